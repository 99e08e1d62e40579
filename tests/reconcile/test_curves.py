"""Curves that were measured badly: with gaps, and cut off by a channel that saturates."""

import numpy as np
import pytest

from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.campaign.curves import Curve
from st_codegen.campaign.orders import curve_sums, fit_orders
from st_codegen.campaign.reader import Campaign, MeasuredCurve
from st_codegen.errors import InputError
from st_codegen.reconcile.data import reading
from st_codegen.reconcile.mistakes.examine import examine
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.te.harmonics import Direction

from .test_forms import RIG

SIGMA = 2e-4
TORQUES = (300.0, 900.0, 1500.0, 1800.0)


def read(folder, monkeypatch, curve, torques=TORQUES):
    """What is read of forward curves of the rig at 1000 rpm; curve: of the random numbers, angle and TE of a turn."""
    random, angle, made = np.random.default_rng(0), np.arange(1000) * 0.36, []
    for number, torque in enumerate(torques):
        te = RIG.te_deg(angle, 1.0, 1000.0, torque, 30.0) + SIGMA * random.standard_normal(len(angle))
        sums = curve_sums(Curve(*curve(random, angle, te)))
        made.append(
            MeasuredCurve(folder / f"run{number}.csv", OperatingPoint(1000.0, torque, 30.0), Direction.FORWARD, sums)
        )
    monkeypatch.setattr(reading, "read_campaign", lambda *_, **__: Campaign(folder, tuple(made), ()))
    return reading.read_measured(folder, RIG)


def with_gap(random, angle, te):
    start = random.integers(0, 920)
    kept = np.r_[:start, start + 70 : 1000]
    return angle[kept], te[kept]


def clipped(_, angle, te):
    """Cut off where the rig's larger torques take it."""
    return angle, np.maximum(te, -0.09)


@pytest.mark.thorough
def test_orders_above_the_band_do_not_leak_out_of_a_gap(tmp_path, monkeypatch):
    """A quarter of 930 samples is 232; the rig has 237, 240 and 243, and nothing lies between 200 and 232."""
    found = read(tmp_path, monkeypatch, with_gap, TORQUES * 3)
    assert not [order for order in found.orders if order > 165]
    assert any("orders 237, 240, 243 of the rig" in text for text in found.not_looked_at)


@pytest.mark.thorough
@pytest.mark.parametrize("order", [260, 300, 380])
def test_an_order_above_the_band_that_the_rig_lacks_does_not_leak_out_of_a_gap(tmp_path, monkeypatch, order):
    """With a gap at one angle in all curves it stood in thirty orders below; in the last runs it was a step of them."""

    def gap(_, angle, te):
        kept = np.r_[:300, 324:1000]
        return angle[kept], (te + 1e-2 * np.cos(np.deg2rad(order * angle) + 1.0))[kept]

    found = read(tmp_path, monkeypatch, gap, TORQUES * 3)
    whole = read(tmp_path, monkeypatch, lambda _, angle, te: (angle, te), TORQUES * 3)
    assert found.orders.tolist() == whole.orders[whole.orders <= 244].tolist()
    noise = SIGMA * np.sqrt(2.0 / 1000)
    assert np.abs((found.values - whole.values[:, whole.orders <= 244]).mean(axis=0)).max() < 2 * noise
    assert found.beyond_deg == pytest.approx(1e-2 / np.sqrt(2), rel=0.03)


@pytest.mark.parametrize("size", [0.3, 1.0, 3.0], ids="{}x".format)
def test_an_order_above_the_band_may_have_another_size_than_the_rig_says(size):
    random, angle = np.random.default_rng(0), np.arange(1000) * 0.36
    te = 1e-3 * np.cos(np.deg2rad(240 * angle)) + 1e-5 * random.standard_normal(1000)
    sums = curve_sums(Curve(*with_gap(random, angle, te)))
    fits = fit_orders(sums, [1]), fit_orders(sums, [1], {240: size * 1e-3 * np.exp(0.5j)})
    leaks = [float(np.sqrt((fit.spectrum[200:] ** 2).mean())) for fit in fits]
    noise = 2e-5 / np.sqrt(sums.samples)
    assert leaks[0] > 10 * noise
    assert leaks[1] < 1.3 * noise


