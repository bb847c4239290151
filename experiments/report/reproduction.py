"""One self-contained HTML page of a command's results: tables, figures as inline SVG, and how it was made."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from experiments.driving.paper_model import geometry_of, published_runs
from experiments.measuring.inner_outer import RoleSamples
from experiments.report.figures import comparison as comparison_figures
from experiments.report.figures import laws as law_figures
from experiments.report.figures import steady_runs as figures
from experiments.report.figures import style as figure_style
from experiments.report.figures import tracking as tracking_figures
from experiments.report.figures.error_sketch import errors_defined
from experiments.report.figures.localization import Sightings, error_against_viewing_angle, sightings
from experiments.report.figures.published import published_and_simulated
from experiments.report.identification import IdentificationText
from experiments.report.page import MISSING, Drawing, Page, conditions, render_page
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.result import Identification
from trackslip.logs.runlog import RunLog

_TRACKING_COLUMNS = (
    ("rms_position", 1e3),
    ("rms_position_after_12s", 1e3),
    ("max_position", 1e3),
    ("final_position", 1e3),
    ("final_heading", math.degrees(1)),
)
"""Keys of a row of summary['tracking'] and the factor from SI to what is printed, mm and degrees."""


@dataclass(frozen=True)
class ComparisonRow:
    """A row of the table published | simulated, as printed."""

    quantity: str
    published: str
    simulated: str


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a page shows. What is empty or None is left out of it."""

    title: str
    command: str
    """How it was made, in one line."""
    manifest: Mapping[str, Any]
    """Whatever fits into JSON: configuration, versions, seed."""
    summary: Mapping[str, Any]
    """Results as JSON; `tracking` is a list of TrackingErrors as mappings with controller and compensation [m, rad]."""
    comparison: Sequence[ComparisonRow] = ()
    grid_logs: Sequence[RunLog] = ()
    """Steady runs."""
    identification: Identification | None = None
    tracking_logs: Sequence[RunLog] = ()
    """Runs along the paper's path, with `controller` and `compensation` in their metadata."""

    @property
    def laws(self) -> Mapping[str, FittedLaw]:
        """The fitted laws by name."""
        return {} if self.identification is None else self.identification.comparison.laws


def render(report: Report) -> Page:
    """The page and its figures."""
    seen = sightings(report.grid_logs)
    drawings = [Drawing(name, figure) for name, figure in _figures(report, seen)]
    tracking = report.summary.get("tracking")
    html = render_page(
        "report.html.j2",
        title=report.title,
        command=report.command,
        manifest=report.manifest,
        report=report,
        figures={drawing.name: drawing.inline for drawing in drawings},
        conditions=conditions(report.manifest, report.command),
        found=None if report.identification is None else IdentificationText.of(report.identification),
        seen=None if seen is None else seen.facts(),
        warnings=_warnings(report),
        tracking=_tracking_rows(tracking if isinstance(tracking, list | tuple) else ()),
        by_paper=any(geometry_of(log.metadata) for log in (*report.grid_logs, *report.tracking_logs)),
        truth=any(log.truth is not None for log in report.tracking_logs),
    )
    return Page(html, drawings)


def _figures(report: Report, seen: Sightings | None) -> Iterator[tuple[str, Figure]]:
    """Name and figure of whatever the report has data for."""
    if report.comparison and report.identification is not None:
        turns = RoleSamples.of(report.identification.samples, report.identification.geometry)
        if len(turns):
            yield "published_and_simulated", published_and_simulated(report.summary["radius"], turns)
    if report.grid_logs:
        yield "fig04_pose_and_velocity", figures.pose_and_velocity(figures.typical_run(report.grid_logs))
    if seen is not None:
        yield "localization_error", error_against_viewing_angle(seen)
    if report.identification is not None:
        yield from _law_figures(report.identification)
    feedforward = tracking_figures.runs_of(report.tracking_logs, "feedforward")
    linear = tracking_figures.runs_of(report.tracking_logs, "linear")
    if feedforward or linear:
        yield "fig07_planned_trajectory", tracking_figures.planned_trajectory()
    if feedforward:
        yield "fig08_feedforward_paths", tracking_figures.paths(feedforward, _published("feedforward", feedforward))
    if linear:
        yield "fig09_errors_defined", errors_defined()
        published = _published("linear", linear)
        yield "fig10_feedback_paths", tracking_figures.paths(linear, published)
        yield "fig11_feedback_errors", tracking_figures.tracking_errors_over_time(linear, published)
        estimated = tracking_figures.slip_during_tracking(linear, report.laws, published)
        if estimated is not None:
            yield "fig12_slip_during_tracking", estimated


def _published(controller: str, runs: Mapping[str, RunLog]) -> dict[str, RunLog]:
    """The same by the paper's equations, for the robot's geometry, as far as it is known, and start."""
    log = next(iter(runs.values()))
    geometry = geometry_of(log.metadata)
    return {} if geometry is None else published_runs(controller, tracking_figures.driven(log)[0], geometry)


def _law_figures(found: Identification) -> Iterator[tuple[str, Figure]]:
    comparison = found.comparison
    turns = RoleSamples.of(found.samples, found.geometry)
    if len(turns):
        yield (
            "fig05_slip_over_speed_and_radius",
            figures.slip_against_speed_and_radius(turns, comparison.laws[comparison.best]),
        )
        yield "fig06_slip_laws", law_figures.fitted_laws(turns, comparison)
        yield "residuals_of_laws", law_figures.residuals(turns, comparison)
    yield "comparison_of_laws", comparison_figures.criteria(comparison)
    correlated = comparison_figures.correlated_laws(comparison)
    if correlated:
        yield "correlations_of_parameters", comparison_figures.correlations(correlated)


def _tracking_rows(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Controller, compensation, localization and the errors in mm and degrees, as printed."""
    printed = []
    for row in rows:
        names = [str(row.get(key, MISSING)) for key in ("controller", "compensation", "localization")]
        names[1] = figure_style.LABELS.get(names[1], names[1])
        printed.append([*names, *(_number(row.get(key), factor) for key, factor in _TRACKING_COLUMNS)])
    return printed


def _number(value: Any, factor: float) -> str:
    if not isinstance(value, int | float) or not math.isfinite(value):
        return MISSING
    return f"{factor * value:.1f}" if factor == 1e3 else f"{factor * value:.2f}"


def _warnings(report: Report) -> list[str]:
    """The command's warnings, or those of the identification; runs left out have a list of their own."""
    found = report.identification
    left_out = set() if found is None else set(map(str, found.outliers))
    warnings = report.summary.get("warnings", () if found is None else found.warnings)
    return [str(warning) for warning in warnings if str(warning) not in left_out]
