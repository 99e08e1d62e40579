"""Operations and models that cannot be computed are refused where they are made, with what is wrong with them."""

import dataclasses

import numpy as np
import pytest

from st_codegen import ir
from st_codegen.errors import InputError
from st_codegen.ir.preorder import preorder
from tests.models import model

#: A split with two leaves.
TREE = ir.TreeEnsemble(
    (0,), (ir.TreeColumn(0),), [0], [0, -1, -1], [0.5, 0, 0], [1, 0, 0], [2, 0, 0], [False] * 3, [0, 0, 1],
    [[1.0], [2.0]], [0], [0.0], ir.Comparison.LESS,
)  # fmt: skip
MODEL = model(ir.Scale((0,), ir.Operator.ADD, [1.0]), features=1)
CELLS = ir.CellTable((0,), (ir.TableAxis(0, [0, 1]),), (2,), [[1.0], [2.0]], [0], [0.0])
CUBIC = ir.Piecewise((0,), [0, 2], [0.0, 1.0], [1.0, -3.0], [[0.5, 0, 0, 0], [0, 0, 0, 2.0], [2.5, 0, 0, 0]])
VECTORS = ir.KernelSum((0,), ir.Kernel.RBF, [[1.0]], [[1.0]], [0.0])
LEAVES = ir.LinearLeaves([1.0, 2.0], [0, 1, 1], [0], [3.0])
SCAN = ir.Scan((0,), (ir.Linear((0,), [[1.0, 1.0]], [0.0]),), [0], 1, [0.0])
SLIDING = ir.SlidingLinear((0,), [[1.0]], [0.0], [0], [0])


