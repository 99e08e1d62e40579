"""Damaged files: only an InputError escapes, and what loads nevertheless is what onnxruntime computes."""

from __future__ import annotations

import numpy as np
import onnx
from google.protobuf.message import Message
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from onnx import helper

from st_codegen.errors import InputError
from st_codegen.ir import reference
from tests.examples import examples
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import Branch, constant, graph_model, info, leaf, ml


def seeds():
    network = graph_model(
        [
            helper.make_node("Gemm", ["X", "W", "b"], ["h"], transB=1, alpha=0.5),
            helper.make_node("Tanh", ["h"], ["t"]),
            helper.make_node("Reshape", ["t", "shape"], ["r"]),
            helper.make_node("Concat", ["r", "X"], ["Y"], axis=1),
        ],
        [info("X", (None, 3))],
        [info("Y", (None, 5))],
        [constant("W", np.ones((2, 3))), constant("b", [0.5, 1.0]), constant("shape", [0, -1], np.int64)],
    )
    tree = Branch("LEQ", 0, 0.5, leaf(1.0), Branch("EQ", 1, 2.0, leaf(2.0), leaf(3.0), missing=True))
    member = Branch("MEMBER", 0, (1.0, 40.0), leaf(1.0), Branch("GT", 1, 2.0, leaf(2.0), leaf(3.0)))
    svm = ml("SVMRegressor", 2, kernel_type="RBF", kernel_params=[0.5, 0.0, 0.0], rho=[0.1], n_supports=2)
    svm.graph.node[0].attribute.extend(
        [helper.make_attribute("support_vectors", [1.0] * 4), helper.make_attribute("coefficients", [1.0, -1.0])]
    )
    classifier = build.classifier([tree, leaf(0.5)], ("a", "b"), zipped=True, n_features=2)
    models = [network, build.regressor([tree, leaf(0.5)], 2), build.ensemble([member, leaf(0.5)], 2), svm, classifier]
    return [model.SerializeToString() for model in models]


SEEDS = seeds()


def slots(message):
    """Every place in a message where something stands: (message, field, position or None)."""
    found = []
    for field, value in message.ListFields():
        repeated = not isinstance(value, (str, bytes, int, float, Message))
        for position, item in enumerate(value) if repeated else [(None, value)]:
            found.append((message, field, position))
            if isinstance(item, Message):
                found.extend(slots(item))
    return found


NUMBERS = [0, 1, -1, 2, 3, 5, 7, 127, 2**31 - 1, 2**31, -(2**31), 2**40, -(2**63), 2**63 - 1]
FLOATS = [0.0, -0.0, 1.0, -1.5, 1e38, -1e38, 1e-45, float("inf"), float("-inf"), float("nan")]
TEXTS = ["", "X", "Y", "W", "h", "r", "Neg", "Add", "MatMul", "Identity", "LEAF", "BRANCH_GT", "MIN", "L2", "axis", "é"]


def damage(model, pick):
    """Replace, drop or repeat one thing in a model; `pick` chooses from a list."""
    message, field, position = pick(slots(model))
    values = getattr(message, field.name)
    if position is not None and pick([False, True]):
        if pick([False, True]):
            del values[position]
        elif field.message_type is None:
            values.append(values[position])
        else:
            values.add().CopyFrom(values[position])
        return
    if field.message_type is not None:
        message.ClearField(field.name)
        return
    new = {str: TEXTS, bytes: [text.encode() for text in TEXTS], int: NUMBERS, float: FLOATS}
    item = values if position is None else values[position]
    try:
        if position is None:
            setattr(message, field.name, pick(new[type(item)]))
        else:
            values[position] = pick(new[type(item)])
    except ValueError:  # does not fit the field's range
        return


@examples(suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_models_with_changed_fields_load_or_are_refused(tmp_path_factory, data):
    """Attributes, names, dimensions and numbers replaced: an InputError, or a model that onnxruntime agrees with."""
    model = onnx.ModelProto.FromString(data.draw(st.sampled_from(SEEDS)))
    for _ in range(data.draw(st.integers(1, 3))):
        damage(model, lambda options: data.draw(st.sampled_from(options)))
    try:
        loaded = build.load(model, tmp_path_factory.getbasetemp())
    except InputError:
        return
    x = np.array([[0.25], [2.0]]) * np.ones((2, len(loaded.ir.features)))
    ours, library = reference.evaluate(loaded.ir, x), loaded.predict(x)
    if loaded.ir.exact:
        library[~np.all(np.isfinite(library), axis=1)] = np.nan
        np.testing.assert_array_equal(ours, library)
    else:
        finite = np.isfinite(library)  # numbers near the end of float32 overflow in onnxruntime first
        np.testing.assert_allclose(ours[finite], library[finite], rtol=1e-5, atol=1e-6)


@examples(suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_mutated_files_load_or_are_refused(tmp_path_factory, data):
    """Bytes replaced, dropped, repeated: an InputError or a model, never another exception or a crash."""
    folder = tmp_path_factory.getbasetemp()
    content = bytearray(data.draw(st.sampled_from(SEEDS)))
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, len(content) - 1))
        kind = data.draw(st.sampled_from(["flip", "byte", "drop", "repeat", "insert"]))
        if kind == "flip":
            content[position] ^= 1 << data.draw(st.integers(0, 7))
        elif kind == "byte":
            content[position] = data.draw(st.sampled_from([0, 1, 127, 128, 254, 255]))
        elif kind == "drop":
            del content[position : position + data.draw(st.integers(1, 8))]
        elif kind == "repeat":
            content[position:position] = content[position : position + data.draw(st.integers(1, 16))]
        else:
            content[position:position] = data.draw(st.binary(min_size=1, max_size=8))
        if not content:
            return
    try:
        loaded = build.load(bytes(content), folder)
    except InputError:
        return
    loaded.predict(np.zeros((1, len(loaded.ir.features))))
