"""What is fitted: data, their noise, which runs count, and how they are grouped for held-out fits and errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from st_codegen.processes import can_be_copied
from st_codegen.reconcile.data.contrasts import equal_parts, speed_levels
from st_codegen.reconcile.data.noise import sigma_of
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Conditions
from st_codegen.rig.model import RigModel

#: columns of one coordinate: the places of the orders that it touches, and d(model)/d(coordinate) there (n, places)
Column = tuple[IntArray, ComplexArray]


def by_place(columns: Sequence[Column]) -> dict[int, tuple[IntArray, ComplexArray]]:
    """For each order that columns touch: their numbers (p,), and their values (n, p) there."""
    found: dict[int, list[tuple[int, ComplexArray]]] = {}
    for number, (places, values) in enumerate(columns):
        for j, place in enumerate(places):
            found.setdefault(int(place), []).append((number, values[:, j]))
    return {
        place: (np.array([number for number, _ in own]), np.stack([values for _, values in own], axis=1))
        for place, own in found.items()
    }


@dataclass(frozen=True)
class Groups:
    """Rows in cells of about the same conditions, and cells in larger groups.

    cells: int (n,), cell of a row; clusters: int (cells,), cluster of a cell: runs within one may have noise in common;
    folds: for `speed`, `torque`, `temperature` the fold (held-out block) of a cell.
    """

    cells: IntArray
    clusters: IntArray
    folds: Mapping[str, IntArray]


def groups_of(at: Conditions) -> Groups:
    """Cells of speed level, torque fold and temperature; whole levels make a fold, five folds of torques at most."""
    speed = speed_levels(at.speed_rpm)
    torque, temperature = _folds(at.torque_Nm, 5), _folds(at.temperature_C, 4)
    code = (speed * 8 + torque) * 8 + temperature
    kinds, cells = np.unique(code, return_inverse=True)
    of_speed, of_torque, of_temperature = kinds // 64, kinds // 8 % 8, kinds % 8
    clusters = np.unique(of_speed * 8 + of_temperature, return_inverse=True)[1]
    folds = {"speed": of_speed % 12, "torque": of_torque, "temperature": of_temperature}
    return Groups(cells.astype(np.int64), clusters.astype(np.int64), folds)


def _folds(values: FloatArray, count: int) -> IntArray:
    """Folds of whole levels, dealt in turn; values that hardly repeat are cut into blocks."""
    levels, index = np.unique(values, return_inverse=True)
    if len(levels) > max(25, len(values) // 4):
        return equal_parts(values, count)
    return (index % count).astype(np.int64)


@dataclass(frozen=True)
class FitData:
    """What is fitted: data, their noise sigma (n, K), the rows that count (n,), and how the rows are grouped.

    wide: (n, K), how far coefficients scatter about the model, never less than the noise: the fit weighs by it, since
    a model whose form is not quite right must not be bent by the last digit of a clean order. run_offset_deg: how far
    the mean differs from run to run, as the rig says; scatter_deg: (K,), how far one component of each order does by
    what a fit of few runs left of it (`few_runs.with_scatter`), 0 where that says nothing.
    corrected: names of mistakes that were taken out.
    """

    data: Observations
    sigma: FloatArray
    good: BoolArray
    groups: Groups
    reduction_ratio: float = 81.0
    reference_temperature_C: float = 30.0
    run_offset_deg: float = 0.0
    scatter_deg: FloatArray | None = None
    wide: FloatArray | None = None
    corrected: frozenset[str] = frozenset()
    cache: dict[object, tuple[Column, ...]] = field(default_factory=dict, compare=False)
    responses: dict[object, ComplexArray] = field(default_factory=dict, compare=False)

    @property
    def at_once(self) -> int:
        """How many fits may be computed at a time, each in a copy of this process: one where data are small.

        Each takes about six arrays of the size of the data, as measured at 4,000 rows of 300 orders.
        """
        is_large = self.data.values.size >= SETTINGS.large and can_be_copied()
        return max(SETTINGS.most_shared_bytes // (6 * self.data.values.nbytes), 1) if is_large else 1

    @property
    def spread(self) -> FloatArray:
        """What residuals are weighed by, float64 (n, K): `wide` where it is known, else the noise."""
        return self.sigma if self.wide is None else self.wide

    @property
    def sure_sigma(self) -> FloatArray:
        """What is noise for sure, float64 (n, K): where curves tell it that within them, else the noise itself.

        Of few runs what is known that they differ by is noise as well: they tell it by nothing else.
        """
        if self.data.spectral_deg is None:
            return self.sigma
        within = np.clip(self.data.spectral_deg, SETTINGS.least_noise_deg, self.sigma)
        return np.maximum(within, self.between_runs) if self.data.few_points else within

    @property
    def between_runs(self) -> FloatArray:
        """How far one component of each order differs from run to run, deg, float64 (K,), as far as that is known."""
        told = np.where(self.data.orders == 0, self.run_offset_deg, 0.0)
        return told if self.scatter_deg is None else np.maximum(told, self.scatter_deg)

    @property
    def counts(self) -> BoolArray:
        """Which coefficients count, bool (n, K): those of good rows that were measured."""
        good = np.broadcast_to(self.good[:, None], self.data.values.shape)
        return good if self.data.seen is None else good & self.data.seen

    def about(self, residual: ComplexArray) -> FitData:
        """This target, weighed by how far its good rows scatter in `residual`, by direction and order."""
        wide = self.sigma.copy()
        for rows in self.data.at.by_direction():
            if (rows & self.good).any():
                wide[rows] = np.maximum(wide[rows], sigma_of(residual[rows & self.good], self.data.orders))
        return replace(self, wide=wide)

    def as_quiet_as_others(self) -> FitData:
        """This target, of whose orders none has more noise than orders usually have, where operating points are few.

        Of a dozen runs none lies next to another: what a peak makes of an order passes for noise there, so that
        nothing would be tried. How far the runs scatter about what is tried still counts.
        """
        waves = self.data.orders > 0
        if not self.data.few_points or waves.sum() < SETTINGS.least_orders_beside:
            return self
        usual = np.median(self.sigma[:, waves], axis=1)[:, None]
        return replace(self, sigma=np.where(waves, np.minimum(self.sigma, usual), self.sigma))

    def subset(self, rows: BoolArray) -> FitData:
        """This target, of which only good rows inside `rows` count."""
        return replace(self, good=self.good & rows)

    def residual(self, model: RigModel, rows: BoolArray | None = None) -> ComplexArray:
        """measured - model, complex128 (n, K), deg; of the chosen rows alone where `rows` is given."""
        data = self.data if rows is None else self.data.rows(rows)
        found = data.values - data.observed(model.coefficients(data.at, data.model_orders()))
        return found if data.seen is None else found * data.seen

    def losses(self, residual: ComplexArray, rows: BoolArray | None = None) -> FloatArray:
        """Twice Huber's loss of each row (of the chosen rows) and order, float64 (n, K): small ones like chi-square."""
        chosen = slice(None) if rows is None else rows
        z = np.abs(self.data.with_real_mean(residual)) / self.spread[chosen]
        z = z * self.counts[chosen]
        return np.where(z <= SETTINGS.huber, z**2, 2 * SETTINGS.huber * z - SETTINGS.huber**2)

    def weights(self, residual: ComplexArray) -> FloatArray:
        """Weights of least squares that equal Huber's loss at these residuals, by row and order, in 1/deg^2."""
        z = np.abs(self.data.with_real_mean(residual)) / self.spread
        return self.counts * np.minimum(1.0, SETTINGS.huber / np.maximum(z, SETTINGS.huber)) / self.spread**2
