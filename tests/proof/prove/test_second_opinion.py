"""A second opinion on small trees and tables: a solver for floating point finds no input where text and library differ.

The text is executed here once more, by a few lines that share nothing with `prove`: each variable holds the values that
it can have, each with the condition on the inputs under which it has it, in the solver's own floating point numbers.
The library's trees become conditions of the same kind, from the arrays that it holds itself.
"""

import numpy as np
import pytest

pytest.importorskip("z3")
pytest.importorskip("sklearn")

import z3
from sklearn.tree import DecisionTreeClassifier, DecisionTreeRegressor

from st_codegen.driver import generate
from st_codegen.passes.choose import Layout, Options
from st_codegen.project.bundle import Bundle
from st_codegen.proof.prove.prove import Verdict, prove
from st_codegen.proof.runner import GeneratedCode
from st_codegen.st import tree as t
from tests.changes import change_once
from tests.classifiers import SCORE, THREE, X, loaded

DOUBLE, SINGLE, NEAREST = z3.Float64(), z3.Float32(), z3.RNE()
ORDER = {"LT": z3.fpLT, "LE": z3.fpLEQ, "GT": z3.fpGT, "GE": z3.fpGEQ}
PLAIN = {
    "LT": lambda a, b: a < b,
    "LE": lambda a, b: a <= b,
    "GT": lambda a, b: a > b,
    "GE": lambda a, b: a >= b,
    "EQ": lambda a, b: a == b,
    "ADD": lambda a, b: a + b,
    "SUB": lambda a, b: a - b,
    "MUL": lambda a, b: a * b,
    "DIV": lambda a, b: int(a / b),
    "AND": lambda a, b: a & b,
}


def symbolic(value):
    return isinstance(value, z3.ExprRef)


def number(value):
    return value if symbolic(value) else z3.FPVal(float(value), DOUBLE)


def rounded(x):
    """A number through float32."""
    return z3.fpToFP(NEAREST, z3.fpToFP(NEAREST, x, SINGLE), DOUBLE)


def both(*conditions):
    return z3.simplify(z3.And(*conditions))


def gathered(cases):
    """Cases with equal values joined, and those that cannot be left out."""
    found = {}
    for condition, value in cases:
        if not z3.is_false(condition):
            key = ("z3", value.get_id()) if symbolic(value) else (type(value).__name__, repr(value))
            old = found.get(key)
            found[key] = (condition if old is None else z3.simplify(z3.Or(old[0], condition)), value)
    return list(found.values())


class Text:
    """One call of a block: for each variable, or element, its values by condition."""

    def __init__(self, project, block, inputs):
        unit = project.pous[block.upper()]
        self.held, self.here = {}, z3.BoolVal(True)
        self.traps = []  # where an index is out of range: must not be reached
        for variable, x in zip(unit.section(t.Section.INPUT), inputs, strict=True):
            self.held[variable, 0] = [(z3.BoolVal(True), x)]
        self.block(unit.body)
        self.outputs = {variable.name: self.held[variable, 0] for variable in unit.section(t.Section.OUTPUT)}

    def block(self, statements):
        for statement in statements:
            self.statement(statement)

    def statement(self, statement):
        if isinstance(statement, t.Assign):
            self.store(statement.target, self.value(statement.value))
        elif isinstance(statement, t.If):
            entry, met = self.here, z3.BoolVal(False)
            left = z3.BoolVal(False)
            for condition, body in [*((b.condition, b.body) for b in statement.branches), (None, statement.otherwise)]:
                self.here = both(entry, z3.Not(met))
                holds = z3.BoolVal(True) if condition is None else self.truth(condition)
                met = z3.simplify(z3.Or(met, holds))
                self.here = both(self.here, holds)
                if not z3.is_false(self.here):
                    self.block(body)
                    left = z3.simplify(z3.Or(left, self.here))
            self.here = left
        elif isinstance(statement, t.For):
            start, stop, step = ((self.value(part))[0][1] for part in (statement.start, statement.stop, statement.step))
            entry = self.here
            for counter in range(start, stop + 1, step):
                self.held[statement.variable, 0] = [(z3.BoolVal(True), counter)]
                self.block(statement.body)
            self.here = entry
        elif isinstance(statement, t.Exit):
            self.here = z3.BoolVal(False)
        else:
            raise AssertionError(type(statement))

    def store(self, target, cases):
        places = [(z3.BoolVal(True), 0)]
        if isinstance(target, t.ElementRef):
            places, target = self.value(target.indices[0]), target.base
        for where, place in places:
            here = both(self.here, where)
            old = self.held.get((target.variable, place), [])
            kept = [(both(condition, z3.Not(here)), value) for condition, value in old]
            self.held[target.variable, place] = gathered([(both(c, here), v) for c, v in cases] + kept)

    def truth(self, expression):
        return z3.simplify(
            z3.Or(*(both(c, v if symbolic(v) else z3.BoolVal(bool(v))) for c, v in self.value(expression)))
        )

    def value(self, e):  # noqa: PLR0911, PLR0912 - one return a kind
        if isinstance(e, t.Constant):
            return [(z3.BoolVal(True), e.value)]
        if isinstance(e, t.VariableRef):
            return [(z3.BoolVal(True), e.variable.initial)] if e.variable.is_constant else self.held[e.variable, 0]
        if isinstance(e, t.ElementRef):
            found = []
            for where, place in self.value(e.indices[0]):
                reached = both(where, self.here)
                if z3.is_false(reached):
                    continue
                if not 0 <= place < e.base.type.size:
                    self.traps.append(reached)
                elif e.base.variable.is_constant:
                    found.append((where, e.base.variable.initial[place].item()))
                else:
                    found += [(both(where, c), v) for c, v in self.held[e.base.variable, place]]
            return gathered(found)
        if isinstance(e, t.Unary):
            return (
                [(z3.BoolVal(True), z3.Not(self.truth(e.operand)))]
                if e.operator == "NOT"
                else self.each(lambda a: -a, e.operand)
            )
        if isinstance(e, t.Conversion) and str(e.operand.type) == "BOOL":
            holds = self.truth(e.operand)
            return gathered([(holds, 1), (z3.simplify(z3.Not(holds)), 0)])
        if isinstance(e, t.Conversion):
            return self.each(lambda a: self.converted(a, e), e.operand)
        if isinstance(e, t.StandardCall):
            functions = {"ABS": lambda a: z3.fpAbs(a) if symbolic(a) else abs(a), "TRUNC": int}
            return self.each(functions[e.function], *e.arguments)
        if e.operator in ("AND", "OR") and str(e.type) == "BOOL":
            join = z3.And if e.operator == "AND" else z3.Or
            return [(z3.BoolVal(True), z3.simplify(join(self.truth(e.left), self.truth(e.right))))]
        return self.each(lambda a, b: self.combined(e.operator, a, b), e.left, e.right)

    def each(self, function, *operands):
        cases = [(self.here, ())]
        for operand in operands:
            cases = [(both(c, d), (*values, v)) for c, values in cases for d, v in self.value(operand)]
        return gathered([(c, function(*values)) for c, values in cases if not z3.is_false(c)])

    @staticmethod
    def combined(operator, a, b):
        if not symbolic(a) and not symbolic(b):
            return PLAIN[operator](a, b)
        return ORDER[operator](number(a), number(b))

    @staticmethod
    def converted(a, e):
        if str(e.type) == "REAL":
            return rounded(a) if symbolic(a) else float(np.float32(a))
        return float(a) if str(e.type) == "LREAL" and not symbolic(a) else a


