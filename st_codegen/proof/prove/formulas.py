"""One formula of +, -, *, / and EXP or LN for each function of one number that models have; branches and roundings.

How far each may lie from the function says docs/proof.md.
"""

from __future__ import annotations

from collections.abc import Callable

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


def branch(
    terms: Terms, operator: str, one: Value, other: Value, then: Callable[[], Value], otherwise: Callable[[], Value]
) -> Value:
    """What `then` gives where a comparison holds, else what `otherwise` gives."""
    return terms.where(terms.compare(operator, one, other), then, otherwise)


def rounded(terms: Terms, value: Value, precision: Precision) -> Value:
    """A value as numbers of a precision have it."""
    return terms.real("single", value) if precision is Precision.FLOAT32 else value


def exp(terms: Terms, x: Value, precision: Precision = Precision.FLOAT64) -> Value:
    """EXP, and 0.0 where its argument is -708 or less."""
    return branch(terms, "GT", x, -_REACH, lambda: rounded(terms, terms.real("exp", x), precision), lambda: 0.0)


def logistic(terms: Terms, x: Value) -> Value:
    """1 / (1 + exp(-|x|)), of x below 0 exp(-|x|) / (1 + exp(-|x|))."""
    size = terms.real("abs", x)
    decay = branch(terms, "GT", size, _REACH, lambda: 0.0, lambda: terms.real("exp", terms.real("neg", size)))
    below = terms.real("add", 1.0, decay)
    return branch(terms, "GE", x, 0.0, lambda: terms.real("div", 1.0, below), lambda: terms.real("div", decay, below))


def softplus(terms: Terms, x: Value) -> Value:
    """max(x, 0) + log(1 + exp(-|x|))."""
    size = terms.real("abs", x)
    rest = branch(
        terms, "LT", size, _REACH, lambda: log1p(terms, terms.real("exp", terms.real("neg", size))), lambda: 0.0
    )
    return terms.real("add", terms.real("max", x, 0.0), rest)


def log1p(terms: Terms, x: Value) -> Value:
    """log(u) * x / (u - 1) with u = 1 + x."""
    u = terms.real("add", 1.0, x)
    rest = terms.real("sub", u, 1.0)
    return branch(
        terms,
        "GT",
        terms.real("abs", rest),
        0.0,
        lambda: terms.real("div", terms.real("mul", terms.real("ln", u), x), rest),
        lambda: x,
    )


def expm1(terms: Terms, x: Value) -> Value:
    """(u - 1) * x / log(u) with u = exp(x)."""

    def near() -> Value:
        u = terms.real("exp", x)
        rest = terms.real("sub", u, 1.0)
        return branch(
            terms,
            "GT",
            terms.real("abs", rest),
            0.0,
            lambda: terms.real("div", terms.real("mul", rest, x), terms.real("ln", u)),
            lambda: x,
        )

    def far() -> Value:
        return terms.real("sub", terms.real("exp", x), 1.0)

    return branch(
        terms, "LT", x, -40.0, lambda: -1.0, lambda: branch(terms, "GT", terms.real("abs", x), 1.0, far, near)
    )


def erf(terms: Terms, x: Value, size: Value) -> Value:
    """erf of a size, with the sign of x: 1 - t * exp(polynomial of t - size * size), t = 1 / (1 + size / 2)."""
    real = terms.real
    t = real("div", 1.0, real("add", 1.0, real("mul", 0.5, size)))
    total: Value = 0.0
    for coefficient in LOG_ERFC:
        total = real("add", real("mul", total, t), coefficient)
    power = real("sub", total, real("mul", size, size))
    y = branch(terms, "GT", power, -_REACH, lambda: real("sub", 1.0, real("mul", t, real("exp", power))), lambda: 1.0)
    return branch(terms, "LT", x, 0.0, lambda: real("neg", y), lambda: y)


def tanh(terms: Terms, x: Value) -> Value:
    """Lambert's continued fraction near 0, else 1 - 2 / (exp(2 * |x|) + 1) with the sign of x."""
    size = terms.real("abs", x)

    def near() -> Value:
        square = terms.real("mul", x, x)
        top: Value = terms.real("add", 990.0, square)
        for constant in (135135.0, 4729725.0, 34459425.0):
            top = terms.real("add", constant, terms.real("mul", square, top))
        bottom: Value = terms.real("add", 13860.0, terms.real("mul", square, 45.0))
        for constant in (945945.0, 16216200.0, 34459425.0):
            bottom = terms.real("add", constant, terms.real("mul", square, bottom))
        return terms.real("div", terms.real("mul", x, top), bottom)

    def far() -> Value:
        e = terms.real("exp", terms.real("mul", 2.0, size))
        y = terms.real("sub", 1.0, terms.real("div", 2.0, terms.real("add", e, 1.0)))
        return branch(terms, "LT", x, 0.0, lambda: terms.real("neg", y), lambda: y)

    def beyond() -> Value:
        return branch(terms, "LT", x, 0.0, lambda: -1.0, lambda: 1.0)

    return branch(terms, "LT", size, 0.75, near, lambda: branch(terms, "GT", size, 22.0, beyond, far))
