"""The truth of a case holds what it says: sizes, orders, conditions; and the same seed makes the same files."""

import re
from dataclasses import replace

import numpy as np
import pytest

from . import cases, files, kinds, machine, make, measuring, mesh, resonance, slow
from .kinds import KINDS, Draw
from .oscillator import Oscillator, Stribeck
from .points import Points, curves, rms_by_order, spectrum


def points_of(speed=1000.0, torque=500.0, oil=30.0, when=0.0, count=1):
    """Runs with equal or given conditions."""
    columns = [np.broadcast_to(np.asarray(values, dtype=float), (count,)) for values in (speed, torque, oil, when)]
    return Points(*columns, np.arange(count))


def drawn(kind, seed=3, layout="grid"):
    """Machine, parts and runs of a kind, without simulating what is known."""
    random = np.random.default_rng(seed)
    whole = machine.draw_machine(random, small=False)
    points = measuring.plan(random, layout, False, (25.0, 35.0))
    known, parts = KINDS[kind](Draw(random, whole, points))
    return whole, known, parts, points


def by_order(part, points, samples=1000):
    return rms_by_order(spectrum(curves(part.waves(points), samples)))


def test_spectrum_gives_back_waves_and_mean():
    te = curves({0.0: np.full((1, 2), 0.5 + 0j), 7.0: np.array([[2j, 1.0]])}, 100)
    found = spectrum(te)
    np.testing.assert_allclose(found[0, :, 0], 0.5, atol=1e-14)
    np.testing.assert_allclose(found[0, :, 7], [2j, 1.0], atol=1e-14)
    assert rms_by_order(found)[7] == pytest.approx(np.sqrt((4 + 1) / 2 / 2))


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"two_mass", "nothing", "one_temperature", "mains"}))
def test_waves_are_on_the_orders_that_the_truth_names(kind):
    _, _, parts, points = drawn(kind)
    for part in parts:
        found = by_order(part, points) ** 2
        on = [order for order in part.orders if order < len(found)]
        assert found[on].sum() > 0.99 * found.sum() > 0, part.title


@pytest.mark.parametrize(
    ("kind", "share"), [("mesh_square", 0.25), ("mesh_two_thirds", 0.5 ** (2 / 3)), ("foreign_square", 0.25)]
)
def test_laws_over_torque(kind, share):
    _, _, (part,), _ = drawn(kind)
    order = float(part.orders[0])
    half, full = (np.abs(part.waves(points_of(torque=torque))[order][0, 0]) for torque in (800.0, 1600.0))
    assert half / full == pytest.approx(share)


def test_what_repeats_each_turn_is_where_its_title_says():
    _, _, (dent,), points = drawn("spall")
    te = curves(dent.waves(points), 720)[0, 0]
    at, width = (float(number) for number in re.findall(r"(\d[\d.]*) deg", dent.title))
    off = np.abs(np.mod(np.arange(720) / 2 - at + 180, 360) - 180)
    assert off[np.argmin(te)] < 1.0 and np.abs(te[off > 2 * width]).max() < 0.02 * np.abs(te).max()
    _, _, (crack,), _ = drawn("crack")
    te = curves(crack.waves(points_of(torque=1600.0)), 720)[0, 0]
    width, at = (float(number) for number in re.findall(r"(\d[\d.]*) deg", crack.title))
    off = np.abs(np.mod(np.arange(720) / 2 - at + 180, 360) - 180)
    assert np.abs(te[off > width + 1]).max() < 0.05 * np.abs(te).max()
    _, _, (texture,), points = drawn("texture")
    power = by_order(texture, points) ** 2
    assert power[8:16].sum() / power[64:128].sum() == pytest.approx(8.0, rel=0.9)


@pytest.mark.parametrize("mistake", measuring.LATER)
def test_later_mistakes_change_the_angle_or_add_a_ramp_and_nothing_else(mistake):
    random, points = np.random.default_rng(2), points_of(count=4)
    data = measuring.plainly(points, curves({3.0: np.full((4, 2), 1e-3 + 0j)}, 720))
    made = measuring.MISTAKES[mistake](random, data, 81)
    power = rms_by_order(spectrum(made.te)) ** 2
    if mistake in ("own_zeros", "eccentric_angle"):
        assert power[3] == pytest.approx(5e-7) and power.sum() == pytest.approx(power[3])
        assert (mistake == "eccentric_angle") == (np.ptp(made.angle - data.angle) > 0.1)
    else:
        rest = np.sqrt(power[[5, 10, 20]]) * [5, 10, 20]
        assert rest == pytest.approx(rest[0], rel=0.05) and rest[0] > 1e-4


