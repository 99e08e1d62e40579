"""The engine against a plain evaluator of the tree: random programs on random inputs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given
from hypothesis import strategies as s

from st_codegen.st import Machine, StCheckError, StRuntimeError, parse_project
from st_codegen.st.types import BlockType
from tests.examples import examples
from tests.st.evaluator import Evaluator, Instance, StoppedError, bits
from tests.st.programs import programs

ROWS = 6
LOOP_LIMIT = 60
REALS = s.one_of(s.sampled_from([0.0, -0.0, 1.0, -1.0, 1e308, 5e-324, 0.5]), s.floats(-10, 10), s.floats())
INTEGERS = s.one_of(s.integers(-6, 6), s.sampled_from([2**31 - 1, -(2**31)]))
INPUTS = s.lists(s.tuples(REALS, REALS, INTEGERS, INTEGERS, s.booleans()), min_size=ROWS, max_size=ROWS)
NAMES = ("fA", "fB", "nA", "nB", "bA")
STATE = (
    "fX",
    "fY",
    "rX",
    "nX",
    "nY",
    "nS",
    "nU",
    "nL",
    "bX",
    "bZ",
    "wX",
    "dX",
    "eX",
    "aF",
    "aN",
    "n",
    "i",
    "j",
    "stP",
    "uB",
)
STATE += ("aP[0]", "aP[1]", "aP[2]", "fbA.fOut", "fbA.nCalls", "fbD.fOut", "fbD.nCalls", "fbD.fLast", "aB[0].nCalls")


def row_of(value: Any, row: int) -> Any:
    if isinstance(value, dict):
        return {name: row_of(part, row) for name, part in value.items()}
    part = value[row]
    return part if isinstance(part, np.ndarray) else part.item()


def at(instance: Instance, path: str) -> Any:
    """A variable of the evaluator by its path."""
    value: Any = instance
    for part in path.upper().replace("[", ".").replace("]", "").split("."):
        value = value[int(part) if part.isdigit() else part]
    return value


@pytest.mark.thorough
@examples(suppress_health_check=list(HealthCheck))
@given(programs(), INPUTS, INPUTS)
def test_the_engine_does_what_the_tree_says(program: str, first: list[Any], second: list[Any]) -> None:
    """Rows and one copy, against a walk through the tree: state, faults, their places and operands."""
    try:
        project = parse_project({"p.st": program}, "twincat")
    except StCheckError as error:
        # The one thing the generator of programs does not avoid
        assume("conversion out of range" not in str(error))
        raise
    evaluator = Evaluator(project, LOOP_LIMIT)
    expected = [evaluator.make(BlockType("FB_Test"), {}) for _ in range(ROWS)]
    many = Machine(project, ROWS, loop_limit=LOOP_LIMIT).instance("FB_Test")
    machine = Machine(project, loop_limit=LOOP_LIMIT)
    single = [machine.instance("FB_Test") for _ in range(ROWS)]
    for rows in (first, second):
        columns = dict(zip(NAMES, zip(*rows, strict=True), strict=True))
        stopped: list[tuple[int, StoppedError]] = []
        for row, values in enumerate(rows):
            expected[row].update(zip(map(str.upper, NAMES), values, strict=True))
            given_ = dict(zip(NAMES, values, strict=True))
            try:
                evaluator.run(expected[row])
            except StoppedError as fault:
                stopped.append((row, fault))
                with pytest.raises(StRuntimeError) as caught:
                    single[row](**given_)
                assert same_fault(fault, caught.value)
            else:
                single[row](**given_)
        inputs = {name: np.array(column) for name, column in columns.items()}
        if stopped:
            with pytest.raises(StRuntimeError) as caught:
                many(**inputs)
            assert caught.value.row == stopped[0][0]
            assert same_fault(stopped[0][1], caught.value)
            return
        many(**inputs)
        for row in range(ROWS):
            for name in STATE:
                wanted = bits(at(expected[row], name))
                assert bits(single[row][name]) == wanted, name
                assert bits(row_of(many[name], row)) == wanted, name


def same_fault(fault: StoppedError, error: StRuntimeError) -> bool:
    assert (error.kind, error.position) == (fault.kind, fault.position), (error, fault)
    assert bits(list(error.operands)) == bits(list(fault.operands)), (error, fault)
    return True


def test_a_table_read_by_a_later_condition_is_loaded_where_it_is_needed() -> None:
    program = """FUNCTION_BLOCK FB_Test
VAR_INPUT nA : DINT; END_VAR
VAR_OUTPUT nOut : DINT; END_VAR
VAR CONSTANT TABLE : ARRAY[0..2] OF LREAL := [0.25, 1.0, 0.75]; END_VAR
IF nA = 7 THEN
    nOut := 1;
ELSIF TABLE[nA] > 0.5 THEN
    nOut := 2;
ELSIF TABLE[nA] < 0.5 THEN
    nOut := 3;
END_IF;
END_FUNCTION_BLOCK
"""
    machine = Machine(parse_project({"p.st": program}, "twincat"))
    results = []
    for index in (0, 1, 2, 7):
        block = machine.instance("FB_Test")
        block(nA=index)
        results.append(block["nOut"])
    assert results == [3, 2, 2, 1]
