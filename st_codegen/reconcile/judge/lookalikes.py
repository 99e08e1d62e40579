"""What else would look like a finding: mistakes of measuring, and physics, that these data do not tell from it.

Each test of a finding takes the fit and the piece that is missing or has changed.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.fit.fitting import Fit
from st_codegen.reconcile.fit.normal import made_of
from st_codegen.reconcile.fit.state import Piece
from st_codegen.reconcile.judge.claims import ONE_SIDED, ONLY_FLANKS, SOMETHING_ELSE, Conclusions
from st_codegen.reconcile.rest.unexplained import beside_the_rigs
from st_codegen.reconcile.rest.unseen import one_after_the_other
from st_codegen.reconcile.search.evidence import unmeasured_states
from st_codegen.reconcile.search.peaks import frequencies_in, has_a_frequency, lost_over_the_speed, where_there
from st_codegen.reconcile.search.plausible import followers, loud_sides
from st_codegen.reconcile.search.states import is_a_constant_wave, is_one_form, left_by_power
from st_codegen.reconcile.search.surroundings import may_be_a_start
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect, Form, Stage
from st_codegen.rig.effects.resonance import StructuralResonance


def left_of_filters(final: Fit, piece: Piece) -> frozenset[str]:
    """Names of filters that were undone, where waves of an effect may have kept what their responses are off by.

    These are told by all orders together, with straight lines between a dozen places.
    """
    is_wave = any(order > 0 for order in piece.effect.touched_orders())
    return final.target.corrected & {"filter", "smoothing"} if is_wave else frozenset()


def left_of_a_response(final: Fit, effect: Effect) -> frozenset[str]:
    """The name of a filter that was undone, where a missing effect hangs on frequency, as its rest does."""
    return final.target.corrected & {"filter"} if has_a_frequency(effect) else frozenset()


def left_of_a_delay(final: Fit, piece: Piece) -> frozenset[str]:
    """The name of a filter, where waves of an effect may have changed by what it does beside a changed delay.

    A delay is the first term of any filter: a tenth of what it does to these waves may be the next ones.
    """
    delays = [
        one for one in final.state.pieces
        if one.effect.stage is Stage.MEASURING and one is not piece and one.origin not in (None, one.effect)
    ]  # fmt: skip
    own = (np.abs(final.shown_change(piece)) ** 2).sum(axis=0)
    waves = (own > 0.0) & (final.target.data.orders > 0)
    delayed = sum(float((np.abs(final.shown_change(one)[:, waves]) ** 2).sum()) for one in delays)
    return frozenset(["filter"]) if waves.any() and own[waves].sum() < SETTINGS.form**2 * delayed else frozenset()


def left_of_a_smoothing(final: Fit, piece: Piece) -> frozenset[str]:
    """The name of a smoothing over the angle, where waves of an effect lie above a place from which all are smaller.

    One that only a few of the highest orders feel is not told from parts that changed.
    """
    data, good = final.target.data, final.target.good
    old, new = (
        model.coefficients(data.at, data.orders.tolist())[good] for model in (final.state.rig, final.state.model())
    )
    power = (np.abs(old) ** 2).mean(axis=0)
    loud = (data.orders > 0) & (power > SETTINGS.loud_order * (final.target.sigma[good] ** 2).mean(axis=0))
    kept = np.abs((new * old.conj()).mean(axis=0)) / np.maximum(power, 1e-300)
    # from here on all are smaller
    above = loud & (data.orders > max(data.orders[loud & (kept > 1.0 / SETTINGS.column_factor)], default=0))
    own = (np.abs(final.shown_change(piece)[good]) ** 2).sum(axis=0)
    return frozenset(["smoothing"]) if own[~above].sum() < SETTINGS.form**2 * own[above].sum() else frozenset()


def is_a_knee(final: Fit, piece: Piece) -> bool:
    """Whether a twist that is softer at low loads does as well as play: the torques at which that is taken up are few,
    or straight lines with knees, or a power of the load, leave no more of the mean, also beside the rig's own play."""
    seating = piece.effect.values.get("seating_torque_Nm")
    if not isinstance(seating, float):
        return False
    data, good = final.target.data, final.target.good
    torques = np.unique(np.abs(data.at.torque_Nm))
    if int((torques < 2 * seating).sum()) < SETTINGS.torques_of_a_knee:
        return True
    if data.orders[0] != 0:
        return False
    twists = [piece for piece in final.state.pieces if piece.effect.name in ("backlash", "torsional_compliance")]
    twist = sum((final.explained(piece.effect)[good, 0].real for piece in twists), final.residual[good, 0].real)
    torque, sign, sigma = data.at.torque_Nm[good], data.at.sign[good], final.target.sigma[good, 0]

    knees = np.quantile(torques[torques > 0.0], np.linspace(0.0, 1.0, SETTINGS.knees_tried + 1)[:-1])
    slopes = [np.clip(torque, -knee, knee) for knee in np.unique(knees)]
    powers = [np.sign(torque) * np.abs(torque) ** power for power in SETTINGS.powers_of_a_load]
    laws = [sign * law for law in (torque, np.tanh(torque / seating), *powers, *slopes)]
    columns = np.stack([sign, np.ones(len(sign)), *laws], axis=1)
    scaled = columns / np.abs(columns).max(axis=0, initial=1e-300)
    # fits are those of as few rows as there are columns, whatever the number of samples
    beside = twist if piece.added else twist - final.explained(piece.own)[good, 0].real
    corner = np.linalg.qr(np.column_stack([scaled, twist, beside]) / sigma[:, None]).R

    def left(*law: int, of: int = -2) -> float:
        """The loss with a twist that is a sum of laws of the load beside what is in proportion to it, a zero, and dry
        friction; of -1: of the twist beside the rig's own play."""
        wanted = corner[:, of]
        return float(((wanted - made_of(corner[:, [0, 1, 2, *law]], wanted)) ** 2).sum())

    play, knees_at = left(3), range(4 + len(powers), columns.shape[1])
    laws_at = [*((law,) for law in range(4, columns.shape[1])), *combinations(knees_at, 2)]
    others = [left(*law, of=of) for law in laws_at for of in ((-2,) if piece.added else (-2, -1))]
    # what neither explains is as much noise to both
    unit = max(1.0, min(play, *others) / len(sign))
    return min(others) < play + SETTINGS.as_good * unit


