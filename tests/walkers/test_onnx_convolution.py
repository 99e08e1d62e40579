"""What slides over the columns of a row: convolutions, poolings, normalization, and matrices of several rows."""

from __future__ import annotations

import numpy as np
import pytest
from onnx import TensorProto, helper

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import Activation, Function, SlidingLinear, reference
from st_codegen.proof.bounds import difference_bound
from st_codegen.walkers.limits import set_features
from tests.classifiers import loaded as compiled
from tests.classifiers import verified
from tests.cli.helpers import run
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import constant, graph_model, info
from tests.walkers.test_onnx_elementwise import agree

pytestmark = pytest.mark.usefixtures("tried_in_place")

RNG = np.random.default_rng(7)


def one(op_type, shape, constants=(), opset=20, outputs=1, **attributes):
    """A node that reads X of a shape and constants."""
    names = ["X", *(tensor.name for tensor in constants)]
    node = helper.make_node(op_type, names, ["Y", "Z"][:outputs], name="the_node", **attributes)
    return graph_model([node], [info("X", shape)], [info("Y", None)], constants, opset)


def kernel(*shape):
    return constant("W", np.random.default_rng(len(shape)).normal(size=shape))


def rows(columns, n=60):
    rng = np.random.default_rng(columns)
    special = np.full((4, columns), [[np.nan], [np.inf], [1e30], [0.0]])
    return np.vstack([rng.normal(size=(n, columns)) * 10 ** rng.uniform(-3, 2, size=(n, 1)), special])


CONVOLUTIONS = {
    "one dimension": ((None, 2, 9), kernel(3, 2, 3), {}),
    "bias and strides": ((None, 2, 9), kernel(3, 2, 3), {"strides": [2], "bias": True}),
    "padding": ((None, 2, 9), kernel(3, 2, 3), {"pads": [1, 2]}),
    "dilations": ((None, 2, 9), kernel(3, 2, 3), {"dilations": [2], "pads": [2, 2]}),
    "groups": ((None, 4, 7), kernel(6, 2, 3), {"group": 2, "bias": True}),
    "each channel": ((None, 3, 7), kernel(3, 1, 2), {"group": 3}),
    "two dimensions": ((1, 2, 5, 4), kernel(3, 2, 3, 2), {"kernel_shape": [3, 2]}),
    "padding of two dimensions": ((1, 1, 4, 5), kernel(2, 1, 3, 2), {"pads": [1, 0, 2, 1], "strides": [2, 1]}),
    "same upper": ((None, 1, 8), kernel(2, 1, 3), {"auto_pad": "SAME_UPPER", "strides": [3]}),
    "same lower": ((None, 1, 4, 4), kernel(2, 1, 2, 2), {"auto_pad": "SAME_LOWER"}),
    "valid": ((None, 1, 8), kernel(2, 1, 3), {"auto_pad": "VALID"}),
}


@pytest.mark.parametrize("name", CONVOLUTIONS)
def test_convolutions(tmp_path, name):
    shape, weights, attributes = CONVOLUTIONS[name]
    attributes = dict(attributes)
    more = [constant("B", np.arange(weights.dims[0]) - 1.5)] if attributes.pop("bias", False) else []
    loaded = build.load(one("Conv", shape, [weights, *more], **attributes), tmp_path)
    bound = agree(loaded, rows(len(loaded.ir.features)))
    assert np.all(np.isfinite(bound)) and not loaded.ir.exact
    assert sum(isinstance(op, SlidingLinear) for op in loaded.ir.ops) == attributes.get("group", 1)


TRANSPOSED = {
    "one dimension": ((None, 2, 5), kernel(2, 3, 3), {}),
    "strides and padding": ((None, 2, 5), kernel(2, 3, 4), {"strides": [2], "pads": [1, 2], "bias": True}),
    "numbers added behind": ((None, 2, 5), kernel(2, 1, 3), {"strides": [3], "output_padding": [2]}),
    "dilations": ((None, 1, 4), kernel(1, 2, 3), {"dilations": [2], "strides": [3]}),
    "groups": ((None, 4, 5), kernel(4, 2, 2), {"group": 2, "bias": True, "strides": [2]}),
    "two dimensions": ((1, 2, 3, 4), kernel(2, 3, 3, 2), {"strides": [2, 3], "pads": [1, 0, 0, 1]}),
    "valid": ((None, 1, 4), kernel(1, 2, 3), {"auto_pad": "VALID", "strides": [2]}),
}


