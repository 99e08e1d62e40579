"""A model as one of the engines of TwinCAT's machine learning runtime: trees, network of layers, support vectors.

An engine is poorer than the intermediate representation: it knows no missing values, no categories, one comparison and
one kind of sum. What it cannot say is refused with its reason. Thresholds are chosen so that `x <= threshold` on
float64 numbers decides exactly as the library does, rounding of the input to float32 included.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import singledispatch
from itertools import combinations
from typing import ClassVar

import numpy as np

from st_codegen import ir
from st_codegen.beckhoff_ml.file import ACTIVATIONS, KERNELS
from st_codegen.errors import UnsupportedModelError, errors_name
from st_codegen.ir.arrays import Float32Array, FloatArray, Int32Array
from st_codegen.passes.monotone import last_on_the_left
from st_codegen.walkers.base import GraphBuilder
from st_codegen.walkers.classes import pair_coefficients, pair_votes

_ACTIVATION_NAMES = {function: f"ACT_FN_{name}" for name, function in ACTIVATIONS.items()}
_KERNEL_NAMES = {kernel: f"KERNEL_FN_{name}" for name, kernel in KERNELS.items()}


@dataclass(frozen=True)
class Affine:
    """`scaling * x + offset`, column by column; `terms` bounds the sum of the offsets' magnitudes on the way there."""

    scaling: FloatArray
    offset: FloatArray
    terms: FloatArray

    @classmethod
    def identity(cls, width: int) -> Affine:
        return cls(np.ones(width), np.zeros(width), np.zeros(width))

    @property
    def changes_nothing(self) -> bool:
        return bool(np.all(self.scaling == 1.0) and not np.any(self.offset))

    def then(self, op: ir.Scale) -> Affine:
        """Behind one more step. Raises UnsupportedModelError for constant / x."""
        a, b, t, c = self.scaling, self.offset, self.terms, op.constant
        if op.operator in (ir.Operator.ADD, ir.Operator.SUBTRACT):
            plus = op.operator is ir.Operator.ADD
            sign = -1.0 if not plus and op.reverse else 1.0
            shift = c if plus or op.reverse else -c
            return Affine(sign * a, sign * b + shift, t + np.abs(c))
        if op.operator is ir.Operator.MULTIPLY:
            return Affine(a * c, b * c, t * np.abs(c))
        if op.operator in (ir.Operator.MAXIMUM, ir.Operator.MINIMUM):
            raise UnsupportedModelError("a limit of a computed number: the format scales and shifts only")
        if op.reverse:
            raise UnsupportedModelError("a constant divided by an input: the format scales and shifts only")
        return Affine(a / c, b / c, t / np.abs(c))

    def of(self, columns: Int32Array) -> Affine:
        """The transformation of some of the columns."""
        return Affine(self.scaling[columns], self.offset[columns], self.terms[columns])

    def placed(self, positions: Int32Array, width: int) -> Affine:
        """For `width` columns, this one's column i at position `positions[i]`; the others stay as they are."""
        wide = Affine.identity(width)
        for part, own in ((wide.scaling, self.scaling), (wide.offset, self.offset), (wide.terms, self.terms)):
            part[positions] = own
        return wide


@dataclass(frozen=True)
class Tree:
    """Nodes of one tree, root first: threshold or leaf value, column (leaf: 0), children (leaf: 0)."""

    values: FloatArray
    columns: Int32Array
    left: Int32Array
    right: Int32Array

    @property
    def leaves(self) -> FloatArray:
        leaves: FloatArray = self.values[self.left == 0]
        return leaves

    @property
    def children(self) -> Int32Array:
        return np.concatenate([self.left, self.right])


@dataclass(frozen=True)
class Engine:
    """What all engines have.

    `first` and `last` are the numbers of the model's operations (from 1) that the engine computes; before and behind
    them lie the transformations of inputs and outputs. `rounds`: the library rounds the inputs to float32 before that.
    """

    n_inputs: int
    n_outputs: int
    input: Affine
    output: Affine
    first: int
    last: int
    rounds: bool
    precision: ClassVar[ir.Precision] = ir.Precision.FLOAT64
    folder: ClassVar[str]
    template: ClassVar[str]

    @property
    def compares_only(self) -> bool:
        """Whether infinite inputs do no harm."""
        return False


