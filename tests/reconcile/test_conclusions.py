"""What is concluded from a fit: changed parameters, errors of what no run sees, a resonance placed by its peaks."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.reconcile.core import reconcile_observations
from st_codegen.reconcile.data.noise import estimate
from st_codegen.reconcile.fit.fitting import fit
from st_codegen.reconcile.fit.state import OFFSET, State, piece_of
from st_codegen.reconcile.fit.target import FitData, groups_of
from st_codegen.reconcile.joint import run as joints
from st_codegen.reconcile.joint.reading import JointRecording
from st_codegen.reconcile.judge import conclusions
from st_codegen.reconcile.judge.claims import ONLY_FLANKS, Conclusions, Retuned
from st_codegen.reconcile.judge.conclusions import conclude, settled
from st_codegen.reconcile.judge.lookalikes import (
    by_order_alone,
    doubted,
    extrapolates,
    is_a_knee,
    left_of_a_response,
    may_be_a_skirt,
    may_be_another_drag,
    may_be_another_power,
    may_be_of_a_law,
    of_its_order,
    of_its_shape,
)
from st_codegen.reconcile.judge.retuned import changes, with_piece_held
from st_codegen.reconcile.plan import next_runs
from st_codegen.reconcile.report.findings import Finding, share_text
from st_codegen.reconcile.rest.lasting import alike
from st_codegen.reconcile.rest.structure import is_lacking, loud_and_foreign
from st_codegen.reconcile.rest.suspects import bad_runs, excused
from st_codegen.reconcile.search.candidates import Search, variants
from st_codegen.reconcile.search.peaks import (
    Frequencies,
    bracket,
    chance_of_bracket,
    is_of_one_speed,
    lost_over_the_speed,
    spread,
)
from st_codegen.reconcile.search.plausible import (
    at_two_frequencies,
    bounds_met,
    is_its_own,
    is_no_form_error,
    lack_of_forms,
    law_holds,
)
from st_codegen.reconcile.search.states import in_their_forms
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions
from st_codegen.rig.model import RigModel
from st_codegen.threads import one_thread

from .test_core import KNOWN, RIG, SIGMA, effect, grid, observed


def fitted(rig, data):
    noise = estimate(data, data.values - data.observed(rig.coefficients(data.at, data.model_orders())))
    target = FitData(data, noise.sigma, noise.good, groups_of(data.at))
    return fit(target, State(rig, 0.0, tuple(piece_of(e, added=False, origin=e) for e in rig.effects)))


def with_values(rig, number, **values):
    effects = list(rig.effects)
    effects[number] = effects[number].with_values({**effects[number].values, **values})
    return RigModel(effects=tuple(effects))


@pytest.mark.parametrize(("upper", "alone"), [(0.2, False), (0.0, True)])
def test_two_sidebands_are_company_and_one_is_none(upper, alone):
    values = {"lower_ratio": 0.1, "lower_phase_rad": 0.2, "upper_ratio": upper, "upper_phase_rad": 0.3}
    sidebands = effect("carrier_modulation", order=39, **values)
    piece = piece_of(sidebands, added=True, origin=sidebands)
    assert by_order_alone(SimpleNamespace(state=SimpleNamespace(pieces=[piece])), piece) is alone


@pytest.mark.parametrize(("load", "alone"), [({}, True), ({"slope_deg_per_kNm": 1e-4, "slope_phase_rad": 0.1}, False)])
def test_three_waves_a_turn_that_no_load_changes_are_no_name_of_the_cranks_alone(load, alone):
    """A bump that moved, and noise that wandered, were cranks that do not share the load evenly, and nothing else."""
    cranks = effect("crank_misalignment", amplitude_deg=1e-3, phase_rad=0.2, **load)
    piece = piece_of(cranks, added=True, origin=cranks)
    final = SimpleNamespace(state=SimpleNamespace(pieces=[piece]))
    assert by_order_alone(final, piece) is alone
    assert bool(of_its_order(final, piece)) is alone


def test_a_shift_that_noise_could_be_is_no_changed_parameter():
    # four tenths of the noise of a coefficient: seven standard errors of 252 independent runs, two of runs that share
    # noise with their next five
    truth = with_values(RIG, 2, amplitude_deg=1e-3 + 0.4 * SIGMA, backward_amplitude_deg=5e-4 + 0.4 * SIGMA)
    assert not changes(fitted(RIG, observed(truth, grid())))


@pytest.mark.parametrize(
    ("number", "values"),
    [
        (2, {"amplitude_deg": 1e-3 + 2 * SIGMA}),
        # 0.8 noises at the largest torque, half of that RMS: noise that lasts does not follow the torque
        (0, {"stiffness_Nm_per_arcmin": 454.0 * (1 + 0.8 * SIGMA / (1800 / 454 / 60))}),
    ],
)
def test_a_changed_parameter_is_found(number, values):
    assert list(changes(fitted(RIG, observed(with_values(RIG, number, **values), grid())))) == [number]


@pytest.mark.parametrize(("noises", "is_open"), [(2, True), (4, False)])
def test_a_change_no_larger_than_what_noise_hides_of_a_law_may_be_one(noises, is_open):
    """A delay in proportion to the speed, of some orders alone, was said to have changed amplitudes by a noise."""
    truth = with_values(RIG, 2, amplitude_deg=1e-3 + noises * SIGMA)
    final = fitted(RIG, observed(truth, grid()))
    assert may_be_of_a_law(final, final.state.pieces[2]) is is_open


@pytest.mark.parametrize(("noises", "power", "is_open"), [(40, 1.0, False), (40, 2.0, True), (1, 1.0, True)])
def test_a_mesh_that_follows_another_power_of_the_load_as_well_may_be_something_else(noises, power, is_open):
    """Of 26 runs a square law was said to grow by so much per 1000 N m, and nothing else."""
    at, slope = grid(6, 5, 1), effect("load_dependent_mesh", order=39, slope_deg_per_kNm=noises * SIGMA)
    data = observed(RIG, at)
    data.values[:, list(data.orders).index(39)] += noises * SIGMA * (at.torque_Nm / at.torque_Nm.max()) ** power
    first = fitted(RIG, data)
    joint = fit(first.target, first.state.with_piece(piece_of(slope, added=True)))
    assert may_be_another_power(joint, joint.state.pieces[-1]) is is_open


def test_what_several_parameters_of_the_rig_may_have_made_is_not_unexplained():
    """Far from 0 N m friction and play look alike: neither is sure, and both left structure when they were held."""
    beside = effect("backlash", gap_arcmin=0.5, seating_torque_Nm=150.0)
    rig, truth = (
        RigModel(effects=(*RIG.effects, beside, effect("friction_windup", coulomb_arcmin=size)))
        for size in (0.25, 0.275)
    )
    at = grid()
    joint = fitted(rig, observed(truth, at.rows(at.torque_Nm > 200), sigma=10 * SIGMA))
    assert not changes(joint)
    found = conclude(rig, joint, KNOWN)
    (one,) = found.retuned
    # in this noise a torque that is read wrong would do as well
    assert {one.before.name, *one.alternatives} == {"backlash", "friction_windup", "misread_torque"}
    assert not is_lacking(found.final.target, found.final.residual).any()


def test_no_parameter_of_the_rig_takes_what_the_rig_has_no_form_for():
    """Twice the order of the carrier, on an order of the rig: what no change of it explains stays unexplained."""
    at = grid()
    data = observed(RIG, at)
    data.values[:, 4] += 3 * SIGMA * np.cos(np.pi * at.speed_rpm / 340)
    found = conclude(RIG, fitted(RIG, data), KNOWN)
    assert found.retuned == ()
    assert is_lacking(found.final.target, found.final.residual).tolist() == [False] * 4 + [True] + [False] * 2


def test_an_offset_counts_from_its_size_on():
    at = grid()
    for shift, expected in ((0.3 * SIGMA, False), (3 * SIGMA, True)):
        moved = RigModel(zero_offset_deg=shift, effects=RIG.effects)
        assert (OFFSET in changes(fitted(RIG, observed(moved, at)))) is expected


def test_what_no_run_sees_has_a_large_error():
    """With all torques at 600 N m and above the seating torque cannot be seen: its error is what the rig's own says."""
    at = grid()
    at = Conditions(at.sign, at.speed_rpm, 600 + at.torque_Nm * 2 / 3, at.temperature_C)
    rig = RigModel(effects=(*RIG.effects, effect("backlash", gap_arcmin=1.0, seating_torque_Nm=25.0)))
    result = fitted(rig, observed(rig, at))
    place = result.state.slices()[-1].stop - 1
    # a value of the rig is believed to its own size before the data speak
    assert np.sqrt(result.covariance[place, place]) == pytest.approx(25.0, rel=1e-6)


