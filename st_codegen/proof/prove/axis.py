"""The float64 numbers of one input, cut into intervals, and values that depend on that input alone.

An axis is the whole line of one input: -infinity, all numbers, +infinity, with -0.0 and 0.0 as two points, cut into
intervals ("lanes"), and NaN as a lane of its own. A value of the text that depends on one input is a constant in each
lane, or a chain of monotone operations on the input: rounding to nearest is monotone, so the values of a chain at both
ends of a lane enclose its values in between, and a comparison with a constant changes over in one place at most, which
bisection over the representable numbers finds. Cutting the lane there makes the comparison constant in each lane.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from st_codegen.ir.arrays import AnyArray, BoolArray, FloatArray, IntArray, bisected
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.floats import Link, bits, run_chain

_SIGN = np.int64(-(2**63))


def require_assigned(known: BoolArray | None, active: BoolArray | bool = True, what: str = "a number") -> None:
    """Raise NotProvedError unless a value is known in every active lane (`known` None: in all lanes)."""
    if known is not None and np.any(active & ~known):
        raise NotProvedError(f"{what} is read before it is assigned")


def to_keys(x: FloatArray) -> IntArray:
    """Integers in the order of float64 numbers, one apart for neighbours; -0.0 comes right before 0.0."""
    bits = np.ascontiguousarray(x, np.float64).view(np.int64)
    return np.where(bits < 0, ~(bits ^ _SIGN), bits)


def from_keys(keys: IntArray) -> FloatArray:
    """The float64 numbers of some keys."""
    keys = np.ascontiguousarray(keys, np.int64)
    return np.where(keys < 0, ~keys ^ _SIGN, keys).view(np.float64)


LOWEST = int(to_keys(np.array([-np.inf]))[0])
HIGHEST = int(to_keys(np.array([np.inf]))[0])


class InputAxis:
    """The line of input `feature`. `ends` are the keys of the last number of each lane; the NaN lane follows them.

    `first` to `last` are the keys of the numbers that the model takes, `nan` says whether it takes NaN. What a block
    does for the others is followed as far as it depends on this input alone; from there on they must count as 0.0 does
    (`held_alike`), so that boxes of several inputs need not hold them.
    """

    def __init__(self, feature: int, first: int = LOWEST, last: int = HIGHEST, *, nan: bool = True) -> None:
        self.feature, self.first, self.last, self.nan = feature, first, last, nan
        self.ends: IntArray = np.array([LOWEST, HIGHEST - 1, HIGHEST], np.int64)
        self.parents: list[IntArray] = []
        self._measure()
        self.cut(np.array([first - 1, last]))
        if first > LOWEST or last < HIGHEST or not nan:
            self.cut(np.array([-1, 0]))

    def _measure(self) -> None:
        self.starts = np.append(LOWEST, self.ends[:-1] + 1)
        self.low = np.append(from_keys(self.starts), np.nan)
        self.high = np.append(from_keys(self.ends), np.nan)

    @property
    def lanes(self) -> int:
        """Lanes of numbers and the lane of NaN."""
        return len(self.ends) + 1

    @property
    def taken(self) -> BoolArray:
        """The lanes that the model takes."""
        return self.within(self.first, self.last, nan=self.nan)

    def within(self, first: int, last: int, *, nan: bool) -> BoolArray:
        """The lanes of which all numbers lie between two keys, and that of NaN where `nan`."""
        return np.append((self.starts >= first) & (self.ends <= last), nan)

    def cut(self, ends: IntArray) -> None:
        """End lanes at these keys too."""
        new = np.union1d(self.ends, ends[(ends >= LOWEST) & (ends < HIGHEST)])
        if len(new) == len(self.ends):
            return
        parent = np.searchsorted(self.ends, new)
        self.parents.append(np.append(parent, len(self.ends)))
        self.ends = new
        self._measure()


@dataclass
class AxisValue:
    """A value that depends on one input: in each lane `constant`, or chain number `chain[lane] - 1` where that is > 0.

    `known` marks the lanes in which it has a value at all (None: all).
    """

    axis: InputAxis
    constant: AnyArray
    chain: IntArray | None = None
    chains: tuple[tuple[Link, ...], ...] = ()
    known: BoolArray | None = None
    version: int = -1
    #: What `in_order` and `held_alike` found, and for which version.
    order: tuple[int, tuple[IntArray, AnyArray, AnyArray, bool] | None] | None = None
    alike: int = -1

    def __post_init__(self) -> None:
        if self.constant.dtype == object:  # what one branch computed of several inputs, beside a number
            raise NotProvedError("a variable that is computed of several inputs in some lanes of one")
        if self.version < 0:
            self.version = len(self.axis.parents)

    def lift(self) -> AxisValue:
        """Bring the arrays up to the lanes that the axis has now."""
        for parent in self.axis.parents[self.version :]:
            self.constant = self.constant[parent]
            self.chain = None if self.chain is None else self.chain[parent]
            self.known = None if self.known is None else self.known[parent]
        self.version = len(self.axis.parents)
        return self

    def ends(self) -> tuple[AnyArray, AnyArray]:
        """The values at the first and the last number of each lane (and for NaN)."""
        self.lift()
        if self.chain is None:
            return self.constant, self.constant
        first, last = self.constant.copy(), self.constant.copy()
        for number, chain in enumerate(self.chains, 1):
            at = np.flatnonzero(self.chain == number)
            first[at] = run_chain(chain, self.axis.low[at])
            last[at] = run_chain(chain, self.axis.high[at])
        return first, last

    def at(self, x: FloatArray) -> AnyArray:
        """The value for numbers of the input (NaN too), one number for each row."""
        self.lift()
        lane = np.searchsorted(self.axis.ends, to_keys(x))
        lane = np.where(np.isnan(x), len(self.axis.ends), lane)
        result = self.constant[lane].copy()
        if self.chain is not None:
            for number, chain in enumerate(self.chains, 1):
                rows = np.flatnonzero(self.chain[lane] == number)
                result[rows] = run_chain(chain, x[rows])
        return result

    def held_alike(self) -> None:
        """Raise NotProvedError unless the value is the same for all inputs that the model refuses, and for 0.0."""
        if self.alike == len(self.axis.parents):
            return
        taken = self.axis.taken
        self.alike = len(self.axis.parents)
        if np.all(taken):
            return
        self.alike = -1
        first, last = self.ends()
        zero = np.searchsorted(self.axis.ends, 0)
        for side in (first, last):
            if np.any(bits(side[~taken]) != bits(first[zero : zero + 1])):
                raise NotProvedError(
                    "with an input that the model refuses a variable of the block is another one than with 0.0, which "
                    "is not followed"
                )
        self.alike = len(self.axis.parents)

    def in_order(self) -> tuple[IntArray, AnyArray, AnyArray, bool] | None:
        """The lanes that the model takes, the values at their ends, negated where they fall, and whether they do.

        None where they neither rise nor fall throughout. Raises NotProvedError where there is no value.
        """
        version = len(self.axis.parents)
        if self.order is None or self.order[0] != version:
            self.order = version, self._ordered()
        return self.order[1]

    def _ordered(self) -> tuple[IntArray, AnyArray, AnyArray, bool] | None:
        taken = self.axis.taken
        lanes = np.flatnonzero(taken[:-1])
        first, last = (values[lanes] for values in self.ends())
        require_assigned(self.known, taken, what="an element")
        sequence = np.column_stack([first, last]).ravel()
        if np.any(np.isnan(sequence.astype(np.float64))):
            return None
        falling = bool(sequence[0] > sequence[-1])
        if not np.all(sequence[1:] <= sequence[:-1] if falling else sequence[1:] >= sequence[:-1]):
            return None
        sign = -1 if falling else 1
        return lanes, sign * first, sign * last, falling

    def with_links(self, name: str, constants: FloatArray, result: AnyArray, active: BoolArray) -> AxisValue:
        """The value behind one more link: `result` has the constant lanes, `constants` those of the chains.

        Raises NotProvedError where an active lane of a chain overflows, meets NaN, or is not monotone.
        """
        self.lift()
        if self.chain is None:
            return AxisValue(self.axis, result, known=self.known)
        chain = np.zeros(len(self.chain), np.int64)
        chains: list[tuple[Link, ...]] = []
        varying = np.flatnonzero(self.chain > 0)
        pairs, kind = np.unique(
            np.column_stack([self.chain[varying], to_keys(np.asarray(constants, np.float64)[varying])]),
            axis=0,
            return_inverse=True,
        )
        if len(pairs) > 64:
            raise NotProvedError("one operation on an input with many different constants")
        for number, (old, key) in enumerate(pairs.tolist(), 1):
            chains.append((*self.chains[old - 1], (name, float(from_keys(np.array([key]))[0]))))
            chain[varying[np.ravel(kind) == number - 1]] = number
        value = AxisValue(self.axis, result, chain, tuple(chains), self.known)
        before, after = self.ends(), value.ends()
        lanes = varying[np.asarray(active)[varying]]
        for given, got in zip(before, after, strict=True):
            if np.any(np.isfinite(given[lanes]) & ~np.isfinite(got[lanes])) or np.any(np.isnan(got[lanes])):
                raise NotProvedError(f"the operation {name} can overflow or meet NaN")
        if name == "abs" and np.any((before[0][lanes] < 0) & (before[1][lanes] > 0)):
            raise NotProvedError("ABS of a lane on both sides of zero")
        return value

    def cut_where(self, holds: Callable[[FloatArray, IntArray], BoolArray], lanes: IntArray) -> None:
        """Cut the lanes (of chains) in which a monotone decision is not the same at both ends; then all have one.

        `holds` decides for values in lanes.
        """
        self.lift()
        if self.chain is None:
            return
        lanes = lanes[(self.chain[lanes] > 0) & (lanes < len(self.axis.ends))]
        first, last = self.ends()
        open_ = lanes[holds(first[lanes], lanes) != holds(last[lanes], lanes)]
        if open_.size:
            self.cut_lanes(open_, lambda x, places: holds(x, open_[places]))

    def cut_lanes(self, lanes: IntArray, holds: Callable[[FloatArray, IntArray], BoolArray]) -> None:
        """Cut lanes (of chains) in each of which a monotone decision changes over.

        `holds` decides for values in some of them, which are given as places in `lanes`.
        """
        assert self.chain is not None
        chain = self.chain[lanes]
        places = [np.flatnonzero(chain == number) for number in range(1, len(self.chains) + 1)]
        pairs = zip(self.chains, places, strict=True)
        self.axis.cut(np.concatenate([self._changeovers(links, lanes, own, holds) for links, own in pairs]))

    def _changeovers(
        self,
        links: tuple[Link, ...],
        lanes: IntArray,
        places: IntArray,
        holds: Callable[[FloatArray, IntArray], BoolArray],
    ) -> IntArray:
        at = lanes[places]
        start, end = self.axis.starts[at], self.axis.ends[at]
        return bisected(lambda keys: holds(run_chain(links, from_keys(keys)), places), start, end)


def input_value(axis: InputAxis, *, counted_as_zero: bool = False) -> AxisValue:
    """The input itself; `counted_as_zero`: 0.0 in place of what the model does not take."""
    chain = axis.taken.astype(np.int64) if counted_as_zero else np.append(np.ones(axis.lanes - 1, np.int64), 0)
    return AxisValue(axis, np.full(axis.lanes, 0.0 if counted_as_zero else np.nan), chain, ((),))
