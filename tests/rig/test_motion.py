"""Motions with the generated text in the loop."""

import dataclasses

import numpy as np
import pytest

pytest.importorskip("numba")

from st_codegen.errors import InputError
from st_codegen.project.bundle import Bundle
from st_codegen.rig.compensator import LAWS, EmittedCompensator, restricted, roles_of
from st_codegen.rig.effects import catalogue
from st_codegen.rig.machine import another_specimen, machine_of
from st_codegen.rig.model import parse_rig
from st_codegen.rig.motion import CompensationCase, LoadSource, Size, Told, compare, lead_time_s, or_none, plan, run
from st_codegen.rig.motion_files import remarks
from st_codegen.rig.profiles import MotionProfile
from st_codegen.rig.study import AUTO, MotionWish, parse_inputs, parse_lead, parse_orders, simulate, with_oil
from st_codegen.rig.tasks import TaskForm, TaskInputs, TaskSettings
from st_codegen.st import Machine
from st_codegen.te.harmonics import Play
from st_codegen.te.purpose import Compensation
from tests.rig.conftest import LINEAR_RIG, ORDERS, write_bundle


def turn(cycle=250e-6, speed=60.0, duration=0.6, torque=200.0):
    """A short move: half a period of a raised cosine."""
    time = np.arange(round(duration / cycle) + 1) * cycle
    rate = speed * (1 - np.cos(2 * np.pi * time / duration)) / 2
    angle = speed / 2 * (time - duration / (2 * np.pi) * np.sin(2 * np.pi * time / duration))
    return MotionProfile("turn", time, angle, rate, np.full_like(time, torque))


@pytest.fixture(scope="module")
def compensator(linear_bundle):
    return EmittedCompensator(linear_bundle)


@pytest.fixture(scope="module")
def moved(linear_rig, compensator):
    planned = plan(linear_rig, turn())
    return planned, run(linear_rig, planned)


def test_the_prediction_is_the_rigs_own_error(linear_rig, compensator, moved):
    """Models that are exact leave only the age of the angle: |TE'| * speed * age, and the blend of the start."""
    planned, before = moved
    outcome = compare(linear_rig, planned, before, compensator, CompensationCase(ORDERS, "full", TaskForm.ONE))
    slope = 0.0172 + 39 * (0.0007 + 0.0007 * 0.2)  # deg of TE a rad of the output
    age = (linear_rig.tasks.main_us * 1e-6) * 1.0  # a prediction belongs to the angle latched a cycle before
    moving = slice(planned.first, None)
    true = (before.theta_out_deg - before.theta_in_deg / 81.0)[moving]
    np.testing.assert_allclose(outcome.predicted_deg, true, atol=slope * np.radians(60.0) * (age + 350e-6) + 1e-6)


def test_what_is_left_is_bounded_by_the_known_delays(linear_rig, compensator, moved):
    planned, before = moved
    outcome = compare(linear_rig, planned, before, compensator, CompensationCase(ORDERS, "full", TaskForm.ONE))
    delay = lead_time_s(linear_rig, TaskForm.ONE)
    slope = 0.0172 + 39 * (0.0007 + 0.0007 * 0.2)
    # the correction itself moves the output by less than 0.05 deg / 81; the loops' own lag is below a millisecond
    assert outcome.after.maximum < slope * np.radians(60.0) * (delay + 1e-3) + 1e-5
    assert 0.99 < outcome.reduction[0] < 1.0
    assert outcome.reduction[1] == 1.0 - outcome.after.maximum / outcome.before.maximum


def test_a_lead_removes_what_latency_leaves(linear_rig, compensator, moved):
    planned, before = moved
    cases = [
        CompensationCase(ORDERS, "full", TaskForm.TWO),
        CompensationCase(ORDERS, "full", TaskForm.TWO, lead_time_s(linear_rig, TaskForm.TWO)),
    ]
    late, ahead = (compare(linear_rig, planned, before, compensator, case).after.rms for case in cases)
    assert ahead < 0.5 * late


