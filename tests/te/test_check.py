"""What the check of blocks around models expects of them: bounds that hold whatever the models may differ."""

import dataclasses

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.te.check import _as_parts, _polar
from st_codegen.te.harmonics import Play, Quantity
from tests.te.projects import described

RANDOM = np.random.default_rng(0)
ROWS = 300
SIZE, PHASE = RANDOM.uniform(0.01, 2.0, ROWS), RANDOM.uniform(-3.1, 3.1, ROWS)
SIGNS = [(one, other) for one in (-1.0, 0.0, 1.0) for other in (-1.0, 0.0, 1.0)]


def changes(value, error, one, other):
    """The pair of numbers, each moved by its error in every way."""
    return [(value[one] + a * error[one], value[other] + b * error[other]) for a, b in SIGNS]


def test_parts_differ_by_no_more_than_their_bound_which_is_not_far():
    value = {Quantity.AMPLITUDE: SIZE, Quantity.PHASE: PHASE}
    error = {Quantity.AMPLITUDE: 1e-4 * RANDOM.random(ROWS), Quantity.PHASE: 1e-3 * RANDOM.random(ROWS)}
    parts, bound = _as_parts(value, error)
    moved = [
        (amplitude * np.cos(phase), amplitude * np.sin(phase))
        for amplitude, phase in changes(value, error, Quantity.AMPLITUDE, Quantity.PHASE)
    ]
    for number, quantity in enumerate((Quantity.COSINE, Quantity.SINE)):
        worst = np.max([np.abs(pair[number] - parts[quantity]) for pair in moved], axis=0)
        assert np.all(worst <= bound[quantity])
        assert np.mean(bound[quantity]) < 3 * np.mean(worst)
    exact = {quantity: np.zeros(ROWS) for quantity in value}
    for quantity, rounding in _as_parts(value, exact)[1].items():
        assert np.all((rounding > np.spacing(np.abs(parts[quantity]))) & (rounding < 8 * np.spacing(SIZE)))


def test_amplitude_and_phase_differ_by_no_more_than_their_bound_which_is_not_far():
    value = {Quantity.COSINE: SIZE * np.cos(PHASE), Quantity.SINE: SIZE * np.sin(PHASE)}
    error = {quantity: 1e-4 * RANDOM.random(ROWS) for quantity in value}
    amplitude, phase, of_amplitude, of_phase = _polar(value, error)
    moved = [np.array(pair) for pair in changes(value, error, Quantity.COSINE, Quantity.SINE)]
    turned = [np.arctan2(sine, cosine) - phase for cosine, sine in moved]
    for bound, changed in (
        (of_amplitude, [np.hypot(cosine, sine) - amplitude for cosine, sine in moved]),
        (of_phase, [(turn + np.pi) % (2 * np.pi) - np.pi for turn in turned]),
    ):
        worst = np.max(np.abs(changed), axis=0)
        assert np.all(worst <= bound)
        assert np.mean(bound) < 3 * np.mean(worst)


def test_a_harmonic_that_may_vanish_has_any_phase():
    value = {Quantity.COSINE: np.array([1e-9, 1.0]), Quantity.SINE: np.zeros(2)}
    error = {Quantity.COSINE: np.full(2, 1e-8), Quantity.SINE: np.zeros(2)}
    amplitude, _, _, phase = _polar(value, error)
    assert (phase == np.pi).tolist() == [True, False]
    assert np.all(np.isfinite(amplitude * phase))


def test_a_harmonic_that_is_exactly_nothing_has_a_phase():
    nothing = dict.fromkeys((Quantity.COSINE, Quantity.SINE), np.zeros(1))
    assert _polar(nothing, nothing)[3] < 1e-12


def test_squares_that_underflow_are_within_the_bound_of_an_amplitude():
    tiny = np.array([1e-160, 3e-162, 1e-300])
    parts = {Quantity.COSINE: tiny, Quantity.SINE: tiny}
    amplitude, _, bound, _ = _polar(parts, dict.fromkeys(parts, np.full(3, 5e-324)))
    assert np.all(np.abs(np.sqrt(tiny * tiny + tiny * tiny) - amplitude) <= bound)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reduction_ratio": 0.0}, "give a positive number"),
        ({"speed_feature": 3}, "there are 3 features"),
        ({"orders": (1, 39), "play": Play(0.05, 1)}, "a play needs the mean, order 0, of both directions"),
        ({"cycles": (("parts",), ("parts",))}, "the cycles do not have each model once"),
    ],
)
def test_what_models_cannot_be_for_is_refused(changes, message):
    _, te = described()
    with pytest.raises(InputError, match=message):
        dataclasses.replace(te, **changes)