@dataclass(frozen=True)
class TreeEngine(Engine):
    """rf_fp64_engine: base + leaf values in tree order, each already divided where the model averages."""

    base: float
    trees: tuple[Tree, ...]
    folder: ClassVar[str] = "trees"
    template: ClassVar[str] = "tree_ensemble"

    @property
    def compares_only(self) -> bool:
        return self.input.changes_nothing

    @property
    def n_leaves(self) -> int:
        return sum(len(tree.leaves) for tree in self.trees)


@dataclass(frozen=True)
class Layer:
    """A row a neuron, its constant last; float32."""

    activation: str
    weights: Float32Array


@dataclass(frozen=True)
class MlpEngine(Engine):
    """mlp_fp32_engine: weights and arithmetic in float32."""

    layers: tuple[Layer, ...]
    precision: ClassVar[ir.Precision] = ir.Precision.FLOAT32
    folder: ClassVar[str] = "mlp"
    template: ClassVar[str] = "mlp"


@dataclass(frozen=True)
class SvmEngine(Engine):
    """svm_fp64_engine: sum of coefficient * kernel(x, support vector) - rho.

    Of a classifier each pair of classes has such a sum and votes, and the result is a label: `coefficients` has shape
    (classes - 1, vectors), `rho` (pairs). The format wants two classes, `vectors_per_class`, even of a regression.
    """

    kernel: ir.Kernel
    gamma: float
    coef0: float
    degree: int
    vectors: FloatArray
    coefficients: FloatArray
    rho: FloatArray
    vectors_per_class: tuple[int, ...]
    classifies: bool = False
    folder: ClassVar[str] = "svm"
    template: ClassVar[str] = "svm"

    @property
    def kernel_name(self) -> str:
        return _KERNEL_NAMES[self.kernel]

    @property
    def labels(self) -> range:
        """Labels in the file: the numbers of the classes of a classifier, 1 and 2 of a regressor."""
        return range(len(self.vectors_per_class)) if self.classifies else range(1, 3)


def engines_of(model: ir.ModelIR) -> tuple[Engine, ...]:
    """The engines that compute a model: one, or one for each output where an engine has only one.

    Raises UnsupportedModelError with all that the format cannot say.
    """
    for number, op in enumerate(model.ops, 1):
        if op.inputs != (number - 1,):
            raise UnsupportedModelError("the model has branches; an engine is one chain of operations")
    columns = np.arange(len(model.features), dtype=np.int32)
    affine = Affine.identity(len(columns))
    for number, op in enumerate(model.ops, 1):
        if isinstance(op, ir.Select):
            columns = columns[op.columns]
            affine = affine.of(op.columns)
        elif isinstance(op, ir.Scale):
            affine = affine.then(op)
        elif not isinstance(op, ir.Round):
            return _engines(op, _Front(model, number, columns, affine))
    raise UnsupportedModelError("the model only scales its inputs: no engine does that")


@dataclass(frozen=True)
class _Front:
    """What comes before operation `number` (from 1): it reads features `columns`, scaled."""

    model: ir.ModelIR
    number: int
    columns: Int32Array
    affine: Affine

    @property
    def rounds(self) -> bool:
        """Whether the features are rounded to float32."""
        return any(isinstance(op, ir.Round) for op in self.model.ops[: self.number - 1])

    def in_place(self, unused: float = 1.0) -> Affine:
        """The transformation of all features in their order; what the model leaves out is multiplied by `unused`.

        Raises UnsupportedModelError where a feature is used twice.
        """
        if len(np.unique(self.columns)) != len(self.columns):
            raise UnsupportedModelError("a feature is used twice; the format scales each feature once")
        placed = self.affine.placed(self.columns, len(self.model.features))
        placed.scaling[np.setdiff1d(np.arange(len(self.model.features)), self.columns)] = unused
        return placed


@singledispatch
def _engines(op: ir.Operation, front: _Front) -> tuple[Engine, ...]:
    """The engines whose first operation is `op`."""
    raise UnsupportedModelError(f"{type(op).__name__} of the inputs: no engine computes it")


def output_of(model: ir.ModelIR, last: int) -> Affine:
    """What happens to the result of operation `last`. Raises UnsupportedModelError for all but scaling and shifting."""
    affine = Affine.identity(model.value_width(last))
    for op in model.ops[last:]:
        if isinstance(op, ir.Scale):
            affine = affine.then(op)
        elif isinstance(op, ir.Activation) and op.function is not ir.Function.IDENTITY:
            raise UnsupportedModelError(
                f"the result is passed through {op.function}; the format scales and shifts only"
            )
        elif not isinstance(op, ir.Round | ir.Activation):
            raise UnsupportedModelError(f"{type(op).__name__} of the result: the format scales and shifts only")
    return affine


