"""From a campaign of the simulated rig to motions compensated by the generated code; see README.md.

python examples/motion/run.py --out build/example
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import subprocess
import sys
from pathlib import Path

from st_codegen.bundle import load
from st_codegen.rig import motion_files
from st_codegen.rig.effects import catalogue
from st_codegen.rig.machine import another_specimen, machine_of
from st_codegen.rig.model import RigModel, read_rig
from st_codegen.rig.motion import Rig
from st_codegen.rig.study import AUTO, Wish, simulate, with_oil
from st_codegen.rig.tasks import Form

RIG = Path(__file__).resolve().parent.parent / "rv160n" / "rig.toml"
ORDERS = (0, 1, 3, 39, 40, 78, 81, 156, 162, 240)
FEW = (0, 1, 39)
SPREAD, DRIFT_K_PER_MIN = 0.02, 1.5
#: Tuned to the rig, see docs/motion.md: a reversal takes the play up in some tens of milliseconds.
TUNED = {"fBlendTime_s": 0.02, "fHysteresis_rpm": 0.2}
STAGES = ("campaign", "train", "compile", "motion", "limits")


def command(*arguments: object) -> None:
    """Run st-codegen; stop at the first error."""
    texts = [str(argument) for argument in arguments]
    print("st-codegen", *texts, flush=True)
    subprocess.run([sys.executable, "-m", "st_codegen", *texts], check=True)


def campaign(out: Path) -> None:
    """The paper's grid, 1026 runs; a campaign that is there is kept."""
    if (out / "campaign").exists():
        return
    grid = itertools.product(range(100, 1801, 100), range(0, 1801, 100), (25, 30, 35))
    lines = ["speed_rpm,torque_Nm,temperature_C", *(",".join(map(str, point)) for point in grid)]
    (out / "conditions.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    command("simulate", "campaign", "--rig", RIG, "--conditions", out / "conditions.csv", "--out", out / "campaign",
            "--samples", 2048, "--seed", 1)  # fmt: skip


def train(out: Path) -> None:
    """Two of the ten families are enough for smooth and for piecewise constant models; --families takes more."""
    command(
        "train", out / "campaign", "--out", out / "models", "--orders", ",".join(map(str, ORDERS)), "--name", "example",
            "--families", "SVM,LGBM", "--folds", 3, "--cache", out / "curves.parquet", "--work", out / "fits.sqlite",
            "--table", out / "harmonics.csv", "--report", out / "training.html")  # fmt: skip


def compile_(out: Path) -> None:
    """Structured Text, and the proof."""
    command("generate", out / "models", "--target", "twincat", "--out", out)
    command("verify", out / "models", "--generated", out)


def machine(model: RigModel, *, spread: float = SPREAD, drift: float = DRIFT_K_PER_MIN) -> Rig:
    """A rig of the same type that differs from the trained one, with oil that warms up."""
    other = another_specimen(model, catalogue(()), spread, 11) if spread else model
    return with_oil(machine_of(other), 29.0, drift)


def motion(out: Path) -> None:
    """Both profiles, few and all orders, the laws; two tasks as published, and split with a lead."""
    rig, bundle = machine(read_rig(RIG)), load(out / "models")
    rows = []
    for profile in ("cycloidal", "robot"):
        for forms, lead, inputs, name in (
            ((Form.TWO,), 0.0, {}, profile),
            ((Form.SPLIT,), AUTO, TUNED, f"{profile}_split_lead"),
        ):
            wish = Wish((FEW, ORDERS), ("published", "continuous", "full"), forms, lead, inputs=inputs)
            study = simulate(rig, bundle, profile, wish, seed=5)
            motion_files.write(study, out / name)
            rows += [motion_files.row(study, outcome) for outcome in study.outcomes]
    (out / "motion.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    for row in rows:
        print(f"{row['profile']:10} {len(row['orders']):2} orders {row['law']:10} {row['tasks']:5} "
              f"RMS -{100 * row['rms_reduction']:.1f} %  maximum -{100 * row['max_reduction']:.1f} %")  # fmt: skip


def limits(out: Path) -> None:
    """What limits it: the best case, then one thing worse at a time."""
    model, bundle = read_rig(RIG), load(out / "models")
    best = Wish((ORDERS,), ("full",), (Form.SPLIT,), AUTO, inputs=TUNED)
    quiet = machine(model, spread=0.0, drift=0.0)
    encoders = dataclasses.replace(quiet.axis.encoders, input_noise_deg=3e-4, output_noise_deg=3e-4)
    ripple = dataclasses.replace(quiet.axis.load, torque_ripple_Nm=10.0)
    sensor = dataclasses.replace(quiet.axis.thermal, sensor_offset_K=2.0)

    def axis(**changes: object) -> Rig:
        return dataclasses.replace(quiet, axis=dataclasses.replace(quiet.axis, **changes))

    jitter = dataclasses.replace(quiet, tasks=dataclasses.replace(quiet.tasks, jitter_us=25.0))
    cases = {
        "best case": (quiet, best),
        "no lead": (quiet, dataclasses.replace(best, lead=0.0)),
        "all in the slow task, no lead": (quiet, dataclasses.replace(best, lead=0.0, forms=(Form.TWO,))),
        "encoder noise 1 arcsec": (axis(encoders=encoders), best),
        "jitter of 25 us": (jitter, best),
        "load ripples by 10 N m": (axis(load=ripple), best),
        "oil warms by 3 K a minute": (machine(model, spread=0.0, drift=3.0), best),
        "oil sensor off by 2 K": (axis(thermal=sensor), best),
        "rig differs by 2 %": (machine(model, spread=0.02, drift=0.0), best),
        "rig differs by 5 %": (machine(model, spread=0.05, drift=0.0), best),
        "orders 0, 1, 39": (quiet, dataclasses.replace(best, orders=(FEW,))),
        "continuous law": (quiet, dataclasses.replace(best, laws=("continuous",))),
        "published law": (quiet, dataclasses.replace(best, laws=("published",))),
        "blend of 0.1 s at reversals": (quiet, dataclasses.replace(best, inputs={})),
    }
    lines = ["profile,what,rms_before_deg,rms_after_deg,rms_reduction,max_reduction"]
    for profile in ("cycloidal", "robot"):
        for what, (rig, wish) in cases.items():
            study = simulate(rig, bundle, profile, wish, seed=5)
            row = motion_files.row(study, study.outcomes[0])
            numbers = (row[key] for key in ("rms_before", "rms_after", "rms_reduction", "max_reduction"))
            lines.append(f'{profile},"{what}",' + ",".join(f"{number:.6g}" for number in numbers))
            print(lines[-1], flush=True)
    (out / "limits.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Run the stages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("build/example"))
    parser.add_argument("--only", choices=STAGES, action="append", help="stages to run (default: all)")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    stages = dict(zip(STAGES, (campaign, train, compile_, motion, limits), strict=True))
    for name in arguments.only or STAGES:
        stages[name](arguments.out)


if __name__ == "__main__":
    main()
