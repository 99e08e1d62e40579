"""Recording of a campaign: PRG_Experiment goes through a plan, its samples become the files that `train` reads.

Each measurement is a file of its own, written whole when it is finished; a later call goes on where this one ended. The
controller ends a measurement by itself when it no longer hears of this client (`te.compensation.recorder`).
"""

from __future__ import annotations

import contextlib
import json
import random
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.campaign.conditions import CONDITION_COLUMNS, OperatingPoint
from st_codegen.campaign.curves import CONDITIONS_FILE, MOST_GAP_DEG, Curve, Run, largest_gap, run_paths, write_run
from st_codegen.emit.output import COMPARISON, read_manifest
from st_codegen.errors import GeneratedCodeError, InputError, Problems, counted, meant
from st_codegen.files.csv_tables import csv_text
from st_codegen.files.text import make_folder, write_text
from st_codegen.ir import AnyArray, BoolArray, FloatArray
from st_codegen.live.controller import Controller, Signal, must_be_of, must_run
from st_codegen.live.failures import (
    ControllerError,
    CorrectionError,
    MeasurementError,
    OtherClientError,
    SilentError,
)
from st_codegen.processes import Progress
from st_codegen.te.compensation import experiment
from st_codegen.te.compensation.codes import EXPERIMENT_STATE, TE_ERROR
from st_codegen.te.compensation.programs import EXPERIMENT_SIGNALS, SIGNALS, SLOW_US
from st_codegen.te.compensation.recorder import KEPT, LIST, SAMPLES
from st_codegen.te.harmonics import Direction

#: What a folder of this command holds beside the curves: the plan that it follows.
PLAN_FILE = "record.json"
#: Decimals of a degree in the files: below what any encoder tells.
_DIGITS = 12
#: A curve must cover so much of a revolution, deg.
_LEAST_SPAN_DEG = 355.0
#: Cycle time of the task that PRG_Experiment and PRG_Record run in.
_CYCLE_S = SLOW_US * 1e-6
#: The inputs of FB_Experiment that an operating point gives, in the order of its numbers.
_OF_POINT = ("fSpeed_rpm", "fTorque_Nm", "fTemperature_C")
_STATES = {code.value: code for code in EXPERIMENT_STATE.all}
_ERRORS = {code.value: code for code in TE_ERROR.all}
_RING = (*(Signal(f"{LIST}.{name}", length=SAMPLES) for name in KEPT), Signal(f"{LIST}.bBackward", "|b1", SAMPLES))


@dataclass(frozen=True)
class PlannedRun:
    """One measurement of the plan and the file it becomes, below the campaign's folder."""

    point: OperatingPoint
    file: str


@dataclass(frozen=True)
class RecordSettings:
    """How measurements are made: samples of a revolution at least, other inputs of PRG_Experiment by name, seconds
    without a word from this client after which the controller stops, seconds between two looks at it."""

    samples: int = 4096
    inputs: Mapping[str, float] = field(default_factory=dict)
    alive_s: float = 5.0
    poll_s: float = 0.005
    #: Seconds for a motion to end after a fault.
    stop_s: float = 120.0


@dataclass(frozen=True)
class RecordedProject:
    """What the manifest says of a project that can record."""

    ratio: float
    fingerprint: int


def recorded_project(folder: Path) -> RecordedProject:
    """Raises GeneratedCodeError for a folder without PRG_Record."""
    manifest = read_manifest(folder)
    if "fingerprint" not in manifest.facts[COMPARISON] or "reduction_ratio" not in manifest.purpose:
        raise GeneratedCodeError(
            f"{folder}: no project that measures; generate a bundle with --with-comparison, which adds PRG_Record"
        )
    return RecordedProject(
        float(manifest.purpose["reduction_ratio"]), int(manifest.facts[COMPARISON]["fingerprint"], 16)
    )


def planned(points: Sequence[OperatingPoint]) -> tuple[PlannedRun, ...]:
    """The runs, the coolest first, since nothing cools the oil; numbered files where conditions repeat."""
    ordered = sorted(points, key=lambda point: point.temperature_C)
    return tuple(PlannedRun(*run) for run in zip(ordered, run_paths(ordered), strict=True))


