"""The code of each operation except trees: its tables, its variables, its template."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import singledispatch, wraps
from itertools import pairwise
from typing import TypeVar, get_type_hints

import numpy as np

from st_codegen import ir
from st_codegen.emit.blocks.listing import ArrayElement, Group, Listing, suffixes
from st_codegen.emit.literals import real
from st_codegen.errors import counted
from st_codegen.ir.base import CENTRAL, CENTRAL_SHARE, COS_REACH, LEAST_SHARE, TAILS

_AnyOperation = TypeVar("_AnyOperation", bound=ir.Operation)

#: Below minus this argument EXP gives a denormal number or zero; 0.0 is taken instead, at most 3.4E-308 away.
EXP_REACH = 708.0
#: Likewise in REAL, at most 1.7E-38 away.
EXP_REACH_REAL = 87.0

#: Functions whose code keeps an exponential, or one plus a small number, beside the result.
_WITH_AN_EXPONENTIAL_BESIDE = (
    ir.Function.TANH,
    ir.Function.LOGISTIC,
    ir.Function.SOFTPLUS,
    ir.Function.ELU,
    ir.Function.EXPM1,
    ir.Function.LOG1P,
    ir.Function.ERF,
    ir.Function.GELU,
)

#: log(erfcx(u) / t) for t = 1 / (1 + u / 2), the highest power first: the least squares fit at the nodes of Chebyshev.
_LOG_ERFC = (
    *(-0.133058616487942, 1.1011737068948, -3.95934960079685, 8.02068737141864, -9.89989849778988),
    *(7.54980718974905, -3.61901364341873, 1.33647950696555, -0.405998888660434, -0.092662408805115),
    *(-0.0913157175380786, 0.0836727701850285, 0.374988806661786, 1.00000014555518, -1.26551212379872),
)


#: Weighted sums that are computed in one loop: each number is read once for all of them, and none waits for the others.
_SUMS_TOGETHER = 4

#: Columns that are picked in a line each; of more, tables say which.
_PICKED_ONE_BY_ONE = 64


@dataclass(frozen=True)
class Step:
    """Where an operation stands in its block.

    `missing`: for each column of the operands, the input whose `abMissing` flag says whether it is missing; None in a
    block that takes no missing values. `fits_real`: all operands are inputs known to lie in the range of REAL.
    `ranks`: the operand is a list of ranks, which are integers. `whole`: the result is the number of a class, kept as
    an integer. `type` is that of all numbers.
    """

    number: int | str
    widths: tuple[int, ...]
    result: str
    operands: tuple[str, ...] = ()
    missing: tuple[int, ...] | None = None
    fits_real: bool = False
    ranks: bool = False
    whole: bool = False
    type: str = "LREAL"

    @property
    def exp_reach(self) -> str:
        """The magnitude of the argument below minus which an exponential is taken for 0.0."""
        return real(EXP_REACH_REAL if self.type == "REAL" else EXP_REACH)

    @property
    def source(self) -> str:
        """The name of the operand of an operation that has one only."""
        return self.operands[0]

    def table(self, stem: str) -> str:
        """The name of a table of this operation."""
        return f"{stem}_{self.number}"


@singledispatch
def lay_out(op: ir.Operation, step: Step, listing: Listing) -> None:
    """Append the code of an operation to a listing."""
    raise NotImplementedError(type(op).__name__)


def lay_out_all(first: str, ops: Sequence[ir.Operation], steps: Sequence[Step], listing: Listing) -> None:
    """Append the code of operations, of which the steps lack the operands; `first` is the name of value 0.

    An operation at the end that has no step is read where its operands are.
    """
    layers = _layers_of(ops)
    names = [first, *(step.result for step in steps)]
    for number, step in enumerate(steps, 1):
        op = ops[number - 1]
        own = replace(step, operands=tuple(names[value] for value in op.inputs))
        if number in layers:
            _lay_out_layer(*layers[number], replace(own, result=names[number + 1]), listing)
        elif number - 1 not in layers:  # that behind the sums of a layer is done with them
            _declare_result(op, own, listing)
            lay_out(op, own, listing)


def _declare_result(op: ir.Operation, step: Step, listing: Listing) -> None:
    """Declare the array that takes the results of an operation."""
    listing.local(step.result, "DINT" if step.whole or isinstance(op, ir.Rank) else "LREAL", op.width)


Section = tuple[str, str, dict[str, object]]


def _column_by_column(
    section: Callable[[_AnyOperation, Step, Listing], Section],
) -> Callable[[_AnyOperation, Step, Listing], None]:
    """Lays out an operation whose code is one loop over the columns of its result.

    `section` gives the title, the template and what only this operation prints by it.
    """

    @wraps(section)
    def laid_out(op: _AnyOperation, step: Step, listing: Listing) -> None:
        listing.loop("nColumn", op.width)
        title, template, own = section(op, step, listing)
        single = getattr(op, "precision", None) is ir.Precision.FLOAT32
        listing.section(title, template, **{"step": step, "last": op.width - 1, "single": single, **own})

    return lay_out.register(get_type_hints(section)["op"], laid_out)


@lay_out.register
def _(op: ir.Select, step: Step, listing: Listing) -> None:
    sources = [
        ArrayElement(name, column)
        for name, width in zip(step.operands, step.widths, strict=True)
        for column in range(width)
    ]
    picked = [sources[column] for column in op.columns]
    if op.width <= _PICKED_ONE_BY_ONE:
        listing.section("pick columns", "select", step=step, sources=picked)
        return
    parts = []
    for number, name in enumerate(dict.fromkeys(source.name for source in picked)):
        to = [at for at, source in enumerate(picked) if source.name == name]
        part: dict[str, object] = {"name": name, "last": len(to) - 1}
        for word, columns in (("source", [picked[at].index for at in to]), ("target", to)):
            rises = columns == list(range(columns[0], columns[0] + len(columns)))
            table = None if rises else listing.table(f"PICK_{word.upper()}_{step.number}_{number}", "DINT", columns)
            part[word] = {"table": table, "first": columns[0]}
        parts.append(part)
        listing.loop("nColumn", len(to))
    listing.section("pick columns", "select_many", step=step, parts=parts)


@_column_by_column
def _(op: ir.Scale, step: Step, listing: Listing) -> Section:
    constant = listing.table(step.table("OPERAND"), "LREAL", op.constant)
    least = None
    if op.refuses:
        least = listing.table(step.table("LEAST"), "LREAL", np.abs(op.constant) * (1.0 / op.ceiling))
    title = f"each column: {'constant ' + op.operator + ' x' if op.reverse else 'x ' + op.operator + ' constant'}"
    own = {"constant": constant, "reverse": op.reverse, "operator": op.operator.value, "least": least}
    own["flags"] = _flags(step, listing) if least else None
    return title, "scale", own


@_column_by_column
def _(op: ir.Combine, step: Step, listing: Listing) -> Section:
    least = None
    if op.refuses:
        least = listing.table(step.table("LEAST"), "LREAL", [1.0 / op.ceiling])
    operator = op.operator.value
    flags = _flags(step, listing) if least else None
    return f"column by column: a {operator} b", "combine", {"operator": operator, "least": least, "flags": flags}


@lay_out.register
def _(op: ir.Round, step: Step, listing: Listing) -> None:
    listing.loop("nColumn", op.width)
    listing.section("rounded to REAL, as the library computes", "round", step=step, last=op.width - 1)


def _flags(step: Step, listing: Listing) -> str | None:
    """The table of the inputs that say whether a column is missing; None where none can be."""
    return None if step.missing is None else listing.table(step.table("FLAG_INPUT"), "DINT", step.missing)


@_column_by_column
def _(op: ir.FillMissing, step: Step, listing: Listing) -> Section:
    listing.locals("LREAL", "fX")
    same = bool(np.all(op.fill == op.fill[0]))
    own: dict[str, object] = {
        "fill": listing.constant(step.table("FILL"), float(op.fill[0])) if same else None,
        "fills": None if same else listing.table(step.table("FILL"), "LREAL", op.fill),
        "sentinel": None if op.sentinel is None else listing.constant(step.table("SENTINEL"), op.sentinel),
        "flags": _flags(step, listing),
    }
    return "missing values filled in", "fill_missing", own


@_column_by_column
def _(op: ir.Clip, step: Step, listing: Listing) -> Section:
    limits = {"lower": op.lower, "upper": op.upper}
    return "limited", "clip", {n: listing.table(step.table(n.upper()), "LREAL", v) for n, v in limits.items()}


@_column_by_column
def _(op: ir.Exceeds, step: Step, listing: Listing) -> Section:
    title = f"1.0 where {'the cut is reached' if op.inclusive else 'above the cut'}, else 0.0"
    cut = listing.table(step.table("CUT"), "LREAL", op.cut)
    return title, "exceeds", {"cut": cut, "comparison": ">=" if op.inclusive else ">"}


#: From here on a number of a type has no fraction, and a sum with a smaller one is rounded to a whole one.
_NO_FRACTION = {"LREAL": 2.0**52, "REAL": 2.0**23}
_WHOLE_TITLES = {
    ir.Towards.NEAREST: "the nearest whole number, of a tie the even one",
    ir.Towards.BELOW: "the whole number that is not above",
    ir.Towards.ABOVE: "the whole number that is not below",
    ir.Towards.ZERO: "the fraction cut off",
}


@_column_by_column
def _(op: ir.WholeNumber, step: Step, listing: Listing) -> Section:
    listing.locals("LREAL", "fX", "fY")
    own: dict[str, object] = {"towards": op.towards.value, "end": real(_NO_FRACTION[step.type])}
    return _WHOLE_TITLES[op.towards], "whole", own


@_column_by_column
def _(op: ir.Piecewise, step: Step, listing: Listing) -> Section:
    listing.locals("LREAL", "fX", "fY")
    listing.locals("DINT", "nKnot", "nHigh")
    counts = np.diff(op.start)
    levels = int(np.max(counts)).bit_length()
    listing.loop("nLevel", levels)
    if levels:
        listing.local("nMiddle", "DINT")
    if op.degree:
        listing.local("nBase", "DINT")
        listing.loop("nPower", op.degree)
    groups = [Group(f"column {n}", int(op.start[n]), int(op.start[n + 1])) for n in range(op.width) if counts[n]]
    # one more knot, beyond all numbers, so that none is read behind the end
    knots = np.append(op.knots, np.finfo(np.float64).max)
    refused = [np.isinf(op.pieces[:, 0]), np.append(np.isinf(op.at), [False])]
    stays = np.full(op.width, np.nan) if op.missing is None else op.missing
    tables: dict[str, object] = {
        "start": listing.table(step.table("KNOT_START"), "DINT", op.start),
        "knots": listing.table(step.table("KNOT"), "LREAL", knots, [*groups, Group("", len(op.knots), len(knots))]),
        "at": listing.table(step.table("KNOT_VALUE"), "LREAL", np.append(np.where(refused[1][:-1], 0.0, op.at), [0.0])),
        "pieces": listing.table(
            step.table("PIECE"),
            "LREAL",
            np.where(np.isinf(op.pieces), 0.0, op.pieces)[:, ::-1].ravel(),
            per_line=op.degree + 1 if op.degree else None,
        ),
        "refused": None,
    }
    if np.any(np.concatenate(refused)):
        tables["refused"] = [
            listing.table(step.table(f"{what}_REFUSED"), "SINT", flags.astype(int))
            for what, flags in zip(("PIECE", "KNOT"), refused, strict=True)
        ]
    flags, missing = _flags(step, listing), None
    if flags is not None:
        missing = listing.table(step.table("FILL"), "LREAL", np.nan_to_num(stays, nan=0.0))
    own = {"levels": levels, "degree": op.degree, "terms": op.degree + 1, "flags": flags, "missing": missing, **tables}
    return f"pieces between {len(op.knots):,} knots", "piecewise", own


@lay_out.register
def _(op: ir.ArgMax, step: Step, listing: Listing) -> None:
    values: dict[str, object] = {"merged": None, "last": op.n_columns - 1, "before_last": op.n_columns - 2}
    if op.n_columns > 1:
        listing.locals("LREAL", "fLargest")
        listing.locals("DINT", "nBest")
        listing.loop("nColumn", op.n_columns - 1)
        values["merged"] = real(op.merged) if op.merged else None
    listing.section(f"the largest of {op.n_columns}, of equal ones the first", "argmax", step=step, **values)


@_column_by_column
def _(op: ir.Softmax, step: Step, listing: Listing) -> Section:
    listing.locals("LREAL", "fLargest", "fX", "fY", "fSum")
    title = "less the logarithm of the sum of exponentials" if op.logarithm else "exponentials, divided by their sum"
    return title, "softmax", {"logarithm": op.logarithm, "exp_reach": step.exp_reach}


@lay_out.register
def _(op: ir.Linear, step: Step, listing: Listing) -> None:
    _lay_out_sums(op, step, listing, _sums_of(op.weights), {"function": None})


def _lay_out_layer(op: ir.Linear, activation: ir.Activation, step: Step, listing: Listing) -> None:
    """Weighted sums and the function of each in one loop; `step` has the operand of the sums and the layer's result."""
    values = _function_values(activation, step, listing)
    values["function_single"] = values.pop("single")
    _declare_result(op, step, listing)
    title = f"layer: {_sums_of(op.weights)}, {activation.function.value} of each"
    _lay_out_sums(op, step, listing, title, values)


