"""Networks of small integers are equal to onnxruntime's own to the bit, or within a bound that is 0 away from ties."""

from __future__ import annotations

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from onnxruntime import quantization

from st_codegen.errors import UnsupportedModelError
from st_codegen.ir import reference
from tests.classifiers import loaded as compiled
from tests.classifiers import verified
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import FLOAT, INT64, constant, graph_model, info, single
from tests.walkers.test_onnx_elementwise import agree, rows

pytestmark = pytest.mark.usefixtures("tried_in_place")

TYPES = (np.uint8, np.int8, np.uint16, np.int16)


def ties(scale):
    """Halves of a scale and their neighbours, as float has them."""
    near = ((np.arange(-300, 300) + 0.5) * scale).astype(np.float32)
    ends = [np.nextafter(near, np.float32(end)) for end in (np.inf, -np.inf)]
    return np.concatenate([near, *ends]).astype(np.float64)[:, None].repeat(3, axis=1)


def quantizing(kind, zero, scale, *behind, **attributes):
    """X quantized to q, and nodes that read it; constants s and z."""
    nodes = [helper.make_node("QuantizeLinear", ["X", "s", "z"], ["q"], **attributes), *behind]
    return nodes, [constant("s", scale), constant("z", zero, kind)]


@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("scale", [0.25, 0.05, [0.05, 0.5, 2.0]])
def test_numbers_quantized_and_back(tmp_path, kind, scale):
    lists = isinstance(scale, list)
    back = helper.make_node("DequantizeLinear", ["q", "s", "z"], ["Y"])
    nodes, constants = quantizing(kind, [3, 0, 100] if lists else 3, scale, back)
    outputs = [info("Y", None), info("q", None, helper.np_dtype_to_tensor_dtype(np.dtype(kind)))]
    loaded = build.load(graph_model(nodes, [info("X", (None, 3))], outputs, constants, opset=21), tmp_path)
    x = np.vstack([rows(np.random.default_rng(0)), ties(0.25), ties(0.05)])
    assert not agree(loaded, x).any()
    assert loaded.ir.exact and not loaded.ir.accepts_nan
    if kind is np.uint8:
        assert verified(compiled(loaded), tmp_path / "text", rows=300).exact


def test_weights_are_quantized_and_back_when_compiled(tmp_path):
    """As frameworks write what was trained with rounded weights."""
    weights = np.random.default_rng(1).normal(size=(3, 4)).astype(np.float32)
    constants = [constant("W", weights), constant("s", [0.01, 0.02, 0.03, 0.04]), constant("z", [0, 0, 0, 0], np.int8)]
    nodes = [
        helper.make_node("QuantizeLinear", ["W", "s", "z"], ["q"], axis=1),
        helper.make_node("DequantizeLinear", ["q", "s", "z"], ["D"], axis=1),
        helper.make_node("MatMul", ["X", "D"], ["Y"]),
    ]
    loaded = build.load(graph_model(nodes, [info("X", (None, 3))], [info("Y", None)], constants), tmp_path)
    assert len(loaded.ir.ops) == 2
    build.assert_within_bound(loaded, build.rows(3))


PRODUCTS = [(a, b, largest) for a in (np.uint8, np.int8) for b, largest in ((np.int8, 64), (np.uint8, 255))]


def product(kind, weights, after):
    """X quantized, multiplied by integers in one of two ways, and the numbers of that."""
    nodes, constants = quantizing(kind, 7, 0.05)
    constants += [constant("B", weights, weights.dtype), constant("bz", [1, 2, 3, 4], weights.dtype)]
    if after == "MatMulInteger":
        nodes.append(helper.make_node(after, ["q", "B", "z", "bz"], ["i"]))
        nodes.append(helper.make_node("Cast", ["i"], ["Y"], to=FLOAT))
    else:
        constants += [constant("bs", [0.01, 0.02, 0.03, 0.04]), constant("ys", 0.07), constant("yz", 5, kind)]
        nodes.append(helper.make_node(after, ["q", "s", "z", "B", "bs", "bz", "ys", "yz"], ["i"]))
        nodes.append(helper.make_node("DequantizeLinear", ["i", "ys", "yz"], ["Y"]))
    return graph_model(nodes, [info("X", (None, 3))], [info("Y", None)], constants, opset=13)


