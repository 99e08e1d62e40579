"""The code of tree ensembles on ranks: one table of small integers, several trees at a time, no data-dependent jumps.

A node is two integers side by side: its key, and where its left child is; the right child follows the left one. The
key is `threshold * slots + slot`, so one number names both the rank and the threshold (the rank is scaled likewise). A
leaf has a key above every rank, itself as its child, and so it stays where it is: trees of one class of depths take the
same number of steps, and several go down together, which hides the waiting for memory.
Where there are several classes, the leaves that were reached are noted and summed in the library's order of the trees.
Children of the larger subtree come next in memory. Equal subtrees of a table are there once.
Trees that are cut into cells have a root for each cell; the roots of a cell stand side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from st_codegen.emit.blocks.depth_classes import DepthClasses, Prices, depth_classes
from st_codegen.emit.blocks.listing import Group, Listing, suffixes
from st_codegen.emit.blocks.operations import Step
from st_codegen.errors import TargetError, counted
from st_codegen.ir import Aggregate, CutTrees, FloatArray, Int32Array, IntArray, Precision, TreeEnsemble, depth_of
from st_codegen.ir.preorder import larger_first
from st_codegen.ir.subtrees import distinct_families, distinct_rows, subtrees
from st_codegen.ir.trees import depths_of

#: Trees that go down together.
ABREAST = 4
#: What classes of depths cost.
PRICES = Prices()


@dataclass(frozen=True)
class _Keys:
    """How nodes and ranks are written: `slots` is a power of two, keys from `leaf` on are leaves."""

    slots: int
    leaf: int


def sum_values(op: TreeEnsemble, step: Step, listing: Listing) -> dict[str, object]:
    """What templates need to begin, add to and end the sums of an ensemble, as `sums`."""
    last = op.adds_base_last and np.any(op.base)
    sums = {
        "last_output": op.width - 1,
        "single": op.sum_precision is Precision.FLOAT32,
        "aggregate": op.aggregate.value,
        "base_last": listing.table(step.table("BASE"), "LREAL", op.base) if last else None,
        "start": listing.table(step.table("START"), "LREAL", _start(op)),
        "divisor": listing.constant(step.table("DIVISOR"), op.divisor) if op.divisor != 1.0 else None,
    }
    return {"sums": sums}


def _start(op: TreeEnsemble) -> FloatArray:
    """What the outputs hold before the first tree."""
    if not op.adds_base_last:
        return op.base
    largest = np.finfo(np.float64).max
    neutral = {Aggregate.SUM: 0.0, Aggregate.MINIMUM: largest, Aggregate.MAXIMUM: -largest}[op.aggregate]
    return np.full(op.width, neutral)


def lay_out_ranked(op: TreeEnsemble, step: Step, listing: Listing) -> None:
    """Append the code of an ensemble whose splits compare ranks (`passes.ranks`)."""
    keys = _keys(op)
    cut = op.cut if isinstance(op, CutTrees) else op
    packed, comparisons = keys.slots > 1, depth_of(cut)
    if comparisons:  # where every tree is one leaf, nothing is compared
        listing.local("nKey", "DINT")
    listing.loop("nSlot", keys.slots)  # and the ranks are kept all the same
    listing.locals("LREAL", "fX")
    narrow = op.leaf_value.shape[1] == 1
    if op.width > 1:
        listing.local("nOutput", "DINT")
    if not narrow:
        listing.local("nBase", "DINT")
    slots = listing.local(f"anSlot{step.number}", "DINT", keys.slots)
    values = sum_values(op, step, listing)
    cells = None
    if isinstance(op, CutTrees):
        listing.locals("DINT", "nCell", "nCellRoot")
        cells = {"slabs": op.slabs, "count": op.cells}
    equal = op.equal if isinstance(op, CutTrees) else subtrees(op).number
    parts = _parts(cut, equal, cut.n_trees // op.n_trees, step, listing, keys)
    listing.section(
        f"{counted(op.n_trees, 'tree')}, {counted(op.n_nodes, 'node')}, at most {counted(comparisons, 'comparison')} "
        "a tree",
        "ranked_trees",
        cells=cells,
        step=step,
        parts=parts,
        slots=slots,
        nodes=[part["node"] for part in parts],
        factor=listing.number(step.table("SLOTS"), "DINT", str(keys.slots)) if packed else None,
        mask=listing.number(step.table("SLOT_MASK"), "DWORD", f"DWORD#16#{keys.slots - 1:X}")
        if packed and comparisons
        else None,
        leaf_key=listing.number(step.table("LEAF_KEY"), "DINT", str(keys.leaf)),
        last_rank=step.widths[0] - 1,
        wide=None if narrow else op.width,
        tree_output=listing.table(step.table("TREE_OUTPUT"), "DINT", op.tree_output)
        if narrow and op.width > 1
        else None,
        **values,
    )


def _keys(op: TreeEnsemble) -> _Keys:
    slots = 1 << (len(op.columns) - 1).bit_length()
    # ranks go up to the largest threshold + 1, one more for missing values
    leaf = (int(op.threshold.max(initial=0)) + 3) * slots
    if leaf + len(op.leaf_value) >= 2**31:
        raise TargetError("the ensemble has too many thresholds for its nodes to be numbered: use another layout")
    return _Keys(slots, leaf)


def _parts(
    op: TreeEnsemble, equal: IntArray, cells: int, step: Step, listing: Listing, keys: _Keys
) -> list[dict[str, object]]:
    """The nodes, cut into runs of whole trees that fit an array; each tree has a root in every cell."""
    pairs = distinct_families(op, equal, cells)
    runs = listing.chunks(np.maximum(2 * cells + 4 * pairs, (pairs + cells) * op.leaf_value.shape[1]), "tree")
    parts: list[dict[str, object]] = []
    depths = depths_of(op)
    for suffix, (first, stop) in zip(suffixes(len(runs)), runs, strict=True):
        tables = _tables(op, equal, depths[first * cells : stop * cells], (first, stop), cells, keys)
        parts.append(
            {
                "node": listing.table(step.table(f"NODE{suffix}"), "DINT", tables.node, tables.groups),
                "leaf": listing.table(step.table(f"LEAF{suffix}"), "LREAL", tables.leaf.ravel()),
                "roots": 2 * (stop - first),
                "classes": [
                    {"depth": depth, "runs": _tree_runs((low, high), first, listing)}
                    for low, high, depth in tables.classes.runs
                ],
                **_sorted_part(tables.classes, first, suffix, step, listing),
            }
        )
    return parts


def _sorted_part(classes: DepthClasses, first: int, suffix: str, step: Step, listing: Listing) -> dict[str, object]:
    """The order of visits where it is not that of the sum, and the variable that keeps the leaf of each tree."""
    trees = len(classes.order)
    listing.loop("nLevel", *(depth for _, _, depth in classes.runs))
    values: dict[str, object] = {"first": first, "last": first + trees - 1, "order": None}
    if classes.is_sorted:
        listing.loop("nTree", trees)
        values["order"] = listing.table(step.table(f"TREE_ORDER{suffix}"), "DINT", classes.order)
        values["reached"] = listing.local(f"anLeaf{step.number}{suffix}", "DINT", trees)
    return values


def _tree_runs(run: tuple[int, int], offset: int, listing: Listing) -> list[dict[str, object]]:
    """Trees `run[0]` to `run[1]` - 1: a loop over as many as go evenly together, and the rest.

    Numbers of a walk count from the variable of the loop, or, where it has one round only and none is written, from 0.
    """
    runs: list[dict[str, object]] = []
    done, trees = run
    listing.loop("nTree", (trees - done) // ABREAST)
    while done < trees:
        abreast = min(ABREAST, trees - done)
        count = (trees - done) // abreast * abreast
        looped = count > abreast
        start = 0 if looped else done
        runs.append(
            {
                "first": done,
                "last": done + count - abreast,
                "step": abreast,
                "looped": looped,
                "walks": [
                    {
                        "node": listing.local(f"nNode{walk + 1}", "DINT"),
                        "root": 2 * (start + walk),
                        "tree": start + walk,
                        "output": offset + start + walk,
                    }
                    for walk in range(abreast)
                ],
            }
        )
        done += count
    return runs


@dataclass(frozen=True)
class _Tables:
    """The tables of consecutive trees, as they are written."""

    node: Int32Array
    leaf: FloatArray
    classes: DepthClasses
    groups: tuple[Group, ...]


def _tables(
    op: TreeEnsemble, equal: IntArray, depths: IntArray, run: tuple[int, int], cells: int, keys: _Keys
) -> _Tables:
    """Nodes of trees `run[0]` to `run[1]` - 1: the roots, cell by cell, then pairs of children."""
    first, stop = run
    begin = int(op.roots[first * cells])
    end = int(op.roots[stop * cells]) if stop * cells < op.n_trees else op.n_nodes
    part = _Part(op, begin, end, op.roots[first * cells : stop * cells] - begin, equal[begin:end])
    trees, n_roots = stop - first, (stop - first) * cells
    used, leaf = np.unique(part.leaf[part.split < 0], return_inverse=True)
    key = np.where(part.split >= 0, part.threshold * keys.slots + part.split, 0)
    key[part.split < 0] = keys.leaf + leaf
    owner, pair_of = part.pairs()
    n_pairs = len(owner)
    node = np.empty((n_roots + 2 * n_pairs, 2), np.int64)
    # the record of a node: the same for all nodes whose subtrees are equal
    children = 2 * (n_roots + 2 * pair_of)
    classes = depth_classes(depths.reshape(trees, cells).max(axis=1), ABREAST, PRICES)
    roots = part.roots.reshape(trees, cells)[classes.order].T.ravel()
    source = np.concatenate([roots, np.column_stack([part.left[owner], part.right[owner]]).ravel()])
    node[:, 0] = key[source]
    own = 2 * np.arange(len(source))
    # a leaf is its own left child: its key is above every rank, so it stays
    node[:, 1] = np.where(part.split[source] >= 0, children[source], own)
    tree = (np.searchsorted(part.roots, owner, side="right") - 1) // cells
    edges = np.searchsorted(tree, np.arange(trees + 1))
    groups = [Group("roots", 0, 2 * n_roots)]
    for number, (low, high) in enumerate(pairwise(edges.tolist())):
        if high > low:
            groups.append(Group(f"tree {first + number}", 2 * n_roots + 4 * low, 2 * n_roots + 4 * high))
    return _Tables(node.ravel().astype(np.int32), op.leaf_value[used], classes, tuple(groups))


class _Part:
    """Some consecutive trees, with node numbers of their own."""

    def __init__(self, op: TreeEnsemble, begin: int, end: int, roots: Int32Array, equal: IntArray) -> None:
        self.roots = roots.astype(np.int64)
        self.split = op.split[begin:end].astype(np.int64)
        self.threshold = op.threshold[begin:end].astype(np.int64)
        self.leaf = op.leaf[begin:end]
        inner = self.split >= 0
        self.left = np.where(inner, op.left[begin:end].astype(np.int64) - begin, -1)
        self.right = np.where(inner, op.right[begin:end].astype(np.int64) - begin, -1)
        self.number = equal

    def pairs(self) -> tuple[IntArray, IntArray]:
        """Distinct pairs of children: a node that owns each, and the pair of every node.

        In the order of a walk that visits the larger subtree first, so that the likely path lies side by side.
        """
        order = larger_first(self.roots, self.left, self.right).order
        walk = order[self.split[order] >= 0]
        left, right = self.number[self.left[walk]], self.number[self.right[walk]]
        both = left * (self.number.max(initial=0) + 1) + right
        first, kind = distinct_rows(both[:, None])
        pair = np.full(len(self.split), -1, np.int64)
        pair[walk] = kind
        return walk[first], pair
