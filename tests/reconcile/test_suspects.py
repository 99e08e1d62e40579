"""Bad runs are named, good ones are not: wrong labels, moved means, waves that slipped."""

import dataclasses
import itertools

import numpy as np
import pytest

from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.data.contrasts import beside_each_other, repeats
from st_codegen.reconcile.data.noise import Noise, estimate
from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.reconcile.rest.suspects import bad_runs, undecided_runs, with_beside, with_rest, without_structure
from st_codegen.rig.effects import Conditions

from .test_core import KNOWN, RIG, observed
from .test_core import SIGMA as NOISE

ORDERS = np.array([0, 1, 3, 39, 40, 78])
SIGMA = np.array([1e-3, *[1e-5] * 5])
GRID = np.array(list(itertools.product(range(100, 1801, 200), range(0, 1801, 300), (25, 30))), float)


def residual(seed, heavy, directions=(1.0, -1.0)):
    """Noise alone, on a grid; standard deviation SIGMA in each part, of Student's t with three degrees if heavy."""
    rng = np.random.default_rng(seed)
    at = Conditions.of(np.repeat(directions, len(GRID)), *np.tile(GRID, (len(directions), 1)).T)
    shape = (2, len(at), len(ORDERS))
    parts = rng.standard_t(3, shape) / np.sqrt(3) if heavy else rng.standard_normal(shape)
    values = SIGMA * (parts[0] + 1j * parts[1])
    values[:, 0] = values[:, 0].real
    return Observations(at, labels(at), ORDERS, values)


def found(data, structured=()):
    return bad_runs(data, data.values, np.broadcast_to(SIGMA, data.values.shape), np.isin(ORDERS, structured))


@pytest.mark.parametrize("heavy", [False, True])
def test_good_runs_are_not_suspected(heavy):
    """20 campaigns of 126 runs."""
    assert sum(len(found(residual(seed, heavy))) for seed in range(20)) == 0


@pytest.mark.parametrize("heavy", [False, True])
def test_bad_runs_are_named_in_both_directions(heavy):
    data = residual(0, heavy)
    count = len(GRID)
    # a moved zero, one wave that slipped, and all orders of another speed
    data.values[[10, 10 + count], 0] += 0.02
    data.values[[60, 60 + count], 3] += 2e-4
    data.values[[99, 99 + count], 1:] += 3e-4j
    assert set(found(data)) == {10, 60, 99, 10 + count, 60 + count, 99 + count}


def test_what_is_off_only_where_the_model_lacks_something_is_no_bad_run():
    """A peak that one run alone meets, say; a run that is off in other orders too is bad all the same."""
    data = residual(0, heavy=False)
    count = len(GRID)
    data.values[[60, 60 + count], 3] += 2e-4
    data.values[[99, 99 + count], 1:] += 3e-4j
    assert set(found(data)) == {60, 99, 60 + count, 99 + count}
    assert set(found(data, structured=[39])) == {99, 99 + count}
    # a model that lacks something everywhere excuses no run that is off in several orders
    assert set(found(data, structured=ORDERS)) == {99, 99 + count}
    noise = Noise(np.broadcast_to(SIGMA, data.values.shape), SIGMA, np.ones(len(data), bool), ((60, 9.0), (99, 9.0)))
    kept = without_structure(data, data.values, noise, np.isin(ORDERS, [39]))
    assert [row for row, _ in kept.suspects] == [99]


def test_having_more_of_what_the_model_lacks_everywhere_is_no_fault_of_a_run():
    """A crack shows in all orders and grows with the load: runs with hardly any load were called bad."""
    data, count, random = residual(0, heavy=False), len(GRID), np.random.default_rng(1)
    orders, sigma = np.arange(30, 42), np.full((2 * count, 12), 1e-5)
    crack = 1e-4 * (random.standard_normal(12) + 1j * random.standard_normal(12))
    values = np.tile(data.values[:, 1:4], 4) + crack * (data.at.torque_Nm[:, None] / 1000 + 1)
    values[[60, 60 + count]] -= 3 * crack
    data = Observations(data.at, labels(data.at), orders, values)
    everywhere = np.ones(12, bool)
    assert set(bad_runs(data, values, sigma, ~everywhere)) == {60, 60 + count}
    assert not bad_runs(data, values, sigma, everywhere)
    values[[99, 99 + count]] += 3e-4j
    assert set(bad_runs(data, values, sigma, everywhere)) == {99, 99 + count}


