"""The links of the axis in recordings over time: the servo's (control lag) and the coupling's.

theta_ref -> theta_mot is the servo's, theta_mot -> theta_in the coupling's. Each is fitted by itself and judged; the
reducer's transmission error behind them goes to the common core.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from st_codegen.ir.arrays import BoolArray, FloatArray, IntArray
from st_codegen.reconcile.data.chances import chi_square_tail
from st_codegen.reconcile.data.noise import MEDIAN_1
from st_codegen.reconcile.data.recordings import Recording, speed_of, step_of
from st_codegen.reconcile.fit.state import Piece
from st_codegen.reconcile.judge.claims import SOMETHING_ELSE, Claim, Conclusions, Retuned
from st_codegen.reconcile.outcome import Gap
from st_codegen.reconcile.search.evidence import Evidence
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect
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
    """What samples (n,) tell of the sizes of named columns (n, p) beside others (n, q).

    A column that the others make is not told: its size is not a number, and its error has no end. parts: of its
    recording in which each sample lies, (n,). rounded_deg: RMS of what the samples are rounded by.
    """

    named: FloatArray
    beside: FloatArray
    samples: FloatArray
    parts: IntArray
    rounded_deg: float

    @cached_property
    def values(self) -> FloatArray:
        """The sizes of the named columns, (p,)."""
        return _sizes(self.named, self.beside, self.samples)[0]

    @cached_property
    def rest(self) -> FloatArray:
        """What all columns leave, (n,)."""
        return _without(np.hstack([self.named, self.beside]), self.samples)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a sample's noise, deg."""
        # neither is below the noise: a wave that is fast beside the samples bends them, and what has no column is left
        shown = min(_noise(self.rest), _rms(self.rest))
        # samples that stay on a step for a while hide how far it is
        return max(shown, self.rounded_deg, SETTINGS.least_noise_deg)

    @cached_property
    def stderr(self) -> FloatArray:
        """Standard errors of the values, (p,): from the noise, from parts that are left out in turn, and from the rest.

        A rest that is more than noise may belong to any column.
        """
        values, alone = _sizes(self.named, self.beside, self.samples)
        numbers = np.arange(SETTINGS.parts_of_link)
        kept = [self.parts != part for part in numbers]
        without_a_part = [_sizes(self.named[k], self.beside[k], self.samples[k])[0] for k in kept]
        scatter = np.sqrt((len(numbers) - 1) * np.var(without_a_part, axis=0))
        left = _rms(self.rest)
        coherent = left * np.sqrt(len(self.samples)) if left > SETTINGS.left_on_link * self.noise else 0.0
        errors: FloatArray = np.hypot(np.hypot(self.noise, coherent) / np.maximum(alone, 1e-300), scatter)
        return np.where(np.isfinite(errors + values), errors, np.inf)

    def are_off(self, known: FloatArray) -> BoolArray:
        """Which of the named sizes are surely not those that are known, (p,)."""
        return np.asarray(np.abs(self.values - known) > SETTINGS.sure_of_link * self.stderr)


def _without(columns: FloatArray, samples: FloatArray) -> FloatArray:
    """Samples (n,) without all that columns (n, p) make of them."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    powers, turned = np.linalg.eigh(scaled.T @ scaled)
    some = powers > SETTINGS.told_of_column**2
    base = scaled @ (turned[:, some] / np.sqrt(powers[some]))
    left: FloatArray = samples - base @ (base.T @ samples)
    return left


def _corner(columns: FloatArray, samples: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Columns (n, p) and samples (n,) in so few rows that fits are quick: their lengths and angles are the same."""
    corner = np.linalg.qr(np.column_stack([columns, samples])).R
    return corner[:, :-1], corner[:, -1]


