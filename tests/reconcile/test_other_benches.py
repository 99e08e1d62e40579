"""What benches have that the rig has not: loud runs, steps, starts of curves, days; none of it gets a false name."""

import re
from dataclasses import replace

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.data.noise import estimate
from st_codegen.reconcile.data.observations import Observations, labels, order_of_runs
from st_codegen.reconcile.fit.fitting import fit
from st_codegen.reconcile.fit.state import State, piece_of
from st_codegen.reconcile.fit.target import FitData, groups_of
from st_codegen.reconcile.judge.claims import Retuned
from st_codegen.reconcile.judge.lookalikes import doubted
from st_codegen.reconcile.mistakes.examine import examine
from st_codegen.reconcile.report.summary import summary
from st_codegen.reconcile.rest.lasting import wander_over_runs
from st_codegen.reconcile.rest.suspects import excused
from st_codegen.reconcile.rest.unexplained import main_cause
from st_codegen.reconcile.search.states import in_one_piece
from st_codegen.reconcile.search.surroundings import is_of_its_place, may_be_a_start, told_order
from st_codegen.rig.model import RigModel

from .test_core import RIG, effect, grid
from .test_misread import AT, KNOWN, PATH, WHOLE

pytestmark = pytest.mark.thorough

ORDERS = np.array(WHOLE.orders())


def curves(rig, at, orders, sigma, seed=0, added=0.0):
    """Curves of a rig with noise of each run's own size (n,), which their other orders tell."""
    random, sigma = np.random.default_rng(seed), np.broadcast_to(sigma, (len(at),))[:, None]
    values = rig.coefficients(at, orders.tolist()) + added
    noise = sigma * (random.standard_normal(values.shape) + 1j * random.standard_normal(values.shape))
    values = values + np.where(orders == 0, noise.real, noise)
    spectral = np.broadcast_to(sigma, values.shape).copy()
    return Observations(at, labels(at), orders, values, run=order_of_runs(at), spectral_deg=spectral)


def test_runs_that_are_louder_than_others_are_not_off_for_it():
    """Noise that grew with the speed made every order of the rig "another in each run"."""
    for seed in range(5):
        data = curves(WHOLE, AT, ORDERS, 1e-5 + 2e-4 * (AT.speed_rpm / 1800) ** 3, seed)
        left = data.values - WHOLE.coefficients(AT, ORDERS.tolist())
        noise, none = estimate(data, left), np.zeros(len(ORDERS), bool)
        assert not excused(data, left, noise, none).any()
        # what the curves say of their noise tells it
        unknown = replace(data, spectral_deg=None)
        assert excused(unknown, left, estimate(unknown, left), none).any()


def test_what_carries_a_held_out_gap_is_said_of_few_curves_only():
    """Of 16 curves alike a third carries the power of the gap by chance."""
    result = reconcile_observations(WHOLE, curves(WHOLE, AT, ORDERS, 1e-5), KNOWN)
    assert not replace(result, carriers=16 / 3 - 0.1, unseen_curves=16).few_carry
    assert replace(result, carriers=3.0, unseen_curves=16).few_carry
    assert replace(result, carriers=3.0, unseen_curves=0).few_carry


def test_what_reaches_many_orders_may_have_changed_any():
    """A step of the curves at one angle, under load, was called another size of a pin, of order 80."""
    pins = next(i for i, one in enumerate(WHOLE.effects) if one.name == "pin_error" and 80 in one.touched_orders())
    changed = list(WHOLE.effects)
    changed[pins] = changed[pins].with_values({**changed[pins].values, "amplitude_deg": 4e-4})
    data = curves(replace(WHOLE, effects=tuple(changed), zero_offset_deg=-0.02), AT, ORDERS, 1e-5)
    found = reconcile_observations(WHOLE, data, KNOWN).conclusions
    (one,) = found.retuned
    assert found.offset_changed and one.after.orders == (80,) and not found.of_offset
    # a constant wave of that order from elsewhere would look the same; without that doubt
    assert one.is_open
    found = replace(found, retuned=(replace(one, is_open=False),))
    foreign = [k for k in range(4, 60, 2) if k not in WHOLE.orders()]
    for few in (foreign[:7], [k for k in range(4, 30, 2) if k not in WHOLE.orders()]):
        assert not doubted(found, few, [], WHOLE.orders(), in_samples=False).retuned[0].is_open
    several = doubted(found, foreign, [], WHOLE.orders(), in_samples=False)
    assert several.retuned[0].is_open and several.of_offset == ("something_else",)
    assert not doubted(found, foreign[:7], [], WHOLE.orders(), in_samples=False).of_offset


