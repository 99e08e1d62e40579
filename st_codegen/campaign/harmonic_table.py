"""Harmonic tables: the transmission error (TE) of a reducer by operating point, direction and order.

A row is the curve TE(theta) = Re(sum over k of c_k * exp(i*k*theta)) in deg, theta the angle of the output shaft in
rad. As a file, one CSV with `direction,speed_rpm,torque_Nm,temperature_C,A0,A1,..,phi1,..`: A_k in deg and phi_k in
rad of c_k = A_k*exp(i*phi_k); A0 is the mean, with its sign and without a phase.
"""

from __future__ import annotations

import csv
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from st_codegen.errors import InputError, Problems
from st_codegen.te.harmonics import Direction

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
BoolArray = npt.NDArray[np.bool_]

CONDITION_COLUMNS = ("speed_rpm", "torque_Nm", "temperature_C")
#: column -> what it says; read over, since the signs are already in A0
_REMARKS = {"A0_sign": "whether the sign of A0 was measured or inferred"}
_DIRECTIONS = {
    "forward": False,
    "fw": False,
    "backward": True,
    "bw": True,
}
_HARMONIC = re.compile(r"(A|phi)(\d{1,6})")
#: a file with more faults than this is described by its first ones
_MOST_PROBLEMS = 50


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
    def conditions(self) -> FloatArray:
        """Speed (rpm), torque (N m) and temperature (degC), float64 (n, 3)."""
        return np.stack([self.speed_rpm, self.torque_Nm, self.temperature_C], axis=1)

    def column(self, order: int) -> ComplexArray:
        """The coefficients of one order, complex128 (n,), deg. Raises InputError for an order that is not there."""
        if order not in self.orders:
            raise InputError(
                f"order {order} is not in the harmonic table, which has {', '.join(map(str, self.orders))}"
            )
        column: ComplexArray = self.coefficients[:, self.orders.index(order)]
        return column

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
        """The rows of one direction."""
        return self.rows(self.backward == (direction is Direction.BACKWARD))

    def only(self, orders: Sequence[int]) -> HarmonicTable:
        """The same rows with these orders. Raises InputError for an order that is not there."""
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
    """Write a table as CSV, 17 digits; the file appears complete or not at all."""
    with_phase = [order for order in table.orders if order]
    header = ["direction", *CONDITION_COLUMNS, *(f"A{k}" for k in table.orders), *(f"phi{k}" for k in with_phase)]
    amplitude, phase = np.abs(table.coefficients), np.angle(table.coefficients)
    if 0 in table.orders:
        mean = table.orders.index(0)
        amplitude[:, mean] = table.coefficients[:, mean].real
        phase = np.delete(phase, mean, axis=1)
    numbers = np.concatenate([table.conditions, amplitude, phase], axis=1)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with temporary.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(header)
            for backward, row in zip(table.backward, numbers, strict=True):
                direction = Direction.BACKWARD if backward else Direction.FORWARD
                writer.writerow([direction.value, *(f"{number:.17g}" for number in row)])
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read_table(path: Path) -> HarmonicTable:
    """Read a table from CSV; rows without a direction column are forward.

    `;` with decimal commas is read as well. Raises one InputError that lists what is wrong, with line numbers.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as text ({error})") from None
    problems = Problems(str(path))
    lines = text.splitlines()
    semicolons = bool(lines) and ";" in lines[0]
    rows = [row for row in enumerate(csv.reader(lines, delimiter=";" if semicolons else ","), 1) if any(row[1])]
    if len(rows) < 2:
        raise InputError(f"{path}: no rows; a harmonic table has a header and one row an operating point")
    header = _Header([name.strip() for name in rows[0][1]], problems)
    problems.raise_if_any()
    numbers = np.empty((len(rows) - 1, len(header.names)))
    for place, (line, cells) in enumerate(rows[1:]):
        numbers[place] = header.numbers(line, cells, semicolons)
    if len(problems.errors) > _MOST_PROBLEMS:
        more = len(problems.errors) - _MOST_PROBLEMS
        del problems.errors[_MOST_PROBLEMS:]
        problems.add(f"and {more} more")
    problems.raise_if_any()
    return header.table(numbers)


class _Header:
    """The columns of a table; reads rows by them."""

    def __init__(self, names: Sequence[str], problems: Problems) -> None:
        self.names = tuple(names)
        self.problems = problems
        harmonics = [_HARMONIC.fullmatch(name) for name in names]
        amplitudes = {int(found[2]) for found in harmonics if found and found[1] == "A"}
        phases = {int(found[2]) for found in harmonics if found and found[1] == "phi"}
        self.orders = tuple(sorted(amplitudes))
        known = {"direction", *CONDITION_COLUMNS, *_REMARKS}
        for name, found in zip(names, harmonics, strict=True):
            if not found and name not in known:
                problems.add(f"unknown column '{name}'; known are {', '.join(sorted(known))}, A0, A1, .. and phi1, ..")
        for name in sorted({name for name in names if names.count(name) > 1}):
            problems.add(f"the column '{name}' is there twice")
        for name in CONDITION_COLUMNS:
            if name not in names:
                problems.add(f"the column '{name}' is missing")
        if not amplitudes:
            problems.add("no amplitude columns A0, A1, ..")
        for order in sorted((amplitudes - {0}) ^ phases):
            has, lacks = ("A", "phi") if order in amplitudes else ("phi", "A")
            problems.add(f"the column '{has}{order}' has no '{lacks}{order}' beside it")

    def numbers(self, line: int, cells: Sequence[str], decimal_comma: bool) -> list[float]:
        """The numbers of a row; direction as 0 (forward) or 1, remarks as 0."""
        if len(cells) != len(self.names):
            self.problems.add(f"line {line}: {len(cells)} values, the header has {len(self.names)}")
            return [0.0] * len(self.names)
        values = []
        for name, cell in zip(self.names, cells, strict=True):
            with self.problems.collect():
                values.append(self._value(line, name, cell.strip(), decimal_comma))
                continue
            values.append(0.0)
        return values

    @staticmethod
    def _value(line: int, name: str, cell: str, decimal_comma: bool) -> float:
        if name in _REMARKS:
            return 0.0
        if name == "direction":
            if cell.lower() not in _DIRECTIONS:
                raise InputError(f"line {line}: direction '{cell}'; known are forward and backward")
            return float(_DIRECTIONS[cell.lower()])
        try:
            value = float(cell.replace(",", ".") if decimal_comma else cell)
        except ValueError:
            raise InputError(f"line {line}, {name}: '{cell}' is not a number") from None
        if not math.isfinite(value):
            raise InputError(f"line {line}, {name}: '{cell}' is not finite")
        return value

    def table(self, numbers: FloatArray) -> HarmonicTable:
        """The table of checked numbers (rows, columns)."""

        def column(name: str) -> FloatArray:
            values: FloatArray = numbers[:, self.names.index(name)]
            return values

        coefficients = np.empty((len(numbers), len(self.orders)), np.complex128)
        for place, order in enumerate(self.orders):
            angle = column(f"phi{order}") if order else np.zeros(len(numbers))
            coefficients[:, place] = column(f"A{order}") * (np.cos(angle) + 1j * np.sin(angle))
        backward = column("direction") != 0 if "direction" in self.names else np.zeros(len(numbers), np.bool_)
        speed, torque, temperature = (column(name) for name in CONDITION_COLUMNS)
        return HarmonicTable(backward, speed, torque, temperature, self.orders, coefficients)
