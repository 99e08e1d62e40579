"""Weighted sums: several in a loop, each in its own order."""

import dataclasses

import numpy as np
import pytest

from st_codegen.emit.targets import TARGETS
from st_codegen.ir import Activation, Feature, Function, Linear, ModelIR, Source, SummationOrder, reference
from st_codegen.passes.domain import limit_inputs
from tests.emit.test_emitted import rendered, run

RANDOM = np.random.default_rng(0)


def sums(rows, columns, function=None):
    """A model of so many sums of so many numbers, added in their order, and a function of each."""
    linear = Linear(
        (0,), RANDOM.normal(size=(rows, columns)), RANDOM.normal(size=rows), order=SummationOrder.SEQUENTIAL
    )
    ops = (linear,) if function is None else (linear, Activation((1,), function, rows))
    features = tuple(Feature(f"f{number}") for number in range(columns))
    outputs = tuple(f"out{number}" for number in range(rows))
    return limit_inputs(ModelIR("sums", features, ops, outputs, Source("none", "0", "sums")))


@pytest.mark.parametrize("rows", [1, 2, 4, 5, 8, 11])
@pytest.mark.parametrize("columns", [1, 3])
@pytest.mark.parametrize("function", [None, Function.RELU])
@pytest.mark.parametrize("longest", [65_536, 18])
def test_each_sum_is_added_in_its_order(rows, columns, function, longest, tmp_path):
    """Also where the weights are cut into several arrays; many sums would differ in another order."""
    model = sums(rows, columns, function)
    x = RANDOM.normal(size=(200, columns))
    limits = dataclasses.replace(TARGETS["iec"].limits, max_array=longest)
    assert np.array_equal(run(model, "iec", tmp_path, x, limits), reference.evaluate(model, x))


def test_a_number_is_read_once_for_four_sums():
    (file,) = (file for file in rendered(sums(10, 3), "iec") if "Sums" in file.path)
    text = "".join(file.pieces)
    assert "FOR nRow := 0 TO 4 BY 4 DO" in text
    assert text.count(":= aInput[nColumn];") == 2
    assert "fSum2 := fSum2 + fColumn * WEIGHT_1[27 + nColumn];" in text


def test_a_sum_alone_has_no_place_in_a_table():
    (file,) = (file for file in rendered(sums(1, 3), "iec") if "Sums" in file.path)
    assert "fSum := fSum + aInput[nColumn] * WEIGHT_1[nColumn];" in "".join(file.pieces)
