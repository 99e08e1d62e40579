"""The check of expressions: names become what they mean, every expression gets its type."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from st_codegen.errors import counted, meant
from st_codegen.st import tree as t
from st_codegen.st import types
from st_codegen.st.check import operators
from st_codegen.st.check.arithmetic import Fault
from st_codegen.st.check.calls import check_call
from st_codegen.st.check.coercion import coerce, settle
from st_codegen.st.check.constants import NotConstantError, evaluate
from st_codegen.st.check.names import Scope, through
from st_codegen.st.check.symbols import failure


class Expressions:
    """Checks the expressions of one unit. Every method raises `StCheckError` at the first error."""

    def __init__(self, scope: Scope) -> None:
        self.scope = scope
        self.rules = scope.rules

    # --- entry points ---

    def value(self, node: t.Expression) -> t.Expression:
        """Check an expression; a literal gets the type it has by itself."""
        return settle(self.check(node))

    def as_type(self, node: t.Expression, target: types.Type, is_stored: bool = False) -> t.Expression:
        """Check an expression that must be, or become, a value of a type."""
        return coerce(self.check(node), target, self.rules, is_stored)

    def condition(self, node: t.Expression) -> t.Expression:
        """Check an expression that must be BOOL."""
        expression = self.value(node)
        if expression.type != types.BOOL:
            raise failure(node, f"a condition is BOOL, not {expression.type}")
        return expression

    def constant(self, node: t.Expression, target: types.Type) -> t.Constant:
        """Check and compute an expression that must be a constant of a type."""
        expression = self.as_type(node, target, is_stored=True)
        try:
            value = evaluate(expression)
        except NotConstantError as error:
            raise failure(error.expression.position, "only constants are allowed here") from None
        except Fault as fault:
            raise failure(node, f"{fault.kind} in a constant") from None
        return t.Constant(value, type=target, position=node.position)

    def number(self, node: t.Expression) -> int:
        """Check and compute an integer constant of any type."""
        type_ = self.value(node).type
        if not type_.is_integer:
            raise failure(node, f"an integer constant is needed, not {type_}")
        return cast(int, self.constant(node, type_).value)

    def check(self, node: t.Expression) -> t.Expression:  # noqa: PLR0911, PLR0912 - one return a case
        """Check any expression; literals without a type stay so."""
        match node:
            case t.Literal():
                return self._literal(node)
            case t.EnumLiteral():
                return self._enum_literal(node)
            case t.Identifier():
                return self.scope.identifier(node)
            case t.Member():
                return self._member(node)
            case t.ElementRef():
                return self._element(node)
            case t.PointerTarget():
                return self._target(node)
            case t.Unary():
                return operators.unary(self.rules, node, self.check(node.operand))
            case t.Infix():
                return self._chain(node)
            case t.Call():
                call = self.call(node)
                if isinstance(call, t.Call) and not call.has_result:
                    raise failure(node, "this call has no result")
                return call
            case t.ThisRef():
                return self.scope.this(node)
            case t.Super():
                raise failure(node, "SUPER^ can only be called, or stand in front of a method")
            case _:
                raise TypeError(node)

    def call(self, node: t.Call) -> t.Expression:
        """Check a call, with a result or without."""
        return check_call(self.scope, node, self.check)

    def _chain(self, node: t.Infix) -> t.Expression:
        """Check a chain of operators of any length, from left to right."""
        pending: list[t.Infix] = []
        current: t.Expression = node
        while isinstance(current, t.Infix):
            pending.append(current)
            current = current.left
        result = self.check(current)
        for item in reversed(pending):
            result = operators.combine(self.rules, item.operator, result, self.check(item.right), item.position)
        return result

    # --- literals ---

    def _literal(self, node: t.Literal) -> t.Expression:
        kind, value, prefix = node.kind, node.value, node.type_name
        match kind:
            case t.LiteralKind.TIME | t.LiteralKind.LTIME:
                return self._duration(node)
            case t.LiteralKind.STRING | t.LiteralKind.WSTRING:
                type_ = types.string_type(len(cast(str, value)), kind is t.LiteralKind.WSTRING)
                if prefix not in (None, "STRING", "WSTRING"):
                    raise failure(node, f"a string is no {prefix}")
            case t.LiteralKind.BOOL:
                type_ = types.BOOL
                if prefix not in (None, "BOOL"):
                    raise failure(node, f"{value} is no {prefix}")
            case _:
                type_ = types.ANY_INT_LITERAL if kind is t.LiteralKind.INTEGER else types.ANY_REAL_LITERAL
        literal = t.Constant(value, type=type_, position=node.position)
        if prefix is None or not type_.is_untyped:
            return literal
        target = self.rules.types.get(prefix)
        if target is None or target.kind is types.Kind.TIME:
            raise failure(node, f"'{prefix}#' is no type of numbers")
        if target is types.BOOL and value in (0, 1):
            return replace(literal, type=types.BOOL, value=bool(value))
        if target.is_real:
            literal = replace(literal, type=types.ANY_REAL_LITERAL, value=float(value))
        return coerce(literal, target, self.rules)

    def _duration(self, node: t.Literal) -> t.Constant:
        type_ = self.rules.types["TIME" if node.kind is t.LiteralKind.TIME else "LTIME"]
        count, rest = divmod(cast(int, node.value), types.nanoseconds_per_unit(type_))
        if rest:
            raise failure(node, "TIME counts whole milliseconds here: use LTIME#")
        if not type_.holds(count):
            raise failure(node, f"this duration does not fit {type_}")
        return t.Constant(count, type=type_, position=node.position)

    def _enum_literal(self, node: t.EnumLiteral) -> t.Expression:
        type_ = self.scope.declared.find_type(node.type_name)
        if not isinstance(type_, types.EnumType):
            raise failure(node, f"'{node.type_name}#{node.name}': '{node.type_name}' is no enumeration")
        return self.scope.enum_value(type_, node.name, node)

    # --- paths ---

    def _member(self, node: t.Member) -> t.Expression:
        base: t.Expression | None = None
        if isinstance(node.base, t.Identifier) and self.scope.find_variable(node.base) is None:
            found = self.scope.namespace_member(node.base, node)
            if found is not None:
                return found
            base = self.scope.find_program(node.base)
        base = base or self.check(node.base)
        if isinstance(base.type, types.StructType):
            field = base.type.by_key.get(node.name.upper())
            if field is None:
                known = [entry.name for entry in base.type.fields]
                raise failure(node, f"'{base.type}' has no field '{node.name}'{meant(node.name, known)}")
            return through(t.FieldRef(base, node.name.upper(), type=field.type, position=node.position))
        if isinstance(base.type, types.BlockType):
            return self.scope.block_member(base, base.type, node)
        raise failure(node, f"{base.type} has no members")

    def _element(self, node: t.ElementRef) -> t.Expression:
        base = self.check(node.base)
        if not isinstance(base.type, types.ArrayType):
            raise failure(node, f"{base.type} is no array")
        bounds = base.type.bounds
        if len(node.indices) != len(bounds):
            raise failure(node, f"{base.type} has {counted(len(bounds), 'dimension')}, not {len(node.indices)}")
        indices = []
        for item, (low, high) in zip(node.indices, bounds, strict=True):
            index = self.value(item)
            if not index.type.is_integer:
                raise failure(item, f"an index is an integer, not {index.type}")
            if isinstance(index, t.Constant) and not low <= cast(int, index.value) <= high:
                raise failure(item, f"index {index.value} is outside of {low}..{high}")
            indices.append(index)
        return through(replace(node, base=base, indices=tuple(indices), type=base.type.element))

    def _target(self, node: t.PointerTarget) -> t.Expression:
        pointer = self.check(node.pointer)
        if not isinstance(pointer.type, types.PointerType) or pointer.type.target is None:
            raise failure(node, f"{pointer.type} cannot be dereferenced")
        return replace(node, pointer=pointer, type=pointer.type.target)
