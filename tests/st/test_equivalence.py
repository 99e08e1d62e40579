"""Lanes and single values give the same bits: random programs on random inputs."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as s

from st_codegen.st import LaneMachine, ScalarMachine, StCheckError, StRuntimeError, parse_project
from tests.st.programs import programs

LANES = 6
LOOP_LIMIT = 60
REALS = s.one_of(s.sampled_from([0.0, -0.0, 1.0, -1.0, 1e308, 5e-324, 0.5]), s.floats(-10, 10), s.floats())
INTEGERS = s.one_of(s.integers(-6, 6), s.sampled_from([2**31 - 1, -(2**31)]))
ROWS = s.lists(s.tuples(REALS, REALS, INTEGERS, INTEGERS, s.booleans()), min_size=LANES, max_size=LANES)
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


def bits(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: bits(part) for name, part in value.items()}
    if isinstance(value, np.ndarray):
        return value.tobytes()
    return struct.pack("<d", value) if isinstance(value, float) else value


def lane_of(value: Any, lane: int) -> Any:
    if isinstance(value, dict):
        return {name: lane_of(part, lane) for name, part in value.items()}
    part = value[lane]
    return part if isinstance(part, np.ndarray) else part.item()


@settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
@given(programs(), ROWS, ROWS)
def test_lanes_equal_single_values(program: str, first: list[Any], second: list[Any]) -> None:
    try:
        project = parse_project({"p.st": program}, "twincat")
    except StCheckError as error:
        # The one thing the generator of programs does not avoid
        assume("conversion out of range" not in str(error))
        raise
    block = LaneMachine(project, LANES, loop_limit=LOOP_LIMIT).instance("FB_Test")
    failure: StRuntimeError | None = None
    completed = 0
    for rows in (first, second):
        columns = dict(zip(NAMES, zip(*rows, strict=True), strict=True))
        try:
            block(**{name: np.array(column) for name, column in columns.items()})
        except StRuntimeError as error:
            failure = error
            break
        completed += 1
    machine = ScalarMachine(project, loop_limit=LOOP_LIMIT)
    for lane in range(LANES):
        single = machine.instance("FB_Test")
        rows = [first[lane], second[lane]]
        try:
            for row in rows[: completed + 1]:
                single(**dict(zip(NAMES, row, strict=True)))
        except StRuntimeError as error:
            assert failure is not None, f"only the single value fails: {error}"
            if lane == failure.lane:
                assert error.position.line == failure.position.line, (error, failure)
            continue
        assert failure is None or failure.lane != lane, f"only the lane fails: {failure}"
        if failure is None:
            for name in STATE:
                assert bits(lane_of(block[name], lane)) == bits(single[name]), name


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
    machine = ScalarMachine(parse_project({"p.st": program}, "twincat"))
    results = []
    for index in (0, 1, 2, 7):
        block = machine.instance("FB_Test")
        block(nA=index)
        results.append(block["nOut"])
    assert results == [3, 2, 2, 1]
