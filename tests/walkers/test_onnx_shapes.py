"""Inputs, outputs, constants, and the operators that only move numbers about."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import Round, Scale, reference
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import DOUBLE, FLOAT, assert_equal_bits, constant, graph_model, info, rows

pytestmark = pytest.mark.usefixtures("tried_in_place")


def test_an_input_without_dimensions(tmp_path):
    nodes = [helper.make_node("Add", ["A", "B"], ["Y"])]
    model = graph_model(nodes, [info("A", ()), info("B", (None, 1), FLOAT)], [info("Y", None)])
    assert assert_equal_bits(build.load(model, tmp_path), [[1.5, 2.0]]).tolist() == [[3.5]]


def test_names_of_inputs_that_would_collide_are_numbered(tmp_path):
    inputs = [info("a", (None, 2)), info("a_0", (None, 1))]
    model = graph_model([helper.make_node("Concat", ["a", "a_0"], ["Y"], axis=1)], inputs, [info("Y", None)])
    assert [feature.name for feature in build.load(model, tmp_path).ir.features] == ["f0", "f1", "f2"]


def test_source_says_where_a_model_comes_from_in_plain_text(tmp_path):
    model = graph_model([helper.make_node("Neg", ["X"], ["Y"])], [info("X", (None, 1))], [info("Y", None)])
    model.producer_name, model.producer_version = "evil *)\n]]>", "1.2"
    source = build.load(model, tmp_path).ir.source
    assert source.library == "ONNX"
    assert source.version == "file by evil ?????? 1.2; opsets: ai.onnx 18, ai.onnx.ml 3"
    assert source.model_class == "Neg"
    assert source.file == source.digest == ""


def moved(tmp_path, nodes, constants=(), shape=(None, 6), opset=18):
    """Columns that a graph of operators without arithmetic picks."""
    model = graph_model(nodes, [info("X", shape, DOUBLE)], [info("Y", None, DOUBLE)], constants, opset)
    loaded = build.load(model, tmp_path)
    x = rows(6)
    assert_equal_bits(loaded, x)
    return reference.evaluate(loaded.ir, np.arange(6.0)[None, :])[0].tolist()


def test_operators_that_move_numbers(tmp_path):
    make = helper.make_node
    numbers = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert moved(tmp_path, [make("Identity", ["X"], ["Y"])]) == numbers
    shape = constant("shape", [3, 2], np.int64)
    axes = constant("axes", [0, 2], np.int64)
    grid = make("Reshape", ["X", "shape"], ["grid"])
    turned = [0.0, 2.0, 4.0, 1.0, 3.0, 5.0]
    assert moved(tmp_path, [grid, make("Transpose", ["grid"], ["Y"])], [shape]) == turned
    assert moved(tmp_path, [grid, make("Transpose", ["grid"], ["Y"], perm=[0, 1])], [shape]) == numbers
    assert moved(tmp_path, [grid, make("Flatten", ["grid"], ["Y"], axis=0)], [shape]) == numbers
    assert moved(tmp_path, [grid, make("Flatten", ["grid"], ["Y"], axis=-1)], [shape]) == numbers
    assert moved(tmp_path, [grid, make("Unsqueeze", ["grid", "axes"], ["Y"])], [shape, axes]) == numbers
    assert moved(tmp_path, [make("Unsqueeze", ["X"], ["Y"], axes=[0, 3])], opset=11) == numbers
    assert moved(tmp_path, [make("Squeeze", ["X"], ["Y"])]) == numbers
    assert moved(tmp_path, [make("Squeeze", ["X"], ["Y"], axes=[0])], opset=11) == numbers
    assert moved(tmp_path, [make("Concat", ["X", "X"], ["Y"], axis=-1)]) == numbers * 2
    picks = constant("picks", [5, 0, -1], np.int64)
    assert moved(tmp_path, [make("Gather", ["X", "picks"], ["Y"], axis=1)], [picks]) == [5.0, 0.0, 5.0]
    one = constant("one", 4, np.int64)
    assert moved(tmp_path, [make("Gather", ["X", "one"], ["Y"], axis=-1)], [one]) == [4.0]
    ends = [constant("from", [1], np.int64), constant("to", [4], np.int64), constant("along", [1], np.int64)]
    assert moved(tmp_path, [make("Slice", ["X", "from", "to", "along"], ["Y"])], ends) == [1.0, 2.0, 3.0]
    picks = constant("picks", [[5, 1]], np.int64)
    extractor = make("ArrayFeatureExtractor", ["X", "picks"], ["Y"], domain="ai.onnx.ml")
    assert moved(tmp_path, [extractor], [picks]) == [5.0, 1.0]
    assert moved(tmp_path, [extractor], [picks], shape=(6,)) == [5.0, 1.0]


def test_numbers_that_are_repeated(tmp_path):
    make = helper.make_node
    given = [constant("shape", [1, 3, 2], np.int64), constant("times", [1, 2, 3], np.int64)]
    nodes = [make("Reshape", ["X", "shape"], ["grid"]), make("Tile", ["grid", "times"], ["Y"])]
    assert moved(tmp_path, nodes, given) == [0, 1, 0, 1, 0, 1, 2, 3, 2, 3, 2, 3, 4, 5, 4, 5, 4, 5] * 2
    with pytest.raises(InputError, match=r"repeats shape .* times; the model file is damaged"):
        moved(tmp_path, nodes, [given[0], constant("times", [1, 2], np.int64)])
    with pytest.raises(UnsupportedModelError, match="at most 65536 are supported"):
        moved(tmp_path, nodes, [given[0], constant("times", [1, 2**20, 1], np.int64)])
    with pytest.raises(InputError, match="rows have no answers of their own"):
        moved(tmp_path, [make("Tile", ["X", "times"], ["Y"])], [constant("times", [2, 1], np.int64)], shape=("N", 6))


def test_whole_numbers_that_graphs_compute_of_constants(tmp_path):
    """A range of lengths, and the triangle of a causal mask."""
    make = helper.make_node
    given = [
        constant("from", 0, np.int64),
        constant("step", 2, np.int64),
        constant("ones", np.ones((6, 6)), np.float64),
        constant("diagonal", -1, np.int64),
    ]
    nodes = [make("Size", ["X"], ["size"]), make("Range", ["from", "size", "step"], ["at"])]
    assert moved(tmp_path, [*nodes, make("Gather", ["X", "at"], ["Y"], axis=1)], given) == [0, 2, 4]
    nodes = [make("Trilu", ["ones", "diagonal"], ["M"], upper=0), make("MatMul", ["X", "M"], ["Y"])]
    model = graph_model(nodes, [info("X", (None, 6), DOUBLE)], [info("Y", None, DOUBLE)], given)
    loaded = build.load(model, tmp_path)
    assert np.array_equal(loaded.ir.ops[-1].weights, np.tril(np.ones((6, 6)), -1).T)
    with pytest.raises(InputError, match="a step of 0"):
        nodes = [make("Range", ["from", "from", "from"], ["at"]), make("Gather", ["X", "at"], ["Y"], axis=1)]
        moved(tmp_path, nodes, given)


def test_a_cast_to_the_type_of_another_tensor(tmp_path):
    nodes = [helper.make_node("CastLike", ["X", "like"], ["F"]), helper.make_node("CastLike", ["F", "X"], ["Y"])]
    model = graph_model(nodes, [info("X", (None, 3), DOUBLE)], [info("Y", None, DOUBLE)], [constant("like", 0.0)])
    assert_equal_bits(build.load(model, tmp_path), rows(3))


def test_shapes_computed_in_the_graph(tmp_path):
    """What torch writes for x.view(x.size(0), -1)."""
    make = helper.make_node
    nodes = [
        make("Shape", ["X"], ["shape"]),
        make("Constant", [], ["zero"], value_int=0),
        make("Gather", ["shape", "zero"], ["batch"]),
        make("Unsqueeze", ["batch", "axis"], ["first"]),
        make("Constant", [], ["rest"], value_ints=[-1]),
        make("Concat", ["first", "rest"], ["target"], axis=0),
        make("Reshape", ["X", "target"], ["Y"]),
    ]
    picked = moved(tmp_path, nodes, [constant("axis", [0], np.int64)], shape=("N", 2, 3))
    assert picked == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    nodes = [make("Shape", ["X"], ["shape"], start=1), make("Reshape", ["X", "shape"], ["Y"])]
    assert moved(tmp_path, nodes) == picked


@pytest.mark.parametrize(
    ("start", "end", "step", "picked"),
    [(-9, -100, -1, [0.0]), (-7, -7, -2, [0.0]), (-3, -100, -2, [3.0, 1.0]), (9, -9, -3, [5.0, 2.0])],
)
def test_a_slice_backwards_starts_at_the_first_number_where_it_starts_before(tmp_path, start, end, step, picked):
    given = zip(("starts", "ends", "axes", "steps"), (start, end, 1, step), strict=True)
    lists = [constant(name, [number], np.int64) for name, number in given]
    node = helper.make_node("Slice", ["X", "starts", "ends", "axes", "steps"], ["Y"])
    assert moved(tmp_path, [node], lists) == picked


@pytest.mark.parametrize("odd", ["ends", "axes", "steps"])
def test_a_slice_with_one_list_longer_than_the_others_is_refused(tmp_path, odd):
    names = ["starts", "ends", "axes", "steps"]
    lists = [constant(name, [1, 1] if name == odd else [1], np.int64) for name in names]
    with pytest.raises(InputError, match="missing or of different lengths"):
        moved(tmp_path, [helper.make_node("Slice", ["X", *names], ["Y"])], lists)


def test_reshape_copies_dimensions_and_infers_one(tmp_path):
    reshape = helper.make_node("Reshape", ["X", "shape"], ["Y"])
    for shape in ([0, -1], [-1, 6], [1, 2, 3], [0, 0]):
        assert moved(tmp_path, [reshape], [constant("shape", shape, np.int64)])[-1] == 5.0
    with pytest.raises(InputError, match=r"6 numbers .* do not fill the shape \[4\]"):
        moved(tmp_path, [reshape], [constant("shape", [4], np.int64)])
    zero = helper.make_node("Reshape", ["X", "shape"], ["Y"], allowzero=1)
    with pytest.raises(InputError, match="do not fill the shape"):
        moved(tmp_path, [zero], [constant("shape", [0, -1], np.int64)])


@pytest.mark.parametrize(
    ("attribute", "value"),
    [
        ("value", constant("c", [2.0], np.float64)),
        ("value", constant("c", [2.0], np.float16)),
        ("value", constant("c", [2], np.uint8)),
        ("value_float", 2.0),
        ("value_floats", [2.0]),
        ("value_int", 2),
        ("value_ints", [2]),
    ],
)
def test_constant_nodes_of_all_types(tmp_path, attribute, value):
    nodes = [
        helper.make_node("Constant", [], ["raw"], **{attribute: value}),
        helper.make_node("Cast", ["raw"], ["two"], to=DOUBLE),
        helper.make_node("Mul", ["X", "two"], ["Y"]),
    ]
    assert moved(tmp_path, nodes) == [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]


@pytest.mark.parametrize("name", ["FLOAT", "DOUBLE", "FLOAT16", "BFLOAT16", "INT8", "INT16", "INT32", "UINT32", "BOOL"])
@pytest.mark.parametrize("raw", [False, True])
def test_initializers_of_all_types(tmp_path, name, raw):
    elem_type = TensorProto.DataType.Value(name)
    values = np.ones(1, helper.tensor_dtype_to_np_dtype(elem_type))
    tensor = (
        helper.make_tensor("c", elem_type, [1], values.tobytes(), raw=True)
        if raw
        else helper.make_tensor("c", elem_type, [1], [1])
    )
    nodes = [helper.make_node("Cast", ["c"], ["one"], to=DOUBLE), helper.make_node("Add", ["X", "one"], ["Y"])]
    assert moved(tmp_path, nodes, [tensor])[0] == 1.0


def test_constants_are_folded_in_their_own_type(tmp_path):
    nodes = [
        helper.make_node("Div", ["one", "three"], ["third"]),
        helper.make_node("Mul", ["X", "third"], ["Y"]),
    ]
    constants = [constant("one", 1.0), constant("three", 3.0)]
    loaded = build.load(graph_model(nodes, [info("X", (None, 2))], [info("Y", None)], constants), tmp_path)
    assert loaded.ir.ops[-1].constant[0] == np.float32(1) / np.float32(3)
    assert_equal_bits(loaded, rows(2))


def test_products_of_constants_are_taken_where_each_is_rounded_once(tmp_path):
    make = helper.make_node
    nodes = [make("MatMul", ["A", "B"], ["C"]), make("Flatten", ["C"], ["D"], axis=0), make("Add", ["X", "D"], ["Y"])]
    column, row = constant("A", [[2.0], [3.0]], np.float64), constant("B", [[1.0, 10.0, 100.0]], np.float64)
    assert moved(tmp_path, nodes, [column, row]) == [2.0, 21.0, 202.0, 6.0, 34.0, 305.0]
    sums = [constant("A", np.ones((2, 2)), np.float64), constant("B", np.ones((2, 3)), np.float64)]
    with pytest.raises(InputError, match="multiplies constants, in an order that is open"):
        moved(tmp_path, nodes, sums)


def test_casts_between_float_and_double(tmp_path):
    nodes = [
        helper.make_node("Cast", ["X"], ["narrow"], to=FLOAT),
        helper.make_node("Cast", ["narrow"], ["wide"], to=DOUBLE),
        helper.make_node("Mul", ["wide", "c"], ["Y"]),
    ]
    model = graph_model(nodes, [info("X", (None, 2), DOUBLE)], [info("Y", None, DOUBLE)], [constant("c", 0.1, float)])
    loaded = build.load(model, tmp_path)
    assert [type(op) for op in loaded.ir.ops] == [Round, Scale]
    assert_equal_bits(loaded, rows(2))


def test_inputs_of_several_types_and_shapes_become_features_in_order(tmp_path):
    make = helper.make_node
    nodes = [
        make("Cast", ["count"], ["count_float"], to=FLOAT),
        make("Cast", ["wide"], ["wide_float"], to=FLOAT),
        make("Concat", ["wide_float", "count_float", "pair"], ["Y"], axis=1),
    ]
    inputs = [info("count", (None, 1), TensorProto.INT64), info("pair", (-1, 2)), info("wide", (1, 1), DOUBLE)]
    loaded = build.load(graph_model(nodes, inputs, [info("Y", None)]), tmp_path)
    assert [feature.name for feature in loaded.ir.features] == ["count", "pair_0", "pair_1", "wide"]
    x = [[7.0, 0.1, 0.2, 0.3], [-3.0, 1.0, 2.0, 1e30]]
    assert assert_equal_bits(loaded, x)[0].tolist() == [np.float32(v) for v in (0.3, 7.0, 0.1, 0.2)]
    assert any("integer inputs are read as numbers" in note for note in loaded.ir.source.notes)
    assert loaded.predict(np.array([[2.5, 0.0, 0.0, 0.0]]))[0, 1] == 2.5


def test_joined_numbers_are_rounded_wherever_they_come_from(tmp_path):
    for order in (["X", "n"], ["n", "X"]):
        nodes = [helper.make_node("Neg", ["X"], ["n"]), helper.make_node("Concat", order, ["Y"], axis=1)]
        loaded = build.load(graph_model(nodes, [info("X", (None, 1))], [info("Y", None)]), tmp_path)
        assert_equal_bits(loaded, rows(1))


def test_feature_vectorizer(tmp_path):
    node = helper.make_node("FeatureVectorizer", ["A", "B"], ["Y"], domain="ai.onnx.ml", inputdimensions=[1, 2])
    model = graph_model([node], [info("A", (None, 1)), info("B", (None, 2))], [info("Y", None)])
    assert_equal_bits(build.load(model, tmp_path), rows(3))
    node.attribute[0].ints[1] = 3
    with pytest.raises(InputError, match=r"inputdimensions \[1, 3\] for inputs of \[1, 2\] columns"):
        build.load(graph_model([node], [info("A", (None, 1)), info("B", (None, 2))], [info("Y", None)]), tmp_path)


def test_several_outputs_are_laid_end_to_end(tmp_path):
    nodes = [helper.make_node("Relu", ["X"], ["first"]), helper.make_node("Neg", ["X"], ["second"])]
    outputs = [info("second", None), info("X2", None), info("first", None)]
    nodes.append(helper.make_node("Identity", ["X"], ["X2"]))
    loaded = build.load(graph_model(nodes, [info("X", (None, 2))], outputs), tmp_path)
    assert loaded.ir.outputs == ("out1", "out2", "out3", "out4", "out5", "out6")
    assert assert_equal_bits(loaded, [[1.5, -2.0]]).tolist() == [[-1.5, 2.0, 1.5, -2.0, 1.5, 0.0]]
    assert "outputs in order: second, X2, first" in loaded.ir.source.notes
    two = build.load(graph_model(nodes, [info("X", (None, 2))], outputs[:2]), tmp_path)
    assert "outputs in order: second, X2" in two.ir.source.notes
    one = build.load(graph_model(nodes, [info("X", (None, 2))], outputs[:1]), tmp_path)
    assert not any("outputs in order" in note for note in one.ir.source.notes)


def test_output_of_two_rows_for_one_is_read_as_columns(tmp_path):
    """skl2onnx reshapes networks with two outputs to one column."""
    node = helper.make_node("Reshape", ["X", "shape"], ["Y"])
    model = graph_model([node], [info("X", (None, 2))], [info("Y", (None, 1))], [constant("shape", [-1, 1], np.int64)])
    assert assert_equal_bits(build.load(model, tmp_path), [[1.0, 2.0]]).tolist() == [[1.0, 2.0]]


MARKS = constant("marks", [False, True, True], np.bool_)
PLACES = constant("places", [[0, -1], [1, 0]], np.int64)
PAIRS = constant("places", [[[0]], [[1]]], np.int64)
BACK = constant("back", [2, 3], np.int64)


@pytest.mark.parametrize(
    ("shape", "node", "constants", "expected"),
    [
        ((3, 2), ("Compress", "marks", {"axis": 0}), MARKS, [2, 3, 4, 5]),
        ((3, 2), ("Compress", "marks", {}), MARKS, [1, 2]),
        ((2, 3), ("GatherND", "places", {}), PLACES, [2, 3]),
        ((2, 3), ("GatherND", "places", {"batch_dims": 1}), PAIRS, [0, 4]),
        ((3, 2), ("ReverseSequence", "back", {}), BACK, [2, 5, 0, 3, 4, 1]),
        ((2, 3), ("ReverseSequence", "back", {"time_axis": 1, "batch_axis": 0}), BACK, [1, 0, 2, 5, 4, 3]),
    ],
)
def test_numbers_that_are_moved_by_constant_lists(tmp_path, shape, node, constants, expected):
    kind, second, attributes = node
    nodes = [
        helper.make_node("Reshape", ["X", "shape"], ["G"]),
        helper.make_node(kind, ["G", second], ["P"], **attributes),
        helper.make_node("Reshape", ["P", "row"], ["Y"]),
    ]
    shapes = [constant("shape", shape, np.int64), constant("row", [1, -1], np.int64)]
    assert moved(tmp_path, nodes, [*shapes, constants], (1, 6)) == expected


@pytest.mark.parametrize("mode", ["DCR", "CRD"])
def test_channels_become_squares_and_squares_channels(tmp_path, mode):
    nodes = [
        helper.make_node("Reshape", ["X", "shape"], ["G"]),
        helper.make_node("DepthToSpace", ["G"], ["D"], blocksize=2, mode=mode),
        helper.make_node("Reshape", ["D", "row"], ["Y"]),
        helper.make_node("SpaceToDepth", ["D"], ["S"], blocksize=2),
        helper.make_node("Reshape", ["S", "row"], ["Z"]),
    ]
    shapes = [constant("shape", [1, 8, 1, 3], np.int64), constant("row", [1, -1], np.int64)]
    outputs = [info("Y", None, DOUBLE), info("Z", None, DOUBLE)]
    loaded = build.load(graph_model(nodes, [info("X", (1, 24), DOUBLE)], outputs, shapes), tmp_path)
    found = assert_equal_bits(loaded, rows(24))
    assert (found[:, 24:] == rows(24)).all() == (mode == "DCR")


@pytest.mark.skipif(onnx.defs.onnx_opset_version() < 28, reason="the installed onnx knows no opset 28")
@pytest.mark.parametrize(
    ("name", "shape", "attributes"),
    [
        ("SpaceToDepth", [1, 2, 2, 6], {"mode": "DCR"}),
        ("SpaceToDepth", [1, 2, 2, 6], {"mode": "CRD"}),
        ("DepthToSpace", [1, 8, 1, 3], {"mode": "CRD"}),
    ],
)
def test_squares_and_channels_of_opset_28(tmp_path, name, shape, attributes):
    assert_moved(tmp_path, (name, [], {"blocksize": 2, **attributes}), shape, opset=28)


def test_a_diagonal_of_the_shape_of_the_input(tmp_path):
    nodes = [
        helper.make_node("Reshape", ["X", "shape"], ["G"]),
        helper.make_node("EyeLike", ["G"], ["E"], k=1),
        helper.make_node("Mul", ["G", "E"], ["P"]),
        helper.make_node("Flatten", ["P"], ["Y"], axis=0),
    ]
    assert moved(tmp_path, nodes, [constant("shape", [2, 3], np.int64)]) == [0.0, 1.0, 0.0, 0.0, 0.0, 5.0]


def assert_moved(tmp_path, node, shape, given=(), opset=18):
    """Columns of a tensor of a shape, and constants among them, as onnxruntime moves them."""
    shapes = [constant("shape", shape, np.int64), constant("row", [1, -1], np.int64)]
    nodes = [
        helper.make_node("Reshape", ["X", "shape"], ["G"]),
        helper.make_node(node[0], ["G", *node[1]], ["P"], **node[2]),
        helper.make_node("Reshape", ["P", "row"], ["Y"]),
    ]
    columns = int(np.prod(shape))
    model = graph_model(nodes, [info("X", (1, columns))], [info("Y", None)], [*shapes, *given], opset=opset)
    assert_equal_bits(build.load(model, tmp_path), rows(columns))


@pytest.mark.parametrize("upper", [0, 1])
@pytest.mark.parametrize("diagonal", [-1, 0, 1, 3])
def test_triangles_of_computed_numbers(tmp_path, upper, diagonal):
    given = [constant("diagonal", diagonal, np.int64)]
    assert_moved(tmp_path, ("Trilu", ["diagonal"], {"upper": upper}), (1, 2, 3, 3), given)


@pytest.mark.parametrize("axis", [1, -2])
def test_elements_that_are_scattered_over_others(tmp_path, axis):
    given = [constant("places", [[[2, -3], [0, 1]]], np.int64), constant("parts", [[[0.5, 1.5], [2.5, 3.5]]])]
    assert_moved(tmp_path, ("ScatterElements", ["places", "parts"], {"axis": axis}), (1, 3, 2), given)


@pytest.mark.parametrize(("places", "parts"), [([[0, -1]], [[0.5, 1.5]]), ([[0, 1, 1], [0, 2, -2]], [0.5, 1.5])])
def test_parts_that_are_scattered_over_others(tmp_path, places, parts):
    given = [constant("places", places, np.int64), constant("parts", parts)]
    assert_moved(tmp_path, ("ScatterND", ["places", "parts"], {}), (1, 3, 2), given)


@pytest.mark.parametrize(
    ("places", "attributes", "message"),
    [
        ([[0, 0]], {}, "several elements for one position"),
        ([[0, 1]], {"reduction": "add"}, "the reduction add"),
        ([[0, 9]], {}, "beyond those of shape"),
    ],
)
def test_elements_that_cannot_be_scattered_are_refused(tmp_path, places, attributes, message):
    given = [constant("places", places, np.int64), constant("parts", [[0.5, 1.5]])]
    with pytest.raises(InputError, match=message):
        assert_moved(tmp_path, ("ScatterElements", ["places", "parts"], {"axis": 1, **attributes}), (1, 3), given)


@pytest.mark.parametrize("position", [3, -4])
def test_elements_gathered_from_beyond_the_end_are_refused(tmp_path, position):
    with pytest.raises(InputError, match=r"beyond those of shape \(1, 3\)"):
        assert_moved(tmp_path, ("GatherElements", ["P"], {"axis": 1}), (1, 3), [constant("P", [[position]], np.int64)])


@pytest.mark.parametrize(
    ("marks", "dtype"), [([1, 0, 1], np.int64), ([True] * 4, np.bool_), ([[True, False, True]], np.bool_)]
)
def test_marks_that_are_no_short_list_of_truth_values_are_refused(tmp_path, marks, dtype):
    with pytest.raises(InputError, match="not a list of at most 3 truth values"):
        assert_moved(tmp_path, ("Compress", ["marks"], {"axis": 1}), (1, 3), [constant("marks", marks, dtype)])


WAYS = ("asymmetric", "half_pixel", "pytorch_half_pixel", "align_corners")
NEAREST = ("floor", "ceil", "round_prefer_floor", "round_prefer_ceil")


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("nearest", NEAREST)
@pytest.mark.parametrize("scales", [(2.0, 3.0), (0.5, 1.0), (1.3, 0.85), (1.0, 1.05)])
def test_the_nearest_of_other_sizes(tmp_path, way, nearest, scales):
    options = {"mode": "nearest", "coordinate_transformation_mode": way, "nearest_mode": nearest}
    given = [constant("none", []), constant("scales", [1.0, 1.0, *scales])]
    assert_moved(tmp_path, ("Resize", ["none", "scales"], options), (1, 2, 4, 6), given)
    lengths = [int(length * scale) for length, scale in zip((4, 6), scales, strict=True)]
    sizes = [constant("none", []), constant("sizes", [1, 2, *lengths], np.int64)]
    assert_moved(tmp_path, ("Resize", ["none", "none", "sizes"], options), (1, 2, 4, 6), sizes, opset=13)


@pytest.mark.parametrize("scales", [(2.0, 3.0), (0.5, 1.0), (1.3, 0.85)])
def test_the_nearest_of_other_sizes_in_the_oldest_version(tmp_path, scales):
    given = [constant("scales", [1.0, 1.0, *scales])]
    assert_moved(tmp_path, ("Resize", ["scales"], {"mode": "nearest"}), (1, 2, 4, 6), given, opset=10)


def test_other_sizes_of_which_rounding_decides_or_that_are_interpolated_are_refused(tmp_path):
    """28 / 1 lies in the middle of two elements, by float before it."""
    given = [constant("none", []), constant("sizes", [1, 1], np.int64)]
    with pytest.raises(UnsupportedModelError, match="lies between two of 28 elements along axis 1"):
        assert_moved(tmp_path, ("Resize", ["none", "none", "sizes"], {"nearest_mode": NEAREST[3]}), (1, 28), given)
    with pytest.raises(
        UnsupportedModelError, match="the mode cubic by half_pixel; of all axes, 'nearest' and 'linear'"
    ):
        assert_moved(tmp_path, ("Resize", ["none", "none", "sizes"], {"mode": "cubic"}), (1, 28), given)
    ratio = {"mode": "nearest", "keep_aspect_ratio_policy": "not_larger"}
    with pytest.raises(UnsupportedModelError, match=r"(?<!half_pixel, )keep_aspect_ratio_policy='not_larger'; of all"):
        assert_moved(tmp_path, ("Resize", ["none", "none", "sizes"], ratio), (1, 28), given, opset=18)
