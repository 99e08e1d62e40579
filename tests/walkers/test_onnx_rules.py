"""Rules of onnxruntime that a reader of the ONNX standard would not guess, each held against onnxruntime itself."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import reference
from st_codegen.proof.bounds import difference_bound
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import (
    DOUBLE,
    FLOAT,
    INT64,
    assert_equal_bits,
    assert_within_bound,
    constant,
    graph_model,
    info,
    rows,
    single,
)

pytestmark = pytest.mark.usefixtures("tried_in_place")
DTYPES = pytest.mark.parametrize("elem_type", [FLOAT, DOUBLE])


def loaded_graph(tmp_path, nodes, constants=(), *, shape=(None, 3), elem_type=FLOAT, out_type=None, opset=18):
    outputs = [info("Y", None, elem_type if out_type is None else out_type)]
    return build.load(graph_model(nodes, [info("X", shape, elem_type)], outputs, constants, opset), tmp_path)


def within(loaded, x):
    """The difference from onnxruntime stays within the bound, which may be none; the library's answers."""
    library, bound = loaded.predict(x), difference_bound(loaded.ir, x)
    assert np.all((np.abs(reference.evaluate(loaded.ir, x) - library) <= bound) | np.isinf(bound))
    return library


@DTYPES
@pytest.mark.parametrize("shape", [(1, 1), (1, 2, 1)])
@pytest.mark.parametrize("exponent", [2.0, 3.0])
def test_powers_of_rows_of_one_number_are_those_of_the_c_library(tmp_path, shape, exponent, elem_type):
    """They were called equal in every bit to products, from which each tenth differed."""
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    power = helper.make_node("Pow", ["X", "e"], ["Y"])
    loaded = loaded_graph(tmp_path, [power], [constant("e", exponent, dtype)], shape=shape, elem_type=elem_type)
    assert_within_bound(loaded, rows(int(np.prod(shape)), n=500, spread=2))


@pytest.mark.parametrize("axis", [0, 1, -1])
@pytest.mark.parametrize(
    "positions", [[[0]], [[-1, 1]], [[2], [0]], [[1, 1], [0, 2]], [[0, 1, 2], [1, 1, 1], [2, 0, 2]]]
)
def test_elements_gathered_by_fewer_and_more_positions_than_there_are(tmp_path, positions, axis):
    """One position stood for all along the other axes, and more of them than there are elements were refused."""
    grid = helper.make_node("Reshape", ["X", "grid"], ["G"])
    gather = helper.make_node("GatherElements", ["G", "P"], ["Y"], axis=axis)
    constants = [constant("grid", [3, 3], np.int64), constant("P", positions, np.int64)]
    loaded = loaded_graph(tmp_path, [grid, gather], constants, shape=(1, 9))
    assert len(assert_equal_bits(loaded, rows(9, n=20))[0]) == np.size(positions)


def test_more_elements_gathered_than_there_are(tmp_path):
    gather = helper.make_node("GatherElements", ["X", "P"], ["Y"], axis=0)
    loaded = loaded_graph(tmp_path, [gather], [constant("P", [[0, -1], [0, 0]], np.int64)], shape=(1, 3))
    assert assert_equal_bits(loaded, [[1.0, 2.0, 3.0]]).tolist() == [[1.0, 2.0, 1.0, 2.0]]


def test_a_mask_that_is_constant_may_take_the_sign_of_a_zero(tmp_path):
    where = helper.make_node("Where", ["c", "X", "X"], ["Y"])
    loaded = loaded_graph(tmp_path, [where], [constant("c", [[True, False, True]], np.bool_)])
    assert loaded.ir.exact and not loaded.ir.signs_zeros
    zeros = np.full((1, 3), -0.0)
    assert np.signbit(loaded.predict(zeros)).tolist() != np.signbit(zeros).tolist()


NO_AXES = "ReduceSum ReduceMean ReduceMax ReduceMin ReduceProd ReduceL1 ReduceL2 ReduceSumSquare ReduceLogSumExp"


