"""Numbers that decide stand in settings, each below its unit and what it is for; the code compares with these alone."""

import ast
import re
from pathlib import Path

import pytest

import st_codegen

RECONCILE = Path(st_codegen.__file__).parent / "reconcile"
FILES = sorted(RECONCILE.rglob("*.py"))
SETTINGS = [path for path in FILES if path.name == "settings.py"]
#: half, one and two say what they are; below a millionth a number keeps arithmetic from a division by zero
PLAIN, GUARD = (0.0, 0.5, 1.0, 2.0), 1e-6
#: numbers that nobody chose: degrees of half a turn and of one; the standard deviation of normal noise over its median,
#: and the median of the sum of two exponential numbers
DERIVED = (180.0, 360.0, 1.4826, 1.678)
#: what these compare decides how much is drawn, and nothing that is said
PICTURES = ("joint/page.py", "report/evidence.py", "report/pages.py")
UNITS = re.compile(
    "#: (count|share|factor|chance|loss|noise|standard (error|deviation)|order|deg|rad|s|degC|N m|step|half width|"
    "width|sample|turn|period|logarithm|-log|correlation|coherence|damping ratio|power|percent|nat|byte|resolution|"
    r"mean sine|cost|false discovery rate|number|unit)s?\b"
)


def numbers_of(tree):
    """Numbers of the module that have a name of their own; what is no number alone is a table, or a grid."""
    found = {}
    for node in (node for node in tree.body if isinstance(node, ast.Assign)):
        names, values = ([*one.elts] if isinstance(one, ast.Tuple) else [one] for one in (node.targets[0], node.value))
        if len(names) == len(values):
            found |= {ast.unparse(name): one for name, one in zip(names, values, strict=True) if is_number(one)}
    return found


def is_number(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, float)


def compared(source):
    """Line and value of the numbers with which a source compares: as they are, or by a name of the module."""
    tree = ast.parse(source)
    named = numbers_of(tree)
    for comparison in (node for node in ast.walk(tree) if isinstance(node, ast.Compare)):
        for node in ast.walk(comparison):
            constant = named.get(node.id) if isinstance(node, ast.Name) else node
            if is_number(constant):
                yield node.lineno, constant.value


def chosen(source):
    return [
        (line, value)
        for line, value in compared(source)
        if value not in PLAIN and value not in DERIVED and abs(value) > GUARD
    ]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(RECONCILE)))
def test_numbers_that_decide_stand_in_settings(path):
    if path in SETTINGS or path.relative_to(RECONCILE).as_posix() in PICTURES:
        return
    assert chosen(path.read_text("utf-8")) == []


@pytest.mark.parametrize(
    "source", ["a > 0.3 * b", "_LEAST = 20.0\na >= _LEAST", "_A, _B = 2, 0.7\nf(a < g(_B))", "x if y < 0.02 < z else w"]
)
def test_a_number_that_was_chosen_is_found(source):
    assert len(chosen(source)) == 1


@pytest.mark.parametrize("source", ["a > 0.5", "a > 1e-12 * b", "a = 0.3 * b", "abs(a) < 180.0", "a > S.least"])
def test_other_numbers_are_not(source):
    assert chosen(source) == []


@pytest.mark.parametrize("path", SETTINGS, ids=lambda path: path.parent.name)
def test_each_number_has_a_comment_of_its_own_that_begins_with_its_unit(path):
    lines = path.read_text("utf-8").splitlines()
    fields = [number for number, line in enumerate(lines) if re.match(r"    \w+: .* = ", line)]
    assert len(fields) > 40
    for number in fields:
        first = number - 1
        while lines[first - 1].startswith("    #: "):
            first -= 1
        assert UNITS.match(lines[first].strip()), lines[number]
