"""Operators made of others: what has one rounding a step is equal to the bit, the rest within its derived bound."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from onnx import TensorProto, helper, numpy_helper

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import reference
from st_codegen.ir.base import COS_REACH
from st_codegen.passes.real import in_real
from st_codegen.proof.bounds import difference_bound
from st_codegen.walkers.onnx.ml import _known
from tests.classifiers import loaded as compiled
from tests.classifiers import verified
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import DOUBLE, FLOAT, INT64, constant, graph_model, info, ml, single

pytestmark = pytest.mark.usefixtures("tried_in_place")

DTYPES = pytest.mark.parametrize("elem_type", [FLOAT, DOUBLE])


def agree(loaded, x):
    """On rows that the library accepts: both have no answer, or one within the bound (0: equal numbers)."""
    x = np.asarray(x, np.float64)
    x = x[reference.valid_rows(loaded.ir, x)]
    library, ours, bound = loaded.predict(x), reference.evaluate(loaded.ir, x), difference_bound(loaded.ir, x)
    missing = ~np.all(np.isfinite(ours), axis=1)
    np.testing.assert_array_equal(missing, ~np.all(np.isfinite(library), axis=1))
    difference, bound = np.abs(ours - library)[~missing], bound[~missing]
    assert np.all(difference <= bound), (difference - bound).max()
    assert len(difference) > len(x) / 4
    return bound


def rows(rng, columns=3):
    """Numbers of all signs and sizes, ties, thresholds and their neighbours, NaN and infinities."""
    near = build.special_rows(columns, [0.5, -1.0, 2.0, 3.0, -3.0, 0.0], rng, n=150)
    return np.vstack([rng.normal(size=(150, columns)) * 3, build.rows(columns, 5, 100, 2.0), near])


_PLAIN = "Abs Sign Sqrt Log Erf Reciprocal Softsign Celu Selu HardSigmoid HardSwish Gelu Sin Cos Tan Mish"
_PLAIN += " Atan Asin Acos Sinh Cosh Asinh Acosh Atanh"
UNARY = {
    **{name: {} for name in _PLAIN.split()},
    "Gelu 2": {"approximate": "tanh"},
    "HardSigmoid 2": {"alpha": 0.3, "beta": 0.25},
    "Celu 2": {"alpha": 1.7},
    "Selu 2": {"alpha": 1.5, "gamma": 0.75},
    "ThresholdedRelu": {},
    "ThresholdedRelu 2": {"alpha": -1.0},
    "ThresholdedRelu 3": {"alpha": 0.1},
    "Shrink": {},
    "Shrink 2": {"bias": 0.25, "lambd": 1.0},
    "Shrink 3": {"bias": -1.7, "lambd": 0.0},
    "Hardmax": {},
    "Swish": {},
    "Swish 2": {"alpha": 1.7},
}
EXACT = {"Abs", "Sign", "Sqrt", "Reciprocal", "HardSigmoid", "HardSwish", "ThresholdedRelu", "Shrink", "Hardmax"}
FLOAT_ONLY = {
    "Atan",
    "Asin",
    "Acos",
    "Sinh",
    "Cosh",
    "Asinh",
    "Acosh",
    "Atanh",
    "Erf",
    "Tan",
    "Celu",
    "Gelu",
    "Mish",
    "ThresholdedRelu",
    "Shrink",
    "Hardmax",
}


@DTYPES
@pytest.mark.parametrize("name", UNARY)
def test_functions_of_each_number(tmp_path, name, elem_type):
    op_type = name.split()[0]
    model = single(op_type, 3, elem_type=elem_type, opset=24 if op_type == "Swish" else 20, **UNARY[name])
    try:
        loaded = build.load(model, tmp_path)
    except InputError as error:
        assert (
            op_type in FLOAT_ONLY | {"Selu", "HardSigmoid", "HardSwish", "Softsign", "ThresholdedRelu"}
            and elem_type == DOUBLE
        )
        assert any(text in str(error) for text in ("onnxruntime refuses the model", "cast the input to float"))
        return
    x = rows(np.random.default_rng(1))
    x[::2] = np.abs(x[::2])
    if op_type in ("Sin", "Cos", "Tan"):  # beyond it there is no answer
        x = np.clip(x, -COS_REACH, COS_REACH)
    if op_type in ("Asin", "Acos", "Atanh"):
        x = np.vstack([x, np.tanh(x), np.array([[1.0, -1.0, 0.0]]), np.nextafter([[1.0, -1.0, 0.0]], 2.0)])
    elif op_type == "Acosh":
        x = np.vstack([x, np.abs(x) + 1.0])
    bound = agree(loaded, x)
    assert loaded.ir.exact == (op_type in EXACT) == (not np.any(bound))


@DTYPES
@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0])
def test_powers(tmp_path, exponent, elem_type):
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    loaded = build.load(single("Pow", 3, [constant("E", exponent, dtype)], elem_type), tmp_path)
    agree(loaded, np.clip(rows(np.random.default_rng(2)), -1e9, 1e9))
    assert loaded.ir.exact


@DTYPES
@pytest.mark.parametrize("exponent", [0.5, -0.5, -1.0, -2.0, 4.0, 5.0, 1.75])
def test_powers_by_a_logarithm(tmp_path, exponent, elem_type):
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    loaded = compiled(build.load(single("Pow", 1, [constant("E", exponent, dtype)], elem_type), tmp_path))
    x = rows(np.random.default_rng(2), 1)
    x = x[(np.abs(x[:, 0]) < 1e6) & ((np.abs(x[:, 0]) > 1e-6) | (exponent > 0) | (x[:, 0] == 0))]
    x[::2] = np.abs(x[::2])
    bound = agree(loaded, x)
    assert np.all(np.isfinite(bound)) and np.all(bound > 0)


@DTYPES
@pytest.mark.parametrize("exponents", [[1.0, 2.0, 3.0], [0.5, 2.0, 0.5], [[3.0, -1.0, 3.0]]])
def test_powers_of_columns(tmp_path, exponents, elem_type):
    """onnxruntime multiplies for one exponent only."""
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    loaded = compiled(build.load(single("Pow", 3, [constant("E", exponents, dtype)], elem_type), tmp_path))
    x = rows(np.random.default_rng(2))
    x = x[np.all((np.abs(x) < 1e6) & (np.abs(x) > 1e-6), axis=1)]
    x[::2] = np.abs(x[::2])
    assert np.all(np.isfinite(agree(loaded, x)))


@DTYPES
@pytest.mark.parametrize("base", [2.0, 0.25, 1.0, [1.5, 10.0, 0.9]])
def test_powers_of_a_constant(tmp_path, base, elem_type):
    node = helper.make_node("Pow", ["B", "X"], ["Y"])
    constants = [constant("B", base, helper.tensor_dtype_to_np_dtype(elem_type))]
    model = graph_model([node], [info("X", (None, 3), elem_type)], [info("Y", None, elem_type)], constants)
    loaded = compiled(build.load(model, tmp_path))
    x = rows(np.random.default_rng(2))
    assert np.all(np.isfinite(agree(loaded, x[np.all(np.abs(x) < 30, axis=1)])))


def test_a_power_of_a_negative_constant_is_refused(tmp_path):
    node = helper.make_node("Pow", ["B", "X"], ["Y"])
    with pytest.raises(UnsupportedModelError, match="not above 0"):
        build.load(graph_model([node], [info("X", (None, 3))], [info("Y", None)], [constant("B", -2.0)]), tmp_path)


@pytest.mark.parametrize("exponent", [0.0, 100.0, np.nan, np.inf, [1.0, 0.0, 2.0]])
def test_powers_that_are_refused(tmp_path, exponent):
    with pytest.raises(UnsupportedModelError, match="constants other than 0 and of magnitude up to 64"):
        build.load(single("Pow", 3, [constant("E", exponent, np.float32)]), tmp_path)


def test_slopes_of_columns(tmp_path):
    loaded = build.load(single("PRelu", 3, [constant("S", [0.5, -0.25, 3.0])]), tmp_path)
    assert loaded.ir.exact
    agree(loaded, rows(np.random.default_rng(3)))


@DTYPES
@pytest.mark.parametrize("op_type", ["Max", "Min"])
def test_the_larger_and_the_smaller(tmp_path, op_type, elem_type):
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    inputs = [info("A", (None, 3), elem_type), info("B", (None, 1), elem_type)]
    node = helper.make_node(op_type, ["A", "C", "B"], ["Y"])
    model = graph_model([node], inputs, [info("Y", None, elem_type)], [constant("C", [0.5, -1.0, 2.0], dtype)])
    loaded = build.load(model, tmp_path)
    assert loaded.ir.exact
    agree(loaded, rows(np.random.default_rng(4), 4))


COMPARISONS = ("Greater", "GreaterOrEqual", "Less", "LessOrEqual", "Equal")


@DTYPES
@pytest.mark.parametrize("op_type", COMPARISONS)
@pytest.mark.parametrize("operands", [["X", "C"], ["C", "X"], ["X", "R"]])
def test_comparisons(tmp_path, op_type, operands, elem_type):
    """Of a number with a constant on either side, and of two numbers, which are often equal."""
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    nodes = [
        helper.make_node("Gather", ["X", "I"], ["R"], axis=1),
        helper.make_node(op_type, operands, ["T"]),
        helper.make_node("Not", ["T"], ["N"]),
        helper.make_node("Cast", ["T"], ["Y"], to=elem_type),
        helper.make_node("Where", ["N", "X", "C"], ["Z"]),
    ]
    constants = [constant("C", [0.5, -1.0, 2.0], dtype), constant("I", [2, 1, 0], np.int64)]
    outputs = [info("Y", None, elem_type), info("Z", None, elem_type)]
    loaded = build.load(graph_model(nodes, [info("X", (None, 3), elem_type)], outputs, constants), tmp_path)
    assert loaded.ir.exact
    agree(loaded, rows(np.random.default_rng(5)))


@pytest.mark.parametrize("op_type", ["And", "Or", "Xor"])
def test_truth_values_together(tmp_path, op_type):
    nodes = [
        helper.make_node("Less", ["X", "C"], ["below"]),
        helper.make_node("Cast", ["X"], ["there"], to=TensorProto.BOOL),
        helper.make_node(op_type, ["below", "there"], ["T"]),
        helper.make_node("Cast", ["T"], ["N"], to=INT64),
        helper.make_node("Cast", ["N"], ["Y"], to=FLOAT),
    ]
    model = graph_model(nodes, [info("X", (None, 3))], [info("Y", None)], [constant("C", [0.5, 0.0, -1.0])])
    agree(build.load(model, tmp_path), rows(np.random.default_rng(6)))


@pytest.mark.parametrize("op_type", ["And", "Or", "Xor"])
@pytest.mark.parametrize("operands", [["below", "mask"], ["mask", "below"]])
def test_truth_values_and_a_constant_mask(tmp_path, op_type, operands):
    nodes = [
        helper.make_node("Less", ["X", "C"], ["below"]),
        helper.make_node(op_type, operands, ["T"]),
        helper.make_node("Cast", ["T"], ["Y"], to=FLOAT),
    ]
    constants = [constant("C", [0.5, 0.0, -1.0]), constant("mask", [[True, False, True], [False, False, True]], bool)]
    model = graph_model(nodes, [info("X", (None, 3))], [info("Y", None)], constants)
    model.graph.input[0].type.tensor_type.shape.dim[0].dim_value = 1
    loaded = build.load(model, tmp_path)
    assert loaded.ir.exact
    agree(loaded, rows(np.random.default_rng(6)))


@pytest.mark.parametrize("op_type", ["And", "Or", "Xor", "Not"])
def test_truth_values_that_stand_in_the_file(tmp_path, op_type):
    nodes = [
        helper.make_node(op_type, ["one", "other"][: 1 if op_type == "Not" else 2], ["T"]),
        helper.make_node("Cast", ["T"], ["F"], to=FLOAT),
        helper.make_node("Mul", ["X", "F"], ["Y"]),
    ]
    masks = [constant("one", [True, False, True], bool), constant("other", [True, False, False], bool)]
    agree(
        build.load(graph_model(nodes, [info("X", (None, 3))], [info("Y", None)], masks), tmp_path),
        rows(np.random.default_rng(6)),
    )


@DTYPES
def test_the_truth_of_a_number_is_that_it_is_not_zero(tmp_path, elem_type):
    """NaN and infinities, of which no sum or difference is taken in the libraries, are refused."""
    nodes = [
        helper.make_node("Cast", ["X"], ["there"], to=TensorProto.BOOL),
        helper.make_node("Cast", ["there"], ["Y"], to=elem_type),
    ]
    loaded = build.load(graph_model(nodes, [info("X", (None, 3), elem_type)], [info("Y", None, elem_type)]), tmp_path)
    x = rows(np.random.default_rng(7))
    agree(loaded, x)
    assert np.isfinite(x[reference.valid_rows(loaded.ir, x)]).all()


REDUCTIONS = (
    "ReduceSum ReduceMean ReduceMax ReduceMin ReduceSumSquare ReduceL1 ReduceL2 ReduceLogSum ReduceLogSumExp"
).split()


@pytest.mark.parametrize("op_type", REDUCTIONS)
@pytest.mark.parametrize("keepdims", [0, 1])
@pytest.mark.parametrize("grid", [(1, 6), (1, 2, 3)])
def test_reductions(tmp_path, op_type, keepdims, grid):
    attributes = {"keepdims": keepdims} if op_type == "ReduceSum" else {"keepdims": keepdims, "axes": [-1]}
    nodes = [
        helper.make_node("Reshape", ["X", "shape"], ["G"]),
        helper.make_node(op_type, ["G", "axes"] if op_type == "ReduceSum" else ["G"], ["Y"], **attributes),
    ]
    constants = [constant("shape", grid, np.int64), constant("axes", [-1], np.int64)]
    loaded = build.load(graph_model(nodes, [info("X", (None, 6))], [info("Y", None)], constants, opset=13), tmp_path)
    assert len(loaded.ir.outputs) == (1 if len(grid) == 2 else 2)
    assert loaded.ir.exact == (op_type in ("ReduceMax", "ReduceMin"))
    x = np.clip(rows(np.random.default_rng(7), 6), -1e6, 1e6)
    agree(loaded, np.abs(x) if op_type == "ReduceLogSum" else x)


def test_a_mask_that_is_constant_picks_columns(tmp_path):
    """It was refused as a constant that should be folded, beside numbers that are computed."""
    picks = constant("picks", [[False, True, True]], np.bool_)
    doubled = [helper.make_node("Mul", ["X", "two"], ["D"]), helper.make_node("Where", ["picks", "X", "D"], ["Y"])]
    masked = [helper.make_node("Where", ["picks", "X", "filler"], ["Y"])]
    two, filler = constant("two", 2.0), constant("filler", -1e9)
    x = rows(np.random.default_rng(23))
    for nodes, constants in ((doubled, [picks, two]), (masked, [picks, filler])):
        model = graph_model(nodes, [info("X", (None, 3))], [info("Y", None)], constants)
        loaded = build.load(model, tmp_path)
        assert loaded.ir.exact and not loaded.ir.signs_zeros  # of a -0 that is picked onnxruntime makes 0
        agree(loaded, x)
    model = graph_model(masked, [info("X", (None, 3))], [info("Y", None)], [picks, constant("filler", -np.inf)])
    with pytest.raises(UnsupportedModelError, match="export a mask with -1E9"):
        build.load(model, tmp_path)


def test_a_mask_with_infinity_is_refused_with_the_number_to_take_in_its_place(tmp_path):
    """Whether it is added, or chosen where a number that is computed says so: no training would help."""
    added = [helper.make_node("Add", ["X", "mask"], ["Y"])]
    chosen = [helper.make_node("Less", ["X", "zero"], ["L"]), helper.make_node("Where", ["L", "mask", "X"], ["Y"])]
    zero, mask = constant("zero", 0.0), constant("mask", [0.0, -np.inf, 0.0])
    for nodes in (added, chosen):
        model = graph_model(nodes, [info("X", (None, 3))], [info("Y", None)], [zero, mask])
        with pytest.raises(UnsupportedModelError, match=r"puts -inf beside .* export a mask with -1E9"):
            build.load(model, tmp_path)


def test_a_sum_of_exponentials_is_told_by_its_largest_one(tmp_path):
    """Told by the first one it lost the digits that a mask, or a class that is out of question, puts it away."""
    nodes = [
        helper.make_node("Add", ["X", "mask"], ["M"]),
        helper.make_node("ReduceLogSumExp", ["M"], ["Y"], axes=[-1], keepdims=0),
    ]
    mask = constant("mask", [-1e6, 0.0, 0.0, -50.0], np.float32)
    loaded = build.load(graph_model(nodes, [info("X", (None, 4))], [info("Y", None)], [mask], opset=13), tmp_path)
    x = np.random.default_rng(3).normal(scale=5.0, size=(200, 4))
    bound = difference_bound(loaded.ir, x)
    assert bound.max() < 2e-5
    assert (np.abs(loaded.predict(x) - reference.evaluate(loaded.ir, x)) <= bound).all()


@pytest.mark.parametrize("count", range(1, 8))
def test_the_mean_of_tensors_is_their_sum_times_a_share(tmp_path, count):
    """onnxruntime multiplies by 1 / count in float, and has no kernel for double."""
    inputs = [info(f"X{number}", (None, 2 - number % 2)) for number in range(count)]
    model = graph_model([helper.make_node("Mean", [one.name for one in inputs], ["Y"])], inputs, [info("Y", None)])
    loaded = build.load(model, tmp_path)
    assert loaded.ir.exact
    agree(loaded, rows(np.random.default_rng(17), len(loaded.ir.features)))


@DTYPES
@pytest.mark.parametrize("kind", [1, 2])
@pytest.mark.parametrize(("grid", "axis"), [((-1, 6), -1), ((-1, 2, 3), 1)])
def test_division_by_a_norm(tmp_path, kind, grid, axis, elem_type):
    nodes = [
        helper.make_node("Reshape", ["X", "shape"], ["G"]),
        helper.make_node("LpNormalization", ["G"], ["Y"], p=kind, axis=axis),
    ]
    outputs, shape = [info("Y", None, elem_type)], constant("shape", grid, np.int64)
    loaded = build.load(graph_model(nodes, [info("X", (None, 6), elem_type)], outputs, [shape]), tmp_path)
    x = np.clip(rows(np.random.default_rng(8), 6), -1e6, 1e6)
    x[::5] = 0.0
    agree(loaded, x)
    assert not reference.evaluate(loaded.ir, np.zeros((1, 6))).any()


@DTYPES
@pytest.mark.parametrize(("grid", "axis"), [((-1, 6, 1), 2), ((-1, 2, 3), 2), ((-1, 3, 2), 1), ((-1, 3, 2), 2)])
def test_products_are_equal_to_the_bit(tmp_path, grid, axis, elem_type):
    nodes = [
        helper.make_node("Reshape", ["X", "shape"], ["G"]),
        helper.make_node("ReduceProd", ["G"], ["Y"], axes=[axis]),
    ]
    outputs, shape = [info("Y", None, elem_type)], constant("shape", grid, np.int64)
    model = graph_model(nodes, [info("X", (None, 6), elem_type)], outputs, [shape], opset=13)
    assert not agree(build.load(model, tmp_path), rows(np.random.default_rng(9), 6)).any()


def test_a_product_of_many_numbers_has_no_order_that_is_known(tmp_path):
    with pytest.raises(UnsupportedModelError, match="more than 3"):
        build.load(single("ReduceProd", 4, opset=13, axes=[-1]), tmp_path)


@pytest.mark.parametrize(
    ("op_type", "bias"), [("LayerNormalization", False), ("LayerNormalization", True), ("RMSNormalization", False)]
)
def test_normalization_of_a_row(tmp_path, op_type, bias):
    rng = np.random.default_rng(8)
    constants = [constant("scale", rng.normal(size=8)), constant("bias", rng.normal(size=8))][: 1 + bias]
    opset = 23 if op_type == "RMSNormalization" else 17
    loaded = build.load(single(op_type, 8, constants, opset=opset), tmp_path)
    x = rng.normal(size=(300, 8)) * 10 ** rng.uniform(-3, 3, size=(300, 1)) + rng.normal(size=(300, 1))
    x = np.vstack([x, np.full((1, 8), 3.0), np.zeros((1, 8))])
    library, ours, bound = loaded.predict(x), reference.evaluate(loaded.ir, x), difference_bound(loaded.ir, x)
    assert np.all(np.abs(library - ours) <= bound)
    assert np.mean(np.isfinite(bound)) > 0.9


def test_columns_that_are_cut_picked_split_and_grown(tmp_path):
    nodes = [
        helper.make_node("Slice", ["X", "starts", "ends", "axes", "steps"], ["back"]),
        helper.make_node("Split", ["X", "parts"], ["left", "right"], axis=1),
        helper.make_node("GatherElements", ["X", "at"], ["picked"], axis=1),
        helper.make_node("Slice", ["right", "zero", "one", "one"], ["single"]),
        helper.make_node("Expand", ["single", "grown"], ["wide"]),
        helper.make_node("ConstantOfShape", ["grown"], ["ones"], value=constant("v", [1.0])),
        helper.make_node("Add", ["wide", "ones"], ["more"]),
        helper.make_node("Concat", ["back", "left", "picked", "more"], ["Y"], axis=1),
    ]
    numbers = {"starts": [-1], "ends": [-99], "axes": [1], "steps": [-2], "parts": [1, 4], "zero": [0], "one": [1]}
    numbers |= {"at": [[4, 0, -2]], "grown": [1, 2]}
    constants = [constant(name, values, np.int64) for name, values in numbers.items()]
    loaded = build.load(graph_model(nodes, [info("X", (None, 5))], [info("Y", None)], constants), tmp_path)
    assert build.assert_equal_bits(loaded, [[1.0, 2.0, 3.0, 4.0, 5.0]]).tolist() == [[5, 3, 1, 1, 5, 1, 4, 3, 3]]


def test_missing_numbers_filled_in(tmp_path):
    fills = [0.5, 3.0, 0.5]
    for replaced in (np.nan, -1.0):
        model = ml("Imputer", 3, imputed_value_floats=fills, replaced_value_float=replaced)
        loaded = build.load(model, tmp_path)
        x = rows(np.random.default_rng(9))
        assert loaded.ir.accepts_nan == bool(np.isnan(replaced))
        agree(loaded, x)
        assert verified(compiled(loaded), tmp_path / "text", rows=300).exact
    nodes = [
        helper.make_node(
            "Imputer", ["X"], ["F"], domain="ai.onnx.ml", imputed_value_floats=[1.0], replaced_value_float=np.nan
        ),
        helper.make_node("MatMul", ["F", "W"], ["Y"]),
    ]
    model = graph_model(nodes, [info("X", (None, 3))], [info("Y", None)], [constant("W", np.ones((3, 2)))])
    loaded = build.load(model, tmp_path)
    assert np.all(np.isfinite(reference.evaluate(loaded.ir, np.array([[np.nan, 1.0, np.nan]]))))
    assert verified(compiled(loaded), tmp_path / "net", rows=300).passed


@DTYPES
def test_whether_inputs_are_missing(tmp_path, elem_type):
    nodes = [
        helper.make_node("IsNaN", ["X"], ["T"]),
        helper.make_node("Not", ["T"], ["N"]),
        helper.make_node("Cast", ["N"], ["Y"], to=elem_type),
    ]
    loaded = build.load(graph_model(nodes, [info("X", (None, 3), elem_type)], [info("Y", None, elem_type)]), tmp_path)
    assert loaded.ir.exact and loaded.ir.accepts_nan
    agree(loaded, rows(np.random.default_rng(9)))
    assert verified(compiled(loaded), tmp_path / "text", rows=300).exact


@DTYPES
@pytest.mark.parametrize(
    "sides", [{}, {"detect_negative": 0}, {"detect_positive": 0}, {"detect_negative": 0, "detect_positive": 0}]
)
def test_whether_computed_numbers_are_infinite(tmp_path, elem_type, sides):
    """Rows whose products overflow have no answer, nor have infinite inputs; in all others nothing is infinite."""
    nodes = [
        helper.make_node("Mul", ["X", "X"], ["S"]),
        helper.make_node("Mul", ["S", "X"], ["C"]),
        helper.make_node("IsInf", ["C"], ["T"], **sides),
        helper.make_node("Where", ["T", "zero", "X"], ["Y"]),
    ]
    given = [constant("zero", 0.0, np.float32 if elem_type == FLOAT else np.float64)]
    model = graph_model(nodes, [info("X", (None, 3), elem_type)], [info("Y", None, elem_type)], given)
    loaded = build.load(model, tmp_path)
    x = np.vstack([rows(np.random.default_rng(9)), [[1e20, -1e15, 2.0], [1e120, -1e101, -3.0]]])
    agree(loaded, x)
    assert not loaded.ir.accepts_nan
    block = compiled(loaded).ir
    answered, overflows = reference.valid_rows(block, x), 1e120 if elem_type == DOUBLE else 1e20
    assert answered.sum() > 100 and not answered[np.abs(x).max(axis=1) >= overflows].any()
    np.testing.assert_array_equal(reference.evaluate(block, x[answered]), loaded.predict(x[answered]))
    taken = x[answered].astype(np.float32 if elem_type == FLOAT else np.float64)
    np.testing.assert_array_equal(loaded.predict(x[answered]), taken)
    assert verified(compiled(loaded), tmp_path / "text", rows=300).exact


def test_no_exponential_that_is_answered_is_infinite(tmp_path):
    nodes = [
        helper.make_node("Exp", ["X"], ["E"]),
        helper.make_node("IsInf", ["E"], ["T"]),
        helper.make_node("Cast", ["T"], ["Y"], to=FLOAT),
    ]
    loaded = build.load(graph_model(nodes, [info("X", (None, 3), FLOAT)], [info("Y", None, FLOAT)]), tmp_path)
    x = np.array([[100.0, 89.0, -100.0], [80.0, 0.0, -1e20]])
    np.testing.assert_array_equal(loaded.predict(x), [[1, 1, 0], [0, 0, 0]])
    np.testing.assert_array_equal(reference.evaluate(compiled(loaded).ir, x), [[np.nan] * 3, [0, 0, 0]])
    assert verified(compiled(loaded), tmp_path / "text", rows=300).exact


@pytest.mark.parametrize("kind", [TensorProto.INT8, TensorProto.INT32, INT64])
@pytest.mark.parametrize("to", [TensorProto.INT32, INT64])
def test_integer_inputs_that_are_cast_to_integers_lose_their_fractions(tmp_path, kind, to):
    nodes = [helper.make_node("Cast", ["X"], ["I"], to=to), helper.make_node("Cast", ["I"], ["Y"], to=DOUBLE)]
    loaded = build.load(graph_model(nodes, [info("X", (None, 3), kind)], [info("Y", None, DOUBLE)]), tmp_path)
    x = np.array([[1.5, -1.5, 0.0], [-0.5, 0.5, -0.0], [2.0**31, 7.0, -3.0], [-(2.0**31), 2.0**31 - 1, 2.0**24 + 1]])
    x = x[reference.valid_rows(loaded.ir, x)]
    assert len(x) == (2 if to == TensorProto.INT32 else 4)
    np.testing.assert_array_equal(reference.evaluate(loaded.ir, x), loaded.predict(x))
    assert verified(compiled(loaded), tmp_path / "text", rows=300).exact


@pytest.mark.parametrize("op_type", ["Imputer", "IsNaN"])
def test_nan_that_a_graph_makes_is_not_looked_for(tmp_path, op_type):
    """Such rows have no answer in the block, and had it that an imputer gives them in the library."""
    given = {"domain": "ai.onnx.ml", "imputed_value_floats": [0.0], "replaced_value_float": np.nan}
    last = [helper.make_node("Imputer", ["L"], ["Y"], **given)]
    if op_type == "IsNaN":
        last = [helper.make_node("IsNaN", ["L"], ["T"]), helper.make_node("Cast", ["T"], ["Y"], to=FLOAT)]
    nodes = [helper.make_node("Log", ["X"], ["L"]), *last]
    with pytest.raises(UnsupportedModelError, match=r"looks for NaN that an operator before it makes.*\.skops"):
        build.load(graph_model(nodes, [info("X", (None, 3))], [info("Y", None)]), tmp_path)


def test_thresholds_and_categories(tmp_path):
    loaded = build.load(ml("Binarizer", 3, threshold=0.5), tmp_path)
    assert loaded.ir.exact
    agree(loaded, rows(np.random.default_rng(10)))
    for elem_type in (FLOAT, DOUBLE):
        loaded = build.load(ml("OneHotEncoder", 2, elem_type, cats_int64s=[0, 3, -2, 1, 7]), tmp_path)
        assert len(loaded.ir.outputs) == 10
        assert loaded.ir.exact
        near = [value + step for value in (-3.0, -2.0, -1.0, 0.0, 1.0, 3.0, 4.0, 7.0, 8.0) for step in (0.0, 0.5, -0.5)]
        x = build.special_rows(2, near, np.random.default_rng(11), n=300)
        agree(loaded, x[np.all(np.abs(x) < 1e9, axis=1)])


@pytest.mark.parametrize("elem_type", [FLOAT, DOUBLE, INT64])
def test_categories_without_which_a_row_has_no_answer(tmp_path, elem_type):
    """With zeros=0 onnxruntime fails on an unknown category; so skl2onnx writes what is not told to ignore it."""
    categories = [3, -2, 4, 7]
    loaded = build.load(ml("OneHotEncoder", 2, elem_type, cats_int64s=categories, zeros=0), tmp_path)
    assert loaded.ir.exact
    near = [value + step for value in (-4, -2, 0, 3, 4, 5, 7, 8) for step in (0.0, 0.5, -0.5, 1e-9, -1e-9)]
    x = np.array([[one, other] for one in near for other in near])
    ours = reference.evaluate(loaded.ir, x)
    known = np.isin(np.trunc(x.astype(np.float32) if elem_type == FLOAT else x), categories).all(axis=1)
    assert np.array_equal(np.isfinite(ours).all(axis=1), known) and known.any()
    assert np.array_equal(ours[known], loaded.predict(x[known]))
    with pytest.raises(InputError, match="Unknown Category"):
        loaded.predict(x[~known][:1])


@pytest.mark.parametrize("elem_type", [FLOAT, DOUBLE, INT64])
@pytest.mark.parametrize("categories", [(3, 5, 9), (-7, -4, 12), (0, 1)])
def test_rows_of_known_categories_are_verified(tmp_path, elem_type, categories):
    """Rows drawn at random have none, and the end of the stretch of -7 is -8 in float32."""
    loaded = build.load(ml("OneHotEncoder", 4, elem_type, cats_int64s=categories, zeros=0), tmp_path)
    report = verified(loaded, tmp_path / "out", target="iec", rows=600)
    assert report.exact and report.unanswered < report.n / 2


def encoded_twice(keys, given):
    """The number of a category, then a column for each number, as an OrdinalEncoder and a OneHotEncoder are written."""
    domain = "ai.onnx.ml"
    nodes = [
        helper.make_node("LabelEncoder", ["X"], ["N"], domain=domain, keys_floats=keys, values_int64s=given),
        helper.make_node("OneHotEncoder", ["N"], ["Y"], domain=domain, cats_int64s=[0, 1, 2], zeros=0),
    ]
    return graph_model(nodes, [info("X", (None, 2))], [info("Y", None)])


def test_a_model_is_tried_with_numbers_that_lead_to_known_categories(tmp_path):
    """0 and 1 are none of the keys; of categories there may be some that float32 does not hold."""
    loaded = build.load(encoded_twice([3.0, -5.0, 9.5], [1, 7, 2]), tmp_path)
    x = np.array([[3.0, 9.5], [9.5, 3.0]])
    assert np.array_equal(loaded.predict(x), [[0, 1, 0, 0, 0, 1], [0, 0, 1, 0, 1, 0]])
    assert np.array_equal(loaded.predict(x), reference.evaluate(loaded.ir, x))
    assert not np.isfinite(reference.evaluate(loaded.ir, [[-5.0, 3.0]])).any()
    loaded = build.load(ml("OneHotEncoder", 2, cats_int64s=[5, -16777217], zeros=0), tmp_path)
    assert np.array_equal(loaded.predict(np.array([[5.0, 5.0]])), [[1, 0, 1, 0]])


def test_a_model_of_which_no_known_category_is_found_says_what_to_do(tmp_path):
    nodes = [
        helper.make_node("Mul", ["X", "c"], ["M"]),
        helper.make_node("OneHotEncoder", ["M"], ["Y"], domain="ai.onnx.ml", cats_int64s=[7, 9], zeros=0),
    ]
    model = graph_model(nodes, [info("X", (None, 2))], [info("Y", None)], [constant("c", [0.5])])
    with pytest.raises(InputError, match=r"Unknown Category.*handle_unknown='ignore', or export it with zeros=1"):
        build.load(model, tmp_path)


def test_many_categories_take_no_square_of_their_number():
    """12,000 took 600 MB; of the knots the first and the last of each stretch are what they were."""
    categories = np.random.default_rng(0).permutation(np.arange(-30000.0, 30000.0, 3.0))
    low = np.where(categories > 0, categories, np.nextafter(categories - 1.0, np.inf))
    high = np.where(categories < 0, np.nextafter(categories, np.inf), categories + 1.0)
    tracemalloc.start()
    op = _known(0, 1, categories, low, high)
    assert tracemalloc.get_traced_memory()[1] < 2e7
    tracemalloc.stop()
    assert np.array_equal(op.at[::2], np.sort(categories)) and np.isinf(op.at[1::2]).all()
    assert np.array_equal(op.pieces[1:, 0], op.at) and np.isinf(op.pieces[0, 0])


def test_labels_encoded(tmp_path):
    nodes = [
        helper.make_node("ArgMax", ["X"], ["I"], axis=1, keepdims=0),
        helper.make_node(
            "LabelEncoder", ["I"], ["Y"], domain="ai.onnx.ml", keys_int64s=[0, 1, 2], values_strings=["a", "b", "c"]
        ),
    ]
    model = graph_model(nodes, [info("X", (None, 3))], [info("Y", None, TensorProto.STRING)])
    loaded = build.load(model, tmp_path)
    assert loaded.ir.classes.labels == ("a", "b", "c")
    agree(loaded, rows(np.random.default_rng(12)))


def test_a_number_of_rows_in_the_file(tmp_path):
    """A graph for five rows at once is compiled for one."""
    nodes = [helper.make_node("Neg", ["X"], ["N"]), helper.make_node("Relu", ["N"], ["Y"])]
    loaded = build.load(graph_model(nodes, [info("X", (5, 3))], [info("Y", (5, 3))]), tmp_path)
    build.assert_equal_bits(loaded, build.rows(3))


def test_a_network_of_these_is_verified(tmp_path):
    """As PyTorch writes Gelu before opset 20, with a norm and a choice behind it."""
    rng = np.random.default_rng(13)
    nodes = [
        helper.make_node("Gemm", ["X", "W1", "b1"], ["h"]),
        helper.make_node("Div", ["h", "root"], ["d"]),
        helper.make_node("Erf", ["d"], ["e"]),
        helper.make_node("Add", ["e", "one"], ["a"]),
        helper.make_node("Mul", ["h", "a"], ["m"]),
        helper.make_node("LayerNormalization", ["m", "scale"], ["n"]),
        helper.make_node("Gemm", ["n", "W2", "b2"], ["s"]),
        helper.make_node("HardSwish", ["s"], ["w"]),
        helper.make_node("LogSoftmax", ["w"], ["Y"], axis=-1),
    ]
    constants = [
        constant("W1", rng.normal(size=(3, 6))),
        constant("b1", rng.normal(size=6)),
        *(constant("root", np.sqrt(2.0)), constant("one", 1.0), constant("scale", rng.normal(size=6))),
        constant("W2", rng.normal(size=(6, 3))),
        constant("b2", rng.normal(size=3)),
    ]
    loaded = build.load(graph_model(nodes, [info("X", (None, 3))], [info("Y", None)], constants, opset=17), tmp_path)
    for target in ("twincat", "iec"):
        assert verified(compiled(loaded), tmp_path / target, target, rows=300).passed


#: Operators whose 0 may have another sign than the library's, as nodes; and others that keep it.
ZEROS = {
    "Relu": (("Relu", ["x"]), {}, True),
    "a limit at 0": (("Clip", ["x", "low", "high"]), {"low": 0.0, "high": 1.0}, True),
    "limits beside 0": (("Clip", ["x", "low", "high"]), {"low": -1.0, "high": 1.0}, False),
    "a choice": (("Where", ["truth", "x", "low"]), {"low": 2.0, "truth": None}, True),
    "above a negative number": (("ThresholdedRelu", ["x"]), {"alpha": -1.0}, True),
    "above a positive number": (("ThresholdedRelu", ["x"]), {"alpha": 0.5}, False),
    "LeakyRelu": (("LeakyRelu", ["x"]), {}, False),
    "Neg": (("Neg", ["x"]), {}, False),
}


@pytest.mark.parametrize("name", ZEROS)
def test_zeros_of_the_other_sign_are_not_called_equal_bits(tmp_path, name):
    (op_type, inputs), given, opens = ZEROS[name]
    attributes = {key: value for key, value in given.items() if key == "alpha"}
    constants = [constant(key, value) for key, value in given.items() if key in ("low", "high")]
    nodes = [helper.make_node(op_type, inputs, ["y"], **attributes)]
    if "truth" in given:
        constants.append(constant("half", 0.5))
        nodes.insert(0, helper.make_node("Less", ["x", "half"], ["truth"]))
    model = graph_model(nodes, [info("x", (None, 3))], [info("y", None)], constants)
    loaded = build.load(model, tmp_path)
    x = np.array([[-0.0, 0.0, -0.0], [0.0, -0.0, 2.0], [-1.0, -0.0, 0.25]])
    library, ours = loaded.predict(x), reference.evaluate(loaded.ir, x)
    np.testing.assert_array_equal(library, ours)
    assert (loaded.ir.exact, loaded.ir.signs_zeros) == (True, not opens)
    if not opens:
        np.testing.assert_array_equal(np.signbit(library), np.signbit(ours))


def _with_fractions(rng):
    """Ties, their neighbours, and numbers around those from which on there are no fractions."""
    ends = np.array([2.0**22, 2.0**23, 2.0**24, 2.0**51, 2.0**52, 2.0**53, 2.0**104, 1e38])
    ties = np.concatenate([np.arange(-5, 5) / 2, ends, ends + 0.5, ends - 0.5, ends + 1.5, [5e-324, 1e-45, 0.3]])
    near = np.concatenate([ties, np.nextafter(ties, 0), np.nextafter(ties, np.inf)])
    return np.vstack([rng.choice(np.concatenate([near, -near]), (300, 3)), rng.normal(size=(200, 3)) * 9])


@DTYPES
@pytest.mark.parametrize("name", ["Floor", "Ceil", "Round"])
def test_whole_numbers_beside_others(tmp_path, name, elem_type):
    loaded = build.load(single(name, elem_type=elem_type), tmp_path)
    bound = agree(loaded, _with_fractions(np.random.default_rng(0)))
    assert (bound.max(), loaded.ir.exact, loaded.ir.signs_zeros) == (0.0, True, False)
    assert loaded.ir.magnitude_limits[0] is not None  # an infinity is refused
    assert not loaded.ir.accepts_nan
    verified(loaded, tmp_path / "out", rows=300)


def test_whole_numbers_of_what_is_rounded_may_be_the_next_ones(tmp_path):
    """Beside a tie the library may take the other one; the bound says so."""
    nodes = [helper.make_node("MatMul", ["x", "w"], ["s"]), helper.make_node("Floor", ["s"], ["y"])]
    weights = constant("w", np.full((3, 1), 1 / 3))
    loaded = build.load(graph_model(nodes, [info("x", (None, 3))], [info("y", None)], [weights]), tmp_path)
    bound = agree(loaded, np.random.default_rng(0).integers(-9, 9, (400, 3)))
    assert not loaded.ir.exact
    assert set(np.round(bound, 12).ravel().tolist()) == {0.0, 1.0}  # 0 away from ties


#: Numbers around the ends of integers, and what is done with them once they are cut: nodes from I to Y, constants.
AFTER_CUTTING = {
    "the integers": ([("Identity", ["I"])], []),
    "numbers again": ([("Cast", ["I"])], []),
    "equal integers": ([("Equal", ["I", "k"]), ("Cast", ["T"])], [("k", [-1, 0, 3])]),
    "integers below": ([("Less", ["I", "k"]), ("Cast", ["T"])], [("k", [-1, 0, 3])]),
    "categories": ([("OneHotEncoder", ["I"])], []),
    "labels": ([("LabelEncoder", ["I"])], []),
    "together": ([("Concat", ["I", "k"]), ("Cast", ["T"])], [("k", [[5, -7]])]),
    "the truth of each": ([("Cast", ["I"]), ("Cast", ["T"])], []),
}


@DTYPES
@pytest.mark.parametrize(
    ("name", "whole"),
    [(name, INT64) for name in AFTER_CUTTING]
    + [(name, TensorProto.INT32) for name in AFTER_CUTTING if name not in ("categories", "labels")],
)
def test_numbers_cut_to_integers(tmp_path, name, whole, elem_type):
    """Of numbers that do not fit, for which machines differ, there is no answer."""
    steps, given = AFTER_CUTTING[name]
    attributes = {
        "Concat": {"axis": 1},
        "OneHotEncoder": {"domain": "ai.onnx.ml", "cats_int64s": [-2, 0, 3]},
        "LabelEncoder": {"domain": "ai.onnx.ml", "keys_int64s": [0, -1, 7], "values_floats": [0.5, 2.0, -3.0]},
    }
    nodes = [helper.make_node("Cast", ["X"], ["I"], to=whole)]
    for number, (op_type, inputs) in enumerate(steps):
        last = number == len(steps) - 1
        to = elem_type if last else TensorProto.BOOL
        more = {"to": to} if op_type == "Cast" else attributes.get(op_type, {})
        nodes.append(helper.make_node(op_type, inputs, ["Y" if last else "T"], **more))
    kind = {"the integers": whole, "categories": FLOAT, "labels": FLOAT}.get(name, elem_type)
    constants = [constant(word, numbers, helper.tensor_dtype_to_np_dtype(whole)) for word, numbers in given]
    model = graph_model(nodes, [info("X", (None, 3), elem_type)], [info("Y", None, kind)], constants)
    loaded = build.load(model, tmp_path)
    bits = 63 if whole == INT64 else 31
    ends = np.array([2.0**bits, 2.0**bits - 64, 2.0**bits - 129, 2.0 ** (bits - 1), 2.0**bits - 2.0 ** (bits - 24)])
    near = np.concatenate([ends, np.nextafter(ends, 0), -ends])
    rng = np.random.default_rng(3)
    x = np.vstack([_with_fractions(rng), rng.choice(np.append(near, [0.5, -0.25, 7.0]), (300, 3)), rows(rng)])
    assert not agree(loaded, x).any()
    assert loaded.ir.exact and not loaded.ir.accepts_nan
    taken = reference.valid_rows(loaded.ir, near[:, None].repeat(3, axis=1))
    assert taken[np.abs(near) <= 2.0 ** (bits - 1)].all() and not taken[0]


@pytest.mark.parametrize("to", [INT64, TensorProto.INT32])
def test_arithmetic_of_integers(tmp_path, to):
    """-1 and 1 of a truth value, as exporters of detectors write it; numbers that leave their type have no answer."""
    kind = helper.tensor_dtype_to_np_dtype(to)
    nodes = [
        helper.make_node("Less", ["X", "cut"], ["T"]),
        helper.make_node("Cast", ["T"], ["I"], to=to),
        helper.make_node("Mul", ["I", "two"], ["D"]),
        helper.make_node("Add", ["D", "one"], ["E"]),
        helper.make_node("Sub", ["E", "I"], ["Y"]),
    ]
    constants = [constant("cut", [0.5, 0.0, -1.0]), constant("two", -2, kind), constant("one", 1, kind)]
    loaded = build.load(graph_model(nodes, [info("X", (None, 3))], [info("Y", None, to)], constants), tmp_path)
    assert loaded.ir.exact
    assert not agree(loaded, rows(np.random.default_rng(6))).any()
    nodes[1].input[0] = "X"
    loaded = build.load(graph_model(nodes, [info("X", (None, 3))], [info("Y", None, to)], constants), tmp_path)
    assert loaded.ir.exact
    assert not agree(loaded, rows(np.random.default_rng(6))).any()
    large = 2.0 ** (29 if to == TensorProto.INT32 else 51)  # -2 of it is half of what there is, -3 is more
    answered = np.isfinite(reference.evaluate(loaded.ir, [[large, 0.0, 0.0], [4 * large, 0.0, 0.0]])).all(axis=1)
    assert answered.tolist() == [True, False]


def test_whole_numbers_that_a_double_does_not_hold_are_refused(tmp_path):
    """2**53 + 1 was taken for 2**53, and what was left of it called exact."""
    nodes = [
        helper.make_node("Cast", ["X"], ["I"], to=INT64),
        helper.make_node("Add", ["I", "large"], ["J"]),
        helper.make_node("Cast", ["J"], ["Y"], to=TensorProto.FLOAT),
    ]
    constants = [numpy_helper.from_array(np.array([2**53 + 1]), "large")]
    with pytest.raises(UnsupportedModelError, match=r"whole numbers from 2\*\*53 on"):
        build.load(graph_model(nodes, [info("X", (None, 3))], [info("Y", (None, 3))], constants), tmp_path)


def test_computed_numbers_that_do_not_fit_integers_have_no_answer(tmp_path):
    nodes = [
        helper.make_node("Mul", ["X", "large"], ["L"]),
        helper.make_node("Cast", ["L"], ["I"], to=TensorProto.INT32),
        helper.make_node("Cast", ["I"], ["Y"], to=FLOAT),
    ]
    model = graph_model(nodes, [info("X", (None, 1))], [info("Y", None)], [constant("large", 1e6)])
    loaded = build.load(model, tmp_path)
    x = np.array([[0.5e-6], [-7.25e-6], [2000.0], [2147.0], [2148.0], [-2148.0]])
    ours = reference.evaluate(loaded.ir, x)
    np.testing.assert_array_equal(np.isnan(ours[:, 0]), np.abs(x[:, 0]) > 2147.5)
    np.testing.assert_array_equal(ours[:4], loaded.predict(x[:4]))


def test_whole_numbers_stay_so_in_real(tmp_path):
    """What rounds in float32 rounds in REAL."""
    model = build.load(single("Round"), tmp_path)
    x = np.array([[0.5, 1.5, -2.5], [8388607.5, 8388609.0, -0.25], [3.0, 1e9, -7.75]])
    narrow = in_real(model.ir)
    np.testing.assert_array_equal(reference.evaluate(narrow, x), model.predict(x))


def test_whole_numbers_of_integers_are_refused(tmp_path):
    with pytest.raises(UnsupportedModelError, match="reads integers"):
        build.load(single("Floor", elem_type=INT64), tmp_path)


@pytest.mark.parametrize("axis", [-1, 1, 2])
@pytest.mark.parametrize("pair", [[0.0, 1.0], [-2.5, 4.0]])
@pytest.mark.parametrize("kind", [TensorProto.FLOAT, TensorProto.INT64])
def test_a_place_among_others(tmp_path, axis, pair, kind):
    nodes = [
        helper.make_node("Cast", ["X"], ["places"], to=TensorProto.INT64),
        helper.make_node("OneHot", ["places", "depth", "pair"], ["H"], axis=axis),
        helper.make_node("Flatten", ["H"], ["Y"]),
    ]
    constants = [constant("depth", 3, np.int64), constant("pair", pair, np.float32)]
    model = graph_model(nodes, [info("X", (None, 2), kind)], [info("Y", None)], constants)
    loaded = build.load(model, tmp_path)
    places = [-5, -4, -3, -2, -1, 0, 1, 2, 3, 9]
    steps = [0.0] if kind == TensorProto.INT64 else [0.0, 0.75, -0.75]
    x = np.array([[a + step, b] for a in places for b in places for step in steps], np.float64)
    assert loaded.ir.exact and not np.any(agree(loaded, x))
    assert len(np.unique(loaded.predict(x), axis=0)) == 16


@pytest.mark.parametrize("op_type", ["Where", "Concat"])
def test_whole_numbers_that_a_double_does_not_hold_are_not_put_beside_computed_ones(tmp_path, op_type):
    constants = [numpy_helper.from_array(np.full((1, 3), 2**53 + 1), "large"), constant("zero", 0.0)]
    nodes = [helper.make_node("Cast", ["X"], ["I"], to=INT64), helper.make_node("Greater", ["X", "zero"], ["C"])]
    if op_type == "Where":
        nodes.append(helper.make_node("Where", ["C", "I", "large"], ["J"]))
    else:
        nodes.append(helper.make_node("Concat", ["I", "large"], ["J"], axis=0))
    nodes.append(helper.make_node("Cast", ["J"], ["Y"], to=TensorProto.FLOAT))
    with pytest.raises(UnsupportedModelError, match=r"whole numbers from 2\*\*53 on"):
        build.load(graph_model(nodes, [info("X", (1, 3))], [info("Y", (None, 3))], constants), tmp_path)