@pytest.mark.parametrize("name", TRANSPOSED)
def test_transposed_convolutions(tmp_path, name):
    shape, weights, attributes = TRANSPOSED[name]
    attributes = dict(attributes)
    outputs = weights.dims[1] * attributes.get("group", 1)
    more = [constant("B", np.arange(outputs) - 1.5)] if attributes.pop("bias", False) else []
    loaded = build.load(one("ConvTranspose", shape, [weights, *more], **attributes), tmp_path)
    assert np.all(np.isfinite(agree(loaded, rows(len(loaded.ir.features)))))


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"auto_pad": "SAME_UPPER", "strides": [2]}, "auto_pad, output_shape, or pads beyond the kernel"),
        ({"output_shape": [7]}, "auto_pad, output_shape, or pads beyond the kernel"),
        ({"pads": [3, 0]}, "auto_pad, output_shape, or pads beyond the kernel"),
        ({"group": 3}, r"a kernel of shape \(2, 3, 3\) in 3 groups for 2 channels"),
        ({"kernel_shape": [2]}, "kernel_shape"),
        ({"output_padding": [0, 1]}, "output_padding"),
        ({"output_padding": [-1]}, "output_padding"),
        ({"output_padding": [2**40]}, "output_padding"),
    ],
)
def test_transposed_convolutions_that_are_refused(tmp_path, attributes, message):
    with pytest.raises(InputError, match=message):
        build.load(one("ConvTranspose", (None, 2, 5), [kernel(2, 3, 3)], **attributes), tmp_path)


POOLINGS = {
    "MaxPool": {},
    "MaxPool strides": {"strides": [2, 1]},
    "MaxPool padding": {"pads": [1, 1, 0, 1], "strides": [2, 2]},
    "MaxPool same": {"auto_pad": "SAME_UPPER", "strides": [2, 2]},
    "MaxPool ceiling that cuts nothing": {"ceil_mode": 1},
    "AveragePool": {},
    "AveragePool padding": {"pads": [1, 1, 0, 1], "strides": [2, 2]},
    "AveragePool with the padding": {"pads": [1, 0, 1, 0], "count_include_pad": 1},
}


@pytest.mark.parametrize("name", POOLINGS)
def test_poolings(tmp_path, name):
    op_type = name.split()[0]
    loaded = build.load(one(op_type, (None, 2, 5, 4), kernel_shape=[3, 2], **POOLINGS[name]), tmp_path)
    agree(loaded, rows(40))
    assert loaded.ir.exact == (op_type == "MaxPool")


@pytest.mark.parametrize("op_type", ["AveragePool", "MaxPool"])
def test_poolings_with_dilations_that_are_padded_by_themselves_are_refused(tmp_path, op_type):
    """onnxruntime pads for a kernel without dilations: it gives less than the standard says."""
    options = {"kernel_shape": [1, 2], "dilations": [2, 2], "opset": 22}
    with pytest.raises(UnsupportedModelError, match=r"auto_pad with dilations \[2, 2\]; export the model with pads"):
        build.load(one(op_type, (None, 1, 6, 7), auto_pad="SAME_UPPER", **options), tmp_path)
    agree(build.load(one(op_type, (None, 1, 6, 7), pads=[0, 1, 0, 1], **options), tmp_path), rows(42))


@pytest.mark.parametrize("op_type", ["GlobalAveragePool", "GlobalMaxPool"])
@pytest.mark.parametrize("shape", [(None, 3, 6), (None, 2, 3, 3)])
def test_poolings_of_all(tmp_path, op_type, shape):
    loaded = build.load(one(op_type, shape), tmp_path)
    agree(loaded, rows(len(loaded.ir.features)))
    assert len(loaded.ir.outputs) == shape[1]


@pytest.mark.parametrize("shape", [(None, 3), (None, 3, 4), (None, 3, 2, 2)])
def test_normalization_of_a_batch(tmp_path, shape):
    numbers = [[0.5, -2.0, 0.0], [1.0, 0.25, -3.0], [10.0, -4.0, 0.5], [2.0, 0.125, 1e-12]]
    given = [constant(name, column) for name, column in zip("SBMV", numbers, strict=True)]
    loaded = build.load(one("BatchNormalization", shape, given, opset=15, epsilon=1e-3), tmp_path)
    bound = agree(loaded, rows(len(loaded.ir.features)))
    assert not loaded.ir.exact and np.all(np.isfinite(bound))


