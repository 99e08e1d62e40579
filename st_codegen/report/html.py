"""Sections of text, tables and pictures -> one HTML page."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from st_codegen.emit.render import render_report
from st_codegen.files.made_by import MADE_BY

#: What stands right: a number, also one that was written as text, with commas or a power of ten.
_NUMBER = re.compile(r"[-+]?inf|nan|[-+]?[0-9][0-9,]*(\.[0-9]+)?(e[-+]?[0-9]+)?")


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
            words = [_literal(text) for text, _ in cells]
            texts = [f"**{word}**" if (row, column) in self.strong else word for column, word in enumerate(words)]
            lines.append("| " + " | ".join(texts) + " |")
        return "\n".join(lines) + "\n"

    def _cells(self) -> list[list[tuple[str, bool]]]:
        """Text and whether it is a number, of every cell."""
        return [[(text, _NUMBER.fullmatch(text) is not None) for text in map(_shown, row)] for row in self.rows]

    def values(self) -> dict[str, Any]:
        """The columns and cells of this table as the page's template takes them."""
        rows = [
            [(text, number, (row, column) in self.strong) for column, (text, number) in enumerate(cells)]
            for row, cells in enumerate(self._cells())
        ]
        columns = []
        for column, name in enumerate(self.columns):
            filled = [number for text, number, _ in (row[column] for row in rows if column < len(row)) if text]
            columns.append((name, bool(filled) and all(filled)))
        return {"columns": columns, "rows": rows}


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
    """A complete HTML page; all text is escaped, pictures are put in as they are. Its foot says what made it."""
    return render_report(
        "report/page.html.j2",
        {
            "title": title,
            "summary": _paragraphs(summary),
            "footer": MADE_BY.get(),
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


def markdown(title: str, sections: Sequence[PageSection], *, summary: str = "") -> str:
    """The page as Markdown, without its pictures."""
    parts = [f"# {_literal(title)}", *map(_literal, _paragraphs(summary))]
    for section in sections:
        parts += [f"## {_literal(section.title)}", *map(_literal, _paragraphs(section.text))]
        parts += [section.table.markdown().rstrip()] if section.table else []
    return "\n\n".join([*parts, *([f"_{_literal(MADE_BY.get())}_"] if MADE_BY.get() else [])]) + "\n"


def _literal(text: str) -> str:
    """Text in which nothing is read as Markdown or HTML."""
    return re.sub(r"([\\`*\[\]<>|])", r"\\\1", text)


def _paragraphs(text: str) -> list[str]:
    return [part.strip() for part in text.split("\n\n") if part.strip()]


def _shown(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
