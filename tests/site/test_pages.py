"""The site: built strictly, its generated pages complete, its examples run."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from site_tools import commands, gallery, problems
from site_tools.markdown import for_the_site, with_pages
from st_codegen.cli.main import _COMMANDS
from st_codegen.diagnostics import DIAGNOSTICS
from tests.cli.helpers import run

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


@pytest.mark.thorough
def test_the_site_is_built_with_every_link_checked_and_loads_nothing_from_elsewhere(tmp_path):
    pytest.importorskip("mkdocstrings")
    pytest.importorskip("material")
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, timeout=1800, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    python = (tmp_path / "reference" / "python.html").read_text(encoding="utf-8")
    assert "Compile and write" in python or "st_codegen.generate" in python
    assert all((tmp_path / f"{path.relative_to(DOCS).with_suffix('.html')}").is_file() for path in DOCS.rglob("*.md"))


def test_the_reference_has_every_command_and_option():
    text = commands.page()
    for name in _COMMANDS:
        assert re.search(rf"^### st-codegen {name}$", text, re.MULTILINE), name
    assert "`--cycle-us" in text
    assert "#### st-codegen simulate motion" in text


def test_every_code_has_a_section():
    headings = re.findall(r"^### (STC\d{4}): ", problems.page(), re.MULTILINE)
    assert headings == sorted({entry.code for entry in DIAGNOSTICS})


def test_the_gallery_shows_each_layout_with_short_tables():
    text = gallery.page()
    assert all(f": {layout}\n" in text for layout in ("table", "ranked trees", "as trained", "factored kernel"))
    assert text.count("END_FUNCTION_BLOCK") == len(gallery.SHOWN)
    assert max(len(code.splitlines()) for code in re.findall(r"```iecst\n(.*?)```", text, re.DOTALL)) < 300


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("text\n- a\n- b\nmore", "text\n\n- a\n- b\nmore"),
        ("1. a\n   - b\n2. c", "1. a\n    - b\n2. c"),
        ("text\n| a |\n|---|", "text\n\n| a |\n|---|"),
        ("text\n\n    - code\n", "text\n\n    - code\n"),
        ("```\na\n- b\n```", "```\na\n- b\n```"),
    ],
)
def test_markdown_of_code_hosts_becomes_that_of_the_generator(written, read):
    assert for_the_site(written) == read


def test_links_to_files_go_to_their_pages():
    pages = {"../SECURITY.md": "repository/security.md"}
    assert with_pages("[a](../SECURITY.md#limits) [b](b.md)", pages) == "[a](repository/security.md#limits) [b](b.md)"


def test_the_page_on_condition_monitoring_does_what_it_says(tmp_path, monkeypatch):
    pytest.importorskip("skops")
    text = (DOCS / "monitoring.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    exec(re.search(r"```python\n(.*?)```", text, re.DOTALL)[1], {})
    assert run("init", "models/") == 0
    configured = Path("models/st-codegen.toml").read_text(encoding="utf-8")
    for old, new in (("fF0", "fRms"), ("fF1", "fCrest"), ("fF2", "fTemperature_degC")):
        configured = configured.replace(old, new)
    Path("models/st-codegen.toml").write_text(configured, encoding="utf-8")
    assert run("models/", "--target", "twincat", "--out", "plc", "-q") == 0
    block = Path("plc/twincat/POUs/FB_State.TcPOU").read_text(encoding="utf-8")
    assert [re.search(r"Class (\d): '(\w+)'", line).groups() for line in block.splitlines() if "  Class" in line] == [
        ("0", "dry"),
        ("1", "healthy"),
        ("2", "worn"),
    ]
    assert "Class 0: -1" in Path("plc/twincat/POUs/FB_Known.TcPOU").read_text(encoding="utf-8")
    assert all(f"{name} : LREAL" in block for name in ("fRms", "fCrest", "fTemperature_degC"))
    assert "Worn := 2" in Path("plc/twincat/DUTs/E_StateClass.TcDUT").read_text(encoding="utf-8")


def test_the_five_steps_use_the_files_of_the_example():
    page = (DOCS / "first_block.md").read_text(encoding="utf-8")
    example = (ROOT / "examples/user_repository/models/st-codegen.toml").read_text(encoding="utf-8")
    bare = {re.sub(r"\s*#.*", "", line.strip()) for line in page.splitlines()}
    wanted = {line.strip() for line in example.splitlines()} - {'leave_out = ["notes.txt"]'}
    assert wanted <= bare
    block = (ROOT / "examples/user_repository/plc/twincat/POUs/FB_PumpPower.TcPOU").read_text(encoding="utf-8")
    for variable in ("fSpeed_rpm", "fPressure_bar", "fPower_kW", "bValid", "bInRange", "bPlausible"):
        assert variable in page
        assert f"{variable} : " in block
