"""Initial values: from what a declaration says to the value of every element."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from st_codegen.errors import counted
from st_codegen.st import tree as t
from st_codegen.st import types
from st_codegen.st.check.expressions import Expressions
from st_codegen.st.check.symbols import failure
from st_codegen.st.syntax import declarations as d


class InitialValues:
    """Evaluates initial values as seen from one unit. Methods raise `StCheckError`."""

    def __init__(self, expressions: Expressions) -> None:
        self._expressions = expressions
        self._declared = expressions.scope.declared
        self._rules = expressions.rules

    def value(self, type_: types.Type, node: d.Initial) -> types.Value:
        """The value that an initialiser gives to a variable of a type."""
        if isinstance(type_, types.ArrayType):
            return self._array(type_, node)
        if isinstance(type_, types.StructType | types.BlockType):
            if not isinstance(node, d.StructInitial):
                return self._copied(type_, node)
            return self._struct(type_, node) if isinstance(type_, types.StructType) else self._block(type_, node)
        if isinstance(node, d.NumberTable | d.ArrayInitial | d.StructInitial):
            raise failure(node, f"{type_} has a single value")
        if isinstance(type_, types.PointerType):
            raise failure(node, "pointers and references have no initial value here: assign them")
        return self._expressions.constant(node, type_).value

    def _copied(self, type_: types.Type, node: d.Initial) -> types.Value:
        """The value of another constant of the same type."""
        if isinstance(node, t.Identifier | t.Member):
            source = self._expressions.check(node)
            variable = getattr(source, "variable", None)
            if source.type == type_ and variable is not None and variable.is_constant:
                return cast(types.Value, variable.initial)
        raise failure(node, f"this is no initial value of {type_}")

    def _array(self, type_: types.ArrayType, node: d.Initial) -> types.Value:
        if isinstance(node, d.NumberTable):
            return self._table(type_, node)
        if not isinstance(node, d.ArrayInitial):
            return self._copied(type_, node)
        flat: list[types.Value] = []
        is_elementary = isinstance(type_.element, types.Elementary | types.EnumType)
        for item in node.items:
            count, initial = (item.count, item.value) if isinstance(item, d.Repeated) else (1, item)
            if len(flat) + count > type_.size:
                raise failure(item, f"{type_} has {counted(type_.size, 'element')}; this initialiser goes beyond them")
            value = types.default_value(type_.element) if initial is None else self.value(type_.element, initial)
            flat += [value] * count
        self._check_count(type_, len(flat), node)
        flat += [types.default_value(type_.element)] * (type_.size - len(flat))
        if not is_elementary:
            return flat
        table = np.array(flat, dtype=types.storage_type(type_.element).dtype)
        table.flags.writeable = False
        return table

    def _check_count(self, type_: types.ArrayType, count: int, node: t.Node) -> None:
        if not self._rules.has_partial_initialisers and count < type_.size:
            raise failure(
                node, f"{type_} has {counted(type_.size, 'element')}, and only {counted(count, 'initial value')}"
            )

    def _table(self, type_: types.ArrayType, node: d.NumberTable) -> types.Value:
        count = node.values.size
        if count > type_.size:
            raise failure(node, f"{type_} has {counted(type_.size, 'element')}; this initialiser has {count}")
        self._check_count(type_, count, node)
        if not isinstance(type_.element, types.Elementary):
            if isinstance(type_.element, types.ArrayType):
                raise failure(node, "an array of arrays is initialised row by row: [[..], [..]]")
            raise failure(node, f"numbers cannot initialise {type_.element}")
        values = self._converted(type_.element, node)
        if count == type_.size:
            return values
        table = np.array(types.filled_array(type_, types.default_value(type_.element)))
        table[:count] = values
        table.flags.writeable = False
        return table

    def _converted(self, element: types.Elementary, node: d.NumberTable) -> NDArray[np.generic]:
        """The numbers of a table in the type of the array, by the rules for single literals."""
        kind, values = node.kind, node.values
        is_loose = self._rules.has_loose_literals
        if kind is d.TableKind.BOOL or element.kind is types.Kind.BOOL:
            zero_one = is_loose and kind is d.TableKind.INTEGER and bool(np.isin(values, (0, 1)).all())
            if element.kind is not types.Kind.BOOL or not (kind is d.TableKind.BOOL or zero_one):
                raise failure(node, f"a table of {kind.value} literals cannot initialise {element}")
        elif element.is_integral and element.kind is not types.Kind.TIME:
            if kind is not d.TableKind.INTEGER:
                raise failure(node, f"a table of {kind.value} literals cannot initialise {element}")
            low, high = int(values.min()), int(values.max())
            for value in (low, high):
                if not element.holds(value):
                    raise failure(node, f"{value} does not fit {element} ({element.lower}..{element.upper})")
        elif not element.is_real:
            raise failure(node, f"numbers cannot initialise {element}")
        elif kind is not d.TableKind.REAL and not is_loose:
            raise failure(
                node, f"a table of {kind.value} literals cannot initialise {element}: write a dot in every number"
            )
        with np.errstate(over="ignore"):
            converted = values.astype(element.dtype)
        if element is types.REAL and not np.isfinite(converted).all():
            raise failure(node, "a number of this table is larger than the largest REAL")
        converted.flags.writeable = False
        return converted

    def _struct(self, type_: types.StructType, node: d.StructInitial) -> types.Value:
        values: dict[str, types.Value] = {entry.name.upper(): entry.initial for entry in type_.fields}
        given: dict[str, types.Value] = {}
        for member in node.members:
            key = member.name.upper()
            if key not in type_.by_key:
                raise failure(member, f"'{type_}' has no field '{member.name}'")
            if key in given:
                raise failure(member, f"'{member.name}' is given twice")
            given[key] = self.value(type_.by_key[key].type, member.value)
        # In a union what is written last stays
        return {**{key: value for key, value in values.items() if key not in given}, **given}

    def _block(self, type_: types.BlockType, node: d.StructInitial) -> types.Value:
        given: dict[str, types.Value] = {}
        for member in node.members:
            found = self._declared.symbols.find_member(type_.name, member.name.upper())
            if found is None:
                raise failure(member, f"'{type_}' has no variable '{member.name}'")
            variable = self._declared.variable(*found)
            if variable.is_constant or variable.section.value in ("VAR_IN_OUT", "VAR_TEMP"):
                raise failure(member, f"'{member.name}' of '{type_}' cannot be initialised")
            given[member.name.upper()] = self.value(variable.type, member.value)
        return given
