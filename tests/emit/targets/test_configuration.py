"""--with-configuration: one portable file that says itself what runs it, read back and executed."""

from pathlib import Path

import numpy as np
import pytest

from st_codegen.driver import generate
from st_codegen.errors import TargetError
from st_codegen.project.bundle import load
from st_codegen.proof.predict import read_table
from st_codegen.proof.verify import verify
from st_codegen.st import Machine, StCheckError, load_project, parse_project
from st_codegen.st.syntax.declarations import ConfigurationDeclaration
from st_codegen.st.syntax.source import read_paths
from tests.st.helpers import violations

GOLDEN = Path(__file__).resolve().parents[3] / "golden"
TASK = "TASK Main(INTERVAL := T#1ms, PRIORITY := 1);"
RUN = "PROGRAM Run WITH Main : P;"


def generated(models, out):
    """The only file, its configuration, and a machine with its programs."""
    (path,) = generate(models, "iec", out, with_configuration=True).folder.glob("*.st")
    source = read_paths([path])
    assert violations(source) == ()
    (configuration,) = (item for item in source.declarations if isinstance(item, ConfigurationDeclaration))
    called = [(run.task, run.program) for run in configuration.programs]
    return configuration, called, Machine(load_project([path], "iec"), 1)


def test_lone_models_are_called_with_the_inputs_of_a_program(tmp_path):
    models = load(GOLDEN / "lone" / "models" / "decision_tree.skops")
    configuration, called, machine = generated(models, tmp_path)
    assert called == [("PlcTask", "PRG_SelfTest"), ("PlcTask", "PRG_Models")]
    assert configuration.tasks[0].interval.value == 10_000_000
    program, test = machine.program("PRG_Models"), machine.program("PRG_SelfTest")
    table = read_table(GOLDEN / "lone" / "inputs" / "decision_tree.csv")
    expected = np.column_stack(list(read_table(GOLDEN / "lone" / "outputs" / "decision_tree.csv").values()))
    for row in range(5):
        for name, column in table.items():
            program[f"f{name.capitalize()}_Decision_tree"] = float(column[row])
        program()
        assert (program["fOut1_Decision_tree"], program["bValid_Decision_tree"]) == (expected[row, 0], True)
    test()
    assert (test["bPassed_SelfTest"], test["nFaults_SelfTest"]) == (True, 0)
    assert verify(models, tmp_path, rows=100).passed


def test_a_bundle_runs_its_own_programs(tmp_path):
    configuration, called, machine = generated(load(GOLDEN / "bundle" / "models"), tmp_path)
    assert called == [("PlcTask", name) for name in ("PRG_SelfTest", "PRG_Experiment", "PRG_Main")]
    assert configuration.tasks[0].interval.value == 500_000
    for _, name in called:
        machine.program(name)()


def test_other_targets_have_tasks_of_their_own(tmp_path):
    models = GOLDEN / "lone" / "models" / "decision_tree.skops"
    for target in ("twincat", "plcopen", "beckhoff-ml"):
        with pytest.raises(TargetError, match=f"target {target} has .*; --with-configuration goes with iec"):
            generate(models, target, tmp_path, with_configuration=True)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("task", "run", "message"),
    [
        (TASK.replace("T#1ms", "T#0ms"), RUN, "needs a time above zero"),
        (TASK.replace("T#1ms", "1"), RUN, "needs a time above zero"),
        (TASK.replace(":= 1)", ":= 1.5)"), RUN, "is no whole number"),
        (TASK, RUN.replace(": P;", ": Q;"), "there is no program 'Q'"),
        (TASK, RUN.replace("WITH Main", "WITH Other"), "there is no task 'Other'"),
    ],
)
def test_a_configuration_that_nothing_can_run_is_refused(task, run, message):
    text = "PROGRAM P END_PROGRAM CONFIGURATION C RESOURCE R ON PLC {} {} END_RESOURCE END_CONFIGURATION"
    parse_project({"a.st": text.format(TASK, RUN)}, "iec")
    with pytest.raises(StCheckError, match=message):
        parse_project({"a.st": text.format(task, run)}, "iec")
