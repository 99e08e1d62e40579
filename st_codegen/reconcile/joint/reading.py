"""Recordings of a robot's joints: CSV with the columns `t,q,dq,tau`, or `t,q1,dq1,tau1,q2,..` for several joints."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.csv_tables import CsvTable, csv_files, header_of, read_csv
from st_codegen.ir.arrays import FloatArray, IntArray
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
    """Even samples of one file, all of them or a piece between lost ones.

    A step in s, and angle (rad), speed as given (rad/s; None) and torque (N m) of each joint, (n,). at_s: time of the
    first sample after the first one of the file; where nearly all of that is pauses, without them.
    without_unit: joints whose angle has no unit in its name, and is taken to be in rad.
    """

    name: str
    step_s: float
    angle: Mapping[str, FloatArray]
    speed: Mapping[str, FloatArray | None]
    torque: Mapping[str, FloatArray]
    notes: tuple[str, ...] = ()
    at_s: float = 0.0
    without_unit: frozenset[str] = frozenset()


def joint_files(path: Path) -> list[Path]:
    """The recordings of joints that a path names: the file itself, or those of a folder; none for anything else."""
    files = csv_files(path) if path.is_dir() else [path]
    return [file for file in files if file.is_file() and _is_joint(header_of(file))]


def _is_joint(names: Sequence[str]) -> bool:
    kinds = {match[1] for name in names if (match := _NAME.fullmatch(name))}
    return bool(set(_TIME) & set(names)) and {"q", "tau"} <= kinds


def read_joints(paths: Sequence[Path]) -> tuple[JointRecording, ...]:
    """Read recordings of the same joints, a file that lost samples as the pieces between them.

    Raises one InputError that lists what is wrong with all of them.
    """
    problems, found = Problems("recordings of joints"), list[JointRecording]()
    for path in paths:
        with problems.collect():
            found += _read(path)
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
            columns.setdefault((kind, joint), (name, 1.0))
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


def _read(path: Path) -> list[JointRecording]:
    table, problems = read_csv(path), Problems(str(path))
    columns = _columns(table, problems)
    joints = _joints(columns)
    time, *more = (name for name in _TIME if name in table.names)
    if more:
        problems.add(f"the columns {', '.join([time, *more])} are all the time; keep one of them")
    names = [time, *(name for name, _ in columns.values())]
    values = dict(zip(names, table.numbers(names, problems, is_finite=False).T, strict=True))
    lines = np.array([row.line for row in table.rows], np.int64)
    _check_values(values, lines, problems)
    if len(lines) < JOINT.samples:
        problems.add(f"{counted(len(lines), 'sample')} only, at least {JOINT.samples} are needed")
    problems.raise_if_any()
    finite = np.isfinite(list(values.values())).all(axis=0)
    notes = _not_finite(values, lines) if not finite.all() else []
    if (left := int(finite.sum())) < JOINT.samples:
        raise InputError(f"{path}: {notes[0]}: {left} are left, at least {JOINT.samples} are needed")
    lines, values = lines[finite], {name: column[finite] for name, column in values.items()}
    si = {key: values[name] * factor for key, (name, factor) in columns.items()}
    moving = {columns["q", joint][0]: si["q", joint] for joint in joints if not is_standing(si["q", joint])}
    step, pieces = _pieces(values[time] * _TIME[time], moving, lines, path, notes)
    if time == "t" and step > JOINT.step:
        unit = "milli" if step * _TIME["t_ms"] <= JOINT.step else "micro"
        raise InputError(
            f"{path}: a sample is taken every {step:g} s if t is in s: is it in {unit}seconds? Name the column t_ms, "
            "t_us or t_s"
        )
    for joint in joints:
        speed = si.get(("dq", joint))
        parts = [(si["q", joint][own], None if speed is None else speed[own]) for own, _ in pieces]
        with problems.collect():
            notes += _check(joint, columns["q", joint][0], parts, step, time)
    problems.raise_if_any()
    tells = [columns["q", joint][0] in moving and np.ptp(si.get(("dq", joint), np.zeros(1))) for joint in joints]
    if time == "t" and not any(tells):
        notes.append(f"t is taken to be in s: a sample every {step:g} s")

    def of(kind: str, own: slice) -> dict[str, FloatArray]:
        return {joint: si[kind, joint][own] for joint in joints if (kind, joint) in si}

    said = tuple(f"{path.name}: {note}" for note in notes)
    without = frozenset(joint for joint in joints if columns["q", joint][0] == f"q{joint}")
    unknown = dict.fromkeys(joints)
    return [
        JointRecording(path.name, step, of("q", own), {**unknown, **of("dq", own)}, of("tau", own), said, at, without)
        for own, at in pieces
    ]


def _check_values(values: Mapping[str, FloatArray], lines: IntArray, problems: Problems) -> None:
    """Note what is no value of a joint."""
    # a clock may count from any date
    for name in (name for name in values if name not in _TIME):
        for row in np.flatnonzero(np.isfinite(values[name]) & (np.abs(values[name]) > JOINT.largest))[:1]:
            value = values[name][row]
            problems.add(f"line {lines[row]}: {name} of {value:.3g} is no value of a joint; was it read wrong?")


def _not_finite(values: Mapping[str, FloatArray], lines: IntArray) -> list[str]:
    """What is said of rows in which a value is no finite number."""
    bad = {name: ~np.isfinite(column) for name, column in values.items() if not np.isfinite(column).all()}
    first, *more = lines[np.logical_or.reduce(list(bad.values()))]
    others = f" and {len(more)} more" if more else ""
    return [f"line {first}{others}: values of {', '.join(bad)} are not finite; these samples count as lost"]


def _pieces(
    clock: FloatArray, moving: Mapping[str, FloatArray], lines: IntArray, path: Path, notes: list[str]
) -> tuple[float, list[tuple[slice, float]]]:
    """The step of even samples, and the pieces between lost ones, each with its time after the first; s.

    moving: angles of joints that move. Raises InputError for time that repeats or falls, jitters, or has so many gaps
    that most of the samples lie in pieces too short to be used.
    """
    steps = np.diff(clock)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0))
        raise InputError(f"{path}: the time does not rise from line {lines[row]} to the next ({clock[row]:g} s)")
    usual = float(np.median(steps))
    gaps = np.flatnonzero(steps > JOINT.gap * usual) + 1
    unseen = np.zeros(len(clock), np.int64)
    between, problems = _between(gaps, len(clock)), Problems(str(path))
    for name, angle in moving.items():
        with problems.collect():
            _check_jumps(name, angle, between, lines)
        unseen = np.maximum(unseen, _unseen(name, angle, between, lines, notes))
    problems.raise_if_any()
    found = _between(np.union1d(gaps, np.flatnonzero(unseen)), len(clock))
    pieces = [own for own in found if own.stop - own.start >= JOINT.piece]
    kept = sum(own.stop - own.start for own in pieces)
    if kept < max(JOINT.samples, JOINT.kept_samples * len(clock)):
        raise InputError(
            f"{path}: the samples are not evenly spaced: the usual step is {usual:g} s, and between "
            f"{counted(len(found) - 1, 'wider one')} only {kept} of {len(clock)} lie in pieces of {JOINT.piece} "
            "or more. Where the clock jitters, bring the columns to even times first"
        )
    # by all samples: the first and the last one of a piece are off as well
    counts = [np.arange(own.stop - own.start) - (own.stop - own.start - 1) / 2 for own in pieces]
    moved = sum(float(count @ (clock[own] - clock[own].mean())) for count, own in zip(counts, pieces, strict=True))
    step = moved / sum(float(count @ count) for count in counts)
    late = [clock[own] - step * np.arange(own.stop - own.start) for own in pieces]
    off = [np.abs(one - np.median(one)) / step for one in late]
    most = max(float(one.max()) for one in off)
    if most > JOINT.jitter:
        own = pieces[int(np.argmax([one.max() for one in off]))]
        raise InputError(
            f"{path}: the samples of lines {lines[own.start]} to {lines[own.stop - 1]} are not evenly spaced: the "
            f"time is off even steps by up to {most:.2g} of one. Where the clock jitters, bring the columns to even "
            "times first"
        )
    why = "samples are missing, or none were taken"
    if most > JOINT.jitter / 5:
        notes.append(f"the time is off even steps by up to {most:.2g} of one; even steps are taken")
        why = "samples are missing, none were taken, or the clock jitters by more"
    if len(found) > 1:
        short = f"; without {counted(len(clock) - kept, 'sample')} of shorter ones" if kept < len(clock) else ""
        notes.append(
            f"{why}, in {counted(len(found) - 1, 'place')}, first after line {lines[found[1].start - 1]}: "
            f"it is read in {counted(len(pieces), 'piece')} of {JOINT.piece} samples or more{short}"
        )
    at = clock + step * np.cumsum(unseen)
    if at[-1] - at[0] > JOINT.span * step * len(at):
        at = step * np.arange(len(at))
    return step, [(own, float(at[own.start] - at[0])) for own in pieces]


def _between(cuts: IntArray, count: int) -> list[slice]:
    """The pieces of a row of samples that is cut before some of them."""
    return [slice(int(start), int(stop)) for start, stop in itertools.pairwise([0, *cuts, count])]


def _check_jumps(name: str, angle: FloatArray, pieces: Sequence[slice], lines: IntArray) -> None:
    """Raise InputError where the angle jumps between two samples of a piece as no motion does."""
    steps = [np.diff(angle[own]) for own in pieces]
    every = np.abs(np.concatenate(steps))
    # a turn that is lost and found are two jumps, and more samples may be off; an angle that rests where its turns are
    # counted anew jumps at any of them
    others = np.sort(every[every < np.pi])[: -max(3, len(every) // 100)]
    fastest = float(others[-1]) if len(others) else 0.0
    for own, step in zip(pieces, steps, strict=True):
        # a step that is several times the fastest motion elsewhere, and that nothing before it announces
        off = np.abs(step[1:-1] - (step[2:] + step[:-2]) / 2)
        row = int(off.argmax()) if len(off) else 0
        if len(off) and off[row] > SETTINGS.jump * fastest > 0:
            raise InputError(
                f"{name} jumps by {step[row + 1]:.3g} from line {lines[own.start + row + 1]} to the next, elsewhere by "
                f"{fastest:.2g} at most: are samples missing there, or is a turn lost? Put a file on each side"
            )


def _unseen(name: str, angle: FloatArray, pieces: Sequence[slice], lines: IntArray, notes: list[str]) -> IntArray:
    """How many samples are missing before each, (n,), though the time is even: the angle moves on by several steps.

    Between two steps on each side that are alike no motion makes one that is a whole number of times as long; an
    encoder does where they are one step of its own.
    """
    unseen = np.zeros(len(angle), np.int64)
    for own in pieces:
        if own.stop - own.start < JOINT.piece or not (steps := np.diff(angle[own])).any():
            continue
        least = float(np.abs(steps[steps != 0]).min())
        beside = np.stack([steps[:-4], steps[1:-3], steps[3:-1], steps[4:]])
        usual = beside.mean(axis=0)
        alike = np.abs(beside - usual).max(axis=0) < JOINT.alike_steps * np.abs(usual)
        alike &= (np.abs(usual) > JOINT.sure_step * noise_of(angle[own])) & (np.round(np.abs(usual) / least) > 1)
        times = np.where(alike, steps[2:-2] / np.where(alike, usual, 1.0), 1.0)
        count = np.round(times).astype(np.int64)
        missing = (count > 1) & (np.abs(times - count) < JOINT.alike_steps)
        unseen[own.start + 3 : own.stop - 2] = np.where(missing, count - 1, 0)
    if unseen.any():
        first, lost = int(np.argmax(unseen > 0)), counted(int(unseen.sum()), "sample")
        notes.append(
            f"{name} moves on by {unseen[first] + 1} steps at once from line {lines[first - 1]} to the next: as if "
            f"{lost} were missing in {counted(int((unseen > 0).sum()), 'place')}, though the time goes on evenly; what "
            "follows is taken to be as much later"
        )
    return unseen


def noise_of(values: FloatArray) -> float:
    """Standard deviation of what changes from sample to sample without a pattern, or more: by fourth differences."""
    size = np.sort(np.abs(np.diff(values, 4)))
    # what jumps (a reversal) is none of it; rounding steps are
    return float(np.sqrt((size[: int(0.99 * len(size)) + 1] ** 2).mean() / 70.0))


def is_standing(angle: FloatArray) -> bool:
    """Whether a joint travels no further than what gives in it, or than one step of its encoder: its dq is noise."""
    return float(np.ptp(angle)) < JOINT.travel or len(np.unique(angle)) < 3


#: Angle of a joint and its speed as given (None) in a piece of a file, (n,) each.
_Given = tuple[FloatArray, FloatArray | None]


def _check(joint: str, name: str, pieces: Sequence[_Given], step: float, time: str) -> list[str]:
    """What a given speed says of units and time, whose column has a name. Raises InputError where it is another one.

    Of a joint that stands it is noise, but for what agrees with the angle by another unit.
    """
    angle = np.concatenate([one for one, _ in pieces])
    turns = float(np.ptp(angle)) / (2 * np.pi)
    if name == f"q{joint}" and turns > JOINT.turns:
        raise InputError(
            f"{name} covers {turns:.0f} turns if it is in rad: is it in degrees? Name the column q{joint}_deg or "
            f"q{joint}_rad"
        )
    told = [(one, speed) for one, speed in pieces if speed is not None]
    if not told:
        taken = f", which is taken to be in {'rad' if name == f'q{joint}' else name.rpartition('_')[2]}"
        return [f"dq{joint} is not there: speeds are derived from {name}{taken}"]
    if not np.ptp(np.concatenate([speed for _, speed in told])) and np.ptp(angle):
        return [f"dq{joint} never changes and is not looked at: speeds are derived from {name}"]
    # both in the mean over a few samples, so that the noise of the angle does not decide
    width = min(max(5, len(angle) // 400), min(len(one) for one, _ in told) // 2)
    derived = np.concatenate([(one[width:] - one[:-width]) / (width * step) for one, _ in told])
    sums = [np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)]) for _, speed in told]
    given = np.concatenate([(one[width:] - one[:-width]) / width for one in sums])
    power = float(derived @ derived)
    if power <= 0 or not given.any():
        return []
    factor = float(given @ derived) / power
    alike = abs(factor) * np.sqrt(power / float(given @ given))
    known = {180 / np.pi: "dq in deg/s, or q in rad while named deg", np.pi / 180: "q in degrees, dq in rad/s",
             30 / np.pi: "dq in rpm", -1.0: "dq with the opposite sign",
             **{_TIME[time] / unit: f"{time} in {word}" for word, unit in _UNITS_OF_TIME.items()}}  # fmt: skip
    why = [text for value, text in known.items() if abs(factor / value - 1) < SETTINGS.one_rate]
    standing = is_standing(angle)
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