def may_be_time(final: Fit, piece: Piece) -> bool:
    """Whether what follows the oil may follow the time: the runs are listed by their temperature, or go through it."""
    data = final.target.data
    by_oil = data.sorted_by == "temperature" or "oil temperature" in one_after_the_other(data)
    return piece.effect.name == "thermal_drift" and by_oil


def may_be_friction(final: Fit, piece: Piece) -> bool:
    """Whether friction that grows with the load would look like a compliance: where the load hardly changes its sign.

    What a load winds up changes its sign with the load, what friction does with the direction alone.
    """
    return piece.effect.name == "torsional_compliance" and _hardly_changes_its_sign(final)


def may_be_of_the_speed(final: Fit, piece: Piece) -> bool:
    """Whether the orders of a resonance may as well all be loud at one speed of the input, as by no frequency."""
    is_of_runs = has_a_frequency(piece.effect) and final.target.data.angle_rad is None
    return is_of_runs and lost_over_the_speed(final, piece.effect) < 1.0


def may_be_of_a_frequency(final: Fit, piece: Piece) -> bool:
    """Whether a resonance would do what any wave does, growth with the load included: at one speed it is constant."""
    is_wave = any(order > 0 for order in piece.effect.touched_orders())
    return is_wave and not np.ptp(final.target.data.at.speed_rpm)


def _hardly_changes_its_sign(final: Fit) -> bool:
    """Whether no load of the other sign is more than a small part of the largest."""
    torques = final.target.data.at.torque_Nm
    of_less = min(float(np.abs(torques[torques * side > 0.0]).max(initial=0.0)) for side in (1.0, -1.0))
    return of_less <= SETTINGS.form * float(np.abs(torques).max(initial=0.0))


def unlike_friction(final: Fit, effects: Sequence[Effect]) -> tuple[str, ...]:
    """What is said of data that do not tell a compliance among some effects from friction that grows with the load."""
    text = (
        f"no load of the other sign is more than {100 * SETTINGS.form:.0f} % of the largest: friction that grows with "
        "the load cannot be told from compliance"
    )
    named = {effect.name for effect in effects}
    return (text,) if "torsional_compliance" in named and _hardly_changes_its_sign(final) else ()


