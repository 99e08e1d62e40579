"""`--self-check`: a block that looks whether its own numbers are still those that were written.

In each call it adds a few of its constants to a checksum, from the first to the last and again; in its first call it
also computes a row whose answer is known. Once either fails, `bValid` stays FALSE until the block starts anew.

The checksum is CRC-32 (ISO-HDLC, that of zlib) over the bits of each number, in parts of 16, the upper ones first. A
LREAL's bits are found by comparing, multiplying and cutting alone, each without rounding, so that every dialect has one
text. A bit that changes in one number changes at most 32 bits in a row, which the checksum always shows.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from st_codegen.emit.blocks.listing import ArrayElement, BlockVariable, Listing, Table
from st_codegen.emit.literals import real
from st_codegen.errors import counted
from st_codegen.ir import AnyArray, FloatArray

#: Constants that a call looks at: some two thousand instructions.
SLICE = 8
#: The variable that says that no damage was found.
INTACT = "bIntact"
_BITS = "DWORD#16#{:X}"
#: How a number is brought to 1 .. 2: so many times at most by this power of two.
_SCALES = ((15, 64), (7, 8), (7, 1))


@dataclass(frozen=True)
class CheckRow:
    """A row of inputs, what the block must answer, and how far each output may be from it."""

    inputs: FloatArray
    expected: FloatArray
    allowed: FloatArray


def checksum(numbers: Sequence[AnyArray]) -> int:
    """CRC-32 of all numbers, of which integers have 32 bits and all others 64, as the text computes it."""
    found = 0
    for values in numbers:
        whole = np.issubdtype(values.dtype, np.integer)
        words = values.astype("<i8").astype("<i4") if whole else values.astype("<f8") + 0.0  # no sign of a zero
        parts = words.view("<u2").reshape(len(values), -1)[:, ::-1]
        found = zlib.crc32(parts.tobytes(), found)
    return found


def _polynomial() -> list[int]:
    """What four bits that leave the sum add to it, as DINT has it."""
    found = np.arange(16, dtype=np.uint32)
    for _ in range(4):
        found = np.where(found & 1, found >> 1 ^ 0xEDB88320, found >> 1).astype(np.uint32)
    return found.view(np.int32).tolist()


def add_self_check(listing: Listing, results: Sequence[ArrayElement], row: CheckRow | None) -> str:
    """Put the check around the sections of a finished block, of which the last one writes the outputs.

    The block's sections must read `row` in place of the inputs where `nPass` is 0. Returns a sentence for the header.
    """
    if row is None and not listing.tables and not listing.constants:
        return "Self-check: the block has no constants, and no row whose answer is certain."
    listing.local(INTACT, "BOOL", initial="TRUE")
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
        f"Self-check: CRC-32 of all {values['last'] + 1} constants in {counted(calls, 'call')}, {SLICE} in each; "
        f"{first}. Once it finds damage, bValid stays FALSE."
    )


def _constants(listing: Listing) -> dict[str, Any]:
    """Where each constant of the block stands among all of them, and the checksum of all."""
    listing.locals("DINT", "nCheck", "nCheckAt", "nField", "nScale", "nPart", "nParts")
    listing.local("anPart", "DINT", 4)
    listing.local("fCheck", "LREAL")
    table = listing.table("CHECK_BITS", "DINT", _polynomial())
    parts: list[dict[str, Any]] = []
    values: list[AnyArray] = []
    at = 0
    every: tuple[Table | BlockVariable, ...] = (*listing.tables, *listing.constants)
    for part in every:
        numbers = part.values if isinstance(part, Table) else np.array([_number(part.initial)])
        values.append(numbers.astype(np.float64 if part.type == "LREAL" else np.int64))
        last, array = at + len(numbers) - 1, isinstance(part, Table)
        parts.append({"name": part.name, "type": part.type, "first": at, "last": last, "array": array})
        at = last + 1
    whole = _BITS.format(2**32 - 1)
    listing.local("nSum", "DWORD", initial=whole)
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
        "table": table,
        "all": whole,
        "part_mask": _BITS.format(0xFFFF),
        "place_mask": _BITS.format(0xF),
        "checksum": listing.number("CHECK_SUM", "DWORD", _BITS.format(checksum(values))),
    }


def _number(initial: str) -> int | float:
    """The value of a constant as it is written."""
    if "#" in initial:
        return int(initial.rpartition("#")[2], 16)
    return float(initial) if "." in initial else int(initial)
