"""Code of operations on values: each as `check.arithmetic` defines it, with the traps that a controller has."""

from __future__ import annotations

from collections.abc import Sequence

from st_codegen.st.check import arithmetic as a
from st_codegen.st.errors import Position
from st_codegen.st.run.writer import INFINITY, KINDS, Operand, Writer, number, value_type
from st_codegen.st.tree import Overflow
from st_codegen.st.types import BOOL, LREAL, REAL, Elementary, Kind

_REAL_WORDS = {"ADD": "fadd", "SUB": "fsub", "MUL": "fmul", "DIV": "fdiv"}
_WORDS = {"ADD": "add", "SUB": "sub", "MUL": "mul", "AND": "and", "OR": "or", "XOR": "xor"}
_ORDER = {"EQ": "eq", "NE": "ne", "LT": "lt", "LE": "le", "GT": "gt", "GE": "ge"}


def binary(
    w: Writer, operator: str, type_: Elementary, overflow: Overflow, x: Operand, y: Operand, at: Position
) -> str:
    """An arithmetic or logical operator."""
    if type_.is_real:
        return _real(w, operator, type_, x, y, at)
    if operator in ("AND", "OR", "XOR"):
        return w.value(f"{_WORDS[operator]} {value_type(type_)} {x.code}, {y.code}")
    if operator in ("DIV", "MOD"):
        return _division(w, operator, type_, x, y, at)
    return ring(w, operator, type_, overflow, x, y, at)


def _real(w: Writer, operator: str, type_: Elementary, x: Operand, y: Operand, at: Position) -> str:
    kind = value_type(type_)
    result = w.value(f"{_REAL_WORDS[operator]} {kind} {x.code}, {y.code}")
    is_division = "true" if operator == "DIV" else "false"
    site = w.site(at, (x, y))
    arguments = f"{kind} {result}, {kind} {x.code}, {kind} {y.code}, i1 {is_division}"
    w.trap_if_called(_is_not_finite(w, kind, result), f"check.{type_.bits}", f"ptr %c, i64 {site}, {arguments}")
    return result


def _is_not_finite(w: Writer, kind: str, value: str) -> str:
    size = w.value(f"call {kind} @llvm.fabs.f{64 if kind == 'double' else 32}({kind} {value})")
    return w.value(f"fcmp uge {kind} {size}, {INFINITY}")


def _not(w: Writer, condition: str) -> str:
    return w.value(f"xor i1 {condition}, true")


def ring(w: Writer, operator: str, type_: Elementary, overflow: Overflow, x: Operand, y: Operand, at: Position) -> str:
    """ADD, SUB or MUL of integers or durations; the factor of a duration may be of another type."""
    kind, word = value_type(type_), _WORDS[operator]
    if overflow is Overflow.ERROR and type_.bits < 64:
        result = w.value(f"{word} i64 {w.wide(x)}, {w.wide(y)}")
        cut = w.value(f"trunc i64 {result} to {kind}")
        back = w.value(f"{'sext' if type_.is_signed else 'zext'} {kind} {cut} to i64")
        w.trap(w.value(f"icmp ne i64 {back}, {result}"), a.INTEGER_OVERFLOW, at, (x, y))
        return cut
    return w.value(f"{word} {kind} {resized(w, x, type_)}, {resized(w, y, type_)}")


def resized(w: Writer, x: Operand, target: Elementary) -> str:
    """An integer as one of another type, with the same low bits."""
    bits = 1 if x.type is BOOL else x.type.bits
    if bits == target.bits:
        return x.code
    word = "trunc" if bits > target.bits else "sext" if x.type.is_signed else "zext"
    return w.value(f"{word} i{bits} {x.code} to {value_type(target)}")


def _division(w: Writer, operator: str, type_: Elementary, x: Operand, y: Operand, at: Position) -> str:
    """DIV cuts towards zero, MOD has the sign of the dividend."""
    kind = value_type(type_)
    if not type_.is_signed and y.type.is_signed:
        negative = w.value(f"icmp slt {value_type(y.type)} {y.code}, 0")
        w.trap(negative, a.INTEGER_OVERFLOW, at, (x, y))
    divisor = resized(w, y, type_)
    w.trap(w.value(f"icmp eq {kind} {divisor}, 0"), a.DIVISION, at, (x, y))
    if type_.is_signed:
        lowest = w.value(f"icmp eq {kind} {x.code}, {type_.lower}")
        minus_one = w.value(f"icmp eq {kind} {divisor}, -1")
        w.trap(w.value(f"and i1 {lowest}, {minus_one}"), a.INTEGER_OVERFLOW, at, (x, y))
    word = ("s" if type_.is_signed else "u") + ("div" if operator == "DIV" else "rem")
    return w.value(f"{word} {kind} {x.code}, {divisor}")


