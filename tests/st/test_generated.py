"""What no generated text may have."""

import pytest

from st_codegen.st import parse_project
from st_codegen.st.check.portable import single_rounds
from tests.st.leftovers import unused_variables

BLOCK = """FUNCTION_BLOCK FB_A
VAR_INPUT n : DINT; END_VAR
VAR i : DINT; j : DINT; x : LREAL; a : ARRAY[0..9] OF LREAL; END_VAR
VAR CONSTANT FIRST : DINT := 3; LAST : DINT := 3; {declared} END_VAR
{body}
END_FUNCTION_BLOCK
"""


def project(body, declared=""):
    return parse_project({"a.st": BLOCK.format(body=body, declared=declared)}, "iec")


@pytest.mark.parametrize(
    ("bounds", "found"),
    [
        ("0 TO 0", True),
        ("-1 TO -1", True),
        ("0 TO 0 BY 4", True),
        ("5 TO 5 BY -1", True),
        ("FIRST TO LAST", True),
        ("FIRST TO 2 + 1", True),
        ("0 TO 1", False),
        ("1 TO 0", False),
        ("n TO n", False),
        ("0 TO n", False),
    ],
)
def test_a_loop_between_equal_constants_is_found(bounds, found):
    loop = f"FOR i := {bounds} DO x := x + 1.0; END_FOR;"
    for body in (loop, f"IF n > 0 THEN {loop} END_IF;", f"FOR j := 0 TO 4 DO {loop} END_FOR;"):
        problems = single_rounds(project(body))
        assert bool(problems) == found
        assert all("write its body once" in problem.message for problem in problems)


def test_variables_that_nothing_uses_are_found():
    problems = unused_variables(project("x := a[0]; j := i; i := FIRST;", "SPARE : LREAL := 1.0;"))
    assert [problem.message for problem in problems] == [
        "'LAST' is declared and not used",
        "'SPARE' is declared and not used",
    ]
