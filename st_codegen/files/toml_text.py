"""TOML as text: the same values always give the same bytes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def table_lines(head: str, table: Mapping[str, Any]) -> list[str]:
    """The lines of a table under its head, `[axis]` or `[[effect]]`; tables in it follow after an empty line."""
    lines = [head, *(f"{key} = {toml_value(value)}" for key, value in table.items() if not isinstance(value, Mapping))]
    for key, value in table.items():
        if isinstance(value, Mapping):
            lines += ["", *table_lines(f"[{head.strip('[]')}.{key}]", value)]
    return lines


def toml_value(value: Any) -> str:
    """A text, number, truth value or list as TOML; numbers have as many digits as give the same float64 again."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quoted(value)
    return repr(float(value)) if isinstance(value, float) else str(int(value))


def _quoted(text: str) -> str:
    """A text in quotes; what is not printable is escaped, so that no mark turns the direction of what is read."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() or _is_half(c) else _escape(ord(c)) for c in escaped) + '"'


def _is_half(character: str) -> bool:
    """Whether it is half of a character (a surrogate), for which TOML has no words: no file can be written with it."""
    return "\ud800" <= character <= "\udfff"


def _escape(number: int) -> str:
    return f"\\u{number:04x}" if number < 1 << 16 else f"\\U{number:08x}"
