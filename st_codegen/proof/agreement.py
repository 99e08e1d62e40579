"""Answers held against each other, row by row: of the library, of the reference, and of what runs the text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from st_codegen.emit.blocks.model import refused_where
from st_codegen.emit.output import block_of
from st_codegen.ir import BoolArray, FloatArray, IntArray, ModelIR, TreeEnsemble, reference
from st_codegen.ir.arrays import to_order
from st_codegen.passes.jumps import inexact_columns, largest_jump, unsure_columns
from st_codegen.project.purpose import BlockCheck
from st_codegen.proof import bounds
from st_codegen.proof.arithmetic import arithmetic_of
from st_codegen.proof.isolated import LibraryRefusesError, answers_to
from st_codegen.proof.probes import RangeSource, operating_range, range_source
from st_codegen.proof.runner import BlockResult
from st_codegen.proof.verify_report import Disagreement, ModelReport, OpenRow
from st_codegen.walkers.base import LoadedModel

#: How often a library is asked about rows that the block refuses.
_ASKED = 48


class RunsModels(Protocol):
    """What computes a model by generated text: the engine here, or a controller."""

    folder: Path

    def run_model(self, block: str, x: FloatArray, outputs: Sequence[int]) -> BlockResult:
        """Call a model's block once for each row of `x` (see `GeneratedCode.run_model`)."""


@dataclass(frozen=True)
class _Answers:
    """What is known of rows `x` before any text runs, of which the model takes the `limited` numbers.

    `usable`: the reference has an answer, `expected`; `bound`: how far the library's may lie from it. `inside`: usable,
    and in the operating range. `sizes`: the outputs that have a size, which the number of a class has not.
    """

    model: ModelIR
    x: FloatArray
    limited: FloatArray
    expected: FloatArray
    library: FloatArray
    usable: BoolArray
    inside: BoolArray
    bound: FloatArray

    @property
    def sizes(self) -> slice:
        return slice(0 if self.model.classes is None else 1, None)


def model_report(
    model: LoadedModel, x: FloatArray, targets: Mapping[str, RunsModels], *, proof: str = ""
) -> ModelReport:
    """Compare the library, the reference and what runs the text, by the name it has in the report, row by row."""
    ir = model.ir
    blocks = {name: block_of(code.folder, ir) for name, code in targets.items()}
    expected, limited = reference.evaluate(ir, x), reference.limited(ir, x)
    usable = np.all(np.isfinite(expected), axis=1)
    report = ModelReport(ir.name, n=len(x), proof=proof, must_be_exact=ir.exact)
    report.guessed = [feature.name for feature in ir.features if range_source(feature) is RangeSource.GUESS]
    library = np.full_like(expected, np.nan)
    try:
        library[usable] = model.predict(limited[usable])
    except LibraryRefusesError as refusal:
        report.refusal, report.exact, report.targets, report.n = str(refusal), False, list(targets), 0
        return report
    lower, upper = operating_range(ir)
    inside = np.all((x >= lower) & (x <= upper), axis=1)
    report.refused, report.unanswered = int(np.sum(~usable)), int(np.sum(inside & ~usable))
    report.nothing_compared = not np.any(usable)
    report.none_inside = report.unanswered > 0 and not np.any(inside & usable)
    report.refused_where = refused_where(ir) or "the magnitude of an input is too large"
    _ask_to_refused(report, model, limited, ~usable & np.all(np.isfinite(limited), axis=1), inside)
    bound = np.where(usable[:, None], bounds.difference_bound(ir, limited), 0.0)
    answers = _Answers(ir, x, limited, expected, library, usable, inside & usable, bound)
    _hold_library(report, answers)
    for name, code in targets.items():
        block, outputs = blocks[name]
        _hold_text(report, answers, name, code.folder.name, code.run_model(block, x, outputs))
    return report


