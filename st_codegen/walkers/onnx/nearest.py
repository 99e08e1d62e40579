"""The nearest of constant rows, as exporters write it: Scan over the rows, TopK of the distances, means over those.

onnxruntime runs the body of a Scan once for each row. Here it is run once for all of them, side by side where a batch
has its rows; of equal numbers TopK takes the first (core/providers/cpu/math/top_k.cc).
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import onnx

from st_codegen.errors import InputError, Problems, UnsupportedModelError, counted
from st_codegen.ir import Function, Operator, Precision, Scale, WeightedMedian
from st_codegen.walkers.onnx import classifiers, elementwise, ml, operators, shapes, sums  # noqa: F401  (rules that medians add to)
from st_codegen.walkers.onnx.file import printable
from st_codegen.walkers.onnx.graph import (
    MEDIAN_STEPS,
    RULES,
    GraphWalk,
    Handler,
    NodeCall,
    Result,
    operator,
    read_initializers,
    run_nodes,
)
from st_codegen.walkers.onnx.operands import (
    FLOAT32,
    ConstantOperand,
    MedianOperand,
    Operand,
    PickedOperand,
    Tensor,
    axis_of,
)

#: Operators that compute each row by itself where the rows of a constant stand in place of the rows of a batch.
_BY_ROWS = frozenset({"Identity", "Sub", "Abs", "Pow", "ReduceSum", "ReduceSumSquare"})


@operator("Scan", 9, 11, 16, 19, 21, 23, 24, 25)
def _scan(call: NodeCall) -> Result:
    body = call.node.attributes["body"].g
    row, rows = call.required(), call.required(1)
    usual = call.node.integer("num_scan_inputs") == 1 and len(call.operands) == len(body.input) == len(body.output) == 2
    kinds = {node.op_type for node in body.node}
    reduced = [node for node in body.node if node.op_type.startswith("Reduce")]
    kept = [a.i for node in reduced for a in node.attribute if a.name == "keepdims"]
    if (
        not usual
        or not (isinstance(row, Tensor) and len(row.shape) == 2 and row.shape[0] == 1)
        or not (isinstance(rows, ConstantOperand) and rows.array.ndim == 2)
        or not kinds <= _BY_ROWS
        or len(kept) != 1
        or len(reduced) != 1
        or any(kept)
    ):
        raise UnsupportedModelError("a loop other than one over constant rows that measures the distance to each")
    walk, outer, problems = call.walk, call.walk.values, Problems("the body")
    walk.values = {body.input[0].name: row, body.input[1].name: rows}
    try:
        read_initializers(walk, body, problems)
        run_nodes(walk, body, walk.opsets, problems)
        state, found = (walk.values.get(output.name) for output in body.output)
    finally:
        walk.values = outer
    problems.raise_if_any()
    if state is not row or not isinstance(found, Tensor) or found.shape != rows.shape[:1]:
        raise UnsupportedModelError("a loop that changes what it starts from, or that gives no number for each row")
    return None, found.moved(lambda array: array[:, None])


_MICROSOFT = "com.microsoft"
_CDIST = onnx.defs.OpSchema(
    "CDist",
    _MICROSOFT,
    1,
    inputs=[onnx.defs.OpSchema.FormalParameter(name, "T") for name in "AB"],
    outputs=[onnx.defs.OpSchema.FormalParameter("C", "T")],
    type_constraints=[("T", ["tensor(float)", "tensor(double)"], "")],
    attributes=[onnx.defs.OpSchema.Attribute("metric", onnx.defs.OpSchema.AttrType.STRING, required=False)],
)


@operator("CDist", 1, domain=_MICROSOFT, schema=_CDIST)
def _distances(call: NodeCall) -> Operand:
    """The distances to constant rows: a.a - 2 a.b + b.b added in any order, of which the magnitude is taken
    (contrib_ops/cpu/cdist.cc).
    """
    tensor, rows, metric = (
        call.computed(),
        call.constant(1, "the second matrix"),
        call.node.text("metric", "sqeuclidean"),
    )
    if rows is None or rows.dtype != tensor.dtype or rows.ndim != 2 or tensor.shape != (1, rows.shape[1]):
        raise UnsupportedModelError("distances of other than one row to a constant matrix of its type")
    if metric not in ("euclidean", "sqeuclidean"):
        raise UnsupportedModelError(
            f"the metric {printable(metric)}, which onnxruntime refuses; skl2onnx writes this one without optim='cdist'"
        )
    walk, wide = call.walk, rows.astype(np.float64)
    squares = walk.settle_finite(operators.product_of(walk, tensor, tensor))
    own = np.sum(wide**2, axis=1)
    terms = walk.builder.beside(squares, walk.settle(tensor))
    weights = np.hstack([np.ones_like(wide), -2.0 * wide])
    walk.charge(weights.size)
    total = walk.builder.linear(terms, weights, own, precision=tensor.precision, bias_terms=own)
    found = walk.computed(total, (1, len(rows)), tensor.dtype)
    found = operators.apply_activation(walk, found, Function.ABS)
    return found if metric == "sqeuclidean" else operators.apply_activation(walk, found, Function.SQRT)


@operator("TopK", 1, 10, 11, 24)
def _top(call: NodeCall) -> Result:
    tensor = call.computed()
    count = [call.node.integer("k")] if call.node.version < 10 else call.integers(1, "k") or []
    axis = axis_of(call.node.integer("axis", -1), len(tensor.shape))
    if not call.node.integer("sorted", 1) or tensor.shape[axis : axis + 1] != (tensor.size,):
        raise UnsupportedModelError("without order, or of several rows; the first of one row are walked")
    if len(count) != 1 or not 1 <= count[0] <= tensor.size:
        raise InputError(f"k is {count} for {counted(tensor.size, 'number')}; the model file is damaged")
    shape = (*tensor.shape[:axis], count[0], *tensor.shape[axis + 1 :])
    value = call.walk.settle_finite(tensor)
    found = call.walk.computed(value, (tensor.size,), tensor.dtype)
    largest = call.node.version < 11 or call.node.integer("largest", 1)
    numbers = ConstantOperand(np.arange(tensor.size, dtype=np.int64))
    picked = _turned(call, value) if largest else value
    return tuple(PickedOperand(picked, count[0], whole, shape) for whole in (found, numbers))


def _turned(call: NodeCall, value: int) -> int:
    """The value whose smallest numbers stand where the largest of a value stand, of equal ones the first, too."""
    builder = call.walk.builder
    made = builder.ops[value - 1] if value else None
    if isinstance(made, Scale) and made.operator is Operator.MULTIPLY and np.all(made.constant == -1.0):
        return made.inputs[0]
    return builder.scale(value, "*", -1.0)


# --- the weighted median of an AdaBoostRegressor, as skl2onnx writes it ----------------------------------------------


def _sums(call: NodeCall, given: PickedOperand) -> Operand | None:
    """The sums of the weights of all, added one after another (core/providers/cpu/math/cumsum.cc)."""
    axis = call.integers(1, "axis") or []
    weighs = isinstance(given.whole, ConstantOperand) and given.dtype == FLOAT32 and not np.any(given.whole.array < 0)
    turned = call.node.integer("exclusive") or call.node.integer("reverse")
    along = [given.shape[axis_of(one, len(given.shape))] for one in axis]
    if not weighs or turned or along != [given.count] or given.count < math.prod(given.whole.shape):
        return None
    return MedianOperand(given, "sums", given.shape, given.dtype)


def _are_places(picked: PickedOperand, of: PickedOperand) -> bool:
    """Whether what is picked are the positions of the columns whose weights another one has."""
    places = picked.whole.array if isinstance(picked.whole, ConstantOperand) else np.zeros(0)
    return (picked.value, picked.count) == (of.value, of.count) and np.array_equal(places, np.arange(of.count))


def _is_first_along_all(call: NodeCall, below: MedianOperand) -> bool:
    """Whether an ArgMin finds the first of all columns, and not the row of each."""
    along = below.shape[axis_of(call.node.integer("axis"), len(below.shape))]
    kept = call.node.integer("keepdims", 1) and not call.node.integer("select_last_index")
    return bool(kept) and along == below.picked.count


def _median_step(call: NodeCall) -> Operand | None:
    """What an operator makes of the step before it; None where that leads to no median."""
    first, second = call.required(), call.optional(1)
    fixed = next((np.ravel(one.array).tolist() for one in (first, second) if isinstance(one, ConstantOperand)), None)
    found: Operand | None = None
    match call.node.op_type, first, second:
        case "CumSum", PickedOperand(), _:
            found = _sums(call, first)
        case "ArrayFeatureExtractor", MedianOperand(step="sums"), _ if fixed == [first.picked.count - 1]:
            found = replace(first, step="whole", shape=(1, 1))
        case "Mul", MedianOperand(step="whole"), _ if fixed == [0.5]:
            found = replace(first, step="half")
        case "Less", MedianOperand(step="sums"), MedianOperand(step="half") if first.picked is second.picked:
            found = replace(first, step="below")
        case "Cast", MedianOperand(step="below"), _:
            found = first
        case "ArgMin", MedianOperand(step="below"), _ if _is_first_along_all(call, first):
            found = replace(first, step="first", shape=(1, 1))
        case "GatherElements", PickedOperand(), MedianOperand(step="first") if _are_places(first, second.picked):
            found = replace(second, step="column")
        case "GatherElements", Tensor(), MedianOperand(step="column"):
            found = _median(call.walk, first, second.picked)
    return found


def _median(walk: GraphWalk, tensor: Tensor, picked: PickedOperand) -> Tensor | None:
    """The column of a tensor with which half of the weights are reached, where its own order is that of the weights."""
    if walk.settle(tensor) != picked.value or not isinstance(picked.whole, ConstantOperand):
        return None
    return walk.computed(
        WeightedMedian((picked.value,), picked.whole.array.ravel(), Precision.FLOAT32), (1, 1), tensor.dtype
    )


def _with_medians(usual: Handler) -> Handler:
    """A rule that also walks the steps of a weighted median."""

    def handler(call: NodeCall) -> Result:
        if not any(isinstance(operand, MedianOperand | PickedOperand) for operand in call.operands):
            return usual(call)
        found = _median_step(call)
        if found is None and any(isinstance(operand, MedianOperand) for operand in call.operands):
            raise UnsupportedModelError("sums of what TopK picks, other than for the weighted median of all of it")
        return usual(call) if found is None else found

    return handler


for _name in MEDIAN_STEPS:
    _key = ("ai.onnx.ml" if _name == "ArrayFeatureExtractor" else "", _name)
    RULES[_key] = replace(RULES[_key], handler=_with_medians(RULES[_key].handler))
