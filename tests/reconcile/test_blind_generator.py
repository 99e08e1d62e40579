"""The generator's formulas: limiting cases, known values, sizes as stated, the same files for the same seed."""

import cmath
import math
import tomllib

import numpy as np
import pytest

from .blind import cases, effects, foreign, generator, hidden, layout, timed

HEAD = {"reduction_ratio": 81.0, "zero_offset_deg": 0.0}


def at(speed=600.0, torque=1000.0, heat=30.0):
    columns = np.broadcast_arrays(*np.atleast_1d(speed, torque, heat))
    return layout.Conditions(*(np.array(column, dtype=float) for column in columns))


def te(*tables, runs=None, head=HEAD):
    return effects.coefficients(head, tables, runs or at())


def test_compliance_of_the_paper_s_rig():
    mean = te({"name": "torsional_compliance", "stiffness_Nm_per_arcmin": 454.0}, runs=at(torque=[0.0, 1800.0]))[0]
    # 3.67e-5 deg per N m
    assert mean[:, 1].real == pytest.approx([-1800 * 3.67e-5, 1800 * 3.67e-5], rel=1e-3)
    assert mean[:, 0].real == pytest.approx([0.0, 0.0])


def test_backlash_opens_by_half_its_gap_either_way():
    table = {"name": "backlash", "gap_arcmin": 0.6, "seating_torque_Nm": 50.0}
    mean = te(table, runs=at(torque=[0.0, 50.0, 5000.0]))[0].real
    assert mean[1, 2] - mean[0, 2] == pytest.approx(0.6 / 60)
    assert mean[0, 1] / mean[0, 2] == pytest.approx(0.7616, abs=1e-4), "76 % at the seating torque"
    assert mean[0, 0] == 0.0


def test_windup_of_cold_oil():
    table = {
        "name": "friction_windup",
        "coulomb_arcmin": 0.2,
        "viscous_arcmin_per_krpm": 0.1,
        "viscosity_decay_per_K": 0.05,
    }
    mean = te(table, runs=at(speed=2000.0, heat=[30.0, 20.0]))[0].real
    assert mean[0] == pytest.approx([-(0.2 + 0.2) / 60, -(0.2 + 0.2 * math.exp(0.5)) / 60])
    assert mean[1] == pytest.approx(-mean[0])
    # left out, the decay is 0.04
    short = {key: value for key, value in table.items() if key != "viscosity_decay_per_K"}
    assert te(short, runs=at(speed=2000.0, heat=20.0))[0].real[1, 0] == pytest.approx((0.2 + 0.2 * math.exp(0.4)) / 60)


def test_drift_is_the_same_in_both_directions():
    mean = te({"name": "thermal_drift", "drift_arcmin_per_K": 0.12}, runs=at(heat=35.0))[0].real
    assert mean[:, 0] == pytest.approx([0.01, 0.01])


@pytest.mark.parametrize("width", [4.0, 15.0, 60.0])
def test_notch_of_wear_sums_to_its_closed_form(width):
    centre = 70.0
    table = {"name": "wear", "depth_arcmin": 6.0, "centre_deg": centre, "width_deg": width}
    curve = effects.curve(te(table), 720)
    theta = np.arange(720) * 0.5
    stiff = 1 / math.radians(width) ** 2
    shape = 0.1 * np.exp(stiff * (np.cos(np.radians(theta - centre)) - 1))
    assert curve[0, 0] == pytest.approx(-shape, abs=2e-4 * 0.1 if width == 4.0 else 1e-12)
    assert curve[1, 0] == pytest.approx(-curve[0, 0])
    # for a narrow notch a Gaussian: 60 % of its depth at its width
    if width == 4.0:
        assert curve[0, 0, np.argmin(abs(theta - centre - width))] == pytest.approx(-0.1 * math.exp(-0.5), rel=0.01)


def test_flanks_without_a_pair_of_their_own_are_equal():
    table = {"name": "pin_error", "order": 40, "amplitude_deg": 1e-3, "phase_rad": 0.5}
    both = te(table)[40][:, 0]
    assert both == pytest.approx([cmath.rect(1e-3, 0.5)] * 2)
    own = te(table | {"backward_amplitude_deg": 2e-3, "backward_phase_rad": -0.5})[40][:, 0]
    assert own == pytest.approx([cmath.rect(1e-3, 0.5), cmath.rect(2e-3, -0.5)])


