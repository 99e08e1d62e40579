"""The choice of the orders to model, from the data, with the reason for each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from st_codegen.campaign.orders import SIGNIFICANT, OrderFit
from st_codegen.errors import InputError, counted
from st_codegen.files.number_text import percent


@dataclass(frozen=True)
class OrderReason:
    """What the curves say about one order.

    above_noise: number of curves in which it stands above the noise, of `curves`; rms_deg: root mean square of its
    amplitude over all curves; noise_deg: median noise floor; share: its part of the mean square of the TE without its
    mean; reason: the decision as a sentence.
    """

    order: int
    chosen: bool
    above_noise: int
    curves: int
    rms_deg: float
    noise_deg: float
    share: float
    reason: str


#: RMS amplitude below which an order is not chosen, by the strongest one's.
_LEAST_SIZE = 0.01
#: Share of the curves in which an order must be above the noise.
_LEAST_CURVES = 0.25


def choose_orders(fits: Sequence[OrderFit], *, most: int = 20, always: Sequence[int] = (0,)) -> tuple[OrderReason, ...]:
    """Judge every order that stands above the noise somewhere; the strongest first, the mean ahead of all.

    An order is chosen where it is above the noise in `_LEAST_CURVES` (a share) of the curves and its root mean square
    amplitude is at least `_LEAST_SIZE` of the strongest one; `most` orders at most, the mean included. `always` are
    chosen whatever the data say. Raises InputError without fits.
    """
    if not fits:
        raise InputError("there are no curves to choose orders from")
    band = min(len(fit.spectrum) for fit in fits)
    spectrum = np.stack([fit.spectrum[:band] for fit in fits])
    floor = np.stack([fit.spectrum_floor[:band] for fit in fits])
    # of a TE that does not change the rest is what rounding leaves of its mean
    floor = np.maximum(floor, np.finfo(np.float64).eps * spectrum[:, :1])
    above = (spectrum > SIGNIFICANT * floor).sum(axis=0)
    # what noise adds to a mean square is taken off
    rms = np.sqrt(np.maximum((spectrum**2 - floor**2).mean(axis=0), 0.0))
    share = rms[1:] ** 2 / max((rms[1:] ** 2).sum(), np.finfo(float).tiny)
    strongest = rms[1:].max(initial=0.0)
    ranking = [0, *(1 + np.argsort(-rms[1:], kind="stable"))]
    reasons, chosen = [], 0
    for order in map(int, ranking):
        forced = order in always
        if not above[order] and not forced:
            continue
        where = f"above the noise in {above[order]} of {counted(len(fits), 'curve')}"
        size = f"{rms[order]:.2e} deg"
        relative = rms[order] / strongest if order and strongest else 1.0
        if forced:
            verdict, why = True, f"always wanted; {where}"
        elif above[order] < _LEAST_CURVES * len(fits):
            verdict, why = False, f"only {where}"
        elif relative < _LEAST_SIZE:
            verdict, why = False, f"{where}, but {size} is below {_LEAST_SIZE:.0%} of the strongest"
        elif chosen >= most:
            verdict, why = (
                False,
                f"{where}, {size}; {counted(most - 1, 'stronger one')} and the mean are chosen already",
            )
        else:
            verdict, why = True, f"{where}; {size} is {percent(relative)} of the strongest"
        chosen += verdict
        reasons.append(
            OrderReason(
                order,
                verdict,
                int(above[order]),
                len(fits),
                float(rms[order]),
                float(np.median(floor[:, order])),
                float(share[order - 1]) if order else 0.0,
                why,
            )
        )
    return tuple(reasons)
