"""Values of all inputs brought together: on the intervals of one input or on boxes of several; truth values, branches.

Whatever is not known here raises NotProvedError.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from st_codegen.ir.arrays import AnyArray, BoolArray
from st_codegen.proof.prove.axis import AxisValue, InputAxis, require_assigned
from st_codegen.proof.prove.boxes import Lanes, Slots, Space
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.terms import Term
from st_codegen.proof.prove.values import (
    NOTHING,
    Absent,
    All,
    Bits,
    ComputedError,
    Conditional,
    Kept,
    Value,
    by_input,
    is_scalar,
)


class Joining:
    """Values of one call of a block, on `axes` of its inputs."""

    def __init__(self, axes: Sequence[InputAxis]) -> None:
        self.axes = axes
        #: The boxes of the statement that is executed: both sides of an IF are to assign on the same ones.
        self._open: Space | None = None

    def _require_known(self, condition: Value, mask: Value) -> None:
        """Raise NotProvedError for a condition that has no value everywhere in a mask."""
        if isinstance(condition, AxisValue) and condition.lift().known is not None:
            active = self._active_on_axis(mask, condition.axis)
        elif isinstance(condition, Lanes) and condition.lift().known is not None:
            active = self._active(mask, condition.space)
        else:
            return
        require_assigned(condition.lift().known, active, "a decision")

    def _merged(self, new: Value, old: Value, mask: Value) -> Value:
        """`new` where the mask holds, else `old`."""
        if mask is True:
            return new
        if new is False and isinstance(mask, AxisValue) and isinstance(old, bool | AxisValue | All):
            return self._logic("AND", old, self._not(mask))
        if isinstance(mask, All) or isinstance(new, Term | Kept) or isinstance(old, Kept | Term):
            return Conditional(mask, new, old)
        stale = isinstance(old, Absent | Slots | Bits) or (
            isinstance(old, Lanes)
            and old.space is not self._open
            and not any(isinstance(v, Lanes) and v.space is old.space for v in (new, mask))
        )
        if isinstance(new, AxisValue) and new.chain is not None:
            stale = stale or (not (isinstance(old, AxisValue) and old.axis is new.axis) and not is_scalar(old))
        if isinstance(mask, AxisValue) and isinstance(old, AxisValue) and old.axis is not mask.axis:
            # what another input gave before is forgotten: in loops over columns each branch assigns
            stale = stale or is_scalar(new) or (isinstance(new, AxisValue) and new.axis is mask.axis)
        return self._where(mask, new, None if stale else old)

    def _where(self, mask: Value, new: Value, old: Value) -> Value:
        axis_values = [value for value in (mask, new, old) if isinstance(value, AxisValue)]
        only_axis = axis_values and not any(isinstance(value, Lanes | Slots) for value in (mask, new, old))
        if only_axis and len({id(value.axis) for value in axis_values}) == 1:
            return self._where_on_axis(axis_values[0].axis, mask, new, old)
        parts = [mask, new] if old is None else [mask, new, old]
        space, arrays = self.joined(parts, True, needed=False)
        active = np.asarray(arrays[0], np.bool_)
        known = self._known_of(parts[1], space)
        if old is None:
            return Lanes(space, arrays[1], active & known)
        kept = self._known_of(old, space)
        return Lanes(space, np.where(active, arrays[1], arrays[2]), np.where(active, known, kept))

    @staticmethod
    def _known_of(value: Value, space: Space) -> BoolArray:
        if isinstance(value, AxisValue) and value.lift().known is not None:
            return space.resolve(value, np.ones(space.lanes, np.bool_))[1]
        if isinstance(value, Lanes) and value.space is space and value.lift().known is not None:
            return np.asarray(value.known)
        return np.ones(space.lanes, np.bool_)

    def _where_on_axis(self, axis: InputAxis, mask: Value, new: Value, old: Value) -> AxisValue:
        active = np.asarray(self._on_axis(mask, axis).constant, np.bool_)
        first = self._on_axis(new, axis)
        if old is None:
            there = active if first.known is None else active & first.known
            return AxisValue(axis, first.constant, first.chain, first.chains, there)
        second = self._on_axis(old, axis)
        known: BoolArray | None = None
        if first.known is not None or second.known is not None:
            sides = [np.ones(axis.lanes, np.bool_) if v.known is None else v.known for v in (first, second)]
            known = np.where(active, sides[0], sides[1])
        constant = np.where(active, first.constant, second.constant)
        if first.chain is None and second.chain is None:
            return AxisValue(axis, constant, known=known)
        none = np.zeros(axis.lanes, np.int64)
        one = none if first.chain is None else first.chain
        other = none if second.chain is None else second.chain
        shifted = np.where(other > 0, other + len(first.chains), 0)
        chain = np.where(active, one, shifted)
        return AxisValue(axis, constant, chain, (*first.chains, *second.chains), known)

    def _settled(self, slots: Slots, mask: Value) -> Value:
        """Slots as a number for each lane."""
        space = slots.space
        result: Lanes | None = None
        for number in np.unique(slots.index.lift().value).tolist():
            item = slots.items[number] if 0 <= number < len(slots.items) else NOTHING
            active = self._active(mask, space) & (slots.index.lift().value == number)
            if not np.any(active):
                continue
            if isinstance(item, AxisValue):
                value, known = space.resolve(item, active)
                require_assigned(known, self._active(mask, space) & (slots.index.lift().value == number), "an element")
            elif is_scalar(item):
                value = np.full(space.lanes, item)
            else:
                raise NotProvedError("an element that depends on several inputs")
            here = slots.index.lift().value == number
            old = np.zeros(space.lanes, value.dtype) if result is None else result.lift().value
            result = Lanes(space, np.where(here, value, old))
        if result is None:
            raise NotProvedError("nothing is read")
        return result

    def _not(self, value: Value) -> Value:
        if isinstance(value, bool):
            return not value
        if isinstance(value, AxisValue):
            value.lift()
            return AxisValue(value.axis, ~value.constant.astype(np.bool_), known=value.known)
        if isinstance(value, Slots):
            value = self._settled(value, True)
        if isinstance(value, Lanes):
            value.lift()
            return Lanes(value.space, ~value.value.astype(np.bool_), value.known)
        raise ComputedError("NOT of a condition on several inputs")

    def _logic(self, operator: str, left: Value, right: Value) -> Value:
        for one, other in ((left, right), (right, left)):
            if isinstance(one, bool):
                return other if one is (operator == "AND") else one
        if operator == "AND" and all(isinstance(value, AxisValue | All) for value in (left, right)):
            parts: dict[int, AxisValue] = {}
            for value in (left, right):
                for axis, part in by_input(value).items():
                    known = parts.get(axis)
                    parts[axis] = part if known is None else self._where_on_axis(part.axis, part, known, False)
            return next(iter(parts.values())) if len(parts) == 1 else All(parts)
        if isinstance(left, All) or isinstance(right, All):
            raise ComputedError("a condition on several inputs")

        def combined(a: AnyArray, b: AnyArray, _: BoolArray) -> AnyArray:
            return a.astype(np.bool_) & b.astype(np.bool_) if operator == "AND" else a.astype(np.bool_) | b

        return self._elementwise(combined, [left, right], True, needed=False)

    def _inside(self, mask: Value, condition: Value) -> Value:
        """Where a condition holds in a branch: in boxes, once two inputs have been decided. Others are not split."""
        apart = isinstance(mask, AxisValue) and isinstance(condition, AxisValue) and mask.axis is not condition.axis
        if not apart and not (isinstance(mask, Lanes) and isinstance(condition, AxisValue)):
            return self._logic("AND", mask, condition)
        space, (holds,) = self.joined([condition], mask, needed=False)
        return Lanes(space, self._active(mask, space) & holds.astype(np.bool_))

    def _any(self, mask: Value) -> bool:
        if isinstance(mask, bool):
            return mask
        if isinstance(mask, AxisValue):
            return bool(np.any(mask.lift().constant))
        if isinstance(mask, Lanes):
            return bool(np.any(mask.lift().value))
        if isinstance(mask, All):
            return all(self._any(part) for part in mask.parts.values())
        raise NotProvedError("a condition that is not followed")

    def _on_axis(self, value: Value, axis: InputAxis) -> AxisValue:
        if isinstance(value, AxisValue):
            return value.lift()
        return AxisValue(axis, np.full(axis.lanes, value))

    def _active_on_axis(self, mask: Value, axis: InputAxis) -> BoolArray:
        """The lanes of an axis in which a mask may hold."""
        if isinstance(mask, AxisValue) and mask.axis is axis:
            return np.asarray(mask.lift().constant, np.bool_)
        return np.ones(axis.lanes, np.bool_)

    def _active(self, mask: Value, space: Space) -> BoolArray:
        """The lanes of a space in which a mask holds; the space may be split for it."""
        if mask is True:
            return np.ones(space.lanes, np.bool_)
        if isinstance(mask, Lanes):
            if mask.space is not space:
                raise NotProvedError("conditions on two different trees")
            return np.asarray(mask.lift().value, np.bool_)
        if isinstance(mask, AxisValue):
            value, _ = space.resolve(mask, np.ones(space.lanes, np.bool_))
            return value.astype(np.bool_)
        raise NotProvedError("a condition that is not followed")

    def joined(
        self, values: Sequence[Value], mask: Value, *, needed: bool = True, space: Space | None = None
    ) -> tuple[Space, list[AnyArray]]:
        """Values on the lanes of one space; `needed`: they must have been assigned wherever the mask holds."""
        values = [self._settled(value, mask) if isinstance(value, Slots) else value for value in values]
        for value in (*values, mask):
            if isinstance(value, Lanes):
                if space is not None and value.space is not space:
                    raise NotProvedError("arithmetic on values of two different trees")
                space = value.space
        self._open = space = space or self._open or Space(self.axes)
        self._active(mask, space)
        parts: list[Lanes] = []
        for value in values:
            if isinstance(value, AxisValue):
                found, known = space.resolve(value, self._active(mask, space))
                parts.append(Lanes(space, found, known))
            elif isinstance(value, Lanes):
                parts.append(value)
            elif is_scalar(value):
                parts.append(Lanes(space, np.full(space.lanes, value)))
            else:
                raise NotProvedError(f"arithmetic on {type(value).__name__}")
        active = self._active(mask, space)
        for part in parts:
            part.lift()
            if needed:
                require_assigned(part.known, active)
        return space, [part.value for part in parts]

    def _elementwise(
        self, compute: Callable[..., AnyArray], values: Sequence[Value], mask: Value, *, needed: bool = True
    ) -> Value:
        """An operation on numbers, lane by lane; `compute` also takes the lanes in which it has to succeed."""
        values = [self._settled(value, mask) if isinstance(value, Slots) else value for value in values]
        if any(isinstance(value, Term | All | Bits | Kept | Conditional | Absent) for value in values):
            raise ComputedError("an operation on a computed number that is not followed")
        if all(is_scalar(value) for value in values):
            result = compute(*(np.array([value]) for value in values), np.ones(1, np.bool_))
            return result[0].item()
        axes = {id(value.axis): value.axis for value in values if isinstance(value, AxisValue)}
        if len(axes) == 1 and not any(isinstance(value, Lanes) for value in values):
            axis = next(iter(axes.values()))
            on_axis = [self._on_axis(value, axis) for value in values]
            active = self._active_on_axis(mask, axis)
            for value in on_axis:
                if value.chain is not None and np.any((value.chain > 0) & active):
                    raise NotProvedError("a number that varies with an input where a constant is needed")
                if needed:
                    require_assigned(value.known, active)
            return AxisValue(axis, np.asarray(compute(*(value.constant for value in on_axis), active)))
        space, arrays = self.joined(values, mask, needed=needed)
        return Lanes(space, np.asarray(compute(*arrays, self._active(mask, space))))