def _sizes(named: FloatArray, beside: FloatArray, samples: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sizes of named columns (n, p) in samples (n,) beside others (n, q), and lengths of what is each one's own, (p,).

    A size is not a number where the other columns make this one.
    """
    columns, samples = _corner(np.hstack([named, beside]), samples)
    sizes, lengths = np.full((2, named.shape[1]), np.nan)
    for i, column in enumerate(columns.T[: len(sizes)]):
        alone = _without(np.delete(columns, i, axis=1), column)
        lengths[i] = np.linalg.norm(alone)
        if lengths[i] > SETTINGS.told_of_column * np.linalg.norm(column):
            sizes[i] = alone @ samples / lengths[i] ** 2
    return sizes, lengths


@dataclass(frozen=True)
class _Samples:
    """Samples of a link, deg (n,), and columns that may make them: of the numbers of its effect, and of others.

    named (n, p); beside (n, q), that of a zero first; file: of each sample, (n,); rounded_deg: RMS of what they are
    rounded by.
    """

    values: FloatArray
    named: FloatArray
    beside: FloatArray
    file: IntArray
    rounded_deg: float

    @property
    def zeros(self) -> FloatArray:
        """The zeros of each recording's own, (n, files)."""
        return np.asarray(self.file[:, None] == np.arange(self.file[-1] + 1), np.float64)

    @cached_property
    def told(self) -> _Told:
        """What they tell where the angles have the same zeros in all recordings."""
        return _Told(self.named, self.beside, self.values, self._parts, self.rounded_deg)

    def may_be_zeros(self, known: FloatArray) -> bool:
        """Whether a number that changed is not told to have done so where each recording has zeros of its own."""
        beside = np.hstack([self.beside, self.zeros[:, 1:]])
        apart = _Told(self.named, beside, self.values, self._parts, self.rounded_deg)
        return bool((self.told.are_off(known) & ~apart.are_off(known)).any())

    @property
    def _parts(self) -> IntArray:
        """The part of its own recording in which each sample lies, so that none is left out as a whole."""
        lengths = np.bincount(self.file)
        return np.concatenate([np.arange(n) * SETTINGS.parts_of_link // max(n, 1) for n in lengths])


def _files(recordings: Sequence[Recording]) -> IntArray:
    return np.repeat(np.arange(len(recordings)), [len(r.time_s) for r in recordings])


def _rounded(recordings: Sequence[Recording], *names: str) -> float:
    """RMS of what the difference of two angles is rounded by, deg."""
    steps = np.array([[step_of(r.angles[name]) for name in names] for r in recordings])
    return float(np.sqrt((steps**2).sum(axis=1).mean() / 12.0))


def servo_link(recordings: Sequence[Recording], rig: RigModel) -> Link | None:
    """theta_ref -> theta_mot: is there a lag that the rig does not have?"""
    usable = [r for r in recordings if {"theta_ref", "theta_mot"} <= r.angles.keys()]
    if not usable:
        return None
    own = next((effect for effect in rig.effects if isinstance(effect, ControlLag)), None)
    start = own.scalar("lag_ms") if own else 0.0

    def left(lag: float, sure: float = 0.0) -> FloatArray:
        effect = ControlLag({"lag_ms": lag}, rig.constants, check=False)
        return np.concatenate([_left_of_lag(r, effect, sure) for r in usable])

    # where the reference and the encoder have their zeros is no lag
    lag = _least(lambda x: float(left(x).var()), start)
    best, step = left(lag), 0.01 * lag + 1e-3
    slope = (best - left(lag + step))[:, None] / step
    # near the best lag the angles are straight over it: of all of it but what stays
    samples = _Samples(
        best + slope[:, 0] * lag,
        slope,
        np.ones((len(best), 1)),
        _files(usable),
        _rounded(usable, "theta_ref", "theta_mot"),
    )
    # of pieces that are short beside the lag the error of a zero is many noises: it is not left of the lag
    first, best = left(start, SETTINGS.sure_of_link), left(lag, SETTINGS.sure_of_link)
    known, change = np.array([start]), None
    if samples.told.are_off(known).any():
        effect = ControlLag({"lag_ms": lag}, rig.constants, check=False)
        stderr = {"lag_ms": float(samples.told.stderr[0])}
        change = _Change(effect, np.array([lag]), best, stderr, samples.may_be_zeros(known))
    ratio = rig.constants.reduction_ratio
    return _judged(samples, _Rig(own, known, first, ControlLag.title, _SERVO, ratio), change)


def _left_of_lag(r: Recording, effect: ControlLag, sure: float) -> FloatArray:
    """What a lag leaves of theta_mot, deg (n,): how far behind it was where the recording begins is not known.

    sure: standard errors within which a zero is none, beside its fades.
    """
    left = r.angles["theta_mot"] - effect.motor_angle(r.time_s, r.angles["theta_ref"])
    lag = effect.scalar("lag_ms") / 1000
    if lag <= 0:
        return left
    starts = r.starts
    piece = np.repeat(np.arange(len(starts)), np.diff([*starts, len(left)]))
    fades = np.exp(-(r.time_s - r.time_s[starts][piece]) / lag)
    squares = np.add.reduceat(fades**2, starts)

    def without_fades(values: FloatArray) -> FloatArray:
        return values - fades * (np.add.reduceat(fades * values, starts) / squares)[piece]

    # the zeros are those of the whole recording: a piece of few samples does not tell them from its fade
    ones, left = without_fades(np.ones(len(left))), without_fades(left)
    zero = (ones @ left) / (ones @ ones)
    within = sure * _rms(left - zero * ones) / np.linalg.norm(ones)
    return left + (1.0 - ones) * (zero if abs(zero) > within else 0.0)


def coupling_link(recordings: Sequence[Recording], rig: RigModel) -> Link | None:
    """theta_mot -> theta_in: does the coupling twist or play beyond what the rig says?

    Beside its twist both angles have zeros of their own, one of them may be late, and an encoder or a coupling that is
    off centre or bent makes waves of the shaft: none of these is a stiffness, or play.
    """
    usable = [r for r in recordings if {"theta_mot", "theta_in"} <= r.angles.keys() and r.moves.any()]
    if not usable:
        return None
    own = next((effect for effect in rig.effects if isinstance(effect, CouplingCompliance)), None)
    known = np.array([1.0 / own.scalar(_STIFFNESS), own.scalar(_PLAY)] if own else [0.0, 0.0])
    ratio = rig.constants.reduction_ratio
    samples = _of_coupling(usable, ratio)
    first = samples.values - samples.named @ known
    its_rig = _Rig(own, known, first, CouplingCompliance.title, _COUPLING, ratio)
    return _judged(samples, its_rig, _change_of_coupling(samples, known, rig))


_STIFFNESS, _PLAY = (scalar.key for scalar in CouplingCompliance.scalars)
#: the least and the most of softness (rad/Nm) and play (arcmin) that a rig file may have
_LEAST, _MOST = np.array(
    [[1.0 / CouplingCompliance.scalars[0].upper, CouplingCompliance.scalars[1].lower],
     [1.0 / CouplingCompliance.scalars[0].lower, CouplingCompliance.scalars[1].upper]]
)  # fmt: skip


def _of_coupling(recordings: Sequence[Recording], ratio: float) -> _Samples:
    """theta_in - theta_mot where the axis moves, and the columns of softness, play, and what is neither."""
    speed = np.concatenate([speed_of(r.angles, r.time_s)[r.moves] for r in recordings])
    moving = [r.rows(np.flatnonzero(r.moves)) for r in recordings]
    motor, fast = (np.concatenate([r.angles[name] for r in moving]) for name in ("theta_mot", "theta_in"))
    sign, torque = (np.concatenate([getattr(r.at, name) for r in moving]) for name in ("sign", "torque_Nm"))
    named = np.stack([-sign * np.rad2deg(torque / ratio), -sign / 120.0], axis=1)
    waves = [wave(times * np.deg2rad(motor)) for times in (1, 2) for wave in (np.cos, np.sin)]
    beside = np.stack([np.ones(len(motor)), speed, *waves], axis=1)
    return _Samples(fast - motor, named, beside, _files(moving), _rounded(recordings, "theta_mot", "theta_in"))


def _change_of_coupling(samples: _Samples, known: FloatArray, rig: RigModel) -> _Change | None:
    """Softness and play that are told to be others than is known; None where none is, or no rig file may have it."""
    changed, stderr = samples.told.are_off(known), samples.told.stderr
    values = np.where(changed, samples.told.values, known)
    if not changed.any() or (values < -SETTINGS.sure_of_link * stderr).any():
        return None
    # what is told to be nothing, or is not known, is the least that a rig file may have
    free = changed & (values > _LEAST)
    values = np.maximum(values, _LEAST)
    without_held = samples.values - samples.named[:, ~free] @ values[~free]
    values[free] = _sizes(samples.named[:, free], samples.beside, without_held)[0]
    if (values < _LEAST).any() or (values > _MOST).any():
        return None
    stiffness = float(1.0 / values[0])
    parameters = {_STIFFNESS: stiffness} | ({_PLAY: float(values[1])} if values[1] or known[1] else {})
    effect = CouplingCompliance(parameters, rig.constants, check=False)
    errors = zip((_STIFFNESS, _PLAY), stderr * (stiffness**2, 1.0), free, strict=True)
    is_open = samples.may_be_zeros(known) or (bool(free[1]) and _may_be_gradual(samples))
    left = samples.values - samples.named @ values
    return _Change(effect, values, left, {key: float(error) for key, error, told in errors if told}, is_open)


def _may_be_gradual(samples: _Samples) -> bool:
    """Whether play that load takes up gradually, or a coupling that is softer at low loads, leaves as little."""
    twist = samples.named[:, 0]
    root = twist / np.sqrt(np.abs(twist) + 1e-300)
    left = _without(np.column_stack([twist, root, samples.beside]), samples.values)
    told = samples.told
    return float((left**2).sum() - (told.rest**2).sum()) < (SETTINGS.sure_of_link * told.noise) ** 2


def _least(loss: Callable[[float], float], start: float) -> float:
    from scipy.optimize import minimize_scalar

    grid = np.concatenate([[start], np.geomspace(0.05, 500, 40)])
    best = int(np.argmin([loss(float(x)) for x in grid]))
    around = sorted({float(x) for x in grid})
    place = around.index(float(grid[best]))
    low, high = around[max(place - 1, 0)], around[min(place + 1, len(around) - 1)]
    found = minimize_scalar(loss, bounds=(low if low < around[place] else 0.0, high), method="bounded")
    return float(found.x)


def _noise(samples: FloatArray) -> float:
    """Standard deviation of white noise, from third differences.

    Those that are nothing are of an axis that stands: what the digits of a file are rounded by shows where it moves.
    """
    smooth = np.abs(np.diff(samples, n=3) / np.sqrt(20.0))
    apart = smooth[smooth > SETTINGS.least_noise_deg]
    return float(np.median(apart) / MEDIAN_1) if apart.size else SETTINGS.least_noise_deg


def _rms(samples: FloatArray) -> float:
    return float(np.sqrt(np.mean(samples**2)))


@dataclass(frozen=True)
class _Kind:
    """What may be on a link: its columns, and how their sizes are said.

    least, most: the sizes below which no machine is, and above which no rig file may be.
    """

    columns: tuple[int, ...]
    say: Callable[[FloatArray], str]
    least: float = -np.inf
    most: float = np.inf

    def text(self, change: FloatArray, known: FloatArray) -> tuple[str, bool]:
        """What is said of sizes beyond known ones, and whether a machine may have them."""
        size, slack = known + change, SETTINGS.rest_of_link * np.abs(change)
        if (size < self.least - slack).any():
            return f"{self.say(size)}, which no machine has", False
        beyond = ", which is beyond what a rig file may have" if (size > self.most).any() else ""
        return self.say(np.maximum(size, self.least)) + beyond, True


def _coupling_text(softness: float) -> str:
    return "a rigid coupling" if abs(softness) <= _LEAST[0] else f"a stiffness of {1.0 / softness:.3g} N m/rad"


def _late_text(early_ms: float) -> str:
    return f"{abs(early_ms):.2g} ms {'early' if early_ms > 0 else 'late'}"


_OFF_CENTRE = "of the fast shaft (an encoder or a coupling that is off centre or bent)"
_SERVO = (
    _Kind((0,), lambda x: f"a lag of {x[0]:.3g} ms", ControlLag.scalars[0].lower, ControlLag.scalars[0].upper),
    _Kind((1,), lambda x: f"zeros of theta_ref and theta_mot that are {abs(x[0]):.2g} deg apart"),
)
_COUPLING = (
    # less soft than the stiffest of rig files is as good as rigid
    _Kind((0,), lambda x: _coupling_text(float(x[0])), -_LEAST[0], _MOST[0]),
    _Kind((1,), lambda x: f"play of {x[0]:.2g} arcmin", _LEAST[1], _MOST[1]),
    _Kind((2,), lambda x: f"zeros of theta_mot and theta_in that are {abs(x[0]):.2g} deg apart"),
    _Kind((3,), lambda x: f"a part in proportion to the speed, as if theta_in were {_late_text(1e3 * x[0])}"),
    _Kind((4, 5), lambda x: f"a wave of {np.hypot(*x):.2g} deg, once a turn {_OFF_CENTRE}"),
    _Kind((6, 7), lambda x: f"a wave of {np.hypot(*x):.2g} deg, twice a turn {_OFF_CENTRE}"),
)


def _looks_like(samples: _Samples, left: FloatArray, known: FloatArray, kinds: Sequence[_Kind]) -> str:
    """What makes nearly all of what is left (n,) beyond known numbers: each choice of kinds of which none can go.

    Nothing where all of them together leave too much.
    """
    columns = np.hstack([samples.named, samples.beside, samples.zeros])
    count, zero = columns.shape[1], kinds[samples.named.shape[1]]
    own_zeros = _Kind(
        tuple(range(count - samples.zeros.shape[1], count)),
        lambda x: f"zeros of each recording's own, which differ by up to {np.ptp(x):.2g} deg",
    )
    base = np.concatenate([known, np.zeros(count - len(known))])
    # lengths in the corner are RMS of a sample
    corner, wanted = (part / np.sqrt(len(left)) for part in _corner(columns, left))
    noise, least = SETTINGS.left_on_link * samples.told.noise, float(np.linalg.norm(_joint(corner, wanted)[1]))
    if least > max(SETTINGS.rest_of_link * _rms(left), noise):
        return ""
    limit = max(noise, SETTINGS.left_on_link * least)
    found = list[tuple[frozenset[_Kind], str, bool]]()
    for choice in _choices([*kinds, own_zeros]):
        its = frozenset(choice)
        # zeros of each recording's own are one of all as well
        wider = its | {zero} if own_zeros in its else its
        if its >= {zero, own_zeros} or any(fewer <= wider for fewer, _, _ in found):
            continue
        sizes, rest = _joint(corner[:, [i for kind in choice for i in kind.columns]], wanted)
        if np.linalg.norm(rest) < limit:
            parts = np.split(sizes, np.cumsum([len(kind.columns) for kind in choice])[:-1])
            said = [kind.text(part, base[list(kind.columns)]) for kind, part in zip(choice, parts, strict=True)]
            found.append((its, " and ".join(text for text, _ in said), all(may_be for _, may_be in said)))
    texts = [text for _, text, may_be in found if may_be] or [text for _, text, _ in found]
    return f"; it looks like {', or like '.join(texts)}" if texts else ""


def _choices(kinds: Sequence[_Kind]) -> Iterator[tuple[_Kind, ...]]:
    """All choices of some of the kinds, those of few first."""
    for count in range(1, len(kinds) + 1):
        yield from combinations(kinds, count)


def _joint(columns: FloatArray, samples: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Sizes of columns (n, p) that leave the least of samples (n,), none larger than need be, and what they leave."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    sizes = np.linalg.lstsq(columns / scale, samples, rcond=SETTINGS.told_of_column)[0] / scale
    return sizes, samples - columns @ sizes


@dataclass(frozen=True)
class _Rig:
    """What the rig says of a link.

    effect: its own, None without one; known: the numbers as they are in the columns, (p,); left: what it leaves, (n,);
    kinds: what may be on the link; ratio: of the reducer.
    """

    effect: Effect | None
    known: FloatArray
    left: FloatArray
    title: str
    kinds: tuple[_Kind, ...]
    ratio: float


@dataclass(frozen=True)
class _Change:
    """A link's effect with numbers that are told to be others than the rig's.

    values: the numbers as they are in the columns, (p,); left: what it leaves of the link, (n,); stderr: of its
    parameters that the data tell; is_open: something else would do as well.
    """

    effect: Effect
    values: FloatArray
    left: FloatArray
    stderr: dict[str, float]
    is_open: bool


def _judged(samples: _Samples, rig: _Rig, change: _Change | None) -> Link:
    """A claim where the link's effect explains what is there, and a signature where something is left."""
    noise = samples.told.noise
    found = None if change is None else _claim(samples, rig.left, change)
    left, values = (rig.left, rig.known) if change is None or found is None else (change.left, change.values)
    retuned = None
    if found is not None and rig.effect is not None:
        is_open = SOMETHING_ELSE in found.alternatives
        retuned = Retuned(rig.effect, found.piece.effect, found.stderr, found.evidence.p_chance, is_open=is_open)
    unexplained = ""
    if _rms(left) > SETTINGS.left_on_link * noise:
        unexplained = f"{rig.title}: {_rms(left):.2g} deg RMS are left at the fast side, noise is {noise:.2g} deg"
        unexplained += _looks_like(samples, left, values, rig.kinds)
    gap = Gap(*(size / rig.ratio for size in (_rms(rig.left), _rms(left), noise)))
    return Link(None if retuned else found, retuned, gap, unexplained)


def _claim(samples: _Samples, first: FloatArray, change: _Change) -> Claim | None:
    """The claim of a change that is stable, no chance, and most of what is there; first: what the rig leaves, (n,)."""
    noise = samples.told.noise
    x, y = _without(samples.beside, first), _without(samples.beside, change.left)
    before, after = _rms(x), _rms(y)
    saved = float((np.minimum(x**2, 1e6 * noise**2).sum() - np.minimum(y**2, 1e6 * noise**2).sum()) / noise**2)
    blocks = np.array_split(np.arange(len(x)), SETTINGS.parts_of_link)
    stable = float(np.mean([(x[b] ** 2).sum() > (y[b] ** 2).sum() for b in blocks]))
    size = float(np.sqrt(max(before**2 - after**2, 0.0)) / noise)
    p = chi_square_tail(saved, max(len(change.stderr), 1))
    fits = max(after**2 - noise**2, 0.0) < SETTINGS.misfit * max(before**2 - after**2, 1e-300)
    if p >= SETTINGS.p_chance or stable <= SETTINGS.stable_link or size < SETTINGS.least_size_of_link or not fits:
        return None
    evidence = Evidence(saved, len(change.stderr), p, p, {"time": saved / len(x)}, (1, 1), stable, size)
    # what stays may have moved its numbers
    is_open = change.is_open or after > SETTINGS.left_on_link * noise
    share = float(np.clip(1 - (after**2 - noise**2) / max(before**2 - noise**2, 1e-300), 0, 1))
    effect, others = change.effect, (SOMETHING_ELSE,) if is_open else ()
    held = [f"{key} is held at {effect.scalar(key):g}: no other that a rig file may have is nearer to what the data say"
            for key in effect.values if key not in change.stderr]  # fmt: skip
    return Claim(Piece(effect, frozenset(change.stderr), True), change.stderr, evidence, others, (), share, (*held,))