@pytest.mark.parametrize(("excess", "loud"), [(1.8, []), (2.2, [0, 2])])
def test_orders_are_loud_beyond_the_scatter_of_their_power(excess, loud):
    """Twice the square root of the rows, where these are many: both parts of a coefficient have a noise of one."""
    search = Search(KNOWN, fitted(RIG, observed(RIG, grid(), orders=(1, 39, 40))))
    rows = len(search.data)
    assert excess * np.sqrt(rows) > SETTINGS.order_gain
    power = 2.0 + np.array([excess, 0.0, excess]) / np.sqrt(rows)
    fit = replace(search.fit, residual=np.sqrt(power / search.scorer.weights).astype(complex))
    found = Frequencies(KNOWN["structural_resonance"], fit, search.scorer.weights, search.scorer.powers)
    assert found.orders == [1, 39, 40] and found.loud == loud


def test_free_keys_stand_in_the_order_of_the_catalogue():
    """That of a set differs from process to process, and a report must not."""
    search = Search(KNOWN, fitted(RIG, observed(RIG, grid(4, 4, 2))))
    for candidate in search.all():
        if candidate.number is None and candidate.piece.effect.orders_key is None:
            keys = [key for key in candidate.piece.effect.values if key in candidate.piece.free]
            order = candidate.piece.effect.known_keys()
            assert keys == sorted(keys, key=order.index), candidate.name


def test_the_falling_part_of_friction_comes_with_the_constant_one():
    for keys in variants(KNOWN["friction_windup"], True):
        assert ("stribeck_arcmin" in keys) <= ("coulomb_arcmin" in keys)
        assert ("stribeck_arcmin" in keys) == ("stribeck_speed_rpm" in keys)
        assert "stribeck_exponent" not in keys


@pytest.mark.parametrize("gap_arcmin", [0.0, 0.5])
def test_an_addition_that_explains_nothing_beside_the_rest_is_no_finding(monkeypatch, gap_arcmin):
    """It said "0 arcmin of backlash between the flanks", of a play that the compliance of the rig had made up for."""
    play = effect("backlash", gap_arcmin=gap_arcmin, seating_torque_Nm=60.0)
    known = fitted(RIG, observed(RigModel(effects=(*RIG.effects, play)), grid()))
    state = known.state.with_piece(piece_of(play, added=True))
    monkeypatch.setattr(conclusions, "founded", lambda *_: (SimpleNamespace(p=0.0, size_in_noise=9.0), True))
    monkeypatch.setattr(conclusions, "bounds_met", lambda _: [])
    found = conclude(RIG, fit(known.target, state), KNOWN)
    assert len(found.claims) == (gap_arcmin > 0.0)


@pytest.mark.thorough
@pytest.mark.parametrize("sigma", [2e-5, 2e-4])
def test_what_the_free_numbers_of_the_rig_explain_beside_an_addition_is_not_explained_by_it(sigma):
    """A mean that jumps at 800 rpm was a late chain, which left four times what it took off once the rig was held."""
    friction = effect("friction_windup", coulomb_arcmin=0.2, viscous_arcmin_per_krpm=0.03, viscosity_decay_per_K=0.04)
    play = effect("backlash", gap_arcmin=0.4, seating_torque_Nm=50.0)
    rig, at = replace(RIG, effects=(*RIG.effects, friction, play)), grid(6, 4, 2)
    data = observed(rig, at, (0, 1, 2, 39, 40, 78), sigma=sigma)
    jumps = at.sign * 4e-3 * np.tanh((at.speed_rpm - 800.0) / 50.0)
    result = reconcile_observations(rig, replace(data, values=data.values + np.outer(jumps, data.orders == 0)), KNOWN)
    assert not result.conclusions.claims and [one.order for one in result.unexplained] == [0]


def test_of_an_addition_that_fails_what_comes_on_top_of_it_goes_first(monkeypatch):
    """Two slow runs may refuse how friction falls with speed; that there is friction all others say."""
    friction = effect("friction_windup", coulomb_arcmin=0.14, viscous_arcmin_per_krpm=0.01)
    known = fitted(RIG, observed(RigModel(effects=(*RIG.effects, friction)), grid()))
    falling = {"stribeck_arcmin": 0.1, "stribeck_speed_rpm": 400.0, "stribeck_exponent": 1.6}
    more = piece_of(friction.with_values(friction.values | falling), added=True)
    judged = conclusions.founded

    def founded(without, with_it, number, places):
        evidence, stands = judged(without, with_it, number, places)
        return evidence, stands and "stribeck_arcmin" not in with_it.state.pieces[number].effect.values

    monkeypatch.setattr(conclusions, "founded", founded)
    found, standing = settled(fit(known.target, known.state.with_piece(more)))
    ((number, one),) = standing.items()
    assert one.stands
    assert set(found.state.pieces[number].effect.values) == {"coulomb_arcmin", "viscous_arcmin_per_krpm"}


@pytest.mark.parametrize("is_known", [False, True])
def test_a_run_is_not_bad_for_what_the_form_of_a_new_effect_may_lack(is_known):
    """Both directions of a run have 8 % less friction than all others: for friction that the rig knew, too little."""
    friction = effect("friction_windup", coulomb_arcmin=0.3)
    data = observed(RigModel(effects=(*RIG.effects, friction)), grid())
    rows = data.runs[100]
    data.values[rows, 0] += 0.08 * 0.3 / 60 * data.at.sign[rows]
    known = fitted(RIG, data)
    piece = piece_of(friction, added=not is_known, origin=friction if is_known else None)
    last = fit(known.target, known.state.with_piece(piece))
    found = bad_runs(data, last.residual, last.target.sigma, np.zeros(len(data.orders), bool), lack_of_forms(last))
    assert set(found) == set(rows if is_known else [])
    noise, nothing = estimate(data, last.residual), np.zeros(len(data.orders), bool)
    noise.good[list(found)] = False
    kept = excused(data, last.residual, noise, nothing)
    assert data.orders[kept].tolist() == ([] if is_known else [0]), "but then the form lacks something there"


@pytest.mark.parametrize("is_near", [False, True])
def test_a_run_is_not_bad_for_a_resonance_of_another_frequency(is_near):
    """One run meets the peak elsewhere, as in a second state; far from the frequency that is no matter of its state."""
    peak = effect("structural_resonance", frequency_Hz=15.0, damping_ratio=0.03, orders=[78], amplitude_deg=[2e-3])
    data = observed(RigModel(effects=(*RIG.effects, peak)), grid(12, 4, 2))
    frequency = 78 * data.at.speed_rpm / 60 / 81
    (number,) = np.flatnonzero(data.orders == 78)
    rows = min(data.runs, key=lambda rows: abs(frequency[rows[0]] - (16.5 if is_near else 24.0)))
    data.values[rows, number] += 1e-3
    known = fitted(RIG, data)
    last = fit(known.target, known.state.with_piece(piece_of(peak, added=True)))
    nothing = np.zeros(len(data.orders), bool)
    found = bad_runs(data, last.residual, last.target.sigma, nothing, lack_of_forms(last))
    assert set(found) == set([] if is_near else rows)
    noise = replace(estimate(data, last.residual), good=~np.isin(np.arange(len(data)), list(found)))
    assert data.orders[excused(data, last.residual, noise, nothing)].tolist() == ([78] if is_near else [])


def test_what_a_few_runs_share_with_their_neighbours_is_said_of_their_order():
    """Three runs that follow each other in speed are off alike: none is bad by itself, and none is noise."""
    data = observed(RIG, grid())
    first = data.runs[40]
    near = [
        rows
        for rows in data.runs
        if data.at.torque_Nm[rows[0]] == data.at.torque_Nm[first[0]]
        and data.at.temperature_C[rows[0]] == data.at.temperature_C[first[0]]
    ][1:4]
    for size, rows in zip((20.0, 25.0, 30.0), near, strict=True):
        data.values[rows, 0] += size * SIGMA * data.at.sign[rows]
    known, nothing = fitted(RIG, data), np.zeros(len(data.orders), bool)
    assert not bad_runs(data, known.residual, np.full_like(known.target.sigma, SIGMA), nothing)
    noise = replace(estimate(data, known.residual), good=np.ones(len(data), bool))
    assert data.orders[excused(data, known.residual, noise, nothing)].tolist() == [0]


