"""What is said of a law that the catalogue does not have: no formula by chance, no word that the runs contradict."""

import re
from dataclasses import replace

import numpy as np
import pytest

from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.reconcile.fit.target import FitData, groups_of
from st_codegen.reconcile.judge.claims import Retuned
from st_codegen.reconcile.mistakes.examine import examine
from st_codegen.reconcile.mistakes.single_runs import Mistake
from st_codegen.reconcile.report.findings import _is_clear, _numbers
from st_codegen.reconcile.report.output import report
from st_codegen.reconcile.report.pages import report_page
from st_codegen.reconcile.report.sentences import floor_text, verdict_text
from st_codegen.reconcile.report.summary import summary
from st_codegen.reconcile.rest.structure import scatter_of_encoder
from st_codegen.reconcile.rest.unseen import cannot_show
from st_codegen.rig.effects import Conditions
from st_codegen.rig.model import RigModel

from .test_core import RIG, effect, observed
from .test_core import grid as core_grid
from .test_forms import KNOWN, MESH, part, reconciled
from .test_forms import grid as forms_grid
from .test_unexplained import ORDERS, SIGMA, curves, found, grid, white

TURN = np.exp(0.3j)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "law",
    [
        lambda at: np.tanh(at.torque_Nm / 300),
        lambda at: at.torque_Nm > 0,
        lambda at: at.torque_Nm > 1000,
        lambda at: 1 / (1 + ((at.speed_rpm - 900) / 300) ** 2),
        lambda at: np.sin(at.torque_Nm / 150),
    ],
)
def test_a_law_that_no_terms_have_gets_no_formula(law):
    """A saturation was said to grow with the cube, in proportion and with the square of the torque: 99 % of it."""
    at = grid()
    (one,) = found(at, {53: 3e-4 * law(at) * TURN}).values()
    assert one.formula is None and ("depends on the torque" in one.text or "depends on the speed" in one.text)


def read_by_a_sensor(true, play):
    """What a sensor with play reads of torques that follow each other: it lags behind by up to `play`."""
    read, now = np.empty_like(true), true[0]
    for i, one in enumerate(true):
        now = min(max(now, one - play), one + play)
        read[i] = now
    return read


@pytest.mark.parametrize("share", [0.01, 0.02, 0.03])
@pytest.mark.parametrize("swept", [True, False])
def test_hysteresis_of_the_torque_sensor_gets_no_formula(swept, share):
    """Torques up and down at each speed, or in any order: the mean is off by a loop, which is no law of the torque."""
    random = np.random.default_rng(3)
    up = np.linspace(0, 1800, 7)
    sweep = np.concatenate([up, up[::-1]])
    rows = [
        (speed, torque, oil)
        for oil in (25.0, 35.0)
        for speed in np.arange(150, 1801, 150.0)
        for torque in (sweep if swept else random.permutation(sweep))
    ]
    speed, torque, oil = (np.repeat(column, 2) for column in np.array(rows).T)
    off = torque - np.repeat(read_by_a_sensor(torque[::2], share * 900), 2)
    at = Conditions.of(np.tile([1.0, -1.0], len(rows)), speed, torque, oil)
    left = found(at, {0: off / 454 / 60 + 0j, 53: off * 1e-6 * TURN})
    # where the torque goes up and down again and again, what repeats differ by is the noise
    assert (swept or 0 in left) and all(one.formula is None for one in left.values())


def test_what_is_only_most_of_a_law_is_said_to_be():
    at = grid()
    (one,) = found(at, {53: 3e-4 * (at.torque_Nm > 700) * TURN}).values()
    assert one.formula is None or "its law may be another" in one.text


def test_conditions_go_together_on_a_curve_as_well():
    """Oil that warms up ever slower in runs sorted by speed: its law and the speed's were said to be told apart."""
    speed, torque = (
        axis.ravel() for axis in np.meshgrid(np.linspace(100, 1800, 8), np.linspace(0, 1800, 5), indexing="ij")
    )
    at = Conditions.of(1.0, speed, torque, 24 + 16 * (1 - np.exp(-np.arange(40) / 15)))
    data = Observations(at, labels(at), ORDERS, np.zeros((len(at), 3), complex))
    assert any("speed and oil temperature go together" in text for text in cannot_show(data))


