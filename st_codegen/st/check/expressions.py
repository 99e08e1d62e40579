"""The check of expressions: names become what they mean, every expression gets its type."""

from __future__ import annotations

from dataclasses import replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, cast

from st_codegen.st import tree as t
from st_codegen.st.check.arithmetic import Fault
from st_codegen.st.check.coercion import coerce, conversion, is_wrapping_operator, settle, unify
from st_codegen.st.check.constants import NotConstantError, binary, evaluate
from st_codegen.st.check.symbols import Unit, failure
from st_codegen.st.tree import PouKind
from st_codegen.st.types import (
    ANY_INT_LITERAL,
    ANY_REAL_LITERAL,
    BOOL,
    DINT,
    LINT,
    LREAL,
    ArrayType,
    BlockType,
    Dialect,
    Elementary,
    EnumType,
    Kind,
    PointerType,
    StructType,
    Type,
    nanoseconds_per_unit,
    string_type,
)

if TYPE_CHECKING:
    from st_codegen.st.check.declare import Declarations

_ARITHMETIC = {"ADD", "SUB", "MUL", "DIV", "MOD"}
_COMPARISONS = {"EQ", "NE", "LT", "LE", "GT", "GE"}
_LOGIC = {"AND", "OR", "XOR"}
_SIGNS = {"NEG": "-", "POS": "+", "NOT": "NOT"}
_UNSIGNED = {8: "USINT", 16: "UINT", 32: "UDINT", 64: "ULINT"}


