"""The proof: source library = reference = emitted text, on rows chosen to make them differ.

For each model three answers are computed: by the source library alone, by the reference evaluation of the intermediate
representation, and by the emitted text, which the engine of `st` runs. An exact model must agree in every bit; another
one within the bound that `bounds` derives for the very row. Rows that the library refuses must be flagged by the block.
The library answers in a process of its own (`isolated`); where it has no answer for a row that it should take, or for
any, the report says so with the library's reason.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from st_codegen.cost.profile import Profile
from st_codegen.cost.report import ProjectCost, project_cost
from st_codegen.emit.blocks.comparison import PROGRAM
from st_codegen.emit.blocks.model import refused_where
from st_codegen.emit.blocks.self_test import SELF_TEST
from st_codegen.emit.blocks.tests import TEST_TASK
from st_codegen.emit.output import block_of, is_real
from st_codegen.errors import GeneratedCodeError
from st_codegen.files.html_text import html_table
from st_codegen.ir import AnyArray, BoolArray, FloatArray, IntArray, Label, ModelIR, TreeEnsemble, reference
from st_codegen.passes.jumps import largest_jump, unsure_columns
from st_codegen.processes import Progress, shared_out
from st_codegen.project.bundle import Bundle
from st_codegen.project.purpose import BlockCheck
from st_codegen.proof import bounds
from st_codegen.proof.arithmetic import arithmetic_of
from st_codegen.proof.isolated import LibraryRefusesError, answers_to, isolated
from st_codegen.proof.probes import RangeSource, operating_range, probe_rows, range_source
from st_codegen.proof.prove.prove import prove_model
from st_codegen.proof.prove.range_bound import real_remarks
from st_codegen.proof.runner import BlockResult, GeneratedCode, target_folders
from st_codegen.proof.windows import window_checks
from st_codegen.walkers.base import LoadedModel

#: What trying a row on a tree takes about.
_SECONDS_A_ROW = 5e-7
#: What proving takes for a tree, and for a node of it: `python benchmarks/prove.py 300 31` took 2.1 s of the processor,
#: `python benchmarks/prove.py 50 1001` (2,001 nodes a tree) took 1.4 s.
_SECONDS_A_TREE, _SECONDS_A_NODE = 6.5e-3, 1.1e-5

#: How often a library is asked about rows that the block refuses.
_ASKED = 48


@dataclass(frozen=True)
class Disagreement:
    """One row on which two answers differ by more than they may: `bound` is that of the numbers that do."""

    between: str
    input: tuple[float, ...]
    expected: tuple[float, ...]
    got: tuple[float, ...]
    bound: float

    def __str__(self) -> str:
        return (
            f"{self.between} differ at {list(self.input)}: {list(self.expected)} and {list(self.got)}, "
            f"allowed {self.bound:g}"
        )


@dataclass(frozen=True)
class OpenRow:
    """A row whose label the bound leaves open, with the labels of the library and of the reference."""

    input: tuple[float, ...]
    library: Label
    reference: Label


@dataclass
class ModelReport:
    """What verification found for one model (or block) over all generated targets.

    `n` rows were tried in each target, and each must agree. `proved`: the text was proved for all inputs (`prove`)
    instead of being tried on every threshold, and these rows are a sample, for the library. `exact`: every number
    did; on `zero_signs` rows the sign of a zero did not. `max_abs_err`, `max_ulp` and `worst_input` (the row with
    the largest error) compare the emitted text with the library on the rows inside the declared range, `bound` is
    the largest error that the derivation allows there: the error of a sum at an input of 1E30 says nothing. Units
    in the last place are those of float32 where the library or the text answers in float32. On `unbounded` rows no
    finite bound is known, as behind a division by what may be rounding only; there the library is not judged. By
    `jump` at most the sum of the trees behind such an operation may differ, where the number that a split compares lies
    within `jump_width` of its threshold (the largest width on these rows, in the operating range).

    Of a classifier every row must have the library's label, but for the `open_rows`: rows on which the bound leaves
    more than one label possible. The first of them are in `open_examples`.

    On `vague` rows of the operating range the bound of an output is larger than all that it spans on the rows there:
    being within it says nothing. `unanswered` rows in that range the block refuses, where `refused_where` says. Of
    these the library was asked `asked`, and had an answer to `silent` all the same, the first at `silent_example` with
    the library's numbers. Of `refused_outside` rows of numbers outside that range the library was asked
    `asked_outside`, and answers `silent_outside`. `nothing_compared`: there was no row that the block takes.

    `guessed`: features of which nobody knows a range, so that the rows lie where the model's own numbers are.

    `refusal`: why the library has no answer for the model, or for an input that it should take; nothing was compared,
    and `n` is 0.
    """

    name: str
    n: int = 0
    max_abs_err: float = 0.0
    max_ulp: int = 0
    exact: bool = True
    zero_signs: int = 0
    worst_input: list[float] | None = None
    bound: float = 0.0
    unbounded: int = 0
    proved: bool = False
    jump: float = 0.0
    jump_width: float = 0.0
    vague: int = 0
    unanswered: int = 0
    refused_where: str = ""
    asked: int = 0
    silent: int = 0
    silent_example: tuple[list[float], list[float]] | None = None
    refused_outside: int = 0
    asked_outside: int = 0
    silent_outside: int = 0
    nothing_compared: bool = False
    open_rows: int = 0
    open_examples: list[OpenRow] = field(default_factory=list)
    must_be_exact: bool = True
    targets: list[str] = field(default_factory=list)
    failures: list[Disagreement] = field(default_factory=list)
    guessed: list[str] = field(default_factory=list)
    refusal: str | None = None

    @property
    def passed(self) -> bool:
        compared = self.refusal is None and not self.nothing_compared
        return compared and not self.failures and (self.exact or not self.must_be_exact)

    @property
    def cells(self) -> tuple[str, ...]:
        """Name, rows, error, bound and units in the last place, for a table."""
        return self.name, f"{self.n:,}", f"{self.max_abs_err:.2g}", f"{self.bound:.2g}", f"{self.max_ulp:,}"

    @property
    def not_judged(self) -> str:
        """What was not compared with the library; empty where all was."""
        said = []
        if self.unbounded:
            said.append(
                f"on {self.unbounded:,} of {self.n:,} rows no bound is known, since rounding may grow there without "
                "limit: the answers to them were not judged"
            )
        if self.vague:
            said.append(
                f"on {self.vague:,} of {self.n:,} rows an output may be off by more than all that it spans on the rows "
                f"tried, and still be within the bound: what says something there is the largest error seen, "
                f"{self.max_abs_err:.2g}, and it is that of a sample"
            )
        if self.unanswered:
            said.append(
                f"{self.unanswered:,} of {self.n:,} rows, all in the range of the inputs, the block refuses (bValid is "
                f"FALSE), since {self.refused_where}: {self._silence}"
            )
        if self.silent_outside:
            said.append(
                f"of {self.refused_outside:,} rows of numbers outside the range of inputs, which the block refuses, "
                f"the library was asked {self.asked_outside:,} and has an answer to {self.silent_outside:,}"
            )
        if self.nothing_compared:
            said.append("it takes no row that was tried, so that nothing was compared: declare its ranges")
        return "; ".join(said)

    @property
    def remarks(self) -> list[str]:
        """What the line of a table does not say: jumps of trees, what was not judged, labels that are open."""
        said = [f"{self.name}: {self.not_judged}"] if self.not_judged else []
        if self.jump:
            said.append(
                f"{self.name}: trees split behind an inexact step; where the number that a split compares lies near "
                f"the threshold, their sum may differ by up to {self.jump:.3g}; on the rows of the operating range "
                f"that were tried, near is within {self.jump_width:.2g}"
            )
        if self.open_rows:
            head = f"{self.name}: the bound leaves the label of {self.open_rows:,} of {self.n:,} rows open, such as"
            rows = [f"  {list(r.input)}: library {r.library!r}, reference {r.reference!r}" for r in self.open_examples]
            said.append("\n".join([head, *rows]))
        return said

    @property
    def _silence(self) -> str:
        """What the library says to the rows that the block refuses."""
        asked = "them" if self.asked == self.unanswered else f"the {self.asked:,} of them that it was asked"
        if self.silent_example is None:
            return f"the library has no finite answer to {asked} either"
        which = asked if self.silent == self.asked else f"{self.silent:,} of {asked}"
        row, answer = self.silent_example
        return f"to {which} the library has an answer, as {answer} to {row}"

    @property
    def verdict(self) -> str:
        """What a line of the table says of a model: FAILED, exact, within bound, and how far that holds."""
        if not self.passed:
            return "FAILED"
        said = "equal but for -0" if self.zero_signs else "exact"
        if not (self.exact and self.must_be_exact):
            said = "within bound"
        return f"{said} where it answers" if self.silent else said

    def as_json(self) -> dict[str, Any]:
        """For reports: numbers that JSON has no way to write become text."""
        content = asdict(self)
        content["passed"] = self.passed
        return {key: _plain(value) for key, value in content.items()}


@dataclass(frozen=True, repr=False)
class VerifyReport:
    """What `st-codegen verify` found.

    `notes` say, by target, what this does not show; `costs` are the worst cases by target, `cycle_us` the budget of one
    cycle.
    """

    models: tuple[ModelReport, ...]
    notes: Mapping[str, str] = field(default_factory=dict)
    costs: Mapping[str, ProjectCost] = field(default_factory=dict)
    cycle_us: float | None = None

    def __repr__(self) -> str:
        failed = [model.name for model in self.models if not model.passed]
        late = f"over the budget: {', '.join(self.over_budget)}" if self.over_budget else ""
        found = "; ".join(filter(None, (f"failed: {', '.join(failed)}" if failed else "", late)))
        return f"VerifyReport({len(self.models)} models, {found or 'all passed'})"

    def _repr_html_(self) -> str:
        return html_table(
            repr(self),
            ("model", "rows", "max error", "allowed", "ulp", "result"),
            [(*model.cells, model.verdict) for model in self.models],
        )

    @property
    def passed(self) -> bool:
        return all(model.passed for model in self.models) and not self.over_budget

    @property
    def guessed(self) -> str:
        """Of which models no range of an input is known, and what was taken in its place; empty where all are."""
        return guesses(self.models)

    @property
    def over_budget(self) -> dict[str, ProjectCost]:
        """The targets whose cycle takes longer than the budget, or has loops without a known bound."""
        if self.cycle_us is None:
            return {}
        return {target: cost for target, cost in self.costs.items() if not cost.fits(self.cycle_us)}

    def as_json(self) -> dict[str, Any]:
        """`passed`, `models` by name, `notes` and `costs` by target."""
        return {
            "passed": self.passed,
            "models": {model.name: model.as_json() for model in self.models},
            "notes": dict(self.notes),
            "costs": {
                target: {"cycle_us": self.cycle_us, "fits": target not in self.over_budget, **cost.as_json()}
                for target, cost in self.costs.items()
            },
        }


def guesses(models: Iterable[ModelReport]) -> str:
    """Of which models no range of an input is known, and what was taken in its place; empty where all are."""
    names = ", ".join(model.name for model in models if model.guessed)
    text = "the range of an input is not known, and guessed from the model's own numbers (st-codegen.toml can give it)"
    return f"{text}: {names}" if names else ""


@dataclass(frozen=True)
class Budget:
    """The time of one cycle on one machine, in us (None: no limit), and the blocks that it runs.

    Without `entries`: the programs that its tasks call.
    """

    profile: Profile
    cycle_us: float | None = None
    entries: tuple[str, ...] = ()


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if np.isfinite(value) else str(value)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def verify(
    bundle: Bundle,
    generated: Path | str,
    *,
    rows: int = 10_000,
    seed: int = 0,
    budget: Budget | None = None,
    progress: Progress | None = None,
    jobs: int | None = None,
) -> VerifyReport:
    """Compare the library, the reference and every generated target below `generated`, row by row.

    `bundle` must be what the targets were generated from: a model that has changed since is an error or a difference.

    `generated` is the folder that `generate` wrote to, or that of one target. Every target in it is parsed, checked and
    run; each costs as much as the first.

    `rows` is how many rows are tried for each model. Special values and all thresholds with their neighbours come
    first, even where they are more than that; the rest are drawn at random from the declared range, one in ten up to
    half its width outside. The result says something of these rows. More rows cost time in proportion; batches bound
    the memory.

    `seed` chooses the random rows. The same seed tries the same rows on every machine; another one tries others.

    `budget` asks for the worst case of one cycle as well, from the emitted text, on the controller of a profile
    (`Budget`). It costs a walk over all paths of the text, seconds for a bundle; what does not fit fails the report.

    `progress` is told of models, and of the blocks around them by their target, as they are tried.

    `jobs` is how many models are tried at the same time (None: one a processor), in copies of this process or, where
    there are none, in threads. The report does not depend on it; each model that is tried takes memory for its rows.

    Raises GeneratedCodeError where there is nothing to verify, or the text cannot be read or would stop a controller.
    """
    if is_real(Path(generated)) != any(ir.is_real for ir in bundle.irs):
        raise GeneratedCodeError(
            f"{generated}: generated with --real, or the models were loaded with it: load(.., real=True) and "
            "generate --real go together"
        )
    targets = {folder.name: GeneratedCode(folder) for folder in target_folders(Path(generated))}
    reports = _reports(bundle, targets, rows, seed, progress, jobs)
    notes = {name: note for name in targets if (note := arithmetic_of(name).note)}
    notes |= real_remarks(bundle.irs)
    costs = (
        {}
        if budget is None
        else {name: cycle_cost(code, budget.profile, budget.entries) for name, code in targets.items()}
    )
    return VerifyReport(tuple(_merged(reports)), notes, costs, None if budget is None else budget.cycle_us)


def cycle_cost(code: GeneratedCode, profile: Profile, entries: tuple[str, ...] = ()) -> ProjectCost:
    """The worst case of a cycle of generated text: of `entries`, else of what its tasks call (see `project_cost`).

    FB_SelfTest, which runs once, is part of no cycle unless it is named or a program calls it; nor are the programs of
    `compare` and of test suites, which do not run in operation. Programs of several tasks are added up, for they share
    a processor. Raises GeneratedCodeError for an unknown entry.
    """
    names = {name.upper() for name in code.project.pous}
    missing = [name for name in entries if name.upper() not in names]
    if missing:
        raise GeneratedCodeError(f"{code.folder}: no block {', '.join(missing)}")
    aside = (SELF_TEST, PROGRAM, *TEST_TASK.programs)
    tasks = tuple(name for name in code.task_programs if name.upper() in names and name not in aside)
    return project_cost(code.project, profile, entries or tasks or None, aside)


def _reports(
    bundle: Bundle,
    targets: dict[str, GeneratedCode],
    rows: int,
    seed: int,
    progress: Progress | None,
    jobs: int | None,
) -> list[ModelReport]:
    """The reports of all models, in their order, and of the blocks around them."""
    # Predictors silence their warnings one by one, which is not safe in threads; here all are silent together
    with isolated(bundle.models) as models, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        around = list(_block_tasks(bundle, targets, seed))
        tasks = [_Task(model.ir.name, partial(_verify_model, model, targets, rows, seed)) for model in models]
        total = len(around) + len(tasks)

        def begun(number: int, task: _Task) -> None:
            if progress is not None:
                progress(number, total, task.name)

        # what takes longest begins first
        everything = [*around, *tasks]
        made = shared_out(
            lambda task: task.reports(), everything, is_large=True, at_once=jobs, can_travel=False, begun=begun
        )
    if progress is not None:
        progress(total, total, "")
    return [report for reports in (*made[len(around) :], *made[: len(around)]) for report in reports]


@dataclass(frozen=True)
class _Task:
    """A part of the verification that needs no other one, and what it is called while it goes on."""

    name: str
    reports: Callable[[], list[ModelReport]]


def _block_tasks(bundle: Bundle, targets: dict[str, GeneratedCode], seed: int) -> Iterable[_Task]:
    """What checks the blocks around the models, target by target."""
    if (purpose := bundle.purpose) is not None:
        for name, code in targets.items():
            bound = arithmetic_of(name).bound
            yield _Task(name, partial(_block_reports, partial(purpose.checks, bundle.irs, code, seed, bound), name))
    if windows := bundle.configuration.windows():
        for name, code in targets.items():
            yield _Task(name, partial(_block_reports, partial(window_checks, bundle.irs, windows, code, seed), name))


def _block_reports(checks: Callable[[], Iterable[BlockCheck]], target: str) -> list[ModelReport]:
    return [block_report(check, target) for check in checks()]


def _is_worth_a_proof(model: ModelIR, count: int, rows: int) -> bool:
    """Whether trying all thresholds would take longer than to prove the text: rows times trees, against nodes."""
    ensembles = [op for op in model.ops if isinstance(op, TreeEnsemble)]
    trees = sum(op.n_trees for op in ensembles)
    proving = trees * _SECONDS_A_TREE + sum(op.n_nodes for op in ensembles) * _SECONDS_A_NODE
    return count > rows and count * trees * _SECONDS_A_ROW > proving


def _verify_model(model: LoadedModel, targets: dict[str, GeneratedCode], rows: int, seed: int) -> list[ModelReport]:
    ir = model.ir
    for code in targets.values():
        block_of(code.folder, ir)  # the model's, before anything takes time
    x = probe_rows(ir, rows, seed)
    proved = _is_worth_a_proof(ir, len(x), rows) and all(prove_model(ir, code).is_proved for code in targets.values())
    if proved:
        # the text is the model's for all inputs: what is left to try is the library, on a sample of the rows
        x = probe_rows(ir, rows, seed, sampled=True)
    return [model_report(model, x, targets, proved=proved)]


class RunsModels(Protocol):
    """What computes a model by generated text: the engine here, or a controller."""

    folder: Path

    def run_model(self, block: str, x: FloatArray, outputs: Sequence[int]) -> BlockResult:
        """Call a model's block once for each row of `x` (see `GeneratedCode.run_model`)."""


