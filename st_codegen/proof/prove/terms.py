"""Expressions of a text's numbers and truth values, each kept once, with the interval that holds its value.

Additions and all other operations are kept in their order; nothing is regrouped. One rule of arithmetic is used: x +
0.0 is x unless x may be -0.0, and x + -0.0 is x. Inside of a branch its condition narrows the intervals of what it
compares. An operation that may overflow, divide by zero or meet NaN raises NotProvedError.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.floats import FLIPPED, NEGATED
from st_codegen.proof.prove.intervals import FUNCTIONS, INTEGER, LARGEST, WHOLE, Interval, compute, cut, ends, hull

#: A number below exp(0.0), as it may err, and rounded to REAL.
_POWER = 0.999
_HALF_ULP = 2.0**-53


class Term:
    """`operation` on `arguments` (terms and plain numbers); a leaf has a name in their place.

    `minus_zero`: whether the value can be -0.0; `single`: whether it is a float32 number for sure.
    """

    __slots__ = ("arguments", "kind", "minus_zero", "operation", "single")

    def __init__(self, operation: str, arguments: tuple[Any, ...], kind: str) -> None:
        self.operation, self.arguments, self.kind = operation, arguments, kind
        self.minus_zero, self.single = True, False

    def __repr__(self) -> str:
        return f"{self.operation}({', '.join(map(repr, self.arguments))})"


#: A plain number or truth value, or an expression.
Value = bool | int | float | Term

#: A value, or what makes it where a condition is known.
Side = Value | Callable[[], Value]


def arguments_of(value: object, operation: str) -> tuple[Value, ...] | None:
    """The operands of a term that is such an operation; None for another value."""
    return value.arguments if isinstance(value, Term) and value.operation == operation else None


def _operands(term: Term) -> list[Term]:
    """The terms whose intervals make that of this one, whatever is true."""
    if term.operation in ("if", "leaf") or term.kind == "bool":
        return []
    return [argument for argument in term.arguments if isinstance(argument, Term)]


def _name(value: object) -> object:
    if isinstance(value, Term):
        return id(value)
    return (type(value).__name__, value.hex() if isinstance(value, float) else value)


class Terms:
    """All terms of a proof, and what is known of them here."""

    def __init__(self) -> None:
        self._known: dict[object, Term] = {}
        self._intervals: list[dict[Term, Interval]] = [{}]
        self._truths: list[dict[Term, bool]] = [{}]
        self._apart: list[dict[Term, float]] = [{}]  # least magnitude of numbers that are not zero

    # --- making terms -----------------------------------------------------------------------------------------------

    def leaf(
        self,
        name: object,
        kind: str,
        interval: Interval = WHOLE,
        *,
        minus_zero: bool = True,
        single: bool = False,
    ) -> Term:
        """Something unknown: an input, a variable before the call, the leaf of a tree."""
        term = self._term("leaf", (name,), kind)
        term.minus_zero, term.single = minus_zero, single
        self._intervals[0].setdefault(term, interval)
        return term

    def _term(self, operation: str, arguments: tuple[Any, ...], kind: str) -> Term:
        key = (operation, kind, *map(_name, arguments))
        return self._known.setdefault(key, Term(operation, arguments, kind))

    def interval(self, value: Value) -> Interval:
        """Where the value lies, as far as it is known here."""
        if not isinstance(value, Term):
            return float(value), float(value), math.isnan(value)
        found = self._found(value)
        waiting = [value] if found is None else []
        while waiting:  # operands first: a sum over many rows is deeper than calls may be nested
            unknown = [operand for operand in _operands(waiting[-1]) if self._found(operand) is None]
            if unknown:
                waiting += unknown
            else:
                term = waiting.pop()
                found = self._intervals[-1][term] = self._computed(term)
        assert found is not None
        return found

    def _found(self, term: Term) -> Interval | None:
        for layer in reversed(self._intervals):
            if term in layer:
                return layer[term]
        return None

    def _computed(self, term: Term) -> Interval:
        if term.operation == "if":
            condition, one, other = term.arguments
            truth = self.truth(condition)
            if truth is not None:
                return self.interval(one if truth else other)
            return hull(self.interval(one), self.interval(other))
        if term.kind == "bool":
            return 0.0, 1.0, False
        try:
            return self._result(term.operation, term.arguments, term)
        except NotProvedError:
            return -LARGEST, LARGEST, False  # it was computed where it stood, and was a number there

    def real(self, operation: str, *arguments: Value) -> Value:
        """A floating point operation. Raises NotProvedError where it may overflow, divide by zero or meet NaN."""
        numbers = [argument for argument in arguments if not isinstance(argument, Term)]
        if operation not in FUNCTIONS and len(numbers) == len(arguments):
            return compute(operation, *map(float, numbers))
        simpler = _simpler(operation, arguments)
        if simpler is not None:
            return simpler
        term = self._term(operation, arguments, "real")
        term.minus_zero, term.single = _facts(operation, arguments)
        self._note(term, self._result(operation, arguments, term))
        return term

    def _note(self, term: Term, interval: Interval) -> None:
        known = self.interval(term) if any(term in layer for layer in self._intervals) else interval
        self._intervals[-1][term] = cut(known, interval)

    def _result(self, operation: str, arguments: tuple[Value, ...], term: Term) -> Interval:
        given = [self.interval(argument) for argument in arguments]
        if any(interval[2] for interval in given):
            raise NotProvedError(f"{operation} may meet NaN")
        if any(interval[0] > interval[1] for interval in given):
            return math.inf, -math.inf, False  # this is not reached
        if operation == "div":
            return (*self._quotient(arguments, given), False)
        if operation in FUNCTIONS:
            if operation == "ln" and self.apart(arguments[0], 1.0):
                self._apart[-1][term] = _HALF_ULP / 2
            low, high = FUNCTIONS[operation](given[0][0], given[0][1])
        elif operation in INTEGER:
            low, high = INTEGER[operation](*given)
        else:
            low, high = ends(operation, given)
            if operation == "mul" and arguments[0] is arguments[1]:
                low = 0.0 if given[0][0] < 0 < given[0][1] else max(low, 0.0)
            if operation == "sub" and arguments[0] in _largest_of(arguments[1]):
                high = min(high, 0.0)
            if operation == "add" and low < _POWER and self._holds_the_largest_power(term):
                low = _POWER
        if not (math.isfinite(low) and math.isfinite(high)) and operation not in ("min", "max", "neg", "abs"):
            raise NotProvedError(f"{operation} may overflow")
        return low, high, False

    def _holds_the_largest_power(self, total: Term) -> bool:
        """Whether a sum of what is not negative has exp(x - largest) for each x of which `largest` is the largest.

        One of these is exp(0.0), so that the sum is no smaller: additions of what is not negative never fall.
        """
        if not any(map(_exponent, total.arguments)):
            return False  # it held them before this term or does not now: the sums of many terms are not looked through
        seen: set[Value] = set()
        largest: Value | None = None
        for summand in _summands(total):
            if self.interval(summand)[0] < 0:
                return False
            apart = _exponent(summand)
            if apart is not None and (largest is None or largest is apart[1]):
                seen.add(apart[0])
                largest = apart[1]
        return largest is not None and _largest_of(largest) <= seen

    def _least(self, value: Value) -> float:
        """A number above zero below which the magnitude of a value does not lie; 0.0: none is known."""
        if not isinstance(value, Term):
            return abs(float(value))
        for layer in reversed(self._apart):
            if value in layer:
                return layer[value]
        low, high, _ = self.interval(value)
        return max(low, -high, 0.0)

    def apart(self, value: Value, number: float) -> bool:
        """Whether a value is known to be another number than `number`."""
        low, high, _ = self.interval(value)
        if number < low or number > high:
            return True
        return any(
            term.operation == "sub" and term.arguments[0] is value and term.arguments[1] == number
            for layer in self._apart
            for term in layer
        )

    def _quotient(self, arguments: tuple[Value, ...], given: list[Interval]) -> tuple[float, float]:
        least = self._least(arguments[1])
        if not least:
            raise NotProvedError("a division by what may be zero")
        known = self._known_quotient(*arguments)
        low, high = given[1][0], given[1][1]
        divisors = [low, high]
        if low <= 0 <= high:
            divisors = ([low] if low < 0 else []) + ([-least] if low < 0 else []) + ([least, high] if high > 0 else [])
        with np.errstate(all="ignore"):
            found = [float(np.float64(a) / np.float64(b)) for a in given[0][:2] for b in divisors]
        if known is not None:
            found = [min(max(number, -known), known) for number in found]
            if given[1][0] < 0 < given[1][1]:
                found += [-known, known]
        if not all(map(math.isfinite, found)):
            raise NotProvedError("div may overflow")
        return min(found), max(found)

    def _known_quotient(self, top: Value, bottom: Value) -> float | None:
        """A bound of the magnitude of some quotients that intervals cannot see."""
        magnitudes = [self._seen("abs", value) for value in (top, bottom)]
        sizes = [
            [size, value] if self.interval(value)[0] >= 0 else [size]
            for value, size in zip((top, bottom), magnitudes, strict=True)
        ]
        if any(self._is_no_larger(one, other) for one in sizes[0] for other in sizes[1]):
            return 1.0
        guarded = self._guarded_quotient(*magnitudes)
        if guarded is not None:
            return guarded
        summands = [] if not isinstance(bottom, Term) else _summands(bottom)
        if any(value is top or value is magnitudes[0] for value in summands if isinstance(value, Term)) and all(
            self.interval(value)[0] >= 0 for value in summands
        ):
            return 2.0  # a part of a sum of what is not negative
        product, apart, logarithm = arguments_of(top, "mul"), arguments_of(bottom, "sub"), arguments_of(bottom, "ln")
        if product is not None:
            one, other = product
            size = max(map(abs, self.interval(one)[:2]))
            # log(u) * x / (u - 1) with u = 1 + x: |x / (u - 1)| <= 2, and (u - 1) * x / log(u) with u = exp(x)
            if apart is not None and apart[1] == 1.0 and apart[0] is self._seen("add", 1.0, other):
                return 2.0 * size if one is self._seen("ln", apart[0]) else None
            if logarithm is not None and logarithm[0] is self._seen("exp", other):
                return 4.0 * size if one is self._seen("sub", logarithm[0], 1.0) else None
        return None

    def _guarded_quotient(self, top: Term | None, bottom: Term | None) -> float | None:
        """1 / c where |bottom| > |top| * c is known; for a product that is denormal too, since floats are apart."""
        for layer in self._truths:
            for term, truth in layer.items():
                if truth is (term.operation == "GT") and term.operation in ("GT", "LE") and term.arguments[0] is bottom:
                    product = term.arguments[1]
                    if isinstance(product, Term) and product.operation == "mul" and product.arguments[0] is top:
                        return (1.0 + 1e-15) / float(product.arguments[1])
        return None

    def _seen(self, operation: str, *arguments: object) -> Term | None:
        return self._known.get((operation, "real", *map(_name, arguments)))

    def _is_no_larger(self, one: Value | None, other: Value | None) -> bool:
        for name, pair in (("LE", (one, other)), ("LT", (one, other)), ("GE", (other, one)), ("GT", (other, one))):
            for operator, truth in ((name, True), (NEGATED[name], False)):
                term = self._known.get((operator, "bool", *map(_name, pair)))
                if term is not None and self.truth(term) is truth:
                    return True
        return False

    def integer(self, operation: str, *arguments: Value, low: int, high: int) -> Value:
        """An operation on integers that must stay within `low` .. `high`."""
        if not any(isinstance(argument, Term) for argument in arguments):
            ends = INTEGER[operation](*(self.interval(argument) for argument in arguments))
            result: Value = int(ends[0])
        else:
            term = self._term(operation, arguments, "int")
            interval = self._result(operation, arguments, term)
            self._note(term, interval)
            ends, result = interval[:2], term
        if ends[0] < low or ends[1] > high:
            raise NotProvedError("an integer overflows")
        return result

    # --- truth values -----------------------------------------------------------------------------------------------

    def compare(self, operator: str, one: Value, other: Value) -> Value:
        """A comparison of numbers. Raises NotProvedError where one may be NaN."""
        for value in (one, other):
            if self.interval(value)[2]:
                raise NotProvedError("a comparison with NaN")
        if operator in ("EQ", "NE"):
            for value, number in ((one, other), (other, one)):
                if isinstance(value, Term) and value.operation == "if" and not isinstance(number, Term):
                    condition, first, second = value.arguments
                    return self.choice(
                        condition,
                        self.compare(operator, first, number),
                        self.compare(operator, second, number),
                    )
        decided = self._decided(operator, one, other)
        if decided is not None:
            return decided
        if not isinstance(one, Term):
            one, other, operator = other, one, FLIPPED[operator]
        term = self._term(operator, (one, other), "bool")
        known = self.truth(term)
        return term if known is None else known

    def _decided(self, operator: str, one: Value, other: Value) -> bool | None:
        (a, b, _), (c, d, _) = self.interval(one), self.interval(other)
        if operator == "LT":
            return True if b < c else False if a >= d else None
        if operator == "LE":
            return True if b <= c else False if a > d else None
        if operator in ("GT", "GE"):
            return self._decided(FLIPPED[operator], other, one)
        equal = True if a == b == c == d else False if b < c or d < a else None
        return equal if operator == "EQ" or equal is None else not equal

    def is_number(self, value: Value) -> Value:
        """Whether a value is not NaN."""
        low, high, nan = self.interval(value)
        if not nan:
            return True
        if low > high:
            return False
        return self._term("number", (value,), "bool")

    def negated(self, value: Value) -> Value:
        """NOT of a truth value."""
        if not isinstance(value, Term):
            return not value
        if value.operation == "not":
            inner: Value = value.arguments[0]
            return inner
        return self._term("not", (value,), "bool")

    def both(self, one: Value, other: Value) -> Value:
        """AND of truth values."""
        for value, rest in ((one, other), (other, one)):
            if not isinstance(value, Term):
                return rest if value else False
        return one if one is other else self._term("and", (one, other), "bool")

    def either(self, one: Value, other: Value) -> Value:
        """OR of truth values."""
        return self.negated(self.both(self.negated(one), self.negated(other)))

    def choice(self, condition: Value, one: Value, other: Value) -> Value:  # noqa: PLR0911 - one a shape
        """`one` where the condition holds, else `other`."""
        if not isinstance(condition, Term):
            return one if condition else other
        one, other = (True if one is condition else one), (False if other is condition else other)
        if one is other or (type(one) is type(other) and not isinstance(one, Term) and _name(one) == _name(other)):
            return one
        if isinstance(one, bool) or isinstance(other, bool) or (isinstance(one, Term) and one.kind == "bool"):
            if other is False:
                return self.both(condition, one)
            if one is False:
                return self.both(self.negated(condition), other)
            if other is True:
                return self.either(self.negated(condition), one)
            if one is True:
                return self.either(condition, other)
        kinds = {value.kind if isinstance(value, Term) else type(value).__name__ for value in (one, other)}
        kind = "bool" if "bool" in kinds else "int" if kinds <= {"int"} else "real"
        term = self._term("if", (condition, one, other), kind)
        term.minus_zero = any(map(_may_be_minus_zero, (one, other)))
        term.single = all(map(_is_single, (one, other)))
        return term

    def where(self, condition: Value, then: Side, otherwise: Side) -> Value:
        """`then` where a condition holds, else `otherwise`; each is made where that is known."""
        if not isinstance(condition, Term):
            return _made(then if condition else otherwise)
        sides = []
        for truth, side in ((True, then), (False, otherwise)):
            with self.assuming(condition, truth):
                value = _made(side)
                sides.append((value, self.interval(value)))
        return self.merged(condition, *sides)

    def branch(self, operator: str, one: Value, other: Value, then: Side, otherwise: Side) -> Value:
        """`then` where a comparison holds, else `otherwise`, as in `where`."""
        return self.where(self.compare(operator, one, other), then, otherwise)

    def merged(self, condition: Term, one: tuple[Value, Interval], other: tuple[Value, Interval]) -> Value:
        """A choice between values whose intervals are those of their branches."""
        result = self.choice(condition, one[0], other[0])
        if isinstance(result, Term) and result.operation == "if" and result.kind != "bool":
            self._note(result, hull(one[1], other[1]))
        return result

    def truth(self, value: Value) -> bool | None:
        """Whether a truth value is known here."""
        return self._truth(value, {}) if isinstance(value, Term) else bool(value)

    def _truth(self, value: Value, asked: dict[Term, bool | None]) -> bool | None:
        """The truth of a value; asked: what is known of its parts by now, which stand in it many times."""
        if not isinstance(value, Term):
            return bool(value)
        if value not in asked:
            asked[value] = self._truth_of(value, asked)
        return asked[value]

    def _truth_of(self, value: Term, asked: dict[Term, bool | None]) -> bool | None:  # noqa: PLR0911 - one a kind
        for layer in reversed(self._truths):
            if value in layer:
                return layer[value]
        arguments = value.arguments
        if value.operation == "not":
            inner = self._truth(arguments[0], asked)
            return None if inner is None else not inner
        if value.operation == "and":
            found = []
            for argument in arguments:
                found.append(self._truth(argument, asked))
                if found[-1] is False:
                    return False
            return True if None not in found else None
        if value.operation == "if":
            condition = self._truth(arguments[0], asked)
            sides = [self._truth(argument, asked) for argument in arguments[1:]]
            if condition is not None:
                return sides[0] if condition else sides[1]
            return sides[0] if sides[0] is sides[1] else None
        if value.operation in NEGATED:
            negative = self._known.get((NEGATED[value.operation], "bool", *map(_name, arguments)))
            for layer in reversed(self._truths):
                if negative in layer:
                    return not layer[negative]
            return self._decided(value.operation, *arguments)
        if value.operation == "number":
            low, high, nan = self.interval(arguments[0])
            return True if not nan else False if low > high else None
        return None

    @contextmanager
    def assuming(self, condition: Value, truth: bool = True) -> Iterator[bool]:
        """A branch in which a condition is known; gives FALSE where it cannot be reached."""
        for layers in (self._intervals, self._truths, self._apart):
            layers.append({})
        try:
            yield self._assume(condition, truth)
        finally:
            for layers in (self._intervals, self._truths, self._apart):
                layers.pop()

    @contextmanager
    def only(self, leaf: Term, interval: Interval) -> Iterator[None]:
        """A look at terms from their leaves up, where one of these lies in another interval; nothing else is known."""
        layers = self._intervals, self._truths, self._apart
        leaves = {term: known for term, known in self._intervals[0].items() if term.operation == "leaf"}
        self._intervals, self._truths, self._apart = [{**leaves, leaf: interval}], [{}], [{}]
        try:
            yield
        finally:
            self._intervals, self._truths, self._apart = layers

    def _assume(self, value: Value, truth: bool) -> bool:  # noqa: PLR0911 - one return a kind
        if not isinstance(value, Term):
            return bool(value) is truth
        known = self.truth(value)
        if known is not None:
            return known is truth
        self._truths[-1][value] = truth
        arguments = value.arguments
        if value.operation == "not":
            return self._assume(arguments[0], not truth)
        if value.operation == "and":
            if truth:
                narrowed = [self._assume(argument, True) for argument in arguments]
                return all(narrowed)
            for one, other in (arguments, arguments[::-1]):
                if self.truth(one):
                    return self._assume(other, False)
        elif value.operation == "if":
            for at, holds in ((1, False), (2, True)):  # a side that cannot be tells the condition
                if self.truth(arguments[at]) is (not truth):
                    return self._assume(arguments[0], holds) and self._assume(arguments[3 - at], truth)
        elif value.operation == "number":
            low, high, _ = self.interval(arguments[0])
            ends = (low, high, False) if truth else (math.inf, -math.inf, True)
            return self._narrow(arguments[0], ends)
        elif value.operation in NEGATED:
            return self._assume_order(value.operation if truth else NEGATED[value.operation], *arguments)
        return True

    def _assume_order(self, operator: str, one: Value, other: Value) -> bool:
        if operator in ("GT", "GE"):
            one, other, operator = other, one, FLIPPED[operator]
        (a, b, _), (c, d, _) = self.interval(one), self.interval(other)
        whole = all(isinstance(v, int) or (isinstance(v, Term) and v.kind == "int") for v in (one, other))
        if operator == "EQ":
            both = (max(a, c), min(b, d), False)
            return self._narrow(one, both) and self._narrow(other, both)
        if operator == "NE":
            return True
        strict = operator == "LT"
        top = (d - 1 if whole else math.nextafter(d, -math.inf)) if strict else d
        bottom = (a + 1 if whole else math.nextafter(a, math.inf)) if strict else a
        return self._narrow(one, (a, min(b, top), False)) and self._narrow(other, (max(c, bottom), d, False))

    def _narrow(self, value: Value, interval: Interval) -> bool:
        if not isinstance(value, Term):
            return interval[2] or interval[0] <= interval[1]
        found = cut(self.interval(value), interval)
        self._intervals[-1][value] = found
        if value.operation == "abs":
            inner: Value = value.arguments[0]
            self._narrow(inner, (-found[1], found[1], False))
            if found[0] > 0:
                self._not_zero(inner, found[0])
        return found[2] or found[0] <= found[1]

    def _not_zero(self, value: Value, least: float) -> None:
        if not isinstance(value, Term):
            return
        if value.operation == "sub" and isinstance(value.arguments[1], float):
            # two different numbers, of which one is known, are half a unit in its last place apart
            least = max(least, abs(value.arguments[1]) * _HALF_ULP)
        self._apart[-1][value] = least
        low, high, nan = self.interval(value)
        if low >= 0:
            self._intervals[-1][value] = (max(low, least), high, nan)
        elif high <= 0:
            self._intervals[-1][value] = (low, min(high, -least), nan)


def _made(side: Side) -> Value:
    return side() if callable(side) else side


def _may_be_minus_zero(value: Value) -> bool:
    return value.minus_zero if isinstance(value, Term) else value == 0 and math.copysign(1.0, value) < 0


def _is_single(value: Value) -> bool:
    if isinstance(value, Term):
        return value.single
    with np.errstate(over="ignore"):
        return float(np.float32(value)) == value


def _simpler(operation: str, arguments: tuple[Value, ...]) -> Value | None:
    """The operand that is the result of an operation for all numbers, such as x of x + 0; None where neither is."""
    if operation == "single":
        return arguments[0] if _is_single(arguments[0]) else None
    for one, other in (arguments, arguments[::-1]) if len(arguments) == 2 else ():
        if isinstance(one, Term):
            continue
        if operation == "add" and one == 0 and (_may_be_minus_zero(one) or not _may_be_minus_zero(other)):
            return other
        # the largest number is where a running minimum starts: it is never the result
        if (operation, one) in (("min", LARGEST), ("max", -LARGEST)):
            return other
    return None


def _facts(operation: str, arguments: tuple[Value, ...]) -> tuple[bool, bool]:
    """Whether a result can be -0.0, and whether it is a float32 number for sure."""
    if operation == "add":
        return all(map(_may_be_minus_zero, arguments)), False
    if operation in ("min", "max"):
        return any(map(_may_be_minus_zero, arguments)), all(map(_is_single, arguments))
    if operation == "single":
        below = arguments[0]
        # a sum of float32 numbers is zero or a float32 number at least: rounding it makes no zero
        exact = isinstance(below, Term) and below.operation == "add" and all(map(_is_single, below.arguments))
        return _may_be_minus_zero(below) if exact else True, True
    return True, False


def _largest_of(value: Value) -> set[Value]:
    """The numbers of which a value is the largest, as a chain of IF x > largest THEN largest := x."""
    found: set[Value] = set()
    while (choice := arguments_of(value, "if")) is not None:
        condition, one, other = choice
        pair = arguments_of(condition, "GT") or (arguments_of(condition, "LT") or ())[::-1]
        if tuple(map(_name, pair)) != (_name(one), _name(other)):
            break
        found.add(one)
        value = other
    return {*found, value}


def _exponent(value: Value) -> tuple[Value, ...] | None:
    """(x, largest) of IF x - largest > c THEN exp(x - largest) ELSE 0, rounded to REAL or not, with c below zero."""
    condition, power, otherwise = arguments_of(value, "if") or (None, None, None)
    (power,) = arguments_of(power, "single") or (power,)
    (apart,) = arguments_of(power, "exp") or (None,)
    compared, cut = arguments_of(condition, "GT") or (None, None)
    if otherwise != 0.0 or apart is None or compared is not apart or not isinstance(cut, float) or cut >= 0:
        return None
    return arguments_of(apart, "sub")


def _summands(term: Value) -> list[Value]:
    """What a sum is made of, through its roundings to REAL."""
    found: list[Value] = []
    while isinstance(term, Term) and term.operation in ("add", "single"):
        if term.operation == "add":
            found.append(term.arguments[1])
        term = term.arguments[0]
        if isinstance(term, Term) and term.operation == "single" and term.arguments[0] is not None:
            inner = term.arguments[0]
            if not (isinstance(inner, Term) and inner.operation == "add"):
                break
    return [*found, term]
