"""Files that cannot be used: each refusal names file, node, operator or field; only an InputError escapes."""

from __future__ import annotations

import importlib

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from st_codegen.errors import InputError, MissingExtraError, UnsupportedModelError
from st_codegen.walkers.onnx import graph
from st_codegen.walkers.onnx.load import load_file
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import DOUBLE, FLOAT, constant, graph_model, info, leaf, ml, single


def refused(model, tmp_path, kind=InputError):
    with pytest.raises(kind) as caught:
        build.load(model, tmp_path)
    message = str(caught.value)
    assert message.startswith("model.onnx: ")
    return message


FILES = {
    "empty": b"",
    "text": b"tree\nversion=v4\nnum_class=1\n",
    "zeros": bytes(1000),
    "noise": np.random.default_rng(0).bytes(2000),
    "graphless": onnx.ModelProto(ir_version=8).SerializeToString(),
}


@pytest.mark.parametrize("name", FILES)
def test_files_that_are_no_models(tmp_path, name):
    assert "not an ONNX model" in refused(FILES[name], tmp_path)


def test_every_truncation_of_a_model_is_refused_or_loads(tmp_path):
    data = single("Add", 3, [constant("C", [1.0, 2.0, 3.0])]).SerializeToString()
    for length in range(len(data)):
        try:
            build.load(data[:length], tmp_path)
        except InputError:
            continue
        assert length > len(data) - 40  # only the end, the list of opsets, can go


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"absent\.onnx: cannot be read \(No such file"):
        load_file(tmp_path / "absent.onnx", "absent")


@pytest.mark.parametrize("package", ["onnx", "onnxruntime"])
def test_missing_packages_name_the_extra(tmp_path, monkeypatch, package):
    def no_such_module(name, *arguments):
        if name == package:
            raise ImportError(name)
        return real(name, *arguments)

    real = importlib.import_module
    monkeypatch.setattr(importlib, "import_module", no_such_module)
    with pytest.raises(MissingExtraError, match=rf"'{package}'.*st-codegen\[onnx\]"):
        load_file(tmp_path / "model.onnx", "model")


def test_unknown_operators_domains_and_types_are_listed_together(tmp_path):
    nodes = [
        helper.make_node("Det", ["X"], ["a"], name="hard"),
        helper.make_node("Det", ["X"], ["b"]),
        helper.make_node("FusedGelu", ["a"], ["c"], name="fused", domain="com.microsoft"),
        helper.make_node("Cast", ["X"], ["d"], name="narrowing", to=TensorProto.FLOAT16),
        helper.make_node("LinearRegressor", ["X"], ["e"], name="post", domain="ai.onnx.ml", post_transform="SOFTMAX"),
        helper.make_node("Add", ["c", "d"], ["Y"], name="reader"),
    ]
    message = refused(graph_model(nodes, [info("X", (None, 2))], [info("Y", None)]), tmp_path, UnsupportedModelError)
    assert message.startswith("model.onnx: 5 problems\n")
    assert "operator Det (opset 18) is not supported: node 'hard', the node of 'b'" in message
    assert "operator com.microsoft.FusedGelu (opset unknown) is not supported: node 'fused'" in message
    assert "node 'narrowing' (Cast, opset 18): casts to FLOAT16; FLOAT, DOUBLE, INT32" in message
    assert "node 'post' (LinearRegressor, opset 3): post_transform SOFTMAX of one target: onnxruntime" in message
    assert "supported operators: " in message
    assert "compile the graph from before optimizing, and quantize with QuantFormat.QDQ" in message
    assert "reader" not in message


@pytest.mark.parametrize("op_type", ["Add", "Gemm", "Relu"])
def test_old_opsets_are_refused(tmp_path, op_type):
    message = refused(single(op_type, 3, [constant("C", np.eye(3))][: op_type != "Relu"], opset=5), tmp_path)
    assert f"node 'the_node' ({op_type}, opset 5): version 1 of this operator is not supported (known: " in message
    assert "export the model with another target_opset" in message


