"""What no effect explains of samples over time: waves of the output's angle that stand above all that is around."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import orth

from st_codegen.campaign.moments import moments
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.fit.normal import made_of
from st_codegen.reconcile.fit.target import FitData
from st_codegen.reconcile.rest.unexplained import Signature
from st_codegen.reconcile.settings import SETTINGS

#: the least distance of orders that are tried between whole ones
_FINEST_STEP = 0.02
#: how often waves of whole orders and those between are told from each other
_ROUNDS = 3
#: orders whose waves are made at once: some 50 MB
_AT_ONCE = 512


def waves_of_angle(data: Observations, samples: FloatArray, highest: int) -> ComplexArray:
    """Waves of samples over the output's angle, complex128 (highest + 1,): their mean, then amplitudes."""
    assert data.angle_rad is not None
    found: ComplexArray = moments(data.angle_rad, samples[None, :], highest)[0] * (2.0 / len(samples))
    found[0] /= 2.0
    return found


def stand_out(power: FloatArray, around: FloatArray, is_open: BoolArray) -> BoolArray:
    """The orders at which `power` (K,) is far larger than `around` on the open orders on both sides, in the mean.

    A step, a slow wander, and an angle that is not passed evenly have waves of all orders; none of them says anything.
    The mean is that of logarithms, right in a spectrum that falls; a step's falls as one over the square of the order,
    and the lowest orders, which have surroundings on one side alone, have to stand out of that.
    """
    nearest, furthest = SETTINGS.around_line
    wide = np.ones(2 * furthest + 1)
    wide[furthest - nearest + 1 : furthest + nearest] = 0.0
    count = np.maximum(np.convolve(is_open.astype(np.float64), wide, "same"), 1.0)
    order = np.maximum(np.arange(len(power)), 1.0)
    found = np.ones(len(power), np.bool_)
    for weight in (np.ones(len(power)), order**2):
        logs = np.where(is_open, np.log(np.maximum(weight * around, 1e-300)), 0.0)
        # powers of noise are exponential: the mean of their logarithms is that of their mean less Euler's constant
        level = np.exp(np.convolve(logs, wide, "same") / count + np.euler_gamma)
        found &= weight * power > SETTINGS.stands_out * level
    return found


def lines_in_samples(target: FitData, residual: ComplexArray, highest: int = 300) -> list[Signature]:
    """Signatures of samples over time: waves of the output's angle that stand above the noise.

    All that was found is fitted together with a mean that wanders slowly: where turns are not whole, each of them leaks
    into other orders. A size that changes, as of a resonance that is passed, is that of the wave while it changes.
    """
    files = target.data.number_of_recording
    between, made = list[Signature](), np.zeros(len(files))
    # each of both leaks into the other where turns are not whole: what is sure of one is taken from the other
    for _ in range(_ROUNDS):
        whole, rest, waves = _whole_orders(target, residual[:, 0].real - made, files, highest)
        between, now = _between_orders(target, rest + made, files, highest)
        rest, made = rest + made - now, now
        if not between:
            break
    out = list[Signature]()
    # where there are as many as are told, others of constant size may be in the rest, and look like one that changes
    may_change = len(whole) < SETTINGS.most_lines
    while whole:
        order = max(whole, key=lambda one: whole[one])
        told = [one.order for one in out]
        found = _changing(target, rest, files, order, whole, waves, told) if order and may_change else None
        kind, name, changes = "constant", f"order {order}" if order else "the mean", ""
        if found is None:
            size = whole.pop(order)
        else:
            order, size, rest, kind = found.order, found.rms_deg, found.rest, "combination"
            whole = {k: constant for k, constant in whole.items() if k not in (order, *found.parts)}
            alike = f" (or {', '.join(map(str, found.alike))}, with about as little left)" if found.alike else ""
            name, changes = f"order {order}{alike}", f", of a size or phase that changes: {found.where}"
        text = f"{name}: {size:.2g} deg RMS over the recordings{changes}"
        out.append(Signature(order, size, size**2, {kind: 1.0}, "both", text))
    return [*sorted(out, key=lambda one: -one.rms_deg), *between]


