"""Numbers as people write them in files and on the command line: plain digits and nothing that only Python takes."""

from __future__ import annotations

import math
import re

_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_WHOLE = re.compile(r"[+-]?[0-9]+")
_MOST_DIGITS = 18
_SPECIAL = re.compile(r"[+-]?(?:inf|infinity|nan)", re.IGNORECASE)


def parse_number(text: str, *, decimal_comma: bool = False, is_finite: bool = True) -> float:
    """The float64 nearest to a decimal number; blanks around it are passed over.

    decimal_comma: a comma is read like a point; is_finite: `nan` and `inf` are refused. Raises ValueError for all else,
    also for what Python would take (`1_0`, digits of other scripts) and for numbers too large for float64.
    """
    stripped = text.strip(" \t")
    if _SPECIAL.fullmatch(stripped):
        if is_finite:
            raise ValueError(f"{text!r} is not finite")
        return float(stripped)
    if decimal_comma:
        stripped = stripped.replace(",", ".")
    if not _NUMBER.fullmatch(stripped):
        raise ValueError(f"{text!r} is not a number")
    value = float(stripped)
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is too large for a 64-bit number")
    return value


def parse_whole(text: str) -> int:
    """A whole number of at most 18 digits; blanks around it are passed over. Raises ValueError for all else."""
    stripped = text.strip(" \t")
    if not _WHOLE.fullmatch(stripped):
        raise ValueError(f"{text!r} is not a whole number")
    if len(stripped.lstrip("+-")) > _MOST_DIGITS:
        raise ValueError(f"{text!r} has more than {_MOST_DIGITS} digits")
    return int(stripped)


def percent(share: float) -> str:
    """A share in percent with one digit, of which 0.0% is none and 100.0% all."""
    text = f"{share:.1%}"
    if text == "0.0%" and share > 0.0:
        return "below 0.1%"
    return "above 99.9%" if text == "100.0%" and share < 1.0 else text


def plain_number(value: float) -> str:
    """A number with six digits, or with as many as it takes to tell it from all others."""
    text = f"{value:g}"
    return text if float(text) == value else repr(float(value))
