"""The live comparison: rows of inputs to a controller, its answers against the library within the derived bound."""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.emit.blocks.comparison import COMPARISON_TASK, LIST
from st_codegen.emit.output import COMPARISON, read_manifest
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import GeneratedCodeError, InputError
from st_codegen.ir import AnyArray, BoolArray, FloatArray
from st_codegen.live.controller import Controller, Signal, must_be_of, must_run
from st_codegen.live.failures import OtherClientError, SilentError
from st_codegen.live.live_report import BlockTimes, LiveReport, OtherBits
from st_codegen.live.rows import ChosenRows, comparison_rows
from st_codegen.processes import Progress
from st_codegen.project.bundle import Bundle
from st_codegen.proof.agreement import block_report, model_report
from st_codegen.proof.arithmetic import arithmetic_of
from st_codegen.proof.isolated import isolated
from st_codegen.proof.runner import BlockResult, GeneratedCode, target_folders
from st_codegen.st import Project
from st_codegen.st.check.flow import all_reached
from st_codegen.st.tree import StandardCall
from st_codegen.st.walk import all_expressions

#: Of the times of a block, the one that is given: higher ones are those of calls that another task interrupted.
_QUANTILE = 0.99
#: Functions of which no standard says the last bit; that of SQRT is said.
_OPEN_FUNCTIONS = {"EXP", "LN", "LOG", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "EXPT"}
#: Seconds of waiting after which it is asked whether the controller still runs.
_LOOK_S = 0.5
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
    #: how long the arrays of inputs and outputs are
    lengths: tuple[int, int]


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
    facts = manifest.facts[COMPARISON]
    if not {"fingerprint", "rows", "lengths", "blocks"} <= facts.keys():
        raise GeneratedCodeError(
            f"{folder}: generated without --with-comparison, or by an older version, so that nothing there takes rows"
        )
    models = manifest.facts["models"]
    changed = [ir.name for ir in bundle.irs if models.get(ir.name, {}).get("digest") != ir.source.digest]
    if changed:
        raise GeneratedCodeError(
            f"{folder}: generated from other models than these ({', '.join(changed)}): generate and download again"
        )
    blocks = facts["blocks"]
    if block is not None:
        chosen = {name: entry for name, entry in blocks.items() if name.upper() == block.upper()}
        if not chosen:
            raise InputError(f"no block {block} is compared; there are {', '.join(blocks)}")
        blocks = chosen
    inputs, outputs = facts["lengths"]
    return ComparedProject(folder, int(facts["fingerprint"], 16), int(facts["rows"]), blocks, models, (inputs, outputs))


