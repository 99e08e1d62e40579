"""What happens at one angle of every turn stands in all orders alike: it is named, and bends nothing else."""

from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.reconcile.data.reading import _alone, _of_a_place
from st_codegen.reconcile.report.sentences import beside_text
from st_codegen.reconcile.report.summary import summary
from st_codegen.reconcile.run import reconcile_files
from st_codegen.reconcile.search.surroundings import _is_no_peak_of_many, _is_told_by_others, angle_of_rest
from st_codegen.rig.effects import Conditions, Constants, catalogue
from st_codegen.rig.model import read_rig

from .blind_form.files import write_curves
from .blind_form.measuring import plainly
from .blind_form.points import Points

pytestmark = pytest.mark.thorough

KNOWN = catalogue()
#: of a turn, of which curves hold every third
SAMPLES = 720
THETA = np.arange(SAMPLES) * 2 * np.pi / SAMPLES
RIG = """[rig]
name = "places"
reduction_ratio = 81.0
cycloid_teeth = 39
pins = 40
cranks = 3
[[effect]]
name = "torsional_compliance"
stiffness_Nm_per_arcmin = 450.0
[[effect]]
name = "output_shaft_eccentricity"
amplitude_deg = 0.015
[[effect]]
name = "cycloid_tooth_error"
order = 39
amplitude_deg = 0.0007
phase_rad = 1.0
[[effect]]
name = "pin_error"
order = 40
amplitude_deg = 0.0009
"""


def at(degrees):
    return np.degrees(np.angle(np.exp(1j * (THETA - np.radians(degrees)))))


def bell(centre, width):
    return np.exp(-0.5 * (at(centre) / width) ** 2)


def texture():
    random = np.random.default_rng(0)
    return sum(3e-5 * np.cos(order * THETA + random.uniform(0, 2 * np.pi)) for order in range(1, 60))


