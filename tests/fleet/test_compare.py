"""Who stands out, who has what few have, what has grown; and how often that is said where there is nothing."""

from pathlib import Path

import numpy as np
import pytest

from st_codegen.fleet.compare import FALSE_ALARM, LEAST_AXES, Campaigns, compare, limit_of
from st_codegen.fleet.estimates import Estimate


def estimate(value, effect="backlash", key="gap_arcmin", stderr=0.01, grows=1, is_phase=False):
    return Estimate(effect, key, value, stderr, "arcmin", grows, is_phase, False)


def fleet(values, **more):
    return [Campaigns(f"r{i}", "t", ((estimate(value, **more),),)) for i, value in enumerate(values)]


def normal(count, seed=0):
    return np.random.default_rng(seed).normal(1.0, 0.05, count)


@pytest.mark.parametrize("axes", [8, 9, 12, 20])
def test_the_rate_of_false_alarms(axes):
    """In other random numbers than those of the limit."""
    values = np.random.default_rng(99).standard_normal((40_000, axes))
    middle = np.median(values, axis=1, keepdims=True)
    deviation = 1.4826 * np.median(np.abs(values - middle), axis=1)
    farthest = np.abs(values - middle).max(axis=1) / deviation
    for level in (0.05, 0.01):
        assert (farthest > limit_of(axes, level)).mean() == pytest.approx(level, rel=0.2)


def test_the_documentation_has_the_limits_that_are_used():
    page = (Path(__file__).parents[2] / "docs" / "fleet.md").read_text(encoding="utf-8")
    nine, twenty = (limit_of(axes, FALSE_ALARM / 8) for axes in (9, 20))
    assert f"(8 parameters: {nine:.1f} for 9 axes, {twenty:.1f} for 20)" in page


def test_the_limit_is_shared_by_all_parameters():
    both = [
        Campaigns(f"r{i}", "t", ((estimate(a), estimate(b, key="seating_torque_Nm")),))
        for i, (a, b) in enumerate(zip(normal(20), normal(20, 1), strict=True))
    ]
    assert {spread.limit for spread in compare(both).spreads} == {limit_of(20, FALSE_ALARM / 2)}


def test_one_axis_stands_out():
    values = normal(20)
    values[7] = 2.5
    (spread,) = compare(fleet(values)).spreads
    assert spread.outliers == ("r7",)
    assert spread.median == pytest.approx(1.0, abs=0.05)
    assert 0.02 < spread.deviation < 0.09
    assert spread.distances["r7"] == pytest.approx((2.5 - spread.median) / np.hypot(spread.deviation, 0.01))


def test_who_is_measured_badly_does_not_stand_out():
    values = normal(20)
    values[7] = 2.5
    axes = fleet(values)
    axes[7] = Campaigns("r7", "t", ((estimate(2.5, stderr=2.0),),))
    assert compare(axes).spreads[0].outliers == ()


def test_equal_values_are_no_deviation_of_zero():
    values = [1.0] * 19 + [1.05]
    assert compare(fleet(values, stderr=0.04)).spreads[0].outliers == ()
    assert compare(fleet(values, stderr=0.001)).spreads[0].outliers == ("r19",)


def test_of_few_axes_nothing_is_said():
    found = compare(fleet([*normal(LEAST_AXES - 2), 50.0]))
    assert [(spread.limit, spread.deviation, spread.distances) for spread in found.spreads] == [(None, None, {})]
    assert found.spreads[0].outliers == ()
    assert "7 axes whose newest campaign was reconciled, fewer than 8: nothing can be said" in found.not_looked_at[0]
    assert compare([]).spreads == ()


def test_phases_are_not_compared():
    assert compare(fleet(normal(20), is_phase=True)).spreads == ()


def test_what_is_not_measured_is_said():
    found = compare(fleet(normal(20), stderr=2.0))
    assert "(standard error above the value): backlash gap_arcmin" in found.not_looked_at[0]


