"""What the trees of a model give, as terms: leaves, linear models in leaves, and the sums in the library's order."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from st_codegen.ir import Aggregate, FloatArray, ModelIR, Precision, TreeEnsemble
from st_codegen.proof.prove.demand import Demand
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.inputs import InputTerms
from st_codegen.proof.prove.intervals import LARGEST, Interval, hull
from st_codegen.proof.prove.terms import Term, Terms, Value

#: A tree of a model: the number of its operation, its own, and the output to which it adds.
TreeKey = tuple[int, int, int]


class TreeTerms:
    """The terms of a model's trees."""

    def __init__(self, terms: Terms, inputs: InputTerms, model: ModelIR) -> None:
        self.terms, self.inputs, self.model = terms, inputs, model
        self._columns: dict[int, tuple[list[Value], list[Value]]] = {}
        self._linear: dict[tuple[int, int], Value] = {}
        self.leaves: dict[TreeKey, Term] = {}

    def tree(self, op: TreeEnsemble, key: TreeKey) -> Value:
        """What a tree gives to an output, as a term of a sum."""
        rows = rows_of(op, key[1])
        values = column_of(op, key[2])[rows]
        interval: Interval = (float(np.min(values)), float(np.max(values)), False)
        if op.linear is not None:
            for row in np.unique(rows).tolist():
                interval = hull(interval, self.terms.interval(self.linear(op, key[0], row)))
        minus_zero = op.linear is not None or bool(np.any((values == 0) & np.signbit(values)))
        single = op.sum_precision is Precision.FLOAT32
        term = self.terms.leaf(("tree", *key), "real", interval, minus_zero=minus_zero, single=single)
        self.leaves[key] = term
        return term

    def linear(self, op: TreeEnsemble, number: int, row: int) -> Value:
        """The linear model of a leaf: constant and products, added in order; its plain value where one is missing."""
        if number not in self._columns:
            demand = Demand.of_trees(self.terms, self.model, self.inputs, {}, True, op.inputs)
            if demand.valid is not True:
                raise NotProvedError("linear models in leaves behind operations that refuse numbers are not followed")
            columns = [column for value in op.inputs for column in demand.values[value]]
            self._columns[number] = columns, [flag for value in op.inputs for flag in demand.missing[value]]
        if (number, row) not in self._linear:
            assert op.linear is not None
            self._linear[number, row] = self._sum(op, number, row, 0, float(op.linear.constant[row]))
        return self._linear[number, row]

    def _sum(self, op: TreeEnsemble, number: int, row: int, term: int, total: Value) -> Value:
        linear, terms, (columns, missing) = op.linear, self.terms, self._columns[number]
        assert linear is not None
        entry = int(linear.start[row]) + term
        if entry == linear.start[row + 1]:
            return total
        column = int(linear.column[entry])

        def goes_on() -> Value:
            x = columns[column]
            if linear.zero_magnitude:
                small = terms.compare("LE", terms.real("abs", x), linear.zero_magnitude)
                x = terms.where(small, 0.0, x)
            product = terms.real("mul", float(linear.coefficient[entry]), x)
            return self._sum(op, number, row, term + 1, terms.real("add", total, product))

        return terms.where(missing[column], float(op.leaf_value[row, 0]), goes_on)

    def sums(self, op: TreeEnsemble, number: int, fixed: Mapping[TreeKey, float]) -> list[Value]:
        """The sums of an ensemble, every addition in the library's order; `fixed` are trees that are constant."""
        single = op.sum_precision is Precision.FLOAT32
        name = {Aggregate.SUM: "add", Aggregate.MINIMUM: "min", Aggregate.MAXIMUM: "max"}[op.aggregate]

        def rounded(value: Value) -> Value:
            return self.terms.real("single", value) if single else value

        results = []
        for output in range(op.width):
            start = {"add": 0.0, "min": LARGEST, "max": -LARGEST}[name]
            total: Value = start if op.adds_base_last else float(op.base[output])
            for tree in range(op.n_trees):
                if op.leaf_value.shape[1] == 1 and op.width > 1 and op.tree_output[tree] != output:
                    continue
                key = (number, tree, output)
                constant = fixed.get(key)
                term = self.tree(op, key) if constant is None else constant
                total = rounded(self.terms.real(name, total, term))
            if op.divisor != 1.0:
                total = rounded(self.terms.real("div", total, op.divisor))
            if op.adds_base_last:
                total = rounded(self.terms.real("add", total, float(op.base[output])))
            results.append(total)
        return results


def rows_of(op: TreeEnsemble, tree: int) -> np.ndarray[tuple[int, ...], np.dtype[np.int32]]:
    """The leaf rows of a tree."""
    stop = op.roots[tree + 1] if tree + 1 < op.n_trees else op.n_nodes
    nodes = np.arange(op.roots[tree], stop)
    return op.leaf[nodes[op.split[nodes] < 0]]


def column_of(op: TreeEnsemble, output: int) -> FloatArray:
    """The leaf values for an output, one a row."""
    return op.leaf_value[:, 0 if op.leaf_value.shape[1] == 1 else output]
