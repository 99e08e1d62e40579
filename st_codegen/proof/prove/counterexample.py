"""Inputs for which the executed text was seen to differ from the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from st_codegen.errors import GeneratedCodeError
from st_codegen.ir import FloatArray, ModelIR, reference
from st_codegen.proof.bounds import difference_bound
from st_codegen.proof.prove.axis import HIGHEST, LOWEST, from_keys
from st_codegen.proof.prove.disagree import OtherExpressionError, differing_rows, evaluated
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.floats import bits
from st_codegen.proof.prove.model import domain_of
from st_codegen.proof.prove.terms import Term
from st_codegen.proof.runner import GeneratedCode

#: Rows on which two expressions differ that are executed: one is wanted that the text itself shows.
_MOST_EXECUTED = 64


@dataclass(frozen=True)
class Counterexample:
    """An input for which the text was executed and differs from the model; `got` is None where it is not valid.

    `by_expression`: `expected` are the numbers of the model's expression, of which the library may give the last digits
    otherwise, within `allowed` of each output.
    """

    input: tuple[float, ...]
    expected: tuple[float, ...] | None
    got: tuple[float, ...] | None
    stops: str = ""
    by_expression: bool = False
    allowed: tuple[float, ...] = ()


def counterexample(
    model: ModelIR,
    code: GeneratedCode,
    block: str,
    outputs: tuple[int, ...],
    points: FloatArray,
    *,
    to_the_bit: bool = False,
) -> Counterexample | None:
    """The first of some points at which the executed text is not what the model demands.

    Within what the library leaves open, unless the text must have the bits of the reference (`to_the_bit`: a table).
    """
    if not len(points):
        return None
    expected = reference.evaluate(model, points)
    try:
        result = code.run_model(block, points, outputs)
    except GeneratedCodeError as error:
        for row in points:
            try:
                code.run_model(block, row[None, :], outputs)
            except GeneratedCodeError:
                return Counterexample(tuple(map(float, row)), None, None, str(error))
        return None
    got = np.where(result.valid[:, None], result.values, np.nan)
    same = (bits(expected) == bits(got)) | (np.isnan(expected) & np.isnan(got))
    if not to_the_bit and not model.exact:  # where the library leaves its last digits open, and the sign of a zero
        same |= np.abs(expected - got) <= difference_bound(model, reference.limited(model, points))
    for row in np.flatnonzero(~np.all(same, axis=1))[:1]:
        return Counterexample(
            tuple(map(float, points[row])),
            tuple(map(float, expected[row])) if not np.isnan(expected[row]).any() else None,
            tuple(map(float, got[row])) if result.valid[row] else None,
        )
    return None


def edge_rows(model: ModelIR) -> FloatArray:
    """Rows beside the ends of what the model takes of each input, and with NaN and infinities in it."""
    domain = domain_of(model)
    keys = np.stack([domain.low - 1, domain.low, domain.high, domain.high + 1])
    inside = domain.nearest_to_zero()
    rows = [inside]
    for feature in range(len(inside)):
        ends = keys[:, feature]
        for number in (np.nan, np.inf, -np.inf, *from_keys(np.clip(ends, LOWEST, HIGHEST)).tolist()):
            rows.append(np.where(np.arange(len(inside)) == feature, number, inside))
    return np.stack(rows)


def of_expressions(
    model: ModelIR, code: GeneratedCode, block: str, outputs: tuple[int, ...], difference: OtherExpressionError
) -> Counterexample | None:
    """An input for which the executed text gives other bits than the expression that the model demands."""
    try:
        rows = differing_rows(difference)[:_MOST_EXECUTED]
    except NotProvedError:  # a number of an earlier call, which no row of inputs tells
        return None
    if not len(rows):
        return None
    wanted = difference.wanted
    if any(isinstance(value, bool) or (isinstance(value, Term) and value.kind == "bool") for value in wanted):
        return counterexample(model, code, block, outputs, rows)
    columns = evaluated(wanted, difference.inputs.leaves(rows), len(rows))
    numbers = np.column_stack([column.astype(np.float64) for column in columns])
    chosen = [outputs[number] for number in difference.outputs]
    try:
        result = code.run_model(block, rows, chosen)
    except GeneratedCodeError:
        return counterexample(model, code, block, outputs, rows)
    differs = result.valid & np.any(bits(numbers) != bits(result.values), axis=1)
    for row in np.flatnonzero(differs)[:1]:
        allowed = difference_bound(model, rows[row : row + 1])[0][list(difference.outputs)]
        found = (rows[row], numbers[row], result.values[row], allowed)
        at, expected, got, bound = (tuple(map(float, number)) for number in found)
        return Counterexample(at, expected, got, by_expression=True, allowed=bound)
    return None