def test_conditions_that_go_together_are_said():
    """The oil warmed with the speed: an order that grows with the oil was said to grow with the speed."""
    at = grid()
    warming = Conditions.of(at.sign, at.speed_rpm, at.torque_Nm, 25 + at.speed_rpm / 180)
    (one,) = found(warming, {53: 2e-4 * (warming.temperature_C - 25) / 10 * TURN}).values()
    assert "speed and oil temperature go together in these runs: it may depend on either" in one.text
    data = Observations(warming, labels(warming), ORDERS, np.zeros((len(at), 3), complex))
    assert any("speed and oil temperature go together" in text for text in cannot_show(data))
    (one,) = found(at, {53: 2e-4 * at.speed_rpm / 1000 * TURN}).values()
    assert "go together" not in one.text and not any("together" in text for text in cannot_show(curves_of(at)))


def curves_of(at):
    return Observations(at, labels(at), ORDERS, np.zeros((len(at), 3), complex))


@pytest.mark.thorough
def test_runs_that_were_repeated_are_not_said_to_be_missing():
    """A campaign whose torque went up and down was told that no run was repeated, and to repeat some."""
    at, orders = grid(), [0, 39, 40, 78]
    twice = Conditions.of(*(np.tile(x, 2) for x in (at.sign, at.speed_rpm, at.torque_Nm, at.temperature_C)))
    late = np.repeat([0.0, 1.0], len(at))
    for points, words in ((at, True), (twice, False)):
        wave = late[: len(points)] * 4e-4 + 1e-4 * np.random.default_rng(2).standard_normal(len(points))
        result = reconciled(part(MESH, orders), points, orders, {40: wave * TURN})
        assert ("No two runs have equal conditions" in floor_text(result)) is words


def test_a_wave_beside_the_alias_of_an_encoder_is_not_the_encoders():
    """Stick and slip of orders 24 to 30: those next to the alias of 1024 lines were said to be the encoder's noise."""
    left, _ = curves(white([1, 1, 1, 1, 5, 9]), SIGMA, samples=1000)
    assert set(left) == {48, 53}
    left, _ = curves(white([1, 1, 1, 1, 5, 1]), SIGMA, samples=1000)
    assert left == {}


def test_numbers_that_moved_only_together_are_said_to():
    """Friction has no phase: "its phases turned" was said of it."""
    before = effect("friction_windup", coulomb_arcmin=0.25, viscous_arcmin_per_krpm=0.02)
    after = effect("friction_windup", coulomb_arcmin=0.251, viscous_arcmin_per_krpm=0.021)
    errors = {"coulomb_arcmin": 0.01, "viscous_arcmin_per_krpm": 0.01}
    assert _numbers(after, errors, before) == (
        "its numbers jointly, none clearly alone",
        "with it coulomb_arcmin 0.25 -> 0.251 +- 0.01 arcmin",
        "viscous_arcmin_per_krpm 0.02 -> 0.021 +- 0.01 arcmin/krpm",
    )
    before, after = (effect("pin_error", order=40, amplitude_deg=1e-3, phase_rad=turn) for turn in (0.0, 0.3))
    errors = {"amplitude_deg": 1e-4, "phase_rad": 0.01}
    assert _numbers(after, errors, before) == ("its phases turned",)
    # beside a size that changed by a little, which would seem to explain what the phase does
    after = after.with_values({**after.values, "amplitude_deg": 1.3e-3})
    assert _numbers(after, errors, before) == ("its phases turned", "amplitude_deg 0.001 -> 0.0013 +- 0.0001 deg")


@pytest.mark.parametrize(
    ("error", "said"), [(0.01475, "0.015"), (14.3, "14"), (243.0, "240"), (2e-6, "2e-06"), (0.0095, "0.0095")]
)
def test_errors_have_the_digits_that_do_not_make_them_smaller(error, said):
    """A dry friction of 0.3345 +- 0.01475 was said to be known to 0.01, and a stiffness to 1e+01."""
    before, after = (effect("torsional_compliance", stiffness_Nm_per_arcmin=size) for size in (380.0, 999.0))
    (text,) = _numbers(after, {"stiffness_Nm_per_arcmin": error}, before)
    assert text == f"stiffness_Nm_per_arcmin 380 -> 999 +- {said} Nm/arcmin"


