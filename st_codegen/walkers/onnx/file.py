"""The pieces of an ONNX file, read with every check that keeps damaged bytes from doing harm."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np
import onnx
import onnx.numpy_helper

from st_codegen.errors import InputError, UnsupportedModelError, counted, errors_name
from st_codegen.ir import AnyArray, FloatArray, IntArray

#: IntArray in one tensor of the file.
MAX_TENSOR_SIZE = 2**27
_ATTRIBUTE_TYPES = dict(onnx.AttributeProto.AttributeType.items())

#: Bytes of a number in `raw_data`, by type; text never is there.
_NUMBER_TYPES: dict[int, int] = {
    onnx.TensorProto.DataType.Value(name): size
    for size, names in (
        (8, "DOUBLE INT64 UINT64"),
        (4, "FLOAT INT32 UINT32"),
        (2, "FLOAT16 BFLOAT16 INT16 UINT16"),
        (1, "INT8 UINT8 BOOL"),
        (0, "STRING"),
    )
    for name in names.split()
}


def check_names(model: onnx.ModelProto) -> None:
    """Raise InputError where a name is not UTF-8: protobuf hands such names on as bytes."""
    if not all(isinstance(name, str) for name in _names(model)):
        raise InputError("it has names that are not text; the model file is damaged")


def _names(model: onnx.ModelProto) -> Iterator[object]:
    yield from (model.producer_name, model.producer_version)
    yield from _names_in(model.graph)
    yield from (entry.domain for entry in model.opset_import)
    yield from (function.name for function in model.functions)


def _names_in(graph: onnx.GraphProto) -> Iterator[object]:
    yield from (value.name for values in (graph.input, graph.output) for value in values)
    yield from (tensor.name for tensor in graph.initializer)
    for node in graph.node:
        yield from (node.name, node.op_type, node.domain, *node.input, *node.output)
        for attribute in node.attribute:
            yield attribute.name
            yield from _names_in(attribute.g)


def printable(text: str, length: int = 80) -> str:
    """A name from the file as a message can show it: ASCII, on one line, not too long."""
    text = text.encode("unicode_escape").decode("ascii")
    return text if len(text) <= length else f"{text[:length]}.."


def plain(text: str) -> str:
    """A text from the file as a comment of generated code can hold it."""
    return re.sub(r"[^A-Za-z0-9 ._+:/-]", "?", text)[:80]


def domain_of(name: str) -> str:
    """The domain of an operator; the standard one has two names."""
    return "" if name == "ai.onnx" else name


def node_label(node: onnx.NodeProto) -> str:
    """A node as a message names it: by its name, or by what it computes."""
    if node.name:
        return f"node '{printable(node.name)}'"
    made = next(filter(None, node.output), None)  # the first of several may be left out
    return f"the node of '{printable(made)}'" if made is not None else "a node without name and outputs"


def type_name(elem_type: int) -> str:
    """The name of an element type, such as FLOAT."""
    known = onnx.TensorProto.DataType.items()
    return next((name for name, number in known if number == elem_type), f"type {elem_type}")


def read_tensor(tensor: onnx.TensorProto) -> AnyArray:
    """The numbers or texts of a tensor as a read-only array of its type and shape (float32 for bfloat16).

    Raises InputError where the data does not fit the declared shape, UnsupportedModelError for external data and for
    anything but numbers and text.
    """
    if tensor.data_location == onnx.TensorProto.EXTERNAL or tensor.external_data:
        raise UnsupportedModelError(
            "its numbers are in another file; save the model with its weights inside "
            "(onnx.save_model(model, path, save_as_external_data=False))"
        )
    if tensor.data_type not in _NUMBER_TYPES:
        kind = type_name(tensor.data_type)
        raise UnsupportedModelError(f"tensors of {kind} are not supported, only numbers and text")
    shape = tuple(tensor.dims)
    size = math.prod(shape)
    if any(length < 0 for length in shape):
        raise InputError(f"its shape {shape} has a negative length; the model file is damaged")
    if size > MAX_TENSOR_SIZE:
        raise UnsupportedModelError(f"its shape {shape} has {size} numbers, at most {MAX_TENSOR_SIZE} are supported")
    if tensor.HasField("raw_data"):
        found, unit = len(tensor.raw_data), "bytes"
        expected = size * _NUMBER_TYPES[tensor.data_type]
    else:
        found, unit = len(getattr(tensor, onnx.helper.tensor_dtype_to_field(tensor.data_type))), "numbers"
        expected = size
    if found != expected:
        raise InputError(f"its shape {shape} needs {expected} {unit}, it has {found}; the model file is damaged")
    try:
        array = np.array(onnx.numpy_helper.to_array(tensor))
    except (ValueError, TypeError, OverflowError) as error:
        raise InputError(f"its numbers cannot be read ({error}); the model file is damaged") from error
    if tensor.data_type == onnx.TensorProto.BFLOAT16:
        array = array.astype(np.float32)
    array.flags.writeable = False
    return array


class GraphNode:
    """A node with its attributes, checked against the operator's schema."""

    def __init__(self, proto: onnx.NodeProto, schema: onnx.defs.OpSchema) -> None:
        self.proto = proto
        self.schema = schema
        self.op_type = proto.op_type
        self.version = schema.since_version
        self.attributes = {attribute.name: attribute for attribute in proto.attribute}

    def check(self) -> None:
        """Raise InputError unless the node has the inputs, outputs and attributes that its operator takes."""
        for kind, count, low, high in (
            ("inputs", len(self.proto.input), self.schema.min_input, self.schema.max_input),
            ("outputs", len(self.proto.output), self.schema.min_output, self.schema.max_output),
        ):
            if not low <= count <= high:
                raise InputError(f"{count} {kind}, expected {low} to {high}; the model file is damaged")
        optional = onnx.defs.OpSchema.FormalParameterOption.Optional
        for number, formal in enumerate(self.schema.inputs[: self.schema.min_input]):
            if not self.proto.input[number] and formal.option != optional:
                raise InputError(f"input {number} is missing; the model file is damaged")
        if len(self.attributes) < len(self.proto.attribute):
            raise InputError("an attribute appears twice; the model file is damaged")
        for name, attribute in self.attributes.items():
            known = self.schema.attributes.get(name)
            if known is None:
                raise UnsupportedModelError(
                    f"attribute '{printable(name)}' is not one of this operator's version {self.version}; "
                    "export the model with another target_opset"
                )
            expected = str(known.type).rpartition(".")[2]
            if attribute.ref_attr_name or attribute.type != _ATTRIBUTE_TYPES[expected]:
                raise InputError(f"attribute '{name}' is not of type {expected}; the model file is damaged")
        for name, known in self.schema.attributes.items():
            if known.required and name not in self.attributes:
                raise InputError(f"attribute '{name}' is missing; the model file is damaged")

    @property
    def has_more_outputs(self) -> bool:
        """Whether the graph reads more than the first output."""
        return sum(map(bool, self.proto.output)) > 1

    def __contains__(self, name: str) -> bool:
        return name in self.attributes

    def integer(self, name: str, default: int = 0) -> int:
        """An attribute of type INT."""
        return int(self.attributes[name].i) if name in self.attributes else default

    def number(self, name: str, default: float = 0.0) -> float:
        """An attribute of type FLOAT, which is a float32 number; so is the default."""
        return float(self.attributes[name].f if name in self.attributes else np.float32(default))

    def text(self, name: str, default: str = "") -> str:
        """An attribute of type STRING."""
        return _decoded(name, self.attributes[name].s) if name in self.attributes else default

    def integers(self, name: str, *counts: int) -> IntArray:
        """An attribute of type INTS; where counts are given, it has one of these lengths."""
        listed = self.attributes[name].ints if name in self.attributes else ()
        return np.fromiter(listed, np.int64, checked_length(name, len(listed), *counts))

    def floats(self, name: str, *counts: int) -> FloatArray:
        """An attribute of type FLOATS, which are float32 numbers, as float64; of one of the lengths that are given."""
        listed = self.attributes[name].floats if name in self.attributes else ()
        return np.fromiter(listed, np.float64, checked_length(name, len(listed), *counts))

    def texts(self, name: str, *counts: int) -> list[str]:
        """An attribute of type STRINGS, of one of the lengths that are given."""
        listed = self.attributes[name].strings if name in self.attributes else ()
        checked_length(name, len(listed), *counts)
        return [_decoded(name, text) for text in listed]

    def tensor(self, name: str) -> AnyArray | None:
        """An attribute of type TENSOR."""
        if name not in self.attributes:
            return None
        with errors_name(f"attribute '{name}'"):
            return read_tensor(self.attributes[name].t)


def checked_length(name: str, length: int, *counts: int) -> int:
    """The length of a list; raises InputError where it is none of the counts that are given."""
    if counts and length not in counts:
        expected = " or ".join(map(str, sorted(set(counts))))
        raise InputError(
            f"{name} has {counted(length, 'entry', 'entries')}, expected {expected}; the model file is damaged, or its "
            "exporter lost columns; compile the native model"
        )
    return length


def _decoded(name: str, text: bytes) -> str:
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        raise InputError(f"attribute '{name}' is not text; the model file is damaged") from None
