"""An ONNX model as a whole: its file, its opsets, its inputs and outputs, and where it comes from."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from google.protobuf.message import DecodeError
from onnx import TensorProto
from onnx.helper import OP_SET_ID_VERSION_MAP

from st_codegen.errors import InputError, Problems, UnsupportedModelError, errors_name
from st_codegen.ir import Feature, Source
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.limits import stated_features
from st_codegen.walkers.onnx import (  # noqa: F401  (they register operators)
    classifiers,
    convolution,
    elementwise,
    loop,
    ml,
    moves,
    nearest,
    operators,
    quantized,
    recurrent,
    shapes,
    sums,
)
from st_codegen.walkers.onnx.external import embed
from st_codegen.walkers.onnx.file import check_names, domain_of, plain, printable, type_name
from st_codegen.walkers.onnx.graph import GraphWalk, read_initializers, run_nodes
from st_codegen.walkers.onnx.inline import inlined
from st_codegen.walkers.onnx.operands import FLOAT32, FLOAT64, MAX_COLUMNS, TRUTH, Tensor
from st_codegen.walkers.onnx.outputs import finish
from st_codegen.walkers.onnx.session import MOST_ROWS, GraphInput, predictor
from st_codegen.walkers.onnx.shapes import as_integers
from st_codegen.walkers.onnx.wire import check_messages

#: Operators that only move numbers about, left out of the description of a model.
_PLUMBING = frozenset(
    (
        *("Identity", "Cast", "Constant", "Shape", "Reshape", "Flatten", "Squeeze", "Unsqueeze", "Transpose"),
        *("Concat", "Gather", "Dropout", "ArrayFeatureExtractor", "FeatureVectorizer", "ZipMap"),
    )
)


def load(path: Path, name: str) -> LoadedModel:
    """Load a file; see `st_codegen.walkers.onnx.load.load_file`."""
    data = _read(path)
    model = _parse(data, path.name)
    with errors_name(path.name):
        model = inlined(model)
    beside = embed(model, path, max(len(data), model.ByteSize()))
    problems = Problems(path.name)
    opsets = _opsets(model, problems)
    inputs = _inputs(model.graph, problems)
    problems.raise_if_any()
    walk = _walk(model.graph, inputs, opsets, problems)
    result, outputs, notes = finish(walk, model.graph, problems)
    problems.raise_if_any()
    with problems.collect():
        source = replace(_source(model, inputs, opsets, notes), data_files=beside)
        ir = walk.builder.model(name, _features(inputs), source, result)
    problems.raise_if_any()
    return LoadedModel(ir, predictor(model, inputs, outputs, path.name, walk.takes))


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path.name}: cannot be read ({error.strerror}); check the path and its permissions"
        ) from error


def _parse(data: bytes, file: str) -> onnx.ModelProto:
    with errors_name(file):
        check_messages(data, onnx.ModelProto.DESCRIPTOR)
    try:
        model: onnx.ModelProto = onnx.ModelProto.FromString(data)
    except (DecodeError, RecursionError, UnicodeDecodeError) as error:
        raise InputError(f"{file}: not an ONNX model, or truncated; export or copy the file again") from error
    if not model.HasField("graph") or not model.graph.node:
        raise InputError(f"{file}: not an ONNX model, or one without nodes; export or copy the file again")
    with errors_name(file):
        check_names(model)
    return model


def _opsets(model: onnx.ModelProto, problems: Problems) -> dict[str, int]:
    """The version of each operator domain."""
    opsets: dict[str, int] = {}
    for entry in model.opset_import:
        domain = domain_of(entry.domain)
        newest = max((v for (known, v) in OP_SET_ID_VERSION_MAP if known == (domain or "ai.onnx")), default=None)
        if opsets.setdefault(domain, entry.version) != entry.version:
            problems.add(f"two opsets of the domain '{printable(domain) or 'ai.onnx'}'; the model file is damaged")
        elif newest is not None and not 1 <= entry.version <= newest:
            problems.errors.append(
                UnsupportedModelError(
                    f"opset {entry.version} of the domain '{domain or 'ai.onnx'}': the installed onnx package "
                    f"lists 1 to {newest} as released; export the model with another target_opset, or install a newer "
                    "onnx and onnxruntime"
                )
            )
    return opsets


def _inputs(graph: onnx.GraphProto, problems: Problems) -> list[GraphInput]:
    constants = {tensor.name for tensor in graph.initializer}
    inputs: list[GraphInput] = []
    seen: set[str] = set()
    for info in graph.input:
        if info.name in constants:
            continue
        with problems.collect():
            name = printable(info.name)
            if info.name in seen:
                raise InputError(f"two inputs '{name}'; the model file is damaged")
            seen.add(info.name)
            start = inputs[-1].start + inputs[-1].size if inputs else 0
            shape, batch = _row_shape(info, name)
            dtype = _element_type(info, name)
            is_short = info.type.tensor_type.elem_type == TensorProto.INT32
            given = GraphInput(info.name, shape, dtype, start, batch, dtype == TRUTH, is_short)
            if start + given.size > MAX_COLUMNS:
                raise UnsupportedModelError(f"input '{name}': at most {MAX_COLUMNS} features are supported")
            inputs.append(given)
    if _reads_integers(graph):
        inputs = [replace(given, cut=given.dtype in (np.int64, TRUTH)) for given in inputs]
    if len(inputs) > 1 and stated_features() not in (None, sum(given.size for given in inputs)):
        problems.add(f"--features {stated_features()}: {len(inputs)} inputs have more; export them with fixed shapes")
    if not inputs and not problems.errors:
        problems.add("the graph has no inputs, so that its outputs are constants; a block needs at least one input")
    return inputs


#: Which of their inputs these operators read as they are, integers too.
_WHOLE = {
    **dict.fromkeys(("Gather", "ArrayFeatureExtractor"), slice(1, None)),
    **dict.fromkeys(("TreeEnsembleClassifier", "LinearClassifier", "SVMClassifier"), slice(1)),
    **dict.fromkeys(("Scaler", "Normalizer"), slice(1)),
}


def _reads_integers(graph: onnx.GraphProto) -> bool:
    """Whether an encoder has integers as keys, inputs are positions, or classifiers or scalers read them."""
    read = {name for node in graph.node for name in node.input[_WHOLE.get(node.op_type, slice(0))]}
    if not read.isdisjoint(info.name for info in graph.input):
        return True
    attributes = [one for node in graph.node if node.op_type == "LabelEncoder" for one in node.attribute]
    return any(
        (one.name == "keys_int64s" and one.ints) or (one.name == "keys_tensor" and one.t.data_type == TensorProto.INT64)
        for one in attributes
    )


def _row_shape(info: onnx.ValueInfoProto, name: str) -> tuple[tuple[int, ...], int]:
    """The shape of an input for one row, whose batch dimension, if there is one, is 1; and the rows to try at once."""
    advice = "export the model with a fixed number of columns, such as FloatTensorType([None, 3])"
    if info.type.WhichOneof("value") != "tensor_type":
        raise UnsupportedModelError(f"input '{name}' is not a tensor; export the model with tensors as inputs")
    if not info.type.tensor_type.HasField("shape"):
        raise UnsupportedModelError(f"input '{name}' has no shape, so the number of features is not known; {advice}")
    dims = [dim.dim_value if dim.HasField("dim_value") else -1 for dim in info.type.tensor_type.shape.dim]
    shown = [length if length >= 0 else "?" for length in dims]
    if 0 in dims:
        raise InputError(f"input '{name}' of shape {shown} has a dimension of length 0; {advice}")
    batch = 1
    if len(dims) > 1:
        batch = 2 if dims[0] < 0 else min(dims[0], MOST_ROWS)
        if dims[0] > 1:  # onnxruntime then takes single rows too, and warns of shapes that are not as declared
            info.type.tensor_type.shape.dim[0].dim_param = "rows"
        dims[0] = 1
    features, known = stated_features(), math.prod(length for length in dims if length > 0)
    if dims.count(-1) == 1 and features is not None:
        if features % known:
            raise InputError(f"--features {features}: input '{name}' of shape {shown} takes a multiple of {known}")
        return tuple(features // known if length < 0 else length for length in dims), batch
    if any(length < 0 for length in dims):
        advice += ", or say --features N" if dims.count(-1) == 1 else ""
        raise UnsupportedModelError(f"input '{name}' of shape {shown}: the number of features is not known; {advice}")
    return tuple(dims), batch


def _element_type(info: onnx.ValueInfoProto, name: str) -> np.dtype[Any]:
    """float32, float64, truth values, or int64 for all whole numbers."""
    elem_type = info.type.tensor_type.elem_type
    if elem_type in (TensorProto.FLOAT, TensorProto.DOUBLE):
        return np.dtype(np.float32 if elem_type == TensorProto.FLOAT else np.float64)
    if elem_type == TensorProto.BOOL:
        return TRUTH
    whole = type_name(elem_type)
    if whole.removeprefix("U") in ("INT8", "INT16", "INT32", "INT64"):
        return np.dtype(np.int64)
    raise UnsupportedModelError(f"input '{name}' is of {whole}; export the model with float inputs")


def _walk(graph: onnx.GraphProto, inputs: list[GraphInput], opsets: dict[str, int], problems: Problems) -> GraphWalk:
    walk = GraphWalk(sum(given.size for given in inputs))
    for given in inputs:
        narrow = given.dtype == FLOAT32
        walk.narrows |= narrow
        numbers = Tensor(np.zeros(given.shape, np.int64), given.columns, given.dtype, unrounded=narrow, special=True)
        whole = given.dtype == np.int64
        if given.dtype == TRUTH:
            walk.values[given.name] = elementwise.is_not_zero(walk, replace(numbers, dtype=FLOAT64))
        elif given.cut:
            own = np.dtype(np.int32) if given.is_short else given.dtype
            walk.values[given.name] = as_integers(walk, replace(numbers, dtype=FLOAT64), own)
        else:
            walk.values[given.name] = replace(numbers, given=whole)
    read_initializers(walk, graph, problems)
    run_nodes(walk, graph, opsets, problems)
    return walk


def _features(inputs: list[GraphInput]) -> tuple[Feature, ...]:
    names = [f"f{number}" for number in range(inputs[-1].start + inputs[-1].size)]
    if len(inputs) > 1:
        own = [
            given.name if given.size == 1 else f"{given.name}_{number}"
            for given in inputs
            for number in range(given.size)
        ]
        names = own if len(set(own)) == len(own) else names
    return tuple(Feature(name) for name in names)


def _source(
    model: onnx.ModelProto, inputs: list[GraphInput], opsets: dict[str, int], results: tuple[str, ...]
) -> Source:
    producer = " ".join(filter(None, (model.producer_name, model.producer_version))) or "unknown producer"
    domains = ", ".join(f"{plain(domain) or 'ai.onnx'} {version}" for domain, version in sorted(opsets.items()))
    computing = [node.op_type for node in model.graph.node if node.op_type not in _PLUMBING]
    shown = ", ".join(computing[:8]) + (f" and {len(computing) - 8} more" if len(computing) > 8 else "")
    whole = [plain(given.name) for given in inputs if given.dtype == np.int64 and not given.cut]
    cut = [plain(given.name) for given in inputs if given.cut and given.dtype == np.int64]
    truths = [plain(given.name) for given in inputs if given.dtype == TRUTH]
    notes = ["evaluated as onnxruntime does, one row at a time, with one thread and no graph optimizations"]
    if whole:
        notes.append(f"integer inputs are read as numbers, not cut to integers: {', '.join(whole)}")
    if cut:
        notes.append(f"integer inputs are read without fractions that they may have: {', '.join(cut)}")
    if truths:
        notes.append(f"truth values are numbers, of which all but 0 are TRUE: {', '.join(truths)}")
    return Source(
        library="ONNX",
        version=f"file by {plain(producer)}; opsets: {domains}",
        model_class=computing[0] if len(computing) == 1 else f"feed-forward graph ({shown or 'Identity'})",
        notes=(*notes, *results),
    )
