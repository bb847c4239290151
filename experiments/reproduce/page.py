"""The page of a reproduction of the paper: comparison of results, slip, laws, closed loops."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from markupsafe import Markup

from experiments.common.page import Block, Page, Plot, Section
from experiments.common.table import Table
from experiments.identify.page import INTRO, measured_slip, remarks, spread
from experiments.identify.steady_figures import published_and_simulated
from experiments.identify.steady_turns import InnerOuterSamples
from experiments.simulate import tracking_figures as figures
from experiments.simulate.grid_summary import RadiusSummary
from experiments.simulate.tracking import TrackingResult
from experiments.simulate.tracking_table import tracking_table
from trackslip.identification.result import Identification
from trackslip.logs.runlog import RunLog

TITLE = "Slip of a tracked robot: the paper and its simulation"


def page(
    command: str,
    manifest: Mapping[str, Any],
    grid: Sequence[Block | None],
    comparison: Table,
    loops: Section,
    found: Identification,
    warnings: Sequence[str] = (),
) -> Page:
    """The page of a reproduction.

    Args:
        command: the command line that made it.
        manifest: configuration, versions, seed: anything that fits into JSON.
        grid: the results of the grid, from `grid_results`.
        comparison: the paper's results and the simulation's.
        loops: the closed loops, from `closed_loops`.
        found: the slip laws.
        warnings: other than those of the identification.
    """
    published, *measured = grid
    sections = [
        Section("Published and simulated", [published, comparison]),
        Section("Measured slip", measured),
        loops,
        *remarks(found, warnings),
    ]
    return Page(TITLE, command, manifest, sections, [INTRO])


def grid_results(found: Identification, logs: Sequence[RunLog], radius: RadiusSummary) -> list[Block | None]:
    """The results of the grid compared with the paper's, and the blocks of its slips and laws."""
    measured = measured_slip(found, logs)
    return [_published_and_simulated(found, radius), *(measured.blocks if measured else ())]


def _published_and_simulated(found: Identification, radius: RadiusSummary) -> Plot | None:
    turns = InnerOuterSamples.of(found.samples, found.geometry)
    if not len(turns):
        return None
    return Plot(
        "published_and_simulated",
        partial(published_and_simulated, radius, turns),
        "The paper's result and the simulation's",
        "Left: radius driven when the sprockets run at the speeds that a robot without slip would need. Right: "
        "slip of each track, by the published law (dashed; crosses at the radii that the paper observed) and in "
        f"every simulated run. {spread(turns)}",
    )


def closed_loops(
    found: Identification,
    results: Sequence[TrackingResult],
    logs: Sequence[RunLog],
    published: Mapping[str, Mapping[str, RunLog]],
) -> Section:
    """The runs along the paper's path, with feedforward and with the linear controller.

    Args:
        found: the slip laws.
        results: errors of the true poses.
        logs: the runs, with `controller` and `compensation` in their metadata.
        published: controller -> compensation -> the same run by the paper's equations.
    """
    feedforward, linear = (figures.runs_of(logs, name) for name in ("feedforward", "linear"))
    laws = {} if found.steady is None else found.comparison.laws
    return Section(
        "Compensated slip",
        [
            "The robot follows a path of two straight lines and an arc of radius 1.25 m at 0.15 m/s. A slip law "
            "converts the controller's twist into sprocket speeds; without compensation, slip is assumed to be zero. "
            "Paths and errors are those of the true pose. Crosses, one per second, are the paper's own equations, "
            "without noise and delay: the robot slips exactly as in Eq. 11, without compensation and compensated by "
            "Eq. 11.",
            tracking_table(results),
            Plot(
                "fig07_planned_trajectory",
                figures.planned_trajectory,
                "The planned trajectory (the paper's Fig. 7)",
                "Desired position and heading: 5 s of acceleration, 7 s straight on, the arc (grey) to a heading of "
                "4π/3, 7 s straight on, 5 s of deceleration.",
            ),
            Plot(
                "fig08_feedforward_paths",
                partial(figures.paths, feedforward, published["feedforward"]),
                "Feedforward only (the paper's Fig. 8)",
                "The robot drives the planned twist without feedback, so that every error of the slip law accumulates. "
                "Left: paths, with squares at their ends. Right: distance from the desired position at the same time "
                "(errors below 0.3 mm are drawn at 0.3 mm; grey: the arc).",
            ),
            Plot(
                "fig09_errors_defined",
                figures.errors_defined,
                "Definition of the errors (the paper's Fig. 9 and Eq. 18)",
                Markup(
                    "The desired pose seen from the robot: its distance ahead (e<sub>x</sub>) and to the left "
                    "(e<sub>y</sub>), and the difference of heading (e<sub>φ</sub>). The controller uses the estimated "
                    "pose; figures and tables here evaluate the true one."
                ),
            ),
            Plot(
                "fig10_feedback_paths",
                partial(figures.paths, linear, published["linear"]),
                "Linear feedback controller (the paper's Fig. 10)",
                "The same with feedback of the estimated pose, from a start beside the path. Feedback corrects part "
                "of what the slip law misses, so the paths differ less than without it.",
            ),
            Plot(
                "fig11_feedback_errors",
                partial(figures.tracking_errors_over_time, linear, published["linear"]),
                "Errors with feedback (the paper's Fig. 11)",
                Markup(
                    "Position error in the robot's frame, forward (e<sub>x</sub>) and to the left (e<sub>y</sub>), and "
                    "its norm. Left: the whole run, dominated by the start beside the path. Right: from 12 s on, where "
                    "the arc (grey) begins. The controller's gains vanish with the planned speed, so nothing corrects "
                    "errors that arise while the robot comes to rest at the end."
                ),
            ),
            Plot(
                "fig12_slip_during_tracking",
                partial(figures.slip_during_tracking, linear, laws, published["linear"]),
                "Slip during tracking (the paper's Fig. 12)",
                "Dashed: slip of each track that the law predicts at the commanded curvature. Thin: true slip, "
                "smoothed over 0.5 s, where the sprocket turns faster than 0.3 rad/s. In the arc (grey), the left "
                "track is the inner one. The axis is the paper's; the first seconds exceed it, because the robot "
                "turns sharply towards the path.",
            ),
        ],
    )
