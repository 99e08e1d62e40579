"""Sums of products, sums before a number, padding and what graphs compute of their own constants."""

from __future__ import annotations

import numpy as np
import pytest
from onnx import helper

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import reference
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import FLOAT, assert_within_bound, constant, graph_model, info, rows

pytestmark = pytest.mark.usefixtures("tried_in_place")
RNG = np.random.default_rng(0)
KEPT = ("numbers", "own")


def whole(*nodes, columns=6, initializers=(), lengths=(2, 3)):
    """A model of nodes that read `X` of some lengths a row, and end in `Y`."""
    shape = [constant("shape", [-1, *lengths], np.int64), constant("flat", [-1, 1], np.int64)]
    ends = [helper.make_node("Reshape", ["R", "shape"], ["X"]), *nodes, helper.make_node("Flatten", ["Y"], ["Z"])]
    return graph_model(ends, [info("R", (None, columns))], [info("Z", None)], [*shape, *initializers], opset=20)


def node(op_type, *inputs, **attributes):
    return helper.make_node(op_type, [*inputs], ["Y"], **attributes)


WEIGHTED = RNG.normal(size=(4, 3))[:3]
WEIGHTS = constant("W", RNG.normal(size=(4, 3)))
CASES = {
    "a product of computed matrices": [
        helper.make_node("Transpose", ["X"], ["T"], perm=[0, 2, 1]),
        node("MatMul", "X", "T"),
    ],
    "a product with a stack of weights": [node("MatMul", "X", "S")],
    "letters, with constant weights": [node("Einsum", "X", "W", equation="bij,kj->bik")],
    "letters, of two computed tensors": [node("Einsum", "X", "X", equation="bij,bkj->bik")],
    "letters, all summed by themselves": [node("Einsum", "X", equation="bij->bj")],
    "letters without a result": [node("Einsum", "X", "W", equation="bij,kj")],
    "sums before a number": [node("CumSum", "X", "axis")],
    "sums behind a number, without it": [node("CumSum", "X", "axis", exclusive=1, reverse=1)],
    "shares within rows": [node("Softmax", "X", axis=1)],
    "channels": [node("InstanceNormalization", "X", "two", "two")],
}
CONSTANTS = [
    WEIGHTS,
    constant("S", RNG.normal(size=(1, 3, 2))),
    constant("axis", 2, np.int64),
    constant("two", [0.5, -2.0]),
]


@pytest.mark.parametrize("name", CASES)
def test_sums_within_their_bound(tmp_path, name):
    assert_within_bound(build.load(whole(*CASES[name], initializers=CONSTANTS), tmp_path), rows(6))


def assert_equal(model, tmp_path):
    loaded, x = build.load(model, tmp_path), rows(6)
    assert loaded.ir.exact
    assert np.array_equal(loaded.predict(x), reference.evaluate(loaded.ir, x))
    return loaded


def test_products_without_a_sum_are_equal_but_for_the_sign_of_a_zero(tmp_path):
    loaded = assert_equal(whole(node("Einsum", "X", "X", equation="bij,bkl->bijkl")), tmp_path)
    x = np.array([[0.0, -1.0, 1.0, 1.0, 1.0, 1.0]])
    assert np.signbit(reference.evaluate(loaded.ir, x)).any() and not loaded.ir.signs_zeros


@pytest.mark.parametrize("mode", ["constant", "edge", "reflect", "wrap"])
def test_padding_is_equal_to_the_bit(tmp_path, mode):
    parts = [constant("pads", [0, 1, 2, 0, 0, 1], np.int64), constant("fill", 1.5)]
    names = ["pads", "fill"] if mode == "constant" else ["pads"]
    assert_equal(whole(node("Pad", "X", *names, mode=mode), initializers=parts), tmp_path)


@pytest.mark.parametrize(
    ("pads", "mode", "error"),
    [
        ([0, -1, 0, 0, 0, 0], "constant", UnsupportedModelError),
        ([0, 0, 3, 0, 0, 0], "reflect", UnsupportedModelError),
        ([0, 1], "constant", InputError),
    ],
)
def test_pads_that_do_not_fit_are_refused(tmp_path, pads, mode, error):
    model = whole(node("Pad", "X", "pads", mode=mode), initializers=[constant("pads", pads, np.int64)])
    with pytest.raises(error, match="pads"):
        build.load(model, tmp_path)


@pytest.mark.parametrize("equation", ["b...->b", "bii->bi", "bij,bij,bij->b"])
def test_letters_that_are_refused(tmp_path, equation):
    inputs = ["X"] * (equation.count(",") + 1)
    with pytest.raises(InputError):
        build.load(whole(node("Einsum", *inputs, equation=equation)), tmp_path)


