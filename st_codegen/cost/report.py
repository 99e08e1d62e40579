"""Who spends what: the worst case of a block in microseconds, split by the units whose text it runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from st_codegen.cost.memory import LINE, lines_by_region
from st_codegen.cost.operations import as_mapping, no_counts, size_of, weighted
from st_codegen.cost.paths import CodeLines, PathCost
from st_codegen.cost.profile import Profile
from st_codegen.cost.units import UnitCost, Units
from st_codegen.st import tree as t
from st_codegen.st.tree import PouKind
from st_codegen.st.types import ArrayType


@dataclass(frozen=True)
class UnitPart:
    """What one unit's own text does on the worst path of a block.

    `lines` of data and `code_lines` of code are touched at most; `code_bytes` is an estimate of all its code,
    `table_bytes` are all its constant arrays. Times in us: `warm_us` with all in the caches that fits, `cold_us` with
    nothing in them.
    """

    unit: str
    operations: Mapping[str, int]
    lines: int
    code_lines: int
    table_bytes: int
    code_bytes: int
    warm_us: float
    cold_us: float

    @property
    def total_operations(self) -> int:
        return sum(self.operations.values())

    def and_for(self, other: UnitPart) -> UnitPart:
        """What the unit does for another block as well: its tables and code are there once."""
        return replace(
            self,
            operations=_added([self, other]),
            lines=self.lines + other.lines,
            code_lines=self.code_lines + other.code_lines,
            warm_us=self.warm_us + other.warm_us,
            cold_us=self.cold_us + other.cold_us,
        )


@dataclass(frozen=True)
class BlockCost:
    """The worst case of one call of a block, with all it calls; `parts` by unit, the slowest first.

    With an entry in `unbounded` the times are no bound: those loops are counted as a single round, and those blocks of
    libraries as a single call.
    """

    block: str
    parts: tuple[UnitPart, ...]
    unbounded: tuple[str, ...]

    @property
    def warm_us(self) -> float:
        return sum(part.warm_us for part in self.parts)

    @property
    def cold_us(self) -> float:
        return sum(part.cold_us for part in self.parts)

    @property
    def is_bounded(self) -> bool:
        return not self.unbounded

    @property
    def operations(self) -> dict[str, int]:
        """How often each operation is executed, by its name."""
        return _added(self.parts)

    def as_json(self) -> dict[str, Any]:
        """The costs of a block as a table of numbers for JSON."""
        return {
            "bounded": self.is_bounded,
            "unbounded": list(self.unbounded),
            **_sums(self.parts),
            "operations": self.operations,
            "parts": {part.unit: {**_sums([part]), "operations": part.total_operations} for part in self.parts},
        }


def _added(parts: Iterable[UnitPart]) -> dict[str, int]:
    """How often each operation is executed by some parts together."""
    total: Counter[str] = Counter()
    for part in parts:
        total.update(part.operations)
    return dict(total)


def _sums(parts: Sequence[UnitPart]) -> dict[str, float]:
    return {
        "warm_us": sum(part.warm_us for part in parts),
        "cold_us": sum(part.cold_us for part in parts),
        "touched_bytes": LINE * sum(part.lines for part in parts),
        "table_bytes": sum(part.table_bytes for part in parts),
        "code_bytes": sum(part.code_bytes for part in parts),
    }


@dataclass(frozen=True)
class ProjectCost:
    """All blocks and programs of a project; `entries` are those that a cycle runs, each once."""

    profile: Profile
    blocks: Mapping[str, BlockCost]
    entries: tuple[str, ...]

    @property
    def cycle(self) -> tuple[BlockCost, ...]:
        """The costs of the blocks that a cycle runs."""
        return tuple(self.blocks[name] for name in self.entries)

    @property
    def parts(self) -> tuple[UnitPart, ...]:
        """What each unit does in a cycle, the slowest first; what several blocks call is one part."""
        found: dict[str, UnitPart] = {}
        for part in (part for block in self.cycle for part in block.parts):
            found[part.unit] = found[part.unit].and_for(part) if part.unit in found else part
        return tuple(sorted(found.values(), key=lambda part: -part.cold_us))

    @property
    def warm_us(self) -> float:
        return sum(block.warm_us for block in self.cycle)

    @property
    def cold_us(self) -> float:
        return sum(block.cold_us for block in self.cycle)

    @property
    def unbounded(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(text for block in self.cycle for text in block.unbounded))

    def fits(self, cycle_us: float) -> bool:
        """Whether a cycle with cold caches stays within a budget, with every loop bounded."""
        return not self.unbounded and self.cold_us <= cycle_us

    def as_json(self) -> dict[str, Any]:
        """The costs of a project as tables of numbers for JSON."""
        return {
            "profile": self.profile.name,
            "estimates": list(self.profile.estimates),
            "entries": list(self.entries),
            "warm_us": self.warm_us,
            "cold_us": self.cold_us,
            "bounded": not self.unbounded,
            "blocks": {name: block.as_json() for name, block in self.blocks.items()},
        }


def project_cost(
    project: t.Project, profile: Profile, entries: Iterable[str] | None = None, aside: Iterable[str] = ()
) -> ProjectCost:
    """The worst cases of a checked project. Paths are compared with cold caches, as that is what a cycle must bear.

    `entries` are the units that a cycle runs; without them all programs, or in a project without any all blocks that
    nobody calls. Programs and blocks of `aside`, and blocks that only libraries call (test suites), are none of these,
    and what they call they do not call in a cycle. Raises KeyError for an entry that the project does not have.
    """
    units = Units(project, profile)
    kinds = (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM)
    own = {key: pou for key, pou in project.pous.items() if pou.kind in kinds and not pou.is_native and pou.body}
    costs = {key: units.of(key) for key in own}
    blocks = {own[key].name: _block_cost(own[key], cost, units, profile) for key, cost in costs.items()}
    never = {name.upper() for name in aside}
    never |= {key for key in own if any(base.is_native for base in project.lineage(key))}  # those of libraries
    in_cycles = {key: pou for key, pou in own.items() if key not in never}
    programs = [pou.name for pou in in_cycles.values() if pou.kind is PouKind.PROGRAM]
    if entries is None and programs:
        chosen = programs
    elif entries is None:
        called = {key for own_key in in_cycles for key in costs[own_key].called}
        called |= {pou.base for pou in project.pous.values() if pou.base is not None}
        chosen = [pou.name for key, pou in in_cycles.items() if key not in called]
    else:
        chosen = [project.pous[name.upper()].name for name in entries]
    return ProjectCost(profile, blocks, tuple(chosen))


def _block_cost(pou: t.Pou, cost: UnitCost, units: Units, profile: Profile) -> BlockCost:
    worst = cost.cost.of_one_way()
    lines: dict[str, int] = {}
    for region, number in lines_by_region(worst.touches).items():
        lines[region.owner] = lines.get(region.owner, 0) + number
    waiting = _warm_wait(sum(lines.values()) * LINE, profile)
    keys = dict.fromkeys([pou.key, *worst.counts, *lines])
    parts = [_part(key, worst, lines.get(key, 0), waiting, units, profile) for key in keys]
    return BlockCost(pou.name, tuple(sorted(parts, key=lambda part: (-part.cold_us, part.unit))), cost.unbounded)


def _warm_wait(touched: int, profile: Profile) -> float:
    """Cycles to wait for each line when all that fits into the caches is there: none does that is used in a circle."""
    if touched <= profile.machine["l1_data_bytes"]:
        return 0.0
    return profile.machine["l2_cycles" if touched <= profile.machine["l2_bytes"] else "memory_cycles"]


def _part(key: str, cost: PathCost, lines: int, waiting: float, units: Units, profile: Profile) -> UnitPart:
    pou = units.project.pous.get(key)  # None: a list of globals
    counts, code = cost.counts.get(key, no_counts()), 0 if pou is None else units.of(key).code_bytes
    code_lines = min(cost.code.get(key, CodeLines()).number, -(-code // LINE))
    memory = profile.memory_factor
    warm = weighted(counts, profile.weights(is_cold=False)) + lines * waiting * memory
    cold = weighted(counts, profile.weights(is_cold=True))
    cold += (lines + code_lines) * profile.machine["memory_cycles"] * memory
    return UnitPart(
        key if pou is None else pou.full_name,
        as_mapping(counts),
        lines,
        code_lines,
        0 if pou is None else table_bytes(pou, units.project),
        code,
        profile.microseconds(warm),
        profile.microseconds(cold),
    )


def table_bytes(pou: t.Pou, project: t.Project) -> int:
    """Bytes of a unit's tables: its constant arrays."""
    tables = (v.type for v in pou.variables if v.is_constant and isinstance(v.type, ArrayType))
    return sum(size_of(table, project.pous) for table in tables)
