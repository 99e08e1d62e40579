"""The live comparison: rows of inputs to a controller, its answers against the library within the derived bound."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.emit.blocks.comparison import LIST
from st_codegen.emit.output import COMPARISON, read_manifest
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import GeneratedCodeError, InputError
from st_codegen.ir import AnyArray, BoolArray, FloatArray
from st_codegen.live.controller import Controller, ControllerError, Signal, must_run
from st_codegen.live.rows import ChosenRows, comparison_rows
from st_codegen.project.bundle import Bundle
from st_codegen.proof.isolated import isolated
from st_codegen.proof.runner import BlockResult, GeneratedCode, target_folders
from st_codegen.proof.verify import ModelReport, model_report

#: Called with (rows done, rows, block).
Progress = Callable[[int, int, str], None]
#: Of the times of a block, the one that is given: higher ones are those of calls that another task interrupted.
_QUANTILE = 0.99
#: Cycles of a request at most: the first ones have few rows, until their times are known.
_CYCLES = 10


@dataclass(frozen=True)
class ComparedProject:
    """What the manifest says of the program that runs rows: fingerprint, rows of a request, blocks by name."""

    folder: Path
    fingerprint: int
    rows: int
    blocks: dict[str, dict[str, Any]]
    models: dict[str, dict[str, Any]]
    #: inputs and outputs of the widest block, for which the arrays have room
    widest: tuple[int, int]


@dataclass
class BlockTimes:
    """Times of a block's calls on the controller, us: their median, and the quantile of which `calibrate` is told."""

    calls: int
    median_us: float
    high_us: float