def _whole_orders(
    target: FitData, left: FloatArray, files: IntArray, highest: int
) -> tuple[dict[int, float], FloatArray, dict[int, FloatArray]]:
    """RMS of constant waves of whole orders in samples (n,), by order; the samples without them; these waves (n,)."""
    data, angle, sigma = target.data, target.data.angle_rad, _noise_of(target)
    assert angle is not None
    mean = _slow(angle, data.at.sign, files)
    own, found = left - mean @ (mean.T @ left), list[int]()
    everywhere = np.ones(highest + 1, np.bool_)
    # of less than a wave nobody can tell that it is one
    turns = max(float(np.ptp(angle[files == n])) for n in np.unique(files)) / (2 * np.pi)
    too_long = [order for order in range(1, highest + 1) if order * turns < SETTINGS.least_of_wave]
    while True:
        orders = [order for order in found if order]
        waves = np.exp(1j * np.outer(angle, orders))
        columns = np.hstack([waves.real, waves.imag])
        beside = columns - mean @ (mean.T @ columns)
        values = np.linalg.lstsq(beside, own, rcond=None)[0]
        amplitudes = np.linalg.norm(values.reshape(2, -1), axis=0)
        sizes = dict(zip(orders, (amplitudes / np.sqrt(2)).tolist(), strict=True))
        sizes[0] = float(np.linalg.norm(mean.T @ (left - columns @ values)) / np.sqrt(len(left)))
        rest = own - beside @ values
        power = np.abs(waves_of_angle(data, rest, highest)) ** 2
        power[0] = sizes[0] ** 2
        stands = stand_out(power, power, everywhere)
        stands[[*found, *too_long]] = False
        order = int(np.argmax(np.where(stands, power, 0.0)))
        size = float(np.sqrt(power[order] / (2 if order else 1)))
        # noise of a line: sigma*sqrt(2/n); autocorrelation may double it, and what has no line is noise to it
        rms = float(np.sqrt((rest**2).mean()))
        least = SETTINGS.sure_line * max(sigma, rms) / np.sqrt(len(left))
        is_noise = not stands[order] or size < least or size < 0.5 * sigma
        # what angles are rounded by may have all its power in one wave
        if is_noise or size < data.rounded_deg or len(found) == SETTINGS.most_lines:
            break
        found.append(order)
    made = {order: beside[:, k :: len(orders)] @ values[k :: len(orders)] for k, order in enumerate(orders)}
    return {order: sizes[order] for order in found}, rest, made


def _noise_of(target: FitData) -> float:
    """The noise of a sample, deg: samples that are far apart differ by waves as well."""
    data = target.data
    return min(float(np.sqrt((target.sigma**2).mean())), max(data.neighbours_deg, data.rounded_deg))


@dataclass(frozen=True)
class _Changing:
    """A wave whose size or phase changes: its order, its RMS, where it is largest, and the samples without it (n,).

    parts: orders of constant waves beside it that were nothing but parts of it; alike: other orders that leave about as
    little.
    """

    order: int
    rms_deg: float
    where: str
    rest: FloatArray
    parts: tuple[int, ...]
    alike: tuple[int, ...] = ()

    @cached_property
    def left(self) -> float:
        """The mean power of the samples without it."""
        return float((self.rest**2).mean())


