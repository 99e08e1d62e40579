"""The axis by itself: what it conserves, its limiting cases, what it refuses."""

import dataclasses
import math

import numpy as np
import pytest

pytest.importorskip("numba")

from st_codegen.errors import InputError, Problems
from st_codegen.files.toml_tables import TomlTable
from st_codegen.rig import kernel
from st_codegen.rig.axis import Axis, Harmonics, controlled_torque
from st_codegen.rig.axis_parameters import AxisParameters, Coupling, Drive, Encoders, Load, Motor, Reducer, read_axis
from st_codegen.rig.machine import machine_of
from st_codegen.rig.model import RigModel

RATIO = 81.0
FREE = AxisParameters(
    motor=Motor(viscous_Nms_per_rad=0.0, coulomb_Nm=0.0),
    coupling=Coupling(damping_Nms_per_rad=0.0),
    reducer=Reducer(coulomb_Nm=0.0, viscous_Nms_per_rad=0.0, load_friction=0.0),
)
STILL = np.zeros(2)


def wavy(amplitude_deg=0.02, order=39.0):
    """A transmission error of one order, equal in both directions."""
    part = np.array([[0.0, amplitude_deg], [0.0, 0.0], [0.0, amplitude_deg], [0.0, 0.0]])
    return Harmonics(np.array([0.0, order]), part[None])


def energy(axis):
    """Kinetic energy of all masses and the coupling's twist (the load's work is not in it)."""
    p, x = axis.packed, axis.state
    g = 1.0 / (axis.ratio * (1.0 - x[kernel.TE1]))
    wound = max(abs(x[kernel.TH_MOT] - x[kernel.TH_IN]) - p[kernel.HALF_PLAY], 0.0)
    moving = p[kernel.J_MOT] * x[kernel.W_MOT] ** 2 + (p[kernel.J_IN] + p[kernel.J_OUT] * g * g) * x[kernel.W_IN] ** 2
    return float(0.5 * (moving + p[kernel.STIFFNESS] * wound**2))


def spun(parameters, harmonics, cycles, twist_rate=5.0, speed=100.0):
    """Energies of a free axis after each cycle: both masses turn, the coupling swings."""
    axis = Axis(parameters, RATIO)
    axis.packed[kernel.CURRENT_GAIN] = 0.0  # the motor makes no torque
    axis.place(0.0, harmonics)
    axis.state[kernel.W_MOT] = speed + twist_rate
    axis.state[kernel.W_IN] = speed
    energies = [energy(axis)]
    for _ in range(cycles):
        axis.advance(0.0, STILL, harmonics.orders, harmonics.parts[0])
        energies.append(energy(axis))
    return np.array(energies)


def test_without_friction_and_loops_energy_stays_within_the_integrators_bound():
    """Velocity Verlet keeps H - (h w / 2)^2 U exactly, U the energy of the twist (linear forces, one frequency w).

    So H swings by at most (h w / 2)^2 * max U; from rest of the twist max U = kinetic energy of the twist / (1 - (h w
    / 2)^2).
    """
    energies = spun(FREE, Harmonics.none(1), 8000)
    behind = FREE.reducer.inertia_kgm2 + FREE.load.inertia_kgm2 / RATIO**2
    reduced = 1.0 / (1.0 / FREE.motor.inertia_kgm2 + 1.0 / behind)
    share = (FREE.step_s * FREE.coupling_frequency_rad_s(RATIO) / 2.0) ** 2
    largest = 0.5 * reduced * 5.0**2 / (1.0 - share)
    rounding = 8000 * 8 * 8 * np.finfo(float).eps * energies[0]
    assert np.ptp(energies) <= share * largest + rounding
    # and the bound is no empty one
    assert np.ptp(energies) > 0.5 * share * largest


def test_with_a_transmission_error_energy_is_conserved_to_second_order():
    """The constraint takes and gives kinetic energy; halving the step quarters what is lost."""
    swings = []
    for step in (31.25e-6, 15.625e-6):
        energies = spun(dataclasses.replace(FREE, step_s=step), wavy(), 800, twist_rate=0.0)
        swings.append(np.ptp(energies) / energies[0])
    assert swings[0] < 1e-4
    assert swings[0] / swings[1] == pytest.approx(4.0, rel=0.25)


def test_friction_takes_energy():
    axis = dataclasses.replace(FREE, reducer=Reducer())
    energies = spun(axis, Harmonics.none(1), 400)
    assert energies[-1] < energies[0]


def test_a_stiff_coupling_keeps_theta_in_at_theta_mot():
    """The twist is the carried torque over the stiffness: at constant speed the load and the friction behind it, to 1
    %."""
    twists = []
    for stiffness in (2e4, 2e5):
        parameters = dataclasses.replace(
            FREE,
            step_s=250e-6 / 64,
            coupling=Coupling(stiffness, damping_Nms_per_rad=5.0),
            encoders=Encoders(motor_steps_per_rev=2.0**40),
            drive=Drive(cycle_s=125e-6),
        )
        axis = Axis(parameters, RATIO)
        axis.place(0.0, Harmonics.none(1))
        load = np.full(2, 500.0)
        for n in range(4000):
            axis.advance(100.0 * n * 250e-6, load, np.zeros(0), np.zeros((4, 0)))
        twists.append(math.radians(axis.theta_mot_deg - axis.theta_in_deg))
        assert twists[-1] == pytest.approx(500.0 / RATIO / stiffness, rel=0.01)
    assert twists[0] / twists[1] == pytest.approx(10.0, rel=0.02)