@pytest.mark.parametrize("after", ["MatMulInteger", "QLinearMatMul"])
@pytest.mark.parametrize(("kind", "other", "largest"), PRODUCTS)
def test_sums_of_products_of_integers(tmp_path, kind, other, largest, after):
    if (kind, other, after) == (np.int8, np.uint8, "QLinearMatMul"):
        return  # onnxruntime has none
    rng = np.random.default_rng(2)
    weights = rng.integers(-largest if other is np.int8 else 0, largest + 1, (3, 4)).astype(other)
    loaded = build.load(product(kind, weights, after), tmp_path)
    assert loaded.ir.exact
    assert not agree(loaded, np.vstack([rows(rng), ties(0.05)])).any()
    assert verified(compiled(loaded), tmp_path / "text", rows=300).exact


@pytest.mark.parametrize("after", ["MatMulInteger", "QLinearMatMul"])
@pytest.mark.parametrize("sign", [1, -1])
def test_products_of_which_machines_keep_other_digits_are_refused(tmp_path, after, sign):
    """255 times two weights fits 16 bits up to a sum of 128."""
    taken, refused = np.zeros((3, 4), np.int8), np.zeros((3, 4), np.int8)
    taken[:, 1], refused[:2, 3] = [64 * sign, 64 * sign, -64 * sign], [64 * sign, 65 * sign]
    build.load(product(np.uint8, taken, after), tmp_path)
    with pytest.raises(UnsupportedModelError, match=r"signed weights beyond 64.*weight_type=QUInt8 or reduce_range"):
        build.load(product(np.uint8, refused, after), tmp_path)


def test_scale_and_zero_point_of_each_row(tmp_path):
    nodes = [
        helper.make_node("DynamicQuantizeLinear", ["X"], ["q", "s", "z"]),
        *(helper.make_node("Cast", [name], [f"{name}f"], to=FLOAT) for name in "qz"),
        *(helper.make_node("Reshape", [name, "one"], [f"{name}1"]) for name in ("s", "zf")),
        helper.make_node("Concat", ["qf", "s1", "zf1"], ["Y"], axis=1),
    ]
    model = graph_model(nodes, [info("X", (1, 3))], [info("Y", None)], [constant("one", [1, 1], np.int64)])
    loaded = build.load(model, tmp_path)
    assert loaded.ir.exact
    x = rows(np.random.default_rng(3))
    largest = np.max(np.abs(x), axis=1)
    x = x[~(largest < 1e-40) | (largest == 0.0)]  # of the others float has no scale
    assert np.isnan(reference.evaluate(loaded.ir, np.array([[1e-44, 0.0, 0.0]]))).any()
    for given in (x, np.abs(x), -np.abs(x), np.zeros((1, 3)), np.vstack([x, np.round(x * 2) / 8])):
        assert not agree(loaded, given).any()
    assert verified(compiled(loaded), tmp_path / "text", rows=300).exact


class _Rows(quantization.CalibrationDataReader):
    def __init__(self, x):
        self.rows = iter([{"X": row[None].astype(np.float32)} for row in x])

    def get_next(self):
        return next(self.rows, None)


def network(tmp_path):
    rng = np.random.default_rng(4)
    shapes = {"K": (4, 1, 3), "k": (4,), "W": (56, 8), "b": (8,), "V": (8, 2), "c": (2,)}
    constants = [constant(name, rng.normal(size=shape) / 3) for name, shape in shapes.items()]
    nodes = [
        helper.make_node("Reshape", ["X", "shape"], ["R"]),
        helper.make_node("Conv", ["R", "K", "k"], ["C"], kernel_shape=[3]),
        helper.make_node("Relu", ["C"], ["A"]),
        helper.make_node("Flatten", ["A"], ["F"]),
        helper.make_node("Gemm", ["F", "W", "b"], ["G"]),
        helper.make_node("Relu", ["G"], ["H"]),
        helper.make_node("Gemm", ["H", "V", "c"], ["Y"]),
    ]
    constants.append(constant("shape", [-1, 1, 16], np.int64))
    model = graph_model(nodes, [info("X", (1, 16))], [info("Y", (1, 2))], constants, opset=13)
    model.ir_version = 8
    onnx.save(model, tmp_path / "float.onnx")
    return rng


