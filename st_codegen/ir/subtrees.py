"""Which subtrees of an ensemble are equal: for the pass that merges them, and the tables that write them once."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from st_codegen.ir.arrays import FloatArray, Int32Array, IntArray
from st_codegen.ir.trees import TreeEnsemble


@dataclass(frozen=True)
class Subtrees:
    """Which subtrees are equal.

    `number` (nodes) is the same for equal subtrees. `forward` (nodes) is the node that stands in for each node: for a
    split with two equal children it is one of them where `collapse` was asked for.
    """

    number: IntArray
    forward: IntArray


def subtrees(op: TreeEnsemble, *, collapse: bool = False) -> Subtrees:
    """Number all subtrees from the leaves up; with `collapse` a split with equal children is one of them."""
    forward = np.arange(op.n_nodes, dtype=np.int64)
    _, kind = distinct_rows(op.leaf_value)
    number = np.where(op.split < 0, kind[op.leaf], -1)
    used = int(kind.max(initial=0)) + 1
    for nodes in _by_height(op):
        left, right = forward[op.left[nodes]], forward[op.right[nodes]]
        same = (number[left] == number[right]) & collapse
        forward[nodes[same]] = left[same]
        number[nodes[same]] = number[left[same]]
        rest = nodes[~same]
        if rest.size:
            number[rest] = used + _numbered(op, rest, number[left[~same]], number[right[~same]])
            used = int(number[rest].max()) + 1
    return Subtrees(number, forward)


def distinct_families(op: TreeEnsemble, number: IntArray, together: int) -> IntArray:
    """Distinct pairs of children in each run of `together` trees, `number` being that of each subtree."""
    inner = np.flatnonzero(op.split >= 0)
    pair = _pairs(number[op.left[inner]], number[op.right[inner]])
    edges = [0, *np.searchsorted(inner, op.roots[together::together]).tolist(), len(inner)]
    counts = []
    for begin, end in pairwise(edges):
        run = np.sort(pair[begin:end])
        counts.append(np.count_nonzero(run[1:] != run[:-1]) + (begin < end))
    return np.array(counts, np.int64)


def _numbered(op: TreeEnsemble, nodes: IntArray, left: IntArray, right: IntArray) -> IntArray:
    """Numbers from 0 for splits: the same for the same question with the same answers."""
    threshold = op.threshold[nodes].astype(np.int64)
    question = _pairs(op.split[nodes].astype(np.int64), threshold - threshold.min())
    answers = _pairs(left, right)
    if int(question.max()) >= 2**62 // (int(answers.max()) + 1):
        answers = np.unique(answers, return_inverse=True)[1]
    return np.unique(_pairs(question, answers), return_inverse=True)[1]


def _pairs(first: IntArray, second: IntArray) -> IntArray:
    """One number for each pair of numbers from 0 on."""
    return first * (int(second.max(initial=0)) + 1) + second


def _by_height(op: TreeEnsemble) -> list[IntArray]:
    """The splits in groups: first those above two leaves, then those above these, and so on."""
    levels: list[Int32Array] = []
    here = op.roots
    while here.size:
        split = here[op.split[here] >= 0]
        levels.append(split)
        here = np.concatenate([op.left[split], op.right[split]])
    height = np.zeros(op.n_nodes, np.min_scalar_type(len(levels)))  # NumPy sorts small integers in linear time
    for split in reversed(levels):
        height[split] = 1 + np.maximum(height[op.left[split]], height[op.right[split]])
    inner = np.flatnonzero(op.split >= 0)
    order = inner[np.argsort(height[inner], kind="stable")]
    groups = np.split(order, np.flatnonzero(np.diff(height[order])) + 1)
    return [group for group in groups if group.size]


def distinct_rows(values: FloatArray | IntArray) -> tuple[IntArray, IntArray]:
    """Rows that are equal to the bit: the first row of each kind, in their order, and the kind of every row."""
    bits = np.ascontiguousarray(values).view(np.int64)
    if bits.shape[1] == 1:
        _, first, kind = np.unique(bits[:, 0], return_index=True, return_inverse=True)
    else:
        _, first, kind = np.unique(bits, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[np.ravel(kind)]