def gains_one_sideband(_: Fit, piece: Piece) -> bool:
    """Whether a modulation gains a constant sideband without its twin: as likely a wave of that order from elsewhere.

    Its ratio moves with it where the runs do not tell what follows the mesh order from what is constant.
    """
    before, after = piece.own, piece.effect
    if after.stage is not Stage.MODULATION or after.values.keys() == before.values.keys():
        return False
    sides = [abs(after.complex_value(key) - before.complex_value(key)) for key in ("lower_deg", "upper_deg")]
    return min(sides) < SETTINGS.form * max(sides)


def told_sides(piece: Piece, stderr: dict[str, float]) -> set[str]:
    """The sidebands of a modulation of which a number is larger than its error leaves open, `lower` and `upper`.

    A side that nothing tells follows whatever else lies on its order.
    """
    sizes = {key for key in stderr if key.endswith(("_ratio", "_deg"))}
    return {key.partition("_")[0] for key in sizes if piece.effect.scalar(key) > SETTINGS.told * stderr[key]}


def may_be_another_power(final: Fit, piece: Piece) -> bool:
    """Whether a mesh order that grows with a power of the load follows another one about as well, or better.

    Beside a constant, where that is free as well; the constant is another one then, too.
    """
    if final.target.data.angle_rad is not None:
        return False
    if is_a_constant_wave(piece.effect):
        beside = (one for one in final.state.pieces if one.free and one.effect.orders == piece.effect.orders)
        return any(may_be_another_power(final, one) for one in beside if one.effect.name == "load_dependent_mesh")
    if piece.effect.name != "load_dependent_mesh":
        return False
    left, count = left_by_power(final, piece), int(final.target.good.sum()) * len(piece.effect.orders)
    power = piece.effect.scalar("exponent")
    own = left(power)
    rivals = min(left(other) for other in SETTINGS.powers_of_a_mesh if not is_one_form(other, power))
    best = min(rivals, *map(left, SETTINGS.any_power))
    # what neither explains is as much noise to both
    margin = SETTINGS.as_good * max(1.0, min(own, best) / max(2.0 * count, 1.0))
    return rivals < own + margin or best < own - margin


def may_be_another_drag(final: Fit, piece: Piece) -> bool:
    """Whether friction whose part with the speed is new, or another one, follows another power of the speed as well.

    Oil that is churned takes more than in proportion to the speed, a film of it less. That power stands beside a dry
    part, and the friction that the rig has, and falls with the oil temperature as an exponential of any rate. Beside a
    skew that drag may make, by another law of the oil, both are halves of it.
    """
    data, good = final.target.data, final.target.good
    if piece.effect.name != "friction_windup" or data.angle_rad is not None or data.orders[0] != 0:
        return False
    change = final.explained(piece.effect) if piece.added else final.shown_change(piece)
    sigma, at = final.target.sigma[good, 0], data.at.rows(np.flatnonzero(good))
    left = final.residual[good, 0].real / sigma
    wanted = left + change[good, 0].real / sigma
    warmer = at.temperature_C - piece.effect.constants.reference_temperature_C

    def lost(*laws: FloatArray) -> float:
        """The loss with a sum of laws that turn with the direction."""
        design = np.stack(laws, axis=1) * (at.sign / sigma)[:, None]
        return float(((wanted - made_of(design, wanted)) ** 2).sum())

    dry, films = np.ones(len(wanted)), product(SETTINGS.powers_of_a_drag, SETTINGS.decays_of_a_drag)
    drags = ((at.speed_rpm / at.speed_rpm.max()) ** power * np.exp(-decay * warmer) for power, decay in films)
    held, best, alone = float((left**2).sum()), min(lost(dry, drag) for drag in drags), lost(dry)
    # what neither explains is as much noise to both; where the dry part alone does as well, it is what changed
    clear = SETTINGS.as_good * max(1.0, min(held, best) / len(wanted))
    # a skew that stands for another film is a part of the same friction, whatever the power
    films_beside = [one for one in final.state.pieces if one.free and may_be_another_film(final, one)]
    return held + clear < alone and (best < held + clear or bool(films_beside))


