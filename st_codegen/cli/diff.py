"""`st-codegen diff`: what changed between two generated folders, or two revisions of one."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table

from st_codegen.cli.console import (
    FILE,
    PLACE,
    Whole,
    console,
    progress_bar,
    quiet_option,
    refuse_unused,
    table_of,
    tell,
    trust_option,
)
from st_codegen.cli.costs import profile_option
from st_codegen.errors import counted
from st_codegen.files.number_text import percent, plain_number
from st_codegen.files.text import inert, write_text

if TYPE_CHECKING:
    from st_codegen.proof.review import Change, ModelChange, Review


@click.command(
    "diff",
    epilog="""\b
Examples:
  st-codegen diff main/generated generated
  st-codegen diff old/ new/ --json review.json     for a bot; without a name: on standard output
  st-codegen diff old/ new/ --html review.html --markdown review.md
  st-codegen diff HEAD~1 HEAD models/              two revisions of git: models are compiled first""",
)
@click.argument("old")
@click.argument("new")
@click.argument("path", type=PLACE, required=False)
@click.option("-n", "--rows", type=Whole(min=1), default=10_000, help="Operating points.")
@click.option("--json", "json_file", is_flag=False, flag_value="-", help="Write the review to this file, - for output.")
@click.option("--html", type=FILE, help="Write a page with curves to this file.")
@click.option("--markdown", "markdown_file", type=FILE, help="Write it as Markdown.")
@profile_option
@trust_option
@quiet_option
def command(
    old: str,
    new: str,
    path: Path | None,
    rows: int,
    json_file: str | None,
    html: Path | None,
    markdown_file: Path | None,
    profile: str,
    trust_pickle: bool,
    quiet: bool,
) -> None:
    """Say what changed from OLD to NEW, two folders that `generate` wrote, or two revisions of the folder PATH.

    Models added, removed and changed; trees, nodes, support vectors, bytes, features and ranges before and after; and
    how far each output moved at random points of the operating range, and at which of them most: of the first target
    that both have. The files of all targets are compared. Exit code 1 on a difference.
    """
    from st_codegen.cli.revisions import two_states
    from st_codegen.cost.profile import load_profile
    from st_codegen.proof.review import diff

    if path is None:
        refuse_unused(
            "on folders that are generated; they are for models in revisions of git",
            *("trust_pickle", "features", "max_model_bytes"),
        )
    machine = load_profile(profile)
    with two_states(old, new, path, trust_pickle=trust_pickle) as states, progress_bar("", quiet=quiet) as progress:
        found = diff(*states, rows=rows, profile=machine, progress=progress)
    text = json.dumps(found.as_json(), indent=1) + "\n"
    if json_file == "-":
        click.echo(text, nl=False)
    elif json_file is not None:
        write_text(Path(json_file), text)
    if html is not None or markdown_file is not None:
        from st_codegen.cli.pages import review_sections, write_pages

        summary, sections = review_sections(found, _lines(found), draw=html is not None)
        write_pages(f"From {old} to {new}", sections, summary, html, markdown_file)
    if not quiet and json_file != "-":
        _show(found)
    sys.exit(1 if found.changed else 0)


def _show(found: Review) -> None:
    for line in _lines(found):
        click.echo(inert(line))
    changed = [model for model in found.models if model.outputs and model.changed]
    if shown := [*changed, *(block for block in found.around if block.outputs)]:
        from st_codegen.proof.review import tried_text

        console.print(_table(shown))
        tell(tried_text(changed, found.target, found.around))


#: Changes of labels, or of their numbers, that a line names.
_MOST_LABELS = 5


def _lines(found: Review) -> list[str]:
    if not found.changed:
        return ["no difference"]
    lines = [f"model added: {name}" for name in found.added]
    lines += [f"model removed: {name}" for name in found.removed]
    lines += [_sentence("", change) for change in found.project]
    for model in (*found.models, *found.around):
        lines += [_sentence(f"{model.name}: ", change) for change in model.facts]
        if model.text_changed and not model.answered:
            if model.rows:
                why = f"none of {counted(model.rows, 'point')} that were tried is answered by both texts"
            elif model in found.around:
                why = "other inputs or no range in common"
            else:
                why = "not as many inputs or outputs as before"
            lines.append(f"{model.name}: {why}: its numbers were not compared")
        if model.rows_lost or model.rows_gained:
            lines.append(
                f"{model.name}: of {counted(model.rows, 'operating point')}, {model.rows_lost:,} lost their answer, "
                f"{model.rows_gained:,} gained one"
            )
        lines += [f"{model.name}: {line}" for line in _label_lines(model)]
        if model.changed and model.answered and not model.facts and not any(output.largest for output in model.outputs):
            lines.append(f"{model.name}: text changed, no output moved at {model.points}")
    counts = {kind: sum(1 for k in found.files.values() if k == kind) for kind in ("added", "removed", "changed")}
    files = [f"{count} {kind}" for kind, count in counts.items() if count]
    return [*lines, f"files: {', '.join(files)}"] if files else lines


def _label_lines(model: ModelChange) -> Iterator[str]:
    """Which labels have other numbers than before, and which came in place of which others."""
    if numbers := [f"{label} {old} -> {new}" for label, (old, new) in model.renumbered.items()]:
        yield f"classes have other numbers: {_first(numbers)}; what compares or counts by them must follow"
        if model.answered and not model.labels:
            yield f"no other label at {model.points}"
    if model.labels:
        share = sum(change.share for change in model.labels)
        most = _first([f"{c.before} -> {c.after} {percent(c.share)}" for c in model.labels])
        yield f"another label at {percent(share)} of {model.points}: {most}"


def _first(changes: list[str]) -> str:
    return ", ".join(changes[:_MOST_LABELS]) + (", .." if len(changes) > _MOST_LABELS else "")


def _sentence(prefix: str, change: Change) -> str:
    if isinstance(change.before, int) and isinstance(change.after, int) and not isinstance(change.before, bool):
        return f"{prefix}{change.what}: {change.before:,} -> {change.after:,}"
    return f"{prefix}{change.what}: {_text(change.before)} -> {_text(change.after)}"


def _text(value: object) -> str:
    """Features as name, unit and range; everything else as it is."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return ", ".join(map(_feature, value))
    return str(value)


def _feature(feature: dict[str, Any]) -> str:
    """Name and unit of a feature, and its range where one is known, in all digits, with what it is known from."""
    text = f"{feature['name']} [{feature['unit']}]" if feature["unit"] else str(feature["name"])
    if (known := feature.get("range")) is not None:
        text += f" {plain_number(known[0])} " + ("only" if known[0] == known[1] else f".. {plain_number(known[1])}")
    if source := feature.get("range_from"):
        text += f" ({source}{', limited' if feature.get('limited') else ''})"
    return text


def _table(models: list[ModelChange]) -> Table:
    title = "change of the outputs at random points"
    table = table_of(title, "output", "largest", "mean", "points that moved", "largest at")
    for model in models:
        for output in model.outputs:
            where = ", ".join(f"{key} = {value:.6g}" for key, value in output.where.items()) if output.largest else ""
            sizes = (one if isinstance(one, str) else f"{one:.3g}" for one in output.sizes)
            table.add_row(model.label(output), *sizes, percent(output.moved), where)
    return table
