"""Tables and lists of the pages against the code that they speak of: names, defaults, limits, counts."""

import dataclasses
import re
import tomllib
from pathlib import Path

import pytest

from st_codegen.cli.choices import MISTAKES
from st_codegen.cli.main import _COMMANDS
from st_codegen.emit.blocks.self_test import FAULTS
from st_codegen.emit.targets import TARGETS
from st_codegen.fleet.axes import AxisOptions
from st_codegen.project.build_options import TABLE_KILOBYTES
from st_codegen.project.configuration import BUILD_KEYS
from st_codegen.training.families import FAMILIES
from st_codegen.walkers.limits import MAX_COLUMNS, Things, most

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


def page(name):
    return (DOCS / f"{name}.md").read_text(encoding="utf-8")


def rows(text, columns):
    """The cells of all rows of tables with so many columns."""
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    return [row for row in cells if len(row) == columns]


def test_the_page_of_commands_has_every_command_and_extra():
    text = page("commands")
    assert {word for word in _COMMANDS if f"`st-codegen {word}" not in text} == set()
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    listed = re.search(r"the extras are (.*?)\.\n", text, re.DOTALL)[1]
    assert set(re.findall(r"`(\w+)`", listed)) == extras.keys() - {"dev"}


def test_the_configuration_lists_every_key_of_build():
    listed = re.search(r"`\[build\]` takes (.*?)\. Not there", page("configuration"), re.DOTALL)[1]
    assert set(re.findall(r"`(\w+)`", listed)) == BUILD_KEYS.keys()


def test_the_page_on_fleets_has_every_option_of_an_axis():
    listed = {key: default for keys, default, _ in rows(page("fleet"), 3) for key in re.findall(r"`(\w+)`", keys)}
    defaults = {field.name: field.default for field in dataclasses.fields(AxisOptions)}
    assert defaults.keys() <= listed.keys()
    assert (listed["target"], listed["check"]) == (f"`{defaults['target']}`", f"`{defaults['check']}`")
    assert listed["most_orders"] == f'`"auto"`, {defaults["most_orders"]}'
    assert (listed["share"], listed["as_is"]) == ("`false`", "`false`")
    assert not defaults["share"] and not defaults["as_is"]


def test_the_limits_of_model_files_are_those_that_are_kept():
    text = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    found = {
        int(what.split()[-2].replace(",", "")): number for what, number in rows(text, 2) if what.endswith(" bytes")
    }
    assert found == {size: f"{most(size):,}" for _, size in (thing.value for thing in Things)}
    assert f"features and outputs of a model to {MAX_COLUMNS:,}" in text


def test_the_limits_of_targets_are_those_that_are_kept():
    _, _, *limits = (row[1:5] for row in rows(page("cost").partition("\n## Limits\n")[2].partition("\n## ")[0], 6))
    elements, mebibytes, kibibytes = limits
    for column, names in enumerate((("twincat",), ("iec", "plcopen", "codesys"), ("scl",), ("beckhoff-ml",))):
        kept = {TARGETS[name].limits for name in names}
        assert {f"{one.max_array:,}" for one in kept} == {elements[column]}
        assert {one.data_bytes for one in kept} == {int(mebibytes[column]) * 2**20}
    assert kibibytes == [str(TABLE_KILOBYTES)] * 3 + [""]  # the vendor's runtime has no tables of ours


def test_the_page_on_targets_has_each_bit_of_the_self_test_once():
    bits = [int(cells[2]) for cells in rows(page("targets"), 3) if cells[2].isdigit()]
    assert sorted(bits) == [1 << bit for bit in range(len(FAULTS))]


def test_the_pages_count_the_families_that_train_tries():
    assert sum("native" in family.forms for family in FAMILIES.values()) == 10
    assert "tries ten families" in page("reducer")
    row = next(line for line in page("training").splitlines() if line.startswith("| search |"))
    named = row.partition(" (`--families`)")[0].removeprefix("| search | ").replace(" and ", ", ").split(", ")
    assert named == [name for name, family in FAMILIES.items() if "native" in family.forms]
    assert all(re.search(rf"\b{name}\b", page("training")) for name in FAMILIES)


def test_the_page_on_reconcile_has_every_mistake_that_accept_takes():
    text = page("reconcile")
    assert [name for names in MISTAKES.values() for name in names if f"`{name}`" not in text] == []


PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")]
PAGES += [*DOCS.rglob("*.md"), *ROOT.glob("examples/*/README.md")]


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_what_a_page_names_of_the_repository_is_there(path):
    """Rules of the Makefile; files and folders, below the page or the top; programs that Python is given."""
    text = path.read_text(encoding="utf-8")
    rules = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert set(re.findall(r"(?:`|^    )make ([a-z][a-z-]*)", text, re.MULTILINE)) <= rules
    rooms = "st_codegen|tests|docs|examples|benchmarks|golden|checker|profiles|site_tools"
    named = re.findall(rf"[` ]((?:{rooms})/[\w./-]*\w)[` ]", text)
    named += [
        f"{module.replace('.', '/')}.py" for module in re.findall(r"python -m ((?:tests|site_tools)[\w.]+)", text)
    ]
    places = [(path.parent / name, ROOT / name, (ROOT / name).with_suffix("")) for name in named]
    assert [places[0] for places in places if not any(place.exists() for place in places)] == []
