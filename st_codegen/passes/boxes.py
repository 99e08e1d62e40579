"""Trees on ranks without the splits that send all rows one way: of all rows, or of each of several parts of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from st_codegen.ir import BoolArray, Int32Array, TreeEnsemble
from st_codegen.ir.preorder import Links
from st_codegen.ir.trees import with_nodes

#: Answers kept at once, about, to whether a node stays in a cell.
_KEPT = 8_000_000


@dataclass(frozen=True)
class Parts:
    """Parts of all rows: the lowest and the highest rank of some columns in each part, shape (parts, columns)."""

    columns: list[int]
    low: Int32Array
    high: Int32Array


@dataclass(frozen=True)
class Boxes:
    """Trees in preorder, and the lowest and the highest ranks of the rows that meet each node, shape (nodes, columns).

    Where a lowest rank is above the highest one, no row meets the node.
    """

    op: TreeEnsemble
    low: Int32Array
    high: Int32Array

    @classmethod
    def of(cls, op: TreeEnsemble, low: Int32Array, high: Int32Array) -> Boxes:
        """Those of rows whose columns have ranks from `low` to `high`."""
        threshold = op.threshold.astype(np.int32)
        lows, highs = np.ones((op.n_nodes, len(low)), np.int32), np.zeros((op.n_nodes, len(low)), np.int32)
        lows[op.roots], highs[op.roots] = low, high
        here = op.roots
        while here.size:
            here = here[op.split.take(here) >= 0]
            at, column = threshold.take(here), op.split.take(here)
            left, right = op.left.take(here), op.right.take(here)
            lows[left] = lows[right] = lows.take(here, axis=0)
            highs[left] = highs[right] = highs.take(here, axis=0)
            highs[left, column] = np.minimum(highs[left, column], at)
            lows[right, column] = np.maximum(lows[right, column], at + 1)
            here = np.concatenate([left, right])
        return cls(op, lows, highs)

    def staying(self, parts: Parts | None = None) -> BoolArray:
        """Whether a node stays for the rows of a part, or of the one part that all rows are; shape (parts, nodes).

        The leaves that rows of the part meet stay, and the splits that send such rows both ways.
        """
        met: BoolArray = np.all(self.low <= self.high, axis=1)[None]
        if parts is not None:
            low, high = self.low[:, parts.columns], self.high[:, parts.columns]
            met = met & np.all((low <= parts.high[:, None]) & (high >= parts.low[:, None]), axis=2)
        inner = np.flatnonzero(self.op.split >= 0)
        met[:, inner] = met.take(self.op.left.take(inner), axis=1) & met.take(self.op.right.take(inner), axis=1)
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


def _together(stays: Sequence[BoolArray]) -> Iterator[BoolArray]:
    """Whether nodes stay in each cell of a grid, for cells of some parts of its first axis at a time."""
    first, *others = stays
    rest = np.ones_like(first[:1])
    for stay in others:
        rest = (rest[:, None] & stay).reshape(-1, first.shape[1])
    step = max(_KEPT // rest.size, 1)
    for at in range(0, len(first), step):
        yield (first[at : at + step, None] & rest).reshape(-1, first.shape[1])
