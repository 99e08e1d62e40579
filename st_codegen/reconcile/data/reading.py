"""Measured data of every kind as observations: campaign folders, harmonic tables, order spectra."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.campaign.curves import CONDITIONS_FILE
from st_codegen.campaign.harmonic_table import read_table
from st_codegen.campaign.orders import BAND
from st_codegen.campaign.reader import Campaign, read_campaign
from st_codegen.errors import InputError, Problems
from st_codegen.ir.arrays import BoolArray, ComplexArray, IntArray
from st_codegen.reconcile.data.observations import Observations, from_table, labels, order_of_runs
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel

Progress = Callable[[int, int, str], None]
_DEGREES = 57.29577951308232


def read_measured(path: Path, rig: RigModel, progress: Progress | None = None) -> Observations:
    """Read a campaign folder or a harmonic table. Raises InputError for what cannot be read."""
    if path.is_dir():
        return _campaign(path, rig, progress)
    if not path.is_file():
        raise InputError(f"{path}: no such file or folder")
    return from_table(read_table(path))


def columns_of(path: Path) -> list[str]:
    """The header of a CSV file, or nothing."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            line = file.readline()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as text ({error})") from None
    return [cell.strip() for cell in next(csv.reader([line], delimiter=";" if ";" in line else ","), [])]


def _campaign(folder: Path, rig: RigModel, progress: Progress | None) -> Observations:
    campaign = read_campaign(folder, progress=progress)
    _check_ratio(campaign, rig)
    band = min(*(curve.sums.band for curve in campaign.curves), BAND)
    wanted = [order for order in rig.orders() if order <= band]
    first = campaign.fits(wanted, progress)
    spectra = np.stack([fit.spectrum[: band + 1] for fit in first])
    floors = np.stack([fit.spectrum_floor[: band + 1] for fit in first])
    orders = sorted({0, *wanted, *np.flatnonzero(_loud(spectra, floors)).tolist()})
    fits = campaign.fits(orders, progress)
    at = campaign.at
    values = np.stack([fit.coefficients for fit in fits])
    files = [curve.path.relative_to(folder).as_posix() for curve in campaign.curves]
    # an amplitude has the variance of two components; the floor of the mean is that of one number already
    spectral = np.stack([fit.noise_floor for fit in fits]) / np.where(np.array(orders) == 0, 1.0, np.sqrt(2.0))
    return Observations(
        at,
        labels(at, files),
        np.array(orders, np.int64),
        values,
        run=_listed_runs(folder, campaign),
        spectral_deg=spectral,
    )


def _check_ratio(campaign: Campaign, rig: RigModel) -> None:
    """Refuse curves that all rise over the turn: then every order is loud, and none of them says anything."""
    low, high = SETTINGS.ramp_orders
    band = min(curve.sums.band for curve in campaign.curves)
    if band < 2 * low:
        return
    orders = np.arange(low, min(band, high) + 1)
    waves = np.stack([curve.sums.te[orders] * (2.0 / curve.sums.samples) for curve in campaign.curves])
    size, scatter = ramp_deg(orders, waves)
    if abs(size) > SETTINGS.ramp * scatter:
        ratio = rig.constants.reduction_ratio
        raise InputError(
            f"{campaign.folder}: TE rises by {size:.3g} deg over a turn in every curve, as if computed "
            f"with a reduction ratio of {ratio / (1 - size / 360.0):.6g}, not {ratio:g}. Compute TE with the ratio of "
            "the rig, or correct reduction_ratio in the rig file"
        )


def ramp_deg(orders: IntArray, coefficients: ComplexArray) -> tuple[float, float]:
    """The ramp over a turn (deg) that all orders share, and the scatter of single ones; a ramp s is c_k = i s / (pi k).

    coefficients: complex (.., K) of orders (K,). Single waves have any phase: only a ramp has one slope at all orders.
    """
    chosen = orders > 0
    slopes = (coefficients[..., chosen].imag * np.pi * orders[chosen]).ravel()
    size = float(np.median(slopes)) if slopes.size else 0.0
    return size, float(np.median(np.abs(slopes - size))) / 0.6745 if slopes.size else np.inf