def test_sidebands_follow_the_bare_mesh_order_and_not_each_other():
    tables = [
        {"name": "cycloid_tooth_error", "order": 39, "amplitude_deg": 1e-3, "phase_rad": 0.3},
        {"name": "load_dependent_mesh", "order": 39, "slope_deg_per_kNm": 1e-3, "phase_rad": 0.3},
        {"name": "carrier_modulation", "order": 39, "lower_ratio": 0.1, "upper_ratio": 0.2, "upper_phase_rad": 1.0},
        {"name": "carrier_modulation", "order": 42, "lower_ratio": 5.0, "upper_ratio": 5.0},
    ]
    waves = te(*tables, runs=at(torque=[0.0, 1000.0]))
    assert waves[39][0] == pytest.approx([cmath.rect(1e-3, 0.3), cmath.rect(2e-3, 0.3)])
    assert waves[36][0] == pytest.approx(0.1 * waves[39][0])
    assert waves[42][0] == pytest.approx(0.2 * cmath.rect(1.0, 1.0) * waves[39][0])
    assert not waves[45].any(), "order 42 is a sideband itself, with no bare wave"


def test_resonance_peaks_where_the_order_meets_it():
    assert abs(effects.response(np.array([54.0]), 54.0, 0.02)[0]) == pytest.approx(1.0)
    # half power points of a light damping are 2 D apart
    for side in (1 - 0.02, 1 + 0.02):
        assert abs(effects.response(np.array([54.0 * side]), 54.0, 0.02)[0]) == pytest.approx(math.sqrt(0.5), rel=0.03)
    assert abs(effects.response(np.array([0.54]), 54.0, 0.02)[0]) < 1e-5
    # far above: 2 D r^2 / -r^2
    assert effects.response(np.array([54e4]), 54.0, 0.02)[0] == pytest.approx(-0.04, abs=1e-5)
    table = {"name": "structural_resonance", "frequency_Hz": 54.3, "damping_ratio": 0.012, "orders": [240, 162]}
    waves = te(
        table | {"amplitude_deg": [1e-3, 2e-3], "phase_rad": [0.0, 0.0]}, runs=at(speed=np.arange(900.0, 1800.0))
    )
    # order 240 at 1100 rpm, 162 near 1630
    assert 900 + np.argmax(abs(waves[240][0])) == pytest.approx(54.3 * 60 * 81 / 240, abs=1)
    assert 900 + np.argmax(abs(waves[162][0])) == pytest.approx(54.3 * 60 * 81 / 162, abs=1)
    assert waves[240][1] == pytest.approx(np.conj(waves[240][0])), "a real amplitude: time runs against theta"


def test_delay_shifts_the_curve_along_the_angle():
    wave = {"name": "pin_error", "order": 40, "amplitude_deg": 1e-3, "phase_rad": 0.0}
    late = {"name": "measurement_delay", "delay_us": 1000.0, "skew_us": 100.0}
    waves = te(wave, late, runs=at(speed=1620.0))
    # 1620 rpm at the input are a third of a revolution a second at the output: 120 deg a second
    turned = math.radians(40 * 120.0 * 1e-3)
    assert waves[40][:, 0] == pytest.approx([1e-3 * cmath.exp(-1j * turned), 1e-3 * cmath.exp(1j * turned)])
    assert waves[0][:, 0].real == pytest.approx([-120.0 * 1e-4, 120.0 * 1e-4])


def test_curve_and_coefficients_agree():
    rng = np.random.default_rng(0)
    made = hidden.healthy(rng, [], ())
    runs = layout.conditions(rng, "scattered", "sparse").take(np.arange(3))
    spectrum = effects.coefficients(made.head, made.true, runs)
    found = np.fft.rfft(effects.curve(spectrum, 1024), axis=2) / 1024
    for order, values in spectrum.items():
        assert (2 - (order == 0)) * found[:, :, order] == pytest.approx(values, abs=1e-12)


