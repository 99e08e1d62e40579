"""Profiles: what an operation costs on one machine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from st_codegen.cost.operations import CostClass
from st_codegen.cost.profile_files import DEFAULT, profile_names, profiles_folder
from st_codegen.errors import InputError, Problems
from st_codegen.files.text import read_text
from st_codegen.files.toml_tables import TomlTable, parse_toml, shown

#: The numbers of [machine], and the largest value that makes sense; all are positive, shares may be 0.
_MACHINE = {
    "clock_MHz": 1e5,
    "l1_data_bytes": 1e9,
    "l2_bytes": 1e12,
    "l2_cycles": 1e6,
    "memory_cycles": 1e6,
    "mispredict_cycles": 1e4,
    "mispredicted_warm": 1.0,
    "mispredicted_cold": 1.0,
    "code_bytes": 1e3,
}
#: What must be above 0 is at least this.
_SMALLEST = 1e-9
#: What a profile takes as factors.
SMALLEST_FACTOR, LARGEST_FACTOR = _SMALLEST, 1e6
_MAY_BE_ZERO = {"mispredicted_warm", "mispredicted_cold", "mispredict_cycles", "l1_data_bytes", "l2_bytes"}


@dataclass(frozen=True)
class Profile:
    """One machine. `machine` and `cycles` by name; `sources` says where each number is from; `text` is the file.

    longest: of the times that it was calibrated with, over its own, where one is longer than that; else 1.
    """

    name: str
    machine: Mapping[str, float]
    cycles: Mapping[CostClass, float]
    compute_factor: float
    memory_factor: float
    sources: Mapping[str, str]
    text: str
    longest: float = 1.0

    def weights(self, *, is_cold: bool) -> dict[CostClass, float]:
        """Cycles of each operation, wrong predictions included."""
        share = self.machine["mispredicted_cold" if is_cold else "mispredicted_warm"]
        weights = dict(self.cycles)
        weights[CostClass.BRANCH] += share * self.machine["mispredict_cycles"]
        return {operation: cycles * self.compute_factor for operation, cycles in weights.items()}

    def microseconds(self, cycles: float) -> float:
        """The time in us that a number of cycles takes."""
        return cycles / self.machine["clock_MHz"]

    @property
    def is_calibrated(self) -> bool:
        """Whether times were measured on the machine, so that the profile's own are no more than a start."""
        return not self.compute_factor == self.memory_factor == 1.0

    def judged(self, *, fits: bool) -> str:
        """What is said of a budget: that a cycle fits into it is an estimate until something was measured."""
        if not fits:
            return "DOES NOT FIT"
        # a calibration that could not tell the memory's factor leaves it at 1, or at the other one
        told = self.is_calibrated and self.memory_factor not in (1.0, self.compute_factor)
        return "fits" if told and self.longest <= 1.0 else "fits by estimate"

    @property
    def remark(self) -> str:
        """Why its times are no bound; empty where no measurement says so."""
        if not self.is_calibrated:
            return f"{self.name} was not calibrated: the times are estimates (st-codegen calibrate)"
        if self.longest <= 1.0:
            return ""
        return (
            f"{self.name}: its times are no bound, since some that it was calibrated with are up to {self.longest:g} "
            "times as long; divide a budget by that at least"
        )

    @property
    def estimates(self) -> tuple[str, ...]:
        """The names of the numbers that nobody has measured."""
        return tuple(name for name, source in self.sources.items() if source == "estimate")


def load_profile(name: str | Path = DEFAULT) -> Profile:
    """A profile by its name, or by the path of a .toml file.

    Raises InputError with every problem of the file, or with the known names when there is no such profile.
    """
    path = Path(name)
    if path.suffix != ".toml":
        path = profiles_folder() / f"{name}.toml"
        if not path.is_file():
            raise InputError(
                f"no profile '{name}': use one of {', '.join(profile_names())}, or the path of a .toml file"
            )
    text = read_text(path)
    problems = Problems(str(path))
    with TomlTable(parse_toml(text, str(path)), "", problems) as file:
        profile = _profile(file, path.stem, text)
    problems.raise_if_any()
    return profile


def _profile(file: TomlTable, name: str, text: str) -> Profile:
    """A profile from its file; `name` is taken where the file gives none."""
    sources: dict[str, str] = {}
    with file.table("profile") as head:
        name = head.text("name", name)
        head.text("description", "")  # for readers of the file
    with file.table("machine", required=True) as table:
        least = {key: 0.0 if key in _MAY_BE_ZERO else _SMALLEST for key in _MACHINE}
        machine = {key: _sourced(table, key, least[key], high, sources) for key, high in _MACHINE.items()}
    with file.table("cycles", required=True) as table:
        cycles = {operation: _sourced(table, operation.value, 0.0, 1e6, sources) for operation in CostClass}
    with file.table("factors") as table:
        compute, memory = (
            table.number(key, 1.0, low=SMALLEST_FACTOR, high=LARGEST_FACTOR) for key in ("compute", "memory")
        )
        longest = table.number("longest", 1.0, low=1.0)
    return Profile(
        name,
        MappingProxyType(machine),
        MappingProxyType(cycles),
        compute,
        memory,
        MappingProxyType(sources),
        text,
        longest,
    )


def _sourced(table: TomlTable, key: str, low: float, high: float, sources: dict[str, str]) -> float:
    """A number written as `{ value = .., source = ".." }`, for a number without a source has no worth."""
    if key in table and not isinstance(table.values[key], dict):
        table.declare(key)
        table.note(f'{key} = {shown(table.values[key])}; write {{ value = NUMBER, source = "where it is from" }}')
        return low
    entry = table.table(key, required=True)
    if not entry.values:
        return low
    with entry:
        value = entry.number("value", low=low, high=high)
        sources[key] = entry.text("source")
        if not sources[key] and entry.is_sound:
            entry.note("source is empty")
    return value