@pytest.mark.parametrize("name", [*NO_AXES.split(), "ReduceLogSum"])
@pytest.mark.parametrize("axes", [[], None])
def test_reductions_over_no_axes_may_be_functions_of_each_number(tmp_path, name, axes):
    """ReduceSumSquare over none of them squares; the numbers came through as they were."""
    listed = [] if axes is None else [constant("axes", axes, np.int64)]
    node = helper.make_node(name, ["X", *(["axes"] if listed else [])], ["Y"], noop_with_empty_axes=1)
    loaded = loaded_graph(tmp_path, [node], listed)
    x = np.abs(rows(3, n=100)) + 0.1 if name == "ReduceLogSum" else rows(3, n=100)
    library = within(loaded, x)
    kept = name in ("ReduceSum", "ReduceMean", "ReduceMax", "ReduceMin", "ReduceProd")
    assert np.array_equal(library, x.astype(np.float32)) == kept or name == "ReduceLogSumExp"


def test_celu_with_a_factor_below_zero_is_refused(tmp_path):
    """It was compiled as an Elu, which it is not: of 46 it gave 0.5, and onnxruntime 46."""
    with pytest.raises(UnsupportedModelError, match=r"alpha -0\.5; it is supported above 0"):
        build.load(single("Celu", alpha=-0.5), tmp_path)


def test_sums_in_float32_that_overflow_on_their_way_have_no_bound(tmp_path):
    """Of 7e38 - 4.7e38 onnxruntime makes NaN or infinity, LREAL a number: the bound was finite."""
    grid = helper.make_node("Expand", ["X", "twice"], ["G"])
    product = helper.make_node("MatMul", ["G", "w"], ["Y"])
    constants = [constant("twice", [2, 4], np.int64), constant("w", [7.0, -4.0, 1.0, 4.0])]
    loaded = loaded_graph(tmp_path, [grid, product], constants, shape=(1, 4))
    x = np.array([[1e38, 1e38, 1e38, -1e38], [1.0, 2.0, 3.0, 4.0]])
    assert np.isinf(difference_bound(loaded.ir, x)).tolist() == [[True, True], [False, False]]


# --- numbers of a list that is picked from -------------------------------------------------------------------------


NEAREST = helper.make_node("ArgMin", ["D"], ["I"], axis=1)
DISTANCE = [helper.make_node("Sub", ["X", "knots"], ["S"]), helper.make_node("Abs", ["S"], ["D"])]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("op_type", ["Add", "Sub", "Mul", "Max", "Concat", "Sum", "Where"])
def test_numbers_that_are_picked_from_a_list_are_computed_with(tmp_path, dtype, op_type):
    """Those of float were taken for double, and the file for damaged."""
    elem_type = helper.np_dtype_to_tensor_dtype(np.dtype(dtype))
    pick = helper.make_node("ArrayFeatureExtractor", ["list", "I"], ["P"], domain="ai.onnx.ml")
    cut = helper.make_node("Greater", ["P", "one"], ["C"])
    given, attributes = {"Where": (["C", "P", "one"], {}), "Concat": (["P", "one"], {"axis": 1})}.get(
        op_type, (["one", "P"], {})
    )
    constants = [
        constant("knots", [[-1.0, 0.5, 2.0]], dtype),
        constant("list", [0.25, 0.25, 1.75], dtype),
        constant("one", [[1.0]], dtype),
    ]
    last = helper.make_node(op_type, given, ["Y"], **attributes)
    nodes = [*DISTANCE, NEAREST, pick, *([cut] if op_type == "Where" else []), last]
    loaded = loaded_graph(tmp_path, nodes, constants, shape=(1, 1), elem_type=elem_type)
    assert loaded.ir.exact and loaded.ir.classes is None
    assert_equal_bits(loaded, rows(1, n=300))


def test_equal_numbers_of_a_list_are_no_labels_of_classes(tmp_path):
    """Such a graph was called damaged."""
    nodes = [helper.make_node("ArgMax", ["X"], ["I"], axis=1), helper.make_node("Gather", ["list", "I"], ["Y"])]
    loaded = loaded_graph(tmp_path, nodes, [constant("list", [5.0, 7.0, 5.0])])
    assert loaded.ir.classes is None
    assert_equal_bits(loaded, rows(3))


def test_integers_that_are_chosen_stay_integers(tmp_path):
    """They were called doubles, so that the next operator, or the output, did not fit them."""
    nodes = [
        helper.make_node("Greater", ["X", "zero"], ["C"]),
        helper.make_node("Where", ["C", "one", "seven"], ["W"]),
        helper.make_node("Add", ["W", "one"], ["Y"]),
    ]
    constants = [constant("zero", 0.0), constant("one", [[1]], np.int64), constant("seven", 7, np.int64)]
    assert_equal_bits(loaded_graph(tmp_path, nodes, constants, out_type=INT64), rows(3))


