"""Measured data of every kind as observations: campaign folders, and harmonic tables."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter1d

from st_codegen.campaign.conditions import Conditions
from st_codegen.campaign.curves import CONDITIONS_FILE
from st_codegen.campaign.harmonic_table import read_table
from st_codegen.campaign.orders import BAND, OrderFit, Sums, fit_orders, listed
from st_codegen.campaign.reader import Campaign, MeasuredCurve, read_campaign
from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.csv_tables import read_csv
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.processes import Progress
from st_codegen.reconcile.data.checks import check_speeds, check_turns
from st_codegen.reconcile.data.hum import Hum, without_hums, without_waves_between
from st_codegen.reconcile.data.observations import Observations, first_of, from_table, labels, sorted_by
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects.wear import bump
from st_codegen.rig.model import RigModel
from st_codegen.threads import one_thread

#: angles of a turn at which a bump is looked for
_ANGLES = 2048


@one_thread()
def read_measured(
    path: Path, rig: RigModel, progress: Progress | None = None, *, skip_bad: bool = False, scale: float = 1.0
) -> Observations:
    """Read a campaign folder or a harmonic table; `skip_bad`: leave out files that cannot be read, and say so.

    scale: what its numbers have to be multiplied by to be deg; they stay as they are. Raises InputError for what cannot
    be read.
    """
    if path.is_dir():
        return _campaign(path, rig, progress, skip_bad, scale)
    if not path.is_file():
        raise InputError(f"{path}: no such file or folder")
    return from_table(read_table(path))


def _campaign(folder: Path, rig: RigModel, progress: Progress | None, skip_bad: bool, scale: float) -> Observations:
    campaign, clipped = _without_clipped(read_campaign(folder, skip_bad=skip_bad, progress=progress))
    campaign, hums = _without_foreign_waves(campaign, rig)
    bands = np.array([min(curve.sums.band, BAND) for curve in campaign.curves])
    # what the rig makes above the band leaks into it where curves have gaps
    above = [order for order in rig.orders() if order > bands.min()]
    beyond = rig.coefficients(campaign.at, above) / scale if above else np.zeros((len(bands), 0))
    others = _peaks_above(campaign, bands, above)
    expected = [
        dict(zip([*above, *others], [*row.tolist(), *(curve.sums.te[others] * 2.0 / curve.sums.samples)], strict=True))
        for row, curve in zip(beyond, campaign.curves, strict=True)
    ]
    waves, floor = _spectra(_fits(campaign, list(rig.orders()), bands, expected, progress), bands)
    orders, mistaken = _looked_at(campaign, rig, waves, floor)
    fits = _fits(campaign, orders, bands, expected, progress)
    values, spectral, fitted = _coefficients(fits, orders, bands)
    seen = fitted & ~mistaken[:, orders]
    run, listed_by = _listed_runs(folder, campaign)
    counts = {curve.sums.in_turn for curve in campaign.curves}
    unseen = _beyond(campaign, fits, bands, beyond)
    files = [_file(campaign, curve) for curve in campaign.curves]
    return Observations(
        campaign.at,
        labels(campaign.at, files),
        np.array(orders, np.int64),
        values,
        run=run,
        sorted_by=listed_by,
        spectral_deg=spectral,
        seen=None if seen.all() else seen,
        not_looked_at=(
            *clipped,
            *_not_looked_at(folder, campaign, rig, bands, files, unseen),
            *_rounded_te(campaign, fits),
            *_mistaken_text(campaign, mistaken, bands, files),
        ),
        samples=counts.pop() if len(counts) == 1 else 0,
        hums=hums,
        begins_rad=np.array([curve.sums.begin for curve in campaign.curves]),
        beyond_deg=unseen,
    )


def _without_foreign_waves(campaign: Campaign, rig: RigModel) -> tuple[Campaign, tuple[Hum, ...]]:
    """The campaign without waves that do not turn with the machine, and these.

    Of curves of several turns a line over the number of the sample is no order: there none is looked for. Raises
    InputError where speeds are of nothing that turns, or angles those of the fast shaft.
    """
    several = _hold_several_turns(campaign)
    check_turns(
        np.array([curve.sums.turns for curve in campaign.curves]), rig.constants.reduction_ratio, campaign.folder
    )
    sums, between = [curve.sums for curve in campaign.curves], tuple[Hum, ...]()
    if not several:
        sums, between = without_waves_between(sums, rig.orders(), campaign.at.sign)
    # a wave that does not come back looks like a ramp
    campaign = _with_sums(campaign, sums)
    problems = Problems(str(campaign.folder))
    check_speeds(campaign.at, [curve.path.name for curve in campaign.curves], problems)
    problems.raise_if_any()
    turns = campaign.at.speed_rpm / (60.0 * rig.constants.reduction_ratio)
    sums, hums = (sums, ()) if several else without_hums(sums, turns, rig.orders())
    return _with_sums(campaign, sums), (*between, *hums)


def _hold_several_turns(campaign: Campaign) -> bool:
    return any(curve.sums.holds_several for curve in campaign.curves)


def _peaks_above(campaign: Campaign, bands: IntArray, known: Sequence[int]) -> list[int]:
    """Orders above the bands of all curves that stand out in most of them, and of which the rig has nothing (`known`).

    Where angles are uneven, or some are missing, they leak into those that are looked at.
    """
    lowest = int(bands.max()) + 1
    highest = min(BAND, *((curve.sums.in_turn - 1) // 2 for curve in campaign.curves))
    if highest < lowest:
        return []
    power = np.stack([np.abs(curve.sums.te[lowest : highest + 1]) ** 2 for curve in campaign.curves])
    usual = np.median(power / np.maximum(np.median(power, axis=1, keepdims=True), 1e-300), axis=0)
    reach = 2 * SETTINGS.orders_of_line + 1
    peaks = (usual > SETTINGS.loud_line) & (usual == maximum_filter1d(usual, reach, mode="nearest"))
    return sorted({*(lowest + np.flatnonzero(peaks)).tolist()} - set(known))


def _spectra(fits: Sequence[OrderFit], bands: IntArray) -> tuple[ComplexArray, FloatArray]:
    """The waves of curves and their noise as amplitudes, (n, highest band + 1); what a curve does not tell is nan."""
    waves = np.full((len(fits), int(bands.max()) + 1), np.nan, np.complex128)
    floor = np.ones(waves.shape)
    for row, (fit, band) in enumerate(zip(fits, bands.tolist(), strict=True)):
        waves[row, : band + 1] = fit.waves[: band + 1]
        floor[row, : band + 1] = np.maximum(fit.spectrum_floor[: band + 1], 1e-30)
    return waves, floor


def _looked_at(
    campaign: Campaign, rig: RigModel, waves: ComplexArray, floor: FloatArray
) -> tuple[list[int], BoolArray]:
    """The orders that are looked at, and which of all orders each curve mistakes for another one, bool (n, K).

    waves, floor: see `_spectra`.
    """
    power, band = np.abs(waves / floor) ** 2, waves.shape[1] - 1
    mistaken = _mistaken(campaign, {*rig.orders(), *np.flatnonzero(_loud(power)).tolist()}, band)
    mistaken |= _alone(power, np.array([curve.sums.in_turn for curve in campaign.curves]), rig.orders())
    waves = np.where(mistaken, np.nan, waves)
    told = [k for k in rig.orders() if k <= band and not mistaken[:, k].all()]
    known = {*told, *np.flatnonzero(_loud(np.abs(waves / floor) ** 2)).tolist()}
    sign = campaign.at.sign
    shared = _shared(waves, sign, known) or _of_a_place(waves, floor, sign, known, rig.constants.mesh_orders())
    return sorted({0, *known, *shared}), mistaken


def _coefficients(
    fits: Sequence[OrderFit], orders: list[int], bands: IntArray
) -> tuple[ComplexArray, FloatArray, BoolArray]:
    """Coefficients, the noise of one component of each by its curve, and whether its samples tell it, all (n, K)."""
    values, fitted = np.zeros((len(fits), len(orders)), np.complex128), np.array(orders)[None, :] <= bands[:, None]
    spectral = np.zeros(values.shape)
    for row, fit in enumerate(fits):
        values[row, fitted[row]] = fit.coefficients
        # in curves without any noise the last digits of their numbers are none of the machine
        spectral[row, fitted[row]] = np.maximum(fit.noise_floor, SETTINGS.least_noise_deg)
    spectral *= _colour(fits, orders, int(bands.min()))
    # an amplitude has the variance of two components; the floor of the mean is that of one number already
    spectral /= np.where(np.array(orders) == 0, 1.0, np.sqrt(2.0))
    return values, spectral, fitted


def _beyond(
    campaign: Campaign, fits: Sequence[OrderFit], bands: IntArray, expected: ComplexArray | FloatArray
) -> float:
    """RMS (deg) above the bands of the curves, where it is more than noise as below lets expect in the median; else 0.

    expected: what the rig has there, (curves, orders), which is taken off.
    """
    found, noise = np.zeros(len(fits)), np.zeros(len(fits))
    for row, (fit, curve, band) in enumerate(zip(fits, campaign.curves, bands.tolist(), strict=True)):
        samples = curve.sums.samples
        others = np.setdiff1d(np.arange(band + 1), np.array(fit.orders))
        found[row] = fit.residual_rms_deg**2 - (np.abs(fit.waves[others]) ** 2).sum() / 2
        # an amplitude has 4/N of the variance of a sample
        steady = min(SETTINGS.wander_orders + 1, len(fit.spectrum_floor) - 1)
        white = samples * float(np.median(fit.spectrum_floor[steady:])) ** 2 / 4
        noise[row] = white * max(1.0 - 2 * band / samples, 0.0)
    found -= (np.abs(expected) ** 2).sum(axis=1) / 2
    loud = np.median(found) > SETTINGS.beyond_band * np.median(noise)
    return float(np.sqrt(np.median(found - noise))) if loud else 0.0


def _colour(fits: Sequence[OrderFit], orders: Sequence[int], band: int) -> FloatArray:
    """By what the noise at each order differs from the median of the quiet orders around it, (K,).

    The floor of a curve is one number for some two dozen orders. Where the noise falls or rises with the order, as all
    curves together tell, that is too little on one side of them and too much on the other.
    """
    powers = np.stack([np.abs(fit.waves[: band + 1]) ** 2 for fit in fits])
    powers /= np.maximum(np.median(powers, axis=1, keepdims=True), 1e-300)
    usual = np.median(powers, axis=0)
    quiet = np.setdiff1d(np.arange(SETTINGS.wander_orders + 1, band + 1), np.array(orders))
    found = np.ones(len(orders))
    for number, order in enumerate(orders):
        near = quiet[np.argsort(np.abs(quiet - order), kind="stable")[: 2 * SETTINGS.quiet_beside]]
        if order <= SETTINGS.wander_orders or len(near) < SETTINGS.quiet_beside or (usual[near] <= 0.0).any():
            continue
        x = np.log(near)
        (slope, _), covariance = np.polyfit(x, np.log(usual[near]), 1, cov=True)
        if abs(slope) > SETTINGS.told * float(np.sqrt(covariance[0, 0])):
            # the median of what rises or falls is that of the middle one; beyond the quiet orders no slope is told
            found[number] = np.exp(slope * (np.clip(np.log(order), x.min(), x.max()) - np.median(x)) / 2.0)
    return found


def _with_sums(campaign: Campaign, sums: Sequence[Sums]) -> Campaign:
    curves = zip(campaign.curves, sums, strict=True)
    return replace(campaign, curves=tuple(replace(curve, sums=own) for curve, own in curves))


def _mistaken(campaign: Campaign, orders: set[int], band: int) -> BoolArray:
    """(curves, band + 1): the orders that a curve with few samples cannot tell from a higher one of `orders`.

    N equal steps of a turn show order m as order |m - j*N| for each whole number j.
    """
    found = np.zeros((len(campaign.curves), band + 1), np.bool_)
    high = np.array(sorted(orders - {0}), np.int64)
    for row, curve in enumerate(campaign.curves):
        steps = curve.sums.in_turn
        shown = np.abs(high - steps * np.round(high / steps).astype(np.int64))
        shown = shown[(shown != high) & (shown <= band)]
        found[row, shown[shown > 0]] = True
    return found


def _alone(power: FloatArray, samples: IntArray, known: Iterable[int]) -> BoolArray:
    """Lines of curves with fewer samples than others that none of these show: they may be what is beyond all bands.

    power: over noise, (n, K), nan where a curve does not tell; samples: (n,); known: orders of the rig, which curves
    show that have few samples as well.
    """
    coarse = samples < samples.max()
    found: BoolArray = (power > SETTINGS.loud_line) & coarse[:, None]
    found[:, [order for order in known if order < power.shape[1]]] = False
    found &= ~_loud(power[~coarse]) if coarse.any() else False
    for order in np.flatnonzero(found.any(axis=0)).tolist():
        found[:, order] &= _shows_one_above(order, np.unique(samples[found[:, order]]))
    return found


def _shows_one_above(order: int, counts: IntArray) -> bool:
    """Whether some order above could show as this one in curves of each of these numbers of samples a turn.

    Curves sampled in time have as many numbers as speeds: what is at one order in several of them is no other one.
    """
    turns = np.arange(1, SETTINGS.highest_line // int(counts.max()) + 2)
    above = (turns[:, None] * int(counts.max()) + np.array([-order, order])).ravel()
    shown = np.abs(above[:, None] - counts * np.round(above[:, None] / counts))
    return bool((shown == order).all(axis=1).any())


def _mistaken_text(campaign: Campaign, mistaken: BoolArray, bands: IntArray, files: list[str]) -> list[str]:
    """Which orders were left out of which curves for `_mistaken`."""
    mistaken = mistaken & (np.arange(mistaken.shape[1])[None, :] <= bands[:, None])
    rows = np.flatnonzero(mistaken.any(axis=1))
    if not rows.size:
        return []
    orders = listed(np.flatnonzero(mistaken.any(axis=0)).tolist())
    named = sorted({files[row] for row in rows})
    most = max(campaign.curves[row].sums.in_turn for row in rows)
    return [
        f"orders {orders} of {counted(len(named), 'file')}: {most} or fewer samples a turn may show higher orders as "
        f"these: {first_of(named, 5)}"
    ]


def _fits(
    campaign: Campaign,
    orders: list[int],
    bands: IntArray,
    expected: list[dict[int, complex]],
    progress: Progress | None,
) -> list[OrderFit]:
    """The orders of every curve as far as its own samples tell them; expected: coefficients of those above.

    Raises InputError that names the curves whose angles do not tell them apart.
    """
    found, problems = list[OrderFit](), Problems(f"{campaign.folder}: order analysis")
    for number, (curve, band, beyond) in enumerate(zip(campaign.curves, bands.tolist(), expected, strict=True)):
        if progress is not None:
            progress(number, len(campaign.curves), curve.path.name)
        with problems.collect(f"{_file(campaign, curve)}, {curve.direction}"):
            found.append(fit_orders(curve.sums, [order for order in orders if order <= band], beyond))
    problems.raise_if_any()
    return found


def _without_clipped(campaign: Campaign) -> tuple[Campaign, list[str]]:
    """The campaign without curves that a saturated channel has cut off, and what is said of these.

    A channel saturates at one value: several curves stay at it, their lowest or highest, for many samples in a row.
    Where noise or a wave turns back by itself, they stay at the digit next to the extreme about as long; a curve of few
    digits stays at any of them. One in which most samples have a value of their own stays at none by chance: it is cut
    off at whatever value that is, as where a mean was taken off it afterwards. One that holds a single value shows
    nothing of the machine at all.
    """
    value, held, beside, values = np.moveaxis(np.array([curve.sums.ends for curve in campaign.curves]), 2, 0)
    flat = (values >= SETTINGS.flat_top) & (held > SETTINGS.flat_top * beside)
    samples = np.array([curve.sums.samples for curve in campaign.curves])
    texts = list[str]()
    cut = (values[:, 0] == 1) & (samples >= SETTINGS.flat_top)

    def files_of(own: BoolArray) -> str:
        return first_of(sorted({_file(campaign, campaign.curves[row]) for row in np.flatnonzero(own)}), 5)

    if cut.any():
        still = "as of a channel that stands still, or is too coarse for what the curve has"
        texts.append(f"{counted(int(cut.sum()), 'curve')} with one value in all samples, {still}: {files_of(cut)}")

    def said(own: BoolArray, held: FloatArray, where: str) -> str:
        return (
            f"{counted(int(own.sum()), 'curve')} that are cut off at {where}, with up to "
            f"{counted(int(held.max()), 'sample')} in a row there, as by a channel that saturates, or is too coarse "
            f"for what lies there: {files_of(own)}"
        )

    for side in range(2):
        for limit, often in zip(*np.unique(value[flat[:, side], side], return_counts=True), strict=True):
            own = value[:, side] == limit
            if often >= SETTINGS.least_block:
                cut |= own
                texts.append(said(own, held[own, side], f"{limit:g}"))
    alone = flat & (2 * values > samples[:, None]) & ~cut[:, None]
    if alone.any():
        cut |= alone.any(axis=1)
        texts.append(said(alone.any(axis=1), held[alone], "values of their own"))
    # where most have a value of their own, others may have one at which they stay for a shorter time
    if cut.all() or 2 * int(alone.any(axis=1).sum()) > len(cut):
        whole = "no curve is whole" if cut.all() else "most curves are not whole, and nobody knows of the others"
        # beside those that are cut off most samples have a value of their own: digits are not what lacks
        digits = "" if (2 * values > samples[:, None] - held)[flat].all() else ", or finer digits"
        advice = f"Measure with a wider range{digits}" if flat.any() else "See whether the channel works"
        raise InputError(f"{campaign.folder}: {whole}: {'; '.join(texts)}. {advice}")
    curves = tuple(curve for curve, is_cut in zip(campaign.curves, cut, strict=True) if not is_cut)
    return replace(campaign, curves=curves), texts


def _file(campaign: Campaign, curve: MeasuredCurve) -> str:
    return curve.path.relative_to(campaign.folder).as_posix()


def _not_looked_at(
    folder: Path, campaign: Campaign, rig: RigModel, bands: IntArray, files: list[str], unseen: float
) -> tuple[str, ...]:
    """Files that were left out, orders above what curves can tell, and how much (`unseen`, deg) these hold."""
    found = [
        f"{error.path.relative_to(folder).as_posix()} was left out: "
        f"{'' if error.line is None else f'line {error.line}: '}{error.reason}"
        for error in campaign.bad
    ]
    found += filter(None, (campaign.spikes, campaign.rounded))
    least = int(bands.min())
    if least < bands.max():
        coarse = sorted({file for file, band in zip(files, bands, strict=True) if band < bands.max()})
        found.append(f"orders above {least} of {counted(len(coarse), 'file')} with few samples: {first_of(coarse, 5)}")
    above = [order for order in rig.orders() if order > bands.max()]
    if above:
        found.append(f"orders {listed(above)} of the rig: a quarter of the samples of a turn is {int(bands.max())}")
    else:
        found.append(f"orders above {int(bands.max())}")
    if _hold_several_turns(campaign):
        several = sum(curve.sums.holds_several for curve in campaign.curves)
        found[-1] += (
            "; waves of no whole number of periods a turn, and of one frequency: only where no curve holds several "
            f"turns, as {several} of {len(campaign.curves)} do"
        )
    if unseen:
        found[-1] += f"; the curves hold {unseen:.2g} deg RMS there in the median, which is more than their noise"
    return tuple(found)


def _rounded_te(campaign: Campaign, fits: Sequence[OrderFit]) -> list[str]:
    """What is said where TE is rounded to steps that are more than its noise, in most curves."""
    steps = []
    for curve, own in zip(campaign.curves, fits, strict=True):
        (low, *_, values), (high, *_) = curve.sums.ends
        step = (high - low) / max(values - 1.0, 1.0)
        made = step / np.sqrt(12.0)
        # a value that only few samples have need not be one of a step
        is_rounded = curve.sums.samples >= SETTINGS.least_of_a_step * values
        is_rounded &= made > SETTINGS.least_of_rounding * own.residual_rms_deg
        steps += [float(step)] if is_rounded else []
    if 2 * len(steps) <= len(fits):
        return []
    return [
        f"what TE does within its steps of {np.median(steps):.2g} deg, which are more than its noise in "
        f"{len(steps)} of {len(fits)} curves: they may make waves of many orders, which differ from run to run"
    ]


def _listed_runs(folder: Path, campaign: Campaign) -> tuple[IntArray | None, str]:
    """The number of each curve's file in conditions.csv, where there is one and it is not sorted by conditions.

    Where it is, the condition by which it is sorted first.
    """
    listed = folder / CONDITIONS_FILE
    if not listed.is_file():
        return None, ""
    table = read_csv(listed, ["file"])
    number = {folder / table.text(row, "file"): i for i, row in enumerate(table.rows)}
    if not all(curve.path in number for curve in campaign.curves):
        return None, ""
    run = np.array([number[curve.path] for curve in campaign.curves], np.int64)
    place = np.argsort(run, kind="stable")
    chosen = [campaign.curves[i] for i in place]
    at = Conditions.of_runs((curve.direction, curve.conditions) for curve in chosen)
    first = sorted_by(at)
    return None if first else run, first


def _loud(power: FloatArray) -> BoolArray:
    """Orders that hold more than noise in the mean of all runs, or much more in a few; power over noise, (n, K).

    What a curve does not tell is nan.
    """
    runs = np.maximum(np.isfinite(power).sum(axis=0), 1)
    power = np.where(np.isfinite(power), power, 0.0) * (len(power) / runs)
    # the power of noise is exponential with mean 1: the mean of n has the standard deviation 1/sqrt(n)
    mean = np.minimum(power, SETTINGS.loud_line).mean(axis=0) > 1 + SETTINGS.quiet_order / np.sqrt(runs)
    few = np.maximum(SETTINGS.runs_with_a_line, SETTINGS.more_runs_with_a_line / runs)
    return np.asarray(mean | ((power > SETTINGS.loud_line).mean(axis=0) > few))


def _shared(waves: ComplexArray, sign: FloatArray, known: set[int]) -> list[int]:
    """Orders that are no louder than their neighbours, yet one wave in all curves of a direction, if there are many.

    What happens at one angle of every turn stands in all orders alike: a spectrum alone takes it for noise. waves:
    (n, K), nan where a curve does not tell; known: orders that are looked at already.
    """
    sure, least = np.zeros(waves.shape[1]), np.zeros(waves.shape[1])
    for direction in np.unique(sign):
        own = waves[sign == direction]
        told = np.isfinite(own)
        count = np.maximum(told.sum(axis=0), 1)
        own = np.where(told, own, 0.0)
        # of n waves of noise, n times this is exponential with mean 1
        alike = np.abs(own.sum(axis=0)) ** 2 / np.maximum(count * (np.abs(own) ** 2).sum(axis=0), 1e-300)
        sure, least = sure + count * alike, np.maximum(least, alike)
    found = np.flatnonzero((sure > SETTINGS.shared_sure) & (least > SETTINGS.shared_least))
    orders = sorted(set(found.tolist()) - known - {0})
    return orders if len(orders) >= SETTINGS.shared_orders else []


def _of_a_place(
    waves: ComplexArray, floor: FloatArray, sign: FloatArray, known: set[int], meshes: Iterable[int]
) -> list[int]:
    """Orders of a bump at one angle that no order shows by itself, but the mean curve of all runs of a direction does.

    Asked at every angle for bumps of some widths, and for mesh orders that are larger there, alike in both directions
    or of opposite sign. waves: (n, K), nan where a curve does not tell; floor: their noise as amplitudes; known: orders
    that are looked at already.
    """
    # the lowest orders may wander from run to run
    asked = np.array([k for k in range(SETTINGS.wander_orders + 1, waves.shape[1]) if k not in known], np.int64)
    noise = np.where(np.isfinite(waves), floor, np.inf)[:, asked]
    own = [sign == direction for direction in np.unique(sign)]
    weights = [(1.0 / noise[rows] ** 2).sum(axis=0) for rows in own]
    if not len(asked) or not (np.min(weights, axis=0) > 0).all():
        return []
    # the mean of each direction by the noise of its curves, and the power of noise in the sum of both
    means = [
        (np.nan_to_num(waves[rows][:, asked]) / noise[rows] ** 2).sum(axis=0) / weight
        for rows, weight in zip(own, weights, strict=True)
    ]
    power = np.sum([1.0 / weight for weight in weights], axis=0)
    best: tuple[float, list[int]] = (SETTINGS.place_sure, [])
    for order, width in itertools.product((0, *meshes), SETTINGS.place_widths_deg):
        shape = bump(asked - order, 0.0, width).real
        reached = asked[np.abs(asked - order) * np.radians(width) <= SETTINGS.told_of_bump]
        for other in (1.0, -1.0)[: len(means)]:
            filtered = np.zeros(waves.shape[1], np.complex128)
            filtered[asked] = (means[0] + other * sum(means[1:])) * shape / power
            there = np.fft.ifft(filtered, _ANGLES) * _ANGLES
            # a bump has one sign, a mesh order any phase
            sure = np.abs(there if order else there.real).max() / np.sqrt(max((shape**2 / power).sum() / 2.0, 1e-300))
            best = max(best, (float(sure), reached.tolist()))
    return best[1]
