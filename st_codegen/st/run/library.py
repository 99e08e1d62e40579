"""Libraries of TwinCAT for the engine: what test suites use of TcUnit and Tc2_Standard, and a clock of Tc2_System."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.st.run.natives import Host, Library, NativeBlock, NativeCall

_EXACT_TYPES = (
    *("BOOL", "BYTE", "WORD", "DWORD", "LWORD", "SINT", "INT", "DINT", "LINT"),
    *("USINT", "UINT", "UDINT", "ULINT", "TIME", "STRING"),
)
_ASSERT = (
    "METHOD AssertEquals_{0} VAR_INPUT Expected : {0}; Actual : {0};{1} Message : STRING(255); END_VAR END_METHOD\n"
)
_ASSERTS = "".join(_ASSERT.format(name, "") for name in _EXACT_TYPES)
_ASSERTS += "".join(_ASSERT.format(name, f" Delta : {name};") for name in ("REAL", "LREAL"))
_TCUNIT = f"""
FUNCTION_BLOCK FB_TestSuite
METHOD TEST VAR_INPUT TestName : STRING(255); END_VAR END_METHOD
METHOD TEST_FINISHED END_METHOD
METHOD TEST_FINISHED_NAMED VAR_INPUT TestName : STRING(255); END_VAR END_METHOD
METHOD AssertTrue VAR_INPUT Condition : BOOL; Message : STRING(255); END_VAR END_METHOD
METHOD AssertFalse VAR_INPUT Condition : BOOL; Message : STRING(255); END_VAR END_METHOD
{_ASSERTS}END_FUNCTION_BLOCK
FUNCTION RUN END_FUNCTION
"""


@dataclass(frozen=True)
class FailedAssertion:
    """An assertion of a test suite that did not hold."""

    test: str
    row: int
    expected: object
    actual: object
    message: str


class TestSuite(NativeBlock):
    """FB_TestSuite: `tests` are the names of the tests that ran, `finished` those that said so, `failures` in order."""

    __test__ = False

    def __init__(self, machine: Host) -> None:
        super().__init__(machine)
        self.tests: list[str] = []
        self.finished: set[str] = set()
        self.failures: list[FailedAssertion] = []
        self._current: NDArray[Any] = np.full(machine.row_count, "", dtype=object)

    def TEST(self, call: NativeCall) -> None:  # noqa: N802 - the name of the library
        """Begin a test."""
        names = call["TESTNAME"]
        self._current[call.rows] = names
        self.tests += [name for name in dict.fromkeys(names) if name not in self.tests]

    def TEST_FINISHED(self, call: NativeCall) -> None:  # noqa: N802
        """End the current test."""
        self.finished |= set(self._current[call.rows])

    def TEST_FINISHED_NAMED(self, call: NativeCall) -> None:  # noqa: N802
        """End a test by its name."""
        self.finished |= set(call["TESTNAME"])

    def _note(self, call: NativeCall, holds: Any, expected: Any, actual: Any) -> None:
        for index in np.flatnonzero(~np.asarray(holds, np.bool_)):
            row = int(call.rows[index])
            values = (expected[index], actual[index], str(call["MESSAGE"][index]))
            self.failures.append(FailedAssertion(str(self._current[row]), row, *values))

    def AssertTrue(self, call: NativeCall) -> None:  # noqa: N802
        """Note a condition that does not hold."""
        condition = call["CONDITION"]
        self._note(call, condition, np.ones_like(condition), condition)

    def AssertFalse(self, call: NativeCall) -> None:  # noqa: N802
        """Note a condition that holds."""
        condition = call["CONDITION"]
        self._note(call, ~condition, np.zeros_like(condition), condition)

    def assert_equals(self, call: NativeCall) -> None:
        """Note values that differ, for types that are compared exactly."""
        expected, actual = call["EXPECTED"], call["ACTUAL"]
        self._note(call, expected == actual, expected, actual)

    def assert_close(self, call: NativeCall) -> None:
        """Note values that differ by more than the delta; a NaN differs from everything."""
        expected, actual = call["EXPECTED"], call["ACTUAL"]
        with np.errstate(invalid="ignore"):
            holds = (expected == actual) | (np.abs(expected - actual) <= call["DELTA"])
        self._note(call, holds, expected, actual)


for _name in _EXACT_TYPES:
    setattr(TestSuite, f"AssertEquals_{_name}", TestSuite.assert_equals)
for _name in ("REAL", "LREAL"):
    setattr(TestSuite, f"AssertEquals_{_name}", TestSuite.assert_close)


def _run_suites(call: NativeCall) -> None:
    """RUN: one cycle of all test suites."""
    for native in list(call.machine.natives):
        if isinstance(native, TestSuite):
            for row in call.rows:
                call.machine.run_body(native, int(row))


TCUNIT = Library("TcUnit", _TCUNIT, blocks={"FB_TestSuite": TestSuite}, functions={"RUN": _run_suites})

_TC2_STANDARD = """
FUNCTION CONCAT : STRING(255) VAR_INPUT STR1 : STRING(255); STR2 : STRING(255); END_VAR END_FUNCTION
FUNCTION DINT_TO_STRING : STRING(80) VAR_INPUT IN : DINT; END_VAR END_FUNCTION
"""


def _concat(call: NativeCall) -> None:
    """CONCAT: both texts, cut after 255 characters."""
    call["CONCAT"] = np.array([f"{a}{b}"[:255] for a, b in zip(call["STR1"], call["STR2"], strict=True)], dtype=object)


def _dint_to_string(call: NativeCall) -> None:
    """DINT_TO_STRING: the digits, with a sign where the number is negative."""
    call["DINT_TO_STRING"] = np.array([str(int(number)) for number in call["IN"]], dtype=object)


TC2_STANDARD = Library("Tc2_Standard", _TC2_STANDARD, functions={"CONCAT": _concat, "DINT_TO_STRING": _dint_to_string})

_TC2_SYSTEM = """
FUNCTION_BLOCK GETCPUCOUNTER
VAR_OUTPUT cpuCntLoDW : UDINT; cpuCntHiDW : UDINT; END_VAR
END_FUNCTION_BLOCK
"""


class CpuCounter(NativeBlock):
    """GETCPUCOUNTER: the clock of this machine in units of 100 ns, as two halves of 64 bits."""

    def body(self, call: NativeCall) -> None:
        now = time.perf_counter_ns() // 100
        call["CPUCNTLODW"] = np.full(len(call.rows), now & 0xFFFFFFFF, np.uint32)
        call["CPUCNTHIDW"] = np.full(len(call.rows), now >> 32, np.uint32)


TC2_SYSTEM = Library("Tc2_System", _TC2_SYSTEM, blocks={"GETCPUCOUNTER": CpuCounter})
