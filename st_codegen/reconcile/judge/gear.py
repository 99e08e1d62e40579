"""Whether the rig is that of another gear: its teeth and pins leave nothing in the data, and other numbers do."""

from __future__ import annotations

import numpy as np

from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.judge.mistakes import AS_IS, Mistake
from st_codegen.reconcile.judge.votes import expected_of, loud_orders, noise_power, told_power
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel

#: fewer waves than this say nothing of a gear, smaller numbers are no teeth, and more numbers are no gear's
_LEAST_WAVES, _LEAST_TEETH, _MOST_NUMBERS = 2, 5, 4
#: amplitude, as a share of the rig's, below which an order is missing
_NOTHING = 0.2


def other_gear(data: Observations, rig: RigModel) -> list[Mistake]:
    """Teeth, pins or a shaft of the rig all of whose waves are missing, where multiples of other numbers are there.

    It changes no data: the rig file is that of another gear.
    """
    constants, orders, noise = rig.constants, data.orders, noise_power(data)
    most = np.maximum((np.abs(data.values) ** 2).mean(axis=0) - noise.mean(axis=0), 0.0)
    least, model = told_power(noise), (np.abs(expected_of(data, rig)) ** 2).mean(axis=0)
    loud, is_missing = loud_orders(data, rig), most + least < _NOTHING**2 * model
    missing = dict[str, list[int]]()
    for name, family in (
        (f"{constants.cycloid_teeth} teeth", constants.tooth_orders()),
        (f"{constants.pins} pins", constants.pin_orders()),
        (f"a shaft that turns {constants.reduction_ratio:g} times", constants.shaft_orders()),
    ):
        own = np.isin(orders, family) & loud
        if own.sum() >= _LEAST_WAVES and is_missing[own].all():
            missing[name] = orders[own].tolist()
    foreign = set(orders[(most > SETTINGS.loud_order * noise.mean(axis=0) + least) & (model == 0)].tolist())
    numbers = [
        number
        for number in sorted(foreign)
        if number >= _LEAST_TEETH and all(number * times in foreign for times in range(1, _LEAST_WAVES + 1))
    ]
    numbers = [one for one in numbers if not any(one > other and one % other == 0 for other in numbers)]
    # where nothing is as large as the rig lets expect, another unit does that
    if not missing or is_missing[loud].all() or not 0 < len(numbers) <= _MOST_NUMBERS:
        return []
    lost = " and ".join(f"{', '.join(map(str, own))} ({name})" for name, own in missing.items())
    text = (
        f"orders {lost} of the rig are missing, and multiples of {' and of '.join(map(str, numbers))} are there, which "
        "it does not have, as if the rig file were that of another gear: correct cycloid_teeth, pins, reduction_ratio "
        f"and the orders of its effects; or give --accept {AS_IS}"
    )
    return [Mistake("gear", text)]
