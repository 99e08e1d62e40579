"""Recordings over time: from the reference to the output, link by link.

theta_ref -> theta_mot is the servo's (control lag), theta_mot -> theta_in the coupling's, theta_in -> theta_out the
reducer's. The two links of the axis are fitted here; the reducer's transmission error goes to the common core, sample
by sample. Columns and signs: docs/effects.md.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.csv_tables import header_of, read_csv
from st_codegen.ir.arrays import BoolArray, FloatArray, IntArray
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions
from st_codegen.rig.effects.axis import ControlLag, CouplingCompliance
from st_codegen.rig.model import RigModel

ANGLES = ("theta_ref", "theta_mot", "theta_in", "theta_out")
#: angles of the fast side, the one nearest to the reducer first
FAST = ("theta_in", "theta_mot", "theta_ref")
#: samples whose waves are made at once: some 50 MB
_AT_ONCE = 100_000
_CONDITIONS = ("speed_rpm", "torque_Nm", "temperature_C")


@dataclass(frozen=True)
class Recording:
    """One recording: float64 (n,) each; angles that are not there are missing in `angles`."""

    name: str
    time_s: FloatArray
    angles: dict[str, FloatArray]
    at: Conditions

    @property
    def fast(self) -> str:
        """The name of the angle of the fast side that is nearest to the output."""
        return next(name for name in FAST if name in self.angles)

    @property
    def moves(self) -> BoolArray:
        """The samples at which the axis moves, (n,): standstill says nothing of the direction, and little else."""
        return np.asarray(self.at.speed_rpm > SETTINGS.standstill * self.at.speed_rpm.max())

    @property
    def starts(self) -> IntArray:
        """The samples with which the recording begins, and those after each gap: what was before is not known."""
        waits = np.diff(self.time_s)
        return np.concatenate([[0], 1 + np.flatnonzero(waits > SETTINGS.jump * np.median(waits))])

    def rows(self, index: IntArray) -> Recording:
        """The samples of an index array."""
        angles = {name: angle[index] for name, angle in self.angles.items()}
        return Recording(self.name, self.time_s[index], angles, self.at.rows(index))


def is_recording(path: Path) -> bool:
    """Whether a file has the columns of a recording."""
    names = set(header_of(path))
    return "t" in names and bool(names & set(ANGLES))


def read_recordings(paths: Sequence[Path]) -> tuple[Recording, ...]:
    """Read recordings. Raises one InputError that lists what is wrong."""
    problems = Problems("recordings")
    found = []
    for path in paths:
        with problems.collect():
            found.append(_read(path))
    problems.raise_if_any()
    return tuple(found)


def _read(path: Path) -> Recording:
    columns = _columns(path)
    problems = Problems(str(path))
    if missing := [name for name in ("t", "torque_Nm", "temperature_C") if name not in columns]:
        problems.add(f"the columns {', '.join(missing)} are missing")
    angles = {name: columns[name] for name in ANGLES if name in columns}
    if len(angles) < 2 or not angles.keys() & set(FAST):
        problems.add(
            f"the angles {', '.join(angles)} do not suffice: two of {', '.join(ANGLES)} are needed to tell a difference"
        )
    time = columns.get("t", np.arange(float(SETTINGS.least_samples)))
    if len(time) < SETTINGS.least_samples:
        problems.add(f"{counted(len(time), 'sample')} only, at least {SETTINGS.least_samples} are needed")
    if (np.diff(time) <= 0).any():
        problems.add(f"the time does not rise from row {int(np.argmax(np.diff(time) <= 0)) + 2} to the next")
    problems.raise_if_any()
    speed = speed_of(angles, time)
    given = columns.get("speed_rpm", np.abs(speed) / 6.0)
    at = Conditions(_directions(speed), np.abs(given), columns["torque_Nm"], columns["temperature_C"])
    return Recording(path.name, time, angles, at)


def _columns(path: Path) -> dict[str, FloatArray]:
    """The columns of a file by name. Raises InputError for what is no table of numbers."""
    table = read_csv(path)
    problems = Problems(str(path))
    values = table.numbers(table.names, problems)
    problems.raise_if_any()
    return dict(zip(table.names, values.T, strict=True))


def speed_of(angles: Mapping[str, FloatArray], time_s: FloatArray) -> FloatArray:
    """The rate of the fast side, deg/s (n,): of the reference, else of a measured angle over some samples."""
    speed: FloatArray = np.gradient(reference_of(angles), time_s)
    return speed if "theta_ref" in angles else _smoothed(speed)


def reference_of(angles: Mapping[str, FloatArray]) -> FloatArray:
    """The angle of the fast side that tells the speed: the reference, else a measured one."""
    return next(angles[name] for name in ("theta_ref", "theta_in", "theta_mot") if name in angles)


def _smoothed(values: FloatArray) -> FloatArray:
    count = SETTINGS.samples_of_rate
    kernel = np.ones(count) / count
    return np.convolve(np.pad(values, count // 2, mode="edge"), kernel, mode="valid")[: len(values)]


def _directions(speed: FloatArray) -> FloatArray:
    """+1 or -1; at standstill the last direction, forward before the first motion."""
    moving = np.abs(speed) > SETTINGS.no_direction * np.abs(speed).max()
    last = np.maximum.accumulate(np.where(moving, np.arange(len(speed)), 0))
    return np.where(moving[last], np.sign(speed[last]), 1.0)


@dataclass(frozen=True)
class _Samples:
    """What a recording says of the reducer: the angle of the output and TE, deg (n,), and which samples move.

    rounded_deg: RMS of what the angles are rounded by; bends: second differences of what the rig leaves where it moves.
    """

    recording: Recording
    out: FloatArray
    te: FloatArray
    moving: IntArray
    rounded_deg: float = 0.0
    bends: FloatArray = field(default_factory=lambda: np.zeros(0))


def observations(recordings: Sequence[Recording], rig: RigModel) -> Observations:
    """The transmission error of recordings as samples for the common core.

    Of those without theta_out, beside others with it, there are none: what was not measured agrees with any rig.
    """
    links = [r.name for r in recordings if "theta_out" not in r.angles]
    aside = [f"{name}: without theta_out it says nothing of the reducer" for name in links]
    recordings = [r for r in recordings if "theta_out" in r.angles] or recordings
    parts = [_samples(r, rig) for r in recordings]
    if not any(len(part.moving) for part in parts):
        raise InputError(f"{', '.join(r.name for r in recordings)}: the axis does not move, by its speed")
    inside, too_long = _orders_inside(recordings, rig)
    drawn = list(zip(parts, _drawn([part.moving for part in parts]), strict=True))
    conditions = [part.recording.at.rows(rows) for part, rows in drawn]
    # second differences of white noise have six times its variance; what is smooth over samples hardly has any
    squares = np.concatenate([part.bends for part in parts]) ** 2
    return Observations(
        Conditions(*(np.concatenate([getattr(c, name) for c in conditions]) for name in ("sign", *_CONDITIONS))),
        tuple(f"{part.recording.name}, t = {part.recording.time_s[i]:g} s" for part, rows in drawn for i in rows),
        np.zeros(1, np.int64),
        np.concatenate([part.te[rows] for part, rows in drawn]).astype(np.complex128)[:, None],
        np.concatenate([np.deg2rad(part.out[rows]) for part, rows in drawn]),
        inside,
        neighbours_deg=float(np.sqrt(squares.mean() / 6.0)) if len(squares) else np.inf,
        rounded_by=np.concatenate([np.full(len(rows), part.rounded_deg) for part, rows in drawn]),
        not_looked_at=(*aside, *too_long),
    )


def _samples(r: Recording, rig: RigModel) -> _Samples:
    """The transmission error of a recording; without theta_out it is the rig's own, since nothing else is known."""
    if "theta_out" not in r.angles:
        out = next(iter(r.angles.values())) / rig.constants.reduction_ratio
        return _Samples(r, out, expected_error(r, out, rig), np.flatnonzero(r.moves))
    out, te = r.angles["theta_out"], error_of(r, rig)
    r = _without_scatter(r, out, te, rig)
    moves = r.moves & _has_turned_over(r, te, rig.constants.reduction_ratio)
    steps = step_of(out), step_of(r.angles[r.fast]) / rig.constants.reduction_ratio
    bends = np.diff(te - expected_error(r, out, rig), n=2)[moves[2:] & moves[1:-1] & moves[:-2]]
    return _Samples(r, out, te, np.flatnonzero(moves), float(np.hypot(*steps)) / np.sqrt(12.0), bends)


