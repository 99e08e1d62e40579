"""For each model: that the emitted text gives its numbers for every input; or an input for which it does not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from st_codegen.emit.output import block_of
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import GeneratedCodeError
from st_codegen.files.html_text import html_table
from st_codegen.ir import ModelIR, TreeEnsemble, reference
from st_codegen.ir.arrays import FloatArray, IntArray
from st_codegen.project.bundle import Bundle
from st_codegen.proof.prove.arithmetic import METHOD, prove_arithmetic
from st_codegen.proof.prove.axis import (
    AxisValue,
    InputAxis,
    NotProvedError,
    from_keys,
)
from st_codegen.proof.prove.blocks import prove_block
from st_codegen.proof.prove.boxes import Lanes, Space
from st_codegen.proof.prove.execute import All, Conditional, Executor, Kept, Value
from st_codegen.proof.prove.expressions import ExpressionNode, Pool
from st_codegen.proof.prove.model import ModelSide, tree_leaf
from st_codegen.proof.runner import GeneratedCode, target_folders

#: Called with (number done, total, what is next).
Progress = Callable[[int, int, str], None]


#: Rows that the reference evaluates at once: bounds its memory.
_BATCH = 20_000
#: The range of a feature that declares none, where another does: no infinity lies in it
_LARGEST = float(np.finfo(np.float64).max)


class Verdict(StrEnum):
    """What was found for a model."""

    PROVED = "proved"
    REFUTED = "refuted"
    NOT_PROVED = "not proved"


@dataclass(frozen=True)
class Counterexample:
    """An input for which the text was executed and differs from the model; `got` is None where it is not valid."""

    input: tuple[float, ...]
    expected: tuple[float, ...] | None
    got: tuple[float, ...] | None
    stops: str = ""


@dataclass(frozen=True)
class ProofResult:
    """The verdict for one model in one target.

    `method` says how it was reached; `trees` and `boxes`, or the `operations` of an expression, how large it was.
    `bound`: how far an expression may lie from the library's answer anywhere in the trained range, for each output;
    empty where no range is declared. `claims`: what holds in every call of a block around models (`model` is its name).
    """

    model: str
    target: str
    block: str
    verdict: Verdict
    reason: str = ""
    method: str = ""
    outputs: tuple[int, ...] = ()
    trees: int = 0
    boxes: int = 0
    operations: int = 0
    bound: tuple[float, ...] = ()
    claims: tuple[str, ...] = ()
    counterexample: Counterexample | None = None


@dataclass(frozen=True, repr=False)
class ProveReport:
    """All verdicts."""

    results: tuple[ProofResult, ...] = field(default=())

    def __repr__(self) -> str:
        proved = sum(result.verdict is Verdict.PROVED for result in self.results)
        return f"ProveReport({proved} of {len(self.results)} proved)"

    def _repr_html_(self) -> str:
        rows = [(r.model, r.target, r.block, r.verdict.value, r.reason or r.method) for r in self.results]
        return html_table(
            "the text equals the model for all inputs", ("model", "target", "block", "verdict", "by"), rows
        )

    @property
    def proved(self) -> bool:
        return bool(self.results) and all(result.verdict is Verdict.PROVED for result in self.results)


class Difference(Exception):  # noqa: N818 - a finding, not a failure
    """The text and the model seem to differ at some of these inputs (rows, features)."""

    def __init__(self, reason: str, points: FloatArray) -> None:
        super().__init__(reason)
        self.points = points


def prove(bundle: Bundle, generated: Path | str, *, progress: Progress | None = None) -> ProveReport:
    """Prove every model of a bundle for every generated target below `generated`."""
    folders = target_folders(Path(generated))
    results = []
    total = len(bundle.models) * len(folders)
    for folder in folders:
        if folder.name == "beckhoff-ml":
            results += [_left_out(model.ir, folder) for model in bundle.models]
            continue
        code = GeneratedCode(folder, TARGETS[folder.name].dialect)
        runs: dict[str, BlockRun] = {}
        for loaded in bundle.models:
            if progress is not None:
                progress(len(results), total, loaded.ir.name)
            results.append(prove_model(loaded.ir, code, runs))
        if bundle.purpose is not None:
            here = [result for result in results if result.target == folder.name]
            results += [_prove_around(name, code, bundle, here) for name in bundle.purpose.called_blocks()]
    if progress is not None:
        progress(total, total, "")
    return ProveReport(tuple(results))


def _prove_around(block: str, code: GeneratedCode, bundle: Bundle, models: list[ProofResult]) -> ProofResult:
    """The proof for a block around models of which there are proofs."""
    result = ProofResult(block, code.folder.name, block, Verdict.NOT_PROVED)
    missing = [model.model for model in models if model.verdict is not Verdict.PROVED]
    if missing:
        return _with(result, Verdict.NOT_PROVED, reason=f"it calls models that are not proved: {', '.join(missing)}")
    irs = {loaded.ir.name: loaded.ir for loaded in bundle.models}
    members: dict[str, list[tuple[ModelIR, tuple[int, ...]]]] = {}
    for model in models:
        members.setdefault(model.block, []).append((irs[model.model], model.outputs))
    try:
        proof = prove_block(code.project, block, members)
    except NotProvedError as error:
        return _with(result, Verdict.NOT_PROVED, reason=str(error))
    return _with(result, Verdict.PROVED, method="invariant of a call", claims=proof.claims)


def _left_out(model: ModelIR, folder: Path) -> ProofResult:
    block, _ = block_of(folder, model)
    return ProofResult(
        model.name, folder.name, block, Verdict.NOT_PROVED, "the vendor's runtime computes, not the text"
    )


@dataclass
class BlockRun:
    """A block of tables that several models share, executed once."""

    executor: Executor
    outputs: dict[str, Value]


def prove_model(model: ModelIR, code: GeneratedCode, runs: dict[str, BlockRun] | None = None) -> ProofResult:
    """Prove a model in one target; `runs` keeps blocks that several models share."""
    folder = code.folder
    block, outputs = block_of(folder, model)
    result = ProofResult(model.name, folder.name, block, Verdict.NOT_PROVED, outputs=outputs)
    if folder.name == "beckhoff-ml":
        return _left_out(model, folder)
    runs = {} if runs is None else runs
    points: FloatArray = np.zeros((0, len(model.features)))
    if model.must_be_present:
        reason = "missing values are taken in some inputs and refused in others, which is not followed"
        return _with(result, Verdict.NOT_PROVED, reason=reason)
    if not any(isinstance(op, TreeEnsemble) for op in model.ops):
        return _prove_expression(model, code, result)
    try:
        proof = _Proof(model, code, block, outputs, runs)
        method, trees, boxes = proof.check()
    except NotProvedError as error:
        reason = str(error)
    except Difference as difference:
        reason, points = str(difference), difference.points
    else:
        return _with(result, Verdict.PROVED, method=method, trees=trees, boxes=boxes)
    found = _counterexample(model, code, block, outputs, points)
    if found is not None:
        return _with(result, Verdict.REFUTED, reason=reason, counterexample=found)
    return _with(result, Verdict.NOT_PROVED, reason=reason)


def _prove_expression(model: ModelIR, code: GeneratedCode, result: ProofResult) -> ProofResult:
    """The proof for a model without trees."""
    try:
        proof = prove_arithmetic(model, code.project, result.block, result.outputs)
    except NotProvedError as error:
        return _with(result, Verdict.NOT_PROVED, reason=str(error))
    return _with(result, Verdict.PROVED, method=METHOD, operations=proof.operations, bound=proof.bound)


def _with(result: ProofResult, verdict: Verdict, **changes: object) -> ProofResult:
    values = {**result.__dict__, "verdict": verdict, **changes}
    return ProofResult(**values)


class _Proof:
    """The proof for one model."""

    def __init__(
        self, model: ModelIR, code: GeneratedCode, block: str, outputs: tuple[int, ...], runs: dict[str, BlockRun]
    ) -> None:
        self.model, self.outputs = model, outputs
        self.side = ModelSide(model)
        self.pool = Pool()
        self.fixed: dict[tuple[int, int, int], float] = {}
        self.expected = list(self._expected_terms())
        self.next = 0
        self.boxes = 0
        run = runs.get(block)
        if run is None:
            executor = Executor(code.project, block, self._axes(), self.pool, self._recognise)
            for axis in executor.axes:
                axis.cut(self.side.cuts(axis.feature))
            run = BlockRun(executor, executor.run())
            if not self.next:
                runs[block] = run
        self.run = run

    def _axes(self) -> list[InputAxis]:
        domain = self.side.domain
        ends = zip(domain.low.tolist(), domain.high.tolist(), strict=True)
        return [InputAxis(feature, first, last, nan=domain.nan) for feature, (first, last) in enumerate(ends)]

    def _expected_terms(self) -> Iterator[tuple[int, int, int]]:
        """(operation, tree, output) in the order in which the library adds; constant trees are noted in `fixed`."""
        for number, ensemble in self.side.ensembles.items():
            op = ensemble.op
            stops = np.append(op.roots[1:], op.n_nodes)
            bits = np.ascontiguousarray(op.leaf_value).view(np.int64)
            for tree in range(op.n_trees):
                node = np.arange(op.roots[tree], stops[tree])
                rows = op.leaf[node[op.split[node] < 0]]
                narrow = op.leaf_value.shape[1] == 1
                for column in range(op.leaf_value.shape[1]):
                    output = int(op.tree_output[tree]) if narrow else column
                    key = (number, tree, output)
                    if np.all(bits[rows, column] == bits[rows[0], column]):
                        self.fixed[key] = float(op.leaf_value[rows[0], column])
                    else:
                        yield key

    # --- recognising trees ------------------------------------------------------------------------------------------

    def _recognise(self, value: Lanes) -> ExpressionNode:
        """The tree of the model that a value of the text is: the next one in the library's order, or none."""
        while self.next < len(self.expected):
            key = self.expected[self.next]
            op = self.side.ensembles[key[0]].op
            points = self._differences(value, key)
            if points is None:
                self.next += 1
                return tree_leaf(self.pool, op, key)
            constant = self._constant(key)
            if constant is None:
                number, tree, _ = key
                raise Difference(f"a sum of the text has another term than tree {tree} of operation {number}", points)
            self.fixed[key] = constant
            self.next += 1
        raise Difference("the text adds more trees than the model has", self._some_points(value))

    def _differences(self, value: Lanes, key: tuple[int, int, int]) -> FloatArray | None:
        """Points in boxes in which a value is not the leaf value of a tree; None where it is everywhere."""
        number, tree, output = key
        ensemble = self.side.ensembles[number]
        value.lift()
        space = value.space.copy()
        got = Lanes(space, value.value, value.known)
        leaves = ensemble.leaves(space, tree)
        self.boxes += space.lanes
        column = 0 if ensemble.op.leaf_value.shape[1] == 1 else output
        wanted = ensemble.op.leaf_value[leaves.value, column]
        got.lift()
        if got.known is not None and not np.all(got.known):
            raise NotProvedError("a number is read before it is assigned")
        wrong = np.flatnonzero(_bits(got.value.astype(np.float64)) != _bits(wanted))
        return space.points(wrong[:1000]) if wrong.size else None

    def _constant(self, key: tuple[int, int, int]) -> float | None:
        """The value of a tree that is the same for all inputs of the domain."""
        number, tree, output = key
        ensemble = self.side.ensembles[number]
        space = Space(self._axes())
        leaves = ensemble.leaves(space, tree)
        values = ensemble.op.leaf_value[leaves.value, 0 if ensemble.op.leaf_value.shape[1] == 1 else output]
        return float(values[0]) if np.all(_bits(values) == _bits(values[:1])) else None

    def _some_points(self, value: Lanes) -> FloatArray:
        space = value.lift().space.copy()
        return space.points(np.arange(min(space.lanes, 1000)))

    # --- the outputs ------------------------------------------------------------------------------------------------

    def check(self) -> tuple[str, int, int]:
        """Compare what the block puts out with what the model demands; how, and the numbers of trees and boxes."""
        outputs = self.run.outputs
        valid = outputs.get("bValid")
        self._check_valid(valid)
        self._check_range(outputs)
        values = [self._value(outputs, number, valid) for number in self.outputs]
        if any(isinstance(value, ExpressionNode) for value in values):
            method = "sums of trees, tree by tree"
            self._check_sums(values)
        else:
            method = "all cells"
            for number, value in enumerate(values):
                self._check_cells(number, value)
        return method, len(self.expected), self.boxes

    def _value(self, outputs: dict[str, Value], number: int, valid: Value) -> Value:
        name = [name for name in outputs if not name.startswith("b")][number]  # the others are flags
        value = outputs[name]
        if isinstance(value, Conditional):
            same = isinstance(value.otherwise, Kept) and value.otherwise.name == name
            if not same or not _same_condition(value.condition, valid):
                raise NotProvedError(f"{name} does not keep its value exactly where bValid is FALSE")
            value = value.value
        return value

    def _check_valid(self, valid: Value) -> None:
        """bValid is TRUE exactly for the inputs for which the model has an answer."""
        domain = self.side.domain
        parts = _condition_parts(valid)
        for axis in self.run.executor.axes:
            feature = axis.feature
            axis.cut(np.array([domain.low[feature] - 1, domain.high[feature]]))
            wanted = np.append((axis.starts >= domain.low[feature]) & (axis.ends <= domain.high[feature]), domain.nan)
            part = parts.get(feature)
            got = np.ones(axis.lanes, np.bool_) if part is None else part.lift().constant.astype(np.bool_)
            wrong = np.flatnonzero(got != wanted)
            if wrong.size:
                raise Difference("bValid is not what the model demands", self._rows(feature, axis.low[wrong[:1000]]))

    def _rows(self, feature: int, values: FloatArray) -> FloatArray:
        domain = self.side.domain
        row = from_keys(np.clip(np.zeros(len(domain.low), np.int64), domain.low, domain.high))
        rows = np.tile(row, (len(values), 1))
        rows[:, feature] = values
        return rows

    def _check_range(self, outputs: dict[str, Value]) -> None:
        """bInRange, where there is one, is TRUE exactly where no number lies outside its declared range."""
        if "bInRange" not in outputs:
            return
        parts = _condition_parts(outputs["bInRange"])
        domain = self.side.domain
        for axis, feature in zip(self.run.executor.axes, self.model.features, strict=True):
            low, high = feature.checked or (-_LARGEST, _LARGEST)  # an infinity is in no range
            with np.errstate(over="ignore"):
                axis.cut_below(np.array([low, np.nextafter(high, np.inf)]))
            wanted = np.append((axis.low[:-1] >= low) & (axis.high[:-1] <= high), True)
            if low == 0.0:
                wanted |= axis.low == 0.0
            part = parts.get(axis.feature)
            got = np.ones(axis.lanes, np.bool_) if part is None else part.lift().constant.astype(np.bool_)
            inside = np.append(
                (axis.starts >= domain.low[axis.feature]) & (axis.ends <= domain.high[axis.feature]), domain.nan
            )
            if np.any((got != wanted) & inside):
                raise NotProvedError(f"bInRange is not what the range of '{feature.name}' demands")

    def _check_sums(self, values: list[Value]) -> None:
        while self.next < len(self.expected):  # trees that the text leaves out must be constant
            key = self.expected[self.next]
            constant = self._constant(key)
            if constant is None:
                raise Difference(f"the text leaves out tree {key[1]}", self._all_leaves(key))
            self.fixed[key] = constant
            self.next += 1
        wanted = self.side.outputs(self.pool, self.fixed)
        for number, (value, node) in enumerate(zip(values, wanted, strict=True)):
            got = value if isinstance(value, ExpressionNode) else self.run.executor.as_node(value)
            if got is not node:
                raise Difference(
                    f"output {number + 1}: not the additions and roundings of the model in its order",
                    self._all_leaves(self.expected[0]),
                )

    def _all_leaves(self, key: tuple[int, int, int]) -> FloatArray:
        space = Space(self._axes())
        self.side.ensembles[key[0]].leaves(space, key[1])
        return space.points(np.arange(min(space.lanes, 1000)))

    def _check_cells(self, output: int, value: Value) -> None:
        """In every box of the text and of the model together one evaluation of the model decides."""
        if any(not isinstance(op, TreeEnsemble) and not op.exact for op in self.model.ops) and not self._steps():
            raise NotProvedError("the model has inexact operations in front of a comparison")
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
        self.boxes += space.lanes
        got.lift()
        if got.known is not None and not np.all(got.known):
            raise NotProvedError("an output is read before it is assigned")
        points = space.points(np.arange(space.lanes))
        batches = range(0, len(points), _BATCH)
        wanted = np.concatenate([reference.evaluate(self.model, points[at : at + _BATCH])[:, output] for at in batches])
        wrong = np.flatnonzero(_bits(got.value.astype(np.float64)) != _bits(wanted))
        if wrong.size:
            raise Difference("a cell of the table differs from the model", points[wrong[:1000]])

    def _steps(self) -> bool:
        return bool(self.side.ensembles)


