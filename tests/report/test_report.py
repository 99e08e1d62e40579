"""Pages and pictures: well-formed, escaped, and the same bytes each time."""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser

import pytest
from lxml import etree

pytest.importorskip("matplotlib")

from st_codegen.report import PageSection, PageTable, figure, figures, page
from st_codegen.report.picture import panels


def draw(axes):
    axes.plot([0, 1, 2], [0.1, 0.3, 0.2], label="measured <TE> & more")
    axes.fill_between([0, 1], [0, 0], [1, 1], alpha=0.3)


def test_picture_is_one_svg_element_with_labels():
    svg = figure(draw, xlabel="angle in deg", ylabel="TE in deg", title="A title")
    root = etree.fromstring(svg)
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert "width" not in root.attrib
    assert "viewBox" in root.attrib
    text = " ".join(root.itertext())
    for label in ("angle in deg", "TE in deg", "A title", "measured <TE> & more"):
        assert label in text


def test_panels_and_empty_places():
    root = etree.fromstring(figures([("one", draw), ("two", draw), ("three", draw)]))
    text = " ".join(root.itertext())
    assert all(title in text for title in ("one", "two", "three"))


def test_same_bytes_in_another_process_on_another_day():
    code = (
        "from tests.report.test_report import draw; from st_codegen.report import figure;"
        "print(figure(draw, title='x'), end='')"
    )
    made = [
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed, "SOURCE_DATE_EPOCH": f"{seed}00000", "TZ": "Asia/Tokyo"},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in "12"
    ]
    assert made[0] == made[1] == figure(draw, title="x")


def test_numbers_stand_right_also_those_that_were_written_as_text_and_so_do_their_titles():
    table = PageTable(
        ("name", "rows", "bound", "id"),
        [("a", 3, "", "1"), ("b", "3,168", "2.6e-15", "A1"), ("c", 0.25, float("nan"), "")],
    )
    text = page("x", [PageSection("y", table=table)])
    head, *rows = re.findall("<tr>(.*?)</tr>", text)
    right = [[" class" in cell for cell in re.findall("<t[dh][^>]*>", row)] for row in (head, *rows)]
    assert ["".join("LR"[cell] for cell in row) for row in right] == ["LRRL", "LRLR", "LRRL", "LRRL"]
    short = page("x", [PageSection("y", table=PageTable(("a", "b"), [("one",), ("two", "")]))])
    assert "<th class" not in short


class _Balance(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.texts = [], []

    def handle_starttag(self, tag, attrs):
        if tag not in {"meta"}:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def test_page_is_balanced_and_escaped():
    table = PageTable(("order", "<b>MAE</b>"), [(1, 2.53e-5), (39, None), ("all", True)], strong={(0, 1)})
    text = page(
        "T & <E>",
        [PageSection("One", "first\n\nsecond <script>", table, (figure(draw),)), PageSection("Two", details="a < b")],
        summary="In short.",
    )
    parser = _Balance()
    parser.feed(text)
    assert parser.open == []
    for shown in ("T & <E>", "first", "second <script>", "<b>MAE</b>", "2.53e-05", "yes", "a < b", "In short."):
        assert any(shown in part for part in parser.texts), shown
    assert "<script" not in text
    assert "<strong>2.53e-05</strong>" in text
    assert "http://www.w3.org/2000/svg" in text


def test_markdown():
    table = PageTable(("order", "MAE"), [(1, 0.5), (2, "a|b")], strong={(0, 1)})
    assert table.markdown() == "| order | MAE |\n|---|---|\n| 1 | **0.5** |\n| 2 | a\\|b |\n"


def test_dollar_signs_in_labels_are_text():
    odd = r"price $\nothing$ of $x"

    def draw(axes):
        axes.plot([1, 2], [1, 1e6], label=odd)
        axes.set_yscale("log")
        axes.text(1, 1, odd)

    picture = re.sub("<!--.*?-->", "", figure(draw, xlabel=odd, ylabel=odd, title=odd), flags=re.DOTALL)
    assert picture.count(odd) == 5
    assert "mathdefault" not in picture  # the exponents of the scale are still formulas


@pytest.mark.filterwarnings("error")
def test_a_title_of_a_hundred_orders_leaves_room_for_its_panel():
    """Axes collapsed to nothing, and Matplotlib said so in the terminal."""
    (shown,) = panels(
        [(", ".join(f"order {number} is changed at 1800 rpm" for number in range(100)), lambda axes: None)]
    )
    assert "order 0 is changed" in shown and "order 50 is" not in shown and ".." in shown