def test_saturating_law_is_flat_at_full_load():
    law = mesh.saturating(300.0)
    low, middle, full = (law(points_of(torque=torque))[0] for torque in (100.0, 1300.0, 1600.0))
    assert full == pytest.approx(1.0)
    assert full - middle < 0.001 < low < 0.4


def test_foreign_orders_belong_to_no_part():
    for seed in range(30):
        _, _, (part,), _ = drawn("foreign", seed)
        assert all(part.orders[0] % teeth for teeth in (39, 40, 81))
        assert part.names == ()


def test_a_loose_wave_has_another_phase_in_each_run():
    _, _, (part,), points = drawn("foreign_loose")
    wave = part.waves(points)[float(part.orders[0])]
    assert np.abs(wave.mean()) < 0.3 * np.abs(wave).mean()
    np.testing.assert_array_equal(part.waves(points)[float(part.orders[0])], wave)


def test_sidebands_keep_their_size_over_load():
    _, known, (part,), _ = drawn("constant_sidebands")
    sizes = [np.abs(part.waves(points_of(torque=torque))[float(part.orders[0])]) for torque in (0.0, 1600.0)]
    np.testing.assert_allclose(*sizes)
    middle = part.near[0]
    assert not [e for e in known.effects if e["name"] == "carrier_modulation" and e["order"] == middle]


def test_mains_stand_still_in_time():
    _, _, (part,), _ = drawn("mains")
    for speed in (300.0, 1700.0):
        (order,) = part.waves(points_of(speed=speed))
        assert order * speed / 60 / 81 == pytest.approx(float(part.title.split()[0]))


def test_a_step_is_in_the_time_of_the_campaign():
    _, _, (part,), _ = drawn("wear_step")
    before, after = (np.abs(part.waves(points_of(when=when))[float(part.orders[0])]).max() for when in (0.3, 0.7))
    assert before == 0 < after


def test_one_direction_has_nothing_in_the_other():
    _, _, (part,), points = drawn("one_direction")
    sizes = np.abs(part.waves(points)[float(part.orders[0])]).max(axis=0)
    assert sizes.min() == 0 < sizes.max()


def test_lagging_body_follows_the_oil_late():
    count = 400
    oil = np.where(np.arange(count) < 200, 25.0, 35.0)
    campaign = points_of(oil=oil, when=np.arange(count) / (count - 1), count=count)
    body = slow.lagging_oil(campaign, 0.1)
    assert body(points_of(when=0.5))[0] == pytest.approx(25.0, abs=0.2)
    # one time constant after the step
    assert body(points_of(when=0.6))[0] == pytest.approx(35.0 - 10.0 / np.e, abs=0.2)


def test_stepped_spring_is_continuous_and_stiffens():
    value = slow.stepped_spring((200.0, 300.0, 500.0), (300.0, 800.0))
    torque = np.linspace(0, 1600, 1601)
    te = value(points_of(torque=torque, count=1601))
    slopes = -1 / np.diff(te) / 60
    assert np.abs(np.diff(te)).max() < 1.01 / 200 / 60
    assert slopes[100] == pytest.approx(200.0)
    assert slopes[500] == pytest.approx(300.0)
    assert slopes[1500] == pytest.approx(500.0)


def test_stribeck_friction_falls_and_rises_again():
    friction = Stribeck(50.0, 120.0, 3.0, 2.0)
    torque = friction.torque(np.array([0.0, 6.0, 30.0]))
    assert torque[0] == 120.0 > torque[1] < torque[2]