def test_the_drive_settles_on_its_reference_and_lags_by_one_over_the_gain():
    """A P loop without feedforward follows a ramp 1 / gain later; the rest is the interpolator's cycle."""
    lag = 0.004
    parameters = dataclasses.replace(
        FREE, drive=Drive(position_gain_per_s=1 / lag, speed_feedforward=0.0, acceleration_feedforward=0.0)
    )
    axis = Axis(parameters, RATIO)
    axis.place(0.0, Harmonics.none(1))
    speed = 600.0  # deg/s of the motor
    for n in range(4000):
        axis.advance(speed * n * 250e-6, STILL, np.zeros(0), np.zeros((4, 0)))
    # the last set-point is reached when its cycle ends
    behind = speed * 3999 * 250e-6 - axis.theta_mot_deg
    resolution = 360.0 / parameters.encoders.motor_steps_per_rev
    assert behind == pytest.approx(speed * lag, abs=speed * 125e-6 + resolution)
    for _ in range(4000):
        axis.advance(1000.0, STILL, np.zeros(0), np.zeros((4, 0)))
    assert axis.theta_mot_deg == pytest.approx(1000.0, abs=2 * resolution)


def test_the_output_follows_the_transmission_error_exactly():
    harmonics = wavy()
    axis = Axis(AxisParameters(), RATIO)
    axis.place(0.0, harmonics)
    for n in range(2000):
        axis.advance(0.3 * n, STILL, harmonics.orders, harmonics.parts[0])
        te = 0.02 * math.cos(39.0 * math.radians(axis.theta_out_deg))
        # one Newton step a step, from an error that a step's travel makes: TE' ** 2 of its change
        assert axis.te_deg == pytest.approx(te, abs=1e-7)
    assert axis.theta_out_deg - axis.theta_in_deg / RATIO == pytest.approx(axis.te_deg, abs=1e-12)


def test_at_a_reversal_the_output_stands_still_until_the_play_is_travelled():
    jump = 0.04
    parts = np.array([[-jump / 2], [0.0], [jump / 2], [0.0]])[None]
    harmonics = Harmonics(np.zeros(1), parts)
    axis = Axis(AxisParameters(), RATIO)
    axis.place(0.0, harmonics)
    for n in range(400):
        axis.advance(0.05 * n, STILL, harmonics.orders, parts[0])
    assert axis.te_deg == pytest.approx(-jump / 2)
    highest = axis.theta_out_deg
    outs, tes = [], []
    for n in range(400, -400, -1):
        axis.advance(0.05 * n, STILL, harmonics.orders, parts[0])
        outs.append(axis.theta_out_deg)
        tes.append(axis.te_deg)
    waiting = np.array([te for te in tes if -jump / 2 + 1e-4 < te < jump / 2 - 1e-4])
    assert len(waiting) > 10
    held = [out for out, te in zip(outs, tes, strict=True) if -jump / 2 + 1e-3 < te < jump / 2 - 1e-3]
    assert np.ptp(held) < 0.1 * jump
    assert tes[-1] == pytest.approx(jump / 2)
    assert max(outs) - highest < jump


def test_the_same_run_gives_the_same_bits():
    states = []
    for _ in range(2):
        harmonics = wavy()
        axis = Axis(AxisParameters(), RATIO)
        axis.place(3.0, harmonics)
        for n in range(200):
            axis.advance(3.0 + 0.3 * n, np.array([50.0, 60.0]), harmonics.orders, harmonics.parts[0])
        states.append(axis.state.tobytes())
    assert states[0] == states[1]


def test_play_of_the_coupling_is_felt():
    parameters = dataclasses.replace(AxisParameters(), coupling=Coupling(backlash_arcmin=30.0))
    axis = Axis(parameters, RATIO)
    axis.place(0.0, Harmonics.none(1))
    for n in range(2000):
        axis.advance(0.05 * n, np.full(2, 200.0), np.zeros(0), np.zeros((4, 0)))
    assert axis.theta_mot_deg - axis.theta_in_deg > 0.25  # half the play, and the twist


