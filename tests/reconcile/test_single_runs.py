"""Single runs that were measured otherwise than they say are left out: labels, directions, signs, a factor."""

import re
from dataclasses import replace

import numpy as np
import pytest

from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.reconcile.mistakes import single_runs
from st_codegen.reconcile.mistakes.examine import examine
from st_codegen.reconcile.mistakes.single_runs import _Asked, _block, _by_label, _places, _ways
from st_codegen.rig.effects import Conditions, Stage

from .test_measurement import ORDERS, PATH, RIG, RUNS, measured, of_curves, of_runs


def test_wrong_labels_beside_a_small_factor_are_no_torques_of_their_own():
    """A factor on a column that was corrected to 0.4 % left all torques a little off, and labels made it large."""
    data = of_curves(3e-6)
    order = np.arange(RUNS)
    chosen = np.random.default_rng(3).choice(RUNS, RUNS // 12, replace=False)
    order[chosen] = np.roll(chosen, 1)
    moved = replace(data, at=data.at.rows(np.concatenate([order, order + RUNS])))
    made = replace(moved, values=moved.values * np.where(data.at.sign > 0, 1.004, 1.0)[:, None])
    assert {mistake.name for mistake in examine(made, RIG, PATH).mistakes} == {"labels"}


@pytest.mark.slow
def test_where_noise_hides_whose_label_a_run_carries_that_is_said():
    """Of five wrong labels in noise two were noticed, and nothing was said of the check that was not made."""
    few, most = (examine(measured(sigma), RIG, PATH).untold for sigma in (1e-3, 3e-4))
    assert any("of a single one: runs that carry the label of another one" in said for said in few)
    (share,) = (re.search(r"at least about (\d+) % of runs with the label of another one", said) for said in most)
    # in so much noise runs are not noticed more often than that
    data, random, noticed = measured(3e-4), np.random.default_rng(3), []
    for one, other in random.integers(0, RUNS, (25, 2)):
        order = np.arange(RUNS)
        order[[one, other]] = other, one
        at = replace(data.at.rows(np.concatenate([order, order + RUNS])), sign=data.at.sign)
        left_out = examine(replace(data, at=at, labels=labels(at)), RIG, PATH).left_out
        noticed += [any(row % RUNS == run for row in left_out) for run in {one, other} if one != other]
    assert 0.2 < np.mean(noticed) < 1.1 - int(share[1]) / 100.0
    # nor is it otherwise where each run has one direction
    single = data.at.sign * np.where(data.number_of_run % 2, 1.0, -1.0) > 0
    half = replace(
        data, at=data.at.rows(single), values=data.values[single], labels=labels(data.at.rows(single)), run=None
    )
    (said,) = examine(half, RIG, PATH).untold
    assert "label of another one" in said


@pytest.mark.parametrize(("hidden", "said"), [(9, "noise at least about 90 % of runs with"), (10, "noise runs with")])
def test_how_many_wrong_labels_would_not_be_noticed_is_no_least_share_of_all(hidden, said, monkeypatch):
    """It was "at least about 100 %", because "the two differ too little", where the mean alone differed by far."""
    monkeypatch.setattr(single_runs, "_exchanges", lambda _: (hidden, 10))
    (text,) = single_runs.hidden_labels(measured(), RIG)
    assert f"in this {said} the label of another one would not be noticed" in text and "too few" in text


def test_orders_that_a_curve_does_not_tell_say_nothing_of_its_label():
    """Of runs with few samples the orders of a resonance were zero, as they are in runs at a low speed."""
    data = of_curves(3e-6)
    seen = np.ones(data.values.shape, bool)
    seen[np.ix_(np.arange(2 * RUNS) % RUNS % 4 == 0, ORDERS > 100)] = False
    made = replace(data, values=np.where(seen, data.values, 0.0), seen=seen)
    assert examine(made, RIG, PATH).mistakes == ()


def test_wrong_labels_are_left_out_and_named():
    data, random = measured(), np.random.default_rng(4)
    chosen = random.choice(RUNS, 17, replace=False)
    order = np.arange(RUNS)
    order[chosen] = np.roll(chosen, 1)
    at = data.at.rows(np.concatenate([order, order + RUNS]))
    at = replace(at, sign=data.at.sign)
    examined = examine(replace(data, at=at, labels=labels(at)), RIG, PATH)
    (mistake,) = examined.mistakes
    assert mistake.name == "labels"
    found = {row % RUNS for row in examined.left_out}
    assert found <= set(chosen.tolist()), "no run with its own label is called wrong"
    # a label of nearly the same conditions makes no difference
    assert len(found) >= 14


def scattered(seed, sigma, runs=60):
    """Runs at speeds, torques and oil temperatures of their own, both directions of each, and their noise."""
    random = np.random.default_rng(seed)
    points = random.uniform([200, 0, 25], [1700, 1600, 35], (runs, 3)).round()
    at = Conditions.of(np.repeat([1.0, -1.0], runs), *np.tile(points, (2, 1)).T)
    noise = sigma * (random.standard_normal((2, *at.sign.shape, len(ORDERS))) * [[[1.0]], [[1.0]]])
    values = RIG.coefficients(at, ORDERS.tolist()) + noise[0] + 1j * np.where(ORDERS == 0, 0.0, noise[1])
    spectral, run = np.full(values.shape, sigma), np.tile(np.arange(runs), 2)
    return random, Observations(at, labels(at), ORDERS, values, run=run, spectral_deg=spectral)


def under_labels(data, order):
    """The data with the conditions of other runs, (runs,)."""
    at = replace(data.at.rows(np.concatenate([order, order + len(order)])), sign=data.at.sign)
    return replace(data, at=at, labels=labels(at))


@pytest.mark.parametrize("seed", range(6))
def test_runs_that_passed_on_their_labels_are_named_with_those_of_each_other(seed):
    """Where torques scatter some torque is as good as any label: some were not noticed, or with a label not theirs."""
    random, data = scattered(seed, 2e-5)
    chosen = random.choice(60, 5, replace=False)
    order = np.arange(60)
    order[chosen] = np.roll(chosen, 1)
    (mistake,) = examine(under_labels(data, order), RIG, PATH).mistakes
    assert mistake.name == "labels"
    found = {row % 60 for row in mistake.rows}
    assert found <= set(chosen.tolist()) and len(found) >= 3
    for run in found:
        speed, torque, oil = (int(axis[run]) for axis in data.at.axes[:3])
        assert f"agrees with {speed} rpm, {torque} N m, {oil} degC" in mistake.text


@pytest.mark.parametrize("seed", range(6))
def test_runs_with_wrong_torques_have_passed_on_no_labels(seed):
    random, data = scattered(seed, 1e-5)
    wrong = random.choice(60, 5, replace=False)
    off = np.where(np.isin(np.arange(60), wrong), random.uniform(0, 1600, 60) - data.at.torque_Nm[:60], 0.0)
    at = replace(data.at, torque_Nm=data.at.torque_Nm + np.tile(off, 2))
    found = examine(replace(data, at=at, labels=labels(at)), RIG, PATH).mistakes
    (one,) = [one for one in found if one.name == "labels"]
    assert "to have had another torque" in one.text and {row % 60 for row in one.rows} <= set(wrong.tolist())
    for row, told in zip(one.rows[::2], re.findall(r"agrees with about (\S+) N m", one.text), strict=True):
        assert float(told) == pytest.approx(data.at.torque_Nm[row], abs=10)


@pytest.mark.parametrize("seed", [1, 3, 6])
def test_a_run_with_a_factor_of_its_own_agrees_with_no_label_and_no_torque(seed):
    """Another label, or torque, took off most of what it left, and left ten thousand times the noise: it "agreed"."""
    random, data = scattered(seed, 1e-5)
    wrong = random.choice(60, 3, replace=False)
    random.uniform(size=60)
    factor = np.where(np.isin(np.arange(60), wrong), random.uniform(0.5, 1.6, 60), 1.0)
    assert not examine(replace(data, values=data.values * np.tile(factor, 2)[:, None]), RIG, PATH).mistakes


def test_small_torques_are_told_by_their_digits():
    """Of 8 N m at most "about 7 N m" and "about 3 N m" were said, as if to one of them."""
    random, data = scattered(0, 1e-8)
    small = replace(data.at, torque_Nm=data.at.torque_Nm / 200.0)
    values = data.values + RIG.coefficients(small, ORDERS.tolist()) - RIG.coefficients(data.at, ORDERS.tolist())
    off = np.where(np.isin(np.arange(60), (5, 17, 40)), random.uniform(2.0, 6.0, 60) - small.torque_Nm[:60], 0.0)
    at = replace(small, torque_Nm=small.torque_Nm + np.tile(off, 2))
    (one,) = examine(replace(data, values=values, at=at, labels=labels(at)), RIG, PATH).mistakes
    told = [float(number) for number in re.findall(r"agrees with about (\S+) N m", one.text)]
    assert len(told) == 3
    assert told == pytest.approx([small.torque_Nm[row] for row in one.rows[::2]], abs=0.03)


@pytest.mark.parametrize("seed", range(3))
def test_a_block_among_scattered_conditions_is_no_noise_between_neighbours(seed):
    """Each run of it lay beside right ones: the noise was large, one order alone was sure, and nothing was named."""
    _, data = scattered(seed, 1e-5)
    factor = np.tile(np.where((np.arange(60) >= 20) & (np.arange(60) < 37), 2.0, 1.0), 2)
    (mistake,) = examine(replace(data, values=data.values * factor[:, None]), RIG, PATH).mistakes
    assert mistake.name == "block" and {row % 60 for row in mistake.rows} == set(range(20, 37))
    assert "17 runs is 2 times as large" in mistake.text and "run 21 to run 37" in mistake.text


def test_as_many_labels_among_each_other_are_counted_against_chance():
    assert [_ways(2, 2), _ways(3, 2), _ways(5, 5)] == [1, 9, 44]
    assert [_places(1, 3), _places(6, 2), _places(12, 3)] == [1, 14, 74]


@pytest.mark.thorough
def test_many_runs_may_have_passed_on_their_labels():
    """Of 110 of 1200 runs the chance was no number, and of a thousand lists of places the count went too deep."""
    _, data = scattered(1, 2e-5, 1200)
    order = np.arange(1200)
    order[:110] = np.roll(order[:110], 1)
    (mistake,) = examine(under_labels(data, order), RIG, PATH).mistakes
    found = {row % 1200 for row in mistake.rows}
    assert mistake.name == "labels" and found <= set(range(110)) and len(found) > 100
    assert _places(1, 1000) == 1 and _ways(1000, 1000) > 0


def test_a_label_of_one_direction_is_none_of_a_run_with_both():
    """What it would leave of one curve was compared with what other labels leave of two."""
    at = Conditions.of(
        np.array([1.0, -1.0, 1.0, -1.0, 1.0]), np.array([100.0, 100.0, 200.0, 200.0, 300.0]), np.zeros(5), np.zeros(5)
    )
    known = np.array([[0.0], [0.0], [1.0], [1.0], [2.0]], np.complex128)
    values = np.array([[2.0], [2.0], [1.0], [1.0], [2.0]], np.complex128)
    asked = _Asked(
        Observations(at, labels(at), np.array([1]), values), RIG, np.ones(1, bool), values, known, np.ones((5, 1))
    )
    losses = {at.speed_rpm[row]: loss for row, loss in _by_label(asked, np.array([0, 1])).items()}
    assert losses == {100.0: 8.0, 200.0: 2.0}
    # two runs of one label leave no more than one of them
    twice = _Asked(
        asked.data.rows(np.array([0, 1, 2, 3, 2, 3])),
        RIG,
        asked.sure,
        *(part[[0, 1, 2, 3, 2, 3]] for part in (values, known, asked.weight)),
    )
    assert min(_by_label(twice, np.array([0, 1])).values()) == 2.0


def test_runs_with_another_zero_are_no_block_of_a_smaller_size():
    """Along what the rig says a turned wave is smaller: three runs of other zeros were 0.498 times as large."""
    data = measured()
    known, weight = RIG.coefficients(data.at, ORDERS.tolist()), np.full(data.values.shape, 1e12)
    few = (np.arange(2 * RUNS) % RUNS < 3)[:, None]
    turned = known * np.exp(1j * np.deg2rad(3.0) * few * ORDERS)
    assert not _block(data, turned, known, weight)
    (block,) = _block(data, np.where(few, 0.5, 1.0) * known, known, weight)
    assert "3 runs is 0.5 times" in block.text


def test_a_block_of_runs_with_a_factor_is_left_out():
    data = measured()
    factor = np.ones(RUNS)
    factor[50:90] = 0.5
    examined = examine(replace(data, values=data.values * np.tile(factor, 2)[:, None]), RIG, PATH)
    assert {row % RUNS for row in examined.left_out} == set(range(50, 90))
    # runs that have others among them, half as many as they are, are a block still
    for last, is_block in ((109, True), (110, False)):
        factor = np.where(np.isin(np.arange(RUNS), [*range(50, 89), last]), 0.5, 1.0)
        known = RIG.coefficients(data.at, ORDERS.tolist())
        found = _block(data, known * np.tile(factor, 2)[:, None], known, np.full(known.shape, 1e12))
        assert bool(found) is is_block
    assert "block of 40 runs is 0.5 times" in examined.mistakes[0].text


@pytest.mark.thorough
@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("of", [measured, of_curves])
def test_curves_with_another_sign_are_left_out(share, of):
    """The mean of these and the others was smaller, and their column was asked to be divided by that."""
    data = of()
    wrong = np.arange(RUNS, 2 * RUNS)[np.random.default_rng(3).random(RUNS) < share]
    values = data.values.copy()
    values[wrong] *= -1.0
    examined = examine(replace(data, values=values), RIG, PATH)
    assert examined.left_out == tuple(wrong)
    (mistake,) = examined.mistakes
    assert "opposite sign of the rig's in most orders" in mistake.text
    assert not examine(data, RIG, PATH).mistakes


@pytest.mark.parametrize("share", [0.02, 0.33])
def test_curves_whose_angle_counts_the_other_way_are_left_out(share):
    """A third of the backward curves, whose TE was stored from its end, made eleven orders unexplained."""
    data = of_curves()
    wrong = np.arange(RUNS, 2 * RUNS)[np.random.default_rng(3).random(RUNS) < share]
    values = data.values.copy()
    values[wrong] = values[wrong].conj()
    examined = examine(replace(data, values=values), RIG, PATH)
    assert examined.left_out == tuple(wrong)
    (mistake,) = examined.mistakes
    assert "to count the other way than its TE" in mistake.text


@pytest.mark.parametrize("share", [0.02, 0.33, 0.45])
def test_runs_with_exchanged_directions_are_left_out(share):
    """A third of the campaign, at one temperature, made 13 orders depend on the temperature."""
    data = measured()
    wrong = np.random.default_rng(3).random(RUNS) < share
    exchanged = np.where(np.tile(wrong, 2)[:, None], np.roll(data.values, RUNS, axis=0), data.values)
    examined = examine(replace(data, values=exchanged), RIG, PATH)
    (mistake,) = examined.mistakes
    assert {row % RUNS for row in examined.left_out} == set(np.flatnonzero(wrong).tolist())
    assert mistake.text.startswith(f"{wrong.sum()} runs seem to have forward and backward exchanged: ")
    assert "ward," not in mistake.text and "ward)" not in mistake.text


@pytest.mark.thorough
def test_loads_of_the_other_sign_may_bear_on_the_other_flanks():
    """Where the flank follows the load, runs that the load drives look as if their directions were exchanged."""
    data = measured()
    driven = np.tile(np.arange(RUNS) % 3 == 0, 2)
    exchanged = np.where(driven[:, None], np.roll(data.values, RUNS, axis=0), data.values)
    for loads, said in ((np.where(driven, -1.0, 1.0), True), (1.0, False)):
        at = replace(data.at, torque_Nm=loads * (data.at.torque_Nm + 100.0))
        change = RIG.coefficients(at, ORDERS.tolist()) - RIG.coefficients(data.at, ORDERS.tolist())
        change = np.where(driven[:, None], np.roll(change, RUNS, axis=0), change)
        seen = replace(data, at=at, labels=labels(at), values=exchanged + change)
        (mistake,) = examine(seen, RIG, PATH).mistakes
        assert {row % RUNS for row in mistake.rows} == set(range(0, RUNS, 3))
        assert ("the other flanks may bear there" in mistake.text) == said


def test_a_label_is_no_matter_of_one_order():
    """The mean lagged behind the load's history: runs "agreed" with another temperature, by nothing but their mean."""
    data = of_curves(3e-5)
    mean = RIG.coefficients(data.at, [0])[:, 0]
    other = np.roll(mean[:RUNS], 1)
    moved = of_runs(np.arange(RUNS) % 9 == 4)[:, 0]
    values = data.values.copy()
    values[:, 0] += np.where(moved, np.tile(other, 2)[: len(mean)] - mean, 0.0)
    assert all(mistake.name != "labels" for mistake in examine(replace(data, values=values), RIG, PATH).mistakes)


def test_a_resonance_that_moves_is_no_wrong_label():
    """Its frequency fell over the campaign: a run at 1769 rpm carried the label of one at 1815 rpm."""
    random = np.random.default_rng(0)
    axes = np.meshgrid(np.linspace(200, 2000, 40), [0.0, 1200.0])
    points = random.permutation(np.stack([axis.ravel() for axis in axes], axis=1))
    runs, sigma, orders = len(points), 4e-6, np.array(RIG.orders())
    at = Conditions.of(np.repeat([1.0, -1.0], runs), *np.tile(points, (2, 1)).T, np.full(2 * runs, 30.0))
    (resonance,) = RIG.of_stage(Stage.STRUCTURE)
    values, step = np.zeros((2 * runs, len(orders)), complex), np.tile(np.arange(runs) * 16 // runs, 2)
    for number in range(16):
        moved = resonance.with_values({**resonance.values, "frequency_Hz": 54.3 * (1 - 0.04 * number / 15)})
        rig = RIG.with_effects([moved if one is resonance else one for one in RIG.effects])
        values[step == number] = rig.coefficients(at, orders.tolist())[step == number]
    noise = sigma * (random.standard_normal(values.shape) + 1j * random.standard_normal(values.shape))
    spectral, run = np.full(values.shape, sigma), np.tile(np.arange(runs), 2)
    data = Observations(
        at, labels(at), orders, values + np.where(orders == 0, noise.real, noise), run=run, spectral_deg=spectral
    )
    assert not examine(data, RIG, PATH).left_out
