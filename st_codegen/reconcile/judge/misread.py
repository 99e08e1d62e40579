"""Readings: ways in which conditions or angles may be read wrong by one number, beside what changed in the rig.

Before the search `examine` asks about what all orders agree on. What noise hides from it there, or another effect, is
asked again of the finished fit: whether one number of the measurement does what several changes of the rig do.
"""

from __future__ import annotations

import heapq
import itertools
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from st_codegen.ir.arrays import ComplexArray, FloatArray
from st_codegen.processes import shared_out
from st_codegen.reconcile.data.chances import chi_square_tail
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.data.ramps import without_ramp
from st_codegen.reconcile.fit.fitting import Fit, Packed, fit, unpacked
from st_codegen.reconcile.fit.normal import gather, inverse
from st_codegen.reconcile.fit.state import OFFSET, State
from st_codegen.reconcile.fit.target import Column, FitData
from st_codegen.reconcile.mistakes.columns import readings
from st_codegen.reconcile.mistakes.other_shaft import over_the_output
from st_codegen.reconcile.rest.lasting import changes_with_time
from st_codegen.reconcile.rest.structure import is_left, structure
from st_codegen.reconcile.search.peaks import frequencies_in
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions

#: the data that were meant where some were read wrong by sizes
Reread = Callable[[Observations, FloatArray], Observations]
#: the factor by which TE of some data is too large, for some sizes
Gain = Callable[[Observations, FloatArray], FloatArray | ComplexArray]


