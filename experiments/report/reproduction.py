"""The page of an identification or a reproduction: tables and figures of whatever there is data for."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from matplotlib.figure import Figure

from experiments.driving.paper_model import geometry_of, published_runs
from experiments.measuring.grid import RadiusSummary
from experiments.measuring.inner_outer import InnerOuterSamples
from experiments.measuring.paper_comparison import Quantity, Values
from experiments.measuring.sightings import Sightings, sightings
from experiments.measuring.tracking import TrackingResult
from experiments.report.drives import DriveFacts
from experiments.report.figures import drives as drive_figures
from experiments.report.figures import laws as law_figures
from experiments.report.figures import steady_runs as steady_figures
from experiments.report.figures import tracking as tracking_figures
from experiments.report.figures.localization import error_against_viewing_angle
from experiments.report.figures.slip_under_load import slip_under_load
from experiments.report.formats import MISSING, number, pair
from experiments.report.identification import Facts
from experiments.report.page import Drawn
from experiments.report.template_page import Drawing, Page, render_page
from experiments.report.tracking import tracking_rows
from trackslip.identification.drive.comparison import DriveComparison
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.result import Identification, SteadyLaws
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog

COMPARISON_HEADER = ("quantity", "published", "simulated")
Published = Mapping[str, Mapping[str, RunLog]]
"""Controller -> compensation -> run by the paper's equations."""
Sketch = tuple[str, Callable[[], Figure | None]]
"""The name of a figure, and what makes it, anywhere; it makes none where the data are too few."""
PLANNED_TRAJECTORY: Sketch = ("fig07_planned_trajectory", tracking_figures.planned_trajectory)
ERRORS_DEFINED: Sketch = ("fig09_errors_defined", tracking_figures.errors_defined)


@dataclass(frozen=True, kw_only=True)
class Report:
    """The content of a page. Whatever is empty or None is left out."""

    title: str
    command: str  # the command line that made it
    manifest: Mapping[str, Any]  # configuration, versions, seed: anything that fits into JSON
    comparison: Sequence[Quantity] = ()  # the paper's results beside the simulation's
    radius: RadiusSummary | None = None  # radii of the grid
    grid_logs: Sequence[RunLog] = ()  # runs, of which figures show one if they are steady
    seen: Sightings | None = None  # their poses, if they are known already
    identification: Identification | None = None
    tracking: Sequence[TrackingResult] = ()  # errors of the runs along the paper's path
    tracking_logs: Sequence[RunLog] = ()  # these runs, with `controller` and `compensation` in their metadata
    published: Published | None = None  # the same runs by the paper's equations, if they are known already
    warnings: Sequence[str] = ()  # other than those of the identification


def render(report: Report, drawn: Mapping[str, Drawn] | None = None) -> Page:
    """Draw the figures, but for those already `drawn`, and fill in the template.

    Without `drawn` all figures are drawn; with it, those that it lacks are left out.
    """
    found = report.identification
    steady = found if found is not None and found.steady is not None else None
    drive = None if found is None else found.drive
    seen = report.seen or sightings(report.grid_logs)
    sketches = figures_of(replace(report, seen=seen))
    if drawn is None:
        figures = ((name, make()) for name, make in sketches)
        drawings: list[Drawing | Drawn] = [Drawing(name, figure) for name, figure in figures if figure is not None]
    else:
        drawings = [drawn[name] for name, _ in sketches if name in drawn]
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


def figures_of(report: Report) -> Iterator[Sketch]:
    """All figures that the report has data for, in the order of the page; they are made only when they are called."""
    found = report.identification
    steady = None if found is None else found.steady
    turns = None if found is None or steady is None else InnerOuterSamples.of(steady.samples, found.geometry)
    if report.radius is not None and turns:
        yield "published_and_simulated", partial(steady_figures.published_and_simulated, report.radius, turns)
    if report.grid_logs and (found is None or steady is not None):
        typical = steady_figures.typical_run(report.grid_logs)
        yield "fig04_pose_and_velocity", partial(steady_figures.pose_and_velocity, typical)
    if report.seen is not None:
        yield "localization_error", partial(error_against_viewing_angle, report.seen)
    if found is not None and steady is not None and turns is not None:
        yield from _law_figures(found, steady, turns)
    if found is not None and found.drive is not None:
        yield from _drive_figures(found.drive)
    laws = {} if steady is None else steady.comparison.laws
    yield from _tracking_figures(report.tracking_logs, laws, report.published)


