"""Forests cut into cells: the trees of each cell of a coarse grid of ranks, without what no row of the cell meets.

A tree of a forest with random thresholds is deep, and most of its splits lie far away from any one input. The ranks of
the two features with the most thresholds are cut into slabs of equal numbers of ranks; where two slabs meet, a cell,
each tree is left with about half of its levels. The cells share equal subtrees, so that the nodes do not even double.
The leaves that a row meets are those of the whole trees, in the same order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from st_codegen.ir import CutTrees, IntArray, ModelIR, Rank, RankSlabs, TreeEnsemble, depth_of
from st_codegen.ir.subtrees import distinct_families, subtrees
from st_codegen.passes.boxes import Boxes, Parts

#: Slabs of a feature in the first attempt, and fewest that are worth their search.
_MOST, _FEWEST = 12, 4
#: Features that are cut. More cells share less.
_AXES = 2
#: The nodes of all cells take at most this many times the memory of the whole trees.
_GROWTH = 2.0
#: With more features than this, two of them decide little.
_FEATURES = 4
#: Trees that are not this deep gain nothing.
_DEEP = 8
#: Nodes of an ensemble that are cut in seconds.
_NODES = 500_000


def cut_into_cells(model: ModelIR, max_array: int) -> ModelIR | None:
    """The model, whose trees are on ranks, with each ensemble cut into cells; None where one gains nothing by it.

    A tree in all its cells takes no more than an array of `max_array` elements.
    """
    ops = list(model.ops)
    found = False
    for number, op in enumerate(ops):
        if not isinstance(op, TreeEnsemble):
            continue
        rank = ops[op.inputs[0] - 1]
        cut = _cut(rank, op, max_array, accepts_nan=model.accepts_nan) if isinstance(rank, Rank) else None
        if cut is None:
            return None
        ops[number], found = cut, True
    return replace(model, ops=tuple(ops)) if found else None


def _cut(rank: Rank, op: TreeEnsemble, longest: int, *, accepts_nan: bool) -> CutTrees | None:
    groups = _columns_by_search(rank)
    if op.n_nodes > _NODES or depth_of(op) < _DEEP or not _AXES <= len(groups) <= _FEATURES:
        return None
    # along the features in which leaves are short, few of them lie in several slabs
    boxes = Boxes.of(op, *rank.ends(accepts_nan=accepts_nan))
    alone = [np.count_nonzero(boxes.staying(_Axis.of(rank, group, _FEWEST, accepts_nan))) for group in groups]
    chosen = [groups[at] for at in np.argsort(alone, kind="stable")[:_AXES]]
    whole, wanted = int(_numbers(op, subtrees(op).number, 1).sum()), _MOST
    for _ in range(2):
        axes = [_Axis.of(rank, group, wanted, accepts_nan) for group in chosen]
        slabs = tuple(axis.slabs for axis in axes)
        cut = boxes.cut(axes)
        equal = subtrees(cut).number
        numbers = _numbers(cut, equal, cut.n_trees // op.n_trees)
        size = int(numbers.sum())
        if size <= _GROWTH * whole and numbers.max() <= longest:
            return CutTrees(**vars(op), slabs=slabs, cut=cut, numbers=size, equal=equal)
        # what is added grows about as the number of slabs
        wanted = int(wanted * min((_GROWTH - 1) * whole / max(size - whole, 1), longest / numbers.max()))
        if wanted < _FEWEST:
            break
    return None


def _numbers(op: TreeEnsemble, equal: IntArray, together: int) -> IntArray:
    """Integers that the nodes of each run of trees take: two a root, four for two children that are written once."""
    return 4 * distinct_families(op, equal, together) + 2 * together


def _columns_by_search(rank: Rank) -> list[list[int]]:
    """Columns that count among the same thresholds of a feature: their ranks differ where a value is missing only."""
    groups: dict[object, list[int]] = {}
    for number, column in enumerate(rank.columns):
        groups.setdefault((column.search, column.descending), []).append(number)
    return list(groups.values())


@dataclass(frozen=True)
class _Axis(Parts):
    """An axis of the grid: its slabs, and the first and last rank of its columns in each."""

    slabs: RankSlabs

    @classmethod
    def of(cls, rank: Rank, group: list[int], wanted: int, accepts_nan: bool) -> _Axis:
        """Slabs of equal numbers of ranks; missing values have one of their own, the first or the last."""
        columns = [rank.columns[number] for number in group]
        highest, missing = columns[0].highest, columns[0].missing
        width = -(-(highest + 1) // wanted)
        shift = 0 if not accepts_nan else width if missing < 0 else -(highest + 1) % width
        last = max(highest, missing) if accepts_nan else highest
        slabs = RankSlabs(group[0], width, shift, (last + shift) // width + 1)
        start = np.arange(slabs.count) * width - shift
        low = np.repeat(np.maximum(start, 0)[:, None], len(group), axis=1)
        high = np.repeat(np.minimum(start + width - 1, highest)[:, None], len(group), axis=1)
        if accepts_nan:
            at = (missing + shift) // width
            low[at] = high[at] = [column.missing for column in columns]
        return cls(group, low.astype(np.int32), high.astype(np.int32), slabs)