def test_a_label_in_more_places_than_one(tmp_path):
    """It ended in a traceback."""
    nodes = [
        helper.make_node("ArgMax", ["X"], ["I"], axis=1),
        helper.make_node("Cast", ["I"], ["F"], to=FLOAT),
        helper.make_node("Where", ["mask", "F", "X"], ["Y"]),
    ]
    loaded = loaded_graph(tmp_path, nodes, [constant("mask", [[True, False, True]], np.bool_)])
    assert_equal_bits(loaded, np.abs(rows(3)))


# --- what was called damaged, and is not ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["Slice", "Concat", "ConstantOfShape"])
def test_constants_without_elements(tmp_path, name):
    make = helper.make_node
    nodes, constants = {
        "Slice": ([make("Slice", ["X", "none", "none"], ["Y"])], [constant("none", [], np.int64)]),
        "Concat": ([make("Concat", ["X", "none"], ["Y"], axis=1)], [constant("none", np.zeros((1, 0)))]),
        "ConstantOfShape": (
            [make("ConstantOfShape", ["shape"], ["none"]), make("Concat", ["X", "none"], ["Y"], axis=1)],
            [constant("shape", [1, 0], np.int64)],
        ),
    }[name]
    assert_equal_bits(loaded_graph(tmp_path, nodes, constants, shape=(1, 3)), rows(3, n=20))


@pytest.mark.parametrize("elem_type", [TensorProto.INT32, INT64, TensorProto.UINT8])
@pytest.mark.parametrize("op_type", ["Add", "Concat", "Where", "CastLike"])
def test_inputs_of_integers_beside_constants_are_refused_for_what_they_are(tmp_path, op_type, elem_type):
    """They were called damaged, or refused by onnxruntime, which had been given doubles in place of them."""
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    mask, other, float_one = constant("m", [[True]], np.bool_), constant("c", [[1]], dtype), constant("f", [[1.0]])
    given, attributes, constants = {
        "Add": (["X", "c"], {}, [other]),
        "Concat": (["X", "c"], {"axis": 1}, [other]),
        "Where": (["m", "X", "c"], {}, [mask, other]),
        "CastLike": (["f", "X"], {}, [float_one]),
    }[op_type]
    node = helper.make_node(op_type, given, ["Y"], **attributes)
    with pytest.raises(UnsupportedModelError, match="reads the integers of an input; cast them to float"):
        loaded_graph(tmp_path, [node], constants, shape=(None, 1), elem_type=elem_type)


def test_parts_without_columns_are_refused_for_what_they_are(tmp_path):
    split = helper.make_node("Split", ["X", "sizes"], ["Y", "Z"], axis=1)
    with pytest.raises(UnsupportedModelError, match=r"parts of \[3, 0\], of which one has no columns"):
        loaded_graph(tmp_path, [split], [constant("sizes", [3, 0], np.int64)])
    tile = helper.make_node("Tile", ["X", "times"], ["Y"])
    with pytest.raises(UnsupportedModelError, match="the result has no elements"):
        loaded_graph(tmp_path, [tile], [constant("times", [1, 0], np.int64)])


# --- constants that a graph computes of others ---------------------------------------------------------------------

WITHIN = {
    "an exponential": [("Exp", ["w"], "c")],
    "a logarithm of what is left of one": [("Exp", ["v"], "e"), ("Sub", ["two", "e"], "r"), ("Log", ["r"], "c")],
    "a root": [("Pow", ["w", "half"], "c")],
    "a sum of logarithms": [("Log", ["w"], "l"), ("ReduceSum", ["l"], "c")],
    "logarithms side by side": [("Log", ["one"], "l"), ("Exp", ["one"], "e"), ("Concat", ["l", "e", "one"], "c")],
    "a quotient": [("Exp", ["w"], "e"), ("Neg", ["e"], "n"), ("Div", ["w", "n"], "c")],
}