def may_be_another_film(final: Fit, piece: Piece) -> bool:
    """Whether all that a change of the measuring chain shows is a mean that grows with the speed, as skew makes it.

    Drag that thins with the oil by another law than the exponential one, or does not thin at all, makes the same.
    """
    data, good = final.target.data, final.target.good
    if piece.effect.stage is not Stage.MEASURING or data.angle_rad is not None:
        return False
    change = final.explained(piece.effect) if piece.added else final.shown_change(piece)
    shown, noise = ((np.abs(part[good]) ** 2).mean(axis=0) for part in (change, final.target.sigma))
    moved = shown > noise * data.parts
    return bool(moved[data.orders == 0].any() and not moved[data.orders > 0].any())


def may_be_a_skirt(final: Fit, piece: Piece) -> bool:
    """Whether waves that changed, by a constant or a growth with the load, grow with the square of their frequency as
    well, all by one share of it.

    So what a force does to a structure grows far below its natural frequency, which no speed need reach.
    """
    data, good = final.target.data, final.target.good
    if not _is_of_no_speed(piece.effect) or data.angle_rad is not None:
        return False
    changed = [one for one in final.state.pieces if one.free and _is_of_no_speed(one.effect)]
    change = sum((final.explained(one.effect) if one.added else final.shown_change(one)) for one in changed)
    skirt = np.asarray(change * (data.at.speed_rpm[:, None] / data.at.speed_rpm.max() * data.orders) ** 2)
    along, told = np.zeros(len(data.orders)), np.zeros(len(data.orders))
    for rows in data.at.by_direction(good):
        free = np.stack([np.ones(int(rows.sum())), data.at.torque_Nm[rows]], axis=1)
        basis = np.linalg.qr(free).Q
        left, grown = (part[rows] - basis @ (basis.T @ part[rows]) for part in (final.residual, skirt))
        along += ((left * grown.conj()).real / final.target.sigma[rows] ** 2).sum(axis=0)
        told += (np.abs(grown) ** 2 / final.target.sigma[rows] ** 2).sum(axis=0)
    # what another order alone grows by says nothing of this one, where its own would show
    own = np.isin(data.orders, piece.effect.touched_orders())
    share = along.sum() / max(told.sum(), 1e-300)
    refused = share * told[own].sum() - along[own].sum() > np.sqrt(SETTINGS.as_good * told[own].sum())
    return bool(along.sum() > np.sqrt(SETTINGS.as_good * told.sum()) > 0.0 and not refused)


def _is_of_no_speed(effect: Effect) -> bool:
    return is_a_constant_wave(effect) or effect.name == "load_dependent_mesh"


def may_be_of_a_law(final: Fit, piece: Piece) -> bool:
    """Whether a change of an effect is so small that a law of the conditions would make it, and leave unseen the rest.

    On each of its orders: structure below a part of the noise is not told from an error of the noise's estimate. What
    is large at one speed or angle alone is like none.
    """
    data, good, effect = final.target.data, final.target.good, piece.effect
    if data.angle_rad is not None or has_a_frequency(effect) or effect.least_foreign:
        return False
    change = (np.abs(final.shown_change(piece)[good]) ** 2).mean(axis=0)
    noise = data.parts * (final.target.sigma[good] ** 2).mean(axis=0)
    return bool((change < SETTINGS.constant_of_a_law * SETTINGS.least_excess * noise).all())


#: Constant waves once or twice a turn: the weight of an arm that hangs on the output, how a machine is mounted, an
#: encoder, or a shaft that bends in another direction than it runs out makes such, too.
_OF_THE_TURN = frozenset({"output_shaft_eccentricity", "output_shaft_ovality", "encoder_eccentricity"})


def may_be_of_the_turn(_: Fit, piece: Piece) -> bool:
    """Whether an effect is a constant wave that other things make once or twice a turn as well."""
    return piece.effect.name in _OF_THE_TURN


def by_order_alone(final: Fit, piece: Piece) -> bool:
    """Whether nothing but its order ties a wave to the part that it is named after.

    Growth with the load or sidebands of the carrier on the same order do; an error of a shaft has no such company, nor
    has a sideband without the other one.
    """
    if piece.effect.stage is Stage.MODULATION:
        return len(followers(piece)) < 2
    if not is_a_constant_wave(piece.effect):
        return False
    company = any(
        other.effect.name in ("load_dependent_mesh", "carrier_modulation")
        and other.effect.orders == piece.effect.orders
        for other in final.state.pieces
    )
    return not company


