"""Every operation is known to every stage, and what it says of itself is true."""

import dataclasses
import importlib
import inspect
import pkgutil

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import st_codegen.emit.blocks.model  # noqa: F401 - all code of operations is registered with it
from st_codegen import ir
from st_codegen.emit.blocks.operations import lay_out
from st_codegen.errors import InputError
from st_codegen.ir import (
    BranchedTree,
    CellTable,
    ColumnFunction,
    CutTrees,
    FactoredKernel,
    Piecewise,
    Rank,
    RankColumn,
    SlidingLinear,
    TreeEnsemble,
    reference,
)
from st_codegen.ir.preorder import preorder
from st_codegen.passes import domain
from st_codegen.proof import bounds
from tests.models import SMALL_MODELS

MODULES = [importlib.import_module(f"{ir.__name__}.{info.name}") for info in pkgutil.iter_modules(ir.__path__)]
OPERATIONS = {
    value
    for module in MODULES
    for value in vars(module).values()
    if inspect.isclass(value) and dataclasses.is_dataclass(value) and hasattr(value, "operand_width")
}
#: What each stage has to know of an operation.
CONCERNS = {
    "the reference (ir/reference.py)": reference.apply,
    "bounds on differences (proof/bounds.py)": bounds.step,
    "the search for overflow (passes/domain.py)": domain.magnitudes,
    "its code (emit/blocks)": lay_out,
}
#: Operations that tests make at random, beside the small models.
# cut and branched trees: tests/passes/test_slabs.py, test_branches.py
AT_RANDOM = {BranchedTree, CellTable, CutTrees, FactoredKernel, Rank, TreeEnsemble}
FUNCTIONS = {type(op): op for model in SMALL_MODELS.values() for op in model.ops if isinstance(op, ColumnFunction)}


@pytest.mark.parametrize("concern", CONCERNS)
def test_every_operation_is_known_to(concern):
    function = CONCERNS[concern]
    unknown = {op.__name__ for op in OPERATIONS if function.dispatch(op) is function.dispatch(object)}
    assert not unknown


def test_every_operation_is_tried_by_a_small_model():
    tried = {type(op) for model in SMALL_MODELS.values() for op in model.ops}
    assert {op.__name__ for op in OPERATIONS - tried - AT_RANDOM} == set()


@pytest.mark.parametrize("op", FUNCTIONS.values(), ids=lambda op: type(op).__name__)
@given(data=st.data())
def test_slope_and_magnitude_of_a_function_hold(op, data):
    numbers = st.lists(st.floats(-1e6, 1e6), min_size=op.width, max_size=op.width)
    x, y = (np.array([data.draw(numbers)]) for _ in range(2))
    if getattr(op, "sentinel", None) is not None:  # a number that counts as missing is a jump
        y = x
    difference = np.abs(x - y)
    values = [op.value(z) for z in (x, y)]
    rounding = 1e-15 * (np.abs(x) + np.abs(y))
    assert np.all(np.abs(values[0] - values[1]) <= op.slope(x, difference) * difference + rounding)
    assert np.all(np.abs(values[0]) <= op.largest(np.abs(x[0])))


@pytest.mark.parametrize("edge", [np.nan, np.inf])
def test_edges_of_ranks_are_numbers(edge):
    with pytest.raises(InputError, match=r"RankColumn\.edges: 1 coefficient not finite"):
        RankColumn(0, np.array([0.0, edge]))


@pytest.mark.parametrize("name", SMALL_MODELS)
def test_a_table_without_rows_has_answers_without_rows(name):
    model = SMALL_MODELS[name]
    none, answers = np.zeros((0, len(model.features))), (0, len(model.outputs))
    assert reference.evaluate(model, none).shape == bounds.difference_bound(model, none).shape == answers


def test_no_two_points_of_a_piecewise_cubic_are_steeper_than_its_slope():
    op = Piecewise((0,), [0, 2], [0.0, 1.0], [1.0, -3.0], [[0.5, 0, 0, 0], [0, 0, 0, 2.0], [2.5, 0, 0, 0]])
    x, y = (grid.reshape(-1, 1) for grid in np.meshgrid(np.linspace(-0.5, 1.5, 41), np.linspace(-0.5, 1.5, 41)))
    difference = np.abs(x - y)
    slope = op.slope(x, difference)
    assert np.all(np.abs(op.value(x) - op.value(y)) <= slope * difference + 1e-15)
    inside = (x > 0.2) & (x < 0.8) & (difference > 0.0) & (difference < 0.19)
    assert np.all(slope[inside] == 6.0)  # of 2 * x ** 3 at its end, and no jump


@pytest.mark.parametrize(("starts", "offsets"), [([0, 2], [0, 1]), ([1, 0], [-1, 0])])
def test_sums_at_places_stay_inside_their_operand(starts, offsets):
    op = SlidingLinear((0,), [[1.0, 2.0]], [0.0], starts, offsets)
    with pytest.raises(InputError, match="SlidingLinear"):
        op.check_operands(3)


def test_any_node_may_be_the_left_child_of_any_other():
    """Two trees, the nodes of the first behind those of the second; the root of neither is node 0."""
    found = preorder(np.array([4, 2]), np.array([-1, -1, 0, -1, 3, -1]), np.array([-1, -1, 1, -1, 5, -1]))
    assert found.order.tolist() == [4, 3, 5, 2, 0, 1]
    assert found.roots.tolist() == [0, 3]
    assert found.left.tolist() == [1, -1, -1, 4, -1, -1]
    assert found.right.tolist() == [2, -1, -1, 5, -1, -1]
    assert found.size.tolist() == [3, 1, 1, 3, 1, 1]
