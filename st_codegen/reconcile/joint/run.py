"""Recordings of joints in, what their torque is made of out."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from st_codegen.errors import InputError, Problems
from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.joint.mode import JointMode, JointResponse, find_mode, is_rigid, response
from st_codegen.reconcile.joint.parts import (
    OTHERS,
    RICH,
    RIGID,
    Chosen,
    TorquePart,
    acting_of,
    base_of,
    choose,
    crossed,
    drifts_of,
    first_of_kinds,
    floor_of,
    stacked,
    surely,
    without_outliers,
)
from st_codegen.reconcile.joint.reading import JointRecording, is_standing
from st_codegen.reconcile.joint.rows import JointRows, rows_of, starts_of
from st_codegen.reconcile.joint.settings import JOINT
from st_codegen.reconcile.joint.waves import ANGLE, TorqueWave, columns, find_wave, most_waves
from st_codegen.threads import one_thread


@dataclass(frozen=True)
class JointResult:
    """What one joint's torque is made of; without its name where it is the only one.

    late_s: how much later than the motion the torque is, as far as a shift tells; as_late_s: the least and the most of
    what does as well; outliers: rows left out; told_Hz: bands in which the motion explains the torque; is_rigid:
    whether all of that is a rigid joint's; unseen_mode: the inertia is not one at all frequencies; unit_is_told: that
    of the angle is known by more than its having no other in its name.
    """

    joint: str
    rows: JointRows
    chosen: Chosen
    waves: tuple[TorqueWave, ...]
    mode: JointMode | None
    late_s: float
    as_late_s: tuple[float, float]
    outliers: int
    told_Hz: tuple[tuple[float, float], ...]
    is_rigid: bool
    unseen_mode: bool
    notes: tuple[str, ...]
    unit_is_told: bool = True

    @property
    def gap(self) -> tuple[float, float, float]:
        """RMS (N m) on left-out stretches of the rigid joint alone and with all parts; noise floor."""
        rigid = [part for part in self.chosen.parts if part.name in (RIGID, OTHERS)]
        before = crossed(stacked(rigid), self.rows).held.sum()
        count = len(self.rows.time)
        return (
            float(np.sqrt(before / count)),
            float(np.sqrt(self.chosen.fit.held.sum() / count)),
            floor_of(self.chosen, self.rows),
        )

    @property
    def left(self) -> FloatArray:
        """The measured torque less all parts that were chosen, N m (rows,)."""
        return self.rows.torque - self.chosen.of(set(self.chosen.names()))


@one_thread()
def reconcile_joints(
    recordings: Sequence[JointRecording], scale: float | None = None, accept: Collection[str] = ()
) -> tuple[JointResult, ...]:
    """What is in the torque of each joint. Raises InputError where no joint moves, or a torque has the wrong sign.

    scale: factor on the torque; accept: `sign` turns a torque whose sign is opposite.
    """
    problems, found = Problems("recordings of joints"), []
    factor = 1.0 if scale is None else scale
    for joint in recordings[0].angle:
        with problems.collect():
            found.append(_joint(_scaled(recordings, joint, factor), joint, accept))
    problems.raise_if_any()
    moving = [one for one in found if one is not None]
    least = f"a joint that travels less than {JOINT.travel:g} rad, or one step of its encoder, counts as standing"
    if not moving:
        # as of samples that are missing, between which it does not
        said = "".join(f"; {note}" for note in dict.fromkeys(note for one in recordings for note in one.notes))
        raise InputError(
            f"no joint moves for long enough: nothing can be told of friction, ripple or elasticity; {least}{said}"
        )
    if still := [joint for joint in recordings[0].angle if joint not in {one.joint for one in moving}]:
        which, they = ("joints", "they do") if still[1:] else ("joint", "it does")
        note = f"of {which} {', '.join(still)} nothing is told: {they} not move for long enough; {least}"
        moving[0] = replace(moving[0], notes=(*moving[0].notes, note))
    return tuple(moving)


def _scaled(recordings: Sequence[JointRecording], joint: str, factor: float) -> list[JointRecording]:
    return [replace(one, torque={**one.torque, joint: factor * one.torque[joint]}) for one in recordings]


def _joint(recordings: list[JointRecording], joint: str, accept: Collection[str]) -> JointResult | None:
    # in a folder one joint may move in each file
    files = dict.fromkeys(one.name for one in recordings)
    recordings = [one for one in recordings if not is_standing(one.angle[joint])]
    still = [name for name in files if name not in {one.name for one in recordings}]
    rows = rows_of(recordings, joint) if recordings else None
    if rows is None:
        return None
    if not np.ptp(rows.torque):
        raise InputError(
            f"tau{joint} never changes: it is no torque of a joint that moves; cut the columns of this joint out"
        )
    acting = acting_of(rows)
    rows = rows_of(recordings, joint, acting=acting.columns) or rows
    said = dict.fromkeys(note for one in recordings for note in one.notes)
    notes = [note for note in said if f"dq{joint} " in note or "dq" not in note]
    told = _unit_is_told(recordings, joint, rows)
    if still:
        notes.append(f"joint {joint} stands in {', '.join(still)}: nothing is taken from there")
    if is_opposite(rows):
        if not {"sign", "all"} & set(accept):
            raise InputError(
                f"tau{joint} has the opposite sign: with it inertia and friction are negative, and friction drives the "
                "joint. tau is the torque on the joint in the direction of rising q. --accept sign turns it"
            )
        recordings = _scaled(recordings, joint, -1.0)
        notes.append(f"the sign of tau{joint} was turned, as accepted")
        rows = replace(rows, torque=-rows.torque, torque_rate=-rows.torque_rate)
    seen = _seen(rows)
    # a ripple shakes the joint as a mode does; waves over time may be those of the motion itself
    ripples = [wave for wave in seen if wave[0] == ANGLE]
    kernel, unseen = _below_mode(recordings, joint, rows, acting.columns, ripples)
    shift, alike = _shift(recordings, joint, kernel, acting.columns, seen)
    rows = rows_of(recordings, joint, shift, kernel, acting.columns) or rows
    rows, outliers = without_outliers(rows)
    chosen, kept = _with_waves(rows, acting.moves)
    if shift and (base := rows_of(recordings, joint, 0, kernel, acting.columns)) is not None:
        # what a shift is found beside has not all parts: it stands for none of them that do better without it
        base, spikes = without_outliers(base)
        plain, beside = _with_waves(base, acting.moves)
        shifted = chosen.fit.held / len(rows.time)
        if surely(shifted - plain.fit.held / len(base.time), shifted):
            shift, alike, rows, outliers, chosen, kept = 0, [0], base, spikes, plain, beside
    rests = [(rows, chosen.of(set(chosen.names())) - chosen.fit.values[0] * rows.acceleration)]
    narrow = rows_of(recordings, joint, shift, acting=acting.columns)
    if narrow is not None and narrow.kernel_s < rows.kernel_s:
        # where a joint is shaken, friction turns with it from sample to sample: a wide kernel knows nothing of that
        rests.append((narrow, _not_inertia(narrow, ripples)))
    mode, bands, rigid = _mode(recordings, joint, rests, shift)
    late, *as_late = (one * recordings[0].step_s for one in (shift, min(alike), max(alike)))
    unseen = unseen and mode is None
    return JointResult(
        joint,
        rows,
        chosen,
        kept,
        mode,
        late,
        (as_late[0], as_late[1]),
        outliers,
        bands,
        rigid,
        unseen,
        tuple(notes),
        told,
    )


def _with_waves(rows: JointRows, moves: Mapping[str, float]) -> tuple[Chosen, tuple[TorqueWave, ...]]:
    """The parts of the torque, and the waves among them, each looked for in what those before it leave."""
    chosen, waves = choose(rows, moves), list[TorqueWave]()
    while len(waves) < JOINT.waves:
        wave = find_wave(rows, chosen)
        if wave is None or any(abs(wave.number - w.number) < wave.resolution and w.over == wave.over for w in waves):
            break
        waves.append(wave)
        chosen = choose(rows, moves, [one.gain.part for one in waves])
    return chosen, tuple(wave for wave in waves if wave.gain.part.name in chosen.names())


def _rich(rows: JointRows, seen: Sequence[tuple[str, float]] = ()) -> list[TorquePart]:
    """All that friction may be, and waves that were seen: what a shift of the torque and a mode are judged beside.

    A wave that the kernel takes away is next to nothing, of which any size would fit.
    """
    waves = [
        TorquePart(f"{over}:{number:.6g}", number, columns(rows, over, number))
        for over, number in seen
        if number <= most_waves(rows, over)
    ]
    return [*base_of(rows), *first_of_kinds(rows, *RICH), *waves]


def _seen(rows: JointRows) -> list[tuple[str, float]]:
    """The loudest waves: the drive answers them, so that they would look like a shift of the torque."""
    seen: list[tuple[str, float]] = []
    while len(seen) < JOINT.waves:
        parts = _rich(rows, seen)
        wave = find_wave(rows, Chosen(tuple(parts), crossed(stacked(parts), rows)))
        if wave is None or (wave.over, wave.number) in seen:
            break
        seen.append((wave.over, wave.number))
    return seen


def _unit_is_told(recordings: list[JointRecording], joint: str, rows: JointRows) -> bool:
    """Whether name or gravity tell the unit of the angle. Raises InputError where gravity tells that it is in degrees.

    An angle in degrees and a speed in deg/s agree as well as those in rad and rad/s; gravity is a wave of the turn.
    """
    if not any(joint in one.without_unit for one in recordings):
        return True
    other = [
        replace(
            one, angle={name: q * (np.pi / 180 if name in one.without_unit else 1.0) for name, q in one.angle.items()}
        )
        for one in recordings
    ]
    turned = rows_of(other, joint)
    turned = turned and (rows_of(other, joint, acting=acting_of(turned).columns) or turned)
    if turned is None or len(turned.time) != len(rows.time):
        return False
    # in one direction what changes with time changes with the angle
    in_rad, in_deg = (crossed(stacked([*_rich(one), *drifts_of(one)]), one).held for one in (rows, turned))
    # what is a line over less than a turn may be a spring's
    if np.ptp(rows.angle) > 2 * np.pi and surely(in_rad - in_deg, in_rad):
        raise InputError(
            f"the torque goes with q{joint} as gravity does if that is in degrees, and not if it is in rad: name the "
            f"column q{joint}_deg or q{joint}_rad (and dq{joint}_deg_s or dq{joint}_rad_s, if it is there)"
        )
    return surely(in_deg - in_rad, in_deg)


def is_opposite(rows: JointRows) -> bool:
    """Whether inertia and friction are negative beyond their errors, beside friction that rises with speed or not."""
    parts, sure = base_of(rows), -JOINT.errors
    for names in (("dry_friction",), ("dry_friction", "viscous_friction")):
        fit = crossed(stacked([*parts, *first_of_kinds(rows, *names)]), rows)
        place = -len(names)
        if fit.values[0] < sure * fit.errors[0] and fit.values[place] < sure * fit.errors[place]:
            return True
    return False


def _below_mode(
    recordings: list[JointRecording],
    joint: str,
    rows: JointRows,
    acting: Sequence[int],
    seen: Sequence[tuple[str, float]],
) -> tuple[float, bool]:
    """The kernel (s) that leaves modes out: below them a joint is rigid. Whether there is one that was not seen."""
    mode, *_ = _mode(recordings, joint, [(rows, _not_inertia(rows, seen))], 0)
    kernel = rows.kernel_s
    if mode is not None:
        lowest = mode.antiresonance_Hz or mode.resonance_Hz
        kernel = max(kernel, JOINT.below_mode / (2 * np.pi * lowest))
    unseen = False
    # a rigid joint has one inertia at all frequencies: what a wider kernel sees otherwise is an unseen mode
    while (narrow := _inertia(recordings, joint, kernel, acting, seen)) is not None:
        wide = _inertia(recordings, joint, 2 * kernel, acting, seen)
        if wide is None:
            break
        (inertia, error, diluted), (other, more, _) = narrow, wide
        apart, sure = abs(inertia - other), JOINT.better * float(np.hypot(error, more))
        noisy = diluted > JOINT.one_inertia * abs(inertia) and 2 * kernel <= JOINT.kernel[1] * rows.step_s
        if apart <= max(JOINT.one_inertia * abs(other), sure) and not noisy:
            break
        kernel, unseen = 2 * kernel, unseen or apart > sure + 2 * diluted
    return kernel, unseen


def _inertia(
    recordings: list[JointRecording],
    joint: str,
    kernel_s: float,
    acting: Sequence[int],
    seen: Sequence[tuple[str, float]],
) -> tuple[float, float, float] | None:
    """The inertia that a kernel shows, its error, and by how much noise of the angle makes it smaller.

    That is more than of the acceleration alone where other parts look like it, as gravity does in a slow sine.
    """
    rows = rows_of(recordings, joint, 0, kernel_s, acting)
    if rows is None:
        return None
    columns = stacked(_rich(rows, seen))
    fit = crossed(columns, rows)
    own = columns[:, 0] - columns[:, 1:] @ np.linalg.lstsq(columns[:, 1:], columns[:, 0], rcond=None)[0]
    noise = rows.noise[1] ** 2
    diluted = noise / max(float((own**2).mean()) - noise, noise / 10, 1e-300)
    return float(fit.values[0]), float(fit.errors[0]), diluted * abs(float(fit.values[0]))


def _shift(
    recordings: list[JointRecording],
    joint: str,
    kernel_s: float,
    acting: Sequence[int],
    seen: Sequence[tuple[str, float]],
) -> tuple[int, list[int]]:
    """Samples by which the torque is late: the shift whose model predicts best, if it surely does so better.

    With all shifts around it whose models do not surely predict worse.
    """
    most = int(min(JOINT.most_shift_s / recordings[0].step_s, JOINT.most_shift))
    fits: dict[int, FloatArray] = {}
    base = rows_of(recordings, joint, 0, kernel_s, acting)

    def tried(shifts: Collection[int]) -> int:
        """The best of all shifts so far, with some more."""
        for shift in sorted(set(shifts) - fits.keys()):
            rows = rows_of(recordings, joint, shift, kernel_s, acting)
            if rows is not None and base is not None and len(rows.time) > JOINT.kept_rows * len(base.time):
                fits[shift] = crossed(stacked(_rich(rows, seen)), rows).held / len(rows.time)
        return min(fits, key=lambda s: float(fits[s].sum()), default=0)

    step = max(1, most // 8)
    best = tried({*range(-most, most + 1, step), 0})
    # the best at the end of what was tried is not the best
    while fits and abs(best) == max(map(abs, fits)) and abs(best) < JOINT.farthest * most:
        before, way = best, int(np.sign(best))
        best = tried([before + way * step * n for n in range(1, 9)])
        if best == before:
            break
    if not fits:
        return 0, [0]
    far = rows_of(recordings, joint, best, kernel_s, acting)
    if abs(best) > most and far is not None:
        # so late a torque makes waves that are none
        seen = _seen(far)
        fits.clear()
    best = tried([0, *range(best - step + 1, best + step)])
    saved = fits[0] - fits[best]
    sure = surely(saved, fits[0]) and (saved > 0).mean() >= JOINT.most
    if not sure or saved.sum() <= JOINT.share * fits[0].sum():
        return 0, [0]
    alike = [best]
    for way in (-1, 1):
        while (farther := alike[-1 if way > 0 else 0] + way) and abs(farther) < JOINT.farthest * most:
            tried([farther])
            if farther not in fits or surely(fits[farther] - fits[best], fits[farther]):
                break
            alike = sorted([*alike, farther])
    return best, alike


def _not_inertia(rows: JointRows, seen: Sequence[tuple[str, float]]) -> FloatArray:
    """The torque that is no inertia's, beside all that friction may be, N m (rows,)."""
    known = stacked(_rich(rows, seen))
    return np.asarray(known[:, 1:] @ crossed(known, rows).values[1:])


