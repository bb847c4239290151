"""Report pages: an answer, then sections of text, tables and plots, in one self-contained HTML
file.
"""

import functools
import io
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Union

import jinja2
import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure

from experiments.common import zoom
from experiments.common.chart import Chart
from experiments.common.results import FIGURES_FOLDER, REPORT_FILE
from experiments.common.table import MISSING, Table

# a figure, several figures to show side by side if there is room, or none; charts zoom on the page
Drawing = Figure | Chart | Sequence[Figure | Chart] | None


@dataclass(frozen=True)
class Drawn:
    """A drawn figure, as the contents of its files."""

    name: str
    svg: str
    """Text of a reproducible SVG file, with letters as outlines so that no font is needed."""
    pdf: bytes = b""
    """Contents of a PDF file, if one was drawn."""
    is_narrow: bool = False
    """True for a single panel, which is not stretched to the page's width."""
    live: Markup | None = None
    """The chart that replaces the figure on the page, for `zoom.LOADER`; None for a figure."""

    @property
    def inline(self) -> Markup:
        """An <svg> element whose ids are unique on the page."""
        text = re.sub(
            r"<metadata>.*?</metadata>|<!--.*?-->",
            "",
            self.svg[self.svg.index("<svg") :],
            flags=re.DOTALL,
        )
        text = re.sub(r'( id="|xlink:href="#|url\(#)', rf"\g<1>{self.name}-", text)
        text = re.sub(r"\n\s*", "\n", text)
        return Markup(text.replace("<svg ", '<svg aria-hidden="true" ', 1))

    def write(self, folder: Path) -> None:
        """Write folder/NAME.svg and, if there is one, NAME.pdf."""
        (folder / f"{self.name}.svg").write_text(self.svg, encoding="utf-8")
        if self.pdf:
            (folder / f"{self.name}.pdf").write_bytes(self.pdf)


def drawn(name: str, drawing: Figure | Chart, pdf: bool = False) -> Drawn:
    """Draw a figure or chart as SVG and, with `pdf`, also as PDF."""
    if isinstance(drawing, Chart):
        live = zoom.zoomable(drawing)
        figure = drawing.figure()
    else:
        live = None
        figure = drawing
    with matplotlib.rc_context({"svg.hashsalt": name, "svg.fonttype": "path", "pdf.fonttype": 42}):
        svg = io.BytesIO()
        pages = io.BytesIO()
        figure.savefig(svg, format="svg", metadata={"Date": None})
        if pdf:
            figure.set_layout_engine("none")  # the layout is that of the page
            figure.savefig(pages, format="pdf", metadata={"CreationDate": None})
    is_narrow = figure.get_figwidth() < 6.0
    return Drawn(name, svg.getvalue().decode(), pages.getvalue(), is_narrow, live)


@dataclass(frozen=True)
class Plot:
    """A figure on a page, which is also written to a file."""

    name: str
    """Name of the file and of the page's element; if there are several panels, file names also
    contain their titles.
    """
    figure: Drawing | Callable[[], Drawing]
    """The figure, or a function that makes it when the page is written; a plot without a figure is
    left out.
    """
    heading: str
    caption: str = ""
    """Text or Markup; the page appends seed, ground and command in small print."""


def drawn_plot(plot: Plot, pdf: bool = False) -> tuple[Drawn, ...]:
    """Draw a plot's figure or its panels; the result is empty if the plot has no figure."""
    figure = plot.figure() if callable(plot.figure) else plot.figure
    if figure is None:
        return ()
    if isinstance(figure, Figure | Chart):
        return (drawn(plot.name, figure, pdf),)
    return tuple(drawn(f"{plot.name}_{file_name(_title(part))}", part, pdf) for part in figure)


def _title(drawing: Figure | Chart) -> str:
    """The title of a figure's first axes, or of a chart."""
    if isinstance(drawing, Chart):
        return drawing.title
    return drawing.axes[0].get_title(loc="left")


@dataclass(frozen=True)
class Bullets:
    """A bulleted list."""

    items: Sequence[str]


@dataclass(frozen=True)
class Pictures:
    """Image files in the page's folder, shown as thumbnails."""

    files: Sequence[str]
    description: str


@dataclass(frozen=True)
class Section:
    """A heading and the blocks below it, in order; a nested section has a smaller heading."""

    heading: str
    blocks: Sequence[Union["Block", None]]
    """Contents of the section. None and empty sections are left out. A str is a paragraph; Markup
    keeps its tags.
    """
    folded: bool = False
    """Whether the section is collapsed until its heading is clicked; for methods and rarely needed
    details.
    """

    @property
    def anchor(self) -> str:
        """The section's id on the page."""
        return file_name(self.heading)

    def __bool__(self) -> bool:
        return any(self.blocks)


Block = str | Table | Plot | Bullets | Pictures | Section


