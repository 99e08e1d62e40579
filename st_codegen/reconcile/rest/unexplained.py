"""What no effect explains: which orders still hold more than noise, how that depends on the conditions, and how large.

Whether there is something is decided in `structure`; sizes and causes are measured on the residual as it is.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import orth

from st_codegen.errors import at_least
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.chances import f_tail
from st_codegen.reconcile.data.contrasts import AXES, UNITS, levels_by_condition
from st_codegen.reconcile.data.hum import Hum
from st_codegen.reconcile.data.observations import whole_percent
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.rest.formulas import Formula, formula_of
from st_codegen.reconcile.rest.in_time import Course
from st_codegen.reconcile.rest.lasting import changes_with_time, lasting_mean, without_lasting
from st_codegen.reconcile.rest.structure import (
    ResidualStructure,
    beyond_loud_runs,
    by_directions,
    level_designs,
    loudest_column,
    noise_within,
    of_an_encoder,
    pairs_of,
    rms_of_component,
    scatter,
    structure,
    sure_times,
    told_beside,
)
from st_codegen.reconcile.rest.unseen import one_after_the_other
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects.base import Constants


def dependence(target: FitData, r: ComplexArray, noise_power: float, course: Course | None) -> dict[str, float]:
    """The constant of a residual (n,), and what each factor explains beyond it, as shares of their sum.

    `combination` is what neighbours share and no factor explains alone. noise_power: deg^2, of one run.
    """
    designs = level_designs(target)
    good = r[target.good]
    constant = orth(designs["constant"], rcond=1e-8)
    found = {"constant": float((np.abs(constant.T @ good) ** 2).sum())}
    for name in AXES:
        basis = orth(designs[name], rcond=1e-8)
        own = float((np.abs(basis.T @ good) ** 2).sum()) - found["constant"]
        found[name] = max(0.0, own - noise_power * (basis.shape[1] - constant.shape[1]))
    if course is not None:
        found["time"] = course.power * len(good)
    whole = float((np.abs(good) ** 2).sum()) - noise_power * len(good)
    found["combination"] = max(0.0, whole - sum(found.values()))
    total = sum(found.values()) or 1.0
    return {name: value / total for name, value in found.items()}


def _holds_elsewhere(target: FitData, r: ComplexArray, name: str) -> bool:
    """Whether the levels of one condition tell left-out levels of each other one better than a constant does.

    What wanders while the runs are made differs between the levels of a condition that was set one after the other.
    """
    designs, y = level_designs(target), r[target.good]
    own, constant = designs[name], designs["constant"]
    for other, levels in levels_by_condition(target.data.at).items():
        level, gain = levels[target.good], 0.0
        for n in np.unique(level) if other != name else ():
            out, rest = level == n, level != n
            # a level of its own that is not among the others is told by none of them
            known = own[out] @ own[rest].any(axis=0) > 0
            left = [
                y[out] - design[out] @ np.linalg.lstsq(design[rest].astype(np.complex128), y[rest], rcond=None)[0]
                for design in (constant, own)
            ]
            gain += float(((np.abs(left[0]) ** 2 - np.abs(left[1]) ** 2) * known).sum()) if rest.any() else 0.0
        if gain < 0.0:
            return False
    return True


@dataclass(frozen=True)
class Signature:
    """One unexplained part.

    order: -1 where it has a frequency (`hertz`) or a number of periods a turn that is not whole (`periods`) instead, or
    where several tell it together; rms_deg, power (deg^2): of what is no noise, over all runs and angles; dependence:
    shares by factor; direction: `both`, `forward`, `backward`; text: a sentence; amplitude_deg: the largest of the
    formula, or of the levels of the factor on which it depends most; formula: the simplest expression that the data
    hold, or None; at_least: runs alone tell the noise beside it, which holds what is unexplained as well, so that the
    size may be larger; would_be: the effect that it would be, were it not fainter than the noise of a run; share: of
    the power of the whole gap; has_levels: whether its size, though no law of it, depends on a condition.
    """

    order: int
    rms_deg: float
    power: float
    dependence: dict[str, float]
    direction: str
    text: str
    amplitude_deg: float = 0.0
    formula: Formula | None = None
    at_least: bool = False
    hertz: float = 0.0
    would_be: str = ""
    periods: float = 0.0
    share: float = 0.0
    has_levels: bool = False

    @property
    def is_scatter(self) -> bool:
        """Whether no pattern over the conditions was found in it."""
        return "scatter" in self.dependence

    @property
    def depends_on_the_load(self) -> bool:
        """Whether the load alone is told to be what it depends on."""
        return "torque" in self.dependence and main_cause(self.dependence) == "torque"

    def of_gap(self, gap_power: float) -> Signature:
        """This one with its share of a whole gap, deg^2."""
        return replace(self, share=min(1.0, self.power / max(gap_power, 1e-300)))

    def of_machine(self, constants: Constants) -> Signature:
        """This one with the part of the machine that has its order, which need not be what makes it."""
        part = constants.shaft_of(self.periods) if self.periods else constants.part_of(self.order)
        name = f"{self.periods:.1f}" if self.periods else self.order
        return replace(self, text=f"{self.text} ({name} = {part})") if part else self


def of_a_hum(hum: Hum) -> Signature:
    """The signature of a wave of no order."""
    seen, of = hum.curves
    return Signature(
        -1,
        hum.amplitude_deg * float(np.sqrt(seen / of / 2)),
        hum.power,
        {"time" if hum.frequency_Hz else "combination" if hum.varies else "constant": 1.0},
        "both",
        hum.text,
        hum.amplitude_deg,
        hertz=hum.frequency_Hz,
        periods=hum.order,
    )


def beside_the_rigs(orders: Collection[int], its: Iterable[int]) -> list[int]:
    """Orders that lie one beside those of the rig (`its`), where at least half of them do; none where few or others do.

    So they look where these orders change once a turn of the output, or where the angle is read wrong.
    """
    made = set(its) - {0}
    beside = sorted(k for k in orders if k not in made and {k - 1, k + 1} & made)
    return beside if len(beside) >= SETTINGS.least_beside and 2 * len(beside) >= len(orders) else []


def _with_hums(one: Signature, hums: Sequence[Hum]) -> Signature:
    """The signature of an order with what hums made of it before they were taken out: that is unexplained there too."""
    made = float(np.linalg.norm([hum.by_order[one.order] for hum in hums if one.order >= 0]))
    if not made or made < SETTINGS.form * one.rms_deg:
        return one
    # the wave has its share of the gap by itself
    whole = float(np.hypot(one.rms_deg, made))
    text = f"{one.text} (beside {made:.2g} deg RMS of a wave of no order that was taken out: this may be left of that)"
    return replace(one, rms_deg=whole, text=text)


def signatures(
    target: FitData,
    residual: ComplexArray,
    floor: FloatArray,
    claimed: BoolArray | None = None,
    kept: BoolArray | None = None,
) -> list[Signature]:
    """Signatures of all orders with significant structure, largest first.

    floor: RMS of one component of the noise by order, (K,); claimed: bool (K,), the
    orders on which something is named or changed. What is left of these must be noise, each by its own: the noise of
    the other orders may be many times as large and hide a form that is not quite right. kept: bool (K,), orders of
    which it is known that they keep more than noise.
    """
    found = structure(target, residual)
    asked = np.zeros(len(found.orders), bool) if claimed is None else claimed
    significant = found.significant_among(asked)
    alike = beyond_loud_runs(target, residual) if significant.any() else significant
    beside = without_lasting(target, target.data.with_real_mean(residual)) if significant.any() else residual
    out = [
        _signature(target, residual, beside[:, k], found, int(k), floor[k], is_alike=bool(alike[k]))
        for k in np.flatnonzero(significant)
    ]
    loud = (rms_of_component(target, residual) > sure_times(target) * floor) & asked
    loud[scatter(target, residual)] = True
    loud |= False if kept is None else kept
    # what the mean of runs differs by is its floor, where that comes from the runs, and both directions do not share it
    directions = by_directions(target, residual)
    beyond = (rms_of_component(target, residual) > sure_times(target) * floor) | directions[0]
    loud &= (target.data.orders > 0) | beyond
    out += [
        _scattered(target, residual, directions, int(k), floor[k])
        for k in np.flatnonzero(loud & ~significant & (of_an_encoder(target, residual) == 0))
    ]
    return sorted((_with_hums(one, target.data.hums) for one in out), key=lambda signature: -signature.rms_deg)


def loudest(target: FitData, residual: ComplexArray, floor: FloatArray) -> Signature:
    """The signature of the order that keeps most beyond its floor, where all together keep more than noise."""
    k = loudest_column(target, residual, floor)
    return _scattered(target, residual, by_directions(target, residual), k, floor[k])


def _scattered(
    target: FitData, residual: ComplexArray, directions: tuple[BoolArray, FloatArray], k: int, floor: float
) -> Signature:
    """An order that keeps more than its noise, with no pattern that was found.

    directions: see `by_directions`; floor: RMS of one component of the noise.
    """
    order = int(target.data.orders[k])
    # RMS over the angle: of a wave half the square of its amplitude, of the mean its square
    power = float((np.abs(residual[target.good, k]) ** 2).mean()) / (2 if order else 1)
    direction = _direction(target, residual[:, k])
    own, what = _noise_of_order(target, residual, directions, k, floor, direction)
    # what runs, or their directions, differ by may be more of what is unexplained
    is_least = what.startswith((_LIKE_THEM, _BOTH_SIDES, _NEAR_THEM))
    loud_at = _where_loud(target, residual[:, k])
    where = loud_at or "with no pattern over the conditions that was found"
    why = "runs differ, or the structure is sharp"
    # where noise lasts over runs their mean is told by fewer of them
    lasting = 0.0 if order else float(lasting_mean(target, residual)[k])
    is_common = _is_common(target, residual[:, k], order, max(power - own, 0.0), lasting)
    if is_common:
        where, why = "most of it the same in all runs of a direction", "they differ by less of it"
    elif changes_with_time(target, residual[:, k : k + 1])[0]:
        why = _WITH_TIME
    size = float(np.sqrt(max(power - own, 0.0)))
    name = f"order {order}" if order else "the mean"
    times, rms = _digits(float(np.sqrt(power / own))), _size(size, is_least=is_least)
    text = (
        f"{name}: {rms} deg RMS beyond the noise, with it {times} times {what}, {where}: {why}"
        if size
        else f"{name}: no louder than {what} over all runs, but single runs that are not called bad are far off in it"
    )
    text += _side(target, residual[:, k], own * (2 if order else 1))
    few = "" if is_common else _few_curves(target, residual[:, k])
    text += few or ("" if target.data.repeated or is_common else "; repeat some runs")
    return Signature(
        order,
        size,
        size**2,
        {"constant" if is_common else "scatter": 1.0},
        direction,
        text,
        size * (np.sqrt(2) if order else 1.0),
        at_least=is_least,
        has_levels=bool(loud_at),
    )


def _few_curves(target: FitData, r: ComplexArray) -> str:
    """Which curves hold most of the power of a residual (n,), where these are few; empty where many do."""
    power, count = np.abs(np.where(target.good, r, 0.0)) ** 2, int(target.good.sum())
    loudest = np.argsort(-power, kind="stable")[: min(SETTINGS.few_named, int(SETTINGS.most_suspects * count))]
    shares = np.cumsum(power[loudest]) / max(float(power.sum()), 1e-300)
    enough = np.flatnonzero(shares >= SETTINGS.held_by_few)
    if not len(enough):
        return ""
    held = int(enough[0]) + 1
    names = ", ".join(target.data.labels[row] for row in loudest[:held])
    again = "repeat these" if held > 1 else "repeat it"
    return f"; {whole_percent(float(shares[held - 1]))} % of its power is in {held} of {count} curves: {names}; {again}"


_LIKE_THEM = "what runs differ by from others like them"
_NEAR_THEM = "what the means of runs near each other differ by"
_BOTH_SIDES = "what both directions of a run differ by"


def _noise_of_order(
    target: FitData,
    residual: ComplexArray,
    directions: tuple[BoolArray, FloatArray],
    k: int,
    floor: float,
    direction: str,
) -> tuple[float, str]:
    """The least power that an order's noise is known to have, deg^2, and what it is of.

    directions: see `by_directions`; floor: RMS of one component of its noise; direction: in which one its residual is.
    """
    parts, (shared, apart) = int(target.data.parts[k]), directions
    own, differ = float(noise_within(target)[k] ** 2), float(apart[k] ** 2)
    what = within = "what orders beside it differ by" if told_beside(target.data)[k] else "the noise within the curves"
    if differ < own:
        own, what = differ, _BOTH_SIDES
    # what one direction alone has is what both differ by
    quiet = _quietest_direction(target, residual[:, k]) / parts
    if direction != "both" and quiet < own:
        own, what = max(quiet, SETTINGS.least_noise_deg**2), "what the other direction has"
    if parts == 1 and own < floor**2 and not shared[k]:
        # the floor of the mean is that within the curves as well, where no more is known
        of_curves = floor <= noise_within(target)[k] < np.inf
        own, what = floor**2, within if of_curves else _NEAR_THEM
    if parts == 1 and shared[k] and target.run_offset_deg:
        own, what = own + target.run_offset_deg**2, f"{what}, with what the rig says that runs differ by"
    if floor**2 < own and not np.isclose(floor**2, own):
        own, what = floor**2, _LIKE_THEM
    return own, what


def _is_common(target: FitData, r: ComplexArray, order: int, beyond: float, lasting: float) -> bool:
    """Whether a residual (n,) has a mean in the runs of a direction that is no chance, and most of what is beyond noise
    (power over the angle) is that; lasting: the mean (deg) of noise that lasts over runs.
    """
    at, good, parts = target.data.at, target.good, 2 if order else 1
    own: ComplexArray = r if order else r.real.astype(np.complex128)
    means = np.array([own[rows].mean() for rows in at.by_direction(good)])
    if (np.abs(means) ** 2).mean() / parts < SETTINGS.same_in_runs * beyond:
        return False
    # both directions of a run may share what they differ by: what they have alike, and what turns with them
    pairs = pairs_of(target)
    first, second = own[pairs].T
    tested: list[ComplexArray] = [(first + second) / 2.0, (first - second) / 2.0] if len(pairs) else [own[good]]
    return any(_is_no_chance(one, parts, lasting) for one in tested)


def _is_no_chance(values: ComplexArray, parts: int, lasting: float) -> bool:
    """Whether values (n,) have a mean beyond what noise that lasts may have, and their scatter."""
    freedom = len(values) - 1
    mean = max(abs(values.mean()) - lasting, 0.0) if len(values) else 0.0
    if freedom < SETTINGS.least_beside_a_law // 2 or not mean:
        return False
    differ = float((np.abs(values - values.mean()) ** 2).sum()) / freedom
    return bool(f_tail(len(values) * mean**2 / max(differ, 1e-300), parts, freedom * parts) < SETTINGS.p_law)


def _size(deg: float, *, is_least: bool) -> str:
    """A size, or the least that it is."""
    return f"at least {at_least(deg)}" if is_least else f"{deg:.2g}"


def _digits(times: float) -> str:
    """A factor with the digits that say something."""
    return f"{times:.1f}" if times < SETTINGS.whole_times else f"{times:.0f}"


def _where_loud(target: FitData, r: ComplexArray) -> str:
    """At which levels of a condition a residual (n,) is large, whatever its phase; empty where no condition tells.

    There it may have another phase in each run, so that no law of the conditions shows. A level where it is clearly
    larger than at all others says so by itself; else the sizes of the runs of all levels are compared by their ranks.
    """
    # only here: it takes a fifth of a second, and few campaigns come here
    from scipy.stats import kruskal, spearmanr

    at, good = target.data.at, target.good
    power = np.abs(r[good]) ** 2
    runs = np.array([power[rows].mean() for rows in _rows_of_runs(target)])
    first = np.array([rows[0] for rows in _rows_of_runs(target)])
    told: list[tuple[float, str]] = []
    for (name, levels), values in zip(levels_by_condition(at).items(), at.axes, strict=True):
        level = levels[good]
        sizes = {int(n): float(np.sqrt(power[level == n].mean())) for n in np.unique(level)}
        low, top = (chosen(sizes, key=lambda n: sizes[n]) for chosen in (min, max))
        there = level == top
        if there.all() or there.sum() < SETTINGS.least_block:
            continue
        # a single run is no level
        usual, rest = float(np.median(power[there])), float(power[~there].mean())
        if usual > SETTINGS.stands_out * rest:
            same = _same_or_another(r[good][there], at.sign[good][there])
            return f"{sizes[top]:.2g} deg {_at_level(name, values[good][there])}, {same}"
        own = level[first]
        groups = [runs[own == n] for n in np.unique(own)]
        if min(map(len, groups)) >= SETTINGS.least_block and np.ptp(runs) > 0.0:
            here = [f"{sizes[n]:.2g} deg {_at_level(name, values[good][level == n])}" for n in (top, low)]
            # what rises, or falls, from level to level is seen sooner
            chance = min(kruskal(*groups).pvalue, spearmanr(own, runs).pvalue)
            same = _same_or_another(r[good][there], at.sign[good][there])
            told.append((float(chance), f"{here[0]} and {here[1]}, {same}"))
    chance, text = min(told, default=(1.0, ""))
    return text if chance < SETTINGS.p_chance else ""


def _same_or_another(r: ComplexArray, sign: FloatArray) -> str:
    """Whether runs (n,) of a level have the same in each direction."""
    mean = np.array([r[sign == side].mean() for side in sign])
    share = float((np.abs(mean) ** 2).sum() / max(float((np.abs(r) ** 2).sum()), 1e-300))
    if share > SETTINGS.same_in_runs:
        return "most of it the same in the runs of a direction"
    return "most of it another in each run" if share > SETTINGS.same_in_runs / 2 else "another in each run"


def _rows_of_runs(target: FitData) -> list[IntArray]:
    """The places of each run's curves among those that are good."""
    place = np.cumsum(target.good) - 1
    kept = (rows[target.good[rows]] for rows in target.data.runs)
    return [place[rows] for rows in kept if len(rows)]


