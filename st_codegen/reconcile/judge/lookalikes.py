"""What else would look like a finding: mistakes of measuring, and physics, that these data do not tell from it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product

import numpy as np

from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.fit.fitting import Fit
from st_codegen.reconcile.fit.normal import made_of
from st_codegen.reconcile.fit.parameters import Piece
from st_codegen.reconcile.judge.peaks import has_a_frequency
from st_codegen.reconcile.judge.plausible import followers
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect, Stage


def left_of_filters(final: Fit, number: int) -> frozenset[str]:
    """Names of filters that were undone, where waves of an effect may have kept what their responses are off by.

    These are told by all orders together, with straight lines between a dozen places.
    """
    is_wave = any(order > 0 for order in final.state.pieces[number].effect.touched_orders())
    return final.target.corrected & {"filter", "smoothing"} if is_wave else frozenset()


def left_of_a_delay(final: Fit, number: int) -> frozenset[str]:
    """The name of a filter, where waves of an effect may have changed by what it does beside a changed delay.

    A delay is the first term of any filter: a tenth of what it does to these waves may be the next ones.
    """
    pieces = final.state.pieces
    delays = [
        one for i, one in enumerate(pieces)
        if one.effect.stage is Stage.MEASURING and i != number and one.origin not in (None, one.effect)
    ]  # fmt: skip
    own = (np.abs(final.shown_change(pieces[number])) ** 2).sum(axis=0)
    waves = (own > 0.0) & (final.target.data.orders > 0)
    delayed = sum(float((np.abs(final.shown_change(one)[:, waves]) ** 2).sum()) for one in delays)
    return frozenset(["filter"]) if waves.any() and own[waves].sum() < SETTINGS.form**2 * delayed else frozenset()


def left_of_a_smoothing(final: Fit, number: int) -> frozenset[str]:
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
    own = (np.abs(final.shown_change(final.state.pieces[number])[good]) ** 2).sum(axis=0)
    return frozenset(["smoothing"]) if own[~above].sum() < SETTINGS.form**2 * own[above].sum() else frozenset()


def is_a_knee(final: Fit, effect: Effect) -> bool:
    """Whether a twist that is softer at low loads does as well as play: the torques at which that is taken up are few,
    or straight lines with knees, or a power of the load, leave no more of the mean."""
    seating = effect.values.get("seating_torque_Nm")
    if not isinstance(seating, float):
        return False
    data, good = final.target.data, final.target.good
    torques = np.unique(np.abs(data.at.torque_Nm))
    if int((torques < 2 * seating).sum()) < SETTINGS.torques_of_a_knee:
        return True
    if data.angle_rad is not None or data.orders[0] != 0:
        return False
    twists = [piece for piece in final.state.pieces if piece.effect.name in ("backlash", "torsional_compliance")]
    twist = sum((final.explained(piece.effect)[good, 0].real for piece in twists), final.residual[good, 0].real)
    torque, sign, sigma = data.at.torque_Nm[good], data.at.sign[good], final.target.sigma[good, 0]

    def left(*laws: FloatArray) -> float:
        """The loss with a twist that is a sum of laws of the load beside a zero and dry friction."""
        columns = np.stack([*(sign * law for law in (torque, *laws)), sign, np.ones(len(sign))], axis=1)
        design, wanted = columns / np.abs(columns).max(axis=0, initial=1e-300) / sigma[:, None], twist / sigma
        return float(((wanted - made_of(design, wanted)) ** 2).sum())

    knees = np.quantile(torques[torques > 0.0], np.linspace(0.0, 1.0, SETTINGS.knees_tried + 1)[:-1])
    slopes = [np.clip(torque, -knee, knee) for knee in np.unique(knees)]
    powers = [np.sign(torque) * np.abs(torque) ** power for power in SETTINGS.powers_of_a_load]
    play = left(np.tanh(torque / seating))
    others = [*map(left, slopes), *map(left, powers), *(left(*two) for two in combinations(slopes, 2))]
    # what neither explains is as much noise to both
    unit = max(1.0, min(play, *others) / len(sign))
    return min(others) < play + SETTINGS.as_good * unit


def may_be_time(final: Fit, effect: Effect) -> bool:
    """Whether what follows the oil may follow the time: the runs are listed by their temperature."""
    return effect.name == "thermal_drift" and final.target.data.sorted_by == "temperature"


def may_be_friction(final: Fit, effect: Effect) -> bool:
    """Whether friction that grows with the load would look like a compliance: where the load hardly changes its sign.

    What a load winds up changes its sign with the load, what friction does with the direction alone.
    """
    torques = final.target.data.at.torque_Nm
    is_compliance = effect.name == "torsional_compliance"
    of_less = min(float(np.abs(torques[torques * side > 0.0]).max(initial=0.0)) for side in (1.0, -1.0))
    return is_compliance and of_less <= SETTINGS.form * float(np.abs(torques).max(initial=0.0))


def unlike_friction(final: Fit, effects: Sequence[Effect]) -> tuple[str, ...]:
    """What is said of data that do not tell a compliance among some effects from friction that grows with the load."""
    text = (
        f"no load of the other sign is more than {100 * SETTINGS.form:.0f} % of the largest: friction that grows with "
        "the load cannot be told from compliance"
    )
    return (text,) if any(may_be_friction(final, effect) for effect in effects) else ()


def gains_one_sideband(before: Effect, after: Effect) -> bool:
    """Whether a modulation gains a constant sideband without its twin: as likely a wave of that order from elsewhere.

    Its ratio moves with it where the runs do not tell what follows the mesh order from what is constant.
    """
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


def may_be_another_power(final: Fit, number: int) -> bool:
    """Whether a mesh order that grows in proportion to the load follows another power of it about as well.

    Beside a constant, where that is free as well.
    """
    piece, data, good = final.state.pieces[number], final.target.data, final.target.good
    if piece.effect.name != "load_dependent_mesh" or data.angle_rad is not None:
        return False
    others = [one for i, one in enumerate(final.state.pieces) if i != number and one.free]
    order = set(piece.effect.orders)
    constant = any(order & set(one.effect.orders) for one in others if is_a_constant_wave(one.effect))
    column = np.isin(data.orders, piece.effect.orders)
    sigma = final.target.sigma[good][:, column]
    wanted = (final.residual + final.explained(piece.effect))[good][:, column] / sigma
    load, sign = np.abs(data.at.torque_Nm[good]), data.at.sign[good]

    def left(power: float) -> float:
        """What a wave of each direction leaves whose height is a power of the load, in noises squared."""
        law = (load / max(float(load.max(initial=0.0)), 1e-300)) ** power
        laws = np.stack([law, *([np.ones(len(law))] if constant else [])], axis=1).astype(np.complex128)
        found = 0.0
        for side, k in product(np.unique(sign), range(wanted.shape[1])):
            rows = sign == side
            design, values = laws[rows] / sigma[rows, k : k + 1], wanted[rows, k]
            found += float((np.abs(values - design @ np.linalg.lstsq(design, values, rcond=None)[0]) ** 2).sum())
        return found

    own, best = left(1.0), min(map(left, SETTINGS.powers_of_a_mesh))
    # what neither explains is as much noise to both
    return best < own + SETTINGS.as_good * max(1.0, min(own, best) / max(2.0 * wanted.size, 1.0))


def may_be_of_a_law(final: Fit, number: int) -> bool:
    """Whether a change of an effect is so small that a law of the conditions would make it, and leave unseen the rest.

    On each of its orders: structure below a part of the noise is not told from an error of the noise's estimate. What
    is large at one speed or angle alone is like none.
    """
    data, good, effect = final.target.data, final.target.good, final.state.pieces[number].effect
    if data.angle_rad is not None or has_a_frequency(effect) or effect.least_foreign:
        return False
    change = (np.abs(final.shown_change(final.state.pieces[number])[good]) ** 2).mean(axis=0)
    noise = data.parts * (final.target.sigma[good] ** 2).mean(axis=0)
    return bool((change < SETTINGS.constant_of_a_law * SETTINGS.least_excess * noise).all())


#: Constant waves once or twice a turn: the weight of an arm that hangs on the output, how a machine is mounted, or an
#: encoder makes such, too.
_OF_THE_TURN = frozenset({"output_shaft_eccentricity", "output_shaft_ovality"})


def may_be_of_the_turn(effect: Effect) -> bool:
    """Whether an effect is a constant wave that other things make once or twice a turn as well."""
    return effect.name in _OF_THE_TURN


def is_a_constant_wave(effect: Effect) -> bool:
    """Whether an effect is a wave of one order, the same at all conditions."""
    return effect.orders_key == "order" and effect.stage is Stage.ADDITIVE and effect.name != "load_dependent_mesh"


def by_order_alone(final: Fit, number: int) -> bool:
    """Whether nothing but its order ties a wave to the part that it is named after.

    Growth with the load or sidebands of the carrier on the same order do; an error of a shaft has no such company, nor
    has a sideband without the other one.
    """
    piece = final.state.pieces[number]
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
