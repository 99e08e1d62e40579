"""Sums of products that are written with letters for axes, and sums of all numbers before one."""

from __future__ import annotations

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import Operator
from st_codegen.walkers.onnx.graph import NodeCall, operator
from st_codegen.walkers.onnx.operands import INTEGERS, ConstantOperand, Operand, axis_of, require_tensor
from st_codegen.walkers.onnx.operators import apply_linear, combined, total_of_last


@operator("Einsum", 12, 28)
def _einsum(call: NodeCall) -> Operand:
    """One tensor, or two multiplied, summed over the letters that the result does not have."""
    equation = call.node.text("equation", "").replace(" ", "")
    before, arrow, after = equation.partition("->")
    terms, parts = before.split(","), [call.required(number) for number in range(len(call.operands))]
    letters = sorted(set("".join(terms)))
    after = after if arrow else "".join(letter for letter in letters if before.count(letter) == 1)
    if "." in equation or len(parts) > 2 or any(len(set(term)) < len(term) for term in (*terms, after)):
        raise UnsupportedModelError("three tensors, an ellipsis or a diagonal; write it with MatMul and Transpose")
    pairs = zip(terms, parts, strict=False)
    lengths = {letter: length for term, part in pairs for letter, length in zip(term, part.shape, strict=False)}
    shapes = [tuple(lengths.get(letter, 0) for letter in term) for term in terms]
    if shapes != [part.shape for part in parts] or not set(after) <= set(letters):
        raise InputError(f"{equation} does not fit tensors of shapes {[part.shape for part in parts]}")
    order = after + "".join(letter for letter in letters if letter not in after)
    laid = [_laid(part, term, order) for part, term in zip(parts, terms, strict=True)]
    whole = laid[0] if len(laid) == 1 else combined(call.walk, Operator.MULTIPLY, *laid)
    call.walk.builder.open_zeros |= len(laid) > 1  # onnxruntime adds each product to 0, also where there is one
    return total_of_last(call.walk, require_tensor(whole), len(order) - len(after))


def _laid(operand: Operand, term: str, order: str) -> Operand:
    """An operand with an axis for each letter of an order, of length 1 where its own term lacks the letter."""
    axes = [term.index(letter) for letter in order if letter in term]
    missing = tuple(at for at, letter in enumerate(order) if letter not in term)
    return operand.moved(lambda array: np.expand_dims(array.transpose(axes), missing))


@operator("CumSum", 11, 14)
def _cumulative_sum(call: NodeCall) -> Operand:
    given, chosen = call.required(), call.integers(1, "axis") or []
    tensor = given if isinstance(given, ConstantOperand) and given.dtype in INTEGERS else call.computed()
    if len(chosen) != 1:
        raise InputError(f"the axis is {chosen}, expected one; the model file is damaged")
    axis = axis_of(chosen[0], len(tensor.shape))
    rows = tensor.moved(lambda array: np.moveaxis(array, axis, -1))
    weights = np.tri(rows.shape[-1], k=-1 if call.node.integer("exclusive") else 0)
    weights = weights.T if call.node.integer("reverse") else weights
    found: Operand
    if isinstance(rows, ConstantOperand):
        found = rows.moved(lambda array: array @ weights.T.astype(array.dtype))  # both count modulo the same power of 2
    else:
        found = apply_linear(call.walk, rows, weights, np.zeros(len(weights)), rows.shape)
    return found.moved(lambda array: np.moveaxis(array, -1, axis))
