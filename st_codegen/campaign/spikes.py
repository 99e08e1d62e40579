"""Spikes: single samples far from those around them, as a counter that slips or a disturbed line makes them.

A least squares fit has no need of every sample, and one that is far off bends every order: of N samples one that is h
off by 2*h/N. What comes back at an angle of the turn is no accident, and stays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import pdtrc

from st_codegen.ir.arrays import BoolArray, FloatArray

#: samples whose median says what lies around one: up to three in a row are outvoted
_AROUND = 7
#: a spike is further from the median than this times what all but a hundredth of the samples are: 10 standard
#: deviations of Gaussian noise
_FAR = 4.0
_ALL_BUT = 0.99
#: curves that have a spike at one place make it one of the turn, where chance brings them together less often than this
_LEAST_CURVES, _CHANCE = 3, 1e-6


def off_deg(te_deg: FloatArray) -> FloatArray:
    """By how much samples (n,) are off that lie far from those around them, no more than a hundredth; 0 for others.

    Where most samples are equal, the digit by which some differ is no spike.
    """
    off = te_deg - median_filter(te_deg, _AROUND, mode="nearest")
    size = np.abs(off)
    usual = max(float(np.quantile(size, _ALL_BUT)), float(size[size > 0].min(initial=np.inf)))
    return np.where(size > _FAR * usual, off, 0.0)


def repeated(angles_rad: Sequence[FloatArray], within_rad: float) -> list[BoolArray]:
    """Of the spikes of each curve which stand where others have them as well, too many to be there by chance.

    angles_rad: of each curve those of its spikes, (s,); within_rad: how near is one place.
    """
    turn = 2.0 * np.pi
    place = np.mod(np.concatenate([*angles_rad, np.zeros(0)]), turn)
    curve = np.repeat(np.arange(len(angles_rad)), [len(one) for one in angles_rad])
    order = np.argsort(place, kind="stable")
    around = np.concatenate([place[order] - turn, place[order], place[order] + turn])
    who = np.tile(curve[order], 3)
    first, last = np.searchsorted(around, place - within_rad), np.searchsorted(around, place + within_rad, "right")
    others = np.array([len(np.unique(who[begin:end])) - 1 for begin, end in zip(first, last, strict=True)], np.float64)
    by_chance = len(place) * 2.0 * within_rad / turn
    again = (others + 1 >= _LEAST_CURVES) & (pdtrc(others - 1, by_chance) < _CHANCE)
    return np.split(again, np.cumsum([len(one) for one in angles_rad])[:-1])