def model_report(
    model: LoadedModel, x: FloatArray, targets: Mapping[str, RunsModels], *, proved: bool = False
) -> ModelReport:
    """Compare the library, the reference and what runs the text, by the name it has in the report, row by row."""
    ir = model.ir
    blocks = {name: block_of(code.folder, ir) for name, code in targets.items()}
    expected = reference.evaluate(ir, x)
    usable = np.all(np.isfinite(expected), axis=1)
    limited = reference.limited(ir, x)
    bound = np.where(usable[:, None], bounds.difference_bound(ir, limited), 0.0)
    report = ModelReport(ir.name, n=len(x), proved=proved, must_be_exact=ir.exact)
    report.guessed = [feature.name for feature in ir.features if range_source(feature) is RangeSource.GUESS]
    library = np.full_like(expected, np.nan)
    try:
        library[usable] = model.predict(limited[usable])
    except LibraryRefusesError as refusal:
        report.refusal, report.exact, report.targets, report.n = str(refusal), False, list(targets), 0
        return report
    _note_open_rows(report, ir, x, library, expected, bound)
    report.unbounded = int(np.sum(~np.all(np.isfinite(bound), axis=1)))
    lower, upper = operating_range(ir)
    inside = np.all((x >= lower) & (x <= upper), axis=1)
    report.unanswered, report.nothing_compared = int(np.sum(inside & ~usable)), not np.any(usable)
    _ask_to_refused(report, model, limited, ~usable & np.all(np.isfinite(limited), axis=1), inside)
    inside &= usable
    numbers = 0 if ir.classes is None else 1  # the first output that has a size
    near = bound[inside, numbers:]
    report.bound = float(np.max(near[np.isfinite(near)], initial=0.0))
    said, report.refused_where = expected[inside, numbers:], refused_where(ir)
    report.vague = _vague(said, near)
    report.jump = largest_jump(ir)
    if report.jump:
        report.jump_width = _jump_width(ir, limited[inside])
    _compare(report, "library and reference", x, library, expected, bound)
    for name, code in targets.items():
        report.targets.append(name)
        block, outputs = blocks[name]
        result = code.run_model(block, x, outputs)
        got = np.where(result.valid[:, None], result.values, np.nan)
        arithmetic = arithmetic_of(code.folder.name)
        answered = usable & arithmetic.answers(ir, limited)
        same = arithmetic.bound is bounds.text_bound and not ir.is_real  # and need not be derived once more
        allowed = np.where(answered[:, None], bound if same else arithmetic.bound(ir, limited), 0.0)
        report.must_be_exact &= not np.any(allowed)
        near = allowed[inside & np.isfinite(allowed).all(axis=1), numbers:]
        report.bound = max(report.bound, float(np.max(near, initial=0.0)))
        report.vague = max(report.vague, _vague(said, allowed[inside, numbers:]))
        _compare(report, f"reference and {name}", x, np.where(answered[:, None], expected, np.nan), got, allowed)
        report.exact &= not np.any(library[answered] != got[answered])
        report.zero_signs = max(report.zero_signs, _other_zeros(library[answered], got[answered]))
        near = inside & answered & result.valid
        _measure(report, x, library[:, numbers:], got[:, numbers:], near, is_real=ir.is_real)
    return report


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
    found = bounds.differences(model, x)
    width = 0.0
    for op in model.ops:
        if isinstance(op, TreeEnsemble):
            given = np.hstack([found[value] for value in op.inputs])
            columns = [op.columns[number].column for number in unsure_columns(model, op)]
            width = max(width, float(np.max(given[:, columns], initial=0.0)))
    return width


