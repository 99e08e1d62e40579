"""The gallery of generated text: one block of each layout, from the golden files."""

from __future__ import annotations

import json
import re
from pathlib import Path

GENERATED = Path(__file__).resolve().parent.parent / "golden" / "lone" / "generated" / "iec"
#: Lines of a table that are shown; the others are counted.
_ROWS = 3
#: Model, what its layout is good for.
SHOWN = {
    "lightgbm_gbdt": "A table. The model splits few inputs at few numbers. All trees become one lookup: search "
    "the cell, take its number.",
    "extra_trees_ranked": "Ranked trees. The model has too many thresholds for a table. Each input is searched once, "
    "then nodes compare small whole numbers.",
    "hist_gradient_boosting_category": "Here an input is a category.",
    "lightgbm_linear": "Trees with linear models in their leaves.",
    "mlp_tanh": "A neural network. A layer is one loop. There is no TANH in the standard, so it is written out, "
    "in a form that neither overflows nor loses digits near zero.",
    "svr": "Support vectors with an RBF kernel: one exponential for each vector.",
    "nu_svr": "Support vectors on a grid: one exponential for each distinct value of a column, then sums.",
    "ridge": "A linear model.",
}


def page() -> str:
    """The gallery as Markdown."""
    facts = json.loads((GENERATED / "st-codegen.json").read_text(encoding="utf-8"))["models"]
    lines = [
        "# Gallery of generated text",
        "",
        "Each block is from the [golden files](project_tree.md) of this project, in the portable dialect "
        "(`--target iec`). The models are small, so that the text is short. Long tables are cut here; `..` says where. "
        "What a layout is and when it is taken: [layouts](cost.md#layouts).",
        "",
    ]
    for name, text in SHOWN.items():
        block = facts[name]["block"]
        code = (GENERATED / f"{block}.st").read_text(encoding="utf-8")
        lines += [f"## {block}: {facts[name]['layout']}", "", text, "", "```iecst", *_cut(code, block), "```", ""]
    return "\n".join(lines) + "\n"


def _cut(code: str, block: str) -> list[str]:
    """The block alone, with a few lines of each table."""
    start = code.index(f"(*\n  {block}")
    shown: list[str] = []
    row = 0
    for line in code[start:].rstrip().split("\n"):
        is_data = bool(re.fullmatch(r"\s+(\(\*.*\*\))?[\s\d.eE+,\-]*", line)) and bool(line.strip())
        row = row + 1 if is_data else 0
        if row <= _ROWS:
            shown.append(line)
        elif row == _ROWS + 1:
            shown.append(f"{' ' * (len(line) - len(line.lstrip()))}..")
    return shown
