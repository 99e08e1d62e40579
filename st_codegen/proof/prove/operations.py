"""Operations on values of all inputs: arithmetic, comparisons and conversions.

Comparisons are decided for whole intervals and boxes, which are cut where they have to be. Sums of several trees are
kept as expressions. What would stop a controller (a comparison with NaN, an overflow) raises NotProvedError.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from st_codegen.ir.arrays import AnyArray, BoolArray, FloatArray, IntArray
from st_codegen.proof.prove.axis import HIGHEST, LOWEST, AxisValue, InputAxis, require_assigned
from st_codegen.proof.prove.boxes import Lanes, Slots, Space
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.floats import COMPARE, FLIPPED, INFINITY, MAGNITUDE, OPERATIONS
from st_codegen.proof.prove.inputs import InputTerms
from st_codegen.proof.prove.intervals import compute
from st_codegen.proof.prove.joining import Joining
from st_codegen.proof.prove.terms import Term
from st_codegen.proof.prove.terms import Value as Number
from st_codegen.proof.prove.values import Bits, ComputedError, Value, is_scalar
from st_codegen.st.types import Elementary, Type

_FLOAT = {"ADD": "add", "SUB": "sub", "MUL": "mul", "DIV": "div", "MIN": "min", "MAX": "max"}


def _quotient(a: IntArray, b: IntArray) -> IntArray:
    """Towards zero, as IEC 61131-3 has it."""
    return np.abs(a) // np.abs(b) * np.sign(a) * np.sign(b)


#: Operations on int64 numbers.
_INTEGER: dict[str, Callable[[IntArray, IntArray], IntArray]] = {
    "ADD": np.add,
    "SUB": np.subtract,
    "MUL": np.multiply,
    "DIV": _quotient,
    "MOD": lambda a, b: a - _quotient(a, b) * b,
    "AND": np.bitwise_and,
    "OR": np.bitwise_or,
    "XOR": np.bitwise_xor,
}


#: Names a value that differs from box to box when it enters a sum: a leaf of a tree.
Recogniser = Callable[[Lanes | Slots], Number]


class ValueOperations(Joining):
    """Arithmetic, comparisons and conversions of the values of one call of a block.

    `recognise` names a value that differs from box to box when it enters a sum (a leaf of a tree).
    """

    def __init__(self, axes: Sequence[InputAxis], inputs: InputTerms, recognise: Recogniser) -> None:
        super().__init__(axes)
        self.inputs, self.terms, self.recognise = inputs, inputs.terms, recognise
        self._terms: dict[int, tuple[Value, Number]] = {}

    def _binary(self, operator: str, left: Value, right: Value, mask: Value, kind: Type | None) -> Value:
        if isinstance(kind, Elementary) and kind.is_real:
            return self._float(_FLOAT[operator], [left, right], mask)
        if isinstance(left, Bits) or isinstance(right, Bits):
            bits, other = (left, right) if isinstance(left, Bits) else (right, left)
            if operator == "AND" and other == MAGNITUDE and isinstance(bits, Bits):
                return Bits(bits.value, magnitude=True)
            raise NotProvedError("arithmetic on the bits of a number")
        if isinstance(kind, Elementary) and kind.name == "BOOL":
            if operator in ("AND", "OR"):
                for side in (left, right):
                    self._require_known(side, mask)
                return self._logic(operator, left, right)
            raise NotProvedError(f"{operator} of truth values")
        return self._elementwise(_integers(operator, kind), [left, right], mask)

    def _float(self, name: str, values: list[Value], mask: Value) -> Value:
        """A floating point operation: on constants and on chains of one input as it is, else as an expression."""
        numbers = [value for value in values if isinstance(value, bool | int | float)]
        if len(numbers) == len(values):
            return compute(name, *map(float, numbers))
        axis_values = [value for value in values if isinstance(value, AxisValue)]
        # what is constant in each lane is the leaf of a tree or an element of a table: a term of a sum; but a limit of
        # it is still a number that trees compare
        limited = name != "add" and len(numbers) == 1
        terms = name in ("add", "min", "max") and not limited and any(value.chain is None for value in axis_values)
        if (
            not terms
            and len(axis_values) + sum(map(is_scalar, values)) == len(values)
            and len({id(value.axis) for value in axis_values}) == 1
        ):
            found = self._float_on_axis(name, values, axis_values[0].axis, mask)
            if found is not None:
                return found
        return self.terms.real(name, *(self.as_term(value) for value in values))

    def _float_on_axis(self, name: str, values: list[Value], axis: InputAxis, mask: Value) -> AxisValue | None:
        if name == "abs" and isinstance(values[0], AxisValue):
            values[0].cut_where(lambda x, _: x < 0, np.arange(axis.lanes))
        on_axis = [self._on_axis(value, axis) for value in values]
        moving = [value for value in on_axis if value.chain is not None and np.any(value.chain > 0)]
        active = self._active_on_axis(mask, axis)
        numbers = [value.constant.astype(np.float64) for value in on_axis]
        with np.errstate(all="ignore"):
            result = OPERATIONS[name](*numbers)
        still = active.copy()
        for value in moving:
            still &= np.asarray(value.chain) == 0
        for value in on_axis:
            require_assigned(value.known, active)
        finite = np.all([np.isfinite(number) for number in numbers], axis=0)
        if np.any(still & finite & ~np.isfinite(result)) or np.any(still & np.isnan(result)):
            raise NotProvedError(f"the operation {name} can overflow or meet NaN")
        if not moving:
            return AxisValue(axis, np.asarray(result))
        if len(moving) > 1:
            return None
        if len(on_axis) == 1:
            return moving[0].with_links(name, np.zeros(axis.lanes), np.asarray(result), active)
        constants = numbers[1] if moving[0] is on_axis[0] else numbers[0]
        if name == "div" and moving[0] is on_axis[1]:
            return None
        link = name if moving[0] is on_axis[0] else f"r{name}"
        return moving[0].with_links(link, constants, np.asarray(result), active)

    def as_term(self, value: Value) -> Number:
        """A value as a term. What differs from box to box must be a tree's."""
        if isinstance(value, Term):
            return value
        if isinstance(value, bool | int | float):
            return float(value)
        if id(value) not in self._terms:
            self._terms[id(value)] = value, self._as_term(value)
        return self._terms[id(value)][1]

    def as_number(self, value: Value) -> Number:
        """A value as a term; integers and truth values stay what they are."""
        return value if isinstance(value, bool | int | float) else self.as_term(value)

    def _as_term(self, value: Value) -> Number:
        if isinstance(value, Slots) and any(isinstance(item, AxisValue) for item in value.items):
            value = self._settled(value, True)
        if isinstance(value, Lanes | Slots):
            return self.recognise(value)
        if isinstance(value, AxisValue) and value.lift().chain is None:
            space = Space(self.axes)
            found, known = space.resolve(value, np.ones(1, np.bool_))
            return self.recognise(Lanes(space, found, known))
        if isinstance(value, AxisValue):
            return self.inputs.number(value)
        raise NotProvedError(f"arithmetic on {type(value).__name__}")

    def _compare(self, operator: str, left: Value, right: Value, mask: Value) -> Value:
        if isinstance(left, Bits):
            if left.magnitude and operator == "GT" and right == INFINITY:
                return self._not(self._is_number(left.value))
            raise NotProvedError("a comparison of the bits of a number")
        if isinstance(right, Slots) and not isinstance(left, Slots):
            left, right, operator = right, left, FLIPPED[operator]
        if isinstance(right, Slots):
            right = self._settled(right, mask)
        if isinstance(left, Slots):
            if operator in ("EQ", "NE"):
                left = self._settled(left, mask)
            else:
                return self._compare_slots(operator, left, right, mask)
        if isinstance(left, Term) or isinstance(right, Term):
            raise ComputedError("a comparison of a computed number")
        values = [left, right]
        axis_values = [value for value in values if isinstance(value, AxisValue)]
        if (
            axis_values
            and len(axis_values) + sum(map(is_scalar, values)) == 2
            and len({id(value.axis) for value in axis_values}) == 1
        ):
            return self._compare_on_axis(operator, left, right, axis_values[0].axis, mask)

        def compared(a: AnyArray, b: AnyArray, active: BoolArray) -> AnyArray:
            if np.any((np.isnan(a) | np.isnan(b)) & active):
                raise NotProvedError("a comparison with NaN")
            return COMPARE[operator](a, b)

        return self._elementwise(compared, values, mask)

    def _compare_on_axis(self, operator: str, left: Value, right: Value, axis: InputAxis, mask: Value) -> AxisValue:
        one, other = self._on_axis(left, axis), self._on_axis(right, axis)
        if one.chain is None and other.chain is not None:
            one, other, operator = other, one, FLIPPED[operator]
        if other.chain is not None:
            active = self._active_on_axis(mask, axis)
            if np.any((other.chain > 0) & active):
                raise NotProvedError("a comparison of two numbers that vary with one input")
        compare = COMPARE[operator]
        steps = [compare] if operator not in ("EQ", "NE") else [np.less, np.less_equal]
        for step in steps:
            one.cut_where(
                lambda x, lanes, step=step: step(x, other.lift().constant[lanes]),  # type: ignore[misc]
                np.flatnonzero(self._active_on_axis(mask, axis)),
            )
        first, _ = one.ends()
        number = other.lift().constant
        active = self._active_on_axis(mask, axis)
        for value in (one, other):
            require_assigned(value.known, active)
        if np.any((np.isnan(first) | np.isnan(number)) & active):
            raise NotProvedError("a comparison with NaN")
        return AxisValue(axis, np.asarray(compare(first, number), np.bool_))

    def _is_number(self, value: Value) -> Value:
        if isinstance(value, float):
            return not np.isnan(value)
        if isinstance(value, AxisValue):
            value.lift()
            number = ~np.isnan(value.constant.astype(np.float64))
            if value.chain is not None:
                number |= value.chain > 0
            return AxisValue(value.axis, number, known=value.known)
        raise NotProvedError("a test for NaN of a computed number")

    def _compare_slots(self, operator: str, slots: Slots, right: Value, mask: Value) -> Value:
        space = slots.space
        while True:
            space_found, (thresholds,) = self.joined([right], mask, space=space)
            assert space_found is space
            active = self._active(mask, space)
            index = slots.index.lift().value
            if len(thresholds) == space.lanes == len(active):
                break
        feature = np.zeros(space.lanes, np.int64)
        last = np.full(space.lanes, LOWEST - 1, np.int64)
        nan = np.zeros(space.lanes, np.bool_)
        below = np.zeros(space.lanes, np.bool_)
        for number in np.flatnonzero(np.bincount(index[active])).tolist():
            lanes = np.flatnonzero(active & (index == number))
            item = slots.items[number]
            if is_scalar(item):
                feature[lanes] = 0
                decided = COMPARE[operator](item, thresholds[lanes])
                below[lanes], nan[lanes], last[lanes] = decided, decided, HIGHEST
                continue
            if not isinstance(item, AxisValue):
                raise NotProvedError("a comparison of an element that depends on several inputs")
            found = _changeovers(operator, item, thresholds[lanes])
            if found is None:
                return self._compare_settled(operator, slots, right, mask)
            feature[lanes] = item.axis.feature
            last[lanes], below[lanes], nan[lanes] = found
            if np.any(np.isnan(np.float64(item.lift().constant[-1]))) and np.any(
                space.nan[lanes, item.axis.feature] & active[lanes]
            ):
                raise NotProvedError("a comparison with NaN")
        return Lanes(space, space.decide(feature, last, below, nan, active))

    def _compare_settled(self, operator: str, slots: Slots, right: Value, mask: Value) -> Value:
        """Slots whose values neither rise nor fall along their input: every comparison for itself."""
        space = slots.space
        _, (thresholds,) = self.joined([right], mask, space=space)
        keys = np.unique(
            np.column_stack([slots.index.lift().value, thresholds])[self._active(mask, space)], axis=0
        ).tolist()
        limit = Lanes(space, thresholds)
        result = Lanes(space, np.zeros(space.lanes, np.bool_))
        for number, threshold in keys:
            item = slots.items[int(number)]
            if not isinstance(item, AxisValue):
                raise NotProvedError("a comparison of an element that depends on several inputs")
            decision = self._compare_on_axis(operator, item, threshold, item.axis, True)

            def here(number: float = number, threshold: float = threshold) -> BoolArray:
                chosen = (slots.index.lift().value == number) & (limit.lift().value == threshold)
                return np.asarray(chosen & self._active(mask, space), np.bool_)

            value, _ = space.resolve(decision, here())
            result = Lanes(space, np.where(here(), value, result.lift().value).astype(np.bool_))
        return result

    def _converted(self, value: Value, source: Type, target: Type, mask: Value) -> Value:
        if not isinstance(source, Elementary) or not isinstance(target, Elementary):
            raise NotProvedError(f"a conversion from {source} to {target}")
        if source.is_real and target.is_real:
            return value if target.bits >= source.bits else self._float("single", [value], mask)
        if source.is_real:
            raise NotProvedError(f"a conversion from {source} to {target}")
        if target.is_real:
            if target.bits < 64 or source.bits > 32:
                raise NotProvedError(f"a conversion from {source} to {target}")
            return self._elementwise(lambda a, _: a.astype(np.float64), [value], mask)

        def integers(a: AnyArray, active: BoolArray) -> AnyArray:
            a = a.astype(np.int64)
            same_size = source.bits == target.bits and source.name != "BOOL"
            if np.any(((a < target.lower) | (a > target.upper)) & active):
                if not same_size or target.bits > 32:
                    raise NotProvedError(f"a conversion from {source} to {target} that loses bits")
                a = a & ((1 << target.bits) - 1)
                a = np.where(a > target.upper, a - (1 << target.bits), a)
            return a

        return self._elementwise(integers, [value], mask)

    def _standard(self, name: str, arguments: list[Value], mask: Value, kind: Type) -> Value:
        if isinstance(kind, Elementary) and kind.is_real:
            if name == "ABS":
                return self._float("abs", arguments, mask)
            if name in ("MIN", "MAX"):
                result = arguments[0]
                for argument in arguments[1:]:
                    result = self._float(_FLOAT[name], [result, argument], mask)
                return result
            return self.terms.real(name.lower(), *(self.as_term(argument) for argument in arguments))
        if name == "TRUNC" and isinstance(kind, Elementary):
            # in all boxes: the condition may be one on inputs that are refused
            return self._elementwise(truncated(kind), arguments, True)
        raise NotProvedError(f"{name} is not followed")