def _at_level(name: str, values: FloatArray) -> str:
    """Where the runs of one level of a condition are; a group of many levels has a middle."""
    return f"{'at' if np.ptp(values) == 0.0 else 'near'} {np.median(values):g} {UNITS[name]}"


def _signature(
    target: FitData,
    residual: ComplexArray,
    beside: ComplexArray,
    found: ResidualStructure,
    k: int,
    floor: float,
    *,
    is_alike: bool,
) -> Signature:
    """The signature of one order with structure.

    beside: the order (n,) without a mean that noise which lasts over runs may have; is_alike: whether it is more than
    louder runs make by noise.
    """
    order, course = int(found.orders[k]), found.courses[k]
    r = residual[:, k] if order else residual[:, k].real.astype(np.complex128)
    parts = 2 if order else 1
    noise = parts * min(float((target.sigma[target.good, k] ** 2).mean()), floor**2)
    # beside a law runs differ as far as is known
    formula = formula_of(target, r, k, max(floor, float(target.between_runs[k]), SETTINGS.least_noise_deg))
    # a mean that noise which wanders over the runs may have is no law; beside one it is a part of the size
    if (beside != r).any() and formula is not None and set(formula.terms) == {"constant"}:
        formula = None
    shares = dependence(target, r if formula else beside, noise, course)
    direction = _direction(target, r)
    loud = target.good & (target.data.at.sign == {"forward": 1.0, "backward": -1.0}.get(direction, target.data.at.sign))
    beyond = float((np.abs(r[target.good] - r[target.good].mean()) ** 2).sum()) / max(noise, 1e-300) - target.good.sum()
    is_told = beyond > SETTINGS.told * np.sqrt(target.good.sum())
    statement = _statement(replace(target, good=loud), r, order, shares, course, formula, is_told=is_told)
    said = statement.text
    if target.data.sorted_by in statement.conditions and not statement.or_when:
        said += ", or with the time if the runs were made in the order of their list"
    # the law of the temperature speaks of the oil, or of its distance from a temperature; a course is one of the time,
    # unless it follows the oil late
    through = [name for name in one_after_the_other(target.data) if name.removeprefix("oil ") in statement.conditions]
    if through and (course is None or course.is_lag or statement.says is not course):
        said += f", or with time: the runs go through the {' and the '.join(through)} once"
    is_law = formula is not None and statement.says is formula
    # what counts as noise may be louder than the law, in one direction as well
    law = formula.values(target.data.at, target.reference_temperature_C) if formula and is_law else r
    least = float((np.abs(law[target.good]) ** 2).mean()) if is_law else 0.0 if course is None else course.power
    power = max(float((np.abs(r[target.good]) ** 2).mean()) - noise, least) / parts
    side = _side(target, law, noise, has_noise=not is_law) + (
        "" if is_alike else "; louder noise in some runs may look the same"
    )
    # where nothing tells the noise but what runs differ by, that holds what is looked for as well: so in the mean of a
    # table, and in orders of curves that are far from quiet ones
    within = float(noise_within(target)[k])
    is_least = not order if target.data.spectral_deg is None else not math.isfinite(within)
    # what neighbours in the conditions differ by holds what changed between the times of both
    is_least |= course is not None and bool(floor > SETTINGS.clearly_larger * within)
    what = f"order {order}" if order else "the mean"
    size = f"{_size(float(np.sqrt(power)), is_least=is_least)} deg RMS"
    text = f"{what} {said}; {size} over the runs{side}" if is_law else f"{what}: {size}, {said}{side}"
    rms, amplitude = float(np.sqrt(power)), statement.amplitude_deg
    return Signature(order, rms, float(power), shares, _direction(target, law), text, amplitude, formula, is_least)