@pytest.mark.parametrize(
    ("made", "changes", "message"),
    [
        (TREE, {"left": [1, 0]}, r"TreeEnsemble\.left: shape \(2,\), expected \(3,\)"),
        (TREE, {"sum_precision": ir.Precision.FLOAT32, "base": [0.1]}, "is no float32"),
        (TREE, {"divisor": 0.0}, r"TreeEnsemble\.divisor: 0\.0"),
        (TREE, {"leaf_value": [[1.0, 2.0], [3.0, 4.0]]}, "leaves of width 2 for 1 output"),
        (TREE, {"roots": [1]}, "not a rising list that starts at node 0"),
        (TREE, {"split": [1, -1, -1]}, "a column that does not exist"),
        (TREE, {"left": [0, 0, 0]}, "a child lies before its parent or outside its tree"),
        (TREE, {"right": [3, 0, 0]}, "a child lies before its parent or outside its tree"),
        (TREE, {"leaf": [0, 0, 2]}, "a leaf without a value"),
        (TREE, {"threshold": [np.nan, 0, 0]}, "NaN or -infinity"),
        (TREE, {"tree_output": [1]}, "an output that does not exist"),
        (
            TREE,
            {"aggregate": ir.Aggregate.MAXIMUM, "base": [0.0, 0.0]},
            "the maximum of an output to which no tree",
        ),
        (LEAVES, {"zero_magnitude": -1.0}, r"zero_magnitude: -1\.0"),
        (LEAVES, {"start": [0, 1, 2]}, "covers all coefficients"),
        (MODEL, {"features": ()}, "model 'm' has no features"),
        (MODEL, {"magnitude_limits": (1.0, 2.0)}, "2 limits, 1 feature"),
        (MODEL, {"accepted": (None, None)}, "2 limits, 1 feature"),
        (MODEL, {"ops": ()}, "model 'm' computes nothing"),
        (
            MODEL,
            {"ops": (ir.Scale((1,), ir.Operator.ADD, [1.0]),)},
            "operation 0: reads a value that is not yet",
        ),
        (MODEL, {"ops": (ir.Scale((0,), ir.Operator.ADD, [1.0, 2.0]),)}, r"\(Scale\): expects 2 columns, gets 1"),
        (MODEL, {"ops": (dataclasses.replace(TREE, columns=(ir.TreeColumn(1),)),)}, "TreeEnsemble: reads .* outside"),
        (MODEL, {"outputs": ("y", "z")}, "2 outputs named, 1 computed"),
        (MODEL, {"estimates": (ir.OutputKind.MEAN, ir.OutputKind.DEVIATION)}, "2 kinds of 1 output"),
        (ir.Feature("x"), {"seen": (2.0, 1.0)}, r"the range 2\.0 \.\. 1\.0 is empty or not finite"),
        (ir.Feature("x"), {"lower": 0.0, "upper": np.inf}, r"the range 0\.0 \.\. inf is not finite"),
        (ir.Feature("x"), {"lower": 0.0}, "give both ends of the range, or none"),
        (ir.Feature("x"), {"lower": 1.0, "upper": 0.0}, r"the range 1\.0 \.\. 0\.0 is empty"),
        (CELLS, {"stored": [1]}, "a column that the table does not have"),
        (CELLS, {"axes": (ir.TableAxis(0, [0, 2]),)}, "a row behind the end of the table"),
        (CELLS.axes[0], {"offset": [-1, 0]}, "empty, or before the table"),
        (ir.RankColumn(0, [1.0]), {"edges": [1.0, 1.0]}, "not strictly rising"),
        (ir.Classes((0, 1), (ir.OutputKind.CLASS,)), {"kinds": ()}, "the first output of a classifier"),
        (ir.CoupledPairs((0,), 2), {"count": 1}, "1 classes, there are two or more"),
        (ir.ArgMax((0,), 2), {"n_columns": 0}, "ArgMax of 0 columns"),
        (ir.Distances((0,), [[1.0]]), {"vectors": np.zeros((0, 1))}, "no vectors"),
        (ir.Distances((0,), [[1.0]]), {"largest": True}, "the largest of squares"),
        (ir.NearestMean((0,), [[1.0, 2.0]], 1), {"count": 3}, "3 of 2 columns"),
        (ir.WeightedMedian((0,), [1.0]), {"weights": [-1.0]}, "none, or a negative one"),
        (ir.Scale((0,), ir.Operator.DIVIDE, [1.0]), {"constant": [0.0]}, "division by a constant that is zero"),
        (ir.FillMissing((0,), [0.0]), {"sentinel": np.inf}, "the sentinel inf is not finite"),
        (ir.Activation((0,), ir.Function.ELU, 1), {"parameter": np.nan}, "the parameter nan is not finite"),
        (SLIDING, {"starts": []}, "no weights, or no places"),
        (VECTORS, {"support_vectors": np.zeros((0, 1)), "coefficients": np.zeros((1, 0))}, "no support vectors"),
        (VECTORS, {"coef0": np.inf}, "gamma 1.0 or coef0 inf is not finite"),
        (VECTORS, {"degree": -1}, "degree -1 is negative"),
        (CUBIC, {"start": [1, 2]}, "not where the knots of each column start"),
        (CUBIC, {"knots": [1.0, 0.0]}, "not rising finite numbers in each column"),
        (CUBIC, {"pieces": [[0.5, 1, 0, 0], [0, 0, 0, 2.0], [2.5, 0, 0, 0]]}, "a piece that has no end"),
        (CUBIC, {"at": [0.0, np.nan]}, "a value or a coefficient is no number"),
        (SCAN, {"starts": []}, "no operations, or no rounds"),
        (SCAN, {"columns": 2}, r"operation 0 \(Linear\): reads what is not computed, or wide"),
        (SCAN, {"body": (ir.Linear((0,), [[1.0, 1.0]] * 2, [0.0] * 2),)}, "a state of 1 number, a round leaves 2"),
    ],
)
def test_what_cannot_be_is_refused(made, changes, message):
    with pytest.raises(InputError, match=message):
        dataclasses.replace(made, **changes)


def test_axes_of_a_grid_rise():
    with pytest.raises(InputError, match="not strictly rising"):
        ir.FactoredKernel((0,), (0,), (np.array([1.0, 1.0]),), [[1.0, 2.0]], [0.0], 1.0)


def test_a_child_outside_of_all_trees_is_refused():
    with pytest.raises(InputError, match="a child number outside the tree"):
        preorder(np.array([0]), np.array([3, -1, -1]), np.array([2, -1, -1]))