@pytest.mark.parametrize("form", [{}, {"stribeck_exponent": 2.0}])
def test_how_suddenly_friction_falls_is_one_of_two_forms(form):
    values = {"coulomb_arcmin": 0.14, "stribeck_arcmin": 0.3, "stribeck_speed_rpm": 400.0}
    truth, begun = effect("friction_windup", **values, **form), effect("friction_windup", **values)
    known = fitted(RIG, observed(RigModel(effects=(*RIG.effects, truth)), grid()))
    found = in_their_forms(fit(known.target, known.state.with_piece(piece_of(begun, added=True))))
    (piece,) = (piece for piece in found.state.pieces if piece.added)
    assert {key: x for key, x in piece.effect.values.items() if key == "stribeck_exponent"} == form
    assert "stribeck_exponent" not in piece.free
    assert piece.effect.scalar("stribeck_arcmin") == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize("is_delay", [True, False])
def test_a_delay_is_not_changed_by_the_orders_of_a_new_effect_alone(is_delay):
    """A delay turns orders 39 and 78; where 78 alone is turned it is the form of the new resonance, off its peak."""
    new = effect("structural_resonance", frequency_Hz=15.0, damping_ratio=0.01, orders=[78], amplitude_deg=[1e-3])
    wave = effect("cycloid_tooth_error", order=78, amplitude_deg=1e-2, phase_rad=1.0)

    def data(delay_us):
        late = effect("measurement_delay", delay_us=delay_us)
        return observed(RigModel(effects=(*RIG.effects, wave, late, new)), grid(), sigma=SIGMA / 10)

    turned, rig = data(500.0), RigModel(effects=(*RIG.effects, wave, effect("measurement_delay", delay_us=250.0)))
    if not is_delay:
        turned.values[:, :-1] = data(250.0).values[:, :-1]
    known, number = fitted(rig, turned), len(rig.effects) - 1
    state = known.state.replaced(number - 1, known.state.pieces[number - 1].held())
    joint = fit(known.target, state.with_piece(piece_of(new, added=True)))
    held = with_piece_held(joint, number)
    assert joint.loss < held.loss - 100.0
    assert is_its_own(joint, joint.state.pieces[number], held) is is_delay


def test_of_a_dozen_runs_both_directions_tell_the_noise():
    """One that seems quieter by chance would be followed by a fit that is weighed by it."""
    random = np.random.default_rng(0)
    speed, torque, oil = (np.tile(random.uniform(*ends, 12), 2) for ends in ((250, 1700), (20, 1350), (25, 35)))
    data = observed(RIG, Conditions.of(np.repeat([1.0, -1.0], 12), speed, torque, oil))
    left = data.values - RIG.coefficients(data.at, data.model_orders())
    left[:12] /= 5.0
    sigma = estimate(data, left).sigma
    assert np.ptp(sigma, axis=0).max() == 0.0


def peaks(**frequency_of_order):
    """One resonance for each order: their target, and a single resonance of all of them."""
    axes = np.meshgrid(np.arange(100.0, 1801.0, 100.0), [0.0, 900.0, 1800.0], [1.0, -1.0])
    at = Conditions.of(axes[2].ravel(), axes[0].ravel(), axes[1].ravel(), 30.0)
    orders = [int(name[1:]) for name in frequency_of_order]
    effects = [
        effect("structural_resonance", frequency_Hz=hertz, damping_ratio=0.02, orders=[k], amplitude_deg=[1e-3])
        for k, hertz in zip(orders, frequency_of_order.values(), strict=True)
    ]
    data = observed(RigModel(effects=tuple(effects)), at, orders=(0, *orders))
    target = FitData(data, np.full(data.values.shape, SIGMA), np.ones(len(at), bool), groups_of(at))
    return target, of_orders(*orders)


def of_orders(*orders):
    """A resonance of some orders, of no size yet."""
    shape = {"frequency_Hz": 54.0, "damping_ratio": 0.02, "amplitude_deg": [0.0] * len(orders)}
    return effect("structural_resonance", orders=orders, **shape)


def bracket_of(**frequency_of_order):
    """What the peaks of all orders say of one frequency."""
    target, whole = peaks(**frequency_of_order)
    return bracket(target, target.data.values, whole)


def test_peaks_bracket_a_frequency():
    """Speeds stand 100 rpm apart; an order is loudest at the one next to its peak, on either side of it half a step."""
    low, high = bracket_of(k156=54.0, k162=54.0, k240=54.0)
    step = {k: k * 100 / 60 / 81 for k in (156, 162, 240)}
    # 54 Hz: order 156 at 1682 rpm, loudest at 1700; order 162 at 1620, at 1600; order 240 at 1094, at 1100
    assert low == pytest.approx(max(16.5 * step[156], 15.5 * step[162], 10.5 * step[240]))
    assert high == pytest.approx(min(17.5 * step[156], 16.5 * step[162], 11.5 * step[240]))
    assert low < 54.0 < high


def test_peaks_of_two_resonances_have_no_bracket():
    assert bracket_of(k156=42.0, k162=54.0) is None


def test_what_is_loud_at_one_speed_in_all_orders_is_no_resonance():
    """Of four orders that peak at 900 rpm two, at 14.4 and 15.0 Hz there, were called a resonance of 14.8 Hz."""
    at_900 = {f"k{k}": k * 900 / 60 / 81 for k in (40, 78, 81, 162)}
    target, _ = peaks(**at_900)
    assert is_of_one_speed(target, target.data.values, of_orders(78, 81), [40, 162])
    # orders beside each other peak at one speed in a resonance, too, and another one may peak there by chance
    for others in ([], [40]):
        assert not is_of_one_speed(target, target.data.values, of_orders(78, 81), others)
    target, _ = peaks(**{**at_900, "k40": 10.0, "k162": 50.0})
    assert not is_of_one_speed(target, target.data.values, of_orders(78, 81), [40, 162])
    # a resonance above the largest speed has all orders loudest there
    target, _ = peaks(k78=40.0, k81=40.0, k162=80.0)
    assert not is_of_one_speed(target, target.data.values, of_orders(78, 81), [162])


def test_orders_far_from_each_other_are_held_against_one_speed_where_runs_are(monkeypatch):
    """All speeds between two orders, in steps of a narrow peak, were 20,000 fits, or too many for numbers."""
    shape = {"orders": [1, 390], "frequency_Hz": 24.0, "damping_ratio": 0.01}
    mode = effect("structural_resonance", amplitude_deg=[1e-3] * 2, **shape)
    at = Conditions.of(np.tile([1.0, -1.0], 20), np.repeat(np.linspace(200, 1700, 20), 2), 500.0, 30.0)
    data = observed(RigModel(effects=(mode,)), at, orders=(0, 1, 390))
    target = FitData(data, np.full(data.values.shape, SIGMA), np.ones(len(at), bool), groups_of(at))
    asked = []
    contribution = type(mode).contribution
    monkeypatch.setattr(type(mode), "contribution", lambda *given: asked.append(1) or contribution(*given))
    fitted = SimpleNamespace(target=target, residual=0.0 * data.values, explained=lambda _: data.values)
    assert np.isfinite(lost_over_the_speed(fitted, mode))
    assert len(asked) < 2 * 20 + 500


@pytest.mark.parametrize(("per_kNm", "is_one"), [(0.0, True), (-0.15, False)])
def test_peaks_that_lie_elsewhere_at_one_load_have_no_bracket(per_kNm, is_one):
    """Of a mode between 17 Hz without a load and 24 Hz it was said that it lies at 22.0 to 22.5 Hz."""
    axes = np.meshgrid(np.arange(100.0, 1801.0, 50.0), [0.0, 0.0, 900.0, 1800.0], [1.0, -1.0])
    at = Conditions.of(axes[2].ravel(), axes[0].ravel(), axes[1].ravel(), 30.0)
    shape = {"orders": [156, 162, 240], "frequency_Hz": 52.0, "damping_ratio": 0.02}
    moves = effect("structural_resonance", amplitude_deg=[1e-3] * 3, frequency_per_kNm=per_kNm, **shape)
    data = observed(RigModel(effects=(moves,)), at, orders=(0, 156, 162, 240))
    target = FitData(data, np.full(data.values.shape, SIGMA), np.ones(len(at), bool), groups_of(at))
    whole = effect("structural_resonance", amplitude_deg=[0.0] * 3, **shape)
    assert (bracket(target, data.values, whole) is not None) == is_one