def test_what_even_samples_cannot_tell_stays_as_it_is_expected():
    """Of 300 steps of a turn order 240 is the same as order 60, which is asked for."""
    angle = np.arange(300) * 1.2
    te = 1e-3 * np.cos(np.deg2rad(240 * angle)) + 2e-3 * np.cos(np.deg2rad(60 * angle))
    found = fit_orders(curve_sums(Curve(angle, te)), [60], {240: 1e-3 + 0j})
    assert found.coefficients == pytest.approx(np.array([2e-3]), abs=1e-8)


def two_turns(random, angle, te):
    """Twice as long; a wave of two and a half periods a turn beside it."""
    whole = np.append(angle, angle + 360.0)
    noise = SIGMA * random.standard_normal(len(whole))
    return whole, np.tile(te, 2) + noise + 2e-3 * np.cos(np.deg2rad(2.5 * whole) + 1.0)


def test_of_curves_of_several_turns_the_samples_of_one_tell_the_orders(tmp_path, monkeypatch):
    """Order 290 of 500 steps a turn was called order 210, and what lies between orders was said to lie above them."""
    angle = np.arange(1000) * 0.72
    sums = curve_sums(Curve(angle, 1e-3 * np.cos(np.deg2rad(290 * angle))))
    assert (sums.in_turn, sums.band, sums.taken) == (500, 125, 1000)
    found = read(tmp_path, monkeypatch, two_turns, TORQUES * 3)
    assert found.samples == 1000 and found.beyond_deg == pytest.approx(2e-3 / np.sqrt(2), rel=0.02)
    assert not found.hums and any("waves of no whole number of periods" in text for text in found.not_looked_at)


def test_angles_of_the_fast_shaft_are_refused(tmp_path, monkeypatch):
    """Curves over 81 turns told orders up to 2, of which one was unexplained, and nothing said why."""
    with pytest.raises(InputError, match=r"covers 81 turns, .* so divide it by 81"):
        read(tmp_path, monkeypatch, lambda _, angle, te: (81.0 * angle, te), TORQUES * 3)


def test_curves_that_are_cut_off_are_left_out(tmp_path, monkeypatch):
    whole = read(tmp_path, monkeypatch, lambda _, angle, te: (angle, te), TORQUES * 3)
    assert len(whole) == 12
    found = read(tmp_path, monkeypatch, clipped, TORQUES * 3)
    assert found.at.torque_Nm.max() == 900.0
    (said,) = (text for text in found.not_looked_at if "cut off" in text)
    assert "6 curves that are cut off at -0.09," in said
    assert said.endswith("run10.csv, run11.csv, run2.csv, run3.csv, run6.csv, ..")


def test_curves_that_are_cut_off_at_values_of_their_own_are_left_out(tmp_path, monkeypatch):
    """All orders of such runs were another factor times the rig's, or unexplained: no value was in three curves."""

    def own(random, angle, te):
        return angle, np.minimum(te, np.quantile(te, 0.9)) if random.random() < 0.4 else te

    found = read(tmp_path, monkeypatch, own, TORQUES * 3)
    (said,) = (text for text in found.not_looked_at if "cut off" in text)
    assert 6 < len(found) < 12
    assert said.startswith(f"{12 - len(found)} curves that are cut off at values of their own, with up to ")


def test_curves_without_noise_have_the_least_that_a_fit_knows(tmp_path, monkeypatch):
    """Their last digits were an angle that is read wrong by 9e-15 deg, and then unexplained orders of 2e-18 deg."""
    monkeypatch.setattr(f"{__name__}.SIGMA", 0.0)
    found = read(tmp_path, monkeypatch, lambda _, angle, te: (angle, te), TORQUES * 3)
    assert (found.spectral_deg[:, found.orders > 0] >= 0.5 * SETTINGS.least_noise_deg).all()


