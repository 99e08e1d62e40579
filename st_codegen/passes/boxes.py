"""Trees on ranks without the splits that send all rows one way: of all rows, or of each of several parts of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from st_codegen.ir import BoolArray, Int32Array, IntArray, TreeEnsemble
from st_codegen.ir.arrays import AnyArray
from st_codegen.ir.preorder import Links, ends_in_preorder, preorder
from st_codegen.ir.trees import with_nodes

#: Answers kept at once, about, to whether a node stays in a cell.
_KEPT = 8_000_000


@dataclass(frozen=True)
class Parts:
    """Parts of all rows: the lowest and the highest rank of some columns in each, shape (parts, columns)."""

    columns: list[int]
    low: Int32Array
    high: Int32Array


@dataclass(frozen=True)
class Boxes:
    """Trees in preorder, the first node behind the subtree of each, and whether rows with given ranks meet a node."""

    op: TreeEnsemble
    end: Int32Array
    met: BoolArray

    @classmethod
    def of(cls, op: TreeEnsemble, low: Int32Array, high: Int32Array) -> Boxes:
        """Boxes of ranks of columns from `low` to `high`, one a row; trees that are not in preorder are laid out.

        What a split does depends on what is left of its own column. That is told by the nearest split of this column
        above it, so that the memory grows with the nodes, however many columns there are.
        """
        end = ends_in_preorder(op.roots, op.left, op.right)
        if end is None:
            layout = preorder(op.roots, op.left, op.right)
            return cls.of(with_nodes(op, layout, layout.order), low, high)
        # the splits of one column after those of another, and how many of its own column each one has above it: those
        # that begin before it but for those that have ended
        inner = np.flatnonzero(op.split >= 0)
        node = inner.take(_order(op.split.take(inner)))
        column = op.split.take(node).astype(np.int64)
        start = column * (op.n_nodes + 1)
        ended = np.searchsorted(np.sort(start + end.take(node)), start + node, side="right")
        above = np.arange(len(node)) - ended
        at, right = op.threshold.take(node).astype(np.int32), op.right.take(node)
        lowest, highest = low.take(column), high.take(column)
        levels = np.split(_order(above), np.cumsum(np.bincount(above)))
        for parents, here in pairwise(levels[:-1]):
            parent = parents.take(np.searchsorted(parents, here) - 1)
            is_right, limit = node.take(here) >= right.take(parent), at.take(parent)
            before, behind = lowest.take(parent), highest.take(parent)
            lowest[here] = np.where(is_right, np.maximum(before, limit + 1), before)
            highest[here] = np.where(is_right, behind, np.minimum(behind, limit))
        missed = np.concatenate([op.left.take(node)[lowest > at], right[highest <= at]])
        return cls(op, end, _outside(missed, end))

    def staying(self, parts: Parts | None = None) -> BoolArray:
        """Whether a node stays for the rows of a part, or of the one part that all rows are; shape (parts, nodes).

        The leaves that rows of the part meet stay, and the splits that send such rows both ways.
        """
        op = self.op
        met = np.repeat(self.met[None], 1 if parts is None else len(parts.low), axis=0)
        if parts is not None:
            place = np.full(len(op.columns) + 1, -1)  # the last is that of leaves
            place[parts.columns] = np.arange(len(parts.columns))
            number = place.take(op.split)
            node = np.flatnonzero(number >= 0)
            number, at = number.take(node), op.threshold.take(node).astype(np.int32)
            left, right = op.left.take(node), op.right.take(node)
            for part, (low, high) in enumerate(zip(parts.low, parts.high, strict=True)):
                missed = np.concatenate([left[low.take(number) > at], right[high.take(number) <= at]])
                met[part] &= _outside(missed, self.end)
        inner = np.flatnonzero(op.split >= 0)
        met[:, inner] = met.take(op.left.take(inner), axis=1) & met.take(op.right.take(inner), axis=1)
        return met

    def cut(self, axes: Sequence[Parts] = ()) -> TreeEnsemble:
        """The trees as the rows of each cell of a grid meet them, in preorder; without axes there is one cell.

        Those of a tree are side by side; the parts of the last axis follow each other.
        """
        op, made = self.op, 0
        stays = [self.staying(axis) for axis in axes] or [self.staying()]
        cells = math.prod(map(len, stays))
        nodes, roots, lefts, rights = [], [], [], []
        # with one cell the trees follow each other as they did
        for begin, end in pairwise([*op.roots.tolist(), op.n_nodes] if cells > 1 else [0, op.n_nodes]):
            for stay in _together([stay[:, begin:end] for stay in stays]):
                place = np.flatnonzero(stay)
                node = place % (end - begin) + begin
                inner = np.flatnonzero(op.split.take(node) >= 0)
                left, right = np.full((2, len(node)), -1, np.int32)
                left[inner] = made + inner + 1
                # on the right side the first that stays of all nodes there
                split = node.take(inner)
                right[inner] = made + np.searchsorted(place, place.take(inner) + op.right.take(split) - split)
                first = np.arange(len(stay)) * (end - begin) if cells > 1 else op.roots
                roots.append(made + np.searchsorted(place, first))
                nodes.append(node)
                lefts.append(left)
                rights.append(right)
                made += len(node)
        links = Links(np.concatenate(roots).astype(np.int32), np.concatenate(lefts), np.concatenate(rights))
        return with_nodes(op, links, np.concatenate(nodes), tree_output=np.repeat(op.tree_output, cells))


def _order(numbers: AnyArray) -> IntArray:
    """The stable order of numbers from 0 on, which is quicker to find the fewer bits they have."""
    return np.argsort(numbers.astype(np.min_scalar_type(numbers.max(initial=0))), kind="stable")


def _outside(tops: IntArray, end: Int32Array) -> BoolArray:
    """Whether nodes in preorder lie in none of the subtrees at `tops`; of all nodes, `end` is behind their subtree."""
    behind = np.zeros_like(end)
    behind[tops] = end.take(tops)
    outside: BoolArray = np.maximum.accumulate(behind, out=behind) <= np.arange(len(end), dtype=np.int32)
    return outside


def _together(stays: Sequence[BoolArray]) -> Iterator[BoolArray]:
    """Whether nodes stay in each cell of a grid, for cells of some parts of its first axis at a time."""
    first, *others = stays
    rest = np.ones_like(first[:1])
    for stay in others:
        rest = (rest[:, None] & stay).reshape(-1, first.shape[1])
    step = max(_KEPT // rest.size, 1)
    for at in range(0, len(first), step):
        yield (first[at : at + step, None] & rest).reshape(-1, first.shape[1])
