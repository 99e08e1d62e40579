from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from st_codegen.st import StSyntaxError
from st_codegen.st import tree as t
from st_codegen.st.syntax import declarations as d
from st_codegen.st.syntax.parser import MAX_DEPTH, _lark, parse_segment, reserved_words
from st_codegen.st.syntax.scan import Segment
from tests.st.examples import METHOD_HEAD, PARTS, PLAIN, REFUSED
from tests.st.printer import lines, show

STARTS = [("file", text) for text in PLAIN.values()] + list(PARTS.items()) + [("head", METHOD_HEAD)]


def parse(text: str, start: str = "file") -> Any:
    return parse_segment(Segment(text, "a.st"), start)


def expression(text: str) -> t.Expression:
    (statement,) = parse(f"x := {text};", "body")
    return statement.value


def statement(text: str) -> t.Statement:
    (found,) = parse(text, "body")
    return found


def test_every_rule_and_terminal_is_used_by_an_example(monkeypatch: pytest.MonkeyPatch) -> None:
    lark = _lark()
    callbacks = lark.parser.parser.parser.callbacks
    used: set[str] = set()
    tokens: set[str] = set()

    def recording(rule: Any, callback: Callable[..., Any]) -> Callable[..., Any]:
        def record(children: list[Any]) -> Any:
            used.add(rule.alias or rule.origin.name)
            used.add(rule.origin.name)
            tokens.update(symbol.name for symbol in rule.expansion if symbol.is_term)
            return callback(children)

        return record

    for rule, callback in list(callbacks.items()):
        monkeypatch.setitem(callbacks, rule, recording(rule, callback))
    for start, text in STARTS:
        parse(text, start)
    for word in REFUSED:
        with pytest.raises(StSyntaxError, match=f"{word} is not supported"):
            parse(f"FUNCTION F {word} s : DINT; END_VAR END_FUNCTION")
    rules = {rule.origin.name for rule in lark.rules} | {rule.alias for rule in lark.rules if rule.alias}
    assert {name for name in rules - used if not name.startswith("__")} == set()
    # WHITE_SPACE is ignored, so no rule has it
    assert {terminal.name for terminal in lark.terminals} - tokens == {"WHITE_SPACE"}


@pytest.mark.parametrize(("start", "text"), STARTS)
def test_printed_tree_parses_to_the_same_tree(start: str, text: str) -> None:
    tree = parse(text, start)
    printed = show(tree).rpartition("END_")[0] if isinstance(tree, d.PouDeclaration) else lines(tuple(tree))
    assert parse(printed, start) == tree


def test_every_example_is_parsed_whatever_the_case_of_its_words() -> None:
    for start, text in STARTS:
        if "'" not in text and '"' not in text:
            assert show_lower(parse(text.lower(), start)) == show_lower(parse(text, start))


def show_lower(tree: Any) -> str:
    nodes = (tree,) if isinstance(tree, t.Node) else tuple(tree)
    return lines(nodes).lower()


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("a OR b XOR c AND d", "a OR (b XOR (c AND d))"),
        ("a AND b = c", "a AND (b = c)"),
        ("a = b < c", "a = (b < c)"),
        ("a < b + c", "a < (b + c)"),
        ("a + b * c", "a + (b * c)"),
        ("a - b - c", "(a - b) - c"),
        ("a / b * c MOD d", "((a / b) * c) MOD d"),
        ("a * b ** c", "a * (b ** c)"),
        ("-a * b", "(-a) * b"),
        ("NOT a AND b", "(NOT a) AND b"),
        ("NOT a = b", "(NOT a) = b"),
        ("a OR_ELSE b AND_THEN c", "a OR_ELSE (b AND_THEN c)"),
        ("a & b", "a AND b"),
        ("- -a", "-(-a)"),
    ],
)
def test_precedence(text: str, same: str) -> None:
    assert expression(text) == expression(same)


@pytest.mark.parametrize("text", ["-a ** 2", "a ** b ** c", "NOT a ** 2"])
def test_powers_that_editions_of_the_standard_read_differently_need_parentheses(text: str) -> None:
    with pytest.raises(StSyntaxError, match=r"unexpected '\*\*'"):
        expression(text)


def test_case_labels_and_statements_are_told_apart() -> None:
    found = statement("CASE a OF 1, 3..5: b := 1; c(); E.X: ; ELSE d := 2; END_CASE")
    assert isinstance(found, t.Case)
    assert [len(branch.choices) for branch in found.branches] == [2, 1]
    assert [len(branch.body) for branch in found.branches] == [2, 0]
    assert len(found.otherwise) == 1


def test_lone_semicolons_and_an_empty_else_leave_nothing() -> None:
    assert statement("IF a THEN ;; b := 1; ELSE ; END_IF;") == statement("IF a THEN b := 1; END_IF")


