"""From a rig that nobody has measured to a compensated motion, all of it over ADS; see README.md.

python examples/commissioning/run.py --out build/commissioning
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from st_codegen.live.controller import Controller, Signal, connected
from st_codegen.rig.model import read_rig

ROOT = Path(__file__).resolve().parents[2]
RV160N = ROOT / "examples" / "rv160n"
RATIO = 81.0


@dataclass(frozen=True)
class Scale:
    """How much is measured, learned, compared and moved."""

    speeds_rpm: tuple[int, ...] = (600, 1000, 1400, 1800)
    torques_Nm: tuple[int, ...] = (0, 200, 600, 1200)
    temperatures_C: tuple[int, ...] = (25, 30)
    orders: str = "0,1,3,39,40,78,81,156,162,240"
    rows: int = 5000
    moved: int = 2000


#: A minute or two, for a first look and for the tests.
QUICK = Scale((1200, 1500, 1800), (0, 150, 400, 900), (25, 26), "0,1,39", 2000, 300)
#: What the axis of the example does quicker than by default, so that nobody waits for it.
INPUTS = ("fAcceleration_rpm_s=5000", "fHomingSpeed_rpm=200")


class Example:
    """The stages, one after another; the controller is `st-codegen serve` with the simulated rig behind it."""

    def __init__(self, out: Path, scale: Scale) -> None:
        self.out, self.scale = out, scale
        self.rig = out / "rig.toml"

    def prepare(self) -> None:
        """The rig, and a first project: it has to measure, its model is of another machine and is not used."""
        text = (RV160N / "rig.toml").read_text(encoding="utf-8")
        self.rig.write_text(f"{text}\n[axis.thermal]\nstart_C = {self.scale.temperatures_C[0]}\n", encoding="utf-8")
        models = self.out / "first_models"
        shutil.rmtree(models, ignore_errors=True)
        models.mkdir()
        bundle = (RV160N / "models" / "bundle.toml").read_text(encoding="utf-8")
        head, *tables = bundle.split("[[harmonic]]")
        kept = [table for table in tables if "\norder = 0\n" in table]
        names = [line.split('"')[1] for table in kept for line in table.splitlines() if line.startswith("amplitude")]
        for name in names:
            shutil.copy2(RV160N / "models" / name, models)
        lines = ["orders = [0]" if line.startswith("orders") else line for line in head.splitlines()]
        text = "\n".join(lines) + "\n" + "".join(f"[[harmonic]]{table}" for table in kept)
        (models / "bundle.toml").write_text(text, encoding="utf-8")
        command("generate", models, "--target", "twincat", "--with-comparison", "--out", self.out / "first")

    def measure(self) -> None:
        """The campaign: every operating point, both directions; a second call makes what is missing."""
        scale, plan = self.scale, self.out / "conditions.csv"
        points = itertools.product(scale.temperatures_C, scale.speeds_rpm, scale.torques_Nm)
        lines = ["speed_rpm,torque_Nm,temperature_C", *(f"{s},{m},{t}" for t, s, m in points)]
        plan.write_text("\n".join(lines) + "\n", encoding="utf-8")
        settings = [word for text in INPUTS for word in ("--set", text)]
        with self._serving(self.out / "first") as ads:
            command("record", "--generated", self.out / "first", "--ads", ads, "--plan", plan, *settings,
                    "--alive", 600, "--timeout", 30, "--out", self.out / "campaign")  # fmt: skip

    def learn(self) -> None:
        """Models of the measured rig, and their text."""
        models = self.out / "models"
        command("train", self.out / "campaign", "--out", models, "--name", "commissioned", "--families", "SVM",
                "--orders", self.scale.orders, "--folds", 2, "--keep-faulty", "--jobs", 1)  # fmt: skip
        command("generate", models, "--target", "twincat", "--with-comparison", "--out", self.out)
        command("verify", models, "--generated", self.out, "--rows", 1000)

    def check(self) -> None:
        """The text on the controller against the models, then a motion with and without the correction."""
        with self._serving(self.out) as ads:
            command("compare", self.out / "models", "--generated", self.out, "--ads", ads, "--rows", self.scale.rows,
                    "--html", self.out / "commissioning.html", "--json", self.out / "commissioning.json",
                    "--calibrated", self.out / "measured.toml", "--same-bits", "--timeout", 30)  # fmt: skip
            with connected(ads, None, 30.0) as controller:
                found = [self._moved(controller, enabled) for enabled in (False, True)]
        before, after = found
        gone = 1.0 - after / before
        print(f"transmission error at the output, RMS about its mean: {before:.5f} deg, compensated {after:.5f} deg "
              f"({gone:.1%} gone)")  # fmt: skip
        motion = {"rms_before_deg": before, "rms_after_deg": after, "gone": gone}
        (self.out / "motion.json").write_text(json.dumps(motion, indent=1) + "\n", encoding="utf-8")

    def explain(self) -> None:
        """What a rig model lacks that knows nothing of the eccentricity of the output shaft."""
        rig, known = read_rig(RV160N / "rig.toml"), self.out / "known.toml"
        effects = [effect for effect in rig.effects if effect.name != "output_shaft_eccentricity"]
        known.write_text(rig.with_effects(effects).text(), encoding="utf-8")
        command("reconcile", "--rig", known, "--measured", self.out / "campaign", "--out", self.out / "reconciled")
        report = json.loads((self.out / "reconciled" / "report.json").read_text(encoding="utf-8"))
        print(f"reconcile: {report['verdict']}, {', '.join(effect['name'] for effect in report['effects'])}")

    def _moved(self, controller: Controller, enabled: bool) -> float:
        """RMS of what the output has beside its reference, at a speed and torque that no run of the campaign had."""
        machine = {name: Signal(f"GVL_Machine.{name}") for name in ("fSpeed_rpm", "fTorque_Nm", "fThetaOut_rad")}
        signals = [
            Signal("GVL_Experiment.fThetaIn_rad"),
            machine["fThetaOut_rad"],
            Signal("GVL_Machine.fCorrection_deg"),
        ]
        controller.write(Signal("GVL_Machine.bEnable", "|b1"), enabled)
        controller.write(machine["fTorque_Nm"], 250.0)
        controller.write(machine["fSpeed_rpm"], 1350.0)
        time.sleep(1.0)
        rows = []
        for _ in range(self.scale.moved):
            rows.append(controller.read_all(signals))
            time.sleep(0.002)
        controller.write(machine["fSpeed_rpm"], 0.0)
        inner, outer, correction = np.array(rows).T
        # the reference is what the motor was told without its correction
        error = np.degrees(outer) - (np.degrees(inner) - correction) / RATIO
        return float(np.std(error))

    @contextlib.contextmanager
    def _serving(self, generated: Path) -> Iterator[str]:
        """A controller with the rig behind it, as fast as this machine can; its address."""
        arguments = ["serve", "--generated", generated, "--ads", "--ads-port", 0, "--speed", 0, "--rig", self.rig]
        with (self.out / "serve.log").open("a", encoding="utf-8") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "st_codegen", *map(str, arguments)],
                stdout=subprocess.PIPE,
                stderr=log,
                text=True,
            )
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            if not line.startswith("ADS "):
                raise SystemExit(f"serve did not start, see {self.out / 'serve.log'}")
            yield f"127.0.0.1.1.1:851@{line.split()[1].rstrip(',')}"
        finally:
            process.terminate()
            process.wait(60)


def command(*arguments: object) -> None:
    """Run st-codegen; an error ends the example."""
    texts = [str(argument) for argument in arguments]
    print("st-codegen", *texts, flush=True)
    done = subprocess.run([sys.executable, "-m", "st_codegen", *texts], check=False)
    if done.returncode:
        raise SystemExit(done.returncode)


def main(arguments: list[str] | None = None) -> None:
    """Run the stages."""
    stages = ("prepare", "measure", "learn", "check", "explain")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("build/commissioning"))
    parser.add_argument("--only", choices=stages, action="append", help="stages to run (default: all)")
    parser.add_argument("--quick", action="store_true", help="few runs, three orders")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    example = Example(options.out, QUICK if options.quick else Scale())
    for name in options.only or stages:
        print(f"--- {name}", flush=True)
        getattr(example, name)()


if __name__ == "__main__":
    main()