def test_one_order_beside_those_that_the_model_lacks_is_no_bad_run():
    """One direction of a run near a peak: what the model lacks there does not count among the orders that are off."""
    data = residual(0, heavy=False)
    data.values[60, [3, 4, 5]] += 3e-4
    assert set(found(data)) == {60}
    assert not found(data, structured=[40, 78])


def test_one_direction_alone_needs_several_orders():
    data = residual(0, heavy=True, directions=(1.0,))
    data.values[10, 0] += 0.02
    data.values[99, 1:] += 3e-4j
    assert set(found(data)) == {99}


def test_what_the_model_lacks_is_no_bad_run():
    """A resonance that is in no model: large, but its neighbours in torque and temperature know of it."""
    data = residual(0, heavy=False)
    peak = 3e-4 / (1 + 5j * (data.at.speed_rpm / 1100 - 1) * 10)
    data.values[:, 5] += peak * (1 + data.at.torque_Nm / 2000)
    assert not found(data)


def test_of_a_dozen_runs_in_which_all_orders_are_wrong_none_is_the_bad_one():
    """The one without load was called bad: a crack shows in all orders under load, and not in that run."""
    data = residual(0, heavy=False).rows(np.r_[0:120:10, 126:246:10])
    data.values[[3, 15], 1:] += 3e-4j
    assert set(found(data)) == {3, 15}
    assert not found(data, structured=ORDERS)
    noise = Noise(np.broadcast_to(SIGMA, data.values.shape), SIGMA, np.arange(24) != 3, ((3, 9.0),))
    left = without_structure(data, data.values, noise, np.ones(len(ORDERS), bool))
    assert left.good.all() and not left.suspects


def test_what_happens_without_load_only_is_no_bad_run():
    """At the edge of the grid, where two of three kinds of neighbours know nothing of it."""
    data = residual(0, heavy=False)
    data.values[data.at.torque_Nm == 0, 0] += 0.02
    assert not found(data)


def test_a_deviation_that_other_temperatures_repeat_is_no_bad_run():
    """Row 0 has the one at 30 degrees beside it; what other speeds, torques or directions do says nothing of it."""
    at = Conditions.of([1.0, 1.0, 1.0, 1.0, -1.0], [5, 5, 9, 5, 5], [7, 7, 7, 8, 7], [25, 30, 30, 30, 30])
    deviation = np.array([[4j, 2], [4j, 2], [-4, 9], [-4, 9], [-4, 9]])
    assert repeats(at, deviation, 0)
    deviation[1] = [4, 2j]
    deviation[2:] = [4j, 2]
    assert not repeats(at, deviation, 0)
    assert not repeats(at, deviation, 2)


def test_what_all_runs_of_a_speed_have_is_no_bad_run():
    """Stick and slip at the lowest speed, another in each run: all 43 of its runs were called bad."""
    data = residual(0, heavy=False)
    slow = data.at.speed_rpm == 100
    turn = np.exp(2j * np.pi * np.random.default_rng(1).random((slow.sum(), 3)))
    data.values[np.ix_(slow, [3, 4, 5])] += 3e-4 * turn
    assert found(data) == {}
    assert not set(np.flatnonzero(slow)) & {row for row, _ in estimate(data, data.values).suspects}


def test_more_than_a_few_are_something_else():
    data = residual(0, heavy=False)
    rows = np.arange(0, len(GRID), 5)
    for side in (0, len(GRID)):
        data.values[rows + side, 1] += 3e-4 * np.exp(1j * rows)
    assert not found(data)


def anywhere(count, random):
    """Operating points of both directions anywhere in the conditions."""
    points = (random.uniform(*ends, count).round() for ends in ((100, 1800), (0, 1800), (25, 35)))
    return Conditions.of(np.repeat([1.0, -1.0], count), *(np.tile(values, 2) for values in points))


def test_runs_that_lie_beside_each_other_do_so_by_no_chance():
    """Three that follow each other in one of three conditions do so in 1 of 224 campaigns of 64 runs, 1 of 21 of 20."""
    at = anywhere(64, np.random.default_rng(0))
    smallest = np.argsort(at.torque_Nm[:64])
    (found,) = beside_each_other(at, np.isin(np.arange(128), 64 + smallest[2:5]))
    assert found.condition == "torque" and set(found.rows) == set(64 + smallest[2:5])
    assert not beside_each_other(at, np.isin(np.arange(128), 64 + smallest[[2, 4]])), "two are beside each other often"
    few = at.rows(smallest[:20])
    assert not beside_each_other(few, np.arange(20) < 3)
    # one elsewhere stays a suspect
    (found,) = beside_each_other(at, np.isin(np.arange(128), 64 + smallest[[1, 2, 3, 4, 50]]))
    assert found.condition == "torque" and set(found.rows) == set(64 + smallest[1:5])