def _changing(
    target: FitData,
    rest: FloatArray,
    files: IntArray,
    order: int,
    whole: Mapping[int, float],
    waves: Mapping[int, FloatArray],
    told: Sequence[int],
) -> _Changing | None:
    """The wave of about an order that changes over samples, which leave `rest` (n,) without all waves; None without.

    A resonance that is passed has its phase turn while its size grows: constant waves of the orders beside it make that
    as well as one of its own. So all of them are taken as one, of the order that leaves least, if it is clearly larger.
    """
    reach, shortest = SETTINGS.beside_changing, max(SETTINGS.piece_of_turn, SETTINGS.waves_of_piece / order)
    # what lies beside any that is tried
    near = [k for k in whole if k and 0 < abs(k - order) <= 2 * reach and abs(k - order) * shortest < 1.0]
    for beside in [near, []] if near else [[]]:
        group = {k: waves[k] for k in (order, *beside)}
        far = min((abs(order - k) for k in (*whole, *told) if k and k not in group), default=order)
        length = max(shortest, 1.0 / far)
        # pieces tell other orders from it
        orders = [k for k in range(max(1, order - reach), order + reach + 1) if abs(k - order) * length < 1.0]
        tried = [_beside_constant_ones(target, rest, files, k, length, group) for k in orders]
        best = min(tried, key=lambda one: one.left)
        constant = [whole[k] for k in (best.order, *best.parts) if k in whole]
        if constant and best.rms_deg > SETTINGS.clearly_larger * float(np.linalg.norm(constant)):
            noise = min(_noise_of(target) ** 2, best.left) * max(1.0 - 10.0 / np.sqrt(len(rest)), 0.0)
            # of two resonances at once the rest holds the other as well
            more = min((SETTINGS.as_little - 1.0) * (best.left - noise), SETTINGS.as_little_of_wave * best.rms_deg**2)
            alike = tuple(one.order for one in tried if one is not best and one.left < best.left + more)
            return replace(best, alike=alike)
    return None


def _beside_constant_ones(
    target: FitData, rest: FloatArray, files: IntArray, order: int, length: float, waves: Mapping[int, FloatArray]
) -> _Changing:
    """A wave of an order that changes, beside those of constant `waves` that tell much of what it leaves."""
    angle = target.data.angle_rad
    assert angle is not None
    alone, parts = rest + np.sum(list(waves.values()), axis=0), list[int]()
    left = alone - _while_it_changes(target, alone, files, order, length)[1]
    for k, wave in ((k, wave) for k, wave in waves.items() if k != order):
        both = (np.cos(k * angle), np.sin(k * angle))
        columns = np.stack([one - _while_it_changes(target, one, files, order, length)[1] for one in both], axis=1)
        told = made_of(columns, left)
        is_own = float(told @ told) > SETTINGS.own_beside_changing * float(left @ left)
        if is_own or abs(k - order) > SETTINGS.beside_changing:
            alone = alone - wave
        else:
            parts.append(k)
    size, made, where = _while_it_changes(target, alone, files, order, length)
    return _Changing(order, size, where, alone - made, tuple(parts))


def _while_it_changes(
    target: FitData, samples: FloatArray, files: IntArray, order: int, length: float
) -> tuple[float, FloatArray, str]:
    """RMS of a wave whose size and phase change over samples (n,), noise taken off, the wave, and where it is largest.

    It is told anew in pieces of the angle that is travelled, of `length` turns.
    """
    data, angle = target.data, target.data.angle_rad
    assert angle is not None
    travelled = np.cumsum(np.abs(np.diff(angle, prepend=angle[0])))
    piece = np.unique(
        np.stack([files, (travelled / (2 * np.pi * length)).astype(np.int64)]), axis=1, return_inverse=True
    )[1].ravel()
    cosine, sine = np.cos(order * angle), np.sin(order * angle)
    count = np.bincount(piece)
    cc, ss, cs, yc, ys = (
        np.bincount(piece, values) for values in (cosine**2, sine**2, cosine * sine, cosine * samples, sine * samples)
    )
    spread = cc * ss - cs**2
    # where both parts of the wave are told
    told = spread > SETTINGS.both_of_piece * (count / 2.0) ** 2
    told &= count >= SETTINGS.least_of_piece
    if not told.any():
        return 0.0, np.zeros(len(samples)), ""
    spread = np.where(told, spread, 1.0)
    sizes = np.stack([(ss * yc - cs * ys) / spread, (cc * ys - cs * yc) / spread]) * told
    saved = (sizes * np.stack([yc, ys])).sum(axis=0)
    inside = told[piece]
    noise = max(float((samples[inside] ** 2).sum()) - float(saved.sum()), 0.0) / max(inside.sum() - 2 * told.sum(), 1)
    power = max(float(saved.sum()) - 2.0 * noise * told.sum(), 0.0) / len(samples)
    most = int(np.argmax(np.hypot(*sizes)))
    at = data.at.rows(np.flatnonzero(piece == most))
    where = (
        f"largest, {np.hypot(*sizes[:, most]):.2g} deg, around {at.speed_rpm.mean():.3g} rpm and "
        f"{at.torque_Nm.mean():.3g} N m ({data.labels[int(np.argmax(piece == most))]})"
    )
    return float(np.sqrt(power)), sizes[0][piece] * cosine + sizes[1][piece] * sine, where


