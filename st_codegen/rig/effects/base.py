"""What an effect is: a name, parameters with bounds, and a contribution to the transmission error (TE).

Effects work on complex harmonic coefficients: TE(theta) = Re(sum over k of c_k * exp(i*k*theta)), c_k in deg. Formulas,
signs and sources: docs/effects.md. A new effect is one class: in a file of this package, in a file given with
`--effects`, or in a package with an entry point in the group `st_codegen.effects`.
"""

from __future__ import annotations

import math
import numbers
from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, IntEnum
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from st_codegen.campaign.conditions import Conditions
from st_codegen.errors import Problems, counted
from st_codegen.files.toml_tables import TomlTable
from st_codegen.ir.arrays import ComplexArray, IntArray

BACKWARD = "backward_"
ARCMIN = 1.0 / 60.0


@dataclass(frozen=True)
class Constants:
    """What all effects of a rig share; keys of the table [rig]."""

    reduction_ratio: float = 81.0
    cycloid_teeth: int = 39
    pins: int = 40
    cranks: int = 3
    reference_temperature_C: float = 30.0

    def mesh_orders(self) -> tuple[int, ...]:
        """Orders of teeth, pins and the fast shaft."""
        return tuple(sorted({*self.tooth_orders(), *self.pin_orders(), *self.shaft_orders()}))

    def part_orders(self) -> tuple[int, ...]:
        """Orders that a part makes by itself: those of the mesh, the cranks, and the output once and twice a turn."""
        return tuple(sorted({1, 2, self.cranks, *self.mesh_orders()}))

    def tooth_orders(self) -> tuple[int, ...]:
        """Multiples of the cycloid's teeth, up to the 10th."""
        return tuple(self.cycloid_teeth * m for m in range(1, 11))

    def pin_orders(self) -> tuple[int, ...]:
        """Multiples of the pins, up to the 10th."""
        return tuple(self.pins * m for m in range(1, 11))

    def shaft_orders(self) -> tuple[int, ...]:
        """Whole multiples of the reduction ratio, up to the 4th."""
        multiples = (self.reduction_ratio * m for m in range(1, 5))
        return tuple(round(order) for order in multiples if math.isfinite(order) and abs(order - round(order)) < 1e-9)

    def part_of(self, order: int) -> str:
        """Which teeth, pins or shaft have an order, as "2 x 39 teeth of the cycloid"; empty where none has it."""
        parts = (
            (self.tooth_orders(), self.cycloid_teeth, "teeth of the cycloid"),
            (self.pin_orders(), self.pins, "pins"),
            (self.shaft_orders(), self.reduction_ratio, "turns of the input shaft"),
        )
        found = [f"{round(order / one)} x {one:.10g} {name}" for orders, one, name in parts if order in orders]
        return " or ".join(found)

    def shaft_of(self, periods: float) -> str:
        """As `part_of`, of a wave of no whole number of periods a turn, known to one decimal."""
        ratio = self.reduction_ratio
        multiple = round(periods / ratio)
        is_shaft = 1 <= multiple <= 4 and round(periods, 1) == round(multiple * ratio, 1)
        return f"{multiple} x {ratio:.10g} turns of the input shaft" if is_shaft else ""


class Form(Enum):
    """How a contribution depends on a scalar: LINEAR in it, in its INVERSE, or otherwise (SHAPE)."""

    LINEAR = "linear"
    INVERSE = "inverse"
    SHAPE = "shape"
    #: where an effect acts, or which of its forms it has: no fit moves it
    FIXED = "fixed"


class Stage(IntEnum):
    """Order of composition, see docs/effects.md."""

    ADDITIVE = 1
    MODULATION = 2
    STRUCTURE = 3
    MEASURING = 4
    AXIS = 5


