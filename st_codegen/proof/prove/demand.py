"""The expressions that a model demands, operation by operation, beside and behind its trees; what it refuses.

A function of one number (tanh and its like) has one formula, in `formulas`. Sums are added in the order of the model's
numbers.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial, singledispatchmethod

import numpy as np

from st_codegen import ir
from st_codegen.ir.arrays import FloatArray
from st_codegen.ir.base import COS_REACH, Elementwise
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.formulas import erf, exp, expm1, log1p, logistic, rounded, softplus, tanh
from st_codegen.proof.prove.inputs import InputTerms
from st_codegen.proof.prove.terms import Term, Terms, Value

_SYMBOL = {ir.Operator.ADD: "add", ir.Operator.SUBTRACT: "sub", ir.Operator.MULTIPLY: "mul", ir.Operator.DIVIDE: "div"}
_SYMBOL |= {ir.Operator.MAXIMUM: "max", ir.Operator.MINIMUM: "min"}


class Demand:
    """The outputs of a model as expressions of its inputs, and where it has an answer (`valid`)."""

    def __init__(self, terms: Terms, model: ir.ModelIR) -> None:
        self.terms, self.model = terms, model
        self.valid: Value = True
        self.missing: dict[int, list[Value]] = {}
        self.values: dict[int, list[Value]] = {}

    @classmethod
    def of_inputs(cls, terms: Terms, model: ir.ModelIR, inputs: list[Term]) -> Demand:
        """What a model without trees demands of inputs, which it limits first."""
        demand = cls(terms, model)
        demand.missing[0] = [terms.negated(terms.is_number(x)) for x in inputs]
        demand.values[0] = [demand._limited(number, x) for number, x in enumerate(inputs)]
        demand._compute(range(1, len(model.ops) + 1))
        return demand

    @classmethod
    def of_trees(
        cls,
        terms: Terms,
        model: ir.ModelIR,
        inputs: InputTerms,
        sums: Mapping[int, list[Value]],
        valid: Value,
        wanted: tuple[int, ...],
    ) -> Demand:
        """What a model demands behind its trees, of their `sums` by operation and of limited inputs.

        `valid` says whether the inputs are taken; `wanted` are the values that are needed, if not the last one.
        """
        demand = cls(terms, model)
        demand.valid = valid
        demand.values = {0: list(inputs.numbers), **sums}
        demand.missing = {
            0: list(inputs.missing),
            **{number: [False] * len(columns) for number, columns in sums.items()},
        }
        needed = set(wanted) or {len(model.ops)}
        for number in range(len(model.ops), 0, -1):
            if number in needed and number not in sums:
                needed.update(model.ops[number - 1].inputs)
        demand._compute(sorted(needed - demand.values.keys()))
        return demand

    def _compute(self, numbers: Iterable[int]) -> None:
        for number in numbers:
            op = self.model.ops[number - 1]
            self.values[number] = self.value(op, [self.values[value] for value in op.inputs])
            self.missing[number] = _flags(op, [self.missing[value] for value in op.inputs])

    @property
    def outputs(self) -> list[Value]:
        """The columns of the last operation."""
        return self.values[len(self.model.ops)]

    def put_out(self) -> list[Value]:
        """The outputs as the block has them: the number of a class is an integer."""
        if self.model.classes is None:
            return self.outputs
        most = len(self.model.classes.labels) - 1
        return [self.terms.integer("itrunc", self.outputs[0], low=0, high=most), *self.outputs[1:]]

    def _limited(self, number: int, x: Value) -> Value:
        declared = self.model.features[number]
        y = self.terms.where(self.missing[0][number], 0.0, x)
        if declared.lower is None or declared.upper is None:
            return y
        low, high = declared.lower, declared.upper
        return self.terms.branch("LT", y, low, low, lambda: self.terms.branch("GT", y, high, high, y))

    # --- building blocks --------------------------------------------------------------------------------------------

    def _refuse(self, condition: Value, missing: Value) -> None:
        """There is no answer where a condition holds of a number that does not stand for a missing one."""
        self.valid = self.terms.choice(condition, self.terms.both(self.valid, missing), self.valid)

    def _flagged(self, op: ir.Operation) -> list[Value]:
        """For each column that an operation reads whether it is missing; rounds of recurrent layers read no flags."""
        if self.model.accepts_nan and any(op is own for own in self.model.ops):
            return self.missing[op.inputs[0]]
        return [False] * op.width

    def _rounded(self, precision: ir.Precision, operation: str, *arguments: Value) -> Value:
        """An operation whose result is rounded to a precision."""
        return rounded(self.terms, self.terms.real(operation, *arguments), precision)

    def _sum(self, terms: Iterable[Value], total: Value = 0.0, precision: ir.Precision = ir.Precision.FLOAT64) -> Value:
        """Terms added to a total, one after another, each sum rounded to a precision."""
        for term in terms:
            total = self._rounded(precision, "add", total, term)
        return total

    # --- operations -------------------------------------------------------------------------------------------------

    @singledispatchmethod
    def value(self, op: ir.Operation, _: list[list[Value]]) -> list[Value]:
        """The columns of the result of an operation."""
        raise NotProvedError(f"the operation {type(op).__name__} is not followed outside of trees")

    @value.register
    def _(self, op: ir.Select, given: list[list[Value]]) -> list[Value]:
        joined = [column for value in given for column in value]
        return [joined[column] for column in op.columns]

    @value.register
    def _(self, op: ir.Scale, given: list[list[Value]]) -> list[Value]:
        result = []
        for x, constant, missing in zip(given[0], op.constant.tolist(), self._flagged(op), strict=True):
            pair = (constant, x) if op.reverse else (x, constant)
            if op.reverse and op.operator is ir.Operator.DIVIDE:
                least = abs(constant) * (1.0 / op.ceiling)
                result.append(self._guarded(pair, least, op.precision, missing))
            else:
                result.append(self._rounded(op.precision, _SYMBOL[op.operator], *pair))
        return result

    @value.register
    def _(self, op: ir.Combine, given: list[list[Value]]) -> list[Value]:
        result = []
        for *pair, missing in zip(*given, self._flagged(op), strict=True):
            if op.operator is ir.Operator.DIVIDE:
                least = self.terms.real("mul", self.terms.real("abs", pair[0]), 1.0 / op.ceiling)
                result.append(self._guarded(pair, least, op.precision, missing))
            else:
                result.append(self._rounded(op.precision, _SYMBOL[op.operator], *pair))
        return result

    def _guarded(self, pair: Sequence[Value], least: Value, precision: ir.Precision, missing: Value = False) -> Value:
        size = self.terms.real("abs", pair[1])
        self._refuse(self.terms.compare("LE", size, least), missing)
        return self.terms.branch("LE", size, least, 0.0, lambda: self._rounded(precision, "div", *pair))

    @value.register
    def _(self, _: ir.Round, given: list[list[Value]]) -> list[Value]:
        return [self.terms.real("single", x) for x in given[0]]

    @value.register
    def _(self, op: ir.Clip, given: list[list[Value]]) -> list[Value]:
        ends = zip(given[0], op.lower.tolist(), op.upper.tolist(), strict=True)
        return [self.terms.real("min", self.terms.real("max", x, low), high) for x, low, high in ends]

    @value.register
    def _(self, op: ir.Exceeds, given: list[list[Value]]) -> list[Value]:
        name = "GE" if op.inclusive else "GT"
        pairs = zip(given[0], op.cut.tolist(), strict=True)
        return [self.terms.branch(name, x, cut, 1.0, 0.0) for x, cut in pairs]

    @value.register
    def _(self, op: ir.WholeNumber, given: list[list[Value]]) -> list[Value]:
        terms, end = self.terms, 2.0**52
        result = []
        for x in given[0]:
            size = terms.real("abs", x)

            def near(size: Value = size) -> Value:
                found = terms.real("sub", terms.real("add", size, end), end)
                if op.towards is not ir.Towards.ZERO:
                    return found
                return terms.branch("GT", found, size, lambda: terms.real("sub", found, 1.0), found)

            y = terms.branch("LT", size, end, near, size)
            y = terms.branch("LT", x, 0.0, partial(terms.real, "sub", 0.0, y), y)
            if op.towards is ir.Towards.BELOW:
                y = terms.branch("GT", y, x, partial(terms.real, "sub", y, 1.0), y)
            elif op.towards is ir.Towards.ABOVE:
                y = terms.branch("LT", y, x, partial(terms.real, "add", y, 1.0), y)
            result.append(y)
        return result

    def _largest(self, columns: list[Value]) -> tuple[Value, Value]:
        """The largest of some numbers and its place, of equal ones the first."""
        largest: Value = columns[0]
        best: Value = 0
        for number, x in enumerate(columns[1:], 1):
            above = self.terms.compare("GT", x, largest)
            best = self.terms.where(above, number, best)
            largest = self.terms.where(above, x, largest)
        return largest, best

    @value.register
    def _(self, op: ir.ArgMax, given: list[list[Value]]) -> list[Value]:
        """The place of the first column that is the largest, or lies below it by `merged` at most."""
        terms = self.terms
        largest, best = self._largest(given[0])
        for number, x in enumerate(given[0][:-1]):
            if not op.merged:
                break
            before = terms.compare("LT", number, best)
            near = terms.compare("LE", terms.real("sub", largest, x), op.merged)
            best = terms.where(terms.both(before, near), number, best)
        return [terms.integer("ireal", best, low=0, high=op.n_columns - 1) if isinstance(best, Term) else float(best)]

    @value.register
    def _(self, op: ir.Softmax, given: list[list[Value]]) -> list[Value]:
        largest, _ = self._largest(given[0])
        below = [self.terms.real("sub", x, largest) for x in given[0]]
        powers = [exp(self.terms, x, op.precision) for x in below]
        total = self._sum(powers)
        if op.logarithm:
            total = self.terms.real("ln", total)
            return [self._rounded(op.precision, "sub", x, total) for x in below]
        return [self._rounded(op.precision, "div", power, total) for power in powers]

    @value.register
    def _(self, op: ir.FillMissing, given: list[list[Value]]) -> list[Value]:
        result = []
        for x, missing, fill in zip(given[0], self.missing[op.inputs[0]], op.fill.tolist(), strict=True):
            value: Value = x
            if op.sentinel is not None:
                apart = self.terms.real("abs", self.terms.real("sub", x, op.sentinel))
                condition = self.terms.negated(self.terms.compare("GT", apart, 0.0))
                value = self.terms.where(condition, fill, x)
            if self.model.accepts_nan:
                value = self.terms.where(missing, fill, value)
            result.append(value)
        return result

    @value.register
    def _(self, op: ir.Piecewise, given: list[list[Value]]) -> list[Value]:
        result = []
        for column, x in enumerate(given[0]):
            missing = self.missing[op.inputs[0]][column] if op.missing is not None else False

            def below(piece: int, column: int = column, x: Value = x, missing: Value = missing) -> Value:
                fill = 0.0 if op.missing is None else float(np.nan_to_num(op.missing[column]))
                return self.terms.where(missing, fill, lambda: self._piece(op, column, piece, x))

            first, last = op.start[column : column + 2].tolist()
            result.append(self._among(op.knots, first, last, x, below))
            if op.refuses:

                def taken(piece: int, column: int = column, x: Value = x, missing: Value = missing) -> Value:
                    return self.terms.where(missing, self.valid, lambda: self._answers(op, column, piece, x))

                self.valid = self._among(op.knots, first, last, x, taken)
        return result

    def _among(self, knots: FloatArray, low: int, high: int, x: Value, then: Callable[[int], Value]) -> Value:
        """What `then` gives for the first of rising knots `low` .. `high` - 1 that does not lie below x."""
        if low == high:
            return then(low)
        middle = (low + high) // 2
        return self.terms.branch(
            "LT",
            float(knots[middle]),
            x,
            lambda: self._among(knots, middle + 1, high, x, then),
            lambda: self._among(knots, low, middle, x, then),
        )

    def _on(self, op: ir.Piecewise, column: int, knot: int, x: Value) -> Value:
        """Whether x is a knot of a column, where that is the first one that does not lie below x."""
        return knot < op.start[column + 1] and self.terms.compare("LE", float(op.knots[knot]), x)

    def _answers(self, op: ir.Piecewise, column: int, knot: int, x: Value) -> Value:
        numbers = np.append(op.at, 0.0)[knot], op.pieces[knot + column, 0]
        sides = [self.valid if math.isfinite(number) else False for number in numbers]
        return self.terms.where(self._on(op, column, knot, x), *sides)

    def _piece(self, op: ir.Piecewise, column: int, knot: int, x: Value) -> Value:
        """The number of a knot where x is that, else the polynomial of the piece below it."""
        real = self.terms.real
        first, last = op.start[column : column + 2].tolist()
        pieces = op.without_refusals().pieces[knot + column, ::-1].tolist()

        def polynomial() -> Value:
            if op.degree == 0:
                return float(pieces[0])
            inside = real("min", real("max", x, float(op.knots[first])), float(op.knots[last - 1]))
            apart = real("sub", inside, float(op.knots[max(knot - 1, first)]))
            total: Value = pieces[0]
            for coefficient in pieces[1:]:
                total = real("add", real("mul", total, apart), coefficient)
            return total

        number = float(np.append(op.without_refusals().at, 0.0)[knot])
        return self.terms.where(self._on(op, column, knot, x), number, polynomial)

    @value.register
    def _(self, op: ir.Linear | ir.SlidingLinear, given: list[list[Value]]) -> list[Value]:
        places = op.columns.tolist() if isinstance(op, ir.SlidingLinear) else [range(len(given[0]))]
        in_order = isinstance(op, ir.Linear) and op.order is ir.SummationOrder.SEQUENTIAL
        step = op.precision if in_order and op.precision is ir.Precision.FLOAT32 else ir.Precision.FLOAT64
        result = []
        for columns in places:
            for weights, bias in zip(op.weights.tolist(), op.bias.tolist(), strict=True):
                pairs = zip(columns, weights, strict=True)
                products = (self._rounded(step, "mul", given[0][column], weight) for column, weight in pairs)
                result.append(rounded(self.terms, self._sum(products, bias, step), op.precision))
        return result

    @value.register
    def _(self, op: ir.Scan, given: list[list[Value]]) -> list[Value]:
        columns = [column for value in given for column in value]
        state: list[Value] = list(op.initial.tolist())
        result: list[Value] = []
        for start in op.starts.tolist():
            values = [columns[start : start + op.columns] + state]
            for step in op.body:
                if isinstance(step, ir.FillMissing | ir.Piecewise):  # these read flags, which a round has none of
                    raise NotProvedError(f"{type(step).__name__} in a recurrent layer is not followed")
                values.append(self.value(step, [values[value] for value in step.inputs]))
            state = values[-1]
            result += state
        return result

    @value.register
    def _(self, op: ir.Activation, given: list[list[Value]]) -> list[Value]:
        pairs = zip(given[0], self._flagged(op), strict=True)
        return [rounded(self.terms, self._function(op, *pair), op.precision) for pair in pairs]

    def _function(self, op: ir.Activation, x: Value, missing: Value = False) -> Value:
        terms, real = self.terms, self.terms.real
        size = real("abs", x)
        #: Functions with a value for every number, and those that refuse some: which, as a comparison, and how.
        everywhere: dict[ir.Function, Callable[[], Value]] = {
            ir.Function.IDENTITY: lambda: x,
            ir.Function.RELU: lambda: real("max", x, 0.0),
            ir.Function.LEAKY_RELU: lambda: terms.branch("LT", x, 0.0, lambda: real("mul", op.parameter, x), x),
            ir.Function.SIGNED_SQUARE: lambda: real("mul", x, size),
            ir.Function.TANH: lambda: tanh(terms, x),
            ir.Function.LOGISTIC: lambda: logistic(terms, x),
            ir.Function.SOFTPLUS: lambda: softplus(terms, x),
            ir.Function.ELU: lambda: terms.branch("LT", x, 0.0, lambda: real("mul", op.parameter, expm1(terms, x)), x),
            ir.Function.ABS: lambda: size,
            ir.Function.ERF: lambda: erf(terms, x, size),
            ir.Function.GELU: lambda: real(
                "mul", real("mul", 0.5, x), real("add", 1.0, erf(terms, x, real("mul", size, math.sqrt(0.5))))
            ),
            ir.Function.SOFTSIGN: lambda: real("div", x, real("add", 1.0, size)),
            ir.Function.ATAN: lambda: real("atan", x),
        }
        refusing: dict[ir.Function, tuple[str, Value, float, Callable[[], Value]]] = {
            ir.Function.LOG1P: ("LE", x, -1.0, lambda: log1p(terms, x)),
            ir.Function.SQRT: ("LT", x, 0.0, lambda: real("sqrt", x)),
            ir.Function.LOG: ("LE", x, 0.0, lambda: real("ln", x)),
            ir.Function.EXP: ("GT", x, op.limit, lambda: exp(terms, x)),
            ir.Function.EXPM1: ("GT", x, op.limit, lambda: expm1(terms, x)),
            ir.Function.SIN: ("GT", size, COS_REACH, lambda: real("sin", x)),
            ir.Function.COS: ("GT", size, COS_REACH, lambda: real("cos", x)),
        }
        if op.function is ir.Function.POWER:
            return self._power(op, x, missing)
        if op.function in everywhere:
            return everywhere[op.function]()
        if op.function not in refusing:
            raise NotProvedError(f"the function {op.function.value} is not followed")
        operator, number, end, formula = refusing[op.function]
        if not math.isfinite(end):
            return formula()
        refused = terms.compare(operator, number, end)
        self._refuse(refused, missing)
        return terms.where(refused, 0.0, formula)

    def _power(self, op: ir.Activation, x: Value, missing: Value) -> Value:
        """exp(exponent * log(|x|)) with the sign of x where the exponent is odd; 0.0 of 0.0."""
        terms = self.terms

        def size() -> Value:  # made where it is read, as in the text: what is known of x by then is known of it
            return terms.real("abs", x)

        refused = terms.compare("GT" if op.parameter > 0 else "LT", size(), min(op.furthest, sys.float_info.max))
        if op.parameter % 1:
            refused = terms.either(terms.compare("LT", x, 0.0), refused)

        def power() -> Value:
            y = exp(terms, terms.real("mul", op.parameter, terms.real("ln", size())))
            return y if op.parameter % 2 != 1 else terms.branch("LT", x, 0.0, lambda: terms.real("neg", y), y)

        self._refuse(refused, missing)
        return terms.where(refused, 0.0, lambda: terms.branch("GT", size(), 0.0, power, 0.0))

    @value.register
    def _(self, op: ir.Normalize, given: list[list[Value]]) -> list[Value]:
        terms, x = self.terms, given[0]
        if op.norm is ir.Norm.MAX:
            return self._by_largest(op, x)
        sizes = (
            terms.real("abs", column) if op.norm is ir.Norm.L1 else self._rounded(op.precision, "mul", column, column)
            for column in x
        )
        total = self._sum(sizes, precision=op.precision)

        def quotient(column: Value) -> Value:
            if op.norm is ir.Norm.L1:
                return self._rounded(op.precision, "div", column, total)
            y = self._rounded(op.precision, "mul", column, column)
            y = self._rounded(op.precision, "div", y, total)
            y = self._rounded(op.precision, "sqrt", y)
            return terms.branch("LT", column, 0.0, lambda: terms.real("neg", y), y)

        return [terms.branch("GT", total, 0.0, partial(quotient, column), column) for column in x]

    def _by_largest(self, op: ir.Normalize, x: list[Value]) -> list[Value]:
        terms = self.terms
        largest = x[0]
        for column in x[1:]:
            largest = terms.real("max", largest, column)
        size = terms.real("abs", largest)
        result = []
        for column in x:
            least = terms.real("mul", terms.real("abs", column), 1.0 / op.ceiling)
            above = terms.compare("GT", size, least)
            result.append(terms.where(above, partial(self._rounded, op.precision, "div", column, largest), column))
            with terms.assuming(above, False):
                refused = terms.compare("GT", size, 0.0)
            self.valid = terms.choice(above, self.valid, terms.choice(refused, False, self.valid))
        return result

    @value.register
    def _(self, op: ir.Distances, given: list[list[Value]]) -> list[Value]:
        result = []
        for vector in op.vectors.tolist():
            total = self._distance(given[0], vector, squared=op.squared, largest=op.largest)
            result.append(self.terms.real("sqrt", total) if op.root else total)
        return result

    def _distance(self, x: list[Value], vector: list[float], *, squared: bool = True, largest: bool = False) -> Value:
        """The sum of the squared differences of two vectors, or of their magnitudes, or the largest of these."""
        terms = self.terms
        deltas = [terms.real("sub", column, number) for column, number in zip(x, vector, strict=True)]
        if largest:
            found: Value = 0.0
            for delta in deltas:
                found = terms.real("max", found, terms.real("abs", delta))
            return found
        return self._sum(terms.real("mul", d, d) if squared else terms.real("abs", d) for d in deltas)

    @value.register
    def _(self, op: ir.KernelSum, given: list[list[Value]]) -> list[Value]:
        result: list[Value] = list(op.intercept.tolist())
        for vector, coefficients in zip(op.support_vectors.tolist(), op.coefficients.T.tolist(), strict=True):
            kernel = self._kernel(op, given[0], vector)
            for output, coefficient in enumerate(coefficients):
                result[output] = self.terms.real("add", result[output], self.terms.real("mul", coefficient, kernel))
        return [rounded(self.terms, value, op.precision) for value in result]

    def _kernel(self, op: ir.KernelSum, x: list[Value], vector: list[float]) -> Value:
        terms = self.terms
        if op.kernel is ir.Kernel.RBF:
            return exp(terms, terms.real("mul", -op.gamma, self._distance(x, vector)))
        product = self._sum(terms.real("mul", *pair) for pair in zip(x, vector, strict=True))
        if op.kernel is ir.Kernel.LINEAR:
            return product
        argument = terms.real("add", terms.real("mul", op.gamma, product), op.coef0)
        if op.kernel is ir.Kernel.SIGMOID:
            return tanh(terms, argument)
        power: Value = 1.0
        for _ in range(op.degree):
            power = terms.real("mul", power, argument)
        return power

    @value.register
    def _(self, op: ir.FactoredKernel, given: list[list[Value]]) -> list[Value]:
        terms = self.terms
        factors = []
        for column, axis in zip(op.columns, op.axes, strict=True):
            deltas = [terms.real("sub", given[0][column], number) for number in axis.tolist()]
            factors.append([exp(terms, terms.real("mul", -op.gamma, terms.real("mul", d, d))) for d in deltas])
        work: list[Value] = list(op.coefficients.ravel().tolist())
        for factor in reversed(factors):
            size = len(factor)
            work = [
                self._sum(terms.real("mul", work[row * size + n], factor[n]) for n in range(size))
                for row in range(len(work) // size)
            ]
        pairs = zip(work, op.intercept.tolist(), strict=True)
        return [self._rounded(op.precision, "add", *pair) for pair in pairs]


def _flags(op: ir.Operation, flags: list[list[Value]]) -> list[Value]:
    """For each column of a result whether it is missing, as the input is that it comes from."""
    if isinstance(op, ir.Select):
        joined = [flag for value in flags for flag in value]
        return [joined[column] for column in op.columns]
    if isinstance(op, ir.ColumnFunction):
        kept = op.keeps_missing
        return [flag if kept is None or kept[column] else False for column, flag in enumerate(flags[0])]
    return flags[0] if isinstance(op, Elementwise) and len(flags[0]) == op.width else [False] * op.width
