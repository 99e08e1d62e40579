# ruff: noqa: E501 - a case a line
"""Any text gives a result or a proper error, and in reasonable time."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as s

from st_codegen.st import (
    Machine,
    StCheckError,
    StError,
    StRuntimeError,
    StSyntaxError,
    parse_project,
)
from st_codegen.st.check.statements import MAX_LOOPS, MAX_NESTED
from st_codegen.st.run.compiler import program_of
from st_codegen.st.syntax.parser import STARTS, _lark, parse_segment
from st_codegen.st.syntax.scan import Segment
from st_codegen.st.syntax.source import read_texts
from tests.examples import examples
from tests.st.examples import PLAIN
from tests.st.programs import programs
from tests.st.test_source import DUT, GVL, POU

WORDS = sorted({t.pattern.value for t in _lark().terminals if t.pattern.type == "str"})
WORDS += [
    "a",
    "b",
    "FB_X",
    "1",
    "2.5",
    "16#FF",
    "T#1s",
    "'x'",
    "DINT",
    "LREAL",
    "[1, 2]",
    "(*",
    "*)",
    "//",
    "{",
    "}",
    "\n",
    "é",
]
SOUP = s.lists(s.sampled_from(WORDS), max_size=60).map(" ".join)


@examples()
@given(s.one_of(SOUP, s.text(max_size=200)), s.sampled_from(STARTS))
def test_any_text_parses_or_is_a_syntax_error(text: str, start: str) -> None:
    try:
        parse_segment(Segment(text, "a.st"), start)
    except StSyntaxError as error:
        assert str(error)


@examples()
@given(s.sampled_from(sorted(PLAIN.values())), s.randoms(use_true_random=False))
def test_damaged_texts_parse_or_are_syntax_errors(text: str, rng: random.Random) -> None:
    for _ in range(rng.randint(1, 4)):
        at, length = rng.randrange(len(text)), rng.randrange(12)
        text = text[:at] + rng.choice(["", ";", "(", ")", "END_IF", "]", "'", "x", "(*"]) + text[at + length :]
    try:
        parse_segment(Segment(text, "a.st"))
    except StSyntaxError as error:
        assert str(error)


@examples()
@given(s.sampled_from([POU, GVL, DUT]), s.randoms(use_true_random=False), s.binary(max_size=3))
def test_damaged_xml_is_read_or_refused(text: str, rng: random.Random, noise: bytes) -> None:
    content = text.encode()
    at = rng.randrange(len(content))
    damaged = content[:at] + noise + content[at + rng.randrange(40) :]
    try:
        read_texts({"X.TcPOU": damaged.decode("utf-8", "surrogateescape").encode("utf-8", "replace").decode("utf-8")})
    except StSyntaxError as error:
        assert str(error)


@pytest.mark.thorough
@examples()
@given(programs(), s.randoms(use_true_random=False))
def test_damaged_programs_are_checked_or_refused(program: str, rng: random.Random) -> None:
    """One name or literal for another: the checker finds an error or the program still compiles."""
    names = ["fX", "nX", "bX", "wX", "eX", "aF", "aN", "stP", "uB", "fbA", "TABLE", "1", "2.5", "TRUE", "zz", "FC_Mix"]
    parts = program.split(" ")
    places = [i for i, part in enumerate(parts) if part in names]
    for i in rng.sample(places, min(3, len(places))):
        parts[i] = rng.choice(names)
    try:
        project = parse_project({"a.st": " ".join(parts)}, rng.choice(["iec", "twincat"]))
        program = program_of(project, 100)
        for pou in project.pous.values():
            program.code(pou)
    except StError as error:
        assert str(error)


@pytest.mark.parametrize(
    "text",
    [
        "PROGRAM P x := " + "(" * 20000 + "1",
        "PROGRAM P " + "IF a THEN " * 5000,
        "PROGRAM P x := " + "-" * 20000 + "1; END_PROGRAM",
        "PROGRAM P x := a" + ".b" * 5000 + "; END_PROGRAM",
        "PROGRAM P VAR a : " + "ARRAY[0..1] OF " * 5000 + "DINT; END_VAR END_PROGRAM",
        "(*" * 50000,
        "PROGRAM P VAR a : ARRAY[0..9] OF LREAL := [" + "1.0E5 " * 100000,
        "x" * 1000000,
        "'" * 100001,
        "PROGRAM P x := " + "1" * 100000 + "; END_PROGRAM",
        "PROGRAM P x := T#" + "1d" * 20000 + "; END_PROGRAM",
    ],
)
def test_hostile_texts_end_soon(text: str) -> None:
    with pytest.raises(StSyntaxError):
        parse_segment(Segment(text, "a.st"))


def test_deep_but_allowed_programs_compile() -> None:
    depth = MAX_NESTED - 1
    text = "IF a THEN " * depth + "a := FALSE; RETURN; " + "END_IF; " * depth
    loops = "".join(f"FOR i{k} := 0 TO 1 DO " for k in range(MAX_LOOPS)) + "n := n + 1; " + "END_FOR; " * MAX_LOOPS
    variables = "a : BOOL := TRUE; n : DINT;" + "".join(f"i{k} : DINT;" for k in range(MAX_LOOPS + 1))
    source = "FUNCTION_BLOCK FB_T VAR {} END_VAR {} END_FUNCTION_BLOCK"
    instance = Machine(parse_project({"a.st": source.format(variables, text + loops)})).instance("FB_T")
    instance()
    instance()
    assert instance["n"] == 2**MAX_LOOPS
    too_deep = "IF a THEN " * (depth + 1) + "a := FALSE; " + "END_IF; " * (depth + 1)
    too_many = (
        "".join(f"FOR i{k} := 0 TO 1 DO " for k in range(MAX_LOOPS + 1)) + "n := 1; " + "END_FOR; " * (MAX_LOOPS + 1)
    )
    for body in (too_deep, too_many):
        with pytest.raises(StCheckError, match="nested loops"):
            parse_project({"a.st": source.format(variables, body)})


def test_long_chains_compile() -> None:
    for operator, kind in (("+", "LREAL"), ("+", "DINT"), ("AND", "BOOL"), ("-", "LREAL")):
        chain = f" {operator} ".join(["x", *["y"] * 1500])
        source = f"FUNCTION_BLOCK FB_T VAR x : {kind}; y : {kind}; z : {kind}; END_VAR z := {chain}; END_FUNCTION_BLOCK"
        Machine(parse_project({"a.st": source}), optimised=False).instance("FB_T")()
    chain = " + ".join(["x", *["y"] * 1500])
    source = f"FUNCTION_BLOCK FB_T VAR_INPUT x : LREAL; y : LREAL; END_VAR VAR z : LREAL; END_VAR z := {chain}; END_FUNCTION_BLOCK"
    with pytest.raises(StRuntimeError, match="overflow"):
        Machine(parse_project({"a.st": source}), optimised=False).instance("FB_T")(x=1e308, y=1e307)
    branches = "".join(f"ELSIF n = {k} OR x > {k}.5 THEN n := {k + 1};\n" for k in range(500))
    source = f"FUNCTION_BLOCK FB_T VAR n : DINT := 7; x : LREAL; END_VAR IF FALSE THEN ; {branches} END_IF; END_FUNCTION_BLOCK"
    instance = Machine(parse_project({"a.st": source})).instance("FB_T")
    instance()
    assert instance["n"] == 8
