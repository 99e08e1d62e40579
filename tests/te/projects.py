"""Small bundles whose coefficients are known, generated and loaded into the interpreter."""

import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from st_codegen.emit.contents import Contents
from st_codegen.emit.render import render
from st_codegen.emit.targets import TARGETS
from st_codegen.ir import Feature, Linear, ModelIR, Source
from st_codegen.passes.domain import limit_inputs
from st_codegen.st import load_project
from st_codegen.te.harmonics import Direction, HarmonicOutput, Play, Quantity, TransmissionError
from st_codegen.te.purpose import Compensation

BOTH = (Direction.FORWARD, Direction.BACKWARD)
RATIO = 81.0
FEATURES = (
    Feature("speed_rpm", "rpm", 100.0, 1800.0),
    Feature("torque_Nm", "N m", 0.0, 1800.0),
    Feature("temperature_C", "degC", 25.0, 35.0),
)
ORDERS = (0, 1, 39)
#: A play, with the load's magnitude in the second feature.
PLAY = Play(0.05, 1)
PAPER_ORDERS = (0, 1, 3, 39, 40, 78, 81, 156, 162, 240)


def coefficient(number):
    """The part `number` of a set: different for all, nearly constant over the operating range."""
    return 0.01 * (1.0 + 0.37 * number) * (-1.0) ** number


def described(orders=ORDERS, directions=BOTH, slope=1e-6, play=None):
    """One linear model with an output for each quantity, and the harmonics that it predicts."""
    outputs = []
    for direction in directions:
        for order in orders:
            quantities = [Quantity.AMPLITUDE] if order == 0 else [Quantity.COSINE, Quantity.SINE]
            for quantity in quantities:
                outputs.append(HarmonicOutput(direction, order, quantity, "parts", len(outputs)))
    n = len(outputs)
    weights = np.full((n, 3), slope)
    bias = np.array([coefficient(number) for number in range(n)])
    names = tuple(f"out{i}" for i in range(n))
    model = ModelIR("parts", FEATURES, (Linear((0,), weights, bias),), names, Source("none", "0", "linear"))
    te = TransmissionError("small", FEATURES, 0, RATIO, tuple(orders), tuple(directions), tuple(outputs), play=play)
    return limit_inputs(model), te


def contents(model, te):
    """What is printed for a model that predicts harmonics."""
    purpose = Compensation(te)
    return Contents((model,), purpose.application(), purpose.uses())


def project(orders=ORDERS, directions=BOTH, slope=1e-6, play=None):
    """A bundle of one linear model with an output for each quantity, and the blocks around it."""
    return contents(*described(orders, directions, slope, play))


def texts(ir, target):
    """The generated files of a project: path -> text."""
    return {file.path: "".join(file.pieces) for file in render(ir, TARGETS[target])}


@cache
def loaded(target, orders=ORDERS, directions=BOTH, slope=1e-6, play=None):
    """The checked text of a small bundle for a target."""
    return loaded_with(target, "", orders, directions, slope, play)


@cache
def loaded_with(target, more, orders=ORDERS, directions=BOTH, slope=1e-6, play=None):
    """The same with further text, such as a block that calls the generated ones."""
    with tempfile.TemporaryDirectory() as name:
        for path, text in {**texts(project(orders, directions, slope, play), target), "More.st": more}.items():
            file = Path(name) / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
        return load_project([Path(name)], TARGETS[target].dialect)


def parts(direction_number, orders=ORDERS):
    """Cosine and sine parts of a direction (0: the first) where all inputs are 0 slopes: arrays over the orders."""
    width = 2 * len(orders) - (0 in orders)
    number = direction_number * width
    cosine, sine = [], []
    for order in orders:
        cosine.append(coefficient(number))
        sine.append(0.0 if order == 0 else coefficient(number + 1))
        number += 1 if order == 0 else 2
    return np.array(cosine), np.array(sine)


def error_codes():
    """Values of E_TEError by name."""
    from st_codegen.te.compensation.codes import TE_ERROR

    return {code.name: code.value for code in TE_ERROR.all}
