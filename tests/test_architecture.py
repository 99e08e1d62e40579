"""The rules of the house, read from the imports."""

import ast
import collections
import functools
import re
import subprocess
from pathlib import Path

import pytest
from jinja2 import Environment, nodes

from st_codegen.st.errors import StSyntaxError
from st_codegen.st.syntax.parser import parse_segment
from st_codegen.st.syntax.scan import Segment

PACKAGE = Path(__file__).resolve().parent.parent / "st_codegen"
FILES = sorted(PACKAGE.rglob("*.py"))

#: Each room of the package and the rooms that it may use, from the ground up: all of them stand above it, so that no
#: two rooms know each other. A room is a folder, or a file beside the folders.
MAY_USE = {
    "diagnostics": set(),
    "errors": {"diagnostics"},
    "entries": set(),
    "threads": set(),
    "processes": {"errors"},
    "files": {"errors"},
    "ir": {"errors"},
    # three stages that know each other only through the intermediate representation
    "walkers": {"entries", "errors", "files", "ir", "processes"},
    "passes": {"errors", "processes", "ir"},
    "emit": {"entries", "processes", "errors", "files", "ir"},
    # the reader of Structured Text shares nothing with its writer: a shared formatter would hide a shared mistake
    "st": {"errors"},
    "cost": {"errors", "st", "files"},
    "project": {"entries", "processes", "errors", "files", "ir", "walkers", "passes", "emit"},
    "proof": {
        "threads",
        "processes",
        "entries",
        "errors",
        "files",
        "ir",
        "walkers",
        "passes",
        "emit",
        "st",
        "cost",
        "project",
    },
    # what a purpose and a target may bring of their own; entered into tables of the rooms above
    "te": {"errors", "files", "ir", "walkers", "passes", "emit", "project", "proof"},
    "beckhoff_ml": {"errors", "ir", "walkers", "passes", "emit", "st", "proof"},
    "driver": {"errors", "files", "ir", "passes", "emit", "project", "proof"},
    # users of the compiler
    "report": {"errors", "files", "emit"},
    "campaign": {"processes", "errors", "files", "ir", "te"},
    "training": {"processes", "threads", "errors", "files", "ir", "walkers", "te", "report", "campaign"},
    "rig": {"processes", "errors", "files", "ir", "emit", "st", "project", "te", "driver", "report", "campaign"},
    "live": {"processes", "errors", "files", "ir", "emit", "st", "project", "proof", "te", "report", "campaign", "rig"},
    "reconcile": {
        "processes",
        "threads",
        "errors",
        "files",
        "ir",
        "emit",
        "project",
        "proof",
        "te",
        "driver",
        "report",
        "campaign",
        "rig",
    },
    # many axes: each goes through all of the above
    "fleet": {
        "threads",
        "errors",
        "files",
        "ir",
        "te",
        "campaign",
        "emit",
        "project",
        "proof",
        "driver",
        "report",
        "training",
        "rig",
        "reconcile",
    },
}
#: What stands on top and may use every room: the command line and the public functions.
TOP = {"cli", "testing", "__init__", "__main__"}
COMPILER = {"ir", "walkers", "passes", "emit", "project", "te", "beckhoff_ml", "driver"}


def module_name(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in FILES}


@functools.cache
def read():
    """Of every module: the modules of ours that it imports, also inside functions and for types, its texts, classes."""
    found = {}
    for module, path in MODULES.items():
        imported, texts, classes = set(), set(), []
        for node in ast.walk(ast.parse(path.read_text())):
            names = []
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [f"{node.module}.{alias.name}" for alias in node.names]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.Constant):
                texts.add(node.value)
            elif isinstance(node, ast.ClassDef):
                classes.append(node.name)
            for name in names:
                if name.partition(".")[0] == PACKAGE.name:
                    imported.add(name if name in MODULES else name.rpartition(".")[0])
        found[module] = imported, texts, classes
    return found


def imports():
    """Modules of ours that each module imports."""
    return {name: imported for name, (imported, *_) in read().items()}


def uses():
    """Modules of ours that each module imports, or names in a text to import them when they are needed."""
    named = {name for name in MODULES if "." in name}
    return {name: imported | (texts & named) for name, (imported, texts, _) in read().items()}


def room(name):
    return name.split(".")[1] if "." in name else "__init__"


