"""Libraries for TwinCAT projects: timers and edges of Tc2_Standard, and the part of TcUnit that test suites use."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from st_codegen.st.run.natives import Host, Library, NativeBlock, NativeCall

_TIMER = """
FUNCTION_BLOCK {name}
VAR_INPUT IN : BOOL; PT : TIME; END_VAR
VAR_OUTPUT Q : BOOL; ET : TIME; END_VAR
END_FUNCTION_BLOCK
"""
_EDGES = """
FUNCTION_BLOCK R_TRIG
VAR_INPUT CLK : BOOL; END_VAR
VAR_OUTPUT Q : BOOL; END_VAR
VAR bLast : BOOL; END_VAR
Q := CLK AND NOT bLast;
bLast := CLK;
END_FUNCTION_BLOCK
FUNCTION_BLOCK F_TRIG
VAR_INPUT CLK : BOOL; END_VAR
VAR_OUTPUT Q : BOOL; END_VAR
VAR bLast : BOOL := FALSE; END_VAR
Q := NOT CLK AND bLast;
bLast := CLK;
END_FUNCTION_BLOCK
"""


class Timer(NativeBlock):
    """Base of the timers: when each row started to count."""

    def __init__(self, machine: Host) -> None:
        super().__init__(machine)
        self.start = np.zeros(machine.row_count, np.int64)
        self.is_counting = np.zeros(machine.row_count, np.bool_)

    def elapsed(self, call: NativeCall, begins: NDArray[np.bool_], stops: NDArray[np.bool_]) -> Any:
        """The time since each row began, in units of PT and not beyond it; zero where it is not counting."""
        rows = call.rows
        preset = call["PT"]
        # TIME counts milliseconds in 32 bits or nanoseconds in 64, by the dialect
        unit = 1_000_000 if preset.dtype.itemsize == 4 else 1
        now = self.machine.time_ns // unit
        self.is_counting[rows] &= ~stops
        starts = begins & ~self.is_counting[rows]
        self.start[rows] = np.where(starts, now, self.start[rows])
        self.is_counting[rows] |= starts
        counted = np.where(self.is_counting[rows], now - self.start[rows], 0)
        return np.clip(counted, 0, preset.astype(np.int64))


class OnDelay(Timer):
    """TON: Q follows IN after PT."""

    def body(self, call: NativeCall) -> None:
        """A call of the instance."""
        given = call["IN"]
        elapsed = self.elapsed(call, given, ~given)
        call["ET"] = elapsed
        call["Q"] = given & (elapsed >= call["PT"])


class OffDelay(Timer):
    """TOF: Q stays for PT after IN has gone."""

    def __init__(self, machine: Host) -> None:
        super().__init__(machine)
        self.was_on = np.zeros(machine.row_count, np.bool_)

    def body(self, call: NativeCall) -> None:
        """A call of the instance."""
        given = call["IN"]
        self.was_on[call.rows] |= given
        elapsed = self.elapsed(call, ~given & self.was_on[call.rows], given)
        call["ET"] = elapsed
        is_on = given | (self.is_counting[call.rows] & (elapsed < call["PT"]))
        call["Q"] = is_on
        self.was_on[call.rows] &= is_on | self.is_counting[call.rows]


class Pulse(Timer):
    """TP: a pulse of length PT from the rising edge of IN."""

    def body(self, call: NativeCall) -> None:
        """A call of the instance."""
        given = call["IN"]
        is_over = self.elapsed(call, given, np.zeros_like(given)) >= call["PT"]
        elapsed = self.elapsed(call, given, is_over & ~given)
        call["ET"] = elapsed
        call["Q"] = self.is_counting[call.rows] & (elapsed < call["PT"])


TC2_STANDARD = Library(
    "Tc2_Standard",
    _EDGES + "".join(_TIMER.format(name=name) for name in ("TON", "TOF", "TP")),
    blocks={"TON": OnDelay, "TOF": OffDelay, "TP": Pulse},
)

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
