"""The code of ranks and cell tables: short searches of as many steps whatever the data, and one row of a table."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from st_codegen.emit.blocks.listing import ArrayElement, Group, Listing, suffixes
from st_codegen.emit.blocks.operations import Step, lay_out
from st_codegen.ir import CellTable, Rank, RankColumn, TableAxis

#: Numbers of classes from here on do not fit SINT.
_SINT_END = 128

#: More searches than this are written as a loop over the columns, fewer one after another.
_MOST_SEARCHES = 8


@dataclass(frozen=True)
class _RankSearch:
    """One search, and the columns of ranks (by position) that come from it."""

    first: RankColumn
    results: tuple[tuple[int, RankColumn], ...]


def _searches(op: Rank) -> list[_RankSearch]:
    """Columns that differ only in their missing value or their direction share a search."""
    groups: dict[object, list[tuple[int, RankColumn]]] = {}
    for number, column in enumerate(op.columns):
        groups.setdefault(column.search, []).append((number, column))
    return [_RankSearch(results[0][1], tuple(results)) for results in groups.values()]


def halvings(count: int) -> list[int]:
    """The steps of a search among `count` thresholds: each looks that many ahead, and goes there or stays.

    The number of steps does not depend on the data.
    """
    steps = []
    while count > 0:
        half = (count + 1) // 2
        steps.append(half)
        count -= half
    return steps


@lay_out.register
def _(op: Rank, step: Step, listing: Listing) -> None:
    searches = _searches(op)
    if any(search.first.highest for search in searches):
        listing.locals("LREAL", "fX")
    listing.locals("DINT", "nRank")
    joined = len(searches) > _MOST_SEARCHES
    if joined:  # those that take as many steps stand together
        searches.sort(key=lambda search: search.first.highest.bit_length())
    looped = _joined_tables(searches, step, listing) if joined else None
    columns = [
        {
            "position": position,
            "column": search.first.column,
            "steps": [] if joined else [_step(half) for half in halvings(search.first.highest)],
            "table": None
            if joined or not search.first.highest
            else listing.table(step.table("EDGE") + f"_{position}", "LREAL", search.first.edges),
            "results": [_result(number, column, step) for number, column in search.results],
        }
        for position, search in enumerate(searches)
    ]
    total = sum(search.first.highest for search in searches)
    apart = "; a missing value has a place of its own" if step.missing else ""
    listing.section(
        f"where the inputs lie among {total:,} thresholds{apart}", "rank", step=step, columns=columns, looped=looped
    )


def _step(half: int) -> dict[str, int]:
    """A step of a search: how far ahead the threshold lies that it looks at, and how far beyond it goes on."""
    return {"ahead": half - 1, "beyond": half}


def _result(number: int, column: RankColumn, step: Step) -> dict[str, object]:
    """One column of ranks: from which end it counts, and the rank of a missing value."""
    return {
        "index": number,
        "highest": column.highest,
        "descending": column.descending,
        "missing": column.missing,
        "flag": None if step.missing is None else step.missing[column.column],
    }


def _joined_tables(searches: list[_RankSearch], step: Step, listing: Listing) -> dict[str, object]:
    """All thresholds in one table (or several where it would be too long), searched in loops.

    A search among n thresholds, 2^k <= n < 2^(k+1), first looks at number 2^k (counted from 1): beyond it the rank is
    at least 2^k, so that the last 2^k ranks are left, otherwise the first 2^k are. From there on all searches of the
    same k take the same steps: halves of powers of two.
    """
    listing.local("nBase", "DINT")
    counts = [search.first.highest for search in searches]
    parts = []
    runs = listing.chunks(counts, "column")
    for suffix, (first, stop) in zip(suffixes(len(runs)), runs, strict=True):
        run = searches[first:stop]
        starts = np.cumsum([0, *counts[first:stop]])
        groups = [Group(f"column {s.first.column}", starts[n], starts[n + 1]) for n, s in enumerate(run)]
        edges = np.concatenate([search.first.edges for search in run])
        table = listing.table(step.table(f"EDGE{suffix}"), "LREAL", edges if len(edges) else np.zeros(1), groups)
        jumps = [count + 1 - (1 << (count.bit_length() - 1)) if count else 0 for count in counts[first:stop]]
        loops = _runs_of_bits(counts[first:stop])
        listing.loop("nColumn", *(high - low for _, low, high in loops))
        parts.append(
            {
                "column": listing.table(
                    step.table(f"EDGE_COLUMN{suffix}"), "DINT", [search.first.column for search in run]
                ),
                "start": listing.table(step.table(f"EDGE_START{suffix}"), "DINT", starts[:-1]),
                "jump": listing.table(step.table(f"EDGE_JUMP{suffix}"), "DINT", jumps),
                "table": table,
                "loops": [
                    {
                        "first": first + low,
                        "last": first + high - 1,
                        "before": first,
                        "low": low,
                        # the first one goes beyond by a jump of its column
                        "steps": [_step(1 << level) for level in reversed(range(bits))],
                    }
                    for bits, low, high in loops
                ],
            }
        )
    return {"found": listing.local(f"anFound{step.number}", "DINT", len(searches)), "parts": parts}


def _runs_of_bits(counts: list[int]) -> list[tuple[int, int, int]]:
    """Bits, first and last (not included) of searches that stand together and take as many steps."""
    bits = [count.bit_length() for count in counts]
    edges = [0, *(at for at in range(1, len(bits)) if bits[at] != bits[at - 1]), len(bits)]
    return [(bits[low], low, high) for low, high in pairwise(edges)]


@lay_out.register
def _(op: CellTable, step: Step, listing: Listing) -> None:
    kind, stored = "LREAL", "LREAL"
    if step.whole:
        kind, stored = "DINT", "SINT" if np.all(op.values < _SINT_END) else "DINT"
    cells, width = op.values.shape
    if width:
        listing.locals("DINT", "nCell", *(["nBase"] if width > 1 else []))
    rows = max(listing.max_array // max(width, 1), 1)
    starts = range(0, cells if width else 0, rows)
    parts = []
    for suffix, start in zip(suffixes(len(starts)), starts, strict=True):
        stop = min(start + rows, cells)
        values = op.values[start:stop].ravel()
        name = listing.table(
            step.table(f"CELL{suffix}"),
            stored,
            values.astype(np.int64) if step.whole else values,
            _row_groups(op, start, stop),
        )
        parts.append(
            {
                "name": name,
                "stop": stop,
                "first": start,
                "assignments": [
                    {"output": output, "column": int(column)} for output, column in enumerate(op.stored) if column >= 0
                ],
            }
        )
    fixed = np.flatnonzero(op.stored < 0)
    constant = None
    if len(fixed):
        numbers = op.constant[fixed]
        constant = listing.table(step.table("CONSTANT"), kind, numbers.astype(np.int64) if step.whole else numbers)
    size = " x ".join(map(str, op.shape))
    listing.section(
        f"one row of a table of {size} cells" if width else "a constant",
        "cells",
        step=step,
        axes=[_skipped(axis, position, step, listing) for position, axis in enumerate(op.axes)],
        parts=parts,
        width=width,
        constant=constant,
        fixed=[int(output) for output in fixed],
        widened=stored == "SINT",
    )


def _skipped(axis: TableAxis, position: int, step: Step, listing: Listing) -> dict[str, object]:
    """How many rows the rank of an axis skips: so many each (`stride`), or by a table."""
    table = None
    if axis.stride is None:
        table = listing.table(step.table("SKIP") + f"_{position}", "DINT", axis.offset)
    return {"rank": ArrayElement(step.source, axis.column), "stride": axis.stride, "table": table}


def _row_groups(op: CellTable, start: int, stop: int) -> list[Group]:
    """A line starts with each run of cells along the last axis, under the cell numbers of the other axes."""
    width = op.values.shape[1]
    run = op.shape[-1]
    groups = []
    at = start
    while at < stop:
        end = min((at // run + 1) * run, stop)
        cell = np.unravel_index(at, op.shape)
        label = "" if len(op.shape) == 1 else f"cells {', '.join(str(int(n)) for n in cell[:-1])}, *"
        groups.append(Group(label.replace("*", "all"), (at - start) * width, (end - start) * width))
        at = end
    return groups
