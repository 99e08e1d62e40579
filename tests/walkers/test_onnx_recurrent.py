"""Recurrent layers over a window are those of onnxruntime within the bound, for every kind and direction."""

from __future__ import annotations

import numpy as np
import pytest
from onnx import helper

from st_codegen import generate, load, verify
from st_codegen.errors import InputError, UnsupportedModelError
from tests.walkers import onnx_builders as build
from tests.walkers.onnx_builders import constant, graph_model, info
from tests.walkers.test_onnx_elementwise import agree

pytestmark = pytest.mark.usefixtures("tried_in_place")

STEPS, READ, HIDDEN = 5, 2, 3
GATES = {"RNN": 1, "GRU": 3, "LSTM": 4}


def layer(op_type, output="Y_h", *, steps=STEPS, biases=True, initial=False, inputs=(), scale=0.7, **attributes):
    """A layer as PyTorch exports it: the batch of one window is turned, the last state comes out."""
    rng, gates = np.random.default_rng(len(op_type)), GATES[op_type]
    sides = 2 if attributes.get("direction") == "bidirectional" else 1
    shapes = {"W": (sides, gates * HIDDEN, READ), "R": (sides, gates * HIDDEN, HIDDEN)}
    shapes |= {"B": (sides, 2 * gates * HIDDEN)} if biases else {}
    given = [constant(name, rng.normal(size=shape) * scale) for name, shape in shapes.items()]
    names = ["T", "W", "R", "B" if biases else ""]
    if initial:
        given.append(constant("H", rng.normal(size=(sides, 1, HIDDEN))))
        names += ["", "H"]
    outputs = ["Y", "Y_h", "Y_c"][: 3 if op_type == "LSTM" else 2]
    nodes = [
        helper.make_node("Transpose", ["X"], ["T"], perm=[1, 0, 2]),
        helper.make_node(op_type, [*names, *inputs], outputs, name="the_node", hidden_size=HIDDEN, **attributes),
        helper.make_node("Flatten", [output], ["Z"], axis=0),
    ]
    return graph_model(nodes, [info("X", (1, steps, READ))], [info("Z", None)], given)


def windows(steps=STEPS, n=60):
    rng = np.random.default_rng(steps)
    calm = rng.normal(size=(n, steps * READ)) * 10 ** rng.uniform(-2, 1, size=(n, 1))
    return np.vstack([calm, np.full((3, steps * READ), [[np.nan], [np.inf], [0.0]]), np.full((1, steps * READ), 1e6)])


CASES = {
    "RNN": {},
    "RNN near 0": {"biases": False, "scale": 1e-3, "output": "Y"},
    "RNN relu": {"activations": ["Relu"], "scale": 0.3},
    "RNN start": {"initial": True},
    "GRU": {"linear_before_reset": 1},
    "GRU with the reset first": {},
    "GRU bidirectional": {"linear_before_reset": 1, "direction": "bidirectional"},
    "LSTM": {},
    "LSTM without biases": {"biases": False},
    "LSTM all states": {"output": "Y"},
    "LSTM cells": {"output": "Y_c"},
    "LSTM reverse": {"direction": "reverse", "output": "Y"},
    "LSTM bidirectional": {"direction": "bidirectional", "output": "Y"},
    "LSTM of one sample": {"steps": 1},
}


@pytest.mark.parametrize("name", CASES)
def test_recurrent_layers(tmp_path, name):
    loaded = build.load(layer(name.split()[0], **CASES[name]), tmp_path)
    x = windows(CASES[name].get("steps", STEPS))
    bound = agree(loaded, x[:, : len(loaded.ir.features)])
    assert np.all(np.isfinite(bound)) and not loaded.ir.exact
    assert np.median(bound) < 1e-2


@pytest.mark.parametrize("op_type", ["LSTM", "GRU"])
def test_a_layer_over_a_window_of_samples(tmp_path, op_type):
    build.load(layer(op_type, linear_before_reset=1) if op_type == "GRU" else layer(op_type), tmp_path)
    text = '[[model]]\nfile = "model.onnx"\nwindow = 5\nsamples = ["fForce", "fTravel"]\n'
    (tmp_path / "st-codegen.toml").write_text(text)
    bundle = load(tmp_path)
    generate(bundle, "iec", tmp_path / "out")
    report = verify(bundle, tmp_path / "out", rows=100, jobs=1)
    assert report.passed and len(report.models) == 2
    (file,) = (tmp_path / "out" / "iec").glob("FB_Model.st")
    assert file.read_text().count("\n") < 500


REFUSED = {
    # onnxruntime itself takes no other layout
    "layout": (lambda: layer("GRU", layout=1), "attribute layout"),
    "clip": (lambda: layer("LSTM", clip=1.0), "attribute clip"),
    "activations": (lambda: layer("LSTM", activations=["Relu", "Tanh", "Tanh"]), "activations Relu, Tanh, Tanh"),
    "peepholes": (lambda: layer("LSTM", inputs=["", "", "", "W"]), "peepholes"),
    "direction": (lambda: layer("RNN", direction="sideways"), "direction sideways"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals(tmp_path, name):
    make, message = REFUSED[name]
    with pytest.raises((InputError, UnsupportedModelError), match=message):
        build.load(make(), tmp_path)
