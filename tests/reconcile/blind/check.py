"""Judges the new rig.toml itself, by the generator's own formulas and on conditions that nobody measured."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from . import effects, layout
from .generator import Made, difference, te_rms

FRESH_SEED = 20_000


def new_rig(path: Path, made: Made) -> dict[str, Any] | None:
    """How far the new rig is from the truth on fresh conditions.

    `error_deg` is the RMS of its difference in the measured orders, `ratio` what a measurement with this case's
    noise would have as its gap there, in noise floors: sqrt(1 + (error / floor)^2). Of foreign errors
    the truth is that part which the catalogue has. None where no rig was written.
    """
    if not path.is_file():
        return None
    text = tomllib.loads(path.read_text(encoding="utf-8"))
    runs = layout.conditions(np.random.default_rng(FRESH_SEED), "scattered", "sparse")
    found = effects.coefficients(text["rig"], text.get("effect", []), runs)
    truth = effects.coefficients(made.head, made.true, runs)
    error = te_rms(difference(found, truth), made.orders)
    return {"error_deg": error, "ratio": float(np.sqrt(1.0 + (error / made.floor_deg) ** 2))}
