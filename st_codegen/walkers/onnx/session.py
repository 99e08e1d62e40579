"""The answers of onnxruntime itself, one row at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto

from st_codegen.errors import InputError
from st_codegen.ir import AnyArray, FloatArray, IntArray, Label
from st_codegen.processes import failure_in_copy
from st_codegen.walkers.base import Predictor
from st_codegen.walkers.classes import numbers_of
from st_codegen.walkers.onnx.file import printable
from st_codegen.walkers.onnx.inline import nodes_within

#: Rows with which a batch is tried at most.
MOST_ROWS = 16


@dataclass(frozen=True)
class GraphInput:
    """An input of the graph: its shape for one row, its type, and the first of its features.

    `batch` is the number of rows with which a batch is tried: the declared one, 2 where the file leaves it open, and 1
    where the input holds one row or has no dimension for rows. `cut`: integers that the graph reads without the
    fractions that a number may have, or truth values. `is_short`: integers of 32 bits.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    start: int
    batch: int = 1
    cut: bool = False
    is_short: bool = False

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    @property
    def columns(self) -> IntArray:
        return np.arange(self.start, self.start + self.size).reshape(self.shape)


#: Makes numbers of what onnxruntime gives for an output.
Reader = Callable[[Any], FloatArray]


def read_label(labels: tuple[Label, ...]) -> Reader:
    """The number of a label."""
    return lambda found: numbers_of(labels, np.ravel(found))[0]


def read_map(labels: tuple[Label, ...]) -> Reader:
    """The numbers of a map, in the order of its labels: onnxruntime sorts them."""
    return lambda found: np.array([found[0][label] for label in labels], np.float64)


def read_largest(found: Any) -> FloatArray:
    """The number of the largest, the first of equal ones."""
    return np.array([np.argmax(found)], np.float64)


def predictor(
    model: onnx.ModelProto,
    inputs: list[GraphInput],
    outputs: list[tuple[str, Reader]],
    file: str,
    takes: Mapping[int, FloatArray],
) -> Predictor:
    """onnxruntime on rows (rows, features), one at a time: the outputs that are read, laid end to end.

    `takes`: the numbers with which it is tried, of features of which it takes no others.

    It is given the model at the first call. Raises InputError where it refuses the model, or where rows of a batch
    were seen to change each other's answers; a copy of this process tries both (see `processes`).
    """
    data = _with_double_inputs(model, inputs)
    predict = _SessionPredictor(data, inputs, outputs, file, takes)
    failure = failure_in_copy(predict.try_it)
    if failure is not None:
        raise InputError(failure if failure.startswith(file) else f"{file}: onnxruntime refuses the model: {failure}")
    return predict


