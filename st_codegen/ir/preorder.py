"""The order of nodes that all tree ensembles have: parent first, left child next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from st_codegen.errors import InputError
from st_codegen.ir.arrays import AnyArray, Int32Array, IntArray


@dataclass(frozen=True)
class Preorder:
    """Trees laid out parent first, left child next: `order[i]` is the old number of new node `i`.

    `size[i]` is the number of nodes of the subtree at node `i`.
    """

    order: IntArray
    size: IntArray
    roots: Int32Array
    left: Int32Array
    right: Int32Array


def preorder(roots: AnyArray, left: AnyArray, right: AnyArray) -> Preorder:
    """Lay trees out in preorder; nodes that no root reaches are dropped. Linear in nodes, without recursion.

    `left` and `right` are node numbers over all trees, negative for a leaf. Raises InputError where the nodes do not
    form trees (a node with two parents, a cycle, a child out of range, a split with one child).
    """
    total = len(left)
    levels = [np.asarray(roots, np.int64)]
    seen, reached = np.zeros(total, np.bool_), 0
    while levels[-1].size:
        here = levels[-1]
        if np.any(here >= total):
            raise InputError("tree: a child number outside the tree; the model file is damaged")
        seen[here] = True
        reached += len(here)
        if np.count_nonzero(seen) != reached:
            raise InputError("tree: a node with two parents or a cycle; the model file is damaged")
        if np.any((left[here] < 0) != (right[here] < 0)):
            raise InputError("tree: a split with only one child; the model file is damaged")
        inner = here[left[here] >= 0]
        levels.append(np.concatenate([left[inner], right[inner]]).astype(np.int64))
    size = np.ones(total, np.int64)
    for here in reversed(levels):
        inner = here[left[here] >= 0]
        size[inner] += size[left[inner]] + size[right[inner]]
    position = np.full(total, -1, np.int64)
    position[levels[0]] = np.concatenate([[0], np.cumsum(size[levels[0]])[:-1]])
    for here in levels:
        inner = here[left[here] >= 0]
        position[left[inner]] = position[inner] + 1
        position[right[inner]] = position[inner] + 1 + size[left[inner]]
    order = np.empty(int(seen.sum()), np.int64)
    kept = np.flatnonzero(seen)
    order[position[kept]] = kept
    split = left[order] >= 0
    return Preorder(
        order=order,
        size=size[order],
        roots=position[levels[0]].astype(np.int32),
        left=np.where(split, position[left[order]], -1).astype(np.int32),
        right=np.where(split, position[right[order]], -1).astype(np.int32),
    )


def larger_first(roots: AnyArray, left: AnyArray, right: AnyArray) -> Preorder:
    """The same of trees that are laid out already, with the child of the larger subtree next to its parent.

    A path from a root then leaves the neighbourhood at most as often as the number of nodes can be halved.
    """
    size = preorder(roots, left, right).size
    left_larger = size[left] >= size[right]
    return preorder(roots, np.where(left_larger, left, right), np.where(left_larger, right, left))
