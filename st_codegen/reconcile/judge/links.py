"""The links of the axis in recordings over time: the servo's (control lag) and the coupling's.

theta_ref -> theta_mot is the servo's, theta_mot -> theta_in the coupling's. Each is fitted by itself and judged; the
reducer's transmission error behind them goes to the common core.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from st_codegen.ir.arrays import FloatArray, IntArray
from st_codegen.reconcile.data.chances import chi_square_tail
from st_codegen.reconcile.data.noise import MEDIAN_1
from st_codegen.reconcile.data.recordings import Recording, speed_of
from st_codegen.reconcile.fit.state import Piece
from st_codegen.reconcile.judge.claims import SOMETHING_ELSE, Claim, Conclusions, Retuned
from st_codegen.reconcile.outcome import Gap
from st_codegen.reconcile.search.evidence import Evidence
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions, Effect
from st_codegen.rig.effects.axis import ControlLag, CouplingCompliance
from st_codegen.rig.model import RigModel


@dataclass(frozen=True)
class Link:
    """What was found on a link of the axis, and the gap that it makes at the output."""

    claim: Claim | None
    retuned: Retuned | None
    gap: Gap
    unexplained: str


#: what the coupling does to the angles, seen from the motor
_LIKE_COUPLING = ("torsional_compliance", "backlash")


def with_unmeasured_links(found: Conclusions, recordings: Sequence[Recording]) -> Conclusions:
    """Findings with what cannot be told from them where theta_in was not measured: the coupling twists as well."""
    if all("theta_in" in r.angles for r in recordings):
        return found
    remark = "theta_in was not measured: the coupling's part is not told from the reducer's; record it"
    claims, retuned = list(found.claims), list(found.retuned)
    for i, claim in enumerate(claims):
        if claim.piece.effect.name in _LIKE_COUPLING:
            names = tuple(sorted({*claim.alternatives, "coupling_compliance"}))
            claims[i] = replace(claim, alternatives=names, extrapolates=(*claim.extrapolates, remark))
    for i, one in enumerate(retuned):
        if one.after.name in _LIKE_COUPLING:
            retuned[i] = replace(one, misread=(*one.misread, "coupling_compliance"))
    return replace(found, claims=tuple(claims), retuned=tuple(retuned))


@dataclass(frozen=True)
class _Told:
    """What samples (n,) tell of named columns (n, p) beside others (n, q), which are no part of the link's effect.

    A column that the others make is not told: its value is not a number, and its error has no end. parts: the part of
    its recording in which each sample lies, (n,).
    """

    named: FloatArray
    beside: FloatArray
    samples: FloatArray
    parts: IntArray

    @cached_property
    def values(self) -> FloatArray:
        """The sizes of the named columns, (p,)."""
        return _sizes(self.named, self.beside, self.samples)

    @cached_property
    def rest(self) -> FloatArray:
        """What all columns leave, (n,)."""
        return _without(np.hstack([self.named, self.beside]), self.samples)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a sample's noise; a wave that is fast beside the samples looks like it."""
        return max(min(_noise([self.rest]), _rms([self.rest])), SETTINGS.least_noise_deg)

    @cached_property
    def stderr(self) -> FloatArray:
        """Standard errors of the values, (p,): from the noise, from parts that are left out in turn, and from the rest.

        A rest that is more than noise may belong to any column.
        """
        alone = [_without(np.delete(self.all, i, axis=1), self.all[:, i]) for i in range(self.named.shape[1])]
        size = 1.0 / np.maximum(np.linalg.norm(alone, axis=1), 1e-300)
        numbers = np.arange(SETTINGS.parts_of_link)
        kept = [self.parts != part for part in numbers]
        values = np.array([_sizes(self.named[rows], self.beside[rows], self.samples[rows]) for rows in kept])
        scatter = np.sqrt((len(numbers) - 1) * np.var(values, axis=0))
        left = _rms([self.rest])
        coherent = left * np.sqrt(len(self.samples)) if left > SETTINGS.left_on_link * self.noise else 0.0
        errors: FloatArray = np.hypot(np.hypot(self.noise, coherent) * size, scatter)
        return np.where(np.isfinite(errors + self.values), errors, np.inf)

    @property
    def all(self) -> FloatArray:
        """All columns, (n, p + q)."""
        return np.hstack([self.named, self.beside])


