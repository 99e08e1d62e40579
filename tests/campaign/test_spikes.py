"""Single samples far from those around them: left out and named, unless an angle of the turn has them again."""

import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples

pytest.importorskip("polars")

from st_codegen.campaign import spikes
from st_codegen.campaign.conditions import OperatingPoint
from st_codegen.campaign.curves import Curve, Run, write_run
from st_codegen.campaign.orders import curve_sums, fit_orders
from st_codegen.campaign.reader import read_campaign
from st_codegen.campaign.spikes import off_deg, repeated
from st_codegen.errors import InputError
from st_codegen.te.harmonics import Direction
from st_codegen.training.measured import measured_table

from .test_orders import ORDERS, a_curve, coefficients


def with_spikes(curve, places, size):
    te = curve.te_deg.copy()
    te[places] += size
    return replace(curve, te_deg=te)


@pytest.mark.parametrize("size", [0.2, -3.0, 4294967.295])
def test_orders_are_those_of_the_other_samples(size):
    curve = a_curve(coefficients())
    places = np.random.default_rng(2).permutation(len(curve.te_deg))[:40]
    sums = curve_sums(with_spikes(curve, places, size))
    assert sums.samples == len(curve.te_deg) - 40 and sums.in_turn == len(curve.te_deg)
    assert sorted(sums.spikes[0]) == sorted(np.deg2rad(curve.angle_deg[places]))
    assert np.abs(fit_orders(sums, ORDERS).coefficients - coefficients()).max() < 1e-12
    # every order would be off by the mean of the spikes
    assert np.abs(fit_orders(sums.with_spikes(np.ones(40, bool)), [0]).coefficients).max() > abs(size) / 500


def test_what_is_put_back_is_as_if_it_had_never_been_left_out(monkeypatch):
    curve = with_spikes(a_curve(coefficients(), noise=1e-5), [0, 77, 4000, 10_799], 0.5)
    found = curve_sums(curve)
    assert found.spikes.shape == (4, 4)
    monkeypatch.setattr(spikes, "_FAR", np.inf)
    whole, back = curve_sums(curve), found.with_spikes(np.ones(4, bool))
    assert back.samples == whole.samples == back.in_turn and not back.spikes.size
    assert np.abs(back.angle - whole.angle).max() < 1e-9 and np.abs(back.te - whole.te).max() < 1e-9
    assert back.te_square == pytest.approx(whole.te_square, rel=1e-12)


@pytest.mark.parametrize("many", [1, 2, 3, 4, 30, 240, 300])
def test_up_to_a_twentieth_of_the_samples_in_a_row_are_spikes(many):
    te = 1e-4 * np.random.default_rng(0).standard_normal(5000)
    te[1000 : 1000 + many] += 0.1
    assert np.flatnonzero(off_deg(te)).tolist() == [*range(1000, 1000 + many)][: many if many < 300 else 0]


def test_samples_in_a_row_that_are_anything_are_left_out():
    random = np.random.default_rng(0)
    te = a_curve(coefficients(), 1000, noise=1e-4).te_deg.copy()
    te[400:430] += random.uniform(0.2, 2.0, 30) * random.choice([-1, 1], 30)
    assert np.flatnonzero(off_deg(te)).tolist() == [*range(400, 430)]
    assert np.array_equal(off_deg(te[::-1])[::-1], off_deg(te))  # whichever way the axis runs


def test_what_rises_or_falls_back_over_several_samples_is_none():
    """A dent has slopes, what settles behind the start has one jump, and so has a counter that slips."""
    at, noise = np.arange(1000), 1e-5 * np.random.default_rng(0).standard_normal(1000)
    te = a_curve(coefficients(), 1000).te_deg + noise
    for off in (
        0.05 * np.exp(-0.5 * ((at - 400) / 6.0) ** 2),
        np.where(at > 400, 0.05 * np.exp(-(at - 400) / 30.0), 0.0),
        np.where(at < 30, 0.05, 0.0),
        np.where(at > 970, 0.05, 0.0),
        np.where(at > 400, 0.05, 0.0),
    ):
        assert not off_deg(te + off).any()


