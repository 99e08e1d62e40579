"""What a step and a ramp look like over the runs."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.settings import SETTINGS


@lru_cache(maxsize=2)
def ramps(count: int) -> FloatArray:
    """What a ramp may look like over the runs, (m, runs): the whole way first, then from a run on, or until one."""
    at, edge = np.arange(count, dtype=np.float64), max(2, count // 20)
    cuts = np.unique(np.linspace(edge, count - 1 - edge, SETTINGS.bends).round())
    return np.stack([at, *(np.maximum(at - cut, 0.0) for cut in cuts), *(np.minimum(at - cut, 0.0) for cut in cuts)])


@lru_cache(maxsize=2)
def steps_and_ramps(count: int) -> FloatArray:
    """What a step or a ramp may look like over the runs, (runs, m)."""
    edge = max(2, count // 20)
    cuts = np.unique(np.linspace(edge, count - edge, SETTINGS.most_cuts).round())
    return np.concatenate([np.arange(count) >= cuts[:, None], ramps(count) / count]).T