def test_the_state_that_a_recurrent_layer_starts_with_may_be_a_constant_times_weights(tmp_path):
    """PyTorch writes the first step of a layer as zeros times weights, and lengths as products of lengths."""
    zeros, bias = constant("H", np.zeros((1, 4))), constant("B", [[0.5, -1.0, 2.0]])
    first = [helper.make_node("MatMul", ["H", "W"], ["P"]), helper.make_node("Add", ["P", "B"], ["Q"])]
    nodes = [*first, node("Add", "X", "Q")]
    assert_equal(whole(*nodes, initializers=[zeros, bias, WEIGHTS]), tmp_path)
    ones = constant("H", np.ones((1, 4)))
    with pytest.raises(UnsupportedModelError, match="in an order that is open"):
        build.load(whole(*nodes, initializers=[ones, bias, WEIGHTS]), tmp_path)


def test_the_state_that_a_loop_starts_with_may_be_multiplied_by_gemm(tmp_path):
    """tf2onnx writes the cells of layers for a batch of 1 so."""
    parts = [constant("H", np.zeros((3, 1))), constant("B", [0.5, -1.0, 2.0]), constant("V", WEIGHTED)]
    nodes = [helper.make_node("Gemm", ["H", "V", "B"], ["Q"], transA=1, transB=1), node("Add", "X", "Q")]
    assert_equal(whole(*nodes, initializers=parts), tmp_path)
    nodes[0] = helper.make_node("Gemm", ["H", "V", "B"], ["Q"], transA=1, transB=1, beta=0.5)
    with pytest.raises(UnsupportedModelError, match="multiplies constants, and then by beta"):
        build.load(whole(*nodes, initializers=parts), tmp_path)


@pytest.mark.parametrize("turned", [{}, {"transA": 1}, {"transA": 1, "transB": 1}, {"transB": 1}])
def test_the_first_factor_of_a_gemm_may_be_the_constant_one(tmp_path, turned):
    """hummingbird-ml writes the splits of trees so. It was refused as a constant that should be folded."""
    weights = RNG.normal(size=(4, 3)).astype(np.float32)
    parts = [constant("A", weights.T if "transA" in turned else weights), constant("C", np.ones((4, 1)))]
    product = helper.make_node("Gemm", ["A", "X" if "transB" in turned else "T"], ["P"], **turned)
    nodes = [helper.make_node("Transpose", ["X"], ["T"]), product, helper.make_node("Transpose", ["P"], ["Y"])]
    ends = [info("X", (None, 3))], [info("Y", None)]
    assert_within_bound(build.load(graph_model(nodes, *ends, parts), tmp_path), rows(3))
    product.input.append("C")
    with pytest.raises(UnsupportedModelError, match="whose first factor is constant; write it as nodes of its own"):
        build.load(graph_model(nodes, *ends, parts), tmp_path)


@pytest.mark.parametrize(
    ("name", "numbers", "dtype"),
    [
        ("ReduceProd", [70000, 70000], np.int32),
        ("ReduceSum", [2**31 - 1, 10], np.int32),
        ("ReduceProd", [2**40, 2**40], np.int64),
        ("ReduceProd", [3**17, 3**18], np.int64),
        ("ReduceSum", [2**53 + 1, 2**40, -(2**53)], np.int64),
        ("ReduceMax", [], np.int64),
    ],
)
def test_lengths_that_onnxruntime_may_round_or_clip_are_refused(tmp_path, name, numbers, dtype):
    nodes = [
        helper.make_node(name, ["L"], ["N"], keepdims=0),
        helper.make_node("Cast", ["N"], ["F"], to=FLOAT),
        node("Add", "X", "F"),
    ]
    with pytest.raises(UnsupportedModelError, match=rf"{name} of (whole numbers that leaves|no number)"):
        build.load(whole(*nodes, initializers=[constant("L", numbers, dtype)]), tmp_path)


@pytest.mark.parametrize("name", ["ReduceProd", "ReduceSum", "ReduceMax", "ReduceMin", "CumSum"])
def test_lengths_are_reduced_in_whole_numbers(tmp_path, name):
    """tf2onnx writes the shapes of the parts of an Einsum so."""
    last = [constant("axis", 0, np.int64)] if name == "CumSum" else []
    found = {"ReduceProd": [6], "ReduceSum": [6], "ReduceMax": [3], "ReduceMin": [1], "CumSum": [1, 3, 6]}[name]
    nodes = [
        helper.make_node(name, ["lengths", *(one.name for one in last)], ["n"]),
        helper.make_node("Cast", ["n"], ["N"], to=FLOAT),
        node("Mul", "X", "N"),
    ]
    model = whole(*nodes, initializers=[constant("lengths", [1, 2, 3], np.int64), *last])
    assert_equal(model, tmp_path)
    x = rows(6).astype(np.float32)
    wanted = (x.reshape(-1, 2, 3) * np.array(found, np.float32)).reshape(x.shape)
    assert np.array_equal(build.load(model, tmp_path).predict(x.astype(np.float64)), wanted)