def test_rooms_name_modules_that_are_there():
    """One module of a room, a room, or a command stands in backticks where a room says how it is made up."""
    for room, path in MODULES.items():
        if path.name == "__init__.py":
            said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            for name in re.findall(r"`([a-z_]{2,})`", said):
                assert {f"{room}.{name}", f"st_codegen.{name}", f"st_codegen.cli.{name}"} & MODULES.keys(), (room, name)


def test_there_are_files():
    assert len(FILES) > 20


def test_every_room_has_its_floor():
    assert {room(name) for name in MODULES} == MAY_USE.keys() | TOP


def test_the_page_names_every_room():
    page = (PACKAGE.parent / "docs" / "architecture.md").read_text("utf-8")
    assert not {name for name in MAY_USE if name and not re.search(rf"\b{name}\b", page)}


def test_a_room_uses_only_rooms_that_stand_above_it_in_the_table():
    above = set()
    for name, used in MAY_USE.items():
        assert used <= above, name
        above.add(name)


def test_imports_keep_to_the_table():
    wrong = [
        f"{name} uses {other}"
        for name, used in uses().items()
        for other in sorted(used)
        if room(name) not in TOP and room(other) not in MAY_USE[room(name)] | {room(name)}
    ]
    assert not wrong


def test_the_proof_shares_with_the_compiler_what_its_page_says():
    """Analyses of numbers, which bounds rest on, and names of what is printed; no layout, and nothing that prints."""
    prove = PACKAGE / "proof" / "prove"
    shared = set()
    for path in prove.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and re.match(r"st_codegen\.(passes|emit)\b", node.module or ""):
                shared |= {f"{node.module.removeprefix('st_codegen.')}.{alias.name}" for alias in node.names}
    assert shared == {
        *("passes.domain.magnitudes", "passes.jumps.largest_jump", "passes.kernels.factored"),
        *("emit.blocks.self_check.INTACT", "emit.output.block_of", "emit.blocks.model.AGE"),
        *("emit.blocks.model.input_variables", "emit.blocks.model.real_lines", "emit.blocks.model.renamed"),
    }


def circles():
    """Groups of modules that import each other, directly or through others."""
    reach = {name: set(used) for name, used in imports().items()}
    for middle, beyond in reach.items():
        for known in reach.values():
            if middle in known:
                known.update(beyond)
    inside = {name: known for name, known in reach.items() if name in known}
    return {frozenset(other for other in known if name in reach[other]) for name, known in inside.items()}


def test_no_module_imports_itself_through_others():
    found = [sorted(circle) for circle in circles()]
    assert not found


@pytest.mark.parametrize("name", ["te", "beckhoff_ml"])
def test_only_the_top_names_the_rooms_that_enter_themselves(name):
    """The compiler finds targets, purposes and kinds of files in its tables."""
    users = {room(other) for other, used in uses().items() if any(room(one) == name for one in used)} - {name}
    assert not users & (COMPILER | {"proof", "cost", "st"})


def test_types_of_arrays_have_their_names_in_one_place():
    """The reader of Structured Text uses nothing of the intermediate representation, and so has its own."""
    alias = re.compile(r"^\w+ = (?:\w+\.)*NDArray\[", re.M)
    owners = {name for name, path in MODULES.items() if alias.search(path.read_text())}
    assert {name for name in owners if room(name) not in {"st", "cost"}} == {"st_codegen.ir.arrays"}


def test_only_render_knows_jinja():
    users = [path for path in FILES if "jinja2" in path.read_text()]
    assert [path.stem for path in users] == ["render"]


#: Where the generator decides what blocks compute. The first file says in words what names mean.
LAID_OUT = [
    path
    for folder in ("emit/blocks", "te/compensation", "beckhoff_ml")
    for path in sorted((PACKAGE / folder).rglob("*.py"))
    if path.name != "wording.py"
]
TEMPLATES = sorted((PACKAGE.parent / "templates").rglob("*.j2"))
ARITHMETIC = (nodes.Add, nodes.Sub, nodes.Mul, nodes.Div, nodes.FloorDiv, nodes.Mod, nodes.Pow, nodes.Neg)
OPERATOR = re.compile(r"\s[-+*/<>=]+(\s|$)|\b(AND|OR|XOR|MOD|NOT)\b|\w\[|\w_TO_\w|^-")