def test_opsets_that_are_unknown_missing_or_double(tmp_path):
    model = single("Neg")
    # the package may know the operators of the next opset already, which onnxruntime refuses until it is released
    model.opset_import[0].version = 999
    message = refused(model, tmp_path)
    assert "opset 999 of the domain 'ai.onnx': the installed onnx package lists 1 to" in message
    assert "as released; export the model with another target_opset, or install a newer onnx and onnxrun" in message
    model.opset_import[0].version = 0
    assert "opset 0 of the domain" in refused(model, tmp_path)
    model = single("Neg")
    del model.opset_import[0]
    assert "the file names no opset for the domain 'ai.onnx'" in refused(model, tmp_path)
    model = single("Neg")
    model.opset_import.append(helper.make_opsetid("", 17))
    assert "two opsets of the domain 'ai.onnx'" in refused(model, tmp_path)
    model.opset_import[-1].version = 18
    build.load(model, tmp_path)


def test_operators_of_another_opset_are_refused(tmp_path):
    message = refused(build.regressor([leaf(1.0)], ml_opset=5), tmp_path)
    assert "node 'trees' (TreeEnsembleRegressor, opset 5): version 5 of this operator is not supported" in message
    model = build.ensemble([leaf(1.0)])
    model.opset_import[1].version = 4
    assert "this opset has no such operator" in refused(model, tmp_path)


def test_functions_that_call_themselves_or_grow_without_end_are_refused(tmp_path):
    def bad(*functions, called="F"):
        model = single("Neg")
        model.graph.node[0].CopyFrom(helper.make_node(called, ["X"], ["Y"], domain="own"))
        model.opset_import.append(helper.make_opsetid("own", 1))
        model.functions.extend(functions)
        return refused(model, tmp_path)

    def own(name, *called, opset=None):
        names = ["x", *(f"t{number}" for number in range(1, len(called))), "y"]
        nodes = [
            helper.make_node(one, [a], [b], domain="own") for one, a, b in zip(called, names, names[1:], strict=False)
        ]
        opsets = single("Neg").opset_import if opset is None else [helper.make_opsetid("", opset)]
        nodes = nodes or [helper.make_node("Neg", ["x"], ["y"])]
        return helper.make_function("own", name, ["x"], ["y"], nodes, [*opsets, helper.make_opsetid("own", 1)])

    assert "a function named ''" in bad(helper.make_function("", "", ["x"], ["y"], [], []))
    assert "a function named 'F::a'" in bad(own("F::a"), called="F")
    assert "its function 'F' calls itself" in bad(own("F", "F"))
    assert "calls itself" in bad(own("F", "G"), own("G", "F"))
    assert "two functions 'F'; the model file is damaged" in bad(own("F"), own("F"))
    doubled = [own("F", "F1", "F1"), *(own(f"F{n}", f"F{n + 1}", f"F{n + 1}") for n in range(1, 40)), own("F40")]
    assert "objects with all calls of its functions, at most" in bad(*doubled)
    assert "functions of its own (F) with other opsets than the graph's" in bad(own("F", opset=7))
    given = own("F")
    given.attribute_proto.append(helper.make_attribute("w", constant("w", np.zeros(2))))
    assert "a function is given 'w', which is no number, text or list below 4096 bytes" in bad(given)
    del given.attribute_proto[:]
    given.attribute_proto.append(helper.make_attribute("w", [1.0] * 2000))
    assert "a function is given 'w', which is no number, text or list below" in bad(given)
    deep = [own("F", "F1"), *(own(f"F{n}", f"F{n + 1}") for n in range(1, 200)), own("F200")]
    assert "functions that call each other more than 100 deep" in bad(*deep)


def test_sparse_tensors_are_refused(tmp_path):
    model = single("Neg")
    model.graph.sparse_initializer.add()
    assert "sparse initializers are not supported" in refused(model, tmp_path)


