"""What the code for lanes calls besides operations: loops, labels, and lists whose index differs between lanes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NoReturn

import numpy as np

from st_codegen.st.check import arithmetic as a
from st_codegen.st.check.arithmetic import Fault
from st_codegen.st.run.runtime import Slot
from st_codegen.st.run.storage import Mask, ld, ndarray, put
from st_codegen.st.run.vector import and_then, or_else

# What generated code refers to
__all__ = ["Slot", "advance", "and_then", "for_test", "gather", "labelled", "loop_fault", "or_else", "parts", "pick"]


def for_test(i: Any, stop: Any, step: Any, m: Mask) -> Any:
    """Whether a FOR loop goes on, in each active lane."""
    if type(i) is int and type(stop) is int and type(step) is int:
        if step == 0:
            raise Fault(a.STEP, (0,))
        return i <= stop if step > 0 else i >= stop
    i, stop, step = ld(i, m), ld(stop, m), ld(step, m)
    if np.any(step == 0):
        raise Fault(a.STEP, (0,), "", int(np.argmax(np.atleast_1d(step == 0))))
    goes_on = np.where(step > 0, i <= stop, i >= stop)
    return goes_on if goes_on.ndim else bool(goes_on)


def advance(i: Any, step: Any, m: Mask, lanes: int, lower: int, upper: int) -> Any:
    """The counter of a FOR loop one step further, with the overflow of its type."""
    if type(i) is int and type(step) is int:
        following = i + step
        return following if lower <= following <= upper else a.wrap(following, lower, upper)
    here, by = ld(i, m), ld(step, m)
    dtype = here.dtype if type(here) is ndarray else by.dtype
    return put(i, np.asarray(here, dtype) + np.asarray(by, dtype), m, lanes, dtype)


def loop_fault(limit: int) -> NoReturn:
    """Stop a loop that runs too often."""
    raise Fault(a.LOOP, (limit,), f"more than {limit} rounds")


def labelled(k: Any, low: int, high: int) -> Any:
    """Whether a selector has a label."""
    if type(k) is int:
        return low <= k <= high
    return k == low if low == high else (k >= low) & (k <= high)


def parts(m: Mask, indices: tuple[Any, ...], lanes: int) -> Iterator[tuple[Mask, Any, tuple[int, ...]]]:
    """The active lanes by the list elements they use: the lanes, their positions (None: all), the indices."""
    if not any(type(index) is ndarray for index in indices):
        yield m, None, indices
        return
    count = lanes if m is None else m.size
    table = np.stack([np.broadcast_to(index, count) for index in indices])
    combinations, inverse = np.unique(table, axis=1, return_inverse=True)
    if combinations.shape[1] == 1:
        yield m, None, tuple(int(index) for index in combinations[:, 0])
        return
    inverse = inverse.reshape(-1)
    for number, combination in enumerate(combinations.T):
        positions = np.flatnonzero(inverse == number)
        yield positions if m is None else m.take(positions), positions, tuple(int(index) for index in combination)


def pick(value: Any, positions: Any) -> Any:
    """A value for a part of the lanes it was computed for."""
    return value if positions is None or type(value) is not ndarray else value.take(positions)


def gather(result: Any, positions: Any, value: Any, m: Mask, lanes: int, dtype: Any) -> Any:
    """Values of parts of the lanes put together."""
    if positions is None:
        return value
    if result is None:
        result = np.zeros(lanes if m is None else m.size, dtype)
    result[positions] = value
    return result
