"""What FB_TEPredict and FB_Compensator must compute, from the models alone (Eq. 2, 3 and 6); rows for a test suite."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.emit.blocks.comparison import CalledBlock
from st_codegen.emit.blocks.model import input_variables
from st_codegen.emit.blocks.tests import ReferenceVectors
from st_codegen.emit.output import read_manifest
from st_codegen.ir import BoolArray, ComplexArray, FloatArray, ModelIR, Precision, reference
from st_codegen.project.purpose import BlockCheck, DifferenceBound, RunsBlocks
from st_codegen.proof import bounds
from st_codegen.proof.vectors import ROWS
from st_codegen.te.compensation.correction import LEAST_TORQUE, SIGNED_LOAD
from st_codegen.te.compensation.harmonic_sum import ERROR_PER_ORDER
from st_codegen.te.compensation.parts import SUFFIX, names_of
from st_codegen.te.harmonics import AxisCorrection, Direction, Play, Quantity, TransmissionError
from st_codegen.walkers.base import LoadedModel

PREDICT, COMPENSATOR = "FB_TEPredict", "FB_Compensator"
#: Inputs of FB_Compensator beside the operating point.
_ANGLE, _BLEND, _LOAD_GIVEN = "fThetaOut_rad", "fBlendTime_s", "bLoadGiven"
#: SQRT, ATAN, COS and the few operations around them: relative error of each result, in units of roundoff.
_ROUNDINGS = 16
#: Operating points on which FB_TEPredict and FB_Compensator are tried; their models are verified by themselves.
_ROWS = 2_000
_UNIT = bounds.UNIT[Precision.FLOAT64]
#: What the root of a sum of squares that underflow may lack: half of the smallest number each, below the root.
_UNDERFLOW = 5e-162
#: Phases nearer to half a turn may come with either sign.
_HALF_TURN = 3.1


@dataclass(frozen=True)
class HarmonicSet:
    """Amplitudes (deg) and phases (rad) of one direction for some operating points, each (rows, orders).

    The bounds say how far the generated code may lie from them: what the models may differ, and the rounding of square
    root and arc tangent.
    """

    amplitude: FloatArray
    phase: FloatArray
    amplitude_bound: FloatArray
    phase_bound: FloatArray


_Values = dict[Quantity, FloatArray]
#: Predictions of a model for rows, (rows, outputs).
Evaluation = Callable[[ModelIR, FloatArray], FloatArray]


def harmonics(
    models: Sequence[ModelIR],
    te: TransmissionError,
    direction: Direction,
    x: FloatArray,
    bound: DifferenceBound = bounds.difference_bound,
    evaluate: Evaluation = reference.evaluate,
) -> HarmonicSet:
    """Amplitudes and phases that the models predict at operating points `x` (rows, features)."""
    by_name = {model.name: model for model in models}
    asked = {output.model for output in te.outputs if output.direction is direction}
    values = {name: evaluate(by_name[name], x) for name in asked}
    errors = {name: bound(by_name[name], x) for name in values}
    zero = np.zeros(len(x))
    columns = []
    for order in te.orders:
        outputs = te.quantities(direction, order)
        value = {quantity: values[of.model][:, of.output] for quantity, of in outputs.items()}
        error = {quantity: errors[of.model][:, of.output] for quantity, of in outputs.items()}
        correction = te.correction(direction, order)
        if correction is not None:
            value, error = _corrected(value, error, correction)
        terms = te.terms(direction, order)
        if terms and Quantity.PHASE in value:
            value, error = _as_parts(value, error)
        for quantity, added in terms.items():
            parts = [values[term.model][:, term.output] for term in added]
            total = value[quantity] + sum(parts)
            # each sum is rounded once, and no partial sum is larger than all magnitudes together
            size = np.abs(value[quantity]) + sum(np.abs(part) for part in parts)
            own = sum(errors[term.model][:, term.output] for term in added)
            value[quantity] = total
            error[quantity] = error[quantity] + own + 2 * len(parts) * _UNIT * size
        if Quantity.COSINE in value:
            columns.append(_polar(value, error))
        else:
            columns.append(
                (
                    value[Quantity.AMPLITUDE],
                    value.get(Quantity.PHASE, zero),
                    error[Quantity.AMPLITUDE],
                    error.get(Quantity.PHASE, zero),
                )
            )
    return HarmonicSet(*(np.column_stack(part) for part in zip(*columns, strict=True)))


def _corrected(value: _Values, error: _Values, correction: AxisCorrection) -> tuple[_Values, _Values]:
    """What an axis has of a harmonic, with what two products and a sum may be rounded by in the block and here."""

    def combined(terms: Sequence[tuple[float, Quantity]], constant: float = 0.0) -> tuple[FloatArray, FloatArray]:
        total = sum((weight * value[quantity] for weight, quantity in terms), np.float64(0.0)) + constant
        size = sum((abs(weight) * np.abs(value[quantity]) for weight, quantity in terms), np.float64(abs(constant)))
        own = sum((abs(weight) * error[quantity] for weight, quantity in terms), np.float64(0.0))
        return np.asarray(total), np.asarray(own * (1 + 4 * _UNIT) + 8 * _UNIT * size)

    if Quantity.COSINE in value:
        along, across = correction.parts
        made = {
            Quantity.COSINE: combined([(along, Quantity.COSINE), (-across, Quantity.SINE)]),
            Quantity.SINE: combined([(along, Quantity.SINE), (across, Quantity.COSINE)]),
        }
    else:
        made = {Quantity.AMPLITUDE: combined([(correction.factor, Quantity.AMPLITUDE)], correction.offset_deg)}
        if Quantity.PHASE in value:
            made[Quantity.PHASE] = combined([(1.0, Quantity.PHASE)], correction.turn_rad)
    return {q: found for q, (found, _) in made.items()}, {q: bound for q, (_, bound) in made.items()}


def _as_parts(value: _Values, error: _Values) -> tuple[_Values, _Values]:
    """Cosine and sine part of an amplitude and a phase; the block rounds COS, SIN and one product each."""
    amplitude, phase = value[Quantity.AMPLITUDE], value[Quantity.PHASE]
    size = np.abs(amplitude)
    moved = error[Quantity.AMPLITUDE] + (size + error[Quantity.AMPLITUDE]) * (error[Quantity.PHASE] + 4 * _UNIT)
    parts = {Quantity.COSINE: amplitude * np.cos(phase), Quantity.SINE: amplitude * np.sin(phase)}
    return parts, dict.fromkeys(parts, moved)


def _polar(value: _Values, error: _Values) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Amplitude, phase and their bounds, from cosine and sine part."""
    amplitude = np.hypot(value[Quantity.COSINE], value[Quantity.SINE])
    phase = np.arctan2(value[Quantity.SINE], value[Quantity.COSINE])
    moved = error[Quantity.COSINE] + error[Quantity.SINE]
    with np.errstate(divide="ignore", invalid="ignore"):
        turned = np.where(moved > 0, moved / np.maximum(amplitude - moved, 0.0), 0.0)
    lost = np.where((moved > 0) | (amplitude > 0), _UNDERFLOW, 0.0)
    most = np.minimum(turned + _ROUNDINGS * _UNIT * np.pi, np.pi)  # no two angles lie farther apart
    return amplitude, phase, moved + _ROUNDINGS * _UNIT * amplitude + lost, most


