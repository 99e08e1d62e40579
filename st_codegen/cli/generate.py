"""`st-codegen generate`: models in, Structured Text out."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table

from st_codegen.cli.choices import PROJECT_FORMS, TARGETS
from st_codegen.cli.codes import show_codes
from st_codegen.cli.console import (
    Whole,
    array_option,
    bytes_option,
    console,
    layout_options,
    models_argument,
    names_options,
    outputs_option,
    progress_bar,
    quiet_option,
    trust_option,
)
from st_codegen.cli.costs import Explanation, print_explanation

if TYPE_CHECKING:
    from st_codegen.driver import Generated
    from st_codegen.emit.blocks.application import Packaging
    from st_codegen.emit.output import FileChange
    from st_codegen.ir import OutputKind
    from st_codegen.passes.choose import CostFunction


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
@models_argument
@names_options
@click.option(
    "-t",
    "--target",
    "targets",
    multiple=True,
    metavar="NAME",
    help=f"Dialect to write, may be given several times: {', '.join(TARGETS)}. Default: twincat.",
)
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("generated"),
    show_default=True,
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
    show_default=True,
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
@click.option(
    "--with-tests",
    is_flag=True,
    help="Also write TcUnit suites that compare every block with the library's answers, and a task that runs them.",
)
@click.option(
    "--with-configuration",
    is_flag=True,
    help="For iec: write one file with programs that call the blocks and a CONFIGURATION that runs them.",
)
@click.option(
    "--with-comparison",
    is_flag=True,
    help="For twincat: also write the programs that `compare` and `record` need on the controller.",
)
@click.option(
    "--project",
    type=click.Choice(PROJECT_FORMS),
    default=PROJECT_FORMS[0],
    show_default=True,
    help="For TwinCAT: a solution that opens by itself, a PLC project alone to be added to a solution of yours, or a "
    "library of the blocks, without programs and tasks.",
)
@click.option("--library-version", metavar="1.0.0.0", help="With --project library: its version. Default: 1.0.0.0.")
@click.option("--company", metavar="NAME", help="With --project library: who offers it.")
@click.option("--namespace", metavar="NAME", help="With --project library: its namespace. Default: the project's name.")
@array_option
@bytes_option
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
@click.option(
    "--html",
    type=click.Path(path_type=Path, dir_okay=False),
    help="With --explain: write what it says to this file as a page with pictures.",
)
@layout_options
@outputs_option
@trust_option
@quiet_option
def command(
    models: Path,
    names: dict[str, str | None],
    targets: tuple[str, ...],
    out: Path,
    only_check: bool,
    stat: bool,
    limit: int,
    force: bool,
    relayout: bool,
    provenance: bool,
    with_tests: bool,
    with_configuration: bool,
    with_comparison: bool,
    project: str,
    library_version: str | None,
    company: str | None,
    namespace: str | None,
    max_array: int | None,
    max_bytes: int | None,
    explain: bool,
    html: Path | None,
    profile: str | None,
    outputs: Collection[OutputKind],
    trust_pickle: bool,
    quiet: bool,
    **layout: Any,
) -> None:
    """Compile MODELS, a folder of model files (or one file), to Structured Text.

    With a bundle.toml the folder is a transmission error bundle and FB_TEPredict and FB_Compensator are generated from
    its models; without one, every model file becomes a function block of its own.
    """
    from st_codegen.cost.profile import load_profile
    from st_codegen.cost.profile_files import DEFAULT
    from st_codegen.driver import differences, generate, limits_for
    from st_codegen.emit.targets import target_named
    from st_codegen.passes.choose import Layout, Options, simple_cost
    from st_codegen.project.bundle import load
    from st_codegen.proof.explain import Pricing, input_limits, prices
    from st_codegen.proof.runner import GeneratedCode
    from st_codegen.proof.verify import cycle_cost

    if html is not None and (only_check or not explain):
        raise click.UsageError("--html is a page of what --explain says: give --explain, without --check.")
    machine = load_profile(profile or DEFAULT)
    explained: list[Explanation] = []
    options = Options(
        Layout(layout["layout"]),
        table_bytes=layout["table_limit"] * 1024,
        outputs_per_cycle=layout["outputs_per_cycle"],
        data_bytes=max_bytes,
    )
    chosen = [target_named(name) for name in targets or ("twincat",)]
    packaging = _packaging(project, library_version, company, namespace)
    able = any(target.has_project_forms for target in chosen)
    with progress_bar("loading", quiet=quiet) as progress:
        bundle = load(models, trust_pickle=trust_pickle, outputs=outputs, progress=progress, **names)
    pricing = {target.name: Pricing(target, limits_for(target, max_array), machine) for target in chosen}
    costs: dict[str, CostFunction] = {name: simple_cost if profile is None else own for name, own in pricing.items()}
    if only_check:
        stale = False
        for target in chosen:
            found = differences(
                bundle,
                target,
                out,
                max_array=max_array,
                options=options,
                with_tests=with_tests,
                with_configuration=with_configuration,
                with_comparison=with_comparison,
                packaging=packaging if target.has_project_forms or not able else None,
                cost=costs[target.name],
                relayout=relayout,
                provenance=provenance,
            )
            stale |= _show(found, limit, stat=stat)
        show_codes(["STC2201"] if stale else [])
        sys.exit(1 if stale else 0)
    for target in chosen:
        generated = generate(
            bundle,
            target,
            out,
            max_array=max_array,
            options=options,
            with_tests=with_tests,
            with_configuration=with_configuration,
            with_comparison=with_comparison,
            packaging=packaging if target.has_project_forms or not able else None,
            cost=costs[target.name],
            relayout=relayout,
            force=force,
            announce=None if quiet else lambda text: console.print(text, soft_wrap=True),
        )
        if not quiet:
            console.print(f"{generated.folder}: {len(generated.files)} file(s)", soft_wrap=True)
            console.print(_files_table(generated))
            console.print(_models_table(generated))
            for name in generated.changed:
                console.print(
                    f"warning: {generated.folder / name} is no longer generated; it stays, since it was changed after "
                    "it was written",
                    soft_wrap=True,
                )
            for change in filter(None, (decision.change for decision in generated.compiled.decisions)):
                console.print(change, soft_wrap=True)
            for remark in generated.purpose.remarks() if generated.purpose else ():
                console.print(remark, soft_wrap=True)
        if explain:
            entry = Explanation(
                target.name,
                tuple(input_limits(bundle.irs)),
                tuple(prices(generated.compiled, pricing[target.name])),
                cycle_cost(GeneratedCode(generated.folder, target.dialect), machine),
            )
            print_explanation(entry)
            explained.append(entry)
    if html is not None:
        from st_codegen.cli.pages import explain_sections, write_pages

        summary, sections = explain_sections(explained)
        write_pages(f"Layouts and times of {models}", sections, summary, html, None)


def _packaging(project: str, version: str | None, company: str | None, namespace: str | None) -> Packaging:
    """The form of the project. Raises InputError for what only libraries have."""
    from st_codegen.emit.blocks.application import Packaging, ProjectForm
    from st_codegen.errors import InputError

    form = ProjectForm(project)
    given = {"--library-version": version, "--company": company, "--namespace": namespace}
    wrong = [option for option, value in given.items() if value]
    if wrong and form is not ProjectForm.LIBRARY:
        raise InputError(f"{', '.join(wrong)}: libraries have these; give --project library, or leave them out")
    return Packaging(form, version or Packaging.version, company or "", namespace or "")


def _show(found: Iterable[FileChange], limit: int, *, stat: bool) -> bool:
    """Print differences, `limit` lines of them (0: all) or a line for each file; whether there is any."""
    files = lines = 0
    for difference in found:
        files += 1
        if stat:
            more, fewer = difference.counts()
            click.echo(f"{difference.path}: +{more:,} -{fewer:,} lines")
            continue
        for line in difference.lines():
            lines += 1
            if not limit or lines <= limit:
                click.echo(line.rstrip("\n"))
    if not stat and limit and lines > limit:
        click.echo(f".. {lines - limit:,} more lines in {files:,} file(s); --limit 0 shows all, --stat a line a file")
    return files > 0


def _files_table(generated: Generated) -> Table:
    table = Table()
    table.add_column("file")
    table.add_column("bytes", justify="right")
    for name, size in generated.files.items():
        table.add_row(name, f"{size:,}")
    return table


def _models_table(generated: Generated) -> Table:
    """Where each model went, and what its block's tables take in the controller's memory."""
    table = Table()
    for name in ("model", "layout", "block", "bytes of tables"):
        table.add_column(name, justify="right" if name.startswith("bytes") else "left")
    for row in generated.models():
        table.add_row(*row)
    return table