@dataclass(frozen=True)
class Scalar:
    """A real parameter. `default` None: the key is required.

    starts: where a fit begins (SHAPE), or the values beside the default that stand for other forms (FIXED).

    shapes: the key of the scalar that this one only shapes; without that it means nothing. beside: the key of the one
    on top of which this one comes; a search does not free it alone. typical: its range in most machines, where the
    bounds allow for others by far: a fit that knows nothing believes in that.
    """

    key: str
    unit: str
    lower: float
    upper: float
    meaning: str
    default: float | None = 0.0
    form: Form = Form.LINEAR
    starts: tuple[float, ...] = ()
    shapes: str = ""
    beside: str = ""
    typical: float = 0.0


@dataclass(frozen=True)
class Phasor:
    """An amplitude and a phase (rad): one complex number, in which the contribution is linear.

    own_flanks: the keys may stand once more with `backward_` in front; without them backward equals forward. beside:
    the key of the one without which this one says nothing; a search frees both, and no other part with them. typical:
    as of a Scalar.
    """

    key: str
    phase_key: str
    unit: str
    upper: float
    meaning: str
    required: bool = True
    own_flanks: bool = False
    beside: str = ""
    typical: float = 0.0

    def keys(self, backward: bool) -> tuple[str, str]:
        """Amplitude and phase key of a direction."""
        front = BACKWARD if backward else ""
        return front + self.key, front + self.phase_key


Value = float | tuple[float, ...]