def test_every_effect_of_the_catalogue_has_a_formula_and_is_hidden():
    assert set(hidden.MAKERS) == set(effects.NAMES)
    cases_of = {name for slot in cases.SLOTS if slot.kind in ("single", "confounded") for name in slot.effects}
    assert cases_of == set(effects.NAMES)


# ------------------------------------------------------------------------------------------------ recordings


def test_lag_follows_a_ramp_by_lag_times_speed():
    ramp = 100.0 * np.arange(2000) * 1e-3
    followed = timed.lagged(ramp, 1e-3, 0.02)
    assert ramp[-1] - followed[-1] == pytest.approx(100.0 * 0.02)
    # the closed form: v (t - L (1 - exp(-t / L)))
    t = 1e-3 * np.arange(2000)
    assert followed == pytest.approx(100.0 * (t - 0.02 * (1 - np.exp(-t / 0.02))))
    assert timed.lagged(ramp, 1e-3, 0.0) == pytest.approx(ramp)


def test_recording_is_stiff_without_effects(monkeypatch):
    monkeypatch.setattr(timed, "FAST_NOISE_DEG", 0.0)
    monkeypatch.setattr(timed, "OUT_NOISE_DEG", 0.0)
    columns = timed.record(np.random.default_rng(0), HEAD, [], moves=2)
    assert tuple(columns) == timed.COLUMNS
    assert columns["theta_mot"] == pytest.approx(columns["theta_ref"])
    assert columns["theta_in"] == pytest.approx(columns["theta_ref"])
    assert columns["theta_out"] == pytest.approx(columns["theta_in"] / 81.0)
    wave = {"name": "pin_error", "order": 40, "amplitude_deg": 1e-3, "phase_rad": 0.2}
    with_wave = timed.record(np.random.default_rng(0), HEAD, [wave], moves=2)
    error = with_wave["theta_out"] - with_wave["theta_in"] / 81.0
    assert error == pytest.approx(1e-3 * np.cos(40 * np.radians(with_wave["theta_out"]) + 0.2), abs=1e-9)


# ------------------------------------------------------------------------------------------------ cases


def test_lists_are_the_same_for_everybody_and_apart():
    first = cases.listed("dev", 200)
    assert first == cases.listed("dev", 200)
    assert first[50:60] == cases.listed("dev", 10, first=50)
    held_out = cases.listed("heldout", 200)
    assert {case.seed for case in first}.isdisjoint(case.seed for case in held_out)
    assert max(case.seed for case in first) < 10000 <= min(case.seed for case in held_out)
    with pytest.raises(ValueError, match="seeds of dev"):
        cases.case("dev", 10000)
    assert len({case.name for case in first}) == 200


def test_a_round_holds_everything():
    kinds = [slot.kind for slot in cases.SLOTS]
    assert {kind: kinds.count(kind) for kind in set(kinds)} == {
        "single": 36, "pair": 14, "none": 30, "foreign": 13, "weak": 15, "confounded": 8,
    }  # fmt: skip
    assert {slot.variant for slot in cases.SLOTS if slot.kind == "foreign"} == set(foreign.KINDS)
    whole = cases.listed("heldout", 3 * cases.ROUND)
    assert len(whole) >= 300
    for label in ("format", "layout", "noise"):
        counts = np.unique([getattr(case, label) for case in whole], return_counts=True)[1]
        assert counts.min() >= 10, f"{label}: each of them is there"


@pytest.mark.parametrize("index", range(0, cases.ROUND, 13))
def test_sizes_and_bounds(index, tmp_path):
    case = cases.case("dev", index)
    made = generator.make(case, tmp_path)
    if case.effects and case.format != "recording":
        assert made.snr == pytest.approx(case.size, rel=1e-3)
    stated = tomllib.loads(made.rig.read_text())
    names = [(table["name"], table.get("order")) for table in stated["effect"]]
    truth = {(table["name"], table.get("order")) for table in made.true}
    assert truth - set(names) == {(table["name"], table.get("order")) for table in made.true[len(names) :]}
    assert len(truth) == len(names) + len(case.effects), "what is hidden is not in the rig, all else is"


