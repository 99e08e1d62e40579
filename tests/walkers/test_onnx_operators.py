"""Operators of feed-forward graphs: what has one rounding is equal to the bit, the rest within its derived bound."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from onnx import AttributeProto, TensorProto, helper

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import (
    FLOAT32_OVERFLOW,
    Activation,
    Linear,
    Normalize,
    Precision,
    Round,
    Scale,
    Select,
    SlidingLinear,
    reference,
)
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import (
    DOUBLE,
    FLOAT,
    assert_equal_bits,
    assert_within_bound,
    constant,
    graph_model,
    info,
    ml,
    rows,
    single,
)

pytestmark = pytest.mark.usefixtures("tried_in_place")

ROW = [0.5, -1.75, 3.1]
DTYPES = pytest.mark.parametrize("elem_type", [FLOAT, DOUBLE])


@DTYPES
@pytest.mark.parametrize("op_type", ["Add", "Sub", "Mul", "Div"])
@pytest.mark.parametrize("shape", [(), (1,), (3,), (1, 3), (1, 1), (1, 1, 3)])
@pytest.mark.parametrize("reverse", [False, True])
def test_arithmetic_with_a_constant_on_either_side(tmp_path, op_type, shape, reverse, elem_type):
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    model = single(op_type, 3, [constant("C", np.reshape(ROW[: int(np.prod(shape))], shape), dtype)], elem_type)
    if reverse:
        model.graph.node[0].input.reverse()
    loaded = build.load(model, tmp_path)
    assert_equal_bits(loaded, rows(3))
    assert loaded.ir.ops[-1].precision is (Precision.FLOAT32 if elem_type == FLOAT else Precision.FLOAT64)


@DTYPES
@pytest.mark.parametrize("op_type", ["Add", "Sub", "Mul", "Div"])
def test_arithmetic_of_two_computed_tensors(tmp_path, op_type, elem_type):
    inputs = [info("A", (None, 3), elem_type), info("B", (None, 1), elem_type)]
    model = graph_model([helper.make_node(op_type, ["A", "B"], ["Y"])], inputs, [info("Y", None, elem_type)])
    loaded = build.load(model, tmp_path)
    assert [feature.name for feature in loaded.ir.features] == ["A_0", "A_1", "A_2", "B"]
    assert_equal_bits(loaded, rows(4))


def test_a_column_grows_to_a_row(tmp_path):
    loaded = build.load(single("Add", 1, [constant("C", [ROW])]), tmp_path)
    assert len(loaded.ir.outputs) == 3
    assert_equal_bits(loaded, rows(1))


def test_sums_of_several_inputs_are_added_in_order(tmp_path):
    inputs = [info(name, (None, 2)) for name in "ABCD"]
    model = graph_model([helper.make_node("Sum", list("ABCD"), ["Y"])], inputs, [info("Y", None)])
    assert_equal_bits(build.load(model, tmp_path), rows(8))


@pytest.mark.parametrize("op_type", ["MatMul", "Max", "Mean", "Min", "Sum"])
def test_what_opset_7_has_of_an_older_version(op_type, tmp_path):
    weights = constant("W", np.random.default_rng(5).normal(size=(3, 3)))
    inputs, nodes = [info("X", (1, 3))], [helper.make_node("MatMul", ["X", "W"], ["Y"])]
    if op_type != "MatMul":
        inputs, nodes = [info(name, (1, 3)) for name in "XAB"], [helper.make_node(op_type, list("XAB"), ["Y"])]
    model = graph_model(nodes, inputs, [info("Y", (1, 3))], [weights] if op_type == "MatMul" else [], opset=7)
    loaded = build.load(model, tmp_path)
    agree = build.assert_within_bound if op_type == "MatMul" else assert_equal_bits
    agree(loaded, rows(3 * len(inputs)))


@DTYPES
@pytest.mark.parametrize(("op_type", "attributes"), [("Relu", {}), ("LeakyRelu", {}), ("LeakyRelu", {"alpha": 0.3})])
def test_exact_activations(tmp_path, op_type, attributes, elem_type):
    loaded = build.load(single(op_type, 3, elem_type=elem_type, **attributes), tmp_path)
    assert_equal_bits(loaded, rows(3))


@DTYPES
def test_negation(tmp_path, elem_type):
    assert_equal_bits(build.load(single("Neg", 3, elem_type=elem_type), tmp_path), rows(3))


INEXACT = [("Tanh", {}), ("Sigmoid", {}), ("Elu", {}), ("Elu", {"alpha": 1.7}), ("Softplus", {}), ("Exp", {})]


@DTYPES
@pytest.mark.parametrize(("op_type", "attributes"), INEXACT)
def test_transcendental_activations(tmp_path, op_type, attributes, elem_type):
    if op_type == "Softplus" and elem_type == DOUBLE:
        with pytest.raises(UnsupportedModelError, match="double version overflows above 709"):
            build.load(single(op_type, 3, elem_type=elem_type), tmp_path)
        return
    loaded = build.load(single(op_type, 3, elem_type=elem_type, **attributes), tmp_path)
    assert loaded.ir.ops[-1].precision is (Precision.FLOAT32 if elem_type == FLOAT else Precision.FLOAT64)
    assert_within_bound(loaded, np.vstack([rows(3, spread=3.0).clip(-85, 85), np.zeros((1, 3)), -np.zeros((1, 3))]))


@DTYPES
@pytest.mark.parametrize("opset", [7, 13, 17])
def test_gemm(tmp_path, opset, elem_type):
    rng = np.random.default_rng(1)
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    for attributes in ({}, {"transB": 1}, {"alpha": 0.7, "beta": 1.3}, {"beta": 0.0}):
        weights = rng.normal(size=(3, 5))
        weights = weights.T if "transB" in attributes else weights
        for shape in ((), (1,), (5,), (1, 5), None):
            if shape is None and opset < 11:
                continue
            extra = [] if shape is None else [constant("C", rng.normal(size=shape), dtype)]
            model = single("Gemm", 3, [constant("B", weights, dtype), *extra], elem_type, opset=opset, **attributes)
            assert_within_bound(build.load(model, tmp_path), rows(3))


def test_gemm_of_a_transposed_column(tmp_path):
    model = single("Gemm", 3, [constant("B", np.ones((3, 2)))], transA=1)
    model.graph.node[0].input[0] = "column"
    node = helper.make_node("Transpose", ["X"], ["column"])
    model.graph.node.insert(0, node)
    assert_within_bound(build.load(model, tmp_path), rows(3))


@DTYPES
def test_matmul_with_constants_on_either_side(tmp_path, elem_type):
    rng = np.random.default_rng(2)
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    for shape, weights, reverse in (
        ((None, 3), (3, 4), False),
        ((3,), (3, 4), False),
        ((3,), (3,), False),
        ((None, 3), (3,), False),
        ((None, 1, 3), (3, 2), False),
        ((3,), (4, 3), True),
        ((1, 3, 1), (4, 3), True),
        ((1, 3, 1), (3,), True),
        ((3,), (2, 3, 4), False),
        ((2, 2, 3), (3,), False),
        ((1, 2, 2, 3), (3,), False),
    ):
        names = ["W", "X"] if reverse else ["X", "W"]
        node = helper.make_node("MatMul", names, ["Y"])
        constants = [constant("W", rng.normal(size=weights), dtype)]
        model = graph_model([node], [info("X", shape, elem_type)], [info("Y", None, elem_type)], constants)
        loaded = build.load(model, tmp_path)
        assert isinstance(loaded.ir.ops[-1], Linear | SlidingLinear)
        assert_within_bound(loaded, rows(len(loaded.ir.features)))


@pytest.mark.parametrize("shapes", [((3,), (3,)), ((3,), (3, 2)), ((2, 3), (3,)), ((1, 2, 2, 3), (3,))])
def test_matmul_of_computed_vectors(tmp_path, shapes):
    """The first one of numpy.matmul: a vector is a row on the left, a column on the right."""
    left, right = shapes
    nodes = [
        helper.make_node("Split", ["X", "sizes"], ["A", "B"], axis=1),
        helper.make_node("Reshape", ["A", "left"], ["L"]),
        helper.make_node("Reshape", ["B", "right"], ["R"]),
        helper.make_node("MatMul", ["L", "R"], ["Y"]),
    ]
    sizes = [int(np.prod(shape)) for shape in shapes]
    given = [constant(name, list(to), np.int64) for name, to in (("sizes", sizes), ("left", left), ("right", right))]
    model = graph_model(nodes, [info("X", (1, sum(sizes)))], [info("Y", None)], given)
    assert_within_bound(build.load(model, tmp_path), rows(sum(sizes)))


def test_layers_of_a_network(tmp_path):
    rng = np.random.default_rng(3)
    nodes = [
        helper.make_node("Gemm", ["X", "W1", "b1"], ["h1"], transB=1),
        helper.make_node("Tanh", ["h1"], ["a1"]),
        helper.make_node("Dropout", ["a1"], ["d1"]),
        helper.make_node("MatMul", ["d1", "W2"], ["h2"]),
        helper.make_node("Add", ["h2", "b2"], ["s2"]),
        helper.make_node("Sigmoid", ["s2"], ["a2"]),
        helper.make_node("Gemm", ["a2", "W3"], ["Y"], alpha=0.5),
    ]
    shapes = {"W1": (20, 4), "b1": (20,), "W2": (20, 10), "b2": (10,), "W3": (10, 2)}
    constants = [constant(name, rng.normal(size=shape)) for name, shape in shapes.items()]
    model = graph_model(nodes, [info("X", ("batch", 4))], [info("Y", ("batch", 2))], constants)
    loaded = build.load(model, tmp_path)
    assert_within_bound(loaded, rng.normal(size=(300, 4)))
    assert loaded.ir.source.model_class == "feed-forward graph (Gemm, Tanh, MatMul, Add, Sigmoid, Gemm)"
    assert not loaded.ir.accepts_nan
    assert set(loaded.ir.magnitude_limits) == {FLOAT32_OVERFLOW}


@DTYPES
def test_clip(tmp_path, elem_type):
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    low, high = constant("low", -0.5, dtype), constant("high", 1.5, dtype)
    for model in (
        single("Clip", 3, [low, high], elem_type, opset=13),
        single("Clip", 3, [low], elem_type, opset=12),
        single("Clip", 3, [constant("low", -np.inf, dtype), high], elem_type),
    ):
        assert_equal_bits(build.load(model, tmp_path), rows(3))
    upper = single("Clip", 3, [high], elem_type)
    upper.graph.node[0].input.insert(1, "")
    assert_equal_bits(build.load(upper, tmp_path), rows(3))
    if elem_type == FLOAT:
        assert_equal_bits(build.load(single("Clip", 3, [low], opset=11), tmp_path), rows(3))
        assert_equal_bits(build.load(single("Clip", 3, opset=9, min=-0.25, max=0.1), tmp_path), rows(3))
        assert_equal_bits(build.load(single("Clip", 3, opset=9, min=0.0, max=np.inf), tmp_path), rows(3))


@DTYPES
@pytest.mark.parametrize("opset", [11, 13, 18])
@pytest.mark.parametrize("op_type", ["ReduceMean", "ReduceSum"])
def test_reductions(tmp_path, op_type, opset, elem_type):
    dtype = helper.tensor_dtype_to_np_dtype(elem_type)
    by_input = opset >= (18 if op_type == "ReduceMean" else 13)
    for axes, keepdims in (([1], 1), ([-1], 0), (None, 1)):
        constants = [constant("axes", axes, np.int64)] if by_input and axes else []
        attributes = {"axes": axes} if axes and not by_input else {}
        model = single(op_type, 5, constants, elem_type, opset=opset, keepdims=keepdims, **attributes)
        if axes is None:  # over the rows of a batch, too
            model.graph.input[0].type.tensor_type.shape.dim[0].dim_value = 1
        loaded = build.load(model, tmp_path)
        assert len(loaded.ir.outputs) == 1
        x = rows(5).astype(dtype).astype(np.float64)
        assert_within_bound(loaded, x)
        exact = x.mean(axis=1) if op_type == "ReduceMean" else x.sum(axis=1)
        np.testing.assert_allclose(reference.evaluate(loaded.ir, x)[:, 0], exact, rtol=1e-4, atol=1e-4)


def test_reduction_of_one_of_two_axes(tmp_path):
    nodes = [
        helper.make_node("Reshape", ["X", "shape"], ["grid"]),
        helper.make_node("ReduceSum", ["grid", "axes"], ["Y"], keepdims=0),
    ]
    constants = [constant("shape", [2, 3], np.int64), constant("axes", [0], np.int64)]
    model = graph_model(nodes, [info("X", (None, 6))], [info("Y", None)], constants)
    loaded = build.load(model, tmp_path)
    assert reference.evaluate(loaded.ir, np.arange(6.0)[None, :]).tolist() == [[3.0, 5.0, 7.0]]
    assert_within_bound(loaded, rows(6))


@DTYPES
def test_scaler(tmp_path, elem_type):
    for offset, scale in ((ROW, [0.1, -3.0, 1e-3]), ([0.3], [1.7])):
        loaded = build.load(ml("Scaler", 3, elem_type, offset=offset, scale=scale), tmp_path)
        assert_equal_bits(loaded, rows(3))
        kinds = [type(op) for op in loaded.ir.ops]
        assert kinds == ([Round, Scale, Scale] if elem_type == FLOAT else [Scale, Scale, Round])


@pytest.mark.parametrize("norm", ["MAX", "L1", "L2"])
def test_normalizer_is_exact_with_underflow_overflow_zeros_and_signs(tmp_path, norm):
    loaded = build.load(ml("Normalizer", 4, norm=norm), tmp_path)
    assert isinstance(loaded.ir.ops[-1], Normalize)
    x = np.vstack([rows(4, n=500, spread=25.0), np.zeros((1, 4)), -np.ones((1, 4)), [[-0.0, 1e-30, 2e-40, -3.0]]])
    x = np.where(np.abs(x) < FLOAT32_OVERFLOW, x, 1.0)
    assert_equal_bits(loaded, x)


def test_normalizer_of_doubles(tmp_path):
    for norm in ("MAX", "L1"):
        assert_equal_bits(build.load(ml("Normalizer", 4, DOUBLE, norm=norm), tmp_path), rows(4))
    with pytest.raises(UnsupportedModelError, match="norm L2 of double numbers; cast the input to float"):
        build.load(ml("Normalizer", 4, DOUBLE, norm="L2"), tmp_path)


@pytest.mark.parametrize(("elem_type", "first_lost"), [(TensorProto.INT64, 2.0**24), (TensorProto.INT32, 46341.0)])
def test_normalizer_by_l2_of_integers_takes_those_whose_squares_are_the_same_in_float(tmp_path, elem_type, first_lost):
    loaded = build.load(ml("Normalizer", 3, elem_type, norm="L2"), tmp_path)
    signs, numbers = np.array([[1.0, -1.0, 1.0], [-1.0, 1.0, -1.0]]), np.array([first_lost, 5.0, 7.0])
    assert np.isnan(reference.evaluate(loaded.ir, signs * numbers)).all()
    assert_equal_bits(loaded, signs * (numbers - 1.0))


def test_linear_regressor(tmp_path):
    rng = np.random.default_rng(4)
    for targets in (1, 3):
        coefficients = rng.normal(size=3 * targets).tolist()
        for attributes in ({}, {"intercepts": rng.normal(size=targets).tolist()}):
            model = ml("LinearRegressor", 3, coefficients=coefficients, targets=targets, **attributes)
            loaded = build.load(model, tmp_path)
            assert loaded.ir.source.model_class == "LinearRegressor"
            assert_within_bound(loaded, rows(3))


KERNELS = {
    "LINEAR": [0.0, 0.0, 0.0],
    "RBF": [0.4, 0.0, 0.0],
    "POLY": [0.7, 0.5, 3.0],
    "SIGMOID": [0.2, -0.3, 0.0],
}


@pytest.mark.parametrize("kernel", KERNELS)
def test_svm_regressor(tmp_path, kernel):
    rng = np.random.default_rng(5)
    for degree in (2.0, 3.0, 4.0) if kernel == "POLY" else (0.0,):
        model = ml(
            "SVMRegressor",
            3,
            kernel_type=kernel,
            kernel_params=[*KERNELS[kernel][:2], degree],
            n_supports=20,
            support_vectors=rng.normal(size=60).tolist(),
            coefficients=rng.normal(size=20).tolist(),
            rho=[0.25],
        )
        loaded = build.load(model, tmp_path)
        assert loaded.ir.ops[-1].precision is Precision.FLOAT32
        assert_within_bound(loaded, rng.normal(size=(200, 3)))


@pytest.mark.parametrize("kernel", KERNELS)
def test_parameters_of_a_kernel_that_are_not_given_are_zero(tmp_path, kernel):
    vectors = {"n_supports": 2, "support_vectors": [1.0, 2.0, 3.0, 2.0, 1.0, 0.0], "coefficients": [0.5, 1.0]}
    model = ml("SVMRegressor", 3, kernel_type=kernel, rho=[0.25], **vectors)
    (node,) = model.graph.node
    node.attribute.append(helper.make_attribute("kernel_params", [], attr_type=AttributeProto.FLOATS))
    assert_within_bound(build.load(model, tmp_path), rows(3))


def test_svm_regressor_without_support_vectors_is_linear(tmp_path):
    model = ml("SVMRegressor", 3, kernel_type="RBF", kernel_params=[1.0, 0.0, 0.0], coefficients=ROW, rho=[0.5])
    loaded = build.load(model, tmp_path)
    assert isinstance(loaded.ir.ops[-1], Linear)
    assert_within_bound(loaded, rows(3))


def test_one_rounding_serves_all_readers_of_an_input(tmp_path):
    nodes = [helper.make_node("Neg", ["X"], ["a"]), helper.make_node("Add", ["a", "X"], ["Y"])]
    loaded = build.load(graph_model(nodes, [info("X", (None, 2))], [info("Y", None)]), tmp_path)
    assert sum(isinstance(op, Round) for op in loaded.ir.ops) == 1
    assert not any(isinstance(op, Select) for op in loaded.ir.ops)


def test_special_numbers_pass_scalers_on_their_way_to_trees(tmp_path):
    tree = build.regressor([build.Branch("LEQ", 0, 0.5, build.leaf(1.0), build.leaf(2.0), missing=True)])
    scaler = helper.make_node("Scaler", ["X0"], ["X"], domain="ai.onnx.ml", offset=[0.5], scale=[3.0])
    model = graph_model([scaler, *tree.graph.node], [info("X0", (None, 1))], tree.graph.output)
    loaded = build.load(model, tmp_path)
    assert loaded.ir.accepts_nan
    x = [[np.nan], [np.inf], [-np.inf], [1e39], [-1e39], [0.6], [0.7]]
    assert np.ravel(assert_equal_bits(loaded, x)).tolist() == [1.0, 2.0, 1.0, 2.0, 1.0, 1.0, 2.0]
    nodes = [*model.graph.node, helper.make_node("Tanh", ["Y"], ["Z"])]
    loaded = build.load(graph_model(nodes, [info("X0", (None, 1))], [info("Z", None)]), tmp_path)
    assert loaded.ir.accepts_nan
    nodes = [*model.graph.node, helper.make_node("Tanh", ["X"], ["Z"])]
    loaded = build.load(graph_model(nodes, [info("X0", (None, 1))], [info("Z", None), info("Y", None)]), tmp_path)
    assert not loaded.ir.accepts_nan


def test_special_numbers_that_reach_other_operators_or_the_output_are_refused(tmp_path):
    tree = build.regressor([build.leaf(1.0)]).graph.node[0]
    nodes = [
        tree,
        helper.make_node("Concat", ["Y", "X"], ["both"], axis=1),
        helper.make_node("Tanh", ["both"], ["Z"]),
    ]
    for kept, output in ((3, "Z"), (2, "both"), (1, "Y")):
        loaded = build.load(graph_model(nodes[:kept], [info("X", (None, 1))], [info(output, None)]), tmp_path)
        assert loaded.ir.accepts_nan == (output == "Y")
        assert set(loaded.ir.magnitude_limits) == {None if output == "Y" else FLOAT32_OVERFLOW}
    assert not build.load(ml("Scaler", 1, offset=[0.0], scale=[1.0]), tmp_path).ir.accepts_nan


def test_double_graphs_refuse_infinities_only(tmp_path):
    loaded = build.load(single("Tanh", 1, elem_type=DOUBLE), tmp_path)
    assert set(loaded.ir.magnitude_limits) == {np.inf}
    assert not loaded.ir.accepts_nan
    assert isinstance(loaded.ir.ops[0], Activation)


def test_opsets_are_those_of_the_schemas(tmp_path):
    """Every version of an operator that the installed onnx knows is walked from opset 7 on, but for Scan of opset 8.

    Of opset 28 onnxruntime 1.32 has no QuantizeLinear and DequantizeLinear to compare with.
    """
    import st_codegen.walkers.onnx.model  # noqa: F401 - with it all operators are there
    from st_codegen.walkers.onnx.graph import RULES

    legacy = {"Gemm": 6, "Add": 6, "Sub": 6, "Mul": 6, "Div": 6, "Dropout": 6, "Sum": 1, "Reshape": 1}
    legacy |= {"Clip": 1, "Tanh": 1, "Relu": 1, "Sigmoid": 1, "LeakyRelu": 1, "Elu": 1, "Exp": 1, "Neg": 1}
    legacy |= {"Cast": 1, "Concat": 1, "Max": 1, "Mean": 1, "Min": 1, "PRelu": 6}
    names = (
        "Abs And Ceil Equal Floor Greater HardSigmoid Less Log Or Pow Reciprocal Selu Split Sqrt Tile Xor LabelEncoder"
    )
    legacy |= dict.fromkeys(names.split(), 1)
    legacy |= {"Pad": 1, "LpPool": 1, "Upsample": 1, "InstanceNormalization": 1, "BatchNormalization": 6}
    legacy |= {"RNN": 1, "LSTM": 1, "GRU": 3, "Scan": 8}
    known: dict[tuple[str, str], set[int]] = {}
    for schema in onnx.defs.get_all_schemas_with_history():
        if not schema.deprecated and schema.since_version > legacy.get(schema.name, 0):
            known.setdefault((schema.domain, schema.name), set()).add(schema.since_version)
    for key, rule in RULES.items():
        if rule.schema is not None:  # onnxruntime's own
            continue
        assert known[key] - ({28} if key[1] in ("QuantizeLinear", "DequantizeLinear") else set()) <= rule.versions, key
        assert min(rule.versions) > legacy.get(key[1], 0), key


def test_an_output_without_a_type_has_the_one_that_is_computed(tmp_path):
    model = single("Relu")
    model.graph.output[0].ClearField("type")
    assert build.load(model, tmp_path).predict(np.array([[1.0, -2.0, 3.0]])).tolist() == [[1.0, 0.0, 3.0]]


#: Operators on numbers, the rest of a node, and the size of numbers whose results lie below the normal ones.
SMALL = {
    "Tanh": ("Tanh", 1e-38, []),
    "Exp": ("Exp", 90.0, []),
    "MatMul": ("MatMul", 1e-22, [constant("W", np.arange(9.0).reshape(3, 3) * 1e-22 / 7)]),
    "Gemm": ("Gemm", 1e-23, [constant("W", np.arange(9.0).reshape(3, 3) * 1e-22 / 7)]),
}


@pytest.mark.parametrize("name", SMALL)
def test_bounds_hold_below_the_normal_numbers(tmp_path, name):
    """A product that lies there keeps few digits in float32, or none, and ours has all of a double."""
    op_type, size, constants = SMALL[name]
    loaded = build.load(single(op_type, 3, constants), tmp_path)
    rng = np.random.default_rng(0)
    x = size * rng.normal(size=(400, 3)) * 10.0 ** rng.uniform(-6, 1, (400, 1))
    x = -size - 14 * rng.random((400, 3)) if op_type == "Exp" else x
    assert_within_bound(loaded, x)


def test_no_rows_have_no_answers(tmp_path):
    loaded = build.load(single("Tanh", 3), tmp_path)
    assert loaded.predict(np.zeros((0, 3))).shape == (0, 3)
