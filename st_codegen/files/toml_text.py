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
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04x}" for c in escaped) + '"'