def _mode(
    recordings: list[JointRecording], joint: str, rests: Sequence[tuple[JointRows, FloatArray]], shift: int
) -> tuple[JointMode | None, tuple[tuple[float, float], ...], bool]:
    """The mode, in which bands (Hz) the motion tells the torque, and whether it is all a rigid joint's.

    rests: rows with the torque that is no inertia's; of several the one counts that leaves most to be told.
    """
    responses = [_response(recordings, joint, rows, rest, shift) for rows, rest in rests]
    found = max((one for one in responses if one is not None), key=lambda one: len(one.frequency), default=None)
    if found is None:
        return None, (), True
    mode = find_mode(found)
    return mode, found.bands(mode.damping if mode is not None else 0.0), is_rigid(found)


def _response(
    recordings: list[JointRecording], joint: str, rows: JointRows, rest: FloatArray, shift: int
) -> JointResponse | None:
    pieces = []
    for one, start in zip(recordings, starts_of(recordings), strict=True):
        time = start + one.step_s * np.arange(len(one.angle[joint]))
        torque = np.roll(one.torque[joint], -shift) - np.interp(time, rows.time, rest)
        cut = abs(shift) + 1
        pieces.append((one.angle[joint][cut:-cut], torque[cut:-cut]))
    return response(pieces, recordings[0].step_s)
