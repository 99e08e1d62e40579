"""The mutants themselves: each changes one place and leaves a file that can be read."""

import ast
import json
import resource
import shutil
from dataclasses import replace
from pathlib import Path

import coverage
import pytest

from tests.mutation import __main__ as mutation
from tests.mutation import executed
from tests.mutation.__main__ import measure, try_mutant
from tests.mutation.executed import Executed
from tests.mutation.mutants import Mutant, _of_python, _of_template, sample

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


def test_what_changes_nothing_in_a_program_that_is_right_stays():
    source = "@dataclass(frozen=True, eq=False)\nclass A:\n    a = zip(b, strict=True)\n    c = f(strict=True)\n"
    assert [(mutant.line, mutant.before) for mutant in _of_python("f.py", source)] == [(4, "True"), (1, "False")]


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


def test_mutants_of_a_room_can_be_parsed():
    mutants = sample(ROOT, 200, seed=1, rooms=["emit"])
    assert {Path(mutant.path).suffix for mutant in mutants} == {".py", ".j2"}
    assert len({str(mutant) for mutant in mutants}) > 150
    for mutant in mutants:
        source = (ROOT / mutant.path).read_text(encoding="utf-8")
        changed = mutant.apply(source)
        assert changed != source
        if mutant.path.endswith(".py"):
            ast.parse(changed)


@pytest.fixture
def measured(tmp_path, monkeypatch):
    """Run `measured(name, source, seconds, lines)` for what coverage saw: contexts with their lines of one file."""
    monkeypatch.setattr(executed, "ROOT", tmp_path)

    def write(name, source, seconds, lines):
        file = tmp_path / name
        file.parent.mkdir(parents=True)
        file.write_text(source)
        executed._parsed.cache_clear()
        (tmp_path / "data.coverage.seconds").write_text(json.dumps(seconds))
        data = coverage.CoverageData(str(tmp_path / "data.coverage"))
        for context, numbers in lines.items():
            data.set_context(context)
            data.add_lines({name: numbers})
        data.write()
        return Executed(tmp_path)

    yield write
    executed._parsed.cache_clear()


def test_a_declaration_is_tried_with_the_tests_that_read_sources(measured):
    """Line 1 is executed by the import and by no test, line 2 by one test, line 3 by nothing that coverage sees."""
    name, of_sources = "st_codegen/st/tree.py", "tests/test_architecture.py"
    seconds = {"tests/st/test_a.py::one": 1.0, f"{of_sources}::rules": 1.0}
    found = measured(name, "\n\n\n", seconds, {"": [1], "tests/st/test_a.py::one": [2]})
    declared, ran, unseen = (found.tests(Mutant(name, line, 0, 1, "1", "2")) for line in (1, 2, 3))
    assert declared == [f"{of_sources}::rules", "tests/st/test_a.py::one"]
    assert ran == unseen == ["tests/st/test_a.py::one"]
    other = Mutant("st_codegen/st/types.py", 1, 0, 1, "1", "2")
    assert found.tests(other) == ["tests/st/test_a.py::one"]
    assert found.tests(replace(other, path="st_codegen/te/check.py")) == []
    assert sum(found.seconds(declared).values()) == 2.0


def test_a_test_that_fails_unchanged_is_not_chosen(measured):
    """Nothing is known of its seconds: the plugin leaves those of failures out."""
    ran = {"tests/st/test_a.py::fails": [1], "tests/st/test_a.py::passes": [1]}
    found = measured("st_codegen/st/tree.py", "\n", {"tests/st/test_a.py::passes": 1.0}, ran)
    assert found.tests(Mutant("st_codegen/st/tree.py", 1, 0, 1, "1", "2")) == ["tests/st/test_a.py::passes"]


def copied(copy, *names):
    """A folder with these files of the repository, and those that make packages of them."""
    for name in ("tests/__init__.py", "tests/mutation/__init__.py", *names):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, copy / name)
    return copy