def _direction(target: FitData, r: ComplexArray) -> str:
    """Which direction a residual (n,) is in: that with three times the RMS of the other, else (or of one) both."""
    power = _by_direction(target, r)
    loud = max(power, key=lambda name: power[name])
    return loud if len(power) == 2 and power[loud] > SETTINGS.one_sided * min(power.values()) else "both"


def _side(target: FitData, r: ComplexArray, noise: float, *, has_noise: bool = True) -> str:
    """The direction that a residual (n,) is in, and whether the other has more of it than noise of this power; whether
    both have it with opposite signs. has_noise: false for a law, which was fitted to what has it.
    """
    direction, rows = _direction(target, r), int(target.good.sum()) / 2
    if direction == "both":
        # what is constant, or follows a condition, in each direction may turn between them, as what rubs does
        pairs = pairs_of(target)
        turned = -(r[pairs[:, 0]] * r[pairs[:, 1]].conj()).real
        shared = SETTINGS.opposed * (np.abs(r[pairs]) ** 2).sum() / 2
        return ", of the other sign backward" if len(pairs) >= SETTINGS.rows_of_noise and turned.sum() > shared else ""
    is_quiet = _quietest_direction(target, r) < noise * (has_noise + SETTINGS.told / np.sqrt(rows))
    return f", {direction} only" if is_quiet else f", mostly {direction}"