U8, S8, U16 = quantization.QuantType.QUInt8, quantization.QuantType.QInt8, quantization.QuantType.QUInt16
STATIC = {
    "as it is": {},
    "a scale for each channel": {"per_channel": True},
    "unsigned": {"weight_type": U8, "activation_type": U8},
    "16 bits": {"activation_type": U16},
}


@pytest.mark.parametrize("name", STATIC)
def test_networks_as_onnxruntime_quantizes_them(tmp_path, name):
    rng = network(tmp_path)
    found = tmp_path / "small.onnx"
    quantization.quantize_static(tmp_path / "float.onnx", found, _Rows(rng.normal(size=(50, 16))), **STATIC[name])
    loaded = build.load(onnx.load(found), tmp_path)
    x = rng.normal(size=(400, 16))
    bound = agree(loaded, x)
    assert np.all(np.isfinite(bound)) and (name == "16 bits" or np.mean(bound == 0.0) > 0.8)
    if name == "unsigned":
        assert verified(compiled(loaded), tmp_path / "text", rows=100).passed


@pytest.mark.parametrize("options", [{"weight_type": U8}, {"weight_type": S8, "reduce_range": True}])
def test_networks_quantized_anew_for_each_row(tmp_path, options):
    rng = network(tmp_path)
    found = tmp_path / "small.onnx"
    only = {"op_types_to_quantize": ["MatMul", "Gemm"]}
    quantization.quantize_dynamic(tmp_path / "float.onnx", found, **options, **only)
    kinds = {node.op_type for node in onnx.load(found).graph.node}
    assert {"DynamicQuantizeLinear", "MatMulInteger"} <= kinds
    loaded = build.load(onnx.load(found), tmp_path)
    bound = agree(loaded, rng.normal(size=(400, 16)))
    assert np.mean(np.isfinite(bound)) > 0.8  # a row of which all numbers may be 0 may have any scale


@pytest.mark.parametrize("weight_type", [U8, S8])
def test_convolutions_of_integers_as_onnxruntime_quantizes_them(tmp_path, weight_type):
    """QLinearConv where the ranges are known, else ConvInteger."""
    rng = network(tmp_path)
    found, only = tmp_path / "small.onnx", {"op_types_to_quantize": ["Conv"], "weight_type": weight_type}
    if weight_type is U8:
        quantization.quantize_dynamic(tmp_path / "float.onnx", found, **only)
    else:
        only |= {"quant_format": quantization.QuantFormat.QOperator, "per_channel": True, "reduce_range": True}
        quantization.quantize_static(tmp_path / "float.onnx", found, _Rows(rng.normal(size=(50, 16))), **only)
    kinds = {node.op_type for node in onnx.load(found).graph.node}
    assert kinds & {"QLinearConv", "ConvInteger"} == ({"ConvInteger"} if weight_type is U8 else {"QLinearConv"})
    loaded = build.load(onnx.load(found), tmp_path)
    bound = agree(loaded, rng.normal(size=(400, 16)))
    assert np.mean(np.isfinite(bound)) > 0.8
    assert verified(compiled(loaded), tmp_path / "text", rows=100).passed


CONVOLUTIONS = {
    "plain": ((1, 2, 6), (3, 2, 3), {}),
    "padded, in groups": ((1, 4, 5), (4, 2, 3), {"group": 2, "pads": [1, 2], "strides": [2]}),
    "an image": ((1, 2, 4, 3), (3, 2, 2, 2), {"pads": [1, 0, 1, 1]}),
}


