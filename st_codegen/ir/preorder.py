"""The order of nodes that all tree ensembles have: parent first, left child next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from st_codegen.errors import InputError
from st_codegen.ir.arrays import AnyArray, Int32Array, IntArray


@dataclass(frozen=True)
class Links:
    """The roots of trees and the children of their nodes, -1 for those of leaves."""

    roots: Int32Array
    left: Int32Array
    right: Int32Array


@dataclass(frozen=True, kw_only=True)
class Preorder(Links):
    """Trees laid out parent first, left child next: `order[i]` is the old number of new node `i`.

    `size[i]` is the number of nodes of the subtree at node `i`.
    """

    order: IntArray
    size: IntArray


def preorder(roots: AnyArray, left: AnyArray, right: AnyArray) -> Preorder:
    """Lay trees out in preorder; nodes that no root reaches are dropped. Linear in nodes, without recursion.

    `left` and `right` are node numbers over all trees, negative for a leaf. Raises InputError where the nodes do not
    form trees (a node with two parents, a cycle, a child out of range, a split with one child).
    """
    total = len(left)
    first = here = np.asarray(roots, np.int64)
    levels: list[tuple[IntArray, IntArray, IntArray]] = []  # splits with their children, level by level
    seen, reached = np.zeros(total, np.bool_), 0
    while here.size:
        if np.any(here >= total):
            raise InputError("tree: a child number outside the tree; the model file is damaged")
        seen[here] = True
        reached += len(here)
        if np.count_nonzero(seen) != reached:
            raise InputError("tree: a node with two parents or a cycle; the model file is damaged")
        is_split = left.take(here) >= 0
        if np.any(is_split != (right.take(here) >= 0)):
            raise InputError("tree: a split with only one child; the model file is damaged")
        split = here[is_split]
        levels.append((split, left.take(split).astype(np.int64), right.take(split).astype(np.int64)))
        here = np.concatenate(levels[-1][1:])
    size = np.ones(total, np.int64)
    for split, lower, upper in reversed(levels):
        size[split] += size.take(lower) + size.take(upper)
    position, new_left, new_right = (np.full(total, -1, np.int64) for _ in range(3))
    position[first] = np.concatenate([[0], np.cumsum(size[first])[:-1]])
    for split, lower, upper in levels:
        begin = position.take(split)
        position[lower] = new_left[begin] = begin + 1
        position[upper] = new_right[begin] = begin + 1 + size.take(lower)
    kept = np.flatnonzero(seen)
    order = np.empty(len(kept), np.int64)
    order[position.take(kept)] = kept
    return Preorder(
        order=order,
        size=size.take(order),
        roots=position[first].astype(np.int32),
        left=new_left[: len(order)].astype(np.int32),
        right=new_right[: len(order)].astype(np.int32),
    )


def ends_in_preorder(roots: AnyArray, left: AnyArray, right: AnyArray) -> Int32Array | None:
    """The first node behind the subtree of each node; None where trees are in another order than preorder.

    Every child comes after its parents.
    """
    here = np.arange(len(left), dtype=np.int32)
    inner = np.flatnonzero(left >= 0)
    last, further = here, np.where(left < 0, here, right)
    while not np.array_equal(last, further):  # the rightmost leaf, twice as far each time
        last, further = further, further.take(further)
    end: Int32Array = last + np.int32(1)
    follow = left.take(inner) == inner + 1, right.take(inner) == end.take(left.take(inner))
    if all(map(np.all, follow)) and np.array_equal(end.take(roots), [*roots[1:], len(left)]):
        return end
    return None


def larger_first(roots: AnyArray, left: AnyArray, right: AnyArray) -> Preorder:
    """Lay out trees so that of two children the one with the larger subtree stands next to its parent.

    A path from a root then leaves the neighbourhood at most as often as the number of nodes can be halved.
    """
    size = preorder(roots, left, right).size
    left_larger = size[left] >= size[right]
    return preorder(roots, np.where(left_larger, left, right), np.where(left_larger, right, left))
