"""Small ONNX models with full control over every attribute, and rows that lie where trees and roundings decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper

from st_codegen.ir import TreeEnsemble, reference
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.onnx.load import load_file

FLOAT, DOUBLE, INT64, BOOL = TensorProto.FLOAT, TensorProto.DOUBLE, TensorProto.INT64, TensorProto.BOOL
ELEM_TYPES = {np.dtype(np.float32): FLOAT, np.dtype(np.float64): DOUBLE}


def info(name: str, shape: Sequence[int | str | None] | None, elem_type: int = FLOAT) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, elem_type, shape)


def constant(name: str, array: Any, dtype: Any = np.float32) -> onnx.TensorProto:
    return onnx.numpy_helper.from_array(np.asarray(array, dtype), name)


def graph_model(
    nodes: Sequence[onnx.NodeProto],
    inputs: Sequence[onnx.ValueInfoProto],
    outputs: Sequence[onnx.ValueInfoProto],
    constants: Sequence[onnx.TensorProto] = (),
    opset: int = 18,
    ml_opset: int = 3,
) -> onnx.ModelProto:
    graph = helper.make_graph(list(nodes), "graph", list(inputs), list(outputs), list(constants))
    opsets = [helper.make_opsetid("", opset), helper.make_opsetid("ai.onnx.ml", ml_opset)]
    return helper.make_model(graph, opset_imports=opsets, ir_version=9, producer_name="tests", producer_version="1")


def single(
    op_type: str,
    n_features: int = 3,
    constants: Sequence[onnx.TensorProto] = (),
    elem_type: int = FLOAT,
    out_type: int | None = None,
    opset: int = 18,
    domain: str = "",
    **attributes: Any,
) -> onnx.ModelProto:
    """One node that reads X (rows, n_features) and constants."""
    names = ["X", *(tensor.name for tensor in constants)]
    node = helper.make_node(op_type, names, ["Y"], name="the_node", domain=domain, **attributes)
    x, y = info("X", (None, n_features), elem_type), info("Y", None, elem_type if out_type is None else out_type)
    return graph_model([node], [x], [y], constants, opset)


def ml(op_type: str, n_features: int = 3, elem_type: int = FLOAT, **attributes: Any) -> onnx.ModelProto:
    """One node of ai.onnx.ml that reads X (rows, n_features) and gives floats."""
    return single(op_type, n_features, (), elem_type, FLOAT, domain="ai.onnx.ml", **attributes)


def load(model: onnx.ModelProto | bytes, folder: Path) -> LoadedModel:
    path = folder / "model.onnx"
    path.write_bytes(model if isinstance(model, bytes) else model.SerializeToString())
    return load_file(path, "model")


def assert_equal_bits(loaded: LoadedModel, x: NDArray[Any]) -> NDArray[np.float64]:
    """The reference gives onnxruntime's bits (NaN for answers that are not finite) on every row it accepts."""
    x = np.asarray(x, np.float64)
    assert loaded.ir.exact
    rows = reference.valid_rows(loaded.ir, x)
    library = loaded.predict(x[rows])
    library[~np.all(np.isfinite(library), axis=1)] = np.nan
    ours = reference.evaluate(loaded.ir, x)[rows]
    np.testing.assert_array_equal(ours.view(np.int64), library.view(np.int64))
    return ours


def assert_within_bound(loaded: LoadedModel, x: NDArray[Any]) -> None:
    """The reference is as near to onnxruntime as the derived bound says, on rows that it all accepts."""
    bounds = pytest.importorskip("st_codegen.proof.bounds")
    x = np.asarray(x, np.float64)
    assert not loaded.ir.exact
    assert np.all(reference.valid_rows(loaded.ir, x))
    bound = bounds.difference_bound(loaded.ir, x)
    difference = np.abs(reference.evaluate(loaded.ir, x) - loaded.predict(x))
    assert np.all(np.isfinite(bound))
    assert np.all(difference <= bound), (difference / bound).max()


