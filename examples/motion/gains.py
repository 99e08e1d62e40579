"""What each step of the example brings, one after the other, on rigs that differ from the one that was measured."""

from __future__ import annotations

from typing import Any

from jobs import AHEAD, TUNED, Job, Machine

from st_codegen.rig.motion import LoadSource
from st_codegen.rig.study import AUTO, MotionWish
from st_codegen.rig.tasks import TaskForm

#: Specimens of each spread.
SPECIMENS = (11, 12, 13)
SPREADS = {"the trained rig": 0.0, "sizes differ by 2 %": 0.02, "sizes differ by 5 %": 0.05}


def gain_jobs(profile: str, orders: tuple[int, ...]) -> list[Job]:
    """All steps on all rigs; each step has what the ones above it have, but for the last."""
    steps: dict[str, tuple[str, dict[str, Any]]] = {
        "the campaign; the speed decides the direction": ("models_campaign", {"inputs": TUNED}),
        "12 more runs": ("models_measured", {"inputs": TUNED}),
        "the resonance as a formula": ("models", {"inputs": TUNED}),
        "set points a lead ahead": ("models", {"inputs": TUNED, "ahead": True}),
        "the load's set point with its sign": ("models", AHEAD),
        "in its place the measured load": (
            "models",
            {**AHEAD, "load": LoadSource.MEASURED, "inputs": AHEAD["inputs"] | {"fLoadTime_s": 0.0}},
        ),
    }
    rigs = [(spread, specimen) for spread in SPREADS.values() for specimen in (SPECIMENS if spread else SPECIMENS[:1])]
    named = {spread: name for name, spread in SPREADS.items()}
    return [
        Job(
            f"gains/{what}/{named[spread]}/{specimen}",
            profile,
            Machine(spread, specimen),
            MotionWish((orders,), ("full",), (TaskForm.SPLIT,), AUTO, **wish),
            models=models,
        )
        for what, (models, wish) in steps.items()
        for spread, specimen in rigs
    ]