def test_curves_of_one_value_say_nothing(tmp_path, monkeypatch):
    """A channel that stood still had the data show nothing of any part of the rig, and another zero than its value."""
    found = read(tmp_path, monkeypatch, lambda random, angle, te: (angle, te * (random.random() > 0.3)), TORQUES * 3)
    (said,) = (text for text in found.not_looked_at if "one value" in text)
    assert 6 < len(found) < 12 and said.startswith(f"{12 - len(found)} curves with one value in all samples")
    with pytest.raises(InputError, match=r"whole: 12 curves with one value .* See whether the channel works$"):
        read(tmp_path, monkeypatch, lambda _, angle, te: (angle, 0.0 * te), TORQUES * 3)


def test_a_campaign_of_which_most_curves_are_cut_off_at_values_of_their_own_is_refused(tmp_path, monkeypatch):
    """What stays at its extreme for a few samples alone was left, and its eccentricity had changed."""

    def own(random, angle, te):
        return angle, np.minimum(te, np.quantile(te, 0.6 if random.random() < 0.8 else 0.995))

    with pytest.raises(InputError, match=r"most curves are not whole, and nobody knows of the others: .* wider range$"):
        read(tmp_path, monkeypatch, own, TORQUES * 3)


def test_one_run_of_few_digits_that_repeats_its_extreme_is_not_called_cut_off(tmp_path, monkeypatch):
    def coarse(_, angle, te):
        return angle, np.maximum(np.round(te, 3), -0.09)

    assert len(read(tmp_path, monkeypatch, coarse)) == len(TORQUES)


def test_rounded_curves_are_whole(tmp_path, monkeypatch):
    """Ten digits of the converter make many samples alike at the extreme, and about as many beside it."""
    found = read(tmp_path, monkeypatch, lambda _, angle, te: (angle, np.round(te, 3)), TORQUES * 3)
    assert len(found) == 12


@pytest.mark.parametrize(("sigma", "step", "said"), [(5e-5, 1e-3, True), (1e-3, 1e-3, False), (0.0, 1e-9, False)])
def test_steps_of_te_that_are_more_than_its_noise_are_said(tmp_path, monkeypatch, sigma, step, said):
    """A hundred orders of a sound machine were unexplained, and nothing said that its encoder made them."""
    monkeypatch.setattr(f"{__name__}.SIGMA", sigma)
    found = read(tmp_path, monkeypatch, lambda _, angle, te: (angle, np.round(te / step) * step), TORQUES * 3)
    of_steps = [text for text in found.not_looked_at if text.startswith("what TE does within its steps of 0.001 deg")]
    assert bool(of_steps) is said and all("in 12 of 12 curves" in text for text in of_steps)


def test_curves_of_a_coarse_channel_are_not_cut_off(tmp_path, monkeypatch):
    """All but the tops of a curve are rounded to one value, many samples in a row: a finer channel is what it wants."""

    def coarse(_, angle, te):
        wave = te - te.mean()
        step = 1.94 * np.abs(wave).max()
        return angle, np.round(wave / step) * step

    found = read(tmp_path, monkeypatch, coarse, TORQUES * 3)
    assert len(found) == 12


def test_a_value_that_is_frequent_but_never_stays_is_not_where_curves_are_cut_off(tmp_path, monkeypatch):
    """Each second sample has the lowest value, as where a channel drops out: none of the curve lies flat there."""
    found = read(
        tmp_path, monkeypatch, lambda _, angle, te: (angle, np.where(np.arange(1000) % 2, te, -0.5)), TORQUES * 3
    )
    assert len(found) == 12


def test_angles_that_do_not_tell_the_orders_apart_are_those_of_a_named_file(tmp_path, monkeypatch):
    def coarse(_, angle, te):
        return np.floor(angle / 9.0) * 9.0, te

    with pytest.raises(InputError) as caught:
        read(tmp_path, monkeypatch, coarse)
    said = str(caught.value)
    assert "run0.csv, forward: the angles of the samples do not tell the orders 39, 40, 42, " in said
    assert all(len(line) < 300 for line in said.splitlines()) and " from others" in said