@dataclass
class LiveReport:
    """What was compared with what, model by model, and how long the calls took.

    `rows` has, by block, the rows, and of how many leaves and splits in all how many have rows of their own. `differs`
    counts, by model, the rows on which the controller's bits are not those of the text run here, which is no failure as
    long as the library's bound holds.
    """

    address: str
    state: str
    fingerprint: str
    generated: str
    models: list[ModelReport] = field(default_factory=list)
    rows: dict[str, tuple[int, int, int]] = field(default_factory=dict)
    differs: dict[str, int] = field(default_factory=dict)
    times: dict[str, BlockTimes] = field(default_factory=dict)
    seconds: float = 0.0
    sent: int = 0
    at: str = ""
    #: rows of each failure, by model
    failed_rows: dict[str, list[int]] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether every model agrees."""
        return all(model.passed for model in self.models)

    @property
    def rows_a_second(self) -> float:
        """Rows that went to the controller and back."""
        return self.sent / self.seconds if self.seconds else 0.0

    def failures(self) -> list[tuple[str, str]]:
        """The model, and what is wrong on which row."""
        found = []
        for model in self.models:
            if model.refusal is not None:
                found.append((model.name, model.refusal))
            numbers = self.failed_rows.get(model.name, [])
            for failure, number in zip(model.failures, numbers, strict=True):
                found.append(
                    (
                        model.name,
                        f"row {number}: {failure.between} differ at {list(failure.input)}: {list(failure.expected)} "
                        f"and {list(failure.got)}, allowed {failure.bound:g}",
                    )
                )
        return found

    def remarks(self) -> list[str]:
        """What the comparison covers, what it does not, and how quick it was."""
        lines = []
        for name, (rows, tried, constants) in self.rows.items():
            if constants:
                share = f"all {constants:,}" if tried == constants else f"{tried:,} of {constants:,}"
                lines.append(f"{name}: {rows:,} rows, with rows of their own for {share} leaves and splits")
            else:
                lines.append(f"{name}: {rows:,} rows")
        for name, count in self.differs.items():
            if count:
                lines.append(
                    f"{name}: on {count:,} rows the controller's bits are not those of the same text run here: a "
                    "constant was changed, or its compiler or its EXP, LN, SIN .. are other ones"
                )
        for name, found in self.times.items():
            lines.append(f"{name}: median {found.median_us:.1f} us a call, 99 % below {found.high_us:.1f} us")
        lines.append(f"{self.sent:,} rows in {self.seconds:.1f} s: {self.rows_a_second:,.0f} rows a second")
        return lines


def generated_folder(generated: Path) -> Path:
    """The folder of the target that has the program for rows. Raises GeneratedCodeError where there is none."""
    folders = target_folders(generated)
    for folder in folders:
        if TARGETS[folder.name].has_comparison:
            return folder
    able = ", ".join(name for name, target in TARGETS.items() if target.has_comparison)
    raise GeneratedCodeError(f"{generated}: no project for {able}, which a controller could compare")


def compared_project(folder: Path, bundle: Bundle, block: str | None) -> ComparedProject:
    """The project as its manifest has it.

    Raises GeneratedCodeError where it was generated without the program, or from other models, and InputError for an
    unknown block.
    """
    manifest = read_manifest(folder)
    facts = {} if manifest is None else manifest.facts[COMPARISON]
    if manifest is None or not facts:
        raise GeneratedCodeError(f"{folder}: generated without --with-comparison, so that nothing there takes rows")
    models = manifest.facts["models"]
    changed = [ir.name for ir in bundle.irs if models.get(ir.name, {}).get("digest") != ir.source.digest]
    if changed:
        raise GeneratedCodeError(
            f"{folder}: generated from other models than these ({', '.join(changed)} differ): generate and download "
            "again"
        )
    blocks = facts["blocks"]
    widest = (
        max((len(entry["inputs"]) for entry in blocks.values()), default=1),
        max((len(entry["outputs"]) for entry in blocks.values()), default=1),
    )
    if block is not None:
        chosen = {name: entry for name, entry in blocks.items() if name.upper() == block.upper()}
        if not chosen:
            raise InputError(f"no block {block} is compared; there are {', '.join(blocks)}")
        blocks = chosen
    return ComparedProject(folder, int(facts["fingerprint"], 16), int(facts["rows"]), blocks, models, widest)


class LiveCode:
    """The blocks of a project on a controller, as `GeneratedCode` is those of the files."""

    def __init__(self, controller: Controller, project: ComparedProject, progress: Progress | None = None) -> None:
        self.folder = project.folder
        self.controller = controller
        self.project = project
        self.seconds = 0.0
        self.sent = 0
        self.times: dict[str, list[AnyArray]] = {}
        self._progress = progress
        self._request = random.randrange(1, 2**30)
        self._per_cycle = 1
        self._known: dict[str, tuple[FloatArray, FloatArray, BoolArray]] = {}
        self._inputs, self._outputs = project.widest

    def check(self) -> str:
        """The state. Raises ControllerError for a controller that does not run this very project."""
        must_run(self.controller)
        found = int(self.controller.read(Signal(f"{LIST}.nFingerprint", "<u8")))
        if found != self.project.fingerprint:
            raise ControllerError(
                f"{self.controller.address}: the project there has the fingerprint {found:016x}, that in "
                f"{self.folder} has {self.project.fingerprint:016x}: download it, or name the folder that is running"
            )
        return self.controller.state()

    def run_model(self, block: str, x: FloatArray, outputs: Sequence[int]) -> BlockResult:
        """Call a block on the controller once for each row."""
        if block not in self._known or self._known[block][0] is not x:
            self._known[block] = (x, *self._run(block, x))
        _, values, valid = self._known[block]
        return BlockResult(values[:, list(outputs)], valid)

    def _run(self, block: str, x: FloatArray) -> tuple[FloatArray, BoolArray]:
        entry = self.project.blocks[block]
        values, valid = np.zeros((len(x), len(entry["outputs"]))), np.zeros(len(x), np.bool_)
        begin, done = time.monotonic(), 0
        while done < len(x):
            part = x[done : done + min(self.project.rows, _CYCLES * self._per_cycle)]
            values[done : done + len(part)], valid[done : done + len(part)], times = self._batch(entry, part)
            self.times.setdefault(block, []).append(times)
            done += len(part)
            if self._progress is not None:
                self._progress(done, len(x), block)
        self.seconds += time.monotonic() - begin
        self.sent += len(x)
        return values, valid

    def _batch(self, entry: dict[str, Any], x: FloatArray) -> tuple[FloatArray, BoolArray, AnyArray]:
        given = np.zeros(self.project.rows * self._inputs)
        given[: x.size] = x.ravel()
        self._request = self._request % (2**31 - 2) + 1
        numbers = {"nBlock": entry["number"], "nRows": len(x), "nPerCycle": self._per_cycle, "nRequest": self._request}
        self.controller.write_all(
            [
                (Signal(f"{LIST}.fInputs", length=len(given)), given),
                *((_number(name), value) for name, value in numbers.items()),
            ]
        )
        values, valid, times = self._answer(len(x))
        outputs = len(entry["outputs"])
        self._adapt(times)
        return values[: len(x) * outputs].reshape(len(x), outputs), valid[: len(x)], times[: len(x)]

    def _answer(self, rows: int) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Wait until the rows are done; a controller that takes ten seconds longer than it should does none."""
        most = self.project.rows
        signals = [
            *(_number("nRequest"), _number("nAnswer"), Signal(f"{LIST}.fOutputs", length=most * self._outputs)),
            *(Signal(f"{LIST}.bValid", "|b1", most), Signal(f"{LIST}.nTime", "<u4", most)),
        ]
        deadline = time.monotonic() + 10.0 + rows / self._per_cycle * 0.02
        while True:
            request, answer, values, valid, times = self.controller.read_all(signals)
            if request != self._request:
                raise ControllerError(f"{self.controller.address}: another client compares at the same time")
            if answer == self._request:
                return values, valid, times
            if time.monotonic() > deadline:
                must_run(self.controller)
                raise ControllerError(
                    f"{self.controller.address}: the rows are not done in time; is ComparisonTask started?"
                )
            time.sleep(0.001)

    def _adapt(self, times: AnyArray) -> None:
        """So many rows in a cycle that they take less than half of the task's 10 ms."""
        longest_us = max(float(np.max(times)) / 10.0, 5.0)
        self._per_cycle = int(np.clip(5000.0 / longest_us, 1, min(self.project.rows, 4 * self._per_cycle)))


