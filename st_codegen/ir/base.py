"""Words, checks and the protocol that all operations of the intermediate representation share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from st_codegen.errors import InputError, counted
from st_codegen.ir.arrays import AnyArray, FloatArray

#: Values of this magnitude and above become infinite when rounded to float32 (the tie to even above FLT_MAX).
FLOAT32_OVERFLOW = 3.4028235677973366e38


#: Larger arguments of a cosine have no answer: how well controllers reduce them is not known.
COS_REACH = 1e6


class Precision(StrEnum):
    """The format to which a library rounds a number."""

    FLOAT32 = "float32"
    FLOAT64 = "float64"
    REAL = "REAL"  # float32 on the controller alone: coefficients and operations are rounded, in the library less


#: Intermediate results of generated code stay below these, so that nothing overflows on the controller. A quotient of
#: two computed numbers that would be larger has no answer.
CEILING = {Precision.FLOAT64: 1e300, Precision.FLOAT32: 3e38, Precision.REAL: 3e38}


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
    """An arithmetic operator between two numbers, or the choice between them."""

    ADD = "+"
    SUBTRACT = "-"
    MULTIPLY = "*"
    DIVIDE = "/"
    MAXIMUM = "max"
    MINIMUM = "min"


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
    ABS = "abs"
    SQRT = "sqrt"
    LOG = "log"
    SOFTSIGN = "softsign"  # x / (1 + |x|)
    ERF = "erf"
    GELU = "gelu"  # x * (1 + erf(x / sqrt(2))) / 2
    SIN = "sin"
    COS = "cos"
    ATAN = "atan"
    SIGNED_SQUARE = "signed_square"  # sign(x) * x * x (LightGBM reg_sqrt)
    NORMAL_QUANTILE = "normal_quantile"  # below which a share x of a normal distribution lies
    POWER = "power"  # x ** parameter; x < 0 for whole parameters only


#: Shares of a normal distribution nearer to 0 or 1 than this have no quantile here.
LEAST_SHARE = 1e-13
#: From this share on, and up to 1 less it, a quantile is q + q s P(s) / Q(s) times sqrt(2 pi), with q = x - 1/2 and
#: s = q q; nearer to the ends it is z - log(z) / z - P(1 / z) / (z Q(1 / z)) with z = sqrt(-2 log(share)). Coefficients
#: of P and of Q, the highest power first (S. L. Moshier, Cephes: ndtri); Q has no root where it divides.
CENTRAL_SHARE = 0.1353352832366127
CENTRAL = (
    *(0.0, 0.0, 0.0, 0.0, -59.96335010141079, 98.00107541859997, -56.67628574690703, 13.931260938727968),
    *(-1.2391658386738125, 1.0, 1.9544885833814176, 4.676279128988815, 86.36024213908905, -225.46268785411937),
    *(200.26021238006066, -82.03722561683334, 15.90562251262117, -1.1833162112133),
)
TAILS = (
    *(4.0554489230596245, 31.525109459989387, 57.16281922464213, 44.08050738932008, 14.684956192885803),
    *(2.1866330685079025, -0.1402560791713545, -0.03504246268278482, -0.0008574567851546854),
    *(1.0, 15.779988325646675, 45.39076351288792, 41.3172038254672, 15.04253856929075, 2.504649462083094),
    *(-0.14218292285478779, -0.03808064076915783, -0.0009332594808954574),
)


#: Functions that grow beyond all numbers: `Activation.limit` keeps their arguments, or that of the exponential that a
#: power is, below overflow.
EXPONENTIALS = frozenset({Function.EXP, Function.EXPM1, Function.POWER})


class Kernel(StrEnum):
    """Kernel functions of support vector machines; u is the input, v a support vector."""

    LINEAR = "linear"  # u.v
    POLYNOMIAL = "polynomial"  # (gamma * u.v + coef0) ** degree
    RBF = "rbf"  # exp(-gamma * |u - v|**2)
    SIGMOID = "sigmoid"  # tanh(gamma * u.v + coef0)


class Towards(StrEnum):
    """Which whole number is taken for a number that lies between two."""

    NEAREST = "nearest"  # of a tie the even one
    BELOW = "below"
    ABOVE = "above"
    ZERO = "zero"  # the fraction is cut off


class Norm(StrEnum):
    """Norms by which a vector is divided."""

    L1 = "l1"
    L2 = "l2"
    MAX = "max"


class SummationOrder(StrEnum):
    """What is known of the order in which a library adds products."""

    SEQUENTIAL = "sequential"  # bias first, then each product rounded and added in order
    UNSPECIFIED = "unspecified"  # BLAS: any order, perhaps fused; equal within a bound only


def freeze(owner: Any, name: str, dtype: type[np.generic], shape: tuple[int | None, ...]) -> AnyArray:
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


def freeze_finite(owner: Any, name: str, shape: tuple[int | None, ...]) -> AnyArray:
    """`freeze` for coefficients, without NaN and infinities: a comparison or sum with one of them stops a PLC."""
    array = freeze(owner, name, np.float64, shape)
    bad = np.flatnonzero(~np.isfinite(np.ravel(array)))
    if bad.size:
        raise InputError(
            f"{type(owner).__name__}.{name}: {counted(bad.size, 'coefficient')} not finite "
            f"(first: number {bad[0]} is {np.ravel(array)[bad[0]]}); "
            "train the model again without NaN and infinite values"
        )
    return array


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


class Elementwise:
    """Mixin of operations that read values of their own width."""

    @property
    def operand_width(self: Operation) -> int:
        return self.width

    def check_operands(self, total: int) -> None:
        """Accept any inputs: beyond their width nothing is asked of them."""


class ReadsWhole:
    """Mixin of operations that read one value as a whole: of `operand_width` columns, and nothing else is asked."""

    def check_operands(self, total: int) -> None:
        """Accept any input: beyond its width nothing is asked of it."""


class ReadsColumns:
    """Mixin of operations that read some columns of values of any width, laid side by side."""

    operand_width: ClassVar[None] = None


class ColumnFunction(Elementwise):
    """Base of operations that apply one exact function to each number of a value, known by three facts of it.

    The reference, the bounds and the search for overflow need nothing else of such an operation. `computes` says
    whether it makes new numbers, which are rounded and may overflow, or only picks among given ones.
    """

    inputs: tuple[int, ...]
    computes: ClassVar[bool] = True

    if TYPE_CHECKING:  # a field or a property of each class

        @property
        def width(self) -> int: ...

    @property
    def exact(self) -> bool:
        """Whether the source library's result is reproduced bit for bit."""
        return True

    @property
    def keeps_missing(self) -> Sequence[bool] | None:
        """For each column whether NaN stays NaN; None: in all of them."""
        return None

    def value(self, x: FloatArray) -> FloatArray:
        """The function of numbers `x` (rows, width), as the library computes it; NaN where there is none."""
        raise NotImplementedError(type(self).__name__)

    def slope(self, x: FloatArray, difference: FloatArray) -> FloatArray | float:
        """The largest slope of the function within `difference` of `x`, both (rows, width)."""
        raise NotImplementedError(type(self).__name__)

    def largest(self, magnitude: FloatArray) -> FloatArray:
        """The largest magnitude of results for numbers up to the given magnitudes, both (width,)."""
        raise NotImplementedError(type(self).__name__)


class Quotient(Elementwise):
    """Mixin of operations that may divide by a computed number: a quotient as large as `ceiling` has no answer."""

    precision: Precision
    limit: float

    @property
    def ceiling(self) -> float:
        """`limit`, which the pass `domain` lowers where later operations would overflow, or that of the precision."""
        return min(self.limit, CEILING[self.precision])


def check_columns(owner: Any, columns: Iterable[int], total: int) -> None:
    """Refuse columns outside 0 .. total-1."""
    if any(not 0 <= column < total for column in columns):
        raise InputError(f"{type(owner).__name__}: reads a column outside 0 .. {total - 1}")
