"""The model against what a processor does: the worst case by operations bounds the instructions that are executed.

The text is translated to C by the translator of the benchmarks and compiled without optimisation, which keeps variables
in memory as compilers of controllers do.
"""

import re
import shutil
import subprocess

import pytest

from benchmarks import bound
from benchmarks.st_to_c import translate
from st_codegen.cost.operations import as_mapping
from tests.cost.helpers import VARIABLES, block, project, unit

pytestmark = [
    pytest.mark.skipif(shutil.which("valgrind") is None, reason="needs valgrind: apt-get install valgrind"),
    pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc: apt-get install gcc"),
]

#: Single statements. Generated text has arrays of one dimension; statements of several parts are left to whole blocks.
STATEMENTS = """
x := y; | i := n; | b := c; | x := 1.5; | x := x + y; | x := x * y; | x := x / y; | i := n + m; | i := n * m;
i := n / m; | i := n / 2; | i := n MOD m; | b := NOT c; | b := b AND c; | x := -y; | i := -n; | x := a[i]; | a[i] := y;
b := y > x; | b := n = m; | IF b THEN x := y; END_IF; | IF y > 2.5 THEN n := 3; END_IF;
x := MIN(y, x); | i := MAX(n, m); | x := LIMIT(y, x, y); | x := SEL(b, x, y); | x := DINT_TO_LREAL(n);
r := LREAL_TO_REAL(y); | x := REAL_TO_LREAL(r); | i := TRUNC(x); | i := BOOL_TO_DINT(b); | x := ABS(y);
i := DWORD_TO_DINT(DINT_TO_DWORD(n) AND DWORD#16#7);
"""


def instructions(body):
    """How many instructions the block has."""
    code = translate(project(block(body, VARIABLES)), "FB_T", "race")
    command = ["gcc", "-O0", "-w", "-S", "-x", "c", "-", "-o", "-"]
    text = subprocess.run(command, input=code, capture_output=True, text=True, check=True).stdout
    text = text[text.index("\nFB_T:") :]
    return len(re.findall(r"^\t[a-z]", text[: text.index(".cfi_endproc")], re.MULTILINE))


def test_no_operation_takes_more_instructions_than_the_table_says():
    empty = instructions("")
    for statement in re.split(r" \| |\n", STATEMENTS.strip()):
        took = instructions(statement) - empty
        counts = as_mapping(unit(statement).cost.total)
        assert 0 < took <= sum(bound.INSTRUCTIONS[name] * number for name, number in counts.items()), statement


def test_the_worst_case_is_a_bound_and_not_a_loose_one():
    found = bound.bounds_of(["extra_tree", "hist_gradient_boosting_missing"], n_rows=12, rounds=0)
    assert [each.block for each in found] == ["FB_Extra_tree", "FB_Hist_gradient_boosting_missing"]
    assert all(each.holds for each in found), found


@pytest.mark.slow
def test_the_bounds_of_all_golden_models(capsys):
    with capsys.disabled():
        assert bound.main([]) == 0