@pytest.mark.parametrize(("error", "is_clear"), [(30.0, False), (3.0, True)])
def test_one_number_that_its_error_holds_is_not_refused(error, is_clear):
    """Of a stiffness that grows with the load 380 -> 411 +- 31 was "refused", "its numbers together"."""
    before, after = (effect("torsional_compliance", stiffness_Nm_per_arcmin=size) for size in (380.0, 411.0))
    errors = {"stiffness_Nm_per_arcmin": error}
    assert _is_clear(Retuned(before, after, errors, 0.0)) is is_clear
    assert _numbers(after, errors, before) == (f"stiffness_Nm_per_arcmin 380 -> 411 +- {error:g} Nm/arcmin",)


def test_a_ratio_is_given_with_the_digits_that_tell_it_from_the_rigs(tmp_path):
    """A ramp of 0.0014 deg was said to be a ratio of 81 instead of 81."""
    at, orders = grid(), [0, 1, 2, 3, 39, 40, 78, 117]
    rig = part(MESH, orders)
    ramp = -0.0014 * np.array([0.5, *(1j / (np.pi * k) for k in orders[1:])])
    noise = np.random.default_rng(0).standard_normal((len(at), len(orders)))
    values = rig.coefficients(at, orders) + ramp + 1e-6 * noise
    with pytest.raises(Exception, match=r"reduction ratio of 80\.9996\d+ instead of 81"):
        examine(Observations(at, labels(at), np.array(orders), values), rig, tmp_path)


def of_curves(rig, at, orders, added, run=None):
    """The result on curves of `rig` plus `added` (order -> complex (n,)), in white noise that they tell."""
    random = np.random.default_rng(0)
    values = rig.coefficients(at, orders)
    for order, wave in added.items():
        values[:, orders.index(order)] += wave
    noise = SIGMA * (random.standard_normal(values.shape) + 1j * random.standard_normal(values.shape))
    noise[:, 0] = noise[:, 0].real
    spectral = np.full(values.shape, SIGMA)
    data = Observations(at, labels(at), np.array(orders), values + noise, run=run, spectral_deg=spectral)
    return reconcile_observations(rig, data, KNOWN)


@pytest.mark.thorough
def test_a_step_in_time_changes_no_parameter_and_no_zero():
    """Runs made again after half a day: half of the step was called a change of the pins, and of the encoders' zero."""
    at, orders = forms_grid(np.linspace(100, 1800, 6)), [0, 39, 40, 78, 117]
    count = len(at) // 2
    run = np.repeat(np.random.default_rng(1).permutation(count), 2)
    late = run >= count // 2
    result = of_curves(part(MESH, orders), at, orders, {0: 1.2e-2 * late + 0j, 40: 4e-4 * late * TURN}, run)
    assert result.conclusions.retuned == () and not result.conclusions.offset_changed
    said = {one.order: one.text for one in result.unexplained}
    assert set(said) == {0, 40} and all("a step of 0.0" in text for text in said.values())


@pytest.mark.thorough
def test_an_order_that_has_no_law_of_the_rig_changes_no_parameter_beside_it():
    """A wave that is there at high torques alone bent the tooth error and the growth with the load, and sidebands."""
    at, orders = forms_grid(np.linspace(100, 1800, 6)), [0, 36, 39, 40, 42, 78]
    sides = effect("carrier_modulation", order=39, lower_ratio=0.11, upper_ratio=0.14)
    rig = part(MESH, orders)
    rig = rig.with_effects((*rig.effects, sides))
    result = of_curves(rig, at, orders, {39: 6e-4 * (at.torque_Nm > 1000) * TURN})
    assert result.conclusions.retuned == () and result.conclusions.claims == ()
    (one,) = result.unexplained
    assert one.order == 39 and one.text.endswith(" (39 = 1 x 39 teeth of the cycloid)")


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_noise_that_lasts_over_ten_runs_changes_no_parameter(seed):
    """Ovality and friction were said to have changed: the mean of 144 such runs is that of eight."""
    at, orders = forms_grid(np.linspace(100, 1800, 8), 6, (25.0, 35.0, 30.0)), [0, 2, 39, 40, 78]
    random, count = np.random.default_rng(seed), len(at) // 2
    drive = random.standard_normal((count, 2, 2)) @ [1, 1j]
    for i in range(1, count):
        drive[i] = 0.9 * drive[i - 1] + np.sqrt(1 - 0.81) * drive[i]
    lasts = np.empty(len(at), complex)
    run = np.repeat(random.permutation(count), 2)
    lasts[:] = drive[run, (at.sign < 0).astype(int)]
    rig = part((*MESH, "output_shaft_ovality"), orders)
    result = of_curves(rig, at, orders, {2: 10 * SIGMA * lasts, 39: 10 * SIGMA * np.roll(lasts, 40)}, run)
    assert result.conclusions.retuned == () and result.conclusions.claims == ()


