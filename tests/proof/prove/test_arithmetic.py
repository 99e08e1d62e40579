"""Models without trees: the text computes the model's expression, nothing in it fails, and the bound is one."""

import dataclasses
import importlib
import itertools
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.emit.targets import TARGETS
from st_codegen.ir import (
    Activation,
    Function,
    Kernel,
    KernelSum,
    Linear,
    Operator,
    Precision,
    Scale,
    Select,
    TreeEnsemble,
    reference,
)
from st_codegen.passes.domain import limit_inputs
from st_codegen.passes.kernels import factored
from st_codegen.project.bundle import load
from st_codegen.proof.bounds import ERF_FORMULA, difference_bound
from st_codegen.proof.prove import arithmetic, symbolic
from st_codegen.proof.prove.arithmetic import prove_arithmetic
from st_codegen.proof.prove.disagree import OtherExpressionError
from st_codegen.proof.prove.errors import NotProvedError
from st_codegen.proof.prove.formulas import LOG_ERFC
from st_codegen.proof.prove.intervals import FUNCTION_ERROR, FUNCTIONS, INTEGER
from st_codegen.proof.prove.prove import Verdict, prove
from st_codegen.proof.prove.range_bound import interval, range_bound
from st_codegen.proof.prove.terms import Terms, _exponent
from st_codegen.proof.runner import GeneratedCode
from tests.changes import change_once
from tests.emit.test_emitted import generated
from tests.models import MISSING_BEHIND, SMALL_MODELS
from tests.models import model as model_of

GOLDEN = Path(__file__).resolve().parents[3] / "golden"

ARITHMETIC = sorted(
    name for name, model in SMALL_MODELS.items() if not any(isinstance(op, TreeEnsemble) for op in model.ops)
)
#: Arithmetic with infinities, which the division lets through, is not followed.
NOT_FOLLOWED = {"combine divide": "may overflow"}
#: Neighbours are sorted by distances, so that the place of an element is decided between computed numbers.
NOT_FOLLOWED |= {
    **dict.fromkeys(("median", "median in float32"), "whose place is a choice between computed numbers"),
    "median of one": "the operation WeightedMedian is not followed",
    **dict.fromkeys(("normal quantiles", "missing behind normal_quantile"), "mul may overflow|by what may be zero"),
    **dict.fromkeys(("coupled pairs", "coupled pairs of two"), "a division by what may be zero"),
    **{name: "whose place is a choice between computed numbers" for name in ARITHMETIC if name.startswith("nearest")},
}
#: A power of nothing is 1, and the largest of one the first, for every input: no operation is left.
CONSTANT = {"kernel polynomial degree 0", "argmax of one"}


@pytest.mark.thorough
@pytest.mark.parametrize("name", [*ARITHMETIC, *MISSING_BEHIND])
def test_each_operation_is_the_expression_that_its_model_demands(name, tmp_path):
    model = limit_inputs((SMALL_MODELS | MISSING_BEHIND)[name])
    code = generated(model, "iec", tmp_path)
    outputs = tuple(range(len(model.outputs)))
    if name in NOT_FOLLOWED:
        with pytest.raises(NotProvedError, match=NOT_FOLLOWED[name]):
            prove_arithmetic(model, code.project, "FB_M", outputs)
        return
    proof = prove_arithmetic(model, code.project, "FB_M", outputs)
    assert (proof.bound == ()) == (not model.exact)
    assert (proof.operations > 0) == (name not in CONSTANT)


def test_a_power_of_what_is_at_most_one_is_followed(tmp_path):
    ops = (
        Select((0,), np.array([0])),
        Activation((1,), Function.RELU, 1),
        Scale((2,), Operator.MULTIPLY, np.array([-0.5])),
        Scale((3,), Operator.ADD, np.array([1.0])),
        Activation((4,), Function.POWER, 1, -2.5),
    )
    model = limit_inputs(model_of(*ops))
    code = generated(model, "iec", tmp_path)
    assert prove_arithmetic(model, code.project, "FB_M", (0,)).operations > 0