class Expressions:
    """Checks the expressions of one unit. Every method raises `StCheckError` at the first error."""

    def __init__(self, declarations: Declarations, unit: Unit) -> None:
        self.declarations = declarations
        self.symbols = declarations.symbols
        self.dialect = self.symbols.dialect
        self.unit = unit
        self.counters: list[t.Variable] = []

    # --- entry points ---

    def value(self, node: t.Expression) -> t.Expression:
        """An expression with a type of its own."""
        return settle(self.check(node))

    def as_type(self, node: t.Expression, target: Type, is_stored: bool = False) -> t.Expression:
        """An expression as a value of a type."""
        return coerce(self.check(node), target, self.dialect, is_stored)

    def condition(self, node: t.Expression) -> t.Expression:
        """A BOOL expression."""
        expression = self.value(node)
        if expression.type != BOOL:
            raise failure(node, f"a condition is BOOL, not {expression.type}")
        return expression

    def constant(self, node: t.Expression, target: Type) -> t.Constant:
        """A constant of a type."""
        expression = self.as_type(node, target, is_stored=True)
        try:
            value = evaluate(expression)
        except NotConstantError as error:
            raise failure(error.expression.position, "only constants are allowed here") from None
        except Fault as fault:
            raise failure(node, f"{fault.kind} in a constant") from None
        return t.Constant(value, type=target, position=node.position)

    def check(self, node: t.Expression) -> t.Expression:  # noqa: PLR0911, PLR0912 - one return a case
        """Any expression; literals without a type stay so."""
        match node:
            case t.Literal():
                return self._literal(node)
            case t.EnumLiteral():
                return self._enum_literal(node)
            case t.Identifier():
                return self._identifier(node)
            case t.Member():
                return self._member(node)
            case t.ElementRef():
                return self._subscript(node)
            case t.PointerTarget():
                return self._dereference(node)
            case t.Unary():
                return self._unary(node)
            case t.Infix():
                return self._chain(node)
            case t.Call():
                from st_codegen.st.check.calls import check_call

                call = check_call(self, node)
                if isinstance(call, t.Call) and not call.has_result:
                    raise failure(node, "this call has no result")
                return call
            case t.ThisRef():
                return self.this(node)
            case t.Super():
                raise failure(node, "SUPER^ can only be called, or stand in front of a method")
            case _:
                raise TypeError(node)

    # --- literals and names ---

    def _literal(self, node: t.Literal) -> t.Expression:  # noqa: PLR0911 - one return a case
        kind, value, where = node.kind, node.value, node.position
        if kind in (t.LiteralKind.TIME, t.LiteralKind.LTIME):
            return self._duration(node)
        if kind in (t.LiteralKind.STRING, t.LiteralKind.WSTRING):
            if node.type_name not in (None, "STRING", "WSTRING"):
                raise failure(node, f"a string is no {node.type_name}")
            return t.Constant(
                value, type=string_type(len(cast(str, value)), kind is t.LiteralKind.WSTRING), position=where
            )
        if kind is t.LiteralKind.BOOL:
            if node.type_name not in (None, "BOOL"):
                raise failure(node, f"{value} is no {node.type_name}")
            return t.Constant(value, type=BOOL, position=where)
        untyped = ANY_INT_LITERAL if kind is t.LiteralKind.INTEGER else ANY_REAL_LITERAL
        literal = t.Constant(value, type=untyped, position=where)
        if node.type_name is None:
            return literal
        target = self.symbols.elementary.get(node.type_name)
        if target is None or target.kind is Kind.TIME:
            raise failure(node, f"'{node.type_name}#' is no type of numbers")
        if target is BOOL and value in (0, 1):
            return replace(literal, type=BOOL, value=bool(value))
        if target.is_real and kind is t.LiteralKind.INTEGER:
            return coerce(replace(literal, type=ANY_REAL_LITERAL, value=float(value)), target, self.dialect)
        return coerce(literal, target, self.dialect)

    def _duration(self, node: t.Literal) -> t.Constant:
        type_ = self.symbols.elementary["TIME" if node.kind is t.LiteralKind.TIME else "LTIME"]
        unit = nanoseconds_per_unit(type_)
        count, rest = divmod(cast(int, node.value), unit)
        if rest:
            raise failure(node, "TIME counts whole milliseconds here: use LTIME#")
        if not type_.holds(count):
            raise failure(node, f"this duration does not fit {type_}")
        return t.Constant(count, type=type_, position=node.position)

    def _enum_literal(self, node: t.EnumLiteral) -> t.Expression:
        type_ = self.declarations.find_type(node.type_name)
        if not isinstance(type_, EnumType):
            raise failure(node, f"'{node.type_name}#{node.name}': '{node.type_name}' is no enumeration")
        return self._enum_value(type_, node.name, node)

    def _enum_value(self, type_: EnumType, name: str, node: t.Node) -> t.Constant:
        if name.upper() not in type_.by_key:
            raise failure(
                node, f"'{type_.name}' has no value '{name}'{_suggest(name, [known for known, _ in type_.values])}"
            )
        return t.Constant(type_.by_key[name.upper()], type=type_, position=node.position)

    def _identifier(self, node: t.Identifier) -> t.Expression:
        variable = self.find_variable(node.name, node)
        if variable is not None:
            expression = t.VariableRef(variable, type=variable.type, position=node.position)
            return self._through_reference(expression)
        value = self.declarations.find_enum_value(node.name.upper())
        if value is not None:
            return t.Constant(value[1], type=value[0], position=node.position)
        known = self.symbols.known_names(self.unit)
        raise failure(node, f"unknown name '{node.name}'{_suggest(node.name, known)}")

    def find_variable(self, name: str, node: t.Node) -> t.Variable | None:
        """The variable that a plain name means here; None if it is none."""
        key, unit = name.upper(), self.unit
        if unit.result is not None and key == unit.name.upper():
            return unit.result
        found = self.symbols.find_entry(unit, key)
        if found is None:
            return None
        owner, entry = found
        variable = self.declarations.variable(owner, entry)
        if unit.block is not None and owner is not unit and variable.section is t.Section.IN_OUT:
            raise failure(
                node, f"a method cannot use '{name}': VAR_IN_OUT of a block exists only while the block is called"
            )
        return variable

    def this(self, node: t.Node) -> t.ThisRef:
        """THIS^ inside a block or its methods."""
        block = self.unit.block or self.unit
        if block.kind is not PouKind.FUNCTION_BLOCK:
            raise failure(node, "THIS^ and SUPER^ exist only in function blocks and their methods")
        return t.ThisRef(type=self.declarations.block_type(block), position=node.position)

    # --- paths ---

    def _through_reference(self, expression: t.Expression) -> t.Expression:
        """A REFERENCE TO stands for what it refers to."""
        if (
            isinstance(expression.type, PointerType)
            and expression.type.is_reference
            and expression.type.target is not None
        ):
            return t.PointerTarget(expression, type=expression.type.target, position=expression.position)
        return expression

    def _member(self, node: t.Member) -> t.Expression:
        if isinstance(node.base, t.Identifier) and self.find_variable(node.base.name, node.base) is None:
            found = self._namespace(node.base, node)
            if found is not None:
                return found
        base = self.check(node.base)
        key = node.name.upper()
        if isinstance(base.type, StructType):
            if key not in base.type.by_key:
                known = [entry.name for entry in base.type.fields]
                raise failure(node, f"'{base.type}' has no field '{node.name}'{_suggest(node.name, known)}")
            field = t.FieldRef(base, key, type=base.type.by_key[key].type, position=node.position)
            return self._through_reference(field)
        if isinstance(base.type, BlockType):
            return self._block_member(base, base.type, node)
        raise failure(node, f"{base.type} has no members")

    def _block_member(self, base: t.Expression, block: BlockType, node: t.Member) -> t.Expression:
        found = self.symbols.find_member(block.name, node.name.upper())
        if found is None:
            owners = self.symbols.lineage(self.symbols.units[block.name.upper()])
            known = [entry.declaration.name for owner in owners for entry in owner.entries.values()]
            raise failure(node, f"'{block}' has no variable '{node.name}'{_suggest(node.name, known)}")
        variable = self.declarations.variable(*found)
        is_program = isinstance(base, t.ProgramRef) and self.dialect is Dialect.TWINCAT
        is_open = variable.section in (t.Section.INPUT, t.Section.OUTPUT) or isinstance(base, t.ThisRef) or is_program
        if not is_open or variable.storage is not t.Storage.INSTANCE:
            raise failure(
                node, f"'{node.name}' of '{block}' is {variable.section.value} and cannot be read from outside"
            )
        if isinstance(base, t.ThisRef):
            return self._through_reference(t.VariableRef(variable, type=variable.type, position=node.position))
        return self._through_reference(t.InstanceVariable(base, variable, type=variable.type, position=node.position))

    def _namespace(self, base: t.Identifier, node: t.Member) -> t.Expression | None:
        """`GVL_X.nY`, `E_X.Value` and `PRG_Main.nY`."""
        key = base.name.upper()
        if key in self.symbols.lists:
            unit = self.symbols.lists[key]
            entry = unit.entries.get(node.name.upper())
            if entry is None:
                known = [other.declaration.name for other in unit.entries.values()]
                raise failure(node, f"'{unit.name}' has no variable '{node.name}'{_suggest(node.name, known)}")
            variable = self.declarations.variable(unit, entry)
            return self._through_reference(t.VariableRef(variable, type=variable.type, position=node.position))
        if key in self.symbols.types:
            type_ = self.declarations.find_type(base.name)
            if isinstance(type_, EnumType):
                return self._enum_value(type_, node.name, node)
        program = self.program(base)
        if program is not None:
            return self._block_member(program, cast(BlockType, program.type), node)
        return None

    def program(self, node: t.Identifier) -> t.ProgramRef | None:
        """The program of a name."""
        unit = self.symbols.units.get(node.name.upper())
        if unit is None or unit.kind is not PouKind.PROGRAM:
            return None
        return t.ProgramRef(type=self.declarations.block_type(unit), position=node.position)

    def _subscript(self, node: t.ElementRef) -> t.Expression:
        base = self.check(node.base)
        if not isinstance(base.type, ArrayType):
            raise failure(node, f"{base.type} is no array")
        bounds = base.type.bounds
        if len(node.indices) != len(bounds):
            raise failure(node, f"{base.type} has {len(bounds)} dimensions, not {len(node.indices)}")
        indices = []
        for item, (low, high) in zip(node.indices, bounds, strict=True):
            index = settle(self.check(item))
            if not isinstance(index.type, Elementary) or not index.type.is_integer:
                raise failure(item, f"an index is an integer, not {index.type}")
            if isinstance(index, t.Constant) and not low <= cast(int, index.value) <= high:
                raise failure(item, f"index {index.value} is outside of {low}..{high}")
            indices.append(index)
        element = replace(node, base=base, indices=tuple(indices), type=base.type.element)
        return self._through_reference(element)

    def _dereference(self, node: t.PointerTarget) -> t.Expression:
        pointer = self.check(node.pointer)
        if not isinstance(pointer.type, PointerType) or pointer.type.target is None:
            raise failure(node, f"{pointer.type} cannot be dereferenced")
        return replace(node, pointer=pointer, type=pointer.type.target)

    # --- operators ---

    def _unary(self, node: t.Unary) -> t.Expression:
        operand = self.check(node.operand)
        type_ = operand.type
        if not isinstance(type_, Elementary):
            raise failure(node, f"no {_SIGNS[node.operator]} of {type_}")
        if node.operator == "NOT":
            is_bits = type_.kind is Kind.BITS or (type_.is_integer and self.dialect is Dialect.TWINCAT)
            if type_ is not BOOL and not is_bits:
                raise failure(node, f"no NOT of {type_}")
            return replace(node, operand=operand, type=type_)
        if not (type_.is_integer or type_.is_real or type_.is_untyped):
            raise failure(node, f"no sign in front of {type_}")
        if node.operator == "POS":
            return operand
        if type_.is_untyped and isinstance(operand, t.Constant):
            return replace(operand, value=-cast(float, operand.value), position=node.position)
        overflow = t.Overflow.ERROR if is_wrapping_operator("SUB", type_) else t.Overflow.WRAP
        return replace(node, operand=operand, overflow=overflow, type=type_)

    def _chain(self, node: t.Infix) -> t.Expression:
        """A chain of operators of any length, from left to right."""
        pending: list[t.Infix] = []
        current: t.Expression = node
        while isinstance(current, t.Infix):
            pending.append(current)
            current = current.left
        result = self.check(current)
        for item in reversed(pending):
            result = self.combine(item.operator, result, self.check(item.right), item)
        return result

    def combine(self, operator: str, left: t.Expression, right: t.Expression, node: t.Node) -> t.Expression:
        """`left operator right`."""
        if operator in _ARITHMETIC:
            return self._arithmetic(operator, left, right, node)
        if operator in _COMPARISONS:
            return self._comparison(operator, left, right, node)
        if operator in _LOGIC:
            return self._logic(operator, left, right, node)
        if operator == "EXPT":
            return self.power(left, right, node)
        if left.type != BOOL or right.type != BOOL:
            raise failure(node, f"{operator} needs BOOL on both sides, not {left.type} and {right.type}")
        return t.ShortCircuit(operator, left, right, type=BOOL, position=node.position)

    def _arithmetic(self, operator: str, left: t.Expression, right: t.Expression, node: t.Node) -> t.Expression:
        left_type = left.type
        if isinstance(left_type, Elementary) and left_type.kind is Kind.TIME and operator in ("MUL", "DIV"):
            factor = settle(right)
            if (
                not isinstance(factor.type, Elementary)
                or not factor.type.is_integer
                or not DINT.holds(factor.type.upper)
            ):
                raise failure(
                    node, f"a duration is multiplied and divided by integers up to DINT, not by {factor.type}"
                )
            return self._operation(operator, left_type, left, conversion(factor, DINT, is_implicit=True), node)
        left, right, type_ = unify(self._number(left), self._number(right), self.dialect)
        allowed = type_.is_integer or type_.is_untyped or (type_.kind is Kind.TIME and operator in ("ADD", "SUB"))
        if not allowed and not (type_.is_real and operator != "MOD"):
            raise failure(node, f"no {operator} of {type_}")
        if operator == "MOD" and type_ is ANY_REAL_LITERAL:
            raise failure(node, "MOD is for integers")
        if isinstance(left, t.Constant) and isinstance(right, t.Constant) and type_.is_untyped:
            return self._fold(operator, type_, left, right, node)
        return self._operation(operator, type_, left, right, node)

    def _operation(
        self, operator: str, type_: Elementary, left: t.Expression, right: t.Expression, node: t.Node
    ) -> t.Binary:
        overflow = t.Overflow.ERROR if is_wrapping_operator(operator, type_) else t.Overflow.WRAP
        return t.Binary(operator, left, right, overflow, type=type_, position=node.position)

    def _number(self, operand: t.Expression) -> t.Expression:
        """In TwinCAT a bit string counts as an unsigned integer in arithmetic."""
        type_ = operand.type
        if isinstance(type_, Elementary) and type_.kind is Kind.BITS and self.dialect is Dialect.TWINCAT:
            return conversion(operand, self.symbols.elementary[_UNSIGNED[type_.bits]], is_implicit=True)
        return operand

    def _fold(self, operator: str, type_: Elementary, left: t.Constant, right: t.Constant, node: t.Node) -> t.Constant:
        computed_as = LREAL if type_ is ANY_REAL_LITERAL else LINT
        try:
            value = binary(operator, computed_as, t.Overflow.ERROR, left.value, right.value)
        except Fault as fault:
            raise failure(node, f"{fault.kind} in a constant") from None
        return t.Constant(value, type=type_, position=node.position)

    def _logic(self, operator: str, left: t.Expression, right: t.Expression, node: t.Node) -> t.Expression:
        if left.type == BOOL and right.type == BOOL:
            return t.Binary(operator, left, right, type=BOOL, position=node.position)
        left, right, type_ = unify(left, right, self.dialect)
        if type_.kind is not Kind.BITS and not (type_.is_integer and self.dialect is Dialect.TWINCAT):
            raise failure(node, f"no {operator} of {type_}")
        return t.Binary(operator, left, right, type=type_, position=node.position)

    def _comparison(self, operator: str, left: t.Expression, right: t.Expression, node: t.Node) -> t.Expression:
        where = node.position
        if (
            operator in ("EQ", "NE")
            and left.type == right.type
            and (left.type == BOOL or isinstance(left.type, EnumType | PointerType))
        ):
            return t.Comparison(operator, left, right, type=BOOL, position=where)
        if isinstance(left.type, PointerType) and operator in ("EQ", "NE"):
            return t.Comparison(operator, left, coerce(right, left.type, self.dialect), type=BOOL, position=where)
        left, right, type_ = unify(left, right, self.dialect)
        if type_.is_untyped:
            left, right = settle(left), settle(right)
        if type_ is BOOL:
            raise failure(node, "BOOL values are compared with = and <> only")
        is_portable = self.dialect is Dialect.IEC and operator == "EQ" and type_.is_real
        is_self_test = is_portable and t.is_place(left) and left == right
        return t.Comparison(operator, left, right, is_self_test, type=BOOL, position=where)

    def power(self, left: t.Expression, right: t.Expression, node: t.Node) -> t.Expression:
        """EXPT and `**`: the base is a real number; computed as LREAL, rounded to the type of the base."""
        base = settle(left)
        if isinstance(base.type, Elementary) and base.type.is_integer and self.dialect is Dialect.TWINCAT:
            base = coerce(base, LREAL, self.dialect)
        if not isinstance(base.type, Elementary) or not base.type.is_real:
            raise failure(node, f"the base of a power is REAL or LREAL, not {base.type}")
        exponent = settle(right)
        if not isinstance(exponent.type, Elementary) or not (exponent.type.is_integer or exponent.type.is_real):
            raise failure(node, f"no power with an exponent of type {exponent.type}")
        raised = conversion(exponent, LREAL, is_implicit=True)
        return t.StandardCall("EXPT", (base, raised), type=base.type, position=node.position)


def _suggest(name: str, known: object) -> str:
    close = get_close_matches(name, list(cast("list[str]", known)), 1)
    return f": is '{close[0]}' meant?" if close else ""