@dataclass(frozen=True)
class WrongReading:
    """One way to read wrong: its name among alternatives and for `--accept`, and the data that were meant.

    texts: what is wrong, one for each size, with it in its unit and (where that says it) its sign in words; steps:
    sizes that change little; most: beyond these it is no slip of this kind. A reading without steps has no degrees.
    refines: the mistake of `examine` of which it may be what the correction was off by. gain: the factor on TE of
    each row, (n, 1), or coefficient, (n, K), by which the noise is larger as well. said: sizes as the texts say them.
    units: those in which the first number would be off by such a factor.
    """

    name: str
    texts: tuple[str, ...]
    meant: Reread
    steps: tuple[float, ...] = ()
    most: tuple[float, ...] = ()
    refines: str = ""
    gain: Gain | None = None
    said: Callable[[FloatArray], FloatArray] = np.asarray
    units: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Misread:
    """A reading with its sizes, and the numbers of the pieces whose changes it stands for (OFFSET: the zero's).

    best: the fit with it, whose pieces have the numbers of those with the changes; touched: how many changes lie on
    orders that it moves; unexplained: the orders of which it leaves hardly anything, where nothing else does, and
    what that is, in words.
    """

    reading: WrongReading
    sizes: FloatArray
    instead_of: frozenset[int]
    best: Fit
    touched: int = 0
    unexplained: frozenset[int] = frozenset()
    leaves: str = ""

    @property
    def text(self) -> str:
        """What seems to be read wrong, with its sizes, and the unit that would be off by so much."""
        sizes = self.reading.said(self.sizes) if len(self.sizes) else np.ones(1)
        said = " and ".join(
            text.format(abs(size), "high" if size > 0 else "low")
            for text, size in zip(self.reading.texts, sizes, strict=True)
        )
        factor = 1.0 + float(sizes[0]) / 100.0
        off = {name: abs(factor * one - 1.0) for name, one in self.reading.units}
        unit = min(off, key=lambda name: off[name], default="")
        return f"{said}, as numbers in {unit} would be" if unit and off[unit] < SETTINGS.near_a_torque else said

    @property
    def is_asked(self) -> bool:
        """Whether it is hardly by chance: it has fewer numbers than there are changes for which it stands.

        Two of twenty that agree on a number say nothing: it stands for most of those on orders that it moves. Of orders
        that are unexplained it takes one more, since nothing else was found for them.
        """
        of_orders = len(self.unexplained) > max(len(self.sizes), 1) + 1
        return of_orders or len(self.instead_of) > max(len(self.sizes), 1, self.touched // 2)

    def meant(self, data: Observations) -> Observations:
        """The data as they would be, read right."""
        return self.reading.meant(data, self.sizes)


def _times(key: str) -> Reread:
    """Numbers by a factor, of which the size is the logarithm in per cent: one of another unit may be far off 1."""
    return lambda data, size: data.under(**{key: getattr(data.at, key) / np.exp(size[0] / 100.0)})


def _scaled(key: str) -> Reread:
    return lambda data, size: data.under(**{key: getattr(data.at, key) / (1.0 + size[0] / 100.0)})


def _shifted(key: str) -> Reread:
    return lambda data, size: data.under(**{key: getattr(data.at, key) - size[0]})


def _scaled_and_shifted(key: str) -> Reread:
    return lambda data, size: data.under(**{key: (getattr(data.at, key) - size[1]) / (1.0 + size[0] / 100.0)})


def _faster(sign: float) -> Reread:
    """Speeds of one direction by a factor."""
    return lambda data, size: data.under(
        speed_rpm=data.at.speed_rpm / np.where(data.at.sign == sign, 1.0 + size[0] / 100.0, 1.0)
    )


def _slipped(data: Observations, size: FloatArray) -> Observations:
    """Speeds that fall in proportion to the load, by a share of 1/100 at the largest."""
    load = np.abs(data.at.torque_Nm)
    share = size[0] / 100.0 * load / max(float(load.max()), 1e-300)
    return data.under(speed_rpm=data.at.speed_rpm * (1.0 - share))


def _warmer_backward(data: Observations, size: FloatArray) -> Observations:
    """Temperatures of one direction: a machine that warms up between the two curves of a run."""
    return data.under(temperature_C=data.at.temperature_C - size[0] * (data.at.sign < 0))


def _of_fahrenheit(data: Observations, _size: FloatArray) -> Observations:
    return data.under(temperature_C=(data.at.temperature_C - 32.0) / 1.8)


def _exchanged(data: Observations, _size: FloatArray) -> Observations:
    return data.under(sign=-data.at.sign)


def _turned(*signs: float) -> Reread:
    """Angles that are read wrong in curves of some directions."""
    return lambda data, size: replace(
        data,
        values=data.values * np.exp(1j * np.radians(size[0]) * np.isin(data.at.sign, signs)[:, None] * data.orders),
    )


def _turned_each(data: Observations, size: FloatArray) -> Observations:
    """Angles that are read wrong, those of backward curves by another size."""
    return _turned(-1.0)(_turned(1.0, -1.0)(data, size[:1]), size[1:])


@lru_cache(maxsize=1)
def _over_the_output(data: Observations) -> Observations:
    """As `over_the_output`, which takes long: asked for the same data by all that may be read wrong."""
    return over_the_output(data)


def _wound(data: Observations, size: FloatArray) -> Observations:
    """Angles of a shaft that the load winds up, by a size at the largest, backward the other way."""
    load = data.at.sign * data.at.torque_Nm / max(float(np.abs(data.at.torque_Nm).max()), 1e-300)
    return replace(data, values=data.values * np.exp(1j * np.radians(size[0]) * load[:, None] * data.orders))


def _against(data: Observations, size: FloatArray) -> Observations:
    """Torques that are read with what rubs between their sensor and the machine, which turns with the direction."""
    return data.under(torque_Nm=data.at.torque_Nm - size[0] * data.at.sign)


def _larger(*signs: float) -> Gain:
    """TE of some directions that is too large."""
    return lambda data, size: 1.0 + size[0] / 100.0 * np.isin(data.at.sign, signs)[:, None]


def _growing(data: Observations, size: FloatArray) -> FloatArray:
    """TE that grows with the number of the run, from the first to the last by a share of 1/100."""
    if data.run is None:
        return np.ones((len(data), 1))
    return np.asarray(1.0 + size[0] / 100.0 * data.run / max(int(data.run.max()), 1))[:, None]


def _of_frequency(data: Observations) -> FloatArray:
    """The frequency of each coefficient as a share of the largest that was measured, (n, K)."""
    found = data.at.speed_rpm[:, None] * data.orders
    return np.asarray(found / max(float(np.abs(found).max()), 1e-300))


def _delayed(sign: float) -> Gain:
    """Curves of one direction behind a delay of their own: phases turn in proportion to the frequency."""

    def gain(data: Observations, size: FloatArray) -> ComplexArray:
        turned = np.radians(size[0]) * _of_frequency(data) * (data.at.sign == sign)[:, None]
        return np.asarray(np.exp(1j * turned))

    return gain


def _faded(data: Observations, size: FloatArray) -> FloatArray:
    """What a filter does to waves beside a delay, at frequencies where it does little: sizes fall with the square."""
    return np.asarray(1.0 + size[0] / 100.0 * _of_frequency(data) ** 2)


def _faded_and_turned(data: Observations, size: FloatArray) -> ComplexArray:
    """The next term of a filter as well: phases turn with the cube of the frequency."""
    return np.asarray(_faded(data, size) * np.exp(1j * np.radians(size[1]) * _of_frequency(data) ** 3))


def _of_gain(
    texts: tuple[str, ...], gain: Gain, refines: str = "", *, steps: tuple[float, ...] = (0.1,),
    most: tuple[float, ...] = (30.0,),
) -> WrongReading:  # fmt: skip
    return WrongReading(
        "misread_te", texts, lambda data, size: data.divided(gain(data, size)), steps, most, refines, gain
    )


_DELAYED = "waves {} turned {{:.3g}} deg too {{}} at the highest frequency, in proportion at others, as by a delay"
#: of a filter, of which the rig may have the delay
_FADED = "waves {:.3g} % too {} at the highest frequency, by its square elsewhere, as behind a filter"
_TORQUE, _SPEED, _HEAT, _ANGLE = (f"misread_{what}" for what in ("torque", "speed", "temperature", "angle"))
_SLIP = WrongReading(
    _SPEED, ("speeds {:.3g} % too {} at the largest load, and in proportion at others",), _slipped, (0.1,), (30.0,)
)
#: N m; what one of other units of a torque is
_TORQUES = (
    ("lbf ft", 1.3558179), ("lbf in", 0.11298483), ("kgf m", 9.80665), ("kgf cm", 0.0980665), ("N cm", 0.01),
    ("daN m", 10.0),
)  # fmt: skip
READINGS = (
    WrongReading(
        _TORQUE, ("all torques {:.3g} % too {}",), _times("torque_Nm"), (0.1,), (500.0,), "torque",
        said=lambda size: 100.0 * np.expm1(size / 100.0), units=_TORQUES,
    ),
    WrongReading(_TORQUE, ("all torques {:.3g} N m too {}",), _shifted("torque_Nm"), (1.0,), (500.0,), "torque"),
    WrongReading(
        _TORQUE, ("all torques {:.3g} % too {}", "beside that {:.3g} N m too {}"), _scaled_and_shifted("torque_Nm"),
        (0.1, 1.0), (100.0, 500.0), "torque",
    ),
    WrongReading(
        _TORQUE, ("torques forward {:.3g} N m too {}, backward the other way",), _against, (1.0,), (500.0,), "torque"
    ),
    WrongReading(_HEAT, ("all temperatures {:.3g} K too {}",), _shifted("temperature_C"), (0.1,), (30.0,)),
    WrongReading(_HEAT, ("all temperatures {:.3g} % too {}",), _scaled("temperature_C"), (0.1,), (90.0,)),
    WrongReading(
        _HEAT, ("all temperatures {:.3g} % too {}", "beside that {:.3g} K too {}"),
        _scaled_and_shifted("temperature_C"), (0.1, 0.1), (90.0, 30.0),
    ),
    WrongReading(_HEAT, ("all temperatures backward {:.3g} K too {}",), _warmer_backward, (0.1,), (30.0,)),
    WrongReading(_HEAT, ("all temperatures in degF",), _of_fahrenheit),
    WrongReading(_SPEED, ("all speeds {:.3g} % too {}",), _scaled("speed_rpm"), (0.1,), (30.0,)),
    WrongReading(_SPEED, ("all speeds backward {:.3g} % too {}",), _faster(-1.0), (0.1,), (30.0,)),
    WrongReading(_SPEED, ("all speeds forward {:.3g} % too {}",), _faster(1.0), (0.1,), (30.0,)),
    _SLIP,
    WrongReading(_ANGLE, ("every angle {:.3g} deg too {}",), _turned(1.0, -1.0), (1e-3,), (5.0,), "home_offset"),
    WrongReading(_ANGLE, ("every angle backward {:.3g} deg too {}",), _turned(-1.0), (1e-3,), (5.0,)),
    WrongReading(
        _ANGLE, ("every angle {:.3g} deg too {}", "backward beside that {:.3g} deg too {}"), _turned_each,
        (1e-3, 1e-3), (5.0, 5.0),
    ),
    WrongReading(
        _ANGLE, ("all angles those of the fast shaft over the reduction ratio",),
        lambda data, _size: _over_the_output(data),
    ),
    WrongReading(
        _ANGLE, ("every angle {:.3g} deg too {} at the largest load, in proportion at others, backward the other way",),
        _wound, (1e-3,), (5.0,),
    ),
    WrongReading(
        "misread_ratio", ("TE {:.3g} deg too {} at the end of each turn",),
        lambda data, size: without_ramp(data, size[0]), (1e-4,), (1.0,), "ratio",
    ),
    _of_gain(("all TE {:.3g} % too {}",), _larger(1.0, -1.0)),
    _of_gain(("all TE backward {:.3g} % too {}",), _larger(-1.0), "column_scale"),
    _of_gain(("all TE {:.3g} % too {} in the last run, and before in proportion to the run's number",), _growing),
    _of_gain((_DELAYED.format("backward"),), _delayed(-1.0), most=(180.0,)),
    _of_gain((_DELAYED.format("forward"),), _delayed(1.0), most=(180.0,)),
    _of_gain((_FADED,), _faded),
    _of_gain((_FADED, "beside that {:.3g} deg too {} there, by the cube elsewhere"), _faded_and_turned,
             steps=(0.1, 0.1), most=(60.0, 60.0)),
    WrongReading("exchanged_directions", ("forward and backward exchanged",), _exchanged),
)  # fmt: skip


#: units of what follows the speed: frequencies, times and speeds
_OF_TIME = re.compile("Hz|rpm|[mu]s$")


@lru_cache(maxsize=1)
def _readings(ratio: float) -> tuple[WrongReading, ...]:
    """All readings of a gear of this ratio: speeds in other units are too far off for steps towards them."""

    def of(changed: Callable[[Conditions], Conditions]) -> Reread:
        return lambda data, _size: data.under(speed_rpm=changed(data.at).speed_rpm)

    units = (
        WrongReading(_SPEED, (f"all speeds {text}",), of(changed))
        for column, text, changed in readings(ratio)
        if column == "speeds"
    )
    return (*READINGS, *units)


def _of(final: Fit, *numbers: int) -> tuple[WrongReading, ...]:
    """The readings that may stand for some pieces, or for any that are free: units of speed for what follows it."""
    pieces = [final.state.pieces[i] for i in numbers] or [piece for piece in final.state.pieces if piece.free]
    units = [scalar.unit for piece in pieces for scalar in piece.effect.scalars]
    units += [phasor.unit for piece in pieces for phasor in piece.effect.phasors]
    return _readings(final.target.reduction_ratio) if any(map(_OF_TIME.search, units)) else READINGS


def misread(final: Fit, changed: Collection[int]) -> tuple[Misread, ...]:
    """Readings that do what changes of the rig do as well as these, the one that stands for most of them first.

    final: the fit with the changes; changed: the numbers of their pieces (OFFSET: that of the zero).
    """
    everything = frozenset(changed)
    if not everything or final.target.data.angle_rad is not None:
        return ()
    plain = fit(final.target, final.state.held({*changed, OFFSET}), steps=SETTINGS.quick_steps)

    def of_one(reading: WrongReading) -> Misread | None:
        chance = _chance_beside(final, reading, everything)
        return _instead(final, plain, reading, chance) or _beside_the_rest(final, reading, chance)

    def of_two(pair: WrongReading) -> Misread | None:
        return _instead(final, plain, pair, _chance_beside(final, pair, everything))

    standing = _that_stand(final, _of(final), of_one)
    if len(everything) >= SETTINGS.changes_of_two and not any(one.is_asked for one in standing):
        standing += _that_stand(final, _likely_pairs(plain), of_two)
    return tuple(sorted(standing, key=lambda one: (-len(one.instead_of), len(one.sizes), one.best.loss)))


def _that_stand(
    final: Fit, readings: Sequence[WrongReading], looked_at: Callable[[WrongReading], Misread | None]
) -> list[Misread]:
    """What was found for each reading, but for None; all processors share the work where the data are large.

    looked_at: what there is for one, with a best fit to the data as it means them; final: one of the same effects.
    """

    target = final.target
    if target.at_once == 1:
        return [one for one in map(looked_at, readings) if one is not None]
    for reading in readings:
        if not reading.steps:
            reading.meant(target.data, np.zeros(0))  # what takes long is kept for all copies

    def made(reading: WrongReading) -> tuple[FloatArray, Packed, tuple[Any, ...]] | None:
        one = looked_at(reading)
        if one is None:
            return None
        # a reading is made of functions, which cannot travel
        return one.sizes, one.best.packed, (one.instead_of, one.touched, one.unexplained, one.leaves)

    standing = list[Misread]()
    for reading, one in zip(readings, shared_out(made, readings, is_large=True, at_once=target.at_once), strict=True):
        if one is not None:
            sizes, best, (instead, *rest) = one
            found = unpacked(best, _as_meant(target, reading, sizes), final.state)
            standing.append(Misread(reading, sizes, instead, found, *rest))
    return standing


def _both(one: WrongReading, other: WrongReading) -> WrongReading:
    """Two readings of one number each at once, under the name of the first."""

    def gain(data: Observations, size: FloatArray) -> FloatArray | ComplexArray:
        of_one = 1.0 if one.gain is None else one.gain(data, size[:1])
        return of_one * (np.ones((1, 1)) if other.gain is None else other.gain(data, size[1:]))

    return WrongReading(
        one.name,
        (*one.texts, *other.texts),
        lambda data, size: other.meant(one.meant(data, size[:1]), size[1:]),
        (*one.steps, *other.steps),
        (*one.most, *other.most),
        gain=None if one.gain is None and other.gain is None else gain,
        said=lambda size: np.concatenate([one.said(size[:1]), other.said(size[1:])]),
        units=one.units,
    )


def _likely_pairs(plain: Fit) -> list[WrongReading]:
    """The pairs of readings, of one number and a column each, that save most beside a fit, by a linear step."""
    singles = [one for one in READINGS if len(one.steps) == 1]
    slopes = [_slopes(plain.target, plain, one, np.zeros(1))[0] for one in singles]
    matrix, pull = _normal(plain, slopes)
    first = len(plain.prior)

    def saved(pair: tuple[int, int]) -> float:
        chosen = [*range(first), *(first + i for i in pair)]
        known = inverse(matrix[np.ix_(chosen, chosen)])[-2:, -2:]
        return float(pull[chosen[-2:]] @ known @ pull[chosen[-2:]])

    pairs = [
        (i, j)
        for i, j in itertools.combinations(range(len(singles)), 2)
        if singles[i].name != singles[j].name and slopes[i][1].any() and slopes[j][1].any()
    ]
    return [_both(singles[i], singles[j]) for i, j in heapq.nlargest(SETTINGS.pairs_tried, pairs, saved)]


def in_place_of_additions(final: Fit) -> tuple[Misread, ...]:
    """Readings that do what one added effect does as well as it, with all else that was found kept and free."""
    standing = list[Misread]()
    added = [i for i, piece in enumerate(final.state.pieces) if piece.added]
    for number in added if final.target.data.angle_rad is None else ():
        piece = final.state.pieces[number]
        without = final.state.replaced(number, replace(piece, effect=piece.absent, free=frozenset()))
        plain = fit(final.target, without, steps=SETTINGS.quick_steps)
        if plain.loss - final.loss < SETTINGS.as_good:
            continue  # where the rest does as well by itself, a reading of nothing would, too
        standing += _that_stand(final, _of(final, number), partial(_does_as_well, final, plain, number))
    return tuple(sorted(standing, key=lambda one: (len(one.sizes), one.best.loss)))


def _does_as_well(final: Fit, plain: Fit, number: int, reading: WrongReading) -> Misread | None:
    """A reading in place of the added piece of a number; plain: the fit without it. None where it does less."""
    piece = final.state.pieces[number]
    if reading.steps and _gain(plain, reading) < SETTINGS.clear_beside * (plain.loss - final.loss):
        return None
    sizes, best = _read(plain.target, plain.state, reading, known=plain if reading.steps else None)
    # what it gains on other orders does not make it a name for what this one does on its own, nor for one that it
    # leaves worse
    worse = best.target.losses(best.residual).sum(axis=0) - final.target.losses(final.residual).sum(axis=0)
    own = np.isin(final.target.data.orders, piece.effect.touched_orders())
    lost = max(best.loss - final.loss, float(worse.max()), float(worse[own].sum()))
    extra = len(sizes) - len(piece.coordinates())
    return Misread(reading, sizes, frozenset({number}), best) if lost + 2.0 * max(extra, 0) < SETTINGS.as_good else None


def _gain(plain: Fit, reading: WrongReading) -> float:
    """The loss that a reading saves beside all that is free in a fit, by a linear step."""
    columns = _slopes(plain.target, plain, reading, np.zeros(len(reading.steps)))
    if not all(values.any() for _, values in columns):
        return 0.0
    count, (matrix, pull) = len(columns), _normal(plain, columns)
    return float(pull[-count:] @ inverse(matrix)[-count:, -count:] @ pull[-count:])


def _normal(fitted: Fit, columns: Sequence[Column]) -> tuple[FloatArray, FloatArray]:
    """The normal matrix of all that is free in a fit and of columns beside it, what is believed of it in it, and the
    pull of what the fit leaves.
    """
    weights = fitted.target.weights(fitted.residual)
    every = (*fitted.columns, *columns)
    matrix, pull = gather(fitted.target, every, fitted.residual, weights, by_cell=False).total()
    return matrix + np.diag(np.concatenate([fitted.prior, np.zeros(len(columns))])), pull


def in_place_of_a_move(final: Fit, number: int) -> frozenset[str]:
    """The name of the reading that leaves no more than a resonance that moves with the load, if it does: speeds that
    are read the higher the larger the load, as those of a motor that slips, where the resonance itself stands still.
    """
    piece, data = final.state.pieces[number], final.target.data
    if not piece.effect.values.get("frequency_per_kNm") or data.angle_rad is not None:
        return frozenset()
    still = piece.without({"frequency_per_kNm", "levels_off_per_kNm"})
    at_rest = replace(data.at, temperature_C=np.full(len(data), piece.effect.constants.reference_temperature_C))
    still_Hz = piece.effect.scalar("frequency_Hz")
    moved_Hz = max(frequencies_in(piece.effect, at_rest), key=lambda hertz: abs(hertz - still_Hz))
    sizes = np.array([100.0 * (1.0 - still_Hz / moved_Hz)])
    if abs(sizes[0]) > _SLIP.most[0]:
        return frozenset()
    sizes, best = _read(final.target, final.state.replaced(number, still), _SLIP, sizes)
    return frozenset() if abs(sizes[0]) > _SLIP.most[0] or _is_needed(best, final, 1) else frozenset([_SLIP.name])


def in_place_of_the_rest(final: Fit, orders: Collection[int]) -> tuple[Misread, ...]:
    """Readings that leave nothing but noise of most of the orders (`orders`) that stay unexplained, the best first."""
    data, target = final.target.data, final.target
    good = target.good
    if data.angle_rad is not None:
        return ()
    noise = (data.parts * target.sigma[good] ** 2).mean(axis=0)
    told = SETTINGS.told / np.sqrt(good.sum()) * noise

    def left(one: Fit) -> FloatArray:
        """The power of each order that is more than noise."""
        return np.asarray(np.maximum((np.abs(one.residual[good]) ** 2).mean(axis=0) - noise, 0.0))

    whole = left(final)
    columns = np.isin(data.orders, list(orders)) & (whole > 2.0 * told)
    if not columns.any():
        return ()
    before = whole[columns]

    def looked_at(reading: WrongReading) -> Misread | None:
        sizes, best = _read(target, final.state, reading, rounds=1, known=final if reading.steps else None)
        if left(best)[columns].sum() < SETTINGS.begins_to_do * before.sum():
            sizes, best = _read(target, best.state, reading, sizes, known=best)
        found = left(best)
        after = found[columns]
        gone = after < SETTINGS.left_of_rest * before + told[columns]
        # nor may an order be left worse that the rig explains as the data are
        if 2 * gone.sum() <= len(gone) or not (found < whole + told).all():
            return None
        # what wanders while the runs are made passes for noise where runs are compared with their neighbours
        drifts = changes_with_time(target, best.residual)
        drifts |= np.array([course is not None for course in structure(best.target, best.residual).courses])
        drifts = drifts[columns][gone]
        rest = frozenset(data.orders[columns][gone][~drifts].tolist())
        if not rest:
            return None
        leaves = f"less than {SETTINGS.left_of_rest:.0%} of the power"
        if (after < told[columns])[gone].all():
            # runs may differ by more than is known to be noise: then it would be said to be unexplained all the same
            stays = is_left(best.target, best.residual)[columns][gone].any()
            leaves = "no more than runs differ by" if stays else "nothing but noise"
        read = Misread(reading, sizes, frozenset(), best, unexplained=rest, leaves=leaves)
        return _with_what_changed(read, target)

    return tuple(
        sorted(_that_stand(final, _of(final), looked_at), key=lambda one: (-len(one.instead_of), one.best.loss))
    )


def _with_what_changed(one: Misread, target: FitData) -> Misread:
    """The reading in place of all changes of the rig as well, where the data need none of them beside it."""
    state = one.best.state
    everything = frozenset(i for i, piece in enumerate(state.pieces) if piece.free and not piece.added)
    everything |= {OFFSET} if state.offset_free else frozenset()
    if not everything:
        return one
    sizes, best = _read(target, state.held({*everything, OFFSET}), one.reading, one.sizes)
    if _is_needed(best, one.best, 0):
        return one
    return replace(one, sizes=sizes, best=best, instead_of=everything)


def refined(final: Fit, accepted: Collection[str]) -> Misread | None:
    """By how much the correction of an accepted mistake is off, now that what is missing is known; None for nothing.

    What it was estimated by before held what was missing as well. accepted: names of the mistakes.
    """
    least = SETTINGS.order_gain * max(1.0, final.loss / max(int(final.target.counts.sum()), 1))
    found: list[tuple[float, Misread]] = []
    for reading in READINGS:
        if reading.refines in accepted and final.target.data.angle_rad is None:
            sizes, read = _read(final.target, final.state, reading)
            # another number must be worth it
            gain = final.loss - read.loss - SETTINGS.as_good * (len(sizes) - 1)
            if gain > least:
                found.append((gain, Misread(reading, sizes, frozenset(), read)))
    return max(found, key=lambda one: one[0])[1] if found else None


def _chance_beside(final: Fit, reading: WrongReading, everything: frozenset[int]) -> dict[int, tuple[float, float]]:
    """The chance of each change by noise where a reading is free as well, by a linear step, and the loss it saves.

    The chance is large where the reading does what it does; where it is too small for a number the loss, negative, says
    how small.
    """
    columns = _slopes(final.target, final, reading, np.zeros(len(reading.steps)))
    columns = columns if all(values.any() for _, values in columns) else []
    known = inverse(_normal(final, columns)[0])
    away, slices = final.state.vector() - final.centre, final.state.slices()
    away[0] = final.state.offset - final.state.rig.zero_offset_deg
    found: dict[int, tuple[float, float]] = {}
    for i in everything:
        place = slice(0, 1) if i == OFFSET else slices[i]
        gain = float(away[place] @ np.linalg.solve(known[place, place], away[place]))
        found[i] = chi_square_tail(gain, len(away[place])), -gain
    return found


def _instead(
    final: Fit, plain: Fit, reading: WrongReading, chance: Mapping[int, tuple[float, float]]
) -> Misread | None:
    """A reading with as many of the changes as it needs to be as good as all of them; None where it needs all.

    chance: of each change beside the reading; those that it is furthest from doing are tried first.
    """
    everything = frozenset(chance)
    sizes, best = _read(plain.target, plain.state, reading, known=plain if reading.steps else None)
    if plain.loss - best.loss < SETTINGS.order_gain:
        return None
    kept: set[int] = set()
    while _is_needed(best, final, len(sizes)):
        # a reading of several numbers stands for as many changes at least
        if len(kept) >= min(SETTINGS.beside_reading, len(everything) - max(len(sizes), 1)):
            return None
        nearest = sorted(everything - kept, key=lambda i: chance[i])[: SETTINGS.changes_tried]
        trials = {i: _read(plain.target, _freed(best.state, final, i), reading, sizes, rounds=1) for i in nearest}
        number = min(trials, key=lambda i: trials[i][1].loss)
        kept.add(number)
        sizes, best = _read(plain.target, trials[number][1].state, reading, trials[number][0])
    for number in sorted(kept):
        # near the right sizes it may be none that is needed: a narrow peak tells them from nearby only
        again = _read(plain.target, best.state.held({number}), reading, sizes)
        if not _is_needed(again[1], final, len(sizes)):
            kept.remove(number)
            sizes, best = again
    instead = everything - kept
    return Misread(reading, sizes, instead, best) if len(instead) >= max(len(sizes), 1) else None


def _beside_the_rest(final: Fit, reading: WrongReading, chance: Mapping[int, tuple[float, float]]) -> Misread | None:
    """A reading that does what one of many changes does, or a few, and leaves the others; None where it does nothing.

    Another unit of a type has many numbers of its own, and a sensor's zero beside them.
    """
    if not reading.steps or len(chance) <= SETTINGS.beside_reading:
        return None
    instead, sizes, best = set[int](), np.zeros(len(reading.steps)), final
    for i in sorted(chance, key=lambda i: chance[i], reverse=True):
        if chance[i][0] < SETTINGS.p_changed:
            break
        again = _read(final.target, best.state.held({i}), reading, sizes)
        if not _is_needed(again[1], final, len(sizes)):
            instead.add(i)
            sizes, best = again
    if len(instead) < len(sizes):
        return None
    moved = [np.abs(slope).any(axis=0) for _, slope in _slopes(final.target, final, reading, np.zeros(len(sizes)))]
    orders = set(final.target.data.orders[np.any(moved, axis=0)].tolist())
    own = [{0} if i == OFFSET else set(final.state.pieces[i].effect.touched_orders()) for i in chance]
    return Misread(reading, sizes, frozenset(instead), best, sum(bool(one & orders) for one in own))


def _is_needed(without: Fit, final: Fit, sizes: int) -> bool:
    """Whether the data refuse the rig's own values of what `without` holds there, as they must of any change.

    sizes: how many numbers it has in place of these.
    """
    # a zero that is held has its place among the coordinates as well
    zero = int(final.state.offset_free and not without.state.offset_free)
    numbers = max(len(final.prior) - len(without.prior) + zero - sizes, 1)
    # what it gains on other orders does not pay for one that it leaves
    worse = without.target.losses(without.residual).sum(axis=0) - final.target.losses(final.residual).sum(axis=0)
    return chi_square_tail(max(without.loss - final.loss, float(worse.max())), numbers) < SETTINGS.p_changed


def _freed(state: State, final: Fit, number: int) -> State:
    if number == OFFSET:
        return replace(state, offset_free=True)
    return state.replaced(number, final.state.pieces[number])


def _as_meant(target: FitData, reading: WrongReading, sizes: FloatArray) -> FitData:
    """What is fitted where data were read wrong by so much, and the noise with it."""
    data = reading.meant(target.data, sizes)
    noise = np.ones((1, 1)) if reading.gain is None else np.abs(reading.gain(target.data, sizes))
    wide = None if target.wide is None else target.wide / noise
    made = replace(target, data=data, sigma=target.sigma / noise, wide=wide)
    # what was kept of columns is that of these conditions
    return made if data.at is target.data.at else replace(made, cache={}, responses={})


def _slopes(target: FitData, best: Fit, reading: WrongReading, sizes: FloatArray) -> list[Column]:
    """What the residual of a fit loses by each size of a reading; target: with the data as they were read."""
    columns: list[Column] = []
    for number, step in enumerate(reading.steps):
        ahead = sizes + step * (np.arange(len(sizes)) == number)
        times: FloatArray | ComplexArray = np.zeros(1)
        if reading.gain is not None:
            times = reading.gain(target.data, ahead) / reading.gain(target.data, sizes) - 1.0
        if times.any():
            # of what the model says: smaller noise is no better a model
            slope = (best.target.data.values - best.residual) * times / step
        else:
            slope = (best.residual - _as_meant(target, reading, ahead).residual(best.state.model())) / step
        columns.append((np.arange(slope.shape[1]), slope))
    return columns


def covariance_of_corrections(final: Fit) -> FloatArray:
    """What the coordinates of a fit may be off by since corrections of the data are told no better, (p, p)."""
    found = np.zeros((len(final.prior), len(final.prior)))
    weights = final.target.weights(final.residual)
    for reading in READINGS:
        if reading.refines not in final.target.corrected or len(reading.steps) != 1:
            continue
        columns = _slopes(final.target, final, reading, np.zeros(1))
        if columns[0][1].any():
            matrix = gather(final.target, (*final.columns, *columns), final.residual, weights, by_cell=False).total()[0]
            moved = final.inverse @ matrix[:-1, -1]
            # beside all that is free
            told = matrix[-1, -1] - matrix[:-1, -1] @ moved
            found += np.outer(moved, moved) / max(float(told), 1e-300)
    return found


def _read(
    target: FitData,
    state: State,
    reading: WrongReading,
    sizes: FloatArray | None = None,
    rounds: int = SETTINGS.quick_steps,
    known: Fit | None = None,
) -> tuple[FloatArray, Fit]:
    """The sizes of a reading, and all that is free in a state beside it: the best there is near some sizes.

    known: the fit of the state at these sizes, where there is one.
    """

    def fitted(sizes: FloatArray, state: State) -> Fit:
        return fit(_as_meant(target, reading, sizes), state, steps=SETTINGS.quick_steps)

    count = len(reading.steps)
    sizes = np.zeros(count) if sizes is None else sizes
    best = fitted(sizes, state) if known is None else known
    for _ in range(rounds if count else 0):
        columns = _slopes(target, best, reading, sizes)
        if not all(values.any() for _, values in columns):
            break
        matrix, pull = _normal(best, columns)
        pull = pull - np.concatenate([best.prior * (best.state.vector() - best.centre), np.zeros(count)])
        covariance = inverse(matrix)
        step, error = (covariance @ pull)[-count:], np.sqrt(np.diag(covariance)[-count:])
        # far from a narrow peak a whole step may lead beyond it
        while (np.abs(step) > SETTINGS.of_an_error * error).any():
            aim = sizes + step
            trial = fitted(aim, best.state) if (np.abs(aim) < reading.most).all() else best
            if trial.loss < best.loss - SETTINGS.quick_tolerance:
                break
            step = step / 4.0
        else:
            break
        sizes, best = aim, trial
    return sizes, best
