"""An order spectrum (sizes of orders over a whole campaign) against a rig: which orders it lacks, named by kinematics.

A spectrum has neither phases nor operating points, so nothing is fitted and the rig stays as it is. An order gets a
name where the machine has a part that turns or meshes with it. Any order may do so by chance: names are given from
the loudest order down, as long as no more than a tenth of those of one effect are expected to be coincidences.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import fdtri, gammainccinv, gammaincinv

from st_codegen.errors import InputError, Problems, at_most
from st_codegen.files.csv_tables import RowError, header_of, read_csv
from st_codegen.ir.arrays import FloatArray
from st_codegen.reconcile.data.checks import check_units
from st_codegen.reconcile.data.observations import Observations, labels
from st_codegen.reconcile.outcome import Outcome
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions, Constants
from st_codegen.rig.model import RigModel

COLUMNS = ("direction", "order", "median_deg")
_DIRECTIONS = {"fw": 1.0, "forward": 1.0, "bw": -1.0, "backward": -1.0}
_WORDS = {1.0: "forward", -1.0: "backward"}


@dataclass(frozen=True)
class Spectrum:
    """Median amplitude (deg) by direction (+1, -1) and order, over the runs of a campaign."""

    path: Path
    size: Mapping[tuple[float, int], float]

    @property
    def orders(self) -> list[int]:
        """All orders, rising."""
        return sorted({order for _, order in self.size})

    @property
    def signs(self) -> list[float]:
        """Directions that are there."""
        return sorted({sign for sign, _ in self.size}, reverse=True)

    def of(self, order: int) -> dict[float, float]:
        """Sizes of one order by direction."""
        return {sign: self.size[sign, order] for sign in self.signs if (sign, order) in self.size}

    def above_zero(self, sign: float) -> dict[int, float]:
        """Sizes of one direction by order, without the mean; one of 0 is rounded: half of the least at most."""
        own = {order: self.size[sign, order] for order in self.orders if order > 0 and (sign, order) in self.size}
        least = min((size for size in own.values() if size > 0), default=0.0)
        return {order: size or least / 2.0 for order, size in own.items()}


@dataclass(frozen=True)
class Named:
    """An order that the rig lacks: the effect, the order of its table, the key of its size; other effects that fit.

    chance: share of the names of this effect, down to this order's loudness, that is expected by coincidence.
    """

    order: int
    name: str
    table: int | None
    key: str
    value: float
    unit: str
    others: tuple[str, ...] = ()
    chance: float = 0.0


@dataclass(frozen=True)
class SpectrumResult:
    """What a spectrum says about a rig.

    floor: root mean square amplitude of noise by direction, deg; least: the size from which on an order is no noise;
    gap: RMS in deg of a curve made of the median sizes.
    """

    rig: RigModel
    spectrum: Spectrum
    floor: Mapping[float, float]
    least: Mapping[float, float]
    simulated: Mapping[tuple[float, int], float]
    named: tuple[Named, ...]
    unexplained: tuple[int, ...]
    gap: tuple[float, float, float]

    @property
    def verdict(self) -> Outcome:
        """Whether what differs is named, and whether more than noise is left."""
        return Outcome.of(named=bool(self.named), is_more_left=bool(self.unexplained))


def is_spectrum(path: Path) -> bool:
    """Whether a file is an order spectrum, by its header."""
    return path.is_file() and {"order", "median_deg"} <= set(header_of(path))


def read_spectrum(path: Path) -> Spectrum:
    """Read `direction,order,median_deg,..`. Raises one InputError that lists every problem."""
    table, problems = read_csv(path, COLUMNS), Problems(str(path))
    size: dict[tuple[float, int], float] = {}
    for row in table.rows:
        with problems.collect():
            direction = table.text(row, "direction")
            sign = _DIRECTIONS.get(direction.lower())
            if sign is None:
                raise RowError(row.line, f"'{direction}' is no direction; there are {', '.join(_DIRECTIONS)}")
            order, median = table.number(row, "order"), table.number(row, "median_deg")
            if order < 0 or order != int(order):
                raise RowError(row.line, f"order: {order:g} is no whole number from 0 on")
            if median < 0:
                raise RowError(row.line, f"median_deg: {median:g} is no size")
            if (sign, int(order)) in size:
                raise RowError(row.line, f"order {order:g} stands there twice for this direction")
            size[sign, int(order)] = median
    problems.raise_if_any()
    spectrum = Spectrum(path, size)
    least = SETTINGS.spectrum_orders
    for sign in spectrum.signs or [1.0]:
        own = spectrum.above_zero(sign)
        if len(own) < least or not any(own.values()):
            few = f"too few orders above 0 for a floor ({len(own)})"
            what = few if len(own) < least else "sizes that are all 0 are too small for a floor"
            problems.add(f"{_WORDS[sign]}: {what}; list all that were measured, at least {least}")
    problems.raise_if_any()
    return spectrum


def reconcile_spectrum(rig: RigModel, spectrum: Spectrum, scale: float | None = None) -> SpectrumResult:
    """Which orders the rig lacks. Raises InputError for sizes in other units, and no order in common."""
    if scale is not None:
        spectrum = replace(spectrum, size={key: value * scale for key, value in spectrum.size.items()})
    simulated = _simulated(rig, spectrum)
    if not any(value > 0 for value in simulated.values()):
        raise InputError(f"{spectrum.path}: no overlap with the rig: it has none of these orders")
    if scale is None:
        _check_units(rig, spectrum)
    noise = {sign: _noise(spectrum, sign) for sign in spectrum.signs}
    floor, least = ({sign: own[n] for sign, own in noise.items()} for n in range(2))
    lacking = [
        order
        for order in spectrum.orders
        if order > 0
        and all(simulated[sign, order] == 0.0 and size >= least[sign] for sign, size in spectrum.of(order).items())
    ]
    named = _names(lacking, rig, spectrum, least)
    left = tuple(sorted(set(lacking) - {one.order for one in named}))
    before, after, quiet = (_rms(spectrum, orders, floor) for orders in (lacking, left, []))
    return SpectrumResult(rig, spectrum, floor, least, simulated, named, left, (before, after, quiet))


def _grid(spectrum: Spectrum) -> Conditions:
    """The operating points over which a campaign's median is taken."""
    axes = np.array(list(itertools.product(range(100, 1801, 100), range(0, 1801, 100), (25, 30, 35))), np.float64)
    signs = np.repeat(spectrum.signs, len(axes))
    return Conditions.of(signs, *np.tile(axes, (len(spectrum.signs), 1)).T)


