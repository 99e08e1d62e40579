"""The nodes of an ONNX tree ensemble as arrays, and what its two operators read in the same way."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import Aggregate, BoolArray, FloatArray, IntArray
from st_codegen.walkers.onnx.file import GraphNode

NumberType = type[np.float32] | type[np.float64]

#: Outputs of one ensemble.
MAX_TARGETS = 2**16
#: Node and tree numbers, and categories, are 32 bits wide in onnxruntime.
MAX_ID = 2**31 - 1


class Mode(IntEnum):
    """What a node asks, numbered as the attribute `nodes_modes` of TreeEnsemble is."""

    LEQ = 0
    LT = 1
    GTE = 2
    GT = 3
    EQ = 4
    NEQ = 5
    MEMBER = 6
    LEAF = 7
    MEMBER_INTEGER = 8  # the integer part of x is a member


#: (aggregate, whether the sum is divided by the number of trees); TreeEnsemble numbers the names.
_AGGREGATES = {
    "AVERAGE": (Aggregate.SUM, True),
    "SUM": (Aggregate.SUM, False),
    "MIN": (Aggregate.MINIMUM, False),
    "MAX": (Aggregate.MAXIMUM, False),
}


@dataclass(frozen=True)
class Forest:
    """An ONNX tree ensemble before any node is moved.

    Arrays with one entry a node: `tree_id` (-1: not in the file) and `node_id` for messages, `mode`, `feature`, `value`
    (threshold), `true` and `false` (node numbers, -1 for a leaf), `missing_true` (NaN counts as true), `leaf` (row of
    the leaf, -1 for a split). Members of node n are `member[member_start[n]:member_start[n + 1]]`. The weights of the
    `n_leaves` leaf rows are a list of (row, target, value), sorted by row.
    """

    roots: IntArray
    tree_id: IntArray
    node_id: IntArray
    mode: NDArray[np.int8]
    feature: IntArray
    value: FloatArray
    true: IntArray
    false: IntArray
    missing_true: BoolArray
    leaf: IntArray
    member_start: IntArray
    member: FloatArray
    n_leaves: int
    weight_leaf: IntArray
    weight_target: IntArray
    weight: FloatArray
    n_targets: int
    base: FloatArray
    aggregate: Aggregate
    average: bool
    number_type: NumberType

    def where(self, node: int) -> str:
        """A node as a message names it."""
        tree = f"tree {self.tree_id[node]}, " if self.tree_id[node] >= 0 else ""
        return f"{tree}node {self.node_id[node]}"

    def members(self, node: int) -> FloatArray:
        """The values that a test of equality or membership compares with."""
        if self.mode[node] in (Mode.EQ, Mode.NEQ):
            return self.value[node : node + 1]
        return self.member[self.member_start[node] : self.member_start[node + 1]]


def read_post_transform(name: str, count: int) -> str:
    """What follows `count` sums: NONE, LOGISTIC or SOFTMAX. Raises UnsupportedModelError for others.

    Of one sum onnxruntime gives the sum itself whatever it says here, but for PROBIT (`FinalizeScores1` in
    tree_ensemble_aggregator.h, `write_scores` in ml_common.h); the ONNX standard does not.
    """
    if name not in ("NONE", "LOGISTIC", "SOFTMAX"):
        raise UnsupportedModelError(f"post_transform {name}: known are NONE, LOGISTIC and SOFTMAX")
    if name != "NONE" and count == 1:
        raise UnsupportedModelError(
            f"post_transform {name} of one target: onnxruntime leaves it out, against the ONNX standard; export the "
            "model without it, and put Sigmoid or Softmax behind"
        )
    return name


def read_aggregate(given: str | int) -> tuple[Aggregate, bool]:
    """How leaf values become one number, and whether the sum is divided by the number of trees."""
    name = dict(enumerate(_AGGREGATES)).get(given, str(given)) if isinstance(given, int) else given
    if name not in _AGGREGATES:
        raise UnsupportedModelError(f"aggregate_function {name}: known are {', '.join(_AGGREGATES)}")
    return _AGGREGATES[name]


def target_count(attributes: GraphNode) -> int:
    """The number of outputs; raises InputError where the file gives none."""
    n_targets = attributes.integer("n_targets", 0)
    if not 1 <= n_targets <= MAX_TARGETS:
        raise InputError(f"n_targets is {n_targets}, expected 1 to {MAX_TARGETS}")
    return n_targets


def check_range(name: str, array: IntArray, end: int) -> None:
    """Raise InputError that names the first entry outside 0 .. end - 1."""
    bad = np.flatnonzero((array < 0) | (array >= end))
    if bad.size:
        raise InputError(f"{name}[{bad[0]}] is {array[bad[0]]}, expected 0 to {end - 1}; the model file is damaged")