def _without_scatter(r: Recording, out: FloatArray, te: FloatArray, rig: RigModel) -> Recording:
    """Conditions that vary by what their sensors scatter by, and by nothing else, as their means.

    What scatters is no load: TE does not follow it, and would show nothing of what does. Where with it less is left
    from sample to sample than with the mean, or what the rig makes of it goes with TE, it is one.
    """
    for name in _CONDITIONS:
        values = getattr(r.at, name)
        # second differences of white noise have six times its variance
        scatter = float((np.diff(values, n=2) ** 2).mean()) / 6.0
        if r.moves.any() and scatter > SETTINGS.mostly_scatter * values[r.moves].var():
            mean = np.full(len(values), values[r.moves].mean())
            meant = replace(r, at=replace(r.at, **{name: mean}))
            usual = expected_error(meant, out, rig)
            gap, made = (np.diff(x - usual, n=2)[r.moves[2:]] for x in (te, expected_error(r, out, rig)))
            follows = (gap @ made) ** 2 > SETTINGS.mostly_scatter * (gap @ gap) * (made @ made)
            r = r if follows or (gap @ gap) >= ((gap - made) ** 2).sum() else meant
    return r


def _has_turned_over(r: Recording, te: FloatArray, ratio: float) -> BoolArray:
    """The samples at which the flanks of the direction carry, (n,).

    Behind a reversal the output stands still until the difference of the means is travelled: TE (deg, (n,)) changes by
    all that the fast side turns over the ratio, and so by no more than it ranges over. What moves less than that in
    most samples is taken as it is.
    """
    fast, moves = r.angles[r.fast] / ratio, r.moves
    reversals = np.flatnonzero(np.diff(r.at.sign)) + 1
    if not len(reversals) or not moves.any():
        return np.ones(len(te), np.bool_)
    last = np.searchsorted(reversals, np.arange(len(te)), side="right") - 1
    travelled = np.where(last < 0, np.inf, np.abs(fast - fast[reversals[np.maximum(last, 0)]]))
    low, high = np.quantile(te[moves], (SETTINGS.far_off, 1.0 - SETTINGS.far_off))
    found = np.asarray(travelled > high - low)
    return found if np.mean(found[moves]) > 0.5 else np.ones(len(te), np.bool_)


