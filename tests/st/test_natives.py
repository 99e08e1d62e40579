from __future__ import annotations

import numpy as np
import pytest

from st_codegen.errors import InputError
from st_codegen.st import Library, Machine, NativeBlock, NativeCall, StCheckError, StRuntimeError, parse_project
from st_codegen.st.run.library import TC2_STANDARD, TCUNIT, TestSuite
from st_codegen.st.run.natives import Host


class Prediction(NativeBlock):
    """What a block of an inference engine looks like to the project: it takes addresses of arrays."""

    def __init__(self, machine: Host) -> None:
        super().__init__(machine)
        self.files: list[str] = []
        self.bodies: list[list[int]] = []

    def body(self, call: NativeCall) -> None:
        self.bodies.append(call.rows.tolist())

    def Configure(self, call: NativeCall) -> None:  # noqa: N802
        self.files.append(str(call["SFILE"][0]))
        call["CONFIGURE"] = np.ones(len(call.rows), bool)

    def Predict(self, call: NativeCall) -> None:  # noqa: N802
        given = call["PDATAINP"]
        if given is None:
            call["PREDICT"] = False
            return
        values = given.read()
        call["PDATAOUT"].write(values.sum(axis=1, keepdims=True) * [1.0, -1.0])
        call["NCOUNT"] = call["NCOUNT"] + call["NDIM"]
        call["PREDICT"] = values[:, 0] > 0


def _halve(call: NativeCall) -> None:
    call["FC_HALF"] = call["A"] / 2
    call["NREST"] = call["A"] % 2


LIBRARY = Library(
    "Tc3_MLL",
    """
TYPE E_Kind : (FP32 := 1, FP64) DINT; END_TYPE
FUNCTION_BLOCK FB_MllPrediction
VAR_INPUT eKind : E_Kind; END_VAR
METHOD Configure : BOOL
VAR_INPUT sFile : STRING(255); END_VAR
END_METHOD
METHOD Predict : BOOL
VAR_INPUT pDataInp : PVOID; nDim : UDINT; pDataOut : PVOID; END_VAR
VAR_IN_OUT nCount : UDINT; END_VAR
END_METHOD
END_FUNCTION_BLOCK
FUNCTION FC_Half : DINT
VAR_INPUT a : DINT; END_VAR
VAR_OUTPUT nRest : DINT; END_VAR
END_FUNCTION
VAR_GLOBAL CONSTANT MAX_DIM : UDINT := 3; END_VAR
""",
    blocks={"FB_MllPrediction": Prediction},
    functions={"FC_Half": _halve},
)
USER = """
FUNCTION_BLOCK FB_T
VAR_INPUT f : LREAL; n : DINT; bOn : BOOL := TRUE; END_VAR
VAR_OUTPUT bDone : BOOL; nHalf : DINT; nRest : DINT; END_VAR
VAR fb : FB_MllPrediction; aIn : ARRAY[0..2] OF LREAL; aOut : ARRAY[0..1] OF LREAL; nCount : UDINT; END_VAR
aIn[0] := f; aIn[1] := 2.0; aIn[2] := 3.0;
fb.eKind := E_Kind.FP64;
IF bOn THEN
    fb.Configure('model.xml');
    bDone := fb.Predict(ADR(aIn), MAX_DIM, pDataOut := ADR(aOut), nCount := nCount);
    nHalf := Tc3_MLL.FC_Half(n, nRest => nRest);
END_IF;
END_FUNCTION_BLOCK
"""


def test_native_blocks_take_addresses_and_references_in_the_calling_rows() -> None:
    project = parse_project({"t.st": USER}, "twincat", [LIBRARY])
    instance = Machine(project, 3, libraries=[LIBRARY]).instance("FB_T")
    instance(f=np.array([1.0, -1.0, 5.0]), n=np.array([7, 8, 9]), bOn=np.array([True, True, False]))
    assert instance["bDone"].tolist() == [True, False, False]
    assert instance["aOut"].tolist() == [[6.0, -6.0], [4.0, -4.0], [0.0, 0.0]]
    assert instance["nCount"].tolist() == [3, 3, 0]
    assert (instance["nHalf"].tolist(), instance["nRest"].tolist()) == ([3, 4, 0], [1, 0, 0])
    assert instance["fb.eKind"].tolist() == [2, 2, 2]


