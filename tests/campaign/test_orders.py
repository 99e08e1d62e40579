"""Order analysis against curves of known coefficients."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples

pytest.importorskip("polars")

from st_codegen.campaign.choice import choose_orders
from st_codegen.campaign.curves import Curve
from st_codegen.campaign.moments import moments
from st_codegen.campaign.orders import SIGNIFICANT, curve_sums, fit_orders, square_error
from st_codegen.errors import InputError

ORDERS = (0, 1, 3, 39, 40, 78, 81, 156, 162, 240)
SIZES = (-0.03, 1.7e-2, 8e-4, 1e-3, 8e-4, 9e-4, 3e-4, 3e-4, 1e-3, 3e-4)
EPS = np.finfo(float).eps


def coefficients(seed=0):
    random = np.random.default_rng(seed)
    phases = np.concatenate([[0.0], random.uniform(-np.pi, np.pi, len(ORDERS) - 1)])
    return np.array(SIZES) * np.exp(1j * phases)


def angles(samples, backward=False):
    """A revolution with a speed that fluctuates by 2 %: samples are not equidistant in angle."""
    t = np.linspace(0, 2 * np.pi, samples, endpoint=False)
    theta = t + 0.004 * (np.sin(3 * t) - 0) + 0.002 * (np.sin(7 * t + 1) - np.sin(1))
    return 2 * np.pi - theta if backward else theta


def a_curve(values, samples=10_800, noise=0.0, backward=False, seed=1, extra=()):
    theta = angles(samples, backward)
    te = (np.exp(1j * np.outer(theta, ORDERS)) @ values).real
    for order, value in extra:
        te += (value * np.exp(1j * order * theta)).real
    return Curve(np.rad2deg(theta), te + noise * np.random.default_rng(seed).normal(size=samples))


@examples(25)
@given(st.integers(1, 4000), st.integers(1, 600), st.integers(0, 10**6))
def test_moments_are_the_direct_sums(samples, highest, seed):
    random = np.random.default_rng(seed)
    theta = random.uniform(-10, 10, samples)
    weights = random.normal(size=(2, samples))
    direct = (np.exp(-1j * np.outer(np.arange(highest + 1), theta)) @ weights.T).T
    # both ways round m*theta, up to 6000: an error of 6000*eps/2 a term at most
    bound = 10 * highest * EPS * np.abs(weights).sum()
    assert np.abs(moments(theta, weights, highest) - direct).max() <= bound


@pytest.mark.parametrize("backward", [False, True])
def test_without_noise_the_coefficients_are_exact(backward):
    values = coefficients()
    fit = fit_orders(a_curve(values, backward=backward), ORDERS)
    # order 240 at 2 pi: the angle itself, stored in deg, is rounded to 240 * 2 pi * eps
    assert np.abs(fit.coefficients - values).max() < 240 * 2 * np.pi * EPS * np.abs(values).max()
    assert fit.residual_rms_deg < 1e-8  # the root of a difference of squares: sqrt(eps) * 0.03


@pytest.mark.parametrize("backward", [False, True])
def test_with_noise_the_error_is_at_the_least_squares_bound(backward):
    values, noise, samples = coefficients(), 2e-4, 4_000
    errors = np.array(
        [
            fit_orders(a_curve(values, samples, noise, backward, seed), ORDERS).coefficients - values
            for seed in range(40)
        ]
    )
    # Cramer-Rao for even angles: 2 * sigma^2 / N for the real and for the imaginary part, sigma^2 / N for the mean
    bound = noise**2 / samples * np.array([1.0] + [4.0] * (len(ORDERS) - 1))
    ratio = (np.abs(errors) ** 2).mean(axis=0) / bound
    # 9 orders * 2 parts * 40 curves are 720 squares of normal numbers: a standard deviation of sqrt(2/720) = 5.3 %,
    # and 2 % for what uneven angles and the orders fitted beside cost
    assert abs(ratio[1:].mean() - 1.0) < 4 * 0.053 + 0.02
    # 40 squares of one part (mean), 80 of two: five standard deviations
    assert (ratio < 1.0 + 5 * np.sqrt(2 / 40)).all()


def test_the_plain_fft_is_biased_where_the_speed_fluctuates():
    values = coefficients()
    curve = a_curve(values)
    fft = curve_sums(curve).plain_fft[list(ORDERS)]
    exact = fit_orders(curve, ORDERS).coefficients
    assert np.abs(fft - values)[7:].max() > 0.1 * np.abs(values)[7:].max()
    assert np.abs(fft - values)[7:].max() > 1e6 * np.abs(exact - values)[7:].max()


@pytest.mark.parametrize("backward", [False, True])
def test_with_even_angles_both_ways_agree(backward):
    values = coefficients()
    theta = np.linspace(0, 2 * np.pi, 10_800, endpoint=False)
    # the n-th of the reversed samples stands at -n*step: the FFT over the number of the sample starts at 0
    theta = np.concatenate([theta[1:][::-1], [0.0]]) if backward else theta
    te = (np.exp(1j * np.outer(theta, ORDERS)) @ values).real
    curve = Curve(np.rad2deg(theta), te)
    fft = curve_sums(curve).plain_fft[list(ORDERS)]
    assert np.abs(fft - values).max() < 1e-12
    assert np.abs(fft - fit_orders(curve, ORDERS).coefficients).max() < 1e-12


def test_other_orders_do_not_leak_and_are_reported():
    values = coefficients()
    extra = ((159, 5e-4), (237, 4e-4j), (2, 3e-4))
    fit = fit_orders(a_curve(values, noise=1e-5, extra=extra), ORDERS)
    assert np.abs(fit.coefficients - values).max() < 5 * 2e-5 / np.sqrt(10_800)
    for order, value in extra:
        assert abs(fit.spectrum[order] - abs(value)) < 5 * 2e-5 / np.sqrt(10_800)
    expected = np.sqrt(sum(abs(value) ** 2 for _, value in extra) / 2)
    assert abs(fit.residual_rms_deg - expected) < 0.02 * expected


def test_noise_floor_is_that_of_the_noise():
    fits = [fit_orders(a_curve(coefficients(), noise=2e-4, seed=seed), ORDERS) for seed in range(10)]
    floor = np.median([fit.noise_floor for fit in fits], axis=0)
    # the median of 24 Rayleigh numbers scatters by some 15 %, that of ten such medians by some 6 %
    assert np.allclose(floor[1:], 2 * 2e-4 / np.sqrt(10_800), rtol=0.3)
    assert np.isclose(floor[0], 2e-4 / np.sqrt(10_800), rtol=0.3)
    assert all((np.abs(fit.coefficients) > SIGNIFICANT * fit.noise_floor).all() for fit in fits)


def test_noise_floor_is_that_of_the_noise_where_every_order_of_the_band_is_fitted():
    """What happens at one angle stands in all orders; the floor of such curves was zero."""
    random = np.random.default_rng(0)
    curves = [Curve(np.arange(400) * 0.9, 1e-3 * random.standard_normal(400)) for _ in range(10)]
    floor = np.mean([fit_orders(curve, range(101)).noise_floor for curve in curves], axis=0)
    # ten times 199 degrees of freedom: 1.6 %
    assert np.allclose(floor[1:], 2e-3 / np.sqrt(400), rtol=0.05) and np.isclose(floor[0], 1e-3 / 20, rtol=0.05)


def test_square_error_is_that_of_the_samples():
    values = coefficients()
    curve = a_curve(values, noise=1e-4)
    theta = np.deg2rad(curve.angle_deg)
    guess = values * 1.1
    direct = np.mean((curve.te_deg - (np.exp(1j * np.outer(theta, ORDERS)) @ guess).real) ** 2)
    assert np.isclose(square_error(curve_sums(curve), ORDERS, guess), direct, rtol=1e-11)


def test_too_few_samples():
    with pytest.raises(InputError, match="samples tell 0 to 50"):
        fit_orders(a_curve(coefficients(), samples=200), [0, 60])


def test_orders_are_chosen_with_reasons():
    extra = ((159, 5e-4), (17, 3e-5))
    fits = [fit_orders(a_curve(coefficients(), noise=1e-5, seed=seed, extra=extra), ()) for seed in range(4)]
    fits += [fit_orders(a_curve(coefficients(), noise=1e-5, extra=((300, 2e-2),)), ())]
    reasons = choose_orders(fits)
    chosen = sorted(reason.order for reason in reasons if reason.chosen)
    assert chosen == sorted([*ORDERS, 159])
    words = {reason.order: reason.reason for reason in reasons}
    assert "4 of 5 curves" in words[159]
    # of a share of 0.97% it said "1.0% of the strongest (below 1%)"
    assert words[17].endswith("deg is below 1% of the strongest")
    assert words[300].startswith("only above the noise in 1 of 5 curves")
    assert sum(reason.share for reason in reasons) == pytest.approx(1.0, abs=1e-3)
    few = choose_orders(fits, most=2)
    assert [reason.order for reason in few if reason.chosen] == [0, 1]
    # the mean is chosen whatever its size: it is none of the stronger ones
    assert any(reason.reason.endswith("; 1 stronger one and the mean are chosen already") for reason in few)
    with pytest.raises(InputError, match="no curves"):
        choose_orders([])


def test_angles_that_do_not_tell_orders_apart():
    """An encoder of 40 steps a turn: orders 1 and 39 are the same wave at its angles."""
    angle = np.repeat(np.arange(40) * 9.0, 10)
    with pytest.raises(InputError, match="do not tell the orders 39, 41 from others"):
        fit_orders(Curve(angle, np.cos(np.deg2rad(angle))), (1, 39, 41))
    # of order 20 there is a cosine alone
    with pytest.raises(InputError, match="do not tell the orders 20 from others"):
        fit_orders(Curve(angle, np.cos(np.deg2rad(angle))), (1, 20))


@pytest.mark.parametrize("steps", [4, 40, 72, 360])
def test_images_of_an_order_at_coarse_angles_take_nothing_from_it(steps):
    """Of angles in whole degrees orders 1 and 359 were fitted together, and 0.37 deg was left of 1 deg."""
    angle = np.arange(4000) * 0.09
    te = np.cos(np.deg2rad(angle)) + 0.1 * np.cos(np.deg2rad(39 * angle) + 0.4)
    read = np.round(angle * steps / 360.0) * 360.0 / steps
    (size,) = np.abs(fit_orders(Curve(read, te), (1,)).coefficients)
    # the mean over a step of the angle
    assert size == pytest.approx(np.sinc(1 / steps), abs=0.01)


def test_of_a_te_that_does_not_change_no_order_is_taken():
    """What rounding leaves of a constant stood above a noise of nothing."""
    angle = np.linspace(0.0, 360.0, 400, endpoint=False)
    fits = [fit_orders(curve_sums(Curve(angle + shift, np.full(400, 0.01))), ()) for shift in (0.0, 0.01, 0.02, 0.03)]
    assert [reason.order for reason in choose_orders(fits) if reason.chosen] == [0]


@pytest.mark.parametrize(("samples", "in_turn", "several"), [(400, 400, False), (404, 400, False), (800, 400, True)])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_curve_that_ends_behind_where_it_began_has_the_samples_of_a_turn(samples, in_turn, several, direction):
    """An encoder's lines, a hum's frequency and aliases were told by 404 samples a turn."""
    angle = 0.9 * np.arange(samples)
    angle = angle if direction > 0 else angle[::-1]
    te = 0.02 + 1e-3 * np.cos(np.radians(29 * angle))
    sums = curve_sums(Curve(angle, te), 60)
    assert (sums.in_turn, sums.holds_several) == (in_turn, several)
    if direction > 0:
        again = curve_sums(Curve(np.mod(angle, 360.0), te), 60)
        assert (again.in_turn, again.holds_several) == (in_turn, several)
    if not several:
        lines = np.abs(sums.plain_fft)
        assert lines[29] == pytest.approx(1e-3, rel=1e-6) and np.delete(lines, [0, 29]).max() < 1e-9


@pytest.mark.parametrize(
    ("angle", "in_turn"),
    [(np.append(0.9 * np.arange(400), 0.0), 400), (np.append(np.arange(361.0), np.arange(361.0)[::-1]), 722)],
)
def test_a_curve_that_ends_at_the_angle_where_it_began_is_read(angle, in_turn):
    """One whose last angle is 0 for 360 deg, or that comes back, stopped the reading of a campaign."""
    sums = curve_sums(Curve(angle, 0.02 + 1e-3 * np.cos(np.radians(2 * angle))), 60)
    assert (sums.in_turn, sums.holds_several) == (in_turn, False)