def test_types_are_compared_by_themselves():
    values = np.linspace(0.9, 1.1, 10)
    small = fleet(values)
    large = [Campaigns(f"l{i}", "large", ((estimate(50 * value),),)) for i, value in enumerate(values)]
    found = compare([*small, *large])
    assert [(spread.type, spread.outliers) for spread in found.spreads] == [("t", ()), ("large", ())]


def test_an_effect_that_few_have():
    axes = fleet(normal(10))
    tooth = estimate(0.001, effect="cycloid_tooth_error of order 39", key="amplitude_deg")
    for number in (2, 5):
        axes[number] = Campaigns(f"r{number}", "t", ((*axes[number].estimates[0], tooth),))
    (rare,) = compare(axes).rare
    assert (rare.effect, rare.axes, rare.of) == ("cycloid_tooth_error of order 39", ("r2", "r5"), 10)
    half = [Campaigns(a.axis, "t", ((*a.estimates[0], tooth),)) if i < 5 else a for i, a in enumerate(axes)]
    assert compare(half).rare == ()
    assert compare(axes[:7]).rare == ()  # too few to say so


def grown(*values, **more):
    return compare([Campaigns("r", "t", tuple((estimate(value, **more),) for value in values))]).growth


def test_growth_since_the_last_campaign():
    (one,) = grown(0.5, 1.0, 1.1)
    assert (one.axis, one.before, one.now, one.history) == ("r", 1.0, 1.1, (0.5, 1.0, 1.1))
    assert one.times == pytest.approx(0.1 / np.hypot(0.01, 0.01))
    assert grown(1.0, 1.01) == ()
    assert grown(1.1, 1.0) == ()
    assert grown(0.5, 1.0, 1.0) == ()  # since the last one, not since the first
    assert grown(1.0) == ()
    assert len(grown(-1.0, -1.1)) == 1  # its size


def test_a_stiffness_that_falls_and_what_has_no_size():
    assert len(grown(450.0, 400.0, grows=-1, stderr=2.0)) == 1
    assert grown(400.0, 450.0, grows=-1, stderr=2.0) == ()
    assert grown(50.0, 60.0, grows=0) == ()


def test_an_effect_that_was_not_there():
    tooth = estimate(0.001, effect="cycloid_tooth_error", key="amplitude_deg")
    found = compare([Campaigns("r", "t", ((estimate(1.0),), (estimate(1.0), tooth)))]).growth
    assert [(one.effect, one.before, one.times, one.history) for one in found] == [
        ("cycloid_tooth_error", None, None, (None, 0.001))
    ]


def test_the_limit_of_growth_holds_for_all_axes_together():
    random = np.random.default_rng(3)
    alarms = [
        bool(
            compare(
                [Campaigns(f"r{i}", "t", tuple((estimate(v),) for v in random.normal(1.0, 0.01, 2))) for i in range(7)]
            ).growth
        )
        for _ in range(600)
    ]
    assert 0.02 < np.mean(alarms) < 0.09


def test_axes_without_an_earlier_campaign_are_named():
    found = compare([*fleet([1.0, 1.0]), Campaigns("r9", "t", ((estimate(1.0),), (estimate(1.0),)))])
    assert "growth, for want of an earlier campaign that was reconciled: r0, r1" in found.not_looked_at
    assert found.growth_limit == pytest.approx(1.645, abs=1e-3)


def test_a_campaign_that_is_there_twice_is_told():
    """By what was measured: a stiffness that no load shows is the rig's in all campaigns."""
    own = ((estimate(1.0),),)
    axes = [Campaigns(f"r{number}", "t", own, (str(number),)) for number in range(9)]
    assert compare(axes).copies == ()
    assert compare([*axes, Campaigns("copy", "t", own, ("3",))]).copies == ("r3", "copy")
    assert compare([Campaigns("r", "t", own * 2, ("1", "1"))]).copies == ("r",)


def test_parameters_without_a_standard_error_are_not_compared_and_named():
    found = compare(fleet(normal(20), stderr=None))
    assert found.spreads == ()
    assert "in axes where it is so: backlash gap_arcmin" in found.not_looked_at[0]
