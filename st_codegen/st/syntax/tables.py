"""Array initialisers of plain numbers as NumPy arrays, in linear time and memory.

A table of a large model is tens of megabytes of text. It is cut into chunks at commas; a chunk is checked by one
regular expression and converted by one NumPy call, so no Python object is made for a single number.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.st.syntax.declarations import TableKind
from st_codegen.st.syntax.literals import parse_integer

CHUNK = 1 << 18
_FLAGS = re.IGNORECASE | re.ASCII
_DIGITS = r"[0-9]++(?:_[0-9]++)*+"
_INTEGER_CELL = rf"\s*+[+-]?+\s*+{_DIGITS}\s*+"
_REAL_CELL = rf"\s*+[+-]?+\s*+{_DIGITS}(?:\.{_DIGITS}(?:E[+-]?+[0-9]++)?+|E[+-]?+[0-9]++)\s*+"
_BOOL_CELL = r"\s*+(?:TRUE|FALSE)\s*+"
_BASED_CELL = rf"\s*+[+-]?+\s*+(?:(?:2|8|16)#[0-9A-F]++(?:_[0-9A-F]++)*+|{_DIGITS})\s*+"


def _list_of(cell: str) -> re.Pattern[str]:
    return re.compile(rf"{cell}(?:,{cell})*+", _FLAGS)


_INTEGERS = _list_of(_INTEGER_CELL)
_REALS = _list_of(_REAL_CELL)
_NUMBERS = _list_of(rf"(?:{_REAL_CELL}|{_INTEGER_CELL})")
_BOOLS = _list_of(_BOOL_CELL)
_BASED = _list_of(_BASED_CELL)
# Integers and reals without what NumPy does not read: underscores, blanks behind signs, and what may not fit LINT
_PLAIN = (
    (_list_of(r"\s*+[+-]?+[0-9]{1,18}+\s*+"), np.int64, TableKind.INTEGER),
    (_list_of(r"\s*+[+-]?+[0-9]++\.[0-9]++(?:E[+-]?+[0-9]++)?+\s*+"), np.float64, TableKind.REAL),
)
_SPACED_SIGN = re.compile(r"([+-])\s+")
# Nineteen digits may not fit LINT; beyond that length the exact path decides
_LONG_INTEGER = re.compile(r"[0-9]{19}")


def parse_table(text: str) -> tuple[NDArray[np.generic], TableKind]:
    """The values between the brackets of `text`, one-dimensional and read-only, and which literals they were.

    Raises `ValueError` when a cell is no number, or an integer fits neither LINT nor ULINT.
    """
    end = len(text) - 1
    parts: list[NDArray[np.generic]] = []
    kinds: set[TableKind] = set()
    at = 1
    while at <= end:
        cut = text.find(",", at + CHUNK, end)
        stop = end if cut < 0 else cut
        values, kind = _parse_chunk(text[at:stop])
        parts.append(values)
        kinds.add(kind)
        at = stop + 1
    kind = kinds.pop() if len(kinds) == 1 else TableKind.MIXED
    if TableKind.BOOL in kinds:
        raise ValueError("a table holds either numbers or TRUE and FALSE, not both")
    table = parts[0] if len(parts) == 1 else np.concatenate([_common(part, parts) for part in parts])
    table.flags.writeable = False
    return table, kind


def _common(part: NDArray[np.generic], parts: list[NDArray[np.generic]]) -> NDArray[np.generic]:
    """A chunk in the type of the whole table: real when one chunk is real, ULINT when one needs it."""
    dtypes = {other.dtype.name for other in parts}
    if "float64" in dtypes:
        return part.astype(np.float64)
    if len(dtypes) > 1 and part.dtype == np.int64:
        if np.min(part.astype(np.int64)) < 0:
            raise ValueError("no integer type holds both the smallest and the largest number of this table")
        return part.astype(np.uint64)
    return part


def _parse_chunk(text: str) -> tuple[NDArray[np.generic], TableKind]:
    for pattern, dtype, kind in _PLAIN:
        if pattern.fullmatch(text):
            return _finite(np.fromstring(text, dtype, sep=",")), kind
    return _other_chunk(text)


def _other_chunk(text: str) -> tuple[NDArray[np.generic], TableKind]:
    if _INTEGERS.fullmatch(text):
        if _LONG_INTEGER.search(text) or "_" in text:
            return _exact_integers(text), TableKind.INTEGER
        return np.fromstring(_SPACED_SIGN.sub(r"\1", text), dtype=np.int64, sep=","), TableKind.INTEGER
    if _REALS.fullmatch(text):
        return _reals(text), TableKind.REAL
    if _NUMBERS.fullmatch(text):
        return _reals(text), TableKind.MIXED
    if _BOOLS.fullmatch(text):
        cells = np.array(text.upper().split(","))
        return np.char.strip(cells) == "TRUE", TableKind.BOOL
    if _BASED.fullmatch(text):
        return _exact_integers(text), TableKind.INTEGER
    raise ValueError(_wrong_cell(text))


def _reals(text: str) -> NDArray[np.generic]:
    return _finite(np.fromstring(_SPACED_SIGN.sub(r"\1", text.replace("_", "")), dtype=np.float64, sep=","))


def _finite(values: NDArray[Any]) -> NDArray[np.generic]:
    if not np.isfinite(values).all():
        raise ValueError("a number of this table is larger than the largest LREAL")
    return values


def _exact_integers(text: str) -> NDArray[np.generic]:
    numbers = [parse_integer("".join(cell.split())) for cell in text.split(",")]
    low, high = min(numbers), max(numbers)
    if low >= -(2**63) and high < 2**63:
        return np.array(numbers, dtype=np.int64)
    if low >= 0 and high < 2**64:
        return np.array(numbers, dtype=np.uint64)
    raise ValueError(f"no integer type holds both {low} and {high}")


def _wrong_cell(text: str) -> str:
    single = re.compile(rf"{_REAL_CELL}|{_BASED_CELL}|{_BOOL_CELL}", _FLAGS)
    cells = text.split(",")
    wrong = next((cell for cell in cells if not single.fullmatch(cell)), None)
    if wrong is None:
        return "a table holds either numbers or TRUE and FALSE, not both"
    return f"'{wrong.strip()[:40]}' is no number" if wrong.strip() else "a number is missing in this table"