def _quietest_direction(target: FitData, r: ComplexArray) -> float:
    """The least mean power of a residual (n,) in a direction: the noise there, and as much in the other, is no more."""
    return min(_by_direction(target, r).values())


def _by_direction(target: FitData, r: ComplexArray) -> dict[str, float]:
    """Mean power of a residual (n,) in each direction in which there are curves."""
    rows = {name: target.good & (target.data.at.sign == sign) for name, sign in (("forward", 1.0), ("backward", -1.0))}
    return {name: float((np.abs(r[own]) ** 2).mean()) for name, own in rows.items() if own.any()}


_CAUSE = {
    "constant": "constant over the operating points",
    "speed": "depends on the speed",
    "torque": "depends on the torque",
    "temperature": "depends on the oil temperature",
    "combination": "depends on the conditions, or on when it was measured; no single one was found to explain it",
}
_HIDDEN = "the noise of the runs hides what it depends on"
_WITH_TIME = "runs that were made one after the other are alike: it changes with time"


def main_cause(shares: dict[str, float]) -> str:
    """What an unexplained part depends on most; constant only where hardly anything else is seen.

    A condition must be clearly more than the next one: where runs are few, or scattered, two of them move together.
    """
    varying = {name: share for name, share in shares.items() if name != "constant"}
    most = max(varying, key=lambda name: varying[name])
    if varying[most] <= SETTINGS.cause:
        return "constant"
    next_one = max((varying.get(name, 0.0) for name in UNITS if name != most), default=0.0)
    return most if most not in UNITS or varying[most] > SETTINGS.clear_cause * next_one else "combination"


