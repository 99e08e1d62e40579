"""A live comparison as a commissioning record: JSON, a page, and times for `calibrate`."""

from __future__ import annotations

from typing import Any

from st_codegen.live.compare import LiveReport
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
        "bits_differ_from_text": dict(report.differs),
        "failures": [f"{name}: {line}" for name, line in report.failures()],
        "times": {
            name: {"calls": found.calls, "median_us": found.median_us, "high_us": found.high_us}
            for name, found in report.times.items()
        },
    }


def record_sections(report: LiveReport) -> tuple[str, list[PageSection]]:
    """The summary of the record, and its sections."""
    wrong = [model.name for model in report.models if not model.passed]
    verdict = f"FAILED: {', '.join(wrong)}" if wrong else "All agree"
    summary = (
        f"{verdict}: library and controller on a sample of {report.sent:,} rows, {report.at}, {report.address}, "
        f"project {report.fingerprint}."
    )
    rows = [(m.name, m.n, m.max_abs_err, m.bound, m.max_ulp, m.verdict) for m in report.models]
    strong = {(row, 5) for row, model in enumerate(report.models) if not model.passed}
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
    """The times of the blocks as `calibrate` takes them; a block that is quicker than its clock has none."""
    rows = [f"{name},warm,{found.high_us:.1f}" for name, found in report.times.items() if found.high_us > 0.0]
    return "\n".join(["block,caches,us", *rows]) + "\n"