@pytest.mark.parametrize("name", CONVOLUTIONS)
@pytest.mark.parametrize("kind", [np.uint8, np.int8])
def test_convolutions_of_integers(tmp_path, name, kind):
    shape, weights, attributes = CONVOLUTIONS[name]
    rng = np.random.default_rng(5)
    other = np.uint8 if kind is np.uint8 else np.int8
    numbers = rng.integers(0, 256, weights) if other is np.uint8 else rng.integers(-64, 65, weights)
    nodes, constants = quantizing(kind, 7, 0.05)
    constants += [constant("B", numbers, other), constant("bz", 3 if other is np.uint8 else 0, other)]
    outputs = weights[0]
    constants += [constant("bs", np.linspace(0.01, 0.04, outputs)), constant("ys", 0.37), constant("yz", 5, kind)]
    constants.append(constant("c", rng.integers(-5000, 5000, outputs), np.int32))
    names = ["q", "s", "z", "B", "bs", "bz", "ys", "yz", "c"]
    nodes.append(helper.make_node("QLinearConv", names, ["i"], **attributes))
    nodes.append(helper.make_node("DequantizeLinear", ["i", "ys", "yz"], ["Y"]))
    results = [info("Y", None)]
    if kind is np.uint8:
        nodes.append(helper.make_node("ConvInteger", ["q", "B", "z", "bz"], ["j"], **attributes))
        nodes.append(helper.make_node("Cast", ["j"], ["Z"], to=FLOAT))
        results.append(info("Z", None))
    loaded = build.load(graph_model(nodes, [info("X", shape)], results, constants, opset=13), tmp_path)
    assert loaded.ir.exact
    size = int(np.prod(shape))
    near = np.resize(ties(0.05), (150, size))
    assert not agree(loaded, np.vstack([rows(rng, size), near])).any()
    assert verified(compiled(loaded), tmp_path / "text", rows=200).exact


def test_convolutions_of_which_machines_keep_other_digits_are_refused(tmp_path):
    nodes, constants = quantizing(np.uint8, 7, 0.05)
    constants.append(constant("B", [[[100, 100, 0]]], np.int8))
    nodes += [helper.make_node("ConvInteger", ["q", "B", "z"], ["j"]), helper.make_node("Cast", ["j"], ["Y"], to=FLOAT)]
    with pytest.raises(UnsupportedModelError, match="signed weights beyond 64"):
        build.load(graph_model(nodes, [info("X", (1, 1, 6))], [info("Y", None)], constants, opset=13), tmp_path)


REFUSED = {
    "a scale of float16": ([constant("s", 0.1, np.float16), constant("z", 0, np.uint8)], "a scale of float16"),
    "a scale of 0": ([constant("s", 0.0), constant("z", 0, np.uint8)], "a scale that is not above 0"),
    "integers of 32 bits": ([constant("s", 0.1), constant("z", 0, np.int32)], "integers of 8 and 16 bits"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_quantized(tmp_path, name):
    constants, message = REFUSED[name]
    with pytest.raises(UnsupportedModelError, match=message):
        build.load(single("QuantizeLinear", 3, constants, out_type=TensorProto.UINT8, opset=21), tmp_path)


def test_rows_of_a_batch_that_share_a_scale_are_refused(tmp_path):
    nodes = [
        helper.make_node("DynamicQuantizeLinear", ["X"], ["q", "s", "z"]),
        helper.make_node("Cast", ["q"], ["i"], to=INT64),
        helper.make_node("Cast", ["i"], ["Y"], to=FLOAT),
    ]
    with pytest.raises(Exception, match=r"DynamicQuantizeLinear.*export with a batch dimension of 1"):
        build.load(graph_model(nodes, [info("X", (None, 3))], [info("Y", None)]), tmp_path)


def test_a_zero_point_and_integers_alone_give_no_rows_that_differ(tmp_path):
    """What is as large as float allows is limited like any other number."""
    nodes, constants = quantizing(np.int8, 0, 1e-3, helper.make_node("Cast", ["q"], ["Y"], to=FLOAT))
    loaded = build.load(graph_model(nodes, [info("X", (None, 1))], [info("Y", None)], constants), tmp_path)
    x = np.array([[3e38], [-3e38], [1e30], [0.0], [-0.0]])
    np.testing.assert_array_equal(reference.evaluate(loaded.ir, x), loaded.predict(x))