def test_pure_native_code_sees_many_rows_at_once_and_is_asked_again_when_its_input_changes() -> None:
    calls: list[int] = []

    class Step(NativeBlock):
        is_pure = True

        def Next(self, call: NativeCall) -> None:  # noqa: N802
            calls.append(len(call.rows))
            given = call["PIN"]
            call["NEXT"] = given.read()[:, 0] * 2 + call["NOFFSET"]

    library = Library(
        "L",
        "FUNCTION_BLOCK FB_Step VAR_INPUT nOffset : DINT; END_VAR "
        "METHOD Next : DINT VAR_INPUT pIn : PVOID; END_VAR END_METHOD END_FUNCTION_BLOCK",
        blocks={"FB_Step": Step},
    )
    text = """FUNCTION_BLOCK FB_T VAR_INPUT n : DINT; END_VAR VAR_OUTPUT nOut : DINT; nCalls : DINT; END_VAR
    VAR fb : FB_Step; a : ARRAY[0..0] OF DINT; i : DINT; END_VAR
    fb.nOffset := 1; a[0] := n;
    FOR i := 1 TO n MOD 7 DO a[0] := fb.Next(ADR(a)); nCalls := nCalls + 1; END_FOR;
    nOut := 100 / a[0];
    END_FUNCTION_BLOCK"""
    project = parse_project({"t.st": text}, "twincat", [library])
    rows = np.arange(1, 1000)
    instance = Machine(project, len(rows), libraries=[library]).instance("FB_T")
    results = []
    for _ in range(2):
        instance(n=rows)
        results.append((instance["nOut"].tolist(), instance["nCalls"].tolist()))

    def expected(n: int) -> int:
        a = n
        for _ in range(n % 7):
            a = 2 * a + 1
        return 100 // a

    assert [nouts for nouts, _ in results] == [[expected(int(n)) for n in rows]] * 2
    assert [counts for _, counts in results] == [[int(n % 7) * k for n in rows] for k in (1, 2)]
    assert len(calls) < 60
    instance = Machine(project, 3, libraries=[library]).instance("FB_T")
    with pytest.raises(StRuntimeError) as caught:
        instance(n=np.array([1, 0, 0]))
    assert (caught.value.kind, caught.value.row) == ("division by zero", 1)


def test_native_blocks_run_in_one_copy_too() -> None:
    project = parse_project({"t.st": USER}, "twincat", [LIBRARY])
    instance = Machine(project, libraries=[LIBRARY]).instance("FB_T")
    instance(f=1.0, n=7)
    assert (instance["bDone"], instance["aOut"].tolist(), instance["nCount"]) == (True, [6.0, -6.0], 3)
    assert (instance["nHalf"], instance["nRest"]) == (3, 1)


def test_a_machine_needs_the_libraries_of_its_project() -> None:
    project = parse_project({"t.st": USER}, "twincat", [LIBRARY])
    with pytest.raises(InputError, match="give the machine the libraries"):
        Machine(project)


def test_a_library_whose_class_lacks_a_method_is_refused() -> None:
    broken = Library("X", "FUNCTION_BLOCK FB_X METHOD Go END_METHOD END_FUNCTION_BLOCK", blocks={"FB_X": NativeBlock})
    with pytest.raises(InputError, match="library X: the class of FB_X lacks Go"):
        parse_project({"t.st": "PROGRAM P END_PROGRAM"}, "twincat", [broken])


def test_the_body_of_a_native_block_can_be_called_directly() -> None:
    project = parse_project({"t.st": USER}, "twincat", [LIBRARY])
    instance = Machine(project, 2, libraries=[LIBRARY]).instance("FB_MllPrediction")
    assert isinstance(instance.native, Prediction)
    instance(eKind=np.array([1, 2]))
    assert instance["eKind"].tolist() == [1, 2]
    assert instance.native.bodies == [[0, 1]]


