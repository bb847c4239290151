"""Pages with templates of their own, until they are sections (see page)."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup
from matplotlib.figure import Figure

from experiments.report.formats import percent, significant
from experiments.report.page import Drawn, conditions, drawn, flatten, relative_command
from experiments.storage.results import FIGURES_FOLDER, REPORT_FILE


@dataclass(frozen=True)
class Drawing:
    """A figure and its name, drawn when its files are needed."""

    name: str
    figure: Figure

    @functools.cached_property
    def svg(self) -> str:
        """See Drawn."""
        return drawn(self.name, self.figure).svg

    @property
    def pdf(self) -> bytes:
        """See Drawn."""
        return drawn(self.name, self.figure, pdf=True).pdf

    @property
    def inline(self) -> Markup:
        """See Drawn."""
        return Drawn(self.name, self.svg).inline


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
            Drawn(drawing.name, drawing.svg, drawing.pdf if pdf else b"").write(folder / FIGURES_FOLDER)


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
    made = {"title": title, "command": relative_command(command), "manifest": list(flatten(manifest))}
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
