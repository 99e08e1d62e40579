"""Recordings of a robot's joints: CSV with the columns `t,q,dq,tau`, or `t,q1,dq1,tau1,q2,..` for several joints."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.csv_tables import CsvTable, header_of, read_csv
from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.joint.settings import JOINT
from st_codegen.reconcile.settings import SETTINGS

#: units that a name may end in, as factors to rad, rad/s and N m; without one the column is in these
UNITS = {
    "q": {"": 1.0, "rad": 1.0, "deg": np.pi / 180},
    "dq": {"": 1.0, "rad_s": 1.0, "deg_s": np.pi / 180, "rpm": np.pi / 30},
    "tau": {"": 1.0, "Nm": 1.0, "Ncm": 1e-2, "mNm": 1e-3},
}
_NAME = re.compile(r"(q|dq|tau)(\d*)(?:_(\w+))?")
#: names of the time, as factors to s
_TIME = {"t": 1.0, "t_s": 1.0, "t_ms": 1e-3, "t_us": 1e-6}
_UNITS_OF_TIME = {"seconds": 1.0, "milliseconds": 1e-3, "microseconds": 1e-6}


@dataclass(frozen=True)
class JointRecording:
    """One file: a step in s, and angle (rad), speed as given (rad/s; None) and torque (N m) of each joint, (n,).

    without_unit: joints whose angle has no unit in its name, and is taken to be in rad.
    """

    name: str
    step_s: float
    angle: Mapping[str, FloatArray]
    speed: Mapping[str, FloatArray | None]
    torque: Mapping[str, FloatArray]
    notes: tuple[str, ...] = ()
    without_unit: frozenset[str] = frozenset()


def joint_files(path: Path) -> list[Path]:
    """The recordings of joints that a path names: the file itself, or those of a folder; none for anything else."""
    files = sorted(path.glob("*.csv")) if path.is_dir() else [path]
    return [file for file in files if file.is_file() and _is_joint(header_of(file))]


def _is_joint(names: Sequence[str]) -> bool:
    kinds = {match[1] for name in names if (match := _NAME.fullmatch(name))}
    return bool(set(_TIME) & set(names)) and {"q", "tau"} <= kinds


def read_joints(paths: Sequence[Path]) -> tuple[JointRecording, ...]:
    """Read recordings of the same joints. Raises one InputError that lists what is wrong with all of them."""
    problems, found = Problems("recordings of joints"), []
    for path in paths:
        with problems.collect():
            found.append(_read(path))
    if len({tuple(sorted(one.angle)) for one in found}) > 1:
        problems.add("the files have different joints; give those of the same joints together")
    problems.raise_if_any()
    return tuple(found)


def _columns(table: CsvTable, problems: Problems) -> dict[tuple[str, str], tuple[str, float]]:
    """The column of each quantity and joint, and its factor to rad, rad/s or N m."""
    columns: dict[tuple[str, str], tuple[str, float]] = {}
    for name in table.names:
        match = _NAME.fullmatch(name)
        if match is None:
            continue
        kind, joint, unit = match[1], match[2], match[3] or ""
        if unit not in UNITS[kind]:
            known = ", ".join(f"{kind}{joint}_{one}" for one in UNITS[kind] if one)
            problems.add(f"the unit of the column '{name}' is not known; there are {known}")
        elif (kind, joint) in columns:
            problems.add(f"the columns {columns[kind, joint][0]} and {name} are the same quantity")
        else:
            columns[kind, joint] = name, UNITS[kind][unit]
    joints = _joints(columns)
    if "" in joints and joints[1:]:
        problems.add(f"a joint without a number stands beside q{joints[1]}: number all of them (q1, dq1, tau1, q2, ..)")
    for joint in joints:
        for kind in ("q", "tau"):
            if (kind, joint) not in columns:
                problems.add(f"the column '{kind}{joint}' is missing: a joint needs q and tau")
    return columns


def _joints(columns: Iterable[tuple[str, str]]) -> list[str]:
    return sorted({joint for _, joint in columns}, key=lambda joint: int(joint or 0))


def _read(path: Path) -> JointRecording:
    table, problems = read_csv(path), Problems(str(path))
    columns = _columns(table, problems)
    joints = _joints(columns)
    time, *more = (name for name in _TIME if name in table.names)
    if more:
        problems.add(f"the columns {', '.join([time, *more])} are all the time; keep one of them")
    names = [time, *(name for name, _ in columns.values())]
    values = dict(zip(names, table.numbers(names, problems, is_finite=False).T, strict=True))
    _check_values(table, values, problems)
    if len(table.rows) < JOINT.samples:
        problems.add(f"{counted(len(table.rows), 'sample')} only, at least {JOINT.samples} are needed")
    problems.raise_if_any()
    step, notes = _step(values[time] * _TIME[time], path)
    if time == "t" and step > JOINT.step:
        raise InputError(
            f"{path}: a sample is taken every {step:g} s if t is in s: is it in milliseconds? Name the column t_ms, "
            "t_us or t_s"
        )
    si = {key: values[name] * factor for key, (name, factor) in columns.items()}
    angle = {joint: si["q", joint] for joint in joints}
    speed = {joint: si.get(("dq", joint)) for joint in joints}
    for joint in joints:
        with problems.collect():
            notes += _check(joint, columns["q", joint][0], angle[joint], speed[joint], step, time)
    problems.raise_if_any()
    tells = [not is_standing(angle[joint]) and (dq := speed[joint]) is not None and np.ptp(dq) for joint in joints]
    if time == "t" and not any(tells):
        notes.append(f"t is taken to be in s: a sample every {step:g} s")
    torque = {joint: si["tau", joint] for joint in joints}
    without = frozenset(joint for joint in joints if columns["q", joint][0] == f"q{joint}")
    notes = [f"{path.name}: {note}" for note in notes]
    return JointRecording(path.name, step, angle, speed, torque, tuple(notes), without)


def _check_values(table: CsvTable, values: Mapping[str, FloatArray], problems: Problems) -> None:
    """Note what is no number of a joint."""
    if bad := [name for name in values if not np.isfinite(values[name]).all()]:
        rows = np.flatnonzero(~np.isfinite([values[name] for name in bad]).all(axis=0))
        lines = [table.rows[row].line for row in rows]
        which = f"line {lines[0]}" + (f" and {len(lines) - 1} more" if len(lines) > 1 else "")
        problems.add(f"{which}: values of {', '.join(bad)} are not finite; cut these rows off, or record them again")
    # a clock may count from any date
    for name in (name for name in values if name not in _TIME):
        for row in np.flatnonzero(np.isfinite(values[name]) & (np.abs(values[name]) > JOINT.largest))[:1]:
            line, value = table.rows[row].line, values[name][row]
            problems.add(f"line {line}: {name} of {value:.3g} is no value of a joint; was it read wrong?")


def _step(time: FloatArray, path: Path) -> tuple[float, list[str]]:
    """The step of even samples. Raises InputError for time that repeats, falls, or has gaps."""
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0))
        raise InputError(f"{path}: the time does not rise from row {row + 2} to the next ({time[row]:g} s)")
    step = float((time[-1] - time[0]) / len(steps))
    off = np.abs(time - time[0] - step * np.arange(len(time))) / step
    if off.max() > JOINT.jitter or steps.max() > JOINT.gap * float(np.median(steps)):
        row = int(np.argmax(steps))
        raise InputError(
            f"{path}: the samples are not evenly spaced; the widest step, {steps[row]:g} s, is from row {row + 2} to "
            f"the next, the usual one {np.median(steps):g} s. Put a file on each side of a gap; where the clock "
            "jitters, bring the columns to even times first"
        )
    uneven = [f"the time is off even steps by up to {off.max():.2g} of one; even steps are taken"]
    return step, uneven if off.max() > JOINT.jitter / 5 else []


def _check_jumps(name: str, angle: FloatArray) -> None:
    """Raise InputError where the angle jumps between two samples as no motion does: samples are missing there."""
    steps = np.diff(angle)
    off = np.abs(steps[1:-1] - (steps[2:] + steps[:-2]) / 2)
    row = int(off.argmax())
    # a turn that is lost and found are two jumps, and more samples may be off; an angle that rests where its turns are
    # counted anew jumps at any of them
    others = np.sort(np.abs(steps)[np.abs(steps) < np.pi])[: -max(3, len(steps) // 100)]
    # a step that is several times the fastest motion elsewhere, and that nothing before it announces
    if len(others) and off[row] > SETTINGS.jump * float(others[-1]) > 0:
        raise InputError(
            f"{name} jumps by {steps[row + 1]:.3g} from row {row + 3} to the next, elsewhere by {others[-1]:.2g} at "
            "most: are samples missing there, or is a turn lost? Put a file on each side"
        )
    _check_missing(name, angle)


def _check_missing(name: str, angle: FloatArray) -> None:
    """Raise InputError where the angle moves on by several steps at once, though the time goes on evenly.

    Between two steps on each side that are alike no motion makes one that is a whole number of times as long; an
    encoder does where they are one step of its own.
    """
    steps = np.diff(angle)
    least = float(np.abs(steps[steps != 0]).min())
    beside = np.stack([steps[:-4], steps[1:-3], steps[3:-1], steps[4:]])
    usual = beside.mean(axis=0)
    alike = np.abs(beside - usual).max(axis=0) < JOINT.alike_steps * np.abs(usual)
    alike &= (np.abs(usual) > JOINT.sure_step * noise_of(angle)) & (np.round(np.abs(usual) / least) > 1)
    times = np.where(alike, steps[2:-2] / np.where(alike, usual, 1.0), 1.0)
    count = np.round(times)
    missing = np.flatnonzero((count > 1) & (np.abs(times - count) < JOINT.alike_steps))
    if len(missing):
        first, lost = int(missing[0]), int(count[missing].sum()) - len(missing)
        raise InputError(
            f"{name} moves on by {count[first]:.0f} steps at once from row {first + 4} to the next: "
            f"as if {counted(lost, 'sample')} were missing in {counted(len(missing), 'place')}, though the time goes "
            "on evenly. Put a file on each side of such a place"
        )


def noise_of(values: FloatArray) -> float:
    """Standard deviation of what changes from sample to sample without a pattern, or more: by fourth differences."""
    size = np.sort(np.abs(np.diff(values, 4)))
    # what jumps (a reversal) is none of it; rounding steps are
    return float(np.sqrt((size[: int(0.99 * len(size)) + 1] ** 2).mean() / 70.0))


def is_standing(angle: FloatArray) -> bool:
    """Whether a joint travels no further than what gives in it, or than one step of its encoder: its dq is noise."""
    return float(np.ptp(angle)) < JOINT.travel or len(np.unique(angle)) < 3


def _check(joint: str, name: str, angle: FloatArray, speed: FloatArray | None, step: float, time: str) -> list[str]:
    """What a given speed says of units and time, whose column has a name. Raises InputError where it is another one.

    Of a joint that stands it is noise, but for what agrees with the angle by another unit.
    """
    turns = float(np.ptp(angle)) / (2 * np.pi)
    if name == f"q{joint}" and turns > JOINT.turns:
        raise InputError(
            f"{name} covers {turns:.0f} turns if it is in rad: is it in degrees? Name the column q{joint}_deg or "
            f"q{joint}_rad"
        )
    standing = is_standing(angle)
    if not standing:
        _check_jumps(name, angle)
    if speed is None:
        taken = f", which is taken to be in {'rad' if name == f'q{joint}' else name.rpartition('_')[2]}"
        return [f"dq{joint} is not there: speeds are derived from {name}{taken}"]
    if not np.ptp(speed) and np.ptp(angle):
        return [f"dq{joint} never changes and is not looked at: speeds are derived from {name}"]
    # both in the mean over a few samples, so that the noise of the angle does not decide
    width = max(5, len(angle) // 400)
    derived = (angle[width:] - angle[:-width]) / (width * step)
    sums = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
    given = (sums[width:] - sums[:-width]) / width
    power = float(derived @ derived)
    if power <= 0 or not given.any():
        return []
    factor = float(given @ derived) / power
    alike = abs(factor) * np.sqrt(power / float(given @ given))
    known = {180 / np.pi: "dq in deg/s, or q in rad while named deg", np.pi / 180: "q in degrees, dq in rad/s",
             30 / np.pi: "dq in rpm", -1.0: "dq with the opposite sign",
             **{_TIME[time] / unit: f"{time} in {word}" for word, unit in _UNITS_OF_TIME.items()}}  # fmt: skip
    why = [text for value, text in known.items() if abs(factor / value - 1) < SETTINGS.one_rate]
    if standing and (alike < JOINT.alike or not why):
        return []
    if alike < JOINT.alike:
        raise InputError(
            f"dq{joint} is not the speed of {name}: they agree to {alike:.2f} only (correlation), 1 is expected"
        )
    if abs(factor - 1) > SETTINGS.one_rate:
        raise InputError(
            f"dq{joint} is {factor:.4g} times the rate of {name}: {why[0] if why else 'of another side of a gear'}? "
            f"Units may stand in the names: q{joint}_deg, dq{joint}_deg_s, dq{joint}_rpm, t_ms; without dq{joint} the "
            "rate of the angle is taken"
        )
    said = f"dq{joint} is {factor:.3f} times the rate of {name}; the rate is taken"
    return [said] if abs(factor - 1) > JOINT.other_rate else []
