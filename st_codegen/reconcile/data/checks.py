"""What is refused before anything is compared: dead channels, too few conditions, sizes that look like other units."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from st_codegen.campaign.conditions import Conditions, temperatures_of_no_oil
from st_codegen.campaign.orders import listed
from st_codegen.errors import InputError, Problems, counted
from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.model import RigModel

_DEGREES = 57.29577951308232


def check_channels(data: Observations, path: Path) -> None:
    """Refuse data of which nothing can be asked: a direction that is 0 throughout, curves that tell no order above the
    mean. Raises InputError.
    """
    if data.spectral_deg is not None and not data.orders.any():
        raise InputError(
            f"{path}: the curves have too few samples a turn to tell any order above the mean: is the angle that of "
            "the fast shaft, over many turns? It must be the output's, in deg"
        )
    for sign, name in ((1.0, "forward"), (-1.0, "backward")):
        own = data.at.sign == sign
        if own.any() and np.abs(data.values).any() and not np.abs(data.values[own]).any():
            raise InputError(f"{path}: the {name} TE is 0 in all runs: a dead channel? Leave that column out")


def check_turns(turns: FloatArray, ratio: float, path: Path) -> None:
    """Refuse curves over as many turns as the fast shaft makes in one of the output. Raises InputError.

    turns: how many each curve holds, (n,). Of a gear of few turns the output may well have made so many itself.
    """
    if ratio >= SETTINGS.fast_shaft and abs(float(np.median(turns)) / ratio - 1.0) < SETTINGS.near_the_ratio:
        raise InputError(
            f"{path}: the angle of most curves covers {float(np.median(turns)):.4g} turns, as many as the fast shaft "
            f"makes in one turn of the output: it looks like the fast shaft's and must be the output's, so divide it "
            f"by {ratio:g}. If the output did turn so often, cut the curves to fewer turns"
        )


def check(data: Observations, rig: RigModel, path: Path) -> None:
    """Refuse data that cannot be compared with the rig, whatever their unit.

    Raises one InputError with all of it: no order in common, too few conditions, values that are not finite.
    """
    problems = Problems(str(path))
    if not np.isfinite(data.values).all():
        rows = np.flatnonzero(~np.isfinite(data.values).all(axis=1))
        problems.add(
            f"{counted(len(rows), 'curve')} with values that are not finite, the first is {data.labels[rows[0]]}"
        )
    check_speeds(data.at, data.labels, problems)
    wrong = np.flatnonzero(temperatures_of_no_oil(data.at.temperature_C))
    if len(wrong):
        problems.add(
            f"{counted(len(wrong), 'curve')} with a temperature that no oil has, the first is {data.labels[wrong[0]]} "
            f"with {data.at.temperature_C[wrong[0]]:g} degC: an error code? Correct it or leave these curves out"
        )
    if not np.abs(data.values).any():
        problems.add("TE is 0 in all curves: a dead channel? There is nothing to compare with the rig")
    elif not set(data.orders.tolist()) & set(rig.orders()):
        problems.add(
            f"no overlap with the rig: measured are the orders {listed(data.orders.tolist())}, the rig has "
            f"{listed(list(rig.orders()))}; nothing can be compared"
        )
    points = data.at.count_of_points
    if len(data) < SETTINGS.least_curves or points < SETTINGS.least_points:
        problems.add(
            f"too few conditions for a claim: {counted(points, 'operating point')} in {counted(len(data), 'curve')}; "
            f"at least {SETTINGS.least_points} different conditions and {SETTINGS.least_curves} curves are needed"
        )
    problems.raise_if_any()


def check_speeds(at: Conditions, names: Sequence[str], problems: Problems) -> None:
    """Add to problems the curves in which nothing turns: their conditions, or how speeds are given, are wrong."""
    rows = np.flatnonzero(at.speed_rpm <= 0.0)
    if len(rows):
        problems.add(
            f"{counted(len(rows), 'curve')} with a speed of 0 rpm or less, the first is {names[rows[0]]} with "
            f"{at.speed_rpm[rows[0]]:g} rpm: speeds are above 0, and the direction has a column of its own"
        )


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
    factor = float(np.exp(np.quantile(sizes, 0.5, method="inverted_cdf", weights=norms[orders])))
    if choices := unit_choices(factor, rig.constants.reduction_ratio):
        raise InputError(f"{path}: {choices}")


def unit_choices(factor: float, ratio: float, *, agreed: bool = False) -> str:
    """What to ask about data that are `factor` times as large as a rig: nothing, or which unit they may have.

    agreed: nearly all orders have this very factor, so that the unit does too, or is none that is known here.
    """
    known = {
        1 / _DEGREES: "in rad instead of deg (a factor of 57.3)",
        _DEGREES: "multiplied by 57.3, as if it had been in rad",
        1000.0 / _DEGREES: "in mrad instead of deg (a factor of 17.5)",
        1000.0: "in mdeg instead of deg (a factor of 1000)",
        1e6 / _DEGREES: "in urad instead of deg (a factor of 1.75e+04)",
        60.0: "in arcmin instead of deg (a factor of 60)",
        3600.0: "in arcsec instead of deg (a factor of 3600)",
        ratio: f"that of the motor side (a factor of {ratio:g})",
        1 / ratio: f"divided by the reduction ratio (a factor of {ratio:g})",
    }
    reach = np.log(SETTINGS.column_factor) if agreed else SETTINGS.near_a_unit
    near = sorted((f for f in known if abs(np.log(f / factor)) < reach), key=lambda f: abs(np.log(f / factor)))
    if not near and agreed:
        return (
            f"the measured TE is {factor:.3g} times the rig's in nearly all orders alike: another unit, or another "
            f"gain? Then give --scale {1 / factor:.6g}. If all parts of the machine really are of another size, give "
            "--scale 1"
        )
    if not near:
        return ""
    choices = "; or ".join(f"{known[f]}: then give --scale {1 / f:.8g}" for f in near)
    return (
        f"the measured TE is {factor:.3g} times the rig's: another unit? Is it {choices}? "
        "If the machine really is that different, or the rig file is that of another one, give --scale 1"
    )