@pytest.mark.thorough
def test_what_is_measured_is_of_the_copy_and_of_tests_that_pass(tmp_path):
    copy, data = copied(tmp_path / "copy", "pyproject.toml", "tests/mutation/contexts.py"), tmp_path / "data"
    for name in ("st_codegen", "templates", "tests/st"):
        (copy / name).mkdir()
    (copy / "st_codegen/testing.py").touch()  # pytest's own entry point
    (copy / "st_codegen/__init__.py").write_text("def f():\n    return 1\n")
    test = copy / "tests/st/test_f.py"
    test.write_text("from st_codegen import f\n\ndef test_f():\n    assert f()\n\ndef test_g():\n    assert not f()\n")
    times = []
    for changed in (False, False, True):  # what is older than a file is measured again
        test.touch() if changed else None
        measure(data, copy, 1, ["st"])
        assert list(json.loads((data / "st.coverage.seconds").read_text())) == ["tests/st/test_f.py::test_f"]
        times.append((data / "st.coverage").stat().st_mtime_ns)
    assert times[0] == times[1] < times[2]
    mutant = Mutant("st_codegen/__init__.py", 2, 0, 1, "1", "2")
    assert Executed(data).tests(mutant) == Executed(data, ["st"]).tests(mutant) == ["tests/st/test_f.py::test_f"]
    assert Executed(data, ["te"]).tests(mutant) == []  # what an earlier run measured is of another room


def test_a_constant_is_tried_with_the_tests_of_its_uses_and_a_line_with_those_of_its_statement(measured):
    source = "LIMIT = 3\n\ndef f(x, at=1):\n    return g(\n        x,\n        2,\n    ) < LIMIT\n"
    source += "\ndef g(*x):\n    return 4\n"
    f, g = "tests/st/test_z.py::f", "tests/st/test_a.py::g"
    name = "st_codegen/st/tree.py"
    found = measured(name, source, {f: 5.0, g: 1.0}, {"": [1, 3, 9], f: [4, 7], g: [10]})
    for line, first in {1: f, 3: f, 4: f, 6: f, 9: g, 10: g}.items():
        assert found.tests(Mutant(name, line, 0, 1, "1", "2"))[0] == first, line


def test_whole_texts_are_compared_first(measured):
    own, golden = "tests/emit/test_a.py::own", "tests/emit/test_golden.py::test_the_generated_text[iec]"
    lines = {own: [1], golden: [1, 2]}
    found = measured("st_codegen/emit/a.py", "f()\ng()\n", {own: 0.1, golden: 9.0}, lines)
    assert found.tests(Mutant("st_codegen/emit/a.py", 1, 0, 1, "1", "2")) == [golden, own]


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("changed", "least", "verdict"),
    [("2", 3, "too slow"), ("3", 600, "survived"), ("4", 600, "noticed")],
    ids=["loops", "within its limit", "fails"],
)
def test_only_processor_time_of_a_test_makes_a_mutant_too_slow(tmp_path, monkeypatch, changed, least, verdict):
    # only the loop gets a limit that the start of pytest alone could reach: its verdict would be the same
    monkeypatch.setattr(mutation, "_START_SECONDS", least)
    copy = copied(tmp_path / "copy", "tests/mutation/limits.py")
    (copy / "f.py").write_text("WHAT = 1\n")
    (copy / "test_f.py").write_text(
        "import resource\nfrom f import WHAT\n\ndef test_f():\n    while WHAT == 2:\n        pass\n"
        f"    assert resource.getrlimit(resource.RLIMIT_CPU)[1] == {resource.getrlimit(resource.RLIMIT_CPU)[1]}\n"
        "    assert WHAT != 4\n\ndef test_long():\n    pass\n"
    )
    (mutant,) = (mutant for mutant in _of_python("f.py", "WHAT = 1\n"))
    # what the other test may take, 40,000 s of processor time, is not the first one's
    tests = {"test_f.py::test_f": 0.0, "test_f.py::test_long": 1e4}
    found = try_mutant(replace(mutant, text=changed), tests, copy)
    assert (found.verdict, found.found) == (verdict, verdict == "noticed")
    assert (copy / "f.py").read_text() == "WHAT = 1\n"
