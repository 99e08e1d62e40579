"""Models of each axis alone against models of the type with corrections: error on fresh runs, and bytes of tables.

Twenty axes as in `fleet.py`, whose sizes differ by 5 % (standard deviation) and whose phases of mounting are any. Each
has some runs a direction at operating points of its own, as a harmonic table with the noise that runs of 512 samples
have. Errors are root mean squares over fresh operating points of what is left of the noiseless transmission error.

    python benchmarks/fleet_shared.py 8 16 32
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np
from fleet import axis

from st_codegen.campaign.conditions import Conditions
from st_codegen.campaign.harmonic_table import HarmonicTable
from st_codegen.driver import generate
from st_codegen.project.bundle import load
from st_codegen.rig.model import RigModel
from st_codegen.te.harmonics import AxisCorrection, Direction
from st_codegen.training import shared
from st_codegen.training.export import FittedModel, write_bundle
from st_codegen.training.families import candidates
from st_codegen.training.learn import LearningPlan, bundle_head, learn
from st_codegen.training.search import Fitting
from st_codegen.training.store import FitStore
from st_codegen.training.study import SearchSettings

AXES, FRESH, ORDERS = 20, 200, (0, 1, 2, 40)
#: White noise of 0.0005 deg over 512 samples; 0.001 deg from run to run in the mean.
NOISE_DEG, RUN_DEG = 0.0005 * np.sqrt(2 / 512), 0.001


def turned(rig: RigModel, number: int) -> RigModel:
    """The same axis, mounted at other angles."""
    random = np.random.default_rng([2, number])
    effects = [
        effect.with_values(
            {key: random.uniform(-3, 3) if key == "phase_rad" else value for key, value in effect.values.items()}
        )
        for effect in rig.effects
    ]
    return rig.with_effects(effects)


def measured(rig: RigModel, runs: int, seed: int, *, noise: bool) -> HarmonicTable:
    """Runs in both directions at operating points that are drawn, those of a grid of speeds and loads in the mean."""
    random = np.random.default_rng(seed)
    speed = np.repeat(random.choice([200.0, 600.0, 1000.0, 1400.0], runs), 2)
    torque = np.repeat(random.uniform(0.0, 1200.0, runs).round(), 2)
    oil = np.repeat(random.uniform(25.0, 35.0, runs).round(1), 2)
    sign = np.tile([1.0, -1.0], runs)
    found = rig.coefficients(Conditions(sign, speed, torque, oil), ORDERS)
    if noise:
        found = found + NOISE_DEG * (random.standard_normal(found.shape) + 1j * random.standard_normal(found.shape))
        found[:, 0] += RUN_DEG * random.standard_normal(len(found))
    found[:, 0] = found[:, 0].real
    return HarmonicTable(sign < 0, speed, torque, oil, ORDERS, found)


def left(models: list[FittedModel], corrections: tuple[AxisCorrection, ...], fresh: HarmonicTable) -> float:
    """Mean square of what models leave of fresh runs, deg^2."""
    errors = []
    for direction in Direction:
        rows = fresh.direction(direction)
        predicted = np.empty(rows.coefficients.shape, np.complex128)
        for place, order in enumerate(ORDERS):
            of = {
                m.quantity: m.estimator.predict(rows.conditions)
                for m in models
                if (m.direction, m.order) == (direction, order)
            }
            if "cosine" in of:
                value = of["cosine"] + 1j * of["sine"]
            else:
                value = of["amplitude"] * np.exp(1j * of.get("phase", 0.0))
            for own in corrections:
                if (own.direction, own.order) == (direction, order):
                    value = complex(*own.parts) * value + own.offset_deg
            predicted[:, place] = value
        errors.append(shared.squared_errors(ORDERS, predicted, rows.coefficients))
    return float(np.concatenate(errors).mean())


def table_bytes(models: list[FittedModel], table: HarmonicTable) -> int:
    """Bytes of the tables of generated blocks."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_bundle(folder / "models", bundle_head(table, "axis", 81.0), models)
        generate(load(folder / "models"), "twincat", folder / "plc")
        (manifest,) = (folder / "plc").rglob("st-codegen.json")
        return sum(block["data_bytes"] for block in json.loads(manifest.read_text())["blocks"].values())


def compared(runs: int, families: tuple[str, ...]) -> None:
    """One line: axes with so many runs a direction."""
    plan = LearningPlan(SearchSettings(candidates(families), 2))
    rigs = {f"r{number}": turned(axis(number)[0], number) for number in range(AXES)}
    tables = {name: measured(rig, runs, number, noise=True) for number, (name, rig) in enumerate(rigs.items())}
    fresh = {name: measured(rig, FRESH, 1000 + number, noise=False) for number, (name, rig) in enumerate(rigs.items())}
    points = shared.held_out_points(tables, plan.test_share, 0)
    started = time.process_time()
    with FitStore(None) as store:
        lesson = shared.learn_shared(tables, plan, points, Fitting(store))
        seconds = time.process_time() - started
        with_type = {name: left(list(lesson.models), lesson.corrections[name], fresh[name]) for name in tables}
        own, own_bytes, taken, asked = {}, 0, 0, 0
        for name, table in tables.items():
            try:
                alone = float(shared.own_errors(table, plan, points, Fitting(store)).mean())
                asked += 1
                taken += float(lesson.errors[name].mean()) <= alone
            except shared.InputError:  # none of its runs is held out in a direction
                pass
            if runs < shared.LEAST_POINTS:
                average = {d: table.direction(d).coefficients.mean(axis=0) for d in Direction}
                errors = [
                    shared.squared_errors(ORDERS, average[d][None], fresh[name].direction(d).coefficients)
                    for d in Direction
                ]
                own[name] = float(np.concatenate(errors).mean())
            else:
                models = [m for d in Direction for m in learn(table, d, plan, Fitting(store)).models]
                own[name] = left(models, (), fresh[name])
                own_bytes += table_bytes(models, table)
        type_bytes = table_bytes(list(lesson.models), next(iter(tables.values())))
    of_type, alone = (np.sqrt(np.mean(list(errors.values()))) for errors in (with_type, own))
    better = sum(with_type[name] <= own[name] for name in tables)
    otherwise = "with own models" if own_bytes else "with the average of the runs"
    print(
        f"{runs:3} runs: left {1e3 * of_type:.3f}e-3 deg with models of the type, {1e3 * alone:.3f}e-3 deg "
        f"{otherwise}; no worse for {better} of {AXES}, taken by {taken} of {asked}; tables {type_bytes:,} bytes once, "
        f"{own_bytes:,} of own models of all; {seconds:.1f} CPU s",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=int, nargs="*", default=[8, 16, 32], help="runs a direction of each axis")
    parser.add_argument("--families", default="DT,SVM", help="as in train")
    options = parser.parse_args()
    for runs in options.runs:
        compared(runs, tuple(options.families.split(",")))


if __name__ == "__main__":
    main()
