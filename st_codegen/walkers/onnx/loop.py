"""Graphs inside of operators: loops, branches, and what the standard itself gives as a graph.

A loop runs equally often for all inputs, as tf2onnx writes recurrent layers that it has no operator for. Its body is
walked once for each round (onnx/defs/controlflow: Loop): its inputs are the round, the condition and what the round
before it left; its outputs the condition, what it leaves, and a row of each result that grows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np
import onnx
from onnx import helper

from st_codegen.errors import InputError, Problems, UnsupportedModelError
from st_codegen.walkers.onnx.elementwise import choice_of
from st_codegen.walkers.onnx.graph import NodeCall, Result, operator, read_initializers, run_nodes
from st_codegen.walkers.onnx.operands import ConstantOperand, Operand
from st_codegen.walkers.onnx.shapes import joined

#: Rounds of all loops of a graph together, also of those inside of others: each writes the code of its body.
MAX_ROUNDS = 1024


@operator("Loop", 1, 11, 13, 16, 19, 21, 23, 24, 25)
def _loop(call: NodeCall) -> Result:
    body, walk = call.node.attributes["body"].g, call.walk
    (most, condition), state = call.operands[:2], list(call.operands[2:])
    if len(body.input) != len(state) + 2 or len(body.output) < len(state) + 1:
        raise InputError("the body has not the inputs and outputs that a loop needs; the model file is damaged")
    rows: list[list[Operand]] = [[] for _ in body.output[1 + len(state) :]]
    limit, goes_on = _known(most, "how often the loop runs"), _known(condition, "whether the loop goes on")
    outer, problems, count = walk.values, Problems("the body"), 0
    try:
        while (limit is None or count < limit) and goes_on != 0:
            if walk.rounds == MAX_ROUNDS:
                raise UnsupportedModelError(f"loops of more than {MAX_ROUNDS} rounds in all")
            walk.rounds += 1
            counter = ConstantOperand(np.array(count, np.int64))
            given = zip(body.input, (counter, ConstantOperand(np.array(True)), *state), strict=True)
            walk.values = outer | {value.name: operand for value, operand in given}
            read_initializers(walk, body, problems)
            run_nodes(walk, body, walk.opsets, problems)
            problems.raise_if_any()
            made = [walk.values.get(output.name) for output in body.output]
            goes_on = _known(made[0], "whether the loop goes on")
            state = made[1 : 1 + len(state)]
            for row, operand in zip(rows, made[1 + len(state) :], strict=True):
                row.append(_present(operand))
            count += 1
    finally:
        walk.values = outer
    if not count:
        raise UnsupportedModelError("a loop that never runs")
    # of each the rows of all rounds, one below the other
    return (*state, *(joined(call.walk, [one.moved(lambda array: array[None]) for one in row], 0) for row in rows))


def _known(operand: Operand | None, what: str) -> int | None:
    """A number or truth value that stands in the file or follows from the round; None where it is absent."""
    if operand is None:
        return None
    if not isinstance(operand, ConstantOperand) or operand.array.size != 1 or operand.dtype.kind not in "bi":
        raise UnsupportedModelError(f"{what} depends on the inputs; it has to be a constant")
    return int(operand.array.ravel()[0])


def _present(operand: Operand | None) -> Operand:
    if operand is None:
        raise UnsupportedModelError("a result of the body is no tensor, or is not computed; tensors are supported")
    return operand


@operator("If", 1, 11, 13, 16, 19, 21, 23, 24, 25)
def _if(call: NodeCall) -> Result:
    """The branch that a constant condition takes; of a computed one both, and a choice between their numbers."""
    condition, branches = call.required(), [call.node.attributes[f"{name}_branch"].g for name in ("then", "else")]
    if isinstance(condition, ConstantOperand):
        return _body(call, branches[0 if _known(condition, "the condition") else 1], call.walk.values)
    sides = [_body(call, branch, call.walk.values) for branch in branches]
    results = []
    for pair in zip(*sides, strict=True):
        first, second = map(_present, pair)
        if first.shape != second.shape or first.dtype != second.dtype:
            raise UnsupportedModelError("branches that give other shapes or types, and a condition that is computed")
        results.append(choice_of(replace(call, operands=[condition, first, second])))
    return tuple(results)


@operator("GroupNormalization", 18, 21)
def _by_its_body(call: NodeCall) -> Result:
    """An operator that onnxruntime computes by the body that the standard gives for it."""
    node, schema = call.node, cast(Any, call.node.schema)
    kinds = [helper.np_dtype_to_tensor_dtype(_present(one).dtype) for one in call.operands]
    types = [helper.make_tensor_type_proto(kind, None).SerializeToString() for kind in kinds]
    data = schema.get_context_dependent_function(node.proto.SerializeToString(), types)
    function = onnx.FunctionProto.FromString(data)
    values = [onnx.ValueInfoProto(name=name) for name in function.output]
    body = helper.make_graph(function.node, node.op_type, [], values)
    return _body(call, body, dict(zip(function.input, call.operands, strict=True)))


def _body(call: NodeCall, body: onnx.GraphProto, given: Mapping[str, Operand | None]) -> tuple[Operand | None, ...]:
    """The outputs of a graph that reads what is given."""
    walk, outer, problems = call.walk, call.walk.values, Problems("the body")
    walk.values = dict(given)
    try:
        read_initializers(walk, body, problems)
        run_nodes(walk, body, walk.opsets, problems)
        problems.raise_if_any()
        return tuple(walk.values.get(output.name) for output in body.output)
    finally:
        walk.values = outer