#: deg forward and backward, without load and per 1000 N m
HIDDEN = {
    "nothing": (0, 0, 0, 0),
    "bump": (3e-3 * bell(74.5, 3), 3e-3 * bell(74.5, 3), 0, 0),
    "two": (1e-3 * bell(100, 2) - 1.5e-3 * bell(250, 3), 1e-3 * bell(100, 2) - 1.5e-3 * bell(250, 3), 0, 0),
    "forward, at zero": (2e-3 * bell(359.8, 3), 0, 0, 0),
    "both, at zero": (*[2e-3 * bell(359.8, 3)] * 2, 0, 0),
    "under load": (0, 0, 2e-3 * bell(200, 3), -1e-3 * bell(200, 3)),
    "trapezoid": (*[1.5e-3 * np.clip(4 - np.abs(at(120)), 0, 1)] * 2, 0, 0),
    # rolled into slowly and left fast
    "dent": (
        *[-3.5e-3 * (0.5 + 0.5 * np.cos(np.pi * np.clip(at(240) / np.where(at(240) < 0, 7.6, 3.2), -1, 1)))] * 2,
        0,
        0,
    ),
    # a tooth that gives way the more, the larger the load is, over as wide a place as it meets
    "crack": (
        0,
        0,
        *[2e-3 * np.where(np.abs(at(150)) < 20, 0.5 + 0.5 * np.cos(np.radians(at(150)) * 9), 0) * np.cos(39 * THETA)]
        * 2,
    ),
    "burst": (1.5e-3 * bell(150, 5) * np.cos(39 * THETA), 1e-3 * bell(150, 5) * np.sin(39 * THETA), 0, 0),
    "texture": (texture(), texture(), 0, 0),
    # in no order above the noise of a curve
    "faint bump": (*[1.5e-4 * bell(74.5, 1.5)] * 2, 0, 0),
    "faint burst": (*[2e-4 * bell(150, 3) * np.cos(39 * THETA)] * 2, 0, 0),
    "of no form": (
        *[1e-3 * np.where(np.abs(at(200)) < 10, np.random.default_rng(0).standard_normal(SAMPLES // 3).repeat(3), 0)]
        * 2,
        0,
        0,
    ),
}


def reconciled(folder, name, walk_deg=0.0, seed=2, noise_deg=1e-4, every=3):
    """The result on a campaign of 24 runs with white noise in each sample, and steps of a walk."""
    (folder / "rig.toml").write_text(RIG)
    rig = read_rig(folder / "rig.toml", KNOWN)
    axes = np.meshgrid([300.0, 700, 1100, 1500], [0.0, 700, 1400], [25.0, 35.0], indexing="ij")
    speed, torque, temperature = np.random.default_rng(1).permutation(np.stack([a.ravel() for a in axes], axis=1)).T
    points = Points(speed, torque, temperature, np.linspace(0, 1, len(speed)), np.arange(len(speed)))
    theta = THETA[::every]
    own = 0.015 * np.cos(theta) + 7e-4 * np.cos(39 * theta + 1) + 9e-4 * np.cos(40 * theta)
    sides = np.array([1.0, -1.0])[None, :, None]
    # forward the output stays behind under load, and comes ahead of it backward
    te = own - sides * (torque / 450 / 60)[:, None, None]
    still, loaded = (np.stack([(part + 0 * THETA)[::every] for part in HIDDEN[name][i : i + 2]]) for i in (0, 2))
    te = te + still + loaded * (torque / 1000)[:, None, None]
    random = np.random.default_rng(seed)
    te = te + noise_deg * random.standard_normal(te.shape)
    te = te + walk_deg * np.cumsum(random.standard_normal(te.shape), axis=-1)
    write_curves(plainly(points, te), folder / "measured", named=False)
    return reconcile_files(rig, folder / "measured", KNOWN)


def named(result):
    return [claim.piece.effect for claim in result.conclusions.claims]


@pytest.mark.parametrize(
    ("name", "places"),
    [
        ("bump", [(74.5, 3.0, 3e-3)]),
        pytest.param("two", [(100.0, 2.0, 1e-3), (250.0, 3.0, -1.5e-3)], marks=pytest.mark.slow),
        pytest.param("forward, at zero", [(359.8, 3.0, 2e-3)], marks=pytest.mark.slow),
        pytest.param("under load", [(200.0, 3.0, 0.0)], marks=pytest.mark.slow),
    ],
)
def test_a_bump_is_named_with_its_place_and_size_and_nothing_else(name, places, tmp_path):
    result = reconciled(tmp_path, name)
    found = sorted(named(result), key=lambda effect: effect.scalar("centre_deg") % 360)
    assert [effect.name for effect in found] == ["local_defect"] * len(places)
    assert not result.conclusions.retuned and not result.unexplained and result.verdict == "explained"
    for effect, (centre, width, height) in zip(found, places, strict=True):
        assert effect.scalar("centre_deg") % 360 == pytest.approx(centre, abs=0.1)
        assert effect.scalar("width_deg") == pytest.approx(width, rel=0.05)
        assert effect.scalar("height_deg") + effect.scalar("turning_deg") == pytest.approx(height, abs=1e-4)
    if name == "under load":
        slope, turning = found[0].scalar("slope_deg_per_kNm"), found[0].scalar("turning_slope_deg_per_kNm")
        assert (slope + turning, slope - turning) == (pytest.approx(2e-3, rel=0.05), pytest.approx(-1e-3, rel=0.1))
    assert result.held_out.after < 0.7 * result.held_out.before


def test_a_burst_of_a_mesh_order_is_named(tmp_path):
    result = reconciled(tmp_path, "burst")
    (effect,) = named(result)
    assert (effect.name, effect.orders) == ("local_mesh_defect", (39,))
    assert effect.scalar("centre_deg") == pytest.approx(150, abs=0.3)
    assert abs(effect.complex_value("amplitude_deg")) == pytest.approx(1.5e-3, rel=0.05)
    assert abs(effect.complex_value("amplitude_deg", True)) == pytest.approx(1e-3, rel=0.05)
    assert "by 0.0015 deg forward, 0.001 deg backward, as damaged teeth" in summary(result)
    assert not result.conclusions.retuned


def test_a_burst_that_follows_the_load_is_named_though_its_form_is_another(tmp_path):
    """A bell explains the quiet orders far from its own worse than nothing does: no sign of another cause."""
    result = reconciled(tmp_path, "crack")
    (effect,) = named(result)
    assert (effect.name, effect.orders) == ("local_mesh_defect", (39,))
    assert effect.scalar("centre_deg") == pytest.approx(150, abs=0.3)
    assert abs(effect.complex_value("slope_deg_per_kNm")) == pytest.approx(2e-3, rel=0.1)
    assert not result.conclusions.retuned and result.held_out.after < 0.2 * result.held_out.before
    assert "deg backward, and follows the load, as damaged teeth" in summary(result)


@pytest.mark.slow
def test_a_bump_of_another_form_is_one_bump_with_a_rest(tmp_path):
    result = reconciled(tmp_path, "trapezoid")
    assert [effect.name for effect in named(result)] == ["local_defect"]
    assert not result.conclusions.retuned and result.verdict == "partly_explained"


@pytest.mark.slow
def test_clean_data_do_not_bend_a_bump_of_another_form(tmp_path):
    """Weighed by what each order keeps, the many quiet ones made it half as wide, and refused it."""
    result = reconciled(tmp_path, "dent", noise_deg=2e-5, every=1)
    (effect,) = named(result)
    assert effect.name == "local_defect"
    assert effect.scalar("centre_deg") == pytest.approx(239.9, abs=1.0)
    assert effect.scalar("height_deg") == pytest.approx(-3.5e-3, rel=0.1)
    assert effect.scalar("width_deg") == pytest.approx(2.1, rel=0.1)


@pytest.mark.parametrize("is_there", [True, False])
def test_two_sidebands_are_no_bump_of_their_phases(is_there):
    """Orders 77 and 79 in loud noise were a bump at 347 deg that other orders of the curves do not have."""
    orders, sigma, random = np.array([4, 6, 8, 10, 12, 14, 77, 79, 81]), 4e-4, np.random.default_rng(0)
    at = Conditions.of(np.tile([1.0, -1.0], 45), np.full(90, 500.0), np.full(90, 300.0), np.full(90, 30.0))
    bump = KNOWN["local_defect"]({"height_deg": -0.0125, "centre_deg": 346.8, "width_deg": 0.52}, Constants())
    own = bump.contribution(at, orders)
    noise = sigma / np.sqrt(2) * (random.standard_normal(own.shape) + 1j * random.standard_normal(own.shape))
    there = own if is_there else np.where(np.isin(orders, (77, 79)), own, 0.0)
    fit = SimpleNamespace(
        target=SimpleNamespace(data=SimpleNamespace(orders=orders), weights=lambda _: np.full(own.shape, 2 / sigma**2)),
        residual=there + noise - own,
        explained=lambda _: own,
        state=SimpleNamespace(rig=SimpleNamespace(orders=lambda: (81,))),
    )
    assert _is_told_by_others(fit, SimpleNamespace(effect=bump)) is is_there


def at_its_place(curve, orders, width_deg, noise_deg=2e-5):
    """A fit (n runs of both directions) of the bump of a width that takes most off a curve by its orders (K,)."""
    random, runs = np.random.default_rng(1), Conditions.of(np.tile([1.0, -1.0], 20), *np.full((3, 40), 300.0))

    def bump(centre):
        values = {"height_deg": 1.0, "centre_deg": centre, "width_deg": width_deg}
        form = KNOWN["local_defect"](values, Constants()).contribution(runs, orders)[0]
        size = np.vdot(form, curve).real / np.vdot(form, form).real
        return size**2 * np.vdot(form, form).real, centre, size

    _, centre, size = max(bump(centre) for centre in np.arange(0.0, 360.0, 0.5))
    effect = KNOWN["local_defect"]({"height_deg": size, "centre_deg": centre, "width_deg": width_deg}, Constants())
    own = effect.contribution(runs, orders)
    noise = noise_deg / np.sqrt(2) * (random.standard_normal(own.shape) + 1j * random.standard_normal(own.shape))
    fit = SimpleNamespace(
        target=SimpleNamespace(data=SimpleNamespace(orders=orders), good=np.ones(len(own), bool)),
        residual=curve + noise - own,
        explained=lambda _: own,
        state=SimpleNamespace(rig=SimpleNamespace(orders=lambda: (39, 40))),
    )
    return fit, SimpleNamespace(effect=effect)


@pytest.mark.parametrize("width_deg", [1.0, 2.5, 5.0])
@pytest.mark.parametrize("seed", range(6))
def test_the_highest_peak_of_a_texture_is_no_bump(seed, width_deg):
    """Of one profile in nine the highest peak was named, 0.0026 +- 0.0023 deg high."""
    orders, random = np.arange(4, 251), np.random.default_rng(seed)
    curve = 3e-3 * (random.standard_normal(247) + 1j * random.standard_normal(247)) / orders
    assert not _is_no_peak_of_many(*at_its_place(curve, orders, width_deg))


@pytest.mark.parametrize("places", [(208.0,), (208.0, 30.0), (208.0, 30.0, 111.0)])
def test_bumps_are_no_peaks_of_each_other(places):
    orders = np.arange(4, 251)
    one = Conditions.of(*np.ones((4, 1)))
    values = ({"height_deg": 2e-3, "centre_deg": place, "width_deg": 2.5} for place in places)
    curve = sum(KNOWN["local_defect"](each, Constants()).contribution(one, orders)[0] for each in values)
    assert _is_no_peak_of_many(*at_its_place(curve, orders, 2.5))


@pytest.mark.slow
def test_waves_of_all_orders_alike_have_no_name_and_change_no_effect(tmp_path):
    result = reconciled(tmp_path, "texture")
    assert not named(result) and not result.conclusions.retuned
    assert result.verdict == "unexplained" and len(result.unexplained) > 30


@pytest.mark.parametrize(
    ("name", "effect", "place"),
    [
        ("faint bump", "local_defect", 74.5),
        pytest.param("faint burst", "local_mesh_defect", 150, marks=pytest.mark.slow),
    ],
)
def test_what_no_order_shows_the_mean_of_all_curves_may(name, effect, place, tmp_path):
    result = reconciled(tmp_path, name)
    (found,) = named(result)
    assert (found.name, result.verdict) == (effect, "explained")
    assert found.scalar("centre_deg") == pytest.approx(place, abs=1.0)


def test_where_curves_that_wander_begin_and_end_nothing_is_named(tmp_path):
    """They jump there, and made two defects of one, each with a wrong place."""
    result = reconciled(tmp_path, "both, at zero", walk_deg=2e-4)
    assert not named(result) and result.unexplained


@pytest.mark.slow
def test_where_in_the_turn_unexplained_orders_stand_together_is_said(tmp_path):
    result = reconciled(tmp_path, "of no form")
    assert not named(result) and len(result.unexplained) > 30
    assert "at one angle of the output: 20" in summary(result).replace("\n", " ")


@pytest.mark.parametrize(("half", "reach"), [(2.0, 2.0), (3.0, 4.0), (6.0, 8.0), (12.0, 16.0), (24.0, None)])
def test_where_orders_stand_together_reaches_no_farther_than_it_has_to(half, reach):
    """Of a step up and down again, so many deg before and behind 20 deg, three quarters of the power lie within."""
    orders = np.arange(1, 400)
    wave = np.sin(orders * np.radians(half)) / orders * np.exp(-1j * orders * np.radians(20.0))
    data = SimpleNamespace(orders=orders, angle_rad=None, at=Conditions.of(np.ones(3), 900.0, 400.0, 30.0))
    found = angle_of_rest(SimpleNamespace(data=data, good=np.ones(3, bool)), np.tile(wave, (3, 1)), orders.tolist())
    assert (found and found[1]) == reach
    assert found is None or abs(found[0] - 20.0) <= reach


def test_noise_alone_has_no_shared_orders(tmp_path):
    result = reconciled(tmp_path, "nothing")
    assert result.verdict == "nothing_missing"
    assert set(result.data.orders.tolist()) == set(result.rig.orders())


@pytest.mark.parametrize(
    ("orders", "said"),
    [
        ([77, 79, 239, 241], "77, 79, 239, 241"),
        ([77, 79, 241, 5, 6, 7, 8], ""),
        ([77, 79], ""),
        ([1, 77, 79, 240], ""),
    ],
)
def test_unexplained_orders_beside_those_of_the_rig_are_said_to_lie_so(orders, said):
    """Order 1 is beside the mean only, and 240 is the rig's own."""
    text = beside_text(orders, [0, 78, 240])
    assert text.startswith(f"Unexplained orders {said} lie one beside") if said else text == ""


def test_a_row_of_orders_may_be_one_wave_between_them():
    """The wave of a slipping motor, 158 to 160 periods a turn, was said to be the rig's orders that change."""
    its = [156, 159, 162]
    assert "lie in one row" in beside_text([157, 158, 160, 161, 163], its)
    assert "lie one beside" in beside_text([155, 157, 161, 163], its)


def test_a_line_that_only_a_curve_with_few_samples_shows_may_be_a_higher_order():
    power = np.ones((10, 60))
    power[0, [20, 30, 40]] = 100.0
    power[1:, 30] = 100.0  # others show it as well
    samples = np.array([150] + [4000] * 9)
    assert np.argwhere(_alone(power, samples, [40])).tolist() == [[0, 20]]
    assert not _alone(power, np.full(10, 150), [40]).any()


def test_a_line_of_curves_sampled_in_time_is_no_higher_order():
    """A resonance that the slowest run does not lift was left out of all the faster ones, which have fewer samples."""
    power = np.ones((4, 60))
    power[:3, 20] = 100.0
    assert not _alone(power, np.array([1030, 1540, 2350, 4000]), []).any()
    # of half and a quarter as many samples one order above shows at one place
    assert np.argwhere(_alone(power, np.array([512, 1024, 2048, 4000]), [])).tolist() == [[0, 20], [1, 20], [2, 20]]


@pytest.mark.parametrize("directions", [(1.0, -1.0), (1.0,)])
def test_a_bump_of_the_mean_curves_gives_orders_and_noise_none(directions):
    """Twenty curves of a direction, of which none shows any order of a bump above its noise."""
    random, sign = np.random.default_rng(0), np.repeat(directions, 20)
    noise = random.standard_normal((2, len(sign), 101))
    waves = (noise[0] + 1j * noise[1]) / np.sqrt(2.0)
    floor, orders = np.ones(waves.shape), np.arange(101)
    assert _of_a_place(waves, floor, sign, {10}, [39]) == []
    for order, phase in ((0, 1.0), (39, 1j)):
        shape = 0.6 * phase * np.exp(-0.5 * ((orders - order) * np.radians(3.0)) ** 2 - 1j * (orders - order) * 2.0)
        found = _of_a_place(waves + shape, floor, sign, {10}, [39])
        assert found == [k for k in range(6, 101) if abs(k - order) <= 57 and k != 10], order
