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
from onnx import AttributeProto

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.walkers.limits import Things, check_count, check_size
from st_codegen.walkers.onnx.file import check_names, domain_of, printable
from st_codegen.walkers.onnx.wire import MAX_DEPTH

#: Domain, name and overload of a function, by which nodes call it.
_Key = tuple[str, str, str]
#: What calls as functions do, the graph; a function of this name is refused.
_GRAPH: _Key = ("", "", "")
#: What a call may hand to its function, and in how many bytes: the body has a copy for each reference.
_HANDED = frozenset(getattr(AttributeProto, name) for name in ("FLOAT", "INT", "STRING", "FLOATS", "INTS", "STRINGS"))
_HANDED_BYTES = 4096


def inlined(model: onnx.ModelProto) -> onnx.ModelProto:
    """The model without functions of its own.

    Raises InputError for functions that stand in the file twice, and for those that the graph reaches and that call
    themselves or grow to more than is read; UnsupportedModelError for functions of other opsets than the graph's, for
    names that may mean several, and for calls that hand on graphs or tensors.
    """
    if not model.functions:
        return model
    functions = _functions(model)
    used = _check_growth(model, functions)
    del model.functions[:]
    model.functions.extend(functions[key] for key in used)
    try:
        found: onnx.ModelProto = onnx.inliner.inline_local_functions(model)
    except (RuntimeError, ValueError, DecodeError, onnx.checker.ValidationError) as error:
        raise InputError(f"its functions cannot be put into its graph ({_first_line(error)})") from error
    if found.functions:
        names = ", ".join(sorted({printable(function.name) for function in found.functions}))
        raise UnsupportedModelError(
            f"functions of its own ({names}) with other opsets than the graph's; export the model with one opset"
        )
    check_size(found.ByteSize(), "with all calls of its functions")
    check_names(found)
    return found


def _first_line(error: Exception) -> str:
    return printable(str(error).partition("\n")[0], 200)


def _functions(model: onnx.ModelProto) -> dict[_Key, onnx.FunctionProto]:
    """Functions by what calls them. Raises for names that onnx may read otherwise."""
    functions: dict[_Key, onnx.FunctionProto] = {}
    for function in model.functions:
        key = (domain_of(function.domain), function.name, function.overload)
        if not function.name or ":" in "".join(key):  # it joins the three by colons
            raise UnsupportedModelError(
                f"a function named '{printable(function.name)}': one without a name, or with a colon in name or "
                "domain, may be taken for another one; export the model without functions"
            )
        if key in functions:
            raise InputError(f"two functions '{printable(function.name)}'; the model file is damaged")
        functions[key] = onnx.FunctionProto.FromString(function.SerializeToString())
    return functions


def _check_growth(model: onnx.ModelProto, functions: dict[_Key, onnx.FunctionProto]) -> list[_Key]:
    """The functions that the graph calls, others called by these included.

    Raises InputError where functions call themselves, or where all calls together make too many nodes or bytes.
    """
    bodies = {
        **{key: list(nodes_within(one.node)) for key, one in functions.items()},
        _GRAPH: list(nodes_within(model.graph.node)),
    }
    calls = {key: [called for called in map(_called, body) if called in functions] for key, body in bodies.items()}
    used, more = set[_Key](), {_GRAPH}
    while more:
        used |= more
        more = {called for key in more for called in calls[key]} - used
    nodes, size, depth = dict[_Key, int](), dict[_Key, int](), dict[_Key, int]()
    for key in _innermost_first({key: calls[key] for key in used}):
        own = functions.get(key, model.graph)
        handed = sum(bool(attribute.ref_attr_name) for node in bodies[key] for attribute in node.attribute)
        nodes[key] = len(bodies[key]) + sum(nodes[called] for called in calls[key])
        size[key] = own.ByteSize() + _HANDED_BYTES * handed + sum(size[called] for called in calls[key])
        depth[key] = 1 + max((depth[called] for called in calls[key]), default=0)
        check_count(nodes[key], Things.OBJECTS, "with all calls of its functions")
        check_size(size[key], "with all calls of its functions")
        if depth[key] > MAX_DEPTH:
            raise InputError(f"functions that call each other more than {MAX_DEPTH} deep; the model file is damaged")
        _check_handed(one for node in bodies[key] if _called(node) in functions for one in node.attribute)
        _check_handed(getattr(own, "attribute_proto", ()))
    return sorted(used - {_GRAPH})


def _check_handed(attributes: Iterable[onnx.AttributeProto]) -> None:
    """Raise UnsupportedModelError for what may be large and is copied wherever a body refers to it."""
    for attribute in attributes:
        if attribute.type not in _HANDED or attribute.ByteSize() > _HANDED_BYTES:
            raise UnsupportedModelError(
                f"a function is given '{printable(attribute.name)}', which is no number, text or list below "
                f"{_HANDED_BYTES} bytes; export the model without functions"
            )


def _called(node: onnx.NodeProto) -> _Key:
    return domain_of(node.domain), node.op_type, node.overload


def nodes_within(nodes: Iterable[onnx.NodeProto]) -> Iterator[onnx.NodeProto]:
    """Nodes and those of the graphs inside them."""
    for node in nodes:
        yield node
        for attribute in node.attribute:
            for graph in (attribute.g, *attribute.graphs):
                yield from nodes_within(graph.node)


def _innermost_first(calls: dict[_Key, list[_Key]]) -> list[_Key]:
    """Functions, each behind those that it calls. Raises InputError where one calls itself."""
    try:
        return list(TopologicalSorter(calls).static_order())
    except CycleError as error:
        _, (key, *_) = error.args
        raise InputError(f"its function '{printable(key[1])}' calls itself; the model file is damaged") from error
