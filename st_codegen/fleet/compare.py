"""Axes beside each other: how far every parameter spreads, which axes stand out, which effects few have, what grew.

An axis stands out where a parameter lies farther from the median of its type than a limit, in units of
sqrt(s^2 + e^2): s is 1.4826 times the median absolute deviation, e the standard error of the axis's own value. The
limit is such that where no axis is odd one is named in `FALSE_ALARM` of all fleets, over all parameters together, if
the values of sound axes are normally distributed: by simulation for the number of axes, since the deviation of few axes
is small by chance, and by Bonferroni over parameters, which may depend on each other.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from statistics import NormalDist

import numpy as np

from st_codegen.errors import counted
from st_codegen.fleet.estimates import Estimate

#: Chance that a page names any axis at all where all are alike; of outliers and of growth, each by itself.
FALSE_ALARM = 0.05
#: With fewer axes that have a parameter nothing is said of who stands out: a deviation of some numbers is chance.
LEAST_AXES = 8
#: Simulated fleets above the limit: the chance is right within some 5 %, or 15 % where many axes make it costly. Of few
#: axes the limit depends on the chance most.
_ABOVE, _ABOVE_OF_MANY, _MANY_AXES = 400, 50, 50
_MOST_SIMULATED = 400_000
_AT_ONCE = 2_000_000


@dataclass(frozen=True)
class Campaigns:
    """What the campaigns of an axis say, the oldest first; the last is the newest. measured: a hash of its numbers."""

    axis: str
    type: str
    estimates: tuple[tuple[Estimate, ...], ...]
    measured: tuple[str, ...] = ()


@dataclass(frozen=True)
class Spread:
    """A parameter over the axes of a type: median, robust standard deviation, median of the standard errors.

    values, distances: by axis; limit: the distance from which an axis stands out. Of fewer than `LEAST_AXES` there is
    no deviation, distance or limit.
    """

    type: str
    effect: str
    key: str
    unit: str
    median: float
    deviation: float | None
    stderr: float
    values: Mapping[str, float]
    distances: Mapping[str, float]
    limit: float | None = None

    @property
    def outliers(self) -> tuple[str, ...]:
        """The axes beyond the limit, the farthest first."""
        if self.limit is None:
            return ()
        far = [axis for axis, distance in self.distances.items() if abs(distance) > self.limit]
        return tuple(sorted(far, key=lambda axis: -abs(self.distances[axis])))


@dataclass(frozen=True)
class Rare:
    """An effect that fewer than half of the axes of a type have."""

    type: str
    effect: str
    axes: tuple[str, ...]
    of: int


@dataclass(frozen=True)
class Growth:
    """A parameter by which an effect grew since the last campaign; before: None where that did not find the effect.

    history: its values in all campaigns, the oldest first; times: the growth in standard errors of the difference.
    """

    axis: str
    effect: str
    key: str
    unit: str
    before: float | None
    now: float
    times: float | None
    history: tuple[float | None, ...]


@dataclass(frozen=True)
class FleetComparison:
    """All that is seen from axis to axis and from campaign to campaign; the limit of `Growth.times`.

    growth_axes: how many axes have a parameter that was compared with that limit;
    copies: the axes of which a campaign has the numbers of another campaign, of its own or of another axis.
    """

    spreads: tuple[Spread, ...] = ()
    rare: tuple[Rare, ...] = ()
    growth: tuple[Growth, ...] = ()
    growth_limit: float | None = None
    growth_axes: int = 0
    copies: tuple[str, ...] = ()
    not_looked_at: tuple[str, ...] = ()


def by_key(found: Iterable[Estimate]) -> dict[tuple[str, str], Estimate]:
    """Parameters by effect and key."""
    return {(one.effect, one.key): one for one in found}


def compare(fleet: Sequence[Campaigns]) -> FleetComparison:
    """Compare axes of a type with each other, and each with its own earlier campaigns."""
    types = {kind: [axis for axis in fleet if axis.type == kind] for kind in dict.fromkeys(axis.type for axis in fleet)}
    spreads = [spread for kind, axes in types.items() for spread in _spreads(kind, axes)]
    level = FALSE_ALARM / max(1, sum(spread.deviation is not None for spread in spreads))
    limited = [
        spread if spread.deviation is None else replace(spread, limit=limit_of(len(spread.values), level))
        for spread in spreads
    ]
    rare = [one for kind, axes in types.items() if len(axes) >= LEAST_AXES for one in _rare(kind, axes)]
    growth, limit, grown_of = _growth(fleet)
    unseen = tuple(_not_looked_at(types, fleet, limited))
    return FleetComparison(tuple(limited), tuple(rare), growth, limit, grown_of, _copies(fleet), unseen)


def _copies(fleet: Sequence[Campaigns]) -> tuple[str, ...]:
    """The axes with a campaign whose measured numbers are those of another one to the bit."""
    owners: dict[str, list[str]] = {}
    for axis in fleet:
        for measured in axis.measured:
            owners.setdefault(measured, []).append(axis.axis)
    return tuple(dict.fromkeys(name for names in owners.values() if len(names) > 1 for name in names))


def _spreads(kind: str, axes: Sequence[Campaigns]) -> list[Spread]:
    """The parameters of a type but phases, which say how an axis was mounted."""
    found: dict[tuple[str, str, str], dict[str, Estimate]] = {}
    for axis in axes:
        for one in axis.estimates[-1]:
            if not one.is_phase and one.stderr is not None:
                found.setdefault((one.effect, one.key, one.unit), {})[axis.axis] = one
    spreads = []
    for (effect, key, _), own in sorted(found.items()):
        values = np.array([one.value for one in own.values()])
        errors = np.array([one.stderr for one in own.values()], np.float64)
        median, stderr = float(np.median(values)), float(np.median(errors))
        deviation, far = None, {}
        if len(own) >= LEAST_AXES:
            deviation = 1.4826 * float(np.median(np.abs(values - median)))
            unit = np.sqrt(deviation**2 + errors**2)
            distances = np.divide(values - median, unit, out=np.zeros(len(unit)), where=unit > 0)
            far = dict(zip(own, distances.tolist(), strict=True))
        by_axis = dict(zip(own, values.tolist(), strict=True))
        spreads.append(
            Spread(kind, effect, key, next(iter(own.values())).unit, median, deviation, stderr, by_axis, far)
        )
    return spreads


@lru_cache
def limit_of(axes: int, level: float) -> float:
    """The distance that the farthest of some axes has by chance with probability `level`: normal, without errors.

    Standard errors make distances shorter, so that the chance is smaller with them. Simulated, always with one seed.
    """
    count = min(_MOST_SIMULATED, math.ceil((_ABOVE if axes < _MANY_AXES else _ABOVE_OF_MANY) / level))
    random, farthest = np.random.default_rng(0), []
    for start in range(0, count, max(1, _AT_ONCE // axes)):
        values = random.standard_normal((min(count - start, max(1, _AT_ONCE // axes)), axes))
        distance = np.abs(values - np.median(values, axis=1, keepdims=True))
        farthest.append(distance.max(axis=1) / (1.4826 * np.median(distance, axis=1)))
    return float(np.quantile(np.concatenate(farthest), 1.0 - level))


def _rare(kind: str, axes: Sequence[Campaigns]) -> list[Rare]:
    owners: dict[str, list[str]] = {}
    for axis in axes:
        for effect in dict.fromkeys(one.effect for one in axis.estimates[-1]):
            owners.setdefault(effect, []).append(axis.axis)
    return [
        Rare(kind, effect, tuple(names), len(axes))
        for effect, names in sorted(owners.items())
        if len(names) < len(axes) / 2
    ]


def _growth(fleet: Sequence[Campaigns]) -> tuple[tuple[Growth, ...], float | None, int]:
    """What grew since the last campaign but the newest, the limit that growth passed, and of how many axes it is."""
    compared, new = [], []
    for axis in fleet:
        if len(axis.estimates) < 2:
            continue
        campaigns = [by_key(one) for one in axis.estimates]
        before, known = campaigns[-2], {effect for effect, _ in campaigns[-2]}
        for key, now in campaigns[-1].items():
            history = tuple(own[key].value if key in own else None for own in campaigns)
            old = before.get(key)
            if old is None and now.effect not in known and now.grows:
                new.append(Growth(axis.axis, *key, now.unit, None, now.value, None, history))
            # a growth with another power of the load is another number
            if old is None or not now.grows or not old.stderr or not now.stderr or old.unit != now.unit:
                continue
            grown = now.grows * (abs(now.value) - abs(old.value)) / math.hypot(now.stderr, old.stderr)
            compared.append(Growth(axis.axis, *key, now.unit, old.value, now.value, grown, history))
    if not compared:
        return tuple(new), None, 0
    limit = NormalDist().inv_cdf(1.0 - FALSE_ALARM / len(compared))
    grown_most = sorted(compared, key=lambda one: -(one.times or 0.0))
    beyond = tuple(one for one in grown_most if (one.times or 0.0) > limit)
    return (*beyond, *new), limit, len({one.axis for one in compared})


def _not_looked_at(
    types: Mapping[str, Sequence[Campaigns]], fleet: Sequence[Campaigns], spreads: Sequence[Spread]
) -> list[str]:
    found = [
        f"{kind or 'axes without a type'}: {counted(len(axes), 'axis', 'axes')} whose newest campaign was reconciled, "
        f"fewer than {LEAST_AXES}: nothing can be said of who stands out, nor of effects that few have"
        for kind, axes in types.items()
        if len(axes) < LEAST_AXES
    ]
    vague = [f"{one.effect} {one.key}" for one in spreads if one.limit is not None and one.stderr >= abs(one.median)]
    if vague:
        found.append(
            f"parameters that the campaigns do not measure (standard error above the value): {', '.join(vague)}"
        )
    unsure = dict.fromkeys(
        f"{one.effect} {one.key}"
        for axis in fleet
        for found_then in axis.estimates[-2:]
        for one in found_then
        if one.stderr is None
    )
    if unsure:
        found.append(
            "parameters without standard error, or of which the campaign says less than the rig file, in axes where "
            f"it is so: {', '.join(unsure)}"
        )
    if alone := [axis.axis for axis in fleet if len(axis.estimates) < 2]:
        found.append(f"growth, for want of an earlier campaign that was reconciled: {', '.join(alone)}")
    return found