def strings(path):
    """Line and text of the strings of a file but docstrings and comments; what is put in stands there as `x`."""
    tree = ast.parse(path.read_text())
    passed = set()
    for node in ast.walk(tree):
        if id(node) in passed:
            continue
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            passed.add(id(node.value))
        elif isinstance(node, ast.keyword) and node.arg == "comment":
            passed |= {id(part) for part in ast.walk(node)}
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("lreal", "dint", "boolean"):
            passed |= {id(part) for part in ast.walk(node.args[1])}  # these take the comment second
        elif isinstance(node, ast.JoinedStr):
            passed |= {id(part) for part in node.values}
            yield node.lineno, "".join(p.value if isinstance(p, ast.Constant) else "x" for p in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value


def is_expression(text):
    """Whether a text is an expression of ST that computes something, or one side of it."""
    if not OPERATOR.search(text):
        return False
    for whole in (text, f"x{text}", f"{text}x", f"x{text}x"):
        try:
            parse_segment(Segment(f"y := {whole};", "string"), "body")
        except StSyntaxError:
            continue
        return True
    return False


def test_no_structured_text_in_python_of_the_generator():
    """Templates lay out, Python decides: no statement of ST stands in a Python string."""
    for path in FILES:
        if room(module_name(path)) not in COMPILER or path.name == "library.py":  # what the vendor's library declares
            continue
        for line, text in strings(path):
            assert ":=" not in text, f"{path}:{line}"
            assert "END_" not in text or path.stem == "literals", f"{path}:{line}"


@pytest.mark.parametrize("path", LAID_OUT, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_no_expression_of_structured_text_in_python_of_the_generator(path):
    found = [f"{path}:{line}: {text}" for line, text in strings(path) if is_expression(text)]
    assert not found


@pytest.mark.parametrize(
    "text", ["x * x", " + x", "nBase + 3", "x[nColumn]", "LREAL_TO_REAL(x)", "-x", "a AND b", " * "]
)
def test_expressions_are_recognised(text):
    assert is_expression(text)


@pytest.mark.parametrize("text", ["nBase", "twincat", "anRank1", "columns, joined", "E_TEError", "1.5E-3", "x.fOut1"])
def test_names_numbers_and_words_are_not_taken_for_expressions(text):
    assert not is_expression(text)


def test_there_are_templates():
    assert len(TEMPLATES) > 50


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: "/".join(path.parts[-3:]))
def test_no_arithmetic_in_templates(path):
    """Python decides, templates lay out: numbers arrive as they are printed."""
    tree = Environment().parse(path.read_text())
    assert [node.lineno for kind in ARITHMETIC for node in tree.find_all(kind)] == []


#: Rooms of reconcile, from the floor up: each uses only what stands before it, `settings`, `outcome`, and itself.
RECONCILE = (
    "data", "fit", "mistakes", "rest", "search", "judge", "result", "core", "run", "spectrum",
    "plan", "models", "report",
)  # fmt: skip
#: What uses nothing of these, and nothing of these uses it.
ALONE = ("__init__", "settings", "outcome", "joint")


@pytest.mark.parametrize("path", sorted((PACKAGE / "reconcile").rglob("*.py")), ids=lambda path: path.stem)
def test_floors_of_reconcile(path):
    here = path.relative_to(PACKAGE / "reconcile").parts[0].removesuffix(".py")
    assert here in (*RECONCILE, *ALONE), "a new room has its floor"
    used, own = set(), (here,) if here in ALONE else RECONCILE[: RECONCILE.index(here) + 1]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("st_codegen.reconcile."):
            used.add(node.module.split(".")[2])
    assert used <= {"settings", "outcome", *own}


#: Dataclasses whose fields change: what one function gathers, and what a server keeps of a client.
CHANGING = set(
    """AxisValue BlockRun BlockTimes DeclaredUnit Entry Graph Lanes
    Listing LiveReport ModelReport NativeCall PathState Plc
    Slots WireVariable XmlFile _Call _Notification _PlcopenReader""".split()
)


def test_dataclasses_do_not_change_but_for_those_that_gather():
    found = set()
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            decorators = node.decorator_list if isinstance(node, ast.ClassDef) else []
            for text in map(ast.unparse, decorators):
                if text.partition("(")[0] == "dataclass" and "frozen=True" not in text:
                    found.add(node.name)
    assert found == CHANGING


#: How often a module pairs up only as many as both sides have, where one of them is longer on purpose.
OF_OTHER_LENGTH = {
    "proof.prove.execute": 1,
    "proof.prove.tree_proof": 1,
    "reconcile.spectrum": 1,
    "reconcile.plan.questions": 1,
    "reconcile.report.evidence": 1,
    "st.run.writer": 1,
    "training.page": 1,
    "walkers.onnx.graph": 1,
    "walkers.onnx.sums": 2,
    "walkers.sklearn.transforms": 1,
    "walkers.sklearn.trees": 1,
    "walkers.xgboost.model": 1,
}


def test_pairs_are_of_equal_length_but_where_one_side_is_longer_on_purpose():
    found = collections.Counter()
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            is_pairs = isinstance(node, ast.Call) and ast.unparse(node.func) == "zip" and len(node.args) > 1
            if is_pairs and "strict=True" not in map(ast.unparse, node.keywords):
                found[module_name(path).removeprefix("st_codegen.")] += 1
    assert found == OF_OTHER_LENGTH


def test_a_public_class_has_its_name_for_itself():
    homes = {}
    for module, (*_, classes) in read().items():
        for name in classes:
            if not name.startswith("_"):
                homes.setdefault(name, []).append(module)
    assert len(homes) > 200
    assert {name: modules for name, modules in homes.items() if len(modules) > 1} == {}


#: What stands at the top of the repository.
AT_THE_TOP = set(
    ".ci .gitattributes .github .gitignore .pre-commit-config.yaml .pre-commit-hooks.yaml CHANGELOG.md CONTRIBUTING.md "
    "LICENSE Makefile README.md SECURITY.md action.yml benchmarks checker docs examples golden mkdocs.yml profiles "
    "pyproject.toml requirements.lock site_tools st_codegen templates tests".split()
)


def test_nothing_strays_at_the_top_of_the_repository():
    """Files of a trial were once committed with everything else."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=PACKAGE.parent, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("no checkout: what belongs to the repository is not known")
    assert {name.partition("/")[0] for name in filter(None, listed.stdout.split("\0"))} == AT_THE_TOP


#: Functions whose answer has no order, or makes one.
_ORDERLESS = {"sorted", "set", "frozenset", "any", "all", "sum", "max", "min"}


def is_a_set(node):
    """Whether an expression is written as a set, or as what two sets or keys of dictionaries have in common."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitAnd | ast.BitOr | ast.Sub):
        return any(is_a_set(side) or ast.unparse(side).endswith(".keys()") for side in (node.left, node.right))
    is_call = isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("set", "frozenset")
    return is_call or isinstance(node, ast.Set | ast.SetComp)


def made_in_the_order_of_a_set(tree):
    """The lines at which a loop, a list, a dictionary or a text goes through a set: its order differs between runs."""
    inside = {}
    for node in ast.walk(tree):
        inside |= dict.fromkeys(map(id, ast.iter_child_nodes(node)), node)
    for node in ast.walk(tree):
        through = []
        if isinstance(node, ast.For):
            through = [node.iter]
        elif isinstance(node, ast.ListComp | ast.GeneratorExp | ast.DictComp):
            if getattr(getattr(inside[id(node)], "func", None), "id", "") not in _ORDERLESS:
                through = [part.iter for part in node.generators]
        elif isinstance(node, ast.List | ast.Tuple):
            through = [part.value for part in node.elts if isinstance(part, ast.Starred)]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in ("join", "list", "tuple"):
            through = node.args
        if any(map(is_a_set, through)):
            yield node.lineno


def test_nothing_is_made_in_the_order_of_a_set():
    found = [
        f"{module_name(path)}:{line}"
        for path in FILES
        for line in made_in_the_order_of_a_set(ast.parse(path.read_text("utf-8")))
    ]
    assert found == []


@pytest.mark.parametrize(
    ("text", "is_found"),
    [
        ("for x in {1, 2}: pass", True),
        ("for x in own.keys() & others: pass", True),
        ("y = [f(x) for x in set(z)]", True),
        ("y = ', '.join({f(x) for x in z})", True),
        ("y = [0, *(a & set(b))]", True),
        ("y = sorted(x for x in {1, 2})", False),
        ("for x in sorted({1, 2}): pass", False),
        ("for x in dict.fromkeys(z): pass", False),
    ],
)
def test_orders_of_sets_are_recognised(text, is_found):
    assert bool([*made_in_the_order_of_a_set(ast.parse(text))]) is is_found