@pytest.mark.parametrize(("falls_by", "is_one"), [(0.5, True), (0.75, False)])
def test_what_peaks_elsewhere_by_far_under_load_is_no_resonance_that_moves(falls_by, is_one):
    """A wave that grows with the square of the load was a resonance of 17 Hz without a load and of 1.7 Hz under any."""
    axes = np.meshgrid(np.arange(100.0, 1801.0, 50.0), [0.0, 900.0, 1800.0], [1.0, -1.0])
    at = Conditions.of(axes[2].ravel(), axes[0].ravel(), axes[1].ravel(), 30.0)
    law = {"frequency_per_kNm": -100.0 * falls_by, "levels_off_per_kNm": 100.0}
    shape = {"orders": [156, 162, 240], "frequency_Hz": 52.0, "damping_ratio": 0.02}
    moves = effect("structural_resonance", amplitude_deg=[1e-3] * 3, **shape, **law)
    known = fitted(RigModel(effects=()), observed(RigModel(effects=(moves,)), at, orders=(0, 156, 162, 240)))
    joint = fit(known.target, known.state.with_piece(piece_of(moves, added=True)))
    assert at_two_frequencies(known, joint, 0) == is_one


def test_the_peaks_of_a_state_are_those_of_its_temperatures():
    """That the other state peaks elsewhere took the bracket of the real table's from it."""
    axes = np.meshgrid(np.arange(100.0, 1801.0, 50.0), [0.0, 900.0, 1800.0], [20.0, 30.0, 35.0], [1.0, -1.0])
    at = Conditions.of(axes[3].ravel(), axes[0].ravel(), axes[1].ravel(), axes[2].ravel())
    shape = {"orders": [156, 162, 240], "damping_ratio": 0.02, "amplitude_deg": [1e-3] * 3}
    warm = effect("structural_resonance", frequency_Hz=54.0, above_C=25.0, **shape)
    cold = effect("structural_resonance", frequency_Hz=48.0, below_C=25.0, **shape)
    data = observed(RigModel(effects=(warm, cold)), at, orders=(0, 156, 162, 240))
    target = FitData(data, np.full(data.values.shape, SIGMA), np.ones(len(at), bool), groups_of(at))
    for state in (warm, cold):
        low, high = bracket(target, data.values, state)
        assert low < state.scalar("frequency_Hz") < high
    assert bracket(target, data.values, effect("structural_resonance", frequency_Hz=54.0, **shape)) is None


@pytest.mark.parametrize(("is_play", "sigma"), [(True, SIGMA), (False, SIGMA), (False, 20 * SIGMA)])
def test_play_and_a_transmission_that_is_softer_at_low_loads_are_told_apart_where_the_torques_do(is_play, sigma):
    """Play of a transmission without any was stated with 0.98, the surer the less noise there was."""
    loads = np.array([0, 20, 40, 60, 80, 120, 180, 260, 400, 600, 900.0])
    axes = np.meshgrid([300.0, 900.0, 1500.0], [*-loads[1:], *loads], [25.0, 35.0], [1.0, -1.0])
    at = Conditions.of(*(axes[i].ravel() for i in (3, 0, 1, 2)))
    play = effect("backlash", gap_arcmin=0.6, seating_torque_Nm=70.0)
    truth = RigModel(effects=(*RIG.effects, play)) if is_play else RIG
    data = observed(truth, at, sigma=sigma)
    if not is_play:
        softer = -at.sign * np.clip(at.torque_Nm, -90.0, 90.0) * 6e-5
        data = replace(data, values=data.values + softer[:, None] * (data.orders == 0))
    target = FitData(data, np.full(data.values.shape, sigma), np.ones(len(at), bool), groups_of(at))
    pieces = [piece_of(one, added=False, origin=one).held() for one in RIG.effects]
    final = fit(target, State(RIG, 0.0, (*pieces, piece_of(play, added=True))))
    assert is_a_knee(final, final.state.pieces[-1]) is not is_play


@pytest.mark.parametrize(("power", "dry", "is_another"), [(1.7, 0.0, True), (1.0, 0.0, False), (None, 0.05, False)])
def test_drag_that_grows_faster_than_the_speed_may_be_no_friction_of_the_rig(power, dry, is_another):
    """Churned oil was a viscosity that falls by 0.0251 +- 0.0004 a kelvin, for 0.0384, and a film of oil, undoubted."""
    axes = np.meshgrid(
        [200.0, 500.0, 900.0, 1400.0, 2000.0, 2500.0], [0.0, 100.0, 300.0], [10.0, 35.0, 60.0], [1.0, -1.0]
    )
    at = Conditions.of(*(axes[i].ravel() for i in (3, 0, 1, 2)))
    rubs = effect("friction_windup", coulomb_arcmin=0.2, viscous_arcmin_per_krpm=0.03, viscosity_decay_per_K=0.035)
    data = observed(RigModel(effects=(*RIG.effects, rubs)), at)
    thin = 0.0 if power is None else (at.speed_rpm / 1000) ** power * np.exp(-0.0384 * (at.temperature_C - 30.0))
    more = at.sign * (0.06 * thin + dry) / 60
    data = replace(data, values=data.values - more[:, None] * (data.orders == 0))
    target = FitData(data, np.full(data.values.shape, SIGMA), np.ones(len(at), bool), groups_of(at))
    pieces = [piece_of(one, added=False, origin=one).held() for one in RIG.effects]
    of_films = {"stribeck_arcmin": 0.01, "stribeck_speed_rpm": 500.0} if power == 1.7 else {}
    free = piece_of(rubs.with_values({**rubs.values, **of_films}), added=False, origin=rubs)
    final = fit(target, State(RIG, 0.0, (*pieces, free)), steps=SETTINGS.long_steps)
    assert may_be_another_drag(final, final.state.pieces[-1]) is is_another


@pytest.mark.parametrize("is_play", [True, False])
def test_play_of_the_rig_that_changed_and_one_beside_which_the_load_makes_more_are_told_apart(is_play):
    """A power of the load beside the rig's own play was another play, and another stiffness, without any doubt."""
    loads = np.array([0, 20, 40, 60, 80, 120, 180, 260, 400, 600, 900.0])
    axes = np.meshgrid([300.0, 900.0, 1500.0], [*-loads[1:], *loads], [25.0, 35.0], [1.0, -1.0])
    at = Conditions.of(*(axes[i].ravel() for i in (3, 0, 1, 2)))
    play = effect("backlash", gap_arcmin=0.6, seating_torque_Nm=70.0)
    data = observed(RigModel(effects=(*RIG.effects, play)), at)
    more = 6e-4 * (
        np.tanh(at.torque_Nm / 70.0) if is_play else np.sign(at.torque_Nm) * np.abs(at.torque_Nm / 900) ** 0.5
    )
    data = replace(data, values=data.values - (at.sign * more)[:, None] * (data.orders == 0))
    target = FitData(data, np.full(data.values.shape, SIGMA), np.ones(len(at), bool), groups_of(at))
    final = fit(target, State(RIG, 0.0, tuple(piece_of(one, added=False, origin=one) for one in (*RIG.effects, play))))
    assert is_a_knee(final, final.state.pieces[-1]) is not is_play


@pytest.mark.parametrize(
    ("speeds", "orders", "seldom"),
    [
        (18, (156, 162), False),
        (18, (156, 162, 240), True),
        (6, (156, 162, 240), False),
        (6, (78, 117, 156, 162, 240), True),
    ],
)
def test_peaks_that_agree_say_more_the_more_speeds_and_orders_there_are(speeds, orders, seldom):
    """Two of 18 speeds agree in one of ten cases, three in one of 100; with six speeds three do in one of 14."""
    at = Conditions.of(*(axis.ravel() for axis in np.meshgrid([1.0, -1.0], np.linspace(100, 1800, speeds), 0.0, 30.0)))
    data = observed(RIG, at)
    target = FitData(data, np.ones(data.values.shape), np.ones(len(at), bool), groups_of(at))
    chance = chance_of_bracket(target, orders)
    assert (chance < SETTINGS.p_agree) is seldom
    if orders == (156, 162):
        # the second peak is where the first is, or partly in one of the intervals beside it
        assert 1 / 18 < chance < 3 / 18


