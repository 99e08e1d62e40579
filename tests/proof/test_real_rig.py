"""Models trained on the table measured on the real rig: ten families, and the bundle of 38 models of the paper.

The table stands beside the checkout, not in it.
"""

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.emit.blocks.model import block_name
from st_codegen.emit.targets import TARGETS
from st_codegen.errors import TargetError
from st_codegen.passes.domain import limit_inputs
from st_codegen.project.bundle import Bundle, load
from st_codegen.proof.probes import probe_rows
from st_codegen.proof.verify import verify
from st_codegen.walkers.base import LoadedModel
from st_codegen.walkers.objects import from_estimator
from tests.families import SHARED, families, harmonic_table, write_bundle

pytestmark = [
    pytest.mark.skipif(
        not SHARED.is_dir(), reason=f"the measured tables are not here ({SHARED.name}/ beside the checkout)"
    ),
    pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning"),
]
pytest.importorskip("sklearn")
pytest.importorskip("lightgbm")
pytest.importorskip("xgboost")

TREES = {"rf", "dt", "et", "ert", "gbm", "hgbm", "lgbm", "xgbm"}


@pytest.mark.thorough
# few rows in the quick suite; `make real` takes the many
@pytest.mark.parametrize("rows", [2_000, pytest.param(100_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("family", sorted(TREES | {"svr", "mlp"}))
def test_every_family_is_verified(family, rows, tmp_path):
    x, columns = harmonic_table("forward")
    loaded = from_estimator(families()[family].fit(x, columns["A39"]), family)
    bundle = Bundle((LoadedModel(limit_inputs(loaded.ir), loaded.predict),), None)
    generate(bundle, TARGETS["twincat"], tmp_path)
    report = verify(bundle, tmp_path, rows=rows)
    (model,) = report.models
    assert report.passed, model.failures
    assert model.n >= rows
    assert model.must_be_exact == (family in TREES)
    if family in TREES:
        assert model.exact
        assert model.max_ulp == 0
    else:
        assert model.max_abs_err <= model.bound < 1e-9
    # every threshold and both its neighbours are among the inputs
    probes = probe_rows(bundle.models[0].ir, rows)
    if family in TREES:
        op = bundle.models[0].ir.ops[0]
        for number, column in enumerate(op.columns):
            thresholds = np.unique(op.threshold[op.split == number])
            if not len(thresholds):
                continue
            for points in (thresholds, np.nextafter(thresholds, np.inf), np.nextafter(thresholds, -np.inf)):
                assert np.isin(points, probes[:, column.column]).all()


@pytest.mark.slow
def test_the_bundle_of_the_paper_is_compiled_and_verified(tmp_path):
    write_bundle(tmp_path / "models")
    bundle = load(tmp_path / "models", trust_pickle=True)
    assert len(bundle.models) == 38
    generated = [generate(bundle, target, tmp_path / "out") for name, target in TARGETS.items() if name != "scl"]
    with pytest.raises(TargetError, match=r"tables take 10,\d+,\d+ bytes, the limit of the target scl is 1,048,576"):
        generate(bundle, "scl", tmp_path / "out")
    names = {path.stem for path in (tmp_path / "out" / "twincat" / "POUs").iterdir()}
    compiled = generated[0].compiled
    blocks = {block_name(compiled.locations[model.ir.name].model) for model in bundle.models}
    assert names >= blocks | {"FB_TEPredict", "FB_Compensator"}
    # what splits at the grid of the campaign becomes tables, and few searches serve them all; random splits stay trees
    layouts = {
        model.ir.name: decision.chosen for model, decision in zip(bundle.models, compiled.decisions, strict=True)
    }
    assert {layouts[f"{name}_forward"] for name in ("phi1", "A3", "phi39", "A81", "phi156")} == {"table"}
    assert layouts["A162_forward"] == "cut trees"
    assert len(blocks) < 20
    report = verify(bundle, tmp_path / "out", rows=1_000)
    assert report.passed, [model.failures for model in report.models if not model.passed]
