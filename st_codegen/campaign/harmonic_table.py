"""Harmonic tables: the transmission error (TE) of a reducer by operating point, direction and order.

A row is the curve TE(theta) = Re(sum over k of c_k * exp(i*k*theta)) in deg, theta the angle of the output shaft in
rad. As a file, one CSV with `direction,speed_rpm,torque_Nm,temperature_C,A0,A1,..,phi1,..`: A_k in deg and phi_k in
rad of c_k = A_k*exp(i*phi_k); A0 is the mean, with its sign and without a phase.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from st_codegen.campaign.conditions import CONDITION_COLUMNS, Conditions
from st_codegen.errors import InputError, Problems, counted
from st_codegen.files.csv_tables import RowError, read_csv
from st_codegen.files.text import whole_file
from st_codegen.ir.arrays import BoolArray, ComplexArray, FloatArray
from st_codegen.te.harmonics import Direction

#: column -> what it says; read over, since the signs are already in A0
_REMARKS = {"A0_sign": "whether the sign of A0 was measured or inferred"}
_DIRECTIONS = {
    "forward": False,
    "fw": False,
    "backward": True,
    "bw": True,
}
_HARMONIC = re.compile(r"(A|phi)(0|[1-9][0-9]{0,5})")


@dataclass(frozen=True)
class HarmonicTable:
    """Complex coefficients by operating point. All arrays are read-only and have one entry a row.

    backward: bool (n,); speed_rpm, torque_Nm, temperature_C: float64 (n,); coefficients: complex128 (n, orders), deg,
    column j belongs to orders[j]. Orders rise. The coefficient of order 0 is real: the mean, with its sign.
    Raises InputError where shapes differ, a number is not finite, or the mean is not real.
    """

    backward: BoolArray
    speed_rpm: FloatArray
    torque_Nm: FloatArray
    temperature_C: FloatArray
    orders: tuple[int, ...]
    coefficients: ComplexArray

    def __post_init__(self) -> None:
        problems = Problems("harmonic table")
        kinds: dict[str, Any] = {"backward": np.bool_, "coefficients": np.complex128}
        kinds |= dict.fromkeys(CONDITION_COLUMNS, np.float64)
        for name, kind in kinds.items():
            array = np.array(getattr(self, name), dtype=kind)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
            wanted = (len(self.speed_rpm), len(self.orders)) if name == "coefficients" else (len(self.speed_rpm),)
            if array.shape != wanted:
                problems.add(f"{name} has the shape {array.shape}, not {wanted}")
            elif not np.isfinite(array).all():
                problems.add(f"{name} has values that are not finite")
        if list(self.orders) != sorted(set(self.orders)) or any(order < 0 for order in self.orders):
            problems.add(f"orders {self.orders} do not rise from 0")
        problems.raise_if_any()
        if 0 in self.orders and self.coefficients[:, self.orders.index(0)].imag.any():
            raise InputError("harmonic table: the mean (order 0) has an imaginary part")

    def __len__(self) -> int:
        return len(self.speed_rpm)

    @property
    def at(self) -> Conditions:
        """The directions and operating points of the rows."""
        return Conditions.of(np.where(self.backward, -1.0, 1.0), self.speed_rpm, self.torque_Nm, self.temperature_C)

    @property
    def conditions(self) -> FloatArray:
        """Speed (rpm), torque (N m) and temperature (degC), float64 (n, 3)."""
        return self.at.points

    def column(self, order: int) -> ComplexArray:
        """The coefficients of one order, complex128 (n,), deg. Raises InputError for an order that is not there."""
        if order not in self.orders:
            raise InputError(
                f"order {order} is not in the harmonic table, which has {', '.join(map(str, self.orders))}"
            )
        return self.coefficients[:, self.orders.index(order)]

    def rows(self, choice: npt.ArrayLike) -> HarmonicTable:
        """The rows that a mask or an index array chooses, in its order."""
        rows = np.asarray(choice)
        return HarmonicTable(
            self.backward[rows],
            self.speed_rpm[rows],
            self.torque_Nm[rows],
            self.temperature_C[rows],
            self.orders,
            self.coefficients[rows],
        )

    def direction(self, direction: Direction) -> HarmonicTable:
        """The rows of a table that were measured in one direction."""
        return self.rows(self.backward == (direction is Direction.BACKWARD))

    def directions(self) -> list[Direction]:
        """The directions of which there are rows."""
        return [direction for direction in Direction if len(self.direction(direction))]

    def only(self, orders: Sequence[int]) -> HarmonicTable:
        """The rows with these orders alone. Raises InputError for an order that is not there."""
        chosen = tuple(sorted(set(orders)))
        columns = [self.column(order) for order in chosen]
        coefficients = np.stack(columns, axis=1) if columns else np.empty((len(self), 0), np.complex128)
        return HarmonicTable(self.backward, self.speed_rpm, self.torque_Nm, self.temperature_C, chosen, coefficients)

    def curves(self, theta_rad: FloatArray) -> FloatArray:
        """TE in deg of every row at the output angles `theta_rad` (m,) in rad, float64 (n, m)."""
        waves = np.exp(1j * np.outer(self.orders, theta_rad))
        te: FloatArray = (self.coefficients @ waves).real
        return te


def joined(tables: Sequence[HarmonicTable]) -> HarmonicTable:
    """The rows of several tables of the same orders, one after the other. Raises InputError where orders differ."""
    orders = {table.orders for table in tables}
    if len(orders) != 1:
        raise InputError(f"harmonic tables of different orders: {sorted(orders)}")

    def all_of(name: str) -> Any:
        return np.concatenate([getattr(table, name) for table in tables])

    speed, torque, temperature = (all_of(name) for name in CONDITION_COLUMNS)
    return HarmonicTable(all_of("backward"), speed, torque, temperature, orders.pop(), all_of("coefficients"))


def write_table(table: HarmonicTable, path: Path) -> None:
    """Write a table as CSV with 17 digits; the file appears whole or not at all."""
    with_phase = [order for order in table.orders if order]
    header = ["direction", *CONDITION_COLUMNS, *(f"A{k}" for k in table.orders), *(f"phi{k}" for k in with_phase)]
    amplitude, phase = np.abs(table.coefficients), np.angle(table.coefficients)
    if 0 in table.orders:
        mean = table.orders.index(0)
        amplitude[:, mean] = table.coefficients[:, mean].real
        phase = np.delete(phase, mean, axis=1)
    numbers = np.concatenate([table.conditions, amplitude, phase], axis=1)
    with whole_file(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for backward, row in zip(table.backward, numbers, strict=True):
            direction = Direction.BACKWARD if backward else Direction.FORWARD
            writer.writerow([direction.value, *(f"{number:.17g}" for number in row)])


def read_table(path: Path) -> HarmonicTable:
    """Read a table from CSV; rows without a direction column are forward.

    `;` or tabs with decimal commas are read as well. Raises one InputError that lists what is wrong, with line numbers.
    """
    problems = Problems(str(path))
    table = read_csv(path, CONDITION_COLUMNS)
    orders = _orders(table.names, problems)
    if not table.rows:
        raise InputError(f"{path}: no rows; a harmonic table has a header and one row an operating point")
    conditions = table.numbers(CONDITION_COLUMNS, problems)
    backward = np.zeros(len(table.rows), np.bool_)
    if "direction" in table.names:
        for number, row in enumerate(table.rows):
            with problems.collect():
                direction = table.text(row, "direction").lower()
                if direction not in _DIRECTIONS:
                    raise RowError(row.line, f"direction '{direction}'; known are forward and backward")
                backward[number] = _DIRECTIONS[direction]
    amplitudes = table.numbers([f"A{k}" for k in orders], problems)
    phases = table.numbers([f"phi{k}" for k in orders if k], problems)
    with problems.collect(), np.errstate(invalid="ignore"):
        far = np.abs(phases) > 2 * np.pi
        if 2 * np.count_nonzero(far) > far.size:
            raise RowError(
                table.rows[int(far.any(axis=1).argmax())].line,
                f"{np.count_nonzero(far)} of {counted(far.size, 'phase')} beyond 2*pi, up to {np.abs(phases).max():g}: "
                "they look like degrees; phi1, .. are in rad: multiply them by pi/180, or take multiples of 2*pi out",
            )
    waves = amplitudes[:, [k > 0 for k in orders]]
    if waves.size and np.all(waves < 0.0):
        problems.add(
            f"all sizes of waves ({waves.min():g} to {waves.max():g}) are negative: A1, .. are in deg, from 0 on, not "
            "in dB; a sign belongs into the phase, as pi"
        )
    problems.raise_if_any()
    if 0 in orders:
        phases = np.insert(phases, orders.index(0), 0.0, axis=1)
    coefficients = amplitudes * (np.cos(phases) + 1j * np.sin(phases))
    speed, torque, temperature = conditions.T
    return HarmonicTable(backward, speed, torque, temperature, orders, coefficients)


def _orders(names: Sequence[str], problems: Problems) -> tuple[int, ...]:
    """The orders that a header has, with whatever is wrong with its columns noted."""
    harmonics = [_HARMONIC.fullmatch(name) for name in names]
    amplitudes = {int(found[2]) for found in harmonics if found and found[1] == "A"}
    phases = {int(found[2]) for found in harmonics if found and found[1] == "phi"}
    known = {"direction", *CONDITION_COLUMNS, *_REMARKS}
    for name, found in zip(names, harmonics, strict=True):
        if not found and name not in known:
            problems.add(f"unknown column '{name}'; known are {', '.join(sorted(known))}, A0, A1, .. and phi1, ..")
    if not amplitudes:
        problems.add("no amplitude columns A0, A1, ..")
    if 0 in phases:
        problems.add("the mean has no phase: leave the column 'phi0' out, and give A0 with its sign")
    for order in sorted((amplitudes ^ phases) - {0}):
        has, lacks = ("A", "phi") if order in amplitudes else ("phi", "A")
        problems.add(f"the column '{has}{order}' has no '{lacks}{order}' beside it")
    problems.raise_if_any()
    return tuple(sorted(amplitudes))
