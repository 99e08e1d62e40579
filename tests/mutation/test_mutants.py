"""The mutants themselves: each changes one place and leaves a file that can be read."""

import ast
from dataclasses import replace
from pathlib import Path

import pytest

from tests.mutation.__main__ import try_mutant
from tests.mutation.mutants import _of_python, _of_template, sample

ROOT = Path(__file__).resolve().parents[2]
SOURCE = '''
def f(a: int | None = 1, *b) -> bool:
    """A text with 1 + 1 in it."""
    print(f"{a + 1}")
    if not a and a <= 2.0 or a is None:
        return a + 1 in b
    return "%d" % a == ""
'''


def test_each_kind_of_change_is_made():
    made = {(mutant.before, mutant.text) for mutant in _of_python("f.py", SOURCE)}
    assert {("and", "or"), ("or", "and"), ("<=", "<"), ("2.0", "4.0"), ("not ", ""), ("is", "is not")} <= made
    assert {("+", "-"), ("in", "not in"), ("1", "2"), ("==", "!=")} <= made
    assert any(text == "pass" for _, text in made)
    assert ("|", "&") not in made and not any("1 + 1" in before for before, _ in made)


def test_a_negated_parenthesis_stays_closed():
    source = "f = 1 if not (a or b) else 2\n"
    (negation,) = (mutant for mutant in _of_python("f.py", source) if mutant.before.startswith("not"))
    assert negation.apply(source) == "f = 1 if (a or b) else 2\n"


def test_a_template_is_changed_outside_of_comments():
    text = "{# 1 < 2 #}IF fX < {{ bound }} AND bY THEN (* 3 *)\n    nZ := 4; // 5\n"
    assert {(m.before, m.text, m.line) for m in _of_template("t.j2", text)} == {
        ("<", "<=", 1),
        ("AND", "OR", 1),
        ("4", "5", 2),
    }


def test_mutants_of_the_package_can_be_parsed():
    mutants = sample(ROOT, 200, seed=1)
    assert len({str(mutant) for mutant in mutants}) > 150
    for mutant in mutants:
        source = (ROOT / mutant.path).read_text(encoding="utf-8")
        changed = mutant.apply(source)
        assert changed != source
        if mutant.path.endswith(".py"):
            ast.parse(changed)


@pytest.mark.parametrize(
    ("changed", "limit", "verdict"),
    [("2", 3, "too slow"), ("3", 600, "survived"), ("4", 600, "noticed")],
    ids=["loops", "within its limit", "fails"],
)
def test_only_processor_time_makes_a_mutant_too_slow(tmp_path, changed, limit, verdict):
    # only the loop gets a limit that the start of pytest alone could reach: its verdict would be the same
    (tmp_path / "f.py").write_text("WHAT = 1\n")
    (tmp_path / "test_f.py").write_text(
        "import resource\nfrom f import WHAT\n\ndef test_f():\n    while WHAT == 2:\n        pass\n"
        f"    assert resource.getrlimit(resource.RLIMIT_CPU)[0] == {limit}\n    assert WHAT != 4\n"
    )
    (mutant,) = (mutant for mutant in _of_python("f.py", "WHAT = 1\n"))
    found = try_mutant(replace(mutant, text=changed), ["test_f.py"], tmp_path, limit=limit)
    assert found.verdict == verdict
    assert (tmp_path / "f.py").read_text() == "WHAT = 1\n"
