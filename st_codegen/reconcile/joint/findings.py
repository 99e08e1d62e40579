"""What is said of a joint: findings in words with their numbers, alternatives, and what the data cannot show."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from st_codegen.errors import at_least
from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.joint.parts import BODIES, KINDS, LOADED, OTHERS, OVER_SPEED, TorquePart, crossed
from st_codegen.reconcile.joint.run import JointResult
from st_codegen.reconcile.joint.settings import JOINT
from st_codegen.reconcile.joint.waves import ANGLE, TorqueWave
from st_codegen.reconcile.outcome import Outcome
from st_codegen.rig.effects import Constants

Value = tuple[float, float | None, str]


@dataclass(frozen=True)
class JointFinding:
    """A named part: key, sentence, parameters (value, standard error, unit), what else could do it, evidence."""

    name: str
    text: str
    parameters: dict[str, Value]
    alternatives: tuple[str, ...] = ()
    remark: str = ""
    share: float | None = None


def findings(result: JointResult, constants: Constants | None) -> list[JointFinding]:
    """The findings of one joint, the largest first, the elasticity last."""
    chosen = result.chosen
    parts = [_part(result, name) for name in chosen.names() if name not in BODIES and not name.startswith("wave_")]
    # where one speed tells no forms apart, friction is one finding
    found = list({one.name: one for one in parts if one is not None}.values())
    found += [_changed_load(result)] if LOADED in chosen.names() else []
    found += [_ripple(result, wave, constants) for wave in _ripples(result) if _is_told(ANGLE, *_size(result, wave))]
    found.sort(key=lambda one: -(one.share or 0.0))
    return found + ([_elasticity(result)] if result.mode is not None else [])


def signatures(result: JointResult) -> list[str]:
    """What stands out and has no name."""
    return [text for text, _ in _left(result)]


def verdict(result: JointResult, found: Sequence[JointFinding]) -> Outcome:
    """Whether what a rigid joint leaves is named, and whether more than noise is left."""
    return Outcome.of(named=bool(found), is_more_left=any(is_more for _, is_more in _left(result)))


def _left(result: JointResult) -> Iterator[tuple[str, bool]]:
    """What stands out and has no name, in words, and whether it is more than the rest of what is left could make."""
    for wave in _ripples(result):
        if not _is_told(ANGLE, *_size(result, wave)):
            yield (
                f"a wave of {digits(wave.number, 4)} per revolution of the joint{_or_over_time(wave)} "
                f"({number(*_size(result, wave), 'Nm')}): what else is left could make all of it",
                False,
            )
    for wave in result.waves:
        if wave.over != ANGLE:
            what = f"a wave of {digits(wave.number, 4)} Hz over time, {digits(_amplitude(result, wave), 2)} N m, "
            how = "which no wave over the angle explains as well: a hum, or an error of what repeats with the motion"
            if wave.has_rival:
                other = digits(wave.rival.part.shape, 4)
                how = f"or of {other} per revolution: the speed does not tell a hum from a ripple"
            yield what + how, True
    for name in result.chosen.names():
        if name not in BODIES and not name.startswith("wave_") and _part(result, name) is None:
            size, error = result.chosen.value(name)
            yield _unnamed(result, name), abs(size) > error
    if result.unseen_mode:
        yield (
            "an inertia that depends on the frequency: an elasticity, a filter, or what happens at reversals, that was "
            "not resolved",
            True,
        )
    _, after, floor = result.gap
    if after > JOINT.noise * floor:
        beyond = digits(np.sqrt(after**2 - floor**2), 2)
        left = f"{beyond} N m RMS on left-out stretches beyond the noise that can be told"
        beside = ", of which what other joints do may make a part" if OTHERS in result.chosen.names() else ""
        yield left + beside, True


@dataclass(frozen=True)
class _Said:
    """What is said of a part: words ({0}: size, {1}: direction), its unit, and what explains it in any data."""

    words: str
    unit: str
    always: tuple[str, ...] = ()


_WARMING = ("warming or running in: no temperature is measured",)
_SAID = {
    "dry_friction": _Said("dry (Coulomb) friction of {0}", "Nm"),
    "viscous_friction": _Said("friction that rises with speed (viscous): {0}", "Nm_s"),
    "square_friction": _Said("friction that rises with the square of the speed: {0}", "Nm_s2"),
    "direction_dependent_friction": _Said(
        "friction that rises more with speed in the {1} direction, by twice {0}",
        "Nm_s",
        ("any torque that grows with speed and keeps its sign, such as that of a cable or fan",),
    ),
    "load_dependent_friction": _Said(
        "friction that grows with the load: {0} of the torque through the joint",
        "",
        ("friction that depends on the angle, where the load does",),
    ),
    "dry_friction_drift": _Said(
        "dry friction that changes over the recording, by {0} from its start to its end", "Nm", _WARMING
    ),
    "viscous_friction_drift": _Said(
        "viscous friction that changes over the recording, by {0} from its start to its end", "Nm_s", _WARMING
    ),
    "torque_zero_drift": _Said(
        "a zero of the torque that drifts, by {0} from the start to the end", "Nm", ("a load that changes",)
    ),
}
_INSTEAD = {
    "curved_friction": "friction curved over speed",
    "reversal_travel": "a friction that builds up over a travel after each reversal",
    "reversal_time": "something that fades with time after each reversal (a filter)",
    **{name: name.replace("_", " ") for name in _SAID},
}


#: units of parameters in words, where they differ from the name that report.json has
UNIT_WORDS = {"Nm": "N m", "Nm_s": "N m per rad/s", "Nm_s2": "N m per (rad/s)^2"}


def number(value: float, error: float | None, unit: str) -> str:
    """A value with its error and unit in words."""
    words = UNIT_WORDS.get(unit, unit)
    spread = "" if error is None else f" +- {digits(error, 1)}"
    return f"{digits(value, 3)}{spread}" + (f" {words}" if words else "")


def digits(value: float, count: int) -> str:
    """So many digits of a number, from a millionth to a million without a power of ten: 30, not 3e+01."""
    short = f"{value or 0.0:.{count}g}"
    is_usual = JOINT.plain[0] <= abs(float(short)) <= JOINT.plain[1]
    return np.format_float_positional(float(short), trim="-") if is_usual and "e" in short else short


def _share(result: JointResult, name: str) -> float:
    return float(result.chosen.own(name).var() / result.rows.torque.var())


def _is_told(name: str, value: float, error: float) -> bool:
    """Whether a part is larger than what else is left could make of it."""
    return abs(value) > (JOINT.bend if name == "square_friction" else 1.0) * error


def _is_below_nothing(result: JointResult, name: str) -> bool:
    """Whether friction that changes would surely be negative at one end of the recording, where it drives the joint."""
    level = name.removesuffix("_drift")
    # dry friction that a constant may hold is of any size
    if name == level or level not in _POWERS or "dry_friction" in result.chosen.not_told:
        return False
    value, error = result.chosen.value(name)
    rows = result.rows
    mean = float((rows.sign * result.chosen.of({*OVER_SPEED, "load_dependent_friction"})).mean())
    part = next(part for part in result.chosen.parts if part.name == name)
    power = np.abs(rows.speed) ** _POWERS[level]
    # what has been added at each time, or taken away, times the mean of this power of the speed
    changed = rows.sign * part.columns[:, 0] / power * float(power.mean())
    most = float(np.abs(changed[np.sign(changed) != np.sign(value)]).max(initial=0.0))
    return most * abs(value) - mean > most * error


def _part(result: JointResult, name: str) -> JointFinding | None:
    """One part of friction; None where it has a sign that friction does not have, no name, or may be of the rest."""
    chosen = result.chosen
    value, error = chosen.value(name)
    if name == "curved_friction":
        return _stribeck(result)
    if not _is_told(name, value, error):
        return None
    if name in ("reversal_travel", "reversal_time"):
        return _reversal(result, name)
    negative = value < 0 and name in (*_POWERS, "load_dependent_friction")
    if negative or _is_below_nothing(result, name):
        return None
    remark = ""
    slow, fast = map(float, np.quantile(np.abs(result.rows.speed), (0.1, 0.9)))
    if name in _POWERS and (fast < JOINT.speeds * slow or _driving(result)):
        together = _near_one_speed(result, fast) if fast < JOINT.speeds * slow else _not_apart(result, slow, fast)
        return None if _is_drive(result) else together
    if name == "dry_friction":
        slowest, fastest = np.quantile(np.abs(result.rows.speed), (0.02, 0.98))
        remark = f"read between {digits(slowest, 2)} and {digits(fastest, 2)} rad/s; at standstill it is not seen"
    elif name == "direction_dependent_friction":
        remark = "what else is said of friction is the mean of both directions"
    said = _SAID[name]
    alternatives = (*(_INSTEAD[one] for one in chosen.alternatives.get(name, ())), *said.always)
    size = abs(value) if name == "direction_dependent_friction" else value
    way = "positive" if value > 0 else "negative"
    text = said.words.format(number(size, error, said.unit), way)
    key = f"{name}_{said.unit}" if said.unit else name
    return JointFinding(name, text, {key: (value, error, said.unit)}, alternatives, remark, _share(result, name))


#: forms of friction over speed by their power of it
_POWERS = {"dry_friction": 0, "viscous_friction": 1, "square_friction": 2}


def _driving(result: JointResult) -> list[str]:
    """Forms over speed that surely drive the joint: together with others they make a curve that none of them has."""
    values = {name: result.chosen.value(name) for name in result.chosen.names() if name in OVER_SPEED}
    return [name for name, (value, error) in values.items() if value < 0 and _is_told(name, value, error)]


def _is_drive(result: JointResult) -> bool:
    """Whether all forms over speed together surely drive the joint at a slow or a fast speed: that is no friction."""
    ends = (_at(result, float(speed)) for speed in np.quantile(np.abs(result.rows.speed), (0.1, 0.9)))
    return any(value < -error for value, error in ends)


def _at(result: JointResult, speed: float) -> tuple[float, float]:
    """Friction at a speed (rad/s) by its forms over speed together, and its standard error, N m."""
    errors = [_curve(result, part, np.array([speed]))[0] * result.chosen.value(part.name)[1] for part in _forms(result)]
    # what one form takes from another leaves the sum as it is
    return float(friction_curve(result, np.array([speed]))[0]), float(np.sqrt(sum(error**2 for error in errors)))


def _not_apart(result: JointResult, slow: float, fast: float) -> JointFinding:
    """All of friction over speed together where a form of it has the wrong sign: no other one is what it is called."""
    text, parameters = [], dict[str, Value]()
    for key, speed in (("slow", slow), ("fast", fast)):
        value, error = _at(result, speed)
        text.append(f"{number(value, error, 'Nm')} at {digits(speed, 2)} rad/s")
        parameters |= {f"{key}_rad_s": (speed, None, "rad/s"), f"{key}_friction_Nm": (value, error, "Nm")}
    how = (
        f"how much of it is dry, and how it changes with the speed, is not told: {_INSTEAD[_driving(result)[0]]} "
        "beside it has the wrong sign, so that the curve is another one"
    )
    share = float(result.chosen.of(set(OVER_SPEED)).var() / result.rows.torque.var())
    return JointFinding("friction", f"friction of {' and '.join(text)}", parameters, (), how, share)


def _near_one_speed(result: JointResult, speed: float) -> JointFinding:
    """All of friction together where the speed hardly varied: its forms look alike there."""
    value, error = _at(result, speed)
    how = "the speed hardly varied: how much of it is dry and how much rises with speed is not told"
    share = float(result.chosen.of(set(OVER_SPEED)).var() / result.rows.torque.var())
    text = f"friction of {number(value, error, 'Nm')} near {digits(speed, 2)} rad/s"
    return JointFinding("friction", text, {"friction_Nm": (value, error, "Nm")}, (), how, share)


def friction_curve(result: JointResult, speed: FloatArray) -> FloatArray:
    """Friction (N m) at positive speeds, the mean of both directions: what the parts over speed make together."""
    parts = [result.chosen.value(part.name)[0] * _curve(result, part, speed) for part in _forms(result)]
    return np.asarray(np.sum([np.zeros(len(speed)), *parts], axis=0), np.float64)


def _forms(result: JointResult) -> list[TorquePart]:
    """The forms of friction over speed that were taken."""
    return [part for part in result.chosen.parts if part.name in OVER_SPEED]


def _curve(result: JointResult, part: TorquePart, speed: FloatArray) -> FloatArray:
    """What a form of friction is at positive speeds where its coefficient is 1."""
    there = replace(result.rows.where(np.zeros(len(speed), np.int64)), speed=speed)
    return KINDS[part.name].laws[part.law].column(there, part.shape, np.zeros((len(speed), 2)))


def _stribeck(result: JointResult) -> JointFinding | None:
    """Friction that falls with speed; None where the curve is bent another way."""
    slowest, fastest = np.quantile(np.abs(result.rows.speed), (0.01, 0.98))
    speed = np.linspace(slowest, fastest, 400)
    curve = friction_curve(result, speed)
    least = int(curve.argmin())
    value, error = result.chosen.value("curved_friction", law=False)
    if value <= 0 or least < 8 or curve[0] - curve[least] < JOINT.better * error or curve[least] < 0:
        return None
    text = (
        f"friction that falls with speed (Stribeck): {digits(curve[0], 3)} N m at {digits(slowest, 2)} rad/s, least at "
        f"about {digits(speed[least], 2)} rad/s with {digits(curve[least], 3)} N m"
    )
    alternatives = tuple(_INSTEAD[one] for one in result.chosen.alternatives.get("curved_friction", ()))
    parameters: dict[str, Value] = {
        "fall_Nm": (float(curve[0] - curve[least]), error, "Nm"),
        "least_at_rad_s": (float(speed[least]), None, "rad/s"),
    }
    remark = "which law it follows is not known: the split into dry and viscous friction depends on it"
    return JointFinding("stribeck", text, parameters, alternatives, remark, _share(result, "curved_friction"))


def _changed_load(result: JointResult) -> JointFinding:
    own = result.chosen.place(LOADED)
    assert own is not None
    values, errors = result.chosen.fit.values[own], result.chosen.fit.errors[own]
    if result.chosen.by_law is not None:
        errors = np.hypot(errors, result.chosen.by_law[own])
    begin = next(part.shape for part in result.chosen.parts if part.name == LOADED)
    weight, way = float(np.hypot(*values[1:3])), "less" if values[0] < 0 else "more"
    change, unsure = abs(float(values[0])), float(errors[0])
    error = float(np.hypot(*(values[1:3] * errors[1:3]))) / max(weight, 1e-300)
    inertia = f"{number(change, unsure, 'kg m^2')} {way} inertia"
    if change < unsure:
        inertia = f"an inertia that nothing tells from the one before ({number(float(values[0]), unsure, 'kg m^2')})"
    text = (
        f"another load from about {digits(begin, 3)} s on: {inertia}, "
        f"and gravity that differs by up to {number(weight, error, 'Nm')}"
    )
    parameters: dict[str, Value] = {
        "begin_s": (begin, None, "s"),
        "inertia_kg_m2": (float(values[0]), float(errors[0]), "kg m^2"),
        "gravity_Nm": (weight, error, "Nm"),
    }
    remark = (
        "the time counts through all files in which the joint moves; one change is looked for; all else is said of "
        "both loads together"
    )
    alternatives = (
        "several changes, of which this is the largest",
        "a load that rises or falls slowly",
        "another torque that follows the angle from then on",
    )
    return JointFinding(LOADED, text, parameters, alternatives, remark, _share(result, LOADED))


def _reversal(result: JointResult, name: str) -> JointFinding | None:
    value, error = result.chosen.value(name)
    shape = next(part.shape for part in result.chosen.parts if part.name == name)
    too_fast = shape <= JOINT.shortest * float(KINDS[name].laws[0].shapes(result.rows)[0])
    # what shakes a joint at its mode turns it both ways while it is slow, where dry friction is less in the mean
    if value >= 0 or too_fast or result.mode is not None:
        return None
    over, unit, key = ("travel", "rad", "travel_rad") if name == "reversal_travel" else ("time", "s", "time_s")
    text = (
        f"after a reversal the torque is short of {number(-value, error, 'Nm')}, which comes back over a {over} of "
        f"about {digits(shape, 2)} {unit}"
    )
    causes = (
        ["play", "bristles or a spring before the sliding part"]
        if over == "travel"
        else ["a filter or delay of a signal"]
    )
    alternatives = (*causes, *(_INSTEAD[one] for one in result.chosen.alternatives.get(name, ())))
    parameters: dict[str, Value] = {"short_Nm": (-value, error, "Nm"), key: (shape, None, unit)}
    return JointFinding("reversal_hysteresis", text, parameters, alternatives, "", _share(result, name))


def _unnamed(result: JointResult, name: str) -> str:
    size, error = result.chosen.value(name)
    value = number(size, error, _SAID[name].unit if name in _SAID else "Nm")
    if name == "square_friction" and error < abs(size) and not _is_told(name, size, error):
        instead = (_INSTEAD[one] for one in result.chosen.alternatives.get(name, ()))
        return (
            f"friction over speed is bent ({value} if by its square): {' or '.join(('what else is left', *instead))} "
            "could make most of it, and every other curve over speed has such a bend"
        )
    if not _is_told(name, size, error):
        return f"a part with the form of {_INSTEAD[name]} ({value}): what else is left could make all of it"
    if name in ("dry_friction", "viscous_friction", "load_dependent_friction") or (name in _POWERS and size > 0):
        wrong = f" and the wrong sign ({value})"
        if size > 0:
            wrong = f" ({value}), with which all that goes by the speed drives the joint at some speeds"
        return f"a part with the form of {name.replace('_', ' ')}{wrong}: no friction drives a joint"
    if _is_below_nothing(result, name):
        forms = ", or of ".join(_INSTEAD[one] for one in (name, *result.chosen.alternatives.get(name, ())))
        return (
            f"a part with the form of {forms} ({value} from start to end): the friction would be negative at one end, "
            "and no friction drives a joint"
        )
    if name in ("curved_friction", "square_friction"):
        return f"friction over speed is bent ({value}), not as by Stribeck's effect"
    over = "travel" if name == "reversal_travel" else "time"
    why = "of no known cause or too fast to be measured"
    if result.mode is not None:
        why = "as what shakes the joint at its mode, while it is slow, makes one"
    return f"a torque that fades over {over} after each reversal, {why} ({value})"


def _size(result: JointResult, wave: TorqueWave) -> tuple[float, float]:
    return result.chosen.amplitude(wave.gain.part.name)


def _amplitude(result: JointResult, wave: TorqueWave) -> float:
    return _size(result, wave)[0]


def _ripples(result: JointResult) -> list[TorqueWave]:
    """Waves over the angle, without those beside a louder one."""
    kept: list[TorqueWave] = []
    for wave in sorted(result.waves, key=lambda wave: -_amplitude(result, wave)):
        if wave.over == ANGLE and not any(_is_beside(wave, loud) for loud in kept):
            kept.append(wave)
    return kept


def _or_over_time(wave: TorqueWave) -> str:
    return f", or of {digits(wave.rival.part.shape, 4)} Hz over time," if wave.has_rival else ""


def _is_beside(wave: TorqueWave, loud: TorqueWave) -> bool:
    near = max(JOINT.beside * loud.number, 3 * loud.resolution)
    return wave is not loud and abs(wave.number - loud.number) < near


def _ripple(result: JointResult, wave: TorqueWave, constants: Constants | None) -> JointFinding:
    half = wave.resolution / 2
    size, error = _size(result, wave)
    text = (
        f"torque ripple: a wave of {digits(wave.number, 4)} +- {digits(half, 2)} per revolution of the joint, "
        f"amplitude {number(size, error, 'Nm')} in the mean"
    )
    named = _kinematics(wave, constants)
    remark = f"of the machine's parts {', '.join(named)} would make it, by its order alone" if named else ""
    beside = [digits(one.number, 3) for one in result.waves if one.over == ANGLE and _is_beside(one, wave)]
    if beside:
        how = f"weaker waves beside it ({', '.join(beside)}): its size or phase changes, or there are more waves"
        remark = f"{remark}; {how}" if remark else how
    alternatives = []
    if wave.has_rival:
        alternatives.append(f"a wave of {digits(wave.rival.part.shape, 4)} Hz over time")
    if wave.number < 6:
        alternatives.append("a bend of gravity or of another torque over the angle")
    errors: dict[str, Value] = {
        "order_per_revolution": (wave.number, half, ""),
        "amplitude_Nm": (size, error, "Nm"),
    }
    share = _share(result, wave.gain.part.name)
    return JointFinding("torque_ripple", text, errors, tuple(alternatives), remark, share)


def _kinematics(wave: TorqueWave, constants: Constants | None) -> list[str]:
    """Parts of the machine whose order lies within what the data tell; none without a rig."""
    if constants is None:
        return []
    known: dict[str, list[float]] = {
        "the input shaft": [constants.reduction_ratio * m for m in (1, 2, 3, 4)],
        "the cycloid's teeth": list(constants.tooth_orders()[:4]),
        "the pins": list(constants.pin_orders()[:4]),
        "the cranks": [constants.cranks],
    }
    reach = wave.resolution / 2
    return [
        f"{name} ({order:g})" for name, orders in known.items() for order in orders if abs(order - wave.number) < reach
    ]


def _elasticity(result: JointResult) -> JointFinding:
    mode = result.mode
    assert mode is not None
    lower = f", and an antiresonance at {digits(mode.antiresonance_Hz, 3)} Hz below it" if mode.antiresonance_Hz else ""
    text = (
        f"elasticity: torque per acceleration has a resonance at {digits(mode.resonance_Hz, 3)} +- "
        f"{digits(mode.resonance_error, 1)} Hz with a damping ratio of {digits(mode.damping, 2)} +- "
        f"{digits(mode.damping_error, 1)}{lower}"
    )
    parameters: dict[str, Value] = {
        "resonance_Hz": (mode.resonance_Hz, mode.resonance_error, "Hz"),
        "damping_ratio": (mode.damping, mode.damping_error, ""),
    }
    if mode.antiresonance_Hz:
        parameters["antiresonance_Hz"] = (mode.antiresonance_Hz, None, "Hz")
    alternatives = ("a filter of the drive, where disturbances and not the drive moved the joint",)
    remark = "one encoder does not tell where it is: gear, link, or what the joint stands on"
    return JointFinding("elasticity", text, parameters, alternatives, remark)


def measurement(result: JointResult) -> list[str]:
    """Sentences on how the joint was measured: what its reader noted, and a delay between torque and motion."""
    found = list(result.notes)
    if result.late_s:
        way = "later" if result.late_s > 0 else "earlier"
        least, most = sorted(abs(one) * 1e3 for one in result.as_late_s)
        span = f" ({digits(least, 3)} to {digits(most, 3)} ms do as well)" if most > least else ""
        _, after, floor = result.gap
        rest = ", or what stays unexplained" if after > JOINT.noise * floor else ""
        found.append(
            f"tau{result.joint} is as if {digits(abs(result.late_s) * 1e3, 3)} ms {way} than the motion{span}, and is "
            f"shifted by as much: a delay, a filter, or an elasticity between encoder and drive{rest}"
        )
    if (told := explained(result)) < JOINT.unrelated:
        found.append(
            f"motion and friction predict {max(told, 0.0):.0%} of the changes of tau{result.joint} over left-out "
            "stretches: is it the torque of this joint?"
        )
    if result.outliers:
        found.append(
            f"left out: {result.outliers} of {result.outliers + len(result.rows.time)} values of the smoothed torque, "
            "far off all others: spikes, or what happens at a reversal"
        )
    if OTHERS in result.chosen.names():
        found.append(
            "a part of the torque follows the motion of other joints; it is taken off by what links in a chain can add"
        )
    return found


def explained(result: JointResult) -> float:
    """Share of the torque's changes over left-out stretches that all parts together predict."""
    rows = result.rows
    level = crossed(np.ones((len(rows.time), 1)), rows).held.sum()
    return 1.0 - float(result.chosen.fit.held.sum()) / float(level)


