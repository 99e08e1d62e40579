"""Intermediate representation: all that walkers make and all that later stages read.

A model is a straight list of operations on vectors. Value 0 is the vector of the model's inputs (one number a feature);
operation `i` reads earlier values and produces value `i + 1`. What differs between libraries (comparison, rounding,
order of additions, missing values) is data here, never a special case downstream.

Everything is frozen, arrays are read-only, and invariants are checked when an object is made: a walker cannot hand on
an operation that a later stage would have to doubt.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from st_codegen.errors import InputError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
BoolArray = NDArray[np.bool_]

#: Values of this magnitude and above become infinite when rounded to float32 (the tie to even above FLT_MAX).
FLOAT32_OVERFLOW = 3.4028235677973366e38


class Precision(StrEnum):
    """The format to which a library rounds a number."""

    FLOAT32 = "float32"
    FLOAT64 = "float64"


#: Intermediate results of generated code stay below these, so that nothing overflows on the controller. A quotient of
#: two computed numbers that would be larger has no answer.
CEILING = {Precision.FLOAT64: 1e300, Precision.FLOAT32: 3e38}


class Comparison(StrEnum):
    """Which comparison sends an input to the left child of a split."""

    LESS = "<"
    LESS_OR_EQUAL = "<="


class Aggregate(StrEnum):
    """How the leaf values that a row reaches become one number."""

    SUM = "sum"
    MINIMUM = "minimum"
    MAXIMUM = "maximum"


class NanRule(StrEnum):
    """How a tree reads NaN in a column (where the model accepts NaN at all)."""

    MISSING = "missing"  # the row takes the default child
    ZERO = "zero"  # read as 0.0 (LightGBM, missing_type None)


class Operator(StrEnum):
    """Arithmetic of two numbers."""

    ADD = "+"
    SUBTRACT = "-"
    MULTIPLY = "*"
    DIVIDE = "/"


class Function(StrEnum):
    """Functions of one number. `Activation.parameter` is the slope or scale where one is named."""

    IDENTITY = "identity"
    TANH = "tanh"
    LOGISTIC = "logistic"  # 1 / (1 + exp(-x))
    RELU = "relu"
    LEAKY_RELU = "leaky_relu"  # x < 0: parameter * x
    ELU = "elu"  # x < 0: parameter * (exp(x) - 1)
    SOFTPLUS = "softplus"  # log(1 + exp(x))
    EXP = "exp"
    EXPM1 = "expm1"
    LOG1P = "log1p"
    SIGNED_SQUARE = "signed_square"  # sign(x) * x * x (LightGBM reg_sqrt)


class Kernel(StrEnum):
    """Kernel functions of support vector machines; u is the input, v a support vector."""

    LINEAR = "linear"  # u.v
    POLYNOMIAL = "polynomial"  # (gamma * u.v + coef0) ** degree
    RBF = "rbf"  # exp(-gamma * |u - v|**2)
    SIGMOID = "sigmoid"  # tanh(gamma * u.v + coef0)


class Norm(StrEnum):
    """Norms by which a vector is divided."""

    L1 = "l1"
    L2 = "l2"
    MAX = "max"


class SummationOrder(StrEnum):
    """What is known of the order in which a library adds products."""

    SEQUENTIAL = "sequential"  # bias first, then each product rounded and added in order
    UNSPECIFIED = "unspecified"  # BLAS: any order, perhaps fused; equal within a bound only


def _freeze(owner: Any, name: str, dtype: type[np.generic], shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Store attribute `name` of a frozen dataclass as a read-only array of the given type and shape (None: any)."""
    given = np.asarray(getattr(owner, name))
    array = np.array(given, dtype=dtype, order="C") if given.dtype != dtype or given.flags.writeable else given
    where = f"{type(owner).__name__}.{name}"
    if array.ndim != len(shape) or any(
        want is not None and got != want for got, want in zip(array.shape, shape, strict=True)
    ):
        raise InputError(f"{where}: shape {array.shape}, expected {tuple('any' if n is None else n for n in shape)}")
    array.flags.writeable = False
    object.__setattr__(owner, name, array)
    return array


