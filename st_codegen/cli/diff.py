"""`st-codegen diff`: what changed between two generated folders."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table

from st_codegen.cli.console import Whole, console, progress_bar, quiet_option
from st_codegen.files.text import write_text

if TYPE_CHECKING:
    from st_codegen.proof.review import Change, ModelChange, Review


@click.command(
    "diff",
    epilog="""\b
Examples:
  st-codegen diff main/generated generated
  st-codegen diff old/ new/ --json review.json     for a bot; without a name: on standard output""",
)
@click.argument("old", type=click.Path(path_type=Path))
@click.argument("new", type=click.Path(path_type=Path))
@click.option("-n", "--rows", type=Whole(min=1), default=10_000, show_default=True, help="Operating points.")
@click.option("--json", "json_file", is_flag=False, flag_value="-", help="Write the review to this file, - for output.")
@quiet_option
def command(old: Path, new: Path, rows: int, json_file: str | None, quiet: bool) -> None:
    """Say what changed from OLD to NEW, two folders that `generate` wrote.

    Models added, removed and changed; trees, nodes, support vectors, bytes, features and ranges before and after; and
    how far each output moved over the trained range, with the place of the largest change. Exit code 1 on a difference.
    """
    from st_codegen.proof.review import diff

    with progress_bar("comparing", quiet=quiet) as progress:
        found = diff(old, new, rows=rows, progress=progress)
    text = json.dumps(found.as_json(), indent=1) + "\n"
    if json_file == "-":
        click.echo(text, nl=False)
    elif json_file is not None:
        write_text(Path(json_file), text)
    if not quiet and json_file != "-":
        _show(found)
    sys.exit(1 if found.changed else 0)


def _show(found: Review) -> None:
    for line in _lines(found):
        click.echo(line)
    changed = [model for model in found.models if model.outputs and model.changed]
    if changed:
        console.print(_table(changed))


def _lines(found: Review) -> list[str]:
    if not found.changed:
        return ["no difference"]
    lines = [f"model added: {name}" for name in found.added]
    lines += [f"model removed: {name}" for name in found.removed]
    lines += [_sentence("", change) for change in found.project]
    for model in found.models:
        lines += [_sentence(f"{model.name}: ", change) for change in model.facts]
        if model.rows_lost or model.rows_gained:
            lines.append(
                f"{model.name}: of {model.rows:,} operating points, {model.rows_lost:,} lost their answer, "
                f"{model.rows_gained:,} gained one"
            )
        if model.changed and not model.facts and not any(output.largest for output in model.outputs):
            lines.append(f"{model.name}: text changed, no output moved")
    counts = {kind: sum(1 for k in found.files.values() if k == kind) for kind in ("added", "removed", "changed")}
    files = [f"{count} {kind}" for kind, count in counts.items() if count]
    return [*lines, f"files: {', '.join(files)}"] if files else lines


def _sentence(prefix: str, change: Change) -> str:
    if isinstance(change.before, int) and isinstance(change.after, int) and not isinstance(change.before, bool):
        return f"{prefix}{change.what}: {change.before:,} -> {change.after:,}"
    return f"{prefix}{change.what}: {_text(change.before)} -> {_text(change.after)}"


def _text(value: object) -> str:
    """Features as name, unit and range; everything else as it is."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return ", ".join(f"{f['name']} [{f['unit']}] {f['range'][0]:g} .. {f['range'][1]:g}" for f in value)
    return str(value)


def _table(models: list[ModelChange]) -> Table:
    table = Table(title="change of the outputs over the trained range", title_justify="left")
    for name in ("output", "largest", "mean", "largest at"):
        table.add_column(name)
    for model in models:
        for output in model.outputs:
            name = model.name if len(model.outputs) == 1 else f"{model.name}[{output.output}]"
            where = ", ".join(f"{key} = {value:.6g}" for key, value in output.where.items())
            table.add_row(name, f"{output.largest:.3g}", f"{output.mean:.3g}", where)
    return table
