"""The nearest of constant rows, as exporters write it: Scan over the rows, TopK of the distances, means over those.

onnxruntime runs the body of a Scan once for each row. Here it is run once for all of them, side by side where a batch
has its rows; of equal numbers TopK takes the first (core/providers/cpu/math/top_k.cc).
"""

from __future__ import annotations

import numpy as np

from st_codegen.errors import InputError, Problems, UnsupportedModelError, counted
from st_codegen.walkers.onnx.graph import NodeCall, Result, operator, read_initializers, run_nodes
from st_codegen.walkers.onnx.operands import ConstantOperand, PickedOperand, Tensor

#: Operators that compute each row by itself where the rows of a constant stand in place of the rows of a batch.
_BY_ROWS = frozenset({"Identity", "Sub", "Abs", "Pow", "ReduceSum", "ReduceSumSquare"})


@operator("Scan", 8, 9, 11, 16, 19, 21, 23, 24, 25)
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


@operator("TopK", 10, 11, 24)
def _top(call: NodeCall) -> Result:
    tensor, count = call.computed(), call.integers(1, "k") or []
    if call.node.integer("largest", 1) or not call.node.integer("sorted", 1) or tensor.shape[-1] != tensor.size:
        raise UnsupportedModelError("the largest, or without order, or of several rows; the nearest of one are walked")
    if len(count) != 1 or not 1 <= count[0] <= tensor.size:
        raise InputError(f"k is {count} for {counted(tensor.size, 'number')}; the model file is damaged")
    shape = (*tensor.shape[:-1], count[0])
    value = call.walk.settle_finite(tensor)
    found = call.walk.computed(value, (tensor.size,), tensor.dtype)
    numbers = ConstantOperand(np.arange(tensor.size, dtype=np.int64))
    return tuple(PickedOperand(value, count[0], whole, shape) for whole in (found, numbers))
