"""Recurrent layers over a window: RNN, LSTM and GRU, which forget all between two rows.

onnxruntime multiplies matrices in an order of its own and takes its functions from MLAS
(core/providers/cpu/rnn): within a bound. Each round's sums are of the inputs and the state together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from operator import itemgetter

import numpy as np

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import FloatArray, Function, Operation, Precision, Scan, Select
from st_codegen.walkers.base import GraphBuilder
from st_codegen.walkers.onnx.file import printable
from st_codegen.walkers.onnx.graph import NodeCall, Result, operator
from st_codegen.walkers.onnx.operands import FLOAT32, Tensor, check_size, together

_FUNCTIONS = {"Tanh": Function.TANH, "Sigmoid": Function.LOGISTIC, "Relu": Function.RELU}


def _sums(body: GraphBuilder, value: int, weights: FloatArray, biases: FloatArray) -> int:
    """Weighted sums with the sum of two biases, which the library adds when it computes."""
    terms = np.sum(np.abs(biases), axis=0)
    return body.linear(value, weights, np.sum(biases, axis=0), bias_terms=terms)


def _in_single(op: Operation) -> Operation:
    """An operation with its result rounded to float32."""
    return op if isinstance(op, Select) else replace(op, precision=Precision.FLOAT32)  # type: ignore[type-var]


def _rnn(w: FloatArray, r: FloatArray, b: FloatArray, _linear_first: bool, function: Function) -> GraphBuilder:
    """h = f(W x + R h + b), where tanh(y) is 2 / (1 + exp(-2 y)) - 1, which loses digits near 0
    (core/providers/cpu/rnn/rnn_activation_functors.h).
    """
    body = GraphBuilder(w.shape[2] + r.shape[1])
    given = _sums(body, 0, np.hstack([w[0], r[0]]), b[:, 0])
    if function is not Function.TANH:
        body.function(given, function)
        return body
    twice = body.scale(given, "*", 2.0)
    share = body.function(twice, Function.LOGISTIC)
    body.scale(body.scale(share, "*", 2.0), "-", 1.0)
    return body


def _lstm(w: FloatArray, r: FloatArray, b: FloatArray, _linear_first: bool, _function: Function) -> GraphBuilder:
    """c = f * c + i * g, h = o * tanh(c) with i, o, f by sigmoids and g by tanh; the state is h, then c."""
    size, read = r.shape[1], w.shape[2]
    body = GraphBuilder(read + 2 * size)
    both, old = body.select(range(read + size), 0), body.select(range(read + size, read + 2 * size), 0)
    gates = [
        body.function(_sums(body, both, np.hstack([w[gate], r[gate]]), b[:, gate]), "tanh" if gate == 3 else "logistic")
        for gate in range(4)
    ]
    kept = body.combine(gates[2], "*", old)
    given = body.combine(gates[0], "*", gates[3])
    new = body.combine(kept, "+", given)
    hidden = body.combine(gates[1], "*", body.function(new, "tanh"))
    body.beside(hidden, new)
    return body


def _gru(w: FloatArray, r: FloatArray, b: FloatArray, linear_first: bool, _function: Function) -> GraphBuilder:
    """h = (1 - z) * g + z * h; g = tanh(W x + r * (R h + b) + b), or with R (r * h) where `linear_first` is FALSE."""
    size, read = r.shape[1], w.shape[2]
    body = GraphBuilder(read + size)
    row, old = body.select(range(read), 0), body.select(range(read, read + size), 0)
    update, reset = (
        body.function(_sums(body, 0, np.hstack([w[gate], r[gate]]), b[:, gate]), "logistic") for gate in range(2)
    )
    if linear_first:
        inner = body.combine(reset, "*", _sums(body, old, r[2], b[1:, 2]))
        given = _sums(body, body.beside(row, inner), np.hstack([w[2], np.eye(size)]), b[:1, 2])
    else:
        inner = body.combine(reset, "*", old)
        given = _sums(body, body.beside(row, inner), np.hstack([w[2], r[2]]), b[:, 2])
    new = body.function(given, "tanh")
    rest = body.scale(update, "-", 1.0, reverse=True)
    kept = body.combine(update, "*", old)
    body.combine(body.combine(rest, "*", new), "+", kept)
    return body


_Body = Callable[[FloatArray, FloatArray, FloatArray, bool, Function], GraphBuilder]
#: Gates of each kind of layer, the functions that its nodes have unless they say otherwise, and one round of it.
_LAYERS: dict[str, tuple[int, tuple[str, ...], _Body]] = {
    "RNN": (1, ("Tanh",), _rnn),
    "GRU": (3, ("Sigmoid", "Tanh"), _gru),
    "LSTM": (4, ("Sigmoid", "Tanh", "Tanh"), _lstm),
}


def _check(call: NodeCall, directions: int) -> Function:
    """The function of an RNN; raises UnsupportedModelError for what is not walked."""
    node, name = call.node, call.node.op_type
    functions = tuple(node.texts("activations")) or _LAYERS[name][1] * directions
    usual = functions == _LAYERS[name][1] * directions
    if not usual and (name != "RNN" or len(set(functions)) > 1 or functions[0] not in _FUNCTIONS):
        raise UnsupportedModelError(f"activations {', '.join(map(printable, functions))}; the usual ones are supported")
    for attribute in ("clip", "activation_alpha", "activation_beta", "input_forget", "layout"):
        if attribute in node and (attribute not in ("input_forget", "layout") or node.integer(attribute)):
            raise UnsupportedModelError(f"the attribute {attribute}; export the layer without it")
    if call.optional(7) is not None:
        raise UnsupportedModelError("peepholes; export the layer without them")
    return _FUNCTIONS[functions[0]]


def _steps(call: NodeCall, tensor: Tensor) -> int:
    """The number of rounds."""
    if len(tensor.shape) != 3 or tensor.shape[1] != 1:
        raise UnsupportedModelError(f"a sequence of shape {tensor.shape} (for one row); a batch of one is supported")
    steps = tensor.shape[0]
    lengths = call.constant(4, "the lengths of the sequences")
    if lengths is not None and np.any(lengths != steps):
        raise UnsupportedModelError("sequences that are shorter than the window; leave sequence_lens out")
    return steps


def _numbers(call: NodeCall, number: int, what: str, shape: tuple[int, ...]) -> FloatArray:
    """A constant of a shape; zeros where it is absent."""
    array = call.constant(number, what)
    if array is None:
        return np.zeros(shape)
    if array.size != np.prod(shape) or array.dtype != FLOAT32:
        raise InputError(f"{what} is {array.dtype} of shape {array.shape}, expected {shape}; the model file is damaged")
    return array.astype(np.float64).reshape(shape)


@operator("RNN GRU LSTM", 7, 14, 22)
def _recurrent(call: NodeCall) -> Result:
    tensor, walk, node = call.computed(), call.walk, call.node
    if tensor.dtype != FLOAT32:
        raise UnsupportedModelError("reads double numbers; export the layer with float inputs")
    name, (gates, _, round_of) = node.op_type, _LAYERS[node.op_type]
    direction = node.text("direction", "forward")
    directions = 2 if direction == "bidirectional" else 1
    function, steps = _check(call, directions), _steps(call, tensor)
    hidden, read = node.integer("hidden_size"), tensor.shape[-1]
    if hidden < 1 or direction not in ("forward", "reverse", "bidirectional"):
        raise InputError(f"hidden_size {hidden}, direction {printable(direction)}; the model file is damaged")
    check_size([steps, directions, hidden, 2])
    w = _numbers(call, 1, "W", (directions, gates, hidden, read))
    r = _numbers(call, 2, "R", (directions, gates, hidden, hidden))
    b = _numbers(call, 3, "B", (directions, 2, gates, hidden))
    walk.charge(w.size + r.size)
    states = [
        _numbers(call, number, what, (directions, hidden)) for number, what in ((5, "initial_h"), (6, "initial_c"))
    ]
    value = walk.settle_finite(tensor)
    order, results = np.arange(steps) * read, []
    for side in range(directions):
        backwards = direction == "reverse" or side == 1
        body = round_of(w[side], r[side], b[side], bool(node.integer("linear_before_reset")), function)
        initial = np.concatenate([state[side] for state in (states if name == "LSTM" else states[:1])])
        starts = (order[::-1] if backwards else order).astype(np.int32)
        made = Scan((value,), tuple(map(_in_single, body.ops)), starts, read, initial)
        results.append((walk.computed(made, (steps, len(initial)), FLOAT32), backwards))
    return _outputs(results, hidden)


def _outputs(results: list[tuple[Tensor, bool]], hidden: int) -> tuple[Tensor, ...]:
    """Y (steps, directions, 1, hidden), and the last h and c of each direction (directions, 1, hidden)."""
    turned = [found.moved(np.flipud) if backwards else found for found, backwards in results]
    all_h = [found.moved(lambda a: a[:, None, :hidden]) for found in turned]
    last = [found.moved(lambda a: a[-1:]) for found, _ in results]
    parts = [slice(start, start + hidden) for start in range(0, last[0].shape[1], hidden)]
    ends = [together(last, np.stack).moved(itemgetter((..., part))) for part in parts]
    return (together(all_h, partial(np.stack, axis=1)), *ends)