@dataclass(frozen=True)
class _Statement:
    """What is said of an unexplained part.

    text: without its subject; amplitude_deg: its largest; says: the course or the formula, None where it is what the
    part depends on; conditions: those that it names (`speed`, `torque`, `temperature`); or_when: whether it says that
    it may as well be when that was measured.
    """

    text: str
    amplitude_deg: float
    says: Course | Formula | None = None
    conditions: frozenset[str] = frozenset()
    or_when: bool = False


def _statement(
    target: FitData,
    r: ComplexArray,
    order: int,
    shares: dict[str, float],
    course: Course | None,
    formula: Formula | None,
    *,
    is_told: bool,
) -> _Statement:
    """What is said of an unexplained part.

    is_told: whether runs differ in it by more than their noise.
    """
    at, good = target.data.at, target.good
    main = main_cause(shares)
    if course is not None and main in ("time", "constant", "combination"):
        return _Statement(course.text, course.amplitude_deg, course, course.conditions)
    if formula is not None:
        return _Statement(formula.text, formula.amplitude_deg, formula, formula.conditions)
    if main in UNITS and not _holds_elsewhere(target, r, main):
        main = "combination"
    text = _CAUSE[main if main in _CAUSE else "combination"]
    if main == "constant" and (whole := round(100 * shares["constant"])) < 100:
        text = f"{whole} % of its power {text}; no single condition was found to explain what varies"
    or_when = main == "temperature" and target.data.run is None
    if or_when:
        text += ", or on when it was measured"
    if main == "combination" and changes_with_time(target, r[:, None])[0]:
        text = _WITH_TIME
    elif main == "combination" and not is_told:
        text = _HIDDEN
    elif main in (*UNITS, "combination") and shares["constant"] > SETTINGS.same_in_runs:
        text = f"{round(100 * shares['constant'])} % of its power {_CAUSE['constant']}; the rest {text}"
    if main not in UNITS:
        return _Statement(text, float(np.sqrt((np.abs(r[good]) ** 2).mean())))
    values, level = at.axes[AXES.index(main)], levels_by_condition(at)[main]
    sizes = {n: float(np.sqrt((np.abs(r[good & (level == n)]) ** 2).mean())) for n in np.unique(level[good])}
    top = max(sizes, key=lambda n: sizes[n])
    there = values[good & (level == top)]
    of_both = "; both together are" if shares["constant"] > SETTINGS.same_in_runs else ","
    text += f"{of_both} most {_at_level(main, there)}: {sizes[top]:.2g} deg"
    if main == "speed" and order:
        hertz = order * float(np.median(there)) / 60 / target.reduction_ratio
        text += f" (order {order} is at {hertz:.3g} Hz there)"
    return _Statement(text, sizes[top], None, frozenset([main]), or_when)
