"""README: short, its two commands, links that lead somewhere, pictures that are drawn from their records."""

import re
from pathlib import Path

import pytest

from site_tools import pictures

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_it_is_short_and_starts_with_a_picture():
    lines = README.splitlines()
    assert len(lines) < 120
    assert any(line.startswith("![") for line in lines[:8])


def test_other_programs_find_the_two_commands():
    commands = [line.split("#")[0].strip() for line in README.splitlines() if line.startswith("    make ")]
    assert commands == ["make run", "make test"]
    rules = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert {"run", "test"} <= rules


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"])
def test_its_links_lead_to_files(page):
    links = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", (ROOT / page).read_text(encoding="utf-8"))
    local = [link for link in links if "://" not in link]
    assert [link for link in local if not (ROOT / link).exists()] == []


def test_every_page_is_reached_from_it():
    """Five pages were linked from the start of the site alone, which nobody sees who reads the repository."""
    found, left = set(), [ROOT / "README.md"]
    while left:
        page = left.pop()
        if page.is_file() and page not in found:
            found.add(page)
            links = re.findall(r"\]\(([^)#]+\.md)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
            left += [(page.parent / link).resolve() for link in links if "://" not in link]
    # the start of the site has the README's place there
    assert {page.name for page in {*(ROOT / "docs").glob("*.md")} - found} == {"index.md"}


def test_the_structured_text_that_it_shows_is_generated():
    linked = re.search(r"\]\((golden/[^)]*\.st)\)\):\n\n((?:(?:    .*)?\n)+)", README)
    assert linked is not None
    shown = [line[4:] for line in linked.group(2).strip("\n").splitlines()]
    assert len(shown) > 10
    assert "\n".join(shown) in (ROOT / linked.group(1)).read_text(encoding="utf-8")


@pytest.mark.parametrize("name", sorted(pictures.DRAWN))
def test_a_picture_is_what_is_drawn_from_its_record(name):
    drawn = pictures.DRAWN[name](pictures.PICTURES)
    assert (pictures.PICTURES / name).read_text(encoding="utf-8") == drawn, "python -m site_tools.pictures"
    assert "http" not in drawn.replace("http://www.w3.org/2000/svg", "")


def test_the_terminal_shows_commands_that_the_page_explains():
    shown = [
        line[2:] for line in (pictures.PICTURES / "terminal.txt").read_text("utf-8").splitlines() if line[:1] == "$"
    ]
    assert tuple(shown) == pictures.COMMANDS


@pytest.mark.thorough
def test_the_terminal_shows_what_its_commands_print(tmp_path):
    """A sentence of `prove` had changed, and the picture had the one before."""
    pictures.record_terminal(tmp_path, tmp_path)
    record = (pictures.PICTURES / "terminal.txt").read_text(encoding="utf-8")
    assert (tmp_path / "terminal.txt").read_text(encoding="utf-8") == record, "python -m site_tools.pictures --record"
