"""What verification found: of each model, of the blocks around them, and of the time of a cycle."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from st_codegen.cost.report import ProjectCost
from st_codegen.errors import at_most, counted
from st_codegen.files.html_text import html_table
from st_codegen.ir import Label


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

    `n` rows were tried in each target, and each must agree. `proof`: what `prove` says of the text for all inputs,
    which was asked instead of trying every threshold; these rows are a sample, for the library. `exact`: all bits are
    equal on these rows; on `zero_signs` rows the sign of a zero is not. `max_abs_err`, `max_ulp` and `worst_input` (the
    row with the largest error) compare the emitted text with the library on the rows inside the declared range, `bound`
    is the largest error that the derivation allows there: the error of a sum at an input of 1E30 says nothing. Units
    in the last place are those of float32 where the library or the text answers in float32. On `unbounded` rows no
    finite bound is known, as behind a division by what may be rounding only; there the library is not judged. By
    `jump` at most the sum of the trees behind such an operation may differ, where the number that a split compares lies
    within `jump_width` of its threshold (the largest width on these rows, in the operating range).

    Of a classifier every row must have the library's label, but for the `open_rows`: rows on which the bound leaves
    more than one label possible. The first of them are in `open_examples`.

    On `vague` rows of the operating range the bound of an output is larger than all that it spans on the rows there:
    being within it says nothing. `refused` rows, of any kind, the block refuses, so that the library's answers to them
    were not compared. `unanswered` of them are in that range, where `refused_where` says; `none_inside`: all are. Of
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
    proof: str = ""
    jump: float = 0.0
    jump_width: float = 0.0
    vague: int = 0
    refused: int = 0
    unanswered: int = 0
    none_inside: bool = False
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
    def proved(self) -> bool:
        """Whether `prove` answers for all inputs, by whichever of its words."""
        return bool(self.proof)

    @property
    def cells(self) -> tuple[str, ...]:
        """Name, rows, error, bound and units in the last place, for a table."""
        return self.name, f"{self.n:,}", f"{self.max_abs_err:.2g}", at_most(self.bound), f"{self.max_ulp:,}"

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
            asked, answered = self.asked_outside, self.silent_outside
            said.append(
                f"the block refuses {counted(self.refused_outside, 'row')} of numbers outside the range of inputs: the "
                f"library answers {_of_them(answered, asked, self.refused_outside)}"
            )
        if self.none_inside and not self.nothing_compared:
            said.append("it takes no row in that range that was tried, so that the errors in the table are of none")
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
                f"the threshold, their sum may differ by up to {at_most(self.jump, 3)}; on the rows of the operating "
                f"range that were tried, near is within {at_most(self.jump_width)}"
            )
        if self.open_rows:
            head = f"{self.name}: the bound leaves the label of {self.open_rows:,} of {self.n:,} rows open, such as"
            rows = [f"  {list(r.input)}: library {r.library!r}, reference {r.reference!r}" for r in self.open_examples]
            said.append("\n".join([head, *rows]))
        return said

    @property
    def _silence(self) -> str:
        """What the library says to the rows that the block refuses."""
        if self.silent_example is None:
            return f"the library has no finite answer to {_of_them(self.asked, self.asked, self.unanswered)} either"
        row, answer = self.silent_example
        which = _of_them(self.silent, self.asked, self.unanswered)
        return f"the library answers {which}, as {answer} to {row}"

    @property
    def verdict(self) -> str:
        """What a line of the table says of a model's rows: FAILED, equal bits, within bound, and where that holds."""
        if not self.passed:
            return "FAILED"
        said = "equal but for -0" if self.zero_signs else "equal bits"
        if not (self.exact and self.must_be_exact):
            said = "within bound"
        return f"{said} where it answers" if self.silent else said

    def as_json(self) -> dict[str, Any]:
        """For reports: numbers that JSON has no way to write become text."""
        content = asdict(self)
        content |= {"passed": self.passed, "proved": self.proved}
        return {key: _plain(value) for key, value in content.items()}


@dataclass(frozen=True, repr=False)
class VerifyReport:
    """What `st-codegen verify` found.

    `notes` say, by target, what this does not show; `costs` are the worst cases by target, `cycle_us` the budget of one
    cycle; `prove` follows the text of some model where `followed`.
    """

    models: tuple[ModelReport, ...]
    notes: Mapping[str, str] = field(default_factory=dict)
    costs: Mapping[str, ProjectCost] = field(default_factory=dict)
    cycle_us: float | None = None
    followed: bool = False

    def __repr__(self) -> str:
        failed = [model.name for model in self.models if not model.passed]
        late = f"over the budget: {', '.join(self.over_budget)}" if self.over_budget else ""
        found = "; ".join(filter(None, (f"failed: {', '.join(failed)}" if failed else "", late)))
        return f"VerifyReport({counted(len(self.models), 'model')}, {found or 'all passed'})"

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
        """The models without a known range of an input, and what was taken in its place; empty where all have one."""
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


def _of_them(some: int, asked: int, rows: int) -> str:
    """So many of the rows that a library was asked about, of all of which there is talk."""
    if asked == rows:
        known = "it" if rows == 1 else "them"
    else:
        known = (
            "the one of them that it was asked about"
            if asked == 1
            else f"the {asked:,} of them that it was asked about"
        )
    return known if some == asked else f"{some:,} of {known}"


def but_for(models: Iterable[ModelReport]) -> str:
    """How many of all rows were not compared with the library, or leave more labels than one; empty for none."""
    counts = {
        "that a block refuses": "refused",
        "without a bound, not judged": "unbounded",
        "whose label rounding leaves open": "open_rows",
    }
    sums = {said: sum(getattr(model, name) for model in models) for said, name in counts.items()}
    parts = [f"{counted(rows, 'row')} {said}" for said, rows in sums.items() if rows]
    return f", but for {' and '.join(parts)}" if parts else ""


def guesses(models: Iterable[ModelReport]) -> str:
    """The models without a known range of an input, and what was taken in its place; empty where all have one."""
    names = ", ".join(model.name for model in models if model.guessed)
    text = "the range of an input is not known, and guessed from the model's own numbers (st-codegen.toml can give it)"
    return f"{text}: {names}" if names else ""


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if np.isfinite(value) else str(value)
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def merged(reports: Iterable[ModelReport]) -> list[ModelReport]:
    """One report a name: the worst over the targets."""
    found: dict[str, ModelReport] = {}
    for report in reports:
        known = found.setdefault(report.name, report)
        if known is report:
            continue
        if report.max_abs_err > known.max_abs_err:
            known.max_abs_err, known.worst_input = report.max_abs_err, report.worst_input
        known.targets += report.targets
        known.failures += report.failures
        known.exact &= report.exact
        known.must_be_exact &= report.must_be_exact
        known.nothing_compared |= report.nothing_compared
        for worst in ("unbounded", "zero_signs", "bound", "max_ulp"):
            setattr(known, worst, max(getattr(known, worst), getattr(report, worst)))
    return list(found.values())