def test_a_campaign_of_which_no_curve_is_whole_is_refused(tmp_path, monkeypatch):
    """Finer digits help where curves have few."""

    def coarse(random, angle, te):
        angle, te = clipped(random, angle, te)
        return angle, np.round(te, 3)

    said = r"no curve is whole: 12 curves that are cut off at -0\.09, .* wider range"
    for made, digits in ((clipped, ""), (coarse, ", or finer digits")):
        (tmp_path / made.__name__).mkdir()
        with pytest.raises(InputError, match=f"{said}{digits}$"):
            read(tmp_path / made.__name__, monkeypatch, made, (1800.0,) * 12)


def test_a_reduction_ratio_that_is_one_tooth_off_is_said_as_it_is(tmp_path, monkeypatch):
    """A ramp in steps has larger orders than a smooth one: 80 was said to be 80.0089."""

    def wrong(_, angle, te):
        return angle, te + angle * (1.0 - 81.0 / 80.0)

    data = read(tmp_path, monkeypatch, wrong, TORQUES * 3)
    with pytest.raises(InputError, match=r"reduction ratio of 80(\.000\d)? instead of 81; give --accept ratio to take"):
        examine(data, RIG, tmp_path)


def spiky(random, angle, te):
    """Two samples of each curve are off, as where a counter slips: every order of it has 4e-4 deg of them."""
    te = te.copy()
    te[random.permutation(len(te))[:2]] += 0.2
    return angle, te


def test_single_samples_that_are_far_off_are_left_out_and_named(tmp_path, monkeypatch):
    """Every order was off by 5e-4 deg, 40 times its noise."""
    whole = read(tmp_path, monkeypatch, lambda _, angle, te: (angle, te), TORQUES * 3)
    found = read(tmp_path, monkeypatch, spiky, TORQUES * 3)
    assert found.orders.tolist() == whole.orders.tolist() and found.samples == 1000
    noise = np.sqrt(2.0) * SIGMA * np.sqrt(2.0 / 1000)
    assert np.sqrt((np.abs(found.values - whole.values)[:, found.orders > 0] ** 2).mean()) < 2 * noise
    (text,) = (text for text in found.not_looked_at if "single samples" in text)
    assert text.startswith("24 single samples of 12 curves, at most 2 of one, up to 0.21 deg off")
    assert not any("single samples" in text for text in whole.not_looked_at)


@pytest.mark.thorough
def test_what_curves_hold_above_the_orders_that_are_told_is_said(tmp_path, monkeypatch):
    """A wave of 500 noises above a quarter of the samples, and nothing was found missing."""
    quiet = read(tmp_path, monkeypatch, lambda _, angle, te: (angle, te), TORQUES * 3)
    assert quiet.beyond_deg == 0.0
    assert any(text == "orders above 250" for text in quiet.not_looked_at)
    loud = read(
        tmp_path,
        monkeypatch,
        lambda _, angle, te: (angle, te + 2e-3 * np.cos(np.deg2rad(380 * angle) + 1.0)),
        TORQUES * 3,
    )
    assert loud.beyond_deg == pytest.approx(2e-3 / np.sqrt(2), rel=0.01)
    assert loud.scaled(-60.0).beyond_deg == 60.0 * loud.beyond_deg
    assert any("hold 0.0014 deg RMS there in the median, which is more than" in text for text in loud.not_looked_at)
    # what the rig has there is none of it
    gap = read(tmp_path, monkeypatch, with_gap, TORQUES * 3)
    assert gap.beyond_deg == 0.0


@pytest.mark.thorough
def test_a_wave_that_was_taken_out_of_curves_is_none_of_what_they_hold_above_the_orders(tmp_path, monkeypatch):
    """A bearing's wave of 7.43 periods a turn was said to lie above the orders as well, with all of its size."""
    found = read(
        tmp_path,
        monkeypatch,
        lambda _, angle, te: (angle, te + 2e-3 * np.cos(np.deg2rad(7.43 * angle) + 1.0)),
        TORQUES * 3,
    )
    (wave,) = found.hums
    assert wave.order == pytest.approx(7.43, abs=0.01) and wave.power == pytest.approx(2e-6, rel=0.02)
    assert found.beyond_deg == 0.0