def inputs_of(tmp_path, *values):
    return refused(graph_model([helper.make_node("Neg", ["X"], ["Y"])], values, [info("Y", None)]), tmp_path)


def test_inputs_that_cannot_be_features(tmp_path):
    assert "input 'X' has no shape" in inputs_of(tmp_path, info("X", None))
    for shape in ((None, None), ("N",), (None, "features"), (1, 3, None), (1, -1)):
        message = inputs_of(tmp_path, info("X", shape))
        assert "the number of features is not known; export the model with a fixed number of columns" in message
    assert "has a dimension of length 0" in inputs_of(tmp_path, info("X", (None, 0)))
    assert "is of STRING; export the model with float inputs" in inputs_of(
        tmp_path, info("X", (None, 1), TensorProto.STRING)
    )
    assert "is of FLOAT16" in inputs_of(tmp_path, info("X", (None, 1), TensorProto.FLOAT16))
    assert "at most 65536 features" in inputs_of(tmp_path, info("X", (None, 2**40)))
    assert "two inputs 'X'" in inputs_of(tmp_path, info("X", (None, 1)), info("X", (None, 1)))
    assert "the graph has no inputs, so that its outputs are constants" in inputs_of(tmp_path)
    sequence = helper.make_tensor_sequence_value_info("X", FLOAT, (None, 1))
    assert "input 'X' is not a tensor; export the model with tensors as inputs" in inputs_of(tmp_path, sequence)
    assert "or say --features N" in inputs_of(tmp_path, info("X", (None, None)))
    for given in ((sequence,), (info("X", (None, 0)),), (info("X", None),), (info("X", (None, None, None)),), ()):
        advice = inputs_of(tmp_path, *given)  # --features would not help
        assert "--features" not in advice
        assert "damaged" not in advice


def test_truth_values_as_an_output_may_be_cast(tmp_path):
    greater = helper.make_node("Greater", ["X", "C"], ["Y"])
    half = [constant("C", [0.5])]
    alone = graph_model([greater], [info("X", (None, 2))], [info("Y", None, TensorProto.BOOL)], half)
    assert "holds truth values; cast it to float, or leave it out" in refused(alone, tmp_path)
    nodes = [greater, helper.make_node("Cast", ["Y"], ["Z"], to=FLOAT)]
    build.load(graph_model(nodes, [info("X", (None, 2))], [info("Z", None)], half), tmp_path)


def test_a_branch_that_gives_a_list_of_tensors_is_not_called_damaged(tmp_path):
    made = helper.make_node("SequenceConstruct", ["X"], ["S"])
    branch = helper.make_graph([made], "branch", [], [helper.make_tensor_sequence_value_info("S", FLOAT, None)])
    chosen = helper.make_node("If", ["truth"], ["Y"], then_branch=branch, else_branch=branch)
    nodes = [
        helper.make_node("ReduceSum", ["X"], ["total"], keepdims=0),
        helper.make_node("Cast", ["total"], ["truth"], to=TensorProto.BOOL),
        chosen,
    ]
    outputs = [helper.make_tensor_sequence_value_info("Y", FLOAT, None)]
    message = refused(graph_model(nodes, [info("X", (1, 2))], outputs), tmp_path)
    assert "a result of the body is no tensor, or is not computed" in message


def test_integers_without_a_cast_are_refused(tmp_path):
    inputs = [info("X", (None, 2), TensorProto.INT64)]
    cut = helper.make_node("Binarizer", ["X"], ["Y"], name="b", domain="ai.onnx.ml", threshold=0.5)
    message = refused(graph_model([cut], inputs, [info("Y", None)]), tmp_path)
    assert (
        "node 'b' (Binarizer, opset 3): reads integers; cast them to float, or export the model with float inputs"
        in message
    )
    plain = graph_model([helper.make_node("Identity", ["X"], ["Y"])], inputs, [info("Y", None, TensorProto.INT64)])
    assert "the output 'Y' holds the integers of an input" in refused(plain, tmp_path)
    cast = helper.make_node("Cast", ["X"], ["Y"], to=TensorProto.STRING)
    message = refused(graph_model([cast], [info("X", (None, 2))], [info("Y", None)]), tmp_path)
    assert "casts numbers to text; leave the cast out" in message