def _sums_of(weights: ir.FloatArray) -> str:
    """How many weighted sums of how many numbers."""
    sums, numbers = weights.shape
    return f"{counted(sums, 'weighted sum')} of {counted(numbers, 'number')}"


def _layers_of(ops: Sequence[ir.Operation]) -> dict[int, tuple[ir.Linear, ir.Activation]]:
    """Weighted sums, by number, of which nothing but the function behind them is read."""
    found, readers = {}, Counter(value for op in ops for value in dict.fromkeys(op.inputs))
    for number, (op, behind) in enumerate(pairwise(ops), 1):
        if (
            isinstance(op, ir.Linear)
            and isinstance(behind, ir.Activation)
            and behind.inputs == (number,)
            and readers[number] == 1
        ):
            found[number] = op, behind
    return found


def _lay_out_sums(op: ir.Linear, step: Step, listing: Listing, title: str, function: dict[str, object]) -> None:
    stepwise = op.order is ir.SummationOrder.SEQUENTIAL and op.precision is not ir.Precision.FLOAT64
    outputs, columns = op.weights.shape
    bias = listing.table(step.table("BIAS"), "LREAL", op.bias)
    runs = listing.chunks(np.full(outputs, columns), "neuron")
    listing.loop("nColumn", columns)
    parts = []
    for suffix, (first, stop) in zip(suffixes(len(runs)), runs, strict=True):
        groups = [
            Group(f"row {row}", (row - first) * columns, (row - first + 1) * columns) for row in range(first, stop)
        ]
        name = listing.table(step.table(f"WEIGHT{suffix}"), "LREAL", np.ravel(op.weights[first:stop]), groups)
        parts.append({"name": name, "loops": _loops_of_sums(range(first, stop), columns, listing)})
    if stepwise:
        listing.local("fTerm", "LREAL")
    if outputs > 1:
        listing.local("fColumn", "LREAL")
    if function["function"]:
        listing.loop("nRow", outputs)
    listing.section(
        title,
        "linear",
        step=step,
        last_row=outputs - 1,
        last_column=columns - 1,
        bias=bias,
        parts=parts,
        stepwise=stepwise,
        single=op.precision is ir.Precision.FLOAT32,
        **function,
    )