#: Tests of a finding of a fit: whether something else may look like it, be it missing or changed; and of changes alone.
LOOK_ALIKES = (
    is_a_knee, may_be_friction, may_be_time, may_be_of_the_turn, by_order_alone, may_be_another_power,
    may_be_another_drag, may_be_another_film, may_be_of_a_frequency,
)  # fmt: skip
OF_CHANGES = (*LOOK_ALIKES, gains_one_sideband, may_be_a_skirt, may_be_of_a_law)


def corrections_left(final: Fit, piece: Piece) -> set[str]:
    """Names of what was read wrong, or filtered, of which a change of the rig may be what is left."""
    return {name for left in (left_of_filters, left_of_a_delay, left_of_a_smoothing) for name in left(final, piece)}


# --- what is said beside a name

#: what is said beside every name that few runs give
FEW = "so few runs cannot tell one law of the conditions from another: measure more levels"
#: what is said beside play that a transmission without any would show at these torques
KNEE = "a transmission without play that is softer at low loads does as well"
#: what is said beside a resonance of orders beside each other
OF_SPEED = "its orders may as well all be loud at one speed of the input: measure more speeds around it"
#: what is said beside a resonance of one order that no part makes
OF_ONE_ORDER = "its one order, which no part of the gear makes, may as well be loud at one speed of the input"
#: what is said beside a name that what happens at the start of each curve may have
START = "what dies away behind the start of each curve (an axis that settles, a filter that runs in) looks like it"


def of_its_shape(joint: Fit, piece: Piece, peaks: tuple[float, float] | None) -> tuple[str, ...]:
    """What the width of a resonance and the shape of its peaks leave open."""
    if peaks is None:
        damping = piece.effect.values.get("damping_ratio")
        narrow = isinstance(damping, float) and damping < SETTINGS.narrow
        text = "narrower than the steps of speed: height and damping are uncertain"
        unmet = isinstance(piece.effect, StructuralResonance) and not _is_met(joint, piece.effect)
        return tuple(said for is_so, said in ((narrow, text), (unmet, ONLY_FLANKS)) if is_so)
    return (
        f"the peaks are not those of one oscillator; the speeds at which they stand put it between {peaks[0]:.1f} "
        f"and {peaks[1]:.1f} Hz, height and damping are uncertain",
    )


def of_its_order(final: Fit, piece: Piece) -> tuple[str, ...]:
    """What is said beside a name that only an order gives."""
    if not by_order_alone(final, piece):
        return ()
    order = (*piece.effect.orders, *piece.effect.touched_orders())[0]
    if piece.effect.stage is Stage.MODULATION:
        is_one = bool(followers(piece)) or len(loud_sides(piece.effect)) == 1
        what = "one sideband" if is_one else "two constant sidebands"
        alike = "without the other: a wave of that order" if is_one else "that do not follow it: two waves"
        return (f"{what} of order {order} {alike} from elsewhere is as likely",)
    return (
        f"order {order} is one that this part makes; a constant wave of that order from elsewhere would look the same",
    )


def extrapolates(joint: Fit, piece: Piece) -> tuple[str, ...]:
    """Remarks where a parameter lies at a bound or outside of what was measured."""
    remarks = []
    at = joint.target.data.at
    fixed = {scalar.key for scalar in piece.effect.scalars if scalar.form is Form.FIXED}
    remarks += [
        f"{key} is held at {value:g}: the data do not tell it, or put it at its bound"
        for key, value in piece.effect.values.items()
        if key not in piece.free | fixed | {"order", "orders"}
    ]
    seating = piece.effect.values.get("seating_torque_Nm")
    if isinstance(seating, float) and np.sum(np.unique(np.abs(at.torque_Nm)) < 2 * seating) < 2:
        remarks.append("too few torques near the seating torque: it is an extrapolation")
    remarks += [
        f"what it does between {low:g} and {high:g} degC is not known: no temperature between them was measured"
        for low, high in unmeasured_states(at, [piece.effect])
    ]
    if "frequency_Hz" in piece.effect.values:
        turn = at.speed_rpm / (60 * piece.effect.constants.reduction_ratio)
        lowest, highest = frequencies_in(piece.effect, at)
        outside = [k for k in piece.effect.orders if not (k * turn.min() < highest and lowest < k * turn.max())]
        if outside:
            which = f"order {outside[0]} does" if len(outside) == 1 else f"orders {', '.join(map(str, outside))} do"
            remarks.append(f"{which} not reach the frequency in the measured speeds")
    return tuple(remarks)