def test_a_resonance_that_lost_all_its_orders_has_no_peaks_that_agree():
    at = Conditions.of(1.0, np.linspace(100, 1800, 18), 0.0, 30.0)
    data = observed(RIG, at)
    assert chance_of_bracket(FitData(data, np.ones(data.values.shape), np.ones(18, bool), groups_of(at)), ()) == 1.0


def test_spread_of_a_frequency_in_a_bracket_is_that_of_an_equal_distribution():
    assert spread(54.0, (53.0, 55.0)) == pytest.approx(2 / np.sqrt(12))
    values = 53.0 + (np.arange(100_000) + 0.5) * 2e-5
    assert spread(55.5, (53.0, 55.0)) == pytest.approx(np.sqrt(((values - 55.5) ** 2).mean()), rel=1e-6)


def test_linear_algebra_has_one_thread_while_reconciling(monkeypatch):
    """Digits of proposed runs and of joints were those of one number of cores, and busy cores waited for each other."""
    pools, seen = pytest.importorskip("threadpoolctl"), []

    def threads(*_):
        seen.append({pool["num_threads"] for pool in pools.threadpool_info() if pool["user_api"] == "blas"})
        raise InputError("enough")

    monkeypatch.setattr(next_runs, "other_models", threads)
    monkeypatch.setattr(joints, "_joint", threads)
    campaign = SimpleNamespace(data=SimpleNamespace(angle_rad=None), conclusions=SimpleNamespace(final=None))
    joint = JointRecording("", 0.01, {"": np.zeros(1)}, {"": None}, {"": np.zeros(1)})
    with pools.threadpool_limits(limits=2):
        for run, given in (
            (one_thread()(threads), ()),
            (next_runs.next_runs, campaign),
            (joints.reconcile_joints, [joint]),
        ):
            with pytest.raises(InputError, match="enough"):
                run(given)
    assert seen == [{1}, {1}, {1}]


def test_a_small_share_is_told_by_the_gap_of_its_own_orders():
    """Where the mean has most of the gap, a share of it says nothing of an order."""
    finding = Finding("", RIG.effects[0], None, (), (), "", "", 0.002, (3e-3, 4e-4))
    assert share_text(finding, first=True) == "the gap of its orders falls from 0.003 to 0.0004 deg"
    assert share_text(replace(finding, share=0.05), first=True) == "it explains 5 % of the gap"


def test_orders_that_do_not_reach_a_frequency_in_the_measured_speeds_are_said():
    at = grid(5, 3, 2)  # up to 1800 rpm, of 81 to 1: 0.37 turns a second
    joint = SimpleNamespace(target=SimpleNamespace(data=SimpleNamespace(at=at)))
    values = {"frequency_Hz": 50.0, "damping_ratio": 0.02, "amplitude_deg": [1e-3, 1e-3]}
    resonance = piece_of(effect("structural_resonance", orders=[78, 240], **values), added=True)
    remarks = extrapolates(joint, resonance)
    assert "order 78 does not reach the frequency in the measured speeds" in remarks


@pytest.mark.parametrize(("speed_rpm", "met"), [(1012.5, True), (1030.0, True), (1040.0, False), (600.0, False)])
def test_a_resonance_that_was_seen_by_its_flanks_alone_says_so(speed_rpm, met):
    """Two modes of 35.9 and 38.7 Hz, with no run near them, were one of 37.2 Hz, 0.0107 +- 0.0013 deg high."""
    at = replace(grid(2, 3, 2), speed_rpm=np.resize([600.0, speed_rpm], len(grid(2, 3, 2))))
    # order 156 meets 32.5 Hz at 1012.5 rpm, of 81 to 1, and its half-power width ends at 1032.75 rpm
    values = {"frequency_Hz": 32.5, "damping_ratio": 0.02, "amplitude_deg": [1e-3]}
    resonance = piece_of(effect("structural_resonance", orders=[156], **values), added=True)
    fits = [
        SimpleNamespace(target=SimpleNamespace(data=SimpleNamespace(at=at), good=good))
        for good in (np.ones(len(at), bool), at.speed_rpm == 600.0)
    ]
    found = [ONLY_FLANKS in of_its_shape(one, resonance, None) for one in fits]
    assert found == [not met, True]  # a bad run does not count
    # orders that are loudest at measured speeds were met there, and are not those of one oscillator
    assert not any(ONLY_FLANKS in of_its_shape(one, resonance, (30.0, 34.0)) for one in fits)


def test_runs_that_follow_each_other_are_as_alike_whatever_their_size():
    series = np.array([[2.0], [2.0], [-2.0], [-2.0]])  # products 4, -4, 4 over a power of 16
    assert alike([series]) == alike([series, 1e3 * series]) == pytest.approx(0.25)


def test_a_share_counts_the_power_of_a_mean_and_half_the_square_of_a_wave():
    gap, own = np.array([[1.0, 2.0j]]), {"mean": [[1.0, 0.0]], "wave": [[0.0, 2.0j]], "too much": [[3.0, 6.0j]]}
    target = SimpleNamespace(
        data=SimpleNamespace(parts=np.array([1, 2])), good=np.ones(1, bool), residual=lambda _: gap
    )
    final = SimpleNamespace(target=target, explained=lambda name: np.array(own[name]))
    shares = [conclusions._share(RIG, final, SimpleNamespace(effect=name)) for name in own]
    assert shares == pytest.approx([1 / 3, 2 / 3, 1.0])


def with_added(data, *effects):
    """A fit of the rig without its first effect to data, with effects added."""
    rig = RigModel(effects=RIG.effects[1:])
    first = fitted(rig, data)
    state = first.state
    for one in effects:
        state = state.with_piece(piece_of(one, added=True))
    return fit(first.target, state)


@pytest.mark.parametrize("gap", [0.0, 1.0])
def test_what_a_form_may_lack_is_no_effect(gap):
    """A compliance that bends by 6 %: backlash saves loss there, and is an effect only where there is some."""
    at = grid()
    truth = RigModel(effects=(*RIG.effects, effect("backlash", gap_arcmin=gap, seating_torque_Nm=50.0)))
    data = observed(truth, at)
    bend = -0.06 * at.sign * at.torque_Nm / 454 / 60 * np.sin(np.pi * at.torque_Nm / 1800)
    data = replace(data, values=data.values + bend[:, None] * (data.orders == 0))
    spring = effect("torsional_compliance", stiffness_Nm_per_arcmin=454.0)
    without = with_added(data, spring)
    both = with_added(data, spring, effect("backlash", gap_arcmin=0.5, seating_torque_Nm=50.0))
    assert without.loss - both.loss > SETTINGS.order_gain
    assert is_no_form_error(without, both, len(both.state.pieces) - 1) is bool(gap)


def test_a_constant_wave_is_no_resonance():
    """A broad peak saves most of what a constant wave of one order would, and less; where there is a peak, more."""
    at = grid(18, 3, 2)
    hertz = np.linspace(0, 1, 18)[5]
    frequency = 78 * (100 + 1700 * hertz) / 60 / 81
    peak = {"frequency_Hz": frequency, "damping_ratio": 0.1, "orders": [78]}
    start = effect("structural_resonance", **peak, amplitude_deg=[3e-5], phase_rad=[0.0],
                   backward_amplitude_deg=[3e-5], backward_phase_rad=[0.0])  # fmt: skip
    for wave, holds in ((4e-5, False), (start.contribution(at, np.array([78]))[:, 0], True)):
        data = observed(RIG, at)
        data = replace(data, values=data.values + np.where(data.orders == 78, 1.0, 0.0) * np.reshape(wave, (-1, 1)))
        without, both = with_added(data), with_added(data, start)
        assert without.loss - both.loss > SETTINGS.order_gain
        assert law_holds(without, both, len(both.state.pieces) - 1) is holds