BOUNDS = {
    "stiffness_Nm_per_arcmin": (0.5, 20000),
    "gap_arcmin": (0, 20),
    "seating_torque_Nm": (5, 150),
    "coulomb_arcmin": (0, 5),
    "viscous_arcmin_per_krpm": (0, 5),
    "viscosity_decay_per_K": (0.01, 0.1),
    "drift_arcmin_per_K": (-2, 2),
    "amplitude_deg": (0, 1),
    "growth_per_kNm": (0, 5),
    "slope_deg_per_kNm": (0, 1),
    "depth_arcmin": (0, 10),
    "centre_deg": (0, 360),
    "width_deg": (4, 60),
    "lower_ratio": (0, 5),
    "upper_ratio": (0, 5),
    "frequency_Hz": (5, 500),
    "damping_ratio": (0.003, 0.3),
    "delay_us": (0, 20000),
    "skew_us": (-2000, 2000),
}


@pytest.mark.thorough
@pytest.mark.parametrize("split", ["heldout"])
def test_what_is_hidden_can_be_found_within_the_bounds(split, tmp_path, monkeypatch):
    """A round without its files: no size needs a value out of bounds (weak ones may)."""
    monkeypatch.setattr(generator.write, "curves", lambda folder, runs, te, names_in_file: [""] * len(runs))
    monkeypatch.setattr(generator.write, "harmonic_table", lambda *arguments: None)
    monkeypatch.setattr(generator, "SAMPLES", 512)
    for case in cases.listed(split, cases.ROUND):
        if not case.effects or case.format == "recording" or case.kind == "weak":
            continue
        made = generator.make(case, tmp_path)
        for table in made.true[-len(case.effects) :]:
            for key, value in table.items():
                low, high = BOUNDS.get(key.removeprefix("backward_"), (-math.inf, math.inf))
                if key not in ("name", "orders"):
                    assert np.all((low <= np.asarray(value)) & (np.asarray(value) <= high)), (case.name, key, value)


def test_the_same_seed_writes_the_same_bytes(tmp_path):
    for case in (cases.case("dev", 0), cases.case("dev", 9)):
        texts = []
        for attempt in ("a", "b"):
            folder = tmp_path / f"{case.name}-{attempt}"
            folder.mkdir()
            made = generator.make(case, folder)
            files = sorted(made.measured.iterdir()) if made.measured.is_dir() else [made.measured]
            texts.append([made.rig.read_bytes(), *(file.read_bytes() for file in files)])
        assert texts[0] == texts[1]


def test_a_foreign_error_is_in_the_files_and_not_in_the_truth(tmp_path):
    index = next(place for place, slot in enumerate(cases.SLOTS) if slot.variant == "order11_constant")
    case = cases.case("dev", index)
    made = generator.make(case, tmp_path)
    runs = at(speed=500.0)
    assert not np.any(effects.coefficients(made.head, made.true, runs).get(11, 0.0))
    assert made.expected.orders == (11,) and not made.expected.hidden


def test_noise_of_a_case_is_its_floor(tmp_path):
    """A table of nothing missing minus its truth has the RMS that is called the floor."""
    wanted = (case for case in cases.listed("dev", 200) if case.kind == "none" and case.format == "table")
    case = next(case for case in wanted if not (case.corrupt or case.drifted) and case.layout != "scattered")
    made = generator.make(case, tmp_path)
    lines = made.measured.read_text().splitlines()
    columns = lines[0].split(",")
    rows = np.array([line.split(",")[1:] for line in lines[1:]], dtype=float)
    place = {name: number - 1 for number, name in enumerate(columns)}
    runs = layout.Conditions(*(rows[: made.runs, column] for column in range(3)))
    truth = effects.coefficients(made.head, made.true, runs)
    squares = 0.0
    for order in generator.TABLE_ORDERS:
        size = rows[:, place[f"A{order}"]].reshape(2, made.runs)
        angle = rows[:, place[f"phi{order}"]].reshape(2, made.runs) if order else 0.0
        rest = size * np.exp(1j * angle) - truth.get(order, 0.0)
        squares += np.mean(abs(rest) ** 2) * (0.5 if order else 1.0)
    assert math.sqrt(squares) == pytest.approx(made.floor_deg, rel=1e-3)