def test_models_that_are_spread_over_calls_take_off_nearly_as_much(linear_rig, linear_bundle, compensator, moved):
    planned, before = moved
    spread = EmittedCompensator(linear_bundle, outputs_per_cycle=1)
    parts = {variable.key for variable in spread.project.pous["FB_TEPREDICT"].variables}
    assert "NPART" in parts
    case = CompensationCase(ORDERS, "full", TaskForm.ONE)
    whole, late = (compare(linear_rig, planned, before, one, case).after.rms for one in (compensator, spread))
    assert whole != late
    assert late < 1.1 * whole


def test_orders_left_out_stay(linear_rig, linear_bundle, moved):
    planned, before = moved
    some = EmittedCompensator(restricted(linear_bundle, (0, 1)))
    outcome = compare(linear_rig, planned, before, some, CompensationCase((0, 1), "full", TaskForm.ONE))
    theta = np.radians(before.theta_out_deg[planned.first :])
    left = ((0.0007 * np.exp(-1.7j) + 0.00014 * np.exp(0.5j)) * np.exp(39j * theta)).real
    assert outcome.after.rms == pytest.approx(float(np.sqrt(np.mean(left**2))), rel=0.05)


def test_the_forms_agree_where_they_must(linear_rig, compensator, moved):
    """Coefficients that hardly change make the split form the single one."""
    planned, before = moved
    one, split = (
        compare(linear_rig, planned, before, compensator, CompensationCase(ORDERS, "continuous", form))
        for form in (TaskForm.ONE, TaskForm.SPLIT)
    )
    assert split.after.rms == pytest.approx(one.after.rms, rel=0.05)


def test_laws(linear_rig, compensator, moved):
    planned, before = moved
    by_law = {
        law: compare(linear_rig, planned, before, compensator, CompensationCase(ORDERS, law, TaskForm.ONE))
        for law in LAWS
    }
    assert by_law["full"].after.rms < by_law["continuous"].after.rms < by_law["published"].after.rms
    # where the weight is 1 they are the same
    assert by_law["full"].full_before.rms == by_law["full"].before.rms
    # at 100 rpm the published law steps by a third: that fades with the position loop's time constant, after the delays
    drive, full = linear_rig.axis.drive, (np.abs(planned.speed_rpm) >= 100.0).sum() * planned.cycle_s
    fading = 0.5 / drive.position_gain_per_s + lead_time_s(linear_rig, TaskForm.ONE)
    published = by_law["published"]
    assert published.full_after.rms < published.before.maximum / 3 * np.sqrt(fading / full)


def test_no_transmission_error_gives_no_error(linear_bundle):
    """A perfect reducer, no compensation: theta_out is theta_in / ratio to the last bits."""
    perfect = machine_of(
        parse_rig("[rig]\nreduction_ratio = 81.0\n[axis.encoders]\noutput_noise_deg = 0.0\ninput_noise_deg = 0.0\n")
    )
    planned = plan(perfect, turn(duration=0.3))
    record = run(perfect, planned)
    assert (
        np.abs(record.theta_out_deg - record.theta_in_deg / 81.0).max()
        <= 4 * np.finfo(float).eps * np.abs(record.theta_out_deg).max()
    )
    steps = 360.0 / 2.0**26
    assert np.abs(record.seen_out_deg - record.seen_in_deg / 81.0).max() < steps * (1 + 1 / 81) + 1e-12


def test_a_compensator_that_predicts_nothing_changes_nothing(linear_rig, tmp_path, moved):
    from st_codegen.project.bundle import load

    nothing = parse_rig("[rig]\nreduction_ratio = 81.0\n")
    bundle = load(write_bundle(nothing, tmp_path / "zero", (0, 1)))
    planned, before = moved
    outcome = compare(
        linear_rig, planned, before, EmittedCompensator(bundle), CompensationCase((0, 1), "full", TaskForm.ONE)
    )
    assert outcome.error_after_deg.tobytes() == outcome.error_before_deg.tobytes()


