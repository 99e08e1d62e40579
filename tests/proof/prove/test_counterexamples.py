"""Texts that were changed by hand, and the inputs that are named for them."""

import dataclasses
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from st_codegen.cli.main import main
from st_codegen.ir import Activation, Combine, Exceeds, Function, Linear, Operator, Scale, reference
from st_codegen.passes.domain import limit_inputs
from st_codegen.project.bundle import load
from st_codegen.proof.prove.axis import to_keys
from st_codegen.proof.prove.counterexample import counterexample
from st_codegen.proof.prove.disagree import OtherExpressionError, SearchedInputs, differing_rows, evaluated, parts_of
from st_codegen.proof.prove.prove import Verdict, prove
from st_codegen.proof.prove.terms import Terms
from st_codegen.proof.runner import GeneratedCode
from tests.changes import ulp
from tests.emit.test_emitted import generated
from tests.models import model as model_of

GOLDEN = Path(__file__).resolve().parents[3] / "golden" / "lone"


def more(match):
    return match[1] + repr(float(np.float32(match[2]) * 1.0625))


#: A change for each family that shows in the bits of some result.
CHANGES = {
    "svr": (r"(INTERCEPT_\d+ : .*\n\s+)(-?[0-9.]+)", ulp),
    "svr_polynomial": (r"(GAMMA_\d+ : LREAL := )([0-9.E-]+)", ulp),
    "linear_svr": (r"(WEIGHT_\d+ : .*\n(?:\s+\(\*.*\n)?\s+)(-?[0-9.]+)", ulp),
    "ridge": (r"(BIAS_\d+ : .*\n\s+)(-?[0-9.]+)", ulp),
    "mlp_tanh": (r"(WEIGHT_\d+ : .*\n(?:\s+\(\*.*\n)?\s+)(-?[0-9.]+)", ulp),
    "mlp_logistic": (r"fX >= 0\.0", lambda _: "fX >= 1.0"),
    "mlp_relu": (r"MAX\(fX, 0\.0\)", lambda _: "MAX(fX, 0.1)"),
    "onnx_network": (r"(BIAS_\d+ : .*\n\s+)(-?[0-9.]+)", more),
    "xgboost_poisson": (r"(CELL_\d\w* : .*\n(?:\s+\(\*.*\n)?\s+)(-?[0-9.]+)", ulp),
    "lightgbm_linear": (r"(LEAF_COEFFICIENT_1 : .*\n(?:\s+\(\*.*\n)?\s+)(-?[0-9.]+)", more),
}


def changed(tmp_path, name):
    """The models' folder, the generated folder with one block changed, and the block's name."""
    models, out = tmp_path / "models", tmp_path / "out" / "iec"
    models.mkdir()
    out.mkdir(parents=True)
    block = f"FB_{name.capitalize()}"
    shutil.copy(GOLDEN / "generated" / "iec" / "st-codegen.json", out)
    shutil.copy(next((GOLDEN / "models").glob(f"{name}.*")), models)
    pattern, change = CHANGES[name]
    text = (GOLDEN / "generated" / "iec" / f"{block}.st").read_text()
    new, count = re.subn(pattern, change, text, count=1)
    assert count == 1 and new != text
    (out / f"{block}.st").write_text(new)
    return models, tmp_path / "out", block


@pytest.mark.parametrize("name", CHANGES)
def test_an_input_is_named_for_which_the_text_differs(name, tmp_path):
    models, out, block = changed(tmp_path, name)
    (result,) = prove(load(models), out).results
    assert result.verdict is Verdict.REFUTED, result.reason
    example = result.counterexample
    x = np.array([example.input])
    got = GeneratedCode(out / "iec", "iec").run_model(block, x, len(result.outputs))
    assert tuple(got.values[0]) == example.got
    assert example.got != example.expected
    if example.by_expression:
        # what is named is the text's own doing: the text as it was generated gives the model's number there
        original = GeneratedCode(GOLDEN / "generated" / "iec", "iec").run_model(block, x, len(result.outputs))
        assert tuple(original.values[0]) == example.expected


def test_the_command_names_the_input_and_what_the_library_leaves_open(tmp_path, capsys):
    models, out, _ = changed(tmp_path, "ridge")
    with pytest.raises(SystemExit) as end:
        main(["prove", str(models), "--generated", str(out), "--quiet"])
    assert end.value.code == 1
    said = capsys.readouterr().err
    assert "refuted" in said and "differs in operation" in said
    assert "the model's expression is [" in said and "so far the library" in said


