"""From a campaign of the simulated rig to motions compensated by the generated code; see README.md.

python examples/motion/run.py --out build/example
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import math
import os
import shutil
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gains import gain_jobs
from jobs import AHEAD, ANOTHER, RIG, TUNED, Job, Machine, digest, run_job, write
from real import CASES, real_jobs, write_rigs
from tables import gains_table, into_page, limits_table, motion_table

from st_codegen.campaign.harmonic_table import HarmonicTable, read_table, write_table
from st_codegen.cli.main import main as st_codegen
from st_codegen.report import PageSection, PageTable, page
from st_codegen.rig.model import RigModel, read_rig
from st_codegen.rig.motion import LoadSource
from st_codegen.rig.study import AUTO, MotionWish
from st_codegen.rig.tasks import TaskForm

STAGES = ("campaign", "more", "train", "compile", "motion", "limits", "gains")


@dataclass(frozen=True)
class Scale:
    """How much is measured, learned and moved."""

    # the paper's grid of 18 x 19 x 3 runs, and three loads more where the lash closes and motions spend much time
    speeds_rpm: tuple[int, ...] = tuple(range(100, 1801, 100))
    torques_Nm: tuple[int, ...] = (0, 25, 50, 75, *range(100, 1801, 100))
    temperatures_C: tuple[int, ...] = (25, 30, 35)
    samples: int = 2048
    orders: tuple[int, ...] = (0, 1, 3, 39, 40, 78, 81, 156, 162, 240)
    few: tuple[int, ...] = (0, 1, 39)
    # smooth in the operating point, unlike trees; with SVM or MLP by cross-validation the tuning motion was no better
    families: str = "SVM"
    folds: int = 3
    profiles: tuple[str, ...] = ("cycloidal", "robot")
    # of at most 12 proposed runs each
    rounds: int = 1


#: Seconds of everything, for a first look and for the tests.
QUICK = Scale((200, 800, 1400, 1800), (0, 600, 1200, 1800), (25, 35), 512, (0, 1), (0, 1), "SVM", 2, ("quick.csv",), 1)
QUICK_PROFILE = "t,theta_out,torque_Nm\n0,0,100\n0.1,3,200\n0.2,9,200\n0.3,12,100\n0.35,12,100\n"


TUNING_MOVES = ((30.0, 1.0), (-50.0, 1.2), (35.0, 0.9))


def tuning_profile() -> str:
    """There and back on cycloidal laws (deg, s), 0.15 s of rest after each, a load of 20 to 150 N m."""
    rows, start, angle = ["t,theta_out,torque_Nm"], 0.0, 0.0
    for travel, duration in TUNING_MOVES:
        for step in range(round(duration / 0.002)):
            u = step * 0.002 / duration
            done = u - math.sin(2 * math.pi * u) / (2 * math.pi)
            load = 20 + 130 * math.sin(math.pi * u) ** 2
            rows.append(f"{start + step * 0.002:.6f},{angle + travel * done:.9f},{load:.6f}")
        start, angle = start + duration + 0.15, angle + travel
        rows += [f"{start - 0.15:.6f},{angle},20", f"{start - 0.002:.6f},{angle},20"]
    return "\n".join(rows) + "\n"


def tuning_jobs() -> list[Job]:
    """Ways to change from one direction's set to the other's at a reversal."""
    plain = MotionWish((Scale.orders,), ("full",), (TaskForm.SPLIT,), AUTO)
    ways: list[dict[str, Any]] = [{}]
    for time_s in (0.02, 0.01, 0.005, 0.0):
        inputs = {"fBlendTime_s": time_s, "fHysteresis_rpm": 0.2}
        ways += [{"inputs": inputs}, {"inputs": inputs, "ahead": True}]
    for angle_deg in (1e-3, 1e-4):
        inputs = {"fBlendTime_s": 0.0, "fHysteresis_rpm": 0.0, "fBlendAngle_deg": angle_deg}
        ways += [{"inputs": inputs}, {"inputs": inputs, "ahead": True}]
    for time_s in (0.005, 0.0):
        inputs = {"fBlendTime_s": time_s, "fHysteresis_rpm": 0.2}
        ways += [{"inputs": inputs, "load": load} for load in (LoadSource.SETPOINT, LoadSource.MEASURED)]
        ways += [{"inputs": inputs, "load": LoadSource.SETPOINT, "ahead": True}]
        ways += [{**AHEAD, "inputs": AHEAD["inputs"] | inputs}]
    return [Job(f"tuning/{way}", "tuning.csv", Machine(), dataclasses.replace(plain, **way), 3) for way in ways]


def motion_jobs(scale: Scale) -> list[Job]:
    """Both profiles: the laws in one and two tasks as they are; and the best, split with a lead, few and all orders."""
    jobs = []
    for profile in scale.profiles:
        plain = MotionWish((scale.orders,), ("published", "continuous"), (TaskForm.TWO, TaskForm.ONE))
        jobs.append(Job(_job_name(profile, scale.orders), profile, ANOTHER, plain))
        for orders in dict.fromkeys((scale.few, scale.orders)):
            ahead = MotionWish((orders,), ("full",), (TaskForm.SPLIT,), AUTO, **AHEAD)
            jobs.append(Job(f"{_job_name(profile, orders)}_split_lead", profile, ANOTHER, ahead))
    return jobs


def _job_name(profile: str, orders: tuple[int, ...]) -> str:
    return f"{Path(profile).stem}_{len(orders)}_orders"


def limit_jobs(scale: Scale) -> list[Job]:
    """The best case, then one thing worse at a time."""
    best = MotionWish((scale.orders,), ("full",), (TaskForm.SPLIT,), AUTO, **AHEAD)
    trained = Machine()

    def worse(**values: Any) -> MotionWish:
        return dataclasses.replace(best, **values)

    def other(path: str, value: float) -> Machine:
        return Machine(values={path: value})

    noise = dict.fromkeys(("axis.encoders.input_noise_deg", "axis.encoders.output_noise_deg"), 3e-4)
    cases = {
        "best case: the trained rig, all orders, full law, lead": (trained, best),
        "no lead (575 us), set points of now": (trained, worse(lead=0.0, ahead=False)),
        "the same, all in the slow task (1325 us)": (
            trained,
            worse(lead=0.0, ahead=False, forms=(TaskForm.TWO,)),
        ),
        "set points of now": (trained, worse(ahead=False)),
        "a measured load, set points of now": (trained, worse(load=LoadSource.MEASURED, ahead=False)),
        "no load: the speed decides": (trained, worse(load=LoadSource.NONE, inputs=TUNED)),
        "encoder noise of 1 arcsec": (Machine(values=noise), best),
        "sampling jitter of 25 us": (other("tasks.jitter_us", 25.0), best),
        "load ripple of 10 N m": (other("axis.load.torque_ripple_Nm", 10.0), best),
        "oil warms by 3 K a minute": (Machine(drift_K_per_min=3.0), best),
        "oil sensor off by 2 K": (other("axis.thermal.sensor_offset_K", 2.0), best),
        "another rig, sizes differ by 2 %": (Machine(spread=0.02), best),
        "another rig, sizes differ by 5 %": (Machine(spread=0.05), best),
        f"orders {', '.join(map(str, scale.few))} only": (trained, worse(orders=(scale.few,))),
        "continuous law": (trained, worse(laws=("continuous",))),
        "published law": (trained, worse(laws=("published",))),
        "no load, default blend at reversals (0.1 s)": (trained, worse(load=LoadSource.NONE, inputs={})),
    }
    hardest = scale.profiles[-1]  # the robot's: quick, with reversals, and a third as long to simulate
    return [
        Job(f"limits/{Path(hardest).stem}/{what}", hardest, machine, wish) for what, (machine, wish) in cases.items()
    ]


class Example:
    """The stages in a folder. What is there and was made of the same things is kept."""

    def __init__(self, out: Path, scale: Scale, jobs: int) -> None:
        self.out, self.scale, self.jobs = out, scale, jobs
        self.models = out / "models"
        self.known = out / "known.toml"

    def campaign(self) -> None:
        """Curve files of the simulated rig, for each speed, load and temperature: 10 x 11 x 3 = 330 runs."""
        scale = self.scale
        grid = (scale.speeds_rpm, scale.torques_Nm, scale.temperatures_C, scale.samples)

        def make() -> None:
            shutil.rmtree(self.out / "campaign", ignore_errors=True)
            lines = [
                "speed_rpm,torque_Nm,temperature_C",
                *(",".join(map(str, p)) for p in itertools.product(*grid[:3])),
            ]
            (self.out / "conditions.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
            command("simulate", "campaign", "--rig", RIG, "--conditions", self.out / "conditions.csv",
                    "--out", self.out / "campaign", "--samples", scale.samples, "--seed", 1)  # fmt: skip

        self._once("campaign", self.out / "campaign", (RIG.read_bytes(), grid), make)

    def more(self) -> None:
        """The runs that `reconcile` proposes, round by round, beside those of the campaign.

        The rig that it is given lacks the resonance: so far nobody knew of it.
        """
        known, measured = self.known, self.out / "measured"

        def make() -> None:
            rig = read_rig(RIG)
            write(known, rig.with_effects(e for e in rig.effects if e.name != "structural_resonance").text())
            shutil.rmtree(measured, ignore_errors=True)
            shutil.copytree(self.out / "campaign", measured, copy_function=os.link)
            for number in range(1, self.scale.rounds + 1):
                found, made = self.out / f"reconciled_{number}", self.out / f"more_{number}"
                shutil.rmtree(made, ignore_errors=True)
                command("reconcile", "--rig", known, "--measured", measured, "--out", found)
                if len((found / "next_runs.csv").read_text(encoding="utf-8").splitlines()) < 2:
                    break
                command("simulate", "campaign", "--rig", RIG, "--conditions", found / "next_runs.csv", "--out", made,
                        "--samples", self.scale.samples, "--seed", 1 + number)  # fmt: skip
                shutil.copytree(made, measured, copy_function=os.link, dirs_exist_ok=True)

        self._once("measured", measured, ((self.out / "campaign.made").read_text(), self.scale.rounds), make)

    def train(self) -> None:
        """Order analysis and models; a search that was stopped goes on where it was.

        Models of the campaign's runs, of all runs, and of all runs without the resonance that was found, which then
        enters the bundle as a formula.
        """
        scale, out = self.scale, self.out
        search = ["--orders", ",".join(map(str, scale.orders)), "--families", scale.families, "--folds", scale.folds]

        def make() -> None:
            # no simulated run is faulty, and one on a peak looks as if it were
            common = ["--name", "example", *search, "--jobs", self.jobs, "--keep-faulty", "--work", out / "fits.sqlite"]
            for runs in ("campaign", "measured"):
                command("train", out / runs, "--out", out / f"models_{runs}", *common,
                        "--cache", out / "curves.parquet", "--table", out / f"{runs}.csv")  # fmt: skip
            found, known = (read_rig(path) for path in (out / "reconciled_1" / "rig.toml", self.known))
            write_table(rest_of(read_table(out / "measured.csv"), found, known), out / "rest.csv")
            command("train", out / "rest.csv", "--out", out / "models_rest", *common, "--report", out / "training.html")
            shutil.rmtree(out / "updated", ignore_errors=True)
            command("reconcile", "--rig", self.known, "--measured", out / "measured", "--out", out / "updated",
                    "--models", out / "models_rest", "--update-models", "--profile", "none")  # fmt: skip
            new = out / "updated" / "models"
            shutil.rmtree(self.models, ignore_errors=True)
            shutil.copytree(new if new.is_dir() else out / "models_rest", self.models)

        self._once("models", self.models, ((out / "measured.made").read_text(), search), make)

    def compile(self) -> None:
        """Structured Text, and the proof that it computes what the models compute."""

        def make() -> None:
            command("generate", self.models, "--target", "twincat", "--out", self.out)
            command("verify", self.models, "--generated", self.out, "--rows", 2000)

        self._once("twincat", self.out / "twincat", self._learned(), make)

    def motion(self) -> None:
        """Motions on a rig that differs from the trained one; motion.json has a row for each."""
        rows = self._moved(motion_jobs(self.scale))
        write(self.out / "motion.json", json.dumps([row for _, row in rows], indent=1) + "\n")
        write(self.out / "motion.md", motion_table([row for _, row in rows]).markdown())
        for _, row in rows:
            lead = f", lead {row['lead_us']:.0f} us" if row["lead_us"] else ""
            case = f"{row['profile']}, {len(row['orders'])} orders, {row['law']} law, tasks {row['tasks']}{lead}"
            print(f"{case:72} RMS -{row['rms_reduction']:6.1%}  maximum -{row['max_reduction']:6.1%}")

    def tune(self) -> None:
        """How TUNED was chosen; not part of the example."""
        for job, row in self._moved(tuning_jobs()):
            print(f"{job.name:60} RMS -{row['rms_reduction']:6.1%}  maximum -{row['max_reduction']:6.1%}")

    def limits(self) -> None:
        """What limits it, as limits.json, .csv, .html and .md."""
        keys = ("rms_before", "rms_after", "rms_reduction", "max_before", "max_after", "max_reduction")
        rows = [
            {"profile": row["profile"], "what": job.name.split("/", 2)[2], **{key: row[key] for key in keys}}
            for job, row in self._moved(limit_jobs(self.scale))
        ]
        self._tell("limits", rows, limits_table(rows), "What limits the compensation")

    def gains(self) -> None:
        """What each step brings, on rigs that differ from the trained one; gains.json, .csv, .html and .md."""
        rows = [
            {"what": job.name.split("/")[1], "rig": job.name.split("/")[2],
             **{key: row[key] for key in ("rms_after", "rms_reduction", "max_after", "max_reduction")}}
            for job, row in self._moved(gain_jobs(self.scale.profiles[-1], self.scale.orders))
        ]  # fmt: skip
        self._tell("gains", rows, gains_table(rows), "What each step brings")

    def real(self, table: Path) -> None:
        """A rig whose transmission error is a measured table, in place of effects; not part of the example."""
        write_rigs(table, self.out / "real")
        for case in CASES:
            learned, models = self.out / "real" / case / "learned.csv", self.out / f"models_real_{case}"
            search = ["--families", self.scale.families, "--folds", self.scale.folds]

            def make(learned: Path = learned, models: Path = models, search: list[object] = search) -> None:
                command(
                    "train", learned, "--out", models, *search, "--jobs", self.jobs, "--work", self.out / "fits.sqlite"
                )

            self._once(models.name, models, (learned.read_bytes(), search), make)
        keys = ("rms_before", "rms_after", "rms_reduction", "max_before", "max_after", "max_reduction")
        rows = [
            {"profile": row["profile"], "what": f"{job.name.split('/')[2]}; {CASES[job.name.split('/')[1]][0]}",
             **{key: row[key] for key in keys}}
            for job, row in self._moved(real_jobs(self.out, self.scale.profiles))
        ]  # fmt: skip
        self._tell("real", rows, limits_table(rows), "A measured table as the rig")

    def _tell(self, name: str, rows: list[dict[str, Any]], table: PageTable, title: str) -> None:
        cells = [",".join(f'"{v}"' if isinstance(v, str) else f"{v:.6g}" for v in row.values()) for row in rows]
        write(self.out / f"{name}.json", json.dumps(rows, indent=1) + "\n")
        write(self.out / f"{name}.csv", "\n".join([",".join(rows[0]), *cells]) + "\n")
        write(self.out / f"{name}.md", table.markdown())
        write(self.out / f"{name}.html", page(title, [PageSection("One thing at a time", table=table)]))
        print(table.markdown())

    def _moved(self, jobs: list[Job]) -> list[tuple[Job, dict[str, Any]]]:
        """Every job's rows, in order; two jobs at a time where there are two cores."""
        from joblib import Parallel, delayed

        for name, text in (("quick.csv", QUICK_PROFILE), ("tuning.csv", tuning_profile())):
            write(self.out / name, text)
        learned, started = self._learned(), time.monotonic()
        work: Iterable[Any] = Parallel(n_jobs=self.jobs, return_as="generator")(
            delayed(run_job)(self.out, learned, job) for job in jobs
        )
        found = []
        for number, (job, rows) in enumerate(zip(jobs, work, strict=True), 1):
            print(f"[{number}/{len(jobs)}, {time.monotonic() - started:.0f} s] {job.name}", flush=True)
            found += [(job, row) for row in rows]
        return found

    def _learned(self) -> str:
        folders = [path for path in sorted(self.out.glob("models*")) if path.is_dir()]
        folders += sorted((self.out / "real").glob("*"))
        return digest(RIG.read_bytes(), *(path.read_bytes() for folder in folders for path in sorted(folder.iterdir())))

    def _once(self, name: str, made: Path, of: Any, make: Callable[[], None]) -> None:
        """Make something, unless it is there and was made of the same."""
        stamp, known = self.out / f"{name}.made", digest(of)
        if made.exists() and stamp.is_file() and stamp.read_text() == known:
            print(f"{made}: kept", flush=True)
            return
        stamp.unlink(missing_ok=True)
        make()
        write(stamp, known)


