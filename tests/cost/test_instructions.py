"""The model against what a processor does: operations counted on the text, instructions counted by callgrind.

The golden models are translated to C by the translator of the benchmarks and compiled without optimisation, which keeps
variables in memory as compilers of controllers do. Measured with gcc 12 on the 37 golden models: 1.8 to 2.8
instructions for each operation of the worst path, correlation of the logarithms 0.99. The bounds below leave room for
other compilers, not for a wrong count: a loop forgotten or counted twice is a factor of the number of its rounds.
"""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from benchmarks.contenders import Built
from benchmarks.harness import Harness
from benchmarks.st_to_c import ports, translate
from st_codegen.cost.profile import load_profile
from st_codegen.cost.report import project_cost
from st_codegen.st import load_project

GOLDEN = Path(__file__).resolve().parent.parent.parent / "golden" / "lone"
MODELS = ("extra_trees", "hist_gradient_boosting_category", "lightgbm_linear", "mlp_tanh", "svr")


@pytest.mark.skipif(shutil.which("valgrind") is None, reason="needs valgrind: apt-get install valgrind")
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc: apt-get install gcc")
def test_operations_go_with_instructions(tmp_path):
    project = load_project([GOLDEN / "generated" / "twincat"], "twincat")
    costs = project_cost(project, load_profile())
    harness = Harness(tmp_path)
    operations, instructions = [], []
    for model in MODELS:
        block = f"FB_{model.capitalize()}"
        (tmp_path / "model.c").write_text(translate(project, block, "race"))
        library = tmp_path / f"{model}.so"
        subprocess.run(["gcc", "-O0", "-w", "-shared", "-fPIC", "-o", library, tmp_path / "model.c", "-lm"], check=True)
        rows = np.genfromtxt(GOLDEN / "inputs" / f"{model}.csv", delimiter=",", skip_header=1)
        rows = rows[np.isfinite(rows).all(axis=1)]
        inputs, outputs = ports(project, block)
        assert rows.shape[1] == inputs
        instructions.append(harness.instructions(Built(0.0, library=library, outputs=outputs), rows, tmp_path))
        operations.append(sum(costs.blocks[block].operations.values()))
    ratio = np.array(instructions) / np.array(operations)
    assert np.corrcoef(np.log(operations), np.log(instructions))[0, 1] > 0.97
    assert ratio.min() > 1.2
    assert ratio.max() < 4.0
