"""The rig file of another gear: it is asked about before anything is named."""

from dataclasses import replace

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.reconcile.data.observations import Observations, labels, order_of_runs
from st_codegen.reconcile.mistakes.columns import other_gear
from st_codegen.reconcile.mistakes.examine import examine
from st_codegen.rig.model import RigModel

from .test_misread import AT, PATH, WHOLE


def geared(**numbers):
    """The whole rig with other teeth, pins and another ratio: each wave keeps its part of the gear."""
    made = replace(WHOLE.constants, **numbers)
    bases = {
        int(old): int(new)
        for old, new in (
            (WHOLE.constants.cycloid_teeth, made.cycloid_teeth), (WHOLE.constants.pins, made.pins),
            (WHOLE.constants.reduction_ratio, made.reduction_ratio),
        )
    }  # fmt: skip

    def moved(order):
        base = next((base for base in bases if order % base == 0), None)
        return order if base is None else order // base * bases[base]

    effects = tuple(
        type(one)(
            {
                key: moved(value) if key == "order" else tuple(map(moved, value)) if key == "orders" else value
                for key, value in one.values.items()
            },
            made,
            check=False,
        )
        for one in WHOLE.effects
    )
    return replace(WHOLE, constants=made, effects=effects)


def measured(rig: RigModel, sigma: float, at=AT):
    """Curves of a rig, with the orders of both."""
    random, orders = np.random.default_rng(1), np.array(sorted({*rig.orders(), *WHOLE.orders()}))
    values = rig.coefficients(at, orders.tolist())
    noise = sigma * (random.standard_normal(values.shape) + 1j * random.standard_normal(values.shape))
    values = values + np.where(orders == 0, noise.real, noise)
    spectral = np.full(values.shape, sigma)
    return Observations(at, labels(at), orders, values, run=order_of_runs(at), spectral_deg=spectral)


@pytest.mark.parametrize("sigma", [1e-6, 2e-5])
def test_teeth_and_pins_of_another_gear_are_asked_about(sigma):
    """Their orders were nothing, others were unexplained, and a sideband was named."""
    other = geared(cycloid_teeth=47, pins=48, reduction_ratio=97.0)
    with pytest.raises(InputError) as error:
        examine(measured(other, sigma), WHOLE, PATH)
    text = str(error.value)
    assert "39, 78, 156 (39 teeth) and 40, 80, 120, 240 (40 pins) and 81, 162 (a shaft that turns 81 times)" in text
    assert "multiples of 47 and of 48 and of 97 are there" in text and "--accept as_is" in text
    # no correction of the data mends it
    with pytest.raises(InputError, match="another gear"):
        examine(measured(other, sigma), WHOLE, PATH, accept=["all"])
    taken = examine(measured(other, sigma), WHOLE, PATH, accept=["as_is"])
    assert any("another gear" in one.text and "(taken as it is)" in one.text for one in taken.mistakes)


def test_pins_alone_are_asked_about():
    (one,) = other_gear(measured(geared(pins=44), 1e-5), WHOLE)
    assert "orders 40, 80, 120, 240 (40 pins) of the rig are missing, and multiples of 44 are there" in one.text


def test_a_gear_that_has_its_waves_is_not_another():
    assert not other_gear(measured(WHOLE, 1e-6), WHOLE)
    # what is missing where nothing else is there, and what is there where nothing is missing
    pins = WHOLE.constants.pin_orders()
    without = replace(WHOLE, effects=tuple(one for one in WHOLE.effects if not {*pins} & set(one.touched_orders())))
    assert not other_gear(measured(without, 1e-6), WHOLE)
    assert not other_gear(measured(geared(pins=44), 1e-6), without)


def test_noise_that_hides_the_waves_hides_that_they_are_another_gears():
    assert not other_gear(measured(geared(pins=44), 1e-2), WHOLE)


def test_another_unit_is_no_other_gear():
    """In rad nothing is as large as the rig lets expect, and a belt of 7 periods a turn stands beside it."""
    data = measured(WHOLE, 1e-6)
    belt = np.array([7, 14])
    values = np.concatenate([data.values, np.full((len(data), 2), 1e-3)], axis=1)
    orders, place = np.concatenate([data.orders, belt]), np.argsort(np.concatenate([data.orders, belt]))
    spectral = np.full(values.shape, 1e-6)
    wider = replace(data, orders=orders[place], values=values[:, place] / 57.3, spectral_deg=spectral / 57.3)
    assert not other_gear(wider, WHOLE)


def test_what_settles_at_the_start_of_curves_whose_waves_a_filter_took_is_no_other_gear():
    """Order 5 and 10 of all the low orders were said to be there, as if they were those of teeth."""
    orders = np.arange(2 * WHOLE.constants.pins + 2)
    model = WHOLE.coefficients(AT, orders.tolist())
    start = 1e-2 / (1.0 + 1j * orders) * (orders < 12)
    values = model * np.where(orders < 30, 1.0, 0.1) + start
    data = Observations(AT, labels(AT), orders, values, spectral_deg=np.full(values.shape, 1e-6))
    assert not other_gear(data, WHOLE)
    # the same with waves that stand out is one
    tall = start * np.where(np.isin(orders, (5, 10)), 3.0, 1.0)
    assert other_gear(replace(data, values=values - start + tall), WHOLE)
