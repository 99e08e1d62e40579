"""`--self-check`: a block that looks whether its own numbers are still those that were written.

In each call it adds a few of its constants to a checksum, from the first to the last and again; in its first call it
also computes a row whose answer is known. Once either fails, `bValid` stays FALSE until the block starts anew.

The checksum is that of Adler (RFC 1950) over four small parts of each number: sign with exponent, and the mantissa's
halves. They are found by comparing, multiplying and cutting alone, each without rounding, so that every dialect has one
text; a single bit that changes in a normal number changes exactly one part, which the sums always show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from st_codegen.emit.blocks.listing import ArrayElement, Listing
from st_codegen.emit.literals import real
from st_codegen.ir import FloatArray

#: Constants that a call looks at: about a thousand instructions.
SLICE = 8
MODULUS = 65_521
#: How a number is brought to 1 .. 2: so many times at most by this power of two.
_SCALES = ((15, 64), (7, 8), (7, 1))


@dataclass(frozen=True)
class CheckRow:
    """A row of inputs, what the block must answer, and how far each output may be from it."""

    inputs: FloatArray
    expected: FloatArray
    allowed: FloatArray


def checksum(values: FloatArray) -> tuple[int, int]:
    """The two sums over the parts of all numbers, as the text computes them."""
    bits = np.ascontiguousarray(values, np.float64).view(np.uint64)
    field = ((bits >> np.uint64(52)) & np.uint64(0x7FF)).astype(np.int64)
    mantissa = (bits & np.uint64(2**52 - 1)).astype(np.int64)
    whole = np.where(field > 0, mantissa + 2**52, 2 * mantissa)
    parts = np.column_stack([field + 4096 * (values < 0), whole >> 26, whole & (2**26 - 1)]).ravel() % MODULUS
    first = (1 + np.cumsum(parts)) % MODULUS
    return int(first[-1]), int(np.sum(first) % MODULUS)


def add_self_check(listing: Listing, results: Sequence[ArrayElement], row: CheckRow | None) -> str:
    """Put the check around the sections of a finished block, of which the last one writes the outputs.

    The block's sections must read `row` in place of the inputs where `nPass` is 0. Returns a sentence for the header.
    """
    if row is None and not listing.tables and not listing.constants:
        return "Self-check: the block has no constants, and no row whose answer is certain."
    listing.local("bIntact", "BOOL", initial="TRUE")
    known = None
    if row is not None:
        listing.local("nPass", "DINT")
        listing.local("bTested", "BOOL")
        known = {
            "results": [
                {"value": value, "whole": listing.variables[value.name].type == "DINT", "number": number}
                for number, value in enumerate(results)
            ],
            "expected": listing.table("CHECK_EXPECTED", "LREAL", row.expected),
            "allowed": listing.table("CHECK_ALLOWED", "LREAL", row.allowed),
        }
    *sections, outputs = listing.sections
    listing.sections.clear()
    values = _constants(listing)
    listing.section("self-check: a few of the constants", "check_constants", **values)
    if row is not None:
        listing.section("self-check: the first call computes a known row, too", "check_begin")
    listing.sections += sections
    listing.section("self-check: what is damaged has no answer", "check_answer", known=known)
    listing.sections.append(outputs)
    if row is not None:
        listing.section("self-check: end of the row", "check_end")
    calls = -(-(values["last"] + 1) // SLICE)
    first = "the first call computes a row whose answer is known, too" if row is not None else "no row is computed"
    return (
        f"Self-check: all {values['last'] + 1} constants in {calls} calls, {SLICE} in each; {first}. Once it finds "
        "damage, bValid stays FALSE."
    )


def _constants(listing: Listing) -> dict[str, Any]:
    """Where each constant of the block stands among all of them, and the checksum of all."""
    for name in ("nCheck", "nCheckAt", "nField", "nScale", "nUpper", "nLower", "nSecondSum"):
        listing.local(name, "DINT")
    listing.local("nFirstSum", "DINT", initial="1")
    listing.local("fCheck", "LREAL")
    parts, values, at = [], [], 0
    for table in listing.tables:
        parts.append({"name": table.name, "type": table.type, "first": at, "last": at + table.last, "array": True})
        values.append(table.values.astype(np.float64))
        at += len(table.values)
    for constant in listing.constants:
        parts.append({"name": constant.name, "type": constant.type, "first": at, "last": at, "array": False})
        values.append(np.array([_number(constant.initial)]))
        at += 1
    first, second = checksum(np.concatenate(values))
    return {
        "parts": parts,
        "scales": [
            {
                "rounds": rounds,
                "exponent": exponent,
                "power": real(2.0**exponent),
                "inverse": real(2.0**-exponent),
                "below": real(2.0 ** (1 - exponent)),
            }
            for rounds, exponent in _SCALES
        ],
        "slice": SLICE,
        "last": at - 1,
        "modulus": MODULUS,
        "first": listing.number("CHECK_FIRST", "DINT", str(first)),
        "second": listing.number("CHECK_SECOND", "DINT", str(second)),
    }


def _number(initial: str) -> float:
    """The value of a constant as it is written."""
    return float(int(initial.rpartition("#")[2], 16)) if "#" in initial else float(initial)
