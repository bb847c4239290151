"""Pages of a report: sections of text, tables and plots, as one HTML file that needs no other."""

from __future__ import annotations

import functools
import io
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import jinja2
import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure

from experiments.common.formats import MISSING
from experiments.common.manifest import relative
from experiments.common.results import FIGURES_FOLDER, REPORT_FILE
from experiments.common.table import Table

_NARROW = 400.0  # width of a figure that shares its line with others [pt]


@dataclass(frozen=True)
class Drawn:
    """A figure as the text of files, which can be sent from one process to another."""

    name: str
    """Descriptive, of letters, digits and underscores."""
    svg: str
    """The text of an SVG file, reproducible, with letters as outlines so that it needs no font."""
    pdf: bytes = b""
    """A PDF file, if one was wanted."""

    @property
    def inline(self) -> Markup:
        """An <svg> element whose ids are unique on the page."""
        text = self.svg[self.svg.index("<svg") :]
        text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
        for reference in (' id="', 'xlink:href="#', "url(#"):
            text = text.replace(reference, f"{reference}{self.name}-")
        text = re.sub(r"\n\s*", "\n", text)
        return Markup(text.replace("<svg ", '<svg aria-hidden="true" ', 1))

    @property
    def is_narrow(self) -> bool:
        """True for one panel, which a page does not stretch to its width."""
        return float(re.findall(r'width="([\d.]+)pt"', self.svg)[0]) < _NARROW

    def write(self, folder: Path) -> None:
        """Write folder/NAME.svg and, if there is one, NAME.pdf."""
        (folder / f"{self.name}.svg").write_text(self.svg, encoding="utf-8")
        if self.pdf:
            (folder / f"{self.name}.pdf").write_bytes(self.pdf)


def drawn(name: str, figure: Figure, pdf: bool = False) -> Drawn:
    """Draw a figure, with `pdf` also as PDF."""
    with matplotlib.rc_context({"svg.hashsalt": name, "svg.fonttype": "path", "pdf.fonttype": 42}):
        svg = _saved(figure, "svg", Date=None).decode()
        return Drawn(name, svg, _saved(figure, "pdf", CreationDate=None) if pdf else b"")


def _saved(figure: Figure, file_format: str, **metadata: None) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format=file_format, metadata=metadata)
    return buffer.getvalue()


Drawing = Figure | Sequence[Figure] | None
"""A figure, several that are shown side by side where there is room, or none."""


@dataclass(frozen=True)
class Plot:
    """A figure on a page, and its file."""

    name: str
    """Of the file and of the element on the page; files of several panels are named after their titles, too."""
    figure: Drawing | Callable[[], Drawing]
    """Or what makes it, when and where the page is written; a plot of None is left out."""
    heading: str
    caption: str = ""
    """Text, or Markup."""
    conditions: str | None = None
    """In small print below the caption; by default seed, ground and command."""

    kind: ClassVar[str] = "plot"


def drawn_plot(plot: Plot, pdf: bool = False) -> tuple[Drawn, ...]:
    """Draw the figure of a plot, or its panels; nothing if there is no figure."""
    made = plot.figure() if callable(plot.figure) else plot.figure
    if made is None:
        return ()
    if isinstance(made, Figure):
        return (drawn(plot.name, made, pdf),)
    titles = [file_name(panel.axes[0].get_title(loc="left")) for panel in made]
    return tuple(drawn(f"{plot.name}_{title}", panel, pdf) for title, panel in zip(titles, made, strict=True))


@dataclass(frozen=True)
class Note:
    """A paragraph of less weight."""

    text: str

    kind: ClassVar[str] = "note"


@dataclass(frozen=True)
class Bullets:
    """A list."""

    items: Sequence[str]

    kind: ClassVar[str] = "bullets"


@dataclass(frozen=True)
class Pictures:
    """Files in the page's folder, shown as thumbnails."""

    files: Sequence[str]
    description: str

    kind: ClassVar[str] = "pictures"


@dataclass(frozen=True)
class Section:
    """A heading and what is below it, in order; a section in a section has a smaller heading."""

    heading: str
    blocks: Sequence[Block | None]
    """None is left out, and so is a section of nothing. A str is a paragraph; Markup keeps its tags."""
    folded: bool = False
    """Collapse it until its heading is clicked: methods, and what few readers decide by."""

    kind: ClassVar[str] = "section"

    @property
    def anchor(self) -> str:
        """Its id on the page."""
        return file_name(self.heading)

    def __bool__(self) -> bool:
        return any(self.blocks)


Block = str | Table | Plot | Note | Bullets | Pictures | Section
Figures = Mapping[str, Sequence[Drawn]]
"""The figures of each plot, by its name."""
Draw = Callable[[Callable[[Plot], tuple[Drawn, ...]], Iterable[Plot]], Iterable[tuple[Drawn, ...]]]


def draw_plots(
    blocks: Iterable[Block | None], pdf: bool = False, draw: Draw = map
) -> Iterator[tuple[str, tuple[Drawn, ...]]]:
    """Draw all plots among some blocks: their names and figures, with `pdf` also as PDF.

    `draw` calls a function with each plot, in order; that of a process pool begins at once to draw them side by side.
    """
    plots = [block for block in all_blocks(blocks) if isinstance(block, Plot)]
    figures = draw(functools.partial(drawn_plot, pdf=pdf), plots)
    return zip([plot.name for plot in plots], figures, strict=True)