@pytest.mark.parametrize("count", [3, 6, 12])
def test_wrong_runs_anywhere_seldom_lie_beside_each_other(count):
    """In fewer than one campaign of a hundred; of 400 that is 10 with a chance of one in 125."""
    random, times = np.random.default_rng(count), 0
    for _ in range(400):
        at = anywhere(64, random).rows(np.arange(64))
        times += bool(beside_each_other(at, np.isin(np.arange(64), random.choice(64, count, replace=False))))
    assert times < 10


def suspected(data, rows):
    """Noise of which some rows are suspects."""
    good = ~np.isin(np.arange(len(data)), rows)
    return Noise(np.ones(data.values.shape), np.ones(len(data.orders)), good, tuple((int(row), 9.0) for row in rows))


def test_both_curves_of_runs_beside_each_other_are_of_one_kind():
    """Forward four follow each other by their torques, backward two of these are far off as well."""
    at = anywhere(64, np.random.default_rng(5))
    smallest = np.argsort(at.torque_Nm[:64])
    data = Observations(at, labels(at), ORDERS, np.zeros((128, len(ORDERS)), complex))
    rows = np.concatenate([smallest[1:5], 64 + smallest[3:5], [smallest[40]]])
    noise = with_beside(data, suspected(data, rows), ~np.isin(np.arange(128), rows))
    assert {row for group in noise.undecided for row in group.rows} == set(rows[:6])
    assert [row for row, _ in noise.suspects] == [smallest[40]]
    assert np.array_equal(np.flatnonzero(~noise.with_the_undecided.good), rows[6:])
    (text,) = undecided_runs(data, noise)
    assert text.startswith("whether 6 curves were measured wrong")


@pytest.mark.parametrize("why", ["a known mistake", "fitted to"])
def test_runs_beside_each_other_that_stay_what_they_are(why):
    at = anywhere(64, np.random.default_rng(5))
    rows = np.argsort(at.torque_Nm[:64])[2:5]
    known = np.isin(np.arange(128), rows)
    data = Observations(at, labels(at), ORDERS, np.zeros((128, len(ORDERS)), complex))
    data = dataclasses.replace(data, left_out=known) if why == "a known mistake" else data
    noise = with_beside(data, suspected(data, rows), ~known if why == "a known mistake" else np.ones(128, bool))
    assert not noise.undecided and {row for row, _ in noise.suspects} == set(rows)


@pytest.mark.parametrize("fitted", [False, True])
def test_a_run_at_the_least_load_of_all_is_undecided(fitted):
    """Forward the two of the least torques; backward the second alone, and between these there is a good one."""
    at = anywhere(64, np.random.default_rng(5))
    smallest = np.argsort(at.torque_Nm[:64])
    data = Observations(at, labels(at), ORDERS, np.zeros((128, len(ORDERS)), complex))
    rows = [*smallest[:2], 64 + smallest[1], smallest[40]]
    noise = with_beside(data, suspected(data, rows), np.full(128, fitted))
    (group,) = noise.undecided
    # both curves of a run are of one kind
    assert set(group.rows) == set(rows[:3]) and [row for row, _ in noise.suspects] == rows[3:]
    (text,) = undecided_runs(data, noise)
    assert "smaller load than all of these in one direction" in text and ("no number is fitted" in text) != fitted
    noise = with_beside(data, suspected(data, rows[2:]), np.full(128, fitted))
    assert not noise.undecided and [row for row, _ in noise.suspects] == rows[2:]
    # of a direction in which nothing is good no load is less than that of all others
    noise = with_beside(data, suspected(data, range(64, 128)), np.full(128, True))
    assert not noise.undecided and len(noise.suspects) == 64


def test_of_runs_at_the_least_load_those_that_numbers_were_fitted_to_are_told_by_themselves():
    """Of all it was said that what is fitted is fitted to them as well, where one of two had been left out."""
    at = anywhere(64, np.random.default_rng(5))
    first, second = np.argsort(at.torque_Nm[:64])[:2]
    data = Observations(at, labels(at), ORDERS, np.zeros((128, len(ORDERS)), complex))
    noise = with_beside(data, suspected(data, [first, second]), np.arange(128) == second)
    assert [(group.rows, group.is_fitted) for group in noise.undecided] == [((first,), False), ((second,), True)]
    left_out, held = undecided_runs(data, noise)
    assert "no number is fitted to them" in left_out and "is fitted to them as well" in held


