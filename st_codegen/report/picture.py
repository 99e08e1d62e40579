"""Pictures as SVG over Matplotlib: the same bytes for the same data, no dates, no global state."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from st_codegen.errors import MissingExtraError

#: a palette that colour-blind readers can tell apart (Okabe and Ito)
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")

#: Draws into Matplotlib axes.
Draw = Callable[[Any], object]

_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "st-codegen",
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
}
_CENTIMETRE = 1 / 2.54
#: letters of a title beside each other, with room for fonts that run wide
_LETTERS_PER_CM = 3.6


def figure(
    draw: Draw, *, xlabel: str = "", ylabel: str = "", title: str = "", size_cm: tuple[float, float] = (16, 7)
) -> str:
    """One picture. `draw(axes)` is given Matplotlib axes; a legend appears where lines have labels. Returns SVG text.

    Raises MissingExtraError without Matplotlib.
    """

    def labelled(axes: Any) -> None:
        draw(axes)
        axes.set(xlabel=xlabel, ylabel=ylabel)

    return figures([(title, labelled)], columns=1, size_cm=size_cm)


def figures(panels: Sequence[tuple[str, Draw]], *, columns: int = 2, size_cm: tuple[float, float] = (8, 6)) -> str:
    """Several panels (title, draw) in one SVG, `columns` side by side, `size_cm` (width, height) each."""
    try:
        import matplotlib as mpl
        from cycler import cycler
        from matplotlib.backends.backend_svg import FigureCanvasSVG
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError("matplotlib", "report", "drawing pictures") from None
    rows = -(-len(panels) // columns)
    with mpl.rc_context():
        mpl.rcdefaults()  # not the reader's own settings
        mpl.rcParams.update(_STYLE)
        mpl.rcParams["axes.prop_cycle"] = cycler(color=COLOURS)
        width, height = size_cm[0] * columns * _CENTIMETRE, size_cm[1] * rows * _CENTIMETRE
        canvas = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasSVG(canvas)
        grid = canvas.subplots(rows, columns, squeeze=False)
        for number, axes in enumerate(grid.flat):
            if number >= len(panels):
                axes.set_axis_off()
                continue
            title, draw = panels[number]
            draw(axes)
            axes.set_title(title)
            if axes.get_legend() is None and axes.get_legend_handles_labels()[0]:
                axes.legend()
            _show_as_they_are(axes)
        text = io.StringIO()
        canvas.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    return _embeddable(text.getvalue())


def panels(shown: Sequence[tuple[str, Draw]], *, size_cm: tuple[float, float] = (11, 7.5)) -> list[str]:
    """Panels (title, draw) as an SVG each, which a page puts side by side where it is wide enough.

    Titles end after four lines: longer ones, as of a hundred orders, would leave no room for the panel.
    """
    fill = partial(textwrap.fill, width=int(size_cm[0] * _LETTERS_PER_CM), max_lines=4, placeholder=" ..")
    return [figures([(fill(title), draw)], columns=1, size_cm=size_cm) for title, draw in shown]


def _show_as_they_are(axes: Any) -> None:
    """Titles and labels come from data: dollar signs in them are no formulas."""
    legend = axes.get_legend()
    labels = [axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
    for text in labels + ([] if legend is None else list(legend.get_texts())):
        text.set_parse_math(False)


def _embeddable(svg: str) -> str:
    """Without the head of an XML file, and scaling with the page."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r'<svg (.*?)width="[\d.]+pt"', r"<svg \1", body, count=1, flags=re.DOTALL)
    body = re.sub(r'<svg (.*?)height="[\d.]+pt"', r"<svg \1", body, count=1, flags=re.DOTALL)
    return re.sub(r"[ \t]+\n", "\n", body)
