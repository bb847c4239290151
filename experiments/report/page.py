"""Pages: templates, figures as inline SVG and as files, and how the results were made."""

import functools
import io
import re
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure

from experiments.report.formats import MISSING, percent, significant
from experiments.storage.manifest import relative
from experiments.storage.results import FIGURES_FOLDER, REPORT_FILE


@dataclass(frozen=True)
class Drawn:
    """A figure as the text of files, which can be sent from one process to another."""

    name: str
    """Descriptive, of letters, digits and underscores."""
    svg: str
    """The text of an SVG file, reproducible, with letters as outlines so that it needs no font."""
    inline: Markup
    """An <svg> element whose ids are unique on the page."""
    pdf: bytes = b""
    """A PDF file, if one was wanted."""


@dataclass(frozen=True)
class Drawing:
    """A figure and its name, drawn when its files are needed."""

    name: str
    figure: Figure

    @functools.cached_property
    def svg(self) -> str:
        """See Drawn."""
        with matplotlib.rc_context({"svg.hashsalt": self.name, "svg.fonttype": "path"}):
            return self._saved("svg", Date=None).decode()

    @property
    def pdf(self) -> bytes:
        """See Drawn."""
        with matplotlib.rc_context({"pdf.fonttype": 42}):
            return self._saved("pdf", CreationDate=None)

    def _saved(self, file_format: str, **metadata: None) -> bytes:
        buffer = io.BytesIO()
        self.figure.savefig(buffer, format=file_format, metadata=metadata)
        return buffer.getvalue()

    @property
    def inline(self) -> Markup:
        """See Drawn."""
        text = self.svg[self.svg.index("<svg") :]
        text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
        for reference in (' id="', 'xlink:href="#', "url(#"):
            text = text.replace(reference, f"{reference}{self.name}-")
        text = re.sub(r"\n\s*", "\n", text)
        return Markup(text.replace("<svg ", '<svg aria-hidden="true" ', 1))


def draw(name: str, make: Callable[[], Figure | None], pdf: bool) -> Drawn | None:
    """Make and draw a figure, wherever this is called; None if there is none to be made."""
    figure = make()
    if figure is None:
        return None
    drawing = Drawing(name, figure)
    return Drawn(name, drawing.svg, drawing.inline, drawing.pdf if pdf else b"")


@dataclass(frozen=True)
class Page:
    """A self-contained HTML page and its figures, which are also written as files."""

    html: str
    drawings: Sequence[Drawing | Drawn]

    def write(self, folder: Path, pdf: bool = False) -> None:
        """Write the page and each figure as figures/NAME.svg, with `pdf` also as NAME.pdf."""
        (folder / REPORT_FILE).write_text(self.html, encoding="utf-8")
        (folder / FIGURES_FOLDER).mkdir()
        for drawing in self.drawings:
            file = folder / FIGURES_FOLDER / drawing.name
            file.with_suffix(".svg").write_text(drawing.svg, encoding="utf-8")
            if pdf:
                file.with_suffix(".pdf").write_bytes(drawing.pdf)


def render_page(
    template: str,
    drawings: Sequence[Drawing | Drawn],
    *,
    title: str,
    command: str,
    manifest: Mapping[str, Any],
    **context: Any,
) -> Page:
    """Fill in a template that extends base.html.j2; the manifest, which must fit into JSON, is listed at its end."""
    inline = {drawing.name: drawing.inline for drawing in drawings}
    context = {"figures": inline, "conditions": conditions(manifest, command)} | context
    made = {"title": title, "command": relative_command(command), "manifest": list(_flatten(manifest))}
    return Page(_environment().get_template(template).render(made, **context), drawings)


@functools.cache
def _environment() -> jinja2.Environment:
    """Templates, each compiled once."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("experiments.report", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"percent": percent, "significant": significant}
    return environment


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


def _flatten(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Dotted names and printed values of everything in nested mappings; a list of plain values is one value."""
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from _flatten(item, f"{path}.{relative(str(key))}" if path else str(key))
    elif isinstance(value, list | tuple) and any(isinstance(item, Mapping) for item in value):
        for index, item in enumerate(value):
            yield from _flatten(item, f"{path}[{index}]")
    elif isinstance(value, list | tuple):
        yield path, ", ".join(relative(str(item)) for item in value) or MISSING
    elif path:
        yield path, MISSING if value is None or value == {} else relative(str(value))
