"""Trees as boosting libraries store them -> the flat arrays of `ir.TreeEnsemble`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from st_codegen import ir
from st_codegen.errors import InputError, UnsupportedModelError, counted
from st_codegen.ir.arrays import AnyArray, BoolArray, FloatArray, Int32Array, IntArray
from st_codegen.ir.preorder import Preorder, preorder

#: Answers of all category splits together; more would not fit a controller by orders of magnitude.
MAX_CATEGORY_ANSWERS = 50_000_000

#: Ways of reading a column, numbered by each library; a bound that makes (feature, reading) one integer key.
_READINGS = 8


@dataclass(frozen=True)
class CategorySets:
    """The category sets of some splits: `nodes[i]` owns the next `counts[i]` entries of `codes`."""

    nodes: IntArray
    counts: IntArray
    codes: IntArray


@dataclass(frozen=True)
class LeafModels:
    """Linear models in the leaves of one tree: leaf `i` owns the next `counts[i]` terms."""

    constant: FloatArray
    counts: IntArray
    column: IntArray
    coefficient: FloatArray


@dataclass(frozen=True)
class ParsedTree:
    """One tree in its library's node order; node 0 is the root.

    Arrays have one entry a node. `left`, `right` are -1 and `leaf` (a row of `leaf_value`) is 0 or more at leaves;
    `reading` says in which of the library's ways a split reads column `feature`.
    """

    feature: IntArray
    reading: IntArray
    threshold: FloatArray
    left: IntArray
    right: IntArray
    missing_left: BoolArray
    leaf: IntArray
    leaf_value: FloatArray
    categories: CategorySets | None = None
    linear: LeafModels | None = None


#: Makes the column of a feature read in a numbered way, with that many category codes (0: numbers).
ColumnMaker = Callable[[int, int, int], ir.TreeColumn]


def flatten(
    trees: Sequence[ParsedTree],
    value: int,
    make_column: ColumnMaker,
    *,
    members_left: bool = False,
    zero: float = 0.0,
    **rule: Any,
) -> ir.TreeEnsemble:
    """Lay trees out parent first, left child next, and number leaves, columns and category tables accordingly.

    The operation reads `value`; `rule` is that of `laid_out`. `members_left`: the categories of a set
    go left and all others right, or the reverse. `zero`: magnitude up to which linear leaves read an input as 0. Linear
    in nodes. Raises InputError where the nodes do not form trees.
    """
    sizes = np.array([len(tree.left) for tree in trees], np.int64)
    first = np.cumsum(sizes) - sizes
    left, right = (_joined_children(trees, first, side) for side in ("left", "right"))
    layout = preorder(first, left, right)
    order = layout.order
    is_split = layout.left >= 0
    new_position = np.full(len(left), -1, np.int64)
    new_position[order] = np.arange(len(order))

    leaf_counts = np.array([len(tree.leaf_value) for tree in trees], np.int64)
    first_leaf = np.repeat(np.cumsum(leaf_counts) - leaf_counts, sizes)
    leaf_rows = (np.concatenate([tree.leaf for tree in trees]) + first_leaf)[order][~is_split]

    key = np.concatenate([tree.feature * _READINGS + tree.reading for tree in trees])[order]
    keys, split = np.unique(key[is_split], return_inverse=True)
    column_of = np.full(len(order), -1, np.int32)
    column_of[is_split] = split
    missing_left = np.concatenate([tree.missing_left for tree in trees])[order]
    widths, row, table = _category_tables(
        _joined_categories(trees, first, new_position), column_of, missing_left, members_left
    )
    columns = (make_column(int(k) // _READINGS, int(k) % _READINGS, widths.get(n, 0)) for n, k in enumerate(keys))
    return laid_out(
        value,
        layout,
        columns=tuple(columns),
        split=column_of,
        threshold=np.concatenate([tree.threshold for tree in trees])[order],
        missing_left=missing_left,
        leaf_value=np.concatenate([tree.leaf_value for tree in trees])[leaf_rows],
        category_row=row,
        category_left=table,
        linear=_linear_leaves(trees, leaf_rows, zero),
        **rule,
    )


def side_by_side(sizes: IntArray, left: AnyArray, right: AnyArray) -> Preorder:
    """The layout of trees of these sizes; children are numbered within their tree, and negative at leaves."""
    first = np.cumsum(sizes) - sizes
    shift = np.repeat(first, sizes)
    return preorder(first, *(np.where(child < 0, -1, child + shift) for child in (left, right)))


def laid_out(
    value: int, layout: Preorder, *, split: AnyArray, threshold: AnyArray, missing_left: AnyArray, **fields: Any
) -> ir.TreeEnsemble:
    """The operation that reads `value` by trees in a layout, by `<=` unless `fields`, its other fields, say otherwise.

    The arrays have an entry a node in the order of the layout, of which those of leaves do not count; `leaf_value` has
    a row a leaf.
    """
    inner = layout.left >= 0
    return ir.TreeEnsemble(
        inputs=(value,),
        roots=layout.roots,
        split=np.where(inner, split, -1).astype(np.int32),
        threshold=np.where(inner, threshold, 0.0),
        left=layout.left,
        right=layout.right,
        missing_left=inner & missing_left,
        leaf=np.where(inner, -1, np.cumsum(~inner) - 1).astype(np.int32),
        **{"comparison": ir.Comparison.LESS_OR_EQUAL} | fields,
    )


def _joined_children(trees: Sequence[ParsedTree], first: IntArray, side: str) -> IntArray:
    """Child numbers over all trees; every child must be a node of its own tree."""
    children = []
    for number, (tree, offset) in enumerate(zip(trees, first, strict=True)):
        child: IntArray = getattr(tree, side)
        if np.any(child >= len(child)):
            raise InputError(f"tree {number}: a {side} child outside the tree; the model file is damaged")
        children.append(np.where(child >= 0, child + offset, -1))
    return np.concatenate(children)


def _joined_categories(trees: Sequence[ParsedTree], first: IntArray, new_position: IntArray) -> CategorySets | None:
    """All category sets with their nodes in the new numbering (-1: a node that no root reaches)."""
    sets = [(tree.categories, offset) for tree, offset in zip(trees, first, strict=True) if tree.categories is not None]
    if not sets:
        return None
    return CategorySets(
        nodes=new_position[np.concatenate([one.nodes + offset for one, offset in sets])],
        counts=np.concatenate([one.counts for one, _ in sets]),
        codes=np.concatenate([one.codes for one, _ in sets]),
    )


def _category_tables(
    sets: CategorySets | None, column_of: Int32Array, missing_left: BoolArray, members_left: bool
) -> tuple[dict[int, int], Int32Array, BoolArray]:
    """Codes of each category column, and the answers of each split for its codes, "other" and a missing value."""
    if sets is None:
        return {}, np.zeros(0, np.int32), np.zeros(0, np.bool_)
    reached = sets.nodes >= 0
    owner = np.repeat(np.arange(len(sets.nodes)), sets.counts)
    codes, owner = sets.codes[reached[owner]], owner[reached[owner]]
    nodes = sets.nodes[reached]
    columns = column_of[nodes]
    n_codes = np.ones(int(columns.max(initial=-1)) + 1, np.int64)
    np.maximum.at(n_codes, column_of[sets.nodes[owner]], codes + 1)
    sizes = n_codes[columns] + 2
    if sizes.sum() > MAX_CATEGORY_ANSWERS:
        raise UnsupportedModelError(
            f"category codes up to {n_codes.max() - 1} in {counted(len(nodes), 'split')} would need "
            f"{sizes.sum()} table entries; number the categories 0, 1, 2, .. before training"
        )
    start = np.cumsum(sizes) - sizes
    row = np.zeros(len(column_of), np.int32)
    row[nodes] = start
    table = np.full(int(sizes.sum()), not members_left)
    table[row[sets.nodes[owner]] + codes] = members_left
    table[start + sizes - 1] = missing_left[nodes]
    return {int(c): int(n_codes[c]) for c in np.unique(columns)}, row, table


def _linear_leaves(trees: Sequence[ParsedTree], leaf_rows: IntArray, zero: float) -> ir.LinearLeaves | None:
    """Linear models of all leaves in their new order; leaves of plain trees become constants."""
    if all(tree.linear is None for tree in trees):
        return None
    models = [
        tree.linear
        or LeafModels(
            tree.leaf_value[:, 0], np.zeros(len(tree.leaf_value), np.int64), np.zeros(0, np.int64), np.zeros(0)
        )
        for tree in trees
    ]
    counts = np.concatenate([model.counts for model in models])
    start = np.cumsum(counts) - counts
    taken = counts[leaf_rows]
    new_start = np.concatenate([[0], np.cumsum(taken)])
    entry = np.repeat(start[leaf_rows] - new_start[:-1], taken) + np.arange(new_start[-1])
    return ir.LinearLeaves(
        constant=np.concatenate([model.constant for model in models])[leaf_rows],
        start=new_start.astype(np.int32),
        column=np.concatenate([model.column for model in models])[entry].astype(np.int32),
        coefficient=np.concatenate([model.coefficient for model in models])[entry],
        zero_magnitude=zero,
    )


def category_note(feature: str, categories: Sequence[object]) -> str:
    """A line for `Source.notes`: which code of a feature stands for which category (at most 20 are named)."""
    named = ", ".join(f"{code} = {category}" for code, category in enumerate(categories[:20]))
    return f"feature '{feature}' is a category code: {named}{', ..' if len(categories) > 20 else ''}"