def _require_finite(owner: Any, *names: str) -> None:
    """Refuse NaN and infinite coefficients: a comparison or sum with one of them stops a PLC."""
    for name in names:
        bad = np.flatnonzero(~np.isfinite(np.ravel(getattr(owner, name))))
        if bad.size:
            value = np.ravel(getattr(owner, name))[bad[0]]
            raise InputError(
                f"{type(owner).__name__}.{name}: {bad.size} coefficients are not finite "
                f"(first: number {bad[0]} is {value}); train the model again without NaN and infinite values"
            )


@dataclass(frozen=True)
class Feature:
    """One input of a model.

    `lower` and `upper` are the trained range in `unit`; a lone model declares none.
    """

    name: str
    unit: str = ""
    lower: float | None = None
    upper: float | None = None

    def __post_init__(self) -> None:
        for bound in (self.lower, self.upper):
            if bound is not None and not math.isfinite(bound):
                raise InputError(f"feature '{self.name}': the range {self.lower} .. {self.upper} is not finite")
        if (self.lower is None) != (self.upper is None):
            raise InputError(f"feature '{self.name}': give both ends of the range, or none")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            raise InputError(f"feature '{self.name}': the range {self.lower} .. {self.upper} is empty")


@dataclass(frozen=True)
class Source:
    """Where a model comes from, as printed in the header of the generated block."""

    library: str
    version: str
    model_class: str
    file: str = ""
    sha256: str = ""
    notes: tuple[str, ...] = ()


class Operation(Protocol):
    """What every operation offers: which values it reads and how wide its result is."""

    @property
    def inputs(self) -> tuple[int, ...]: ...
    @property
    def width(self) -> int: ...
    @property
    def operand_width(self) -> int | None:
        """The width expected of each input; None where any will do."""
        ...

    def check_operands(self, total: int) -> None:
        """Raise InputError unless the operation can read inputs of `total` columns together."""
        ...

    @property
    def exact(self) -> bool:
        """Whether the source library's result is reproduced bit for bit."""
        ...


class _Elementwise:
    """Mixin of operations that read values of their own width."""

    @property
    def operand_width(self: Operation) -> int:
        return self.width

    def check_operands(self, total: int) -> None:
        """Nothing beyond the width."""


def _check_columns(owner: Any, columns: Iterable[int], total: int) -> None:
    if any(not 0 <= column < total for column in columns):
        raise InputError(f"{type(owner).__name__}: reads a column outside 0 .. {total - 1}")


@dataclass(frozen=True)
class Select:
    """Columns picked from one or several values laid end to end (concatenation, reordering, column transformers)."""

    inputs: tuple[int, ...]
    columns: IntArray
    exact: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _freeze(self, "columns", np.int32, (None,))

    @property
    def width(self) -> int:
        return len(self.columns)

    @property
    def operand_width(self) -> None:
        return None

    def check_operands(self, total: int) -> None:
        _check_columns(self, self.columns, total)


@dataclass(frozen=True)
class Scale(_Elementwise):
    """`x <operator> constant` for each column, rounded to `precision`; `reverse` gives `constant <operator> x`.

    A chain of these says exactly what a scaler does: (x - mean) / scale is two of them, x * scale + min is two others.
    """

    inputs: tuple[int, ...]
    operator: Operator
    constant: FloatArray
    precision: Precision = Precision.FLOAT64
    reverse: bool = False
    exact: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _freeze(self, "constant", np.float64, (None,))
        _require_finite(self, "constant")
        if self.operator is Operator.DIVIDE and not self.reverse and not np.all(self.constant):
            raise InputError("Scale: division by a constant that is zero")

    @property
    def width(self) -> int:
        return len(self.constant)


@dataclass(frozen=True)
class Combine(_Elementwise):
    """`a <operator> b` for two computed values of one width, column by column, rounded to `precision`."""

    inputs: tuple[int, ...]
    operator: Operator
    width: int
    precision: Precision = Precision.FLOAT64
    exact: ClassVar[bool] = True


@dataclass(frozen=True)
class Round(_Elementwise):
    """Rounding to float32: a library's cast. A value too large for float32 makes the row invalid."""

    inputs: tuple[int, ...]
    width: int
    exact: ClassVar[bool] = True


