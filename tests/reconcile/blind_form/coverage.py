"""Whether stated errors are true where the form is wrong: `python -m tests.reconcile.blind_form.coverage`.

What endless data would give is fitted to runs without noise, many times as dense, by the same effects. Each number that
is stated must lie there within its 95 % interval; errors that take the form for right are shown beside it.
"""

from __future__ import annotations

import argparse
import copy
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.reconcile.fit.fitting import Fit, fit
from st_codegen.reconcile.fit.state import State
from st_codegen.reconcile.fit.target import FitData, groups_of
from st_codegen.reconcile.judge.errors import standard_errors
from st_codegen.reconcile.result import Reconciliation
from st_codegen.rig.effects import Conditions, catalogue
from st_codegen.rig.model import RigModel, parse_rig

from .cases import Case, listed
from .machine import silent_rig
from .make import SAMPLES, draw
from .measuring import NOISE_UNIT
from .points import Complex, Part, Points

KINDS = (
    "two_mass", "mesh_two_thirds", "mesh_square", "mesh_saturating", "hertz_spring", "resonance_drift_torque",
    "stepped_spring", "stribeck",
)  # fmt: skip
#: first number of the cases; those of more noise hide the form
FIRST, LOUDEST = 5000, 10.0
WAYS = ("of independent noise", "of noise in common", "stated")


def cases(count: int) -> list[Case]:
    """As many cases of each kind, on the layouts that tell a law."""
    found: list[Case] = []
    number = FIRST
    while len(found) < count:
        (case,) = listed("dev", 1, number)
        number += 1
        plain = case.kind in KINDS and not case.mistakes and not case.trouble
        enough = sum(one.kind == case.kind for one in found) >= count / len(KINDS)
        if plain and not enough and case.layout != "twelve" and case.noise <= LOUDEST:
            found.append(case)
    return found


def coefficients(rig: RigModel, parts: Sequence[Part], points: Points, orders: Sequence[int]) -> Observations:
    """The truth in both directions of all points."""
    runs = len(points)
    columns = [np.tile(part, 2) for part in (points.speed, points.torque, points.temperature)]
    at = Conditions.of(np.repeat([1.0, -1.0], runs), *columns)
    values: Complex = rig.coefficients(at, list(orders)).astype(np.complex128)
    for part in parts:
        for order, wave in part.waves(points).items():
            if order in orders:
                values[:, orders.index(int(order))] += np.concatenate([wave[:, 0], wave[:, 1]])
    values[:, 0] = values[:, 0].real
    return Observations(at, labels(at), np.array(orders), values)


def dense(points: Points) -> Points:
    """Forty speeds, nine torques and three temperatures of what was measured."""
    axes = [np.linspace(x.min(), x.max(), count) for x, count in ((points.speed, 40), (points.torque, 9))]
    oil = np.unique(points.temperature)
    grid = [axis.ravel() for axis in np.meshgrid(*axes, oil if len(oil) <= 3 else np.linspace(oil[0], oil[-1], 3))]
    return Points(*grid, np.linspace(0, 1, len(grid[0])), np.arange(len(grid[0])))


def endless(result: Reconciliation, data: Observations) -> State:
    """What the same effects become on dense data without noise."""
    own, state = result.conclusions.final.target, result.conclusions.final.state
    sigma = np.broadcast_to(np.median(own.sigma[own.good], axis=0), data.values.shape).copy()
    good = np.ones(len(data), bool)
    target = FitData(
        data, sigma, good, groups_of(data.at), own.reduction_ratio, own.reference_temperature_C, own.run_offset_deg
    )
    for _ in range(3):
        state = fit(target.about(target.residual(state.model())), state, steps=30).state
    return state


def judged(case: Case) -> list[list[bool]]:
    """Of each stated number of a case, whether the interval of each of WAYS holds it."""
    machine, parts, points, _ = draw(case)
    rig = parse_rig(silent_rig(machine.text()), known=catalogue())
    seen = {int(order) for part in parts for order in part.waves(points.take(np.arange(2)))}
    orders = sorted(order for order in {0, *rig.orders(), *seen} if order <= SAMPLES // 4)
    data = coefficients(rig, parts, points, orders)
    random = np.random.default_rng([case.seed, 2, case.level])
    noise = random.standard_normal(data.values.shape) + 1j * random.standard_normal(data.values.shape)
    noise[:, 0] = noise[:, 0].real / np.sqrt(2.0)
    values = data.values + case.noise * NOISE_UNIT * np.sqrt(2 / SAMPLES) * noise
    result = reconcile_observations(rig, replace(data, values=values), catalogue())
    found, joint = result.conclusions, result.conclusions.joint
    stated = [(claim.piece.effect, claim.stderr) for claim in found.claims]
    stated += [(entry.after, entry.stderr) for entry in found.retuned]
    if not stated:
        return []
    true = endless(result, coefficients(rig, parts, dense(points), orders))
    rows = []
    for effect, errors in stated:
        number = next(i for i, piece in enumerate(found.final.state.pieces) if piece.effect is effect)
        ways = [standard_errors(_with(joint, part), number) for part in (joint.inverse, joint.covariance)]
        for key, error in errors.items():
            off = _number(effect.values, key, effect.orders) - _number(
                true.pieces[number].effect.values, key, effect.orders
            )
            off = (off + np.pi) % (2 * np.pi) - np.pi if "phase" in key else off
            rows.append([abs(off) <= 1.96 * one for one in (*(way[key] for way in ways), error)])
    return rows


def _with(joint: Fit, covariance: np.ndarray) -> Fit:
    """A fit whose errors come from another covariance."""
    found = copy.copy(joint)
    found.__dict__["covariance_with_form"] = covariance
    return found


def _number(values: Mapping[str, Any], key: str, orders: Sequence[int]) -> float:
    """A parameter, or the entry of a list for an order: `key[order]`."""
    name, _, order = key.partition("[")
    value = values[name]
    return float(value[orders.index(int(order[:-1]))] if order else value)


def main(values: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=40)
    rows = []
    for case in cases(parser.parse_args(values).cases):
        own = judged(case)
        rows += own
        sys.stdout.write(f"{case.name}: {sum(row[-1] for row in own)} of {len(own)}\n")
    shares = ", ".join(f"{name} {100 * share:.1f} %" for name, share in zip(WAYS, np.mean(rows, axis=0), strict=True))
    sys.stdout.write(f"{len(rows)} numbers inside their 95 % intervals: errors {shares}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