class LiveCode:
    """The blocks of a project on a controller, as `GeneratedCode` is those of the files."""

    def __init__(self, controller: Controller, project: ComparedProject, progress: Progress | None = None) -> None:
        self.folder = project.folder
        self.controller = controller
        self.project = project
        self.seconds = 0.0
        self.sent = 0
        self.times: dict[str, list[AnyArray]] = {}
        #: by block around models: inputs, rows, calls, and the answers
        self.called: dict[str, tuple[dict[str, FloatArray], int, int, FloatArray, BoolArray]] = {}
        self._progress = progress
        self._request = random.randrange(1, 2**30)
        self._per_cycle = 1
        self._known: dict[str, tuple[FloatArray, FloatArray, BoolArray]] = {}

    def check(self) -> str:
        """The state. Raises ControllerError for a controller that does not run this very project."""
        must_be_of(self.controller, self.project.fingerprint, f"that in {self.folder}")
        return self.controller.state()

    def run_model(self, block: str, x: FloatArray, outputs: Sequence[int]) -> BlockResult:
        """Call a block on the controller once for each row."""
        if block not in self._known or self._known[block][0] is not x:
            self._known[block] = (x, *self._run(block, x))
        _, values, valid = self._known[block]
        return BlockResult(values[:, list(outputs)], valid)

    def call(self, block: str, inputs: Mapping[str, FloatArray], rows: int, *, calls: int = 1) -> dict[str, FloatArray]:
        """Run rows through a block around models; its program calls it often enough and sets what is fixed."""
        entry = self.project.blocks[block]
        x = np.column_stack([inputs[name] for name in entry["inputs"]])
        values, valid = self._run(block, x)
        self.called[block] = (dict(inputs), rows, calls, values, valid)
        return {**_by_variable(entry["outputs"], values), "bValid": valid.astype(np.float64)}

    def _run(self, block: str, x: FloatArray) -> tuple[FloatArray, BoolArray]:
        entry = self.project.blocks[block]
        values, valid = np.zeros((len(x), len(entry["outputs"]))), np.zeros(len(x), np.bool_)
        most = entry.get("rows", self.project.rows)
        begin, done = time.monotonic(), 0
        while done < len(x):
            part = x[done : done + min(most, _CYCLES * self._per_cycle)]
            values[done : done + len(part)], valid[done : done + len(part)], times = self._batch(entry, part)
            self.times.setdefault(block, []).append(times)
            done += len(part)
            if self._progress is not None:
                self._progress(done, len(x), block)
        self.seconds += time.monotonic() - begin
        self.sent += len(x)
        return values, valid

    def _batch(self, entry: dict[str, Any], x: FloatArray) -> tuple[FloatArray, BoolArray, AnyArray]:
        given = np.zeros(self.project.lengths[0])
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
        values, valid, times = values[: len(x) * len(entry["outputs"])], valid[: len(x)], times[: len(x)]
        self._adapt(times)
        return values.reshape(len(x), -1), valid, times

    def _answer(self, rows: int) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Wait until the rows are done, for twice their cycles and two answers, or ten seconds, beyond it none are."""
        most = self.project.rows
        signals = [
            *(_number("nRequest"), _number("nAnswer"), Signal(f"{LIST}.fOutputs", length=self.project.lengths[1])),
            *(Signal(f"{LIST}.bValid", "|b1", most), Signal(f"{LIST}.nTime", "<u4", most)),
        ]
        begun = looked = time.monotonic()
        deadline = (
            begun + max(10.0, 2 * self.controller.timeout_s) + rows / self._per_cycle * 2e-6 * COMPARISON_TASK.cycle_us
        )
        while True:
            request, answer, values, valid, times = self.controller.read_all(signals)
            if request != self._request:
                raise OtherClientError(f"{self.controller.address}: another client compares at the same time")
            if answer == self._request:
                return values, valid, times
            now = time.monotonic()
            if now > looked + _LOOK_S:
                must_run(self.controller)
                looked = now
            if now > deadline:
                raise SilentError(
                    f"{self.controller.address}: the rows are not done in time; is ComparisonTask started?"
                )
            time.sleep(0.001)

    def _adapt(self, times: AnyArray) -> None:
        """So many rows in a cycle that they take half of the task's time, by what the last request took as a whole.

        The longest call says nothing: another task may have interrupted it.
        """
        mean_us = max(float(np.mean(times)) / 10.0, 5.0)
        self._per_cycle = int(
            np.clip(COMPARISON_TASK.cycle_us / 2 / mean_us, 1, min(self.project.rows, 4 * self._per_cycle))
        )


def _by_variable(names: Sequence[str], values: FloatArray) -> dict[str, FloatArray]:
    """Columns by the variable that they belong to; those of an array's elements side by side, as `names` has them."""
    found: dict[str, list[int]] = {}
    for column, name in enumerate(names):
        found.setdefault(name.partition("[")[0], []).append(column)
    return {
        name: values[:, columns] if f"{name}[0]" in names else values[:, columns[0]] for name, columns in found.items()
    }


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

    Rows are those of `rows.comparison_rows`; blocks around models (`Purpose.checks`) have as many as `verify` tries.
    `connect` makes the connection; it is asked after the libraries have their process (`proof.isolated`), since a copy
    of a process with a connection would share it. Raises ControllerError where the controller is not in RUN, has
    another project, or is lost on the way.
    """
    project = compared_project(folder, bundle, block)
    text = GeneratedCode(folder)
    with isolated(bundle.models) as models, connect() as controller:
        live = LiveCode(controller, project, progress)
        report = LiveReport(controller.address, live.check(), f"{project.fingerprint:016x}", str(folder))
        report.at = datetime.now(UTC).isoformat(timespec="seconds")
        report.device = controller.device
        for name in project.blocks:
            own = [model for model in models if project.models[model.ir.name]["block"] == name]
            if not own:
                continue
            chosen: ChosenRows = comparison_rows([model.ir for model in own], rows, seed)
            report.rows[name] = (len(chosen.x), chosen.reached, chosen.constants)
            if any(project.models[model.ir.name].get("layout") == "table" for model in own):
                report.untried_cells[name] = chosen.untried_cells
            for model in own:
                found = model_report(model, chosen.x, {"controller": live})
                report.models.append(found)
                report.failed_rows[found.name] = [_row_of(failure.input, chosen.x) for failure in found.failures]
            outputs = range(len(project.blocks[name]["outputs"]))
            there, here = live.run_model(name, chosen.x, outputs), text.run_model(name, chosen.x, outputs)
            for model in own:
                columns = project.models[model.ir.name]["block_outputs"]
                _note_bits(
                    *(report, model.ir.name, text, name, chosen.x),
                    *(BlockResult(result.values[:, columns], result.valid) for result in (there, here)),
                )
        if bundle.purpose is not None:
            _compare_around(report, bundle, live, text, seed)
        report.times = {
            # the time of a row that takes several calls is not that of a call
            name: _times(parts)
            for name, parts in live.times.items()
            if "calls" not in project.blocks[name]
        }
        live.check()  # the same project to the end
    report.seconds, report.sent = live.seconds, live.sent
    return report


def _row_of(given: tuple[float, ...], x: FloatArray) -> int:
    """The number of a row, by its bits."""
    bits = np.array([given]).view(np.int64)
    return int(np.flatnonzero((x.view(np.int64) == bits).all(axis=1))[0])


def _times(parts: Sequence[AnyArray]) -> BlockTimes:
    times = np.concatenate(parts).astype(np.float64) / 10.0
    return BlockTimes(len(times), float(np.median(times)), float(np.quantile(times, _QUANTILE, method="inverted_cdf")))


def _compare_around(report: LiveReport, bundle: Bundle, live: LiveCode, text: GeneratedCode, seed: int) -> None:
    """The blocks around the models against the models that they are made of."""
    assert bundle.purpose is not None
    names = [block.name for block in bundle.purpose.called_blocks() if block.name in live.project.blocks]
    if not names:
        return
    bound = arithmetic_of(text.folder.name).bound
    for check in bundle.purpose.checks(bundle.irs, live, seed, bound, names):
        found = block_report(check, "controller")
        report.models.append(found)
        report.rows[check.block] = (len(check.inputs), 0, 0)
        report.failed_rows[found.name] = [_row_of(failure.input, check.inputs) for failure in found.failures]
        inputs, rows, calls, values, valid = live.called[check.block]
        answers = text.call(check.block, inputs, rows, calls=calls)
        names_of = live.project.blocks[check.block]["outputs"]
        here = np.column_stack([answers[name] for name in _by_variable(names_of, values)])
        _note_bits(
            *(report, check.block, text, check.block, check.inputs),
            *(BlockResult(values, valid), BlockResult(here, answers["bValid"].astype(np.bool_))),
        )


def _note_bits(
    report: LiveReport,
    name: str,
    text: GeneratedCode,
    block: str,
    x: FloatArray,
    there: BlockResult,
    here: BlockResult,
) -> None:
    """Where the controller's bits are not those of the text, run here; what is not valid has no bits."""
    same = (there.values.view(np.int64) == here.values.view(np.int64)).all(axis=1)
    other = np.flatnonzero(np.where(there.valid & here.valid, ~same, there.valid != here.valid))
    if len(other):
        inputs = tuple(map(float, x[other[0]]))
        report.differs[name] = OtherBits(len(other), int(other[0]), inputs, leaves_bits_open(text.project, block))


def leaves_bits_open(project: Project, block: str) -> bool:
    """Whether a block, or one that it calls, calls a function whose result may differ between controllers by an ulp."""
    bodies = (project.pous[key].body for key in all_reached(project, block.upper()))
    parts = (part for body in bodies for part in all_expressions(body))
    return any(isinstance(part, StandardCall) and part.function in _OPEN_FUNCTIONS for part in parts)