def test_a_wander_over_runs_in_the_order_of_the_grid_depends_on_no_condition():
    """At 25 degC from speed to speed, then at 35: the mean was said to depend on the speed, most at 1050 rpm."""
    axes = np.meshgrid([25.0, 35.0], np.arange(150, 1801, 150.0), np.arange(0, 1501, 300.0), [1.0, -1.0], indexing="ij")
    oil, speed, torque, sign = (axis.ravel() for axis in axes)
    at = Conditions.of(sign, speed, torque, oil)
    for seed in (5, 10):
        random, wander = np.random.default_rng(seed), np.zeros(len(at) // 2)
        for i in range(1, len(wander)):
            wander[i] = 0.95 * wander[i - 1] + random.standard_normal()
        (one,) = found(at, {0: 2e-4 * np.repeat(wander, 2) + 0j}).values()
        assert "depends on the conditions, or on when it was measured" in one.text
    (one,) = found(at, {53: 2e-4 * np.sin(at.speed_rpm / 200) * TURN}).values()
    assert "depends on the speed" in one.text


def behind(oil, runs):
    """The temperature of a body that follows the oil run by run, 63 % of a change in `runs` of them."""
    body = np.empty(len(oil))
    body[0] = oil[0]
    for i in range(1, len(oil)):
        body[i] = oil[i] + (body[i - 1] - oil[i]) * np.exp(-1.0 / runs)
    return body


@pytest.mark.thorough
def test_a_body_behind_an_oil_that_was_warmed_up_once_may_be_the_time():
    """A walk through three temperatures was said to follow the oil late, and no more."""
    at, orders = forms_grid(np.linspace(100, 1800, 6), 4, (22.0, 28.0, 34.0, 40.0)), [0, 39, 40, 78]
    count = len(at) // 2
    run, oil = np.empty(count, np.int64), at.temperature_C[::2]
    run[np.lexsort((np.random.default_rng(2).permutation(count), oil))] = np.arange(count)
    body = behind(np.sort(oil), 6.0)[run]
    result = of_curves(part(MESH, orders), at, orders, {0: np.repeat(3e-4 * (body - 30.0), 2) + 0j}, np.repeat(run, 2))
    (one,) = result.unexplained
    assert "follows the oil temperature late" in one.text
    assert "or with time: the runs go through the oil temperature once" in one.text


@pytest.mark.thorough
@pytest.mark.parametrize("lag", [1.5, 6.0])
def test_a_body_that_lags_behind_the_oil_is_no_drift_with_the_oil(lag):
    """Runs in any order: half of what the body does follows the oil of the run, and was named as a drift with it."""
    at, orders = forms_grid(np.linspace(100, 1800, 6), 4, (22.0, 28.0, 34.0, 40.0)), [0, 39, 40, 78]
    count = len(at) // 2
    turn = np.random.default_rng(2).permutation(count)
    oil, body = np.empty(count), np.empty(len(at))
    run = np.repeat(turn, 2)
    oil[run] = at.temperature_C
    body[:] = behind(oil, lag)[run]
    result = of_curves(part(MESH, orders), at, orders, {0: 3e-4 * (body - 30.0) + 0j}, run)
    assert result.conclusions.claims == ()
    (one,) = result.unexplained
    assert one.order == 0 and "follows the oil temperature late" in one.text
    assert re.search(r"0\.000(29|3|31) deg per kelvin", one.text) and one.dependence["time"] > 0.5
    assert "or with the time" not in one.text
    result = of_curves(part(MESH, orders), at, orders, {0: 3e-4 * (at.temperature_C - 30.0) + 0j}, run)
    assert [claim.piece.effect.name for claim in result.conclusions.claims] == ["thermal_drift"]
    assert result.unexplained == ()


@pytest.mark.thorough
def test_what_is_ahead_of_the_sensor_of_the_oil_is_no_body_that_follows_it():
    """A sensor that lags by the run: "follows the oil late, as a body that takes some 0.33 runs", 20 times its size."""
    at, orders = forms_grid(np.linspace(100, 1800, 6), 4, (22.0, 28.0, 34.0, 40.0)), [0, 39, 40, 78]
    count = len(at) // 2
    run = np.repeat(np.random.default_rng(2).permutation(count), 2)
    listed = np.empty(count)
    listed[run] = at.temperature_C
    # what a sensor of first order shows is late by so much of how it moves
    ahead = 2.0 * np.diff(listed, prepend=listed[0])
    result = of_curves(part(MESH, orders), at, orders, {0: 3e-4 * ahead[run] + 0j}, run)
    (one,) = result.unexplained
    assert one.order == 0 and "from that of the run before: 0.0006 deg per kelvin" in one.text
    assert "or a sensor of the oil that is late itself" in one.text and not result.conclusions.claims


def test_a_run_that_was_stored_twice_counts_once():
    """As repeats, copies have no noise: every order seemed to hold structure."""
    at, orders = forms_grid(np.linspace(100, 1800, 6)), [0, 39, 40, 78]
    rig = part(MESH, orders)
    noise = SIGMA * np.random.default_rng(0).standard_normal((len(at), len(orders)))
    once = Observations(at, labels(at), np.array(orders), rig.coefficients(at, orders) + noise)
    twice = once.rows(np.tile(np.arange(len(at)), 2)).without_copies()
    assert len(twice) == len(at) and f"and {len(at) - 1} more curves" in twice.not_looked_at[-1]
    result = reconcile_observations(rig, twice, KNOWN)
    assert result.verdict == "nothing_missing" and result.fitted.noise_floor > SIGMA
    again = replace(once, values=once.values + 1e-9)
    both = once.rows(np.tile(np.arange(len(at)), 2))
    assert len(replace(both, values=np.concatenate([once.values, again.values])).without_copies()) == 2 * len(at)


@pytest.mark.thorough
def test_a_changed_parameter_at_its_bound_is_no_finding():
    """Friction whose viscosity falls faster with the oil than any oil's: 0.04 was said to have become 0.1 1/K."""
    at, orders = forms_grid(np.linspace(100, 1800, 6), 4, (20.0, 25.0, 30.0, 35.0, 40.0)), [0, 39, 40, 78]
    friction = effect("friction_windup", coulomb_arcmin=0.2, viscous_arcmin_per_krpm=0.02, viscosity_decay_per_K=0.04)
    rig = part(MESH, orders)
    rig = rig.with_effects((*rig.effects, friction))
    extra = -at.sign * 0.4 / 60 * at.speed_rpm / 1000 * np.exp(-(at.temperature_C - 20) / 3)
    for decay in (3.0, 12.0):
        extra = -at.sign * 0.4 / 60 * at.speed_rpm / 1000 * np.exp(-(at.temperature_C - 20) / decay)
        result = of_curves(rig, at, orders, {0: extra + 0j})
        said = {key: new.after.scalar("viscosity_decay_per_K") for new in result.conclusions.retuned
                for key in new.after.values if key == "viscosity_decay_per_K"}  # fmt: skip
        assert all(0.04 < value < 0.19 for value in said.values()) and bool(said) == (decay > 10)


@pytest.mark.thorough
def test_a_sideband_is_no_order_of_the_mesh():
    """A brake whose torque ripples once a turn: beside 77 and 79, order 80 was named, and one to grow with the load."""
    at, orders = forms_grid(np.linspace(100, 1800, 6)), [0, 39, 40, 76, 77, 78, 79, 80, 81, 82]
    rig = part(("cycloid_tooth_error", "load_dependent_mesh"), [39, 78])
    torque = at.torque_Nm / 1800
    sides = {77: 3e-4 * torque * TURN, 79: 3e-4 * torque * TURN**2, 80: 6e-5 * torque + 0j}
    assert of_curves(rig, at, orders, sides).conclusions.claims == ()
    (claim,) = of_curves(rig, at, orders, {80: sides[80]}).conclusions.claims
    assert claim.piece.effect.orders == (80,)


def test_play_that_grows_over_the_campaign_changes_no_friction():
    """The flanks wear: dry friction was said to have gone, the play and the torque that seats it to be others."""
    at, orders = forms_grid(np.linspace(100, 1800, 6), 1, (25.0, 35.0)), [0, 39, 40, 78]
    torques = np.tile([0.0, 20.0, 60.0, 150.0, 400.0, 900.0], len(at) // 2)
    points = [np.repeat(x[::2], 6) for x in (at.speed_rpm, at.temperature_C)]
    at = Conditions.of(np.tile([1.0, -1.0], len(torques)), np.repeat(points[0], 2), np.repeat(torques, 2),
                       np.repeat(points[1], 2))  # fmt: skip
    run = np.repeat(np.random.default_rng(3).permutation(len(torques)), 2)
    own = (effect("backlash", gap_arcmin=0.3, seating_torque_Nm=60.0), effect("friction_windup", coulomb_arcmin=0.2))
    rig = part(MESH, orders)
    rig = rig.with_effects((*rig.effects, *own))
    wear = at.sign * 0.6 / 60 / 2 * run / run.max() * np.exp(-at.torque_Nm / 60)
    result = of_curves(rig, at, orders, {0: wear + 0j}, run)
    assert result.conclusions.retuned == () and [one.order for one in result.unexplained] == [0]


def test_an_order_that_follows_the_torque_is_not_an_encoders():
    """It was listed as unexplained, with a formula, and as the noise of an encoder of 2048 lines."""
    at, orders = forms_grid(np.linspace(100, 1800, 6)), [0, 39, 40, 52, 53, 78]
    data = Observations(at, labels(at), np.array(orders), np.zeros((len(at), 6), complex), samples=300)
    target = FitData(data, np.full((len(at), 6), SIGMA), np.ones(len(at), bool), groups_of(at))
    random = np.random.default_rng(1)
    left = SIGMA * (random.standard_normal((len(at), 6)) + 1j * random.standard_normal((len(at), 6)))
    wave = np.zeros((len(at), 6), complex)
    wave[:, 4] = 3e-4 * TURN * np.exp(2j * np.pi * random.random(len(at)))
    spectral = replace(data, spectral_deg=np.full((len(at), 6), SIGMA))
    target = replace(target, data=spectral)
    assert "an encoder of 2048 lines" in scatter_of_encoder(target, left + wave)[0]
    wave[:, 4] = 3e-4 * TURN * (at.torque_Nm / 1800) ** 2
    assert scatter_of_encoder(target, left + wave) == ()


@pytest.mark.thorough
def test_lowest_orders_that_jump_are_said_to_count_as_noise():
    """Counts that an encoder lost within some turns were said to be nothing that these data show, and no more."""
    at, orders = forms_grid(np.linspace(100, 1800, 6)), [0, 1, 2, 3, 4, 5, 39, 40, 78]
    random = np.random.default_rng(0)
    lost = 0.0027 * (random.random(len(at)) < 0.25) * np.exp(2j * np.pi * random.random(len(at)))
    steps = {k: lost / (np.pi * k) * np.exp(1j * k) for k in orders[1:]}
    said = of_curves(part(MESH, orders), at, orders, steps).cannot_show
    assert any("wanders within a turn, or jumps" in text for text in said)
    said = of_curves(part(MESH, orders), at, orders, {}).cannot_show
    assert not any("within a turn" in text for text in said)


@pytest.mark.thorough
def test_the_size_of_a_step_is_that_of_the_residual_as_it_is():
    """With little noise it was that of the residual cut at five noises: 8e-6 deg for 0.004."""
    at, orders = forms_grid(np.linspace(100, 1800, 6)), [0, 39, 40, 78]
    run = np.repeat(np.arange(len(at) // 2), 2)
    late = run >= len(at) // 4
    (one,) = of_curves(part(MESH, orders), at, orders, {40: 4e-3 * late * TURN}, run).unexplained
    assert one.order == 40 and one.amplitude_deg == pytest.approx(4e-3, rel=0.05) and "a step of 0.004 deg" in one.text


@pytest.mark.parametrize("size", [3e-5, 4e-5])
def test_noise_a_little_larger_than_that_within_curves_takes_no_change_back(size):
    """An order whose slope had changed was unexplained: a sixth more noise than curves tell was called structure."""
    at, orders = forms_grid(np.linspace(100, 1800, 6)), [0, 39, 40, 78]
    rig = part(MESH, orders)
    (mesh,) = (one for one in rig.effects if one.name == "load_dependent_mesh" and 78 in one.orders)
    change = mesh.contribution(at, np.array(orders))[:, 3]
    noise = 0.4 * SIGMA * np.random.default_rng(7).standard_normal((2, len(at)))
    added = size * change / np.abs(change).max() + noise[0] + 1j * noise[1]
    result = of_curves(rig, at, orders, {78: added})
    assert [one.after.name for one in result.conclusions.retuned] == [
        "load_dependent_mesh"
    ] and result.unexplained == ()


@pytest.mark.parametrize("seed", range(2))
def test_what_is_fainter_than_the_noise_of_a_run_is_not_said_to_be_noise(seed):
    """A drift of half a noise in 252 curves, once in a million millions by chance, was "nothing is missing"."""
    truth = RigModel(effects=(*RIG.effects, effect("thermal_drift", drift_arcmin_per_K=0.006)))
    result = reconcile_observations(RIG, observed(truth, core_grid(), seed=seed, sigma=1e-3), KNOWN)
    assert result.verdict == "unexplained" and not result.conclusions.claims
    assert verdict_text(result) == "What differs has a faint pattern, which may be noise that lasts over runs."
    (one,) = report(result)["unexplained"]
    assert one["would_be"] == "thermal_drift" and one["order"] == 0 and one["at_least"]
    assert one["size"] == pytest.approx(0.006 / 60 * np.sqrt(50 / 3), rel=0.3)
    nothing = reconcile_observations(RIG, observed(RIG, core_grid(), seed=seed, sigma=1e-3), KNOWN)
    assert nothing.verdict == "nothing_missing" and nothing.unexplained == ()


@pytest.mark.parametrize("seed", [0, 6])
def test_a_dozen_runs_change_no_two_parameters_of_the_mean(seed):
    """Play that load takes up: they were said to have another stiffness and another backlash, both wrong."""
    random = np.random.default_rng(seed)
    points = [random.uniform(200, 1800, 12), random.uniform(30, 1600, 12), random.choice([25.0, 35.0], 12)]
    at = Conditions.of(np.repeat([1.0, -1.0], 12), *(np.tile(x, 2) for x in points))
    friction = effect("friction_windup", coulomb_arcmin=0.26, viscous_arcmin_per_krpm=0.018, viscosity_decay_per_K=0.04)
    backlash = effect("backlash", gap_arcmin=0.3, seating_torque_Nm=60.0)
    rig = RigModel(effects=(*RIG.effects, friction, backlash))
    data = observed(rig, at, seed=seed, sigma=8e-4)
    play = at.sign * 0.009 * (np.tanh(at.torque_Nm / 500) - 1.0)
    moved = replace(data, values=data.values + np.where(data.orders == 0, play[:, None], 0.0))
    result = reconcile_observations(rig, moved, KNOWN)
    assert len(result.conclusions.retuned) < 2 and result.unexplained


@pytest.mark.thorough
@pytest.mark.parametrize("seed", range(2))
def test_the_mean_of_noise_that_lasts_is_no_faint_pattern(seed):
    """Each order and direction has a constant of its own, of a third of the noise of a run."""
    data = observed(RIG, core_grid(), (0, 1, 2, 3, 36, 39, 40, 42, 78, 80, 117, 120), seed=seed, sigma=1e-3)
    random = np.random.default_rng(50 + seed)
    mean = 3e-4 * (random.standard_normal((2, 12)) + 1j * random.standard_normal((2, 12)))
    lasts = np.where((data.at.sign > 0)[:, None], *mean)
    lasts = np.where(data.orders == 0, lasts.real, lasts)
    result = reconcile_observations(RIG, replace(data, values=data.values + lasts), KNOWN)
    assert result.verdict == "nothing_missing" and result.unexplained == ()


def test_digits_of_a_run_at_another_operating_point_count_nowhere():
    """Files that were copied over others: four of them were a "block of 0.443 times" the rig."""
    at, orders = grid(), [0, 39, 40, 78]
    random = np.random.default_rng(5)
    values = random.standard_normal((len(at), 4)) + 1j * random.standard_normal((len(at), 4))
    data = Observations(at, labels(at), np.array(orders), values)
    assert len(data.without_copies()) == len(data)
    rows = np.flatnonzero(at.sign > 0)
    values[rows[7]] = values[rows[3]]
    found = replace(data, values=values).without_copies()
    assert len(found) == len(data) - 2
    assert "2 curves that have the digits of one at another operating point" in found.not_looked_at[-1]
    # what depends on no condition is alike everywhere
    same = replace(data, values=np.ones_like(values)).without_copies()
    assert len(same) == len(data)


def test_what_is_mostly_constant_is_not_the_same_at_every_operating_point():
    """A mean of which the oil temperature made a part was "constant: .. at every operating point"."""
    at = grid()
    for share, least, most in ((0.25, 0.9, 0.97), (0.15, 0.97, 0.99)):
        # steps that no term follows
        wave = 3e-4 * (1 + share * np.sign(np.sin(at.torque_Nm / 90 + at.speed_rpm / 70))) * TURN
        (one,) = found(at, {53: wave}).values()
        assert set(one.formula.terms) == {"constant"} and least < one.formula.explains < most
        assert "is mostly constant" in one.text and "deg in the mean of the operating points" in one.text
        assert f"(that is {100 * one.formula.explains:.0f} % of it: the rest may differ from one of them" in one.text
    (one,) = found(at, {53: 3e-4 * TURN + 0.0 * at.sign}).values()
    assert "is constant: 0.0003 deg in the mean of the operating points" in one.text and "of it:" not in one.text


@pytest.mark.parametrize(("power", "names"), [(1, []), (0, ["pin_error"])])
def test_a_wave_that_vanishes_with_the_speed_is_no_constant_one(power, names):
    """A wave of a mesh order in proportion to the speed was an error of the pins, which most of it is like."""
    random, orders = np.random.default_rng(4), (0, 1, 2, 3, 39, 40, 78)
    drawn = [random.uniform(*ends, 30) for ends in ((100, 2000), (0, 1000), (25, 45))]
    at = Conditions.of(np.repeat([1.0, -1.0], 30), *np.tile(drawn, 2))
    data = observed(RIG, at, orders)
    wave = 3e-4 * (at.speed_rpm / 1000) ** power * TURN
    values = data.values + wave[:, None] * (data.orders == 40)
    result = reconcile_observations(RIG, replace(data, values=values), KNOWN)
    assert [claim.piece.effect.name for claim in result.conclusions.claims] == names
    assert names or [one.order for one in result.unexplained] == [40]


def test_runs_that_are_named_already_are_not_suspected_as_well():
    """Fifteen runs were said to be left out, and then, of the same ones, that five were suspected."""
    result = reconcile_observations(RIG, observed(RIG, core_grid(4, 3, 2)), KNOWN)
    result = replace(result, noise=replace(result.noise, suspects=((0, 9.0),)))
    assert "Suspected bad runs: 1" in summary(result)
    assert "Suspected bad runs" in report_page(result) and "usual distance" in report(result)["suspect_runs"][0]
    named = replace(result, mistakes=(Mistake("direction", "1 run seems exchanged", rows=(0,)),))
    assert "Suspected bad runs" not in summary(named) + report_page(named)
    assert report(named)["suspect_runs"] == [f"{result.data.labels[0]}: direction"]
