"""Parts of reconcile one by one: noise floor, coordinates, joint fit, evidence, units; own effects; the report."""

import importlib
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from st_codegen.campaign.harmonic_table import HarmonicTable, write_table
from st_codegen.cli.main import cli
from st_codegen.errors import InputError
from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.data.chances import f_tail, false_discoveries
from st_codegen.reconcile.data.checks import check_units
from st_codegen.reconcile.data.noise import estimate
from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.reconcile.fit.fitting import fit
from st_codegen.reconcile.fit.normal import inverse, root_of_inverse
from st_codegen.reconcile.fit.propagation import Propagation
from st_codegen.reconcile.fit.state import State, piece_of
from st_codegen.reconcile.fit.target import FitData, groups_of
from st_codegen.reconcile.judge.errors import standard_errors
from st_codegen.reconcile.judge.retuned import with_piece_held
from st_codegen.reconcile.search.candidates import variants
from st_codegen.reconcile.search.evidence import _p_of_chance
from st_codegen.rig.effects import Conditions, Constants, Effect, Phasor, catalogue
from st_codegen.rig.model import RigModel

ROOT = Path(__file__).resolve().parents[2]
KNOWN = catalogue()
CONSTANTS = Constants()
SIGMA = 2e-5


def effect(name, **values):
    return KNOWN[name](values, CONSTANTS)


def grid(speeds=6, torques=7, temperatures=3):
    axes = np.meshgrid(
        np.linspace(100, 1800, speeds), np.linspace(0, 1800, torques), np.linspace(25, 35, temperatures), [1.0, -1.0]
    )
    speed, torque, temperature, sign = (axis.ravel() for axis in axes)
    return Conditions.of(sign, speed, torque, temperature)


def observed(rig, at, orders=(0, 1, 2, 3, 39, 40, 78), seed=0, sigma=SIGMA):
    random = np.random.default_rng(seed)
    values = rig.coefficients(at, orders)
    noise = sigma * (random.standard_normal(values.shape) + 1j * random.standard_normal(values.shape))
    noise[:, 0] = noise[:, 0].real
    return Observations(at, labels(at), np.array(orders), values + noise)


RIG = RigModel(
    effects=(
        effect("torsional_compliance", stiffness_Nm_per_arcmin=454.0),
        effect("output_shaft_eccentricity", amplitude_deg=0.0172, phase_rad=0.3),
        effect("cycloid_tooth_error", order=39, amplitude_deg=1e-3, phase_rad=1.0,
               backward_amplitude_deg=5e-4, backward_phase_rad=-1.0),
    )
)  # fmt: skip


@pytest.mark.parametrize("spectral_deg", [None, SIGMA])
def test_an_order_of_a_table_that_is_another_in_each_run_is_said_to_be(spectral_deg):
    """A cage of 33.4 waves a turn, of another phase in each run, was noise, and not a word said so."""
    data, random = observed(RIG, grid(), (0, 1, 2, 3, 33, 39, 40, 78)), np.random.default_rng(1)
    turned = 10 * SIGMA * np.exp(2j * np.pi * random.random(len(data)))
    seen = None if spectral_deg is None else np.full(data.values.shape, spectral_deg)
    data = replace(data, values=data.values + turned[:, None] * (data.orders == 33), spectral_deg=seen)
    result = reconcile_observations(RIG, data, KNOWN)
    said = [text for text in result.cannot_show if "order 33 differs from run to run by" in text]
    assert len(said) == (seen is None)
    assert bool(result.unexplained) == (seen is not None)


def started(rig, data):
    """The state of a rig, all of whose effects are free, and what is fitted."""
    n = data.values.shape
    target = FitData(data, np.full(n, SIGMA), np.ones(n[0], bool), groups_of(data.at))
    return target, State(rig, 0.0, tuple(piece_of(one, added=False, origin=one) for one in rig.effects))


def test_losses_are_squares_of_what_an_order_may_have_and_straight_beyond_three():
    """A mean has no imaginary part."""
    at = grid(2, 2, 1)
    data = observed(RIG, at, orders=(0, 5))
    target = FitData(data, np.full((len(at), 2), 2.0), np.arange(len(at)) > 0, groups_of(at))
    losses = target.losses(np.tile([2 + 90j, 1.2 + 1.6j], (len(at), 1)))
    assert losses[0].tolist() == [0.0, 0.0]
    assert losses[1:] == pytest.approx(1.0)
    assert target.losses(np.tile([-10 + 0j, 6 + 8j], (len(at), 1)))[1:] == pytest.approx(2 * 3 * 5 - 9)
    assert target.weights(np.tile([-10 + 90j, 6 + 8j], (len(at), 1)))[1:] == pytest.approx(3 / 5 / 4)