def test_the_code_in_the_loop_gives_the_bits_of_the_block_run_for_all_rows(compensator):
    random = np.random.default_rng(5)
    rows = np.stack([random.uniform(-1700, 1700, 60), random.uniform(0, 1800, 60), random.uniform(15, 45, 60)], axis=1)
    theta = 0.1 * np.arange(60)
    block = Machine(compensator.project, rows=60).instance("FB_Compensator")
    block["bEnable"] = True
    block(fThetaOut_rad=theta, fSpeed_rpm=rows[:, 0], fTorque_Nm=rows[:, 1], fTemperature_C=rows[:, 2], fCycle_s=250e-6)
    for number, point in enumerate(rows.tolist()):
        running = compensator.start(TaskForm.ONE, "continuous", TaskSettings())
        running.correct(TaskInputs(theta[number], *point))
        assert running.te_deg.hex() == block["fTE_deg"][number].item().hex()
        assert running.weight.hex() == block["fWeight"][number].item().hex()


def test_the_same_seed_gives_the_same_bits_and_another_one_does_not():
    rig = machine_of(
        parse_rig(
            LINEAR_RIG.replace("output_noise_deg = 0.0", "output_noise_deg = 1e-4") + "\n[tasks]\njitter_us = 5.0\n"
        )
    )
    errors = [run(rig, plan(rig, turn(duration=0.1), seed=seed)).seen_out_deg.tobytes() for seed in (1, 1, 2)]
    assert errors[0] == errors[1] != errors[2]


def test_the_mean_does_not_jump_while_the_load_turns_over(linear_rig):
    """Compliance follows the load, not the sign of the speed: it is the same in both directions."""
    there = turn(duration=0.3)
    back = MotionProfile(
        "there and back",
        np.arange(2 * len(there.time_s)) * 250e-6,
        np.concatenate([there.angle_deg, there.angle_deg[::-1]]),
        np.concatenate([there.speed_deg_s, -there.speed_deg_s[::-1]]),
        np.concatenate([there.torque_Nm, there.torque_Nm]),
    )
    planned = plan(linear_rig, back)
    mean = planned.harmonics.parts[:, :, 0]
    np.testing.assert_allclose(mean[:, 2] - mean[:, 0], 2 * 0.25 / 60, atol=1e-15)  # the drag alone tells them apart
    # 200 N m turn over: 2 * 200 / 454 arcmin, as fast as the load side's control lets it
    assert mean[-1, 0] - mean[planned.first, 0] == pytest.approx(2 * 200 / 454 / 60, rel=1e-3)
    assert np.abs(np.diff(mean[:, 0])).max() < 0.1 * 2 * 200 / 454 / 60


def test_the_axis_stands_until_its_motion_begins(linear_rig):
    planned = plan(linear_rig, turn())
    assert planned.first > 0
    assert not planned.speed_rpm[: planned.first].any() and planned.speed_rpm[planned.first :].any()


def test_oil_that_drifts_and_its_slow_sensor(linear_rig):
    warm = with_oil(linear_rig, 28.0, 6.0)
    planned = plan(warm, turn())
    assert planned.temperature_C[0] == 28.0
    assert planned.temperature_C[-1] == pytest.approx(28.06)
    assert planned.sensor_C[-1] < 28.01  # time constant of 20 s


def test_half_a_modulation_is_named_beside_every_other_problem_of_its_effect():
    mesh = '[[effect]]\nname = "load_dependent_mesh"\norder = 39\nslope_deg_per_kNm = 1e-3\nmodulated = 0.5\nfoo = 1\n'
    head = "[rig]\nname = 't'\nreduction_ratio = 81\ncycloid_teeth = 39\npins = 40\ncranks = 3\n"
    with pytest.raises(InputError, match=r"(?s)2 problems.*unknown key 'foo'.*'modulated' is neither 0 nor 1"):
        parse_rig(head + mesh)