def test_outputs_that_are_not_computed(tmp_path):
    def graph(nodes, *outputs, constants=()):
        return graph_model(nodes, [info("X", (None, 2))], outputs, constants)

    neg = helper.make_node("Neg", ["X"], ["Y"])
    assert "the output 'Z' is not computed by any node" in refused(graph([neg], info("Z", None)), tmp_path)
    assert "the graph has no outputs" in refused(graph([neg]), tmp_path)
    message = refused(graph([neg], info("C", None), constants=[constant("C", 1.0)]), tmp_path)
    assert "the output 'C' is a constant" in message
    message = refused(graph([neg], info("Y", None, DOUBLE)), tmp_path)
    assert "the output 'Y' is declared as DOUBLE, its operator computes FLOAT" in message


def test_graphs_with_cycles_gaps_and_double_names(tmp_path):
    def graph(*nodes, constants=()):
        return graph_model(nodes, [info("X", (None, 2))], [info("Y", None)], constants)

    neg = helper.make_node("Neg", ["X"], ["Y"], name="neg")
    late = helper.make_node("Relu", ["b"], ["a"], name="one"), helper.make_node("Relu", ["a"], ["b"], name="two")
    message = refused(graph(*late, neg), tmp_path)
    assert (
        "node 'one' (Relu, opset 18): reads 'b', which node 'two' computes only later: the graph has a cycle" in message
    )
    message = refused(graph(helper.make_node("Relu", ["ghost"], ["Y"])), tmp_path)
    assert "the node of 'Y' (Relu, opset 18): reads 'ghost', which nothing computes" in message
    assert "node 'neg' (Neg, opset 18): 'Y' is computed twice" in refused(graph(neg, neg), tmp_path)
    twice = [constant("c", 1.0), constant("c", 2.0)]
    assert "the initializer 'c' appears twice" in refused(graph(neg, constants=twice), tmp_path)


def test_nodes_that_do_not_fit_their_schema(tmp_path):
    def message(op_type, inputs=("X",), **attributes):
        node = helper.make_node(op_type, list(inputs), ["Y"], name="n", **attributes)
        return refused(graph_model([node], [info("X", (None, 2))], [info("Y", None)]), tmp_path)

    assert "node 'n' (Neg, opset 18): 2 inputs, expected 1 to 1" in message("Neg", ("X", "X"))
    assert "node 'n' (Add, opset 18): input 1 is missing" in message("Add", ("X", ""))
    assert "attribute 'colour' is not one of this operator's version 13" in message("Neg", colour=1)
    assert "attribute 'alpha' is not of type FLOAT" in message("Elu", alpha=[1.0])
    assert "attribute 'axis' is missing" in message("Concat")
    assert "axis 5 of a tensor with 2 dimensions" in message("Concat", axis=5)
    assert "perm [0, 0] for 2 dimensions" in message("Transpose", perm=[0, 0])
    model = single("Elu", 2, alpha=1.0)
    model.graph.node[0].attribute.append(model.graph.node[0].attribute[0])
    assert "an attribute appears twice" in refused(model, tmp_path)