def cannot_show(result: JointResult) -> list[str]:
    """What these data do not show, with the reason."""
    rows, names = result.rows, result.chosen.names()
    found = []
    if not rows.reversals:
        found.append(
            "dry friction, its load, and what happens at reversals: the joint never reverses, so that a constant is "
            "told from nothing"
        )
    hidden = [_INSTEAD[name] for name in result.chosen.not_told if name not in names]
    if hidden and rows.reversals:
        found.append(f"{', '.join(hidden)}: the motion does not tell {'them' if hidden[1:] else 'it'} from other parts")
    found.append("friction that differs by direction at all speeds alike: a zero of the torque looks the same")
    what = "an elasticity" if result.mode is None else "a second elasticity (one is looked for)"
    if not result.told_Hz:
        found.append(f"{what}: no band of frequencies in which the motion explains the torque")
    elif result.mode is None and not result.is_rigid:
        found.append(
            f"an elasticity: the torque up to {digits(result.told_Hz[-1][1], 3)} Hz is not that of one inertia, and no "
            "mode was resolved in it; what happens at reversals can do that as well"
        )
    else:
        bands = " and ".join(f"{digits(low, 3)} to {digits(high, 3)} Hz" for low, high in result.told_Hz)
        what += ", and any" if result.mode is not None else ""
        found.append(f"{what} outside of {bands}: the motion explains the torque there alone")
    if not result.waves:
        fewest = JOINT.least_waves * 2 * np.pi / float(np.ptp(rows.angle))
        found.append(f"waves of fewer than {digits(fewest, 2)} per revolution")
    found.append(f"what changes faster than about {digits(0.2 / rows.kernel_s, 2)} Hz, other than an elasticity")
    found.append(f"standstill, and speeds below {at_least(float(np.abs(rows.speed).min()))} rad/s")
    if not result.unit_is_told:
        q = f"q{result.joint}"
        found.append(f"the unit of {q}: its name has none, these data do not tell it, and it is taken to be in rad")
    found.append("a torque constant that is off: all sizes in N m are off by the same factor")
    return found