def test_positions_are_those_of_the_text() -> None:
    tree = parse("FUNCTION_BLOCK FB_A\n(* x *)\nVAR\n    nA : DINT; END_VAR\n  nA := 1 +\n     nB;\nEND_FUNCTION_BLOCK")
    block = tree[0]
    assert (block.position.line, block.position.column, block.position.pou) == (1, 16, "FB_A")
    assert str(block.blocks[0].variables[0].position) == "a.st:4:5 (FB_A)"
    assignment = block.body[0]
    assert str(assignment.value.right.position) == "a.st:6:6 (FB_A)"


def test_methods_have_their_block_in_their_position() -> None:
    tree = parse("FUNCTION_BLOCK FB_A\nMETHOD Go : BOOL\nGo := TRUE;\nEND_METHOD\nEND_FUNCTION_BLOCK")
    assert tree[0].methods[0].body[0].position.pou == "FB_A.Go"


def test_attributes_belong_to_what_follows() -> None:
    (block,) = parse(PLAIN["block"])
    assert block.attributes == ("hide",)
    assert block.blocks[0].variables[0].attributes == ("displaymode:=hex",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "FUNCTION_BLOCK A IF x THEN y := 1; END_FUNCTION_BLOCK",
            "unexpected 'END_FUNCTION_BLOCK'; expected a statement, 'END_IF'",
        ),
        ("PROGRAM P x := ; END_PROGRAM", "unexpected ';'; expected an expression"),
        ("PROGRAM P x := 1", "the text ends too early"),
        ("PROGRAM P x ? 1; END_PROGRAM", "unexpected character '?'"),
        ("PROGRAM P VAR bY : BOOL; END_VAR END_PROGRAM", "'bY' is a keyword and cannot be a name"),
        ("PROGRAM P a + b; END_PROGRAM", "unexpected '+'"),
        ("PROGRAM P a; END_PROGRAM", "a statement is an assignment or a call; this is neither"),
        ("PROGRAM P CASE a OF b := 1; 1: c := 2; END_CASE; END_PROGRAM", "a statement between OF and the first label"),
        ("PROGRAM P VAR a : ARRAY[0..1] OF DINT := [1, 2; END_VAR END_PROGRAM", "unexpected ';'"),
        ("PROGRAM P VAR a : ARRAY[0..1] OF DINT := [1,, 2]; END_VAR END_PROGRAM", "a number is missing in this table"),
        ("PROGRAM P x := 2#12; END_PROGRAM", "'2#12' has a digit that base 2 does not have"),
        ("PROGRAM P x := 1.0E999; END_PROGRAM", "larger than the largest LREAL"),
        (f"PROGRAM P x := {'9' * 5000}; END_PROGRAM", "an integer of 5000 digits fits no type"),
        ("PROGRAM P x := T#5s3h; END_PROGRAM", "must go from large to small"),
        ("PROGRAM P x := T#1.5h3m; END_PROGRAM", "only the last unit"),
        ("PROGRAM P x := T#0.5ns; END_PROGRAM", "not a whole number of nanoseconds"),
        ("PROGRAM P x := 'a$Q'; END_PROGRAM", "'$Q' is no escape sequence"),
        ("PROGRAM P x := 'abc; END_PROGRAM", "this string never ends"),
        ("PROGRAM P (* abc (* *) END_PROGRAM", "this comment never ends"),
        ("PROGRAM P {attribute 'a' END_PROGRAM", "this pragma never ends"),
        ("TYPE A EXTENDS B : (C, D); END_TYPE", "only structures and blocks can extend another one"),
        ("banana", "unexpected 'banana'; expected 'CONFIGURATION', 'FUNCTION'"),
    ],
)
def test_errors_say_what_is_wrong_and_where(text: str, message: str) -> None:
    with pytest.raises(StSyntaxError) as caught:
        parse(text)
    assert message in str(caught.value)
    assert str(caught.value).startswith("a.st:1:")


def test_nesting_is_limited() -> None:
    deep = MAX_DEPTH + 2
    with pytest.raises(StSyntaxError, match="levels of nesting"):
        expression("NOT " * deep + "x")
    with pytest.raises(StSyntaxError, match="levels of nesting"):
        parse("IF a THEN " * deep + "END_IF " * deep, "body")
    with pytest.raises(StSyntaxError, match="levels of nesting"):
        expression("f(" * deep + ")" * deep)


def test_parentheses_and_chains_do_not_count_as_nesting() -> None:
    assert expression("(" * 5000 + "x" + ")" * 5000) == t.Identifier("x")
    chain = expression(" + ".join(["x"] * 5000))
    assert isinstance(chain, t.Binary)


def test_reserved_words_are_upper_case_words() -> None:
    assert {"END_IF", "BY", "VAR_IN_OUT", "XOR"} <= reserved_words()
    assert not {"NAME", "CONSTANT", "METHOD"} & reserved_words()
