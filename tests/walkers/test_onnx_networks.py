"""Networks as the exporters of PyTorch and Keras wrote them (`examples/networks`): each stays within its bound."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper

from st_codegen import generate, load, verify
from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import reference
from tests.classifiers import loaded as compiled
from tests.classifiers import verified
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import BOOL, FLOAT, constant, graph_model, info

pytestmark = pytest.mark.usefixtures("tried_in_place")

DATA = Path(__file__).parent / "data" / "networks"
NETWORKS = sorted(path.stem for path in DATA.glob("*.onnx"))


def test_every_exporter_has_its_files():
    assert len(NETWORKS) == 38
    assert {name.split("_")[0] for name in NETWORKS} == {"torch", "dynamo", "keras"}


@pytest.mark.parametrize("name", NETWORKS)
def test_networks_are_those_of_onnxruntime_within_their_bound(tmp_path, name):
    loaded = build.load(onnx.load(DATA / f"{name}.onnx"), tmp_path)
    build.assert_within_bound(loaded, build.rows(len(loaded.ir.features), n=60, spread=2.0))


@pytest.mark.parametrize("name", ["keras_gru", "dynamo_lstm_two_layers", "torch_convolution"])
def test_text_of_a_network_is_verified(tmp_path, name):
    bundle = load(DATA / f"{name}.onnx")
    generate(bundle, "iec", tmp_path)
    assert verify(bundle, tmp_path, rows=100).passed


def loop(most=4, *, condition=None, step=1.0, stays=True, names=("i", "on", "s")):
    """A loop over a state of two numbers, which is doubled and moved by `step`; its rounds are kept."""
    nodes = [
        helper.make_node("Cast", ["i"], ["f"], to=build.FLOAT),
        helper.make_node("Mul", ["s", "TWO"], ["d"]),
        helper.make_node("Add", ["d", "STEP"], ["e"]),
        helper.make_node("Add", ["e", "f"], ["left"]),
        helper.make_node("Identity", ["left"], ["kept"]),
        helper.make_node("Less", ["i", "LAST"], ["goes_on"]),
    ]
    given = [constant("TWO", [2.0]), constant("STEP", [step]), constant("LAST", stays, np.int64)]
    outputs = [info("goes_on", None, onnx.TensorProto.BOOL), info("left", None), info("kept", None)]
    types = {"i": onnx.TensorProto.INT64, "on": onnx.TensorProto.BOOL}
    inputs = [info(name, () if name in types else None, types.get(name, build.FLOAT)) for name in names]
    body = helper.make_graph(nodes, "body", inputs, outputs, given)
    first = [constant("MOST", most, np.int64)] if most is not None else []
    whole = helper.make_node("Loop", ["MOST" if first else "", condition or "", "X"], ["s_end", "rows"], body=body)
    tail = [helper.make_node("Concat", ["s_end", "rows_flat"], ["Z"], axis=1)]
    flat = helper.make_node("Reshape", ["rows", "SHAPE"], ["rows_flat"])
    first.append(constant("SHAPE", [1, -1], np.int64))
    return graph_model([whole, flat, *tail], [info("X", (1, 2))], [info("Z", None)], first)


@pytest.mark.parametrize(("most", "last", "rounds"), [(4, 100, 4), (4, 1, 2), (None, 5, 6), (1, 100, 1)])
def test_a_loop_runs_as_often_as_its_count_and_its_condition_say(tmp_path, most, last, rounds):
    loaded = build.load(loop(most, stays=last), tmp_path)
    assert len(loaded.ir.outputs) == 2 + 2 * rounds
    build.assert_equal_bits(loaded, build.rows(2, n=40))


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"most": 0}, UnsupportedModelError, "a loop that never runs"),
        ({"most": None, "stays": 10**9}, UnsupportedModelError, "more than 1024 rounds in all"),
        ({"condition": "X"}, UnsupportedModelError, "whether the loop goes on depends on the inputs"),
        ({"names": ("i", "on", "s", "more")}, InputError, "not the inputs and outputs that a loop needs"),
    ],
)
def test_loops_that_are_refused(tmp_path, given, error, message):
    with pytest.raises(error, match=message):
        build.load(loop(**given), tmp_path)


def test_rounds_of_loops_inside_of_loops_count_together(tmp_path):
    """Ten rounds in each of four depths are 11,110 in all."""
    nodes = [helper.make_node("Identity", ["s4"], ["left4"])]
    for depth in (4, 3, 2, 1):
        types = {f"i{depth}": onnx.TensorProto.INT64, f"on{depth}": onnx.TensorProto.BOOL}
        inputs = [info(name, (), kind) for name, kind in types.items()] + [info(f"s{depth}", None)]
        outputs = [info("on" + str(depth) + "o", (), onnx.TensorProto.BOOL), info(f"left{depth}", None)]
        keeps = helper.make_node("Identity", [f"on{depth}"], [f"on{depth}o"])
        body = helper.make_graph([keeps, *nodes], f"body{depth}", inputs, outputs)
        outer = "X" if depth == 1 else f"s{depth - 1}"
        result = "Z" if depth == 1 else f"left{depth - 1}"
        nodes = [helper.make_node("Loop", ["MOST", "", outer], [result], body=body)]
    model = graph_model(nodes, [info("X", (1, 2))], [info("Z", None)], [constant("MOST", 10, np.int64)])
    with pytest.raises(UnsupportedModelError, match="more than 1024 rounds in all"):
        build.load(model, tmp_path)


def branches(condition, nodes, inputs, constants=(), shape=None):
    """Twice the input, or one more than it, by a condition."""
    sides = []
    for op_type, number in (("Mul", 2.0), ("Add", 1.0)):
        own = [constant("own", [number])]
        side = helper.make_node(op_type, ["X", "own"], [f"by_{op_type}"])
        sides.append(helper.make_graph([side], op_type, [], [info(f"by_{op_type}", shape)], own))
    whole = helper.make_node("If", [condition], ["Y"], then_branch=sides[0], else_branch=sides[1])
    return graph_model([*nodes, whole], inputs, [info("Y", shape)], constants)


@pytest.mark.parametrize("truth", [True, False])
def test_a_branch_that_a_constant_chooses(tmp_path, truth):
    model = branches("C", [], [info("X", (None, 3))], [constant("C", truth, np.bool_)])
    loaded = build.load(model, tmp_path)
    assert len(loaded.ir.ops) == 2
    build.assert_equal_bits(loaded, build.rows(3))


def test_a_branch_that_is_chosen_by_a_number(tmp_path):
    nodes = [
        helper.make_node("ReduceSum", ["X"], ["S"], keepdims=0),
        helper.make_node("Greater", ["S", "zero"], ["C"]),
    ]
    model = branches("C", nodes, [info("X", (1, 3))], [constant("zero", 0.0)])
    loaded = compiled(build.load(model, tmp_path))
    x = np.random.default_rng(0).normal(size=(200, 3))
    ours, library = reference.evaluate(loaded.ir, x), loaded.predict(x)
    np.testing.assert_array_equal(ours, library)
    verified(loaded, tmp_path / "text", rows=200)


def test_branches_of_other_shapes_are_refused(tmp_path):
    sides = [
        helper.make_graph([helper.make_node(*node)], "side", [], [info(node[2][0], None)])
        for node in (("Identity", ["X"], ["A"]), ("ReduceMax", ["X"], ["B"]))
    ]
    nodes = [helper.make_node("ReduceSum", ["X"], ["S"], keepdims=0), helper.make_node("Greater", ["S", "zero"], ["C"])]
    nodes.append(helper.make_node("If", ["C"], ["Y"], then_branch=sides[0], else_branch=sides[1]))
    model = graph_model(nodes, [info("X", (1, 3))], [info("Y", None)], [constant("zero", 0.0)])
    with pytest.raises(UnsupportedModelError, match="branches that give other shapes"):
        build.load(model, tmp_path)


def test_truth_values_as_inputs(tmp_path):
    """A number other than 0 is TRUE, to onnxruntime as well."""
    nodes = [
        helper.make_node("Cast", ["B"], ["N"], to=FLOAT),
        helper.make_node("Where", ["B", "X", "N"], ["W"]),
        helper.make_node("Concat", ["W", "N"], ["Y"], axis=1),
    ]
    model = graph_model(nodes, [info("B", (None, 2), BOOL), info("X", (None, 2))], [info("Y", None)])
    loaded = build.load(model, tmp_path)
    assert any("all but 0 are TRUE: B" in note for note in loaded.ir.source.notes)
    x = np.random.default_rng(0).normal(size=(200, 4))
    x[:, :2] = np.random.default_rng(1).choice([0.0, -0.0, 1.0, 0.5, -1e-300, 1e30], (200, 2))
    x[0, 0], x[1, 1] = np.nan, np.inf
    ours = build.assert_equal_bits(loaded, x)
    assert len(ours) == 198
    verified(compiled(loaded), tmp_path / "text", rows=300)


def test_truth_values_that_are_read_inside_of_a_branch(tmp_path):
    inner = branches("D", [], [info("X", (1, 3))], shape=(1, 3)).graph.node[0]
    inner.output[0] = "inner"
    own = [constant("own", [7.0])]
    sides = [
        helper.make_graph([inner], "then", [], [info("inner", (1, 3))]),
        helper.make_graph([helper.make_node("Sub", ["X", "own"], ["less"])], "else", [], [info("less", (1, 3))], own),
    ]
    node = helper.make_node("If", ["C"], ["Y"], then_branch=sides[0], else_branch=sides[1])
    inputs = [info("X", (1, 3)), info("C", (1,), BOOL), info("D", (1,), BOOL)]
    loaded = build.load(graph_model([node], inputs, [info("Y", (1, 3))]), tmp_path)
    x = np.random.default_rng(0).normal(size=(40, 5))
    x[:, 3:] = np.round(x[:, 3:])
    np.testing.assert_array_equal(reference.evaluate(loaded.ir, x), loaded.predict(x))
    threes = np.column_stack([np.full((3, 3), 3.0), [1.0, 1.0, 0.0], [1.0, 0.0, 1.0]])
    assert loaded.predict(threes)[:, 0].tolist() == [6.0, 4.0, -4.0]
