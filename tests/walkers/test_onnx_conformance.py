"""The conformance cases that the onnx package ships: every operator that is walked computes what the standard says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper, numpy_helper

from st_codegen.errors import InputError, UnsupportedModelError
from st_codegen.ir import reference
from st_codegen.walkers.onnx import classifiers, ml  # noqa: F401  (these register operators)
from st_codegen.walkers.onnx import outputs as ends  # noqa: F401
from st_codegen.walkers.onnx.graph import RULES
from st_codegen.walkers.onnx.load import load_file
from tests.walkers import onnx_builders as build

DATA = Path(onnx.__file__).parent / "backend" / "test" / "data" / "node"
pytestmark = [
    pytest.mark.skipif(not DATA.is_dir(), reason="the onnx package is installed without its test data"),
    pytest.mark.usefixtures("tried_in_place"),
]

_NAMES = "add sub mul div sum gemm matmul tanh relu sigmoid leakyrelu elu softplus exp neg clip reduce_mean reduce_sum"
_NAMES += " identity reshape flatten squeeze unsqueeze transpose concat gather cast constant dropout_default shape"
_NAMES += " abs sqrt log erf gelu reciprocal softsign celu selu hardsigmoid hardswish prelu pow max min reduce_max"
_NAMES += " reduce_min reduce_l1 reduce_l2 reduce_sum_square reduce_log_sum_exp layer_normalization slice split expand"
_NAMES += " gather_elements softmax logsoftmax conv_ basic_conv maxpool averagepool globalaveragepool globalmaxpool"
_NAMES += " batchnorm ceil floor round hardmax shrink tan rms_normalization depthtospace spacetodepth compress gathernd"
_NAMES += " reversesequence acos asin atan cosh sinh group_normalization lppool upsample scatter"
PREFIXES = tuple(f"test_{name}" for name in _NAMES.split())
#: What the walker turns down: batches and stacks of matrices, integers, sequences, strings, random numbers,
#: a norm whose mean is an output.
REFUSED_ONLY = {"Gemm", "Dropout", "Shape", "Constant", "ConstantOfShape", "LayerNormalization", "MatMulInteger"}


def cases():
    if not DATA.is_dir():
        return []
    found = []
    for folder in sorted(DATA.iterdir()):
        if folder.name.startswith(PREFIXES) and not folder.name.endswith("_expanded"):
            model = onnx.load(folder / "model.onnx")
            if len(model.graph.node) == 1 and ("", model.graph.node[0].op_type) in RULES:
                found.append(folder.name)
    return found


def tensors(folder, kind):
    paths = sorted(folder.glob(f"{kind}_*.pb"), key=lambda path: int(path.stem.split("_")[1]))
    return [numpy_helper.to_array(onnx.TensorProto.FromString(path.read_bytes())) for path in paths]


def as_one_row(model, inputs):
    """The model of a case for one row: its computed inputs cut from rows, all others as constants."""
    node = model.graph.node[0]
    n_computed = len(inputs) if node.op_type in ("Add", "Sub", "Mul", "Div", "Sum", "Concat") else 1
    constants, rows, nodes = [], [], []
    for number, (value, array) in enumerate(zip(model.graph.input, inputs, strict=True)):
        if number >= n_computed:
            constants.append(numpy_helper.from_array(array, value.name))
            continue
        constants.append(build.constant(f"shape{number}", array.shape, np.int64))
        rows.append(build.info(f"row{number}", (1, array.size), build.ELEM_TYPES[array.dtype]))
        nodes.append(helper.make_node("Reshape", [f"row{number}", f"shape{number}"], [value.name]))
    outputs = [build.info(value.name, None, value.type.tensor_type.elem_type) for value in model.graph.output]
    graph = helper.make_graph([*nodes, node], "case", rows, outputs, constants)
    opset = helper.make_opsetid("", model.opset_import[0].version)
    row = np.concatenate([np.ravel(array) for array in inputs[:n_computed]])
    return helper.make_model(graph, opset_imports=[opset], ir_version=model.ir_version), row


def run(name, tmp_path):
    """None where a case is out of scope, else whether the walker's numbers are those of the case."""
    folder = DATA / name
    model = onnx.load(folder / "model.onnx")
    data = folder / "test_data_set_0"
    try:
        inputs, outputs = tensors(data, "input"), tensors(data, "output")
    except Exception:  # sequences and optionals are no tensors
        return None
    if not inputs or inputs[0].dtype not in build.ELEM_TYPES or any(array.size == 0 for array in inputs[:1]):
        return None
    one_row, row = as_one_row(model, inputs)
    try:
        loaded = build.load(one_row, tmp_path)
    except UnsupportedModelError:
        return None
    ours = reference.trace(loaded.ir, row[None, :].astype(np.float64))[-1]
    expected = np.concatenate([np.ravel(output) for output in outputs]).astype(np.float64)
    if loaded.ir.classes is not None:  # what ends in Softmax is a classifier: its class stands before the scores
        ours = ours[:, 1:]
    return np.allclose(ours[0], expected, rtol=1e-5, atol=1e-6, equal_nan=True)


@pytest.mark.thorough
def test_cases_of_the_standard(tmp_path):
    results = {name: run(name, tmp_path) for name in cases()}
    assert [name for name, equal in results.items() if equal is False] == []
    walked = {onnx.load(DATA / name / "model.onnx").graph.node[0].op_type for name, equal in results.items() if equal}
    given = {onnx.load(DATA / name / "model.onnx").graph.node[0].op_type for name in results}
    assert given - walked <= REFUSED_ONLY
    assert sum(equal is True for equal in results.values()) >= 100