def test_a_block_that_never_answers_is_not_called_one_that_loses_its_outputs(tmp_path):
    ops = (
        Activation((0,), Function.ABS, 3),
        Scale((1,), Operator.MULTIPLY, np.full(3, -1.0)),
        Scale((2,), Operator.SUBTRACT, np.ones(3)),
        Activation((3,), Function.SQRT, 3),
    )
    model = limit_inputs(dataclasses.replace(model_of(ops[0]), ops=ops))
    with pytest.raises(NotProvedError, match="no answer to any input"):
        prove_arithmetic(model, generated(model, "iec", tmp_path).project, "FB_M", (0, 1, 2))


def test_ranges_of_which_some_flag_and_some_limit_are_followed(tmp_path):
    model = SMALL_MODELS["linear"]
    first, second, *others = model.features
    ranged = (dataclasses.replace(first, flagged=(-1.0, 1.0)), dataclasses.replace(second, lower=3.0, upper=4.0))
    model = limit_inputs(dataclasses.replace(model, features=(*ranged, *others)))
    code, outputs = generated(model, "iec", tmp_path), tuple(range(len(model.outputs)))
    assert prove_arithmetic(model, code.project, "FB_M", outputs).operations > 0


def test_a_range_that_only_flags_is_followed(tmp_path):
    """It was said that bInRange is not what the declared ranges demand, and it is."""
    model = SMALL_MODELS["linear"]
    first, *others = model.features
    model = limit_inputs(
        dataclasses.replace(model, features=(dataclasses.replace(first, flagged=(-1.0, 1.0)), *others))
    )
    code, outputs = generated(model, "iec", tmp_path), tuple(range(len(model.outputs)))
    assert prove_arithmetic(model, code.project, "FB_M", outputs).operations > 0
    wider = dataclasses.replace(model, features=(dataclasses.replace(first, flagged=(-1.0, 2.0)), *others))
    with pytest.raises(NotProvedError, match="bInRange is not what"):
        prove_arithmetic(limit_inputs(wider), code.project, "FB_M", outputs)


def test_a_bound_that_nobody_knows_is_infinite():
    model = SMALL_MODELS["distances"]
    features = tuple(dataclasses.replace(feature, lower=-1.0, upper=1.0) for feature in model.features)
    assert set(range_bound(dataclasses.replace(model, features=features))) == {np.inf}


