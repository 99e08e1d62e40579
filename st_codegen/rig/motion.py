"""Motions with and without compensation: profile, PLC tasks with the generated text, axis, error of the output."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from st_codegen.errors import InputError
from st_codegen.files.number_text import percent
from st_codegen.ir.arrays import FloatArray
from st_codegen.rig.axis import Axis, ErrorModel, Harmonics, controlled_torque
from st_codegen.rig.axis_parameters import AxisParameters, Thermal
from st_codegen.rig.compensator import EmittedCompensator, RunningCompensator
from st_codegen.rig.profiles import MotionProfile
from st_codegen.rig.tasks import Plc, TaskForm, TaskInputs, TaskSettings
from st_codegen.te.compensation.codes import TE_ERROR

#: Standstill before the profile starts: the compensator's ramp has its 0.5 s, the loops settle.
LEAD_IN_S = 1.0


@dataclass(frozen=True)
class Rig:
    """All that a motion needs of the machine: TE, axis, tasks."""

    model: ErrorModel
    axis: AxisParameters = field(default_factory=AxisParameters)
    tasks: TaskSettings = field(default_factory=TaskSettings)


@dataclass(frozen=True)
class MotionPlan:
    """A profile on the PLC's ticks, with the operating points on the way. All arrays (ticks,).

    `torque_Nm` opposes the motion; `wanted_Nm` is the profile's, which the PLC knows; `load_Nm` and the load side's
    `setpoint_Nm` are above 0 against forward motion; `sensor_C` is what the oil's sensor says.
    """

    profile: MotionProfile
    cycle_s: float
    first: int
    angle_deg: FloatArray
    speed_rpm: FloatArray
    wanted_Nm: FloatArray
    setpoint_Nm: FloatArray
    torque_Nm: FloatArray
    load_Nm: FloatArray
    temperature_C: FloatArray
    sensor_C: FloatArray
    harmonics: Harmonics
    noise_in_deg: FloatArray
    noise_out_deg: FloatArray
    jitter_s: FloatArray

    @property
    def time_s(self) -> FloatArray:
        """0 where the profile starts."""
        return (np.arange(len(self.angle_deg), dtype=np.float64) - self.first) * self.cycle_s


class LoadSource(StrEnum):
    """From where the blocks know the load with its sign."""

    NONE = "none"  # they take it to oppose the motion
    SETPOINT = "setpoint"  # what the load side is told to make
    MEASURED = "measured"  # what it makes, by a torque meter without faults


@dataclass(frozen=True)
class Told:
    """What the blocks are told of the profile, each (ticks,)."""

    speed_rpm: FloatArray
    torque_Nm: FloatArray
    load_Nm: FloatArray

    @classmethod
    def of(cls, plan: MotionPlan, load: LoadSource = LoadSource.NONE, ahead_s: float = 0.0) -> Told:
        """Set points as they will be `ahead_s` later, rounded to cycles; what is measured is of now."""
        ticks = len(plan.speed_rpm)
        later = np.minimum(np.arange(ticks) + round(ahead_s / plan.cycle_s), ticks - 1)
        loads = plan.load_Nm if load is LoadSource.MEASURED else plan.setpoint_Nm[later]
        return cls(plan.speed_rpm[later], plan.wanted_Nm[later], loads)


@dataclass(frozen=True)
class MotionRecord:
    """A run, one row a tick: angles (deg, fast side and output), what encoders showed and what the compensator said."""

    theta_ref_deg: FloatArray
    theta_mot_deg: FloatArray
    theta_in_deg: FloatArray
    theta_out_deg: FloatArray
    seen_in_deg: FloatArray
    seen_out_deg: FloatArray
    weight: FloatArray
    predicted_deg: FloatArray


def plan(rig: Rig, profile: MotionProfile, *, seed: int = 0) -> MotionPlan:
    """Everything about a motion that does not depend on the loop. The same seed gives the same noise, run after run."""
    cycle = rig.tasks.main_us * 1e-6
    before = round(LEAD_IN_S / cycle)
    random = np.random.default_rng(seed)

    def held(values: FloatArray, at_rest: float | None = None) -> FloatArray:
        first = values[0] if at_rest is None else at_rest
        return np.concatenate([np.full(before, first), values])

    ratio = rig.model.reduction_ratio
    side = held(profile.direction)
    wanted = held(profile.torque_Nm)
    setpoint = wanted * side
    load = controlled_torque(setpoint, rig.axis.load, cycle, random)
    speed = held(profile.speed_deg_s, 0.0) / 6.0 * ratio
    time = (np.arange(len(speed)) - before) * cycle
    temperature = rig.axis.thermal.start_C + rig.axis.thermal.drift_K_per_min / 60.0 * np.maximum(time, 0.0)
    encoders = rig.axis.encoders
    return MotionPlan(
        profile=profile,
        cycle_s=cycle,
        first=before,
        angle_deg=held(profile.angle_deg),
        speed_rpm=speed,
        wanted_Nm=wanted,
        setpoint_Nm=setpoint,
        torque_Nm=load * side,
        load_Nm=load,
        temperature_C=temperature,
        sensor_C=_sensed(temperature, rig.axis.thermal, cycle),
        harmonics=Harmonics.along(rig.model, np.abs(speed), load, temperature),
        noise_in_deg=random.normal(0.0, 1.0, len(speed)) * encoders.input_noise_deg,
        noise_out_deg=random.normal(0.0, 1.0, len(speed)) * encoders.output_noise_deg,
        jitter_s=random.normal(0.0, 1.0, len(speed)) * rig.tasks.jitter_us * 1e-6,
    )


def _sensed(temperature_C: FloatArray, thermal: Thermal, cycle_s: float) -> FloatArray:
    """The sensor: first-order lag, offset, steps of 0.01 K."""
    if thermal.sensor_time_constant_s > 0.0:
        from scipy.signal import lfilter

        keep = float(np.exp(-cycle_s / thermal.sensor_time_constant_s))
        lagged, _ = lfilter([1.0 - keep], [1.0, -keep], temperature_C, zi=[keep * temperature_C[0]])
    else:
        lagged = temperature_C
    result: FloatArray = np.round((lagged + thermal.sensor_offset_K) / 0.01) * 0.01
    return result


def run(
    rig: Rig,
    plan: MotionPlan,
    form: TaskForm = TaskForm.ONE,
    running: RunningCompensator | None = None,
    told: Told | None = None,
) -> MotionRecord:
    """Move once, with the compensator `running` in the loop or without; `told`: what of the profile it is told."""
    told = told or Told.of(plan)
    ticks = len(plan.angle_deg)
    axis = Axis(rig.axis, rig.model.reduction_ratio, cycle_s=plan.cycle_s)
    axis.set_arrival(rig.tasks.transfer_us * 1e-6)
    references = plan.angle_deg * rig.model.reduction_ratio
    axis.place(
        float(references[0]),
        plan.harmonics,
        backward=bool(plan.profile.direction[0] < 0.0),
        load_Nm=float(plan.load_Nm[0]),
    )
    plc = Plc(rig.tasks, form, running)
    rows = np.zeros((ticks, 8))
    orders, parts, load = plan.harmonics.orders, plan.harmonics.parts, plan.load_Nm
    setpoint, radians = float(references[0]), np.pi / 180.0
    for n in range(ticks):
        age = rig.axis.encoders.delay_s - plan.jitter_s[n]
        seen_in, seen_out = axis.seen_deg(age, plan.noise_in_deg[n], plan.noise_out_deg[n])
        sample = TaskInputs(
            seen_out * radians,
            float(told.speed_rpm[n]),
            float(told.torque_Nm[n]),
            float(plan.sensor_C[n]),
            float(told.load_Nm[n]),
        )
        published = plc.tick(n, sample, float(references[n]))
        if published is not None:
            setpoint = published
        if n == plan.first and running is not None:  # what was said before the motion is that of the first calls
            running.calls = running.limited = 0
            running.refused.clear()
        rows[n, :6] = setpoint, axis.theta_mot_deg, axis.theta_in_deg, axis.theta_out_deg, seen_in, seen_out
        if running is not None:
            rows[n, 6:] = running.weight, running.te_deg
        axis.advance(setpoint, load[n : n + 2] if n + 1 < ticks else load[[n, n]], orders, parts[n])
    if not np.isfinite(rows).all():
        raise InputError(
            "the simulation left all bounds; the parameters of [axis] do not describe a machine that can move like this"
        )
    return MotionRecord(*rows.T)


# --- results ---


@dataclass(frozen=True)
class Size:
    """Root mean square and largest magnitude, deg."""

    rms: float
    maximum: float

    @classmethod
    def of(cls, values: FloatArray) -> Size:
        """The root mean square and the largest magnitude of an error over time, deg; NaN of no time."""
        if not len(values):
            return cls(math.nan, math.nan)
        return cls(float(np.sqrt(np.mean(values**2))), float(np.abs(values).max()))


def or_none(value: float) -> float | None:
    """What is not known is null in JSON."""
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class CompensationCase:
    """One way to compensate; `inputs`: other inputs of the block, by name.

    `load`: from where the blocks know the load with its sign; `ahead`: they are told the set points of the lead later.
    """

    orders: tuple[int, ...]
    law: str
    form: TaskForm
    lead_s: float = 0.0
    inputs: Mapping[str, float] = field(default_factory=dict)
    load: LoadSource = LoadSource.NONE
    ahead: bool = False


@dataclass(frozen=True)
class MotionOutcome:
    """One case on one profile. `before`, `after`: the whole motion; `full_..`: where the law's weight is 1.

    The error after is theta_out with compensation against theta_in / ratio of the same motion without it: what is left
    of TE at the output, without the drive's own lag, which both have. `following`: theta_out against the profile,
    drive included. `refused`: in which calls the blocks refused their inputs, so that they did not correct, and why;
    `limited`: in which the correction was as large as it may be.
    """

    case: CompensationCase
    before: Size
    after: Size
    full_before: Size
    full_after: Size
    following_before: Size
    following_after: Size
    error_before_deg: FloatArray
    error_after_deg: FloatArray
    predicted_deg: FloatArray
    refused: str = ""
    limited: str = ""

    @property
    def reduction(self) -> tuple[float, float]:
        """Share of RMS and maximum that is gone, over the whole motion; NaN where there was nothing."""
        pairs = (self.after.rms, self.before.rms), (self.after.maximum, self.before.maximum)
        rms, maximum = (1.0 - after / before if before else math.nan for after, before in pairs)
        return rms, maximum


def compare(
    rig: Rig, plan: MotionPlan, before: MotionRecord, compensator: EmittedCompensator, case: CompensationCase
) -> MotionOutcome:
    """Move with the compensator and compare with the same motion without it."""
    given = case.load is not LoadSource.NONE
    running = compensator.start(case.form, case.law, rig.tasks, case.lead_s, case.inputs, load_given=given)
    after = run(rig, plan, case.form, running, Told.of(plan, case.load, case.lead_s if case.ahead else 0.0))
    ratio, moving = rig.model.reduction_ratio, slice(plan.first, None)
    old = (before.seen_out_deg - before.seen_in_deg / ratio)[moving]
    new = (after.seen_out_deg - before.seen_in_deg / ratio)[moving]
    full = after.weight[moving] >= 1.0
    wanted = plan.angle_deg[moving]
    return MotionOutcome(
        case=case,
        before=Size.of(old),
        after=Size.of(new),
        full_before=Size.of(old[full]),
        full_after=Size.of(new[full]),
        following_before=Size.of(before.theta_out_deg[moving] - wanted),
        following_after=Size.of(after.theta_out_deg[moving] - wanted),
        error_before_deg=old,
        error_after_deg=new,
        predicted_deg=after.predicted_deg[moving],
        refused=_refused(running),
        limited=_limited(running),
    )


def _refused(running: RunningCompensator) -> str:
    """In which calls a compensator refused its inputs, and why; empty where it took all."""
    if not running.refused:
        return ""
    share = sum(running.refused.values()) / running.calls
    known = {code.value: code for code in TE_ERROR.all}
    reasons = "; ".join(f"{known[number].name}: {known[number].comment}" for number in sorted(running.refused))
    return f"an error in {percent(share)} of the calls, by which the correction fades to zero ({reasons})"


def _limited(running: RunningCompensator) -> str:
    """In which calls a larger correction was kept from the motor; empty for none."""
    if not running.limited:
        return ""
    share = percent(running.limited / running.calls)
    return f"the correction is at its limit, fCorrectionLimit_deg = {running.limit_deg:g}, in {share} of the calls"


def outside(compensator: EmittedCompensator, plan: MotionPlan) -> str:
    """Where a motion leaves the ranges of the models, so that nothing was learned there; empty: nowhere."""
    told = Told.of(plan)
    values = {"speed": np.abs(told.speed_rpm), "torque": told.torque_Nm, "temperature": plan.sensor_C}
    roles = {name: values[role][plan.first :] for role, name in vars(compensator.roles).items() if name}
    found = []
    for feature, name in zip(compensator.te.features, compensator.names, strict=True):
        if feature.checked is None:
            continue
        low, high = feature.checked
        for side, end, is_out in ("below", low, roles[name] < low), ("above", high, roles[name] > high):
            if is_out.any():
                found.append(f"{feature.name} is {side} {end:g} in {percent(float(is_out.mean()))} of the motion")
    return f"outside the ranges of the models (bInRange is FALSE): {', '.join(found)}" if found else ""


def lead_time_s(rig: Rig, form: TaskForm) -> float:
    """All known delays from a latched angle to the motor's answer, s: tasks, transfer, hold, interpolation and lag.

    The drive's interpolator reaches a set-point one main cycle after its arrival. Without feedforward of the speed its
    position loop follows 1 / gain later.
    """
    drive = rig.axis.drive
    lag = max(1.0 - drive.speed_feedforward, 0.0) / drive.position_gain_per_s if drive.position_gain_per_s else 0.0
    chain = rig.tasks.latency(form).mean_us + rig.tasks.main_us
    return chain * 1e-6 + lag + rig.axis.encoders.delay_s
