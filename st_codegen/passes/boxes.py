"""Trees on ranks without the splits that send all rows one way: of all rows, or of each of several parts of them."""

from __future__ import annotations

import numpy as np

from st_codegen.ir import Int32Array, TreeEnsemble
from st_codegen.ir.preorder import preorder
from st_codegen.ir.trees import with_nodes

#: Numbers kept at once, about, for the ranks that lead to the nodes of some trees.
_KEPT = 8_000_000


def in_boxes(op: TreeEnsemble, low: Int32Array, high: Int32Array) -> TreeEnsemble:
    """The trees in preorder as rows of each box meet them, those of a tree side by side.

    `low` and `high` (boxes, columns) are the ranks that each column has in a box.
    """
    ends = np.concatenate([low, high], axis=1)
    width, roots = low.shape[1], op.n_trees * len(low)
    step = max(_KEPT // (ends.size * max(op.n_nodes // op.n_trees, 1)), 1)
    threshold, read, is_inner = op.threshold.astype(np.int32), np.maximum(op.split, 0), op.split >= 0
    made, old, places = 0, [], []
    for first in range(0, op.n_trees, step):
        node = np.repeat(op.roots[first : first + step].astype(np.int64), len(low))
        # of a root: below 0; of a child: twice its parent, and 1 for the right one
        place = np.arange(len(node)) + first * len(low) - roots
        boxes = np.tile(ends, (len(node) // len(low), 1))
        # level by level, a box for each node
        while node.size:
            at, inner = threshold.take(node), is_inner.take(node)
            lowest = 2 * width * np.arange(len(node)) + read.take(node)
            goes_left, goes_right = boxes.take(lowest) <= at, boxes.take(lowest + width) > at
            passes = np.flatnonzero(inner & (goes_left != goes_right))
            new = np.flatnonzero(~inner | (goes_left & goes_right))
            both = np.flatnonzero(inner.take(new))
            number, both = made + both, new.take(both)
            old.append(node.take(new))
            places.append(place.take(new))
            made += len(new)
            onward, split = node.take(passes), node.take(both)
            onward = np.where(goes_left.take(passes), op.left.take(onward), op.right.take(onward))
            place = np.concatenate([place.take(passes), 2 * number, 2 * number + 1])
            node = np.concatenate([onward, op.left.take(split), op.right.take(split)])
            boxes = boxes.take(np.concatenate([passes, both, both]), axis=0)
            left, right = boxes[len(passes) :].reshape(2, len(both), 2 * width)
            of_both = np.arange(len(both))
            left[of_both, read.take(split) + width] = at.take(both)
            right[of_both, read.take(split)] = at.take(both) + 1
    found = np.full(2 * made + roots, -1, np.int64)
    found[np.concatenate(places)] = np.arange(made)  # places of roots count from the end
    layout = preorder(found[2 * made :], found[: 2 * made : 2], found[1 : 2 * made : 2])
    output = np.repeat(op.tree_output, len(low))
    return with_nodes(op, layout, np.concatenate(old).take(layout.order), tree_output=output)