@pytest.mark.parametrize("size", [2e-4, 5e-5])
def test_a_mesh_order_and_its_sidebands_are_fitted_together(size):
    """A step that takes both at once overshoots: sidebands are a ratio times the size of their mesh order."""
    sides = {"lower_phase_rad": 0.2, "upper_phase_rad": 0.3}
    true, start = (
        replace(RIG, effects=(*RIG.effects[:2], RIG.effects[2].with_values(dict(RIG.effects[2].values) | own),
                effect("carrier_modulation", order=39, lower_ratio=ratio, upper_ratio=ratio, **sides)))
        for own, ratio in (({}, 1.0), ({"amplitude_deg": size, "backward_amplitude_deg": size}, 0.1))
    )  # fmt: skip
    data = observed(true, grid(), orders=(0, 1, 36, 39, 42))
    found = fit(*started(start, data), steps=50)
    numbers = len(data) * 9
    assert found.loss < numbers + 5 * np.sqrt(2 * numbers)
    # nothing is left that another step would gain
    assert float(found.open_step @ np.linalg.inv(found.inverse) @ found.open_step) < 0.1


def test_noise_is_found_under_what_varies_smoothly():
    data = observed(RIG, grid())
    noise = estimate(data, data.values)
    # 126 runs a direction: the median of as many has a relative error of 6 %; four times that
    assert noise.sigma[0, 1:] == pytest.approx(SIGMA, rel=0.25)
    assert not noise.suspects


def test_orders_that_few_curves_tell_have_the_noise_of_these():
    """What stands in for the others has no noise: a resonance was read from the rest."""
    data = observed(RIG, grid())
    seen = np.ones(data.values.shape, bool)
    seen[::2, -1] = False
    data = replace(data, seen=seen, spectral_deg=np.where(seen, SIGMA, 0.0), values=np.where(seen, data.values, 0.0))
    noise = estimate(data, data.values - RIG.coefficients(data.at, data.orders.tolist()))
    assert noise.sigma[:, -1] == pytest.approx(SIGMA, rel=0.25)
    assert noise.sigma[:, -2] == pytest.approx(SIGMA, rel=0.25)


def test_a_bad_run_is_named():
    data = observed(RIG, grid())
    values = data.values.copy()
    # order 0 is real; all others are wrong by thirty noises
    values[100, 1:] += 30 * SIGMA * np.exp(1j * np.arange(6))
    noise = estimate(data, values)
    assert [row for row, _ in noise.suspects] == [100]
    assert (~noise.good).sum() == 1


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_coordinates_there_and_back(name):
    values = {
        "stiffness_Nm_per_arcmin": 300.0, "gap_arcmin": 0.4, "seating_torque_Nm": 50.0, "coulomb_arcmin": 0.1,
        "viscous_arcmin_per_krpm": 0.2, "viscosity_decay_per_K": 0.05, "drift_arcmin_per_K": 0.1, "amplitude_deg": 0.01,
        "phase_rad": 0.4, "slope_deg_per_kNm": 0.02, "depth_arcmin": 0.3, "centre_deg": 100.0, "width_deg": 5.0,
        "delay_us": 200.0, "skew_us": -30.0, "lower_ratio": 0.3, "lower_phase_rad": 1.0, "stiffness_Nm_per_rad": 9000.0,
        "height_deg": 0.01, "lag_ms": 4.0, "frequency_Hz": 54.0, "damping_ratio": 0.02,
    }  # fmt: skip
    known = KNOWN[name].known_keys()
    chosen = {key: value for key, value in values.items() if key in known}
    if "order" in known:
        chosen["order"] = {"pin_error": 40, "input_shaft_misalignment": 81}.get(name, 39)
    if "orders" in known:
        chosen |= {"orders": [156, 240], "amplitude_deg": [0.01, 0.02], "phase_rad": [0.4, -2.0]}
        chosen |= {"slope_deg_per_kNm": [0.03, 0.0], "slope_phase_rad": [1.0, 0.0]}
    piece = piece_of(effect(name, **chosen), added=False)
    back = piece.with_vector(piece.vector()).effect
    for key, value in piece.effect.values.items():
        assert back.values[key] == pytest.approx(value, rel=1e-12), key


