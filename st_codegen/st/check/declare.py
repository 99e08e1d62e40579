"""From declarations to types, variables and enumeration values; each is made when it is first asked for."""

from __future__ import annotations

from typing import cast

from st_codegen.st import tree as t
from st_codegen.st.check.expressions import Expressions
from st_codegen.st.check.initial import InitialValues
from st_codegen.st.check.names import Scope
from st_codegen.st.check.symbols import DeclaredUnit, Entry, Symbols, failure
from st_codegen.st.errors import StCheckError
from st_codegen.st.syntax import declarations as d
from st_codegen.st.tree import PouKind, Section, Variable
from st_codegen.st.types import (
    DEFAULT_STRING_LENGTH,
    UNSUPPORTED,
    ArrayType,
    BlockType,
    Elementary,
    EnumType,
    Field,
    Kind,
    PointerType,
    StructType,
    Type,
    Value,
    default_value,
    string_type,
)

MAX_ELEMENTS = 1 << 27
_OVERLAID = (Kind.BITS, Kind.SIGNED, Kind.UNSIGNED, Kind.REAL)


class Declarations:
    """Knows everything that is declared in a project; methods raise `StCheckError`."""

    def __init__(self, symbols: Symbols) -> None:
        self.symbols = symbols
        self._types: dict[str, Type] = {}
        self._in_progress: set[str] = set()
        self._defaults: dict[str, Value] = {}
        # Types and globals have no unit around them: only constants and enumerations are visible
        self._outside = DeclaredUnit("", "", t.Node().position, {})

    # --- types ---

    def find_type(self, name: str) -> Type | None:
        """The type of a name, None when there is none of that name."""
        key = name.upper()
        if key in self.symbols.dialect.types:
            return self.symbols.dialect.types[key]
        if key == "PVOID":
            return PointerType(None)
        if key in self._types:
            return self._types[key]
        if key in self.symbols.types:
            return self._declared_type(key)
        unit = self.symbols.units.get(key)
        if unit is not None and unit.kind in (PouKind.FUNCTION_BLOCK, PouKind.PROGRAM):
            return self.block_type(unit)
        return None

    def block_type(self, unit: DeclaredUnit) -> BlockType:
        """The type of the instances of a block or program."""
        ancestors = tuple(base.name for base in list(self.symbols.lineage(unit))[1:])
        return BlockType(unit.name, ancestors)

    def resolve(self, spec: d.TypeSpec, unit: DeclaredUnit) -> Type:
        """The type that a declaration in a unit asks for."""
        match spec:
            case d.NamedType():
                found = self.find_type(spec.name) or self.find_type(spec.name.rpartition(".")[2])
                if found is None:
                    supported = f"the type '{spec.name}' is not supported" if spec.name.upper() in UNSUPPORTED else None
                    raise failure(spec, supported or f"unknown type '{spec.name}'")
                if isinstance(found, BlockType) and self.symbols.units[found.name.upper()].kind is PouKind.PROGRAM:
                    raise failure(spec, f"'{spec.name}' is a program; there is only one of it")
                return found
            case d.StringSpec():
                length = DEFAULT_STRING_LENGTH if spec.length is None else self.expressions(unit).number(spec.length)
                if not 1 <= length <= 65535:
                    raise failure(spec, f"a string of {length} characters")
                return string_type(length, spec.wide)
            case d.ArraySpec():
                number = self.expressions(unit).number
                bounds = tuple((number(item.lower), number(item.upper)) for item in spec.ranges)
                element = self.resolve(spec.element, unit)
                array = ArrayType(element, bounds)
                if any(low > high for low, high in bounds):
                    raise failure(spec, f"{array}: a lower bound above the upper one")
                if array.size > MAX_ELEMENTS:
                    raise failure(spec, f"{array} has more than {MAX_ELEMENTS} elements")
                return array
            case d.SubrangeSpec():
                raise failure(
                    spec, f"subrange types are not supported, since controllers do not check them: use {spec.base}"
                )
            case d.PointerSpec():
                return PointerType(self.resolve(spec.target, unit), spec.is_reference)

    def expressions(self, unit: DeclaredUnit) -> Expressions:
        """What checks expressions as seen from a unit."""
        return Expressions(Scope(self, unit))

    def _initial(
        self, unit: DeclaredUnit, type_: Type, declaration: d.VariableDeclaration | d.AliasDeclaration
    ) -> Value:
        """The initial value of a declaration; without one that of its type, an alias included."""
        if declaration.initial is not None:
            return InitialValues(self.expressions(unit)).value(type_, declaration.initial)
        spec = declaration.type
        if isinstance(spec, d.NamedType) and spec.name.upper() in self._defaults:
            return self._defaults[spec.name.upper()]
        return default_value(type_)

    def _declared_type(self, key: str) -> Type:
        declaration = self.symbols.types[key]
        if key in self._in_progress:
            raise failure(declaration, f"the type '{declaration.name}' contains itself")
        self._in_progress.add(key)
        try:
            if isinstance(declaration, d.EnumDeclaration):
                self._types[key] = self._enum(declaration)
            elif isinstance(declaration, d.StructDeclaration):
                self._types[key] = self._struct(declaration)
            else:
                self._types[key] = self.resolve(declaration.type, self._outside)
                if declaration.initial is not None:
                    self._defaults[key] = self._initial(self._outside, self._types[key], declaration)
        finally:
            self._in_progress.discard(key)
        return self._types[key]

    def _enum(self, declaration: d.EnumDeclaration) -> EnumType:
        base = self.symbols.dialect.enum_base
        if declaration.base is not None:
            found = self.symbols.dialect.types.get(declaration.base)
            if found is None or not (found.is_integer or found.kind is Kind.BITS):
                raise failure(declaration, f"'{declaration.base}' cannot be the base of an enumeration")
            base = found
        expressions, following, values = self.expressions(self._outside), 0, list[tuple[str, int]]()
        for item in declaration.values:
            if item.value is not None:
                following = cast(int, expressions.constant(item.value, base).value)
            if not base.holds(following):
                raise failure(item, f"{following} does not fit {base}")
            if item.name.upper() in {name.upper() for name, _ in values}:
                raise failure(item, f"'{item.name}' is declared twice in '{declaration.name}'")
            values.append((item.name, following))
            following += 1
        default = values[0][1]
        if isinstance(declaration.default, t.Identifier):
            by_key = {name.upper(): number for name, number in values}
            if declaration.default.name.upper() not in by_key:
                raise failure(declaration.default, f"'{declaration.name}' has no value '{declaration.default.name}'")
            default = by_key[declaration.default.name.upper()]
        return EnumType(declaration.name, base, tuple(values), default)

    def _struct(self, declaration: d.StructDeclaration) -> StructType:
        fields: dict[str, Field] = {}
        if declaration.base is not None:
            base = self.find_type(declaration.base)
            if not isinstance(base, StructType) or base.is_union or declaration.is_union:
                raise failure(
                    declaration, f"'{declaration.name}' extends '{declaration.base}', which is no known structure"
                )
            fields = {entry.name.upper(): entry for entry in base.fields}
        for item in declaration.fields:
            type_ = self.resolve(item.type, self._outside)
            if item.name.upper() in fields:
                raise failure(item, f"'{item.name}' is declared twice in '{declaration.name}'")
            if declaration.is_union and not _can_overlay(type_):
                raise failure(item, f"{type_} in a union: only numbers and arrays of numbers can share memory")
            initial = self._initial(self._outside, type_, item)
            fields[item.name.upper()] = Field(item.name, type_, initial)
        if not fields:
            raise failure(declaration, f"'{declaration.name}' has no fields")
        return StructType(declaration.name, tuple(fields.values()), declaration.is_union)

    # --- enumeration values ---

    def find_enum_value(self, key: str) -> tuple[EnumType, int] | None:
        """An enumeration value by its plain name; None also when two enumerations have it."""
        found = []
        for name, declaration in self.symbols.types.items():
            if not isinstance(declaration, d.EnumDeclaration) or "qualified_only" in declaration.attributes:
                continue
            if any(value.name.upper() == key for value in declaration.values) and name not in self._in_progress:
                type_ = cast(EnumType, self.find_type(name))
                found.append((type_, type_.by_key[key]))
        return found[0] if len(found) == 1 else None

    # --- variables ---

    def variable(self, unit: DeclaredUnit, entry: Entry) -> Variable:
        """The variable that a declaration in a unit makes."""
        declaration = entry.declaration
        if entry.variable is not None:
            return entry.variable
        if entry.is_in_progress:
            raise failure(declaration, f"'{declaration.name}' is needed to declare itself")
        if entry.has_failed:
            # Its own error was reported where it is declared
            raise StCheckError([])
        entry.is_in_progress = True
        try:
            entry.variable = self._make_variable(unit, entry)
        except StCheckError:
            entry.has_failed = True
            raise
        finally:
            entry.is_in_progress = False
        return entry.variable

    def _make_variable(self, unit: DeclaredUnit, entry: Entry) -> Variable:
        declaration, section = entry.declaration, entry.section
        type_ = self.resolve(declaration.type, unit)
        if section is Section.IN_OUT and declaration.initial is not None:
            raise failure(declaration, f"'{declaration.name}': VAR_IN_OUT has no initial value")
        if entry.is_constant and (isinstance(type_, BlockType) or section is Section.IN_OUT):
            raise failure(declaration, f"'{declaration.name}' cannot be CONSTANT")
        self._check_instance(unit, section, declaration, type_)
        return Variable(
            declaration.name,
            type_,
            section,
            unit.storage(section),
            unit.key,
            None if section is Section.IN_OUT else self._initial(unit, type_, declaration),
            declaration.position,
            is_constant=entry.is_constant,
            has_initial=declaration.initial is not None,
        )

    def _check_instance(
        self, unit: DeclaredUnit, section: Section, declaration: d.VariableDeclaration, type_: Type
    ) -> None:
        while isinstance(type_, ArrayType):
            type_ = type_.element
        is_lasting = unit.kind is None or (unit.has_instance and section is not Section.TEMP)
        if isinstance(type_, BlockType) and not is_lasting and section is not Section.IN_OUT:
            raise failure(declaration, f"'{declaration.name}': an instance of '{type_}' would not outlive the call")

    def result(self, unit: DeclaredUnit) -> Variable | None:
        """The result of a function or method, as a variable of its name."""
        declaration = unit.declaration
        if unit.result is not None or declaration is None or declaration.return_type is None:
            return unit.result
        type_ = self.resolve(declaration.return_type, unit)
        if isinstance(type_, BlockType):
            raise failure(declaration, f"'{unit.name}' cannot return an instance of '{type_}'")
        initial = default_value(type_)
        storage = unit.storage(Section.RESULT)
        unit.result = Variable(unit.name, type_, Section.RESULT, storage, unit.key, initial, unit.position)
        return unit.result


def _can_overlay(type_: Type) -> bool:
    while isinstance(type_, ArrayType):
        type_ = type_.element
    return isinstance(type_, Elementary) and type_.kind in _OVERLAID