def test_normalization_of_several_rows(tmp_path):
    given = [constant("S", [0.5, 1.0, -2.0, 1.0]), constant("B", [0.0, 1.0, 2.0, -1.0])]
    loaded = build.load(one("LayerNormalization", (None, 3, 4), given, axis=-1), tmp_path)
    agree(loaded, np.random.default_rng(1).normal(size=(100, 12)))


MATRICES = {
    "rows times weights": lambda x: (["X", "W"], (None, 3, 4), (4, 2)),
    "rows times a vector": lambda x: (["X", "W"], (None, 3, 4), (4,)),
    "weights times rows": lambda x: (["W", "X"], (None, 4, 3), (2, 4)),
    "a vector times rows": lambda x: (["W", "X"], (None, 4, 3), (4,)),
    "weights times one row": lambda x: (["W", "X"], (None, 4, 1), (2, 4)),
}


@pytest.mark.parametrize("name", MATRICES)
def test_matrices_of_several_rows(tmp_path, name):
    names, shape, weights = MATRICES[name](None)
    node = helper.make_node("MatMul", names, ["Y"])
    model = graph_model([node], [info("X", shape)], [info("Y", None)], [kernel(*weights)])
    loaded = build.load(model, tmp_path)
    agree(loaded, rows(len(loaded.ir.features)))
    x = np.random.default_rng(2).normal(size=(3, len(loaded.ir.features)))
    assert np.all(np.abs(loaded.predict(x) - reference.evaluate(loaded.ir, x)) <= difference_bound(loaded.ir, x))


def test_gemm_of_several_rows(tmp_path):
    nodes = [
        helper.make_node("Reshape", ["X", "to"], ["R"]),
        helper.make_node("Gemm", ["R", "W", "B"], ["Y"], alpha=2.0, transB=1),
    ]
    given = [constant("to", [-1, 4], np.int64), kernel(3, 4), constant("B", [1.0, 2.0, 3.0])]
    agree(build.load(graph_model(nodes, [info("X", (None, 8))], [info("Y", None)], given), tmp_path), rows(8))


def network():
    """As frameworks write them: Conv, BatchNormalization, Relu, MaxPool, Conv, a mean of all, Flatten, Gemm."""
    rng = np.random.default_rng(3)
    given = [
        constant("W1", rng.normal(size=(4, 1, 5))),
        constant("B1", rng.normal(size=4)),
        *(constant(name, np.abs(rng.normal(size=4)) + 0.1) for name in "SBMV"),
        constant("W2", rng.normal(size=(3, 4, 3))),
        constant("W3", rng.normal(size=(2, 3))),
        constant("B3", rng.normal(size=2)),
    ]
    nodes = [
        helper.make_node("Conv", ["X", "W1", "B1"], ["c1"], pads=[2, 2], kernel_shape=[5]),
        helper.make_node("BatchNormalization", ["c1", "S", "B", "M", "V"], ["n1"]),
        helper.make_node("Relu", ["n1"], ["r1"]),
        helper.make_node("MaxPool", ["r1"], ["p1"], kernel_shape=[2], strides=[2]),
        helper.make_node("Conv", ["p1", "W2"], ["c2"]),
        helper.make_node("Tanh", ["c2"], ["t2"]),
        helper.make_node("GlobalAveragePool", ["t2"], ["g"]),
        helper.make_node("Flatten", ["g"], ["f"]),
        helper.make_node("Gemm", ["f", "W3", "B3"], ["l"], transB=1),
        helper.make_node("Softmax", ["l"], ["Y"], axis=1),
    ]
    return graph_model(nodes, [info("X", ("batch", 1, 16))], [info("Y", None)], given)


def test_a_network_is_verified_and_small(tmp_path):
    loaded = build.load(network(), tmp_path)
    assert verified(compiled(loaded), tmp_path / "out", "iec", rows=200).passed
    code = max((tmp_path / "out").rglob("*.st"), key=lambda path: path.stat().st_size).read_text()
    assert code.count("\n") < 700