def test_variants_are_the_choices_of_optional_parts():
    # the part that falls with speed comes on top of the constant one
    assert len(variants(KNOWN["friction_windup"], True)) == 5
    # either sideband or both in proportion to the mesh order, or both of constant size
    assert len(variants(KNOWN["carrier_modulation"], True)) == 4
    assert len(variants(KNOWN["torsional_compliance"], True)) == 1


def test_standard_errors_of_the_joint_fit_are_those_of_repeated_data():
    """The spread of a stiffness over 30 data sets against its standard error."""
    at = grid(5, 5, 2)
    found, errors = [], []
    for seed in range(30):
        data = observed(RIG, at, seed=seed, sigma=2e-4)
        noise = estimate(data, data.values - RIG.coefficients(at, data.orders.tolist()))
        target = FitData(data, noise.sigma, noise.good, groups_of(at))
        result = fit(target, State(RIG, 0.0, tuple(piece_of(e, added=False, origin=e) for e in RIG.effects)))
        found.append(result.state.vector()[1])
        errors.append(np.sqrt(result.covariance[1, 1]))
    assert np.mean(found) == pytest.approx(1 / 454.0, abs=4 * np.std(found) / np.sqrt(30))
    # the standard deviation of 30 values has a relative error of 13 %; errors are never below those of independent runs
    assert 0.6 < np.mean(errors) / np.std(found) < 1.8


def test_no_error_is_below_that_of_independent_runs():
    """Two clusters have a covariance of rank two: an amplitude was 126 of its standard errors from the true one."""
    at, true = grid(2, 4, 1), RIG.effects[2].values["amplitude_deg"]
    distances = []
    for seed in range(20):
        result = fit(*started(RIG, observed(RIG, at, seed=seed)))
        held = np.linalg.cholesky(np.linalg.inv(result.inverse))
        assert np.linalg.eigvalsh(held.T @ result.covariance @ held).min() > 1.0 - 1e-6
        found = result.state.model().effects[2].values["amplitude_deg"]
        distances.append((found - true) / standard_errors(result, 2)["amplitude_deg"])
    assert np.abs(distances).max() < 4.0


def test_the_root_of_an_inverse_is_told_where_rounding_leaves_nothing():
    size = np.array([1e-9, 1.0, 1e8])
    whole = np.array([[2.0, 0.5, 0.1], [0.5, 1.0, 0.3], [0.1, 0.3, 1.0]]) * np.outer(size, size)
    root = root_of_inverse(whole)
    assert root @ root.T == pytest.approx(inverse(whole), rel=1e-7)
    alike = np.ones((3, 3)) * np.outer(size, size)
    assert np.isfinite(root_of_inverse(alike)).all()


def test_errors_grow_where_the_form_is_wrong_and_keep_their_correlations():
    """Torques beyond the rig's own law: each level left out moves the stiffness farther than noise does."""
    at = grid(5, 5, 2)
    data = observed(RIG, at, sigma=2e-5)
    data.values[:, 0] += 4e-3 * (at.torque_Nm / 1800) ** 2 * at.sign
    result = fit(*started(RIG, data))
    known, wide = result.covariance, result.covariance_with_form
    times = np.diag(wide) / np.diag(known)
    assert times.min() >= 1.0
    assert times[1] > 10.0
    assert wide == pytest.approx(known * np.sqrt(np.outer(times, times)), rel=1e-9, abs=0.0)


