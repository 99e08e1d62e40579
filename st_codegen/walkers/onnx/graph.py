"""Walks an ONNX graph as onnxruntime evaluates it for one row, and notes its operations in a graph builder.

The batch dimension is 1 throughout. A computed tensor is a list of references to columns of the intermediate
representation's values, so that whatever only moves numbers about (Reshape, Concat, Gather, ..) costs nothing and is
checked by doing it. float32 tensors are rounded where they are first computed with.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import onnx

from st_codegen import ir
from st_codegen.errors import InputError, Problems, UnsupportedModelError, errors_name
from st_codegen.ir.arrays import AnyArray, IntArray
from st_codegen.walkers.base import GraphBuilder
from st_codegen.walkers.onnx.file import GraphNode, domain_of, node_label, printable, read_tensor
from st_codegen.walkers.onnx.operands import (
    FLOAT32,
    FLOAT64,
    INTEGERS,
    MAX_COLUMNS,
    MAX_WHOLE,
    BetweenOperand,
    ConstantOperand,
    LabelOperand,
    MedianOperand,
    Operand,
    PickedOperand,
    Tensor,
    as_doubles,
    check_size,
    require_finite,
    require_float,
    require_tensor,
)

#: IntArray in all results and weights of one graph.
MAX_NUMBERS = 2**26


@dataclass(frozen=True)
class NodeCall:
    """One node and the operands it reads, None for an optional input that is absent."""

    walk: GraphWalk
    node: GraphNode
    operands: Sequence[Operand | None]

    def optional(self, number: int) -> Operand | None:
        """An input that may be absent."""
        return self.operands[number] if number < len(self.operands) else None

    def required(self, number: int = 0) -> Operand:
        """An input; raises InputError where it is absent."""
        operand = self.optional(number)
        if operand is None:
            raise InputError(f"input {number} is missing; the model file is damaged")
        return operand

    def computed(self, number: int = 0) -> Tensor:
        """An input that has to be computed floating-point numbers."""
        return require_float(require_tensor(self.walk.numbered(self.required(number))))

    def floating(self) -> Tensor:
        """The first input as floating-point numbers: classifiers and scalers cast integers to float32 themselves."""
        tensor = require_tensor(self.walk.numbered(self.required()))
        whole = tensor.dtype in INTEGERS and not tensor.given
        return self.walk.as_type(tensor, FLOAT32) if whole else require_float(tensor)

    def constant(self, number: int, what: str) -> AnyArray | None:
        """The array of a constant input that may be absent."""
        operand = self.optional(number)
        if operand is None:
            return None
        if isinstance(operand, BetweenOperand):
            raise UnsupportedModelError(f"{what} is computed by the graph; fold constants when exporting")
        if not isinstance(operand, ConstantOperand):
            raise UnsupportedModelError(f"{what} is computed from the inputs; it has to be a constant")
        if operand.dtype.kind == "O":
            raise InputError(f"{what} is text, expected numbers; the model file is damaged")
        return operand.array

    def integers(self, number: int, what: str) -> list[int] | None:
        """The whole numbers of a constant input that may be absent."""
        array = self.constant(number, what)
        if array is None:
            return None
        if array.dtype not in (np.int64, np.int32) or array.ndim > 1:
            raise InputError(f"{what} is {array.dtype} of shape {array.shape}, expected a list of integers")
        if array.size > MAX_COLUMNS:
            raise UnsupportedModelError(f"{what} has {array.size} numbers, at most {MAX_COLUMNS} are supported")
        return [int(number) for number in array.ravel()]

    def positions(self) -> AnyArray:
        """The second input of an operator that picks elements."""
        positions = self.constant(1, "the list of positions")
        if positions is None or positions.dtype not in (np.int64, np.int32):
            raise InputError("the positions are missing or not integers; the model file is damaged")
        return positions


#: What an operator gives: its first output, or all of them (None: one that is left out of the model).
Result = Operand | tuple[Operand | None, ...]
Handler = Callable[[NodeCall], Result]


@dataclass(frozen=True)
class Rule:
    """How the outputs of an operator are walked, and the versions of it (opset of their last change) that fit.

    `schema` is that of an operator of onnxruntime's own, which the onnx package does not know.
    """

    handler: Handler
    versions: frozenset[int]
    schema: onnx.defs.OpSchema | None = None


RULES: dict[tuple[str, str], Rule] = {}


def operator(
    names: str, *versions: int, domain: str = "", schema: onnx.defs.OpSchema | None = None
) -> Callable[[Handler], Handler]:
    """Register the handler of the versions of an operator, or of several ones: their names stand apart by spaces."""

    def register(handler: Handler) -> Handler:
        for name in names.split():
            RULES[domain, name] = Rule(handler, frozenset(versions), schema)
        return handler

    return register


class GraphWalk:
    """One walk through a graph; `values` holds the tensors by name, None for what could not be computed or is left out.

    `zipped` has the labels of outputs that are maps from labels to numbers, `notes` what the user has to know. `takes`
    has the numbers of features of which onnxruntime takes no others. `rounds` counts those of all loops.
    """

    def __init__(self, n_features: int) -> None:
        self.builder = GraphBuilder(n_features)
        self.values: dict[str, Operand | None] = {}
        self.zipped: dict[str, tuple[ir.Label, ...]] = {}
        self.notes: list[str] = []
        self.takes: dict[int, ir.FloatArray] = {}
        self.opsets: dict[str, int] = {}
        self.narrows = False
        self.rounds = 0
        self._numbers = 0
        self._settled: dict[tuple[bytes, bytes, bool, bool], int] = {}

    def charge(self, count: int) -> None:
        """Count numbers that the walk keeps; raises UnsupportedModelError when a graph asks for too many."""
        self._numbers += count
        if self._numbers > MAX_NUMBERS:
            raise UnsupportedModelError(
                f"the graph needs more than {MAX_NUMBERS} numbers in all; share less, or split the model"
            )

    def settle(self, tensor: Tensor) -> int:
        """The value of the representation whose columns are the elements of a tensor in order, rounded and cut."""
        value, column = np.ravel(tensor.value), np.ravel(tensor.column)
        key = (value.tobytes(), column.tobytes(), tensor.unrounded, tensor.uncut)
        if key not in self._settled:
            number = self.gathered(value, column)
            if tensor.unrounded:
                number = self.builder.add(ir.Round(inputs=(number,), width=len(column)))
            if tensor.uncut:
                number = self.builder.add(ir.WholeNumber((number,), len(column), ir.Towards.ZERO))
            self._settled[key] = number
        return self._settled[key]

    def gathered(self, value: IntArray, column: IntArray) -> int:
        """The value that has the given columns of other values, without rounding."""
        first = int(value[0])
        width = self.builder.width(first)
        if np.all(value == first) and np.array_equal(column, np.arange(width)):
            return first
        inputs = np.unique(value)
        start = np.cumsum([0, *(self.builder.width(int(number)) for number in inputs)])
        columns = start[np.searchsorted(inputs, value)] + column
        return self.builder.select(columns, *inputs.tolist())

    def numbers(self, array: AnyArray, beside: Tensor) -> Tensor:
        """Constants as numbers that are computed for each row, of a number that is there."""
        self.refuse_special(beside)
        constants = require_finite(as_doubles(array).ravel())
        first = self.builder.select(np.zeros(len(constants), np.int32), self.settle(beside))
        return self.computed(ir.Clip((first,), constants, constants), array.shape, array.dtype)

    def numbered(self, operand: Operand) -> Operand:
        """Labels that are numbers as computed numbers; any other operand as it is."""
        if not isinstance(operand, LabelOperand) or operand.dtype.kind == "O":
            return operand
        labels = np.array(operand.labels, np.float64)
        if not np.all(np.abs(labels) <= MAX_WHOLE if operand.dtype in INTEGERS else np.isfinite(labels)):
            raise UnsupportedModelError("computes with numbers of a list that are not finite, or of more than 53 bits")
        knots, pieces = np.arange(float(len(labels))), np.full((len(labels) + 1, 1), labels[0])
        made = self.builder.add(ir.Piecewise((operand.value,), np.array([0, len(labels)]), knots, labels, pieces))
        zeros = np.zeros(operand.shape, np.int64)
        return Tensor(zeros + made, zeros, operand.dtype, special=False)

    def computed(
        self, made: ir.Operation | int, shape: Sequence[int], dtype: np.dtype[Any], special: bool = False
    ) -> Tensor:
        """The tensor that a value of the representation holds, or that an operation makes."""
        value = made if isinstance(made, int) else self.builder.add(made)
        width = self.builder.width(value)
        column = np.arange(width).reshape(tuple(shape))
        return Tensor(np.full(tuple(shape), value), column, dtype, special=special)

    def joined(self, tensors: Sequence[Tensor]) -> int:
        """The value that has the elements of all tensors in order."""
        settled = [self.settle(tensor) for tensor in tensors]
        value = np.repeat(settled, [tensor.size for tensor in tensors])
        return self.gathered(value, np.concatenate([np.arange(tensor.size) for tensor in tensors]))

    def finish(self, tensors: Sequence[Tensor]) -> None:
        """Make the elements of all tensors, in order, the last value."""
        number = self.joined(tensors)
        if number < max(len(self.builder.ops), 1):
            columns = np.arange(self.builder.width(number), dtype=np.int32)
            self.builder.select(columns, number)

    def ends_in(self, kind: type[ir.Operation], tensor: Tensor) -> bool:
        """Whether a tensor of several numbers is all of what an operation of a kind computes."""
        value, column = np.ravel(tensor.value), np.ravel(tensor.column)
        made = self.builder.ops[value[0] - 1] if value[0] and np.all(value == value[0]) else None
        return isinstance(made, kind) and tensor.size > 1 and np.array_equal(column, np.arange(made.width))

    def refuse_special(self, tensor: Tensor) -> None:
        """Refuse NaN and infinite inputs where what an operator makes of them is not certain."""
        if tensor.special:
            self.builder.refuse_nan()
            self.builder.refuse_magnitude(ir.FLOAT32_OVERFLOW if self.narrows else math.inf)

    def settle_finite(self, tensor: Tensor) -> int:
        """The value of a tensor, as `settle`, for an operator that is certain of finite numbers only."""
        self.refuse_special(tensor)
        return self.settle(tensor)

    def cut(self, tensor: Tensor) -> Tensor:
        """A tensor whose integers are no longer to be cut."""
        return self.computed(self.settle(tensor), tensor.shape, tensor.dtype) if tensor.uncut else tensor

    def as_type(self, tensor: Tensor, dtype: np.dtype[Any]) -> Tensor:
        """A tensor cast to float32 or float64."""
        tensor = self.cut(tensor)
        if dtype == FLOAT64 or tensor.dtype == FLOAT32:
            return replace(tensor, dtype=dtype, given=False)
        self.narrows = True
        return replace(tensor, dtype=dtype, unrounded=True, given=False)


def run_nodes(walk: GraphWalk, graph: onnx.GraphProto, opsets: dict[str, int], problems: Problems) -> None:
    """Walk all nodes of a graph; what is wrong with any of them is noted in `problems`."""
    walk.opsets = opsets
    unsupported: dict[tuple[str, str, int], list[str]] = {}
    made_by = {name: label for node in graph.node for label in [node_label(node)] for name in node.output if name}
    for proto in graph.node:
        domain = domain_of(proto.domain)
        label = f"{node_label(proto)} ({printable(proto.op_type)}, opset {opsets.get(domain, 'unknown')})"
        rule = RULES.get((domain, proto.op_type))
        result: Result | None = None
        if rule is None:
            unsupported.setdefault((domain, proto.op_type, opsets.get(domain, 0)), []).append(node_label(proto))
        else:
            with problems.collect(), errors_name(label):
                result = _run_node(walk, proto, rule, opsets, made_by)
        with problems.collect(), errors_name(label):
            _store(walk, proto, result)
    _report_unsupported(unsupported, problems)


def _run_node(
    walk: GraphWalk, proto: onnx.NodeProto, rule: Rule, opsets: dict[str, int], made_by: dict[str, str]
) -> Result | None:
    """The result of a node; None where one of its inputs could not be computed or is left out."""
    domain = domain_of(proto.domain)
    if domain not in opsets:
        raise InputError(f"the file names no opset for the domain '{domain or 'ai.onnx'}'; the model file is damaged")
    try:
        node = GraphNode(proto, rule.schema or onnx.defs.get_schema(proto.op_type, opsets[domain], domain))
    except onnx.defs.SchemaError:
        raise UnsupportedModelError("this opset has no such operator; export with another target_opset") from None
    if node.version not in rule.versions:
        known = ", ".join(map(str, sorted(rule.versions)))
        raise UnsupportedModelError(
            f"version {node.version} of this operator is not supported (known: {known}); "
            "export the model with another target_opset"
        )
    node.check()
    operands: list[Operand | None] = []
    for name in proto.input:
        if name and name not in walk.values:
            raise InputError(
                f"reads '{printable(name)}', "
                + (
                    f"which {made_by[name]} computes only later: the graph has a cycle or is not in order"
                    if name in made_by
                    else "which nothing computes"
                )
                + "; the model file is damaged"
            )
        operands.append(walk.values[name] if name else None)
    if any(name and operand is None for name, operand in zip(proto.input, operands, strict=True)):
        return None
    result = _handled(rule, NodeCall(walk, node, operands))
    for operand in result if isinstance(result, tuple) else (result,):
        if operand is None:
            continue
        if not isinstance(operand, ConstantOperand):
            check_size(operand.shape)
        walk.charge(math.prod(operand.shape))
    return result


#: Operators that compute each element by itself.
_EACH = frozenset("Abs Add Cast Div Equal Greater Identity Less Max Min Mul Neg Not Pow Reciprocal Sqrt Sub".split())


#: Operators of which exporters make a weighted median; others read no step of it.
MEDIAN_STEPS = ("CumSum", "ArrayFeatureExtractor", "Mul", "Less", "Cast", "ArgMin", "GatherElements")


def _handled(rule: Rule, call: NodeCall) -> Result:
    """The result of a node; of elements that are picked that of all of which they may be."""
    if call.node.op_type not in (*MEDIAN_STEPS, "Reshape"):
        for operand in call.operands:
            if isinstance(operand, MedianOperand):
                require_tensor(operand)
    picks = [operand for operand in call.operands if isinstance(operand, PickedOperand)]
    if not picks or call.node.op_type not in _EACH:
        return rule.handler(call)
    others = [operand for operand in call.operands if not isinstance(operand, PickedOperand)]
    same = len({(picked.value, picked.count, math.prod(picked.whole.shape)) for picked in picks}) == 1
    if not same or any(not isinstance(other, ConstantOperand) or other.array.size != 1 for other in others):
        raise UnsupportedModelError("what TopK picks together with others; a constant is supported")
    shape = np.broadcast_shapes(*(operand.shape for operand in call.operands if operand is not None))
    given = [operand.whole if isinstance(operand, PickedOperand) else operand for operand in call.operands]
    found = rule.handler(replace(call, operands=given))
    if not isinstance(found, ConstantOperand | Tensor):
        raise UnsupportedModelError("labels of what TopK picks; sums and means of numbers are supported")
    return replace(picks[0], whole=found.moved(np.ravel), shape=shape)


def _store(walk: GraphWalk, proto: onnx.NodeProto, result: Result | None) -> None:
    results = result if isinstance(result, tuple) else (result,) * len(proto.output)
    for name, operand in zip(proto.output, results, strict=False):
        if name in walk.values:
            raise InputError(f"'{printable(name)}' is computed twice; the model file is damaged")
        if name:
            walk.values[name] = operand


_MADE_BY_ONNXRUNTIME = (
    "operators of com.microsoft are often those of onnxruntime's optimized or quantized graphs: compile the graph from "
    "before optimizing, and quantize with QuantFormat.QDQ"
)


def _report_unsupported(unsupported: dict[tuple[str, str, int], list[str]], problems: Problems) -> None:
    for (domain, name, opset), labels in unsupported.items():
        more = f" and {len(labels) - 3} more" if len(labels) > 3 else ""
        where = f"{', '.join(labels[:3])}{more}"
        full = f"{printable(domain)}.{printable(name)}" if domain else printable(name)
        problems.errors.append(
            UnsupportedModelError(f"operator {full} (opset {opset or 'unknown'}) is not supported: {where}")
        )
    if unsupported:
        known = ", ".join(sorted(name for _, name in RULES))
        made = any(domain.startswith("com.microsoft") for domain, _, _ in unsupported)
        others = f"; {_MADE_BY_ONNXRUNTIME}" if made else ""
        problems.errors.append(
            UnsupportedModelError(
                f"supported operators: {known}; leave the others out when exporting, or compile the native model"
                f"{others}"
            )
        )


def read_initializers(walk: GraphWalk, graph: onnx.GraphProto, problems: Problems) -> None:
    """Note the constants of a graph."""
    if graph.sparse_initializer:
        problems.errors.append(UnsupportedModelError("sparse initializers are not supported; export dense tensors"))
    for tensor in graph.initializer:
        name = printable(tensor.name)
        with problems.collect():
            if tensor.name in walk.values:
                raise InputError(f"the initializer '{name}' appears twice; the model file is damaged")
            walk.values[tensor.name] = None
            with errors_name(f"initializer '{name}'"):
                walk.values[tensor.name] = ConstantOperand(read_tensor(tensor))