def _without(columns: FloatArray, samples: FloatArray) -> FloatArray:
    """Samples (n,) without all that columns (n, p) make of them."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    powers, turned = np.linalg.eigh(scaled.T @ scaled)
    some = powers > SETTINGS.told_of_column**2
    base = scaled @ (turned[:, some] / np.sqrt(powers[some]))
    left: FloatArray = samples - base @ (base.T @ samples)
    return left


def _sizes(named: FloatArray, beside: FloatArray, samples: FloatArray) -> FloatArray:
    """Sizes of named columns (p,) in samples (n,), beside others; not a number where the others make a column."""
    columns = np.hstack([named, beside])
    out = np.full(named.shape[1], np.nan)
    for i in range(len(out)):
        alone = _without(np.delete(columns, i, axis=1), columns[:, i])
        if np.linalg.norm(alone) > SETTINGS.told_of_column * np.linalg.norm(columns[:, i]):
            out[i] = alone @ samples / (alone @ alone)
    return out


def _parts(lengths: Sequence[int]) -> IntArray:
    """The part of its own recording in which each sample lies, so that none is left out as a whole."""
    return np.concatenate([np.arange(n) * SETTINGS.parts_of_link // max(n, 1) for n in lengths])


def servo_link(recordings: Sequence[Recording], rig: RigModel) -> Link | None:
    """theta_ref -> theta_mot: is there a lag that the rig does not have?"""
    usable = [r for r in recordings if {"theta_ref", "theta_mot"} <= r.angles.keys()]
    if not usable:
        return None
    own = next((effect for effect in rig.effects if isinstance(effect, ControlLag)), None)
    start = own.scalar("lag_ms") if own else 0.0

    def left(lag: float) -> FloatArray:
        effect = ControlLag({"lag_ms": lag}, rig.constants, check=False)
        return np.concatenate(
            [r.angles["theta_mot"] - effect.motor_angle(r.time_s, r.angles["theta_ref"]) for r in usable]
        )

    # where the reference and the encoder have their zeros is no lag
    lag = _least(lambda x: float(left(x).var()), start)
    first, best, step = left(start), left(lag), 0.01 * lag + 1e-3
    parts = _parts([len(r.time_s) for r in usable])
    told = _Told(((left(lag + step) - best) / step)[:, None], np.ones((len(best), 1)), best, parts)
    stderr = float(told.stderr[0])
    effect = ControlLag({"lag_ms": lag}, rig.constants, check=False)
    keep = {"lag_ms": stderr} if abs(lag - start) > SETTINGS.sure_of_link * stderr else {}
    return _judged(first, best, told, rig, _Change(effect, own, keep), _SERVO)


def coupling_link(recordings: Sequence[Recording], rig: RigModel) -> Link | None:
    """theta_mot -> theta_in: does the coupling twist or play beyond what the rig says?

    Beside its twist both angles have zeros of their own, one of them may be late, and an encoder or a coupling that is
    off centre or bent makes waves of the shaft: none of these is a stiffness, or play.
    """
    usable = [r for r in recordings if {"theta_mot", "theta_in"} <= r.angles.keys() and r.moves.any()]
    if not usable:
        return None
    own = next((effect for effect in rig.effects if isinstance(effect, CouplingCompliance)), None)
    parts = _parts([int(r.moves.sum()) for r in usable])
    files = np.repeat(np.arange(len(usable)), [int(r.moves.sum()) for r in usable])
    at = Conditions(
        *map(
            np.concatenate,
            zip(*((r.at.sign[r.moves], *(axis[r.moves] for axis in r.at.axes)) for r in usable), strict=True),
        )
    )
    y = np.concatenate([(r.angles["theta_in"] - r.angles["theta_mot"])[r.moves] for r in usable])
    turned = np.deg2rad(np.concatenate([r.angles["theta_mot"][r.moves] for r in usable]))
    speed = np.concatenate([speed_of(r.angles, r.time_s)[r.moves] for r in usable])
    waves = [wave(times * turned) for times in (1, 2) for wave in (np.cos, np.sin)]
    beside = np.stack([np.ones(len(y)), speed, *waves], axis=1)
    twist, play = -at.sign * np.rad2deg(at.torque_Nm / rig.constants.reduction_ratio), -at.sign / 120.0
    soft, gap = (1 / own.scalar("stiffness_Nm_per_rad"), own.scalar("backlash_arcmin")) if own else (0.0, 0.0)
    first = y - soft * twist - gap * play
    told = _Told(np.stack([twist, play], axis=1), beside, y, parts)
    is_open, errors = False, told.stderr
    if told.values[1] > SETTINGS.sure_backlash * errors[1]:
        new_soft, new_gap = told.values
        # play that load takes up gradually, or a coupling that is softer at low loads
        gradual = _Told(np.stack([twist, twist / np.sqrt(np.abs(twist) + 1e-300)], axis=1), beside, y, parts)
        is_open = float((gradual.rest**2).sum() - (told.rest**2).sum()) < SETTINGS.sure_of_link**2 * told.noise**2
        sure = abs(new_soft - soft) > SETTINGS.sure_of_link * errors[0]
        sure = sure or abs(new_gap - gap) > SETTINGS.sure_of_link * errors[1]
    else:
        # play that the data do not tell stays what it is
        told = _Told(twist[:, None], beside, y - gap * play, parts)
        errors, new_soft, new_gap = told.stderr, told.values[0], gap
        sure = abs(new_soft - soft) > SETTINGS.sure_of_link * errors[0]
    own_zeros = np.hstack([beside, (files[:, None] == np.arange(1, len(usable))).astype(np.float64)])
    apart = _Told(told.named, own_zeros, told.samples, parts)
    known = np.array([soft, gap])[: told.named.shape[1]]
    is_open = is_open or not (np.abs(apart.values - known) > SETTINGS.sure_of_link * apart.stderr).any()
    values = {"stiffness_Nm_per_rad": float(1.0 / new_soft) if new_soft > 0 else np.inf}
    keep = {"stiffness_Nm_per_rad": float(errors[0]) * values["stiffness_Nm_per_rad"] ** 2}
    if new_gap:
        values["backlash_arcmin"] = float(new_gap)
        keep |= {"backlash_arcmin": float(errors[1])} if len(errors) > 1 else {}
    sure = sure and all(one.lower <= values.get(one.key, 0.0) <= one.upper for one in CouplingCompliance.scalars)
    effect = CouplingCompliance(values, rig.constants, check=False)
    best = y - new_soft * twist - new_gap * play if sure else first
    return _judged(first, best, told, rig, _Change(effect, own, keep if sure else {}, is_open), _COUPLING)


def _least(loss: Callable[[float], float], start: float) -> float:
    from scipy.optimize import minimize_scalar

    grid = np.concatenate([[start], np.geomspace(0.05, 500, 40)])
    best = int(np.argmin([loss(float(x)) for x in grid]))
    around = sorted({float(x) for x in grid})
    place = around.index(float(grid[best]))
    low, high = around[max(place - 1, 0)], around[min(place + 1, len(around) - 1)]
    found = minimize_scalar(loss, bounds=(low if low < around[place] else 0.0, high), method="bounded")
    return float(found.x)


def _noise(parts: Sequence[FloatArray]) -> float:
    """Standard deviation of white noise, from third differences.

    Those that are nothing are of an axis that stands: what the digits of a file are rounded by shows where it moves.
    """
    smooth = np.abs(np.concatenate([np.diff(part, n=3) / np.sqrt(20.0) for part in parts]))
    apart = smooth[smooth > SETTINGS.least_noise_deg]
    return float(np.median(apart) / MEDIAN_1) if apart.size else SETTINGS.least_noise_deg


def _rms(parts: Sequence[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


@dataclass(frozen=True)
class _Kind:
    """What is beside the effect of a link: its columns, and how its sizes are said."""

    columns: tuple[int, ...]
    say: Callable[[FloatArray], str]


_OFF_CENTRE = "of the fast shaft, as of an encoder or a coupling that is off centre or bent"
_SERVO = (_Kind((0,), lambda x: f"zeros of theta_ref and theta_mot that are {abs(x[0]):.2g} deg apart"),)
_COUPLING = (
    _Kind((0,), lambda x: f"zeros of theta_mot and theta_in that are {abs(x[0]):.2g} deg apart"),
    _Kind((1,), lambda x: f"a part in proportion to the speed, as if theta_in were {_late(1e3 * x[0])}"),
    _Kind((2, 3), lambda x: f"a wave of {np.hypot(*x):.2g} deg, once a turn {_OFF_CENTRE}"),
    _Kind((4, 5), lambda x: f"a wave of {np.hypot(*x):.2g} deg, twice a turn {_OFF_CENTRE}"),
)


def _late(early_ms: float) -> str:
    return f"{abs(early_ms):.2g} ms {'early' if early_ms > 0 else 'late'}"


@dataclass(frozen=True)
class _Change:
    """A link's effect as it was fitted, and the rig's own.

    stderr: of the numbers that the data tell, empty where none is sure to have changed; is_open: something else would
    do as well.
    """

    effect: Effect
    own: Effect | None
    stderr: dict[str, float]
    is_open: bool = False


def _beside_text(told: _Told, left: FloatArray, kinds: Sequence[_Kind]) -> str:
    """What the columns beside the effect make of what is left (n,), where they alone make nearly all of it."""
    count, size = told.named.shape[1], _rms([left])

    def is_all(columns: FloatArray) -> bool:
        rest = _rms([_without(columns, left)])
        return rest < max(SETTINGS.rest_of_link * size, SETTINGS.left_on_link * told.noise)

    texts = []
    for kind in kinds:
        own = [count + i for i in kind.columns]
        sizes = _sizes(told.all[:, own], np.delete(told.all, own, axis=1), left)
        if _rms([told.all[:, own] @ np.nan_to_num(sizes)]) > SETTINGS.much_of_link * size:
            texts.append(kind.say(sizes))
    if texts and is_all(told.beside):
        return f"; it looks like {' and '.join(texts)}"
    if not texts and is_all(told.all):
        return "; zeros of the angles, a late one and the twist would all make it, and these runs do not tell which"
    return ""


def _judged(
    first: FloatArray,
    best: FloatArray,
    told: _Told,
    rig: RigModel,
    change: _Change,
    kinds: Sequence[_Kind],
) -> Link:
    """A claim where the link's effect explains what is there, and a signature where something is left.

    first: what the rig leaves (n,); best: what the effect leaves, with all that is beside it.
    """
    effect, own, stderr = change.effect, change.own, change.stderr
    ratio, sigma = rig.constants.reduction_ratio, told.noise
    x, y = _without(told.beside, first), _without(told.beside, best)
    before, after = _rms([x]), _rms([y])
    saved = float((np.minimum(x**2, 1e6 * sigma**2).sum() - np.minimum(y**2, 1e6 * sigma**2).sum()) / sigma**2)
    blocks = np.array_split(np.arange(len(x)), SETTINGS.parts_of_link)
    stable = float(np.mean([(x[b] ** 2).sum() > (y[b] ** 2).sum() for b in blocks]))
    size = float(np.sqrt(max(before**2 - after**2, 0.0)) / sigma)
    p = chi_square_tail(saved, max(len(stderr), 1))
    evidence = Evidence(saved, len(stderr), p, p, {"time": saved / len(x)}, (1, 1), stable, size)
    fits = max(after**2 - sigma**2, 0.0) < SETTINGS.misfit * max(before**2 - after**2, 1e-300)
    is_sure = bool(stderr) and p < SETTINGS.p_chance and stable > SETTINGS.stable_link
    found = is_sure and size >= SETTINGS.least_size_of_link and fits
    left = best if found else first
    wrong = _rms([left]) > SETTINGS.left_on_link * sigma
    # what bends its numbers may be all of them
    is_open = change.is_open or _rms([told.rest]) > SETTINGS.left_on_link * sigma
    unexplained = ""
    if wrong:
        unexplained = f"{effect.title}: {_rms([left]):.2g} deg RMS are left at the fast side, noise is {sigma:.2g} deg"
        unexplained += _beside_text(told, left, kinds)
    share = float(np.clip(1 - (after**2 - sigma**2) / max(before**2 - sigma**2, 1e-300), 0, 1)) if found else 0.0
    claim = retuned = None
    if found and own is None:
        others = (SOMETHING_ELSE,) if is_open else ()
        claim = Claim(Piece(effect, frozenset(effect.values), True), stderr, evidence, others, (), share, ())
    elif found and own is not None:
        retuned = Retuned(own, effect, stderr, p, is_open=is_open)
    return Link(claim, retuned, Gap(_rms([first]) / ratio, _rms([left]) / ratio, sigma / ratio), unexplained)
