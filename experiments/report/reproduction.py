"""The page of an identification or a reproduction: tables and figures of whatever there is data for."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from experiments.driving.paper_model import geometry_of, published_runs
from experiments.measuring.grid import RadiusSummary
from experiments.measuring.inner_outer import InnerOuterSamples
from experiments.measuring.paper_comparison import Quantity, Values
from experiments.measuring.tracking import TrackingResult
from experiments.report.drives import DriveFacts
from experiments.report.figures import drives as drive_figures
from experiments.report.figures import laws as law_figures
from experiments.report.figures import steady_runs as steady_figures
from experiments.report.figures import tracking as tracking_figures
from experiments.report.figures.drive_path import path_and_predictions
from experiments.report.figures.localization import Sightings, error_against_viewing_angle, sightings
from experiments.report.figures.slip_under_load import slip_under_load
from experiments.report.formats import MISSING, number, pair
from experiments.report.identification import Facts
from experiments.report.page import Drawing, Page, render_page
from experiments.report.tracking import tracking_rows
from trackslip.identification.drive.comparison import DriveComparison
from trackslip.identification.result import Identification
from trackslip.logs.runlog import RunLog

COMPARISON_HEADER = ("quantity", "published", "simulated")


@dataclass(frozen=True, kw_only=True)
class Report:
    """The content of a page. Whatever is empty or None is left out."""

    title: str
    command: str  # the command line that made it
    manifest: Mapping[str, Any]  # configuration, versions, seed: anything that fits into JSON
    comparison: Sequence[Quantity] = ()  # the paper's results beside the simulation's
    radius: RadiusSummary | None = None  # radii of the grid
    grid_logs: Sequence[RunLog] = ()  # runs, of which figures show one if they are steady
    identification: Identification | None = None
    tracking: Sequence[TrackingResult] = ()  # errors of the runs along the paper's path
    tracking_logs: Sequence[RunLog] = ()  # these runs, with `controller` and `compensation` in their metadata
    warnings: Sequence[str] = ()  # other than those of the identification


def render(report: Report) -> Page:
    """Draw the figures and fill in the template."""
    found = report.identification
    steady = found if found is not None and found.steady is not None else None
    drive = None if found is None else found.drive
    seen = sightings(report.grid_logs)
    drawings = [Drawing(name, figure) for name, figure in _figures(report, seen)]
    return render_page(
        "report.html.j2",
        drawings,
        title=report.title,
        command=report.command,
        manifest=report.manifest,
        comparison=comparison_table(report.comparison),
        found=None if steady is None else Facts.of(steady),
        drives=None if found is None or drive is None else DriveFacts.of(drive, main=found.method == "drive"),
        half_gauge="" if found is None else f"{found.geometry.half_gauge:g} m",
        outliers=() if found is None else found.outliers,
        seen=None if seen is None else seen.facts(),
        warnings=_warnings(report),
        tracking=tracking_rows(report.tracking),
        true_grid=bool(report.grid_logs) and report.grid_logs[0].truth is not None,
        true_tracking=any(log.truth is not None for log in report.tracking_logs),
        by_paper=any(geometry_of(log.metadata) for log in (*report.grid_logs, *report.tracking_logs)),
    )


def comparison_table(quantities: Sequence[Quantity]) -> list[tuple[str, str, str]]:
    """One line per quantity, under COMPARISON_HEADER."""
    return [(q.name, _text(q.published, q), _text(q.simulated, q)) for q in quantities]


def _text(values: Values | str, quantity: Quantity) -> str:
    if isinstance(values, str):
        return values or MISSING
    return pair([number(value, quantity.digits) for value in values], quantity.unit) if values else MISSING


def _figures(report: Report, seen: Sightings | None) -> Iterator[tuple[str, Figure]]:
    """Name and figure of whatever the report has data for."""
    found = report.identification
    steady = None if found is None else found.steady
    turns = None if found is None or steady is None else InnerOuterSamples.of(steady.samples, found.geometry)
    if report.radius is not None and turns:
        yield "published_and_simulated", steady_figures.published_and_simulated(report.radius, turns)
    if report.grid_logs and (found is None or steady is not None):
        yield "fig04_pose_and_velocity", steady_figures.pose_and_velocity(steady_figures.typical_run(report.grid_logs))
    if seen is not None:
        yield "localization_error", error_against_viewing_angle(seen)
    if found is not None and steady is not None and turns is not None:
        comparison = steady.comparison
        if len(turns):
            slip = steady_figures.slip_against_speed_and_radius(turns, comparison.laws[comparison.best])
            yield "fig05_slip_over_speed_and_radius", slip
            yield "fig06_slip_laws", law_figures.fitted_laws(turns, comparison)
            yield "residuals_of_laws", law_figures.residuals(turns, comparison)
        loaded = comparison.laws.get("icr_load")
        if loaded is not None and (figure := slip_under_load(steady.samples, loaded, found.geometry)) is not None:
            yield "slip_under_load", figure
        yield "comparison_of_laws", law_figures.criteria(comparison)
        if correlated := law_figures.correlated_laws(comparison):
            yield "correlations_of_parameters", law_figures.correlations(correlated)
    if found is not None and found.drive is not None:
        yield from _drive_figures(found.drive)
    feedforward = tracking_figures.runs_of(report.tracking_logs, "feedforward")
    linear = tracking_figures.runs_of(report.tracking_logs, "linear")
    if feedforward or linear:
        yield "fig07_planned_trajectory", tracking_figures.planned_trajectory()
    if feedforward:
        yield "fig08_feedforward_paths", tracking_figures.paths(feedforward, _published("feedforward", feedforward))
    if linear:
        yield "fig09_errors_defined", tracking_figures.errors_defined()
        published = _published("linear", linear)
        yield "fig10_feedback_paths", tracking_figures.paths(linear, published)
        yield "fig11_feedback_errors", tracking_figures.tracking_errors_over_time(linear, published)
        laws = {} if steady is None else steady.comparison.laws
        if (tracked := tracking_figures.slip_during_tracking(linear, laws, published)) is not None:
            yield "fig12_slip_during_tracking", tracked


def _drive_figures(drive: DriveComparison) -> Iterator[tuple[str, Figure]]:
    """Figures of laws identified from whole drives."""
    best = drive.laws[drive.best]
    yield "drive_path", path_and_predictions(drive)
    yield "drive_prediction_errors", drive_figures.prediction_errors(drive)
    yield "drive_residuals", drive_figures.residuals_over_time(best)
    if drive.clock is not None:
        yield "drive_clock_offset", drive_figures.clock_offset(drive)
    if len(best.free) > 1:
        yield "drive_correlations", drive_figures.drive_correlations(best)


def _published(controller: str, runs: Mapping[str, RunLog]) -> dict[str, RunLog]:
    """The same runs by the paper's equations, from the same start; empty where the geometry is not known."""
    log = next(iter(runs.values()))
    geometry = geometry_of(log.metadata)
    return {} if geometry is None else published_runs(controller, tracking_figures.driven(log)[0], geometry)


def _warnings(report: Report) -> list[str]:
    """All warnings but those of runs that were left out, which have a list of their own."""
    found = report.identification
    known = [] if found is None else [warning for warning in found.warnings if warning not in map(str, found.outliers)]
    return [*report.warnings, *known]