@dataclass(frozen=True)
class FillMissing(_Elementwise):
    """NaN, and every number equal to `sentinel` where there is one, replaced by `fill` (XGBoost gblinear)."""

    inputs: tuple[int, ...]
    width: int
    fill: float = 0.0
    sentinel: float | None = None
    exact: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not math.isfinite(self.fill) or not (self.sentinel is None or math.isfinite(self.sentinel)):
            raise InputError(f"FillMissing: fill {self.fill} or sentinel {self.sentinel} is not finite")


@dataclass(frozen=True)
class Clip(_Elementwise):
    """Each column limited to [lower, upper] (MinMaxScaler(clip=True), ONNX Clip)."""

    inputs: tuple[int, ...]
    lower: FloatArray
    upper: FloatArray
    exact: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _freeze(self, "lower", np.float64, (None,))
        _freeze(self, "upper", np.float64, (len(self.lower),))
        _require_finite(self, "lower", "upper")

    @property
    def width(self) -> int:
        return len(self.lower)


@dataclass(frozen=True)
class Linear:
    """`weights @ x + bias`; weights has shape (outputs, inputs)."""

    inputs: tuple[int, ...]
    weights: FloatArray
    bias: FloatArray
    order: SummationOrder = SummationOrder.UNSPECIFIED
    precision: Precision = Precision.FLOAT64

    def __post_init__(self) -> None:
        weights = _freeze(self, "weights", np.float64, (None, None))
        _freeze(self, "bias", np.float64, (weights.shape[0],))
        _require_finite(self, "weights", "bias")

    @property
    def operand_width(self) -> int:
        return int(self.weights.shape[1])

    def check_operands(self, total: int) -> None:
        """Nothing beyond the width."""

    @property
    def width(self) -> int:
        return int(self.weights.shape[0])

    @property
    def exact(self) -> bool:
        return self.order is SummationOrder.SEQUENTIAL


@dataclass(frozen=True)
class Activation(_Elementwise):
    """A function of each column. Exact where it needs no transcendental function.

    Arguments above `limit` are refused (exponentials: the pass `domain` sets a limit below overflow).
    """

    inputs: tuple[int, ...]
    function: Function
    width: int
    parameter: float = 1.0
    precision: Precision = Precision.FLOAT64
    limit: float = math.inf

    _EXACT: ClassVar[frozenset[Function]] = frozenset(
        {Function.IDENTITY, Function.RELU, Function.LEAKY_RELU, Function.SIGNED_SQUARE}
    )

    def __post_init__(self) -> None:
        if not math.isfinite(self.parameter):
            raise InputError(f"Activation {self.function}: the parameter {self.parameter} is not finite")

    @property
    def exact(self) -> bool:
        return self.function in self._EXACT


@dataclass(frozen=True)
class Normalize(_Elementwise):
    """The vector divided by its norm, every step rounded to `precision` (onnxruntime, ml/normalizer.cc).

    MAX: x / largest number (not largest magnitude). L1: x / (|x1| + |x2| + ...), added in order.
    L2: sign(x) * sqrt(x*x / (x1*x1 + x2*x2 + ...)), added in order. A norm of zero leaves the vector as it is.
    """

    inputs: tuple[int, ...]
    norm: Norm
    width: int
    precision: Precision = Precision.FLOAT32
    exact: ClassVar[bool] = True


@dataclass(frozen=True)
class KernelSum:
    """Support vector regression: sum of coefficient * kernel(x, support vector), plus intercept.

    `support_vectors` (vectors, columns); `coefficients` (outputs, vectors); `intercept` (outputs).
    """

    inputs: tuple[int, ...]
    kernel: Kernel
    support_vectors: FloatArray
    coefficients: FloatArray
    intercept: FloatArray
    gamma: float = 1.0
    coef0: float = 0.0
    degree: int = 3
    precision: Precision = Precision.FLOAT64
    exact: ClassVar[bool] = False

    def __post_init__(self) -> None:
        vectors = _freeze(self, "support_vectors", np.float64, (None, None))
        coefficients = _freeze(self, "coefficients", np.float64, (None, vectors.shape[0]))
        _freeze(self, "intercept", np.float64, (coefficients.shape[0],))
        _require_finite(self, "support_vectors", "coefficients", "intercept")
        if not (math.isfinite(self.gamma) and math.isfinite(self.coef0)):
            raise InputError(f"KernelSum: gamma {self.gamma} or coef0 {self.coef0} is not finite")
        if self.kernel is Kernel.RBF and self.gamma < 0:
            raise InputError(f"KernelSum: gamma {self.gamma} is negative; an RBF kernel would grow without bound")
        if self.degree < 0:
            raise InputError(f"KernelSum: degree {self.degree} is negative")

    @property
    def operand_width(self) -> int:
        return int(self.support_vectors.shape[1])

    def check_operands(self, total: int) -> None:
        """Nothing beyond the width."""

    @property
    def width(self) -> int:
        return int(self.coefficients.shape[0])


