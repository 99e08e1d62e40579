"""Angles that are rounded, to tenths of a degree or to the steps of an encoder, and what they were before.

The samples of a curve are even in time, and the angle of an axis is smooth over it: the smoothest one that all digits
allow is nearer to the truth than the digits are, of which every order is turned to and fro.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import dct, idct

from st_codegen.ir.arrays import FloatArray

#: a step of the angle is coarse from this share of that between two samples on: the highest order that is told turns by
#: a quarter of its wave between two samples, and loses less than a hundredth of itself below
_COARSE = 0.01
#: waves of the highest order that a step may hold: within a longer one nobody knows how the speed wanders
_MOST_WAVES = 0.5
#: angles are multiples of a step up to this share of it, which their own digits may take
_WHOLE = 0.02
#: standard deviations of what rounding leaves that may be chance
_SURE = 5.0


def without_steps(angle_deg: FloatArray, highest: int) -> FloatArray:
    """Angles (n,) in order of time without the steps that they are rounded to, or as they are.

    Taken is the slowest wander of the speed with which all stay within one step of what is read: the mean of them is
    that of the digits, so that where these were cut off all angles are half a step low. highest: the order up to which
    they are needed.
    """
    count, step = len(angle_deg), _step(angle_deg)
    if not step or highest * step > _MOST_WAVES * 360.0:
        return angle_deg
    index = np.arange(count)
    even = np.polyval(np.polyfit(index, angle_deg, 1), index)
    waves = dct(angle_deg - even, norm="ortho")
    # what is rounded off is anything within a step: its square has the mean of a twelfth, and scatters by 0.9 of that
    square = step**2 / 12.0
    most = square * (1.0 + _SURE * np.sqrt(0.8 / count))
    # of a wave of the speed the samples tell as many periods as of an order, a half at each index
    for kept in (0, *2 ** np.arange(1, (count // 2).bit_length())):
        smooth = even + idct(np.where(index <= kept, waves, 0.0), norm="ortho")
        left = angle_deg - smooth
        # two of the numbers are those of the line
        off = np.sqrt(square * (kept + 2) / count)
        if (left**2).mean() <= most and np.ptp(left) <= step + 2.0 * _SURE * off:
            return np.asarray(smooth)
    return angle_deg


def _step(angle_deg: FloatArray) -> float:
    """The step (deg) of which all differences of angles beside each other are multiples, where it is coarse; else 0.

    One step from sample to sample, and now and then two, is what lost samples of even angles look like.
    """
    sizes = np.unique(np.abs(np.diff(angle_deg)))
    least = _COARSE * float(np.ptp(angle_deg)) / len(angle_deg)
    gaps = np.diff(sizes)
    gaps = gaps[gaps > least]
    if not gaps.size:
        return 0.0
    times = np.round(sizes / gaps.min())
    step = float(sizes @ times / (times @ times))
    is_whole = np.abs(sizes - times * step).max() < min(_WHOLE * step, least)
    return step if is_whole and times.min() != 1.0 else 0.0