@DTYPES
@pytest.mark.parametrize("name", WITHIN)
@pytest.mark.parametrize("op_type", ["Add", "Mul", "Sub", "Div"])
def test_constants_that_libraries_compute_each_in_their_own_way(tmp_path, name, op_type, elem_type):
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    attributes = {"Concat": {"axis": 1}, "ReduceSum": {"keepdims": 1}}
    nodes = [helper.make_node(kind, given, [out], **attributes.get(kind, {})) for kind, given, out in WITHIN[name]]
    nodes.append(helper.make_node(op_type, ["X", "c"], ["Y"]))
    constants = [
        constant("w", [[0.3, 1.7, 2.9]], dtype),
        constant("v", [[-0.3, -1.7, 0.1]], dtype),
        constant("two", 2.0, dtype),
        constant("half", 0.5, dtype),
        constant("one", [[1.3]], dtype),
    ]
    given = {name for node in nodes for name in node.input}
    loaded = loaded_graph(tmp_path, nodes, [c for c in constants if c.name in given], elem_type=elem_type)
    x = rows(3, spread=2)
    assert_within_bound(loaded, x)
    bound = difference_bound(loaded.ir, x) / np.maximum(np.abs(loaded.predict(x)), 1.0)
    assert np.max(bound) < 300 * np.finfo(dtype).eps


def test_weights_that_a_graph_computes(tmp_path):
    nodes = [helper.make_node("Log", ["w"], ["l"]), helper.make_node("MatMul", ["X", "l"], ["Y"])]
    assert_within_bound(loaded_graph(tmp_path, nodes, [constant("w", [[0.5, 2.0], [1.0, 3.0], [0.1, 7.0]])]), rows(3))


@pytest.mark.parametrize("op_type", ["Exp", "Log"])
def test_constants_that_are_computed_and_have_no_limits_are_refused(tmp_path, op_type):
    nodes = [helper.make_node(op_type, ["w"], ["c"]), helper.make_node("Add", ["X", "c"], ["Y"])]
    with pytest.raises(UnsupportedModelError, match="a constant that is or may be infinite or NaN"):
        loaded_graph(tmp_path, nodes, [constant("w", 90.0 if op_type == "Exp" else 0.0)])
    mean = [helper.make_node("Exp", ["w"], ["c"]), helper.make_node("Clip", ["X", "c"], ["Y"])]
    with pytest.raises(UnsupportedModelError, match="min is computed by the graph; fold constants when exporting"):
        loaded_graph(tmp_path, mean, [constant("w", 1.0)])


# --- tables that are looked up by a computed position ---------------------------------------------------------------


@pytest.mark.parametrize("axis", [0, 1, -1])
@pytest.mark.parametrize("elem_type", [FLOAT, INT64, TensorProto.INT32])
def test_rows_of_a_table_by_computed_positions(tmp_path, axis, elem_type):
    """So exporters write the vectors that networks keep for categories."""
    table = constant("table", np.random.default_rng(1).normal(size=(4, 5)))
    nodes = [helper.make_node("Gather", ["table", "I"], ["Y"], axis=axis)]
    shape = (None, 2) if axis == 0 else (1, 2)
    if elem_type == FLOAT:
        nodes.insert(0, helper.make_node("Cast", ["X"], ["I"], to=INT64))
    else:
        nodes[0].input[1] = "X"
    loaded = loaded_graph(tmp_path, nodes, [table], shape=shape, elem_type=elem_type, out_type=FLOAT)
    length = 4 if axis == 0 else 5
    x = np.array(np.meshgrid(np.arange(-length, length), np.arange(-length, length))).reshape(2, -1).T.astype(float)
    assert len(assert_equal_bits(loaded, x)[0]) == 40 / length
    for beyond in (length, -length - 1, 1e6):
        assert not np.isfinite(reference.evaluate(loaded.ir, [[0.0, beyond]])).any()