@dataclass(frozen=True)
class TreeColumn:
    """How the splits of an ensemble read one column of its input.

    The number is first rounded to the ensemble's `input_precision`. A number in the closed interval `missing_interval`
    counts as missing, as NaN does under `NanRule.MISSING`. With `n_categories` the column holds a category code: the
    number cut to an integer, or, where `categories` lists the known values, the position of the equal value in that
    list. Codes outside 0 .. n_categories-1 are "other", and so is every negative number, unless
    `negative_fraction_is_zero`: then numbers between -1 and 0 are cut to code 0 (a plain C cast). `seen_missing`: the
    model file says that the training data had missing values here (most files do not say).
    """

    column: int
    nan: NanRule = NanRule.MISSING
    missing_interval: tuple[float, float] | None = None
    n_categories: int = 0
    categories: tuple[float, ...] | None = None
    negative_fraction_is_zero: bool = False
    seen_missing: bool = False

    @property
    def categorical(self) -> bool:
        return self.n_categories > 0


@dataclass(frozen=True)
class LinearLeaves:
    """Linear models in leaves (LightGBM linear_tree): constant + sum of coefficient * column, in order.

    Leaf row `r` owns entries `start[r] .. start[r+1]-1` of `column` and `coefficient`. A NaN in one of these columns
    makes the leaf fall back to its plain value. An input of magnitude `zero_magnitude` or less is read as 0.
    """

    constant: FloatArray
    start: IntArray
    column: IntArray
    coefficient: FloatArray
    zero_magnitude: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.zero_magnitude < math.inf:
            raise InputError(f"LinearLeaves.zero_magnitude: {self.zero_magnitude}")
        constant = _freeze(self, "constant", np.float64, (None,))
        start = _freeze(self, "start", np.int32, (len(constant) + 1,))
        column = _freeze(self, "column", np.int32, (None,))
        _freeze(self, "coefficient", np.float64, (len(column),))
        _require_finite(self, "constant", "coefficient")
        if start[0] != 0 or start[-1] != len(column) or np.any(np.diff(start) < 0):
            raise InputError("LinearLeaves.start: not a rising list of positions that covers all coefficients")