def _bits(values: FloatArray) -> IntArray:
    return np.ascontiguousarray(values, np.float64).view(np.int64)


def _condition_parts(value: Value) -> dict[int, AxisValue]:
    """A condition by input. Raises NotProvedError for another one."""
    if value is True:
        return {}
    if isinstance(value, AxisValue):
        return {value.axis.feature: value}
    if isinstance(value, All):
        return dict(value.parts)
    raise NotProvedError("bValid or bInRange is not followed")


def _same_condition(one: Value, other: Value) -> bool:
    first, second = _condition_parts(one), _condition_parts(other)
    return set(first) == set(second) and all(
        np.array_equal(first[key].lift().constant, second[key].lift().constant) for key in first
    )


def _counterexample(
    model: ModelIR, code: GeneratedCode, block: str, outputs: tuple[int, ...], points: FloatArray
) -> Counterexample | None:
    """The first of some points at which the executed text is not what the model demands."""
    if not len(points):
        return None
    expected = reference.evaluate(model, points)
    try:
        result = code.run_model(block, points, outputs)
    except GeneratedCodeError as error:
        for row in points:
            try:
                code.run_model(block, row[None, :], outputs)
            except GeneratedCodeError:
                return Counterexample(tuple(map(float, row)), None, None, str(error))
        return None
    got = np.where(result.valid[:, None], result.values, np.nan)
    same = (_bits(expected) == _bits(got)) | (np.isnan(expected) & np.isnan(got))
    for row in np.flatnonzero(~np.all(same, axis=1))[:1]:
        return Counterexample(
            tuple(map(float, points[row])),
            tuple(map(float, expected[row])) if not np.isnan(expected[row]).any() else None,
            tuple(map(float, got[row])) if result.valid[row] else None,
        )
    return None