def _loops_of_sums(rows: range, columns: int, listing: Listing) -> list[dict[str, object]]:
    """Loops over rows of weights: of `_SUMS_TOGETHER` rows in a round, then one round of those that are left."""
    whole = len(rows) // _SUMS_TOGETHER * _SUMS_TOGETHER
    loops: list[dict[str, object]] = []
    for part, together in ((rows[:whole], _SUMS_TOGETHER), (rows[whole:], len(rows) - whole)):
        if not part:
            continue
        starts = part[::together]
        has_rounds = len(starts) > 1
        listing.loop("nRow", len(starts))
        if has_rounds:
            listing.local("nBase", "DINT")
        sums = []
        for number in range(together):
            name = f"fSum{number + 1}" if number else "fSum"
            listing.local(name, "LREAL")
            row = ("nRow", number) if has_rounds else (str(starts[0] + number),)
            before = ("nBase", number * columns) if has_rounds else ((starts[0] - rows[0] + number) * columns,)
            sums.append({"name": name, "row": row, "at": (*before, "nColumn")})
        loops.append({"first": starts[0], "last": starts[-1], "sums": sums, "numbers": together * columns})
    return loops


@lay_out.register
def _(op: ir.SlidingLinear, step: Step, listing: Listing) -> None:
    outputs, read = op.weights.shape
    for name, rounds in (("nPlace", len(op.starts)), ("nRow", outputs), ("nColumn", read)):
        listing.loop(name, rounds)
    for name in ("nFirst", "nBase", "nResult"):
        listing.local(name, "DINT")
    listing.locals("LREAL", "fSum")
    groups = [Group(f"row {row}", row * read, (row + 1) * read) for row in range(outputs)]
    in_order = np.array_equal(op.offsets, np.arange(read))
    listing.section(
        f"{_sums_of(op.weights)} at {counted(len(op.starts), 'place')}",
        "sliding_linear",
        step=step,
        last_place=len(op.starts) - 1,
        last_row=outputs - 1,
        last_column=read - 1,
        columns=read,
        starts=listing.table(step.table("PLACE"), "DINT", op.starts),
        offsets=None if in_order else listing.table(step.table("OFFSET"), "DINT", op.offsets),
        bias=listing.table(step.table("BIAS"), "LREAL", op.bias),
        weights=listing.table(step.table("WEIGHT"), "LREAL", np.ravel(op.weights), groups),
        single=op.precision is ir.Precision.FLOAT32,
    )