def _simulated(rig: RigModel, spectrum: Spectrum) -> dict[tuple[float, int], float]:
    """Median sizes of the rig over the paper's grid."""
    at, orders = _grid(spectrum), spectrum.orders
    size = np.abs(rig.coefficients(at, orders))
    return {
        (sign, order): float(np.median(size[at.sign == sign, place]))
        for sign in spectrum.signs
        for place, order in enumerate(orders)
    }


def _check_units(rig: RigModel, spectrum: Spectrum) -> None:
    orders = [order for order in spectrum.orders if order > 0]
    at = Conditions.of(spectrum.signs, 900.0, 900.0, rig.constants.reference_temperature_C)
    values = np.array([[spectrum.size.get((sign, order), 0.0) for order in orders] for sign in spectrum.signs])
    check_units(Observations(at, labels(at), np.array(orders), values.astype(np.complex128)), rig, spectrum.path)


def _noise(spectrum: Spectrum, sign: float) -> tuple[float, float]:
    """The root mean square amplitude of noise, and the size that none of as many orders reaches in noise, both deg.

    Sizes of noise in one run have a Rayleigh distribution, their powers a Gamma distribution of shape 1; the more runs
    a median is of, the less they scatter. The level is that of the quiet orders: noise stands in all of them.
    """
    sizes = np.sort(list(spectrum.above_zero(sign).values()))
    shape, share, count = _shape(spectrum), SETTINGS.spectrum_quiet, len(sizes)
    # by two standard errors of a quantile more, since few orders tell it
    level, most = np.quantile(sizes, (share, share + 2.0 * math.sqrt(share * (1.0 - share) / count)))
    unit = math.sqrt(gammaincinv(shape, share))
    # an order is there when all directions that list it show it: c of one and c^2 of two
    orders = [order for order in spectrum.orders if order > 0]
    shared = sum(len(spectrum.of(order)) > 1 for order in orders)
    alone = len(orders) - shared
    wanted = SETTINGS.spectrum_chance
    chance = 2.0 * wanted / (alone + math.sqrt(alone**2 + 4.0 * shared * wanted))
    least = most / unit * math.sqrt(gammainccinv(shape, chance))
    quietest = float(np.median(sizes[: max(3, int(share * count))]))
    return float(level / unit * math.sqrt(shape)), max(SETTINGS.spectrum_clear * quietest, float(least))