def open_campaign(folder: Path, runs: Sequence[PlannedRun], how: Mapping[str, float] | None = None) -> list[PlannedRun]:
    """Make or open the campaign's folder; the runs that are still to be made.

    how: what all files of a campaign have in common, by name. Raises InputError for a folder that holds something
    else, another plan, or files that were measured otherwise.
    """
    plan = [[run.file, run.point.speed_rpm, run.point.torque_Nm, run.point.temperature_C] for run in runs]
    path = folder / PLAN_FILE
    text = json.dumps({"runs": plan, "how": dict(how or {})}, indent=1) + "\n"
    if path.is_file():
        try:
            begun = json.loads(path.read_text(encoding="utf-8"))
            known, before = begun["runs"], dict(begun.get("how") or how or {})
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path}: not readable; was it made by st-codegen record?") from None
        if known != plan:
            raise InputError(f"{folder} was begun with another plan: name a new folder, or give the old plan")
        if how is not None and before != how:
            if not any((folder / run.file).is_file() for run in runs):
                write_text(path, text)
                return list(runs)
            changed = sorted(name for name in {*before, *how} if before.get(name) != how.get(name))
            was = ", ".join(f"{name} {before.get(name, 'as the controller has it')}" for name in changed)
            raise InputError(f"{folder} was begun otherwise ({was}): give that again, or name a new folder")
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder} exists and is not empty; name a new folder, or one that record has begun")
    else:
        make_folder(folder)
        write_text(path, text)
    return [run for run in runs if not (folder / run.file).is_file()]


def record(
    controller: Controller,
    project: RecordedProject,
    runs: Sequence[PlannedRun],
    folder: Path,
    recording: RecordSettings = RecordSettings(),
    progress: Progress | None = None,
) -> int:
    """Measure what is still missing in `folder`; the number of runs that were made now.

    Raises ControllerError for a controller that is lost, not in RUN, has another project or another client, and
    MeasurementError where a measurement ends early; the axis is stopped first, or stops by itself where the connection
    is lost. What was finished before stays.
    """
    _check_plan(project, runs, recording)
    how = {"samples": float(recording.samples), "reduction_ratio": project.ratio, **recording.inputs}
    missing = open_campaign(folder, runs, how)
    if len(missing) < len(runs):
        _note_conditions(folder, runs)  # those of the last file may be missing, where a run was killed behind it
    if not missing:
        return 0
    client = MeasuringClient(controller, project, recording)
    client.claim()
    try:
        for number, run in enumerate(missing):
            where = f"{run.file} ({number + 1} of {len(missing)})"

            def told(what: str, number: int = number, where: str = where) -> None:
                if progress is not None:
                    progress(number, len(missing), f"{where}: {what}")

            curves = client.measure(run.point, where, told)
            write_run(Run(run.point, curves), folder / run.file, digits=_DIGITS)
            _note_conditions(folder, runs)
    finally:
        client.release()
    return len(missing)


def _check_plan(project: RecordedProject, runs: Sequence[PlannedRun], recording: RecordSettings) -> None:
    """Raise one InputError for all that FB_Experiment would refuse, if only when its turn has come.

    Those are operating points and settings beyond its limits, and inputs that are no settings; beside them speeds at
    which a revolution has fewer cycles than samples are wanted.
    """
    problems = Problems("record")
    known = experiment.limits()
    own = [name for name in known if name not in _OF_POINT]
    points = (given for run in runs for given in _of_point(run.point).items())
    for name, value in dict.fromkeys([*points, *recording.inputs.items()]):
        if name not in known:
            problems.add(f"{name} is no setting of FB_Experiment{meant(name, own)}; known are {', '.join(own)}")
        elif not known[name][0] <= value <= known[name][1]:
            problems.add(f"{name} {value:.15g}: FB_Experiment takes {known[name][0]:g} .. {known[name][1]:g}")
    slowest = known["fSpeed_rpm"][0]
    for speed in dict.fromkeys(run.point.speed_rpm for run in runs if run.point.speed_rpm >= slowest):
        most = 60.0 * project.ratio / speed / _CYCLE_S
        if most < recording.samples:
            problems.add(
                f"{speed:g} rpm: a revolution has {int(most):,} samples at most, one each cycle of "
                f"{_CYCLE_S * 1e6:g} us, and {recording.samples:,} are wanted: ask for fewer (--samples), or measure "
                "slower"
            )
    problems.raise_if_any()


