"""The names of the standard functions."""

from __future__ import annotations

from functools import cache

from st_codegen.st.types import NUMBERS

REAL_FUNCTIONS = ("SQRT", "LN", "LOG", "EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN")
SHIFTS = ("SHL", "SHR", "ROL", "ROR")
ARITHMETIC = ("ADD", "SUB", "MUL", "DIV")
COMPARISONS = ("EQ", "NE", "LT", "LE", "GT", "GE")
# The names of the standard for arguments that are given by name; IN1, IN2, .. may go on
PARAMETERS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys((*REAL_FUNCTIONS, "ABS", "TRUNC", "MOVE"), ("IN",)),
    **dict.fromkeys(SHIFTS, ("IN", "N")),
    **dict.fromkeys((*ARITHMETIC, *COMPARISONS, "EXPT"), ("IN1", "IN2")),
    "ATAN2": ("Y", "X"),
    "MIN": ("IN1", "IN2"),
    "MAX": ("IN1", "IN2"),
    "LIMIT": ("MN", "IN", "MX"),
    "SEL": ("G", "IN0", "IN1"),
    "MUX": ("K", "IN0", "IN1"),
    "ADR": ("IN",),
}
EXTENSIBLE = frozenset({"ADD", "MUL", "MIN", "MAX", "MUX"})
REFUSED = {
    "SIZEOF": "SIZEOF depends on how a target aligns memory",
    **dict.fromkeys(
        ("LEN", "LEFT", "RIGHT", "MID", "CONCAT", "INSERT", "DELETE", "REPLACE", "FIND"),
        "functions of strings are not supported",
    ),
    **dict.fromkeys(("TRUNC_INT", "FLOOR", "CEIL"), "not supported: use TRUNC"),
}
_CONVERTIBLE = (*NUMBERS, "TIME", "LTIME", "STRING", "WSTRING")


@cache
def conversions() -> dict[str, tuple[str | None, str]]:
    """Source (None in `TO_X`) and target type of all conversion functions by name."""
    pairs = {f"{a}_TO_{b}": (a, b) for a in _CONVERTIBLE for b in _CONVERTIBLE if a != b}
    return {**pairs, **{f"TO_{b}": (None, b) for b in _CONVERTIBLE}}


def is_standard_function(name: str) -> bool:
    """Whether an upper-case name is that of a supported standard function; the others may be names of variables."""
    return name in PARAMETERS or name in conversions()
