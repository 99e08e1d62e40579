"""One formula of +, -, *, / and EXP or LN for each function of one number that models have; branches and roundings.

How far each may lie from the function says docs/proof.md.
"""

from __future__ import annotations

from st_codegen.ir import Precision
from st_codegen.proof.prove.terms import Terms, Value

#: Below minus this argument an exponential is taken as 0.
_REACH = 708.0

#: The polynomial of erf, written down a second time: how far the formula lies from erf is held by a test.
LOG_ERFC: tuple[float, ...] = (
    -0.133058616487942,
    1.1011737068948,
    -3.95934960079685,
    8.02068737141864,
    -9.89989849778988,
)
LOG_ERFC += (7.54980718974905, -3.61901364341873, 1.33647950696555, -0.405998888660434, -0.092662408805115)
LOG_ERFC += (-0.0913157175380786, 0.0836727701850285, 0.374988806661786, 1.00000014555518, -1.26551212379872)


def rounded(terms: Terms, value: Value, precision: Precision) -> Value:
    """A value as numbers of a precision have it."""
    return terms.real("single", value) if precision is Precision.FLOAT32 else value


def exp(terms: Terms, x: Value, precision: Precision = Precision.FLOAT64) -> Value:
    """EXP, and 0.0 where its argument is -708 or less."""
    return terms.branch("GT", x, -_REACH, lambda: rounded(terms, terms.real("exp", x), precision), 0.0)


def logistic(terms: Terms, x: Value) -> Value:
    """1 / (1 + exp(-|x|)), of x below 0 exp(-|x|) / (1 + exp(-|x|))."""
    real = terms.real
    size = real("abs", x)
    decay = terms.branch("GT", size, _REACH, 0.0, lambda: real("exp", real("neg", size)))
    below = real("add", 1.0, decay)
    return terms.branch("GE", x, 0.0, lambda: real("div", 1.0, below), lambda: real("div", decay, below))


def softplus(terms: Terms, x: Value) -> Value:
    """max(x, 0) + log(1 + exp(-|x|))."""
    real = terms.real
    size = real("abs", x)
    rest = terms.branch("LT", size, _REACH, lambda: log1p(terms, real("exp", real("neg", size))), 0.0)
    return real("add", real("max", x, 0.0), rest)


def log1p(terms: Terms, x: Value) -> Value:
    """log(u) * x / (u - 1) with u = 1 + x."""
    real = terms.real
    u = real("add", 1.0, x)
    rest = real("sub", u, 1.0)
    return terms.branch("GT", real("abs", rest), 0.0, lambda: real("div", real("mul", real("ln", u), x), rest), x)


def expm1(terms: Terms, x: Value) -> Value:
    """(u - 1) * x / log(u) with u = exp(x)."""
    real = terms.real

    def near() -> Value:
        u = real("exp", x)
        rest = real("sub", u, 1.0)
        return terms.branch("GT", real("abs", rest), 0.0, lambda: real("div", real("mul", rest, x), real("ln", u)), x)

    def far() -> Value:
        return real("sub", real("exp", x), 1.0)

    return terms.branch("LT", x, -40.0, -1.0, lambda: terms.branch("GT", real("abs", x), 1.0, far, near))


def erf(terms: Terms, x: Value, size: Value) -> Value:
    """erf of a size, with the sign of x: 1 - t * exp(polynomial of t - size * size), t = 1 / (1 + size / 2)."""
    real = terms.real
    t = real("div", 1.0, real("add", 1.0, real("mul", 0.5, size)))
    total: Value = 0.0
    for coefficient in LOG_ERFC:
        total = real("add", real("mul", total, t), coefficient)
    power = real("sub", total, real("mul", size, size))
    y = terms.branch("GT", power, -_REACH, lambda: real("sub", 1.0, real("mul", t, real("exp", power))), 1.0)
    return terms.branch("LT", x, 0.0, lambda: real("neg", y), y)


def tanh(terms: Terms, x: Value) -> Value:
    """Lambert's continued fraction near 0, else 1 - 2 / (exp(2 * |x|) + 1) with the sign of x."""
    real = terms.real
    size = real("abs", x)

    def near() -> Value:
        square = real("mul", x, x)
        top: Value = real("add", 990.0, square)
        for constant in (135135.0, 4729725.0, 34459425.0):
            top = real("add", constant, real("mul", square, top))
        bottom: Value = real("add", 13860.0, real("mul", square, 45.0))
        for constant in (945945.0, 16216200.0, 34459425.0):
            bottom = real("add", constant, real("mul", square, bottom))
        return real("div", real("mul", x, top), bottom)

    def far() -> Value:
        e = real("exp", real("mul", 2.0, size))
        y = real("sub", 1.0, real("div", 2.0, real("add", e, 1.0)))
        return terms.branch("LT", x, 0.0, lambda: real("neg", y), y)

    def beyond() -> Value:
        return terms.branch("LT", x, 0.0, -1.0, 1.0)

    return terms.branch("LT", size, 0.75, near, lambda: terms.branch("GT", size, 22.0, beyond, far))
