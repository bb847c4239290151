"""Drawing with what was measured before: files that show the same, and matplotlib as it was."""

import contextlib
import io
import re
from xml.etree import ElementTree

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.text import Text

from experiments.report.figures.style import styled, subplots
from experiments.report.page import Drawing
from experiments.report.quick_drawing import quick_drawing

SVG = "{http://www.w3.org/2000/svg}"
LINK = "{http://www.w3.org/1999/xlink}href"
NUMBER = re.compile(r"(?<![#\w.])-?\d+\.?\d*")


@styled
def drawn():
    figure, axes = subplots(4.0, 2, 2, sharex=True)
    x = np.linspace(0.1, 9, 40)
    for k, axis in enumerate(axes.ravel()):
        axis.plot(x, np.exp(0.9 * k * x), label="e$_x$ of 10")
        axis.set(xlabel="x [m]", ylabel="a quantity [mm]", title="Growth")
        axis.legend()
    axes[1, 1].set_yscale("log")
    axes[1, 0].set_aspect("equal", adjustable="datalim")
    figure.legend(loc="outside lower center")
    return figure


def plainly(figure):
    """The file as matplotlib draws it, ticks found and texts measured whenever it likes."""
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": "name", "svg.fonttype": "path"}):
        FigureCanvasSVG(figure)
        figure.get_layout_engine().execute(figure)
        figure.set_layout_engine(None)
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def marks(svg):
    """What a file shows: the numbers (n, ...) of n pieces without a move of the pen in them, by what else they are."""
    root = ElementTree.fromstring(svg)
    defined = {part.get("id"): part for group in root.iter(f"{SVG}defs") for part in group}
    found = {}

    def add(outline, style, *place):
        visible = {key: value for key, value in style.items() if (key, value) != ("fill", "#000000")}
        text = f"{outline} {' '.join(place)}"
        kind = NUMBER.sub("0", text).split(), sorted(visible.items())
        found.setdefault(str(kind), []).append([float(number) for number in NUMBER.findall(text)])

    def walk(part, style, place):
        style = style | look(part)
        if part.tag == f"{SVG}use":
            x, y, *_ = [*NUMBER.findall(part.get("transform", "")), "0", "0"]
            shape = defined[part.get(LINK)[1:]]
            add(shape.get("d", ""), look(shape) | style, place, part.get("x", x), part.get("y", y))
        for piece in part.get("d", "").split("M"):
            if piece.strip():
                add(piece, style, place)
        for child in part:
            if child.tag != f"{SVG}defs":
                walk(child, style, place + part.get("transform", "").replace("rotate(-0)", ""))

    walk(root, {}, "")
    return found


def look(part):
    """The style of an element, wherever it is written."""
    css = dict(entry.split(": ") for entry in part.get("style", "").split("; ") if entry)
    return css | ({"fill": part.get("fill")} if part.get("fill") else {})


def test_files_show_the_same():
    ours, theirs = marks(Drawing("name", drawn()).svg), marks(plainly(drawn()))
    assert ours.keys() == theirs.keys()
    for kind, numbers in theirs.items():
        np.testing.assert_allclose(ours[kind], numbers, atol=0.01, err_msg=kind)


def test_a_pdf_comes_from_the_same_layout():
    both = Drawing("name", drawn())
    assert both.svg
    assert both.pdf.startswith(b"%PDF")
    assert both.figure.get_layout_engine() is None


def replaced():
    return (
        Axis._update_ticks,
        Axis.draw,
        Axis.get_major_ticks,
        Axis.get_minor_ticks,
        Axes.get_tightbbox,
        Text._get_layout,
    )


def test_matplotlib_is_as_it_was():
    before = replaced()
    with contextlib.suppress(KeyError), quick_drawing():
        assert not set(before) & set(replaced())
        raise KeyError
    assert replaced() == before


def test_other_limits_have_other_ticks():
    _, axis = subplots(3.0)
    with quick_drawing():
        axis.set_xlim(0, 1)
        few = [tick.get_loc() for tick in axis.xaxis._update_ticks()]
        axis.set_xlim(0, 50)
        many = [tick.get_loc() for tick in axis.xaxis._update_ticks()]
    assert max(few) <= 1 < max(many)