def rows(n_features: int, seed: int = 0, n: int = 200, spread: float = 4.0) -> NDArray[np.float64]:
    """Random rows over many orders of magnitude."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, n_features)) * 10 ** rng.uniform(-spread, spread / 2, size=(n, 1))


def special_rows(n_features: int, values: Sequence[float], rng: np.random.Generator, n: int = 400) -> NDArray[Any]:
    """Rows of thresholds, their float32 and float64 neighbours, and what is special about floating point."""
    given = np.asarray(values, np.float64)
    narrow = given.astype(np.float32)
    with np.errstate(over="ignore"):
        near = [np.nextafter(part, part.dtype.type(end)) for part in (given, narrow) for end in (np.inf, -np.inf)]
    pool = np.concatenate(
        [
            given,
            narrow.astype(np.float64),
            *(part.astype(np.float64) for part in near),
            [np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-45, -1e-45, 1e-310, -1e-310, 3.4e38, -3.4e38, 3.5e38, -3.5e38],
            rng.normal(size=20),
        ]
    )
    if n_features == 1:
        return pool[:, None]
    return rng.choice(pool, size=(n, n_features))


@dataclass(frozen=True)
class Branch:
    """A split of a test tree: `feature <mode> value`."""

    mode: str
    feature: int
    value: float | tuple[float, ...]
    true: Branch | Leaf
    false: Branch | Leaf
    missing: bool = False


@dataclass(frozen=True)
class Leaf:
    """Weights by target."""

    weights: dict[int, float]


def leaf(*weights: float) -> Leaf:
    return Leaf(dict(enumerate(weights)))


def regressor(
    trees: Sequence[Branch | Leaf],
    n_features: int = 1,
    n_targets: int = 1,
    elem_type: int = FLOAT,
    changes: dict[str, Any] | None = None,
    tensors: bool = False,
    ml_opset: int = 3,
    **attributes: Any,
) -> onnx.ModelProto:
    """TreeEnsembleRegressor; a subtree that occurs twice (the same object) is one node with two parents.

    `changes` replaces attributes (None removes one); `tensors` gives doubles as tensors.
    """
    nodes: list[tuple[int, int, str, int, float, int, int, int]] = []
    weights: list[tuple[int, int, int, float]] = []

    def add(tree: int, item: Branch | Leaf, known: dict[int, int]) -> int:
        if id(item) in known:
            return known[id(item)]
        number = known[id(item)] = len(known)
        if isinstance(item, Leaf):
            nodes.append((tree, number, "LEAF", 0, 0.0, 0, 0, 0))
            weights.extend((tree, number, target, value) for target, value in item.weights.items())
            return number
        position = len(nodes)
        nodes.append((tree, number, "", 0, 0.0, 0, 0, 0))
        true, false = add(tree, item.true, known), add(tree, item.false, known)
        mode = f"BRANCH_{item.mode}"
        nodes[position] = (tree, number, mode, item.feature, item.value, true, false, int(item.missing))
        return number

    for tree, root in enumerate(trees):
        add(tree, root, {})
    names = ("treeids", "nodeids", "modes", "featureids", "values", "truenodeids", "falsenodeids")
    columns = list(zip(*nodes, strict=True))
    values: dict[str, Any] = {f"nodes_{name}": list(columns[number]) for number, name in enumerate(names)}
    values["nodes_missing_value_tracks_true"] = list(columns[7])
    for number, name in enumerate(("treeids", "nodeids", "ids", "weights")):
        values[f"target_{name}"] = [weight[number] for weight in weights]
    if tensors:
        for name in ("nodes_values", "target_weights"):
            values[f"{name}_as_tensor"] = constant(name, values.pop(name), np.float64)
    values |= {"n_targets": n_targets, **attributes, **(changes or {})}
    given = {name: value for name, value in values.items() if value is not None}
    node = helper.make_node("TreeEnsembleRegressor", ["X"], ["Y"], name="trees", domain="ai.onnx.ml", **given)
    x, y = info("X", (None, n_features), elem_type), info("Y", (None, n_targets))
    return graph_model([node], [x], [y], ml_opset=ml_opset)


def classifier(
    trees: Sequence[Branch | Leaf], labels: Sequence[str] | Sequence[int], zipped: bool = False, **options: Any
) -> onnx.ModelProto:
    """TreeEnsembleClassifier with the outputs `label` and `scores`; options are those of `regressor`."""
    model = regressor(trees, n_targets=len(labels), **options)
    node = model.graph.node[0]
    node.op_type = "TreeEnsembleClassifier"
    kept = [attribute for attribute in node.attribute if attribute.name != "n_targets"]
    for attribute in kept:
        attribute.name = attribute.name.replace("target_", "class_")
    del node.attribute[:]
    node.attribute.extend(kept)
    return with_labels(model, labels, "classlabels_int64s", zipped)


def with_labels(
    model: onnx.ModelProto, labels: Sequence[str] | Sequence[int], integers: str, zipped: bool = False
) -> onnx.ModelProto:
    """The one node of a model as a classifier with labels, of which its second output may be made a map."""
    (node,) = model.graph.node
    texts = isinstance(labels[0], str)
    node.attribute.append(helper.make_attribute("classlabels_strings" if texts else integers, list(labels)))
    del node.output[:], model.graph.output[:]
    node.output.extend(["label", "scores"])
    model.graph.output.append(info("label", None, TensorProto.STRING if texts else INT64))
    if not zipped:
        model.graph.output.append(info("scores", None))
        return model
    given = {"classlabels_strings" if texts else "classlabels_int64s": list(labels)}
    model.graph.node.append(helper.make_node("ZipMap", ["scores"], ["map"], domain="ai.onnx.ml", **given))
    key = TensorProto.STRING if texts else INT64
    kind = helper.make_map_type_proto(key, helper.make_tensor_type_proto(FLOAT, []))
    model.graph.output.append(helper.make_value_info("map", helper.make_sequence_type_proto(kind)))
    return model


_MODE_NUMBERS = {"LEQ": 0, "LT": 1, "GTE": 2, "GT": 3, "EQ": 4, "NEQ": 5, "MEMBER": 6}


def ensemble(
    trees: Sequence[Branch | Leaf],
    n_features: int = 1,
    n_targets: int = 1,
    elem_type: int = FLOAT,
    changes: dict[str, Any] | None = None,
    **attributes: Any,
) -> onnx.ModelProto:
    """TreeEnsemble (ai.onnx.ml 5); every leaf has one weight."""
    dtype = np.float32 if elem_type == FLOAT else np.float64
    nodes: list[list[int | float]] = []
    leaves: list[tuple[int, float]] = []
    members: dict[int, list[float]] = {}

    def add(item: Branch | Leaf) -> tuple[int, int]:
        """(number, whether it is a leaf)."""
        if isinstance(item, Leaf):
            leaves.append(next(iter(item.weights.items())))
            return len(leaves) - 1, 1
        number = len(nodes)
        nodes.append([])
        if isinstance(item.value, tuple):
            members[number] = [*item.value, np.nan]
        value = 0.0 if isinstance(item.value, tuple) else item.value
        true, false = add(item.true), add(item.false)
        nodes[number] = [_MODE_NUMBERS[item.mode], item.feature, value, *true, *false, int(item.missing)]
        return number, 0

    roots = [_as_branch(tree) for tree in trees]
    root_numbers = [add(tree)[0] for tree in roots]
    columns = list(zip(*nodes, strict=True))
    values: dict[str, Any] = {
        "tree_roots": root_numbers,
        "n_targets": n_targets,
        "nodes_modes": constant("modes", columns[0], np.uint8),
        "nodes_featureids": list(columns[1]),
        "nodes_splits": constant("splits", columns[2], dtype),
        "nodes_truenodeids": list(columns[3]),
        "nodes_trueleafs": list(columns[4]),
        "nodes_falsenodeids": list(columns[5]),
        "nodes_falseleafs": list(columns[6]),
        "nodes_missing_value_tracks_true": list(columns[7]),
        "leaf_targetids": [target for target, _ in leaves],
        "leaf_weights": constant("weights", [weight for _, weight in leaves], dtype),
    }
    for number, root in zip(root_numbers, trees, strict=True):
        if isinstance(root, Leaf):
            values["nodes_falsenodeids"][number] = values["nodes_truenodeids"][number]
    if members:
        listed = [value for number in sorted(members) for value in members[number]]
        values["membership_values"] = constant("members", listed, dtype)
    values |= attributes | (changes or {})
    given = {name: value for name, value in values.items() if value is not None}
    node = helper.make_node("TreeEnsemble", ["X"], ["Y"], name="trees", domain="ai.onnx.ml", **given)
    x, y = info("X", (None, n_features), elem_type), info("Y", (None, n_targets), elem_type)
    return graph_model([node], [x], [y], opset=20, ml_opset=5)


def _as_branch(tree: Branch | Leaf) -> Branch:
    """TreeEnsemble has no lone leaves: a root whose two edges go to one leaf stands for it."""
    return tree if isinstance(tree, Branch) else Branch("LEQ", 0, 0.0, tree, tree)


def random_tree(rng: np.random.Generator, modes: Sequence[str], values: Sequence[Any], depth: int, **shape: Any) -> Any:
    """A tree of random splits; `shape`: n_features, weights (function of rng -> Leaf), missing (probability)."""
    if depth == 0 or rng.random() < 0.15:
        return shape["weights"](rng)
    mode = str(rng.choice(list(modes)))
    value = values[int(rng.integers(len(values)))]
    if mode == "MEMBER":
        value = tuple(float(v) for v in rng.choice(values, size=int(rng.integers(1, 5))))
    children = [random_tree(rng, modes, values, depth - 1, **shape) for _ in range(2)]
    missing = bool(rng.random() < shape.get("missing", 0.4))
    return Branch(mode, int(rng.integers(shape["n_features"])), value, *children, missing=missing)


def check_layout(op: TreeEnsemble) -> None:
    """Parents first, and the left child of every split is the next node."""
    splits = np.flatnonzero(op.split >= 0)
    np.testing.assert_array_equal(op.left[splits], splits + 1)
    assert np.all(op.right[splits] > splits)