@pytest.mark.parametrize(
    "made",
    [
        lambda random, n: random.standard_normal(n),
        lambda random, n: random.laplace(size=n),
        lambda random, n: random.uniform(-1, 1, n),
        lambda random, n: np.round(0.2 * random.standard_normal(n)),
        lambda random, n: (random.random(n) < 0.004).astype(float),
        lambda random, n: np.cumsum(random.standard_normal(n)),
        lambda random, n: np.where(np.arange(n) < n // 3, 0.0, 100.0) + 0.1 * random.standard_normal(n),
        lambda random, n: 100 * np.exp(-np.arange(n) / 3.0) + 0.1 * random.standard_normal(n),
        lambda random, n: np.cos(2 * np.pi * np.arange(n) * 2.9 / 10),
        lambda random, n: np.zeros(n),
    ],
    ids=["normal", "laplace", "uniform", "few_digits", "one_digit", "wandering", "step", "settling", "wave", "zero"],
)
def test_noise_steps_digits_and_waves_are_no_spikes(made):
    random = np.random.default_rng(1)
    assert not any(off_deg(made(random, n)).any() for n in (100, 300, 2000, 20_000))


@examples(40)
@given(st.integers(100, 3000), st.floats(1e-9, 1e9), st.integers(0, 10**6))
def test_a_spike_is_found_at_any_scale_and_no_more_than_a_hundredth_are_spikes(n, scale, seed):
    random = np.random.default_rng(seed)
    te = random.standard_normal(n)
    places = random.permutation(n)[: max(n // 400, 1)]
    far = te.copy()
    far[places] += 40.0 * random.choice([-1, 1], len(places))
    found = off_deg(scale * far)
    # the scale is an estimate, and a median of few neighbours that are spikes as well may hide one of them
    assert set(np.flatnonzero(found)) <= set(places.tolist()) and np.count_nonzero(found) <= n / 100
    if n >= 800:
        assert np.count_nonzero(found) > 0


@pytest.mark.parametrize("where", [[0], [-1], [0, 1], [-2, -1], [0, -1], [-10, -1], [0, 9]])
@pytest.mark.parametrize("noise", [0.0, 5e-4])
def test_spikes_at_the_ends_of_a_curve_are_found(where, noise):
    """The last sample was the median of itself: 2 deg of a row that was cut off moved order 1 by a fifth, unsaid."""
    theta = np.linspace(0.0, 2.0 * np.pi, 1024)
    te = 0.017 * np.cos(theta + 1.1) + 1e-3 * np.cos(40 * theta)
    te += noise * np.random.default_rng(0).standard_normal(len(te))
    assert not off_deg(te).any()
    most = np.abs(te).max()
    te[where] = 2.0
    found = off_deg(te)
    assert np.flatnonzero(found).tolist() == sorted(n % len(te) for n in where)
    assert (np.abs(te - found) < 2 * most).all()


def test_what_stands_at_one_angle_in_several_curves_is_none_by_chance():
    random = np.random.default_rng(0)
    alone = [random.uniform(0, 2 * np.pi, 20) for _ in range(30)]
    assert not np.concatenate(repeated(alone, 1e-3)).any()
    # just below a whole turn, and just above
    shared = [np.append(own, 2e-4 * (-1) ** n) for n, own in enumerate(alone[:9])]
    again = repeated([*shared, *alone[9:]], 1e-3)
    assert [one.tolist() for one in again[:9]] == [[False] * 20 + [True]] * 9 and not np.concatenate(again[9:]).any()
    assert not np.concatenate(repeated([*shared[:2], *alone[5:]], 1e-3)).any()
    # three of a few spikes in all are enough
    assert np.concatenate(repeated([np.ones(1), np.ones(1), np.ones(1), np.zeros(1)], 1e-3)).tolist() == [True] * 3 + [
        False
    ]
    assert repeated([np.zeros(0), np.zeros(0)], 1e-3)[1].shape == (0,) and not repeated([], 1e-3)


def test_many_samples_in_a_row_at_one_place_of_many_curves_take_no_time():
    """Of 500 curves it was 2.6 s, of 2000 a minute."""
    random = np.random.default_rng(0)
    rows = [1.0 + np.arange(40) * 1e-3 + 1e-5 * random.standard_normal(40) for _ in range(1000)]
    began = time.process_time()
    assert np.concatenate(repeated(rows, 1.5e-3)).all()
    assert time.process_time() - began < 1.0


def campaign(folder, spiky, seed=3, read=lambda curve: curve):
    """Six runs of two directions; spiky: samples and sizes of the number of a curve."""
    random = np.random.default_rng(seed)
    for number in range(6):
        curves = {}
        for backward, direction in enumerate(Direction):
            curve = a_curve(coefficients(), 4000, 1e-5, backward=bool(backward), seed=int(random.integers(1000)))
            curves[direction] = read(with_spikes(curve, *spiky(2 * number + backward, random)))
        conditions = OperatingPoint(100.0 * (number + 1), 100.0, 25.0)
        write_run(Run(conditions, curves), folder / conditions.rig_path())
    return folder


def test_a_campaign_says_what_it_leaves_out_and_reads_the_same_again(tmp_path):
    clean = campaign(tmp_path / "clean", lambda *_: ([], 0.0))
    made = campaign(tmp_path / "made", lambda n, random: ([97 * n + 5, 1800 + 31 * n], 0.2) if n < 5 else ([], 0.0))
    cache = tmp_path / "kept.parquet"
    first, again = (read_campaign(made, jobs=1, cache=cache) for _ in range(2))
    assert first.spikes == again.spikes
    assert first.spikes.startswith("10 single samples of 5 curves, at most 2 of one, up to 0.21 deg off those")
    assert "100.0rpm/" in first.spikes or "100.0rpm100.0Nm25.0deg.csv" in first.spikes
    assert first.samples == 6 * 2 * 4000 and not read_campaign(clean, jobs=1).spikes
    tables = [one.table(one.fits(ORDERS)).coefficients for one in (first, again, read_campaign(clean, jobs=1))]
    assert (tables[0] == tables[1]).all()
    # two samples less of 4000, of 1e-5 each
    assert np.abs(tables[0] - tables[2]).max() < 6 * 2 * 1e-5 / 4000 * 2
    assert any("single samples" in text for text in measured_table(made, ORDERS, 9).left_out)


def test_of_samples_in_a_row_is_said_how_many(tmp_path):
    """One curve of twelve made the noise of all, and its order 1 was constant."""
    made = campaign(tmp_path / "made", lambda n, _: ([*range(700, 740)], 0.2) if n == 4 else ([], 0.0))
    found = read_campaign(made, jobs=1)
    assert found.spikes.startswith("40 samples of 1 curve, at most 40 of one, up to 40 in a row, up to 0.21 deg off")


def test_samples_in_a_row_are_counted_by_their_numbers(tmp_path):
    """Ten samples have the angle of one whole degree."""

    def spiky(n, _):
        return ([*range(700, 740)], 0.2) if n == 4 else ([], 0.0)

    def whole_degrees(curve):
        return replace(curve, angle_deg=np.floor(curve.angle_deg))

    found = read_campaign(campaign(tmp_path / "made", spiky, read=whole_degrees), jobs=1)
    assert found.spikes.startswith("40 samples of 1 curve, at most 40 of one, up to 40 in a row")


def test_a_curve_that_has_a_gap_without_samples_in_a_row_is_a_bad_file(tmp_path):
    """Of 4000 samples 111 are 10 deg: with more lost ones a file is refused. All orders of it could not be fitted."""

    def made(name, many, curves):
        def spiky(n, _):
            row = range(4000 - 700 - many, 4000 - 700) if n % 2 else range(700, 700 + many)
            return [*row] if n in curves else [], 0.2

        return campaign(tmp_path / name, spiky)

    assert read_campaign(made("few", 109, [4]), jobs=1).spikes.startswith("109 samples of 1 curve")
    many = made("many", 150, [4])
    with pytest.raises(InputError, match=r"300\.0rpm.*: forward: 150 samples in a row .* 13\.6 deg of the revolution"):
        read_campaign(many, jobs=1)
    left = read_campaign(many, jobs=1, skip_bad=True)
    assert len(left.curves) == 10 and not left.spikes
    # what several curves have is the turn's, and in them
    assert len(read_campaign(made("repeated", 150, range(12)), jobs=1).curves) == 12
    # and where so few have it that it could be chance, but all
    alone = made("alone", 150, range(12))
    for path in sorted(alone.rglob("*.csv"))[1:]:
        path.unlink()
    assert len(read_campaign(alone, jobs=1).curves) == 2


def test_samples_in_a_row_are_no_gap_where_another_turn_has_some():
    angle = np.arange(3000) * 0.36
    te = 1e-2 * np.cos(np.deg2rad(angle)) + 1e-4 * np.random.default_rng(0).standard_normal(3000)
    te[1400:1440] += 0.2
    for first, last, row in ((0, 3000, 0), (600, 2500, 0), (600, 2300, 40), (1000, 2000, 40)):
        sums = curve_sums(Curve(angle[first:last], te[first:last]))
        assert (sums.spikes.shape[1], sums.row_left_out) == (40, row)


def test_samples_in_a_row_at_one_place_of_the_turn_stay_in_the_curves(tmp_path):
    made = campaign(tmp_path / "made", lambda n, _: ([*range(700, 730)] if n % 2 == 0 else [], 0.2))
    found = read_campaign(made, jobs=1)
    assert not any(curve.sums.spikes.size for curve in found.curves)


def test_a_place_of_the_turn_stays_in_the_curves(tmp_path):
    """Sample 500 of every forward curve: a scratch on a disc, or a tooth, whatever it is."""
    made = campaign(tmp_path / "made", lambda n, _: ([500] if n % 2 == 0 else [123 * n], 0.2))
    found = read_campaign(made, jobs=1)
    left = {(curve.conditions.speed_rpm, curve.direction): curve.sums.spikes.shape[1] for curve in found.curves}
    assert {count for (_, direction), count in left.items() if direction is Direction.FORWARD} == {0}
    assert {count for (_, direction), count in left.items() if direction is Direction.BACKWARD} == {1}


def test_orders_that_a_row_hides_are_refused_for_that_reason():
    """The steps of these angles were said to be coarse."""
    angle = np.arange(1000) * 0.36
    te = 1e-2 * np.cos(np.deg2rad(angle)) + 1e-4 * np.random.default_rng(0).standard_normal(1000)
    te[400:427] += 0.2
    with pytest.raises(InputError, match="apart: 27 samples in a row are left out, which lie far"):
        fit_orders(curve_sums(Curve(angle, te)), range(201))