def test_where_curves_begin_a_name_is_not_the_only_one():
    data = curves(WHOLE, AT, ORDERS, 1e-5)
    final = reconcile_observations(WHOLE, data, KNOWN).conclusions.final
    bump = {"height_deg": 1e-3, "width_deg": 2.0}
    near, far = (effect("local_defect", centre_deg=centre, **bump) for centre in (355.0, 200.0))
    assert may_be_a_start(final, near) and not may_be_a_start(final, far)
    heights = {"amplitude_deg": (1e-3,) * 9, "phase_rad": (0.0,) * 9}
    many, few = (
        effect(
            "structural_resonance", orders=orders, frequency_Hz=50.0, damping_ratio=0.03,
            **{key: value[: len(orders)] for key, value in heights.items()},
        )
        for orders in (tuple(range(130, 139)), (156, 162, 240))
    )  # fmt: skip
    assert may_be_a_start(final, many) and not may_be_a_start(final, few)
    table = replace(final, target=replace(final.target, data=replace(final.target.data, spectral_deg=None)))
    assert not may_be_a_start(table, near)


def test_a_condition_is_a_cause_only_where_it_is_clearly_more_than_the_next_one():
    """Of 30 scattered runs speed and torque told as much, and the speed was said to be it."""
    assert main_cause({"constant": 0.7, "speed": 0.14, "torque": 0.13, "combination": 0.0}) == "combination"
    assert main_cause({"constant": 0.7, "speed": 0.02, "torque": 0.13, "combination": 0.0}) == "torque"
    assert main_cause({"constant": 0.8, "speed": 0.09, "torque": 0.02}) == "constant"
    assert main_cause({"constant": 0.2, "speed": 0.2, "torque": 0.1, "time": 0.5}) == "time"


def started(law, sigma, seed=0):
    """Curves to which a law of the way (deg) and of the time (s) since their start is added."""
    orders, angle = np.arange(121), np.arange(2048) * 360.0 / 2048
    travelled = np.where(AT.sign[:, None] > 0, angle, (360.0 - angle) % 360.0)
    seconds = travelled / 360.0 * 60.0 * WHOLE.constants.reduction_ratio / AT.speed_rpm[:, None]
    te = np.broadcast_to(law(travelled, seconds), travelled.shape)
    added = np.fft.rfft(te)[:, orders] * 2.0 / 2048
    added[:, 0] /= 2.0
    data = curves(WHOLE, AT, orders, sigma, seed, added=added)
    return replace(data, begins_rad=np.zeros(len(AT)), samples=2048)


def test_a_change_of_the_delay_is_doubted_where_an_order_stays_unexplained():
    """A wave of one order that does not share the chain's delay changed it "by itself"."""
    data = curves(WHOLE, AT, ORDERS, 1e-5)
    found = reconcile_observations(WHOLE, data, KNOWN).conclusions
    delay = effect("measurement_delay", delay_us=250.0)
    changed = replace(found, retuned=(Retuned(delay, delay.with_values({**delay.values, "delay_us": 170.0}), {}, 0.0),))
    assert doubted(changed, [57], [], WHOLE.orders(), in_samples=False).retuned[0].is_open
    assert not doubted(changed, [], [], WHOLE.orders(), in_samples=False).retuned[0].is_open


