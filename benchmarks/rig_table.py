"""The simulated rig beside the real one: medians, dependence on torque and speed of every order, one picture.

python benchmarks/rig_table.py ../shared/data/rv160n_harmonics.csv --out build/rig_table
"""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path

import numpy as np

from st_codegen.report import Section, Table, figures, page
from st_codegen.rig.effects import Conditions
from st_codegen.rig.model import read_rig

RIG = Path(__file__).resolve().parent.parent / "examples" / "rv160n" / "rig.toml"
ORDERS = (0, 1, 3, 39, 40, 78, 81, 156, 162, 240)


def real_table(path):
    """Direction sign, speed, torque, temperature (n,), and amplitudes (n, orders), deg; order 0 with its sign."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    sign = np.array([1.0 if row["direction"] == "forward" else -1.0 for row in rows])
    at = np.array([[float(row[key]) for key in ("speed_rpm", "torque_Nm", "temperature_C")] for row in rows])
    amplitudes = np.array([[float(row[f"A{order}"]) for order in ORDERS] for row in rows])
    return sign, at, amplitudes


def by_level(levels, values):
    """Medians at each level of a condition: (levels, medians)."""
    unique = np.unique(levels)
    return unique, np.array([np.median(values[levels == level]) for level in unique])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=Path)
    parser.add_argument("--out", type=Path, default=Path("build/rig_table"))
    arguments = parser.parse_args()
    sign, at, real = real_table(arguments.table)
    rig = read_rig(RIG)
    c = rig.coefficients(Conditions.of(sign, *at.T), ORDERS)
    ours = np.abs(c)
    ours[:, 0] = np.where(np.isfinite(real[:, 0]), c[:, 0].real, np.nan)
    forward = sign > 0
    rows, numbers = [], []
    for column, order in enumerate(ORDERS):
        entry = {"order": order}
        for name, rows_of in (("forward", forward), ("backward", ~forward)):
            a, b = real[rows_of, column], ours[rows_of, column]
            if order == 0 and name == "backward":
                a, b = np.abs(a), np.abs(b)  # stored without sign at the source
            entry[f"{name}_real_median"] = float(np.median(a))
            entry[f"{name}_ours_median"] = float(np.median(b))
            entry[f"{name}_correlation"] = float(np.corrcoef(a, b)[0, 1]) if b.std() > 1e-9 else None
            entry[f"{name}_rms_difference"] = float(np.sqrt(np.mean((a - b) ** 2)))
        numbers.append(entry)
        rows.append(tuple(f"{v:.3g}" if isinstance(v, float) else str(v) for v in entry.values()))

    def panel(column, condition, label):
        def draw(axes):
            for values, style, name in ((real, "o", "real"), (ours, "-", "simulated")):
                levels, medians = by_level(at[forward, condition], values[forward, column])
                axes.plot(levels, medians * 1e3, style, markersize=3, label=name)
            axes.set(xlabel=label, ylabel="median in 1e-3 deg")

        return (f"order {ORDERS[column]}", draw)

    panels = [
        panel(i, k, label) for i in range(len(ORDERS)) for k, label in ((1, "torque in N m"), (0, "speed in rpm"))
    ]
    arguments.out.mkdir(parents=True, exist_ok=True)
    picture = figures(panels, columns=4, size_cm=(6, 4.5))
    text = page(
        "The simulated rig beside the real one",
        [
            Section(
                "Medians, correlation over all operating points, RMS difference (deg)",
                table=Table(tuple(numbers[0]), rows),
            ),
            Section("Forward amplitudes against torque and speed", figures=[picture]),
        ],
    )
    (arguments.out / "rig_table.html").write_text(text, encoding="utf-8")
    (arguments.out / "rig_table.json").write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
    for entry in numbers:
        print({key: round(value, 5) if isinstance(value, float) else value for key, value in entry.items()})


if __name__ == "__main__":
    main()