def _all_blocks(blocks: Iterable[Block | None]) -> Iterator[Block]:
    for block in blocks:
        if block:
            yield block
        if isinstance(block, Section):
            yield from _all_blocks(block.blocks)


@dataclass(frozen=True)
class Answer:
    """The answer to the reader's question, or what is wrong with it, at the top of a page."""

    heading: str
    """The answer itself, in a few words and a number."""
    facts: Sequence[tuple[str, str]] = ()
    """Quantities, and their values with ± and unit."""
    lines: Sequence[str] = ()
    """Further sentences, such as the improvement over today's method."""
    warnings: Sequence[str] = ()
    """Remarks that limit the answer."""
    alarms: Sequence[str] = ()
    """Reasons not to trust the answer, which stand in place of the heading."""
    next: Sequence[str] = ()
    """Command lines to run next."""


@dataclass(frozen=True)
class Page:
    """A page, written together with its figures."""

    title: str
    command: str
    """The command line that made the page."""
    manifest: Mapping[str, Any]
    """Configuration, versions, seed and anything else that fits into JSON; listed at the end of the
    page.
    """
    sections: Sequence[Section | None]
    intro: Sequence[Block | None] = ()
    """Blocks below the title and the answer."""
    answer: Answer | None = None

    @property
    def blocks(self) -> Iterator[Block]:
        """All blocks on the page, in order; a section is followed by the blocks in it."""
        return _all_blocks((*self.intro, *self.sections))

    def write(self, folder: Path, pdf: bool = False) -> None:
        """Write the page, and each figure as figures/NAME.svg and, with `pdf`, as NAME.pdf."""
        figures = self._figures(pdf)
        (folder / REPORT_FILE).write_text(self.html(figures), encoding="utf-8")
        (folder / FIGURES_FOLDER).mkdir()
        for figure in itertools.chain(*figures.values()):
            figure.write(folder / FIGURES_FOLDER)

    def _figures(self, pdf: bool = False) -> dict[str, tuple[Drawn, ...]]:
        """Draw the figures of all plots, by the plot's name."""
        return {
            block.name: drawn_plot(block, pdf) for block in self.blocks if isinstance(block, Plot)
        }

    def html(self, figures: Mapping[str, Sequence[Drawn]] | None = None) -> str:
        """The page's HTML; `figures` are the plots' figures by plot name, if they have been drawn
        already.
        """
        manifest = []
        for name, value in flatten(self.manifest):
            is_unset_option = value == MISSING and name.startswith("config.")
            if not is_unset_option:
                manifest.append((name, value))
        if figures is None:
            figures = self._figures()
        is_live = any(part.live for parts in figures.values() for part in parts)
        return _template().render(
            vars(self),
            sections=[section for section in self.sections if section],
            figures=figures,
            scripts=[zoom.library(), zoom.LOADER] if is_live else [],
            conditions=conditions(self.manifest, self.command),
            manifest=manifest,
        )


@functools.cache
def _template() -> jinja2.Template:
    """The template of all pages, compiled once."""
    loader = jinja2.PackageLoader("experiments.common", "")
    undefined = jinja2.StrictUndefined
    pages = jinja2.Environment(
        loader=loader, undefined=undefined, autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    return pages.get_template("page.html.j2")


def conditions(manifest: Mapping[str, Any], command: str) -> str:
    """Seed, ground and command on one line, for captions; items missing from the manifest are left
    out.
    """
    seed = manifest.get("seed")
    ground = manifest.get("ground")
    parts = []
    if seed is not None:
        seeds = ", ".join(map(str, seed)) if isinstance(seed, list | tuple) else seed
        parts.append(f"seed {seeds}")
    if isinstance(ground, Mapping):
        parts.append(_ground(ground))
    if command:
        parts.append(command)
    return " · ".join(parts)


def _ground(ground: Mapping[str, Any]) -> str:
    """Describe a ground's friction, shear and slope, or list the names of several grounds."""
    if "along" not in ground:
        return f"grounds {', '.join(ground)}"
    text = f"ground: friction {ground['along']:g} along, {ground['across']:g} across"
    if ground.get("shear"):
        text += f", shear {1e3 * ground['shear']:g} mm"
    if ground.get("slope"):
        text += f", slope {ground['slope']:.3g} rad, uphill {ground.get('uphill', 0.0):.3g} rad"
    return text


def file_name(text: str) -> str:
    """A title as a file name: lower-case letters and digits, with underscores for everything
    else.
    """
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


def flatten(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Dotted names and printed values of all entries in nested mappings."""
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from flatten(item, f"{path}.{key!s}" if path else str(key))
    elif path:
        items = value if isinstance(value, list | tuple) else [value]
        if value is None or value == {}:
            items = []
        yield path, ", ".join(str(item) for item in items) or MISSING