def _note_open_rows(
    report: ModelReport, model: ModelIR, x: FloatArray, library: FloatArray, expected: FloatArray, bound: FloatArray
) -> None:
    if model.classes is None:
        return
    rows = np.flatnonzero((bound[:, 0] > 0) & np.isfinite(library[:, 0]))
    report.open_rows = len(rows)
    labels = model.classes.labels
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
    first, second = (_in_order(value.astype(np.float32) if single else value) for value in (a, b))
    near = np.abs(first.astype(np.float64) - second.astype(np.float64)) < 2.0**62
    distance = np.abs(np.where(near, first, 0) - np.where(near, second, 0))
    return np.where(near, distance, np.int64(2**62))


def _in_order(value: AnyArray) -> IntArray:
    """Integers that are in the order of the numbers, one apart for neighbours."""
    contiguous = np.ascontiguousarray(value)
    if value.dtype == np.float64:
        bits, lowest = contiguous.view(np.int64), -(2**63)
    else:
        bits, lowest = contiguous.view(np.int32).astype(np.int64), -(2**31)
    return np.where(bits < 0, lowest - bits, bits)


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
    report.exact = bool(np.array_equal(check.expected, check.got, equal_nan=True))
    report.zero_signs = _other_zeros(check.expected, check.got)
    _measure(report, check.inputs, check.expected, check.got, answered)
    return report


def _merged(reports: list[ModelReport]) -> list[ModelReport]:
    """One report a name: the worst over the targets."""
    merged: dict[str, ModelReport] = {}
    for report in reports:
        known = merged.setdefault(report.name, report)
        if known is report:
            continue
        known.targets += report.targets
        known.failures += report.failures
        known.exact &= report.exact
        known.must_be_exact &= report.must_be_exact
        known.unbounded = max(known.unbounded, report.unbounded)
        known.zero_signs = max(known.zero_signs, report.zero_signs)
        known.bound = max(known.bound, report.bound)
        known.nothing_compared |= report.nothing_compared
        known.max_ulp = max(known.max_ulp, report.max_ulp)
        if report.max_abs_err > known.max_abs_err:
            known.max_abs_err, known.worst_input = report.max_abs_err, report.worst_input
    return list(merged.values())