def test_a_loud_run_is_as_loud_as_its_own_curve_says():
    """One noise for all runs made a resonance of what was noise at the fastest speed."""
    loud = 1e-5 + 3e-4 * (AT.speed_rpm / AT.speed_rpm.max()) ** 4
    data = curves(WHOLE, AT, ORDERS, loud, seed=3)
    noise = estimate(data, data.values - WHOLE.coefficients(AT, ORDERS.tolist()))
    fast = AT.speed_rpm == AT.speed_rpm.max()
    assert (np.median(noise.sigma[fast], axis=1) > 0.7 * loud[fast]).all()
    alike = curves(WHOLE, AT, ORDERS, 1e-5, seed=3)
    left = alike.values - WHOLE.coefficients(AT, ORDERS.tolist())
    assert np.array_equal(estimate(alike, left).sigma, estimate(replace(alike, spectral_deg=None), left).sigma)


@pytest.mark.parametrize(("width", "is_told"), [(0.7, False), (5.0, True)])
def test_a_pulse_shorter_than_a_wave_is_no_damaged_tooth(width, is_told):
    """A seam of an encoder was order 81, a scratch order 117; a burst of order 39 is one."""
    orders, angle = np.arange(161), np.radians(np.arange(4096) * 360.0 / 4096)
    away = np.degrees(np.angle(np.exp(1j * (angle - np.radians(140.0))))) / width
    te = 3e-3 * np.exp(-(away**2) / 2) * (np.cos(39 * angle) if is_told else away)
    added = np.fft.rfft(te)[orders] * 2.0 / 4096
    data = curves(WHOLE, AT, orders, 5e-6, added=added)
    burst = effect("local_mesh_defect", order=39 if is_told else 81, centre_deg=140.0, width_deg=max(width, 0.9),
                   amplitude_deg=2e-3, phase_rad=0.0, backward_amplitude_deg=2e-3, backward_phase_rad=0.0)  # fmt: skip
    target = FitData(data, np.full(data.values.shape, 5e-6), np.ones(len(AT), bool), groups_of(AT))
    pieces = (*(piece_of(one, added=False, origin=one).held() for one in WHOLE.effects), piece_of(burst, added=True))
    final = fit(target, State(WHOLE, WHOLE.zero_offset_deg, pieces))
    assert (told_order(final, final.state.pieces[-1]) > 0.0) is is_told


def test_a_few_waves_that_meet_are_no_bump():
    """To a rig without effects the waves of its mesh made three bumps, where they met."""
    bump = effect("local_defect", centre_deg=140.0, width_deg=1.5, height_deg=5e-3)
    pieces = (*(piece_of(one, added=False, origin=one).held() for one in WHOLE.effects), piece_of(bump, added=True))
    for orders, is_one in (
        (np.arange(121), True),
        (np.unique([0, *WHOLE.orders(), 36, 37, 38, 41, 42, 77, 79]), False),
    ):
        added = bump.contribution(AT, orders)
        data = curves(WHOLE, AT, orders, 5e-6, added=added)
        target = FitData(data, np.full(data.values.shape, 5e-6), np.ones(len(AT), bool), groups_of(AT))
        final = fit(target, State(WHOLE, WHOLE.zero_offset_deg, pieces))
        assert is_of_its_place(final, len(pieces) - 1) == is_one


STARTS = {
    "as large as the speed, over the way": (
        lambda way, time: -2.5e-3 * AT.sign[:, None] * (AT.speed_rpm[:, None] / 1800) * np.exp(-way / 20.0),
        "settles behind the start of each curve, by up to 0.0025 deg at first in nine of ten, and is down to 1/e of "
        "that some 20 deg",
    ),
    "alike, over the time": (
        lambda way, time: 2e-3 * np.exp(-time / 0.05),
        "settles behind the start of each curve, by up to 0.0022 deg at first in nine of ten, and is down to 1/e of "
        "that some 0.05 s",
    ),
    "rings": (
        lambda way, time: 2e-3 * np.exp(-time / 0.08) * np.cos(2 * np.pi * 18.0 * time + 0.5),
        "rings, at 18 Hz, behind the start of each curve",
    ),
}


@pytest.mark.parametrize("name", STARTS)
def test_what_dies_away_behind_the_start_is_named_and_taken_out(name):
    """It was a ramp of another ratio, a resonance of many orders, or a place at 0 deg."""
    law, text = STARTS[name]
    data = started(law, 1e-6)
    assert text in _asked(data) and "ratio" not in _asked(data)
    if "speed" in name:  # where the files do not say where curves begin, a ramp must be as large in slow runs
        assert "reduction ratio" not in _asked(replace(data, begins_rad=None))
    found = examine(data, WHOLE, PATH, accept={"start"})
    left = found.data.values - WHOLE.coefficients(AT, data.orders.tolist())
    assert np.sqrt((np.abs(left) ** 2).mean() / 2) < 1.05e-6
    assert "start" in found.corrected


