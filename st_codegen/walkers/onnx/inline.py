"""Functions that a model file brings along: their calls are replaced by their bodies, as onnxruntime does.

What a few functions that call each other grow to is counted before: thirty of them, each of which calls the next one
twice, are a billion nodes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from graphlib import CycleError, TopologicalSorter

import onnx
import onnx.checker
import onnx.inliner
from google.protobuf.message import DecodeError

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.walkers.limits import Things, check_count, check_size
from st_codegen.walkers.onnx.file import check_names, domain_of, printable
from st_codegen.walkers.onnx.wire import MAX_DEPTH

#: Domain, name and overload of a function, by which nodes call it.
_Key = tuple[str, str, str]
#: What calls as functions do, the graph; a function of this name is refused.
_GRAPH: _Key = ("", "", "")


def inlined(model: onnx.ModelProto) -> onnx.ModelProto:
    """The model without functions of its own.

    Raises InputError for functions that call themselves, that stand in the file twice or that grow to more than is
    read, UnsupportedModelError for those of other opsets than the graph's.
    """
    if not model.functions:
        return model
    _check_growth(model)
    try:
        found: onnx.ModelProto = onnx.inliner.inline_local_functions(model)
    except (RuntimeError, ValueError, DecodeError, onnx.checker.ValidationError) as error:
        raise InputError(f"its functions cannot be put into its graph ({_first_line(error)})") from error
    if found.functions:
        names = ", ".join(sorted({printable(function.name) for function in found.functions}))
        raise UnsupportedModelError(
            f"functions of its own ({names}) with other opsets than the graph's; export the model with one opset"
        )
    check_names(found)
    return found


def _first_line(error: Exception) -> str:
    return printable(str(error).partition("\n")[0], 200)


def _check_growth(model: onnx.ModelProto) -> None:
    """Raise InputError where functions call themselves, or where all calls together make too many nodes or bytes."""
    functions: dict[_Key, onnx.FunctionProto] = {}
    for function in model.functions:
        key = (domain_of(function.domain), function.name, function.overload)
        if functions.setdefault(key, function) is not function:
            raise InputError(f"two functions '{printable(function.name)}'; the model file is damaged")
    if _GRAPH in functions:
        raise InputError("a function without a name; the model file is damaged")
    calls = {
        key: [k for k in map(_called, _nodes(function.node)) if k in functions] for key, function in functions.items()
    }
    calls[_GRAPH] = [key for key in map(_called, _nodes(model.graph.node)) if key in functions]
    nodes, size, depth = dict[_Key, int](), dict[_Key, int](), dict[_Key, int]()
    for key in _innermost_first(calls):
        own = functions.get(key, model.graph)
        nodes[key] = sum(1 for _ in _nodes(own.node)) + sum(nodes[called] for called in calls[key])
        size[key] = own.ByteSize() + sum(size[called] for called in calls[key])
        depth[key] = 1 + max((depth[called] for called in calls[key]), default=0)
        check_count(nodes[key], Things.OBJECTS, "with all calls of its functions")
        check_size(size[key], "with all calls of its functions")
        if depth[key] > MAX_DEPTH:
            raise InputError(f"functions that call each other more than {MAX_DEPTH} deep; the model file is damaged")


def _called(node: onnx.NodeProto) -> _Key:
    return domain_of(node.domain), node.op_type, node.overload


def _nodes(nodes: Iterable[onnx.NodeProto]) -> Iterator[onnx.NodeProto]:
    """Nodes and those of the graphs inside them."""
    for node in nodes:
        yield node
        for attribute in node.attribute:
            for graph in (attribute.g, *attribute.graphs):
                yield from _nodes(graph.node)


def _innermost_first(calls: dict[_Key, list[_Key]]) -> list[_Key]:
    """Functions, each behind those that it calls. Raises InputError where one calls itself."""
    try:
        return list(TopologicalSorter(calls).static_order())
    except CycleError as error:
        _, (key, *_) = error.args
        raise InputError(f"its function '{printable(key[1])}' calls itself; the model file is damaged") from error
