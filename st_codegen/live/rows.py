"""Rows that show a wrong constant: every leaf of every tree is reached, every split is tried on both of its sides.

`proof.probes` takes each threshold and its neighbours, wherever the other inputs may be; a tree whose other splits send
the row elsewhere then never asks. A constant that changed on a controller shows only where it is used, so that here the
other inputs lie where the split, or the leaf, is reached.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from st_codegen.ir import FloatArray, ModelIR, Operator, TreeEnsemble
from st_codegen.proof.probes import operating_range, origin, probe_rows, singles, undone

#: Grids of cells with more points are left to the rows of leaves and thresholds.
_MOST_CELLS = 20_000
#: Rows of leaves and splits, where `rows` is less: of more, as many are drawn at random.
_MOST_AIMED = 50_000
#: A leaf's value may be lost in one sum and not in another.
_ROWS_OF_A_LEAF = 4
#: Rows of `probe_rows` at most.
_PROBES = 1000
#: One step of scaling between a feature and what a tree compares.
Step = tuple[Operator, bool, float]


@dataclass(frozen=True)
class ChosenRows:
    """Rows (n, features) for the models of one block; rows are aimed at `reached` of `constants` leaves and splits.

    Categories, which are drawn at random, and ranges that limit inputs can send such a row elsewhere. `untried_cells`:
    how many cells there are between thresholds, where these are too many to have a row each.
    """

    x: FloatArray
    reached: int
    constants: int
    untried_cells: int = 0


def comparison_rows(models: Sequence[ModelIR], rows: int, seed: int = 0) -> ChosenRows:
    """At least `rows` rows for models that one block computes, and so have the same inputs.

    First those of `probe_rows`, special values included, then a row for each cell between thresholds where there are
    few cells (a table has a number for each), then those of leaves and splits, even where these are more than `rows`,
    then random ones.
    """
    random = np.random.default_rng(seed)
    aimed = [group for model in models for group in _aimed(model, random)]
    kept: list[FloatArray] = []
    reached, room = 0, max(rows, _MOST_AIMED)
    for number in random.permutation(len(aimed)):
        if len(kept) + len(aimed[number]) > room:
            break
        kept += aimed[number]
        reached += bool(aimed[number])
    cells, untried = _cells(models)
    parts = [probe_rows(models[0], min(rows, _PROBES), seed), cells]
    if kept:
        parts.append(np.array(kept))
    left = max(rows - sum(map(len, parts)), 0)
    lower, upper = operating_range(models[0])
    parts.append(lower + (upper - lower) * random.random((left, len(lower))))
    return ChosenRows(np.vstack(parts), reached, len(aimed), untried)


def _thresholds(model: ModelIR) -> list[FloatArray]:
    """For each feature, the inputs at which splits change over."""
    found: list[list[FloatArray]] = [[np.zeros(0)] for _ in model.features]
    for op in model.ops:
        if isinstance(op, TreeEnsemble):
            for number, column in enumerate(op.columns):
                feature, steps = origin(model, op.inputs[0], column.column)
                if feature is not None and not column.categorical:
                    values = np.unique(op.threshold[op.split == number])
                    found[feature].append(undone(values[np.isfinite(values)], steps))
    return [np.unique(np.concatenate(values)) for values in found]


def _cells(models: Sequence[ModelIR]) -> tuple[FloatArray, int]:
    """A point inside of each cell between the thresholds of all models together; where these are many none, but how
    many they are.
    """
    lower, upper = operating_range(models[0])
    axes = []
    for number, parts in enumerate(zip(*map(_thresholds, models), strict=True)):
        thresholds = np.unique(np.concatenate(parts))
        ends = np.concatenate([[lower[number]], thresholds, [upper[number]]])
        middles = np.unique(ends[:-1] + (ends[1:] - ends[:-1]) / 2)
        outside = [] if not len(thresholds) else [thresholds[0] - 1.0, thresholds[-1] + 1.0]
        axes.append(np.unique(np.concatenate([middles, outside])))
    count = math.prod(map(len, axes))
    if count > _MOST_CELLS:
        return np.zeros((0, len(lower))), count
    return np.array(list(itertools.product(*axes))), 0


def _aimed(model: ModelIR, random: np.random.Generator) -> Iterator[list[FloatArray]]:
    """For each leaf rows that reach it, for each split the threshold and its neighbours where it is reached.

    Splits by categories, and those of numbers that no input gives, have none.
    """
    lower, upper = operating_range(model)
    for op in model.ops:
        if not isinstance(op, TreeEnsemble):
            continue
        origins = [origin(model, op.inputs[0], column.column) for column in op.columns]
        usable = [o[0] is not None and not c.categorical for o, c in zip(origins, op.columns, strict=True)]
        for root in op.roots:
            # the node, and the open interval of each column on the way
            stack: list[tuple[int, dict[int, tuple[float, float]]]] = [(int(root), {})]
            while stack:
                node, box = stack.pop()
                split = int(op.split[node])
                feature, steps = origins[split] if split >= 0 else (None, [])
                threshold = float(op.threshold[node])
                if feature is not None and usable[split] and np.isfinite(threshold):
                    yield _around(
                        _base(lower, upper, box, origins, random), feature, undone(np.array([threshold]), steps)
                    )
                elif split < 0:
                    yield [_base(lower, upper, box, origins, random) for _ in range(_ROWS_OF_A_LEAF)]
                else:
                    yield []
                if split >= 0:
                    low, high = box.get(split, (-np.inf, np.inf))
                    for child, part in (
                        (int(op.left[node]), (low, min(high, threshold))),
                        (int(op.right[node]), (max(low, threshold), high)),
                    ):
                        stack.append((child, {**box, split: part} if usable[split] else box))


def _base(
    lower: FloatArray,
    upper: FloatArray,
    box: dict[int, tuple[float, float]],
    origins: Sequence[tuple[int | None, list[Step]]],
    random: np.random.Generator,
) -> FloatArray:
    """A random row inside of a box of columns."""
    base: FloatArray = lower + (upper - lower) * random.random(len(lower))
    for column, (low, high) in box.items():
        feature, steps = origins[column]
        if feature is not None:
            base[feature] = _inside(low, high, steps, base[feature])
    return base


def _inside(low: float, high: float, steps: list[Step], otherwise: float) -> float:
    """A number between two thresholds, as an input; the random one where that already lies there."""
    ends = undone(np.array([low, high]), steps)
    if len(ends) < 2:
        if not np.isfinite(low) and not np.isfinite(high):
            return otherwise
        edge = undone(np.array([low if np.isfinite(low) else high]), steps)
        if not len(edge):
            return otherwise
        inside = edge[0] + abs(edge[0]) * 0.01 + 0.5 if np.isfinite(low) else edge[0] - abs(edge[0]) * 0.01 - 0.5
        within = otherwise > edge[0] if np.isfinite(low) else otherwise < edge[0]
        return otherwise if within else float(inside)
    first, last = min(ends), max(ends)
    return otherwise if first < otherwise < last else float(first + (last - first) / 2)


def _around(base: FloatArray, feature: int, threshold: FloatArray) -> list[FloatArray]:
    """The threshold itself, and its neighbours in float64 and float32."""
    below, _, above = singles(threshold)
    near = [threshold, np.nextafter(threshold, -np.inf), np.nextafter(threshold, np.inf), below, above]
    rows = np.tile(base, (len(near) * len(threshold), 1))
    rows[:, feature] = np.stack(near, 1).ravel()
    return list(rows)