def test_resonance_peaks_where_its_truth_says():
    mode = resonance.Mode(resonance.falling(40.0, 0.1, "torque", 0.0, 1600.0), resonance.constant(0.01), True)
    speeds = np.linspace(300, 1700, 4000)
    for torque, hertz in ((0.0, 40.0), (1600.0, 36.0)):
        points = points_of(speed=speeds, torque=torque, count=4000)
        peak = speeds[np.argmax(np.abs(mode.response(points, 162, 81)))]
        assert 162 * peak / 60 / 81 == pytest.approx(hertz, rel=0.005)


def test_oscillator_without_play_is_the_linear_one():
    """Integrated in time, the loaded oscillator has the response of the linear equation."""
    system = Oscillator(40.0, 0.05, 454.0 * 60, 1e-3, {162: 1e-4 + 0j})
    points = points_of(speed=np.array([600.0, 1150.0, 1500.0]), torque=1500.0, count=3)
    found = np.fft.rfft(system.run(points, 81), axis=-1)[..., 162] * (2 / 6720)
    r = points.hertz(162, 81) / 40.0
    expected = 1e-4 * np.abs((1 + 0.1j * r) / (1 - r**2 + 0.1j * r))
    np.testing.assert_allclose(np.abs(found), np.repeat(expected[:, None], 2, axis=1), rtol=0.03)


def test_oscillator_with_play_knocks_without_load():
    system = Oscillator(40.0, 0.02, 454.0 * 60, 2e-3, {162: 1e-3 + 0j})
    speeds = np.array([900.0, 1100.0])
    loaded, unloaded = (
        np.abs(np.fft.rfft(system.run(points_of(speed=speeds, torque=torque, count=2), 81, 3360, 1344), axis=-1))
        for torque in (1600.0, 50.0)
    )
    # the loaded one has the excited order alone
    assert loaded[..., 324].max() < 0.01 * loaded[..., 162].max()
    assert unloaded[..., 324].max() > 0.01 * unloaded[..., 162].max()


# ------------------------------------------------------------------------------------------------ measuring


@pytest.mark.parametrize("name", sorted(measuring.NOISES))
def test_noise_has_the_size_of_its_level(name):
    clean = np.zeros((40, 2, 1000))
    noisy = measuring.NOISES[name](np.random.default_rng(1), clean, 1e-2)
    assert 0.8e-2 < noisy.std() < 2.5e-2
    assert np.abs(noisy.mean()) < 2e-3


def test_an_encoder_of_18_bits_shows_its_steps_without_noise():
    read = measuring.encoder(np.random.default_rng(1), np.zeros((20, 2, 1000)), 0.0)
    assert 0.2 < read.std() / measuring.STEP_18_BITS < 0.5


def test_mistakes_change_what_they_say():
    random = np.random.default_rng(2)
    points = measuring.plan(random, "grid", False, (25.0, 35.0))
    te = random.standard_normal((len(points), 2, 50))
    data = measuring.plainly(points, te)
    changed = {name: mistake(random, data, 81) for name, mistake in measuring.MISTAKES.items()}
    np.testing.assert_allclose(changed["arcsec"].te, 3600 * te)
    np.testing.assert_allclose(changed["rad"].te, np.radians(te))
    np.testing.assert_allclose(changed["sign"].te, -te)
    np.testing.assert_allclose(changed["direction"].te[:, 0], te[:, 1])
    ramp = changed["ratio"].te - te
    np.testing.assert_allclose(np.diff(ramp[0, 0]), ramp[0, 0, 1])
    turned = np.mod(changed["home_offset"].angle - data.angle, 360)
    np.testing.assert_allclose(turned, turned[0, 0])
    told = changed["labels"]
    moved = np.flatnonzero((told.points.speed != points.speed) | (told.points.torque != points.torque)
                           | (told.points.temperature != points.temperature))  # fmt: skip
    assert set(moved) == set(told.wrong)
    assert len(told.wrong) == pytest.approx(0.08 * len(points), abs=1)
    late = changed["delay"].te - te
    np.testing.assert_allclose(late[:, 0], -late[:, 1])
    assert np.ptp(late[:, 0, 0] / points.speed) < 1e-12
    blocked = changed["block"]
    rows = np.flatnonzero(np.any(blocked.te != te, axis=(1, 2)))
    np.testing.assert_array_equal(rows, blocked.wrong)
    np.testing.assert_array_equal(np.diff(rows), 1)


