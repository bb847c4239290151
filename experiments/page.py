"""What every page is made with: templates, figures as inline SVG, a manifest as a list."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from typing import Any

import jinja2
import matplotlib
from markupsafe import Markup
from matplotlib.figure import Figure

MISSING = "–"


def render_page(template: str, *, title: str, command: str, manifest: Mapping[str, Any], **context: Any) -> str:
    """A template that extends base.html.j2, as HTML that needs no other file.

    Args:
        template: its file's name.
        title: of the page.
        command: how it was made, in one line.
        manifest: whatever fits into JSON; listed at the end.
        context: what the template itself wants.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("experiments", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(
        title=title, command=command, manifest=list(_flatten(manifest)), **context
    )


def inline_svg(figure: Figure, name: str) -> Markup:
    """A figure as an <svg> element; `name` makes its ids differ from other figures' on the page."""
    buffer = io.StringIO()
    with matplotlib.rc_context({"svg.hashsalt": name, "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r'((?:\bid|xlink:href)="#?|url\(#)(?=[^"#)])', rf"\g<1>{name}-", text)
    text = re.sub(r"\n\s*", "\n", text)
    return Markup(text.replace("<svg ", '<svg aria-hidden="true" ', 1))


def _flatten(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Dotted names and printed values of everything in nested mappings; lists of plain values stay in one."""
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            yield from _flatten(item, f"{path}.{key}" if path else str(key))
    elif isinstance(value, list | tuple) and any(isinstance(item, Mapping) for item in value):
        for number, item in enumerate(value):
            yield from _flatten(item, f"{path}[{number}]")
    elif isinstance(value, list | tuple):
        yield path, ", ".join(map(str, value)) or MISSING
    elif path:
        yield path, MISSING if value is None or value == {} else str(value)