def _integers(operator: str, kind: Type | None) -> Callable[..., AnyArray]:
    """An operation on integers of a type (DINT where it has none), on numbers of lanes."""
    lower, upper = -(2**31), 2**31 - 1
    if isinstance(kind, Elementary) and kind.is_integral:
        lower, upper = kind.lower, min(kind.upper, 2**62)

    def result(a: AnyArray, b: AnyArray, active: BoolArray) -> AnyArray:
        a, b = a.astype(np.int64), b.astype(np.int64)
        if operator not in _INTEGER:
            raise NotProvedError(f"{operator} is not followed")
        if operator in ("DIV", "MOD"):
            if np.any((b == 0) & active):
                raise NotProvedError("a division by zero")
            b = np.where(b == 0, 1, b)
        if operator == "MUL" and np.any((np.abs(a).astype(np.float64) * np.abs(b) > 2.0**61) & active):
            raise NotProvedError("an integer overflows")
        found = np.asarray(_INTEGER[operator](a, b))
        if np.any(((found < lower) | (found > upper)) & active):
            raise NotProvedError("an integer overflows")
        return found

    return result


def truncated(kind: Elementary) -> Callable[..., AnyArray]:
    """TRUNC to an integer type, on numbers of lanes. Raises NotProvedError where one does not fit."""

    def whole(a: AnyArray, active: BoolArray) -> AnyArray:
        inside = np.isfinite(a) & (np.trunc(np.where(np.isfinite(a), a, 0.0)) >= kind.lower)
        inside &= np.where(np.isfinite(a), a, 0.0) < kind.upper + 1.0
        if np.any(~inside & active):
            raise NotProvedError("TRUNC of a number that the type does not hold")
        return np.where(inside, a, 0.0).astype(np.int64)

    return whole