@pytest.mark.parametrize(
    ("op_type", "pair", "length"),
    [("Mul", (2, 3), 6), ("Add", (2, 4), 6), ("Sub", (7, 1), 6), ("Div", (13, 2), 6), ("Mod", (20, 14), 6)],
)
def test_lengths_are_computed_in_whole_numbers(tmp_path, op_type, pair, length):
    parts = [constant("a", [pair[0]], np.int64), constant("b", [pair[1]], np.int64), constant("c", [-1], np.int64)]
    nodes = [
        helper.make_node(op_type, ["a", "b"], ["n"]),
        helper.make_node("Concat", ["c", "n"], ["lengths"], axis=0),
        helper.make_node("Reshape", ["X", "lengths"], ["Y"]),
    ]
    loaded = build.load(whole(*nodes, initializers=parts), tmp_path)
    assert len(loaded.ir.outputs) == length
    assert np.array_equal(loaded.predict(rows(6)), rows(6).astype(np.float32))


@pytest.mark.parametrize(
    ("op_type", "pair", "said"),
    [("Div", (1, 0), "divides whole numbers by 0"), ("Mul", (2**40, 2**40), "53 bits"), ("Mod", (1, 0), "remainders")],
)
def test_whole_numbers_without_an_answer_are_refused(tmp_path, op_type, pair, said):
    parts = [constant("a", [pair[0]], np.int64), constant("b", [pair[1]], np.int64)]
    nodes = [helper.make_node(op_type, ["a", "b"], ["n"]), helper.make_node("Reshape", ["X", "n"], ["Y"])]
    with pytest.raises(InputError, match=said):
        build.load(whole(*nodes, initializers=parts), tmp_path)


def test_a_division_of_whole_numbers_rounds_towards_zero(tmp_path):
    parts = [constant("a", [-7], np.int64), constant("b", [2], np.int64), constant("at", [0], np.int64)]
    nodes = [
        helper.make_node("Div", ["a", "b"], ["n"]),  # -3, from the end
        helper.make_node("Gather", ["X", "n"], ["Y"], axis=2),
    ]
    loaded = build.load(whole(*nodes, initializers=parts), tmp_path)
    assert np.array_equal(loaded.predict(rows(6)), rows(6)[:, [0, 3]].astype(np.float32))


def test_roots_of_constants_are_computed(tmp_path):
    nodes = [helper.make_node("Sqrt", ["four"], ["two"]), node("Mul", "X", "two")]
    assert_equal(whole(*nodes, initializers=[constant("four", 4.5)]), tmp_path)


def attention():
    """Self-attention over the rows of `X`: products of computed matrices, shares within each row."""
    return [
        helper.make_node("MatMul", ["X", "Q"], ["q"]),
        helper.make_node("MatMul", ["X", "K"], ["k"]),
        helper.make_node("Transpose", ["k"], ["kt"], perm=[0, 2, 1]),
        helper.make_node("MatMul", ["q", "kt"], ["scores"]),
        helper.make_node("Softmax", ["scores"], ["shares"], axis=-1),
        node("MatMul", "shares", "X"),
    ]


def test_attention(tmp_path):
    weights = [constant(name, RNG.normal(size=(3, 3))) for name in "QK"]
    loaded = build.load(whole(*attention(), initializers=weights), tmp_path)
    assert_within_bound(loaded, rows(6, spread=2.0))


@pytest.mark.parametrize("reduction", ["ReduceSum", "ReduceMean"])
@pytest.mark.parametrize(
    ("opset", "largest"), [(8, {"k": 3}), (10, {}), (17, {}), (17, {"largest": 1}), (17, {"largest": 0})]
)
def test_sums_of_the_largest(tmp_path, opset, largest, reduction):
    """And of the smallest; of equal numbers those that stand first, with what stands at their places."""
    axes = ["axes"] if reduction == "ReduceSum" and opset > 12 else []
    nodes = [
        helper.make_node("TopK", ["X"] if "k" in largest else ["X", "k"], ["numbers", "places"], axis=1, **largest),
        helper.make_node("Gather", ["W", "places"], ["own"]),
        *(helper.make_node(reduction, [name, *axes], [f"{name}Y"], **({} if axes else {"axes": [1]})) for name in KEPT),
    ]
    given = [constant("k", [3], np.int64), constant("W", [0.5, -2.0, 3.0, 7.0, 0.25]), constant("axes", [1], np.int64)]
    model = graph_model(nodes, [info("X", (None, 5))], [info(f"{name}Y", None) for name in KEPT], given, opset=opset)
    x = np.vstack([rows(5), np.round(rows(5, spread=0.5))])
    assert_within_bound(build.load(model, tmp_path), x)


def test_the_largest_along_the_axis_of_the_batch_are_refused(tmp_path):
    nodes = [
        helper.make_node("TopK", ["X", "k"], ["numbers", "places"], axis=0),
        helper.make_node("ReduceSum", ["numbers"], ["Y"]),
    ]
    model = graph_model(nodes, [info("X", (1, 5))], [info("Y", None)], [constant("k", [1], np.int64)])
    with pytest.raises(UnsupportedModelError, match="of several rows"):
        build.load(model, tmp_path)