@dataclass(frozen=True)
class TreeEnsemble:
    """Decision trees in flat arrays.

    Nodes of tree `t` are `roots[t] .. roots[t+1]-1` (to the end for the last), parents before children. A node with
    `split[n] >= 0` is a split: `split` indexes `columns`. It goes left when `value <comparison> threshold[n]`; a
    missing value goes where `missing_left[n]` says; for a category column, `category_left` has the answer for code c
    at position `category_row[n] + c`, with c = n_categories for "other" and n_categories + 1 for a missing value.
    A threshold of +infinity sends every number left (HistGradientBoosting's split of missing from present).
    A node with `split[n] < 0` is a leaf: row `leaf[n]` of `leaf_value` (leaves, width of a leaf).

    Leaves of width 1 add to output `tree_output[t]`; wider leaves have one number for each output.
    The result of an output is `(base + v1 + v2 + ...) / divisor` with every addition rounded to `sum_precision`, `base`
    added last instead of first when `base_last`.
    """

    inputs: tuple[int, ...]
    columns: tuple[TreeColumn, ...]
    roots: IntArray
    split: IntArray
    threshold: FloatArray
    left: IntArray
    right: IntArray
    missing_left: BoolArray
    leaf: IntArray
    leaf_value: FloatArray
    tree_output: IntArray
    base: FloatArray
    comparison: Comparison
    input_precision: Precision = Precision.FLOAT64
    sum_precision: Precision = Precision.FLOAT64
    aggregate: Aggregate = Aggregate.SUM
    base_last: bool = False
    divisor: float = 1.0
    category_row: IntArray = field(default_factory=lambda: np.zeros(0, np.int32))
    category_left: BoolArray = field(default_factory=lambda: np.zeros(0, np.bool_))
    linear: LinearLeaves | None = None
    exact: ClassVar[bool] = True

    def __post_init__(self) -> None:
        nodes = len(_freeze(self, "split", np.int32, (None,)))
        roots = _freeze(self, "roots", np.int32, (None,))
        for name, dtype in (("threshold", np.float64), ("left", np.int32), ("right", np.int32)):
            _freeze(self, name, dtype, (nodes,))
        _freeze(self, "missing_left", np.bool_, (nodes,))
        _freeze(self, "leaf", np.int32, (nodes,))
        values = _freeze(self, "leaf_value", np.float64, (None, None))
        _freeze(self, "tree_output", np.int32, (len(roots),))
        base = _freeze(self, "base", np.float64, (None,))
        _freeze(self, "category_left", np.bool_, (None,))
        _freeze(self, "category_row", np.int32, (nodes if self.has_categories else 0,))
        _require_finite(self, "leaf_value", "base")
        if self.sum_precision is Precision.FLOAT32:
            for array in (values, base):
                with np.errstate(over="ignore"):
                    if not np.array_equal(array.astype(np.float32), array):
                        raise InputError(
                            "TreeEnsemble: a leaf or base value is no float32, but the sum is one of float32"
                        )
        if not math.isfinite(self.divisor) or self.divisor == 0:
            raise InputError(f"TreeEnsemble.divisor: {self.divisor}")
        if values.shape[1] not in (1, len(base)):
            raise InputError(f"TreeEnsemble: leaves of width {values.shape[1]} for {len(base)} outputs")
        self._check_structure(nodes)

    def _check_structure(self, nodes: int) -> None:
        """Every walk from a root ends in a leaf of the same tree: children come after their parent and inside it."""
        roots, split = self.roots, self.split
        if len(roots) == 0 or roots[0] != 0 or np.any(np.diff(roots) <= 0) or roots[-1] >= nodes:
            raise InputError("TreeEnsemble.roots: not a rising list that starts at node 0")
        if np.any(split >= len(self.columns)):
            raise InputError("TreeEnsemble.split: a column that does not exist")
        inner = np.flatnonzero(split >= 0)
        end_of_tree = np.append(roots[1:], nodes)[np.searchsorted(roots, inner, side="right") - 1]
        for child in (self.left[inner], self.right[inner]):
            if np.any(child <= inner) or np.any(child >= end_of_tree):
                raise InputError("TreeEnsemble: a child lies before its parent or outside its tree")
        leaves = self.leaf[split < 0]
        if np.any(leaves < 0) or np.any(leaves >= len(self.leaf_value)):
            raise InputError("TreeEnsemble.leaf: a leaf without a value")
        numeric = inner[~np.array([c.categorical for c in self.columns] or [False])[split[inner]]]
        thresholds = self.threshold[numeric]
        if np.any(np.isnan(thresholds)) or np.any(thresholds == -np.inf):
            raise InputError("TreeEnsemble.threshold: NaN or -infinity; the model file is damaged")
        if np.any(self.tree_output < 0) or np.any(self.tree_output >= len(self.base)):
            raise InputError("TreeEnsemble.tree_output: an output that does not exist")
        narrow = self.leaf_value.shape[1] == 1
        if self.aggregate is not Aggregate.SUM and narrow and len(np.unique(self.tree_output)) < len(self.base):
            raise InputError(f"TreeEnsemble: the {self.aggregate} of an output to which no tree adds")

    @property
    def has_categories(self) -> bool:
        return any(column.categorical for column in self.columns)

    @property
    def operand_width(self) -> None:
        return None

    def check_operands(self, total: int) -> None:
        _check_columns(self, (column.column for column in self.columns), total)

    @property
    def width(self) -> int:
        return len(self.base)

    @property
    def n_trees(self) -> int:
        return len(self.roots)

    @property
    def n_nodes(self) -> int:
        return len(self.split)


