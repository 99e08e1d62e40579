"""The rig: constants, effects, and the transmission error (TE) that they make together.

TE(theta) = Re(sum over k of c_k * exp(i*k*theta)) in deg, theta the angle of the output shaft. Files: `rig.toml`, see
docs/effects.md. Order of composition: additive effects, carrier modulation, structural resonance, measuring chain.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from st_codegen.errors import InputError, Problems
from st_codegen.rig.effects import Catalogue, Conditions, Constants, Effect, Stage, catalogue
from st_codegen.rig.effects.base import ComplexArray, FloatArray, IntArray

#: tables of a rig file that belong to other parts of the simulation; kept as they are
OTHER_TABLES = ("axis", "motor", "drive", "reducer", "load", "encoders", "tasks")


@dataclass(frozen=True)
class Noise:
    """Noise of simulated measurements: standard deviation of a sample, and of the mean from run to run, deg."""

    white_deg: float = 0.0
    run_offset_deg: float = 0.0


@dataclass(frozen=True)
class RigModel:
    """A rig. `other`: tables that other parts of the simulation read."""

    name: str = "rig"
    constants: Constants = field(default_factory=Constants)
    zero_offset_deg: float = 0.0
    noise: Noise = field(default_factory=Noise)
    effects: tuple[Effect, ...] = ()
    other: Mapping[str, Any] = field(default_factory=dict)

    def orders(self) -> tuple[int, ...]:
        """All orders to which something contributes."""
        return tuple(sorted({0, *(order for effect in self.effects for order in effect.touched_orders())}))

    def of_stage(self, stage: Stage) -> tuple[Effect, ...]:
        """The effects of a stage, in the order of the file."""
        return tuple(effect for effect in self.effects if effect.stage is stage)

    def with_effects(self, effects: Iterable[Effect]) -> RigModel:
        """The same rig with other effects."""
        return replace(self, effects=tuple(effects))

    def closure(self, orders: Sequence[int]) -> IntArray:
        """`orders` and those that their sidebands need, rising."""
        needed = {
            carrier
            for effect in self.of_stage(Stage.MODULATION)
            for order in orders
            for carrier in effect.needed_orders(order)
        }
        return np.array(sorted({*orders, *needed}), np.int64)

    def coefficients(self, at: Conditions, orders: Sequence[int]) -> ComplexArray:
        """c_k at operating points, complex128 (len(at), len(orders)), deg; column j belongs to orders[j]."""
        wanted = self.closure(orders)
        total = self._through(at, wanted)
        places = np.searchsorted(wanted, np.asarray(orders, np.int64))
        found: ComplexArray = total[:, places]
        return found

    def _through(self, at: Conditions, orders: IntArray) -> ComplexArray:
        total = np.zeros((len(at), len(orders)), np.complex128)
        total[:, orders == 0] = self.zero_offset_deg
        for effect in self.of_stage(Stage.ADDITIVE):
            total += effect.contribution(at, orders)
        before = total.copy()
        for effect in self.of_stage(Stage.MODULATION):
            total += effect.passed_on(at, orders, before) - before
        for stage in (Stage.STRUCTURE, Stage.MEASURING):
            for effect in self.of_stage(stage):
                total = effect.passed_on(at, orders, total)
        return total

    def te_deg(
        self,
        theta_deg: npt.ArrayLike,
        sign: npt.ArrayLike,
        speed_rpm: npt.ArrayLike,
        torque_Nm: npt.ArrayLike,
        temperature_C: npt.ArrayLike,
    ) -> FloatArray:
        """TE in deg at angles of the output (deg), each with its operating point; all broadcast to one shape (n,)."""
        theta = np.atleast_1d(np.asarray(theta_deg, np.float64))
        at = Conditions.of(sign, speed_rpm, torque_Nm, temperature_C)
        orders = np.array(self.orders())
        waves = np.exp(1j * np.outer(np.deg2rad(theta), orders))
        te: FloatArray = (self.coefficients(at, self.orders()) * waves).real.sum(axis=1)
        return te

    def curve(self, at: Conditions, samples: int) -> FloatArray:
        """TE over a revolution at `samples` equidistant angles from 0, float64 (len(at), samples), deg.

        Orders from samples/2 up fold back, as they do in a measurement.
        """
        orders = self.orders()
        theta = np.arange(samples) * (2 * np.pi / samples)
        te: FloatArray = (self.coefficients(at, orders) @ np.exp(1j * np.outer(orders, theta))).real
        return te

    def text(self) -> str:
        """The rig as TOML: the same rig always gives the same bytes."""
        head = {"name": self.name} | {f.name: getattr(self.constants, f.name) for f in fields(Constants)}
        lines = ["[rig]", *_entries(head | {"zero_offset_deg": self.zero_offset_deg})]
        noise = {f.name: getattr(self.noise, f.name) for f in fields(Noise) if getattr(self.noise, f.name)}
        if noise:
            lines += ["", "[noise]", *_entries(noise)]
        for key in sorted(self.other):
            lines += _table_lines(key, self.other[key])
        for effect in self.effects:
            lines += ["", "[[effect]]", *_entries(effect.table())]
        return "\n".join(lines) + "\n"

    def write(self, path: Path) -> None:
        """Write the rig file; it appears complete or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            temporary.write_text(self.text(), encoding="utf-8", newline="\n")
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def read_rig(path: Path, known: Catalogue | None = None) -> RigModel:
    """Read a rig file. Raises one InputError that lists every problem."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not readable as text ({error})") from None
    return parse_rig(text, str(path), known)


def parse_rig(text: str, subject: str = "rig.toml", known: Catalogue | None = None) -> RigModel:
    """A rig from TOML text; `subject` names it in messages. Raises one InputError that lists every problem."""
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{subject}: not readable as TOML ({error})") from None
    problems = Problems(subject)
    tables = ("rig", "noise", "effect", *OTHER_TABLES)
    for key in sorted(set(content) - set(tables)):
        problems.add(f"unknown table [{key}]; known are {', '.join(tables)}")
    head = _table(content, "rig", problems)
    if not head:
        problems.add("[rig] is missing: it holds reduction_ratio and what else all effects share")
    name = head.pop("name", "rig")
    if not isinstance(name, str):
        problems.add(f"[rig]: name = {name!r} is not a text")
    offset = _number(head, "zero_offset_deg", 0.0, (-1e3, 1e3), problems)
    constants = _constants(head, problems)
    noise = _numbers(_table(content, "noise", problems), Noise, "[noise]", (0.0, 1e3), problems)
    effects = _effects(content.get("effect", []), constants, known or catalogue(), problems)
    problems.raise_if_any()
    other = {key: content[key] for key in OTHER_TABLES if key in content}
    return RigModel(name, constants, offset, noise, effects, other)


def _table(content: dict[str, Any], key: str, problems: Problems) -> dict[str, Any]:
    table = content.get(key, {})
    if not isinstance(table, dict):
        problems.add(f"[{key}] must be a table")
        return {}
    return dict(table)


def _number(table: dict[str, Any], key: str, default: float, bounds: tuple[float, float], problems: Problems) -> float:
    value = table.pop(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not bounds[0] <= value <= bounds[1]:
        problems.add(f"{key} = {value!r} is not a number in {bounds[0]:g} .. {bounds[1]:g}")
        return default
    return value


def _numbers(table: dict[str, Any], kind: Any, where: str, bounds: tuple[float, float], problems: Problems) -> Any:
    values = {f.name: _number(table, f.name, float(getattr(kind, f.name)), bounds, problems) for f in fields(kind)}
    for key in sorted(table):
        problems.add(f"{where}: unknown key '{key}'; known are {', '.join(f.name for f in fields(kind))}")
    return kind(**values)


def _constants(head: dict[str, Any], problems: Problems) -> Constants:
    if "reduction_ratio" not in head:
        problems.add("[rig]: 'reduction_ratio' is missing")
    temperature = _number(head, "reference_temperature_C", 30.0, (-273.15, 1000.0), problems)
    ratio = _number(head, "reduction_ratio", 81.0, (1.0, 1e5), problems)
    whole = {}
    for key in ("cycloid_teeth", "pins", "cranks"):
        value = _number(head, key, getattr(Constants, key), (1, 10000), problems)
        if value != int(value):
            problems.add(f"[rig]: {key} = {value} is not a whole number")
        whole[key] = int(value)
    for key in sorted(head):
        known = ["name", "zero_offset_deg", *(f.name for f in fields(Constants))]
        problems.add(f"[rig]: unknown key '{key}'; known are {', '.join(known)}")
    return Constants(float(ratio), whole["cycloid_teeth"], whole["pins"], whole["cranks"], float(temperature))


def _effects(tables: Any, constants: Constants, known: Catalogue, problems: Problems) -> tuple[Effect, ...]:
    if not isinstance(tables, list):
        problems.add("effects are written as [[effect]], one table each")
        return ()
    found: list[Effect] = []
    for number, table in enumerate(tables, 1):
        name = table.get("name")
        if name not in known:
            problems.add(f"[[effect]] {number}: name = {name!r}; known are {', '.join(sorted(known))}")
            continue
        with problems.collect():
            try:
                found.append(known[name]({key: v for key, v in table.items() if key != "name"}, constants))
            except InputError as error:
                raise InputError(f"[[effect]] {number}: {error}") from None
    delays = [effect for effect in found if effect.stage is Stage.MEASURING]
    if len({effect.name for effect in delays}) < len(delays):
        problems.add(f"'{delays[0].name}' stands there {len(delays)} times; give it once")
    return tuple(found)


def _entries(table: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {_value(value)}" for key, value in table.items() if not isinstance(value, dict)]


def _table_lines(name: str, table: Any) -> list[str]:
    """A table of `other`, with the tables in it."""
    if isinstance(table, list):
        return [line for entry in table for line in ["", f"[[{name}]]", *_entries(entry)]]
    lines = ["", f"[{name}]", *_entries(table)]
    for key, value in table.items():
        if isinstance(value, dict):
            lines += _table_lines(f"{name}.{key}", value)
    return lines


def _value(value: Any) -> str:
    """A value as TOML, numbers with as many digits as give the same float64 again."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(_value(entry) for entry in value)}]"
    return _WRITERS[type(value)](value)


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c >= " " else f"\\u{ord(c):04x}" for c in escaped) + '"'


_WRITERS: dict[type, Callable[[Any], str]] = {bool: lambda v: str(v).lower(), str: _quoted, int: str, float: repr}
