"""The answers of onnxruntime itself, one row at a time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto

from st_codegen.errors import InputError
from st_codegen.ir import FloatArray, IntArray, Label
from st_codegen.processes import failure_in_copy
from st_codegen.walkers.base import Predictor
from st_codegen.walkers.classes import numbers_of
from st_codegen.walkers.onnx.file import printable


@dataclass(frozen=True)
class GraphInput:
    """An input of the graph: its shape for one row, its type, and the first of its features."""

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    start: int

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
    model: onnx.ModelProto, inputs: list[GraphInput], outputs: list[tuple[str, Reader]], file: str
) -> Predictor:
    """onnxruntime on rows (rows, features), one at a time: the outputs that are read, laid end to end.

    It is given the model at the first call. Raises InputError where it refuses the model, which a copy of this process
    tries (see `processes`).
    """
    data = _with_double_inputs(model, inputs)
    predict = _SessionPredictor(data, inputs, outputs, file)
    row = np.zeros((1, inputs[-1].start + inputs[-1].size))  # some faults show only when a model runs
    failure = failure_in_copy(lambda: predict(row))
    if failure is not None:
        raise InputError(failure if failure.startswith(file) else f"{file}: onnxruntime refuses the model: {failure}")
    return predict


class _SessionPredictor:
    """onnxruntime's own prediction, row by row; the model is loaded at the first call."""

    def __init__(self, data: bytes, inputs: list[GraphInput], outputs: list[tuple[str, Reader]], file: str) -> None:
        self.data, self.inputs, self.outputs, self.file = data, inputs, outputs, file

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

    def __call__(self, x: FloatArray) -> FloatArray:
        names = list(dict.fromkeys(name for name, _ in self.outputs))
        with np.errstate(over="ignore"):
            columns = {
                given.name: x[:, given.columns].astype(np.float32 if given.dtype == np.float32 else np.float64)
                for given in self.inputs
            }
        result = []
        for row in range(len(x)):
            try:
                found = self.session.run(names, {name: np.asarray(column[row]) for name, column in columns.items()})
            except Exception as error:  # as above
                reason = printable(str(error), 400)
                raise InputError(f"{self.file}: onnxruntime fails on row {row}: {reason}") from error
            by_name = dict(zip(names, found, strict=True))
            result.append(np.concatenate([read(by_name[name]) for name, read in self.outputs]))
        return np.array(result, np.float64).reshape(len(x), -1)


def _with_double_inputs(model: onnx.ModelProto, inputs: list[GraphInput]) -> bytes:
    """The model with double in place of integer inputs, which only casts to float or double read."""
    whole = {given.name for given in inputs if given.dtype == np.int64}
    for info in model.graph.input:
        if info.name in whole:
            info.type.tensor_type.elem_type = TensorProto.DOUBLE
    return bytes(model.SerializeToString())
