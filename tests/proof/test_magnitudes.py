"""Where a library answers, the block answers, too, unless its header states a limit: numbers of every magnitude."""

import math
from pathlib import Path

import numpy as np
import pytest

from st_codegen.emit.blocks.model import limit_text, model_header
from st_codegen.errors import InputError
from st_codegen.ir import Rank, Round, Select, TreeEnsemble, reference
from st_codegen.passes.domain import limit_inputs
from st_codegen.project.bundle import load
from st_codegen.proof import bounds
from tests.walkers import onnx_builders

pytest.importorskip("skops")
pytest.importorskip("lightgbm")
pytest.importorskip("xgboost")
pytest.importorskip("onnxruntime")

LONE = Path(__file__).resolve().parents[2] / "golden" / "lone" / "models"
MAGNITUDES = [2147483647.0, 2147483648.0, 1e19, 1e35, 3e38, 3.5e38, 1e150, 1e300, float(np.finfo(float).max), math.inf]
NUMBERS = [sign * magnitude for magnitude in MAGNITUDES for sign in (1.0, -1.0)]
#: Operations that compute nothing with the inputs, so that nothing can overflow.
COMPARING = (Rank, Round, Select, TreeEnsemble)


def answers(model, x):
    """The library's answers row by row, NaN where it refuses."""
    found = np.full((len(x), len(model.ir.outputs)), np.nan)
    for number, row in enumerate(x):
        try:
            with np.errstate(all="ignore"):
                found[number] = model.predict(row[None])
        except (ValueError, InputError):
            continue
    return found


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", sorted(path.name for path in LONE.iterdir()))
def test_a_block_refuses_only_what_its_library_or_its_header_refuses(name):
    (model,) = load(LONE / name).models
    ir = model.ir
    width = len(ir.features)
    x = np.full((width * len(NUMBERS), width), 0.7)
    x[np.arange(len(x)), np.repeat(np.arange(width), len(NUMBERS))] = NUMBERS * width
    library, block = answers(model, x), reference.evaluate(ir, x)
    answered, given = (np.isfinite(values).all(axis=1) for values in (library, block))
    limits = np.array([np.nan if limit is None else limit for limit in ir.magnitude_limits])
    stated = np.any(np.abs(x) >= limits, axis=1)
    assert not np.any(answered & ~given & ~stated)
    assert not np.any(given & stated)
    both = answered & given
    assert np.all(np.abs(library - block)[both] <= bounds.difference_bound(ir, x)[both])
    if all(isinstance(op, COMPARING) and getattr(op, "linear", None) is None for op in ir.ops):
        assert np.array_equal(answered, given)
    header = " ".join(" ".join(model_header(ir)).split())  # long lines are broken
    assert all(limit_text(limit) in header for limit in ir.magnitude_limits if limit is not None)


@pytest.mark.filterwarnings("ignore")
def test_two_layers_of_exponentials_answer_where_onnxruntime_does(tmp_path):
    helper = pytest.importorskip("onnx").helper
    weights = ([[0.5, -0.25], [0.125, 0.5]], [[0.1, 0.02], [0.05, 0.1]], [[1.0], [-2.0]])
    constants = [onnx_builders.constant(f"W{number}", values) for number, values in enumerate(weights)]
    nodes = [
        helper.make_node("MatMul", ["X", "W0"], ["a"]),
        helper.make_node("Exp", ["a"], ["b"]),
        helper.make_node("MatMul", ["b", "W1"], ["c"]),
        helper.make_node("Exp", ["c"], ["d"]),
        helper.make_node("MatMul", ["d", "W2"], ["Y"]),
    ]
    info = onnx_builders.info
    graph = onnx_builders.graph_model(nodes, [info("X", (None, 2))], [info("Y", (None, 1))], constants)
    model = onnx_builders.load(graph, tmp_path)
    ir = limit_inputs(model.ir)
    numbers = [-1e30, -1e4, -100.0, -20.0, -5.0, -1.0, 0.0, 1.0, 5.0, 9.0, 12.0, 100.0]
    x = np.stack(np.meshgrid(numbers, numbers), -1).reshape(-1, 2)
    library, block = answers(model, x), reference.evaluate(ir, x)
    with np.errstate(all="ignore"):
        largest = np.max(np.exp(x @ np.array(weights[0])) @ np.array(weights[1]), axis=1)
    moderate = np.isfinite(library[:, 0]) & (largest < 87.0)  # e**88.7 is the largest REAL
    assert moderate.sum() > 40
    assert np.isfinite(block[moderate]).all()
    finite = np.isfinite(block[:, 0])
    assert np.all(np.abs(library - block)[finite] <= bounds.difference_bound(ir, x)[finite])
