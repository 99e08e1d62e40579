"""Every message of a refusal has a code, and every code stands for something."""

import ast
import re
from pathlib import Path

import pytest

import st_codegen
from st_codegen import errors
from st_codegen.diagnostics import DIAGNOSTICS, UNKNOWN, code_for, diagnostic
from st_codegen.driver import generate
from st_codegen.errors import InputError, MissingExtraError, Problems, StCodegenError, with_subject
from st_codegen.project.bundle import load
from tests.cli.helpers import run

PACKAGE = Path(st_codegen.__file__).parent


def classes(trees):
    """All classes of errors of the package, and those above each, by their names in the source."""
    known = {"StCodegenError": {"StCodegenError"}}
    bases = {}
    for tree in trees:
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                bases[node.name] = [base.id for base in node.bases if isinstance(base, ast.Name)]
    for _ in bases:
        for name, above in bases.items():
            for base in above:
                if base in known:
                    known[name] = {name, *known[base]}
    return known


class Makers(ast.NodeVisitor):
    """Places of a module that make an error or note a problem, with the class of the error."""

    def __init__(self, module, known):
        self.module, self.known, self.names, self.found = module, known, [], []

    def inside(self, node):
        self.names.append(node.name)
        self.generic_visit(node)
        self.names.pop()

    visit_FunctionDef = visit_ClassDef = inside

    def visit_Call(self, node):
        name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        text = bool(node.args) and isinstance(node.args[0], ast.JoinedStr | ast.Constant)
        noted = name == "note" or (name == "add" and text and "problems" in ast.unparse(node.func))
        if name in self.known or noted:
            place = f"{self.module}:{'.'.join(self.names)}"
            self.found.append((place, self.known.get(name, self.known["InputError"])))
        self.generic_visit(node)


@pytest.fixture(scope="module")
def makers():
    paths = sorted(PACKAGE.rglob("*.py"))
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}
    known = classes(trees.values())
    found = []
    for path, tree in trees.items():
        module = ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")
        visitor = Makers(module, known)
        visitor.visit(tree)
        found += [entry for entry in visitor.found if module not in errors._FOR_OTHERS]
    return found


def test_every_place_that_makes_an_error_has_a_code(makers):
    assert len(makers) > 400
    without = {place for place, kinds in makers if code_for(place, kinds) == UNKNOWN}
    assert not without, "an entry in st_codegen/diagnostics.py should name these rooms or modules"


def test_every_code_stands_for_something_that_is_made(makers):
    made = {code_for(place, kinds) for place, kinds in makers}
    by_kind = {entry.code for entry in DIAGNOSTICS if entry.kinds and not entry.places}
    answers = {entry.code for entry in DIAGNOSTICS if entry.code >= "STC2"}
    rooms = {entry.code for entry in DIAGNOSTICS if entry.places and not (PACKAGE / entry.places[0]).exists()}
    assert {entry.code for entry in DIAGNOSTICS} - made - by_kind - answers - {UNKNOWN} <= rooms & {"STC1701"}


@pytest.mark.parametrize("place", sorted({place for entry in DIAGNOSTICS for place in entry.places}))
def test_every_place_of_an_entry_is_there(place):
    """A function with another name would have another code, which users may have written down."""
    module, _, name = place.partition(":")
    path = PACKAGE / module.replace(".", "/")
    path = path.with_suffix(".py") if path.with_suffix(".py").is_file() else path / "__init__.py"
    assert path.is_file()
    within = [ast.parse(path.read_text(encoding="utf-8"))]
    for part in filter(None, name.split(".")):
        within = [node for tree in within for node in tree.body if getattr(node, "name", "") == part]
        assert within, part


def test_codes_are_unique_and_say_cause_and_cure():
    codes = [entry.code for entry in DIAGNOSTICS]
    assert len(set(codes)) == len(codes)
    for entry in DIAGNOSTICS:
        assert re.fullmatch(r"STC\d{4}", entry.code)
        assert entry.title and not entry.title.endswith(".")
        assert entry.cause.endswith(".") and entry.cure.endswith("."), entry.code


