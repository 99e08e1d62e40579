"""The code of a small tree as nested IFs: one comparison of an input a split, then the number of the leaf.

The larger of two subtrees stands behind THEN, next to its comparison, so that long paths are few lines of code.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from st_codegen.emit.blocks.listing import Listing
from st_codegen.emit.blocks.operations import Step, lay_out
from st_codegen.emit.blocks.ranked_trees import sum_values
from st_codegen.emit.literals import real
from st_codegen.errors import counted
from st_codegen.ir import BranchedTree, depth_of
from st_codegen.ir.preorder import larger_first

#: No number lies between it and zero, so that `x <= BELOW_ZERO` is `x < 0.0`, which every compiler reads.
BELOW_ZERO = float(np.nextafter(0.0, -1.0))


@lay_out.register
def _(op: BranchedTree, step: Step, listing: Listing) -> None:
    listing.local("nLeaf", "DINT")
    listing.local("fX", "LREAL")
    if op.width > 1:
        listing.locals("DINT", "nBase", "nOutput")
    listing.section(
        f"1 tree, {counted(op.n_nodes, 'node')}, at most {counted(depth_of(op), 'comparison')}",
        "branched_tree",
        step=step,
        lines=_lines(op, step),
        leaf=listing.table(step.table("LEAF"), "LREAL", np.ravel(op.leaf_value)),
        width=op.width,
        **sum_values(op, step, listing),
    )


def _lines(op: BranchedTree, step: Step) -> list[dict[str, object]]:
    """The lines of the IFs: tests, leaves, ELSE and END_IF."""
    order = larger_first(op.roots, op.left, op.right).order.tolist()
    then = dict(pairwise(order))  # of a split: the child behind THEN
    lines: list[dict[str, object]] = []
    # the last entry: the inputs that may be missing in a row that comes here
    todo: list[tuple[str, int, int, frozenset[int]]] = [("node", 0, 0, frozenset(range(len(op.columns))))]
    while todo:
        kind, node, depth, missing = todo.pop()
        line: dict[str, object] = {"kind": kind, "indent": "    " * depth}
        if kind == "node" and op.split[node] < 0:
            line |= {"kind": "leaf", "leaf": int(op.leaf[node])}
        elif kind == "node":
            left, right = int(op.left[node]), int(op.right[node])
            is_left = then[node] == left
            line |= _test(op, step, node, is_left=is_left, may_miss=int(op.split[node]) in missing)
            present = missing - {int(op.split[node])}
            rows = {left: missing, right: present} if op.missing_left[node] else {left: present, right: missing}
            first, second = (left, right) if is_left else (right, left)
            todo += [("end", node, depth, missing), ("node", second, depth + 1, rows[second])]
            todo += [("else", node, depth, missing), ("node", first, depth + 1, rows[first])]
        lines.append(line)
    return lines


def _test(op: BranchedTree, step: Step, node: int, *, is_left: bool, may_miss: bool) -> dict[str, object]:
    """When a row goes to the child behind THEN. A missing input reads as 0.0, which is where it must go or is not."""
    column, threshold = op.columns[op.split[node]].column, float(op.threshold[node])
    missing_left, below_zero = bool(op.missing_left[node]), threshold == BELOW_ZERO
    flag = None
    if step.missing is not None and may_miss and missing_left != (threshold >= 0.0):
        flag = step.missing[column]
    return {
        "kind": "if",
        "column": column,
        "operator": ("<" if is_left else ">=") if below_zero else "<=" if is_left else ">",
        "threshold": real(0.0 if below_zero else threshold) if np.isfinite(threshold) else None,
        "flag": flag,
        "takes_missing": missing_left == is_left,
    }
