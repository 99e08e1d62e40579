"""report.html."""

from __future__ import annotations

from st_codegen.reconcile.run import Result
from st_codegen.reconcile.words import summary
from st_codegen.report.html import Section, page


def report_page(result: Result) -> str:
    """The report as one HTML page."""
    return page("Reconcile", [Section("Findings", summary(result))])
