"""Sizes of the default rig's mesh effects, from the harmonic table measured on the real rig.

python benchmarks/rig_sizes.py ../shared/data/

Each mesh order and direction: c = a + b M + what the resonance passes on, by least sum of distances (not of squares:
the table has faulty runs), the delay of the measuring chain turned back. The resonance itself stays as it is; where it
is near, by 15 % of its frequency, the order says nothing of a and b. Sidebands: median over that of the mesh order.
"""

from __future__ import annotations

import argparse
import csv
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from st_codegen.rig.effects import Conditions, Stage
from st_codegen.rig.model import RigModel, read_rig

ROOT = Path(__file__).resolve().parent.parent
RIG = ROOT / "examples" / "rv160n" / "rig.toml"
TABLE, SPECTRUM = "rv160n_harmonics.csv", "rv160n_order_spectrum.csv"
MESH = (39, 40, 78, 81, 156, 162, 240)
NEAR = 0.15
#: Distances below this count as equal, deg.
_EQUAL = 2e-5


@dataclass(frozen=True)
class Measured:
    """The table: operating points, and c_k (n, orders) in deg."""

    at: Conditions
    orders: tuple[int, ...]
    coefficients: np.ndarray

    def of(self, order: int) -> np.ndarray:
        return self.coefficients[:, self.orders.index(order)]

    def rows(self, chosen: np.ndarray) -> Measured:
        return Measured(self.at.rows(chosen), self.orders, self.coefficients[chosen])


def read_table(path: Path) -> Measured:
    """The harmonic table, both directions; order 0 with the sign that it is stored with."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    orders = tuple(int(name[1:]) for name in rows[0] if name[0] == "A" and name[1:].isdigit())

    def column(name: str) -> np.ndarray:
        return np.array([float(row[name]) for row in rows])

    sign = np.array([1.0 if row["direction"] == "forward" else -1.0 for row in rows])
    at = Conditions.of(sign, *(column(name) for name in ("speed_rpm", "torque_Nm", "temperature_C")))
    phases = [np.zeros(len(rows)) if k == 0 else column(f"phi{k}") for k in orders]
    values = [column(f"A{k}") * np.exp(1j * phase) for k, phase in zip(orders, phases, strict=True)]
    return Measured(at, orders, np.stack(values, axis=1))


def least_distances(x: np.ndarray, y: np.ndarray, rounds: int = 100) -> np.ndarray:
    """The coefficients with the least sum of |y - x b|, complex, by reweighted least squares."""
    weight = np.ones(len(y))
    for _ in range(rounds):
        found = np.linalg.lstsq(x * weight[:, None], y * weight, rcond=None)[0]
        weight = 1 / np.sqrt(np.maximum(abs(y - x @ found), _EQUAL))
    return found


def mesh_sizes(measured: Measured, rig: RigModel) -> dict[tuple[int, int], tuple[complex, complex]]:
    """(order, +1 or -1) -> shape error in deg, growth with the load in deg/kNm."""
    at = measured.at
    structure = rig.of_stage(Stage.STRUCTURE)
    orders = np.array(MESH)
    resonance = sum(effect.contribution(at, orders) for effect in structure)
    delay = sum(effect.scalar("delay_us") for effect in rig.of_stage(Stage.MEASURING)) * 1e-6
    frequency = np.outer(at.speed_rpm, orders) / (60 * rig.constants.reduction_ratio)
    far = np.ones(frequency.shape, bool)
    for effect in structure:
        own = np.isin(orders, effect.orders)
        far &= ~own | (abs(frequency / effect.scalar("frequency_Hz") - 1) > NEAR)
    found = {}
    for place, order in enumerate(MESH):
        turn = at.output_rad_s(rig.constants.reduction_ratio) * delay
        shape = measured.of(order) * np.exp(1j * order * turn) - resonance[:, place]
        for sign in (1, -1):
            rows = (at.sign == sign) & far[:, place]
            x = np.stack([np.ones(rows.sum()), at.torque_Nm[rows] / 1000], axis=1).astype(complex)
            constant, slope = least_distances(x, shape[rows])
            found[order, sign] = complex(constant), complex(slope)
    return found


def sideband_ratios(spectrum: Path, sizes: dict, measured: Measured) -> dict[int, float]:
    """Sideband -> ratio of forward medians to its mesh order (before the resonance)."""
    with spectrum.open() as file:
        medians = {int(r["order"]): float(r["median_deg"]) for r in csv.DictReader(file) if r["direction"] == "Fw"}
    load = measured.at.torque_Nm[measured.at.sign > 0] / 1000
    found = {}
    for order in (39, 162, 240):
        constant, slope = sizes[order, 1]
        for side in (order - 3, order + 3):
            if side in medians:
                found[side] = medians[side] / float(np.median(abs(constant + slope * load)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help=f"folder with {TABLE} and {SPECTRUM}")
    data = parser.parse_args().data
    measured = read_table(data / TABLE)
    sizes = mesh_sizes(measured, read_rig(RIG))
    for part, name in enumerate(("error of shape, deg", "growth with the load, deg/kNm")):
        print(f"{name} (forward; backward)")
        for order in MESH:
            texts = [f"({abs(c):.2e}, {np.angle(c):.2f})" for c in (sizes[order, s][part] for s in (1, -1))]
            print(f"  {order:4} {', '.join(texts)}")
    print("sidebands over their mesh order")
    for side, ratio in sideband_ratios(data / SPECTRUM, sizes, measured).items():
        print(f"  {side:4} {ratio:.2g}")


if __name__ == "__main__":
    main()
