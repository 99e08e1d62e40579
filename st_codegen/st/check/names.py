"""What names mean inside of one unit."""

from __future__ import annotations

from typing import Protocol

from st_codegen.errors import meant
from st_codegen.st import tree as t
from st_codegen.st.check.symbols import DeclaredUnit, Entry, Symbols, failure
from st_codegen.st.tree import PouKind
from st_codegen.st.types import BlockType, EnumType, PointerType, Type


class Declared(Protocol):
    """What the names of a project stand for; each is worked out when it is first asked for."""

    symbols: Symbols

    def find_type(self, name: str) -> Type | None:
        """The type of a name, None when there is none of that name."""

    def block_type(self, unit: DeclaredUnit) -> BlockType:
        """The type of the instances of a block or program."""

    def find_enum_value(self, key: str) -> tuple[EnumType, int] | None:
        """An enumeration value by its plain name; None also when two enumerations have it."""

    def variable(self, unit: DeclaredUnit, entry: Entry) -> t.Variable:
        """The variable that a declaration in a unit makes."""

    def result(self, unit: DeclaredUnit) -> t.Variable | None:
        """The result of a function or method, as a variable of its name."""


class Scope:
    """The names that the text of one unit can use; methods raise `StCheckError` at the first error."""

    def __init__(self, declared: Declared, unit: DeclaredUnit) -> None:
        self.declared = declared
        self.symbols = declared.symbols
        self.rules = declared.symbols.dialect
        self.unit = unit
        self.block = unit.block or unit
        #: The counters of the FOR loops around what is being checked.
        self.counters: list[t.Variable] = []

    def find_variable(self, node: t.Identifier) -> t.Variable | None:
        """The variable that a plain name means here; None if it is none."""
        key, unit = node.name.upper(), self.unit
        if unit.result is not None and key == unit.name.upper():
            return unit.result
        found = self.symbols.find_entry(unit, key)
        if found is None:
            return None
        owner, entry = found
        variable = self.declared.variable(owner, entry)
        if unit.block is not None and owner is not unit and variable.section is t.Section.IN_OUT:
            raise failure(
                node, f"a method cannot use '{node.name}': VAR_IN_OUT of a block exists only while the block is called"
            )
        return variable

    def identifier(self, node: t.Identifier) -> t.Expression:
        """A variable or enumeration value by its plain name."""
        variable = self.find_variable(node)
        if variable is not None:
            return reference(variable, node)
        value = self.declared.find_enum_value(node.name.upper())
        if value is None:
            known = self.symbols.known_names(self.unit)
            raise failure(node, f"unknown name '{node.name}'{meant(node.name, known)}")
        return t.Constant(value[1], type=value[0], position=node.position)

    def this(self, node: t.Node) -> t.ThisRef:
        """The instance that a body or method runs on."""
        if self.block.kind is not PouKind.FUNCTION_BLOCK:
            raise failure(node, "THIS^ and SUPER^ exist only in function blocks and their methods")
        return t.ThisRef(type=self.declared.block_type(self.block), position=node.position)

    def find_program(self, node: t.Identifier) -> t.ProgramRef | None:
        """The program of a name, None when there is none of that name."""
        unit = self.symbols.units.get(node.name.upper())
        if unit is None or unit.kind is not PouKind.PROGRAM:
            return None
        return t.ProgramRef(type=self.declared.block_type(unit), position=node.position)

    def enum_value(self, type_: EnumType, name: str, node: t.Node) -> t.Constant:
        """A value of an enumeration by its name."""
        if name.upper() not in type_.by_key:
            hint = meant(name, (known for known, _ in type_.values))
            raise failure(node, f"'{type_.name}' has no value '{name}'{hint}")
        return t.Constant(type_.by_key[name.upper()], type=type_, position=node.position)

    def namespace_member(self, base: t.Identifier, node: t.Member) -> t.Expression | None:
        """`GVL_X.nY` and `E_X.Value`; None where the name in front is that of no list and no enumeration."""
        unit = self.symbols.lists.get(base.name.upper())
        if unit is not None:
            entry = unit.entries.get(node.name.upper())
            if entry is None:
                raise failure(node, f"'{unit.name}' has no variable '{node.name}'{meant(node.name, unit.names)}")
            return reference(self.declared.variable(unit, entry), node)
        type_ = self.declared.find_type(base.name) if base.name.upper() in self.symbols.types else None
        return self.enum_value(type_, node.name, node) if isinstance(type_, EnumType) else None

    def block_member(self, base: t.Expression, block: BlockType, node: t.Member) -> t.Expression:
        """A variable of an instance of a block or of a program."""
        found = self.symbols.find_member(block.name, node.name.upper())
        if found is None:
            owners = self.symbols.lineage(self.symbols.units[block.name.upper()])
            known = [name for owner in owners for name in owner.names]
            raise failure(node, f"'{block}' has no variable '{node.name}'{meant(node.name, known)}")
        variable = self.declared.variable(*found)
        is_open = variable.section in (t.Section.INPUT, t.Section.OUTPUT) or isinstance(base, t.ThisRef)
        is_open |= isinstance(base, t.ProgramRef) and self.rules.has_open_programs
        if not is_open or variable.storage is not t.Storage.INSTANCE:
            raise failure(
                node, f"'{node.name}' of '{block}' is {variable.section.value} and cannot be read from outside"
            )
        if isinstance(base, t.ThisRef):
            return reference(variable, node)
        return through(t.InstanceVariable(base, variable, type=variable.type, position=node.position))


def reference(variable: t.Variable, node: t.Node) -> t.Expression:
    """An expression for a variable, at the position of the node that names it."""
    return through(t.VariableRef(variable, type=variable.type, position=node.position))


def through(expression: t.Expression) -> t.Expression:
    """What an expression stands for: a REFERENCE TO stands for what it refers to."""
    type_ = expression.type
    if isinstance(type_, PointerType) and type_.is_reference and type_.target is not None:
        return t.PointerTarget(expression, type=type_.target, position=expression.position)
    return expression