def _drawn(moving: Sequence[IntArray]) -> list[IntArray]:
    """As many of the samples that move as the common core is given, of each recording."""
    # even steps would show each order as others too
    random = np.random.default_rng(0)
    step = max(1, -(-sum(map(len, moving)) // SETTINGS.most_samples))
    firsts = [np.arange(0, len(rows), step) for rows in moving]
    return [
        rows[first + random.integers(0, np.minimum(step, len(rows) - first))]
        for rows, first in zip(moving, firsts, strict=True)
    ]


def _orders_inside(recordings: Sequence[Recording], rig: RigModel) -> tuple[tuple[int, ...], list[str]]:
    """The orders of which the transmission error of recordings is the sum, and what is said of those that are not."""
    constants, turns = rig.constants, turned(recordings, rig)
    highest = 3.1 * max(constants.cycloid_teeth, constants.pins)
    mesh = [k for k in constants.mesh_orders() if k <= highest]
    sides = [k + d for k in mesh for d in (-constants.cranks, constants.cranks)]
    # of less than a wave nobody can tell that it is one
    told = {order for order in {constants.cranks, *mesh, *sides, *range(13)} if order * turns >= SETTINGS.least_of_wave}
    inside = tuple(sorted({0, *rig.orders(), *told}))
    if turns >= SETTINGS.least_of_wave:
        return inside, []
    return inside, [
        f"orders below {SETTINGS.least_of_wave / max(turns, 1e-6):.3g} but those of the rig: the output turns by "
        f"{turns:.2g} of a turn at most, less than a wave of them"
    ]


def turned(recordings: Sequence[Recording], rig: RigModel) -> float:
    """Turns of the output over which the recording goes that goes farthest."""
    degrees = [float(np.ptp(r.angles[r.fast])) for r in recordings]
    return max(degrees, default=0.0) / (360.0 * rig.constants.reduction_ratio)


def is_whole_turn(r: Recording, rig: RigModel) -> bool:
    """Whether a recording goes over a whole turn of the output."""
    angle, waits = r.angles[r.fast], np.diff(r.time_s)
    # a gap is no step, and neither is what noise makes of two samples at nearly the same time
    step = float((np.abs(np.diff(angle)) * np.minimum(np.median(waits) / waits, 1.0)).max())
    return float(np.ptp(angle)) + SETTINGS.steps_of_turn * step >= 360.0 * rig.constants.reduction_ratio


def step_of(angle: FloatArray) -> float:
    """The step of which all values of an angle are multiples, deg: of decimals or of an encoder; 0 without one."""
    counts = {lines * times for lines in SETTINGS.encoder_lines for times in (1, 4)} | {2**n for n in range(8, 25)}
    tried = {d * 10.0**-n for n in range(6) for d in (1.0, 2.0, 5.0)} | {360.0 / count for count in counts}
    values, bends = angle - angle[0], np.abs(np.diff(angle, n=2))
    dust = 1e-9 * float(np.abs(angle).max())
    for step in sorted(tried, reverse=True):
        off = np.abs(values - step * np.round(values / step))
        # an even motion may go in whole steps; what is rounded is one step too early or too late now and then
        wobbles = np.abs(bends / step - 1.0) < SETTINGS.wobble_of_a_step
        is_one = float(off.max()) < SETTINGS.off_steps * step + dust < SETTINGS.told_step * step
        if is_one and wobbles.mean() > SETTINGS.least_wobbles:
            return step
    return 0.0


def expected_error(r: Recording, out: FloatArray, rig: RigModel) -> FloatArray:
    """The transmission error that the rig has, deg (n,): what sensors of the conditions scatter by is in it."""
    parts = np.array_split(np.arange(len(out)), max(1, len(out) // _AT_ONCE))
    at = [r.at.rows(part) for part in parts]
    return np.concatenate(
        [
            rig.te_deg(out[part], a.sign, a.speed_rpm, a.torque_Nm, a.temperature_C)
            for part, a in zip(parts, at, strict=True)
        ]
    )


def error_of(r: Recording, rig: RigModel) -> FloatArray:
    """The transmission error of a recording with theta_out, deg (n,)."""
    return r.angles["theta_out"] - _input_angle(r, rig) / rig.constants.reduction_ratio


def _input_angle(r: Recording, rig: RigModel) -> FloatArray:
    """theta_in, deg: measured, or by the rig's own links from the next angle of the fast side that is there."""
    if "theta_in" in r.angles:
        return r.angles["theta_in"]
    angle = with_motor(r, rig).angles["theta_mot"]
    for effect in rig.effects:
        angle = angle + effect.twist(r.at) if isinstance(effect, CouplingCompliance) else angle
    return angle


def with_motor(r: Recording, rig: RigModel) -> Recording:
    """The recording with theta_mot, by the rig's own lag from theta_ref where no angle behind it was measured."""
    if r.angles.keys() & {"theta_in", "theta_mot"}:
        return r
    angle = r.angles["theta_ref"]
    for effect in rig.effects:
        angle = effect.motor_angle(r.time_s, angle) if isinstance(effect, ControlLag) else angle
    return replace(r, angles={**r.angles, "theta_mot": angle})