def _listed_runs(folder: Path, campaign: Campaign) -> IntArray | None:
    """The number of each curve's file in conditions.csv, where there is one and it is not sorted by conditions."""
    listed = folder / CONDITIONS_FILE
    if not listed.is_file():
        return None
    text = listed.read_text(encoding="utf-8-sig").splitlines()
    rows = csv.DictReader(text, delimiter=";" if text and ";" in text[0] else ",", skipinitialspace=True)
    number = {folder / (row.get("file") or "").strip(): i for i, row in enumerate(rows)}
    if not all(curve.path in number for curve in campaign.curves):
        return None
    run = np.array([number[curve.path] for curve in campaign.curves], np.int64)
    place = np.argsort(run, kind="stable")
    chosen = [campaign.curves[i] for i in place]
    at = Conditions.of_runs((curve.direction, curve.conditions) for curve in chosen)
    return None if order_of_runs(at) is None else run


def _loud(spectra: np.ndarray, floors: np.ndarray) -> BoolArray:
    """Orders that hold more than noise in the mean of all runs, or much more in a few."""
    power = (spectra / np.maximum(floors, 1e-30)) ** 2
    runs = len(power)
    # the power of noise is exponential with mean 1: the mean of n has the standard deviation 1/sqrt(n)
    mean = np.minimum(power, 30.0).mean(axis=0) > 1 + 6 / np.sqrt(runs)
    few = (power > 30.0).mean(axis=0) > max(0.01, 2.5 / runs)
    loud: BoolArray = mean | few
    return loud


def check(data: Observations, rig: RigModel, path: Path, *, units: bool = True) -> None:
    """Refuse data that cannot be compared with the rig; `units`: sizes that look like other units too.

    Raises one InputError with all of it: no order in common, too few conditions, values that are not finite, units.
    """
    problems = Problems(str(path))
    if not np.isfinite(data.values).all():
        rows = np.flatnonzero(~np.isfinite(data.values).all(axis=1))
        problems.add(f"{len(rows)} curves have values that are not finite, the first is {data.labels[rows[0]]}")
    overlap = bool(set(data.orders.tolist()) & set(rig.orders())) and bool(np.abs(data.values).any())
    if not overlap:
        problems.add(
            f"no overlap with the rig: measured are the orders {_listed(data.orders.tolist())}, the rig has "
            f"{_listed(list(rig.orders()))}; nothing can be compared"
        )
    points = len({*zip(data.at.speed_rpm, data.at.torque_Nm, data.at.temperature_C, strict=True)})
    if len(data) < SETTINGS.least_curves or points < SETTINGS.least_points:
        problems.add(
            f"too few conditions for a claim: {points} operating points in {len(data)} curves; at least "
            f"{SETTINGS.least_points} different conditions and {SETTINGS.least_curves} curves are needed"
        )
    if overlap and units:
        with problems.collect():
            check_units(data, rig, path)
    problems.raise_if_any()


def check_units(data: Observations, rig: RigModel, path: Path) -> None:
    """Ask about sizes that look like other units. Raises InputError."""
    model = rig.coefficients(data.at, data.orders.tolist())
    norms = np.abs(model).max(axis=0)
    orders = np.flatnonzero(norms > 0)
    if not len(orders):
        return
    # order by order the measured size over the simulated one; what is right for most of the TE decides
    measured, simulated = (np.median(np.abs(values[:, orders]), axis=0) for values in (data.values, model))
    sizes = np.log(np.maximum(measured, 1e-12) / np.maximum(simulated, 1e-12))
    factor = float(np.exp(_weighted_median(sizes, norms[orders])))
    if choices := unit_choices(factor, rig.constants.reduction_ratio):
        raise InputError(f"{path}: {choices}")


def unit_choices(factor: float, ratio: float) -> str:
    """What to ask about data that are `factor` times as large as a rig: nothing, or which unit they may have."""
    known = {
        1 / _DEGREES: "in rad instead of deg (a factor of 57.3)",
        _DEGREES: "multiplied by 57.3, as if it had been in rad",
        60.0: "in arcmin instead of deg (a factor of 60)",
        3600.0: "in arcsec instead of deg (a factor of 3600)",
        ratio: f"that of the motor side (a factor of {ratio:g})",
        1 / ratio: f"divided by the reduction ratio (a factor of {ratio:g})",
    }
    near = sorted((f for f in known if abs(np.log(f / factor)) < 0.9), key=lambda f: abs(np.log(f / factor)))
    if not near:
        return ""
    choices = "; or ".join(f"{known[f]}: then give --scale {1 / f:.8g}" for f in near)
    return (
        f"the measured TE is {factor:.3g} times the rig's: another unit? Is it {choices}? "
        "If the machine really is that different, give --scale 1"
    )


def _weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def _listed(orders: list[int]) -> str:
    shown = ", ".join(map(str, orders[:12]))
    return shown + (", .." if len(orders) > 12 else "")