def test_an_embedding_counts_negative_positions_from_the_end(tmp_path):
    """As tf2onnx writes Keras' Embedding: a choice between a position and one that is a length more, by products."""
    table, length = constant("table", np.random.default_rng(1).normal(size=(6, 2))), constant("length", 6, np.int32)
    nodes = [
        helper.make_node("Cast", ["X"], ["I"], to=TensorProto.INT32),
        helper.make_node("Add", ["I", "length"], ["end"]),
        helper.make_node("Cast", ["I"], ["F"], to=FLOAT),
        helper.make_node("Less", ["F", "zero"], ["is_below"]),
        helper.make_node("Not", ["is_below"], ["is_not"]),
        *(helper.make_node("Cast", [f"is_{way}"], [way], to=TensorProto.INT32) for way in ("below", "not")),
        helper.make_node("Mul", ["end", "below"], ["one"]),
        helper.make_node("Mul", ["I", "not"], ["other"]),
        helper.make_node("Add", ["one", "other"], ["place"]),
        helper.make_node("Gather", ["table", "place"], ["Y"]),
    ]
    loaded = loaded_graph(tmp_path, nodes, [table, length, constant("zero", 0.0)], shape=(None, 2))
    x = np.array(np.meshgrid(np.arange(-6.0, 6.0), [-6.0, 2.75, 5.5])).reshape(2, -1).T
    assert len(np.unique(assert_equal_bits(loaded, x), axis=0)) == 6 * 3
    assert not np.isfinite(reference.evaluate(loaded.ir, [[0.0, 2147483520.0], [0.0, 6.0]])).any()


def test_a_batch_whose_rows_are_positions_is_tried_with_positions(tmp_path):
    """Random numbers are positions in no list, and a graph that mixed the rows of a batch passed untried."""
    nodes = [
        helper.make_node("Cast", ["X"], ["I"], to=INT64),
        helper.make_node("Gather", ["table", "I"], ["G"]),
        helper.make_node("Softmax", ["G"], ["Y"], axis=0),
    ]
    with pytest.raises(InputError, match="among 2 rows at once, rows have no answers of their own"):
        loaded_graph(tmp_path, nodes, [constant("table", [0.5, 1.5])])
    nodes[2] = helper.make_node("Neg", ["G"], ["Y"])
    nodes.insert(0, helper.make_node("Sub", ["X", "one"], ["S"]))
    nodes[1].input[0], nodes[2].op_type, nodes[2].domain = "S", "ArrayFeatureExtractor", "ai.onnx.ml"
    model = loaded_graph(tmp_path, nodes, [constant("table", [[0.5, 1.5]]), constant("one", 1.0)], shape=(1, 1))
    assert assert_equal_bits(model, [[1.0], [2.0]]).tolist() == [[-0.5], [-1.5]]


def test_what_cannot_be_looked_up_is_refused(tmp_path):
    position = helper.make_node("Cast", ["X"], ["I"], to=INT64)
    gather = helper.make_node("Gather", ["table", "I"], ["Y"])
    for numbers, message in (([1, 2], "constants of float only"), ([1.0, np.inf], "some are infinite or NaN")):
        table = constant("table", numbers, np.asarray(numbers).dtype if numbers == [1, 2] else np.float32)
        with pytest.raises(UnsupportedModelError, match=message):
            loaded_graph(tmp_path, [position, gather], [table])
    pick = helper.make_node("ArgMax", ["X"], ["I"], axis=1)
    with pytest.raises(InputError, match="picks from 2 numbers by positions beyond them, on which onnxruntime fails"):
        loaded_graph(tmp_path, [pick, gather], [constant("table", [1.0, 2.0])])


opset_28 = pytest.mark.skipif(onnx.defs.onnx_opset_version() < 28, reason="the installed onnx knows no opset 28")


@opset_28
@pytest.mark.parametrize(
    ("name", "constants", "attributes"),
    [
        ("Cast", [], {"to": DOUBLE}),
        ("Celu", [], {"alpha": 1.7}),
        ("Compress", [constant("marks", [True, False, True], bool)], {"axis": 1}),
        ("Einsum", [constant("W", np.arange(6.0).reshape(3, 2), np.float32)], {"equation": "ij,jk->ik"}),
        ("ReduceLogSum", [constant("axes", [1], np.int64)], {}),
        ("ReduceLogSumExp", [constant("axes", [1], np.int64)], {}),
    ],
)
def test_operators_of_opset_28(tmp_path, name, constants, attributes):
    out_type = DOUBLE if name == "Cast" else None
    x = np.abs(rows(3, n=200)) + 0.1 if name == "ReduceLogSum" else rows(3, n=200)
    within(build.load(single(name, 3, constants, out_type=out_type, opset=28, **attributes), tmp_path), x)


@opset_28
def test_celu_of_doubles_is_refused(tmp_path):
    with pytest.raises(UnsupportedModelError, match="cast the input to float"):
        build.load(single("Celu", elem_type=DOUBLE, opset=28), tmp_path)