def test_errors_hold_what_a_change_that_is_held_would_move():
    """Half of a play that changed, and was not believed, stood in the friction: 0.27 +- 0.002 arcmin of 0.22."""
    at, orders = grid(), (0, 39)
    play = effect("backlash", gap_arcmin=0.5, seating_torque_Nm=40.0)
    true = RIG.with_effects([*RIG.effects, play, effect("friction_windup", coulomb_arcmin=0.22)])
    rig = RIG.with_effects([*RIG.effects, play.with_values(dict(play.values) | {"gap_arcmin": 0.4})])
    data = observed(true, at, orders)
    target = FitData(data, np.full(data.values.shape, SIGMA), np.ones(len(data), bool), groups_of(at))
    friction = piece_of(effect("friction_windup", coulomb_arcmin=0.1), added=True)
    pieces = [piece_of(one, added=False, origin=one) for one in rig.effects]
    joint = fit(target, State(rig, rig.zero_offset_deg, (*pieces, friction)))
    final = with_piece_held(joint, len(pieces) - 1)
    found = final.state.pieces[-1].effect.scalar("coulomb_arcmin")
    assert abs(found - 0.22) > 0.02
    assert standard_errors(joint, len(pieces), final)["coulomb_arcmin"] > 0.9 * abs(found - 0.22)
    assert standard_errors(joint, len(pieces))["coulomb_arcmin"] < 0.2 * abs(found - 0.22)


def test_a_linear_column_is_what_a_small_step_changes():
    """Beside a delay the skew of the encoders had a column with all that the delay turns, and was never found."""
    rig = RigModel(effects=(*RIG.effects, effect("measurement_delay", delay_us=250.0, skew_us=10.0)))
    piece = piece_of(rig.effects[-1], added=False)
    data = observed(rig, grid())
    place = [c.key for c in piece.coordinates()].index("skew_us")
    (touched, column) = Propagation(rig, data).columns(piece)[place]
    more = RigModel(effects=(*RIG.effects, effect("measurement_delay", delay_us=250.0, skew_us=11.0)))
    expected = more.coefficients(data.at, data.model_orders()) - rig.coefficients(data.at, data.model_orders())
    assert touched.tolist() == [0]
    assert column[:, 0] == pytest.approx(expected[:, 0], rel=1e-6)


def test_columns_of_the_orders_of_a_resonance_are_what_steps_of_each_size_change():
    """The sizes of all orders are computed at once, behind a delay and also where an order was not measured."""
    delay = effect("measurement_delay", delay_us=250.0)
    values = {"orders": (39, 40, 78), "frequency_Hz": 20.0, "damping_ratio": 0.05}
    sizes = {"amplitude_deg": (1e-3, 0.0, 2e-3), "phase_rad": (0.3, 0.0, -2.0)}
    load_part = {"slope_deg_per_kNm": (0.0, 1e-3, 0.0), "slope_phase_rad": (0.0, 1.0, 0.0)}
    peak = effect("structural_resonance", **values, **sizes, **load_part)
    rig = RigModel(effects=(*RIG.effects, peak, delay))
    data = observed(rig, grid(), orders=(1, 39, 40))
    piece = piece_of(peak, added=False)
    columns = Propagation(rig, data).columns(piece)
    for number, (c, (touched, column)) in enumerate(zip(piece.coordinates(), columns, strict=True)):
        if not c.part:
            continue
        vector = piece.vector()
        vector[number] += 0.5 * c.scale
        more = RigModel(effects=(*RIG.effects, piece.with_vector(vector).effect, delay))
        step = more.coefficients(data.at, data.model_orders()) - rig.coefficients(data.at, data.model_orders())
        assert touched.tolist() == [[1], [2], []][c.place]
        assert step[:, touched] == pytest.approx(0.5 * c.scale * column, rel=1e-9)
        assert not np.delete(step, touched, axis=1).any()


def test_a_wave_of_one_of_several_orders_has_its_sidebands():
    """An effect of one's own may list orders whose waves come before the sidebands."""

    class Listed(Effect):
        name, title, orders_key = "listed_waves", "waves of several orders", "orders"
        phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "their size"),)

        def coefficient(self, at, order):
            return self.complex_at("amplitude_deg", at, self.orders.index(order))

    waves = Listed({"orders": (39, 80), "amplitude_deg": (1e-3, 2e-3), "phase_rad": (0.1, 0.2)}, CONSTANTS)
    rig = RigModel(effects=(waves, effect("carrier_modulation", order=39, upper_ratio=0.5)))
    data, piece = observed(rig, grid(), orders=(39, 42, 80)), piece_of(waves, added=False)
    columns = Propagation(rig, data).columns(piece)
    touched = {
        c.place: data.orders[places].tolist() for c, (places, _) in zip(piece.coordinates(), columns, strict=True)
    }
    assert touched == {0: [39, 42], 1: [80]}