OTHERS = {
    "a ramp": lambda way, time: 2e-3 * np.where(AT.sign[:, None] > 0, way, 360.0 - way) / 360.0,
    "a bump": lambda way, time: 2e-3 * np.exp(-(((way + 180.0) % 360.0 - 180.0) ** 2) / 18.0),
    "a bump in one direction": lambda way, time: (
        (AT.sign[:, None] > 0) * 2e-3 * np.exp(-(((way + 180.2) % 360.0 - 180.0) ** 2) / 18.0)
    ),
    "steps": lambda way, time: 2e-3 * ((way > 100.0) & (way < 200.0)),
    "a walk": lambda way, time: 2e-5 * np.cumsum(np.random.default_rng(5).standard_normal(way.shape), axis=1),
}


@pytest.mark.slow
@pytest.mark.parametrize("begin", [0.0, 77.0])
def test_the_start_is_where_the_files_begin(begin):
    """A seam of an encoder at another angle was called the start of curves that begin at 0."""
    settles = STARTS["as large as the speed, over the way"][0]
    data = started(settles, 1e-6)
    turn = np.exp(-1j * np.radians(begin) * data.orders)
    added = data.values - WHOLE.coefficients(AT, data.orders.tolist())
    moved = replace(data, values=data.values + added * (turn - 1.0))
    assert ("behind the start" in _asked(moved)) == (begin == 0.0)
    known = replace(moved, begins_rad=np.full(len(AT), np.radians(begin)))
    assert "behind the start" in _asked(known) and "at which all curves begin" in _asked(known)
    # what begins somewhere else in each curve is struck by no place
    own = np.random.default_rng(0).uniform(0.0, 2 * np.pi, len(AT))
    turned = np.exp(-1j * own[:, None] * data.orders)
    scattered = replace(data, values=data.values + added * (turned - 1.0), begins_rad=own)
    assert "behind the start" in _asked(scattered) and "at which all curves begin" not in _asked(scattered)


@pytest.mark.parametrize("name", OTHERS)
@pytest.mark.parametrize("sigma", [1e-6, 2e-5])
def test_what_begins_with_the_curves_but_stays_is_no_start(name, sigma):
    data = started(OTHERS[name], sigma)
    assert "behind the start" not in _asked(data)
    is_ratio = "at every run, as if it had been computed with a reduction ratio" in _asked(data)
    assert is_ratio == (name == "a ramp")


@pytest.mark.parametrize("rise", [0.02, 2.0])
def test_a_ramp_in_steps_is_taken_out_whatever_its_size(rise):
    """A large one was refused whatever --accept said; of a small one the highest orders kept a fifth: "order 213"."""
    orders, samples = np.arange(121), 512
    # the samples of a curve jump between the last and the first
    half = np.pi * np.maximum(orders, 1) / samples
    steps = np.where(orders > 0, 1j * rise / samples * np.exp(1j * half) / np.sin(half), rise / 2)
    data = replace(curves(WHOLE, AT, orders, 1e-6, 0, added=steps), samples=samples)
    used = 81.0 / (1.0 - rise / 360.0)
    assert float(re.search(r"reduction ratio of ([\d.]+) ", _asked(data))[1]) == pytest.approx(used, abs=1e-3 * rise)
    left = examine(data, WHOLE, PATH, accept={"ratio"}).data.values - WHOLE.coefficients(AT, orders.tolist())
    assert np.abs(left[:, 1:]).max() < 1e-2 * rise / samples + 1e-5


def _asked(data):
    """What is asked about data before the search; empty for nothing."""
    try:
        examine(data, WHOLE, PATH)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(("warm", "is_one"), [(25.0, True), (26.0, False)])
