"""The code of tree ensembles: flat tables and one bounded loop.

Nodes lie parent first, left child next, so a node needs only its column, its threshold and the distance to its right
child. Distances are relative to the node and trees are found by their sizes: a tree that changes leaves the rows of all
others as they were. A leaf has column -1, its value in place of the threshold, and its row number in place of the
distance.

A missing value costs nothing in the loop: a column is read through slots, one for splits that send missing values left
and one for those that send them right, which hold a number below or above every threshold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from st_codegen.emit.blocks.listing import Group, Listing, suffixes
from st_codegen.emit.blocks.operations import Step, lay_out
from st_codegen.emit.blocks.ranked_trees import lay_out_ranked, sum_values
from st_codegen.errors import InputError, counted
from st_codegen.ir import (
    FLOAT32_OVERFLOW,
    BoolArray,
    FloatArray,
    Int32Array,
    IntArray,
    NanRule,
    Precision,
    TreeEnsemble,
    depth_of,
)

#: A missing value that goes left (right) is read as minus (plus) this number.
MISSING_VALUE = 1e306
#: A threshold of +infinity is written as this number, and inputs above it are lowered to it.
LARGEST_THRESHOLD = 1e305


@dataclass(frozen=True)
class _Slots:
    """The numbers that the splits compare, one row a slot; `of_node` says which one a split reads (else -1)."""

    column: Int32Array
    missing: FloatArray
    of_node: Int32Array


@lay_out.register
def _(op: TreeEnsemble, step: Step, listing: Listing) -> None:
    if step.ranks:
        lay_out_ranked(op, step, listing)
        return
    listing.locals("DINT", "nNode", "nRoot")
    listing.loop("nLevel", depth_of(op))
    listing.locals("LREAL", "fX")
    if op.width > 1:
        listing.local("nOutput", "DINT")
    slots = _numeric_slots(op)
    depth = depth_of(op)
    values: dict[str, object] = {"step": step, "depth": depth}
    values["single"] = op.input_precision is Precision.FLOAT32
    values["real_limit"] = None
    if op.input_precision is Precision.FLOAT32 and not step.fits_real and np.any(op.split >= 0):
        values["real_limit"] = listing.table(step.table("REAL_LIMIT"), "LREAL", [FLOAT32_OVERFLOW])
    values |= _slot_values(op, step, listing, slots)
    runs = _tree_runs(op, listing)
    answers = _category_answers(op, runs)
    values |= _category_values(op, step, listing, slots, answers)
    values |= _leaf_values(op, step, listing)
    values["parts"] = _node_tables(op, step, listing, slots, runs, answers)
    values["comparison"] = op.comparison.value
    values |= sum_values(op, step, listing)
    size = f"{counted(op.n_trees, 'tree')}, {counted(op.n_nodes, 'node')}"
    listing.section(f"{size}, at most {counted(depth, 'comparison')} a tree", "trees", **values)


def _numeric_slots(op: TreeEnsemble) -> _Slots:
    """Which (column, direction of missing values) pairs the splits use, in the order of the columns."""
    numeric = np.array([not column.categorical for column in op.columns] or [False])
    inner = (op.split >= 0) & numeric[np.maximum(op.split, 0)]
    key = np.where(inner, 2 * op.split + ~op.missing_left, -1)
    used = np.unique(key[inner])
    return _Slots(
        column=(used // 2).astype(np.int32),
        missing=np.where(used % 2 == 0, -MISSING_VALUE, MISSING_VALUE),
        of_node=np.where(inner, np.searchsorted(used, key), -1).astype(np.int32),
    )


def _slot_values(op: TreeEnsemble, step: Step, listing: Listing, slots: _Slots) -> dict[str, object]:
    """Reading the columns: rounding, missing values, infinite thresholds."""
    thresholds = op.threshold[slots.of_node >= 0]
    largest = float(np.max(np.abs(thresholds[np.isfinite(thresholds)]), initial=0.0))
    if largest >= LARGEST_THRESHOLD:
        raise InputError(f"a threshold of {largest:g} leaves no room for missing values")
    if not len(slots.column):
        return {"slots": None}
    listing.loop("nSlot", len(slots.column))
    used = [op.columns[number] for number in slots.column]
    columns = [column.column for column in used]
    values: dict[str, object] = {
        "slots": listing.local(f"aSlot{step.number}", "LREAL", len(used)),
        "last_slot": len(used) - 1,
        "slot_column": listing.table(step.table("SLOT_COLUMN"), "DINT", columns),
        "nan": None,
        "infinite": None,
        "interval": None,
    }
    if np.any(np.isinf(thresholds)):
        values["infinite"] = listing.table(step.table("LARGEST"), "LREAL", [LARGEST_THRESHOLD])
    if step.missing is not None:
        flags = [step.missing[column] for column in columns]
        zero = [column.nan is NanRule.ZERO for column in used]
        values["nan"] = {
            "flag": values["slot_column"]
            if flags == columns
            else listing.table(step.table("SLOT_FEATURE"), "DINT", flags),
            "value": listing.table(step.table("SLOT_MISSING"), "LREAL", np.where(zero, 0.0, slots.missing)),
        }
    if any(column.missing_interval is not None for column in used):
        bounds = [column.missing_interval or (1.0, 0.0) for column in used]  # columns that have none: an empty interval
        values["interval"] = {
            "low": listing.table(step.table("MISSING_LOW"), "LREAL", [low for low, _ in bounds]),
            "high": listing.table(step.table("MISSING_HIGH"), "LREAL", [high for _, high in bounds]),
            "value": listing.table(step.table("INTERVAL_VALUE"), "LREAL", slots.missing),
        }
    return values


@dataclass(frozen=True)
class _Answers:
    """The answers of the categorical splits of some trees, and where those of each of their nodes start."""

    left: BoolArray
    row: Int32Array


def _tree_runs(op: TreeEnsemble, listing: Listing) -> list[tuple[int, int]]:
    """Runs of whole trees of which the nodes, and the answers of categorical splits, fit an array."""
    sizes = np.diff(np.append(op.roots, op.n_nodes))
    if len(op.category_left) <= listing.max_array:
        return listing.chunks(sizes, "tree")
    sizes = np.maximum(sizes, np.add.reduceat(_answer_counts(op), op.roots))
    highest = max((column.n_categories for column in op.columns if column.categories is None), default=0) - 1
    coded = f"number the categories from 0 without gaps (their codes reach {highest:,}), " if highest > 0 else ""
    return listing.chunks(sizes, "tree", f"{coded}train a smaller model")


def _answer_counts(op: TreeEnsemble) -> IntArray:
    """How many answers each node has: one a category of a categorical split, one for others, one for missing values."""
    counts = np.array([column.n_categories + 2 if column.categorical else 0 for column in op.columns] or [0])
    return np.where(op.split >= 0, counts[op.split], 0)


def _category_answers(op: TreeEnsemble, runs: list[tuple[int, int]]) -> list[_Answers]:
    """The answers of each run of trees; of a single run they stay where the model has them."""
    if len(runs) == 1 or not len(op.category_left):
        return [_Answers(op.category_left, op.category_row)] * len(runs)
    counts, stops = _answer_counts(op), np.append(op.roots[1:], op.n_nodes)
    found = []
    for first, stop in runs:
        nodes = slice(int(op.roots[first]), int(stops[stop - 1]))
        own = counts[nodes]
        start = np.cumsum(own) - own
        at = np.repeat(op.category_row[nodes] - start, own) + np.arange(own.sum())
        left = op.category_left[at] if len(at) else np.zeros(1, np.bool_)  # a table has an element
        found.append(_Answers(left, np.where(own > 0, start, 0).astype(np.int32)))
    return found


def _category_values(
    op: TreeEnsemble, step: Step, listing: Listing, slots: _Slots, answers: list[_Answers]
) -> dict[str, object]:
    """Category codes, and the answers of the splits for each code, a table a run of trees."""
    numbers = [number for number, column in enumerate(op.columns) if column.categorical]
    if not numbers or not len(op.category_left):
        return {"categories": None}
    listing.locals("DINT", "nCode", "nSlot")
    bits = {number: max((op.columns[number].n_categories - 1).bit_length(), 1) for number in numbers}
    listing.loop("nLevel", *(bits[number] for number in numbers if op.columns[number].categories is None))
    listing.locals("BOOL", "bLeft")
    if any(op.columns[number].categories is None for number in numbers):
        listing.local("nBit", "DINT")
    if any(op.columns[number].missing_interval is not None for number in numbers):
        listing.local("bMissing", "BOOL")
    columns = []
    for position, number in enumerate(numbers):
        column = op.columns[number]
        table = None
        if column.categories is not None:
            table = listing.table(step.table(f"CATEGORY_{position}"), "LREAL", np.array(column.categories))
        columns.append(
            {
                "position": position,
                "column": column.column,
                "table": table,
                "last": column.n_categories - 1,
                "bits": bits[number],
                "highest_bit": 1 << (bits[number] - 1),
                "other": column.n_categories,
                "missing": column.n_categories + 1,
                "negative_fraction_is_zero": column.negative_fraction_is_zero,
                "interval": None
                if column.missing_interval is None
                else listing.table(step.table(f"CATEGORY_MISSING_{position}"), "LREAL", column.missing_interval),
                "flag": None if step.missing is None else step.missing[column.column],
            }
        )
    return {
        "categories": {
            "columns": columns,
            "codes": listing.local(f"anCode{step.number}", "DINT", len(numbers)),
            "left": [
                listing.table(step.table(f"CATEGORY_LEFT{suffix}"), "SINT", part.left.astype(np.int8))
                for suffix, part in zip(suffixes(len(answers)), answers, strict=True)
            ],
            "first": len(slots.column),
        }
    }


def _leaf_values(op: TreeEnsemble, step: Step, listing: Listing) -> dict[str, object]:
    """Wide leaves, several outputs, linear leaves."""
    values: dict[str, object] = {"wide": None, "output": "0", "linear": None}
    if op.leaf_value.shape[1] > 1:
        values["wide"] = listing.table(step.table("LEAF_VALUE"), "LREAL", np.ravel(op.leaf_value))
    elif op.width > 1:
        values["output"] = "nOutput"
        values["tree_output"] = listing.table(step.table("TREE_OUTPUT"), "DINT", op.tree_output)
    if op.linear is not None:
        listing.locals("DINT", "nTerm", "nLeaf")
        listing.local("fTerm", "LREAL")
        linear = op.linear
        column, coefficient = (linear.column, linear.coefficient) if len(linear.column) else ([0], [0.0])
        values["linear"] = {
            "constant": listing.table(step.table("LEAF_CONSTANT"), "LREAL", linear.constant),
            "start": listing.table(step.table("LEAF_START"), "DINT", linear.start),
            "column": listing.table(step.table("LEAF_COLUMN"), "DINT", column),
            "coefficient": listing.table(step.table("LEAF_COEFFICIENT"), "LREAL", coefficient),
            "zero_magnitude": listing.constant(step.table("ZERO_MAGNITUDE"), linear.zero_magnitude)
            if linear.zero_magnitude
            else None,
            "feature": None
            if step.missing is None
            else listing.table(step.table("LEAF_FEATURE"), "DINT", [step.missing[c] for c in column]),
        }
    return values


def _node_tables(
    op: TreeEnsemble, step: Step, listing: Listing, slots: _Slots, runs: list[tuple[int, int]], answers: list[_Answers]
) -> list[dict[str, object]]:
    """The nodes, cut into runs of whole trees that fit an array."""
    stops = np.append(op.roots[1:], op.n_nodes)
    sizes = stops - op.roots
    inner = op.split >= 0
    nodes = np.arange(op.n_nodes)
    if np.any(op.left[inner] != nodes[inner] + 1):
        raise InputError("the trees are not laid out parent first, left child next")
    split = slots.of_node.copy()
    value = np.where(np.isinf(op.threshold), LARGEST_THRESHOLD, op.threshold)
    if op.has_categories:
        category_slot = np.cumsum([column.categorical for column in op.columns]) - 1 + len(slots.column)
        categorical = inner & (slots.of_node < 0)
        split[categorical] = category_slot[op.split[categorical]]
    row = np.maximum(op.leaf, 0)
    narrow = op.leaf_value.shape[1] == 1
    value[~inner] = op.leaf_value[row[~inner], 0] if narrow else 0.0
    jump = np.where(inner, op.right - nodes, (0 if narrow and op.linear is None else row * op.leaf_value.shape[1]))
    compares = bool(np.any(slots.of_node >= 0))
    parts: list[dict[str, object]] = []
    for suffix, (first, stop), part in zip(suffixes(len(runs)), runs, answers, strict=True):
        listing.loop("nTree", stop - first)
        begin, end = int(op.roots[first]), int(stops[stop - 1])
        groups = [Group(f"tree {t}", int(op.roots[t]) - begin, int(stops[t]) - begin) for t in range(first, stop)]
        parts.append(
            {
                "first": first,
                "last": stop - first - 1,
                "size": listing.table(step.table(f"TREE_SIZE{suffix}"), "DINT", sizes[first:stop]),
                "split": listing.table(step.table(f"SPLIT{suffix}"), "DINT", split[begin:end], groups)
                if np.any(inner)
                else None,
                "row": listing.table(step.table(f"ROW{suffix}"), "DINT", part.row, groups) if len(part.left) else None,
                "value": listing.table(step.table(f"THRESHOLD{suffix}"), "LREAL", value[begin:end], groups)
                if compares or (narrow and op.linear is None) or (op.linear is not None and step.missing is not None)
                else None,
                "jump": listing.table(step.table(f"RIGHT{suffix}"), "DINT", jump[begin:end], groups)
                if np.any(inner) or not narrow or op.linear is not None
                else None,
            }
        )
    return parts