def check_transmission_error(
    models: Sequence[ModelIR],
    te: TransmissionError,
    code: RunsBlocks,
    seed: int,
    bound: DifferenceBound,
    names: Collection[str],
) -> list[BlockCheck]:
    """Run both blocks, or those of `names`, at random operating points inside the declared range, and compute what they
    must give."""
    rows = _ROWS
    random = np.random.default_rng(seed)
    x = _inside(te, rows, random)
    theta = random.uniform(-2 * np.pi, 2 * np.pi, rows)
    sets = {direction: harmonics(models, te, direction, x, bound) for direction in te.directions}
    checks: dict[str, Callable[[], BlockCheck]] = {
        PREDICT: lambda: _check_predict(te, code, x, sets),
        COMPENSATOR: lambda: _check_sum(te, code, x, theta, sets),
    }
    return [check() for name, check in checks.items() if not names or name in names]


def checked_blocks(te: TransmissionError) -> tuple[CalledBlock, ...]:
    """Both blocks, with the inputs that the checks set and the outputs that they look at.

    Rows follow each other in one instance on a controller, and no row may depend on the one before: nothing is blended
    from one direction of rotation to the other.
    """
    inputs = tuple(names_of(input_variables(te.features)))
    calls = max(len(te.cycles), 1)
    sets = [f"{name}{SUFFIX[direction]}" for direction in te.directions for name in ("aAmplitude", "aPhase")]
    outputs = tuple(f"{name}[{number}]" for name in sets for number in range(len(te.orders)))
    return (
        CalledBlock(PREDICT, inputs, outputs, calls=calls),
        CalledBlock(
            COMPENSATOR,
            (*inputs, _ANGLE, *((SIGNED_LOAD.name, _LOAD_GIVEN) if te.play else ())),
            ("fTE_deg",),
            {"bEnable": "TRUE", _BLEND: "0.0"},
            calls,
            (_LOAD_GIVEN,),
        ),
    )