def _number(name: str) -> Signal:
    return Signal(f"{LIST}.{name}", "<i4")


def compare(
    bundle: Bundle,
    folder: Path,
    connect: Callable[[], Controller],
    *,
    rows: int = 10_000,
    seed: int = 0,
    block: str | None = None,
    progress: Progress | None = None,
) -> LiveReport:
    """Run at least `rows` rows through each block of models on the controller and compare with the library.

    Rows are those of `rows.comparison_rows`. `connect` makes the connection; it is asked after the libraries have their
    process (`proof.isolated`), since a copy of a process with a connection would share it. Raises
    ControllerError where the controller is not in RUN, has another
    project, or is lost on the way.
    """
    project = compared_project(folder, bundle, block)
    text = GeneratedCode(folder, TARGETS[folder.name].dialect)
    with isolated(bundle.models) as models, connect() as controller:
        live = LiveCode(controller, project, progress)
        report = LiveReport(controller.address, live.check(), f"{project.fingerprint:016x}", str(folder))
        report.at = datetime.now(UTC).isoformat(timespec="seconds")
        for name in project.blocks:
            own = [model for model in models if project.models[model.ir.name]["block"] == name]
            if not own:
                continue
            chosen: ChosenRows = comparison_rows([model.ir for model in own], rows, seed)
            report.rows[name] = (len(chosen.x), chosen.reached, chosen.constants)
            for model in own:
                found = model_report(model, chosen.x, {"controller": live})
                report.models.append(found)
                report.failed_rows[found.name] = [_row_of(failure.input, chosen.x) for failure in found.failures]
            outputs = range(len(project.blocks[name]["outputs"]))
            _note_bits(report, own, project, live.run_model(name, chosen.x, outputs), text, chosen.x)
            report.times[name] = _times(live.times[name])
        live.check()  # the same project to the end
    report.seconds, report.sent = live.seconds, live.sent
    return report


def _row_of(given: tuple[float, ...], x: FloatArray) -> int:
    """The number of a row, by its bits."""
    bits = np.array([given]).view(np.int64)
    return int(np.flatnonzero((x.view(np.int64) == bits).all(axis=1))[0])


def _times(parts: Sequence[AnyArray]) -> BlockTimes:
    times = np.concatenate(parts).astype(np.float64) / 10.0
    return BlockTimes(len(times), float(np.median(times)), float(np.quantile(times, _QUANTILE)))


def _note_bits(
    report: LiveReport,
    models: Sequence[Any],
    project: ComparedProject,
    got: BlockResult,
    text: GeneratedCode,
    x: FloatArray,
) -> None:
    """Where the controller's bits are not those of the text, run here."""
    block = project.models[models[0].ir.name]["block"]
    here = text.run_model(block, x, range(got.values.shape[1]))
    both = got.valid & here.valid
    for model in models:
        outputs = project.models[model.ir.name]["block_outputs"]
        same = got.values[:, outputs].view(np.int64) == here.values[:, outputs].view(np.int64)
        report.differs[model.ir.name] = int(np.sum(~same.all(axis=1) & both) + np.sum(got.valid != here.valid))