def _is_met(joint: Fit, effect: StructuralResonance) -> bool:
    """Whether a good run is inside the half-power width of a resonance, at one of its orders."""
    at = joint.target.data.at
    at = at.rows(np.flatnonzero(joint.target.good & where_there(effect, at)))
    hertz = at.speed_rpm[:, None] / (60 * effect.constants.reduction_ratio) * np.array(effect.orders)
    mode = np.reshape(effect.scalar("frequency_Hz") * effect.shift(at.torque_Nm, at.temperature_C), (-1, 1))
    return bool((np.abs(hertz / mode - 1.0) <= effect.scalar("damping_ratio")).any())


# --- what stays unexplained says that something else may be there


def of_one_angle(final: Fit, before: ComplexArray) -> set[int]:
    """Orders of a table, near each other, that all differ from the rig's as by what stands at one angle of the turn.

    before: what the rig leaves, (n, K). A bump, or a burst of a mesh order, changes all orders around 0, or around the
    mesh order, by the waves of one bell; where those between are in no column, only the sizes and phases of those that
    are can speak against it.
    """
    target, data = final.target, final.target.data
    if data.spectral_deg is not None or data.angle_rad is not None:
        return set()
    moved = before - final.residual
    power, noise = ((np.abs(part[target.good]) ** 2).mean(axis=0) for part in (moved, target.sigma))
    found = set[int]()
    for k in data.orders[(power > noise * data.parts) & (data.orders > 0)]:
        near = (np.abs(data.orders - k) <= SETTINGS.reach_of_bell) & (data.orders > 0)
        if near.sum() >= SETTINGS.least_in_bell and (power > noise * data.parts)[near].all():
            centres = [0, *np.intersect1d(final.state.rig.constants.mesh_orders(), data.orders[near]).tolist()]
            # whatever its size and sign in a run: what the runs of a direction have in common
            sides = (moved[np.ix_(rows, near)] for rows in data.at.by_direction(target.good))
            parts = (np.linalg.svd(side, full_matrices=False) for side in sides)
            waves = np.array([size[0] * wave[0] for _, size, wave in parts])
            if min(_left_of_a_bell(data.orders[near] - c, waves) for c in centres) < SETTINGS.form**2:
                found |= set(data.orders[near].tolist())
    return found


def _left_of_a_bell(off: IntArray, waves: ComplexArray) -> float:
    """The share of the power of waves, (directions, m), that the best bell at one angle leaves.

    off: by how much their orders, (m,), are off that of the bell.
    """
    widths, angles = np.radians(np.arange(2.0, 31.0)), np.radians(np.arange(360.0))
    bells = np.exp(-0.5 * (off * widths[:, None]) ** 2)[:, None, :] * np.exp(-1j * off * angles[:, None])
    # a bell far from all of the orders has nothing on any of them
    along = np.abs(bells.conj() @ waves.T) ** 2 / np.maximum((np.abs(bells) ** 2).sum(axis=2), 1e-300)[..., None]
    return 1.0 - float(along.sum(axis=2).max()) / max(float((np.abs(waves) ** 2).sum()), 1e-300)