def test_the_sign_of_a_zero_that_the_library_leaves_open_refutes_nothing(tmp_path):
    """The formula of the text gives -1E-10 for erf(0): 1E-11 more lies below zero, and its sign comes through."""
    ops = (
        Activation((0,), Function.ERF, 3),
        Scale((1,), Operator.ADD, np.full(3, 1e-11)),
        Exceeds((2,), np.full(3, 0.1)),
        Combine((2, 3), Operator.MULTIPLY, 3),
    )
    tried = limit_inputs(model_of(*ops))
    code, points = generated(tried, "iec", tmp_path), np.zeros((1, 3))
    wanted, found = reference.evaluate(tried, points), code.run_model("FB_M", points, 3)
    assert np.signbit(wanted).tolist() != np.signbit(found.values).tolist() and found.valid.all()
    assert counterexample(tried, code, "FB_M", (0, 1, 2), points) is None


@pytest.mark.parametrize(("answer", "refuted"), [(2.1, False), (3.0, True)])
def test_a_wrong_answer_beyond_a_declared_range_refutes(answer, refuted):
    """The bound was that of the infinite number itself, so that any answer lay within it."""
    made = model_of(Linear((0,), np.array([[2.0]]), np.array([0.1])), features=1)
    made = dataclasses.replace(made, features=(dataclasses.replace(made.features[0], lower=0.0, upper=1.0),))
    result = SimpleNamespace(values=np.array([[answer]]), valid=np.array([True]))
    code = SimpleNamespace(run_model=lambda *_: result)
    assert (counterexample(made, code, "FB_M", (0,), np.array([[np.inf]])) is not None) == refuted


@pytest.mark.parametrize(
    ("functions", "refused"),
    [
        ((Function.TANH,), np.nan),
        ((Function.TANH, Function.LOG), -5.0),
        ((Function.TANH, Function.SQRT), -2.0),
    ],
)
def test_an_answer_where_the_model_has_none_refutes_however_wide_its_bound(functions, refused):
    ops = [Activation((number,), function, 1) for number, function in enumerate(functions)]
    made = limit_inputs(model_of(*ops, features=1))
    result = SimpleNamespace(values=np.array([[0.5]]), valid=np.array([True]))
    code, points = SimpleNamespace(run_model=lambda *_: result), np.array([[refused]])
    assert np.isnan(reference.evaluate(made, points)).all()
    assert counterexample(made, code, "FB_M", (0,), points) is not None


def test_where_no_input_shows_a_difference_it_is_said(tmp_path):
    models, out, block = changed(tmp_path, "svr")
    path = out / "iec" / f"{block}.st"
    text = (GOLDEN / "generated" / "iec" / f"{block}.st").read_text()
    path.write_text(text.replace("-GAMMA_", "0.0 - GAMMA_", 1))
    (result,) = prove(load(models), out).results
    assert result.verdict is Verdict.NOT_PROVED
    assert "differs in operation" in result.reason and result.reason.endswith("no input was found that shows it")


def leaves_of(value):
    return [term for term in parts_of([value]) if term.operation == "leaf"]


def rows_of(got, wanted, low=-1e6, high=1e6):
    leaves = [*leaves_of(got), *leaves_of(wanted)]
    keys = to_keys(np.array([low, high]))
    inputs = SearchedInputs(keys[:1], keys[1:], lambda x: dict.fromkeys(leaves, x[:, 0]))
    return differing_rows(OtherExpressionError("", [got], [wanted], inputs))


def test_a_comparison_that_differs_in_one_number_is_found_there():
    terms = Terms()
    x = terms.leaf(("input", 0), "real", (-1e6, 1e6, False))
    score = terms.real("add", terms.real("mul", x, 3.0), -0.75)
    one = terms.where(terms.compare("GT", score, 0.375), lambda: 1.0, lambda: 0.0)
    other = terms.where(terms.compare("GE", score, 0.375), lambda: 1.0, lambda: 0.0)
    found = rows_of(one, other)
    assert found.tolist() and set((found * 3.0 - 0.75).ravel()) == {0.375}


def test_equal_expressions_have_no_row_and_are_evaluated_as_they_are_written():
    terms = Terms()
    x = terms.leaf(("input", 0), "real", (-1e6, 1e6, False))
    one = terms.real("sub", terms.real("mul", x, 2.0), 0.0)
    assert not len(rows_of(one, terms.real("mul", x, 2.0)))
    (value,) = evaluated([terms.real("exp", terms.real("neg", terms.real("abs", x)))], {x: np.array([0.0, 1.0])}, 2)
    assert value.tolist() == [1.0, float(np.exp(-1.0))]


def test_an_input_whose_range_has_none_of_the_numbers_is_searched():
    terms = Terms()
    x = terms.leaf(("input", 0), "real", (5.0, 6.0, False))
    found = rows_of(terms.real("mul", x, 3.0), terms.real("mul", x, 4.0), low=5.0, high=6.0)
    assert len(found) and found.min() >= 5.0 and found.max() <= 6.0