@_engines.register
def _(op: ir.TreeEnsemble, front: _Front) -> tuple[Engine, ...]:
    _check_trees(op)
    width = len(front.model.features)
    inputs = Affine.identity(width) if front.affine.changes_nothing else front.in_place()
    read = replace(op, input_precision=ir.Precision.FLOAT32) if front.rounds else op
    split = _EngineSplits(
        last_on_the_left(read, np.where(op.split >= 0, op.threshold, 0.0)),
        front.columns[np.array([column.column for column in op.columns] or [0], np.int32)],
    )
    outputs = output_of(front.model, front.number)
    narrow = op.leaf_value.shape[1] == 1
    return tuple(
        TreeEngine(
            n_inputs=width,
            n_outputs=1,
            input=inputs,
            output=outputs.of(np.array([number], np.int32)),
            first=front.number,
            last=front.number,
            rounds=False,
            base=float(op.base[number]) / (1.0 if op.base_last else op.divisor),
            trees=tuple(
                _tree(op, split, tree, 0 if narrow else number)
                for tree in range(op.n_trees)
                if not narrow or op.tree_output[tree] == number
            ),
        )
        for number in range(op.width)
    )


@dataclass(frozen=True)
class _EngineSplits:
    """What the splits of an ensemble compare: a threshold a node, and the feature of each column."""

    threshold: FloatArray
    feature: Int32Array


def _tree(op: ir.TreeEnsemble, splits: _EngineSplits, number: int, output: int) -> Tree:
    start = int(op.roots[number])
    stop = int(op.roots[number + 1]) if number + 1 < op.n_trees else op.n_nodes
    split = op.split[start:stop]
    inner = split >= 0
    leaf = op.leaf_value[np.maximum(op.leaf[start:stop], 0), output] / op.divisor
    return Tree(
        np.where(inner, splits.threshold[start:stop], leaf),
        np.where(inner, splits.feature[np.maximum(split, 0)], 0).astype(np.int32),
        np.where(inner, op.left[start:stop] - start, 0).astype(np.int32),
        np.where(inner, op.right[start:stop] - start, 0).astype(np.int32),
    )


def _check_trees(op: ir.TreeEnsemble) -> None:
    reasons = []
    if op.has_categories:
        reasons.append("splits by category")
    if any(column.missing_interval is not None for column in op.columns):
        reasons.append("numbers that count as missing values")
    if np.any(np.isinf(op.threshold[op.split >= 0])) or any(column.seen_missing for column in op.columns):
        reasons.append("splits trained on missing values")
    if op.linear is not None:
        reasons.append("linear models in leaves")
    if op.aggregate is not ir.Aggregate.SUM:
        reasons.append(f"the {op.aggregate} over trees")
    if not op.is_forest:
        reasons.append("nodes that several splits share")
    if reasons:
        raise UnsupportedModelError(f"trees with {', '.join(reasons)}: not expressible")


@_engines.register
def _(op: ir.Linear, front: _Front) -> tuple[Engine, ...]:
    inputs = front.in_place()
    model = front.model
    layers: list[tuple[ir.Linear, ir.Function]] = []
    last = front.number
    for at in range(front.number, len(model.ops) + 1):
        current = model.ops[at - 1]
        if isinstance(current, ir.Linear):
            layers.append((current, ir.Function.IDENTITY))
        elif isinstance(current, ir.Activation) and layers and layers[-1][1] is ir.Function.IDENTITY:
            layers[-1] = (layers[-1][0], current.function)
        elif not isinstance(current, ir.Round):
            break
        last = at
    unknown = sorted({function.value for _, function in layers if function not in _ACTIVATION_NAMES})
    if unknown:
        raise UnsupportedModelError(f"no engine has the activation function {', '.join(unknown)}")
    first = np.zeros((op.width, len(model.features)))
    first[:, front.columns] = op.weights
    weights = [first, *(layer.weights for layer, _ in layers[1:])]
    built = tuple(
        Layer(_ACTIVATION_NAMES[function], _single(np.column_stack([matrix, layer.bias])))
        for matrix, (layer, function) in zip(weights, layers, strict=True)
    )
    return (
        MlpEngine(
            n_inputs=len(model.features),
            n_outputs=len(model.outputs),
            input=inputs,
            output=output_of(model, last),
            first=front.number,
            last=last,
            rounds=front.rounds,
            layers=built,
        ),
    )


