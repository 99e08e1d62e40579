"""From the Markdown of this repository, as code hosts read it, to that of the site's generator."""

from __future__ import annotations

import re
from collections.abc import Mapping

_ITEM = re.compile(r"( *)(?:[-*]|\d+\.) +(?=\S)")


def for_the_site(text: str) -> str:
    """Lists and tables that follow a line directly get a blank line; items inside items stand four columns in."""
    lines: list[str] = []
    fenced = in_list = False
    for line in text.split("\n"):
        before = lines[-1].strip() if lines else ""
        fenced ^= line.lstrip().startswith("```")
        item = _ITEM.match(line)
        shown = line
        if fenced or (line.startswith("    ") and not in_list):
            pass
        elif item and len(item[1]) < 4:
            if before and not in_list:
                lines.append("")
            shown = " " * 4 * bool(item[1]) + line.lstrip()
            in_list = True
        elif line.startswith("|") and before and not before.startswith("|"):
            lines.append("")
        if line.strip() and not line.startswith(" ") and not item and not before:
            in_list = False
        lines.append(shown)
    return "\n".join(lines)


def with_pages(text: str, pages: Mapping[str, str]) -> str:
    """Links to files that are pages of the site under another name go to these."""

    def moved(link: re.Match[str]) -> str:
        return f"]({pages.get(link[1], link[1])}{link[2] or ''})"

    return re.sub(r"\]\(([^)#\s]+)(#[^)\s]*)?\)", moved, text)