def _shape(spectrum: Spectrum) -> float:
    """The shape of the Gamma distribution of powers of noise, by how far quiet orders differ that should be alike.

    These are both directions of an order, or, where few are listed for both, orders one after the other; a floor that
    is another from order to order makes them differ more. Sizes that are rounded to 0 hide how far they differ: then it
    is as far as in one run.
    """
    if any(order > 0 and not size for (_, order), size in spectrum.size.items()):
        return 1.0
    each = [spectrum.above_zero(sign) for sign in spectrum.signs]
    alike = [[own[order] for own in each] for order in spectrum.orders if all(order in own for own in each)]
    if len(each) == 1 or len(alike) < SETTINGS.spectrum_orders:
        alike = [[*pair] for own in each for pair in itertools.pairwise(own.values())]
    both = np.log(alike)
    quiet = both[np.argsort(both.sum(axis=1), kind="stable")[: max(3, len(both) // 2)]]
    apart = quiet[:, 0] - quiet[:, 1]
    apart = np.abs(apart - np.median(apart))
    shapes = np.geomspace(1.0, 1e4, 200)
    # the ratio of two such powers has an F distribution
    usual = np.log(fdtri(2 * shapes, 2 * shapes, 0.75)) / 2.0
    return float(np.interp(-np.median(apart), -usual, shapes))


def _loudness(order: int, spectrum: Spectrum) -> float:
    return max(spectrum.of(order).values(), default=0.0)


def _carriers(order: int, constants: Constants, spectrum: Spectrum, least: Mapping[float, float]) -> list[int]:
    """Mesh orders that are there and of which an order is a sideband, the loudest first."""
    near = [order - constants.cranks, order + constants.cranks]
    there = [
        carrier
        for carrier in near
        if carrier in constants.mesh_orders()
        and any(size >= least[sign] for sign, size in spectrum.of(carrier).items())
        and _loudness(order, spectrum) <= SETTINGS.largest_ratio * _loudness(carrier, spectrum)
    ]
    return sorted(there, key=lambda carrier: -_loudness(carrier, spectrum))


def _direct(order: int, constants: Constants) -> list[str]:
    """Effects whose own order this is."""
    known = {
        "output_shaft_eccentricity": (1,),
        "encoder_eccentricity": (1,),
        "output_shaft_ovality": (2,),
        "crank_misalignment": (constants.cranks,),
        "cycloid_tooth_error": constants.tooth_orders(),
        "pin_error": constants.pin_orders(),
        "input_shaft_misalignment": constants.shaft_orders(),
    }
    return [name for name, orders in known.items() if order in orders]


def _name(order: int, constants: Constants, spectrum: Spectrum, least: Mapping[float, float]) -> Named | None:
    direct, carriers = _direct(order, constants), _carriers(order, constants, spectrum, least)
    size = _loudness(order, spectrum)
    if direct:
        table = order if direct[0] in ("cycloid_tooth_error", "pin_error", "input_shaft_misalignment") else None
        key = "amplitude_deg" if table is None else f"amplitude_deg[{order}]"
        others = (*direct[1:], *(["carrier_modulation"] if carriers else []))
        return Named(order, direct[0], table, key, size, "deg", others)
    if carriers:
        first = carriers[0]
        side = "lower_ratio" if order < first else "upper_ratio"
        others = tuple(f"carrier_modulation of order {other}" for other in carriers[1:])
        ratio = size / _loudness(first, spectrum)
        return Named(order, "carrier_modulation", first, f"{side}[{first}]", ratio, "", others)
    return None


def _names(
    lacking: Sequence[int], rig: RigModel, spectrum: Spectrum, least: Mapping[float, float]
) -> tuple[Named, ...]:
    """Names for the lacking orders, each effect's from the loudest order down to where coincidences become likely."""
    have = set(rig.orders())
    places = [_name(k, rig.constants, spectrum, least) for k in range(1, max(spectrum.orders) + 1) if k not in have]
    ranked = sorted(lacking, key=lambda order: -_loudness(order, spectrum))
    found = [(rank, _name(order, rig.constants, spectrum, least)) for rank, order in enumerate(ranked, 1)]
    kept: list[Named] = []
    for name in sorted({one.name for _, one in found if one is not None}):
        share = sum(one is not None and one.name == name for one in places) / len(places)
        own = [(rank, one) for rank, one in found if one is not None and one.name == name]
        chances = [share * rank / hits for hits, (rank, _) in enumerate(own, 1)]
        last = max((place for place, chance in enumerate(chances) if chance <= SETTINGS.coincidence), default=-1)
        kept += [replace(one, chance=chance) for (_, one), chance in zip(own[: last + 1], chances, strict=False)]
    return tuple(sorted(kept, key=lambda one: one.order))


def _rms(spectrum: Spectrum, orders: Sequence[int], floor: Mapping[float, float]) -> float:
    """RMS in deg of what these orders make, and of the floor of all listed ones, both directions."""
    powers = []
    for sign in spectrum.signs:
        noise = floor[sign] ** 2 / 2 * len(spectrum.orders)
        powers.append(noise + sum(spectrum.size.get((sign, order), 0.0) ** 2 / 2 for order in orders))
    return float(np.sqrt(np.mean(powers)))


# --- what is written ---


def spectrum_report(result: SpectrumResult) -> dict[str, Any]:
    """The content of report.json: the keys of docs/reconcile.md that a spectrum can fill."""
    gap = dict(zip(("before", "after", "noise_floor"), result.gap, strict=True))
    effects = []
    for name in sorted({one.name for one in result.named}):
        ones = [one for one in result.named if one.name == name]
        effects.append(
            {
                "name": name,
                "orders": sorted({one.order if one.table is None else one.table for one in ones}),
                "touched_orders": [one.order for one in ones],
                "parameters": {one.key: {"value": one.value, "stderr": None, "unit": one.unit} for one in ones},
                "evidence": {
                    "expected_coincidences": {str(one.order): round(one.chance, 4) for one in ones},
                    "size_over_floor": {str(one.order): _over_floor(one.order, result) for one in ones},
                },
                "alternatives": sorted({other for one in ones for other in one.others}),
                "remarks": ["named by its order alone: a spectrum has neither phases nor operating points"],
            }
        )
    return {
        "verdict": result.verdict,
        "effects": effects,
        "unexplained": [
            {
                "order": order,
                "dependence": {},
                "direction": "both" if len(result.spectrum.of(order)) == len(result.spectrum.signs) else "one",
                "size": _loudness(order, result.spectrum) / math.sqrt(2),
                "text": _signature(order, result),
            }
            for order in sorted(result.unexplained, key=lambda order: -_loudness(order, result.spectrum))
        ],
        # nothing is fitted, so nothing can be held out
        "gap": {"fitted": gap, "held_out": gap | {"after": None}},
        "suspect_runs": [],
        "orders": result.spectrum.orders,
    }


def _over_floor(order: int, result: SpectrumResult) -> float:
    return max(size / result.floor[sign] for sign, size in result.spectrum.of(order).items())


def _signature(order: int, result: SpectrumResult) -> str:
    """An unnamed order by its distance from the nearest mesh orders."""
    near = sorted((abs(order - mesh), mesh) for mesh in result.rig.constants.mesh_orders())[:2]
    beside = " and ".join(
        f"{mesh} {'+' if order > mesh else '-'} {distance}" if distance else f"order {mesh} of the mesh"
        for distance, mesh in near
        if distance <= SETTINGS.near_orders
    )
    size, times = _loudness(order, result.spectrum), _over_floor(order, result)
    place = f"it is {beside}" if beside else "far from the mesh"
    return f"order {order}: median {size:.2g} deg, {times:.1f} times the floor; {place}"


def spectrum_summary(result: SpectrumResult) -> str:
    """The findings as a few lines."""
    sizes = " and ".join(f"{at_most(least)} deg {_WORDS[sign]}" for sign, least in result.least.items())
    lines = [
        f"Orders that the rig lacks and that are larger than {sizes}, which noise like that of the quiet orders "
        f"reaches in at most one of {1 / SETTINGS.spectrum_chance:g} spectra:"
        + " none"
        * (not (result.named or result.unexplained))
    ]
    for one in sorted(result.named, key=lambda one: (one.name, one.order)):
        also = f" (or {', '.join(one.others)})" if one.others else ""
        of = f" of order {one.table}" if one.name == "carrier_modulation" else ""
        lines.append(f"- order {one.order}, {_loudness(one.order, result.spectrum):.2g} deg: {one.name}{of}{also}")
    lines += [f"- unexplained: {_signature(order, result)}" for order in result.unexplained]
    before, after, floor = result.gap
    lines.append(f"RMS of the median curve: lacking {before:.3g}, not named {after:.3g}, floor {floor:.3g} deg")
    lines.append("A spectrum has no phases: the rig stays as it is. Measure a harmonic table to have them fitted.")
    return "\n".join(lines)


def sizes(result: SpectrumResult) -> list[tuple[int, FloatArray]]:
    """Order and (measured, simulated, floor) of the loudest direction, for tables and pictures."""
    found = []
    for order in result.spectrum.orders:
        by_sign = result.spectrum.of(order)
        sign = max(by_sign, key=lambda own: by_sign[own])
        found.append((order, np.array([by_sign[sign], result.simulated[sign, order], result.floor[sign]])))
    return found
