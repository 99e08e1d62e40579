"""The quick parser gives the trees of lark's own, and leaves to it what it does not take."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as s
from lark.exceptions import UnexpectedInput

from st_codegen.st import StSyntaxError
from st_codegen.st.syntax import parser
from st_codegen.st.syntax.builder import Builder
from st_codegen.st.syntax.scan import Segment, scan
from st_codegen.st.syntax.source import read_texts
from tests.examples import examples
from tests.st.programs import programs
from tests.st.test_grammar import STARTS

GOLDEN = Path(__file__).resolve().parents[2] / "golden" / "bundle" / "generated" / "iec" / "golden.st"


def trees(text, start="file"):
    """The trees of the tables and of lark's own loop; None where they do not take the text."""
    scanned = scan(Segment(text, "a.st"))
    text, token = scanned.segment.text, Builder.parsing.set(scanned)
    try:
        quick = parser._tables().parse(text, start)
        try:
            return quick, parser._lark().parse(text, start=start)
        except UnexpectedInput:
            return quick, None
    finally:
        Builder.parsing.reset(token)


@pytest.mark.parametrize(("start", "text"), [*STARTS, ("file", ""), ("body", ""), ("file", GOLDEN.read_text("utf-8"))])
def test_what_the_grammar_takes_has_the_same_tree(start, text):
    quick, own = trees(text, start)
    assert quick == own
    assert quick is not None


@pytest.mark.parametrize("text", ["a := b; c := ;", "a := b", "a := b; END_IF;", "a := ?;", "a := (b;", "a b;"])
def test_what_it_does_not_take_is_left_to_lark(text):
    assert trees(text, "body") == (None, None)


@examples(20)
@given(programs(), s.integers(0, 2**31), s.sampled_from([";", "END_IF", "1", "?", ":= x", "("]))
def test_damaged_programs_are_taken_by_both_or_by_none(program, place, noise):
    at = place % len(program)
    try:
        quick, own = trees(program[:at] + noise + program[at + 1 :])
    except StSyntaxError:  # of a number or a comment: whichever reads it first
        return
    assert quick == own


def test_lark_is_not_asked_about_a_text_that_is_taken(monkeypatch):
    monkeypatch.setattr(parser._lark(), "parse", None)
    assert parser.parse_segment(Segment("a := b + 1;", "a.st"), "body")


def test_a_lark_that_keeps_its_tables_elsewhere_reads_the_same(monkeypatch):
    text = "PROGRAM P VAR a : DINT; END_VAR a := 1 + 2 * a; END_PROGRAM"
    expected = read_texts({"a.st": text})

    def moved(_):
        raise AttributeError("parse_table")

    with monkeypatch.context() as patched:
        patched.setattr(parser.ParseTables, "of", moved)
        parser._tables.cache_clear()
        assert parser._tables() is None
        assert read_texts({"a.st": text}) == expected
    parser._tables.cache_clear()
    assert parser._tables() is not None
