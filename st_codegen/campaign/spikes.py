"""Spikes: samples far from those around them, single or in a row, as a counter or a disturbed line makes them.

A least squares fit has no need of every sample, and one that is far off bends every order: of N samples one that is h
off by 2*h/N. What comes back at an angle of the turn is no accident, and stays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import pdtrc

from st_codegen.ir.arrays import BoolArray, FloatArray, IntArray

#: samples whose median says what lies around one: up to three in a row are outvoted
_AROUND = 7
#: a spike is further from the median than this times what all but a hundredth of the samples are: 10 standard
#: deviations of Gaussian noise
_FAR = 4.0
_ALL_BUT = 0.99
#: many in a row begin and end from one sample to the next: with a step that is larger than this times all but a
#: twentieth of the steps (10 standard deviations of Gaussian noise), and so far are they off the median of a tenth of
#: the curve, which outvotes a twentieth; fewer are single ones
_FAR_IN_A_ROW = 5.1
_MOST_IN_A_ROW = 0.05
LEAST_ROW = 4
#: curves that have a spike at one place make it one of the turn, where chance brings them together less often than this
_LEAST_CURVES, _CHANCE = 3, 1e-6


def off_deg(te_deg: FloatArray) -> FloatArray:
    """By how much samples (n,) are off that lie far from those around them; 0 for others.

    Single ones are no more than a hundredth of all, those in a row no more than a twentieth. Where most samples are
    equal, the digit by which some differ is no spike.
    """
    reach = _AROUND // 2
    off = te_deg - median_filter(_with_ends(te_deg), _AROUND)[reach:-reach]
    inside = te_deg - np.where(_are_far(off, _FAR, _ALL_BUT), off, 0.0)  # another spike is no step of the curve
    for own, beside in ((off[:reach], inside[reach : 2 * _AROUND]), (off[-reach:], inside[-2 * _AROUND : -reach])):
        # a curve that settles is no line there, but its steps beside are as large
        own[np.abs(own) <= _FAR * np.abs(np.diff(beside)).max(initial=0.0)] = 0.0
    found = np.where(_are_far(off, _FAR, _ALL_BUT), off, 0.0)
    jumps = _are_far(np.diff(te_deg), _FAR_IN_A_ROW, 1.0 - _MOST_IN_A_ROW)
    if jumps.sum() < 2:
        return found
    off = te_deg - median_filter(te_deg, 2 * int(_MOST_IN_A_ROW * len(te_deg)) + 1, mode="nearest")
    far = np.flatnonzero(_are_far(off, _FAR_IN_A_ROW, 1.0 - _MOST_IN_A_ROW))
    for row in np.split(far, np.flatnonzero(np.diff(far) > 1) + 1):
        if len(row) >= LEAST_ROW and row[0] > 0 and row[-1] < len(jumps) and jumps[row[0] - 1] and jumps[row[-1]]:
            found[row] = off[row]
    return found


def _with_ends(te_deg: FloatArray) -> FloatArray:
    """The samples with as many in front and behind as a median reaches, on lines through the first and the last ones.

    The first or last sample in their place would be the median of itself, however far it is off.
    """
    beyond = np.arange(_AROUND // 2 + 1, _AROUND)
    start, end = (
        np.median(one) + beyond * np.median(np.diff(one)) for one in (te_deg[:_AROUND][::-1], te_deg[-_AROUND:])
    )
    return np.concatenate([start[::-1], te_deg, end])


def longest_row(numbers: FloatArray | IntArray) -> int:
    """How many of some samples stand in a row at most, by their numbers in rising order."""
    apart = np.flatnonzero(np.diff(numbers) > 1)
    return int(np.diff([0, *(apart + 1), len(numbers)]).max())


def _are_far(values: FloatArray, times: float, all_but: float) -> BoolArray:
    """Which of some values (n,) are further from zero than so many times what a share of them is."""
    size = np.abs(values)
    usual = max(float(np.quantile(size, all_but)), float(size[size > 0].min(initial=np.inf)))
    return np.asarray(size > times * usual)


def repeated(angles_rad: Sequence[FloatArray], within_rad: float) -> list[BoolArray]:
    """Which spikes of each curve stand where those of other curves do, too many to be there by chance.

    angles_rad: of each curve those of its spikes, (s,); within_rad: how near is one place.
    """
    turn = 2.0 * np.pi
    places = [np.mod(own, turn) for own in angles_rad]
    # from where to where each curve has a spike within reach: samples in a row stand at one place
    begins, ends = [np.zeros(0)], [np.zeros(0)]
    for own in places:
        around = np.sort(np.concatenate([own - turn, own, own + turn]))
        apart = np.flatnonzero(np.diff(around) > 2.0 * within_rad)
        begins.append(around[np.append(0, apart + 1)[: len(around)]] - within_rad)
        ends.append(around[np.append(apart, -1)[: len(around)]] + within_rad)
    begin, end = np.sort(np.concatenate(begins)), np.sort(np.concatenate(ends))
    by_chance = float(end.clip(0.0, turn).sum() - begin.clip(0.0, turn).sum()) / turn

    def are_again(own: FloatArray) -> BoolArray:
        curves = np.searchsorted(begin, own, "right") - np.searchsorted(end, own, "left")
        return np.asarray((curves >= _LEAST_CURVES) & (pdtrc(np.maximum(curves - 2.0, 0.0), by_chance) < _CHANCE))

    return [are_again(own) for own in places]
