"""Where a campaign was measured: conditions on a grid, ragged, with gaps, off any grid, in the order they were run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SPEED_RPM = (100.0, 1800.0)
TORQUE_NM = (0.0, 1800.0)
TEMPERATURE_C = (25.0, 35.0)


@dataclass(frozen=True)
class Conditions:
    """The runs of a campaign in the order of time; all arrays of shape (runs,)."""

    speed_rpm: np.ndarray
    torque_Nm: np.ndarray
    temperature_C: np.ndarray

    def __len__(self) -> int:
        return len(self.speed_rpm)

    def take(self, index: np.ndarray) -> Conditions:
        return Conditions(self.speed_rpm[index], self.torque_Nm[index], self.temperature_C[index])

    def levels(self) -> tuple[int, int, int]:
        """How many different values each axis has."""
        columns = (self.speed_rpm, self.torque_Nm, self.temperature_C)
        return tuple(len(np.unique(column)) for column in columns)  # type: ignore[return-value]


def _product(speeds: np.ndarray, torques: np.ndarray, temperatures: np.ndarray) -> Conditions:
    mesh = np.meshgrid(speeds, torques, temperatures, indexing="ij")
    return Conditions(*(axis.ravel() for axis in mesh))


#: runs of a campaign off any grid
SCATTERED = {"dense": 150, "fine": 200, "sparse": 80}
#: levels of speed, torque and temperature of a grid
SHAPES = {
    "dense": ((9, 5, 3), (12, 6, 2), (6, 9, 3)),
    "fine": ((18, 5, 2), (18, 4, 3)),  # every 100 rpm, as on the real rig: a resonance is narrow
    "sparse": ((6, 4, 3), (8, 4, 2)),
}


def grid(rng: np.random.Generator, density: str) -> Conditions:
    """A full grid as on the real rig, thinner."""
    counts = SHAPES[density][rng.integers(len(SHAPES[density]))]
    bounds = (SPEED_RPM, TORQUE_NM, TEMPERATURE_C)
    return _product(*(np.linspace(*bound, count).round() for bound, count in zip(bounds, counts, strict=True)))


def ragged(rng: np.random.Generator, density: str) -> Conditions:
    """A grid of which high speeds were not run at high torque, nor every temperature everywhere."""
    full = grid(rng, density)
    power = full.speed_rpm / SPEED_RPM[1] + full.torque_Nm / TORQUE_NM[1]
    middle = full.temperature_C == 30.0
    kept = (power < rng.uniform(1.5, 1.8)) & (~middle | (rng.random(len(full)) < 0.5))
    return full.take(np.flatnonzero(kept))


def missing(rng: np.random.Generator, density: str) -> Conditions:
    """A grid with 15 % of its runs missing and one speed missing altogether, as 1200 rpm on the real rig."""
    full = grid(rng, density)
    speeds = np.unique(full.speed_rpm)
    kept = (rng.random(len(full)) > 0.15) & (full.speed_rpm != rng.choice(speeds[1:-1]))
    return full.take(np.flatnonzero(kept))


def scattered(rng: np.random.Generator, density: str) -> Conditions:
    """No grid at all: a Latin hypercube over speed and torque, oil as warm as it happened to be."""
    count = SCATTERED[density]
    strata = (np.stack([rng.permutation(count) for _ in range(3)]) + rng.random((3, count))) / count
    bounds = (SPEED_RPM, TORQUE_NM, TEMPERATURE_C)
    columns = [low + (high - low) * part for part, (low, high) in zip(strata, bounds, strict=True)]
    return Conditions(columns[0].round(1), columns[1].round(1), columns[2].round(2))


LAYOUTS = {"grid": grid, "ragged": ragged, "missing": missing, "scattered": scattered}


def conditions(rng: np.random.Generator, name: str, density: str = "dense") -> Conditions:
    """The runs of layout `name` in the order of time, which is random: drift must not follow a condition."""
    plan = LAYOUTS[name](rng, density)
    return plan.take(rng.permutation(len(plan)))
