"""The codes of messages, below them on standard error."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import click

from st_codegen.diagnostics import code_for
from st_codegen.errors import StCodegenError


def codes_of(error: Exception) -> tuple[str, ...]:
    """The codes of an error that a user can mend."""
    if isinstance(error, StCodegenError):
        return error.codes
    names = [name for kind in type(error).__mro__ for name in (kind.__name__, f"{kind.__module__}.{kind.__name__}")]
    return (code_for("", [name.replace("_csv.", "csv.") for name in names]),)


def show_codes(codes: Iterable[str]) -> None:
    """A line that names the codes of a message, and the command that explains them."""
    shown: Sequence[str] = list(dict.fromkeys(codes))
    if shown:
        which = shown[0] if len(shown) == 1 else "CODE"
        click.echo(f"{', '.join(shown)}: st-codegen explain {which} says what to do", err=True)