@pytest.mark.parametrize("trouble", files.TROUBLES)
def test_broken_files_are_broken(tmp_path, trouble):
    random = np.random.default_rng(4)
    points = points_of(speed=[500.0, 900.0], count=2)
    names = files.write_curves(measuring.plainly(points, np.zeros((2, 2, 400))), tmp_path / "m", named=False)
    whole = {name: (tmp_path / "m" / name).read_text() for name in names}
    bad = files.spoil(random, tmp_path / "m", names, trouble)
    after = {name: path.read_text() for name in names if (path := tmp_path / "m" / name).is_file()}
    assert [name for name in names if after.get(name) != whole[name]] == list(bad) or trouble == "mixed_sampling"
    assert len(bad) == (trouble != "mixed_sampling")


def test_table_holds_the_waves(tmp_path):
    waves = {0.0: np.full((1, 2), 0.1 + 0j), 40.0: np.array([[1e-3j, 2e-3]])}
    data = measuring.plainly(points_of(), curves(waves, 400))
    files.write_table(data, tmp_path / "t.csv", [0, 40])
    rows = [line.split(",") for line in (tmp_path / "t.csv").read_text().splitlines()]
    assert rows[0] == ["direction", "speed_rpm", "torque_Nm", "temperature_C", "A0", "A40", "phi40"]
    assert [float(value) for value in rows[1][1:]] == pytest.approx([1000, 500, 30, 0.1, 1e-3, np.pi / 2])
    assert float(rows[2][5]) == pytest.approx(2e-3)


# ------------------------------------------------------------------------------------------------ the list


def test_list_has_each_kind_and_three_noises_of_one_machine():
    listed = cases.listed("dev", 3 * len(cases.LONG_PASS), cases.FIRST_LONG)
    assert {case.kind for case in listed} == set(KINDS)
    assert {case.trouble for case in listed} == {"", *files.TROUBLES}
    assert {mistake for case in listed for mistake in case.mistakes} == set(measuring.MISTAKES)
    for place in range(len(cases.LONG_PASS)):
        three = listed[place :: len(cases.LONG_PASS)]
        assert len({case.seed for case in three}) == 1
        assert len({case.noise for case in three}) == 3
        assert len({replace(case, name="", level=0, noise=0.0) for case in three}) == 1
    before = cases.listed("dev", len(cases.PASS))
    assert not {case.kind for case in before} & set(kinds.LATER)
    held_out = cases.listed("heldout", cases.HELD_OUT_CASES)
    assert len({case.name for case in held_out}) == len(held_out) == 513
    assert not {case.seed for case in held_out} & {case.seed for case in listed}
    assert {0.1, 100.0} <= {case.noise for case in held_out}


@pytest.mark.thorough
def test_cases_are_the_same_each_time(tmp_path):
    case = next(case for case in cases.listed("dev", 3) if case.kind == "foreign_multiple")
    case = replace(case, layout="twelve")
    for folder in ("a", "b"):
        make.make(case, tmp_path / folder)
    first, second = (sorted(p for p in (tmp_path / folder).rglob("*") if p.is_file()) for folder in ("a", "b"))
    assert [p.relative_to(tmp_path / "a") for p in first] == [p.relative_to(tmp_path / "b") for p in second]
    assert [p.read_bytes() for p in first] == [p.read_bytes() for p in second]


def test_files_hold_known_and_hidden(tmp_path):
    case = next(case for case in cases.listed("dev", 400) if case.kind == "foreign" and case.form == "numbered")
    truth = make.make(replace(case, noise=1e-6, noise_form="white", layout="twelve"), tmp_path)
    table = np.loadtxt(tmp_path / "measured" / "run_0003.csv", delimiter=",", skiprows=1)
    te = truth.known[2] + truth.hidden[2]
    np.testing.assert_allclose(table[:, 1], te[0], atol=2e-9)
    np.testing.assert_allclose(table[:, 3], np.concatenate([te[1, :1], te[1, :0:-1]]), atol=2e-9)
    (part,) = truth.parts
    assert int(np.argmax(truth.by_order())) == part.orders[0]
    # nothing of it is in what the rig model makes
    assert spectrum(truth.known)[..., part.orders[0]].__abs__().max() < 1e-9
    assert truth.strength[0] > 1e6
