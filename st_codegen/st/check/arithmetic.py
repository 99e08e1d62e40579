"""What one operation on single values gives, and when it is a floating point exception.

The exceptions are those of a processor whose divide-by-zero, invalid and overflow traps are on, as TwinCAT has them:
infinities and quiet NaNs may be operands of arithmetic, and what comes out of them is no exception by itself.
REAL values are Python floats that a float32 holds exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from struct import Struct

from st_codegen.st.types import REAL, Elementary

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
REFERENCE = "reference not set"

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


def real_add(a: float, b: float) -> float:
    """LREAL addition."""
    result = a + b
    return check_float(result, a, b) if result - result else result


def real_sub(a: float, b: float) -> float:
    """LREAL subtraction."""
    result = a - b
    return check_float(result, a, b) if result - result else result


def real_mul(a: float, b: float) -> float:
    """LREAL multiplication."""
    result = a * b
    return check_float(result, a, b) if result - result else result


def real_div(a: float, b: float) -> float:
    """LREAL division."""
    if b == 0.0:
        if math.isnan(a):
            return check_float(a, a, b)
        if math.isinf(a):
            return a * math.copysign(1.0, b)
        raise Fault(DIVISION, (a, b))
    result = a / b
    return check_float(result, a, b) if result - result else result


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
    """LREAL_TO_REAL."""
    if value - value:
        raise Fault(CONVERSION, (value,))
    try:
        result: float = _SINGLE.unpack(_SINGLE.pack(value))[0]
    except OverflowError:
        raise Fault(CONVERSION, (value,)) from None
    return result


def to_integer(value: float, lower: int, upper: int) -> int:
    """A real number to the nearest integer, ties to even."""
    if value - value:
        raise Fault(CONVERSION, (value,))
    result = round(value)
    if not lower <= result <= upper:
        raise Fault(CONVERSION, (value,))
    return result


def truncate(value: float, lower: int, upper: int) -> int:
    """A real number to the next integer towards zero."""
    if value - value:
        raise Fault(CONVERSION, (value,))
    result = int(value)
    if not lower <= result <= upper:
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


def less(a: float, b: float) -> bool:
    """`a < b` of real numbers."""
    return a < b or compared(a, b)


def minimum(a: float, b: float) -> float:
    """MIN of real numbers; the first one when they are equal."""
    return b if less(b, a) else a


def maximum(a: float, b: float) -> float:
    """MAX of real numbers; the first one when they are equal."""
    return b if less(a, b) else a


def limit(low: float, value: float, high: float) -> float:
    """LIMIT of real numbers."""
    return minimum(maximum(value, low), high)


def shift_left(value: int, count: int, bits: int, mask: int) -> int:
    """SHL of an unsigned value."""
    if not 0 <= count < bits:
        raise Fault(SHIFT, (value, count))
    return (value << count) & mask


def shift_right(value: int, count: int, bits: int, _mask: int) -> int:
    """SHR; of a signed value the sign is kept."""
    if not 0 <= count < bits:
        raise Fault(SHIFT, (value, count))
    return value >> count


def rotate_left(value: int, count: int, bits: int, mask: int) -> int:
    """ROL."""
    if count < 0:
        raise Fault(SHIFT, (value, count))
    turn = count % bits
    return ((value << turn) | (value >> (bits - turn))) & mask


def rotate_right(value: int, count: int, bits: int, mask: int) -> int:
    """ROR."""
    if count < 0:
        raise Fault(SHIFT, (value, count))
    return rotate_left(value, bits - count % bits, bits, mask)


# --- functions --------------------------------------------------------------------------------------------------------
# The C library evaluates them here, by Python's own functions, and in compiled code: they agree to the last bit.


def exp(x: float) -> float:
    """EXP."""
    if x > EXP_LIMIT and not math.isinf(x):
        raise Fault(OVERFLOW, (x,))
    return math.exp(x)


def _of_positive(function: Callable[[float], float]) -> Callable[[float], float]:
    def evaluate(x: float) -> float:
        if x <= 0.0:
            raise Fault(INVALID, (x,))
        return function(x)

    return evaluate


def _of_finite(function: Callable[[float], float]) -> Callable[[float], float]:
    def evaluate(x: float) -> float:
        if math.isinf(x):
            raise Fault(INVALID, (x,))
        return function(x)

    return evaluate


def _of_unit(function: Callable[[float], float]) -> Callable[[float], float]:
    def evaluate(x: float) -> float:
        if abs(x) > 1.0:
            raise Fault(INVALID, (x,))
        return function(x)

    return evaluate


def sqrt(x: float) -> float:
    """SQRT; of the negative zero it is the negative zero."""
    if x < 0.0:
        raise Fault(INVALID, (x,))
    return math.sqrt(x)


def expt(x: float, y: float) -> float:
    """EXPT and `**`."""
    if x == 0.0 and y < 0.0 and not math.isinf(y):
        raise Fault(DIVISION, (x, y))
    if x < 0.0 and math.isfinite(x) and math.isfinite(y) and y != math.floor(y):
        raise Fault(INVALID, (x, y))
    try:
        result = math.pow(x, y)
    except OverflowError:
        raise Fault(OVERFLOW, (x, y)) from None
    if result - result and not math.isnan(x) and not math.isnan(y):
        return check_float(result, x, y)
    return result


def _quiet_check(function: Callable[[float], float]) -> Callable[[float], float]:
    """The function without exceptions for NaN, which passes through, but not for a signalling one."""

    def evaluate(x: float) -> float:
        if math.isnan(x):
            return check_float(x, x)
        return function(x)

    evaluate.__doc__ = function.__doc__
    return evaluate


FUNCTIONS: dict[str, Callable[[float], float]] = {
    "SQRT": _quiet_check(sqrt),
    "EXP": _quiet_check(exp),
    "LN": _quiet_check(_of_positive(math.log)),
    "LOG": _quiet_check(_of_positive(math.log10)),
    "SIN": _quiet_check(_of_finite(math.sin)),
    "COS": _quiet_check(_of_finite(math.cos)),
    "TAN": _quiet_check(_of_finite(math.tan)),
    "ASIN": _quiet_check(_of_unit(math.asin)),
    "ACOS": _quiet_check(_of_unit(math.acos)),
    "ATAN": _quiet_check(math.atan),
}


def atan2(y: float, x: float) -> float:
    """ATAN2."""
    if math.isnan(x) or math.isnan(y):
        return check_float(math.nan, x, y)
    return math.atan2(y, x)


def single(function: Callable[..., float]) -> Callable[..., float]:
    """A function of REAL values: evaluated as LREAL, then rounded."""

    def evaluate(*arguments: float) -> float:
        return round_single(function(*arguments), *arguments)

    return evaluate


def stored(value: float, type_: Elementary) -> float:
    """A real constant as a value of its type; REAL rounds."""
    return round_single(value, value) if type_ is REAL else value
