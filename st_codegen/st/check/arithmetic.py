"""What one operation on single values gives, and when it is a floating point exception.

The exceptions are those of a processor whose divide-by-zero, invalid and overflow traps are on, as TwinCAT has them:
infinities and quiet NaNs may be operands of arithmetic, and what comes out of them is no exception by itself.
REAL values are Python floats that a float32 holds exactly.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from struct import Struct

from st_codegen.st.types import REAL, Elementary

RealFunction = Callable[[float], float]
RealOperator = Callable[[float, float], float]

DIVISION = "division by zero"
INVALID = "invalid operation"
OVERFLOW = "overflow"
NAN_COMPARED = "comparison with NaN"
CONVERSION = "conversion out of range"
INDEX = "index out of range"
INTEGER_OVERFLOW = "integer overflow"
SHIFT = "shift out of range"
LOOP = "loop limit"
STEP = "step of zero"

# The largest LREAL whose EXP is finite
EXP_LIMIT = 709.782712893384
_SINGLE = Struct("<f")
_BITS = Struct("<Q")
_DOUBLE = Struct("<d")


class Fault(Exception):  # noqa: N818 - who catches it knows the position and makes an error of it
    """An operation that would stop a controller."""

    def __init__(self, kind: str, operands: tuple[object, ...]) -> None:
        self.kind = kind
        self.operands = operands
        super().__init__(kind)


def is_signalling(value: float) -> bool:
    """Whether the bits are those of a signalling NaN."""
    return math.isnan(value) and not _BITS.unpack(_DOUBLE.pack(value))[0] & (1 << 51)


def check_float(result: float, *operands: float) -> float:
    """The result of an arithmetic operation that is not finite, if that is no exception."""
    if any(is_signalling(value) for value in operands):
        raise Fault(INVALID, operands)
    if any(math.isnan(value) for value in operands):
        return result
    if math.isnan(result):
        raise Fault(INVALID, operands)
    if not any(math.isinf(value) for value in operands):
        raise Fault(OVERFLOW, operands)
    return result


def _finite(compute: RealOperator) -> RealOperator:
    """An operation on LREAL values whose result is looked at where it is not finite."""

    def evaluate(a: float, b: float) -> float:
        result = compute(a, b)
        return check_float(result, a, b) if result - result else result

    return evaluate


def real_div(a: float, b: float) -> float:
    """Division of LREAL values."""
    if b == 0.0:
        if math.isnan(a):
            return check_float(a, a, b)
        if math.isinf(a):
            return a * math.copysign(1.0, b)
        raise Fault(DIVISION, (a, b))
    result = a / b
    return check_float(result, a, b) if result - result else result


REAL_OPERATORS: dict[str, RealOperator] = {
    "ADD": _finite(operator.add),
    "SUB": _finite(operator.sub),
    "MUL": _finite(operator.mul),
    "DIV": real_div,
}


def round_single(value: float, *operands: float) -> float:
    """The REAL nearest to the exact result of an operation on `operands`.

    Rounding twice is exact here: 53 bits are more than twice 24 plus 2, so an LREAL sum, product, quotient or square
    root of REAL values rounds to the right REAL.
    """
    try:
        result: float = _SINGLE.unpack(_SINGLE.pack(value))[0]
    except OverflowError:
        raise Fault(OVERFLOW, operands) from None
    return result


def to_single(value: float) -> float:
    """LREAL_TO_REAL; what is not finite stops a controller here."""
    try:
        result: float = math.nan if value - value else _SINGLE.unpack(_SINGLE.pack(value))[0]
    except OverflowError:
        result = math.nan
    if math.isnan(result):
        raise Fault(CONVERSION, (value,))
    return result


def to_integer(value: float, lower: int, upper: int) -> int:
    """A real number to the nearest integer, ties to even."""
    if value - value or not lower <= (result := round(value)) <= upper:
        raise Fault(CONVERSION, (value,))
    return result


def wrap(value: int, lower: int, upper: int) -> int:
    """Two's complement: the value of the type that has the same low bits."""
    return ((value - lower) & (upper - lower)) + lower


def exact(value: int, lower: int, upper: int, *operands: int) -> int:
    """An intermediate result, which must fit its type."""
    if not lower <= value <= upper:
        raise Fault(INTEGER_OVERFLOW, operands)
    return value


def integer_div(a: int, b: int, upper: int) -> int:
    """Division that cuts towards zero; the one quotient that does not fit stops a processor, too."""
    if b == 0:
        raise Fault(DIVISION, (a, b))
    result = abs(a) // abs(b)
    if (a < 0) != (b < 0):
        return -result
    if result > upper:
        raise Fault(INTEGER_OVERFLOW, (a, b))
    return result


def integer_mod(a: int, b: int, upper: int) -> int:
    """The remainder of `integer_div`: it has the sign of the dividend."""
    if b == 0:
        raise Fault(DIVISION, (a, b))
    if b == -1 and a < -upper:
        raise Fault(INTEGER_OVERFLOW, (a, b))
    result = abs(a) % abs(b)
    return -result if a < 0 else result


def compared(a: float, b: float) -> bool:
    """False, or the exception of a comparison that has a NaN in it."""
    if math.isnan(a) or math.isnan(b):
        raise Fault(NAN_COMPARED, (a, b))
    return False


# --- functions --------------------------------------------------------------------------------------------------------
# The C library evaluates them here, by Python's own functions, and in compiled code: they agree to the last bit.


def _guarded(compute: RealFunction, is_outside: Callable[[float], bool], kind: str = INVALID) -> RealFunction:
    """A function of one LREAL that stops a controller outside of its domain.

    A NaN passes through without an exception, but not a signalling one.
    """

    def evaluate(x: float) -> float:
        if math.isnan(x):
            return check_float(x, x)
        if is_outside(x):
            raise Fault(kind, (x,))
        return compute(x)

    return evaluate


FUNCTIONS: dict[str, RealFunction] = {
    "SQRT": _guarded(math.sqrt, lambda x: x < 0.0),
    "EXP": _guarded(math.exp, lambda x: EXP_LIMIT < x < math.inf, OVERFLOW),
    "LN": _guarded(math.log, lambda x: x <= 0.0),
    "LOG": _guarded(math.log10, lambda x: x <= 0.0),
    "SIN": _guarded(math.sin, math.isinf),
    "COS": _guarded(math.cos, math.isinf),
    "TAN": _guarded(math.tan, math.isinf),
    "ASIN": _guarded(math.asin, lambda x: abs(x) > 1.0),
    "ACOS": _guarded(math.acos, lambda x: abs(x) > 1.0),
    "ATAN": _guarded(math.atan, lambda _: False),
}


def stored(value: float, type_: Elementary) -> float:
    """A real constant as a value of its type; REAL rounds."""
    return round_single(value, value) if type_ is REAL else value
