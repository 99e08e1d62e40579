"""What the trees of a model give, as terms: leaves, linear models in leaves, and the sums in the library's order."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from st_codegen.ir import Aggregate, FloatArray, Precision, TreeEnsemble
from st_codegen.proof.prove.inputs import InputTerms
from st_codegen.proof.prove.intervals import LARGEST, Interval, hull
from st_codegen.proof.prove.terms import Term, Terms, Value

#: A tree of a model: the number of its operation, its own, and the output to which it adds.
TreeKey = tuple[int, int, int]


class TreeTerms:
    """The terms of a model's trees. `values` are those of the columns that linear leaves read."""

    def __init__(self, terms: Terms, inputs: InputTerms) -> None:
        self.terms, self.inputs = terms, inputs
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
        """The linear model of a leaf: its constant and products, added in order; its plain value where one is missing.

        Reads the inputs of the model themselves.
        """
        if (number, row) not in self._linear:
            self._linear[number, row] = self._sum(op, row, 0, self._start(op, row))
        return self._linear[number, row]

    def _start(self, op: TreeEnsemble, row: int) -> Value:
        assert op.linear is not None
        return float(op.linear.constant[row])

    def _sum(self, op: TreeEnsemble, row: int, term: int, total: Value) -> Value:
        linear, terms = op.linear, self.terms
        assert linear is not None
        entry = int(linear.start[row]) + term
        if entry == linear.start[row + 1]:
            return total
        column = int(linear.column[entry])
        missing = self.inputs.missing[column]

        def goes_on() -> Value:
            x = self.inputs.numbers[column]
            if linear.zero_magnitude:
                small = terms.compare("LE", terms.real("abs", x), linear.zero_magnitude)
                x = terms.where(small, lambda: 0.0, lambda: self.inputs.numbers[column])
            product = terms.real("mul", float(linear.coefficient[entry]), x)
            return self._sum(op, row, term + 1, terms.real("add", total, product))

        return terms.where(missing, lambda: float(op.leaf_value[row, 0]), goes_on)

    def sums(self, op: TreeEnsemble, number: int, fixed: Mapping[TreeKey, float]) -> list[Value]:
        """The sums of an ensemble, every addition in the library's order; `fixed` are trees that are constant."""
        single = op.sum_precision is Precision.FLOAT32
        name = {Aggregate.SUM: "add", Aggregate.MINIMUM: "min", Aggregate.MAXIMUM: "max"}[op.aggregate]

        def rounded(value: Value) -> Value:
            return self.terms.real("single", value) if single else value

        results = []
        for output in range(op.width):
            later = op.base_last or op.aggregate is not Aggregate.SUM
            start = {"add": 0.0, "min": LARGEST, "max": -LARGEST}[name]
            total: Value = start if later else float(op.base[output])
            for tree in range(op.n_trees):
                if op.leaf_value.shape[1] == 1 and op.width > 1 and op.tree_output[tree] != output:
                    continue
                key = (number, tree, output)
                constant = fixed.get(key)
                term = self.tree(op, key) if constant is None else constant
                total = rounded(self.terms.real(name, total, term))
            if op.divisor != 1.0:
                total = rounded(self.terms.real("div", total, op.divisor))
            if later:
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