REFUSED = {
    "three dimensions": (lambda: one("Conv", (None, 1, 3, 3, 3), [kernel(1, 1, 2, 2, 2)]), "tensor of shape"),
    "a kernel that does not fit": (lambda: one("Conv", (None, 1, 2), [kernel(1, 1, 3)]), "does not fit"),
    "ceiling": (lambda: one("MaxPool", (None, 1, 6), kernel_shape=[3], strides=[2], ceil_mode=1), "ceil_mode"),
    "positions of maxima": (lambda: one("MaxPool", (None, 1, 6), kernel_shape=[3], outputs=2), "second output"),
    "padding beyond all tensors": (
        lambda: one("Conv", (None, 1, 9), [kernel(1, 1, 3)], pads=[2**16 + 1, 0]),
        "the model file is damaged",
    ),
    "channels": (lambda: one("Conv", (None, 2, 9), [kernel(1, 3, 3)]), "for 2 channels"),
    "a dimension that is open": (lambda: one("Conv", (None, 2, None), [kernel(1, 2, 3)]), "say --features N"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals(tmp_path, name):
    make, message = REFUSED[name]
    with pytest.raises((InputError, UnsupportedModelError), match=message):
        build.load(make(), tmp_path)


def test_an_open_number_of_columns_is_stated(tmp_path):
    model = one("Conv", (None, 2, None), [kernel(1, 2, 3)])
    try:
        set_features(12)
        agree(build.load(model, tmp_path), rows(12))
        set_features(11)
        with pytest.raises(InputError, match="takes a multiple of 2"):
            build.load(model, tmp_path)
        # of one input with a fixed shape it is known already
        assert len(build.load(one("Conv", (None, 2, 6), [kernel(1, 2, 3)]), tmp_path).ir.features) == 12
    finally:
        set_features(None)


def test_the_build_table_states_an_open_number_of_columns(tmp_path):
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "c.onnx").write_bytes(one("Conv", (None, 2, None), [kernel(1, 2, 3)]).SerializeToString())
    wanted = (tmp_path / "m", "--target", "iec", "-q", "--out", tmp_path / "out")
    try:
        assert run(*wanted) == 2
        (tmp_path / "m" / "st-codegen.toml").write_text("[build]\nfeatures = 12\n")
        assert run(*wanted) == 0
        assert run("verify", tmp_path / "m", "-g", tmp_path / "out", "-n", 50, "-q") == 0
    finally:
        set_features(None)


def test_numbers_that_are_encoded(tmp_path):
    node = helper.make_node(
        "LabelEncoder", ["X"], ["Y"], domain="ai.onnx.ml", name="the_node",
        keys_floats=[2.0, 0.5, 2.0], values_floats=[10.0, 20.0, 30.0], default_float=-1.0,
    )  # fmt: skip
    loaded = build.load(graph_model([node], [info("X", (None, 2))], [info("Y", None)]), tmp_path)
    x = np.array([[2.0, 0.5], [0.5, 7.0], [2.000001, 1e30], [2.00000001, -0.5], [np.nan, 2.0]])
    assert not np.any(agree(loaded, x))
    np.testing.assert_array_equal(reference.evaluate(loaded.ir, x)[:4], [[10, 20], [20, -1], [-1, -1], [10, -1]])


LINES = {
    "twice": ((None, 2, 4), [1, 1, 2], {}),
    "half": ((None, 2, 8), [1, 1, 0.5], {}),
    "an image": ((None, 2, 4, 3), [1, 1, 2, 3], {}),
    "other numbers": ((None, 1, 4, 5), [1, 1, 1.5, 0.75], {"coordinate_transformation_mode": "pytorch_half_pixel"}),
    "corners": ((None, 1, 4, 5), [1, 1, 2, 1.6], {"coordinate_transformation_mode": "align_corners"}),
    "from the corner": ((None, 1, 4, 5), [1, 1, 2.5, 1], {"coordinate_transformation_mode": "asymmetric"}),
}


@pytest.mark.parametrize("name", LINES)
def test_numbers_on_the_line_between_two(tmp_path, name):
    shape, scales, options = LINES[name]
    node = helper.make_node("Resize", ["X", "", "S"], ["Y"], mode="linear", **options)
    given = [info("X", shape)], [info("Y", None)], [constant("S", scales)]
    loaded = build.load(graph_model([node], *given, opset=18), tmp_path)
    agree(loaded, rows(int(np.prod(shape[1:]))))
    verified(compiled(loaded), tmp_path / "text", rows=100)


@pytest.mark.parametrize("mode", ["nearest", "linear"])
@pytest.mark.parametrize("opset", [8, 9])
def test_upsample_of_older_files(tmp_path, mode, opset):
    scales = [1.0, 1.0, 2.0, 2.0]
    names, options = (["X"], {"scales": scales}) if opset == 8 else (["X", "S"], {})
    node = helper.make_node("Upsample", names, ["Y"], mode=mode, **options)
    constants = [] if opset == 8 else [constant("S", scales)]
    given = [info("X", (None, 2, 3, 3))], [info("Y", None)], constants
    loaded = build.load(graph_model([node], *given, opset=opset), tmp_path)
    assert loaded.ir.exact == (mode == "nearest")
    agree(loaded, rows(18))


def test_sizes_that_a_graph_computes_of_the_shape(tmp_path):
    """As older exporters of PyTorch write an interpolation by a factor."""
    nodes = [
        helper.make_node("Shape", ["X"], ["shape"]),
        helper.make_node("Slice", ["shape", "two", "four"], ["lengths"]),
        helper.make_node("Slice", ["shape", "zero", "two"], ["before"]),
        helper.make_node("Cast", ["lengths"], ["number"], to=TensorProto.FLOAT),
        helper.make_node("Mul", ["number", "factor"], ["product"]),
        helper.make_node("Floor", ["product"], ["floor"]),
        helper.make_node("Cast", ["floor"], ["whole"], to=TensorProto.INT64),
        helper.make_node("Concat", ["before", "whole"], ["sizes"], axis=0),
        helper.make_node("Resize", ["X", "", "", "sizes"], ["Y"], mode="linear"),
    ]
    constants = [constant(name, [at], np.int64) for name, at in (("zero", 0), ("two", 2), ("four", 4))]
    constants.append(constant("factor", [2.5]))
    loaded = build.load(graph_model(nodes, [info("X", (1, 1, 3, 3))], [info("Y", None)], constants), tmp_path)
    assert len(loaded.ir.outputs) == 49
    agree(loaded, rows(9))


@pytest.mark.parametrize("number", [np.nan, 3e9])
def test_constants_that_are_no_integers_are_not_cast(tmp_path, number):
    nodes = [
        helper.make_node("Cast", ["n"], ["i"], to=TensorProto.INT32),
        helper.make_node("Gather", ["X", "i"], ["Y"], axis=1),
    ]
    with pytest.raises(UnsupportedModelError, match="casts constants to int32 that do not fit"):
        build.load(graph_model(nodes, [info("X", (1, 3))], [info("Y", None)], [constant("n", [number])]), tmp_path)


@pytest.mark.parametrize("power", [1, 2, 3])
@pytest.mark.parametrize(
    ("shape", "options"),
    [
        ((None, 2, 6), {"kernel_shape": [2]}),
        ((None, 1, 4, 4), {"kernel_shape": [2, 3], "pads": [1, 0, 0, 1], "strides": [2, 1]}),
    ],
)
def test_norms_of_windows(tmp_path, shape, options, power):
    loaded = build.load(one("LpPool", shape, p=power, **options), tmp_path)
    x = rows(int(np.prod(shape[1:])))
    agree(loaded, x[np.all(np.abs(x) < 1e6, axis=1)])
    # the root is a power of a reciprocal in float32
    powers = [op.parameter for op in loaded.ir.ops if isinstance(op, Activation) and op.function is Function.POWER]
    assert powers[-1:] == [float(np.float32(1.0) / np.float32(power))][: power - 1]


@pytest.mark.parametrize("opset", [18, 21])
def test_normalization_of_groups(tmp_path, opset):
    rng = np.random.default_rng(3)
    count = 2 if opset == 18 else 4  # the older version scales groups, the newer one channels
    constants = [constant(name, rng.normal(size=count)) for name in ("S", "Mean")]
    node = helper.make_node("GroupNormalization", ["X", "S", "Mean"], ["Y"], num_groups=2, epsilon=0.01)
    given = [info("X", (None, 4, 3))], [info("Y", None)], constants
    loaded = build.load(graph_model([node], *given, opset=opset), tmp_path)
    x = rng.normal(size=(60, 12)) * 3
    assert np.all(np.isfinite(agree(loaded, x)))
    verified(compiled(loaded), tmp_path / "text", rows=100)