def test_another_specimen_has_the_same_forms():
    """A share of what says a form is no form: "'modulated' is neither 0 nor 1", by which no motion was rehearsed."""
    mesh = '[[effect]]\nname = "load_dependent_mesh"\norder = 39\nslope_deg_per_kNm = 1e-3\n'
    head = "[rig]\nname = 't'\nreduction_ratio = 81\ncycloid_teeth = 39\npins = 40\ncranks = 3\n"
    rig = parse_rig(f"{head}{mesh}exponent = 3\nmodulated = 1\n")
    for seed in range(5):
        (effect,) = another_specimen(rig, catalogue(), 0.02, seed).effects
        assert effect.values["exponent"] == 3.0 and effect.values["modulated"] == 1.0
        assert effect.values["slope_deg_per_kNm"] != 1e-3 and effect.orders == (39,)


def test_another_specimen_differs_by_its_spread(linear_model):
    other = another_specimen(linear_model, catalogue(()), 0.05, 3)
    assert [e.name for e in other.effects] == [e.name for e in linear_model.effects]
    old, new = (
        np.array([e.table()["amplitude_deg"] for e in r.effects if "amplitude_deg" in e.table()])
        for r in (linear_model, other)
    )
    assert 0.0 < np.abs(new / old - 1.0).max() < 0.25
    assert another_specimen(linear_model, catalogue(()), 0.0, 3).text() == linear_model.text()


def test_effects_of_recordings_set_the_axis():
    extra = '\n[[effect]]\nname = "control_lag"\nlag_ms = 5.0\n[[effect]]\nname = "coupling_compliance"\nstiffness_Nm_per_rad = 5000.0\nbacklash_arcmin = 2.0\n'  # noqa: E501
    axis = machine_of(parse_rig(LINEAR_RIG + extra)).axis
    assert axis.drive.position_gain_per_s == pytest.approx(200.0)
    assert axis.drive.speed_feedforward == 0.0
    assert (axis.coupling.stiffness_Nm_per_rad, axis.coupling.backlash_arcmin) == (5000.0, 2.0)
    own = machine_of(parse_rig(LINEAR_RIG + extra + "\n[axis.drive]\nposition_gain_per_s = 50.0\n")).axis
    assert own.drive.position_gain_per_s == 50.0


def test_a_study_runs_all_cases(linear_rig, linear_bundle):
    wish = MotionWish(
        ((0, 1), ORDERS), ("published",), (TaskForm.TWO, TaskForm.SPLIT), AUTO, inputs={"fBlendTime_s": 0.02}
    )
    seen = []
    study = simulate(linear_rig, linear_bundle, turn(duration=0.2), wish, progress=lambda *state: seen.append(state))
    assert [(len(o.case.orders), o.case.form) for o in study.outcomes] == [
        (2, "two"),
        (2, "split"),
        (3, "two"),
        (3, "split"),
    ]
    assert seen[0][0] == 0
    assert seen[-1][:2] == (5, 5)
    assert all(o.case.lead_s > 1e-3 for o in study.outcomes if o.case.form is TaskForm.TWO)


def test_a_study_says_where_the_motion_leaves_the_ranges_of_the_models(linear_rig, linear_bundle):
    wish = MotionWish((ORDERS,), ("full",), (TaskForm.ONE,))
    study = simulate(with_oil(linear_rig, 90.0, None), linear_bundle, turn(duration=0.05, torque=5000.0), wish)
    assert "torque_Nm is above" in study.outside
    assert "temperature_C is above" in study.outside
    assert remarks(study) == [study.outside]


@pytest.fixture(scope="module")
def playing(linear_bundle):
    """The same bundle, which knows what 0.25 arcmin of drag make."""
    te = dataclasses.replace(linear_bundle.purpose.te, play=Play(0.5 / 60, 1))
    return restricted(Bundle(linear_bundle.models, Compensation(te)), (0, 1))


def there_and_back(cycle=250e-6):
    """Half a turn out and back, with a rest between, and a load that opposes both ways also at rest."""
    out, rest = turn(cycle, 40.0, 0.4), np.zeros(400)
    rate = np.concatenate([out.speed_deg_s, rest, -out.speed_deg_s])
    angle = np.concatenate([out.angle_deg, rest + out.angle_deg[-1], out.angle_deg[::-1]])
    return MotionProfile("back", np.arange(len(rate)) * cycle, angle, rate, np.full(len(rate), 60.0))