def library(estimator, inputs):
    """The leaf of scikit-learn's own arrays for each condition, and where it answers."""
    tree, fits = estimator.tree_, z3.FPVal(3.4028235677973366e38, DOUBLE)
    answers = z3.And(*(z3.Or(z3.fpIsNaN(x), z3.fpLT(z3.fpAbs(x), fits)) for x in inputs))

    def walk(node, condition):
        if tree.children_left[node] < 0:
            value = tree.value[node, 0]
            yield condition, int(np.argmax(value)) if hasattr(estimator, "classes_") else float(value[0])
            return
        x = inputs[tree.feature[node]]
        goes = z3.fpLEQ(rounded(x), z3.FPVal(float(tree.threshold[node]), DOUBLE))
        goes = z3.If(z3.fpIsNaN(x), z3.BoolVal(bool(tree.missing_go_to_left[node])), goes)
        yield from walk(tree.children_left[node], z3.And(condition, goes))
        yield from walk(tree.children_right[node], z3.And(condition, z3.Not(goes)))

    return answers, list(walk(0, z3.BoolVal(True)))


def differing_input(project, block, estimator, output):
    """Numbers for which text and library differ; None where the solver shows that there are none."""
    inputs = [z3.FP(f"x{number}", DOUBLE) for number in range(estimator.n_features_in_)]
    text = Text(project, block, inputs)
    valid = z3.Or(*(both(c, v if symbolic(v) else z3.BoolVal(bool(v))) for c, v in text.outputs["bValid"]))
    answers, leaves = library(estimator, inputs)
    wrong = [valid != answers, *text.traps]
    for condition, value in leaves:
        same = [c for c, v in text.outputs[output] if v == value]
        wrong.append(z3.And(answers, condition, z3.Not(z3.Or(*same))))
    solver = z3.Solver()
    solver.add(z3.Or(*wrong))
    found = solver.check()
    assert found != z3.unknown
    return None if found == z3.unsat else solver.model()


CASES = {
    "numbers": (DecisionTreeRegressor(max_depth=3, random_state=0), SCORE, "fOut1"),
    "labels": (DecisionTreeClassifier(max_depth=3, random_state=0), THREE, "nClass"),
}


def written(name, layout, folder):
    estimator, y, output = CASES[name]
    model = loaded(estimator.fit(X[:, :2], y), outputs=())
    generate(Bundle((model,)), "iec", folder, options=Options(layout=layout))
    return model, estimator, output


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("layout", [Layout.TREES, Layout.RANKED, Layout.TABLE])
def test_a_solver_agrees_that_text_and_library_are_equal(name, layout, tmp_path):
    model, estimator, output = written(name, layout, tmp_path)
    assert prove(Bundle((model,)), tmp_path).results[0].verdict is Verdict.PROVED
    assert differing_input(GeneratedCode(tmp_path / "iec", "iec").project, "FB_M", estimator, output) is None


@pytest.mark.parametrize("layout", [Layout.TREES, Layout.TABLE])
def test_a_solver_and_prove_both_find_a_threshold_that_was_changed(layout, tmp_path):
    model, estimator, output = written("labels", layout, tmp_path)
    path = tmp_path / "iec" / "FB_M.st"
    pattern = r"((?:EDGE_1_0|THRESHOLD_1) : .*\n\s+(?:\(\*.*\n\s+)?)(-?[0-9.]+)"
    change_once(path, pattern, lambda m: m[1] + repr(float(m[2]) + 0.25))
    assert prove(Bundle((model,)), tmp_path).results[0].verdict is Verdict.REFUTED
    assert differing_input(GeneratedCode(tmp_path / "iec", "iec").project, "FB_M", estimator, output) is not None
