"""Which subtrees of an ensemble are equal: for the pass that merges them, and the tables that write them once."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from st_codegen.ir.arrays import FloatArray, IntArray
from st_codegen.ir.trees import TreeEnsemble


@dataclass(frozen=True)
class Subtrees:
    """Which subtrees are equal.

    `number` (nodes) is the same for equal subtrees, -1 where no row comes. `forward` (nodes) is the node that stands
    in for each node: for a split with two equal children it is one of them.
    """

    number: IntArray
    forward: IntArray


def subtrees(op: TreeEnsemble, substitute: IntArray | None = None) -> Subtrees:
    """Number all subtrees from the leaves up.

    `substitute` has the node that stands in for each node, -1 where no row comes. With None all nodes stay as they are,
    and so do splits with equal children.
    """
    collapse = substitute is not None
    if substitute is None:
        substitute = np.arange(op.n_nodes, dtype=np.int64)
    forward = substitute.copy()
    number = np.full(op.n_nodes, -1, np.int64)
    own = np.flatnonzero(substitute == np.arange(op.n_nodes))  # the nodes that stay
    leaves = own[op.split[own] < 0]
    _, kind = distinct_rows(op.leaf_value)
    number[leaves] = kind[op.leaf[leaves]]
    used = int(kind.max(initial=0)) + 1
    inner = own[op.split[own] >= 0]
    for nodes in _by_height(op, substitute, inner):
        left, right = forward[op.left[nodes]], forward[op.right[nodes]]
        same = (number[left] == number[right]) & collapse
        forward[nodes[same]] = left[same]
        number[nodes[same]] = number[left[same]]
        rest = nodes[~same]
        if rest.size:
            number[rest] = used + _numbered(op, rest, number[left[~same]], number[right[~same]])
            used = int(number[rest].max()) + 1
    known = np.flatnonzero(substitute >= 0)
    follow(forward)
    number[known] = number[forward[known]]
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


def _by_height(op: TreeEnsemble, substitute: IntArray, inner: IntArray) -> list[IntArray]:
    """The splits `inner` in groups: first those above two leaves, then those above these, and so on."""
    levels: list[IntArray] = []
    here = substitute[op.roots]
    while here.size:
        split = here[op.split[here] >= 0]
        levels.append(split)
        here = np.concatenate([substitute[op.left[split]], substitute[op.right[split]]])
    height = np.zeros(op.n_nodes, np.min_scalar_type(len(levels)))  # NumPy sorts small integers in linear time
    for split in reversed(levels):
        height[split] = 1 + np.maximum(height[substitute[op.left[split]]], height[substitute[op.right[split]]])
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


def follow(substitute: IntArray) -> None:
    """Replace substitutes by their own substitutes until nothing changes; the array itself is changed."""
    known = np.flatnonzero(substitute >= 0)
    while True:
        further = substitute[substitute[known]]
        if np.array_equal(further, substitute[known]):
            return
        substitute[known] = further
