"""How additive contributions reach the measured coefficients, and their derivatives by the coordinates of a fit."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.reconcile.data.observations import Observations
from st_codegen.reconcile.fit.state import Coordinate, Piece
from st_codegen.reconcile.fit.target import Column
from st_codegen.reconcile.settings import SETTINGS
from st_codegen.rig.effects import Effect, Stage
from st_codegen.rig.model import RigModel


class Propagation:
    """How additive contributions reach the measured coefficients: sidebands, structure, measuring chain."""

    def __init__(self, model: RigModel, data: Observations) -> None:
        self.model, self.data = model, data
        self.orders = model.closure(data.model_orders())
        self.places = np.searchsorted(self.orders, data.model_orders())
        at = data.at
        self.base = np.zeros((len(data), len(self.orders)), np.complex128)
        self.base[:, self.orders == 0] = model.zero_offset_deg
        for effect in model.of_stage(Stage.ADDITIVE):
            self.base += effect.contribution(at, self.orders)
        self.before_measuring = self.base.copy()
        for effect in model.of_stage(Stage.MODULATION):
            self.before_measuring += effect.passed_on(at, self.orders, self.base) - self.base
        for effect in model.of_stage(Stage.STRUCTURE):
            self.before_measuring += effect.contribution(at, self.orders)

    def measured(self, change: ComplexArray, stage: Stage) -> ComplexArray:
        """What a change of coefficients (n, all orders) at a stage becomes in the measured ones (n, K)."""
        at = self.data.at
        if stage is Stage.ADDITIVE:
            sidebands = [
                effect.passed_on_change(at, self.orders, change) - change
                for effect in self.model.of_stage(Stage.MODULATION)
                if change[:, self.orders == effect.orders[0]].any()
            ]
            change = change + sum(sidebands) if sidebands else change
        if stage is not Stage.MEASURING and self.model.of_stage(Stage.MEASURING):
            change = change * self._chain
        return self.data.observed(change[:, self.places])

    @cached_property
    def _chain(self) -> ComplexArray:
        """What the measuring chain makes of each coefficient, (n, all orders): it mixes none of them."""
        factor = np.ones_like(self.base)
        for effect in self.model.of_stage(Stage.MEASURING):
            factor = effect.passed_on_change(self.data.at, self.orders, factor)
        return factor

    def change(self, effect: Effect) -> ComplexArray:
        """The part of the coefficients that an effect makes, at its own stage (n, all orders)."""
        at = self.data.at
        if effect.stage is Stage.MODULATION:
            return effect.passed_on(at, self.orders, self.base) - self.base
        if effect.stage is Stage.MEASURING:
            return effect.passed_on(at, self.orders, self.before_measuring) - self.before_measuring
        return effect.contribution(at, self.orders)

    def columns(self, piece: Piece) -> list[Column]:
        """Derivatives of the measured coefficients by the coordinates of a piece."""
        coordinates, vector, stage = piece.coordinates(), piece.vector(), piece.effect.stage
        # what a shape alone makes (a delay turns all orders) is no part of what a linear coordinate adds
        nothing = self.change(piece.unit()) if stage is Stage.MEASURING else 0.0
        # the size of one of several orders shows on that order alone: those of all orders are computed at once
        is_by_order = stage is Stage.STRUCTURE and piece.effect.orders_key == "orders" and self.data.angle_rad is None
        sizes: dict[tuple[str, int], ComplexArray] = {}
        found = []
        for number, c in enumerate(coordinates):
            if is_by_order and c.part:
                size = c.key, c.part
                if size not in sizes:
                    alike = [other for other in coordinates if (other.key, other.part) == size]
                    sizes[size] = self.measured(self.change(piece.unit(*alike)), stage)
                own = self.data.orders == piece.effect.orders[c.place]
                found.append(self._column(sizes[size], own))
                continue
            change = self.change(piece.unit(c)) - nothing if c.linear else self._slope(piece, vector, number, c)
            found.append(self._column(self.measured(change, stage)))
        return found

    def cached_columns(self, piece: Piece, cache: dict[object, tuple[Column, ...]]) -> tuple[Column, ...]:
        """The columns of a piece, taken from `cache` where they depend on nothing that a fit changes."""
        effect = piece.effect
        if effect.stage not in (Stage.ADDITIVE, Stage.STRUCTURE) or not all(c.linear for c in piece.coordinates()):
            return tuple(self.columns(piece))
        later = [e for stage in (Stage.MODULATION, Stage.MEASURING) for e in self.model.of_stage(stage)]
        tables = tuple((e.name, *sorted(e.values.items())) for e in later)
        fixed = tuple(sorted((key, value) for key, value in effect.values.items() if key not in piece.free))
        key = (effect.name, effect.orders, piece.free, fixed, tables)
        if key not in cache:
            if len(cache) > SETTINGS.most_cached:
                cache.clear()
            cache[key] = tuple(self.columns(piece))
        return cache[key]

    def offset_column(self) -> Column:
        """Derivative by the rig's constant offset."""
        change = np.zeros_like(self.base)
        change[:, self.orders == 0] = 1.0
        return self._column(self.measured(change, Stage.ADDITIVE))

    def _slope(self, piece: Piece, vector: FloatArray, number: int, c: Coordinate) -> ComplexArray:
        step = 1e-4 * max(abs(vector[number]), 1e-3 * c.scale)
        up, down = vector.copy(), vector.copy()
        up[number], down[number] = min(up[number] + step, c.upper), max(down[number] - step, c.lower)
        changes = [self.change(piece.with_vector(v).effect) for v in (up, down)]
        return np.asarray((changes[0] - changes[1]) / (up[number] - down[number]))

    @staticmethod
    def _column(values: ComplexArray, own: BoolArray | bool = True) -> Column:
        touched = np.flatnonzero((np.abs(values).max(axis=0, initial=0.0) > 0) & own)
        return touched, np.ascontiguousarray(values[:, touched])