def calls_of(folder: Path) -> int:
    """How many calls of FB_TEPredict a generated folder spreads its models over."""
    return int(read_manifest(folder).purpose.get("calls", 1))


def predicted(code: RunsBlocks, inputs: Mapping[str, FloatArray]) -> tuple[dict[str, ComplexArray], BoolArray]:
    """What FB_TEPredict answers, in deg: A * exp(i * phi) by order and direction, of order 0 the mean."""
    facts = read_manifest(code.folder).purpose
    result = code.call(PREDICT, inputs, len(next(iter(inputs.values()))), calls=calls_of(code.folder))
    values: dict[str, ComplexArray] = {}
    for direction in map(Direction, facts.get("directions", ())):
        whole = result[f"aAmplitude{SUFFIX[direction]}"] * np.exp(1j * result[f"aPhase{SUFFIX[direction]}"])
        values |= {f"order {order} {direction}": whole[:, number] for number, order in enumerate(facts["orders"])}
    return values, result["bValid"].astype(np.bool_)


def _feature_inputs(te: TransmissionError, x: FloatArray) -> dict[str, FloatArray]:
    return dict(zip(names_of(input_variables(te.features)), x.T, strict=True))


def _check_predict(
    te: TransmissionError, code: RunsBlocks, x: FloatArray, sets: dict[Direction, HarmonicSet]
) -> BlockCheck:
    result = code.call(PREDICT, _feature_inputs(te, x), len(x), calls=calls_of(code.folder))
    expected, got, bound = [], [], []
    for direction, harmonic in sets.items():
        suffix = SUFFIX[direction]
        amplitude = np.where(result["bValid"][:, None], result[f"aAmplitude{suffix}"], np.nan)
        phase = result[f"aPhase{suffix}"]
        # the same angle may come as +pi and -pi
        turns = np.round((phase - harmonic.phase) / (2 * np.pi))
        phase = phase - 2 * np.pi * turns
        expected += [harmonic.amplitude, harmonic.phase]
        got += [amplitude, phase]
        bound += [harmonic.amplitude_bound, harmonic.phase_bound]
    return BlockCheck(PREDICT, x, np.hstack(expected), np.hstack(got), np.hstack(bound))


def _check_sum(
    te: TransmissionError,
    code: RunsBlocks,
    x: FloatArray,
    theta: FloatArray,
    sets: dict[Direction, HarmonicSet],
) -> BlockCheck:
    """TE of Eq. 3; the sign of the speed chooses the direction."""
    backward = np.arange(len(x)) % 2 == 1 if len(sets) == 2 else np.full(len(x), Direction.BACKWARD in sets)
    signed = x.copy()
    signed[backward, te.speed_feature] *= -1.0
    fixed: dict[str, Any] = {"bEnable": np.ones(len(x), np.bool_), _BLEND: np.zeros(len(x))}
    inputs = _feature_inputs(te, signed) | {_ANGLE: theta, **fixed}
    loads = np.where(backward, -1.0, 1.0)
    if te.play:
        # every other pair of rows is given a load that has any sign in either direction
        given = np.arange(len(x)) % 4 >= 2
        loads = np.where(given, np.cos(theta), loads)
        torque = np.maximum(np.abs(x[:, te.play.torque_feature]), LEAST_TORQUE)
        inputs |= {_LOAD_GIVEN: given, SIGNED_LOAD.name: loads * torque}
    result = code.call(COMPENSATOR, inputs, len(x), calls=calls_of(code.folder))
    expected, bound = np.zeros(len(x)), np.zeros(len(x))
    if te.play:
        sets = _with_loads(te, te.play, sets, loads)
    for direction, harmonic in sets.items():
        angle = np.array(te.orders) * theta[:, None] + harmonic.phase
        chosen = backward if direction is Direction.BACKWARD else ~backward
        expected = np.where(chosen, np.sum(harmonic.amplitude * np.cos(angle), axis=1), expected)
        # here an angle of many turns is rounded before its cosine is taken; the block multiplies along its chain
        size = np.abs(harmonic.amplitude)
        chain = ERROR_PER_ORDER * np.array(te.orders)
        rounding = size * (chain + (_ROUNDINGS + len(te.orders)) * _UNIT * (1 + np.abs(angle)))
        own = harmonic.amplitude_bound + size * harmonic.phase_bound + rounding
        bound = np.where(chosen, np.sum(own, axis=1), bound)
    got = np.where(result["bValid"], result["fTE_deg"], np.nan)
    return BlockCheck(COMPENSATOR, signed, expected[:, None], got[:, None], bound[:, None])


