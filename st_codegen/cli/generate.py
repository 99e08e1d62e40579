"""`st-codegen generate`: models in, Structured Text out."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click
from rich.table import Table

from st_codegen.cli.choices import TARGETS
from st_codegen.cli.codes import show_codes
from st_codegen.cli.console import (
    FILE,
    FOLDER,
    GivenModels,
    Whole,
    build_options,
    console,
    models_options,
    outputs_option,
    reading_options,
    refuse_unused,
    say,
    say_next,
    table_of,
)
from st_codegen.cli.costs import Explanation, print_explanation
from st_codegen.errors import counted
from st_codegen.files.text import inert

if TYPE_CHECKING:
    from st_codegen.driver import Generated, Wishes
    from st_codegen.emit.output import FileChange
    from st_codegen.emit.targets import Target
    from st_codegen.ir import OutputKind
    from st_codegen.project.bundle import Bundle
    from st_codegen.proof.explain import Pricing


@click.command(
    "generate",
    epilog="""\b
Examples:
  st-codegen models/ --target twincat
  st-codegen generate models/ --target iec --target twincat --out plc/
  st-codegen models/ --target twincat --with-tests
  st-codegen models/ --target twincat --project library --company Plant
  st-codegen models/ --target iec --with-configuration
  st-codegen models/ --target twincat --profile cx5140 --explain
  st-codegen models/ --layout table --table-limit 256
  st-codegen models/ --outputs class,probability             classifiers: the class, and how probable each class is
  st-codegen generate models/ --target twincat --check      in CI: fail when the files are not up to date""",
)
@models_options
@click.option(
    "-t",
    "--target",
    "targets",
    multiple=True,
    metavar="NAME",
    help=f"What to write, may be given several times: {', '.join(TARGETS)}. Default: twincat.",
)
@click.option(
    "-o",
    "--out",
    type=FOLDER,
    default=Path("generated"),
    help="Folder to write to; each target gets a folder of its own inside.",
)
@click.option(
    "--check",
    "only_check",
    is_flag=True,
    help="Write nothing; print a diff and exit 1 if the files are not up to date.",
)
@click.option("--stat", is_flag=True, help="With --check: a line for each file that is not up to date, no diff.")
@click.option(
    "--limit",
    type=Whole(min=0),
    default=1000,
    help="With --check: the most lines of the diff that are printed; 0 for all.",
)
@click.option("--force", is_flag=True, help="Overwrite generated files that were changed by hand.")
@click.option(
    "--relayout",
    is_flag=True,
    help="Choose layouts and shared tables afresh. Default: those of the files in the folder stay unless others take "
    "at most 70 % of the time, or they no longer fit.",
)
@click.option(
    "--provenance",
    is_flag=True,
    help="With --check: the model files themselves must be the same, not only what was read from them.",
)
@build_options("with_tests", "with_configuration", "with_comparison", "self_check", "with_age", "real")
@build_options("project", "library_version", "company", "namespace", "max_array", "max_bytes")
@click.option(
    "--profile",
    metavar="NAME|FILE",
    help="Choose layouts by the worst case of the emitted text on this controller (see verify); slower. Default: by an "
    "estimate from the model alone.",
)
@click.option(
    "--explain",
    is_flag=True,
    help="Print which inputs are refused, the layouts of each model with prices, and who spends what.",
)
@click.option("--html", type=FILE, help="With --explain: write what it says to this file as a page with pictures.")
@build_options("layout", "table_limit", "outputs_per_cycle")
@outputs_option
@reading_options
def command(
    given: GivenModels,
    targets: tuple[str, ...],
    out: Path,
    only_check: bool,
    stat: bool,
    limit: int,
    force: bool,
    provenance: bool,
    profile: str | None,
    real: bool,
    explain: bool,
    html: Path | None,
    outputs: Collection[OutputKind],
    **wished: Any,
) -> None:
    """Compile MODELS, a folder of model files (or one file), to Structured Text.

    With a bundle.toml the folder is a transmission error bundle and FB_TEPredict and FB_Compensator are generated from
    its models; without one, every model file becomes a function block of its own.
    """
    from st_codegen.driver import generate, wishes_of
    from st_codegen.emit.output import check_place
    from st_codegen.emit.targets import target_named
    from st_codegen.proof.emitted import one_reader
    from st_codegen.proof.prove.range_bound import real_remarks

    if html is not None and (only_check or not explain):
        raise click.UsageError("--html is a page of what --explain says: give --explain, without --check.")
    if only_check:
        refuse_unused("with --check, which writes nothing", "force", "explain")
    else:
        refuse_unused("without --check", "stat", "limit", "provenance")
    chosen = [target_named(name) for name in targets or ("twincat",)]
    pricing = _pricing(chosen, profile, wished["max_array"]) if explain or profile is not None else {}
    for target in chosen:
        check_place(out / target.name)
    wishes = wishes_of(wished, chosen)
    with one_reader():
        bundle = given.load(outputs, real=real)
        for target in chosen if profile is not None else ():
            wishes[target.name]["cost"] = pricing[target.name]
        if only_check:
            _check(bundle, chosen, out, wishes, limit=limit, stat=stat, provenance=provenance)
        explained: list[Explanation] = []
        remarks = real_remarks(bundle.irs)
        announce = None if given.quiet else say
        for target in chosen:
            generated = generate(bundle, target, out, force=force, announce=announce, **wishes[target.name])
            # said once, and of no text that was refused
            for name, text in remarks.items():
                say(f"{name}: {text}")
            remarks = {}
            if not given.quiet:
                _show_generated(generated)
            if explain:
                explained.append(_explanation(bundle, generated, target, pricing[target.name]))
                print_explanation(explained[-1])
    if html is not None:
        from st_codegen.cli.pages import explain_sections, write_pages

        summary, sections = explain_sections(explained)
        write_pages(f"Layouts and times of {given.models}", sections, summary, html, None)
    for place in () if given.quiet else _places(out, chosen):
        say_next(*given.asked_next("verify", place))


def _places(out: Path, chosen: Sequence[Target]) -> Sequence[Path]:
    """The folders that hold what was written and nothing else: older text of another target may be of other options."""
    from st_codegen.proof.runner import target_folders

    written = [out / target.name for target in dict.fromkeys(chosen)]
    return [out] if set(target_folders(out)) == set(written) else written


def _pricing(chosen: Sequence[Target], profile: str | None, max_array: int | None) -> dict[str, Pricing]:
    """What counts the emitted text on a controller, by target."""
    from st_codegen.cost.profile import load_profile
    from st_codegen.cost.profile_files import DEFAULT
    from st_codegen.driver import limits_for
    from st_codegen.proof.explain import Pricing

    machine = load_profile(DEFAULT if profile is None else profile)
    return {target.name: Pricing(target, limits_for(target, max_array), machine) for target in chosen}


def _check(
    bundle: Bundle,
    chosen: Sequence[Target],
    out: Path,
    wishes: Mapping[str, Wishes],
    *,
    limit: int,
    stat: bool,
    provenance: bool,
) -> NoReturn:
    """Show what is not up to date, and end with the exit code that says whether anything is."""
    from st_codegen.driver import differences

    stale = False
    for target in chosen:
        found = differences(bundle, target, out, provenance=provenance, **wishes[target.name])
        stale |= _show(found, limit, stat=stat)
    show_codes(["STC2201"] if stale else [])
    sys.exit(1 if stale else 0)


def _show_generated(generated: Generated) -> None:
    """Print what was written, and what there is to know of it."""
    from st_codegen.emit.output import MANIFEST

    lines = [
        f"warning: {generated.folder / name} is no longer generated; it stays, since it was changed after it was "
        "written"
        for name in generated.changed
    ]
    if generated.removed:
        listed = ", ".join(generated.removed[:8]) + (", .." if len(generated.removed) > 8 else "")
        lines.append(f"removed, since no longer generated: {counted(len(generated.removed), 'file')}: {listed}")
    lines += filter(None, (decision.change for decision in generated.compiled.decisions))
    lines += generated.purpose.remarks() if generated.purpose else ()
    say(f"{generated.folder}: {counted(len(generated.files), 'file')} and {MANIFEST}, the list of what was written")
    console.print(_files_table(generated))
    console.print(_models_table(generated))
    for line in lines:
        say(line)


def _explanation(bundle: Bundle, generated: Generated, target: Target, pricing: Pricing) -> Explanation:
    """What `--explain` says of one target."""
    from st_codegen.proof.explain import input_limits, prices
    from st_codegen.proof.runner import GeneratedCode
    from st_codegen.proof.verify import cycle_cost

    return Explanation(
        target.name,
        tuple(input_limits(bundle.irs)),
        tuple(prices(generated.compiled, pricing)),
        cycle_cost(GeneratedCode(generated.folder, target.dialect), pricing.profile),
    )


def _show(found: Iterable[FileChange], limit: int, *, stat: bool) -> bool:
    """Print differences, `limit` lines of them (0: all) or a line for each file; whether there is any."""
    files = lines = cut = 0
    for difference in found:
        files += 1
        if stat:
            more, fewer = difference.counts()
            click.echo(f"{difference.path}: +{more:,} -{fewer:,} lines")
            continue
        for line in difference.lines():
            lines += 1
            if not limit or lines <= limit:
                click.echo(inert(line.rstrip("\n")))
        cut += bool(limit) and lines > limit
    if not stat and limit and lines > limit:
        where = counted(cut, "file")
        click.echo(f".. {counted(lines - limit, 'more line')} in {where}; --limit 0 shows all, --stat a line a file")
    return files > 0


def _files_table(generated: Generated) -> Table:
    table = table_of(None, "file", ">bytes")
    for name, size in generated.files.items():
        table.add_row(name, f"{size:,}")
    return table


def _models_table(generated: Generated) -> Table:
    """Where each model went, and what its block's tables take in the controller's memory."""
    table = table_of(None, "model", "layout", "block", ">bytes of tables")
    for row in generated.models():
        table.add_row(*row)
    return table