DAMAGE = {
    "needs 4096 numbers, it has 2": lambda t: t.dims.__setitem__(0, 4096),
    "negative length": lambda t: t.dims.__setitem__(0, -2),
    "at most 134217728 are supported": lambda t: t.dims.__setitem__(0, 2**40),
    "needs 2 numbers, it has 0": lambda t: setattr(t, "data_type", TensorProto.STRING),
    "tensors of COMPLEX64 are not supported": lambda t: setattr(t, "data_type", TensorProto.COMPLEX64),
    "tensors of type 77 are not supported": lambda t: setattr(t, "data_type", 77),
    "needs 8 bytes, it has 5": lambda t: setattr(t, "raw_data", b"12345"),
    "its numbers are in '', which is no path inside the folder": lambda t: setattr(
        t, "data_location", TensorProto.EXTERNAL
    ),
    "its numbers are in another file; save the model with its weights inside": lambda t: t.external_data.add(
        key="location", value="c.data"
    ),
}


@pytest.mark.parametrize("message", DAMAGE)
def test_damaged_initializers(tmp_path, message):
    model = single("Add", 2, [helper.make_tensor("C", FLOAT, [2], [1.0, 2.0])])
    DAMAGE[message](model.graph.initializer[0])
    text = refused(model, tmp_path)
    assert "initializer 'C': " in text
    assert message in text


def test_an_initializer_has_as_many_numbers_as_are_supported(tmp_path, monkeypatch):
    model = single("Add", 2, [helper.make_tensor("C", FLOAT, [2], [1.0, 2.0])])
    monkeypatch.setattr("st_codegen.walkers.onnx.file.MAX_TENSOR_SIZE", 2)
    build.load(model, tmp_path)
    monkeypatch.setattr("st_codegen.walkers.onnx.file.MAX_TENSOR_SIZE", 1)
    assert "its shape (2,) has 2 numbers, at most 1 are supported" in refused(model, tmp_path)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_coefficients_that_are_not_finite(tmp_path, value):
    bad = [1.0, value, 0.0]
    beside = f"puts {value} beside computed numbers; train the model without NaN and infinite values"
    assert beside in refused(single("Add", 3, [constant("C", bad)]), tmp_path)
    weights = np.where(np.eye(3) == 1, value, 0.0)
    message = refused(single("MatMul", 3, [constant("C", weights)]), tmp_path)
    assert "node 'the_node' (MatMul, opset 18): Linear.weights: 3 coefficients not finite" in message
    for attributes in ({"coefficients": bad}, {"coefficients": [0.0] * 3, "intercepts": [value]}):
        assert "1 coefficient not finite" in refused(ml("LinearRegressor", 3, **attributes), tmp_path)
    assert beside in refused(ml("Scaler", 3, offset=bad, scale=[1.0, 1.0, 1.0]), tmp_path)
    svm = {"kernel_type": "RBF", "kernel_params": [value, 0.0, 0.0], "n_supports": 1, "rho": [0.0]}
    message = refused(ml("SVMRegressor", 3, support_vectors=[0.0] * 3, coefficients=[1.0], **svm), tmp_path)
    assert "not finite" in message


def test_division_by_zero(tmp_path):
    message = refused(single("Div", 2, [constant("C", [1.0, 0.0])]), tmp_path)
    assert "node 'the_node' (Div, opset 18): divides by a constant that is 0, which gives infinity or NaN" in message


