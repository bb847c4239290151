"""Drawing with what was measured before: the same files, and matplotlib as it was."""

import contextlib
import io

import matplotlib
import numpy as np
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG

from experiments.report.figures.style import styled, subplots
from experiments.report.page import Drawing
from experiments.report.quick_drawing import quick_drawing


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
    buffer = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": "name", "svg.fonttype": "path"}):
        FigureCanvasSVG(figure)
        figure.get_layout_engine().execute(figure)
        figure.set_layout_engine(None)
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def test_files_are_the_same():
    assert Drawing("name", drawn()).svg.encode() == plainly(drawn())


def test_a_pdf_comes_from_the_same_layout():
    both = Drawing("name", drawn())
    assert both.svg
    assert both.pdf.startswith(b"%PDF")
    assert both.figure.get_layout_engine() is None


def replaced():
    return Axis._update_ticks, Axis.get_major_ticks, Axis.get_minor_ticks, RendererSVG.get_text_width_height_descent


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