def rest_of(table: HarmonicTable, found: RigModel, known: RigModel) -> HarmonicTable:
    """What was measured without what was found beside the known effects."""
    added = found.coefficients(table.at, table.orders) - known.coefficients(table.at, table.orders)
    return dataclasses.replace(table, coefficients=table.coefficients - added)


def command(*arguments: object) -> None:
    """Run st-codegen; an error ends the example."""
    texts = [str(argument) for argument in arguments]
    print("st-codegen", *texts, flush=True)
    try:
        st_codegen(texts)
    except SystemExit as end:
        if end.code:
            raise


def main(arguments: list[str] | None = None) -> None:
    """Run the stages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("build/example"))
    parser.add_argument("--only", choices=(*STAGES, "tune"), action="append", help="stages to run (default: all)")
    parser.add_argument("--real", type=Path, metavar="TABLE", help="motions of a measured harmonic table, and no stage")
    parser.add_argument(
        "--quick", action="store_true", help="a small campaign, three orders, a third of a second of motion"
    )
    parser.add_argument(
        "--jobs", type=int, default=min(os.cpu_count() or 1, 4), help="processes (default: the cores, 4 at most)"
    )
    parser.add_argument("--page", type=Path, help="a page into which the tables are put, as docs/motion.md")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    example = Example(options.out, QUICK if options.quick else Scale(), options.jobs)
    if options.real:
        example.real(options.real)
    for name in [] if options.real else options.only or STAGES:
        print(f"--- {name}", flush=True)
        getattr(example, name)()
    if options.page:
        into_page(options.page, options.out, ["real"] if options.real else ["motion", "limits", "gains"])


if __name__ == "__main__":
    main()