LISTS = {
    "offset has 2 entries, expected 1 or 3": ("Scaler", {"offset": [0.0, 1.0], "scale": [1.0]}),
    "scale has 3 entries, expected 1": ("Scaler", {"offset": [0.0], "scale": [1.0] * 3}),
    "norm L7: known are MAX, L1, L2": ("Normalizer", {"norm": "L7"}),
    "coefficients has 4 entries, expected 3": ("LinearRegressor", {"coefficients": [1.0] * 4}),
    "intercepts has 2 entries, expected 0 or 1": (
        "LinearRegressor",
        {"coefficients": [1.0] * 3, "intercepts": [0.0, 1.0]},
    ),
    "post_transform LOGISTIC of one target": ("LinearRegressor", {"post_transform": "LOGISTIC"}),
    "one_class: a detector of outliers": ("SVMRegressor", {"one_class": 1}),
    "rho has 2 entries": ("SVMRegressor", {"rho": [0.0, 1.0]}),
    "coefficients has 2 entries, expected 3": ("SVMRegressor", {"rho": [0.0], "coefficients": [1.0, 2.0]}),
    "coefficients has 1 entry, expected 2": (
        "SVMRegressor",
        {"rho": [0.0], "coefficients": [1.0], "n_supports": 2, "support_vectors": [0.0] * 3},
    ),
    "support_vectors has 4 entries, expected 3": (
        "SVMRegressor",
        {"rho": [0.0], "coefficients": [1.0], "n_supports": 1, "support_vectors": [0.0] * 4},
    ),
    "0 targets, expected 1 or more": ("LinearRegressor", {"targets": 0, "coefficients": [1.0]}),
    "kernel_type CUBIC: known are LINEAR, POLY, RBF, SIGMOID": ("SVMRegressor", {"kernel_type": "CUBIC"}),
    "kernel_params has 2 entries, expected 0 or 3": ("SVMRegressor", {"kernel_params": [0.0, 1.0]}),
    "degree 2.5 of the polynomial kernel": (
        "SVMRegressor",
        {"kernel_type": "POLY", "kernel_params": [1.0, 0.0, 2.5]},
    ),
    "gamma -1.0 is negative": ("SVMRegressor", {"kernel_type": "RBF", "kernel_params": [-1.0, 0.0, 0.0]}),
}
SVM = {"rho": [0.0], "coefficients": [1.0], "n_supports": 1, "support_vectors": [0.0] * 3}


@pytest.mark.parametrize("message", LISTS)
def test_attributes_of_the_wrong_length_or_value(tmp_path, message):
    op_type, attributes = LISTS[message]
    if op_type == "SVMRegressor" and "rho" not in attributes:
        attributes = {**SVM, **attributes}
    text = refused(ml(op_type, 3, **attributes), tmp_path)
    assert text.startswith(f"model.onnx: node 'the_node' ({op_type}, opset 3): ")
    assert message in text


def test_operands_of_the_wrong_kind(tmp_path):
    def message(op_type, constants, **attributes):
        return refused(single(op_type, 3, constants, **attributes), tmp_path)

    assert "the inputs have different types, float32 and float64" in message("Add", [constant("C", 1.0, float)])
    assert "shapes (1, 3) and (2,) (for one row) do not fit" in message("Add", [constant("C", [1.0, 2.0])])
    assert "the result has 98304 numbers for one row" in message("Add", [constant("C", np.zeros((32768, 1)))])
    assert "the result has no elements" in message("Add", [constant("C", np.zeros((0, 1)))])
    assert "multiplies tensors of shapes (1, 3) and (2, 2)" in message("MatMul", [constant("C", np.eye(2))])
    assert "the weights are float64, the input float32" in message("MatMul", [constant("C", np.eye(3), float)])
    assert "multiplies shapes (1, 3) and (2, 2)" in message("Gemm", [constant("C", np.eye(2))])
    assert "C has shape (2,) for 3 columns" in message("Gemm", [constant("B", np.eye(3)), constant("C", [1.0, 2.0])])
    assert "positions outside 0 .. 2" in message("Gather", [constant("C", [3], np.int64)], axis=1)
    assert "positions are missing or not integers" in message("Gather", [constant("C", [1.0])], axis=1)
    assert "shape is float32 of shape (2,), expected a list of integers" in message(
        "Reshape", [constant("C", [1.0, 3.0])]
    )
    assert "drops axes [1] of shape (1, 3)" in message("Squeeze", [constant("C", [1], np.int64)])
    assert "inserts axes [0, 0] twice" in message("Unsqueeze", [constant("C", [0, 0], np.int64)])
    assert "min is float32 of shape (3,), expected one float32" in message("Clip", [constant("C", [0.0] * 3)])
    assert "Clip.lower: 3 coefficients not finite" in message("Clip", [constant("C", np.nan)])
    training = [constant("ratio", 0.5), constant("on", True, bool)]
    assert "Dropout in training mode; export the model for inference" in message("Dropout", training)