def _hold_library(report: ModelReport, answers: _Answers) -> None:
    """Note how library and reference agree, and what the bound leaves open between them."""
    model, bound, inside = answers.model, answers.bound, answers.inside
    _note_open_rows(report, answers)
    report.unbounded = int(np.sum(~np.all(np.isfinite(bound), axis=1)))
    near = bound[inside, answers.sizes]
    report.bound = float(np.max(near[np.isfinite(near)], initial=0.0))
    report.vague = _vague(answers.expected[inside, answers.sizes], near)
    report.jump = largest_jump(model)
    if report.jump:
        report.jump_width = _jump_width(model, answers.limited[inside])
    _compare(report, "library and reference", answers.x, answers.library, answers.expected, bound)


def _hold_text(report: ModelReport, answers: _Answers, name: str, target: str, result: BlockResult) -> None:
    """Note how far what the text of a target computed agrees with reference and library."""
    model, library, sizes, arithmetic = answers.model, answers.library, answers.sizes, arithmetic_of(target)
    report.targets.append(name)
    got = np.where(result.valid[:, None], result.values, np.nan)
    answered = answers.usable & arithmetic.answers(model, answers.limited)
    same = arithmetic.bound is bounds.text_bound and not model.is_real  # and need not be derived once more
    allowed = np.where(answered[:, None], answers.bound if same else arithmetic.bound(model, answers.limited), 0.0)
    report.must_be_exact &= not np.any(allowed)
    near = allowed[answers.inside & np.isfinite(allowed).all(axis=1), sizes]
    report.bound = max(report.bound, float(np.max(near, initial=0.0)))
    report.vague = max(report.vague, _vague(answers.expected[answers.inside, sizes], allowed[answers.inside, sizes]))
    wanted = np.where(answered[:, None], answers.expected, np.nan)
    _compare(report, f"reference and {name}", answers.x, wanted, got, allowed)
    report.exact &= not np.any(library[answered] != got[answered])
    report.zero_signs = max(report.zero_signs, _other_zeros(library[answered], got[answered]))
    rows = answers.inside & answered & result.valid
    _measure(report, answers.x, library[:, sizes], got[:, sizes], rows, is_real=model.is_real)


def _ask_to_refused(
    report: ModelReport, model: LoadedModel, x: FloatArray, refused: BoolArray, inside: BoolArray
) -> None:
    """Note to how many of the rows that the block refuses the library has an answer."""
    answers, asked = np.full((len(x), len(model.ir.outputs)), np.nan), np.zeros(len(x), np.bool_)
    rows = np.flatnonzero(refused)
    rows = rows[np.argsort(inside[rows], kind="stable")]  # the last ones are asked first
    answers[rows], asked[rows] = answers_to(model, x[rows], _ASKED)
    answered = asked & np.isfinite(answers).all(axis=1)
    report.asked, report.silent = int(np.sum(asked & inside)), int(np.sum(answered & inside))
    outside = (refused & ~inside, asked & ~inside, answered & ~inside)
    report.refused_outside, report.asked_outside, report.silent_outside = map(int, map(np.sum, outside))
    if report.silent:
        first = int(np.argmax(answered & inside))
        report.silent_example = x[first].tolist(), answers[first].tolist()


def _vague(values: FloatArray, bound: FloatArray) -> int:
    """Rows on which the bound of an output, (n, outputs), is finite and larger than all that it spans on these.

    One that is the same on all rows is held against its size.
    """
    if not len(values):
        return 0
    spans = np.ptp(values, axis=0)
    sizes = np.where(spans > 0.0, spans, np.abs(values[0]))
    return int(np.sum(((bound > sizes) & np.isfinite(bound)).any(axis=1)))


def _jump_width(model: ModelIR, x: FloatArray) -> float:
    """How far the numbers that trees compare behind inexact operations may lie from the library's, on some rows."""
    found, inexact = bounds.differences(model, x), inexact_columns(model)
    width = 0.0
    for op in model.ops:
        if isinstance(op, TreeEnsemble):
            given = np.hstack([found[value] for value in op.inputs])
            columns = [op.columns[number].column for number in unsure_columns(op, inexact)]
            width = max(width, float(np.max(given[:, columns], initial=0.0)))
    return width