def _changeovers(operator: str, item: AxisValue, thresholds: FloatArray) -> tuple[AnyArray, AnyArray, AnyArray] | None:
    """Where comparisons of a rising or falling value with thresholds change over.

    Returns the last key before the change, the decision up to it, and that for NaN; None for a value that neither rises
    nor falls. Cuts the axis at these places.
    """
    axis, compare = item.axis, COMPARE[operator]
    item.held_alike()

    def beyond(limits: FloatArray) -> Callable[[FloatArray, IntArray], BoolArray]:
        return lambda x, places: np.asarray(compare(x, limits[places]), np.bool_)

    while True:
        order = item.in_order()
        if order is None:
            return None
        lanes, first, last, falling = order
        sign = -1 if falling else 1
        name = FLIPPED[operator] if falling else operator
        side: Literal["left", "right"] = "left" if name in ("LT", "GE") else "right"
        limits = sign * thresholds
        count = np.searchsorted(first, limits, side=side)  # lanes that begin below the threshold
        lane = np.maximum(count - 1, 0)
        ends_beyond = last[lane] >= limits if side == "left" else last[lane] > limits
        open_ = (count > 0) & ends_beyond
        if not np.any(open_):
            break
        distinct, at = np.unique(thresholds[open_], return_index=True)
        item.cut_lanes(lanes[lane[open_][at]], beyond(distinct))
    end = np.where(count > 0, axis.ends[lanes[lane]], LOWEST - 1)
    nan = np.asarray(compare(item.lift().constant[-1], thresholds))
    return end, np.full(len(thresholds), name in ("LT", "LE")), nan
