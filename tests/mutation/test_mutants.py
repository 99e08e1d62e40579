"""The mutants themselves: each changes one place and leaves a file that can be read."""

import ast
from pathlib import Path

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