class Effect(ABC):
    """One effect with its parameters. Subclasses set the class attributes and `contribution` (or `passed_on`).

    orders_key: None, "order" (one order) or "orders" (a list; phasors are lists of that length).
    """

    name: ClassVar[str]
    title: ClassVar[str]
    scalars: ClassVar[tuple[Scalar, ...]] = ()
    phasors: ClassVar[tuple[Phasor, ...]] = ()
    orders_key: ClassVar[str | None] = None
    #: where it acts; an effect may set its own, a search of what is missing goes by that of the class
    stage: Stage = Stage.ADDITIVE
    #: the lowest order that it may name
    least_order: ClassVar[int] = 1
    #: how many of its orders must be measured that the rig does not make, for it to be told from changes of these
    least_foreign: ClassVar[int] = 0
    #: whether `reconcile` tries it as a cause
    searched: ClassVar[bool] = True
    #: what tells this effect from its look-alikes where no operating point does
    experiment: ClassVar[str] = ""

    def __init__(self, values: Mapping[str, Any], constants: Constants, *, check: bool = True) -> None:
        """Raises InputError that lists every problem of the values, unless `check` is off."""
        self.values: Mapping[str, Value] = MappingProxyType(_plain(values))
        self.constants = constants
        if check:
            problems = Problems(self.name)
            self.check(TomlTable(values, self.name, problems))
            problems.raise_if_any()

    # -- what a subclass gives

    @classmethod
    def allowed_orders(cls, constants: Constants) -> tuple[int, ...] | None:
        """The orders that `order` or `orders` may name; None: all."""
        return None

    def touched_orders(self) -> tuple[int, ...]:
        """The orders to which this effect contributes."""
        return self.orders

    def needed_orders(self, order: int) -> tuple[int, ...]:
        """The orders of the earlier stage from which the coefficient of `order` is made (MODULATION)."""
        return ()

    def coefficient(self, at: Conditions, order: int) -> Any:
        """What is added to c_k of one of `touched_orders`, (n,), deg. For stages ADDITIVE and STRUCTURE.

        Written with arithmetic, powers, np.exp, np.tanh, np.abs and np.maximum of speed, torque and temperature alone,
        it is also the formula that `reconcile --update-models` compiles for the controller.
        """
        return self.contribution(at, np.array([order], np.int64))[:, 0]

    def contribution(self, at: Conditions, orders: IntArray) -> ComplexArray:
        """What is added to c_k: complex128 (n, len(orders)), deg. A subclass gives this or `coefficient`."""
        found = np.zeros((len(at), len(orders)), np.complex128)
        if type(self).coefficient is not Effect.coefficient:
            touched = set(self.touched_orders())
            for index, order in enumerate(orders.tolist()):
                if order in touched:
                    found[:, index] = self.coefficient(at, order)
        return found

    def transfer(self, order: int) -> Mapping[int, complex] | None:
        """What c_k of `order` gets from earlier orders, as factors (MODULATION); None: not by constant factors."""
        return None

    def constant(self, order: int) -> complex:
        """What c_k of `order` gets at every operating point, whatever the earlier orders are (MODULATION)."""
        return 0.0

    def passed_on(self, at: Conditions, orders: IntArray, coefficients: ComplexArray) -> ComplexArray:
        """The coefficients behind this effect, given those before it (n, len(orders)); affine in them."""
        return coefficients + self.contribution(at, orders)

    def passed_on_change(self, at: Conditions, orders: IntArray, change: ComplexArray) -> ComplexArray:
        """What becomes of a small change of the coefficients (the linear part of `passed_on`)."""
        return change

    # -- what all share

    @cached_property
    def orders(self) -> tuple[int, ...]:
        """The orders named by the parameters."""
        if self.orders_key is None:
            return ()
        value = self.values[self.orders_key]
        return tuple(int(k) for k in value) if isinstance(value, tuple) else (int(value),)

    @property
    def state_text(self) -> str:
        """Where an effect acts that has a state of its own, to stand behind its name; empty for most."""
        return ""

    def scalar(self, key: str) -> float:
        """The value of a scalar, or its default."""
        if key in self.values:
            return float(self.values[key])  # type: ignore[arg-type]
        default = next(scalar.default for scalar in self.scalars if scalar.key == key)
        return 0.0 if default is None else default

    def complex_value(self, key: str, backward: bool = False, index: int = 0) -> complex:
        """A phasor as a complex number, for one direction, and one order of a list."""
        return self.complex_values(key, backward)[index]

    def complex_values(self, key: str, backward: bool = False) -> tuple[complex, ...]:
        """A phasor as complex numbers, for one direction: one for each order of a list, or a single one."""
        known = self._complex_values.get((key, backward))
        if known is None:
            phasor = next(phasor for phasor in self.phasors if phasor.key == key)
            keys = phasor.keys(backward and phasor.own_flanks)
            if backward and keys[0] not in self.values:
                keys = phasor.keys(False)
            count = len(self.orders) if self.orders_key == "orders" else 1
            amplitudes, phases = (_entries(self.values.get(name, 0.0), count) for name in keys)
            known = tuple(complex(a * math.cos(p), a * math.sin(p)) for a, p in zip(amplitudes, phases, strict=True))
            self._complex_values[key, backward] = known
        return known

    @cached_property
    def _complex_values(self) -> dict[tuple[str, bool], tuple[complex, ...]]:
        """The phasors that were asked for: a fit asks for the same ones at every step of others."""
        return {}

    def complex_at(self, key: str, at: Conditions, index: int = 0) -> ComplexArray:
        """A phasor at operating points, complex128 (n,)."""
        return np.where(at.sign > 0, self.complex_value(key, False, index), self.complex_value(key, True, index))

    def with_values(self, values: Mapping[str, Any]) -> Effect:
        """This effect with other values, unchecked."""
        return type(self)(values, self.constants, check=False)

    def table(self) -> dict[str, Any]:
        """Name and parameters in the order of the catalogue, for a rig file."""
        known = self.known_keys()
        rest = sorted((key for key in self.values if key in known), key=known.index)
        found: dict[str, Any] = {"name": self.name}
        for key in rest:
            value = self.values[key]
            found[key] = list(self.orders) if key == "orders" else value
            if key == "order":
                found[key] = self.orders[0]
        return found

    @classmethod
    def known_keys(cls) -> list[str]:
        """All keys that the effect knows."""
        keys = [] if cls.orders_key is None else [cls.orders_key]
        keys += [scalar.key for scalar in cls.scalars]
        for phasor in cls.phasors:
            keys += [*phasor.keys(False), *(phasor.keys(True) if phasor.own_flanks else ())]
        return keys

    def units(self) -> dict[str, str]:
        """The unit of the value of each key."""
        found = {scalar.key: scalar.unit for scalar in self.scalars}
        for phasor in self.phasors:
            for backward in (False, True):
                amplitude, phase = phasor.keys(backward)
                found |= {amplitude: phasor.unit, phase: "rad"}
        return found

    def check(self, table: TomlTable) -> None:
        """Note whatever is wrong with the values that this effect was made of: unknown keys, types, bounds, orders."""
        with table:
            count = self._check_orders(table)
            for scalar in self.scalars:
                table.number(
                    scalar.key,
                    scalar.default,
                    low=scalar.lower,
                    high=scalar.upper,
                    unit=scalar.unit,
                    meaning=scalar.meaning,
                )
            for phasor in self.phasors:
                self._check_phasor(phasor, count, table)

    def _check_orders(self, table: TomlTable) -> int:
        """The number of orders that the table names."""
        key = self.orders_key
        if key is None:
            return 0
        orders = (
            (table.whole(key, low=self.least_order),)
            if key == "order"
            else table.list_of(key, lambda name, entry: table.whole_of(name, entry, self.least_order))
        )
        if not table.is_sound:
            return len(orders)
        if not orders:
            table.note(f"{key} is empty")
        allowed = self.allowed_orders(self.constants)
        for order in orders:
            if allowed is not None and order not in allowed:
                given = ", ".join(map(str, allowed)) or "none"
                table.note(f"{key}: {order} is no order of this effect: ratio, teeth and pins of [rig] give {given}")
        if len(set(orders)) != len(orders):
            table.note(f"{key}: an order stands there twice")
        return len(orders)

    def _check_phasor(self, phasor: Phasor, count: int, table: TomlTable) -> None:
        for backward in (False, True) if phasor.own_flanks else (False,):
            amplitude, phase = phasor.keys(backward)
            table.declare(amplitude, phase)
            if amplitude not in table:
                if phasor.required and not backward:
                    table.note(f"'{amplitude}' is missing ({phasor.meaning})")
                if phase in table:
                    table.note(f"'{phase}' stands without '{amplitude}'")
                continue
            self._check_numbers(amplitude, count, table, 0.0, phasor.upper, phasor.unit)
            if phase in table:
                self._check_numbers(phase, count, table)

    def _check_numbers(
        self, key: str, count: int, table: TomlTable, low: float = -math.inf, high: float = math.inf, unit: str = ""
    ) -> None:
        """A number, or a list of `count` numbers where the effect has a list of orders."""
        if self.orders_key != "orders":
            table.number(key, low=low, high=high, unit=unit)
            return
        table.list_of(key, lambda name, entry: table.number_of(name, entry, low, high, unit))
        value = table.values[key]
        if isinstance(value, list | tuple) and len(value) != count:
            table.note(f"'{key}' has {counted(len(value), 'entry', 'entries')}, orders has {count}")


class Wave(Effect):
    """An effect whose coefficient, on each order that it touches, is its first phasor as it stands."""

    def coefficient(self, at: Conditions, order: int) -> ComplexArray:
        return self.complex_at(self.phasors[0].key, at)


def _plain(values: Mapping[str, Any]) -> dict[str, Value]:
    """Numbers as float, lists as tuples; what is neither stays as it is, for `Effect.check` to refuse."""
    return {
        key: tuple(map(_float, value)) if isinstance(value, list | tuple) else _float(value)
        for key, value in values.items()
    }


def _float(value: Any) -> Any:
    # nearly all are: to ask whether a number is real takes longer than all the rest
    if type(value) is float or not isinstance(value, numbers.Real):
        return value
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _entries(value: Value, count: int) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,) * count
