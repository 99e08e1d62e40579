"""The choice of a solution for every order by cross-validation: the best whose worst-case cost fits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from st_codegen.errors import InputError, at_least, at_most, counted
from st_codegen.training.study import Solution, Study


@dataclass(frozen=True)
class Choice:
    """The solutions by order."""

    solutions: tuple[Solution, ...]

    @property
    def cost_us(self) -> float:
        """Worst case of one evaluation of all of them."""
        return sum(solution.cost_us for solution in self.solutions)


def choose(study: Study, *, limit_us: float = math.inf) -> Choice:
    """One solution an order, so that the transmission error is predicted best and all together cost at most `limit_us`.

    The error that counts is the complex one, by cross-validation: mean square of the transmission error that wrong
    coefficients leave is half the mean of abs(difference)^2 (all of it for the mean). Its robust version, the squared
    mean absolute difference, decides, so that single faulty runs do not. Starting from the best of each order, the
    exchange that loses least for each microsecond is made until all fit.
    Raises InputError where even the cheapest do not, or nothing can be compiled.
    """
    orders = [order for order in study.learn.orders if any(key[0] == order for key in study.outcomes)]
    options = [_worthwhile(list(study.solutions(order))) for order in orders]
    for order, choices in zip(orders, options, strict=True):
        if not choices:
            raise InputError(f"order {order}: none of the families that were tried can be compiled")
    cheapest = sum(choices[-1].cost_us for choices in options)
    if cheapest > limit_us:
        raise InputError(
            f"the cheapest models of the {counted(len(orders), 'order')} take {at_most(cheapest, 4)} us in the "
            f"worst case, and {at_least(limit_us, 6)} us are allowed: model fewer orders, try cheaper families (DT, "
            "ET, MLP), or allow more"
        )
    taken = [0] * len(orders)
    while sum(choices[at].cost_us for choices, at in zip(options, taken, strict=True)) > limit_us:
        taken = _exchanged(options, taken)
    return Choice(tuple(choices[at] for choices, at in zip(options, taken, strict=True)))


def loss(solution: Solution) -> float:
    """What a solution leaves of the transmission error, deg^2."""
    return float(solution.errors.complex_mae**2 * (1.0 if solution.order == 0 else 0.5))


def _worthwhile(solutions: Sequence[Solution]) -> list[Solution]:
    """Best first, each cheaper than all better ones; what cannot be compiled left out."""
    kept: list[Solution] = []
    for solution in sorted(solutions, key=lambda s: (loss(s), s.cost_us)):
        if np.isfinite(solution.cost_us) and (not kept or solution.cost_us < kept[-1].cost_us):
            kept.append(solution)
    return kept


def _exchanged(options: Sequence[Sequence[Solution]], taken: Sequence[int]) -> list[int]:
    """One order on a cheaper solution: the one that loses least for each microsecond saved."""
    prices = [
        ((loss(cheaper) - loss(choices[at])) / (choices[at].cost_us - cheaper.cost_us), order, number)
        for order, (choices, at) in enumerate(zip(options, taken, strict=True))
        for number, cheaper in enumerate(choices[at + 1 :], at + 1)
    ]
    _, exchanged, number = min(prices)
    return [number if order == exchanged else at for order, at in enumerate(taken)]