def _of_point(point: OperatingPoint) -> dict[str, float]:
    """The inputs of FB_Experiment that an operating point gives."""
    return dict(zip(_OF_POINT, astuple(point), strict=True))


def _note_conditions(folder: Path, runs: Sequence[PlannedRun]) -> None:
    """Write the conditions of the numbered files that are there; other files have them in their names."""
    if all(run.file.startswith("Test_") for run in runs):
        return
    there = [(run.file, run.point) for run in runs if (folder / run.file).is_file()]
    rows = [(file, point.speed_rpm, point.torque_Nm, point.temperature_C) for file, point in there]
    write_text(folder / CONDITIONS_FILE, csv_text([("file", *CONDITION_COLUMNS), *rows]))


class MeasuringClient:
    """PRG_Experiment and PRG_Record of a controller."""

    def __init__(self, controller: Controller, project: RecordedProject, recording: RecordSettings) -> None:
        self.controller = controller
        self.project = project
        self.recording = recording
        self._owner = random.randrange(1, 2**31)
        self._alive = 0
        self._is_mine = False
        self._is_stuck = False
        self._found: list[tuple[Signal, Any]] = []

    def claim(self) -> None:
        """Become the client that measures. Raises ControllerError where that is not possible."""
        must_be_of(self.controller, self.project.fingerprint, "the generated one")
        owner, alive = self._numbers("nOwner", "nAlive")
        if owner:
            raise OtherClientError(
                f"{self.controller.address}: another client measures (number {owner}); when it has gone, the "
                "controller forgets it by itself"
            )
        if self.controller.read(_experiment("bBusy", "|b1")):
            raise OtherClientError(f"{self.controller.address}: a measurement is going on that nobody here has started")
        corrects = [Signal(f"{SIGNALS}.{name}", "|b1") for name in ("bEnable", "bActive")]
        if any(self.controller.read_all(corrects)):
            raise CorrectionError(
                f"{self.controller.address}: a measurement is made without correction, and the controller corrects: "
                f"set {corrects[0].name} to FALSE, and wait until {corrects[1].name} is FALSE"
            )
        self._alive = alive
        self._write("fAliveTimeOut_s", self.recording.alive_s, "<f8")
        self._tell_alive()
        self._write("nOwner", self._owner)
        time.sleep(4 * self.recording.poll_s)
        if self._numbers("nOwner")[0] != self._owner:
            raise OtherClientError(f"{self.controller.address}: another client came at the same time")
        self._is_mine = True

    def release(self) -> None:
        """Leave the controller to others, with the axis at rest and the inputs as they were found."""
        if not self._is_mine:
            return
        # each on its own: an input that may not be written keeps nobody from the others, nor the next client waiting
        if not self._is_stuck:
            with contextlib.suppress(ControllerError):
                self._stop()
        try:
            self.controller.write_all(self._found)
        except SilentError:
            return
        except ControllerError:
            for pair in self._found:
                with contextlib.suppress(ControllerError):
                    self.controller.write_all([pair])
        with contextlib.suppress(ControllerError):
            self._write("nOwner", 0)

    def measure(self, point: OperatingPoint, where: str, told: Callable[[str], None]) -> dict[Direction, Curve]:
        """One measurement. Raises ControllerError with its reason and with what is known of the axis.

        That is a MeasurementError where the axis was stopped, and an OtherClientError where it is another client's.
        """
        try:
            return self._measured(point, told)
        except OtherClientError:
            raise
        except (KeyboardInterrupt, ControllerError) as error:
            if failed := self._failed_stop():
                kind = type(error) if isinstance(error, ControllerError) else ControllerError
                kind = ControllerError if kind is MeasurementError else kind
                raise kind(
                    f"{where}: {str(error) or 'interrupted'}; whether the axis stands is not known ({failed}). Without "
                    f"a word from here the controller ends the measurement after {self.recording.alive_s:g} s"
                ) from None
            if isinstance(error, MeasurementError | KeyboardInterrupt):
                text = f"{where}: {str(error) or 'stopped'}; the axis stands, and what was measured before is kept"
                raise type(error)(text) from None
            raise

    def _failed_stop(self) -> str:
        """Bring the axis to rest; why that failed, where it did."""
        try:
            self._stop()
        except ControllerError as error:
            self._is_stuck = True
            return str(error)
        return ""

    def _measured(self, point: OperatingPoint, told: Callable[[str], None]) -> dict[Direction, Curve]:
        every = max(1, int(60.0 * self.project.ratio / point.speed_rpm / _CYCLE_S / self.recording.samples))
        self._write("nEvery", every)
        self._set({_experiment(name): value for name, value in {**_of_point(point), **self.recording.inputs}.items()})
        (before,) = self._numbers("nMeasurement")
        self.controller.write_all([(_experiment("bAbort", "|b1"), False), (_experiment("bStart", "|b1"), True)])
        samples = self._watched(before, told)
        self._end()
        return _curves(samples, self.project.ratio)

    def _set(self, values: Mapping[Signal, float]) -> None:
        """Set inputs, and keep what they were before this client came."""
        new = [signal for signal in values if signal not in {known for known, _ in self._found}]
        if new:
            self._found += zip(new, self.controller.read_all(new), strict=True)
        self.controller.write_all(list(values.items()))

    def _watched(self, before: int, told: Callable[[str], None]) -> list[AnyArray]:
        """The samples of a measurement that has been started, read while it runs."""
        parts: list[list[AnyArray]] = []
        taken, begun, last_state = 0, time.monotonic(), -1
        while True:
            self._tell_alive()
            # in this order, since the controller goes on between requests: what has begun is busy or at its end, and
            # at its end has all its samples
            owner, measurement = self._numbers("nOwner", "nMeasurement")
            state, error, done, busy = self.controller.read_all(
                [
                    *(_experiment(name, "<i4") for name in ("eState", "eError")),
                    *(_experiment(name, "|b1") for name in ("bDone", "bBusy")),
                ]
            )
            (count,) = self._numbers("nSamples")
            if owner not in (0, self._owner):
                self._is_mine = False  # what moves is the other's
                raise OtherClientError(
                    f"{self.controller.address}: another client measures (number {owner}): this one was silent for too "
                    "long. The axis is the other's, and was not stopped; what was measured before is kept"
                )
            if not owner:
                raise MeasurementError("the controller heard nothing from here for too long, and ended it")
            if state != last_state:
                told(_STATES[state].name if state in _STATES else str(state))
                last_state = state
            if error:
                code = _ERRORS.get(error)
                raise MeasurementError(
                    f"ended early, {code.name}: {code.comment}" if code else f"ended early with error {error}"
                )
            started = measurement != before
            if not started and time.monotonic() - begun > self.recording.stop_s:
                must_run(self.controller)
                raise MeasurementError("it does not start; is PRG_Experiment called, and bStart free?")
            if started and count > taken and (done or count - taken >= SAMPLES // 4):
                parts.append(self._ring(taken, count))
                taken = count
            if started and done:
                return [np.concatenate(arrays) for arrays in zip(*parts, strict=True)] if parts else []
            if started and not busy:
                raise MeasurementError("it ended without a result")
            time.sleep(self.recording.poll_s)

    def _ring(self, first: int, end: int) -> list[AnyArray]:
        """Samples `first` to `end`, which must still be there after they were read."""
        arrays = self.controller.read_all(_RING)
        (now,) = self._numbers("nSamples")
        if now - first > SAMPLES:
            raise MeasurementError(
                f"{counted(now - first - SAMPLES, 'sample')} overwritten before they were read: ask for fewer a "
                "revolution"
            )
        places = np.arange(first, end) % SAMPLES
        return [array[places] for array in arrays]

    def _end(self) -> None:
        """Make ready for the next measurement."""
        self.controller.write(_experiment("bStart", "|b1"), False)
        self._wait(lambda: self.controller.read(_experiment("eState", "<i4")) == EXPERIMENT_STATE["IDLE"].value)

    def _stop(self) -> None:
        """Bring the axis to rest, whatever it does."""
        if self.controller.read(_experiment("bBusy", "|b1")):
            self.controller.write(_experiment("bAbort", "|b1"), True)
            self._wait(lambda: not self.controller.read(_experiment("bBusy", "|b1")))
        self._end()
        self.controller.write(_experiment("bAbort", "|b1"), False)

    def _wait(self, holds: Callable[[], bool]) -> None:
        deadline = time.monotonic() + self.recording.stop_s
        while not holds():
            self._tell_alive()
            if time.monotonic() > deadline:
                raise ControllerError(f"{self.controller.address}: the measurement does not end: stop the axis by hand")
            time.sleep(self.recording.poll_s)

    def _tell_alive(self) -> None:
        self._alive = (self._alive + 1) % 1_000_000
        self._write("nAlive", self._alive)

    def _numbers(self, *names: str) -> list[int]:
        return [int(value) for value in self.controller.read_all([Signal(f"{LIST}.{name}", "<i4") for name in names])]

    def _write(self, name: str, value: float, dtype: str = "<i4") -> None:
        self.controller.write(Signal(f"{LIST}.{name}", dtype), value)


def _experiment(name: str, dtype: str = "<f8") -> Signal:
    return Signal(f"{EXPERIMENT_SIGNALS}.{name}", dtype)


def _curves(samples: list[Any], ratio: float) -> dict[Direction, Curve]:
    """The curves of both directions. Raises MeasurementError where they are not whole."""
    if not samples:
        raise MeasurementError("no samples came")
    inner, outer, encoder, _, _, backward = samples
    broken = np.flatnonzero(~np.isfinite(np.array([inner, outer, encoder])).all(axis=0))
    if len(broken):
        raise MeasurementError(
            f"{len(broken):,} of {counted(len(inner), 'sample')} no numbers (NaN or infinite), first sample {broken[0]}"
            ": an encoder or its scaling is at fault"
        )
    found = {}
    for direction, chosen in ((Direction.FORWARD, ~backward), (Direction.BACKWARD, backward)):
        curve = _curve(inner, outer, encoder, chosen, ratio, 360.0 if direction is Direction.BACKWARD else 0.0)
        span = abs(curve.angle_deg[-1] - curve.angle_deg[0]) if len(curve.angle_deg) else 0.0
        if span < _LEAST_SPAN_DEG:
            raise MeasurementError(f"the samples {direction} cover {span:.1f} deg of a revolution")
        if (gap := largest_gap(curve.angle_deg)) > MOST_GAP_DEG:
            raise MeasurementError(
                f"{gap:.1f} deg of the revolution {direction} are without a sample: were samples lost?"
            )
        found[direction] = curve
    return found


def _curve(
    inner: FloatArray, outer: FloatArray, encoder: FloatArray, chosen: BoolArray, ratio: float, begin_deg: float
) -> Curve:
    """Angles of the encoder, from about 0 up or from about 360 down, and the transmission error, deg.

    The error counts from the zero of the homing. Its angle is the encoder's own, since that is what the compensator
    is given: the homing stops near the encoder's zero, not on it.
    """
    angle = np.degrees(encoder[chosen])
    te = np.degrees(outer[chosen] - inner[chosen] / ratio)
    if len(angle):
        angle = angle - 360.0 * np.round((angle[0] - begin_deg) / 360.0)
    return Curve(angle, te)
