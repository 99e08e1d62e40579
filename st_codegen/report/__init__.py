"""HTML pages with tables and pictures, for every command that has something to show.

A page is one file without scripts or links to elsewhere, and the same bytes on every machine for the same input:

    from st_codegen.report import PageSection, PageTable, figure, page

    picture = figure(lambda axes: axes.plot(theta, te), xlabel="output angle in deg", ylabel="TE in deg")
    sections = [PageSection("Curves", text="Measured at 1000 rpm.", figures=(picture,)),
                PageSection("Errors", table=PageTable(("order", "MAE in deg"), [(1, 2.5e-5)]))]
    path.write_text(page("Campaign", sections, summary="969 runs."), encoding="utf-8")
"""

from st_codegen.report.html import PageSection, PageTable, markdown, page
from st_codegen.report.picture import COLOURS, figure, figures

__all__ = ["COLOURS", "PageSection", "PageTable", "figure", "figures", "markdown", "page"]