def _between_orders(
    target: FitData, left: FloatArray, files: IntArray, highest: int
) -> tuple[list[Signature], FloatArray]:
    """Signatures of waves between whole orders in samples (n,) that have nothing else left, largest first; the waves.

    They do not come back after a turn, so that each recording has a phase of its own. Where a recording is no longer
    than some turns, they have to lie as far from whole orders as its length tells apart. Noise that lasts over samples,
    as behind a low pass, has no line.
    """
    angle, numbers = target.data.angle_rad, np.unique(files)
    assert angle is not None
    turns = np.array([np.ptp(angle[files == n]) for n in numbers]) / (2.0 * np.pi)
    if turns.max() < SETTINGS.least_turns_between:
        return [], np.zeros(len(left))
    step = max(0.5 / float(turns.max()), _FINEST_STEP)
    dense = float(np.median([(files == n).sum() / max(turn, 1e-9) for n, turn in zip(numbers, turns, strict=True)]))
    tried = np.arange(SETTINGS.wander_orders + 1.0, min(highest, dense / 2.0), step)
    apart = np.abs(tried - np.round(tried)) > max(1.0 / float(turns.max()), SETTINGS.off_order)
    out, rest, size = list[Signature](), left.copy(), float(np.sqrt((left**2).mean()))
    while len(out) < SETTINGS.most_lines and len(tried):
        power = _power_at(tried, angle, rest, files)
        stands = apart & stand_out(power, power, np.ones(len(tried), np.bool_))
        coarse = tried[int(np.argmax(np.where(stands, power, 0.0)))]
        near = coarse + step * np.linspace(-1.0, 1.0, 41)
        best = float(near[int(np.argmax(_power_at(near, angle, rest, files)))])
        made = np.zeros(len(rest))
        for n in numbers:
            own = files == n
            columns = np.stack([np.cos(best * angle[own]), np.sin(best * angle[own])], axis=1)
            made[own] = made_of(columns, rest[own])
        rms = float(np.sqrt((made**2).mean()))
        if not stands.any() or rms < SETTINGS.part_of_rest * size:
            return out, left - rest
        rest, size = rest - made, float(np.sqrt(((rest - made) ** 2).mean()))
        periods = f"{best:.{1 if round(best, 1) % 1 else 2}f}"  # it has no whole number of them
        text = (
            f"a wave of about {periods} periods a turn, {rms:.2g} deg RMS over the recordings: it does not come back "
            "after a turn, as of a bearing, a belt, another shaft, or of a frequency of its own at one speed"
        )
        out.append(Signature(-1, rms, rms**2, {"constant": 1.0}, "both", text, rms * np.sqrt(2), periods=best))
    return out, left - rest


def _power_at(tried: FloatArray, angle: FloatArray, samples: FloatArray, files: IntArray) -> FloatArray:
    """Power of samples (n,) at orders (m,) that need not be whole, whatever the phase in each recording, (m,)."""
    power = np.zeros(len(tried))
    for n in np.unique(files):
        own = files == n
        for part in range(0, len(tried), _AT_ONCE):
            waves = np.exp(-1j * np.outer(tried[part : part + _AT_ONCE], angle[own]))
            power[part : part + _AT_ONCE] += np.abs(waves @ samples[own]) ** 2 / own.sum()
    return power


def _slow(angle: FloatArray, sign: FloatArray, files: IntArray) -> FloatArray:
    """Orthonormal columns of a mean that differs by direction and wanders, no faster than once in two turns, (n, p).

    It wanders over the angle that is travelled inside of the files, so that no order is slow where the machine is.
    """
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(angle)) * (np.diff(files) == 0))])
    count = min(int(travelled[-1] / (2 * np.pi)), SETTINGS.most_waves_of_mean)
    waves = np.cos(np.outer(travelled, np.arange(count + 1)) * (np.pi / max(travelled[-1], 1e-300)))
    return orth(np.hstack([waves, sign[:, None]]), rcond=1e-8)