def negation(w: Writer, type_: Elementary, overflow: Overflow, x: Operand, at: Position) -> str:
    """The sign of a number changed; of a real number only the sign bit."""
    if type_.is_real:
        return w.value(f"fneg {value_type(type_)} {x.code}")
    return ring(w, "SUB", type_, overflow, Operand("0", type_), x, at)


def inversion(w: Writer, type_: Elementary, x: str) -> str:
    """NOT of a truth value or of the bits of an integer."""
    return w.value(f"xor {value_type(type_)} {x}, {'true' if type_ is BOOL else '-1'}")


def comparison(w: Writer, operator: str, x: Operand, y: Operand, at: Position, is_number_test: bool) -> str:
    """A comparison of two values of one type; one with a NaN stops, but for the portable test for numbers."""
    kind = value_type(x.type)
    if x.type.is_real:
        if not is_number_test:
            w.trap(w.value(f"fcmp uno {kind} {x.code}, {y.code}"), a.NAN_COMPARED, at, (x, y))
        return w.value(f"fcmp {'une' if operator == 'NE' else 'o' + _ORDER[operator]} {kind} {x.code}, {y.code}")
    sign = "" if operator in ("EQ", "NE") else "s" if x.type.is_signed else "u"
    return w.value(f"icmp {sign}{_ORDER[operator]} {kind} {x.code}, {y.code}")


def conversion(w: Writer, x: Operand, target: Elementary, at: Position) -> str:  # noqa: PLR0911 - one return a case
    """A change of type; to integers: to nearest, ties to even."""
    source = x.type
    if source == target:
        return x.code
    if target is BOOL:
        zero = "0.0" if source.is_real else "0"
        return w.value(f"{'fcmp une' if source.is_real else 'icmp ne'} {value_type(source)} {x.code}, {zero}")
    if source.is_real:
        if target is LREAL:
            return _widened(w, x)
        if target is REAL:
            narrow = w.value(f"fptrunc double {x.code} to float")
            w.trap(_is_not_finite(w, "float", narrow), a.CONVERSION, at, (x,))
            return narrow
        return _to_integer(w, "rint", x, target, at)
    if target.is_real:
        bits = 1 if source is BOOL else source.bits
        wide = w.value(f"{'si' if source.is_signed else 'ui'}tofp i{bits} {x.code} to double")
        return w.value(f"fptrunc double {wide} to float") if target is REAL else wide
    return resized(w, x, target)


def _widened(w: Writer, x: Operand) -> str:
    return x.code if x.type is LREAL else w.value(f"fpext float {x.code} to double")


def _to_integer(w: Writer, rounding: str, x: Operand, target: Elementary, at: Position) -> str:
    whole = w.value(f"call double @llvm.{rounding}.f64(double {_widened(w, x)})")
    # The bound above is a power of two and exact; the one below, too
    low = w.value(f"fcmp oge double {whole}, {number(target.lower)}")
    high = w.value(f"fcmp olt double {whole}, {number(float(target.upper + 1))}")
    w.trap(_not(w, w.value(f"and i1 {low}, {high}")), a.CONVERSION, at, (x,))
    return w.value(f"fpto{'si' if target.is_signed else 'ui'} double {whole} to {value_type(target)}")


# --- standard functions -----------------------------------------------------------------------------------------------


def function(w: Writer, name: str, type_: Elementary, arguments: Sequence[Operand], at: Position) -> str:  # noqa: PLR0911 - one return a case
    """A standard function whose result has a given type."""
    match name:
        case "ABS":
            return _absolute(w, type_, arguments[0], at)
        case "TRUNC":
            return _to_integer(w, "trunc", arguments[0], type_, at)
        case "MIN" | "MAX":
            result = arguments[0]
            for argument in arguments[1:]:
                result = Operand(_extreme(w, name, result, argument, at), type_)
            return result.code
        case "LIMIT":
            low, value, high = arguments
            raised = Operand(_extreme(w, "MAX", value, low, at), type_)
            return _extreme(w, "MIN", raised, high, at)
        case "SEL":
            return _chosen(w, arguments[0].code, arguments[2], arguments[1])
        case "MUX":
            return _multiplexed(w, arguments[0], arguments[1:], at)
        case "SHL" | "SHR" | "ROL" | "ROR":
            return _shift(w, name, type_, arguments[0], arguments[1], at)
        case _:
            return _real_function(w, name, type_, arguments, at)


def _absolute(w: Writer, type_: Elementary, x: Operand, at: Position) -> str:
    kind = value_type(type_)
    if type_.is_real:
        return w.value(f"call {kind} @llvm.fabs.f{type_.bits}({kind} {x.code})")
    if not type_.is_signed:
        return x.code
    w.trap(w.value(f"icmp eq {kind} {x.code}, {type_.lower}"), a.INTEGER_OVERFLOW, at, (x,))
    negative = w.value(f"icmp slt {kind} {x.code}, 0")
    opposite = w.value(f"sub {kind} 0, {x.code}")
    return w.value(f"select i1 {negative}, {kind} {opposite}, {kind} {x.code}")