@pytest.mark.parametrize("upper", [0.0, 0.3])
def test_sidebands_are_on_both_sides_of_their_mesh_order(upper):
    """One that follows it alone may be a wave from elsewhere that grows with the load as the mesh does."""
    teeth = {"backward_amplitude_deg": 1e-3, "backward_phase_rad": 0.0, "phase_rad": 1.0, "amplitude_deg": 1e-3}
    carrier = effect("cycloid_tooth_error", order=39, **teeth)
    ratios = {"lower_ratio": 0.5, "lower_phase_rad": 0.2, "upper_ratio": upper, "upper_phase_rad": 1.0}
    side = effect("carrier_modulation", order=39, **ratios)
    data = observed(RigModel(effects=(*RIG.effects[:2], carrier, side)), grid(), orders=(0, 1, 36, 39, 42))
    without = fitted(RigModel(effects=(*RIG.effects[:2], carrier)), data)
    both = fit(without.target, without.state.with_piece(piece_of(side, added=True)))
    assert law_holds(without, both, len(both.state.pieces) - 1) is bool(upper)


@pytest.mark.parametrize(("order", "upper", "holds"), [(81, 2e-6, False), (81, 1e-3, True), (39, 2e-6, True)])
def test_of_recordings_a_sideband_without_its_twin_is_no_order_of_the_mesh(order, upper, holds):
    """Twice 39 teeth were a sideband of order 81, whose twin was noise, and no tooth error was named beside it."""
    values = {"lower_deg": 1.5e-3, "lower_deg_phase_rad": 1.0, "upper_deg": upper, "upper_deg_phase_rad": 0.5}
    side = effect("carrier_modulation", order=order, **values)
    piece = piece_of(side, added=True)
    data = SimpleNamespace(angle_rad=np.zeros(3))
    fit_of_samples = SimpleNamespace(state=SimpleNamespace(pieces=[piece]), target=SimpleNamespace(data=data))
    assert law_holds(fit_of_samples, fit_of_samples, 0) is holds
    (said,) = of_its_order(fit_of_samples, piece)
    assert said.startswith("two constant sidebands" if upper == 1e-3 else "one sideband")


def test_what_others_lose_elsewhere_is_no_sign_of_a_change():
    """A change of order 39 that saves nothing there, whatever the fits leave of other orders."""
    data = observed(RIG, grid())
    fits = [fitted(rig, data) for rig in (RIG, with_values(RIG, 1, amplitude_deg=0.0172))]
    worse = replace(fits[0], residual=fits[0].residual + 20 * SIGMA * (data.orders == 1))
    assert is_no_form_error(worse, fits[1])
    assert not is_no_form_error(worse, fits[1], shows=data.orders == 39)


def test_an_addition_that_the_whole_data_refuse_is_taken_back():
    """Beside the true effect stands one that no data need, and one at its bound."""
    data = observed(RIG, grid())
    spring = effect("torsional_compliance", stiffness_Nm_per_arcmin=400.0)
    stiff = effect("hanging_load_compliance", stiffness_Nm_per_arcmin=20000.0)
    last, standing = settled(with_added(data, spring, stiff, effect("pin_error", order=40, amplitude_deg=1e-6)))
    assert [piece.effect.name for piece in last.state.pieces if piece.added] == ["torsional_compliance"]
    assert all(one.stands for one in standing.values())


def test_what_a_motion_excites_is_no_force_beside_a_changed_wave():
    """The two differ by a constant of each order: the wave of the teeth was called changed for it."""
    shape = {"orders": [39, 40], "frequency_Hz": 9.0, "damping_ratio": 0.03}
    motion = effect("structural_resonance", amplitude_deg=[3e-3, 2e-3], phase_rad=[0.4, 2.0], **shape)
    data = observed(RigModel(effects=(*RIG.effects, motion)), grid(18, 3, 2))
    forced = motion.with_values({**motion.values, "static_share": 1.0})
    rig = fitted(RIG, data)
    joint = fit(rig.target, rig.state.with_piece(piece_of(forced, added=True)))
    assert [joint.state.pieces[i].effect.name for i in changes(joint)] == ["cycloid_tooth_error"]
    # the constant of an order that the rig has no wave of was called an error of the pins
    constant = effect("pin_error", order=40, amplitude_deg=2e-3 * 2 * 0.03, phase_rad=2.0)
    both = fit(
        rig.target, rig.state.with_piece(piece_of(forced, added=True)).with_piece(piece_of(constant, added=True))
    )
    for one in (joint, both):
        found = conclude(RIG, one, KNOWN)
        assert not found.retuned
        (claim,) = found.claims
        assert "static_share" not in claim.piece.effect.values


@pytest.mark.parametrize("seed", [1, 3, 6])
def test_a_wave_of_the_rig_tells_a_motion_from_a_force_beside_a_new_wave(seed):
    """A new wave on one of the orders takes up the difference, the rig's own wave on the other one cannot.

    Both forms do as well while that one is free, and which of them is a hair better says nothing.
    """
    motion = effect(
        "structural_resonance", amplitude_deg=[3e-3, 2e-3], phase_rad=[0.4, 2.0],
        orders=[39, 40], frequency_Hz=9.0, damping_ratio=0.02,
    )  # fmt: skip
    constant = effect(
        "pin_error", order=40, amplitude_deg=8e-4, phase_rad=1.0, backward_amplitude_deg=8e-4, backward_phase_rad=-1.0
    )
    truth = RigModel(effects=(*RIG.effects, motion, constant))
    rig = fitted(RIG, observed(truth, grid(18, 3, 2), seed=seed, sigma=10 * SIGMA))
    with_both = rig.state.with_piece(piece_of(motion, added=True)).with_piece(piece_of(constant, added=True))
    found = conclude(RIG, fit(rig.target, with_both), KNOWN)
    assert not found.retuned
    assert "static_share" not in found.claims[0].piece.effect.values


@pytest.mark.parametrize(("share", "seed"), [(0.0, 0), (0.0, 2), (1.0, 1)])
def test_what_excites_a_resonance_is_open_beside_a_new_wave_of_its_order(share, seed):
    """Nothing tells a motion from a force there, so the error of the wave holds what it would be by the other one."""
    heights = {
        "amplitude_deg": [2e-3],
        "phase_rad": [2.0],
        "backward_amplitude_deg": [2e-3],
        "backward_phase_rad": [2.0],
    }
    shape = {"orders": [40], "frequency_Hz": 9.0, "damping_ratio": 0.03, **heights}
    resonance = effect("structural_resonance", **shape, **({"static_share": share} if share else {}))
    constant = effect(
        "pin_error", order=40, amplitude_deg=8e-4, phase_rad=1.0, backward_amplitude_deg=8e-4, backward_phase_rad=-1.0
    )
    truth = RigModel(effects=(*RIG.effects, resonance, constant))
    rig = fitted(RIG, observed(truth, grid(18, 3, 2), seed=seed, sigma=5 * SIGMA))
    other = effect("structural_resonance", **shape, **({} if share else {"static_share": 1.0}))
    with_both = rig.state.with_piece(piece_of(other, added=True)).with_piece(piece_of(constant, added=True))
    found = conclude(RIG, fit(rig.target, with_both), KNOWN)
    for claim, (key, suffix) in zip(found.claims, (("phase_rad", "[40]"), ("backward_amplitude_deg", "")), strict=True):
        true = (resonance if suffix else constant).values[key]
        off = np.abs(np.subtract(claim.piece.effect.values[key], true)).max()
        assert off < 3 * claim.stderr[key + suffix]


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_force_is_no_motion_beside_a_growth_that_did_change(share):
    """Where the growth of a wave had changed as well, the waves of all orders of a resonance were called changed."""
    growth = effect("load_dependent_mesh", order=39, slope_deg_per_kNm=1e-3, phase_rad=0.5)
    more = growth.with_values({**growth.values, "slope_deg_per_kNm": 1.5e-3})
    shape = {"orders": [39, 40], "frequency_Hz": 9.0, "damping_ratio": 0.03, "static_share": share}
    mode = effect("structural_resonance", amplitude_deg=[3e-3, 2e-3], phase_rad=[0.4, 2.0], **shape)
    data = observed(RigModel(effects=(*RIG.effects, more, mode)), grid(18, 3, 2))
    rig = RigModel(effects=(*RIG.effects, growth))
    start = fitted(rig, data)
    other = mode.with_values({**mode.values, "static_share": 1.0 - share})
    joint = fit(start.target, start.state.with_piece(piece_of(other, added=True)))
    found = conclude(rig, joint, KNOWN)
    assert [one.after.name for one in found.retuned] == ["load_dependent_mesh"]
    (claim,) = found.claims
    assert claim.piece.effect.scalar("static_share") == share


