"""What the outputs of an ONNX graph are: numbers, or the class, the probabilities and the scores of a classifier."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import onnx
from onnx import TensorProto
from onnx.helper import np_dtype_to_tensor_dtype

from st_codegen.errors import InputError, Problems, UnsupportedModelError
from st_codegen.ir import Softmax
from st_codegen.walkers.base import Classified
from st_codegen.walkers.classes import largest
from st_codegen.walkers.onnx.file import plain, printable, type_name
from st_codegen.walkers.onnx.graph import GraphWalk
from st_codegen.walkers.onnx.operands import (
    TRUTH,
    BetweenOperand,
    ConstantOperand,
    LabelOperand,
    MedianOperand,
    PickedOperand,
    Tensor,
)
from st_codegen.walkers.onnx.ranges import are_shares
from st_codegen.walkers.onnx.session import Reader, read_label, read_largest, read_map

#: What a graph computes (None: all numbers of the last value), how each of its outputs is read, and notes on them.
Finished = tuple[Classified | None, list[tuple[str, Reader]], tuple[str, ...]]


def finish(walk: GraphWalk, graph: onnx.GraphProto, problems: Problems) -> Finished:
    """Make the outputs of a graph those of the model; what is wrong with any is noted in `problems`.

    A graph with a label among its outputs, or that ends with Softmax, is a classifier.
    """
    found = {info.name: operand for info in graph.output for operand in _checked(walk, info, problems)}
    if not found and not problems.errors:
        kind = UnsupportedModelError if walk.notes else InputError
        why = "; ".join(walk.notes) or "the file is damaged"
        problems.errors.append(kind(f"the graph has no outputs that are compiled; {why}"))
    if problems.errors:
        return None, [], ()
    tensors = {name: operand for name, operand in found.items() if isinstance(operand, Tensor)}
    for tensor in tensors.values():
        walk.refuse_special(tensor)
    choices = {name: operand for name, operand in found.items() if isinstance(operand, LabelOperand)}
    if len(choices) > 1:
        names = ", ".join(map(printable, choices))
        problems.errors.append(UnsupportedModelError(f"several outputs are labels: {names}; leave one of them"))
        return None, [], ()
    readers: dict[str, Reader] = {
        name: read_map(walk.zipped[name]) if name in walk.zipped else _read_numbers for name in tensors
    }
    if choices:
        ((name, choice),) = choices.items()
        result = (name, read_label(choice.labels)), Classified(choice.labels, choice.value)
        return _classified(walk, *result, tensors, readers)
    if len(tensors) == 1 and walk.ends_in(Softmax, *tensors.values()):
        ((name, tensor),) = tensors.items()
        value = walk.settle(tensor)
        result = (name, read_largest), Classified(tuple(range(tensor.size)), largest(walk.builder, value))
        return _classified(walk, *result, tensors, readers)
    walk.finish(list(tensors.values()))
    order = (f"outputs in order: {', '.join(map(plain, tensors))}",) if len(tensors) > 1 else ()
    return None, list(readers.items()), (*order, *walk.notes)


def _checked(walk: GraphWalk, info: onnx.ValueInfoProto, problems: Problems) -> Iterator[Tensor | LabelOperand]:
    """What an output holds; nothing where it could not be computed or is left out."""
    with problems.collect():
        name = printable(info.name)
        if info.name not in walk.values:
            raise InputError(f"the output '{name}' is not computed by any node; the model file is damaged")
        operand = walk.values[info.name]
        if isinstance(operand, LabelOperand) and len(set(operand.labels)) < max(len(operand.labels), 2):
            operand = walk.numbered(operand)  # one number for several places of a list is no label of a class
            if isinstance(operand, LabelOperand):
                raise UnsupportedModelError(f"the output '{name}' picks from texts that are equal; leave it out")
        if isinstance(operand, ConstantOperand | BetweenOperand):
            walk.notes.append(f"the output '{name}' is a constant and left out")
            return
        if isinstance(operand, Tensor) and info.name not in walk.zipped:
            _check_type(info, name, operand)
        if isinstance(operand, PickedOperand | MedianOperand):
            raise UnsupportedModelError(
                f"the output '{name}' is what TopK picks; only sums and means of that are supported"
            )
        if operand is not None:
            yield operand


def _check_type(info: onnx.ValueInfoProto, name: str, tensor: Tensor) -> None:
    declared = info.type.tensor_type.elem_type
    computed = None if tensor.dtype == TRUTH else np_dtype_to_tensor_dtype(tensor.dtype)
    if computed is None or tensor.given:
        kind = "the integers of an input" if tensor.given else "truth values"
        raise UnsupportedModelError(f"the output '{name}' holds {kind}; cast it to float, or leave it out of the graph")
    if declared not in (computed, TensorProto.UNDEFINED):  # onnxruntime infers a type that is not declared
        raise UnsupportedModelError(
            f"the output '{name}' is declared as {type_name(declared)}, its operator computes {type_name(computed)}, "
            "which onnxruntime refuses; export the model with float inputs (FloatTensorType)"
        )


def _read_numbers(found: object) -> np.ndarray:
    return np.ravel(np.asarray(found, np.float64))


def _classified(
    walk: GraphWalk,
    label: tuple[str, Reader],
    result: Classified,
    tensors: dict[str, Tensor],
    readers: dict[str, Reader],
) -> Finished:
    """The classifier: the first numbers that are shares of all labels are probabilities, all others scores."""
    shares = [
        name
        for name, tensor in tensors.items()
        if tensor.size == len(result.labels) and are_shares(walk.builder, tensor)
    ][:1]
    scores = [name for name in tensors if name not in shares]
    probability, decision = (
        walk.joined([tensors[name] for name in names]) if names else None for names in (shares, scores)
    )
    whole = Classified(result.labels, result.index, probability, decision)
    named = zip(("class", "probability", "decision"), ([label[0]], shares, scores), strict=True)
    note = ", ".join(f"{kind} {' and '.join(map(plain, names))}" for kind, names in named if names)
    order = [label, *((name, readers[name]) for name in (*shares, *scores))]
    return whole, order, (f"outputs of the graph: {note}", *walk.notes)