CHANGES = {
    "an ulp": ("svr", r"(VECTOR_\d+ : .*\n\s+)([0-9.]+)", lambda m: m[1] + repr(float(np.nextafter(float(m[2]), 9e9)))),
    "order": ("svr", r"fSum := fSum \+ fDelta \* fDelta", lambda _: "fSum := fDelta * fDelta + fSum"),
    "a sign": ("svr", r"fSum := -GAMMA", lambda _: "fSum := GAMMA"),
    "a bound": ("mlp_tanh", r"IF ABS\(fX\) < 0.75", lambda _: "IF ABS(fX) <= 0.75"),
    "a constant": ("mlp_tanh", r"135135\.0", lambda _: "135136.0"),
    "no check of infinities": ("mlp_tanh", r"> INPUT_LIMIT\[nColumn\]", lambda _: ">= INPUT_LIMIT[nColumn]"),
    "a later result": ("ridge", r"bValid := bUsable", lambda _: "bValid := TRUE"),
    "a result that is not held": ("ridge", r"IF bUsable THEN", lambda _: "IF TRUE THEN"),
    "an unguarded exponential": ("svr", r"IF fSum > -708.0 THEN", lambda _: "IF fSum > -708.0 OR TRUE THEN"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CHANGES)
def test_a_text_changed_by_hand_is_not_proved(name, tmp_path):
    model, pattern, change = CHANGES[name]
    folder, models = tmp_path / "out" / "iec", tmp_path / "models"
    folder.mkdir(parents=True)
    models.mkdir()
    shutil.copy(GOLDEN / "lone" / "generated" / "iec" / "st-codegen.json", folder)
    block = f"FB_{model.capitalize()}.st"
    text = (GOLDEN / "lone" / "generated" / "iec" / block).read_text()
    changed, count = re.subn(pattern, change, text, count=1)
    assert count == 1 and changed != text
    shutil.copy(GOLDEN / "lone" / "models" / f"{model}.skops", models)
    bundle = load(models)
    (folder / block).write_text(text)
    assert prove(bundle, tmp_path / "out").results[0].verdict is Verdict.PROVED
    (folder / block).write_text(changed)
    assert prove(bundle, tmp_path / "out").results[0].verdict is not Verdict.PROVED


@pytest.mark.parametrize(("limit", "most"), [("_MOST_CASES", 1), ("_MOST_SPLITS", 0)])
def test_an_integer_that_differs_in_too_many_cases_is_given_up(limit, most, tmp_path, monkeypatch):
    """A search among knots is two cases, one in the other; what has thousands must end."""
    model = limit_inputs(SMALL_MODELS["piecewise linear"])
    project = generated(model, "iec", tmp_path).project
    monkeypatch.setattr(symbolic, limit, most + 1)
    prove_arithmetic(model, project, "FB_M", (0, 1, 2))
    monkeypatch.setattr(symbolic, limit, most)
    with pytest.raises(NotProvedError, match="too many cases"):
        prove_arithmetic(model, project, "FB_M", (0, 1, 2))


#: Changes of searches among knots, of polynomials between them, and of rounds that hand on a state.
CASES_CHANGED = {
    "a knot by an ulp": ("linear", r"(KNOT_1 : .*\n(?:.*\n)?\s+)0\.0", r"\g<1>5E-324"),
    "on a knot": ("linear", r"(KNOT_VALUE_1 : .*\n(?:.*\n)?\s+)0\.0", r"\g<1>-0.0"),
    "a coefficient": ("quadratic", r"(PIECE_1 : (?:.*\n){5}.*?)(\d\.\d)", r"\g<1>1\2"),
    "the search on a knot": ("linear", r"\[nMiddle\] < fX", "[nMiddle] <= fX"),
    "the knot itself": ("linear", r"\[nKnot\] <= fX", "[nKnot] < fX"),
    "a search too short": ("linear", r"nLevel := 1 TO 2", "nLevel := 1 TO 1"),
    "the origin": ("quadratic", r"nHigh := nKnot - 1", "nHigh := nKnot"),
    "the order of the powers": ("quadratic", r"fY := fY \* fX \+", "fY := fX * fY +"),
    "what is refused": ("constant", r"_REFUSED_1\[nKnot\] = 1", "_REFUSED_1[nKnot] = 2"),
    "what is missing": ("constant", r"(FILL_1 : .*\n\s+0\.0, )8\.0", r"\g<1>8.5"),
    "the end of the last knot": ("linear", r"AND nKnot < KNOT_START_1\[nColumn \+ 1\]", ""),
}


@pytest.mark.parametrize("name", CASES_CHANGED)
def test_cases_of_one_number_changed_by_hand_are_not_proved(name, tmp_path):
    kind, pattern, replacement = CASES_CHANGED[name]
    model = limit_inputs(SMALL_MODELS[f"piecewise {kind}"])
    path = tmp_path / "iec" / "FB_M.st"
    generated(model, "iec", tmp_path)
    change_once(path, pattern, replacement)
    code = GeneratedCode(path.parent, "iec")
    with pytest.raises(NotProvedError):
        prove_arithmetic(model, code.project, "FB_M", tuple(range(len(model.outputs))))


@pytest.mark.parametrize(
    ("assigned", "verdict"),
    [("", Verdict.PROVED), ("IF NOT bUsable THEN bOther := TRUE; END_IF;", Verdict.NOT_PROVED)],
)
def test_a_variable_has_its_initial_value_only_where_no_call_with_any_input_assigns_it(assigned, verdict, tmp_path):
    folder, models = tmp_path / "out" / "iec", tmp_path / "models"
    folder.mkdir(parents=True)
    models.mkdir()
    shutil.copy(GOLDEN / "lone" / "generated" / "iec" / "st-codegen.json", folder)
    text = (GOLDEN / "lone" / "generated" / "iec" / "FB_Ridge.st").read_text()
    (result,) = re.findall(r"fOut1 := (\S+);", text)
    text = text.replace("    bUsable : BOOL;", "    bOther : BOOL;\n    bUsable : BOOL;")
    text = text.replace(f"    fOut1 := {result};", f"    fOut1 := {result};\n    IF bOther THEN fOut1 := 1.0; END_IF;")
    (folder / "FB_Ridge.st").write_text(text.replace("END_FUNCTION_BLOCK", f"{assigned}\nEND_FUNCTION_BLOCK"))
    shutil.copy(GOLDEN / "lone" / "models" / "ridge.skops", models)
    assert prove(load(models), tmp_path / "out").results[0].verdict is verdict


def test_the_bound_on_a_range_is_above_that_of_every_row_and_not_far():
    for loaded in load(GOLDEN / "bundle" / "models").models:
        if loaded.ir.exact:
            continue
        low, high = np.array([(feature.lower, feature.upper) for feature in loaded.ir.features]).T
        x = low + (high - low) * np.random.default_rng(0).random((2000, len(low)))
        rows = difference_bound(loaded.ir, np.vstack([x, low, high])).max(axis=0)
        bound = np.array(range_bound(loaded.ir))
        assert np.all(bound >= rows)
        assert np.all(bound < 3 * rows)


def test_the_bound_on_a_range_knows_that_expanded_squares_lose_digits():
    model = SMALL_MODELS["kernel two outputs"]
    op = dataclasses.replace(model.ops[0], support_vectors=model.ops[0].support_vectors + 1e6, expands=True)
    features = tuple(dataclasses.replace(f, lower=1e6 - 1, upper=1e6 + 1) for f in model.features)
    model = dataclasses.replace(model, features=features, ops=(op,))
    x = np.random.default_rng(0).uniform(1e6 - 1, 1e6 + 1, (500, len(features)))
    assert np.all(np.array(range_bound(model)) >= difference_bound(model, x).max(axis=0))


def test_the_formula_of_erf_lies_from_it_as_far_as_the_bounds_say():
    """`LOG_ERFC` is written down apart from the emitter's: a text with other numbers is not proved."""
    u = np.linspace(0.0, 7.0, 30_001)
    t = 1.0 / (1.0 + u / 2)
    formula = 1.0 - t * np.exp(np.polyval(LOG_ERFC, t) - u * u)
    assert np.max(np.abs(formula - np.array([math.erf(x) for x in u]))) < ERF_FORMULA


@pytest.mark.parametrize("name", ["function erf", "function gelu float32"])
def test_a_changed_coefficient_of_erf_is_another_expression(name, tmp_path):
    model = limit_inputs(SMALL_MODELS[name])
    generated(model, "iec", tmp_path)
    (path,) = tmp_path.rglob("FB_M.st")
    text = path.read_text()
    number = repr(LOG_ERFC[4])
    assert text.count(number) == 1
    path.write_text(text.replace(number, repr(float(np.nextafter(LOG_ERFC[4], 0.0)))))
    with pytest.raises(OtherExpressionError):
        prove_arithmetic(
            model, GeneratedCode(path.parent, TARGETS["iec"].dialect).project, "FB_M", tuple(range(len(model.outputs)))
        )


FALLING = {
    f"{function.value} {slope}": model_of(Activation((0,), function, 3, slope))
    for function in (Function.LEAKY_RELU, Function.ELU)
    for slope in (-0.5, 0.25)
}


@pytest.mark.parametrize("model", [*SMALL_MODELS.values(), *FALLING.values()], ids=[*SMALL_MODELS, *FALLING])
def test_the_interval_of_a_step_holds_what_numbers_of_its_operands_give(model):
    random = np.random.default_rng(0)
    with np.errstate(all="ignore"):
        values = reference.trace(model, random.normal(size=(60, len(model.features))))
        for op in model.ops:
            ends = [(values[number] - 0.3, values[number] + 0.3) for number in op.inputs]
            try:
                low, high = interval(op, ends)
            except NotProvedError:
                continue
            for _ in range(20):
                result = reference.apply(op, [a + (b - a) * random.random(a.shape) for a, b in ends])
                room = 1e-6 * (1.0 + np.abs(result))  # roundings, to float32 at most, are added by others
                assert np.all((low - room <= result) & (result <= high + room) | ~np.isfinite(result))


#: Functions without a bound on a whole range: their slope has no limit, or their extremes are within it.
WITHOUT_A_RANGE = {"abs", "sin", "cos", "erf", "gelu", "sqrt", "log", "power", "normal_quantile"}


@pytest.mark.parametrize("precision", [Precision.FLOAT32, Precision.FLOAT64, Precision.REAL])
@pytest.mark.parametrize("function", Function)
def test_the_bound_of_a_function_on_a_range_is_above_that_of_every_row_and_not_far(function, precision):
    """The numbers that it reads are sums, so that they differ by roundings, which its slope makes larger."""
    low, high = np.array([-0.9, -0.6]), np.array([1.5, 2.5])
    sums = Linear((0,), [[0.5, 0.5], [0.1, 0.0]], [0.0, 0.1], precision=precision)
    read = Activation((1,), function, 2, 0.3, precision)
    model = model_of(sums, read, features=2)
    features = tuple(
        dataclasses.replace(f, lower=a, upper=b) for f, a, b in zip(model.features, low, high, strict=True)
    )
    model = dataclasses.replace(model, features=features)
    bound = np.array(range_bound(model))
    x = low + (high - low) * np.random.default_rng(0).random((3000, 2))
    rows = difference_bound(model, np.vstack([x, low, high])).max(axis=0)
    if function.value in WITHOUT_A_RANGE:
        assert np.all(np.isinf(bound))
    else:
        assert np.all((bound >= rows) & (bound < 3 * rows))


def on_a_grid():
    """A model with one kernel sum on a grid, and the same factored."""
    vectors = np.stack(np.meshgrid([0.0, 1.0, 2.0], [0.5, 1.5, 4.0], indexing="ij"), -1).reshape(-1, 2)
    sums = KernelSum((1,), Kernel.RBF, vectors, np.arange(1.0, 10.0)[None], [0.25], gamma=0.7)
    model = model_of(Scale((0,), Operator.ADD, [1.0, 2.0]), sums, features=2)
    return model, factored(model)


GRIDS = {
    "a coefficient": lambda op: {"coefficients": op.coefficients + np.eye(1, 9)},
    "a coefficient that is left out": lambda op: {"coefficients": op.coefficients * (1 - np.eye(1, 9))},
    "an axis": lambda op: {"axes": (op.axes[0] + np.eye(1, 3)[0] / 8, op.axes[1])},
    "columns exchanged": lambda op: {"columns": op.columns[::-1]},
    "gamma": lambda op: {"gamma": np.nextafter(op.gamma, 1.0)},
    "the intercept": lambda op: {"intercept": op.intercept + 1e-9},
    "the precision": lambda op: {"precision": Precision.FLOAT32},
    "the operand": lambda op: {"inputs": (0,)},
}


@pytest.mark.parametrize("name", GRIDS)
def test_kernels_on_a_grid_stand_for_the_support_vectors_of_the_model_only(name):
    """A pass that made another grid than the model's gives no expression that a text may have instead."""
    model, grid = on_a_grid()
    assert arithmetic._is_the_same(model, grid)
    (changed,) = (dataclasses.replace(op, **GRIDS[name](op)) for op in grid.ops[1:])
    assert not arithmetic._is_the_same(model, dataclasses.replace(grid, ops=(grid.ops[0], changed)))


def test_support_vectors_that_are_equal_are_one_on_a_grid(tmp_path):
    vectors = np.array([[0.0], [1.0], [1.0], [2.0], [2.0], [2.0]])
    kernel = KernelSum((1,), Kernel.RBF, vectors, np.array([[0.1, 0.2, 0.3, 0.4, 0.5, -0.7]]), np.zeros(1), gamma=0.5)
    model = limit_inputs(model_of(Select((0,), np.array([0])), kernel))
    code = generated(factored(model), "iec", tmp_path)
    assert prove_arithmetic(model, code.project, "FB_M", (0,)).operations > 0


def test_nothing_but_an_rbf_kernel_is_a_product_over_its_columns():
    model, grid = on_a_grid()
    other_kernel = dataclasses.replace(model.ops[1], kernel=Kernel.LINEAR)
    assert not arithmetic._is_the_same(dataclasses.replace(model, ops=(model.ops[0], other_kernel)), grid)
    other_step = dataclasses.replace(model.ops[0], constant=[1.0, 3.0])
    assert not arithmetic._is_the_same(model, dataclasses.replace(grid, ops=(other_step, grid.ops[1])))


@pytest.mark.parametrize("name", ["iadd", "isub", "imul", "imod"])
def test_the_ends_of_integers_are_those_of_all_pairs(name):
    compute = {"iadd": np.add, "isub": np.subtract, "imul": np.multiply, "imod": np.remainder}[name]
    ends = [(low, high) for low in range(-4, 5) for high in range(low, low + 4)]
    for one, other in itertools.product(ends, ends):
        intervals = ((float(low), float(high), False) for low, high in (one, other))
        if name == "imod" and (one[0] < 0 or other[0] != other[1] or other[0] <= 0):
            with pytest.raises(NotProvedError, match="MOD"):
                INTEGER[name](*intervals)
            continue
        pairs = compute.outer(np.arange(one[0], one[1] + 1), np.arange(other[0], other[1] + 1))
        low, high = INTEGER[name](*intervals)
        assert low <= pairs.min() and high >= pairs.max()
        if name == "imod" and one[0] != one[1]:
            assert high <= min(other[0] - 1, one[1])
        else:
            assert (low, high) == (pairs.min(), pairs.max())


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_functions_of_intervals_hold_what_a_controller_may_make_of_them(name):
    """Off by as much as the proof assumes; the ends of a wave as well."""
    low, high = FUNCTIONS[name](0.25, 9.0)
    exact = {"ln": math.log}.get(name) or getattr(math, name)
    for x in (0.25, math.pi / 2, math.pi, 2 * math.pi, 9.0):
        assert low <= exact(x) - abs(exact(x)) * FUNCTION_ERROR
        assert exact(x) + abs(exact(x)) * FUNCTION_ERROR <= high


@pytest.mark.parametrize("seed", range(40))
def test_intervals_hold_what_a_random_expression_computes(seed):
    random = np.random.default_rng(seed)
    terms = Terms()
    ends = np.sort(random.normal(size=(3, 2)) * 3, axis=1)
    pool = [
        (terms.leaf(n, "real", (*end, False)), end[0] + (end[1] - end[0]) * random.random(50))
        for n, end in enumerate(ends.tolist())
    ]
    compute = {
        "add": np.add,
        "sub": np.subtract,
        "mul": np.multiply,
        "div": np.divide,
        "min": np.minimum,
        "max": np.maximum,
        "abs": np.abs,
        "neg": np.negative,
        "exp": np.exp,
        "sqrt": np.sqrt,
        "ln": np.log,
    }
    made = 0
    for _ in range(60):
        name = str(random.choice(list(compute)))
        count = 1 if name in ("abs", "neg", "exp", "sqrt", "ln") else 2
        chosen = [pool[int(random.integers(len(pool)))] for _ in range(count)]
        try:
            term = terms.real(name, *(term for term, _ in chosen))
        except NotProvedError:
            continue
        value = compute[name](*(value for _, value in chosen))
        low, high, nan = terms.interval(term)
        assert not nan
        assert np.all((value >= low) & (value <= high)), (name, low, high, value)
        if max(abs(low), abs(high)) < 1e100:
            pool.append((term, value))
            made += 1
    assert made > 10


def test_a_condition_narrows_what_it_compares_in_its_branch_only():
    terms = Terms()
    x = terms.leaf("x", "real", (-10.0, 10.0, False))
    size = terms.real("abs", x)
    condition = terms.compare("GT", size, 3.0)
    with terms.assuming(condition, False) as reached:
        assert reached
        assert terms.interval(x) == (-3.0, 3.0, False)
    assert terms.interval(x) == (-10.0, 10.0, False)
    with terms.assuming(condition), pytest.raises(NotProvedError, match="division"):
        terms.real("div", 1.0, terms.real("sub", x, 5.0))


def test_a_difference_of_which_only_the_largest_size_is_known_may_be_zero():
    terms = Terms()
    difference = terms.real("sub", terms.leaf("x", "real", (-10.0, 10.0, False)), 2.0)
    near = terms.compare("LT", terms.real("abs", difference), 5.0)
    with terms.assuming(near), pytest.raises(NotProvedError, match="division"):
        terms.real("div", 1.0, difference)


@pytest.mark.parametrize(("side", "expected"), [("GE", (0.25, 2.0)), ("LE", (-2.0, -0.25))])
def test_a_divisor_is_as_far_from_zero_as_is_known_where_zero_ends_its_interval(side, expected):
    terms = Terms()
    x = terms.leaf("x", "real", (-4.0, 4.0, False))
    apart, on_a_side = terms.compare("GT", terms.real("abs", x), 0.5), terms.compare(side, x, 0.0)
    with terms.assuming(apart), terms.assuming(on_a_side):
        assert terms.interval(terms.real("div", 1.0, x))[:2] == pytest.approx(expected)


def test_a_sum_of_more_terms_than_calls_may_be_nested_has_an_interval_again():
    terms = Terms()
    x = terms.leaf("x", "real", (0.0, 1.0, False))
    total = x
    for _ in range(2000):
        total = terms.real("add", total, x)
    with terms.only(x, (1.0, 1.0, False)):
        assert terms.interval(total) == (2001.0, 2001.0, False)


def test_a_sum_without_powers_is_not_looked_through_at_each_of_its_terms(monkeypatch):
    """The proof of 66 support vector machines of 340 vectors each took over four minutes, most of it there."""
    home = importlib.import_module("st_codegen.proof.prove.terms")
    monkeypatch.setattr(home, "_summands", lambda _: pytest.fail("looked through"))
    terms = Terms()
    total = terms.leaf("first", "real", (0.0, 0.25, False))
    for number in range(3):
        total = terms.real("add", total, terms.leaf(number, "real", (0.0, 0.25, False)))
    assert terms.interval(total) == (0.0, 1.0, False)


def test_a_model_that_is_nested_too_deeply_leaves_the_others_their_verdicts(tmp_path, monkeypatch):
    from sklearn.linear_model import Ridge

    prover = importlib.import_module("st_codegen.proof.prove.prove")
    x = np.arange(12.0).reshape(6, 2) ** 2
    bundle = load({name: Ridge().fit(x, x[:, 0]) for name in ("deep", "flat")})
    generate(bundle, "iec", tmp_path)

    def nested(model, *given):
        return nested(model, *given) if model.name == "deep" else prove_arithmetic(model, *given)

    monkeypatch.setattr(prover, "prove_arithmetic", nested)
    deep, flat = prove(bundle, tmp_path).results
    assert (deep.verdict, flat.verdict) == (Verdict.NOT_PROVED, Verdict.PROVED)
    assert "nested too deeply" in deep.reason


def test_comparing_what_may_be_nan_is_not_proved():
    terms = Terms()
    x = terms.leaf("x", "real")
    with pytest.raises(NotProvedError, match="NaN"):
        terms.compare("LT", x, 1.0)
    with terms.assuming(terms.is_number(x)):
        terms.compare("LT", x, 1.0)


@pytest.mark.parametrize("condition", [True, False])
def test_what_holds_anyway_is_assumed_and_the_other_branch_is_not_reached(condition):
    terms = Terms()
    for truth in (True, False):
        with terms.assuming(condition, truth) as reached:
            assert reached is (condition is truth)


def test_an_exponential_below_the_largest_is_one_where_its_cut_lies_below_zero():
    """With a cut at zero the largest itself would count as nothing."""
    terms = Terms()
    x, largest = terms.leaf("x", "real", (-9.0, 9.0, False)), terms.leaf("y", "real", (-9.0, 9.0, False))
    apart = terms.real("sub", x, largest)
    found = [
        _exponent(terms.where(terms.compare("GT", apart, cut), lambda: terms.real("exp", apart), lambda: 0.0))
        for cut in (-0.5, 0.0)
    ]
    assert found == [(x, largest), None]


def test_a_truth_value_that_stands_in_another_many_times_is_looked_at_once():
    """Three splines with refused ends took over four minutes: one condition stands twice in the next."""
    terms = Terms()
    value = terms.leaf("usable", "bool")
    for step in range(80):
        one, other = (terms.leaf(f"{side}{step}", "bool") for side in ("first", "second"))
        value = terms.choice(one, terms.both(value, other), terms.negated(value))
    assert terms.truth(value) is None
    last = value.arguments
    with terms.assuming(terms.leaf("first79", "bool"), False), terms.assuming(last[2], True):
        assert terms.truth(value) is True