def test_of_a_wave_that_changed_beside_a_resonance_errors_hold_both_ways_to_excite_it():
    """A wave that did change was said to be 25 errors off: a force leaves another one than a motion of the base."""
    shape = {"orders": [39], "frequency_Hz": 9.0, "damping_ratio": 0.01}
    mode = effect("structural_resonance", amplitude_deg=[6e-3], phase_rad=[0.4], **shape)
    changed = with_values(RIG, 2, amplitude_deg=1.5e-3, backward_amplitude_deg=8e-4)
    start = fitted(RIG, observed(RigModel(effects=(*changed.effects, mode)), grid(6, 3, 2)))
    joint = fit(start.target, start.state.with_piece(piece_of(mode, added=True)))
    (one,) = conclude(RIG, joint, KNOWN).retuned
    for key, truth in (("amplitude_deg", 1.5e-3), ("backward_amplitude_deg", 8e-4)):
        assert abs(one.after.scalar(key) - truth) < 2.0 * one.stderr[key]
        assert one.stderr[key] > 5 * SIGMA / np.sqrt(len(start.target.data))


@pytest.mark.parametrize(
    ("exponent", "is_by_load", "is_open"), [(2.0, False, True), (1.0, True, True), (1.0, False, False)]
)
def test_a_power_of_the_load_whose_order_is_unexplained_may_be_another_law(exponent, is_by_load, is_open):
    """A wave that grows from 300 N m on alone was said to grow with the square of the load, and nothing else; one that
    turns with the load to grow in proportion."""
    growth = effect("load_dependent_mesh", order=40, slope_deg_per_kNm=1e-3, exponent=exponent)
    final = with_added(observed(RigModel(effects=(*RIG.effects, growth)), grid()), growth)
    found = conclude(RIG, final, KNOWN)
    for left, is_doubted in (([40], is_open), ([], False)):
        (claim,) = doubted(found, left, left if is_by_load else [], RIG.orders(), in_samples=False).claims
        assert ("something_else" in claim.alternatives) == is_doubted


@pytest.mark.parametrize("of_load", [False, True])
def test_waves_that_grow_as_far_below_a_natural_frequency_may_be_no_errors_of_parts(of_load):
    """What a force does to a structure that no speed reaches was a changed wave of the teeth, and nothing else."""
    at = grid(18, 3, 2)
    growth = effect("load_dependent_mesh", order=39, slope_deg_per_kNm=1e-3, phase_rad=0.5)
    rig = RigModel(effects=(*RIG.effects, growth))
    shape = {"orders": [39], "frequency_Hz": 60.0, "damping_ratio": 0.03, "static_share": 1.0}
    size = {"slope_deg_per_kNm": [8e-3]} if of_load else {"amplitude_deg": [8e-3], "phase_rad": [0.4]}
    far = effect("structural_resonance", **({"amplitude_deg": [0.0]} | size | shape))
    changed = with_values(rig, 3, slope_deg_per_kNm=1.4e-3) if of_load else with_values(rig, 2, amplitude_deg=1.4e-3)
    for truth, is_open in ((RigModel(effects=(*rig.effects, far)), True), (changed, False)):
        (one,) = conclude(rig, fitted(rig, observed(truth, at)), KNOWN).retuned
        assert one.after.name == ("load_dependent_mesh" if of_load else "cycloid_tooth_error")
        assert one.is_open == is_open


def test_what_another_order_alone_grows_by_is_no_doubt_of_a_changed_wave():
    """A structure far below its natural frequency moves order 40; the wave of the teeth changed for its own reason."""
    rig = RigModel(effects=(*RIG.effects, effect("pin_error", order=40, amplitude_deg=1e-3, phase_rad=1.0)))
    changed = with_values(rig, 2, amplitude_deg=1.4e-3)
    far = effect(
        "structural_resonance", amplitude_deg=[8e-3], phase_rad=[0.4], orders=[40],
        frequency_Hz=60.0, damping_ratio=0.03, static_share=1.0,
    )  # fmt: skip
    truth = RigModel(effects=(*changed.effects, far))
    final = conclude(rig, fitted(rig, observed(truth, grid(18, 3, 2))), KNOWN).final
    found = {piece.effect.name: may_be_a_skirt(final, piece) for piece in final.state.pieces if piece.free}
    assert found == {"cycloid_tooth_error": False, "pin_error": True}


def test_a_changed_parameter_names_what_would_do_in_its_place():
    """Where all runs have loads that seat the flanks, more dry friction looks like more backlash."""
    at = grid(4, 5, 2)
    loaded = Conditions(at.sign, at.speed_rpm, 600 + at.torque_Nm * 2 / 3, at.temperature_C)
    play = effect("backlash", gap_arcmin=1.0, seating_torque_Nm=25.0)
    rig = RigModel(effects=(*RIG.effects, play))
    truth = RigModel(effects=(*RIG.effects, play, effect("friction_windup", coulomb_arcmin=0.5)))
    (changed,) = conclude(rig, fitted(rig, observed(truth, loaded)), KNOWN).retuned
    assert (changed.after.name, changed.alternatives) == (
        "backlash", ("friction_windup", "misread_torque", "something_else"),
    )  # fmt: skip


def test_a_change_that_the_zero_would_do_as_well_names_it_and_what_is_missing():
    """Of one direction, far from 0 N m, missing friction is more play or another zero, and one hides the other."""
    at = grid(6, 4, 2)
    at = at.rows(np.flatnonzero((at.sign > 0) & (at.torque_Nm > 0)))
    play = effect("backlash", gap_arcmin=0.3, seating_torque_Nm=60.0)
    friction = effect("friction_windup", coulomb_arcmin=0.25, viscous_arcmin_per_krpm=0.02, viscosity_decay_per_K=0.04)
    rig = RigModel(effects=(*RIG.effects, play))
    data = observed(RigModel(effects=(*rig.effects, friction)), at, sigma=3e-4)
    (changed,) = conclude(rig, fitted(rig, data), KNOWN).retuned
    assert changed.after.name == "backlash" and {"friction_windup", "zero_offset_deg"} <= set(changed.alternatives)


@pytest.mark.parametrize(
    ("missing", "chosen"),
    [
        (effect("friction_windup", coulomb_arcmin=0.25), lambda at: at.sign > 0),
        (effect("hanging_load_compliance", stiffness_Nm_per_arcmin=400.0), lambda at: at.torque_Nm == 900),
        (effect("thermal_drift", drift_arcmin_per_K=0.1), lambda at: at.temperature_C == 35),
    ],
)
def test_another_zero_names_what_one_direction_load_or_temperature_does_not_tell_from_it(missing, chosen):
    """Friction of forward runs alone was a zero that moved, and nothing stood beside that."""
    at = grid(8, 5, 3)
    truth = RigModel(effects=(*RIG.effects, missing))
    data = observed(truth, at.rows(np.flatnonzero(chosen(at))), sigma=3e-4)
    found = conclude(RIG, fitted(RIG, data), KNOWN)
    assert found.offset_changed and missing.name in found.of_offset
    apart = observed(RigModel(zero_offset_deg=0.01, effects=RIG.effects), at, sigma=3e-4)
    assert missing.name not in conclude(RIG, fitted(RIG, apart), KNOWN).of_offset


@pytest.mark.parametrize(("one_speed", "is_open"), [(True, True), (False, False)])
def test_a_wave_that_changed_at_one_speed_may_be_what_a_resonance_makes_there(one_speed, is_open):
    """A resonance was teeth of another shape at the only speed, since the rig has a growth with the load of them."""
    grown = effect("load_dependent_mesh", order=39, slope_deg_per_kNm=1e-3)
    rig = RigModel(effects=(*RIG.effects, grown))
    truth = with_values(rig, 2, amplitude_deg=3e-3, backward_amplitude_deg=3e-3)
    at = grid(4, 7, 3)
    data = observed(truth, at.rows(np.flatnonzero(at.speed_rpm == 100)) if one_speed else at)
    (changed,) = conclude(rig, fitted(rig, data), KNOWN).retuned
    assert changed.after.name == "cycloid_tooth_error" and changed.is_open is is_open