GEMMS = "alpha beta default_no_bias default_scalar_bias default_vector_bias default_zero_bias transposeB"


@pytest.mark.parametrize("name", ["matmul_2d", *(f"gemm_{case}" for case in GEMMS.split())])
def test_matrix_products_of_the_standard_row_by_row(tmp_path, name):
    folder = DATA / f"test_{name}"
    inputs, (expected,) = (tensors(folder / "test_data_set_0", kind) for kind in ("input", "output"))
    model = onnx.load(folder / "model.onnx")
    names = [value.name for value in model.graph.input]
    constants = [numpy_helper.from_array(array, given) for given, array in zip(names[1:], inputs[1:], strict=True)]
    rows = [build.info(names[0], (None, inputs[0].shape[1]))]
    outputs = [build.info(model.graph.output[0].name, None)]
    one_row = build.graph_model(model.graph.node, rows, outputs, constants, opset=model.opset_import[0].version)
    ours = reference.evaluate(build.load(one_row, tmp_path).ir, inputs[0].astype(np.float64))
    np.testing.assert_allclose(ours, expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["single_tree", "set_membership"])
def test_tree_ensembles_of_the_standard(tmp_path, name):
    folder = DATA / f"test_ai_onnx_ml_tree_ensemble_{name}"
    (x,), (expected,) = (tensors(folder / "test_data_set_0", kind) for kind in ("input", "output"))
    model = onnx.load(folder / "model.onnx")
    model.graph.input[0].type.tensor_type.shape.dim[0].dim_param = "rows"
    loaded = build.load(model, tmp_path)
    ours = build.assert_equal_bits(loaded, x)
    np.testing.assert_array_equal(ours, expected)


MIXING = "softmax_axis_0_expanded_ver18 mvn_expanded reduce_max_default_axes_keepdim_example concat_2d_axis_0"
MIXING += " transpose_all_permutations_3"


@pytest.mark.parametrize("name", MIXING.split())
def test_cases_in_which_rows_of_a_batch_change_each_other_are_refused(name):
    with pytest.raises(
        InputError, match=r"rows have no answers of their own in the output '.*': an operator works along"
    ):
        load_file(DATA / f"test_{name}" / "model.onnx", "m")


APART = "softmax_axis_1_expanded_ver18 flatten_axis2 transpose_all_permutations_1 add_bcast argmax_keepdims_example"


@pytest.mark.parametrize("name", APART.split())
def test_cases_whose_rows_stand_alone_are_taken_row_by_row(name):
    folder = DATA / f"test_{name}"
    inputs, (expected,) = (tensors(folder / "test_data_set_0", kind) for kind in ("input", "output"))
    rows = len(inputs[0])  # the second input of add_bcast has no dimension for rows
    x = np.hstack([given.reshape(rows, -1) if given.ndim > 1 else np.tile(given, (rows, 1)) for given in inputs])
    loaded = load_file(folder / "model.onnx", "m")
    np.testing.assert_allclose(
        reference.evaluate(loaded.ir, x.astype(np.float64)), expected.reshape(rows, -1), rtol=1e-5
    )


def test_a_mean_over_a_batch_of_one_row_is_taken(tmp_path):
    nodes = [helper.make_node("ReduceMean", ["X", "axes"], ["Y"], keepdims=1)]
    axes = build.constant("axes", [0], np.int64)
    one = build.graph_model(nodes, [build.info("X", (1, 3))], [build.info("Y", (1, 3))], [axes])
    row = np.array([[1.0, 2.0, 4.0]])
    np.testing.assert_array_equal(reference.evaluate(build.load(one, tmp_path).ir, row), row)
    for rows in ("N", 5):
        many = build.graph_model(nodes, [build.info("X", (rows, 3))], [build.info("Y", (1, 3))], [axes])
        with pytest.raises(InputError, match="export with a batch dimension of 1"):
            build.load(many, tmp_path)


@pytest.mark.parametrize("batch", ["N", 3])
@pytest.mark.parametrize("op_type", ["Trilu", "EyeLike"])
def test_answers_that_depend_on_the_place_in_a_batch_are_refused(tmp_path, op_type, batch):
    nodes = [helper.make_node(op_type, ["X"], ["T"]), helper.make_node("Add", ["X", "T"], ["Y"])]
    model = build.graph_model(nodes, [build.info("X", (batch, 3))], [build.info("Y", None)])
    with pytest.raises(InputError, match="rows at once, rows have no answers of their own"):
        build.load(model, tmp_path)
    one = build.graph_model(nodes, [build.info("X", (1, 3))], [build.info("Y", None)])
    build.assert_equal_bits(build.load(one, tmp_path), build.rows(3))


@pytest.mark.parametrize("batch", ["N", 3])
def test_a_constant_with_a_row_for_each_row_of_a_batch_is_refused(tmp_path, batch):
    table = build.constant("table", [[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]])
    nodes = [helper.make_node("Add", ["X", "table"], ["Y"])]
    model = build.graph_model(nodes, [build.info("X", (batch, 2))], [build.info("Y", None)], [table])
    with pytest.raises(InputError, match="among 3 rows at once, rows have no answers of their own"):
        build.load(model, tmp_path)
