"""Which of several layouts of a model is generated.

Every layout of trees computes the same bits, and a factored kernel lies within the bound of the model, so the choice is
one of cost only. `simple_cost` is an estimate from the intermediate representation alone; any other function of a model
may take its place (`CostFunction`), such as one that measures the emitted text.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import singledispatch

import numpy as np

from st_codegen import ir
from st_codegen.errors import InputError
from st_codegen.ir.preorder import larger_first


class Layout(StrEnum):
    """Which layouts of trees the user allows."""

    AUTO = "auto"  # the cheapest
    TREES = "trees"  # nodes as they were trained, for people who want to read them
    RANKED = "ranked"  # nodes that compare ranks, wherever there are such
    CUT = "cut"  # the same, cut into the cells of a coarse grid, wherever that saves levels
    IFS = "ifs"  # nested IFs, where a model is one small tree
    TABLE = "table"  # a table wherever one exists below the limit


@dataclass(frozen=True)
class Options:
    """How models are rewritten before they are printed.

    `table_bytes`: no table has more for one output of a model.
    `max_array`: elements of an array that the target holds; longer lists of thresholds have no layout.
    `outputs_per_cycle`: models are spread over successive calls, so many outputs in each in the mean, so that the
    costliest call is about as cheap as can be (one model is never cut); None: all in every call.
    `data_bytes`: of all tables that are printed, more is an error; None: what the target says. Forests that need more
    memory to be faster stay as they are where it would be exceeded. `layouts`: what is asked for single models, by
    their names, in place of `layout`.
    """

    layout: Layout = Layout.AUTO
    table_bytes: int = 64 * 1024
    max_array: int = 65_536
    outputs_per_cycle: int | None = None
    data_bytes: int | None = None
    layouts: Mapping[str, Layout] = field(default_factory=dict)


#: A layout that is in place gives way to one that takes at most this share of its time.
SAVES_MUCH = 0.7
#: What is in place may be larger than what is chosen anew, by this factor.
MAY_GROW = 1.25


@dataclass(frozen=True)
class Choices:
    """What was chosen for models: the layout of each, and for each block of shared tables the models side by side.

    A retrained model is near a limit, or two layouts cost nearly the same: chosen afresh each time, a row more in the
    training data may rewrite a whole block. What an earlier run chose is therefore kept unless another choice saves
    much or it is no longer possible.
    """

    layouts: Mapping[str, str] = field(default_factory=dict)
    shared: Mapping[str, Sequence[Sequence[str]]] = field(default_factory=dict)


@dataclass(frozen=True)
class CallCost:
    """What one call takes: arithmetic and memory instructions, cache lines touched, bytes of tables."""

    instructions: float = 0.0
    lines: float = 0.0
    table_bytes: int = 0

    def __add__(self, other: CallCost) -> CallCost:
        return CallCost(
            self.instructions + other.instructions, self.lines + other.lines, self.table_bytes + other.table_bytes
        )

    @property
    def nanoseconds(self) -> float:
        """A cold call on a small controller (Atom E3845): two instructions in three cycles, 100 ns a cache line."""
        return self.instructions * 1.5 / 1.91 + self.lines * 100.0


CostFunction = Callable[[ir.ModelIR], CallCost]


@dataclass(frozen=True)
class PricedLayout:
    """One layout of a model, and what it costs."""

    layout: str
    model: ir.ModelIR
    cost: CallCost


#: Bytes of code: of a step of a search, of a split and of a leaf among nested IFs. More searches share a loop.
_SEARCH_CODE, _SPLIT_CODE, _LEAF_CODE, _UNROLLED = 28, 32, 6, 8
#: Lines of code that look up a table, that go down trees as trained, and that go down ranked trees.
_TABLE_LINES, _WALK_LINES, _RANKED_WALK_LINES = 2, 4, 8


def simple_cost(model: ir.ModelIR) -> CallCost:
    """What one call of a model costs, estimated from its operations without printing them."""
    total = CallCost(instructions=8.0 * len(model.features) + 4.0 * len(model.outputs), lines=4.0)
    for op in model.ops:
        ranked = isinstance(op, ir.TreeEnsemble) and model.reads_ranks(op)
        total += _ranked_cost(op) if ranked and isinstance(op, ir.TreeEnsemble) else _cost(op)
    return total


def cheapest(candidates: Sequence[PricedLayout]) -> PricedLayout:
    """The candidate that takes the least time; of equals the smaller one. Raises InputError where there is none."""
    if not candidates:
        raise InputError("no layout fits the limits; raise them or use another layout")
    return min(candidates, key=lambda candidate: (candidate.cost.nanoseconds, candidate.cost.table_bytes))


def preferred(candidates: Sequence[PricedLayout], earlier: str | None) -> PricedLayout:
    """The cheapest candidate, or the `earlier` layout where it is still possible and the cheapest saves little."""
    best = cheapest(candidates)
    kept = next((candidate for candidate in candidates if candidate.layout == earlier), best)
    return best if best.cost.nanoseconds <= SAVES_MUCH * kept.cost.nanoseconds else kept


def priced(layout: str, model: ir.ModelIR, cost: CostFunction) -> PricedLayout:
    """A candidate with its cost."""
    return PricedLayout(layout, model, cost(model))


def _touched(n_bytes: float) -> float:
    """Cache lines of a table that is read from end to end."""
    return n_bytes / 64.0


@singledispatch
def _cost(op: ir.Operation) -> CallCost:
    """The cost of an operation that works column by column; operations that cost something else are registered."""
    return CallCost(instructions=6.0 * op.width, lines=1.0 + _touched(8.0 * op.width), table_bytes=8 * op.width)


@_cost.register
def _(op: ir.Rank) -> CallCost:
    total, steps = CallCost(), [0]
    searched = {column.search: column.highest for column in op.columns}
    for edges in searched.values():
        steps.append(edges.bit_length())
        # the last three steps look at neighbours, which share a cache line
        total += CallCost(instructions=4.0 + 4.0 * steps[-1], lines=max(steps[-1] - 3, 1), table_bytes=8 * edges)
    code = sum(steps) if len(searched) <= _UNROLLED else max(steps)  # one loop for all
    return total + CallCost(instructions=2.0 * op.width, lines=_touched(_SEARCH_CODE * code))


@_cost.register
def _(op: ir.CellTable) -> CallCost:
    lists = sum(axis.stride is None for axis in op.axes)
    return CallCost(
        instructions=3.0 * len(op.axes) + 3.0 * op.width,
        lines=1.0 + lists + _touched(8.0 * op.values.shape[1]) + _TABLE_LINES,
        table_bytes=op.values.nbytes,
    )


@_cost.register
def _(op: ir.TreeEnsemble) -> CallCost:
    visits = op.n_trees * ir.depth_of(op)
    lines = 2.0 * visits + (_WALK_LINES if visits else 0.0)
    return CallCost(12.0 * visits + 12.0 * op.n_trees, lines, 16 * op.n_nodes)


@_cost.register
def _(op: ir.BranchedTree) -> CallCost:
    """The longest path, and the numbers of its leaf."""
    lines = _path_lines(op) + 1.0 + _touched(8.0 * op.leaf_value.shape[1])
    return CallCost(4.0 * ir.depth_of(op) + 6.0 * op.width, lines, op.leaf_value.nbytes)


def _path_lines(op: ir.TreeEnsemble) -> int:
    """Cache lines of code on the longest path of a tree, with larger subtrees first."""
    laid = larger_first(op.roots, op.left, op.right)
    inner = laid.left >= 0
    stop = np.cumsum(np.where(inner, _SPLIT_CODE, _LEAF_CODE))
    first, last = np.append(0, stop[:-1]) // 64, (stop - 1) // 64
    lines = last - first + 1
    for node in np.flatnonzero(inner).tolist():  # parents come before their children
        for child in (laid.left[node], laid.right[node]):
            lines[child] += lines[node] - (first[child] == last[node])
    return int(lines.max())


def _ranked_cost(op: ir.TreeEnsemble) -> CallCost:
    """Two integers a node, side by side; half of the children lie in the line of their parent."""
    cut, numbers = (op.cut, op.numbers) if isinstance(op, ir.CutTrees) else (op, 2 * op.n_nodes)
    visits = op.n_trees * ir.depth_of(cut)
    lines = 0.5 * visits + op.n_trees + _RANKED_WALK_LINES
    return CallCost(7.0 * visits + 10.0 * op.n_trees, lines, 4 * numbers + op.leaf_value.nbytes)


def _reading(instructions: float, numbers: int) -> CallCost:
    """The cost of an operation that reads so many numbers of its tables."""
    return CallCost(instructions, _touched(8.0 * numbers), 8 * numbers)


@_cost.register
def _(op: ir.KernelSum) -> CallCost:
    vectors, columns = op.support_vectors.shape
    return _reading(vectors * (6.0 * columns + 60.0 + 4.0 * op.width), vectors * (columns + op.width))


@_cost.register
def _(op: ir.FactoredKernel) -> CallCost:
    size = op.coefficients.size
    return _reading(80.0 * sum(len(axis) for axis in op.axes) + 8.0 * 1.5 * size, size)


@_cost.register
def _(op: ir.Linear) -> CallCost:
    return _reading(6.0 * op.weights.size, op.weights.size)


@_cost.register
def _(op: ir.SlidingLinear) -> CallCost:
    return _reading(8.0 * len(op.starts) * op.weights.size, op.weights.size)


@_cost.register
def _(op: ir.Scan) -> CallCost:
    once = sum(map(_cost, op.body), CallCost(instructions=6.0 * len(op.initial)))
    return CallCost(len(op.starts) * once.instructions, once.lines, once.table_bytes)