SUITE = """
FUNCTION_BLOCK FB_Add_Test EXTENDS FB_TestSuite
VAR nRuns : DINT; END_VAR
METHOD Sums
TEST('sums');
AssertEquals_DINT(Expected := 3, Actual := 1 + 2, Message := 'one and two');
AssertEquals_LREAL(0.3, 0.1 + 0.2, 1.0E-12, 'tenths');
AssertTrue(nRuns > 0, 'it runs');
TEST_FINISHED();
END_METHOD
METHOD Wrong
TEST('wrong');
AssertEquals_LREAL(1.0, 1.5, 0.1, 'too far');
AssertFalse(TRUE, 'no');
AssertTrue(FALSE, 'never');
AssertEquals_STRING('a', 'b', 'letters');
TEST_FINISHED_NAMED('wrong');
END_METHOD
METHOD Open
TEST('open');
END_METHOD
nRuns := nRuns + 1;
Sums();
Wrong();
Open();
END_FUNCTION_BLOCK
PROGRAM PRG_TEST
VAR fbTest : FB_Add_Test; END_VAR
TcUnit.RUN();
END_PROGRAM
"""


@pytest.mark.parametrize("rows", [None, 1])
def test_tcunit_suites_run(rows: int | None) -> None:
    project = parse_project({"t.st": SUITE}, "twincat", [TCUNIT])
    machine = Machine(project, rows, libraries=[TCUNIT])
    machine.program("PRG_TEST")()
    (suite,) = machine.natives
    assert isinstance(suite, TestSuite)
    assert suite.tests == ["sums", "wrong", "open"]
    assert suite.finished == {"sums", "wrong"}
    assert [(f.test, f.expected, f.actual, f.message) for f in suite.failures] == [
        ("wrong", 1.0, 1.5, "too far"),
        ("wrong", False, True, "no"),
        ("wrong", True, False, "never"),
        ("wrong", "a", "b", "letters"),
    ]
    assert np.ravel(machine.program("PRG_TEST")["fbTest.nRuns"])[0] == 1


def test_failures_name_their_row() -> None:
    text = SUITE.replace("VAR nRuns : DINT; END_VAR", "VAR_INPUT x : LREAL; END_VAR VAR nRuns : DINT; END_VAR").replace(
        "AssertEquals_LREAL(1.0, 1.5, 0.1, 'too far');", "AssertEquals_LREAL(1.0, x, 0.1, 'x');"
    )
    project = parse_project({"t.st": text}, "twincat", [TCUNIT])
    instance = Machine(project, 4, libraries=[TCUNIT]).instance("FB_Add_Test")
    instance(x=np.array([1.0, 2.0, np.nan, 1.05]))
    found = [(f.row, f.actual) for f in instance.native.failures if f.message == "x"]
    assert found[0] == (1, 2.0)
    assert [row for row, _ in found] == [1, 2]


def test_texts_are_joined_and_whole_numbers_written_as_in_twincat() -> None:
    text = (
        "FUNCTION_BLOCK FB_Text VAR_INPUT n : DINT; END_VAR VAR sText : STRING(255); END_VAR\n"
        "sText := CONCAT(CONCAT('row ', DINT_TO_STRING(n)), ': fOut1');\nEND_FUNCTION_BLOCK"
    )
    project = parse_project({"t.st": text}, "twincat", [TC2_STANDARD])
    instance = Machine(project, 2, libraries=[TC2_STANDARD]).instance("FB_Text")
    instance(n=np.array([0, -12]))
    assert list(instance["sText"]) == ["row 0: fOut1", "row -12: fOut1"]
    with pytest.raises(StCheckError, match="functions of strings are not supported"):
        parse_project({"t.st": text.replace("DINT_TO_STRING(n)", "'n'")}, "twincat")