def _single(values: FloatArray) -> Float32Array:
    with np.errstate(over="ignore"):
        single: Float32Array = values.astype(np.float32)
    if not np.all(np.isfinite(single)):
        raise UnsupportedModelError("a weight is too large for float32, in which the engine computes")
    return single


@_engines.register
def _(op: ir.KernelSum, front: _Front) -> tuple[Engine, ...]:
    # a vector of an RBF kernel measures the distance along every input
    inputs = front.in_place(unused=0.0)
    vectors = np.zeros((len(op.support_vectors), len(front.model.features)))
    vectors[:, front.columns] = op.support_vectors
    one = SvmEngine(
        n_inputs=len(front.model.features),
        n_outputs=1,
        input=inputs,
        output=Affine.identity(1),
        first=front.number,
        last=front.number,
        rounds=front.rounds,
        kernel=op.kernel,
        gamma=op.gamma,
        coef0=op.coef0,
        degree=op.degree,
        vectors=vectors,
        coefficients=op.coefficients,
        rho=-op.intercept,
        vectors_per_class=(1, len(vectors) - 1),
    )
    if front.model.classes is not None:
        return (_voting(op, front, one),)
    outputs = output_of(front.model, front.number)
    return tuple(
        replace(
            one,
            output=outputs.of(np.array([number], np.int32)),
            coefficients=op.coefficients[number : number + 1],
            rho=one.rho[number : number + 1],
        )
        for number in range(op.width)
    )


def _voting(op: ir.KernelSum, front: _Front, engine: SvmEngine) -> SvmEngine:
    """The engine of a classifier of which each pair of classes votes, as libsvm decides."""
    builder = GraphBuilder(op.width)
    count = len(front.model.classes.labels) if front.model.classes is not None else 0
    votes = pair_votes(builder, 0, count)
    builder.add(ir.ArgMax((votes,), count))
    rest = [step for step in front.model.ops[front.number :] if not isinstance(step, ir.Select)]
    if op.width != count * (count - 1) // 2 or [_said(step) for step in rest] != [_said(step) for step in builder.ops]:
        raise UnsupportedModelError("a label that is not that of most votes of pairs: the format says no other")
    # a vector has a coefficient above 0 in pairs of which its class is the first, and one below 0 in others
    owner = np.zeros(len(op.support_vectors), np.int64)
    for (one, other), row in zip(combinations(range(count), 2), op.coefficients, strict=True):
        owner = np.where(row > 0, one, np.where(row < 0, other, owner))
    of_class = np.bincount(owner, minlength=count)
    dual = np.zeros((count - 1, len(owner)))
    for (one, other), row in zip(combinations(range(count), 2), op.coefficients, strict=True):
        dual[other - 1, owner == one], dual[one, owner == other] = row[owner == one], row[owner == other]
    if np.any(np.diff(owner) < 0) or not np.array_equal(pair_coefficients(dual, of_class), op.coefficients):
        raise UnsupportedModelError("support vectors that do not stand class by class: not expressible")
    per_class = tuple(int(number) for number in of_class)
    last = len(front.model.ops)
    return replace(engine, last=last, coefficients=dual, vectors_per_class=per_class, classifies=True)


def _said(op: ir.Operation) -> tuple[object, ...]:
    """What an operation computes, for comparison with another one."""
    numbers = (op.cut,) if isinstance(op, ir.Exceeds) else (op.weights, op.bias) if isinstance(op, ir.Linear) else ()
    inclusive = op.inclusive if isinstance(op, ir.Exceeds) else None
    return type(op), op.width, op.operand_width, inclusive, *(array.tolist() for array in numbers)


def checked_engines(model: ir.ModelIR) -> tuple[Engine, ...]:
    """`engines_of`, its errors with the name of the model."""
    with errors_name(f"model '{model.name}'"):
        has_file = model.classes is None or any(isinstance(op, ir.KernelSum) for op in model.ops)
        engines = engines_of(model) if has_file else ()
        if not engines:
            raise UnsupportedModelError(
                "a classifier that is no support vector machine: the text of such files is not public; use --target "
                "twincat, which computes it in Structured Text"
            )
        if model.classes is not None and len(model.outputs) > 1:
            raise UnsupportedModelError("the runtime hands out labels only: leave scores out (--outputs class)")
        return engines
