"""Sections of text, tables and pictures -> one HTML page."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from st_codegen.emit.render import render_report


@dataclass(frozen=True)
class PageTable:
    """A table: names of the columns, and rows of text, numbers or truth values.

    strong: cells (row, column) in bold. Numbers stand right; floats are shown with four digits: hand over text where
    that is not right.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    strong: Collection[tuple[int, int]] = ()

    def markdown(self) -> str:
        """This table as Markdown."""
        lines = ["| " + " | ".join(self.columns) + " |", "|" + "---|" * len(self.columns)]
        for row, cells in enumerate(self._cells()):
            texts = [f"**{text}**" if (row, column) in self.strong else text for column, (text, _) in enumerate(cells)]
            lines.append("| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |")
        return "\n".join(lines) + "\n"

    def _cells(self) -> list[list[tuple[str, bool]]]:
        """Text and whether it is a number, of every cell."""
        return [[(_shown(cell), isinstance(cell, int | float)) for cell in row] for row in self.rows]

    def values(self) -> dict[str, Any]:
        """The columns and cells of this table as the page's template takes them."""
        rows = [
            [(text, number, (row, column) in self.strong) for column, (text, number) in enumerate(cells)]
            for row, cells in enumerate(self._cells())
        ]
        return {"columns": list(self.columns), "rows": rows}


@dataclass(frozen=True)
class PageSection:
    """A part of a page, top to bottom: title, text, table, pictures, folded text.

    text: plain; an empty line parts paragraphs. figures: SVG as `figure` and `figures` return it. details: a long text
    (a log, a TOML file) that opens on a click, or is open from the start.
    """

    title: str
    text: str = ""
    table: PageTable | None = None
    figures: Sequence[str] = ()
    details: str = ""
    open_details: bool = False


def page(title: str, sections: Sequence[PageSection], *, summary: str = "") -> str:
    """A complete HTML page; all text is escaped, pictures are put in as they are."""
    return render_report(
        "report/page.html.j2",
        {
            "title": title,
            "summary": _paragraphs(summary),
            "sections": [
                {
                    "title": section.title,
                    "paragraphs": _paragraphs(section.text),
                    "table": section.table.values() if section.table else None,
                    "figures": list(section.figures),
                    "details": section.details,
                    "open": section.open_details,
                }
                for section in sections
            ],
        },
    )


def _paragraphs(text: str) -> list[str]:
    return [part.strip() for part in text.split("\n\n") if part.strip()]


def _shown(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