def _note_open_rows(report: ModelReport, answers: _Answers) -> None:
    """Note the rows of a classifier whose label the bound leaves open, and the first of them."""
    if answers.model.classes is None:
        return
    x, library, expected = answers.x, answers.library, answers.expected
    rows = np.flatnonzero((answers.bound[:, 0] > 0) & np.isfinite(library[:, 0]))
    report.open_rows = len(rows)
    labels = answers.model.classes.labels
    report.open_examples = [
        OpenRow(tuple(map(float, x[row])), labels[int(library[row, 0])], labels[int(expected[row, 0])])
        for row in rows[:3]
    ]


def _compare(
    report: ModelReport, between: str, x: FloatArray, expected: FloatArray, got: FloatArray, bound: FloatArray
) -> None:
    """Note the first rows on which two answers differ by more than the bound, or only one of them is an answer."""
    same = (expected == got) | (np.isnan(expected) & np.isnan(got))
    with np.errstate(invalid="ignore"):
        near = (np.abs(expected - got) <= bound) | np.isinf(bound)
    differs = ~(same | near)
    for row in np.flatnonzero(differs.any(axis=1))[:3]:
        report.failures.append(
            Disagreement(
                between,
                tuple(map(float, x[row])),
                tuple(map(float, expected[row])),
                tuple(map(float, got[row])),
                float(np.max(bound[row, differs[row]])),
            )
        )


def _other_zeros(expected: FloatArray, got: FloatArray) -> int:
    """Rows with a zero on both sides whose signs differ: equal numbers, of which a division by them would tell."""
    differ = (expected == 0.0) & (got == 0.0) & (np.signbit(expected) != np.signbit(got))
    return int(differ.any(axis=1).sum())


def _measure(
    report: ModelReport, x: FloatArray, library: FloatArray, got: FloatArray, rows: BoolArray, *, is_real: bool = False
) -> None:
    """Largest error of the emitted text against the library on some rows."""
    if not rows.any() or not library.shape[1]:
        return
    error = np.max(np.abs(library[rows] - got[rows]), axis=1)
    worst = int(np.argmax(error))
    report.max_ulp = max(report.max_ulp, int(np.max(ulps_between(library[rows], got[rows], single=is_real))))
    if report.worst_input is None or error[worst] > report.max_abs_err:
        report.worst_input = [float(value) for value in x[rows][worst]]
    report.max_abs_err = max(report.max_abs_err, float(error[worst]))


def ulps_between(a: FloatArray, b: FloatArray, *, single: bool = False) -> IntArray:
    """How many representable numbers lie from `a` to `b`; 0 for equal numbers, +0 and -0 included.

    Counts float32 numbers when all of `a` are such or `single` says so, else float64 numbers. Distances from 2**62 on
    are given as 2**62.
    """
    with np.errstate(over="ignore"):
        single = single or np.array_equal(a, a.astype(np.float32))
    first, second = (to_order(value.astype(np.float32) if single else value) for value in (a, b))
    near = np.abs(first.astype(np.float64) - second.astype(np.float64)) < 2.0**62
    distance = np.abs(np.where(near, first, 0) - np.where(near, second, 0))
    return np.where(near, distance, np.int64(2**62))


def block_report(check: BlockCheck, target: str) -> ModelReport:
    """A block around the models against the models that it is made of."""
    # what the models refuse has no bound, and needs none
    limits = np.where(np.isnan(check.expected), 0.0, check.bound)
    known = np.isfinite(limits)
    bound = float(np.max(limits[known], initial=0.0))
    report = ModelReport(check.block, n=len(check.inputs), bound=bound, targets=[target])
    report.must_be_exact, report.unbounded = not np.any(limits), int(np.sum(~known.all(axis=1)))
    _compare(report, f"models and {target}", check.inputs, check.expected, check.got, check.bound)
    answered = np.all(np.isfinite(check.expected) & np.isfinite(check.got), axis=1)
    report.nothing_compared = not np.any(np.isfinite(check.expected) & np.isfinite(check.got))
    report.refused = int(np.sum(~np.isfinite(check.expected).all(axis=1)))
    report.exact = bool(np.array_equal(check.expected, check.got, equal_nan=True))
    report.zero_signs = _other_zeros(check.expected, check.got)
    _measure(report, check.inputs, check.expected, check.got, answered)
    return report