@_column_by_column
def _(op: ir.Activation, step: Step, listing: Listing) -> Section:
    own = _function_values(op, step, listing)
    if op.refuses:
        own["flags"] = _flags(step, listing)
    return f"{op.function.value} of each column", "activation", own


def _function_values(op: ir.Activation, step: Step, listing: Listing) -> dict[str, object]:
    """What `activated` needs to compute fY from fX."""
    listing.locals("LREAL", "fX", "fY")
    if op.function in _WITH_AN_EXPONENTIAL_BESIDE:
        listing.locals("LREAL", "fExp")
    if op.function in (ir.Function.TANH, ir.Function.ERF, ir.Function.GELU):
        listing.locals("LREAL", "fSquare")
    polynomial = None
    if op.function in (ir.Function.ERF, ir.Function.GELU):
        listing.loop("nTerm", len(_LOG_ERFC))
        polynomial = listing.table(step.table("LOG_ERFC"), "LREAL", _LOG_ERFC)
    if op.function is ir.Function.SOFTPLUS:
        listing.locals("LREAL", "fPositive")
    quantile: dict[str, object] = {}
    if op.function is ir.Function.NORMAL_QUANTILE:
        listing.locals("LREAL", "fSquare", "fUpper", "fLower")
        listing.loop("nTerm", len(TAILS) // 2)
        quantile = {
            "least": real(LEAST_SHARE),
            "central": real(CENTRAL_SHARE),
            "factor": real(math.sqrt(2.0 * math.pi)),
            "half": len(TAILS) // 2,
            "last": len(TAILS) // 2 - 1,
            "centre": listing.table(step.table("CENTRE"), "LREAL", CENTRAL),
            "tails": listing.table(step.table("TAILS"), "LREAL", TAILS),
        }
    parameter = None
    if op.function in (ir.Function.LEAKY_RELU, ir.Function.ELU, ir.Function.POWER):
        parameter = listing.constant(step.table("PARAMETER"), op.parameter)
    power: dict[str, object] = {}
    if op.function is ir.Function.POWER:
        power = {
            "whole": op.parameter == int(op.parameter),
            "odd": op.parameter % 2 == 1,
            "rises": op.parameter > 0,
            "furthest": listing.table(step.table("FURTHEST"), "LREAL", [min(op.furthest, np.finfo(np.float64).max)]),
        }
    return {
        "function": op.function.value,
        "power": power,
        "quantile": quantile,
        "parameter": parameter,
        "polynomial": polynomial,
        "last_term": len(_LOG_ERFC) - 1,
        "half_root": real(math.sqrt(0.5)),
        "exp_limit": real(op.limit) if math.isfinite(op.limit) else None,
        "exp_reach": step.exp_reach,
        "cos_reach": real(COS_REACH),
        "single": op.precision is ir.Precision.FLOAT32,
        "flags": None,
    }


@_column_by_column
def _(op: ir.Normalize, step: Step, listing: Listing) -> Section:
    listing.locals("LREAL", "fX", "fY", "fSum")
    least = listing.table(step.table("LEAST"), "LREAL", [1.0 / op.ceiling]) if op.norm is ir.Norm.MAX else None
    return f"divided by the {op.norm.value} norm", "normalize", {"norm": op.norm.value, "least": least}


def _vectors(vectors: ir.FloatArray, name: str, listing: Listing) -> str:
    """The table of vectors, each of which begins a line."""
    rows, columns = vectors.shape
    groups = [Group("", row * columns, (row + 1) * columns) for row in range(rows)]
    return listing.table(name, "LREAL", np.ravel(vectors), groups, per_line=columns)


@lay_out.register
def _(op: ir.KernelSum, step: Step, listing: Listing) -> None:
    vectors, columns = op.support_vectors.shape
    runs = listing.chunks(np.full(vectors, max(columns, op.width)), "support vector")
    listing.loop("nVector", *(stop - first for first, stop in runs))
    listing.loop("nColumn", columns)
    listing.local("nBase", "DINT")
    listing.loop("nRow", op.width)
    stepwise = op.precision is ir.Precision.REAL
    listing.locals("LREAL", "fKernel", "fSum", *(["fTerm"] if stepwise else []))
    if op.kernel is ir.Kernel.RBF:
        listing.locals("LREAL", "fDelta")
    if op.kernel is ir.Kernel.SIGMOID:
        listing.locals("LREAL", "fX", "fY", "fExp", "fSquare")
    if op.kernel is ir.Kernel.POLYNOMIAL:
        listing.locals("LREAL", "fPower")
        listing.loop("nPower", op.degree)
    intercept = listing.table(step.table("INTERCEPT"), "LREAL", op.intercept)
    gamma = listing.constant(step.table("GAMMA"), op.gamma) if op.kernel is not ir.Kernel.LINEAR else None
    coef0 = (
        listing.constant(step.table("COEF0"), op.coef0)
        if op.kernel in (ir.Kernel.POLYNOMIAL, ir.Kernel.SIGMOID)
        else None
    )
    parts = []
    for suffix, (first, stop) in zip(suffixes(len(runs)), runs, strict=True):
        vector = _vectors(op.support_vectors[first:stop], step.table(f"VECTOR{suffix}"), listing)
        coefficient = listing.table(
            step.table(f"COEFFICIENT{suffix}"), "LREAL", np.ravel(op.coefficients[:, first:stop].T)
        )
        parts.append({"vector": vector, "coefficient": coefficient, "last": stop - first - 1})
    listing.section(
        f"{counted(vectors, 'support vector')}, {op.kernel.value} kernel",
        "kernel_sum",
        step=step,
        columns=columns,
        last_column=columns - 1,
        last_output=op.width - 1,
        width=op.width,
        kernel=op.kernel.value,
        gamma=gamma,
        coef0=coef0,
        degree=op.degree,
        intercept=intercept,
        parts=parts,
        stepwise=stepwise,
        exp_reach=step.exp_reach,
        single=op.precision is ir.Precision.FLOAT32,
    )


@lay_out.register
def _(op: ir.Distances, step: Step, listing: Listing) -> None:
    vectors, columns = op.vectors.shape
    runs = listing.chunks(np.full(vectors, columns), "training row")
    listing.loop("nVector", *(stop - first for first, stop in runs))
    listing.loop("nColumn", columns)
    listing.local("nBase", "DINT")
    listing.locals("LREAL", "fSum", "fDelta")
    parts = []
    for suffix, (first, stop) in zip(suffixes(len(runs)), runs, strict=True):
        vector = _vectors(op.vectors[first:stop], step.table(f"TRAINING_ROW{suffix}"), listing)
        parts.append({"vector": vector, "first": first, "last": stop - first - 1})
    listing.section(
        f"distances to {counted(vectors, 'training row')}",
        "distances",
        step=step,
        columns=columns,
        last_column=columns - 1,
        parts=parts,
        squared=op.squared,
        root=op.root,
        largest=op.largest,
    )


@lay_out.register
def _(op: ir.NearestMean, step: Step, listing: Listing) -> None:
    columns = op.values.shape[1]
    listing.local(f"abUsed{step.number}", "BOOL", columns)
    listing.local("nBest", "DINT")
    listing.loop("nColumn", columns)
    listing.loop("nRow", op.count)
    listing.loop("nOutput", op.width)
    listing.locals("LREAL", "fSum", "fX", "fY", *(["fLeast"] if op.inverse else []))
    listing.section(
        f"mean over the nearest {op.count} of {columns}",
        "nearest_mean",
        step=step,
        used=f"abUsed{step.number}",
        last=columns - 1,
        count=op.count,
        last_output=op.width - 1,
        width=op.width,
        values=listing.table(step.table("TRAINING_VALUE"), "LREAL", np.ravel(op.values.T)),
        inverse=op.inverse,
        factors=step.operands[1] if len(step.operands) > 1 else None,
        divides=op.divides,
    )


@lay_out.register
def _(op: ir.CoupledPairs, step: Step, listing: Listing) -> None:
    first, second = np.triu_indices(op.count, 1)
    listing.local(f"afPair{step.number}", "LREAL", op.count**2)
    listing.local(f"afProduct{step.number}", "LREAL", op.count)
    for name, rounds in (("nPair", len(first)), ("nRow", op.count), ("nColumn", op.count), ("nRound", op.rounds)):
        listing.loop(name, rounds)
    listing.local("nBase", "DINT")
    listing.local("bGoesOn", "BOOL")
    listing.locals("LREAL", "fX", "fSum", "fTotal", "fDelta")
    listing.section(
        f"shares of {op.count} classes from those of each two",
        "coupled_pairs",
        step=step,
        matrix=f"afPair{step.number}",
        products=f"afProduct{step.number}",
        count=op.count,
        last=op.count - 1,
        last_element=op.count**2 - 1,
        last_pair=len(first) - 1,
        last_round=op.rounds - 1,
        first=listing.table(step.table("PAIR_FIRST"), "DINT", first),
        second=listing.table(step.table("PAIR_SECOND"), "DINT", second),
        equal=real(1.0 / op.count),
        epsilon=real(op.epsilon),
    )


@lay_out.register
def _(op: ir.WeightedMedian, step: Step, listing: Listing) -> None:
    columns = len(op.weights)
    listing.local(f"abUsed{step.number}", "BOOL", columns)
    listing.local(f"anOrder{step.number}", "DINT", columns)
    listing.local("nBest", "DINT")
    listing.loop("nColumn", columns)
    listing.loop("nRow", columns)
    listing.locals("LREAL", "fSum", "fX")
    listing.section(
        f"weighted median of {columns}",
        "weighted_median",
        step=step,
        used=f"abUsed{step.number}",
        order=f"anOrder{step.number}",
        last=columns - 1,
        single=op.precision is ir.Precision.FLOAT32,
        weights=listing.table(step.table("MEDIAN_WEIGHT"), "LREAL", op.weights),
    )


@lay_out.register
def _(op: ir.FactoredKernel, step: Step, listing: Listing) -> None:
    lengths = [len(axis) for axis in op.axes]
    listing.loop("nRow", sum(lengths), op.coefficients.size // lengths[-1])
    listing.local("nTerm", "DINT")
    listing.loop("nColumn", *lengths)
    listing.locals("LREAL", "fSum", "fDelta")
    ends = np.cumsum(lengths)
    groups = [Group(f"column {column}", end - n, end) for column, end, n in zip(op.columns, ends, lengths, strict=True)]
    points = op.coefficients.shape[1]
    sums = []
    for axis in reversed(range(len(lengths))):
        # results so far: a row for each point of the axes that are left
        rows = op.width * math.prod(lengths[:axis])
        first = int(ends[axis]) - lengths[axis]
        sums.append({"first": first, "last": int(ends[axis]) - 1, "last_row": rows - 1})
    coefficients = listing.table(step.table("COEFFICIENT"), "LREAL", op.coefficients.ravel(), per_line=lengths[-1])
    listing.section(
        f"rbf kernel on a grid of {' x '.join(map(str, lengths))} points",
        "factored_kernel",
        step=step,
        axis=listing.table(step.table("AXIS"), "LREAL", np.concatenate(op.axes), groups),
        columns=listing.table(step.table("AXIS_COLUMN"), "DINT", np.repeat(op.columns, lengths)),
        last=int(ends[-1]) - 1,
        factor=listing.local(f"aFactor{step.number}", "LREAL", int(ends[-1])),
        work=listing.local(f"aWork{step.number}", "LREAL", op.width * points // lengths[-1]),
        coefficients=coefficients,
        sums=sums,
        gamma=listing.constant(step.table("GAMMA"), op.gamma),
        intercept=listing.table(step.table("INTERCEPT"), "LREAL", op.intercept),
        last_output=op.width - 1,
        exp_reach=step.exp_reach,
        single=op.precision is ir.Precision.FLOAT32,
    )