def test_the_code_is_that_of_the_place_and_stays_when_a_subject_is_added(tmp_path):
    with pytest.raises(InputError) as caught:
        load(tmp_path / "none")
    assert caught.value.codes == ("STC1307",)
    with pytest.raises(InputError, match="no model files") as caught:
        load(tmp_path)
    assert caught.value.codes == ("STC1307",)  # it was the code of a fault in bundle.toml
    (tmp_path / "x.txt").write_text("no model")
    with pytest.raises(InputError) as caught:
        load(tmp_path)
    assert caught.value.codes == ("STC1202",)
    assert with_subject(caught.value, "there").codes == ("STC1202",)
    assert MissingExtraError("a", "b", "c").codes == ("STC1005",)
    assert StCodegenError("made elsewhere").codes == (UNKNOWN,)


def test_several_problems_have_the_codes_of_all(lone_folder, tmp_path):
    (lone_folder / "x.txt").write_text("no model")
    (lone_folder / "y.pkl").write_bytes(b"x")
    with pytest.raises(InputError) as caught:
        load(lone_folder)
    assert caught.value.codes == ("STC1202", "STC1203")
    problems = Problems("a")
    problems.errors = [caught.value, caught.value]
    with pytest.raises(InputError) as caught:
        problems.raise_if_any()
    assert caught.value.codes == ("STC1202", "STC1203")


def test_a_table_that_is_wrong_has_the_code_of_its_reader(lone_folder):
    (lone_folder / "st-codegen.toml").write_text('[project]\nnam = "x"\n')
    with pytest.raises(InputError) as caught:
        load(lone_folder)
    assert caught.value.codes == ("STC1302",)


def test_the_command_line_shows_the_code_and_explains_it(lone_folder, tmp_path, capsys):
    assert run("verify", lone_folder, "-g", tmp_path / "none") == 2
    shown = capsys.readouterr().err
    assert "error: " in shown
    assert shown.endswith("STC1501: st-codegen explain STC1501 says what to do\n")
    assert run("explain", "stc1501") == 0
    text = capsys.readouterr().out
    assert text.startswith("STC1501: There is no generated code")
    assert diagnostic("STC1501").cure in " ".join(text.split())
    assert run("explain", "STC1005") == 0
    assert '"st-codegen[lightgbm]"' in capsys.readouterr().out  # in one line: it is to be copied
    # questions of reconcile were "no overlap", and an order that a table lacks had "file and line"
    assert run("explain", "STC1605") == 0
    assert "--accept" in capsys.readouterr().out
    assert run("explain", "STC1601") == 0
    assert "The message has file and line" not in capsys.readouterr().out
    assert run("explain", "STC7777") == 2
    assert run("verify", "--no-such-option") == 2
    assert "STC1001" in capsys.readouterr().err
    assert run("explain") == 0
    listed = capsys.readouterr().out
    assert all(entry.code in listed for entry in DIAGNOSTICS)


def test_answers_that_are_no_have_codes(lone_folder, lightgbm_text, tmp_path, capsys):
    generate(lone_folder, "twincat", tmp_path)
    block = next(tmp_path.rglob("FB_Te.TcPOU"))
    text = block.read_text(encoding="utf-8")
    assert run("verify", lone_folder, "-g", tmp_path, "-n", 50, "--cycle-us", 0.001, "-q") == 1
    assert "STC2002" in capsys.readouterr().err
    block.write_text(re.sub(r"fOut1 := (\w+\[0\]);", r"fOut1 := \1 + 1.0;", text), encoding="utf-8")
    assert run("verify", lone_folder, "-g", tmp_path, "-n", 50, "-q") == 1
    assert "STC2001" in capsys.readouterr().err
    assert run("prove", lone_folder, "-g", tmp_path, "-q") == 1
    assert "STC2101" in capsys.readouterr().err
    assert run("generate", lone_folder, "-o", tmp_path, "--check", "--stat") == 1
    assert "STC2201" in capsys.readouterr().err