def test_what_measuring_turns_is_all_that_the_rig_makes_sidebands_too():
    rig = RigModel(effects=(*RIG.effects, effect("carrier_modulation", order=39, upper_ratio=0.5)))
    at = grid(3, 3, 1)
    delayed = RigModel(effects=(*rig.effects, effect("measurement_delay", delay_us=250.0)))
    propagation = Propagation(delayed, observed(delayed, at))
    expected = rig.coefficients(at, propagation.orders.tolist())
    assert propagation.before_measuring == pytest.approx(expected, rel=1e-12)


def test_chance_counts_one_number_of_a_mean_and_two_of_a_wave():
    """Of five runs: ten numbers of order 1 beside one coordinate, five of the mean."""
    losses = {"before": 13.0, "after": 3.0}
    target = SimpleNamespace(
        losses=lambda name: np.array([losses[name]]),
        counts=np.ones((5, 2), bool),
        data=SimpleNamespace(parts=np.array([1, 2])),
    )
    columns = [(np.array([1]),), (np.array([0]),), (np.array([0, 1]),)]
    without, with_it = (SimpleNamespace(target=target, columns=columns, residual=name) for name in losses)
    for places, rest in (([0], 9), ([1], 4), ([0, 1], 13), ([2], 14)):
        expected = f_tail(10.0 / len(places), len(places), rest)
        assert _p_of_chance(without, with_it, places) == pytest.approx(expected, rel=1e-12)


def test_chances_of_an_f_by_hand():
    """Of two numbers over infinitely many it is exp(-x); over two it is 1 / (1 + x)."""
    chances = f_tail(np.array([1.5, 1.5, -1.0, np.nan, np.nan]), 2, np.array([np.inf, 2.0, 2.0, 2.0, np.inf]))
    assert chances == pytest.approx([np.exp(-1.5), 1 / 2.5, 1.0, 1.0, 1.0])


def test_false_discovery_rate_by_hand():
    p = np.array([0.001, 0.02, 0.9, 0.012, 0.04])
    # sorted 0.001 0.012 0.02 0.04 0.9 against 0.05*i/5 = 0.01 0.02 0.03 0.04 0.05
    assert false_discoveries(p, 0.05).tolist() == [True, True, False, True, True]
    assert not false_discoveries(np.array([0.5, 0.9]), 0.05).any()


@pytest.mark.parametrize(("factor", "words"), [(np.pi / 180, "in rad"), (180 / np.pi, "57.3"), (81.0, "motor side")])
def test_units_are_asked_about(factor, words):
    data = observed(RIG, grid()).scaled(factor)
    with pytest.raises(InputError, match=words):
        check_units(data, RIG, Path("table.csv"))


def run(tmp_path, rig, at, measured, *more):
    data = observed(measured, at)
    table = HarmonicTable(
        at.sign < 0, at.speed_rpm, at.torque_Nm, at.temperature_C, tuple(data.orders.tolist()), data.values
    )
    write_table(table, tmp_path / "h.csv")
    rig.write(tmp_path / "rig.toml")
    arguments = ["reconcile", "--rig", tmp_path / "rig.toml", "--measured", tmp_path / "h.csv", "--out", tmp_path / "o"]
    result = CliRunner().invoke(cli, [*map(str, arguments), *map(str, more)])
    assert result.exit_code == 0, result.output
    return json.loads((tmp_path / "o" / "report.json").read_text())


def test_a_missing_effect_is_named_added_and_the_page_says_so(tmp_path):
    less = RIG.with_effects(RIG.effects[1:])
    report = run(tmp_path, less, grid(), RIG)
    (found,) = report["effects"]
    # the load keeps its sign: friction that grows with the load would look the same
    assert found["alternatives"] == ["something_else"]
    assert (found["name"], report["verdict"]) == ("torsional_compliance", "explained")
    stiffness = found["parameters"]["stiffness_Nm_per_arcmin"]
    assert abs(stiffness["value"] - 454) < 4 * stiffness["stderr"]
    assert stiffness["unit"] == "Nm/arcmin"
    gap = report["gap"]["held_out"]
    assert gap["after"] < 1.15 * gap["noise_floor"] < gap["before"]
    assert 'name = "torsional_compliance"' in (tmp_path / "o" / "rig.toml").read_text()
    page = (tmp_path / "o" / "report.html").read_text()
    assert "N m per arcmin" in page and "<svg" in page
    assert found["share_of_gap"] > 0.99 and "It explains more than 99 % of the gap" in page
    assert '+name = "torsional_compliance"' in (tmp_path / "o" / "rig.diff").read_text()


