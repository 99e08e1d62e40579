"""What a live comparison found: as commands print it, as a commissioning record (JSON, a page), as times."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from st_codegen.errors import at_most, counted
from st_codegen.live.controller import SOFT_PLC, UNKNOWN
from st_codegen.proof.verify_report import ModelReport, but_for, guesses
from st_codegen.report import PageSection, PageTable


@dataclass
class BlockTimes:
    """Times of a block's calls on the controller, us: their median, and the time that 99 % of them need at most."""

    calls: int
    median_us: float
    high_us: float


@dataclass(frozen=True)
class OtherBits:
    """Rows on which a controller's bits are not those of the same text run here, and the first of them.

    `is_open`: the text calls functions such as EXP, whose last bit is left to whoever writes them. All else that the
    text does (sums, products, comparisons) has one result, so that other bits are another constant, or a compiler that
    computes in other ways.
    """

    count: int
    row: int
    inputs: tuple[float, ...]
    is_open: bool

    def __str__(self) -> str:
        reason = "or its EXP, LN, SIN .. are other ones" if self.is_open else "or its compiler computes in another way"
        return (
            f"on {counted(self.count, 'row')} the controller's bits are not those of the same text run here, first on "
            f"row {self.row} at {list(self.inputs)}: a constant was changed, {reason}"
        )


@dataclass
class LiveReport:
    """What was compared with what, by model and by block around models, and how long the calls took.

    `rows` has, by block, the rows, and of how many leaves and splits in all how many have rows aimed at them;
    `untried_cells`: of a table, how many cells it has between thresholds where these are too many for a row each.
    `differs` has, by model or block, the rows with other bits than the text has here: a failure where nothing leaves
    them open.
    """

    address: str
    state: str
    fingerprint: str
    generated: str
    models: list[ModelReport] = field(default_factory=list)
    rows: dict[str, tuple[int, int, int]] = field(default_factory=dict)
    untried_cells: dict[str, int] = field(default_factory=dict)
    differs: dict[str, OtherBits] = field(default_factory=dict)
    times: dict[str, BlockTimes] = field(default_factory=dict)
    seconds: float = 0.0
    sent: int = 0
    at: str = ""
    #: what the controller calls itself, where it says
    device: str = ""
    #: other bits than those of the text run here are a failure even where functions such as EXP leave them open
    same_bits: bool = False
    #: rows of each failure, by model
    failed_rows: dict[str, list[int]] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether every model and block agrees, and every bit that is not left open."""
        return not self.failures()

    @property
    def rows_a_second(self) -> float:
        """Rows that went to the controller and back."""
        return self.sent / self.seconds if self.seconds else 0.0

    def failures(self) -> list[tuple[str, str]]:
        """The model, and what is wrong on which row."""
        found = [(name, str(bits)) for name, bits in self.differs.items() if self.same_bits or not bits.is_open]
        for model in self.models:
            if model.refusal is not None:
                found.append((model.name, model.refusal))
            if model.nothing_compared:
                found.append((model.name, model.not_judged))
            numbers = self.failed_rows.get(model.name, [])
            rows = zip(model.failures, numbers, strict=True)
            found += [(model.name, f"row {number}: {failure}") for failure, number in rows]
        return found

    def remarks(self) -> list[str]:
        """What the comparison covers, what it does not, and how quick it was."""
        lines = []
        for name, (rows, tried, constants) in self.rows.items():
            if constants:
                share = f"all {constants:,}" if tried == constants else f"{tried:,} of {constants:,}"
                lines.append(f"{name}: {counted(rows, 'row')}, with rows aimed at {share} leaves and splits")
            else:
                lines.append(f"{name}: {counted(rows, 'row')}")
            if cells := self.untried_cells.get(name):
                lines.append(
                    f"{name}: {cells:,} cells between thresholds are too many for a row each, so that a changed number "
                    "of the table may be one that no row meets"
                )
        lines += [remark for model in self.models for remark in model.remarks]
        lines += filter(None, [guesses(self.models)])
        if self.device == SOFT_PLC:
            lines.append(f"{SOFT_PLC} is a soft PLC: no controller was compared, and the times are those of a computer")
        if self.state == UNKNOWN:
            lines.append(f"{self.address} does not say whether the PLC is in RUN: it answered")
        if not self.same_bits:
            lines += [f"{name}: {bits}" for name, bits in self.differs.items() if bits.is_open]
        for name, found in self.times.items():
            most = f"99 % of {found.calls:,} at most {found.high_us:.1f} us"
            lines.append(f"{name}: median {found.median_us:.1f} us a call, {most}")
        lines.append(f"{counted(self.sent, 'row')} in {self.seconds:.1f} s: {self.rows_a_second:,.0f} rows a second")
        return lines


def record_of(report: LiveReport) -> dict[str, Any]:
    """The record as JSON has it."""
    return {
        "passed": report.passed,
        "controller": report.address,
        "state": report.state,
        "at": report.at,
        "device": report.device,
        "generated": report.generated,
        "fingerprint": report.fingerprint,
        "rows_a_second": round(report.rows_a_second, 1),
        "models": {model.name: model.as_json() for model in report.models},
        "rows": {
            name: {"rows": rows, "leaves_and_splits": constants, "tried": tried}
            for name, (rows, tried, constants) in report.rows.items()
        },
        "bits_differ_from_text": {
            name: {"rows": bits.count, "first_row": bits.row, "first_input": list(bits.inputs), "may": bits.is_open}
            for name, bits in report.differs.items()
        },
        "failures": [f"{name}: {line}" for name, line in report.failures()],
        "times": {
            name: {"calls": found.calls, "median_us": found.median_us, "high_us": found.high_us}
            for name, found in report.times.items()
        },
    }


def record_sections(report: LiveReport) -> tuple[str, list[PageSection]]:
    """The summary of the record, and its sections."""
    wrong = list(dict.fromkeys(name for name, _ in report.failures()))
    tried = sum(model.n for model in report.models)
    verdict = f"FAILED: {', '.join(wrong)}" if wrong else "All agree"
    summary = (
        f"{verdict}: library and controller on a sample of {counted(tried, 'row')}{but_for(report.models)}, "
        f"{report.at}, {report.address}{f' ({report.device})' if report.device else ''}, project {report.fingerprint}."
    )
    rows = [(m.name, m.n, m.max_abs_err, at_most(m.bound, 4), m.max_ulp, m.verdict) for m in report.models]
    strong = {(row, 5) for row, model in enumerate(report.models) if model.name in wrong}
    columns = ("model", "rows", "largest error", "allowed", "ulp", "result")
    text = "\n\n".join([*report.remarks(), *(f"{name}: {line}" for name, line in report.failures())])
    times = [(name, found.calls, found.median_us, found.high_us) for name, found in report.times.items()]
    head = ("block", "calls", "median us", "99th percentile us")
    about = "The clock was read before and after each call, in steps of 0.1 us; other tasks may have interrupted it."
    return summary, [
        PageSection("Agreement", text, PageTable(columns, rows, strong)),
        PageSection("Times on the controller", about, PageTable(head, times)),
    ]


def times_csv(report: LiveReport) -> str:
    """The times of the blocks as `calibrate` takes them; whether caches were cold nobody knows, they count as warm."""
    rows = [f"{name},warm,{high_us:.1f}" for name, high_us in known_times(report).items()]
    return "\n".join(["block,caches,us", *rows]) + "\n"


def known_times(report: LiveReport) -> dict[str, float]:
    """The time of a call in us, by block; a block that is quicker than the controller's clock has none."""
    return {name: found.high_us for name, found in report.times.items() if found.high_us > 0.0}