def test_runs_that_are_off_where_something_stays_unexplained_alone_are_undecided():
    """At the least load of all what a form lacks is largest; a run that is off in another order as well is bad."""
    data = residual(0, heavy=False)
    count = len(GRID)
    least, wrong = [0, count], [60, 60 + count]
    data.values[[*least, *wrong], 0] += 0.02
    data.values[wrong, 3] += 2e-4
    sigma = np.broadcast_to(SIGMA, data.values.shape)
    for fitted, known in itertools.product((False, True), repeat=2):
        left_out = np.isin(np.arange(len(data)), least) if known else None
        noise = dataclasses.replace(suspected(data, [*least, *wrong]), sigma=sigma)
        data = dataclasses.replace(data, left_out=left_out)
        noise = with_rest(data, data.values, noise, np.full(len(data), fitted), [0])
        assert [row for row, _ in noise.suspects] == ([*least, *wrong] if known else wrong)
        assert np.flatnonzero(~noise.good).tolist() == sorted(wrong if fitted and not known else [*least, *wrong])
        told = undecided_runs(data, noise)
        assert len(told) == (not fitted and not known)
        assert all(text.startswith("whether 2 curves were") and "stay unexplained" in text for text in told)


@pytest.mark.parametrize(
    ("orders", "off", "is_undecided"),
    [
        ((6, 40, 50, 60, 70, 80, 90, 116, 122), 6, True),
        ((0, 6, 40, 50, 60, 70, 80, 90, 116, 122), 0, False),
        ((6, 40, 50, 116, 122, 238), 6, False),
    ],
)
def test_runs_off_in_sums_and_differences_of_what_is_unexplained_are_undecided(orders, off, is_undecided):
    """Play mixes waves: off at 122 - 116 as well says nothing of the run, unless most orders are such a mixture."""
    data = residual(0, heavy=False)
    data = dataclasses.replace(data, orders=np.array(orders), values=np.tile(data.values[:, [5]], len(orders)))
    for order in (116, off):
        data.values[[0, len(GRID)], orders.index(order)] += 0.02
    noise = suspected(data, [0, len(GRID)])
    noise = dataclasses.replace(noise, sigma=np.full(data.values.shape, SIGMA[5]))
    noise = with_rest(data, data.values, noise, np.zeros(len(data), bool), [-1, 116, 122])
    assert bool(noise.suspects) is not is_undecided
    assert [group.rows for group in noise.undecided] == [(0, len(GRID))] * is_undecided
    assert not noise.good[[0, len(GRID)]].any()


@pytest.mark.thorough
@pytest.mark.parametrize("places", [(2, 3, 4), (5, 30, 55)], ids=["at small loads", "anywhere"])
def test_runs_far_off_beside_each_other_are_called_unexplained_and_not_bad(places):
    """Where flanks come apart at small loads; the orders were a sixteenth as large, of all other runs."""
    at = anywhere(64, np.random.default_rng(3))
    data = observed(RIG, at, sigma=NOISE)
    rows = 64 + np.argsort(at.torque_Nm[:64])[list(places)]
    apart = 3e-3 * np.exp(1j * np.arange(9)).reshape(3, 3)
    data.values[np.ix_(rows, [3, 5, 6])] += apart
    result = reconcile_observations(RIG, data, KNOWN)
    suspects, said = {row for row, _ in result.noise.suspects}, " ".join(result.cannot_show)
    if places[0] == 2:
        assert not suspects and not (set(rows) - set(np.flatnonzero(result.noise.good)))
        assert all(data.labels[row] in said for row in rows) and "measured wrong" in said
        sizes = {one.order: one.rms_deg for one in result.unexplained}
        assert set(sizes) == {3, 40, 78}
        assert list(sizes.values()) == pytest.approx([3e-3 * np.sqrt(3 / 128 / 2)] * 3, rel=0.1)
        assert result.fitted.after == pytest.approx(np.sqrt(3) * 3e-3 * np.sqrt(3 / 128 / 2), rel=0.1)
    else:
        assert suspects == set(rows) and "measured wrong" not in said
        assert not result.unexplained
