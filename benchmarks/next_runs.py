"""How many runs until the answer is right: proposed ones against grids.

Each case hides one effect of the default rig's kind, its sizes drawn by a seed. A small grid is measured; then the runs
that `reconcile` proposes are, round by round, until the answer is right, and right after the next round too. Against
that stand grids of growing size, each measured anew: a case needs the smallest of which the next larger answers rightly
too.

python benchmarks/next_runs.py [--seeds 5] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.reconcile.plan.next_runs import next_runs
from st_codegen.reconcile.result import Reconciliation
from st_codegen.rig.effects import Conditions, Effect, catalogue
from st_codegen.rig.model import RigModel, read_rig

RIG = Path(__file__).resolve().parent.parent / "examples" / "rv160n" / "rig.toml"
KNOWN = catalogue()
#: grids (speeds, torques, temperatures): `even` ones get denser in all conditions, as who does not know what is hidden
#: makes them; the others in the one condition that tells most of the hidden effect
LEVELS = (3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40)
EVEN = [(3, 2, 2), (4, 3, 2), (5, 4, 2), (6, 5, 2), (8, 6, 2), (12, 6, 2), (16, 8, 2), (16, 8, 3), (24, 10, 3)]
GRIDS = {
    "narrow resonance": [(count, 2, 2) for count in LEVELS],
    "backlash": [(6, count, 2) for count in LEVELS],
    "friction": [(count, 2, 2) for count in LEVELS],
}
START = (3, 2, 2)
WAYS = ("proposed", "even", "own")
#: proposed runs that are made before the next look, and looks at most
PORTION, MOST_ROUNDS = 6, 12
#: share of the hidden effect (RMS over all conditions) that a right answer may leave
MOST_LEFT = 0.1
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
    """Only the hidden effect is claimed, nothing else is said to be missing, and the rest of its waves is small.

    Between all runs too: on a dense grid of conditions at most a tenth of it (RMS) is left.
    """
    found = result.conclusions
    if [claim.piece.effect.name for claim in found.claims] != [hidden.name]:
        return False
    if found.retuned or result.unexplained or found.claims[0].alternatives:
        return False
    points = grid(81, 7, 3)
    at = Conditions.of(np.repeat([1.0, -1.0], len(points)), *np.concatenate([points, points]).T)
    orders = np.array(sorted({*hidden.touched_orders(), *found.claims[0].piece.effect.touched_orders()}))
    true, own = (effect.contribution(at, orders) for effect in (hidden, found.claims[0].piece.effect))
    return bool(np.linalg.norm(own - true) < MOST_LEFT * np.linalg.norm(true))


def with_proposals(rig: RigModel, truth: RigModel, hidden: Effect, seed: int) -> tuple[int, str]:
    """Runs from which on the answer is right, with the proposed ones, and how it ended; 0 where it never was."""
    points, before = grid(*START), 0
    for _ in range(MOST_ROUNDS):
        result = reconcile_observations(rig, measured(truth, points, seed), KNOWN)
        right = is_right(result, hidden)
        if right and before:
            return before, "right"
        before = len(points) if right else 0
        proposed = next_runs(result)
        if not proposed.runs:
            return before, "right" if right else proposed.none_because
        points = np.concatenate([points, [astuple(run.point) for run in proposed.runs[:PORTION]]])
    return 0, f"not within {len(points)} runs"


def by_grid(rig: RigModel, truth: RigModel, hidden: Effect, grids: Sequence[tuple[int, int, int]], seed: int) -> int:
    """Runs of the smallest grid that answers rightly, as the next larger does; 0 where none does."""
    before = 0
    for number, counts in enumerate(grids):
        points = grid(*counts)
        result = reconcile_observations(rig, measured(truth, points, 1000 * seed + number), KNOWN)
        if not is_right(result, hidden):
            before = 0
        elif before:
            return before
        else:
            before = len(points)
    return 0


def case(rig: RigModel, kind: str, seed: int) -> dict[str, Any]:
    """One case: runs that each way needs, 0 where the answer never becomes right."""
    hidden = cases(seed)[kind]
    known = rig.with_effects(e for e in rig.effects if e.name != hidden.name)
    truth = known.with_effects([*known.effects, hidden])
    proposed, how = with_proposals(known, truth, hidden, seed)
    even, own = (by_grid(known, truth, hidden, grids, seed) for grids in (EVEN, GRIDS[kind]))
    return {"kind": kind, "seed": seed, "proposed": proposed, "even": even, "own": own, "ended": how}


def table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Runs of every case, and of all cases of a kind that came out right each way."""
    lines = ["| hidden | proposals | grid, denser in all conditions | grid, denser in the one that matters |"]
    lines.append("|---|---|---|---|")
    for kind in GRIDS:
        own = [row for row in rows if row["kind"] == kind]
        columns = (", ".join(str(row[way] or "none") for row in own) for way in WAYS)
        lines += [f"| {kind} | {' | '.join(columns)} |"] * bool(own)
    for way in WAYS[1:]:
        both = [row for row in rows if row["proposed"] and row[way]]
        sums = [sum(row[key] for row in both) for key in ("proposed", way)]
        half = sum(2 * row["proposed"] <= row[way] for row in both)
        lines.append(f"{way}: {len(both)} of {len(rows)} cases right both ways, {sums[0]} runs against {sums[1]}; "
                     f"at most half in {half}")  # fmt: skip
    return lines


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the cases that FILE does not have yet, and print how many runs each way took."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kind", choices=list(GRIDS), action="append", help="kinds of hidden effects (default: all)")
    parser.add_argument("--json", type=Path, help="results; those that stand there already are kept")
    options = parser.parse_args(arguments)
    rig = read_rig(RIG, KNOWN)
    rows = json.loads(options.json.read_text(encoding="utf-8")) if options.json and options.json.is_file() else []
    done = {(row["kind"], row["seed"]) for row in rows}
    for seed in range(options.first, options.first + options.seeds):
        for kind in options.kind or GRIDS:
            if (kind, seed) in done:
                continue
            rows.append(case(rig, kind, seed))
            print(", ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
            if options.json:
                options.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
