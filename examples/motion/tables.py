"""Tables of the results, and how they get into the page that tells of them."""

from __future__ import annotations

import re
import statistics
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from st_codegen.errors import InputError
from st_codegen.report import PageTable


def limits_table(rows: list[dict[str, Any]]) -> PageTable:
    """A row a case; RMS and maximum of what is gone, a pair of columns a profile."""
    profiles = list(dict.fromkeys(row["profile"] for row in rows))
    gone = {(row["what"], row["profile"]): (row["rms_reduction"], row["max_reduction"]) for row in rows}
    head = ["what", *(f"{profile}: {what} gone" for profile in profiles for what in ("RMS", "maximum"))]
    cells = [
        [what, *(_percent(value) for profile in profiles for value in gone[what, profile])]
        for what in dict.fromkeys(row["what"] for row in rows)
    ]
    return PageTable(head, cells)


def gains_table(rows: list[dict[str, Any]]) -> PageTable:
    """A row a step; of several specimens the median, the least and the largest."""
    rigs = list(dict.fromkeys(row["rig"] for row in rows))

    def text(what: str, rig: str, key: str) -> str:
        values = sorted(row[key] for row in rows if (row["what"], row["rig"]) == (what, rig))
        spread = f" ({_percent(values[0])} .. {_percent(values[-1])})" if len(values) > 1 else ""
        return _percent(statistics.median(values)) + spread

    head = ["each step with those above it", *(f"{rig}: {key} gone" for rig in rigs for key in ("RMS", "maximum"))]
    cells = [
        [what, *(text(what, rig, key) for rig in rigs for key in ("rms_reduction", "max_reduction"))]
        for what in dict.fromkeys(row["what"] for row in rows)
    ]
    return PageTable(head, cells)


def motion_table(rows: list[dict[str, Any]]) -> PageTable:
    """A row a motion: RMS and maximum of the error before and after, deg, and the share that is gone."""
    head = [
        "profile",
        "orders",
        "law",
        "tasks",
        "RMS before, after (deg)",
        "gone",
        "maximum before, after (deg)",
        "gone",
    ]

    def cells(row: dict[str, Any]) -> list[str]:
        orders = row["orders"]
        lead = f", lead {row['lead_us']:.0f} us, set points ahead" if row["ahead"] else ""
        sizes = [
            text
            for size in ("rms", "max")
            for text in (
                f"{row[f'{size}_before']:.5f}, {row[f'{size}_after']:.5f}",
                _percent(row[f"{size}_reduction"]),
            )
        ]
        named = ", ".join(map(str, orders)) if len(orders) < 4 else f"all {len(orders)}"
        return [row["profile"], named, row["law"], row["tasks"] + lead, *sizes]

    return PageTable(head, [cells(row) for row in rows])


def into_page(page: Path, out: Path, names: Iterable[str]) -> None:
    """Put tables of a folder between the marks of a page. Raises InputError where a mark or a table is missing."""
    text = _read(page)
    for name in names:
        table = _read(out / f"{name}.md")
        between = re.compile(rf"(<!-- {name}: .*? -->\n\n).*?(\n<!-- end -->)", re.DOTALL)
        if len(between.findall(text)) != 1:
            raise InputError(
                f"{page}: a line '<!-- {name}: ... -->', an empty one, and a line '<!-- end -->' are wanted"
            )
        text = between.sub(lambda found, table=table: found[1] + table.strip() + "\n" + found[2], text)
    page.write_text(text, encoding="utf-8")


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _read(path: Path) -> str:
    if not path.is_file():
        raise InputError(f"{path}: no such file; run all stages first")
    return path.read_text(encoding="utf-8")
