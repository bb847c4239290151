"""The page of odometry's errors: tables and figures."""

from collections.abc import Mapping, Sequence
from typing import Any

from experiments.odometry import Evaluated
from experiments.report.figures import odometry as figures
from experiments.report.odometry import HEADERS, TITLES, gain, tables
from experiments.report.page import Drawing, Page, render_page


def render(
    found: Sequence[Evaluated],
    notes: Sequence[str],
    sensing: Sequence[str],
    manifest: Mapping[str, Any],
    command: str,
    name: str,
) -> Page:
    """Draw the figures and fill in the template."""
    drives = found[0].errors.drives
    drawings = [Drawing("odometry_paths", figures.paths(found))]
    if found[0].errors.after_metres:
        drawings.append(Drawing("odometry_errors_over_way", figures.errors_over_way(found)))
    shown = tables(found)
    return render_page(
        "evaluate.html.j2",
        drawings,
        title=f"Odometry by slip laws on {name}",
        command=command,
        manifest=manifest,
        tables=[(TITLES[key], HEADERS[key], rows) for key, rows in shown.items()],
        drives=len(drives),
        way=f"{sum(drive.way for drive in drives):.0f} m",
        duration=f"{sum(drive.duration for drive in drives):.0f} s",
        poses=sum(drive.poses for drive in drives),
        headings=figures.longest(found).has_heading,
        shown=figures.longest(found).name,
        gain=gain(found),
        sensing=sensing,
        notes=notes,
    )
