"""How far an engine of TwinCAT's machine learning runtime may lie from the library, row by row.

Derived as in `bounds`, for the arithmetic that the format prescribes: trees and support vectors in float64, networks
with float32 weights and float32 arithmetic. Assumed is what the format does not say: sums in any order, functions
within a few units of the last place.
"""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from st_codegen import ir
from st_codegen.beckhoff_ml.blocks import engine_limits
from st_codegen.beckhoff_ml.engines import Affine, Engine, SvmEngine, checked_engines, engines_of, output_of
from st_codegen.ir import reference
from st_codegen.ir.arrays import BoolArray, FloatArray
from st_codegen.ir.trees import added_up, of_each_tree
from st_codegen.proof import bounds

#: Roundings of `scaling * x + offset` and of its two numbers.
_AFFINE_ROUNDINGS = 8
#: What float32 loses below its smallest normal number, many times over.
_TINY = 1e-36


def engine_bound(model: ir.ModelIR, x: FloatArray) -> FloatArray:
    """Bound on |library - engine| for rows of `x` (rows, features), shape (rows, outputs).

    0 where every step is exact, infinite where rounding may send a row through other leaves of a tree without bound.
    """
    engine = engines_of(model)[0]
    unit = max((bounds.UNIT[op.precision] for op in model.ops if isinstance(op, ir.Scale)), default=0.0)
    values = reference.trace(model, x)
    differences = [np.zeros_like(values[0])]
    with np.errstate(all="ignore"):
        for number, op in enumerate(model.ops, 1):
            operands = [values[value] for value in op.inputs]
            given = [differences[value] for value in op.inputs]
            if number == engine.first:
                given = [given[0] + _input_error(engine, x, operands[0], unit)]
            difference = bounds.step(op, operands, given, values[number])
            if engine.first <= number <= engine.last and not isinstance(engine, SvmEngine):
                # of support vectors `proof.bounds` allows for two evaluations in float64
                difference = difference + _own_error(op, engine, operands[0], given[0], values[number])
            elif isinstance(op, ir.Round):
                difference = difference + bounds.UNIT[ir.Precision.FLOAT32] * np.abs(
                    operands[0]
                )  # the engine does not round
            differences.append(np.where(np.isnan(difference), np.inf, difference))
        core = values[engine.last]
        difference = differences[-1] + _affine_error(
            output_of(model, engine.last), core, differences[engine.last], unit
        )
    if engine.precision is ir.Precision.FLOAT32:  # it hands the result over as REAL
        difference = difference + bounds.UNIT[ir.Precision.FLOAT32] * np.abs(values[-1])
        # beyond REAL, on the way or at the end, the engine has no answer and the block flags the row
        largest = np.max(np.abs(np.hstack(values)), axis=1, keepdims=True)
        difference = np.where(largest < ir.CEILING[ir.Precision.FLOAT32], difference, np.inf)
    return np.asarray(difference)


def _input_error(engine: Engine, x: FloatArray, operand: FloatArray, unit: float) -> FloatArray:
    """The transformation of the inputs and their rounding, in the columns that the first operation reads."""
    size = np.abs(operand)
    error = np.zeros_like(operand)
    if not engine.input.changes_nothing:
        # any column may come from any feature: the largest error of all of them is one for each
        whole = _affine_error(engine.input, x, np.zeros_like(x), unit)
        error = error + np.max(whole, axis=1, keepdims=True)
    if engine.rounds or engine.precision is ir.Precision.FLOAT32:
        # the input itself is handed over as REAL, and what is computed from it is rounded again
        single = bounds.UNIT[ir.Precision.FLOAT32]
        handed = np.max(np.abs(engine.input.scaling * x), axis=1, keepdims=True)
        error = error + 2 * single * (size + handed + error)
    return error


def _affine_error(affine: Affine, x: FloatArray, difference: FloatArray, unit: float) -> FloatArray:
    """Rounding of `scaling * x + offset` where the library takes its steps one by one, rounded by `unit`."""
    if affine.changes_nothing:
        return np.zeros_like(x)
    size = np.abs(affine.scaling) * (np.abs(x) + difference) + affine.terms
    return _AFFINE_ROUNDINGS * unit * size


@singledispatch
def _own_error(
    op: ir.Operation, engine: Engine, operand: FloatArray, given: FloatArray, result: FloatArray
) -> FloatArray:
    """What the engine's own numbers and arithmetic add to the difference: one rounding, unless registered otherwise."""
    return bounds.UNIT[engine.precision] * np.abs(result)


@_own_error.register
def _(op: ir.Linear, engine: Engine, operand: FloatArray, given: FloatArray, result: FloatArray) -> FloatArray:
    weights = np.abs(op.weights)
    size = (np.abs(operand) + given) @ weights.T + np.abs(op.bias)
    # one rounding of each weight, one of each product, and the sum; the weights' own error grows the sum a little
    terms = bounds.gamma(op.operand_width + 4, engine.precision)
    return terms * (1 + bounds.UNIT[engine.precision]) * size + _TINY


@_own_error.register
def _(op: ir.Activation, engine: Engine, operand: FloatArray, given: FloatArray, result: FloatArray) -> FloatArray:
    roundings = np.where(op.exact, 1.0, bounds.FUNCTION_ROUNDINGS)
    return roundings * bounds.UNIT[engine.precision] * (np.abs(result) + given + 1.0) + _TINY


@_own_error.register
def _(op: ir.TreeEnsemble, engine: Engine, operand: FloatArray, given: FloatArray, result: FloatArray) -> FloatArray:
    return _tree_error(op, result)


def _tree_error(op: ir.TreeEnsemble, result: FloatArray) -> FloatArray:
    """Leaves that were divided one by one, and sums in another precision or order than the library's."""
    same = op.divisor == 1.0 and op.sum_precision is ir.Precision.FLOAT64 and not op.base_last
    if same:
        return np.zeros_like(result)
    total = added_up(op, of_each_tree(op, np.maximum, np.abs(op.leaf_value)))
    size = total / abs(op.divisor) + np.abs(op.base) / (1.0 if op.base_last else abs(op.divisor))
    terms = op.n_trees + 2
    library = bounds.gamma(terms, op.sum_precision)
    return np.broadcast_to((library + bounds.gamma(terms, ir.Precision.FLOAT64)) * size, result.shape)


def engine_answers(model: ir.ModelIR, x: FloatArray) -> BoolArray:
    """The rows of `x` that an engine answers: none with a missing value, and none that does not fit its numbers."""
    answered: BoolArray = ~np.any(np.isnan(x), axis=1)
    for column, limit in enumerate(engine_limits(model, checked_engines(model)[0])):
        if limit is not None:
            answered &= np.abs(x[:, column]) < limit
    return answered