@dataclass(frozen=True)
class ModelIR:
    """One trained model: features in, numbers out.

    `outputs` names the columns of the last value. `accepts_nan`: NaN is a missing value to the library; otherwise it
    refuses the row. `magnitude_limits`: for each feature, the magnitude from which on the library refuses an input
    (infinity: it refuses infinities only; None: it takes everything). Empty: it takes everything.
    """

    name: str
    features: tuple[Feature, ...]
    ops: tuple[Operation, ...]
    outputs: tuple[str, ...]
    source: Source
    accepts_nan: bool = False
    magnitude_limits: tuple[float | None, ...] = ()

    def __post_init__(self) -> None:
        if not self.features:
            raise InputError(f"model '{self.name}' has no features")
        if not self.magnitude_limits:
            object.__setattr__(self, "magnitude_limits", (None,) * len(self.features))
        if len(self.magnitude_limits) != len(self.features):
            raise InputError(f"model '{self.name}': {len(self.magnitude_limits)} limits, {len(self.features)} features")
        if not self.ops:
            raise InputError(f"model '{self.name}' computes nothing")
        for number, op in enumerate(self.ops):
            if not op.inputs or any(not 0 <= value <= number for value in op.inputs):
                raise InputError(f"model '{self.name}', operation {number}: reads a value that is not yet computed")
            self._check_operands(number, op)
        if self.ops[-1].width != len(self.outputs):
            raise InputError(f"model '{self.name}': {len(self.outputs)} outputs named, {self.ops[-1].width} computed")

    def _check_operands(self, number: int, op: Operation) -> None:
        where = f"model '{self.name}', operation {number} ({type(op).__name__})"
        widths = [self.value_width(value) for value in op.inputs]
        if op.operand_width is not None and any(width != op.operand_width for width in widths):
            raise InputError(f"{where}: expects {op.operand_width} columns, gets {' and '.join(map(str, widths))}")
        try:
            op.check_operands(sum(widths))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    def value_width(self, value: int) -> int:
        """Number of columns of value `value` (0: the inputs)."""
        return len(self.features) if value == 0 else self.ops[value - 1].width

    @property
    def exact(self) -> bool:
        """Whether every output equals the source library's bit for bit."""
        return all(op.exact for op in self.ops)


class Direction(StrEnum):
    """Direction of rotation."""

    FORWARD = "forward"
    BACKWARD = "backward"


class Quantity(StrEnum):
    """What a model predicts of a harmonic A*cos(k*theta + phi)."""

    AMPLITUDE = "amplitude"  # A in deg; for order 0 the signed mean
    PHASE = "phase"  # phi in rad
    COSINE = "cosine"  # A*cos(phi) in deg
    SINE = "sine"  # A*sin(phi) in deg


@dataclass(frozen=True)
class HarmonicOutput:
    """Output `output` (from 0) of model `model` predicts one quantity of one harmonic."""

    direction: Direction
    order: int
    quantity: Quantity
    model: str
    output: int


@dataclass(frozen=True)
class TransmissionError:
    """What the models of a bundle are for: TE(theta) = sum of A_k * cos(k*theta + phi_k), per direction (Eq. 2).

    `speed_feature` is the number of the feature that holds the input speed in rpm, `reduction_ratio` is
    theta_in / theta_out. `outputs` has, for every order and direction, amplitude and phase or cosine and sine part
    (order 0: amplitude only).
    """

    name: str
    features: tuple[Feature, ...]
    speed_feature: int
    reduction_ratio: float
    orders: tuple[int, ...]
    directions: tuple[Direction, ...]
    outputs: tuple[HarmonicOutput, ...]

    def __post_init__(self) -> None:
        if not (math.isfinite(self.reduction_ratio) and self.reduction_ratio > 0):
            raise InputError(f"reduction ratio {self.reduction_ratio}: give a positive number")
        if not 0 <= self.speed_feature < len(self.features):
            raise InputError(f"speed feature {self.speed_feature}: there are {len(self.features)} features")

    def quantities(self, direction: Direction, order: int) -> dict[Quantity, HarmonicOutput]:
        """The model outputs of one harmonic."""
        return {o.quantity: o for o in self.outputs if o.direction is direction and o.order == order}


@dataclass(frozen=True)
class ProjectIR:
    """Everything that is generated together: models, and what they are for where that is known."""

    models: tuple[ModelIR, ...]
    transmission_error: TransmissionError | None = None