def doubted(
    found: Conclusions,
    left: Collection[int],
    by_load: Collection[int],
    made: Collection[int],
    places: Collection[int] = (),
    expressed: Collection[int] = (),
    *,
    in_samples: bool,
) -> Conclusions:
    """Conclusions whose names have the alternative `something_else` where what stays unexplained says so.

    left: orders that stay unexplained: what is there may have changed a parameter of the rig on them as well, and on
    the other side of a mesh order; where they lie one beside the rig's orders, as where an angle is read wrong, what
    does that changes the orders between them, too; by_load: those of them of which the load tells what is left; made:
    the rig's orders. Many others that are left, as a step at one angle makes them, or what dies away behind the start
    of a curve, reach all up to twice the highest, and the mean. In samples over time all that moves the mean slowly, as
    a step or a drift, moves what is found of the mean as well. places: orders that one angle of the turn may have
    changed; expressed: those of which the rig has an expression without a cause, whose law may be another one.
    """
    foreign = sorted(order for order in {*left, *_of_what_is_many(found)} if order > 0 and order not in made)
    is_broad = len(foreign) >= SETTINGS.shared_orders
    broad = set(range(2 * foreign[-1] + 1)) if is_broad else set()
    near = {order + off for order in beside_the_rigs(left, made) for off in (-1, 1)}
    moved = near | broad | set(left) | _reached(set(left)) | set(expressed)
    slow = {0} & set(left) if in_samples else set()
    # what changed in one direction alone is half of what turns with it, and half of what does not
    halves = ONE_SIDED if found.names >= ONE_SIDED else frozenset()

    def is_open(effect: Effect, orders: Collection[int]) -> bool:
        its = set(effect.touched_orders())
        if effect.stage is Stage.MEASURING:  # it turns all orders, those that stay unexplained among them
            its |= set(left) - {0}
        return effect.name in halves or bool(its & set(orders))

    def follows_another_law(effect: Effect) -> bool:
        is_power = effect.name == "load_dependent_mesh" and not is_one_form(effect.scalar("exponent"), 1.0)
        return effect.name == "load_dependent_mesh" and is_open(effect, left if is_power else by_load)

    def is_of_one_angle(effect: Effect) -> bool:
        its = set(effect.touched_orders())
        return bool(its) and its <= set(places)

    claims = [
        claim.in_doubt("what stays unexplained may have a part in it")
        if (is_open(claim.piece.effect, near | slow) or (is_broad and claim.piece.effect.least_foreign))
        and (claim.counted or slow)
        else claim.in_doubt("what stands at one angle of the turn may have changed all these orders")
        if is_of_one_angle(claim.piece.effect)
        else claim.in_doubt("the rig's expression without a cause may follow another law")
        if is_open(claim.piece.effect, expressed)
        else claim.in_doubt("what stays unexplained of its order may be that it follows another law of the load")
        if follows_another_law(claim.piece.effect)
        else claim
        for claim in found.claims
    ]
    retuned = [
        replace(
            one,
            is_open=one.is_open or is_of_one_angle(one.after) or is_open(one.after, moved | _mirrored(one.after, left)),
        )
        for one in found.retuned
    ]
    unsure = {one.after.name for one in retuned if SOMETHING_ELSE in one.alternatives}
    unsure |= {claim.piece.effect.name for claim in claims if SOMETHING_ELSE in claim.alternatives}
    if "backlash" in unsure:
        # above the load that takes play up it is dry friction's twin: what is no play is no such friction either, and
        # of a transmission that is softer at low loads the stiffness makes up for what the play has too much
        twin, twins = "the play beside it may be something else", ("friction_windup", "torsional_compliance")
        claims = [claim.in_doubt(twin) if claim.piece.effect.name in twins else claim for claim in claims]
        retuned = [replace(one, is_open=one.is_open or one.after.name in twins) for one in retuned]
    offset_is_open = found.offset_changed and 0 in moved
    return replace(found, claims=tuple(claims), retuned=tuple(retuned), offset_is_open=offset_is_open)


def _reached(left: set[int]) -> set[int]:
    """Orders that what stays unexplained on those around them reaches as well.

    What is on both sides of one, as an effect of one angle is, reaches it; and what three in a row have in common, as
    an error of pitch that adds up, the two beside them on each side.
    """
    between = {k for k in range(max(left, default=0)) if {k - 1 if k else 2, k + 1} <= left}
    rows = [k for k in left if {k + 1, k + 2} <= left]
    return between | {beyond for k in rows for beyond in (k - 2, k - 1, k + 3, k + 4) if beyond >= 0}


def _mirrored(effect: Effect, left: Collection[int]) -> set[int]:
    """The sidebands on the other side of the mesh order beside each: what changes a mesh makes both."""
    mesh, reach = effect.constants.mesh_orders(), effect.constants.cranks
    return {2 * order - k for k in left for order in mesh if abs(order - k) <= reach}


def _of_what_is_many(found: Conclusions) -> set[int]:
    """The orders of claims that may be what happens where curves begin."""
    return {
        order
        for claim in found.claims
        if may_be_a_start(found.final, claim.piece.effect)
        for order in claim.piece.effect.touched_orders()
    }
