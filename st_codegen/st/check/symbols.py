"""Which names a project has, and what each means at a given place."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from st_codegen.st import tree as t
from st_codegen.st.check.standard_names import is_standard_function
from st_codegen.st.dialects import Dialect
from st_codegen.st.errors import Position, Problem, StCheckError
from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.parser import reserved_words
from st_codegen.st.tree import PouKind, Section, Storage, Variable
from st_codegen.st.types import UNSUPPORTED


def failure(node: t.Node | Position, message: str) -> StCheckError:
    """An error at a node or position."""
    return StCheckError([Problem(node if isinstance(node, Position) else node.position, message)])


@contextmanager
def noted(problems: list[Problem]) -> Iterator[None]:
    """Note what is wrong in a block, and go on behind it."""
    try:
        yield
    except StCheckError as error:
        problems += error.problems


@dataclass
class Entry:
    """A declared name on its way to a `Variable`."""

    declaration: d.VariableDeclaration
    block: d.VariableBlock
    variable: Variable | None = None
    is_in_progress: bool = False
    has_failed: bool = False

    @property
    def section(self) -> Section:
        """The kind of VAR block that it is declared in."""
        return self.block.section

    @property
    def is_constant(self) -> bool:
        """Whether it is declared in a CONSTANT block."""
        return "CONSTANT" in self.block.qualifiers


@dataclass
class DeclaredUnit:
    """A program organisation unit, method or list of globals while it is being checked."""

    name: str
    key: str
    position: Position
    entries: dict[str, Entry]
    kind: PouKind | None = None
    declaration: d.PouDeclaration | None = None
    block: DeclaredUnit | None = None
    methods: dict[str, DeclaredUnit] = field(default_factory=dict)
    result: Variable | None = None
    attributes: tuple[str, ...] = ()
    is_native: bool = False

    @property
    def names(self) -> list[str]:
        """The names that the unit declares, as written."""
        return [entry.declaration.name for entry in self.entries.values()]

    @property
    def has_instance(self) -> bool:
        """Whether the variables of the unit live on after a call."""
        return self.kind in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM)

    @property
    def is_qualified_only(self) -> bool:
        """Whether the variables of a list need the list's name in front."""
        return "qualified_only" in self.attributes

    def storage(self, section: Section) -> Storage:
        """Where a variable of this unit lives."""
        if self.kind is None:
            return Storage.GLOBAL
        return Storage.INSTANCE if self.has_instance and section is not Section.TEMP else Storage.LOCAL


