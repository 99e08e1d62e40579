from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as s

from st_codegen.st import StSyntaxError
from st_codegen.st.syntax.scan import CommentKind, Segment, scan


def scanned(text: str):
    return scan(Segment(text, "a.st"))


def test_comments_become_blanks_of_the_same_shape() -> None:
    text = "a (* x\ny *) b // c\nd /// e"
    clean = scanned(text).segment.text
    assert clean == "a     \n     b     \nd      "
    assert len(clean) == len(text)


def test_kinds_of_comments() -> None:
    found = scanned("(* a *) (* b (* c *) d *) // e\n")
    assert [comment.kind for comment in found.comments] == [CommentKind.BLOCK, CommentKind.NESTED, CommentKind.LINE]
    assert found.segment.text.strip() == ""


def test_strings_hide_what_looks_like_a_comment() -> None:
    text = "a := '(* $' // {' + \"// {\";"
    assert scanned(text).segment.text == text


def test_a_comment_hides_what_looks_like_a_string() -> None:
    assert scanned("a (* it's *) b").segment.text == "a            b"


def test_attributes_are_found_by_what_follows_them() -> None:
    found = scanned("{attribute 'hide'}\n{attribute 'a' := 'b}'} (* c *) x {region 'r'} y")
    assert found.attributes == {found.segment.text.index("x"): ("hide", "a:=b}")}
    assert [pragma.attribute for pragma in found.pragmas] == ["hide", "a:=b}", None]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a (* b", "comment never ends"),
        ("{a", "pragma never ends"),
        ("'a", "string never ends"),
        ('"a\n"', "string never ends"),
    ],
)
def test_what_never_ends_is_an_error_where_it_starts(text: str, message: str) -> None:
    with pytest.raises(StSyntaxError, match=message) as caught:
        scanned("\n  " + text)
    assert str(caught.value).startswith(
        f"a.st:2:{3 + min(text.index(c) for c in '({' + chr(39) + chr(34) if c in text)}"
    )


def test_positions_start_where_the_segment_starts() -> None:
    segment = Segment("ab\ncd", "x.TcPOU", 10, 5, "FB_A")
    assert str(segment.position(1)) == "x.TcPOU:10:6 (FB_A)"
    assert str(segment.position(4)) == "x.TcPOU:11:2 (FB_A)"


@given(s.text(alphabet="ab(*)/{}'\"$\n ", max_size=60))
def test_scanning_keeps_length_and_lines_or_reports_an_error(text: str) -> None:
    try:
        clean = scanned(text).segment.text
    except StSyntaxError:
        return
    assert len(clean) == len(text)
    assert [i for i, c in enumerate(clean) if c == "\n"] == [i for i, c in enumerate(text) if c == "\n"]
    assert all(a in (b, " ") for a, b in zip(clean, text, strict=True))


@given(s.lists(s.sampled_from(["(*", "*)", "x", " ", "\n"]), max_size=12))
def test_nested_comments_balance(parts: list[str]) -> None:
    """An independent count of nesting says what is left."""
    depth, visible = 0, ""
    for part in parts:
        if part == "(*":
            depth += 1
        elif part == "*)" and depth:
            depth -= 1
        elif not depth:
            visible += part
    if depth:
        with pytest.raises(StSyntaxError):
            scanned("".join(p + " " for p in parts))
    else:
        clean = scanned("".join(p + " " for p in parts)).segment.text
        assert clean.replace(" ", "").replace("\n", "") == visible.replace(" ", "").replace("\n", "")
