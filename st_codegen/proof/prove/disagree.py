"""An input for which two expressions differ, the text's and the model's: searched where they part.

Both are evaluated on rows by the same functions, so that only what is written differently can differ. Rows are laid
where the difference lies: beside the numbers with which inputs are compared or from which they are taken, on both sides
of the place at which a comparison changes over that only one of the two makes, and, for a constant or an operation that
differs, on neighbouring numbers of the inputs at which the differing parts lie furthest apart for the last digit of the
result, so that each row is another chance for its rounding to show it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from st_codegen.ir import BoolArray, FloatArray, IntArray
from st_codegen.ir.arrays import bisected
from st_codegen.proof.prove.axis import from_keys, to_keys
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.floats import COMPARE, OPERATIONS
from st_codegen.proof.prove.terms import Term, Value

#: Rows of the first look, numbers of an input that are tried in it, and neighbouring numbers of each input afterwards.
_ROWS, _ANCHORS, _NEIGHBOURS = 1024, 64, 2048
#: Rows around which neighbours are tried, and changeovers that are looked for.
_CENTRES, _CHANGEOVERS = 6, 64
#: Numbers that are held at once, and that are computed of one set of rows.
_MOST_HELD, _MOST_COMPUTED = 2_000_000, 60_000_000

#: What terms stand for beside operations on float64 numbers and comparisons.
_COMPUTE: dict[str, Callable[..., FloatArray]] = {
    "iadd": np.add,
    "isub": np.subtract,
    "imul": np.multiply,
    "itrunc": np.trunc,
    "ireal": lambda x: x,
    "not": np.logical_not,
    "and": np.logical_and,
    "number": lambda x: ~np.isnan(x),
    "if": np.where,
    **COMPARE,
    **OPERATIONS,
}

#: The numbers that leaves stand for, on rows of inputs.
Leaves = Callable[[FloatArray], Mapping[Term, FloatArray]]


class OtherExpressionError(NotProvedError):
    """The text's expressions `got` are not those that the model demands, `wanted`; `outputs` are the model's own."""

    def __init__(
        self,
        reason: str,
        got: Sequence[Value],
        wanted: Sequence[Value],
        inputs: SearchedInputs,
        outputs: Sequence[int] = (),
    ) -> None:
        super().__init__(reason)
        self.got, self.wanted, self.inputs = got, wanted, inputs
        self.outputs = tuple(outputs) or tuple(range(len(got)))
        self.apart = len(set(parts_of(wanted)) - set(parts_of(got)))


@dataclass(frozen=True)
class SearchedInputs:
    """The numbers that a model takes, keys from `low` to `high` of each input, and what leaves are on rows of them.

    `anchors` are numbers at which something is decided, for each input.
    """

    low: IntArray
    high: IntArray
    leaves: Leaves
    anchors: tuple[FloatArray, ...] = ()


def parts_of(values: Iterable[Value]) -> list[Term]:
    """All terms in some values, parts before what is made of them."""
    done: dict[Term, None] = {}
    open_: list[tuple[object, bool]] = [(value, False) for value in values]
    while open_:
        term, entered = open_.pop()
        if not isinstance(term, Term) or term in done:
            continue
        if entered or term.operation == "leaf":
            done[term] = None
        else:
            open_.append((term, True))
            open_ += [(argument, False) for argument in term.arguments]
    return list(done)


def evaluated(values: Sequence[Value], leaves: Mapping[Term, FloatArray], rows: int) -> list[FloatArray]:
    """Values on rows; numbers where a controller would stop are NaN or infinite."""
    known: dict[Term, FloatArray] = dict(leaves)
    with np.errstate(all="ignore"):
        for term in parts_of(values):
            if term not in known:
                arguments = [known[a] if isinstance(a, Term) else a for a in term.arguments]
                function = _COMPUTE.get(term.operation)
                if function is None or term.operation == "leaf":
                    raise NotProvedError(f"{term.operation} is not evaluated")
                known[term] = np.broadcast_to(np.asarray(function(*arguments)), (rows,))
    return [known[v] if isinstance(v, Term) else np.full(rows, v) for v in values]


def differing_rows(difference: OtherExpressionError) -> FloatArray:
    """Rows of inputs on which the two expressions were seen to differ; none where no such row was found."""
    search = _Search(difference)
    for stage in (search.first, search.changeovers, search.neighbours):
        found = search.differing(stage())
        if len(found):
            return found
    return search.base[:0]


class _Search:
    """The rows that are tried for one difference."""

    def __init__(self, difference: OtherExpressionError) -> None:
        self.got, self.wanted, self.inputs = difference.got, difference.wanted, difference.inputs
        got, wanted = parts_of(self.got), parts_of(self.wanted)
        alone = set(got).symmetric_difference(wanted)
        #: Comparisons of the same numbers that one of the two makes and the other does not.
        decisions = [term for term in (*got, *wanted) if term in alone and term.operation in COMPARE]
        self.decisions = [term for term in decisions if not alone.intersection(term.arguments)]
        self.parts = max(len({*got, *wanted}), 1)
        self.batch = max(_MOST_HELD // self.parts, 64)
        self.base = self._base()

    def _values(self, values: Sequence[Value], rows: FloatArray) -> list[FloatArray]:
        found = [
            evaluated(values, self.inputs.leaves(rows[at : at + self.batch]), len(rows[at : at + self.batch]))
            for at in range(0, len(rows), self.batch)
        ]
        return [np.concatenate(column) for column in zip(*found, strict=True)]

    def differing(self, rows: FloatArray) -> FloatArray:
        """The rows, of some (n, inputs), on which an output differs in its bits: from the first batch that has any."""
        rows = rows[:: max(len(rows) * self.parts // _MOST_COMPUTED, 1)]
        for at in range(0, len(rows), self.batch):
            here = rows[at : at + self.batch]
            found = evaluated([*self.got, *self.wanted], self.inputs.leaves(here), len(here))
            differs = np.zeros(len(here), np.bool_)
            for one, other in zip(found[: len(self.got)], found[len(self.got) :], strict=True):
                a, b = one.astype(np.float64), other.astype(np.float64)
                differs |= (a.view(np.int64) != b.view(np.int64)) & np.isfinite(b)
            if np.any(differs):
                return here[differs]
        return rows[:0]

    def _base(self) -> FloatArray:
        """Rows whose columns run through the anchors of their inputs, each with a step of its own."""
        columns = []
        for feature in range(len(self.inputs.low)):
            numbers = self._numbers(feature)
            order = np.arange(_ROWS) * (2 * feature + 1) + (np.arange(_ROWS) // len(numbers)) * feature
            columns.append(numbers[order % len(numbers)])
        return np.column_stack(columns)

    def _numbers(self, feature: int) -> FloatArray:
        """Numbers of an input: what it is compared with or taken from, between these, and where they end."""
        low, high = from_keys(np.array([self.inputs.low[feature], self.inputs.high[feature]])).tolist()
        given = [0.0, 1.0, -1.0, *(self.inputs.anchors[feature] if self.inputs.anchors else ())]
        leaf = ("input", feature)
        for term in parts_of((*self.got, *self.wanted)):
            if len(term.arguments) == 2 and any(isinstance(a, Term) and a.arguments == (leaf,) for a in term.arguments):
                given += [float(a) for a in term.arguments if isinstance(a, float)]
        numbers = np.unique(np.clip(np.array(given), low, high))
        numbers = numbers[np.isfinite(numbers)]
        numbers = numbers[np.linspace(0, len(numbers) - 1, min(len(numbers), _ANCHORS)).astype(np.int64)]
        between = (numbers[1:] + numbers[:-1]) / 2 if len(numbers) > 1 else numbers
        span = max(float(numbers[-1] - numbers[0]), 1.0)
        beyond = np.array([numbers[0] - 0.37 * span, numbers[-1] + 0.37 * span, numbers[-1] + 2.7 * span])
        beside = from_keys(np.concatenate([to_keys(numbers) - 1, to_keys(numbers) + 1]))
        ends = np.array([end for end in (low, high) if np.isfinite(end)])
        found = np.unique(np.concatenate([numbers, between, beyond, beside, ends]))
        return np.asarray(found[(found >= low) & (found <= high)], np.float64)

    def first(self) -> FloatArray:
        """The numbers of each input that are tried first: those that the model and the text themselves compare with."""
        return self.base

    def changeovers(self) -> FloatArray:
        """Both sides, and the numbers beside, of where a comparison changes over that one of the two makes."""
        rows = []
        for term in self.decisions[:_CHANGEOVERS]:
            holds = self._values([term], self.base)[0].astype(np.bool_)
            for feature in range(self.base.shape[1]):
                rows += self._changes(term, holds, feature)
        return np.concatenate(rows) if rows else self.base[:0]

    def _changes(self, term: Term, holds: BoolArray, feature: int) -> list[FloatArray]:
        """Rows around changeovers of a comparison along one input, from rows of the first look."""
        starts = self.base[:: len(self.base) // 32]
        decided = holds[:: len(self.base) // 32]
        ends = starts.copy()
        ends[:, feature] = self.base[np.arange(len(starts)) * 7 % len(self.base), feature]
        other = self._values([term], ends)[0].astype(np.bool_)
        chosen = np.flatnonzero(other != decided)
        if not chosen.size:
            return []

        def rows_at(keys: IntArray) -> FloatArray:
            rows = starts[chosen]
            rows[:, feature] = from_keys(keys)
            return rows

        last = bisected(
            lambda keys: self._values([term], rows_at(keys))[0].astype(np.bool_),
            to_keys(starts[chosen, feature]),
            to_keys(ends[chosen, feature]),
        )
        return [rows_at(last + step) for step in range(-2, 3)]

    def neighbours(self) -> FloatArray:
        """Numbers beside those at which the differing parts lie furthest apart for the last digit of the result."""
        pairs = [pair for g, w in zip(self.got, self.wanted, strict=True) for pair in _first_differences(g, w)]
        pairs = [pair for pair in pairs if all(not isinstance(v, Term) or v.kind == "real" for v in pair)][:16]
        score = np.zeros(len(self.base))
        with np.errstate(all="ignore"):
            last = np.zeros(len(self.base))
            for value in self._values(self.wanted, self.base):
                last += np.spacing(np.abs(value.astype(np.float64)))
            for one, other in pairs:
                a, b = (v.astype(np.float64) for v in self._values([one, other], self.base))
                score = np.fmax(score, np.nan_to_num(np.abs(a - b) / last, posinf=0.0))
        centres = self.base[np.argsort(-score, kind="stable")[:_CENTRES]]
        rows = []
        for feature in range(self.base.shape[1]):
            steps = np.arange(_NEIGHBOURS // 2)
            # neighbours one by one, and far ones: a small step may be lost in what follows
            keys = np.concatenate([steps, steps * 1_000_003, steps * 4_398_046_511_119])
            for centre in centres:
                row = np.tile(centre, (len(keys), 1))
                moved = to_keys(centre[feature : feature + 1]) + keys
                row[:, feature] = from_keys(np.clip(moved, self.inputs.low[feature], self.inputs.high[feature]))
                rows.append(row[np.all(np.isfinite(row), axis=1)])
        return np.concatenate(rows)


def _first_differences(one: Value, other: Value) -> list[tuple[Value, Value]]:
    """The innermost parts in which two expressions of the same shape differ."""
    found: list[tuple[Value, Value]] = []
    seen: set[tuple[int, int]] = set()
    open_ = [(one, other)]
    while open_:
        a, b = open_.pop()
        if a is b or (id(a), id(b)) in seen or (not isinstance(a, Term) and not isinstance(b, Term) and a == b):
            continue
        seen.add((id(a), id(b)))
        alike = isinstance(a, Term) and isinstance(b, Term) and a.operation == b.operation
        if alike and a.operation != "leaf" and len(a.arguments) == len(b.arguments):  # type: ignore[union-attr]
            open_ += list(zip(a.arguments, b.arguments, strict=True))  # type: ignore[union-attr]
        else:
            found.append((a, b))
    return found
