"""Operators on checked operands: which types they take, and the type of the result."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

from st_codegen.st import tree as t
from st_codegen.st.check.arithmetic import Fault
from st_codegen.st.check.coercion import coerce, conversion, overflow_of, settle, unify
from st_codegen.st.check.constants import binary
from st_codegen.st.check.standard_names import ARITHMETIC, COMPARISONS
from st_codegen.st.check.symbols import failure
from st_codegen.st.dialects import Dialect
from st_codegen.st.errors import Position
from st_codegen.st.types import (
    ANY_REAL_LITERAL,
    BOOL,
    DINT,
    LINT,
    LREAL,
    AnyType,
    Elementary,
    EnumType,
    Kind,
    PointerType,
)

_LOGIC = ("AND", "OR", "XOR")
_HALVES = tuple((below, above) for below in ("LT", "LE") for above in ("GT", "GE"))
_SIGNS = {"NEG": "-", "POS": "+", "NOT": "NOT"}
_UNSIGNED = {8: "USINT", 16: "UINT", 32: "UDINT", 64: "ULINT"}


def is_bits(type_: AnyType, rules: Dialect) -> bool:
    """Whether a type has bits that can be taken one by one; BOOL is not meant."""
    return type_.kind is Kind.BITS or (type_.is_integer and rules.has_numeric_bits)


def unary(rules: Dialect, node: t.Unary, operand: t.Expression) -> t.Expression:
    """Apply NOT or a sign to a checked operand."""
    type_ = operand.type
    if not isinstance(type_, Elementary):
        raise failure(node, f"no {_SIGNS[node.operator]} of {type_}")
    if node.operator == "NOT":
        if type_ is not BOOL and not is_bits(type_, rules):
            raise failure(node, f"no NOT of {type_}")
        return replace(node, operand=operand, type=type_)
    if not (type_.is_integer or type_.is_real or type_.is_untyped):
        raise failure(node, f"no sign in front of {type_}")
    if node.operator == "POS":
        return operand
    if (type_.is_untyped or type_.is_real) and isinstance(operand, t.Constant):
        return replace(operand, value=-cast(float, operand.value), position=node.position)
    return replace(node, operand=operand, overflow=overflow_of("SUB", type_), type=type_)


def combine(rules: Dialect, operator: str, left: t.Expression, right: t.Expression, where: Position) -> t.Expression:
    """Apply an operator to two checked operands."""
    if operator in ARITHMETIC or operator == "MOD":
        return _arithmetic(rules, operator, left, right, where)
    if operator in COMPARISONS:
        return _comparison(rules, operator, left, right, where)
    if operator in _LOGIC:
        return _logic(rules, operator, left, right, where)
    if operator == "EXPT":
        return power(rules, left, right, where)
    if left.type != BOOL or right.type != BOOL:
        raise failure(where, f"{operator} needs BOOL on both sides, not {left.type} and {right.type}")
    return t.ShortCircuit(operator, left, right, type=BOOL, position=where)


def _arithmetic(
    rules: Dialect, operator: str, left: t.Expression, right: t.Expression, where: Position
) -> t.Expression:
    if left.type.kind is Kind.TIME and operator in ("MUL", "DIV"):
        type_, right = cast(Elementary, left.type), settle(right)
        if not isinstance(right.type, Elementary) or not (right.type.is_integer and DINT.holds(right.type.upper)):
            raise failure(where, f"a duration is multiplied and divided by integers up to DINT, not by {right.type}")
        right = conversion(right, DINT)
    else:
        left, right, type_ = unify(_number(rules, left), _number(rules, right), rules)
        allowed = type_.is_integer or type_.is_untyped or (type_.kind is Kind.TIME and operator in ("ADD", "SUB"))
        if not allowed and not (type_.is_real and operator != "MOD"):
            raise failure(where, f"no {operator} of {type_}")
        if operator == "MOD" and type_ is ANY_REAL_LITERAL:
            raise failure(where, "MOD is for integers")
        if type_.is_untyped:
            return _fold(operator, type_, cast(t.Constant, left), cast(t.Constant, right), where)
    return t.Binary(operator, left, right, overflow_of(operator, type_), type=type_, position=where)


def _number(rules: Dialect, operand: t.Expression) -> t.Expression:
    """An operand of arithmetic: where the dialect has it so, a bit string counts as an unsigned integer."""
    if operand.type.kind is Kind.BITS and rules.has_numeric_bits:
        unsigned = rules.types[_UNSIGNED[cast(Elementary, operand.type).bits]]
        return conversion(operand, unsigned)
    return operand


def _fold(operator: str, type_: Elementary, left: t.Constant, right: t.Constant, where: Position) -> t.Constant:
    """Literals without a type are computed at once, and stay without a type."""
    computed_as = LREAL if type_ is ANY_REAL_LITERAL else LINT
    try:
        value = binary(operator, computed_as, t.Overflow.ERROR, left.value, right.value)
    except Fault as fault:
        raise failure(where, f"{fault.kind} in a constant") from None
    return t.Constant(value, type=type_, position=where)


def _logic(rules: Dialect, operator: str, left: t.Expression, right: t.Expression, where: Position) -> t.Expression:
    type_ = BOOL
    if left.type != BOOL or right.type != BOOL:
        left, right, type_ = unify(left, right, rules)
        if not is_bits(type_, rules):
            raise failure(where, f"no {operator} of {type_}")
    elif operator == "OR" and rules.has_number_test:
        left, right = _as_number_test(left, right)
    return t.Binary(operator, left, right, type=type_, position=where)


def _as_number_test(left: t.Expression, right: t.Expression) -> tuple[t.Expression, t.Expression]:
    """Both marked where they compare one place with constants and leave no number out, as `x < 1.0 OR x > -1.0`."""
    if not (isinstance(left, t.Compare) and isinstance(right, t.Compare) and left.left == right.left):
        return left, right
    below, above = (left, right) if left.operator in ("LT", "LE") else (right, left)
    if (
        (below.operator, above.operator) in _HALVES
        and t.is_place(left.left)
        and isinstance(below.right, t.Constant)
        and isinstance(above.right, t.Constant)
        and below.right.type.is_real
        and cast(float, below.right.value) > cast(float, above.right.value)
    ):
        return replace(left, is_number_test=True), replace(right, is_number_test=True)
    return left, right


def _comparison(
    rules: Dialect, operator: str, left: t.Expression, right: t.Expression, where: Position
) -> t.Expression:
    is_equality = operator in ("EQ", "NE")
    is_same = left.type == right.type and (left.type == BOOL or isinstance(left.type, EnumType | PointerType))
    if is_equality and isinstance(left.type, PointerType):
        right = coerce(right, left.type, rules)
    elif not (is_equality and is_same):
        left, right, type_ = unify(left, right, rules)
        if type_.is_untyped:
            left, right = settle(left), settle(right)
        if type_ is BOOL:
            raise failure(where, "BOOL values are compared with = and <> only")
    return t.Compare(operator, left, right, type=BOOL, position=where)


def power(rules: Dialect, left: t.Expression, right: t.Expression, where: Position) -> t.Expression:
    """EXPT and `**`: the base is a real number; computed as LREAL, rounded to the type of the base."""
    base = real(rules, left)
    if base is None:
        raise failure(where, f"the base of a power is REAL or LREAL, not {settle(left).type}")
    exponent = settle(right)
    if not (exponent.type.is_integer or exponent.type.is_real):
        raise failure(where, f"no power with an exponent of type {exponent.type}")
    raised = conversion(exponent, LREAL)
    return t.StandardCall("EXPT", (base, raised), type=base.type, position=where)


def real(rules: Dialect, operand: t.Expression) -> t.Expression | None:
    """An operand as a real number: where the dialect widens, an integer is an LREAL; None for anything else."""
    operand = settle(operand)
    if operand.type.is_integer and rules.has_widening:
        return coerce(operand, LREAL, rules)
    return operand if operand.type.is_real else None
