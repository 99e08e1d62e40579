"""Vibration of a bearing as it might be measured, made up: the same numbers for the same seed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Samples a second.
RATE_HZ = 4000.0
SHAFT_HZ = 25.0
#: The rolling elements pass a fault so often, and each time the housing rings.
FAULT_HZ = 162.0
RINGING_HZ, DECAY_S = 1200.0, 0.0012
STATES = ("healthy", "worn", "dry")


def vibration(state: str, samples: int, seed: int) -> FloatArray:
    """A record in m/s2, shape (samples,): unbalance and noise; impacts where worn, broad noise where dry.

    Speed, phases and the size of the fault differ from record to record.
    """
    random = np.random.default_rng([STATES.index(state), seed])
    t = np.arange(samples) / RATE_HZ
    speed = 1.0 + 0.02 * random.standard_normal()
    angle = 2 * np.pi * (SHAFT_HZ * speed * t + random.random())
    signal = 0.8 * np.sin(angle) + 0.2 * np.sin(2 * angle + random.random()) + 0.25 * random.standard_normal(samples)
    if state == "dry":
        signal += random.uniform(0.6, 1.2) * random.standard_normal(samples)
    if state == "worn":
        passed = (t * FAULT_HZ * speed + random.random()) % 1.0 / (FAULT_HZ * speed)
        ringing = np.exp(-passed / DECAY_S) * np.sin(2 * np.pi * RINGING_HZ * passed)
        signal += random.uniform(1.2, 3.0) * ringing
    return signal


def windows(signal: FloatArray, length: int) -> FloatArray:
    """The record cut into windows, shape (windows, length)."""
    return signal[: len(signal) // length * length].reshape(-1, length)
