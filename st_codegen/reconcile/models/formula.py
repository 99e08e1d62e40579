"""Effects as formulas: their own code, run on symbols instead of numbers, gives a graph of real operations.

The graph is evaluated here for comparison and written as an ONNX model in double precision, which the compiler takes
like any other model. Each step is one rounded operation, so that only exp and tanh are not exact to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.errors import InputError, MissingExtraError
from st_codegen.ir.arrays import FloatArray
from st_codegen.rig.effects import Conditions, Effect, Stage
from st_codegen.rig.model import RigModel

#: quantity -> field of Conditions
QUANTITIES = ("speed_rpm", "torque_Nm", "temperature_C")
_OPSET, _IR_VERSION = 17, 8
_PRODUCER = "st-codegen"

_BINARY: dict[str, Callable[[Any, Any], Any]] = {
    "Add": np.add,
    "Sub": np.subtract,
    "Mul": np.multiply,
    "Div": np.divide,
    "Max": np.maximum,
    "Pow": np.power,
}
_UNARY: dict[str, Callable[[Any], Any]] = {"Exp": np.exp, "Tanh": np.tanh, "Abs": np.absolute}
#: the binary operations of complex numbers
_OPERATORS = {np.add: "Add", np.subtract: "Sub", np.multiply: "Mul", np.divide: "Div", np.true_divide: "Div"}
_FUNCTIONS = {ufunc: name for name, ufunc in _UNARY.items()}


class NoFormulaError(Exception):
    """An effect that is not a formula of arithmetic and the functions below."""


@dataclass(frozen=True, eq=False)
class FormulaNode:
    """A real number: `constant`, an input (`name`), or an operation of ONNX on earlier nodes."""

    operator: str
    operands: tuple[FormulaNode, ...] = ()
    constant: float = 0.0
    name: str = ""

    def inputs(self) -> set[str]:
        """The names of the inputs it depends on."""
        return {node.name for node in in_order([self]) if node.operator == "Input"}


@dataclass
class Graph:
    """Makes nodes; equal ones are the same object, constants are folded."""

    made: dict[tuple[Any, ...], FormulaNode] = field(default_factory=dict)

    def _kept(self, key: tuple[Any, ...], node: FormulaNode) -> FormulaNode:
        return self.made.setdefault(key, node)

    def constant(self, value: float) -> FormulaNode:
        """A number."""
        value = float(value) + 0.0  # no negative zero
        return self._kept(("Constant", value), FormulaNode("Constant", constant=value))

    def input(self, name: str) -> FormulaNode:
        """An input."""
        return self._kept(("Input", name), FormulaNode("Input", name=name))

    def binary(self, operator: str, a: FormulaNode, b: FormulaNode) -> FormulaNode:
        """`a <operator> b`, simplified where one of them is a constant that changes nothing."""
        if a.operator == b.operator == "Constant":
            return self.constant(float(_BINARY[operator](a.constant, b.constant)))
        neutral = {"Add": 0.0, "Sub": 0.0, "Mul": 1.0, "Div": 1.0, "Max": -math.inf, "Pow": 1.0}[operator]
        if b.operator == "Constant" and b.constant == neutral:
            return a
        if operator in ("Add", "Mul") and a.operator == "Constant" and a.constant == neutral:
            return b
        if operator == "Mul" and any(x.operator == "Constant" and x.constant == 0.0 for x in (a, b)):
            return self.constant(0.0)
        if operator == "Div" and a.operator == "Constant" and a.constant == 0.0:
            return a
        return self._kept((operator, id(a), id(b)), FormulaNode(operator, (a, b)))

    def unary(self, operator: str, a: FormulaNode) -> FormulaNode:
        """A function of a number."""
        if a.operator == "Constant":
            return self.constant(float(_UNARY[operator](a.constant)))
        return self._kept((operator, id(a)), FormulaNode(operator, (a,)))


class Symbol(np.lib.mixins.NDArrayOperatorsMixin):
    """A complex number of two nodes; behaves as an array of NumPy in arithmetic and the real functions of `_traced`."""

    def __init__(self, graph: Graph, real: FormulaNode, imag: FormulaNode | None = None) -> None:
        self.graph, self.real = graph, real
        self.imag = graph.constant(0.0) if imag is None else imag

    @property
    def is_real(self) -> bool:
        """Whether the imaginary part is known to be zero."""
        return self.imag.operator == "Constant" and self.imag.constant == 0.0

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **_: Any) -> Symbol:
        symbols = [_symbol(self.graph, value) for value in inputs]
        if method != "__call__":
            raise NoFormulaError(f"np.{ufunc.__name__}.{method}")
        if ufunc in _OPERATORS:
            return _arithmetic(_OPERATORS[ufunc], *symbols)
        if ufunc is np.negative:
            return _arithmetic("Mul", symbols[0], _symbol(self.graph, -1.0))
        if ufunc is np.square:
            return _arithmetic("Mul", symbols[0], symbols[0])
        if ufunc is np.power:
            return _power(*symbols)
        if ufunc in _FUNCTIONS and symbols[0].is_real:
            return Symbol(self.graph, self.graph.unary(_FUNCTIONS[ufunc], symbols[0].real))
        if ufunc is np.maximum and all(symbol.is_real for symbol in symbols):
            return Symbol(self.graph, self.graph.binary("Max", symbols[0].real, symbols[1].real))
        raise NoFormulaError(f"np.{ufunc.__name__}")


def _symbol(graph: Graph, value: Any) -> Symbol:
    if isinstance(value, Symbol):
        return value
    array = np.asarray(value)
    if array.size != 1 or array.dtype.kind not in "fcib":
        raise NoFormulaError("an array of several numbers")
    number = complex(array.item())
    return Symbol(graph, graph.constant(number.real), graph.constant(number.imag))


def _arithmetic(operator: str, a: Symbol, b: Symbol) -> Symbol:
    g = a.graph
    if operator in ("Add", "Sub"):
        return Symbol(g, g.binary(operator, a.real, b.real), g.binary(operator, a.imag, b.imag))
    if b.is_real:
        return Symbol(g, g.binary(operator, a.real, b.real), g.binary(operator, a.imag, b.real))
    if operator == "Mul" and a.is_real:
        return _arithmetic(operator, b, a)
    if operator == "Mul":
        return Symbol(g, _crossed(g, "Sub", a.real, b.real, a.imag, b.imag),
                      _crossed(g, "Add", a.imag, b.real, a.real, b.imag))  # fmt: skip
    size = _crossed(g, "Add", b.real, b.real, b.imag, b.imag)
    above = _arithmetic("Mul", a, Symbol(g, b.real, g.binary("Mul", b.imag, g.constant(-1.0))))
    return Symbol(g, g.binary("Div", above.real, size), g.binary("Div", above.imag, size))


def _power(base: Symbol, exponent: Symbol) -> Symbol:
    """A power that is a number: a product where it is a square."""
    if not exponent.is_real or exponent.real.operator != "Constant":
        raise NoFormulaError("a power that is no number")
    power = exponent.real.constant
    if power in (1.0, 2.0):
        return base if power == 1.0 else _arithmetic("Mul", base, base)
    if power <= 0.0 or not base.is_real:
        raise NoFormulaError(f"a power of {power:g}" + ("" if base.is_real else " of a complex number"))
    return Symbol(base.graph, base.graph.binary("Pow", base.real, exponent.real))


def _crossed(g: Graph, operator: str, a: FormulaNode, b: FormulaNode, c: FormulaNode, d: FormulaNode) -> FormulaNode:
    """a * b <operator> c * d."""
    return g.binary(operator, g.binary("Mul", a, b), g.binary("Mul", c, d))


# --- effects ---


def operating_point(graph: Graph, sign: float) -> Conditions:
    """An operating point of symbols; the direction is a number."""
    parts: list[Any] = [Symbol(graph, graph.input(name)) for name in QUANTITIES]
    return Conditions(np.array([sign]), *parts)


def addends(rig: RigModel, order: int, at: Conditions, graph: Graph) -> list[tuple[str, Symbol]]:
    """What a rig adds to c_k of one order at an operating point of symbols, by name of the effect.

    What the measuring chain adds is no error of the reducer and stays out. Raises NoFormulaError.
    """
    found = _additive(rig, order, at, graph)
    for effect in rig.of_stage(Stage.MODULATION):
        if order not in effect.touched_orders():
            continue
        transfer = effect.transfer(order)
        if transfer is None:
            raise NoFormulaError(f"{effect.name} passes orders on in a way of its own")
        for carrier, factor in transfer.items():
            total = sum((symbol for _, symbol in _additive(rig, carrier, at, graph)), _symbol(graph, 0.0))
            found.append((effect.name, _symbol(graph, factor) * total))
        if effect.constant(order):
            found.append((effect.name, _symbol(graph, effect.constant(order))))
    for effect in rig.of_stage(Stage.STRUCTURE):
        if order in effect.touched_orders():
            found.append((effect.name, _traced(effect, order, at, graph)))
    return found


def _additive(rig: RigModel, order: int, at: Conditions, graph: Graph) -> list[tuple[str, Symbol]]:
    found = [("zero_offset", _symbol(graph, rig.zero_offset_deg))] if order == 0 else []
    for effect in rig.of_stage(Stage.ADDITIVE):
        if order in effect.touched_orders():
            found.append((effect.name, _traced(effect, order, at, graph)))
    return found


def _traced(effect: Effect, order: int, at: Conditions, graph: Graph) -> Symbol:
    try:
        return _symbol(graph, effect.coefficient(at, order))
    except (NoFormulaError, InputError, TypeError, ValueError, AttributeError) as error:
        raise NoFormulaError(
            f"the method `coefficient` of {effect.name} is no formula of arithmetic, powers, np.exp, np.tanh, "
            f"np.abs and np.maximum ({error})"
        ) from None


# --- what becomes of a graph ---


def in_order(nodes: Sequence[FormulaNode]) -> list[FormulaNode]:
    """All nodes that these need, operands first, each once."""
    found: dict[int, FormulaNode] = {}
    stack = [(node, False) for node in reversed(nodes)]
    while stack:
        node, ready = stack.pop()
        if id(node) in found:
            continue
        if ready:
            found[id(node)] = node
        else:
            stack.append((node, True))
            stack += [(operand, False) for operand in reversed(node.operands)]
    return list(found.values())


def evaluate(nodes: Sequence[FormulaNode], inputs: Mapping[str, FloatArray]) -> FloatArray:
    """Values at operating points, float64 (n, nodes)."""
    values: dict[int, Any] = {}
    for node in in_order(nodes):
        operands = [values[id(operand)] for operand in node.operands]
        if node.operator == "Constant":
            values[id(node)] = np.float64(node.constant)
        elif node.operator == "Input":
            values[id(node)] = inputs[node.name]
        else:
            values[id(node)] = (_BINARY | _UNARY)[node.operator](*operands)
    count = len(next(iter(inputs.values())))
    return np.stack([np.broadcast_to(values[id(node)], count) for node in nodes], axis=1)


def write_onnx(path: Path, nodes: Sequence[FormulaNode], features: Sequence[str], note: str) -> None:
    """Write nodes as the outputs of one ONNX model of `features` (the name of each input, in their order).

    Raises MissingExtraError without onnx.
    """
    try:
        import onnx
        from onnx import TensorProto, helper
    except ImportError:
        raise MissingExtraError("onnx", "onnx", "writing formulas as models") from None
    steps, tensors, names = [], [], {}
    for number, node in enumerate(in_order(nodes)):
        name = names[id(node)] = f"v{number}"
        if node.operator == "Constant":
            # a column, so that it fits whatever it is combined with
            tensors.append(helper.make_tensor(name, TensorProto.DOUBLE, [1, 1], [node.constant]))
        elif node.operator == "Input":
            place = f"i{number}"
            tensors.append(helper.make_tensor(place, TensorProto.INT64, [1], [list(features).index(node.name)]))
            steps.append(helper.make_node("Gather", ["x", place], [name], axis=1))
        else:
            steps.append(helper.make_node(node.operator, [names[id(o)] for o in node.operands], [name]))
    columns = [names[id(node)] for node in nodes]
    constants = [number for number, node in enumerate(nodes) if not node.inputs()]
    if constants:
        # a constant output still has a row for each operating point
        tensors += [helper.make_tensor("i", TensorProto.INT64, [1], [0])]
        tensors += [helper.make_tensor("zero", TensorProto.DOUBLE, [1, 1], [0.0])]
        steps += [
            helper.make_node("Gather", ["x", "i"], ["any"], axis=1),
            helper.make_node("Mul", ["any", "zero"], ["o"]),
        ]
    for number in constants:
        steps.append(helper.make_node("Add", ["o", columns[number]], [f"c{number}"]))
        columns[number] = f"c{number}"
    steps.append(helper.make_node("Concat", columns, ["y"], axis=1))
    x = helper.make_tensor_value_info("x", TensorProto.DOUBLE, [None, len(features)])
    y = helper.make_tensor_value_info("y", TensorProto.DOUBLE, [None, len(nodes)])
    graph = helper.make_graph(steps, "formula", [x], [y], tensors, doc_string=note)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)], producer_name=_PRODUCER)
    model.ir_version = _IR_VERSION
    onnx.save_model(model, path)
