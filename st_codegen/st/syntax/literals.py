"""Literals of Structured Text as Python values. Every function raises `ValueError` with a clear text."""

from __future__ import annotations

import math
import re
from fractions import Fraction

MAX_DIGITS = 400
_DURATION_UNITS = {
    "d": 86_400_000_000_000,
    "h": 3_600_000_000_000,
    "m": 60_000_000_000,
    "s": 1_000_000_000,
    "ms": 1_000_000,
    "us": 1_000,
    "ns": 1,
}
_DURATION_PART = re.compile(r"([0-9][0-9_]*(?:\.[0-9]+)?)(ms|us|ns|[dhms])_?", re.IGNORECASE | re.ASCII)
_ESCAPES = {"$": "$", "'": "'", '"': '"', "l": "\n", "n": "\n", "p": "\f", "r": "\r", "t": "\t"}
_ESCAPE = re.compile(r"\$(.?)([0-9A-Fa-f]*)", re.DOTALL)


def parse_integer(text: str) -> int:
    """The value of an integer such as `12`, `1_000`, `16#FF_FF` or `-5`."""
    digits = text.replace("_", "")
    if len(digits) > MAX_DIGITS:
        raise ValueError(f"an integer of {len(digits)} digits fits no type")
    sign = -1 if digits.startswith("-") else 1
    digits = digits.lstrip("+-")
    if "#" not in digits:
        return sign * int(digits)
    base, _, body = digits.partition("#")
    if base not in {"2", "8", "16"} or not body:
        raise ValueError(f"'{text}' is no number to the base 2, 8 or 16")
    try:
        return sign * int(body, int(base))
    except ValueError:
        raise ValueError(f"'{text}' has a digit that base {base} does not have") from None


def parse_real(text: str) -> float:
    """The value of a real number such as `1.0E-3`; one beyond the largest LREAL is refused."""
    value = float(text.replace("_", ""))
    if math.isinf(value):
        raise ValueError(f"'{text[:40]}' is larger than the largest LREAL")
    return value


def parse_duration(text: str) -> int:
    """The nanoseconds of a duration such as `1d2h3.5s`, `250us` or `-5ms`.

    Units go from large to small, each once, and only the last may have a fraction, which must be whole nanoseconds.
    """
    body = text.lstrip("+-")
    if len(body) > MAX_DIGITS:
        raise ValueError("this duration has too many digits")
    total, at, last_unit = Fraction(0), 0, math.inf
    while at < len(body):
        part = _DURATION_PART.match(body, at)
        if part is None:
            raise ValueError(f"'{text}' is no duration: a number and one of d, h, m, s, ms, us, ns is expected")
        unit = _DURATION_UNITS[part[2].lower()]
        if unit >= last_unit:
            raise ValueError(f"the units of '{text}' must go from large to small")
        at, last_unit = part.end(), unit
        if "." in part[1] and at < len(body):
            raise ValueError(f"only the last unit of '{text}' may have a fraction")
        total += Fraction(part[1].replace("_", "")) * unit
    if not body or total.denominator != 1:
        raise ValueError(f"'{text}' is not a whole number of nanoseconds")
    return -int(total) if text.startswith("-") else int(total)


def parse_characters(text: str) -> str:
    """The characters between quotes, with `$` escapes: `$'`, `$N`, `$41` (two digits; four in a WSTRING)."""
    width = 4 if text.startswith('"') else 2

    def replacement(match: re.Match[str]) -> str:
        first, rest = match[1], match[2]
        digits = (first + rest)[:width]
        if len(digits) == width and re.fullmatch(r"[0-9A-Fa-f]+", digits):
            return chr(int(digits, 16)) + (first + rest)[width:]
        if first.lower() not in _ESCAPES or not first:
            raise ValueError(f"'${first}' is no escape sequence")
        return _ESCAPES[first.lower()] + rest

    return _ESCAPE.sub(replacement, text[1:-1])
