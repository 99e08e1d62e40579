"""How many runs until the answer is right: proposed ones against grids.

Each case hides one effect of the default rig's kind, its sizes drawn by a seed. A small grid is measured; then the runs
that `reconcile` proposes are, round by round, until the answer is right. Against that stand grids of growing size, each
measured anew: a case needs the smallest from which on the next larger answers rightly too.

python benchmarks/next_runs.py [--seeds 8] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.reconcile.plan.next_runs import next_runs
from st_codegen.reconcile.run import Reconciliation, reconcile_observations
from st_codegen.rig.effects import Conditions, Effect, catalogue
from st_codegen.rig.model import RigModel, read_rig

RIG = Path(__file__).resolve().parent.parent / "examples" / "rv160n" / "rig.toml"
KNOWN = catalogue()
#: kinds of hidden effects, and the grids (speeds, torques, temperatures) in which their own condition gets denser
LEVELS = (3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40)
GRIDS = {
    "narrow resonance": [(count, 2, 2) for count in LEVELS],
    "backlash": [(2, count, 2) for count in LEVELS],
    "friction": [(count, 2, 2) for count in LEVELS],
}
#: proposed runs that are made before the next look, and looks at most
PORTION, MOST_ROUNDS = 6, 12
#: deg: noise of one component of a coefficient, and of the mean from run to run
NOISE, OF_MEAN = 1e-4, 5e-4


def cases(seed: int) -> dict[str, Effect]:
    """One hidden effect of each kind, drawn by a seed."""
    random = np.random.default_rng([seed, 5])
    constants = read_rig(RIG, KNOWN).constants

    def phases(count: int) -> list[float]:
        return [float(x) for x in random.uniform(-3, 3, count)]

    def sizes(count: int, low: float, high: float) -> list[float]:
        return [float(x) for x in np.exp(random.uniform(np.log(low), np.log(high), count))]

    def made(name: str, **values: Any) -> Effect:
        return KNOWN[name](values, constants)

    orders = [(156, 162, 240), (120, 156, 162), (81, 120, 156)][seed % 3]
    highest = min(orders) * 1700 / 60 / 81
    return {
        "narrow resonance": made(
            "structural_resonance", orders=list(orders), frequency_Hz=float(random.uniform(0.55, 1.0) * highest),
            damping_ratio=sizes(1, 0.006, 0.02)[0], amplitude_deg=sizes(3, 2e-3, 8e-3), phase_rad=phases(3),
            backward_amplitude_deg=sizes(3, 2e-3, 8e-3), backward_phase_rad=phases(3),
        ),
        "backlash": made("backlash", gap_arcmin=sizes(1, 0.4, 1.5)[0], seating_torque_Nm=sizes(1, 30, 120)[0]),
        "friction": made(
            "friction_windup", coulomb_arcmin=sizes(1, 0.1, 0.4)[0], viscous_arcmin_per_krpm=sizes(1, 0.05, 0.2)[0],
            viscosity_decay_per_K=sizes(1, 0.02, 0.08)[0],
        ),
    }  # fmt: skip


def grid(speeds: int, torques: int, temperatures: int) -> np.ndarray:
    """Operating points of a grid over the paper's ranges, (n, 3); one temperature is the middle."""
    warm = np.linspace(25, 35, temperatures) if temperatures > 1 else np.array([30.0])
    axes = np.meshgrid(np.linspace(100, 1800, speeds).round(), np.linspace(0, 1800, torques).round(), warm)
    return np.stack([axis.ravel() for axis in axes], axis=1)


def measured(truth: RigModel, points: np.ndarray, seed: int) -> Observations:
    """Both directions of every point with noise; a point that was measured before keeps its numbers."""
    at = Conditions.of(np.repeat([1.0, -1.0], len(points)), *np.concatenate([points, points]).T)
    orders = truth.orders()
    values = truth.coefficients(at, orders)
    noise = np.empty_like(values)
    for row in range(len(points)):
        random = np.random.default_rng([seed, row])
        parts = random.standard_normal((2, 2, len(orders)))
        noise[[row, row + len(points)]] = NOISE * (parts[0] + 1j * parts[1])
        noise[[row, row + len(points)], 0] = OF_MEAN * parts[0, :, 0]
    return Observations(at, labels(at), np.array(orders), values + noise)


def is_right(result: Reconciliation, hidden: Effect) -> bool:
    """Only the hidden effect is claimed, nothing else is said to be missing, and its numbers are right.

    Right numbers are within 5 % (of the largest of a list), frequencies within 0.5 %.
    """
    found = result.conclusions
    names = [claim.piece.effect.name for claim in found.claims]
    if names != [hidden.name] or found.retuned or result.unexplained or found.claims[0].alternatives:
        return False
    own = found.claims[0].piece.effect
    if hidden.orders != own.orders:
        return False
    for key, value in hidden.values.items():
        limit = 0.005 if key == "frequency_Hz" else 0.05
        if "phase" in key or key in ("order", "orders"):
            continue
        if key not in own.values or np.abs(np.subtract(own.values[key], value)).max() > limit * np.abs(value).max():
            return False
    return True


def with_proposals(rig: RigModel, truth: RigModel, hidden: Effect, start: np.ndarray, seed: int) -> tuple[int, str]:
    """Runs until the answer is right, with the proposed ones, and how it ended; 0 where it never was."""
    points = start
    for _ in range(MOST_ROUNDS):
        result = reconcile_observations(rig, measured(truth, points, seed), KNOWN)
        if is_right(result, hidden):
            return len(points), "right"
        proposed = next_runs(result)
        if not proposed.runs:
            return 0, proposed.none_because
        points = np.concatenate([points, [astuple(run.point) for run in proposed.runs[:PORTION]]])
    return 0, f"not within {len(points)} runs"


def by_grid(rig: RigModel, truth: RigModel, hidden: Effect, grids: Sequence[tuple[int, int, int]], seed: int) -> int:
    """Runs of the smallest grid that answers rightly, as the next larger does; 0 where none does."""
    before = 0
    for number, counts in enumerate(grids):
        points = grid(*counts)
        result = reconcile_observations(rig, measured(truth, points, 1000 * seed + number), KNOWN)
        if is_right(result, hidden):
            if before:
                return before
            before = len(points)
        else:
            before = 0
    return before


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cases and print how many runs each way took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kind", choices=list(GRIDS), action="append", help="kinds of hidden effects (default: all)")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args(arguments)
    rig = read_rig(RIG, KNOWN)
    rows = []
    for seed in range(options.first, options.first + options.seeds):
        for kind, hidden in cases(seed).items():
            if kind not in (options.kind or GRIDS):
                continue
            known = rig.with_effects(e for e in rig.effects if e.name != hidden.name)
            truth = known.with_effects([*known.effects, hidden])
            proposed, how = with_proposals(known, truth, hidden, grid(*GRIDS[kind][0]), seed)
            needs = by_grid(known, truth, hidden, GRIDS[kind], seed)
            rows.append({"kind": kind, "seed": seed, "proposed": proposed, "grid": needs, "ended": how})
            line = f"{proposed or '-':>4} runs with proposals, grid {needs or '-':>4}   {how}"
            print(f"{kind:18} seed {seed}: {line}", flush=True)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