@pytest.mark.parametrize("form", [TaskForm.ONE, TaskForm.SPLIT])
def test_a_load_that_is_known_ahead_helps_at_reversals(linear_rig, playing, form):
    def largest(load, ahead, **inputs):
        given = {"fBlendTime_s": 0.005, "fHysteresis_rpm": 0.2, **inputs}
        wish = MotionWish(((0, 1),), ("full",), (form,), AUTO, inputs=given, load=load, ahead=ahead)
        (outcome,) = simulate(linear_rig, playing, there_and_back(), wish, compensators=code).outcomes
        assert (outcome.case.load, outcome.case.ahead) == (load, ahead)
        return outcome.after.maximum

    code = {}
    without = largest(LoadSource.NONE, False)
    ahead = largest(LoadSource.SETPOINT, True, fLoadTime_s=0.0056)
    assert ahead < 0.75 * without


def test_what_the_blocks_are_told_is_that_of_later(linear_rig):
    planned = plan(linear_rig, there_and_back())
    ahead = Told.of(planned, LoadSource.SETPOINT, 0.01)
    assert np.array_equal(ahead.speed_rpm[:-40], planned.speed_rpm[40:])
    assert np.array_equal(ahead.load_Nm[:-40], planned.setpoint_Nm[40:])
    assert np.array_equal(ahead.torque_Nm[-41:], np.full(41, planned.wanted_Nm[-1]))
    assert np.array_equal(Told.of(planned, LoadSource.MEASURED, 0.01).load_Nm, planned.load_Nm)
    assert set(np.sign(planned.setpoint_Nm)) == {1.0, -1.0}


@pytest.mark.parametrize(
    ("call", "part"),
    [
        (lambda b, c: c.start(TaskForm.ONE, "full", TaskSettings(), load_given=True), r"no \[play\]"),
        (lambda b, c: parse_orders(("0,x",), b), "whole numbers"),
        (lambda b, c: parse_orders(("0,7",), b), "order 7"),
        (lambda b, c: parse_lead("soon"), "microseconds"),
        (lambda b, c: parse_lead("-3"), "microseconds"),
        (lambda b, c: parse_inputs(("fBlendTime_s",)), "fBlendTime_s=0.05"),
        (lambda b, c: c.start(TaskForm.ONE, "full", TaskSettings(), 0.2), "lead"),
        (lambda b, c: c.start(TaskForm.ONE, "full", TaskSettings(), 0.0, {"fWrong": 1.0}), "fWrong"),
        (lambda b, c: EmittedCompensator(b, "iec").start(TaskForm.SPLIT, "full", TaskSettings()), "twincat"),
        (lambda b, c: c.start(TaskForm.SPLIT, "full", TaskSettings(500.0, 500.0)), "main_us"),
    ],
)
def test_wishes_that_cannot_be_met(linear_bundle, compensator, call, part):
    with pytest.raises(InputError, match=part):
        call(linear_bundle, compensator)


def test_the_bundle_must_fit_the_rig(linear_bundle):
    rig = machine_of(parse_rig("[rig]\nreduction_ratio = 100.0\n"))
    with pytest.raises(InputError, match="reduction ratio 81"):
        simulate(rig, linear_bundle, turn(), MotionWish((ORDERS,)))


def test_features_the_rig_does_not_know(linear_bundle):
    te = linear_bundle.purpose.te
    strange = dataclasses.replace(te.features[1], name="humidity", unit="%")
    with pytest.raises(InputError, match="humidity"):
        roles_of(dataclasses.replace(te, features=(te.features[0], strange, te.features[2])))


def test_of_no_error_no_share_is_gone(linear_rig, compensator, moved):
    planned, before = moved
    outcome = compare(linear_rig, planned, before, compensator, CompensationCase(ORDERS, "full", TaskForm.ONE))
    assert outcome.refused == ""
    nothing = dataclasses.replace(outcome, before=Size(0.0, 0.0))
    assert np.isnan(nothing.reduction).all()
    assert or_none(nothing.reduction[0]) is None
