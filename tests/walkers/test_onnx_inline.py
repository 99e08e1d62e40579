"""Functions that a file brings along: what is walked in their place is what onnxruntime makes of the file."""

from __future__ import annotations

import numpy as np
import onnxruntime
import pytest
from onnx import AttributeProto, NodeProto, helper

from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import constant, graph_model, info

ALPHA = 0.3


def _elu_of_an_attribute() -> NodeProto:
    node = helper.make_node("Elu", ["x"], ["y"])
    alpha = node.attribute.add()
    alpha.name, alpha.ref_attr_name, alpha.type = "alpha", "steep", AttributeProto.FLOAT
    return node


FUNCTIONS = {
    "Negated": [helper.make_node("Neg", ["x"], ["t"]), helper.make_node("Relu", ["t"], ["y"])],
    "Nested": [helper.make_node("Negated", ["x"], ["a"], domain="own"), helper.make_node("Add", ["a", "x"], ["y"])],
    "Weighted": [
        helper.make_node(
            "Constant", [], ["w"], value=constant("w", [[1.5, 0.0, 2.0], [0.0, -1.0, 0.5], [3.0, 0.0, 1.0]])
        ),
        helper.make_node("MatMul", ["x", "w"], ["y"]),
    ],
    "Steep": [_elu_of_an_attribute()],
    "Unused": [helper.make_node("NoSuchOperator", ["x"], ["y"])],
}


@pytest.mark.parametrize("calls", [["Negated"], ["Nested", "Nested"], ["Weighted", "Negated"], ["Steep", "Nested"]])
def test_functions_are_what_onnxruntime_makes_of_the_file(tmp_path, calls):
    names = ["X", *(f"t{number}" for number in range(1, len(calls))), "Y"]
    nodes = [
        helper.make_node(name, [a], [b], domain="own", **({"steep": ALPHA} if name == "Steep" else {}))
        for name, a, b in zip(calls, names, names[1:], strict=False)
    ]
    model = graph_model(nodes, [info("X", [None, 3])], [info("Y", [None, 3])])
    model.opset_import.append(helper.make_opsetid("own", 1))
    for name, body in FUNCTIONS.items():
        attributes = ["steep"] * (name == "Steep")
        opsets = [helper.make_opsetid("", 7)] if name == "Unused" else model.opset_import
        model.functions.append(helper.make_function("own", name, ["x"], ["y"], body, opsets, attributes))
    given = model.SerializeToString()
    loaded = build.load(given, tmp_path)
    x = build.rows(3, spread=2.0)
    assert loaded.ir.exact is not bool({"Weighted", "Steep"} & set(calls))
    (build.assert_equal_bits if loaded.ir.exact else build.assert_within_bound)(loaded, x)
    session = onnxruntime.InferenceSession(given)
    want = np.vstack([session.run(None, {"X": row[None].astype(np.float32)})[0] for row in x])
    assert np.array_equal(loaded.predict(x), want.astype(np.float64))
    assert "Unused" not in loaded.ir.source.model_class