def _law_figures(found: Identification, steady: SteadyLaws, turns: InnerOuterSamples) -> Iterator[Sketch]:
    """Figures of laws identified from steady stretches."""
    comparison = steady.comparison
    if len(turns):
        best = comparison.laws[comparison.best]
        yield "fig05_slip_over_speed_and_radius", partial(steady_figures.slip_against_speed_and_radius, turns, best)
        yield "fig06_slip_laws", partial(law_figures.fitted_laws, turns, comparison)
        yield "residuals_of_laws", partial(law_figures.residuals, turns, comparison)
    if (loaded := comparison.laws.get("icr_load")) is not None:
        yield "slip_under_load", partial(slip_under_load, steady.samples, loaded, found.geometry)
    yield "comparison_of_laws", partial(law_figures.criteria, comparison)
    if correlated := law_figures.correlated_laws(comparison):
        yield "correlations_of_parameters", partial(law_figures.correlations, correlated)


def _tracking_figures(
    logs: Sequence[RunLog], laws: Mapping[str, FittedLaw], published: Published | None
) -> Iterator[Sketch]:
    """Figures of the closed loops."""
    runs = {name: tracking_figures.runs_of(logs, name) for name in ("feedforward", "linear")}
    feedforward, linear = runs.values()
    if feedforward or linear:
        yield PLANNED_TRAJECTORY
        published = published_beside(logs) if published is None else published
    if published is not None and feedforward:
        yield "fig08_feedforward_paths", partial(tracking_figures.paths, feedforward, published.get("feedforward", {}))
    if published is not None and linear:
        beside = published.get("linear", {})
        yield ERRORS_DEFINED
        yield "fig10_feedback_paths", partial(tracking_figures.paths, linear, beside)
        yield "fig11_feedback_errors", partial(tracking_figures.tracking_errors_over_time, linear, beside)
        yield "fig12_slip_during_tracking", partial(tracking_figures.slip_during_tracking, linear, laws, beside)


def _drive_figures(drive: DriveComparison) -> Iterator[Sketch]:
    """Figures of laws identified from whole drives."""
    best = drive.laws[drive.best]
    yield "drive_path", partial(drive_figures.path_and_predictions, drive)
    yield "drive_prediction_errors", partial(drive_figures.prediction_errors, drive)
    yield "drive_residuals", partial(drive_figures.residuals_over_time, best)
    if drive.clock is not None:
        yield "drive_clock_offset", partial(drive_figures.clock_offset, drive)
    if len(best.free) > 1:
        yield "drive_correlations", partial(drive_figures.drive_correlations, best)


def published_beside(logs: Sequence[RunLog]) -> Published:
    """The same runs by the paper's equations, from the same starts; those of a robot of unknown geometry are left out.

    Runs of robots of different geometries are driven one after another.
    """
    starts: dict[RobotGeometry, dict[str, Array]] = {}
    for name in ("feedforward", "linear"):
        log = next(iter(tracking_figures.runs_of(logs, name).values()), None)
        geometry = None if log is None else geometry_of(log.metadata)
        if log is not None and geometry is not None:
            starts.setdefault(geometry, {})[name] = tracking_figures.driven(log)[0]
    return {name: runs for one, of in starts.items() for name, runs in published_runs(of, one).items()}


def _warnings(report: Report) -> list[str]:
    """All warnings but those of runs that were left out, which have a list of their own."""
    found = report.identification
    known = [] if found is None else [warning for warning in found.warnings if warning not in map(str, found.outliers)]
    return [*report.warnings, *known]