class _SessionPredictor:
    """onnxruntime's own prediction, row by row; the model is loaded at the first call."""

    def __init__(
        self,
        data: bytes,
        inputs: list[GraphInput],
        outputs: list[tuple[str, Reader]],
        file: str,
        takes: Mapping[int, FloatArray],
    ) -> None:
        self.data, self.inputs, self.outputs, self.file, self.takes = data, inputs, outputs, file, takes

    @cached_property
    def session(self) -> Any:
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        options.log_severity_level = 4
        try:
            return onnxruntime.InferenceSession(self.data, options, providers=["CPUExecutionProvider"])
        except Exception as error:  # its exceptions have no common base class
            raise InputError(f"{self.file}: onnxruntime refuses the model: {printable(str(error), 400)}") from error

    def try_it(self) -> None:
        """Raise InputError for faults that show only when a model runs, and where a row of a batch has no own answer.

        One row of a batch is changed at random: the answers of all others must stay, and there must be as many numbers
        for each row as one row alone has. A graph that takes no batch passes: it can be called with single rows only.
        """
        width = self.inputs[-1].start + self.inputs[-1].size
        try:
            self(row := self._taken(np.zeros((1, width))))  # some faults show only when a model runs
        except InputError:  # 0 may be no position in a list
            try:
                self(row := self._taken(np.ones((1, width))))
            except InputError as error:
                if "Unknown Category" not in str(error):
                    raise
                raise InputError(
                    f"{error}; no row of known categories was found to try the model with: fit the OneHotEncoder with "
                    "handle_unknown='ignore', or export it with zeros=1"
                ) from error
        most = max(given.batch for given in self.inputs)
        if most == 1:
            return
        alone = self._batch(row, 1)
        # a constant with a row for each row of a batch takes no other batch, and gives one row all of its own rows
        lengths = {len(found) for found in alone if np.ndim(found)}
        for rows in sorted({most, *(length for length in lengths if 1 < length <= MOST_ROWS)}):
            for name, found in zip(self.names, alone, strict=True):
                if not self._try_batch(rows, name, np.size(found), fractions=True):
                    self._try_batch(rows, name, np.size(found), fractions=False)

    def _try_batch(self, rows: int, name: str, size: int, *, fractions: bool) -> bool:
        """Raise InputError where a batch of so many rows does not hold an answer of so many numbers for each row.

        Nor does it where rows have other answers at other places, by more than their last digits: two at least, since
        in one rounding may decide what is the largest, or a step. Of numbers with fractions, or of 0 and 1, which are
        positions in any list of two; FALSE: it takes no such batch.
        """
        width = self.inputs[-1].start + self.inputs[-1].size
        random, output = np.random.default_rng(0), self.names.index(name)
        draw = partial(random.normal, 0.0, 3.0) if fractions else partial(random.integers, 0, 2)
        moved = 0
        for changed in (0, rows - 1) * 4:
            batch, fresh = (self._taken(np.asarray(draw((rows, width)), np.float64), random) for _ in range(2))
            other = batch.copy()
            for given in self.inputs:
                if given.batch > 1:
                    other[changed, given.columns] = fresh[changed, given.columns]
            try:
                three = (batch, other, np.repeat(batch[:1], rows, axis=0))
                pair = [np.asarray(self._batch(x, rows)[output]) for x in three]
            except Exception:  # its exceptions have no common base class
                return False
            if any(found.size != rows * size for found in pair):
                raise self._no_own_answers(rows, name)
            rest = [np.delete(found.reshape(rows, size), changed, axis=0).tolist() for found in pair[:2]]
            if repr(rest[0]) != repr(rest[1]):
                raise self._no_own_answers(rows, name)
            moved += not _is_one_row(pair[2].reshape(rows, size))
        if moved > 1:
            raise self._no_own_answers(rows, name)
        return True

    def _no_own_answers(self, rows: int, name: str) -> InputError:
        return InputError(
            f"{self.file}: among {rows} rows at once, rows have no answers of their own in the output "
            f"'{printable(name)}': an operator works along axis 0 (Softmax, a mean, Concat, Trilu, "
            "DynamicQuantizeLinear, a constant with several rows, ..), and a controller has one row at a time; where "
            "one row is meant, export with a batch dimension of 1"
        )

    def _taken(self, x: FloatArray, random: np.random.Generator | None = None) -> FloatArray:
        """The rows, with numbers that the library takes in place of others: the first ones, or some at random."""
        for feature, numbers in self.takes.items():
            if len(numbers):
                x[:, feature] = numbers[0] if random is None else random.choice(numbers, len(x))
        return x

    def _batch(self, x: FloatArray, rows: int) -> list[Any]:
        """The outputs for several rows at once; inputs without a dimension for rows have the numbers of the first."""
        shaped = {}
        for given in self.inputs:
            count = rows if given.batch > 1 else 1
            shape = (count * given.shape[0], *given.shape[1:]) if given.shape else ()
            shaped[given.name] = x[:count, given.columns].astype(_given_type(given)).reshape(shape)
        found: list[Any] = self.session.run(self.names, shaped)
        return found

    @cached_property
    def names(self) -> list[str]:
        """The outputs of the graph that are read."""
        return list(dict.fromkeys(name for name, _ in self.outputs))

    def __call__(self, x: FloatArray) -> FloatArray:
        if not len(x):  # of no rows onnxruntime does not say how many outputs there are
            return self(self._taken(np.zeros((1, x.shape[1]))))[:0]
        with np.errstate(over="ignore"):
            columns = {given.name: x[:, given.columns].astype(_given_type(given)) for given in self.inputs}
        result, session = [], self.session
        for row in range(len(x)):
            try:
                found = session.run(self.names, {name: np.asarray(column[row]) for name, column in columns.items()})
            except Exception as error:  # as above
                reason = printable(str(error), 400)
                raise InputError(f"{self.file}: onnxruntime fails on row {row}: {reason}") from error
            by_name = dict(zip(self.names, found, strict=True))
            result.append(np.concatenate([read(by_name[name]) for name, read in self.outputs]))
        return np.array(result, np.float64).reshape(len(x), -1)


def _is_one_row(found: AnyArray) -> bool:
    """Whether all rows are the first, but for the lower half of their digits: kernels may add in another order."""
    if found.dtype.kind != "f":
        return bool(np.all(found == found[:1]))
    digits = math.sqrt(np.finfo(found.dtype).eps)
    size = np.max(np.abs(found[np.isfinite(found)]), initial=0.0)
    return np.allclose(found, found[:1], rtol=digits, atol=digits * size, equal_nan=True)


def _given_type(given: GraphInput) -> type[np.floating[Any]]:
    """The type of the numbers that an input is given: double in place of integers and truth values."""
    return np.float32 if given.dtype == np.float32 else np.float64


def _with_double_inputs(model: onnx.ModelProto, inputs: list[GraphInput]) -> bytes:
    """The model with double inputs in place of other types, which only casts to float or double read, or are cast."""
    whole = {given.name: given.cut for given in inputs if given.dtype in (np.int64, np.bool_)}
    for info in model.graph.input:
        if info.name not in whole:
            continue
        declared = info.type.tensor_type.elem_type
        info.type.tensor_type.elem_type = TensorProto.DOUBLE
        if whole[info.name]:
            _read_cut(model.graph, info.name, declared)
    return bytes(model.SerializeToString())


def _read_cut(graph: onnx.GraphProto, name: str, elem_type: int) -> None:
    """Put a cast to the declared type behind an input that is given as numbers."""
    nodes = list(nodes_within(graph.node))
    used = {*(one for node in nodes for one in (*node.input, *node.output)), *(one.name for one in graph.input)}
    own = next(f"{name}_whole{n or ''}" for n in range(len(used) + 1) if f"{name}_whole{n or ''}" not in used)
    for node in nodes:
        for number, read in enumerate(node.input):
            if read == name:
                node.input[number] = own
    graph.node.insert(0, onnx.helper.make_node("Cast", [name], [own], to=elem_type))