def _extreme(w: Writer, name: str, x: Operand, y: Operand, at: Position) -> str:
    """MIN or MAX of two; the first one when they are equal."""
    return _chosen(w, comparison(w, "LT" if name == "MIN" else "GT", y, x, at, False), y, x)


def _chosen(w: Writer, condition: str, x: Operand, y: Operand) -> str:
    kind = value_type(x.type)
    return w.value(f"select i1 {condition}, {kind} {x.code}, {kind} {y.code}")


def _multiplexed(w: Writer, selector: Operand, choices: Sequence[Operand], at: Position) -> str:
    k = w.wide(selector)
    w.trap(w.value(f"icmp uge i64 {k}, {len(choices)}"), a.INDEX, at, (selector,), "MUX has no input {0}")
    result = choices[0].code
    for position, choice in enumerate(choices[1:], start=1):
        is_it = w.value(f"icmp eq i64 {k}, {position}")
        result = _chosen(w, is_it, choice, Operand(result, choice.type))
    return result


def _shift(w: Writer, name: str, type_: Elementary, x: Operand, n: Operand, at: Position) -> str:
    kind, places = value_type(type_), w.wide(n)
    if name in ("ROL", "ROR"):
        if n.type.is_signed:
            w.trap(w.value(f"icmp slt i64 {places}, 0"), a.SHIFT, at, (x, n))
        turn = w.value(f"urem i64 {places}, {type_.bits}")
        back = w.value(f"urem i64 {w.value(f'sub i64 {type_.bits}, {turn}')}, {type_.bits}")
        left, right = (turn, back) if name == "ROL" else (back, turn)
        parts = [
            w.value(f"{word} {kind} {x.code}, {resized(w, Operand(by, _I64), type_)}")
            for word, by in (("shl", left), ("lshr", right))
        ]
        return w.value(f"or {kind} {parts[0]}, {parts[1]}")
    w.trap(w.value(f"icmp uge i64 {places}, {type_.bits}"), a.SHIFT, at, (x, n))
    word = "shl" if name == "SHL" else "ashr" if type_.is_signed else "lshr"
    return w.value(f"{word} {kind} {x.code}, {resized(w, Operand(places, _I64), type_)}")


_I64 = Elementary("LWORD", Kind.BITS, 64)


def _real_function(w: Writer, name: str, type_: Elementary, arguments: Sequence[Operand], at: Position) -> str:
    """A function of real numbers: of REAL values evaluated as LREAL, then rounded."""
    values = [_widened(w, argument) for argument in arguments]
    listed = ", ".join(f"double {value}" for value in values)
    if len(values) == 1:
        _check_domain(w, name, values[0], w.site(at, (Operand(values[0], LREAL),)))
    called = "@llvm.sqrt.f64" if name == "SQRT" else w.functions[name]
    result = w.value(f"call double {called}({listed}) #1")
    if len(values) == 2:
        site = w.site(at, [Operand(value, LREAL) for value in values])
        if name == "EXPT":
            low = w.value(f"fcmp ole double {values[0]}, 0.0")
            rare = w.value(f"or i1 {low}, {_is_not_finite(w, 'double', result)}")
            w.trap_if_called(rare, "check.power", f"ptr %c, i64 {site}, double {result}, {listed}")
        else:
            rare = w.value(f"fcmp uno double {values[0]}, {values[1]}")
            w.trap_if_called(rare, "check.64", f"ptr %c, i64 {site}, double {result}, {listed}, i1 false")
    if type_ is not REAL:
        return result
    narrow = w.value(f"fptrunc double {result} to float")
    lost = w.value(f"xor i1 {_is_not_finite(w, 'float', narrow)}, {_is_not_finite(w, 'double', result)}")
    w.trap(lost, a.OVERFLOW, at, [Operand(value, LREAL) for value in values])
    return narrow


def _check_domain(w: Writer, name: str, x: str, site: int) -> None:
    """Everything outside of the domain is rare; a NaN is outside of it, too, and may pass unless it is signalling."""
    kind = a.OVERFLOW if name == "EXP" else a.INVALID
    match name:
        case "SQRT":
            inside = w.value(f"fcmp oge double {x}, 0.0")
        case "LN" | "LOG":
            inside = w.value(f"fcmp ogt double {x}, 0.0")
        case "EXP":
            small = w.value(f"fcmp ole double {x}, {number(a.EXP_LIMIT)}")
            inside = w.value(f"or i1 {small}, {w.value(f'fcmp oeq double {x}, {INFINITY}')}")
        case "ASIN" | "ACOS":
            size = w.value(f"call double @llvm.fabs.f64(double {x})")
            inside = w.value(f"fcmp ole double {size}, 1.0")
        case "ATAN":
            inside = w.value(f"fcmp ord double {x}, {x}")
        case _:
            inside = _not(w, _is_not_finite(w, "double", x))
    w.trap_if_called(_not(w, inside), "domain", f"ptr %c, i64 {site}, i64 {KINDS.index(kind)}, double {x}")