def _with_loads(
    te: TransmissionError, play: Play, sets: dict[Direction, HarmonicSet], loads: FloatArray
) -> dict[Direction, HarmonicSet]:
    """The sets with the means that loads give, -1 .. 1 of the trained torque; 1 is the load of forward motion."""
    mean = te.orders.index(0)
    forward, backward = sets[Direction.FORWARD], sets[Direction.BACKWARD]
    both = forward.amplitude[:, mean] + backward.amplitude[:, mean]
    of_load = forward.amplitude[:, mean] - backward.amplitude[:, mean] + play.angle_deg
    size = np.abs(forward.amplitude[:, mean]) + np.abs(backward.amplitude[:, mean]) + play.angle_deg
    error = forward.amplitude_bound[:, mean] + backward.amplitude_bound[:, mean] + _ROUNDINGS * _UNIT * size
    found = {}
    for direction, side in ((Direction.FORWARD, 1.0), (Direction.BACKWARD, -1.0)):
        amplitude, bound = sets[direction].amplitude.copy(), sets[direction].amplitude_bound.copy()
        amplitude[:, mean] = 0.5 * (both + of_load * loads - play.angle_deg * side)
        bound[:, mean] = error
        found[direction] = dataclasses.replace(sets[direction], amplitude=amplitude, amplitude_bound=bound)
    return found


def prediction_vectors(te: TransmissionError, models: Sequence[LoadedModel]) -> ReferenceVectors:
    """FB_TEPredict at operating points inside the declared range."""
    x = _inside(te, ROWS, np.random.default_rng(0))
    by_name = {model.ir.name: model for model in models}

    def by_library(model: ModelIR, rows: FloatArray) -> FloatArray:
        return by_name[model.name].predict(reference.limited(model, rows))

    results: list[str] = []
    expected, allowed = [], []
    sure = np.ones(len(x), np.bool_)
    for direction in te.directions:
        found = harmonics([model.ir for model in models], te, direction, x, evaluate=by_library)
        sure &= np.all((np.abs(found.phase) < _HALF_TURN) & (found.phase_bound < np.pi), axis=1)
        for kind, values, bound in (
            ("aAmplitude", found.amplitude, found.amplitude_bound),
            ("aPhase", found.phase, found.phase_bound),
        ):
            results += [f"{kind}{SUFFIX[direction]}[{number}]" for number in range(values.shape[1])]
            expected.append(values)
            allowed.append(bound)
    return ReferenceVectors(
        name="TEPredict",
        block=PREDICT,
        results=tuple(results),
        inputs=x[sure],
        expected=np.hstack(expected)[sure],
        allowed=np.hstack(allowed)[sure],
        refuses_nan=True,
    )


def _inside(te: TransmissionError, rows: int, random: np.random.Generator) -> FloatArray:
    """Operating points inside the declared range, (rows, features)."""
    lower = np.array([feature.lower for feature in te.features], dtype=np.float64)
    upper = np.array([feature.upper for feature in te.features], dtype=np.float64)
    return lower + (upper - lower) * random.random((rows, len(te.features)))