def joint_report(results: Sequence[JointResult], constants: Constants | None) -> dict[str, Any]:
    """The content of report.json."""
    joints: list[dict[str, Any]] = []
    for result in results:
        found = findings(result, constants)
        gap = dict(zip(("before", "after", "noise_floor"), result.gap, strict=True))
        joints.append(
            {
                "joint": result.joint or "1",
                "verdict": verdict(result, found),
                "effects": [
                    {
                        "name": one.name,
                        "text": one.text,
                        "parameters": {
                            key: {"value": value, "stderr": error, "unit": unit}
                            for key, (value, error, unit) in one.parameters.items()
                        },
                        "share_of_torque": one.share,
                        "alternatives": list(one.alternatives),
                        "remarks": [one.remark] if one.remark else [],
                    }
                    for one in found
                ],
                "unexplained": signatures(result),
                "gap": {"held_out": gap, "unit": "Nm"},
                "measurement": measurement(result),
                "cannot_show": cannot_show(result),
            }
        )
    worst = (Outcome.UNEXPLAINED, Outcome.PARTLY_EXPLAINED, Outcome.EXPLAINED, Outcome.NOTHING_MISSING)
    return {"kind": "joints", "verdict": min((one["verdict"] for one in joints), key=worst.index), "joints": joints}