def all_blocks(blocks: Iterable[Block | None]) -> Iterator[Block]:
    """Everything in some blocks, in order; a section is followed by its blocks."""
    for block in blocks:
        if block:
            yield block
            if isinstance(block, Section):
                yield from all_blocks(block.blocks)


def warnings(lines: Sequence[str]) -> Section | None:
    """A section of warnings, if there are any."""
    return Section("Warnings", [Bullets([f"{line}." for line in lines])]) if lines else None


@dataclass(frozen=True)
class Answer:
    """The first thing on a page: the answer that its reader came for."""

    heading: str
    """The answer itself, in a few words with its number."""
    facts: Sequence[tuple[str, str]] = ()
    """Quantities and their values with ± and unit."""
    lines: Sequence[str] = ()
    """Sentences: the gain over today, the one thing to know."""
    warnings: Sequence[str] = ()
    next: Sequence[str] = ()
    """Command lines to run next."""


@dataclass(frozen=True)
class Page:
    """A page, which is written with its figures."""

    title: str
    command: str
    """The command line that made it."""
    manifest: Mapping[str, Any]
    """Configuration, versions, seed: anything that fits into JSON; listed at the end."""
    sections: Sequence[Section | None]
    intro: Sequence[Block | None] = ()
    """Below the title and the answer."""
    answer: Answer | None = None

    def write(self, folder: Path, pdf: bool = False, figures: Figures | None = None) -> None:
        """Write the page and each figure as figures/NAME.svg, with `pdf` also as NAME.pdf.

        `figures` are those of all plots if they have been drawn already.
        """
        figures = dict(draw_plots((*self.intro, *self.sections), pdf)) if figures is None else figures
        (folder / REPORT_FILE).write_text(self._html(figures), encoding="utf-8")
        (folder / FIGURES_FOLDER).mkdir()
        for several in figures.values():
            for figure in several:
                figure.write(folder / FIGURES_FOLDER)

    def html(self) -> str:
        """The page alone."""
        return self._html(dict(draw_plots((*self.intro, *self.sections))))

    @property
    def blocks(self) -> Iterator[Block]:
        """Everything on the page, in order; a section is followed by its blocks."""
        return all_blocks((*self.intro, *self.sections))

    def _html(self, figures: Figures) -> str:
        return _template().render(
            title=self.title,
            command=relative_command(self.command),
            answer=self.answer,
            intro=self.intro,
            sections=[section for section in self.sections if section],
            figures=figures,
            conditions=conditions(self.manifest, self.command),
            manifest=[(k, v) for k, v in flatten(self.manifest) if v != MISSING or not k.startswith("config.")],
        )


@functools.cache
def _template() -> jinja2.Template:
    """The template of all pages, compiled once."""
    loader = jinja2.PackageLoader("experiments.common", "")
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.get_template("page.html.j2")


def relative_command(command: str) -> str:
    """A command line with all its paths relative to the current folder."""
    words = shlex.split(command)
    relatives = list(map(relative, words))
    return command if relatives == words else shlex.join(relatives)


def conditions(manifest: Mapping[str, Any], command: str) -> str:
    """Seed, ground and command on one line, for captions; what the manifest lacks is left out."""
    seed, ground = manifest.get("seed"), manifest.get("ground")
    seeds = seed if isinstance(seed, list | tuple) else [seed]
    parts = [
        "" if seed is None else f"seed{'s' if len(seeds) > 1 else ''} {', '.join(map(str, seeds))}",
        _ground(ground) if isinstance(ground, Mapping) else "",
        relative_command(command),
    ]
    return " · ".join(part for part in parts if part)


def _ground(ground: Mapping[str, Any]) -> str:
    """One ground, or several by their names."""
    if "along" not in ground:
        return "; ".join(f"{relative(name)} {_ground(one)}" for name, one in ground.items() if isinstance(one, Mapping))
    text = f"ground: friction {ground['along']:g} along, {ground['across']:g} across"
    if ground.get("shear"):
        text += f", shear {1e3 * ground['shear']:g} mm"
    if ground.get("slope"):
        text += f", slope {ground['slope']:.3g} rad, uphill {ground.get('uphill', 0.0):.3g} rad"
    for key, one in (("patches", "patch"), ("changes", "change")):
        if count := len(ground.get(key) or ()):
            text += f", {count} {one if count == 1 else key}"
    return text


def file_name(text: str) -> str:
    """A title as the name of a file: lower-case letters and digits, everything else underscores."""
    return re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")


def flatten(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Dotted names and printed values of everything in nested mappings; a list of plain values is one value."""
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from flatten(item, f"{path}.{relative(str(key))}" if path else str(key))
    elif isinstance(value, list | tuple) and any(isinstance(item, Mapping) for item in value):
        for index, item in enumerate(value):
            yield from flatten(item, f"{path}[{index}]")
    elif isinstance(value, list | tuple):
        yield path, ", ".join(relative(str(item)) for item in value) or MISSING
    elif path:
        yield path, MISSING if value is None or value == {} else relative(str(value))