class Symbols:
    """All named things of a project; `problems` collects what is wrong with their names."""

    def __init__(
        self,
        dialect: Dialect,
        declarations: Iterable[d.Declaration],
        native: Iterable[d.Declaration],
        namespaces: Iterable[str] = (),
    ) -> None:
        self.dialect = dialect
        self.namespaces = frozenset(name.upper() for name in namespaces)
        self.problems: list[Problem] = []
        self.units: dict[str, DeclaredUnit] = {}
        self.lists: dict[str, DeclaredUnit] = {}
        self.types: dict[str, d.TypeDeclaration] = {}
        self.configurations: list[d.ConfigurationDeclaration] = []
        self._taken: dict[str, Position] = {}
        for declaration in native:
            self._add(declaration, is_native=True)
        for declaration in declarations:
            self._add(declaration, is_native=False)

    # --- collecting ---

    def _problem(self, position: Position, message: str) -> None:
        self.problems.append(Problem(position, message))

    def _add(self, declaration: d.Declaration, is_native: bool) -> None:
        key, where = declaration.name.upper(), declaration.position
        self._check_name(declaration.name, where, is_offered=is_native)
        if key in self._taken and not (isinstance(declaration, d.GlobalDeclarations) and key in self.lists):
            self._problem(where, f"'{declaration.name}' is declared already at {self._taken[key]}")
            return
        self._taken[key] = where
        if isinstance(declaration, d.GlobalDeclarations):
            known = self.lists.get(key)
            unit = DeclaredUnit(declaration.name, key, where, {}, attributes=declaration.attributes)
            self.lists[key] = known or unit
            self._add_entries(self.lists[key], declaration.blocks)
        elif isinstance(declaration, d.PouDeclaration):
            self.units[key] = self._unit(declaration, key, None, is_native)
        elif isinstance(declaration, d.ConfigurationDeclaration):
            self.configurations.append(declaration)
        else:
            self.types[key] = declaration
            for value in declaration.values if isinstance(declaration, d.EnumDeclaration) else ():
                self._check_name(value.name, value.position, is_offered="qualified_only" in declaration.attributes)

    def _unit(self, pou: d.PouDeclaration, key: str, block: DeclaredUnit | None, is_native: bool) -> DeclaredUnit:
        unit = DeclaredUnit(pou.name, key, pou.position, {}, pou.kind, pou, block, is_native=is_native)
        self._add_entries(unit, pou.blocks)
        for method in pou.methods:
            self._check_name(method.name, method.position, is_offered=True)
            name = method.name.upper()
            if name in unit.methods or name in unit.entries:
                self._problem(method.position, f"'{method.name}' is declared twice in '{pou.name}'")
            made = self._unit(method, f"{key}.{name}", unit, is_native)
            unit.methods[name] = made
            self.units[made.key] = made
        return unit

    def _add_entries(self, unit: DeclaredUnit, blocks: Iterable[d.VariableBlock]) -> None:
        for block in blocks:
            if (block.section is Section.GLOBAL) != (unit.kind is None):
                self._problem(block.position, f"{block.section.value} cannot stand in '{unit.name}'")
            for declaration in block.variables:
                self._check_name(declaration.name, declaration.position)
                key = declaration.name.upper()
                if key in unit.entries:
                    self._problem(declaration.position, f"'{declaration.name}' is declared twice in '{unit.name}'")
                unit.entries.setdefault(key, Entry(declaration, block))

    def _check_name(self, name: str, position: Position, is_offered: bool = False) -> None:
        """Note a name that has a meaning already; methods and what libraries offer may have that of a function."""
        key = name.upper()
        is_function = is_standard_function(key) and not is_offered
        if key in self.dialect.types or key in UNSUPPORTED or key in reserved_words() or is_function:
            self._problem(position, f"'{name}' is a word of the language and cannot be declared")

    # --- looking up ---

    def lineage(self, unit: DeclaredUnit) -> Iterator[DeclaredUnit]:
        """A block and what it extends, nearest first. Raises for an unknown base and for a circle."""
        seen: set[str] = set()
        current: DeclaredUnit | None = unit
        while current is not None:
            if current.key in seen:
                raise failure(current.position, f"'{current.name}' extends itself")
            seen.add(current.key)
            yield current
            base = current.declaration.base if current.declaration is not None else None
            if base is None:
                return
            found = self.units.get(base.upper().rpartition(".")[2])
            if found is None or found.kind is not PouKind.FUNCTION_BLOCK:
                raise failure(current.position, f"'{current.name}' extends '{base}', which is no known function block")
            current = found

    def find_entry(self, unit: DeclaredUnit, key: str) -> tuple[DeclaredUnit, Entry] | None:
        """What a plain name means inside a unit, as far as it is a variable."""
        if key in unit.entries:
            return unit, unit.entries[key]
        block = unit.block or unit
        if block.kind is PouKind.FUNCTION_BLOCK or unit.block is not None:
            for owner in self.lineage(block):
                entry = owner.entries.get(key)
                if entry is not None and (unit.block is None or entry.section is not Section.TEMP):
                    return owner, entry
        return self.find_global(key)

    def find_global(self, key: str) -> tuple[DeclaredUnit, Entry] | None:
        """A global variable by its plain name; None also when two lists have it."""
        found = [unit for unit in self.lists.values() if key in unit.entries and not unit.is_qualified_only]
        return (found[0], found[0].entries[key]) if len(found) == 1 else None

    def find_member(self, block: str, key: str) -> tuple[DeclaredUnit, Entry] | None:
        """A variable of an instance of a block by its upper-case name."""
        for owner in self.lineage(self.units[block.upper()]):
            if key in owner.entries:
                return owner, owner.entries[key]
        return None

    def find_method(self, block: str, key: str) -> DeclaredUnit | None:
        """A method of a block, inherited ones included."""
        for owner in self.lineage(self.units[block.upper()]):
            if key in owner.methods:
                return owner.methods[key]
        return None

    def known_names(self, unit: DeclaredUnit) -> set[str]:
        """Every variable name that a unit could use: to suggest one for a name that is not known."""
        is_inside = unit.block is not None or unit.kind is PouKind.FUNCTION_BLOCK
        blocks = self.lineage(unit.block or unit) if is_inside else ()
        return {name for owner in (unit, *blocks, *self.lists.values()) for name in owner.names}
