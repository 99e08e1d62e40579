"""Findings in words that a maintenance engineer understands."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from st_codegen.campaign.orders import listed
from st_codegen.errors import at_most, counted
from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.reconcile.data.observations import first_of, rms_deg, whole_percent
from st_codegen.reconcile.fit.state import Piece
from st_codegen.reconcile.judge.claims import ONLY_FLANKS, Claim
from st_codegen.reconcile.judge.lookalikes import told_sides
from st_codegen.reconcile.judge.misread import Misread
from st_codegen.reconcile.outcome import Outcome
from st_codegen.reconcile.rest.structure import in_both_directions, told_beside
from st_codegen.reconcile.rest.unexplained import beside_the_rigs
from st_codegen.reconcile.result import Reconciliation, TakenBack
from st_codegen.reconcile.search.peaks import where_there
from st_codegen.reconcile.search.surroundings import angle_of_rest
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions, Effect
from st_codegen.rig.effects.base import ARCMIN, BACKWARD, Phasor
from st_codegen.rig.effects.modulation import CarrierModulation
from st_codegen.rig.effects.resonance import LOAD_PART, StructuralResonance
from st_codegen.rig.model import RigModel

VERDICT_TEXT = {
    Outcome.EXPLAINED: "What differs is named; no pattern over the conditions was found in what is left.",
    Outcome.PARTLY_EXPLAINED: "Part of what differs is named; for the rest no effect of the catalogue was found.",
    Outcome.NOTHING_MISSING: "Nothing was found missing: no pattern over the conditions was found in the differences.",
    Outcome.UNEXPLAINED: "Something differs for which no effect of the catalogue was found.",
}


def verdict_text(result: Reconciliation) -> str:
    """The verdict in words."""
    few, is_named = result.data.few_points, result.verdict is Outcome.PARTLY_EXPLAINED
    # a dozen runs follow more than one law
    named = "What is named fits, and other causes may fit so few operating points" if few else "What differs is named"
    if result.unexplained and all(one.would_be for one in result.unexplained):
        left = f"{named}; what is left" if is_named else "What differs"
        return f"{left} has a faint pattern, which may be noise that lasts over runs."
    if result.unexplained and all(one.is_scatter for one in result.unexplained):
        which = f"{named}; runs" if is_named else "Runs"
        known = "that is known" if result.data.spectral_deg is None else "within their curves"
        how = "without a pattern over the conditions: more noise"
        if any(one.has_levels for one in result.unexplained):
            how = "by more at some conditions than at others: more noise there"
        return f"{which} differ by more than the noise {known}, {how}, or something missing."
    text = VERDICT_TEXT[result.verdict]
    if is_named and few:
        rest = "for the rest no effect of the catalogue was found"
        return f"{named}; {rest if result.unexplained else 'they do not tell whether what is left is noise'}."
    if result.verdict is Outcome.UNEXPLAINED and few:
        return "Something differs; so few operating points name no effect of the catalogue for it."
    if result.verdict not in (Outcome.EXPLAINED, Outcome.NOTHING_MISSING):
        return text
    also = [_hidden(result)]
    rows = {row for row, _ in result.noise.suspects}.union(*(mistake.rows for mistake in result.mistakes))
    if rows:
        runs = {int(result.data.number_of_run[row]) for row in rows}
        whole = len(rows) == np.isin(result.data.number_of_run, list(runs)).sum()
        bad, what = (len(runs), "run") if whole else (len(rows), "curve")
        also.append(f"a {what} that seems bad is left out" if bad == 1 else f"{bad} {what}s that seem bad are left out")
    return "; ".join([text.removesuffix("."), *filter(None, also)]) + "."


def _hidden(result: Reconciliation) -> str:
    """What may hide beside a verdict that nothing more was found; empty where nothing is known of it."""
    # what a correction takes from the orders it takes above them as well
    if result.data.beyond_deg and not result.mistakes:
        beyond = result.data.beyond_deg
        return f"but beside the orders that were looked at the curves hold {beyond:.2g} deg RMS, more than noise"
    if _lasts(result):
        floor, near = result.held_out.noise_floor, result.data.neighbours_deg
        return (
            f"but what is left, {floor:.2g} deg, is more than the noise from sample to sample, {near:.2g} deg: noise "
            "that lasts over samples, or a wave that is none of the orders looked at, as a hum is"
        )
    return "the runs are too few to tell small ones" if result.data.few_points else ""


def _lasts(result: Reconciliation) -> bool:
    """Whether what is left of samples over time is more than the noise from one to the next, and than the rounding."""
    floor, near = result.held_out.noise_floor, max(result.data.neighbours_deg, result.data.rounded_deg)
    return result.data.angle_rad is not None and floor > SETTINGS.clearly_larger * near


#: what a noise floor is made of, by the kind of contrast
_FLOOR = {
    "plane": "the scatter of runs about the plane through their neighbours",
    "speed": "the scatter of runs about the line through their neighbours in speed",
    "torque": "the scatter of runs about the line through their neighbours in torque",
    "temperature": "the scatter of runs about those at other temperatures",
    "repeats": "how far repeated runs differ",
    "smooth": "what a smooth function of the conditions leaves of the runs",
    "law": "how far runs that are too few for neighbours lie from a line of each direction over the conditions",
    "rig": "what the rig leaves of the runs, which are too few to tell more",
}


def floor_text(result: Reconciliation) -> str:
    """What the noise floor is made of, and so what it cannot tell from noise."""
    if result.data.angle_rad is not None:
        if not _lasts(result):
            if result.data.rounded_deg > SETTINGS.least_of_rounding * result.held_out.noise_floor:
                return (
                    f"The floor holds what the angles are rounded by, {result.data.rounded_deg:.2g} deg RMS: smaller "
                    "waves cannot be told from it."
                )
            return "The floor is the noise from sample to sample."
        return (
            "The floor is the rest of the samples; from one to the next they differ as noise of "
            f"{at_most(result.data.neighbours_deg)} deg would at most: it holds noise that lasts over samples, or what "
            "lasts and has no line among the orders that were looked at."
        )
    kinds = list(dict.fromkeys(result.noise.kinds))
    parts = []
    for kind in kinds:
        orders = [str(k) for k, own in zip(result.data.orders, result.noise.kinds, strict=True) if own == kind]
        which = "" if len(kinds) == 1 else f" (orders {first_of(orders, 8)})"
        parts.append(_FLOOR[kind] + which)
    of_runs = dict(zip(result.data.orders.tolist(), result.noise.floor_rms.tolist(), strict=True))
    if any(one.order == 0 and one.noise_floor > of_runs[0] for one in result.orders):
        parts.append("of the mean no less than what the rig says that runs differ by, as far as they do")
    text = f"The floor is {'; '.join(parts)}"
    if not result.data.repeated:
        text += ". No two runs have equal conditions: structure finer than their spacing counts as noise there"
    if result.floor_is_bound:
        also = "what is unexplained" if result.unexplained else "what differs between so few runs"
        text += f". It may be smaller: {also} may be in it as well"
    if held := result.scatter_in_floor_deg:
        text += f". It holds what runs differ by in the lowest orders without a pattern ({held:.2g} deg RMS)"
    if more := result.scatter_beside_floor_deg:
        differ = "else differ" if held else "differ"
        text += f". If what runs {differ} by without a pattern ({more:.2g} deg RMS) is noise, it adds to the floor"
    if result.data.spectral_deg is not None:
        of = "the noise between the orders of their own curves"
        if told_beside(result.data).any():
            of = "what the runs differ by in the orders beside them"
        text += f". Orders above 5 were also compared with {of}"
    return text + "."


def _empirical(rig: RigModel) -> list[Effect]:
    """What a rig has without a name."""
    return [effect for effect in rig.effects if effect.name == "empirical"]


def between_text(result: Reconciliation) -> str:
    """What the held-out gap holds beside what held-out runs leave, or cannot hold; empty for most."""
    texts = []
    if len(_empirical(result.new_rig)) > len(_empirical(result.rig)):
        texts.append("The gaps are those of the new rig without the formulas that --empirical adds to it.")
    if result.data.few_points:
        texts.append("The gap on held-out runs is a lower bound: so few runs say nothing about points between them.")
    elif result.untested:
        texts.append(
            f"The gap on held-out runs is a lower bound: the levels of {' and '.join(result.untested)} are too few to "
            "leave one out, so that nothing says what lies between them."
        )
    elif any(one.frequency_Hz for one in result.data.hums):
        texts.append(
            "The gap on held-out runs is a lower bound: at other speeds the wave of one frequency makes other orders."
        )
    elif result.few_test:
        texts.append(
            "The gap on held-out runs is a lower bound: what the new rig takes off lies at so few of their operating "
            f"points, or speeds (worth {result.testers:.1f} equal ones), that they say little about others."
        )
    elif result.held_out_scatters and not result.few_carry:
        texts.append(
            f"The gap on held-out runs comes from {counted(result.unseen_curves, 'curve')}: of others it may be "
            "another."
        )
    elif result.held_out_scatters:
        texts.append(
            f"The gap on held-out runs is a lower bound: few runs carry most of it (it scatters as if there were "
            f"{result.carriers:.1f} curves), and between the runs there may be more such places."
        )
    gap = result.held_out.after**2
    # what does not move the gap by more than its scatter is not worth a sentence
    if gap > SETTINGS.worse**2 * (gap - result.between_deg**2):
        texts.append(
            f"Between temperatures that were measured, where nobody knows which frequency a resonance has, the rig may "
            f"be off by {result.between_deg:.3g} deg RMS; the gap on held-out runs holds that."
        )
    return " ".join(texts)


#: orders that are listed so
_MOST_LISTED = 4


def misread_texts(result: Reconciliation) -> list[str]:
    """What would explain changes of the rig as well, or of what is unexplained, and what to do where it is so.

    One sentence for each name.
    """
    found = result.conclusions

    def of_what(one: Misread) -> str:
        """What it would explain."""
        what = "" if found.adds_for(one) else "the change of "
        texts = [f"would explain {what}{', '.join(found.changes_for(one))} as well"] * bool(one.instead_of)
        if one.unexplained:
            orders = sorted(one.unexplained)
            which = f"order{'s' * (len(orders) > 1)} {listed(orders)}" if orders != [0] else "the mean"
            texts.append(f"would leave {one.leaves} of what is unexplained in {which}")
        return " and ".join(texts)

    return [
        f"{one.text} {of_what(one)}: if it is so, --accept {one.reading.name} corrects it"
        for one in {one.reading.name: one for one in reversed(found.misread)}.values()
    ]


def left_text(result: Reconciliation) -> str:
    """What makes most of a held-out gap that is well above the floor, and what is known of it; empty for others."""
    gap, own = result.held_out, result.orders
    if gap.after < SETTINGS.above_floor * gap.noise_floor or not own:
        return ""
    times = gap.after / gap.noise_floor
    if result.data.angle_rad is not None:
        listed = "only waves of the angle that stand out of it are listed"
        return f"The gap on held-out recordings is {times:.3g} noise floors; {listed}.{_few_samples(result)}"
    hums = [hum for hum in result.data.hums if hum.power]
    of_hums = result.data.hum_power([one.order for one in own])
    left = np.maximum(np.array([one.held_out for one in own]) ** 2 - of_hums, 0.0)
    shares = np.concatenate([left, [hum.power for hum in hums]]) / gap.after**2
    alike = in_both_directions(result.target, result.conclusions.final.residual)
    parts = []
    most = int(np.searchsorted(np.cumsum(np.sort(shares)[::-1]), SETTINGS.most_of_gap)) + 1
    most_of_it = [k for n, k in enumerate(np.argsort(-shares)[:most]) if n == 0 or shares[k] >= SETTINGS.least_listed]
    for k in most_of_it[:_MOST_LISTED]:
        if k >= len(own):
            hum = hums[k - len(own)]
            name = f"{hum.order:.1f} periods a turn" if hum.order else f"{hum.frequency_Hz:.4g} Hz"
            parts.append(f"{whole_percent(shares[k])} % of its power is the wave of {name} that was taken out")
            continue
        # what is noise there makes the floor, and not what the gap has beyond it
        if own[k].held_out < SETTINGS.above_floor * own[k].noise_floor:
            continue
        name = f"order {own[k].order}" if own[k].order else "the mean"
        text = f"{whole_percent(shares[k])} % of its power is {name}, {own[k].held_out:.2g} deg RMS"
        if alike[k] > SETTINGS.most_of_gap * own[k].after:
            # what is known of an unexplained mean stands there
            is_open = own[k].order == 0 and all(one.order != 0 for one in result.unexplained)
            moves = ": it moves from run to run by what no effect that was found follows" if is_open else ""
            text += f" (of the {own[k].after:.2g} deg of the fitted runs both directions share {alike[k]:.2g}{moves})"
        parts.append(text)
    return f"The gap on held-out runs is {times:.3g} noise floors: {'; '.join(parts) or 'no order alone makes it'}."


def _few_samples(result: Reconciliation) -> str:
    """Where in the recordings most of what is left stands, if few samples hold it; empty elsewhere."""
    data, power = result.data, result.conclusions.final.residual[:, 0].real ** 2
    assert data.angle_rad is not None
    # the gap is that of all links: of what the servo or the coupling leaves, the reducer's samples say nothing
    if power.sum() < result.held_out.after**2 * len(data) / 2:
        return ""
    ranked = np.argsort(-power)
    count = int(np.searchsorted(np.cumsum(power[ranked]), power.sum() / 2)) + 1
    if count > SETTINGS.few_samples * len(data):
        return ""
    turns = np.exp(1j * data.angle_rad[ranked[:count]])
    place = float(np.rad2deg(np.angle(turns.mean()))) % 360.0
    reach = float(np.rad2deg(np.abs(np.angle(turns * np.exp(-1j * np.deg2rad(place)))).max()))
    largest, label = f"{math.sqrt(power[ranked[0]]):.2g} deg", data.labels[ranked[0]]
    if count == 1:
        looked_at = f"{len(data)} samples that were looked at"
        return f" One of {looked_at} holds half of the power of what is left: {largest}, at {label}."
    where = (
        f", all within {at_most(reach + 0.05)} deg of {place:.1f} deg of the output"
        if reach < SETTINGS.one_place_deg
        else ""
    )
    return (
        f" {count} of {len(data)} samples that were looked at hold half of the power of what is left{where}; the "
        f"largest, {largest}, is at {label}."
    )


def together_text(result: Reconciliation) -> str:
    """What most of the orders that stay unexplained have in common: an angle of the turn, or places; empty for most."""
    orders = [one.order for one in result.unexplained if one.order > 0]
    found = angle_of_rest(result.target, result.conclusions.final.residual, orders)
    if found is not None:
        angle, reach, size = found
        place = (
            "In the mean of all runs, most of what stays unexplained in orders stands at one angle of the output: "
            f"{angle:.0f} deg, within {reach:g} deg on both sides, up to {size:.2g} deg. "
        )
        if result.data.spectral_deg is not None and abs((angle + 180.0) % 360.0 - 180.0) <= reach:
            return (
                f"{place}If the curves begin and end there, an axis may still settle, or a filter run in; else look at "
                "pins, teeth and bearings there, and at the encoder's disc."
            )
        return f"{place}Look at pins, teeth and bearings there, and at the encoder's disc."
    return beside_text(orders, result.rig.orders())


def beside_text(orders: Collection[int], its: Iterable[int]) -> str:
    """What is said of unexplained orders that lie beside those of the rig (`its`); empty where few or others do.

    Those of several orders that change stand apart: a wave between orders is found on a row of them.
    """
    made = set(its)
    beside = beside_the_rigs(orders, made)
    if not beside:
        return ""
    named = ", ".join(map(str, beside))
    if set(range(beside[0], beside[-1])) <= set(orders) | made:
        return (
            f"Unexplained orders {named} lie in one row: so does a wave between orders, above all one whose number of "
            "periods a turn differs from run to run, as that of a motor that slips; or the orders of the rig among "
            "them change once a turn of the output."
        )
    return (
        f"Unexplained orders {named} lie one beside orders of the rig: so they look where these orders change once a "
        "turn of the output, or where the angle is read wrong once a turn."
    )


def taken_back_text(back: TakenBack) -> str:
    """Why the rig stays as it is."""
    return (
        f"taken back: {', '.join(back.names) or 'changed parameters'} explained the runs that were fitted, and others "
        f"worse than before ({back.before:.3g} -> {back.after:.3g} deg); the rig stays as it is"
    )


def words(claim: Claim, result: Reconciliation) -> str:
    """One claim in words."""
    effect = claim.piece.effect
    if effect.name in _TEXTS:
        numbers = {scalar.key: effect.scalar(scalar.key) for scalar in effect.scalars}
        orders = ", ".join(map(str, effect.orders or effect.touched_orders()))
        sizes = {"size": _size(effect.phasors[:1], effect), "by_load": _by_load(effect)}
        if effect.name == "load_dependent_mesh":
            sizes["law"] = _growth(effect, numbers["exponent"], result)
        side = ""
        for one in effect.phasors[:1]:
            forward, backward = (abs(effect.complex_value(one.key, back)) for back in (False, True))
            side = _louder_side(claim, forward, backward, {one.key: 1.0}, "large")
        if effect.values.get("modulated") == 0.0:
            side += "; its sidebands do not follow"
        return _TEXTS[effect.name].format(**numbers, **sizes, title=effect.title, orders=orders) + side
    return _WORDS.get(effect.name, plain)(effect, result)


def form_error(claim: Claim, result: Reconciliation) -> tuple[list[int], float, float] | None:
    """Orders of an effect that keep structure, what stays of them, and what the effect makes there (RMS in deg).

    None where they keep none, or where another finding makes more of them.
    """
    final, own = result.conclusions.final, claim.piece
    left = {s.order for s in result.unexplained} & set(own.effect.touched_orders())
    if not left or result.data.angle_rad is not None:
        return None
    columns, good = np.isin(result.data.orders, sorted(left)), final.target.good

    def rms(values: ComplexArray) -> float:
        return rms_deg(values[good][:, columns], result.data.orders[columns])

    found = [*(c.piece for c in result.conclusions.claims), *(p for p in final.state.pieces if _is_changed(p, result))]
    size = rms(final.explained(own.effect))
    if size < max(rms(final.explained(piece.effect)) for piece in found):
        return None
    unexplained = math.sqrt(sum(s.rms_deg**2 for s in result.unexplained if s.order in left))
    return sorted(left), unexplained, size


def form_text(claim: Claim, result: Reconciliation) -> str:
    """In how far an effect is not quite of its form, in words; empty where it is."""
    error = form_error(claim, result)
    if error is None:
        return ""
    orders, left, size = error
    what = "the mean" if orders == [0] else f"order{'s' * (len(orders) > 1)} {', '.join(map(str, orders))}"
    return (
        f"{left:.2g} deg RMS of {what} stay unexplained, where it makes {size:.2g}: something else is there, or "
        f"its form is not quite the machine's (the errors of its numbers allow for that)"
    )


def _is_changed(piece: Piece, result: Reconciliation) -> bool:
    return any(piece.effect is entry.after for entry in result.conclusions.retuned)


def error_digits(error: float) -> str:
    """A standard error with two digits: one alone is up to a third less than it is (0.0148, said as 0.01)."""
    return f"{float(f'{error:.2g}'):g}"


def _with_its_digits(value: float, error: float) -> str:
    """A signed number with as many digits as its error tells; with one behind the point where it has none."""
    if not math.isfinite(error) or error <= 0.0:
        return f"{value:+.1f}"
    return f"{value:+.{max(1, -math.floor(math.log10(error)))}f} +- {error_digits(error)}"


def plain(effect: Effect, result: Reconciliation) -> str:
    """An effect by its title and orders."""
    orders = f", order {', '.join(map(str, effect.orders))}" if effect.orders else ""
    return f"{effect.title}{orders}"


def _compliance(effect: Effect, result: Reconciliation) -> str:
    stiffness = effect.scalar("stiffness_Nm_per_arcmin")
    twist = float(np.abs(result.data.at.torque_Nm).max()) / stiffness
    load = "a load that keeps its direction" if effect.name == "hanging_load_compliance" else "load"
    return (
        f"the transmission twists under {load}: {stiffness:.0f} N m per arcmin, {twist:.1f} arcmin at the largest "
        "torque"
    )


def _resonance(effect: Effect, result: Reconciliation) -> str:
    """Which order is lifted how far at which speed, and where the mode lies that lifts it."""
    claim = next((claim for claim in result.conclusions.claims if claim.piece.effect is effect), None)
    peaks = None if claim is None else claim.peaks
    at = result.data.at.rows(np.flatnonzero(where_there(effect, result.data.at)))
    frequency = effect.scalar("frequency_Hz") if peaks is None else sum(peaks) / 2
    parts = _lifted(effect, result, at, frequency, is_one_peak=peaks is None)
    one = "one resonance" if len(effect.orders) > 1 else "a resonance"
    where = (
        f"at {frequency:.1f} Hz" if peaks is None else f"near {frequency:.0f} Hz ({peaks[0]:.1f} to {peaks[1]:.1f} Hz)"
    )
    slopes = [("frequency_per_kNm", "per 1000 N m"), ("frequency_per_10K", "per 10 K of oil temperature")]
    moving = state = ""
    if isinstance(effect, StructuralResonance):
        if "levels_off_per_kNm" in effect.values:
            where = _between_loads(effect, at, frequency)
            del slopes[0]
        elif peaks is None:
            where = _where_measured(effect, at)
        moving = "" if claim is None else _heights(claim, effect, at)
        state = f"{effect.state_text} of oil" if effect.state_text else ""
    stderr = {} if claim is None else claim.stderr
    moves = [
        f"by {_with_its_digits(frequency * effect.scalar(key), frequency * stderr.get(key, math.nan))} Hz {per}"
        for key, per in slopes
        if abs(effect.scalar(key)) > SETTINGS.clearly * stderr.get(key, 0.0)
    ]
    moving = (f", which moves {' and '.join(moves)}" if moves else "") + moving
    flanks = f"; {ONLY_FLANKS}" if claim is not None and ONLY_FLANKS in claim.extrapolates else ""
    return f"{', '.join(parts)}: {one} of the structure {where}{moving}{state}{flanks}"


def _lifted(
    effect: Effect, result: Reconciliation, at: Conditions, frequency: float, *, is_one_peak: bool
) -> list[str]:
    """By order of a resonance the measured speed that comes next to it, and how far the order is raised there.

    frequency: Hz, at no load and the reference temperature where the resonance is one peak.
    """
    final = result.conclusions.final
    model = final.state.model()
    without = model.with_effects(other for other in model.effects if other is not effect)
    turn = at.speed_rpm / (60 * effect.constants.reduction_ratio)
    hertz = np.full(len(at), frequency)
    if is_one_peak and isinstance(effect, StructuralResonance):
        hertz = frequency * effect.shift(at.torque_Nm, at.temperature_C)
    parts = []
    for order in effect.orders:
        speed = float(at.speed_rpm[np.abs(order * turn - hertz).argmin()])
        rows = at.rows(np.flatnonzero(at.speed_rpm == speed))
        with_it = np.abs(model.coefficients(rows, [order])).mean()
        alone = np.abs(without.coefficients(rows, [order])).mean()
        is_lifted = alone > 1e-7 and with_it > SETTINGS.lifted * alone
        lifted = f"raised {_times(with_it / alone)}-fold" if is_lifted else "changed"
        parts.append(f"order {order} is {lifted} at {speed:g} rpm")
    return parts


def _times(factor: float) -> str:
    """A factor in words: 1.5 is not twice."""
    return f"{factor:.1f}" if round(factor, 1) < 2.0 else f"{factor:.0f}"


def _between_loads(effect: StructuralResonance, at: Conditions, frequency: float) -> str:
    """Where a mode on no line lies at a low and a high load, of those at which some order comes near it.

    That says more than how it starts.
    """
    orders, turn = np.array(effect.orders), at.speed_rpm / (60 * effect.constants.reduction_ratio)
    hertz = frequency * effect.shift(at.torque_Nm, at.temperature_C)
    reached = (orders.min() * turn.min() < hertz) & (hertz < orders.max() * turn.max())
    loads = np.quantile(np.abs(at.torque_Nm[reached if reached.any() else ...]), (0.1, 0.9), method="nearest")
    oil = float(np.clip(effect.constants.reference_temperature_C, at.temperature_C.min(), at.temperature_C.max()))
    ends = frequency * effect.shift(loads, oil)
    return f"at {ends[0]:.1f} Hz at {loads[0]:g} N m and at {ends[1]:.1f} Hz at {loads[1]:g} N m"


def _where_measured(effect: StructuralResonance, at: Conditions) -> str:
    """The frequency at the least load and the reference temperature, or the measured one next to that.

    Both are said where they move it, if not at none and there.
    """
    load, oil, stands = float(np.abs(at.torque_Nm).min()), effect.constants.reference_temperature_C, ""
    if effect.scalar("frequency_per_kNm") and load:
        stands += f" at {load:g} N m"
    if effect.scalar("frequency_per_10K") and not at.temperature_C.min() <= oil <= at.temperature_C.max():
        oil = float(np.clip(oil, at.temperature_C.min(), at.temperature_C.max()))
        stands += f" at {oil:g} degC"
    return f"at {effect.scalar('frequency_Hz') * float(effect.shift(load, oil)):.1f} Hz{stands}"


def _heights(claim: Claim, effect: StructuralResonance, at: Conditions) -> str:
    """How high the orders of a resonance are together at the lowest and the largest load, and in each direction.

    Empty where loads and directions are alike, or the growth with the load is not clearly more than its error.
    """

    def rms(sign: float, loads: FloatArray) -> float:
        there = replace(at, sign=np.full(len(at), sign), torque_Nm=loads)
        heights = [effect.height(there, place) for place in range(len(effect.orders))]
        return float(np.sqrt((np.abs(heights) ** 2).mean(axis=1).sum()))

    found, signs = "", np.unique(at.sign)
    least, most = float(at.torque_Nm.min()), float(at.torque_Nm.max())
    keys = [key for key in (LOAD_PART, BACKWARD + LOAD_PART) if key in effect.values]
    sides = [key == BACKWARD + LOAD_PART for key in keys]
    growth = math.hypot(*(abs(size) for side in sides for size in effect.complex_values(LOAD_PART, side)))
    error = math.hypot(*(claim.stderr.get(f"{key}[{order}]", 0.0) for key in keys for order in effect.orders))
    if growth > SETTINGS.clearly * error and least < most:
        sizes = [
            math.sqrt(np.mean([rms(sign, np.full(len(at), load)) ** 2 for sign in signs])) for load in (least, most)
        ]
        on_line = f"{sizes[1]:.2g} deg high at {most:g} N m and {sizes[0]:.2g} deg at {least:g} N m"
        found = f", on a line over the load {on_line} (of all its orders)"
    if len(signs) == 2:
        load = float(np.abs(at.torque_Nm).max()) / 1000.0
        units = {"amplitude_deg": 1.0, LOAD_PART: load}
        found += _louder_side(claim, rms(1.0, at.torque_Nm), rms(-1.0, at.torque_Nm), units, "high")
    return found


def _louder_side(claim: Claim, forward: float, backward: float, units: dict[str, float], what: str) -> str:
    """In which direction an effect is clearly more, and how many times; empty where it is in neither.

    units: what the parameters of which a size is made are worth in it: their errors say how much the quiet direction
    may have at most.
    """
    (low, quiet), (high, loud) = sorted([(forward, "forward"), (backward, "backward")])
    front = BACKWARD * (quiet == "backward")
    own = {f"{front}{key}": worth for key, worth in units.items()}
    errors = [error * own[name] for key, error in claim.stderr.items() if (name := key.partition("[")[0]) in own]
    times = high / max(low + SETTINGS.clearly * math.hypot(*errors), 1e-300)
    if not errors or times <= SETTINGS.times_of_one_side:
        return ""
    return f", at least {math.floor(min(times, SETTINGS.most_times))} times as {what} {loud} as {quiet}"


def _sidebands(effect: Effect, result: Reconciliation) -> str:
    mesh, all_sides = effect.orders[0], effect.sidebands() if isinstance(effect, CarrierModulation) else ()
    claim = next((one for one in result.conclusions.claims if one.piece.effect is effect), None)
    told = told_sides(claim.piece, claim.stderr) if claim else set[str]()
    sides = [order for side, order in all_sides if side in told or not told]
    if not any(x for key, x in effect.values.items() if key.endswith("_ratio")):
        stand = "order {} stands beside" if len(sides) == 1 else "orders {} stand beside"
        alike = "a sideband of the carrier does" if len(sides) == 1 else "sidebands of the carrier do"
        return f"{stand.format(listed(sides))} mesh order {mesh} as {alike}, at constant size"
    return f"the carrier modulates mesh order {mesh} and gives it sidebands: {', '.join(map(str, sides))}"


def _friction(effect: Effect, result: Reconciliation) -> str:
    dry, wet = effect.scalar("coulomb_arcmin"), effect.scalar("viscous_arcmin_per_krpm")
    mixed = effect.scalar("stribeck_arcmin")
    parts = [f"{dry:.2g} arcmin dry"] if dry else []
    parts += [f"{wet:.2g} arcmin per 1000 rpm by the oil"] if wet else []
    parts += [f"{mixed:.2g} arcmin that fall with speed as the oil film builds up"] if mixed else []
    return f"friction wind-up: {' and '.join(parts)}"


def _worn(effect: Effect, result: Reconciliation) -> str:
    depth, centre = effect.scalar("depth_arcmin"), effect.scalar("centre_deg")
    return f"a worn sector around {centre:.0f} deg of the output, {depth:.2g} arcmin ({depth * ARCMIN:.2g} deg) deep"


def _defect(effect: Effect, result: Reconciliation) -> str:
    at = result.data.at
    width = effect.scalar("width_deg")
    sizes = []
    for sign, name in ((1.0, "forward"), (-1.0, "backward")):
        load = at.torque_Nm[at.sign == sign].mean() / 1000.0 if (at.sign == sign).any() else 0.0
        height = effect.scalar("height_deg") + effect.scalar("slope_deg_per_kNm") * load
        turning = effect.scalar("turning_deg") + effect.scalar("turning_slope_deg_per_kNm") * load
        sizes += [f"{height + sign * turning:.2g} deg {name}"] if (at.sign == sign).any() else []
    return (
        f"a bump at {effect.scalar('centre_deg') % 360:.1f} deg of the output, about {2 * width:.1f} deg wide and in "
        f"the mean of the runs {', '.join(sizes)} high: not a harmonic"
    )


def _burst(effect: Effect, result: Reconciliation) -> str:
    centre, width = effect.scalar("centre_deg") % 360, 2 * effect.scalar("width_deg")
    at, sizes, follows = result.data.at.rows(result.noise.good), [], False
    for sign, name in ((1.0, "forward"), (-1.0, "backward")):
        there = at.rows(at.sign == sign)
        if not len(there):
            continue
        load = effect.complex_at("slope_deg_per_kNm", there) * there.torque_Nm / 1000.0
        wave = np.abs(effect.complex_at("amplitude_deg", there) + load)
        sizes.append(f"{wave.mean():.2g} deg {name}")
        follows |= bool(np.ptp(wave) > 0.5 * wave.max())
    where = (
        f"at {centre:.1f} deg of the output, over about {width:.1f} deg, in the mean of the runs by {', '.join(sizes)}"
    )
    return (
        f"mesh order {effect.orders[0]} is another {where}{', and follows the load' if follows else ''}, as damaged "
        "teeth or pins make it"
    )


def _size(waves: Sequence[Phasor], effect: Effect) -> float:
    """How large one of some waves of an effect is in the direction that has more of it; 0 without a wave."""
    return max((abs(effect.complex_value(one.key, back)) for one in waves for back in (False, True)), default=0.0)


def _by_load(effect: Effect) -> str:
    """What a load adds to the wave of an effect, in words; empty for nothing."""
    own = [one for one in effect.phasors[1:] if one.key == LOAD_PART]
    grows = effect.values.get("growth_per_kNm")
    if more := _size(own, effect):
        return f" without load, with a part of {more:.2g} deg per 1000 N m"
    return f" without load, and {100.0 * grows:.3g} % more per 1000 N m" if isinstance(grows, float) and grows else ""


def _growth(effect: Effect, power: float, result: Reconciliation) -> str:
    """The power of the load that a mesh order grows with, and its size: for another than 1 at the largest good load."""
    size = _size(effect.phasors[:1], effect)
    if power == 1.0:
        return f": {size:.2g} deg per 1000 N m"
    largest = float(np.abs(result.data.at.torque_Nm[result.conclusions.final.target.good]).max())
    return f" to the power {power:.2g}: {size * (largest / 1000.0) ** power:.2g} deg at {largest:g} N m"


_WAVES = (
    "output_shaft_eccentricity", "encoder_eccentricity", "output_shaft_ovality", "crank_misalignment",
    "cycloid_tooth_error", "pin_error", "input_shaft_misalignment",
)  # fmt: skip
#: effects that their numbers alone say
_TEXTS = {
    **dict.fromkeys(_WAVES, "{title}: order {orders} of {size:.2g} deg{by_load}"),
    "load_dependent_mesh": "order {orders} grows with the torque{law}",
    "backlash": "{gap_arcmin:.2g} arcmin of backlash between the flanks",
    "thermal_drift": "the mean drifts by {drift_arcmin_per_K:.2g} arcmin a kelvin of oil temperature",
    "measurement_delay": "the measuring chain is late: delay {delay_us:.0f} us, skew of the encoders {skew_us:.1f} us",
}
_WORDS: dict[str, Callable[[Effect, Any], str]] = {
    "torsional_compliance": _compliance,
    "hanging_load_compliance": _compliance,
    "structural_resonance": _resonance,
    "carrier_modulation": _sidebands,
    "friction_windup": _friction,
    "wear": _worn,
    "local_defect": _defect,
    "local_mesh_defect": _burst,
}
