"""The proof of a model with trees in one target: decisions on boxes of inputs, and terms of what the trees give."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from st_codegen.errors import at_most
from st_codegen.ir import ModelIR, Scale, Select, TreeEnsemble, reference
from st_codegen.ir.arrays import BoolArray, FloatArray, IntArray
from st_codegen.passes.jumps import largest_jump
from st_codegen.proof.prove.arithmetic import NEVER, Findings, check_plausible, first_missing, numbers_of, same_number
from st_codegen.proof.prove.axis import AxisValue, InputAxis, from_keys, require_assigned, to_keys
from st_codegen.proof.prove.boxes import Lanes, Slots, Space
from st_codegen.proof.prove.demand import Demand
from st_codegen.proof.prove.disagree import OtherExpressionError, SearchedInputs, parts_of
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.execute import Executor, converted
from st_codegen.proof.prove.floats import bits
from st_codegen.proof.prove.inputs import InputTerms
from st_codegen.proof.prove.intervals import LARGEST, Interval
from st_codegen.proof.prove.model import ModelSide
from st_codegen.proof.prove.range_bound import range_bound
from st_codegen.proof.prove.sums import TreeKey, TreeTerms, column_of, rows_of
from st_codegen.proof.prove.terms import Term, Terms
from st_codegen.proof.prove.terms import Value as Number
from st_codegen.proof.prove.values import Conditional, Kept, Value, by_input
from st_codegen.proof.runner import GeneratedCode

#: How a proof was reached.
SUMS, CELLS, TAIL = "sums of trees, tree by tree", "all cells", "the model's expression of its trees"

#: What is said of trees behind inexact steps.
_BESIDE_A_THRESHOLD = (
    "the text is the model's expression, operation by operation; its trees compare numbers that are computed with "
    "rounding, so that the library may take another leaf where such a number lies beside a threshold: the sum of the "
    "trees then differs {size} (verify says what width that was on its rows)"
)

#: Boxes in which more rows than one are looked at for a difference, and how many in each.
_SPREAD = 64
#: Numbers of inputs that have no other end there.
_NEAR = 1e3
#: Rows that the reference evaluates at once: bounds its memory.
_BATCH = 20_000


class Difference(Exception):  # noqa: N818 - a finding, not a failure
    """The text and the model seem to differ at some of these inputs (rows, features).

    `to_the_bit`: in bits of numbers that the text holds, which no rounding of a function excuses.
    """

    def __init__(self, reason: str, points: FloatArray, *, to_the_bit: bool = False) -> None:
        super().__init__(reason)
        self.points, self.to_the_bit = points, to_the_bit


@dataclass
class BlockRun:
    """A block of tables that several models share, executed once."""

    executor: Executor
    outputs: dict[str, Value]


class TreeProof:
    """The proof for one model with trees. Raises NotProvedError and Difference."""

    def __init__(
        self, model: ModelIR, code: GeneratedCode, block: str, outputs: tuple[int, ...], runs: dict[str, BlockRun]
    ) -> None:
        self.model, self.outputs = model, [numbers_of(code.project, block)[number] for number in outputs]
        inputs = InputTerms(Terms(), model)
        self.before: set[int] = set()
        self.trees = TreeTerms(inputs.terms, inputs, model)
        self.fixed: dict[TreeKey, float] = {}
        self.expected = list(self._expected_terms())
        self.side = ModelSide(model, lambda op, place: self._computed(inputs, op, place))
        self.open: dict[tuple[int, int], list[TreeKey]] = {}
        for key in reversed(self.expected):
            self.open.setdefault((key[0], key[2]), []).append(key)
        self.recognised = 0
        self.boxes = 0
        run = None if inputs.computed else runs.get(block)
        if run is None:
            executor = Executor(code.project, block, self._axes(), inputs, self._recognise)
            for axis in executor.axes:
                axis.cut(self.side.cuts(axis.feature))
            run = BlockRun(executor, executor.run())
            if not self.recognised and not inputs.computed:
                runs[block] = run
        self.run = run

    def _computed(self, inputs: InputTerms, op: TreeEnsemble, place: int) -> tuple[int, Interval]:
        """The axis and the interval of a column that is computed in front of trees: what holds for all of its numbers
        there holds for those that the inputs lead to.
        """
        before = [n for n in _ensembles(self.model) if n <= max(op.inputs)]
        sums = {n: self.trees.sums(_ensembles(self.model)[n], n, self.fixed) for n in before}
        demand = Demand.of_trees(inputs.terms, self.model, inputs, sums, True, op.inputs)
        term = [column for value in op.inputs for column in demand.values[value]][place]
        if [flag for value in op.inputs for flag in demand.missing[value]][place] is not False:
            raise NotProvedError("it may be missing")
        if not isinstance(term, Term):
            raise NotProvedError("it is a constant")
        interval = inputs.terms.interval(term)
        if not np.all(np.isfinite(interval)) or interval[2]:
            raise NotProvedError("it may overflow")
        self.before.update(op.inputs)
        if term not in inputs.computed:
            inputs.computed.append(term)
        return len(inputs.features) + inputs.computed.index(term), interval

    def _decided_in_cells(self) -> bool:
        """Whether trees compare no numbers but inputs and, without a rounding, what other trees give."""
        leaves = {term for key, term in self.trees.leaves.items() if self.side.ensembles[key[0]].op.linear is None}
        computed = self.run.executor.inputs.computed
        known = all(part in leaves for part in parts_of(computed) if part.operation == "leaf")
        return not computed or (known and not largest_jump(self.model))

    def _axes(self) -> list[InputAxis]:
        domain = self.side.domain
        ends = zip(domain.low.tolist(), domain.high.tolist(), strict=True)
        return [InputAxis(feature, first, last, nan=domain.nan[feature]) for feature, (first, last) in enumerate(ends)]

    def _expected_terms(self) -> Iterator[tuple[int, int, int]]:
        """(operation, tree, output) in the order in which the library adds; constant trees are noted in `fixed`."""
        for number, op in _ensembles(self.model).items():
            values = bits(op.leaf_value)
            for tree in range(op.n_trees):
                rows = rows_of(op, tree)
                narrow = op.leaf_value.shape[1] == 1
                for column in range(op.leaf_value.shape[1]):
                    output = int(op.tree_output[tree]) if narrow else column
                    key = (number, tree, output)
                    if op.linear is None and np.all(values[rows, column] == values[rows[0], column]):
                        self.fixed[key] = float(op.leaf_value[rows[0], column])
                    else:
                        yield key

    # --- recognising trees ------------------------------------------------------------------------------------------

    def _recognise(self, value: Lanes | Slots) -> Number:
        """The tree of the model that a value of the text is: the next one that adds to an output, in that order.

        A value that is the same in all boxes, such as that of a tree of one leaf, may also be a number.
        """
        points: tuple[TreeKey, FloatArray] | None = None
        for stream in sorted(filter(None, self.open.values()), key=lambda stream: self.expected.index(stream[-1])):
            while stream:
                key = stream[-1]
                found = self._differences(value, key)
                if found is None:
                    stream.pop()
                    self.recognised += 1
                    tree = self.trees.tree(self.side.ensembles[key[0]].op, key)
                    assert isinstance(tree, Term)
                    return tree
                constant = self._constant(key)
                if constant is None:
                    points = points or (key, found)
                    break
                self.fixed[key] = constant
                stream.pop()
        if isinstance(value, Lanes) and np.ptp(bits(value.lift().value.astype(np.float64))) == 0:
            require_assigned(value.known)
            return float(value.value[0])
        if points is None:
            raise Difference("the text adds more trees than the model has", _some_points(value.space))
        (number, tree_number, _), rows = points
        raise Difference(f"a sum of the text has another term than tree {tree_number} of operation {number}", rows)

    def _differences(self, value: Lanes | Slots, key: TreeKey) -> FloatArray | None:
        """Points in boxes in which a value is not what a tree gives; None where it is everywhere."""
        number, tree, output = key
        ensemble = self.side.ensembles[number]
        here = value.index.lift() if isinstance(value, Slots) else value.lift()
        space = here.space.copy()
        got = Lanes(space, here.value, here.known)
        leaves = ensemble.leaves(space, tree)
        taken = self._taken(space)
        self.boxes += space.lanes
        got.lift()
        leaves.lift()
        require_assigned(got.known)
        if isinstance(value, Slots) or ensemble.op.linear is not None:
            wrong = self._other_terms(value, got.value, leaves.value, key)
        else:
            wanted = column_of(ensemble.op, output)[leaves.value]
            wrong = np.flatnonzero(bits(got.value.astype(np.float64)) != bits(wanted))
        wrong = wrong[taken[wrong]]
        return self._spread(space, wrong) if wrong.size else None

    def _taken(self, space: Space) -> BoolArray:
        """The boxes whose inputs are taken; each is split where that changes."""
        taken = Lanes(space, np.ones(space.lanes, np.bool_))
        for accepted in self.side.accepted.values():
            found, _ = space.resolve(accepted, taken.lift().value)
            taken = Lanes(space, taken.lift().value & found.astype(np.bool_))
        return taken.value

    def _spread(self, space: Space, lanes: IntArray) -> FloatArray:
        """Rows in some boxes, beside numbers at which other trees decide: what is added to a leaf there differs."""
        cuts = [self.side.cuts(axis) for axis in range(len(self.side.domain.low))]
        found = [space.points(lanes[:1000])]
        for lane in lanes[:_SPREAD].tolist():
            rows = np.tile(space.points(np.array([lane])), (_SPREAD, 1))
            for feature, keys in enumerate(cuts):
                inside = keys[(keys >= space.low[lane, feature]) & (keys <= space.high[lane, feature])]
                if inside.size:
                    rows[:, feature] = from_keys(inside[np.arange(_SPREAD) * (2 * feature + 1) % len(inside)])
            found.append(rows)
            # and inside, where linear models in leaves have their digits
            ends = [np.clip(from_keys(keys[lane]), -_NEAR, _NEAR) for keys in (space.low, space.high)]
            share = np.modf(np.outer(np.arange(1, _SPREAD), np.sqrt(np.arange(2, 2 + len(cuts)))))[0]
            with np.errstate(invalid="ignore"):  # a box of NaN alone has no ends
                found.append(np.where(np.isnan(rows[1:]), np.nan, ends[0] + (ends[1] - ends[0]) * share))
        return np.concatenate(found)

    def _other_terms(self, value: Lanes | Slots, got: FloatArray, rows: IntArray, key: TreeKey) -> IntArray:
        """The lanes in which a number or term is not that of the leaf."""
        keys = got.astype(np.int64) if isinstance(value, Slots) else bits(got)
        pairs, back = np.unique(np.column_stack([keys, rows]), axis=0, return_inverse=True)
        same = []
        for at, row in pairs.tolist():
            if isinstance(value, Slots):
                number = value.items[at]
            else:
                number = float(np.array([at], np.int64).view(np.float64)[0])
            same.append(same_number(number, self._leaf(key, row)))
        return np.flatnonzero(~np.array(same, np.bool_)[np.ravel(back)])

    def _leaf(self, key: TreeKey, row: int) -> Number:
        op = self.side.ensembles[key[0]].op
        return float(column_of(op, key[2])[row]) if op.linear is None else self.trees.linear(op, key[0], row)

    def _constant(self, key: TreeKey) -> float | None:
        """The value of a tree that is the same for all inputs of the domain."""
        _, leaves = self._reached(key)
        values = [self._leaf(key, row) for row in np.unique(leaves.value).tolist()]
        first = values[0]
        if isinstance(first, Term) or not all(same_number(value, first) for value in values):
            return None
        return float(first)

    def _reached(self, key: TreeKey) -> tuple[Space, Lanes]:
        """Boxes of all inputs that the model takes, and the leaf of a tree in each."""
        space = Space(self._axes())
        return space, self.side.ensembles[key[0]].leaves(space, key[1])

    # --- the outputs ------------------------------------------------------------------------------------------------

    def check(self) -> Findings:
        """Compare what the block puts out with what the model demands."""
        outputs = self.run.outputs
        valid = outputs["bValid"]
        values = [self._value(outputs, name, valid) for name in self.outputs]
        by_cells = [isinstance(value, Lanes | AxisValue) for value in values]
        if not any(isinstance(value, Term) for value in values):
            by_cells = [True] * len(values)
        if all(by_cells):
            found = Findings(method=CELLS)
            self._check_valid(valid)
        else:
            found = self._check_terms(values, by_cells, valid)
        for number, value in enumerate(values):
            if by_cells[number]:
                self._check_cells(number, value)
        self._check_range(outputs)
        self._check_plausible(outputs, valid)
        return dataclasses.replace(found, trees=len(self.expected), boxes=self.boxes)

    def _value(self, outputs: dict[str, Value], name: str, valid: Value) -> Value:
        """What an output is assigned where there is an answer; it must keep its value elsewhere."""
        value, inputs = outputs[name], self.run.executor.inputs
        kept: Value = None
        if isinstance(value, Conditional):
            same = not isinstance(valid, Term) and _same_condition(value.condition, valid)
            kept = value.otherwise if same else None
            value = value.value
        elif isinstance(value, Term) and value.operation == "if" and value.arguments[0] is inputs.truth(valid):
            last = value.arguments[2]
            kept = Kept(name) if isinstance(last, Term) and last.arguments == (("before", name),) else None
            value = value.arguments[1]
        elif valid is True:
            if isinstance(value, Kept):
                raise NotProvedError(f"{name} is not assigned")
            return value
        elif valid is False and isinstance(value, Kept):
            raise NotProvedError(NEVER)
        if not isinstance(kept, Kept) or kept.name != name:
            raise NotProvedError(f"{name} does not keep its value exactly where bValid is FALSE")
        return value

    def _check_terms(self, values: list[Value], by_cells: list[bool], valid: Value) -> Findings:
        """Outputs that are computed from trees are the model's very expressions of them."""
        for stream in self.open.values():  # trees that the text leaves out must be constant
            for key in reversed(stream):
                constant = self._constant(key)
                if constant is None:
                    raise Difference(f"the text leaves out tree {key[1]}", _some_points(self._reached(key)[0]))
                self.fixed[key] = constant
        terms, inputs = self.run.executor.terms, self.run.executor.inputs
        start: Value = valid
        if isinstance(valid, Term):
            used = [value for value, term in inputs.taken if term in parts_of([valid])]
            start = used[0] if used else True
        sums = {
            number: self.trees.sums(ensemble.op, number, self.fixed) for number, ensemble in self.side.ensembles.items()
        }
        wanted = (*self.before, len(self.model.ops))
        demand = Demand.of_trees(terms, self.model, inputs, sums, inputs.truth(start), wanted)
        self._check_valid(start)
        if demand.valid is not inputs.truth(valid):
            reason = "bValid is not what the model demands behind its trees"
            raise OtherExpressionError(reason, [inputs.truth(valid)], [demand.valid], self._inputs())
        chosen = [n for n, cells in enumerate(by_cells) if not cells]
        got = [self.run.executor.as_number(values[n]) for n in chosen]
        demanded = [demand.put_out()[n] for n in chosen]
        if not all(map(same_number, got, demanded)):
            names = [self.outputs[n] for n, *pair in zip(chosen, got, demanded, strict=True) if not same_number(*pair)]
            reason = f"{', '.join(names)}: not the additions, roundings and operations of the model, which "
            reason += first_missing(demand, got)
            raise OtherExpressionError(reason, got, demanded, self._inputs(), chosen)
        tail = [op for number, op in enumerate(self.model.ops, 1) if number in demand.values and number not in sums]
        linear = any(ensemble.op.linear is not None for ensemble in self.side.ensembles.values())
        operations, jump = len(parts_of(demand.outputs)), largest_jump(self.model)
        if inputs.computed and jump:
            size = f"by up to {at_most(jump, 3)}" if np.isfinite(jump) else "by an amount of which no bound is known"
            claim = _BESIDE_A_THRESHOLD.format(size=size)
            unbounded = (np.inf,) * len(self.outputs)
            return Findings(method=TAIL, operations=operations, bound=unbounded, claims=(claim,))
        if not linear and not inputs.computed and all(isinstance(op, Select | Scale) and op.exact for op in tail):
            return Findings(method=SUMS)
        return Findings(method=TAIL, operations=operations, bound=range_bound(self.model))

    def _inputs(self) -> SearchedInputs:
        """What stands for the leaves of expressions on rows of inputs."""
        inputs = self.run.executor.inputs
        numbers = [number for number in inputs.numbers if isinstance(number, Term)]

        def leaves(x: FloatArray) -> dict[Term, FloatArray]:
            values = reference.trace(self.model, reference.limited(self.model, x))
            columns = zip(numbers, values[0].T, strict=True)
            found = {number: np.nan_to_num(column, nan=0.0) for number, column in columns}
            found |= {m: np.isnan(c) for m, c in zip(inputs.missing, x.T, strict=True) if isinstance(m, Term)}
            found |= {term: np.ones(len(x), np.bool_) for _, term in inputs.taken}
            for key, term in self.trees.leaves.items():
                op = self.side.ensembles[key[0]].op
                given = np.hstack([values[value] for value in op.inputs])
                found[term] = reference.leaf_values(op, given, key[1])[:, 0 if op.leaf_value.shape[1] == 1 else key[2]]
            return found

        anchors = []
        for feature in range(len(self.model.features)):
            keys = self.side.cuts(feature)
            anchors.append(from_keys(np.concatenate([keys, keys + 1])))
        low, high = (ends[: len(anchors)] for ends in (self.side.domain.low, self.side.domain.high))
        return SearchedInputs(low, high, leaves, tuple(anchors))

    def _check_plausible(self, outputs: dict[str, Value], valid: Value) -> None:
        """bPlausible, where there is one, is bValid and that no output lies outside of its plausible range."""
        plausible = outputs.get("bPlausible")
        if plausible is None:
            return
        executor = self.run.executor
        names = {port.variable: port for port in self.model.ports if port.lower is not None}
        given = [plausible, *(outputs[name] for name in names)]
        if all(isinstance(value, bool | Lanes | AxisValue) for value in given):
            _, (got, *numbers) = executor.joined(given, True)
            wanted = np.ones(len(got), np.bool_)
            for port, x in zip(names.values(), numbers, strict=True):
                wanted &= (x >= port.lower) & (x <= port.upper)
            if valid is not True or np.any(got.astype(np.bool_) != wanted):
                raise NotProvedError("bPlausible is not what the plausible ranges demand")
            return
        held = {variable.name: variable for variable in executor.unit.variables if variable.name in outputs}
        terms = {name: converted(executor, outputs[name], held[name]) for name in (*names, "bPlausible")}
        read = {name: value() if callable(value) else value for name, value in terms.items()}
        check_plausible(self.model, executor.terms, read, executor.inputs.truth(valid))

    def _check_valid(self, valid: Value) -> None:
        """bValid is TRUE exactly for the inputs for which the model has an answer."""
        domain = self.side.domain
        parts = self._conditions_on_inputs(valid)
        for axis in self.run.executor.axes[: len(self.model.features)]:
            feature = axis.feature
            axis.cut(np.array([domain.low[feature] - 1, domain.high[feature]]))
            accepted = self.side.accepted.get(feature)
            if accepted is not None:
                axis.cut(accepted.axis.ends)
            wanted = domain.lanes_within(axis)
            if accepted is not None:
                wanted &= accepted.at(axis.low)
            got = _truths(axis, parts.get(feature))
            wrong = np.flatnonzero(got != wanted)
            if wrong.size:
                raise Difference("bValid is not what the model demands", self._rows(feature, axis.low[wrong[:1000]]))

    def _conditions_on_inputs(self, value: Value) -> dict[int, AxisValue]:
        """A condition by input: none may tell what a number is that has an axis of its own in front of the trees."""
        parts = by_input(value)
        if any(feature >= len(self.model.features) for feature in parts):
            raise NotProvedError("bValid or bInRange depends on a number that is computed in front of the trees")
        return parts

    def _rows(self, feature: int, values: FloatArray) -> FloatArray:
        rows = np.tile(self.side.domain.nearest_to_zero(), (len(values), 1))
        rows[:, feature] = values
        return rows

    def _check_range(self, outputs: dict[str, Value]) -> None:
        """bInRange, where there is one, is TRUE exactly where no number lies outside its declared range."""
        if "bInRange" not in outputs:
            return
        parts = self._conditions_on_inputs(outputs["bInRange"])
        for axis, feature in zip(self.run.executor.axes, self.model.features, strict=False):
            low, high = feature.checked or (-LARGEST, LARGEST)  # an infinity is in no range
            with np.errstate(over="ignore"):
                axis.cut(to_keys(np.array([low, np.nextafter(high, np.inf)])) - 1)  # lanes begin at these numbers
            wanted = np.append((axis.low[:-1] >= low) & (axis.high[:-1] <= high), True)
            if low == 0.0:
                wanted |= axis.low == 0.0
            got = _truths(axis, parts.get(axis.feature))
            if np.any((got != wanted) & self.side.domain.lanes_within(axis)):
                raise NotProvedError(f"bInRange is not what the range of '{feature.name}' demands")

    def _check_cells(self, output: int, value: Value) -> None:
        """In every box of the text and of the model together one evaluation of the model decides."""
        if not self._decided_in_cells():
            raise NotProvedError("a table of numbers that are computed in front of trees is not followed")
        if isinstance(value, Lanes):
            space = value.lift().space.copy()
            got = Lanes(space, value.value, value.known)
        else:
            space = Space(self.run.executor.axes)
            found, known = (
                space.resolve(value, np.ones(1, np.bool_))
                if isinstance(value, AxisValue)
                else (np.array([value]), np.ones(1, np.bool_))
            )
            got = Lanes(space, found, known)
        for feature in range(len(self.model.features)):
            axis = InputAxis(feature)
            axis.cut(self.side.cuts(feature))
            space.resolve(AxisValue(axis, np.arange(axis.lanes)), np.ones(space.lanes, np.bool_))
        taken = self._taken(space)
        self.boxes += space.lanes
        got.lift()
        require_assigned(got.known, what="an output")
        points = space.points(np.arange(space.lanes))[:, : len(self.model.features)]
        batches = range(0, len(points), _BATCH)
        wanted = np.concatenate([reference.evaluate(self.model, points[at : at + _BATCH])[:, output] for at in batches])
        wrong = np.flatnonzero((bits(got.value.astype(np.float64)) != bits(wanted)) & taken)
        if wrong.size:
            raise Difference("a cell of the table differs from the model", points[wrong[:1000]], to_the_bit=True)


def _ensembles(model: ModelIR) -> dict[int, TreeEnsemble]:
    return {number: op for number, op in enumerate(model.ops, 1) if isinstance(op, TreeEnsemble)}


def _some_points(space: Space) -> FloatArray:
    return space.points(np.arange(min(space.lanes, 1000)))


def _truths(axis: InputAxis, condition: AxisValue | None) -> BoolArray:
    """A condition on one input in each lane of its axis; None: it holds in all of them."""
    return np.ones(axis.lanes, np.bool_) if condition is None else condition.lift().constant.astype(np.bool_)


def _same_condition(one: Value, other: Value) -> bool:
    first, second = by_input(one), by_input(other)
    return set(first) == set(second) and all(
        np.array_equal(first[key].lift().constant, second[key].lift().constant) for key in first
    )
