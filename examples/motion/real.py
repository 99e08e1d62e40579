"""Motions of a rig whose transmission error is a measured harmonic table, compensated by models of that table."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jobs import AHEAD, RIG, TUNED, Job, Machine

from st_codegen.campaign.harmonic_table import HarmonicTable, read_table, write_table
from st_codegen.rig.measured import MeasuredHarmonics
from st_codegen.rig.model import RigModel, read_rig
from st_codegen.rig.study import AUTO, MotionWish
from st_codegen.rig.tasks import TaskForm

#: Which runs of the table the models learn, and which the rig is made of.
CASES: dict[str, tuple[str, Callable[[HarmonicTable], Any], Callable[[HarmonicTable], Any]]] = {
    "all": ("learned from the very runs that the rig is made of", lambda t: t.speed_rpm > 0, lambda t: t.speed_rpm > 0),
    "between": (
        "learned at 25 and 35 degC, the rig made of the runs at 30 degC",
        lambda table: table.temperature_C != 30.0,
        lambda table: table.temperature_C == 30.0,
    ),
}
#: What the blocks do; the last on a rig without the mean, which then has no play, so that no load is given.
WISHES: dict[str, dict[str, Any]] = {
    "published law, two tasks": {"laws": ("published",), "forms": (TaskForm.TWO,)},
    "full law, split with a lead, set points ahead": {
        "laws": ("full",),
        "forms": (TaskForm.SPLIT,),
        "lead": AUTO,
        **AHEAD,
    },
    "the same without the mean, in rig and blocks": {
        "laws": ("full",),
        "forms": (TaskForm.SPLIT,),
        "lead": AUTO,
        "inputs": TUNED,
        "ahead": True,
    },
}


def write_rigs(table_file: Path, out: Path) -> None:
    """For each case the table to learn from, and rig files with and without the mean, in `out`/case."""
    table, rig = read_table(table_file), read_rig(RIG)
    waves = [order for order in table.orders if order]
    for case, (_, learned, moved) in CASES.items():
        folder = out / case
        folder.mkdir(parents=True, exist_ok=True)
        write_table(table.rows(learned(table)), folder / "learned.csv")
        of_rig = table.rows(moved(table))
        for name, content in (("rig", of_rig), ("waves", of_rig.only(waves))):
            write_table(content, folder / f"{name}.csv")
            measured = MeasuredHarmonics.read(folder / f"{name}.csv")
            RigModel(name, rig.constants, measured=measured, other=rig.other).write(folder / f"{name}.toml")


def real_jobs(out: Path, profiles: tuple[str, ...]) -> list[Job]:
    """Both profiles and what the blocks can do, for each case."""
    jobs = []
    for case, (what, wish), profile in itertools.product(CASES, WISHES.items(), profiles):
        rig = out / "real" / case / ("waves.toml" if "without the mean" in what else "rig.toml")
        measured = read_rig(rig).measured
        assert measured is not None
        wanted = MotionWish(orders=(measured.orders,), **wish)
        jobs.append(
            Job(f"real/{case}/{what}/{profile}", profile, Machine(rig=rig), wanted, models=f"models_real_{case}")
        )
    return jobs