def test_two_states_that_have_come_to_be_the_same_are_one(warm, is_one):
    """One mode that moved with the load was two, above and below 30 degC, with the same numbers."""
    at, orders = grid(18, 4, 2), np.array([0, 78, 80])
    shape = {"orders": (78, 80), "damping_ratio": 0.04, "amplitude_deg": (1e-3, 5e-4), "phase_rad": (0.3, -1.0)}
    cold = effect("structural_resonance", frequency_Hz=25.0, below_C=30.0, **shape)
    hot = effect("structural_resonance", frequency_Hz=warm, above_C=30.0, **shape)
    data = curves(RigModel(effects=(*RIG.effects, cold, hot)), at, orders, 1e-6)
    target = FitData(data, np.full(data.values.shape, 1e-6), np.ones(len(at), bool), groups_of(at))
    pieces = (*(piece_of(one, added=False, origin=one).held() for one in RIG.effects),
              *(piece_of(one, added=True) for one in (cold, hot)))  # fmt: skip
    joint = fit(target, State(RIG, 0.0, pieces))
    found = in_one_piece(joint)
    assert (found is not None) == is_one
    if found is not None:
        (one,) = (piece.effect for piece in found.state.pieces if piece.added)
        assert not {"above_C", "below_C"} & one.values.keys()
        assert one.scalar("frequency_Hz") == pytest.approx(25.0, abs=0.01)


@pytest.mark.parametrize(("other_Hz", "slope", "is_one"), [(25.0, 0.0, True), (25.5, 0.0, False), (25.0, 4e-4, True)])
def test_a_resonance_that_was_found_twice_on_orders_of_its_own_is_one(other_Hz, slope, is_one):
    """The report had two findings of one oscillator, each with a part of its orders, of which one follows the load."""
    at, orders = grid(18, 4, 2), np.array([0, 39, 78, 80])
    shape = {"damping_ratio": 0.04, "phase_rad": (0.3,)}
    first = effect("structural_resonance", frequency_Hz=25.0, orders=(80,), amplitude_deg=(1e-3,), **shape)
    second = effect("structural_resonance", frequency_Hz=other_Hz, orders=(78,), amplitude_deg=(5e-4,), **shape,
                    **({"slope_deg_per_kNm": (slope,), "slope_phase_rad": (1.0,)} if slope else {}))  # fmt: skip
    data = curves(RigModel(effects=(*RIG.effects, first, second)), at, orders, 1e-6)
    target = FitData(data, np.full(data.values.shape, 1e-6), np.ones(len(at), bool), groups_of(at))
    pieces = (*(piece_of(one, added=False, origin=one).held() for one in RIG.effects),
              *(piece_of(one, added=True) for one in (first, second)))  # fmt: skip
    found = in_one_piece(fit(target, State(RIG, 0.0, pieces)))
    assert (found is not None) == is_one
    if found is not None:
        (one,) = (piece.effect for piece in found.state.pieces if piece.added)
        assert one.orders == (78, 80)
        assert one.values["amplitude_deg"] == pytest.approx((5e-4, 1e-3), rel=0.01)
        assert one.values.get("slope_deg_per_kNm", ()) == pytest.approx((slope, 0.0) if slope else (), abs=4e-6)
        assert one.scalar("frequency_Hz") == pytest.approx(25.0, abs=0.01)


@pytest.mark.parametrize("wanders", [True, False])
def test_a_mean_that_wanders_with_the_day_is_said_to_be_alike_in_runs_that_follow_each_other(wanders):
    """It was "noise" without a word: a sine of 25 runs, five times the noise of a run."""
    number = order_of_runs(AT)
    mean = 1e-3 * (np.sin(2 * np.pi * number / 25) if wanders else np.random.default_rng(2).standard_normal(72)[number])
    data = curves(WHOLE, AT, ORDERS, 2e-5, added=mean[:, None] * (ORDERS == 0))
    result = reconcile_observations(WHOLE, data, KNOWN)
    assert any("runs that follow each other" in text for text in result.cannot_show) == wanders
    assert ("Cannot be shown: the means of runs that follow each other are alike" in summary(result)) == wanders
    if wanders:
        residual = result.conclusions.final.residual
        assert wander_over_runs(result.target, residual, []) and not wander_over_runs(result.target, residual, [0])