def test_the_mask_of_a_dropout_that_drops_nothing_is_no_training_mode(tmp_path):
    nodes = [helper.make_node("Dropout", ["X"], ["Y", "mask"])]
    text = refused(build.graph_model(nodes, [build.info("X", (None, 3))], [build.info("Y", None)]), tmp_path)
    assert "several outputs: the mask is for training; leave it out" in text and "training mode" not in text


def test_a_node_without_a_name_is_told_by_the_first_output_that_it_has(tmp_path):
    """Of a recurrent layer often the last state alone is read: it was "the node of ''"."""
    node = helper.make_node("GRU", ["X", "W", "R"], ["", "last"], hidden_size=1, layout=1)
    weights = [constant("W", np.zeros((1, 3, 2))), constant("R", np.zeros((1, 3, 1)))]
    model = graph_model([node], [info("X", (1, 4, 2))], [info("last", None)], weights)
    assert "the node of 'last' (GRU, opset 18): the attribute layout" in refused(model, tmp_path)


def test_weights_that_are_an_input_without_rows_are_no_damage(tmp_path):
    """The first dimension of an input is taken for rows: of a scale for (3, 5) numbers one row is left."""
    inputs = [build.info("X", (2, 3, 5)), build.info("scale", (3, 5))]
    flat = [build.constant("flat", [0, -1], np.int64), build.constant("one", [1, -1], np.int64)]
    nodes = [
        helper.make_node("Reshape", ["X", "flat"], ["F"]),
        helper.make_node("Reshape", ["scale", "one"], ["S"]),
        helper.make_node("Mul", ["F", "S"], ["Y"]),
    ]
    text = refused(build.graph_model(nodes, inputs, [build.info("Y", None)], flat), tmp_path)
    assert "shapes (1, 15) and (1, 5) (for one row) do not fit: the first dimension of an input is taken for" in text


def test_a_ratio_of_dropout_that_is_computed_is_refused(tmp_path):
    """onnxruntime fails on rows where it is none, though nothing is dropped."""
    nodes = [helper.make_node("Dropout", ["X", "ratio"], ["Y"])]
    model = graph_model(nodes, [info("X", (1, 3)), info("ratio", ())], [info("Y", None)])
    assert "the ratio is computed from the inputs" in refused(model, tmp_path, UnsupportedModelError)


def test_tensors_that_cannot_be_joined(tmp_path):
    node = helper.make_node("Concat", ["A", "B"], ["Y"], axis=1)
    flat = [info("A", (None, 1, 2)), info("B", (None, 3, 3))]
    message = refused(graph_model([node], flat, [info("Y", None)]), tmp_path)
    assert "tensors of shapes (1, 1, 2), (1, 3, 3) cannot be joined along axis 1" in message
    mixed = [info("A", (None, 2)), info("B", (None, 2), DOUBLE)]
    assert "the inputs have different types, float32 and float64" in refused(
        graph_model([node], mixed, [info("Y", None)]), tmp_path
    )


def test_all_operators_that_are_missing_are_listed_at_once(tmp_path):
    nodes = [helper.make_node("Det", ["X"], ["A"], name="one"), helper.make_node("Unique", ["X"], ["B"], name="two")]
    last = helper.make_node("Add", ["A", "B"], ["Y"])
    message = refused(graph_model([*nodes, last], [info("X", (None, 3))], [info("Y", None)]), tmp_path)
    assert "operator Det (opset 18) is not supported: node 'one'" in message
    assert "operator Unique (opset 18) is not supported: node 'two'" in message
    assert "supported operators: Abs, Acos, Acosh, Add, And, ArgMax, ArgMin, ArrayFeatureExtractor," in message