@pytest.mark.parametrize(
    ("stiffness", "met"), [(0.5, True), (0.6, False), (454.0, False), (9000.0, False), (2e4, True)]
)
def test_a_stiff_transmission_is_not_at_the_bound_of_soft_ones(stiffness, met):
    """The inverse spans five decades: a thousandth of its range was all that is stiffer than 490 N m per arcmin."""
    piece = piece_of(effect("torsional_compliance", stiffness_Nm_per_arcmin=stiffness), added=True)
    assert bool(bounds_met(piece)) is met


def test_a_burst_of_a_mesh_order_is_asked_for_only_where_the_orders_around_it_were_measured():
    """Of 240 and its sidebands at three a burst of order 312 was named, half a degree high, that nobody measured."""
    few = (0, 1, *range(4, 13), 36, 39, 42, 75, 78, 81, 117, 156, 159, 162, 165, 237, 240, 243)

    burst = effect("local_mesh_defect", order=78, centre_deg=150.0, width_deg=3.0, amplitude_deg=5e-3, phase_rad=0.3,
                   backward_amplitude_deg=5e-3, backward_phase_rad=0.3)  # fmt: skip

    def bursts(orders):
        truth = RigModel(effects=(*RIG.effects, burst))
        search = Search(KNOWN, fitted(RIG, observed(truth, grid(4, 4, 2), orders=orders)))
        return {c.piece.effect.orders for c in search.all() if c.name == "local_mesh_defect"}

    assert bursts(few) == set()
    assert (78,) in bursts((0, 1, *range(60, 97))) <= {(78,), (80,), (81,)}


def test_a_foreign_order_that_single_runs_have_is_lacking_and_not_their_fault():
    """Play makes sums of orders where a resonance is loud: the run is right, and order 57 is unexplained."""
    data = observed(RIG, grid(), orders=(0, 1, 2, 3, 39, 40, 57, 78))
    data = replace(data, spectral_deg=np.full(data.values.shape, SIGMA))
    rows = data.runs[100]
    data.values[np.ix_(rows, [6])] += 20 * SIGMA
    known = fitted(RIG, data)
    left, nothing = known.residual, np.zeros(len(data.orders), bool)
    lacking = loud_and_foreign(known.target, left, RIG.orders())
    assert data.orders[lacking].tolist() == [57]
    sigma = np.full(left.shape, SIGMA)
    assert set(bad_runs(data, left, sigma, nothing)) == set(rows) and not bad_runs(data, left, sigma, lacking)
    assert not loud_and_foreign(known.target, left, [*RIG.orders(), 57]).any()


def test_foreign_orders_of_a_walk_within_the_turn_are_noise():
    orders = (0, 1, 2, 3, 4, 5, 6, 7, 8, 39)
    data = observed(RIG, grid(), orders=orders)
    data = replace(data, spectral_deg=np.full(data.values.shape, SIGMA))
    random, size = np.random.default_rng(1), 30.0 * SIGMA / np.maximum(np.array(orders), 1) * (np.array(orders) > 0)
    known = fitted(RIG, data)
    walk = random.standard_normal((2, *data.values.shape)) * np.where(np.array(orders) == 39, 0.0, size)
    left = known.residual + walk[0] + 1j * walk[1]
    assert not loud_and_foreign(known.target, left, RIG.orders()).any()
    left[:, 7] *= 3.0
    assert data.orders[loud_and_foreign(known.target, left, RIG.orders())].tolist() == [7]


@pytest.mark.parametrize(
    ("left", "is_open"),
    [
        ((1, 2), {0}),
        ((2, 4), {3}),
        ((0, 2), {1}),
        ((1, 4), set()),
        ((2,), set()),
        ((4, 5, 6), {3}),
        ((2, 3, 4), {0, 1}),
    ],
)
def test_what_lies_between_unexplained_orders_is_open(left, is_open):
    """A worn sector reaches all the lowest orders: on two of them it was a stiffness and a crankshaft that changed."""
    own = {
        0: effect("torsional_compliance", stiffness_Nm_per_arcmin=454.0),
        1: effect("output_shaft_eccentricity", amplitude_deg=1e-2),
        3: effect("crank_misalignment", amplitude_deg=1e-3),
    }
    retuned = tuple(Retuned(one, one, {}, 0.0) for one in own.values())
    found = doubted(Conclusions(None, None, (), retuned, True), left, (), (), in_samples=False)
    assert {k for k, one in zip(own, found.retuned, strict=True) if one.is_open} - set(left) == is_open
    # a bump that moved over the campaign had moved the encoders' zero as well
    assert found.offset_is_open is (0 in is_open | set(left))


FRICTION = effect("friction_windup", coulomb_arcmin=0.25)


@pytest.mark.parametrize(("left", "is_open"), [(38, True), (37, False), (40, True), (118, False)])
def test_the_twin_of_an_unexplained_sideband_is_open(left, is_open):
    """Waves of orders 38 and 40 that grew with the load were a changed mesh order 40, and an order 38 with no name."""
    mesh = effect("load_dependent_mesh", order=40, slope_deg_per_kNm=1e-4)
    changed = (Retuned(mesh, mesh, {}, 0.0),)
    found = doubted(Conclusions(None, None, (), changed, False), [left], (), (), in_samples=False)
    assert found.retuned[0].is_open is is_open


@pytest.mark.parametrize("order", [40, 80])
def test_what_an_expression_without_a_cause_lacks_is_no_sure_change(order):
    """Of a wave that grew as the root of the torque --empirical took a proportional one; the rest was another pin."""
    pin = effect("pin_error", order=40, amplitude_deg=1e-3)
    found = doubted(
        Conclusions(None, None, (), (Retuned(pin, pin, {}, 0.0),), False), (), (), (), (), [order], in_samples=False
    )
    assert found.retuned[0].is_open is (order == 40)


@pytest.mark.parametrize("is_open", [True, False])
def test_dry_friction_beside_play_that_may_be_something_else_may_be_so_as_well(is_open):
    """What the play lost above 70 N m the friction gained: only the one was said to be unsure."""
    play = effect("backlash", gap_arcmin=0.3, seating_torque_Nm=60.0)
    changed = (Retuned(play, play, {}, 0.0, is_open=is_open), Retuned(FRICTION, FRICTION, {}, 0.0))
    found = doubted(Conclusions(None, None, (), changed, False), (), (), (), in_samples=False)
    assert [one.is_open for one in found.retuned] == [is_open, is_open]


def test_what_is_smaller_than_its_error_is_no_part_of_a_name(monkeypatch):
    """Friction that falls with speed by 0.07 +- 0.08 arcmin was named beside the dry part."""
    values = {"coulomb_arcmin": 0.5, "stribeck_arcmin": 0.4, "stribeck_speed_rpm": 300.0}
    friction = effect("friction_windup", **values)
    data = observed(RigModel(effects=(*RIG.effects, friction)), grid(12, 5, 2))
    first = fitted(RIG, data)
    joint = fit(first.target, first.state.with_piece(piece_of(friction, added=True)))
    number = len(joint.state.pieces) - 1
    assert not conclusions._top_is_unsure(joint, number)
    large = {"stribeck_arcmin": 0.2}
    monkeypatch.setattr(conclusions, "standard_errors", lambda *_: large)
    assert conclusions._top_is_unsure(joint, number)
    monkeypatch.undo()
    (sure,) = conclude(RIG, joint, KNOWN).claims
    assert "stribeck_arcmin" in sure.piece.effect.values
    monkeypatch.setattr(conclusions, "_top_is_unsure", lambda fit, i: "stribeck_arcmin" in fit.state.pieces[i].free)
    (plain,) = conclude(RIG, joint, KNOWN).claims
    assert "stribeck_arcmin" not in plain.piece.effect.values and "coulomb_arcmin" in plain.piece.effect.values


def test_a_resonance_beside_a_filter_that_was_undone_may_be_what_is_left_of_it():
    """A notch at 40 Hz was undone by straight lines over the frequency, and a resonance at 44.7 Hz was found alone."""
    peak = effect("structural_resonance", orders=(240,), frequency_Hz=44.7, damping_ratio=0.05, amplitude_deg=(1e-4,))
    slope = effect("load_dependent_mesh", order=78, slope_deg_per_kNm=1e-3)
    for corrected, of_peak in ((frozenset(["filter", "sign"]), {"filter"}), (frozenset(["smoothing"]), set())):
        final = SimpleNamespace(target=SimpleNamespace(corrected=corrected))
        assert left_of_a_response(final, peak) == of_peak and not left_of_a_response(final, slope)
