"""Write one case: rig.toml, campaign; and keep its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import files
from .cases import Case
from .kinds import KINDS, MANY_SPEEDS, Draw
from .machine import Machine, draw_machine, simulate
from .measuring import MISTAKES, NOISE_UNIT, NOISES, Measured, fresh, plainly, plan
from .points import Array, Part, Points, curves, rms_by_order, spectrum

#: the program looks at orders up to a quarter of the samples: enough for 240 and its neighbours
SAMPLES = 1000
MIXED_SAMPLES = 1200


@dataclass(frozen=True)
class Truth:
    """What holds for a case. Curves are free of noise and of mistakes, (runs, 2, samples), in deg.

    `labelled` are the runs as their files name them.
    `known` is what the rig model makes, `hidden` what it lacks; `_fresh` the same at runs that nobody measured.
    `noise_by_order` is the RMS over the runs of the noise in each integer order. `strength` of each part is its size
    in standard deviations of the noise, all samples taken together. `wrong` are rows that a mistake spoilt.
    """

    case: Case
    machine: Machine
    parts: tuple[Part, ...]
    points: Points
    labelled: Points
    known: Array
    hidden: Array
    new_points: Points
    known_fresh: Array
    hidden_fresh: Array
    noise_by_order: Array
    strength: tuple[float, ...]
    bad_files: tuple[str, ...]
    wrong: tuple[int, ...]
    rig: Path
    measured: Path
    data: Measured
    unreadable: tuple[int, ...] = ()

    @property
    def samples(self) -> int:
        return int(self.known.shape[-1])

    def by_order(self, fresh_runs: bool = False) -> Array:
        """RMS in deg of what is hidden, by integer order."""
        return rms_by_order(spectrum(self.hidden_fresh if fresh_runs else self.hidden))

    def plain(self) -> dict[str, Any]:
        """For the file of results."""
        by_order = self.by_order()
        strong = [int(order) for order in np.argsort(-by_order)[:8] if by_order[order] > 1e-9]
        return {
            "parts": [
                {"title": part.title, "names": part.names, "orders": part.orders, "hedged": part.hedged,
                 "strength": round(strength, 2)}
                for part, strength in zip(self.parts, self.strength, strict=True)
            ],
            "hidden_rms_by_order": {str(order): float(f"{by_order[order]:.4g}") for order in strong},
            "runs": len(self.points),
            "bad_files": self.bad_files,
            "wrong_runs": self.wrong,
        }  # fmt: skip


def draw(case: Case) -> tuple[Machine, tuple[Part, ...], Points, Points]:
    """Machine as the rig model has it, hidden parts, runs, and runs that nobody measures: all from the case's seed."""
    random = np.random.default_rng([case.seed, 1])
    machine = draw_machine(random, case.small)
    single = case.kind == "one_temperature"
    temperatures = (30.0,) if single else (25.0, 35.0) if random.uniform() < 0.6 else (25.0, 30.0, 35.0)
    points = plan(random, case.layout, case.kind in MANY_SPEEDS, temperatures)
    known, parts = KINDS[case.kind](Draw(random, machine, points))
    return known, parts, points, fresh(random, points)


def hidden_curves(parts: tuple[Part, ...], points: Points, samples: int) -> Array:
    """Sum of the parts, (runs, 2, samples)."""
    total = np.zeros((len(points), 2, samples))
    for part in parts:
        total += curves(part.waves(points), samples)
    return total


def make(case: Case, folder: Path) -> Truth:
    """Write `folder/rig.toml` and `folder/measured`."""
    machine, parts, points, new_points = draw(case)
    samples = MIXED_SAMPLES if case.trouble in ("mixed_sampling", "coarse_file") else SAMPLES
    together = Points(
        *(np.concatenate([getattr(points, key), getattr(new_points, key)]) for key in Points.__dataclass_fields__)
    )
    known = simulate(machine.text(), together, samples)
    hidden = hidden_curves(parts, together, samples)
    runs = len(points)
    clean = known[:runs] + hidden[:runs]
    random = np.random.default_rng([case.seed, 2, case.level])
    noisy = NOISES[case.noise_form](random, clean, case.noise * NOISE_UNIT)
    noise_by_order = rms_by_order(spectrum(noisy - clean))
    data = plainly(points, noisy)
    wrong_random = np.random.default_rng([case.seed, 3])
    for mistake in case.mistakes:
        data = MISTAKES[mistake](wrong_random, data, machine.ratio)
    folder.mkdir(parents=True, exist_ok=True)
    rig = folder / "rig.toml"
    rig.write_text(machine.text())
    measured, bad, unreadable = write(case, machine, parts, data, folder)
    sigma = np.std(noisy - clean)
    strength = tuple(float(np.sqrt(np.sum(curves(part.waves(points), samples) ** 2)) / sigma) for part in parts)
    return Truth(
        case, machine, parts, points, data.points, known[:runs], hidden[:runs], new_points, known[runs:], hidden[runs:],
        noise_by_order, strength, bad, data.wrong, rig, measured, data, unreadable,
    )  # fmt: skip


def write(
    case: Case, machine: Machine, parts: tuple[Part, ...], data: Measured, folder: Path
) -> tuple[Path, tuple[str, ...], tuple[int, ...]]:
    """The files of a campaign in the case's form; their path, names of those that are broken, rows of no use."""
    if case.form == "table":
        path = folder / "measured.csv"
        orders = set(machine.orders()) | {order for part in parts for order in part.orders}
        files.write_table(data, path, sorted(orders))
        return path, (), ()
    path = folder / "measured"
    names = files.write_curves(data, path, case.form == "named", case.form == "comma")
    if not case.trouble:
        return path, (), ()
    random = np.random.default_rng([case.seed, 4])
    bad = files.spoil(random, path, names, case.trouble)
    return path, bad, tuple(names.index(name) for name in bad)
