"""The pictures of README and site: `make pictures` records what they show, and draws it.

What is recorded stands beside the pictures (`docs/pictures/*.csv`, `*.txt`), so that drawing needs no simulation:

    python -m site_tools.pictures            # draw from the records
    python -m site_tools.pictures --record   # simulate, train, move and run the commands first; minutes
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from html import escape
from itertools import pairwise
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"
RIG = ROOT / "examples" / "rv160n" / "rig.toml"

#: What the terminal shows, run beside a copy of `examples/user_repository/models`.
COMMANDS = (
    "st-codegen models/ --target twincat --out plc",
    "st-codegen verify models/ --generated plc",
    "st-codegen prove models/ --generated plc",
)
#: Light and dark, in the picture itself: no page has to know.
_STYLE = """<style>
.ground { fill: #fff } .text { fill: #24292f } .soft { fill: #57606a } .line { stroke: #d0d7de }
.before { stroke: #8c959f } .after { stroke: #0969da } .before-text { fill: #57606a } .after-text { fill: #0969da }
.bar { fill: #0969da } .good { fill: #1a7f37 } .prompt { fill: #57606a }
@media (prefers-color-scheme: dark) {
.ground { fill: #0d1117 } .text { fill: #e6edf3 } .soft { fill: #9198a1 } .line { stroke: #30363d }
.before { stroke: #6e7681 } .after { stroke: #58a6ff } .before-text { fill: #9198a1 } .after-text { fill: #58a6ff }
.bar { fill: #58a6ff } .good { fill: #3fb950 } .prompt { fill: #9198a1 } }
</style>"""


# --- the transmission error before and after

#: The campaign that the models of the picture learn from: rpm, N m, degC.
_GRID = (
    (100, 200, 400, 600, 800, 1000, 1200, 1400, 1600, 1800),
    (0, 25, 50, 75, 100, 200, 400, 700, 1000, 1400, 1800),
    (25, 30, 35),
)
_ORDERS = "0,1,3,39,40,78,81,156,162,240"
_COLUMNS = ("t_s", "before_low_deg", "before_high_deg", "after_low_deg", "after_high_deg")
_BINS = 700


def record_motion(out: Path, work: Path) -> None:
    """Campaign of the simulated rig, models of it, and the robot's motion of another rig with the generated text.

    All sizes of that other rig differ at random by 2 % (standard deviation), and its oil warms up.
    """
    from itertools import product

    from st_codegen.rig.effects import catalogue
    from st_codegen.rig.machine import another_specimen
    from st_codegen.rig.model import read_rig

    other = work / "other.toml"
    other.write_text(another_specimen(read_rig(RIG), catalogue(()), 0.02, 11).text(), encoding="utf-8")
    conditions = work / "conditions.csv"
    lines = ["speed_rpm,torque_Nm,temperature_C", *(",".join(map(str, point)) for point in product(*_GRID))]
    conditions.write_text("\n".join(lines) + "\n", encoding="utf-8")
    _run(work, "simulate", "campaign", "--rig", RIG, "--conditions", conditions, "--out", "measured",
         "--samples", 1024, "--seed", 1)  # fmt: skip
    _run(work, "train", "measured", "--out", "models", "--orders", _ORDERS, "--families", "SVM", "--folds", 3,
         "--keep-faulty", "--table", "harmonics.csv")  # fmt: skip
    _record_revolution(out, work)
    _run(work, "simulate", "motion", "--models", "models", "--rig", other, "--profile", "robot", "--law", "full",
         "--drift", 1.5, "--seed", 5, "--tasks", "split", "--lead", "auto", "--set", "fBlendTime_s=0.005",
         "--set", "fHysteresis_rpm=0.2", "--out", "moved")  # fmt: skip
    with (work / "moved" / "curves.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    curves = {name: np.array([float(row[name]) for row in rows])
              for name in ("t", "error_before_deg", "error_after_1_deg")}  # fmt: skip
    edges = np.linspace(0, len(rows), _BINS + 1).astype(int)
    with (out / "compensation.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(_COLUMNS)
        for start, stop in pairwise(edges):
            ends = [f"{pick(curves[name][start:stop]):.5f}" for name in ("error_before_deg", "error_after_1_deg")
                    for pick in (np.min, np.max)]  # fmt: skip
            writer.writerow([f"{curves['t'][start]:.3f}", *ends])
    (row,) = json.loads((work / "moved" / "motion.json").read_text(encoding="utf-8"))
    kept = {key: round(row[key], 5) for key in ("rms_before", "rms_after", "max_before", "max_after")}
    (out / "compensation.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def _record_revolution(out: Path, work: Path) -> None:
    """One measured curve in both directions, and how large each order is in the middle of all runs."""
    (curve,) = (work / "measured").rglob("1000.0rpm400.0Nm25.0deg.csv")
    with curve.open(encoding="utf-8", newline="") as file:
        rows = [[float(cell) for cell in row] for row in list(csv.reader(file))[1:]]
    forward, backward = [row[:2] for row in rows], [row[2:] for row in rows][::-1]
    with (out / "revolution.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("forward_deg", "forward_te_deg", "backward_deg", "backward_te_deg"))
        writer.writerows([f"{angle:.2f}", f"{te:.5f}", f"{other:.2f}", f"{back:.5f}"]
                         for (angle, te), (other, back) in zip(forward, backward, strict=True))  # fmt: skip
    with (work / "harmonics.csv").open(encoding="utf-8", newline="") as file:
        table = [row for row in csv.DictReader(file) if row["direction"] == "forward"]
    orders = [f"A{order}" for order in _ORDERS.split(",")[1:]]
    with (out / "orders.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("order", "median_amplitude_deg"))
        writer.writerows([name[1:], f"{np.median([float(row[name]) for row in table]):.6f}"] for name in orders)


def _numbers(folder: Path, name: str) -> list[list[float]]:
    with (folder / name).open(encoding="utf-8", newline="") as file:
        return [[float(cell) for cell in row] for row in list(csv.reader(file))[1:]]


def draw_revolution(folder: Path) -> str:
    """The transmission error over one revolution, both directions."""
    rows = _numbers(folder, "revolution.csv")
    width, height, left, right, top, bottom = 860, 300, 62, 16, 58, 44
    values = [row[1] for row in rows] + [row[3] for row in rows]
    low, high = np.floor(min(values) * 50) / 50, np.ceil(max(values) * 50) / 50

    def x(angle: float) -> float:
        return left + (width - left - right) * angle / 360

    def y(te: float) -> float:
        return top + (height - top - bottom) * float(high - te) / float(high - low)

    def line(angle: int, te: int) -> str:
        return " ".join(f"{x(row[angle]):.1f},{y(row[te]):.1f}" for row in rows)

    ticks = []
    for step in range(round((high - low) / 0.02) + 1):
        at, label = y(low + 0.02 * step), f"{low + 0.02 * step:.2f}"
        ticks.append(f'<line class="line" x1="{left}" x2="{width - right}" y1="{at:.1f}" y2="{at:.1f}"/>')
        ticks.append(f'<text class="soft" x="{left - 8}" y="{at + 4:.1f}" text-anchor="end">{label}</text>')
    for angle in range(0, 361, 60):
        anchor = f'y="{height - bottom + 18}" text-anchor="{"end" if angle == 360 else "middle"}"'
        ticks.append(f'<text class="soft" x="{x(angle):.1f}" {anchor}>{angle}</text>')
    title = "One revolution of the output at 1000 rpm and 400 N m (simulated), error in degrees"
    parts = [
        _head(width, height, title),
        f'<text class="text" x="{left}" y="22" font-weight="600">{title}</text>',
        f'<text class="after-text" x="{left}" y="42">forward</text>',
        f'<text class="before-text" x="{left + 90}" y="42">backward</text>',
        *ticks,
        f'<text class="soft" x="{width - right}" y="{height - 6}" text-anchor="end">angle of the output in deg</text>',
        *(f'<polyline class="{name}" fill="none" stroke-width="1" points="{line(*columns)}"/>'
          for name, columns in (("before", (2, 3)), ("after", (0, 1)))),
        "</svg>",
    ]  # fmt: skip
    return "\n".join(parts) + "\n"


def draw_orders(folder: Path) -> str:
    """A bar an order, on a logarithmic scale."""
    rows = _numbers(folder, "orders.csv")
    width, height, left, top, bottom = 860, 280, 62, 44, 44
    low, high = -5.0, -1.0
    wide = (width - left - 16) / len(rows)

    def y(value: float) -> float:
        return top + (height - top - bottom) * (high - value) / (high - low)

    title = "How large each order is: median amplitude over all simulated runs, degrees (logarithmic)"
    parts = [_head(width, height, title), f'<text class="text" x="{left}" y="22" font-weight="600">{title}</text>']
    for power in range(int(low), int(high) + 1):
        at = y(power)
        parts.append(f'<line class="line" x1="{left}" x2="{width - 16}" y1="{at:.1f}" y2="{at:.1f}"/>')
        parts.append(f'<text class="soft" x="{left - 8}" y="{at + 4:.1f}" text-anchor="end">{10.0**power:g}</text>')
    for number, (order, amplitude) in enumerate(rows):
        x, at = left + wide * (number + 0.5), y(float(np.log10(amplitude)))
        tall = height - bottom - at
        parts.append(f'<rect class="bar" x="{x - 18:.1f}" y="{at:.1f}" width="36" height="{tall:.1f}"/>')
        under = f'y="{height - bottom + 18}" text-anchor="middle"'
        parts.append(f'<text class="soft" x="{x:.1f}" {under}>{order:g}</text>')
    label = "order: periods in one revolution of the output"
    parts.append(f'<text class="soft" x="{width - 16}" y="{height - 6}" text-anchor="end">{label}</text>')
    return "\n".join([*parts, "</svg>"]) + "\n"


def draw_motion(folder: Path) -> str:
    """The error of the output over time, before and after, as an SVG."""
    rows = _numbers(folder, "compensation.csv")
    numbers = json.loads((folder / "compensation.json").read_text(encoding="utf-8"))
    width, height, left, right, top, bottom = 860, 340, 62, 16, 58, 44
    last = rows[-1][0]
    low, high = -0.04, 0.04

    def x(t: float) -> float:
        return left + (width - left - right) * t / last

    def y(value: float) -> float:
        return top + (height - top - bottom) * (high - value) / (high - low)

    def band(first: int) -> str:
        """One stroke a bin, from its lowest to its highest error."""
        parts = []
        for number, row in enumerate(rows):
            ends = (row[first], row[first + 1]) if number % 2 else (row[first + 1], row[first])
            parts += [f"{x(row[0]):.1f},{y(end):.1f}" for end in ends]
        return " ".join(parts)

    rms = 1 - numbers["rms_after"] / numbers["rms_before"]
    most = 1 - numbers["max_after"] / numbers["max_before"]
    ticks = [f'<line class="line" x1="{left}" x2="{width - right}" y1="{y(v):.1f}" y2="{y(v):.1f}"/>'
             f'<text class="soft" x="{left - 8}" y="{y(v) + 4:.1f}" text-anchor="end">{v:g}</text>'
             for v in (-0.04, -0.02, 0.0, 0.02, 0.04)]  # fmt: skip
    ticks += [f'<text class="soft" x="{x(t):.1f}" y="{height - bottom + 18}" text-anchor="middle">{t}</text>'
              for t in range(int(last) + 1)]  # fmt: skip
    title = "Transmission error of a simulated robot reducer, degrees"
    parts = [
        _head(width, height, f"{title}: before and after compensation by the generated code"),
        f'<text class="text" x="{left}" y="22" font-weight="600">{title}</text>',
        f'<text class="before-text" x="{left}" y="42">without compensation</text>',
        f'<text class="after-text" x="{left + 165}" y="42">with the generated blocks in the loop: '
        f"{rms:.0%} of the RMS and {most:.0%} of the maximum are gone</text>",
        *ticks,
        f'<text class="soft" x="{width - right}" y="{height - 6}" text-anchor="end">time in s</text>',
        f'<text class="soft" x="{left}" y="{height - 6}">simulated; the models learned from a rig whose sizes '
        "differ by 2 %</text>",
        *(f'<polyline class="{name}" fill="none" stroke-width="1" points="{band(first)}"/>'
          for name, first in (("before", 1), ("after", 3))),
        "</svg>",
    ]  # fmt: skip
    return "\n".join(parts) + "\n"


# --- a terminal


def record_terminal(out: Path, work: Path) -> None:
    """What the commands print, with `$ ` before each command."""
    models = ROOT / "examples" / "user_repository" / "models"
    (work / "models").mkdir()
    for name in ("power.txt", "st-codegen.toml", "notes.txt"):
        shutil.copyfile(models / name, work / "models" / name)
    lines: list[str] = []
    for command in COMMANDS:
        done = _run(work, *shlex.split(command)[1:])
        shown = [line.rstrip() for line in done.splitlines() if line.strip()]
        lines += [f"$ {command}", *_without_files(shown), ""]
    (out / "terminal.txt").write_text("\n".join(lines[:-1]) + "\n", encoding="utf-8")


def _without_files(lines: list[str]) -> list[str]:
    """Without the table of files, whose numbers change with every release."""
    tables = [number for number, line in enumerate(lines) if line.startswith("┏")]
    if len(tables) < 2:
        return lines
    return [*lines[: tables[0]], "..", *lines[tables[1] :]]


def draw_terminal(folder: Path) -> str:
    """The text as an SVG, a letter a cell."""
    lines = (folder / "terminal.txt").read_text(encoding="utf-8").splitlines()
    cell, step, margin = 7.8, 17, 16
    columns = max(map(len, lines))
    width, height = round(columns * cell + 2 * margin), len(lines) * step + 2 * margin
    parts = [_head(width, height, "A terminal: a model is compiled, verified and proved")]
    for number, line in enumerate(lines):
        if not line:
            continue
        style = 'class="text" font-weight="600"' if line.startswith("$") else 'class="text"'
        shown = escape(line)
        for word in ("equal bits", "proved"):
            shown = shown.replace(f" {word} ", f' <tspan class="good" font-weight="600">{word}</tspan> ')
        parts.append(
            f'<text {style} x="{margin}" y="{margin + 12 + number * step}" xml:space="preserve" '
            f'font-family="ui-monospace, SFMono-Regular, Menlo, Consolas, monospace" '
            f'textLength="{len(line) * cell:.1f}" lengthAdjust="spacingAndGlyphs">{shown}</text>'
        )
    return "\n".join([*parts, "</svg>"]) + "\n"


# --- both


def _head(width: int, height: int, title: str) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" font-family="system-ui, sans-serif" font-size="13"><title>{escape(title)}</title>{_STYLE}\n'
        f'<rect class="ground line" x="0.5" y="0.5" width="{width - 1}" height="{height - 1}" rx="6"/>'
    )


def _run(work: Path, *arguments: object) -> str:
    """Run st-codegen; what it printed."""
    command = [sys.executable, "-m", "st_codegen", *map(str, arguments)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "120"}
    done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{shlex.join(command)}\n{done.stdout}{done.stderr}")
    return done.stderr + done.stdout


#: Pictures by the functions that draw them from the records.
DRAWN = {
    "compensation.svg": draw_motion,
    "revolution.svg": draw_revolution,
    "orders.svg": draw_orders,
    "terminal.svg": draw_terminal,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Record if asked, then draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true", help="run the commands and the simulation first")
    if parser.parse_args(arguments).record:
        for record in (record_terminal, record_motion):
            with tempfile.TemporaryDirectory() as work:
                record(PICTURES, Path(work))
    for name, draw in DRAWN.items():
        (PICTURES / name).write_text(draw(PICTURES), encoding="utf-8")


if __name__ == "__main__":
    main()