def test_names_that_are_not_text(tmp_path):
    data = single("Neg").SerializeToString().replace(b"the_node", b"\xff\xfe\xfd_node")
    assert "it has names that are not text" in refused(data, tmp_path)


def test_products_that_do_not_fit_and_operands_that_have_to_be_constants(tmp_path):
    inputs, outputs = [info("X", (None, 3))], [info("Y", None)]
    for op_type in ("MatMul", "Gemm"):
        node = helper.make_node(op_type, ["X", "X"], ["Y"], name="n")
        assert f"node 'n' ({op_type}, opset 18): " in refused(graph_model([node], inputs, outputs), tmp_path)
    node = helper.make_node("Reshape", ["X", "S"], ["Y"])
    model = graph_model([node], [*inputs, info("S", (2,), TensorProto.INT64)], outputs)
    assert "shape is computed from the inputs; it has to be a constant" in refused(model, tmp_path)
    neg = graph_model([helper.make_node("Erf", ["C"], ["Y"])], inputs, outputs, [constant("C", [1.0])])
    assert "reads a constant; fold constants when exporting" in refused(neg, tmp_path)


def test_ml_operators_want_one_row(tmp_path):
    nodes = [
        helper.make_node("Reshape", ["X", "shape"], ["grid"]),
        helper.make_node("Normalizer", ["grid"], ["Y"], domain="ai.onnx.ml"),
    ]
    for shape in ([2, 2], [1, 2, 2]):
        constants = [constant("shape", shape, np.int64)]
        model = graph_model(nodes, [info("X", (None, 4))], [info("Y", None)], constants)
        assert f"reads a tensor of shape {tuple(shape)} (for one row)" in refused(model, tmp_path)


def test_linear_and_svm_regressors_of_doubles_are_refused(tmp_path):
    model = ml("LinearRegressor", 3, DOUBLE, coefficients=[1.0] * 3)
    assert "reads double numbers; onnxruntime has it for float only" in refused(model, tmp_path)


def test_graphs_that_ask_for_too_much_memory(tmp_path, monkeypatch):
    """Forty doublings of a constant, or many wide results, end before they cost anything."""
    doublings = [helper.make_node("Concat", [f"c{n}", f"c{n}"], [f"c{n + 1}"], axis=0) for n in range(40)]
    model = graph_model(
        [helper.make_node("Neg", ["X"], ["Y"]), *doublings],
        [info("X", (None, 1))],
        [info("Y", None)],
        [constant("c0", np.ones(100))],
    )
    assert "numbers" in refused(model, tmp_path, UnsupportedModelError)
    wide = [helper.make_node("Identity", ["X"], [f"y{n}"]) for n in range(1500)]
    model = graph_model(wide, [info("X", (None, 60000))], [info("y0", None)])
    assert "the graph needs more than 67108864 numbers in all" in refused(model, tmp_path)
    monkeypatch.setattr(graph, "MAX_NUMBERS", 1_000_000)  # what is counted costs its time, too
    many = [helper.make_node("MatMul", ["X", "W"], [f"y{n}"]) for n in range(150)]
    model = graph_model(many, [info("X", (None, 100))], [info("y0", None)], [constant("W", np.ones((100, 100)))])
    assert "the graph needs more than 1000000 numbers in all" in refused(model, tmp_path)


def test_what_onnxruntime_itself_refuses(tmp_path):
    model = single("Clip", 3, [constant("low", 0.0, float)], DOUBLE, opset=11)
    assert "onnxruntime refuses the model: " in refused(model, tmp_path)


def test_names_in_messages_are_printable_and_short(tmp_path):
    node = helper.make_node("Det", ["X"], ["Y"], name="évil\n*)]]>" + "x" * 500)
    message = refused(graph_model([node], [info("X", (None, 1))], [info("Y", None)]), tmp_path)
    assert message.isascii()
    assert "\\xe9vil\\n*)]]>" in message
    assert "x" * 81 not in message