def test_flanks_push_and_do_not_pull():
    """Just beyond the play the coupling's damping would hold flanks together that part: on both sides alike."""
    axis = Axis(dataclasses.replace(AxisParameters(), coupling=Coupling(backlash_arcmin=30.0)), RATIO)
    axis.place(0.0, Harmonics.none(1))
    at_rest = kernel.accelerations.py_func(axis.state, axis.packed, 0.0)
    for side in (1.0, -1.0):
        state = axis.state.copy()
        state[kernel.TH_MOT] = state[kernel.TH_IN] + side * (axis.packed[kernel.HALF_PLAY] + 1e-9)
        state[kernel.W_MOT], state[kernel.W_IN] = 0.0, side * 1e-3
        motor, _ = kernel.accelerations.py_func(state, axis.packed, 0.0)
        assert motor == pytest.approx(0.0, abs=1e-12)
        state[kernel.W_IN] *= -1.0
        motor, _ = kernel.accelerations.py_func(state, axis.packed, 0.0)
        assert side * motor < -1e-3
    assert at_rest == pytest.approx((0.0, 0.0), abs=1e-12)


def test_the_load_side_reaches_its_set_point_and_ripples_as_stated():
    random = np.random.default_rng(3)
    steady = controlled_torque(np.full(4000, 300.0), Load(torque_ripple_Nm=0.0), 250e-6, random)
    assert np.abs(steady - 300.0).max() < 1e-9
    step = controlled_torque(np.concatenate([[0.0], np.full(8000, 300.0)]), Load(torque_ripple_Nm=0.0), 250e-6, random)
    assert step[-1] == pytest.approx(300.0)
    # 0.7 damping overshoots by exp(-pi d / sqrt(1 - d^2)) = 4.6 %
    assert step.max() == pytest.approx(300.0 * 1.046, rel=1e-3)
    ripple = controlled_torque(np.zeros(200_000), Load(torque_ripple_Nm=2.0), 250e-6, random)
    # 50 s at 40 Hz are some 2000 independent values: 5 % are three standard deviations
    assert ripple[4000:].std() == pytest.approx(2.0, rel=0.05)
    # the mean of as many has a standard error of 2 / sqrt(2000)
    assert abs(ripple[4000:].mean()) < 4 * 2.0 / np.sqrt(2000)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (AxisParameters(coupling=Coupling(1e7)), "step_s"),
        (AxisParameters(coupling=Coupling(damping_Nms_per_rad=1e3)), "step_s"),
        (AxisParameters(drive=Drive(speed_gain_Nms_per_rad=200.0)), "unstable"),
        (AxisParameters(drive=Drive(position_gain_per_s=5e3)), "unstable"),
        (AxisParameters(step_s=30e-6), "multiple"),
        (AxisParameters(drive=Drive(cycle_s=100e-6)), "multiple"),
    ],
)
def test_what_cannot_run_is_refused(parameters, message):
    with pytest.raises(InputError, match=message):
        Axis(parameters, RATIO)


def test_the_default_loops_are_stable_with_and_without_feedforward():
    assert Axis(AxisParameters(), RATIO).growth() < 1.0
    slow = Drive(position_gain_per_s=250.0, speed_feedforward=0.0, acceleration_feedforward=0.0)
    assert Axis(AxisParameters(drive=slow), RATIO).growth() < 1.0


def test_all_faults_of_a_table_in_one_message():
    problems = Problems("rig.toml")
    values = {"stepp_s": 1.0, "motor": {"inertia_kgm2": -1.0}, "drive": 3, "load": {"inertia_kgm2": "x"}}
    read_axis(TomlTable(values, "[axis]", problems))
    with pytest.raises(InputError) as caught:
        problems.raise_if_any()
    text = str(caught.value)
    for part in ("'stepp_s'; did you mean 'step_s'", "[axis.motor]", "[axis.drive]", "[axis.load]", "4 problems"):
        assert part in text


def test_every_parameter_names_a_source_and_holds_its_own_bounds():
    for group in (AxisParameters(), Motor(), Drive(), Coupling(), Reducer(), Load(), Encoders()):
        for field in dataclasses.fields(group):
            value = getattr(group, field.name)
            if not dataclasses.is_dataclass(value):
                assert field.metadata["source"]
                assert field.metadata["low"] <= value <= field.metadata["high"], field.name


def test_an_axis_may_be_without_friction_and_load():
    problems = Problems("rig.toml")
    without = {
        "motor": {"viscous_Nms_per_rad": 0.0, "coulomb_Nm": 0.0},
        "coupling": {"damping_Nms_per_rad": 0.0, "backlash_arcmin": 0.0},
        "reducer": {"coulomb_Nm": 0.0, "viscous_Nms_per_rad": 0.0, "load_friction": 0.0},
        "load": {"inertia_kgm2": 0.0, "torque_ripple_Nm": 0.0},
    }
    axis = read_axis(TomlTable(without, "[axis]", problems))
    problems.raise_if_any()
    for group, values in without.items():
        assert {key: getattr(getattr(axis, group), key) for key in values} == values


def test_a_rig_made_by_hand_is_checked_as_one_from_a_file():
    with pytest.raises(InputError, match="unknown key 'motors'"):
        machine_of(RigModel(other={"axis": {"motors": {}}}))
    with pytest.raises(InputError, match="main_us"):
        machine_of(RigModel(other={"tasks": {"main_us": -1.0}}))
