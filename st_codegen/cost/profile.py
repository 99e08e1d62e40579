"""Profiles: what an operation costs on one machine."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any

from st_codegen.cost.operations import Operation
from st_codegen.errors import InputError, Problems

#: Profile that is used where none is named.
DEFAULT = "cx5140"

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
_MAY_BE_ZERO = {"mispredicted_warm", "mispredicted_cold", "mispredict_cycles", "l1_data_bytes", "l2_bytes"}


@dataclass(frozen=True)
class Profile:
    """One machine. `machine` and `cycles` by name; `sources` says where each number is from; `text` is the file."""

    name: str
    description: str
    machine: Mapping[str, float]
    cycles: Mapping[Operation, float]
    compute_factor: float
    memory_factor: float
    sources: Mapping[str, str]
    text: str

    def weights(self, *, is_cold: bool) -> dict[Operation, float]:
        """Cycles of each operation, wrong predictions included."""
        share = self.machine["mispredicted_cold" if is_cold else "mispredicted_warm"]
        weights = dict(self.cycles)
        weights[Operation.BRANCH] += share * self.machine["mispredict_cycles"]
        return {operation: cycles * self.compute_factor for operation, cycles in weights.items()}

    def microseconds(self, cycles: float) -> float:
        """The time of some cycles."""
        return cycles / self.machine["clock_MHz"]

    @property
    def estimates(self) -> tuple[str, ...]:
        """The numbers that are nobody's measurement."""
        return tuple(name for name, source in self.sources.items() if source == "estimate")


def profiles_folder() -> Path:
    """`profiles/` of the installed package, or of the checkout."""
    installed = Path(str(files("st_codegen"))) / "profiles"
    return installed if installed.is_dir() else Path(__file__).resolve().parent.parent.parent / "profiles"


def profile_names() -> list[str]:
    """The profiles that come with st-codegen."""
    return sorted(path.stem for path in profiles_folder().glob("*.toml"))


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
    try:
        text = path.read_text(encoding="utf-8")
        content = tomllib.loads(text)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: not a readable profile: {error}") from error
    return _checked(content, path, text)


def _checked(content: dict[str, Any], path: Path, text: str) -> Profile:
    problems = Problems(str(path))
    known = {"profile", "machine", "factors", "cycles"}
    for key in content.keys() - known:
        problems.add(f"[{key}] is no table of a profile: {', '.join(sorted(known))}")
    tables = {}
    for key in sorted(known):
        table = content.get(key, {})
        if not isinstance(table, dict):
            problems.add(f"[{key}] must be a table")
            table = {}
        tables[key] = table
    sources: dict[str, str] = {}
    machine = _numbers(tables["machine"], "machine", _MACHINE, problems, sources)
    names = {operation.value: 1e6 for operation in Operation}
    cycles = _numbers(tables["cycles"], "cycles", names, problems, sources)
    factors = {key: _number(tables["factors"].get(key, 1.0)) for key in ("compute", "memory")}
    for key, value in factors.items():
        if value is None or value <= 0.0:
            problems.add(f"[factors] {key} must be a number above 0")
    for key in tables["factors"].keys() - factors.keys():
        problems.add(f"[factors] {key} is not known: compute, memory")
    problems.raise_if_any()
    return Profile(
        str(tables["profile"].get("name", path.stem)),
        str(tables["profile"].get("description", "")),
        MappingProxyType(machine),
        MappingProxyType({operation: cycles[operation.value] for operation in Operation}),
        factors["compute"] or 1.0,
        factors["memory"] or 1.0,
        MappingProxyType(sources),
        text,
    )


def _number(value: Any) -> float | None:
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if is_number else None


def _numbers(
    table: dict[str, Any], title: str, wanted: Mapping[str, float], problems: Problems, sources: dict[str, str]
) -> dict[str, float]:
    """The numbers of a table; each is `{ value = .., source = ".." }`, for a number without a source has no worth."""
    found: dict[str, float] = {}
    for key in sorted(table.keys() - wanted.keys()):
        problems.add(f"[{title}] {key} is not known")
    for key, largest in wanted.items():
        entry = table.get(key)
        if entry is None:
            problems.add(f"[{title}] {key} is missing")
            continue
        value = _number(entry.get("value")) if isinstance(entry, dict) else None
        source = entry.get("source") if isinstance(entry, dict) else None
        if value is None or not isinstance(source, str) or not source:
            problems.add(f'[{title}] {key} must be {{ value = NUMBER, source = "where it is from" }}')
        elif value < 0.0 or value > largest or (value == 0.0 and title == "machine" and key not in _MAY_BE_ZERO):
            problems.add(f"[{title}] {key} = {value:g} is not between 0 and {largest:g}")
        else:
            found[key], sources[key] = value, source
    return found
