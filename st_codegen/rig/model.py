"""The rig: constants, effects, and the transmission error (TE) that they make together.

TE(theta) = Re(sum over k of c_k * exp(i*k*theta)) in deg, theta the angle of the output shaft. Files: `rig.toml`, see
docs/effects.md. Order of composition: additive effects, carrier modulation, structural resonance, measuring chain.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from st_codegen.errors import InputError, Problems
from st_codegen.files.text import read_text, write_text
from st_codegen.files.toml_tables import TomlTable, nearest, parse_toml
from st_codegen.files.toml_text import table_lines
from st_codegen.ir.arrays import ComplexArray, FloatArray, IntArray
from st_codegen.rig.axis_parameters import read_axis
from st_codegen.rig.effects import Catalogue, Conditions, Constants, Effect, Stage, catalogue
from st_codegen.rig.measured import MeasuredHarmonics
from st_codegen.rig.tasks import read_tasks


@dataclass(frozen=True)
class MeasuringNoise:
    """Noise of simulated measurements: standard deviation of a sample, and of the mean from run to run, deg."""

    white_deg: float = 0.0
    run_offset_deg: float = 0.0


@dataclass(frozen=True)
class RigModel:
    """A rig. `measured`: a harmonic table to which the effects add; `other`: its tables [axis] and [tasks] as they
    stand in the file, which `machine` reads."""

    name: str = "rig"
    constants: Constants = field(default_factory=Constants)
    zero_offset_deg: float = 0.0
    noise: MeasuringNoise = field(default_factory=MeasuringNoise)
    effects: tuple[Effect, ...] = ()
    measured: MeasuredHarmonics | None = None
    other: Mapping[str, Any] = field(default_factory=dict)

    def orders(self) -> tuple[int, ...]:
        """All orders to which something contributes."""
        measured = self.measured.orders if self.measured else ()
        return tuple(sorted({0, *measured, *(order for effect in self.effects for order in effect.touched_orders())}))

    def of_stage(self, stage: Stage) -> tuple[Effect, ...]:
        """The effects of a stage, in the order of the file."""
        return tuple(effect for effect in self.effects if effect.stage is stage)

    def with_effects(self, effects: Iterable[Effect]) -> RigModel:
        """This rig with other effects in place of its own."""
        return replace(self, effects=tuple(effects))

    def of_effects(self) -> RigModel:
        """This rig, which effects alone make. Raises InputError where a measured table is a part of it."""
        if self.measured:
            raise InputError(
                f"the rig contains a measured table ({self.measured.path.name}), of which nothing has a name; "
                "reconcile wants a rig of effects: leave [measured] out"
            )
        return self

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
        columns = np.searchsorted(wanted, np.asarray(orders, np.int64))
        return total[:, columns]

    def _through(self, at: Conditions, orders: IntArray) -> ComplexArray:
        total = np.zeros((len(at), len(orders)), np.complex128)
        if self.measured:
            total += self.measured.coefficients(at, orders)
        total[:, orders == 0] += self.zero_offset_deg
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
        return (self.coefficients(at, orders) @ np.exp(1j * np.outer(orders, theta))).real

    def text(self, folder: Path | None = None) -> str:
        """The rig as TOML, to stand in `folder`: the same rig always gives the same bytes."""
        head = {"name": self.name} | {f.name: getattr(self.constants, f.name) for f in fields(Constants)}
        lines = table_lines("[rig]", head | {"zero_offset_deg": self.zero_offset_deg})
        noise = {f.name: getattr(self.noise, f.name) for f in fields(MeasuringNoise) if getattr(self.noise, f.name)}
        if noise:
            lines += ["", *table_lines("[noise]", noise)]
        if self.measured:
            path = self.measured.path
            shown = Path(os.path.relpath(path, folder.resolve())) if folder else path
            lines += ["", *table_lines("[measured]", {"table": shown.as_posix()})]
        for key in sorted(self.other):
            lines += ["", *table_lines(f"[{key}]", self.other[key])]
        for effect in self.effects:
            lines += ["", *table_lines("[[effect]]", effect.table())]
        return "\n".join(lines) + "\n"

    def write(self, path: Path) -> None:
        """Write the rig file; it appears whole or not at all."""
        write_text(path, self.text(path.parent))


def read_rig(path: Path, known: Catalogue | None = None) -> RigModel:
    """Read a rig file. Raises one InputError that lists every problem."""
    return parse_rig(read_text(path), str(path), known, path.parent)


def parse_rig(text: str, subject: str = "rig.toml", known: Catalogue | None = None, folder: Path = Path()) -> RigModel:
    """A rig from TOML text; `subject` names it in messages, `folder` is where the files lie that it names.

    Raises one InputError that lists every problem.
    """
    problems = Problems(subject)
    content = parse_toml(text, subject)
    with TomlTable(content, "", problems) as file:
        with file.table("rig", required=True) as head:
            name = head.text("name", "rig")
            offset = head.number("zero_offset_deg", 0.0, low=-1e3, high=1e3, unit="deg")
            constants = _constants(head)
        with file.table("noise") as table:
            noise = MeasuringNoise(
                table.number("white_deg", 0.0, low=0.0, high=1e3, unit="deg"),
                table.number("run_offset_deg", 0.0, low=0.0, high=1e3, unit="deg"),
            )
        measured = _measured(file, folder)
        effects = _effects(file.tables("effect"), constants, known or catalogue(), problems)
        # what the axis and the tasks are is the business of `machine`; what is wrong with them is said here
        read_axis(file.table("axis"))
        read_tasks(file.table("tasks"))
    problems.raise_if_any()
    other: dict[str, Any] = {key: content[key] for key in ("axis", "tasks") if key in content}
    return RigModel(name, constants, offset, noise, effects, measured, other)


def _constants(head: TomlTable) -> Constants:
    whole = {key: head.whole(key, getattr(Constants, key), low=1, high=10_000) for key in ("cycloid_teeth", "pins")}
    return Constants(
        head.number("reduction_ratio", low=1.0, high=1e5),
        **whole,
        cranks=head.whole("cranks", Constants.cranks, low=1, high=10_000),
        reference_temperature_C=head.number(
            "reference_temperature_C", Constants.reference_temperature_C, low=-273.15, high=1000.0, unit="degC"
        ),
    )


def _measured(file: TomlTable, folder: Path) -> MeasuredHarmonics | None:
    with file.table("measured") as table, table.collect():
        if "measured" in file and (name := table.text("table")):
            return MeasuredHarmonics.read(folder / name)
    return None


def _effects(
    tables: Sequence[TomlTable], constants: Constants, known: Catalogue, problems: Problems
) -> tuple[Effect, ...]:
    found: list[Effect] = []
    for table in tables:
        name = table.text("name")
        if name not in known:
            if name:
                table.note(f"there is no effect '{name}'; {nearest(name, sorted(known))}")
            continue
        values = {key: value for key, value in table.values.items() if key != "name"}
        effect = known[name](values, constants, check=False)
        effect.check(table)
        found.append(effect)
    delays = [effect for effect in found if effect.stage is Stage.MEASURING]
    if len({effect.name for effect in delays}) < len(delays):
        problems.add(f"'{delays[0].name}' stands there {len(delays)} times; give it once")
    return tuple(found)
