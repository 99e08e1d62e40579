"""A live comparison as a commissioning record: JSON, a page, and times for `calibrate`."""

from __future__ import annotations

from typing import Any

from st_codegen.live.live_report import LiveReport
from st_codegen.report import PageSection, PageTable


def record_of(report: LiveReport) -> dict[str, Any]:
    """The record as JSON has it."""
    return {
        "passed": report.passed,
        "controller": report.address,
        "state": report.state,
        "at": report.at,
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
    verdict = f"FAILED: {', '.join(wrong)}" if wrong else "All agree"
    summary = (
        f"{verdict}: library and controller on a sample of {report.sent:,} rows, {report.at}, {report.address}, "
        f"project {report.fingerprint}."
    )
    rows = [(m.name, m.n, m.max_abs_err, m.bound, m.max_ulp, m.verdict) for m in report.models]
    strong = {(row, 5) for row, model in enumerate(report.models) if model.name in wrong}
    columns = ("model", "rows", "largest error", "allowed", "ulp", "result")
    text = "\n\n".join([*report.remarks(), *(f"{name}: {line}" for name, line in report.failures())])
    times = [(name, found.calls, found.median_us, found.high_us) for name, found in report.times.items()]
    head = ("block", "calls", "median us", "99th percentile us")
    about = "The clock was read before and after each call; other tasks may have interrupted it."
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
