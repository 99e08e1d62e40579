"""What it saves a call, and costs the compensation, to spread the models of a bundle over calls.

    python benchmarks/spread.py [--bundle paper|example] [--outputs 13 6 ..]

For each number of outputs in a cycle: the calls of a round, the worst case of a call of FB_Compensator by the cost
model (cx5140), and what the generated text takes off the error of a motion, where models run in a task of 500 us and
the sum in one of 250 us, with a lead. The bundle of the paper moves the measured harmonic table that its models were
trained on, the example its rig.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.race_bundle import trained
from st_codegen.cost.profile import load_profile
from st_codegen.cost.report import project_cost
from st_codegen.driver import generate
from st_codegen.passes.choose import Options
from st_codegen.project.bundle import Bundle, load
from st_codegen.rig.machine import read_machine
from st_codegen.rig.measured import MeasuredHarmonics
from st_codegen.rig.model import RigModel, read_rig
from st_codegen.rig.motion import Rig
from st_codegen.rig.study import AUTO, MotionWish, simulate
from st_codegen.rig.tasks import TaskForm
from st_codegen.st import load_project
from st_codegen.te.check import calls_of
from st_codegen.te.purpose import transmission_error
from tests.families import CHOICE, SHARED

EXAMPLE = Path(__file__).resolve().parents[1] / "examples" / "rv160n"
PROFILES = ("cycloidal", "robot")


def _paper(folder: Path) -> tuple[Bundle, Rig]:
    rig = read_rig(EXAMPLE / "rig.toml")
    measured = MeasuredHarmonics.read(SHARED / "rv160n_harmonics.csv")
    file = folder / "rig.toml"
    RigModel("measured", rig.constants, measured=measured, other=rig.other).write(file)
    return load(trained("te-bundle-paper", CHOICE), trust_pickle=True), read_machine(file)[1]


def _row(bundle: Bundle, rig: Rig, mean: int | None, folder: Path) -> str:
    """One row of the table."""
    made = generate(bundle, "twincat", folder, options=Options(outputs_per_cycle=mean))
    calls = calls_of(made.folder)
    cost = project_cost(load_project([made.folder], "twincat"), load_profile(), ["FB_Compensator"])
    age = f"{calls - 1} to {2 * calls - 2}" if calls > 1 else "0"
    cells = [str(mean or "all"), str(calls), f"{cost.warm_us:.0f}", f"{cost.cold_us:.0f}", age]
    orders = transmission_error(bundle).orders
    wish = MotionWish((orders,), ("full",), (TaskForm.SPLIT,), AUTO, outputs_per_cycle=mean)
    for profile in PROFILES:
        outcome = simulate(rig, bundle, profile, wish).outcomes[0]
        cells += [f"{100 * gone:.2f} %" for gone in outcome.reduction]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the table row by row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bundle", choices=("paper", "example"), default="paper" if SHARED.is_dir() else "example")
    parser.add_argument("--outputs", type=int, nargs="+", default=[19, 13, 8, 6, 4, 2])
    arguments = parser.parse_args()
    named = [f"{profile}: {what} gone" for profile in PROFILES for what in ("RMS", "maximum")]
    print(f"| outputs a cycle | calls | us warm | us cold | age, calls | {' | '.join(named)} |")
    print("|--:|--:|--:|--:|--:|" + "--:|" * len(named))
    with tempfile.TemporaryDirectory() as folder:
        if arguments.bundle == "paper":
            bundle, rig = _paper(Path(folder))
        else:
            bundle, rig = load(EXAMPLE / "models"), read_machine(EXAMPLE / "rig.toml")[1]
        for mean in (None, *arguments.outputs):
            print(_row(bundle, rig, mean, Path(folder) / "out"), flush=True)


if __name__ == "__main__":
    main()
