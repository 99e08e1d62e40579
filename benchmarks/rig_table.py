"""A campaign of the simulated rig beside the table measured on the real one: medians of every order, over all operating
points and against torque and speed, in one picture.

python benchmarks/rig_table.py ../shared/data/rv160n_harmonics.csv --out build/rig_table
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.rig_sizes import RIG, Measured, read_table
from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.report import PageSection, PageTable, figures, page
from st_codegen.rig.campaign import Measuring, simulate_run
from st_codegen.rig.model import RigModel, read_rig
from st_codegen.te.harmonics import Direction

#: Enough for order 240; the real curves have 10,800 and more.
MEASURING = Measuring(samples=1024, seed=1)
DIRECTIONS = ((1.0, Direction.FORWARD, "#0072b2"), (-1.0, Direction.BACKWARD, "#d55e00"))
#: Orders that the resonance feeds.
FED = (156, 162, 240)
CONDITIONS = (("torque", "torque in N m"), ("speed", "speed in rpm"))


def simulated(measured: Measured, rig: RigModel) -> np.ndarray:
    """Harmonics of simulated runs, with noise, at the table's operating points: (n, orders), deg, by FFT as there."""
    at = measured.at
    runs = np.stack([at.speed_rpm, at.torque_Nm, at.temperature_C], axis=1)
    found = np.empty((len(at), len(measured.orders)), np.complex128)
    for number, point in enumerate(np.unique(runs, axis=0)):
        run = simulate_run(rig, OperatingPoint(*map(float, point)), MEASURING, number)
        same = (runs == point).all(axis=1)
        for sign, direction, _ in DIRECTIONS:
            spectrum = np.fft.rfft(run.curves[direction].te_deg) / MEASURING.samples
            spectrum[1:] *= 2
            found[same & (at.sign == sign)] = spectrum[list(measured.orders)]
    return found


def sizes_of(values: np.ndarray, order: int) -> np.ndarray:
    """Amplitudes, deg; of the mean with its sign."""
    return values.real if order == 0 else abs(values)


def by_level(levels: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Medians at each level of a condition."""
    unique = np.unique(levels)
    return unique, np.array([np.median(values[levels == level]) for level in unique])


def level_medians(measured: Measured, ours: np.ndarray, place: int, sign: float) -> dict[str, Any]:
    """By condition: levels, medians of the table, medians of the simulation."""
    rows, order = measured.at.sign == sign, measured.orders[place]
    found = {}
    for name, levels in (("torque", measured.at.torque_Nm[rows]), ("speed", measured.at.speed_rpm[rows])):
        unique, real = by_level(levels, sizes_of(measured.coefficients[rows, place], order))
        found[name] = unique, real, by_level(levels, sizes_of(ours[rows, place], order))[1]
    return found


def compared(measured: Measured, ours: np.ndarray) -> list[dict[str, Any]]:
    """A row an order and direction: medians, their ratio, and how alike the medians over torque and speed run."""
    rows = []
    for place, order in enumerate(measured.orders):
        for sign, direction, _ in DIRECTIONS:
            chosen = measured.at.sign == sign
            real, own = (
                float(np.median(sizes_of(values[chosen, place], order))) for values in (measured.coefficients, ours)
            )
            row: dict[str, Any] = {
                "order": order,
                "direction": str(direction),
                "real_median_deg": real,
                "simulated_median_deg": own,
                "ratio": own / real,
            }
            for name, (_, a, b) in level_medians(measured, ours, place, sign).items():
                row[f"{name}_correlation"] = float(np.corrcoef(a, b)[0, 1])
                row[f"{name}_rms_difference_deg"] = float(np.sqrt(np.mean((a - b) ** 2)))
            rows.append(row)
    return rows


def picture(measured: Measured, ours: np.ndarray) -> str:
    """A panel an order and condition: points of the table, lines of the simulation, both directions."""

    def panel(place: int, name: str, label: str) -> tuple[str, Any]:
        def draw(axes: Any) -> None:
            first = place == 0 and name == "torque"  # one legend for all
            for sign, direction, colour in DIRECTIONS:
                levels, real, own = level_medians(measured, ours, place, sign)[name]
                axes.plot(levels, real * 1e3, "o", color=colour, markersize=3, label=f"{direction}, real" * first)
                axes.plot(levels, own * 1e3, "-", color=colour, label=f"{direction}, simulated" * first)
            if measured.orders[place] in FED and name == "speed":
                axes.set_yscale("log")
            axes.set(xlabel=label, ylabel="median in 1e-3 deg")
            if first:
                axes.legend(fontsize=6)

        return f"order {measured.orders[place]}", draw

    panels = [panel(place, *condition) for place in range(len(measured.orders)) for condition in CONDITIONS]
    return figures(panels, columns=4, size_cm=(6, 4.5))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", type=Path)
    parser.add_argument("--out", type=Path, default=Path("build/rig_table"))
    arguments = parser.parse_args()
    measured = read_table(arguments.table)
    ours = simulated(measured, read_rig(RIG))
    rows, drawn = compared(measured, ours), picture(measured, ours)
    head = (
        "order",
        "direction",
        "real",
        "simulated",
        "ratio",
        "torque: corr.",
        "RMS diff.",
        "speed: corr.",
        "RMS diff.",
    )
    cells = [tuple(f"{v:.3g}" if isinstance(v, float) else str(v) for v in row.values()) for row in rows]
    sections = [
        PageSection(
            "Medians (deg): all operating points, and those over torque and speed", table=PageTable(head, cells)
        ),
        PageSection("Against torque and speed", "Points: the real rig. Lines: the simulated one.", figures=[drawn]),
    ]
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "rig_table.html").write_text(page("The simulated rig beside the real one", sections), "utf-8")
    (arguments.out / "rig_table.svg").write_text(drawn, "utf-8")
    (arguments.out / "rig_table.json").write_text(json.dumps(rows, indent=1) + "\n", "utf-8")
    for row in rows:
        print("  ".join(f"{v:10.4g}" if isinstance(v, float) else f"{v!s:>8}" for v in row.values()))
    print(f"{arguments.out}/rig_table.html")


if __name__ == "__main__":
    main()