@pytest.mark.thorough
def test_nothing_is_said_where_nothing_is_missing(tmp_path):
    report = run(tmp_path, RIG, grid(), RIG)
    assert (report["verdict"], report["effects"], report["unexplained"]) == ("nothing_missing", [], [])
    assert (tmp_path / "o" / "rig.toml").read_text() == RIG.text()


@pytest.mark.thorough
def test_an_effect_of_the_users_own_is_found(tmp_path):
    own = ROOT / "examples" / "effects" / "motor_cogging.py"
    at = grid()
    known = catalogue([own])
    piece = known["motor_cogging"]({"amplitude_deg": 1e-3, "phase_rad": 0.7}, CONSTANTS)
    measured = RigModel(effects=(*RIG.effects, piece))
    data = observed(measured, at, orders=(0, 1, 39, 81, 405))
    table = HarmonicTable(
        at.sign < 0, at.speed_rpm, at.torque_Nm, at.temperature_C, tuple(data.orders.tolist()), data.values
    )
    write_table(table, tmp_path / "h.csv")
    RIG.write(tmp_path / "rig.toml")
    arguments = ["reconcile", "--rig", tmp_path / "rig.toml", "--measured", tmp_path / "h.csv", "--out", tmp_path / "o"]
    result = CliRunner().invoke(cli, [*map(str, arguments), "--effects", str(own)])
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / "o" / "report.json").read_text())
    assert [entry["name"] for entry in report["effects"]] == ["motor_cogging"]
    assert report["effects"][0]["parameters"]["amplitude_deg"]["value"] == pytest.approx(1e-3, rel=0.05)


OWN_STRUCTURE = '''
import numpy as np
from st_codegen.rig.effects import Effect, Phasor, Scalar, Stage


class Frame(Effect):
    """Behind the sidebands like a resonance, but with no frequency."""

    name = "frame"
    title = "twist of the frame"
    stage = Stage.STRUCTURE
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "at 1000 N m"),)

    def touched_orders(self):
        return (2,)

    def contribution(self, at, orders):
        return (self.complex_at("amplitude_deg", at) * at.torque_Nm / 1000)[:, None] * np.isin(orders, (2,))


class Listed(Effect):
    """A list of orders without a frequency: nothing says which belong together, so it is not searched."""

    name = "listed"
    title = "several orders at once"
    orders_key = "orders"
    phasors = (Phasor("amplitude_deg", "phase_rad", "deg", 1, "amplitude"),)

    def coefficient(self, at, order):
        return self.complex_at("amplitude_deg", at, self.orders.index(order))
'''


@pytest.mark.thorough
def test_effects_of_the_structure_need_no_frequency(tmp_path):
    own = tmp_path / "frame.py"
    own.write_text(OWN_STRUCTURE)
    frame = catalogue([own])["frame"]({"amplitude_deg": 1e-3, "phase_rad": 0.7}, CONSTANTS)
    report = run(tmp_path, RIG, grid(4, 5, 2), RigModel(effects=(*RIG.effects, frame)), "--effects", own)
    assert [entry["name"] for entry in report["effects"]] == ["frame"]
    assert report["effects"][0]["parameters"]["amplitude_deg"]["value"] == pytest.approx(1e-3, rel=0.05)


@pytest.mark.parametrize("after", [1.0, 2.0])
def test_an_effect_without_which_runs_are_predicted_worse_is_not_gone(after, monkeypatch):
    """Where the load scatters no backlash was seen: "the rig stays as it is" stood beside a gap without it."""
    core = importlib.import_module("st_codegen.reconcile.core")
    whole, without = core._reconcile, SimpleNamespace(held_out=SimpleNamespace(before=1.0, after=after))
    monkeypatch.setattr(core, "gone", lambda *_: ("backlash",))
    monkeypatch.setattr(core, "_reconcile", lambda *_: without)
    found = whole(RIG, KNOWN, None, core.Examined(observed(RIG, grid(4, 4, 2))))
    assert (found is without) == (after == 1.0)
    assert found is without or (found.new_rig is found.rig and not found.conclusions.retuned)
