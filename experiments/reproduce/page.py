"""The page on a reproduction of the paper: answer, comparison of results, closed loops, slip and
laws.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

from markupsafe import Markup

from experiments.common.page import Answer, Page, Plot, Section
from experiments.common.table import number, percent
from experiments.identify.page import method, notes, steady_slip
from experiments.identify.turns import Turns
from experiments.reproduce import figures
from experiments.reproduce.comparison import comparison_table
from experiments.simulate.grid_summary import GridSummary
from experiments.simulate.tracking import TrackingResult, tracking_table
from trackslip.identification.result import Identification
from trackslip.logs.runlog import RunLog
from trackslip.views.values import value_text

TITLE: Final = "Slip of a tracked robot: the paper and its simulation"


def page(
    command: str,
    manifest: Mapping[str, Any],
    grid: GridSummary,
    result: Identification,
    results: Sequence[TrackingResult],
    loops: Sequence[RunLog],
    warnings: Sequence[str],
) -> Page:
    """The page on a reproduction.

    `loops` are the closed loops, with `controller` and `compensation` in their metadata, and
    `results` their errors; `warnings` are about the grid.
    """
    turns = Turns.of(result.samples, result.geometry)
    beside = Plot(
        "published_and_simulated",
        partial(figures.published_and_simulated, grid.radius, turns),
        "The paper's result and the simulation's",
        "Left: radius driven when the sprockets run at the speeds that a robot without slip "
        "would need. Right: slip of "
        "each track, by the published law (dashed; crosses at the radii that the paper observed) "
        "and in every run.",
    )
    table = comparison_table(grid, result, results)
    sections = [
        Section("Published and simulated", [beside if len(turns) else None, table]),
        _closed_loops(result, results, loops),
        steady_slip(result),
        method(result),
        notes(result.warnings),
    ]
    alarms = [alarm.line for alarm in result.alarms]
    answer = _answer(manifest, grid, result, results, warnings, alarms)
    return Page(TITLE, command, manifest, sections, answer=answer)


def _answer(
    manifest: Mapping[str, Any],
    grid: GridSummary,
    result: Identification,
    results: Sequence[TrackingResult],
    warnings: Sequence[str],
    alarms: Sequence[str],
) -> Answer:
    """The answer: how close the simulation is to the paper, and by how much compensation reduces
    errors.
    """
    feedforward = [run for run in results if run.controller == "feedforward"]
    linear = [run for run in results if run.controller == "linear"]
    final = {run.compensation: run.errors.final_position for run in feedforward}
    late = {run.compensation: run.errors.rms_position_after_12s for run in linear}

    slip_rms = number(grid.slip_rms_vs_published, 4)
    radius_rms = percent(grid.radius.rms_vs_published)
    offset = value_text(result.comparison.laws["icr_radius"], "offset")
    facts = [
        ("slip, simulated minus published", f"{slip_rms} rms, at the paper's radii"),
        ("radius driven, likewise", f"{radius_rms} rms"),
        ("law of the simulated slip", f"icr_radius, D = {offset}"),
        ("feedforward, end of the path", _compensated(final)),
        ("linear controller, after 12 s", _compensated(late)),
    ]
    before = 1e3 * final["none"]
    after = 1e3 * final["icr_radius"]
    heading = (
        f"Slip compensation reduces the open-loop final error from {before:.0f} to {after:.0f} mm"
    )
    commands = [f"trackslip view {manifest['config']['out']}", "trackslip benchmark"]
    return Answer(heading, facts, (), warnings, alarms, commands)


def _compensated(errors: Mapping[str, float]) -> str:
    """Format the errors [m] of runs without compensation, with the published law and with
    icr_radius.
    """
    names = ("none", "published", "icr_radius")
    return ", ".join(f"{number(1e3 * errors[name], 1, 'mm')} with {name}" for name in names)


def _closed_loops(
    result: Identification, results: Sequence[TrackingResult], loops: Sequence[RunLog]
) -> Section:
    """The section on runs along the paper's path, with feedforward and with the linear
    controller.
    """
    feedforward, linear = (figures.runs_of(loops, name) for name in ("feedforward", "linear"))
    return Section(
        "Compensated slip",
        [
            "The robot follows a path of two straight lines and an arc of radius 1.25 m at 0.15 "
            "m/s. A slip law "
            "converts the controller's twist into sprocket speeds; none assumes no slip. Paths "
            "and errors are those of "
            "the true pose.",
            tracking_table(results),
            Plot(
                "fig08_feedforward_paths",
                partial(figures.paths, feedforward),
                "Feedforward only (the paper's Fig. 8)",
                "The robot drives the planned twist without feedback, so that every error of the "
                "slip law accumulates. "
                "Left: paths, with squares at their ends. Right: distance from the desired "
                "position at the same time "
                "(errors below 0.3 mm are drawn at 0.3 mm; grey: the arc).",
            ),
            Plot(
                "fig10_feedback_paths",
                partial(figures.paths, linear),
                "Linear feedback controller (the paper's Fig. 10)",
                "The same with feedback of the estimated pose, from a start beside the path. "
                "Feedback corrects part "
                "of what the slip law misses, so the paths differ less than without it.",
            ),
            Plot(
                "fig11_feedback_errors",
                partial(figures.tracking_errors_over_time, linear),
                "Errors with feedback (the paper's Fig. 11)",
                Markup(
                    "Position error in the robot's frame, ahead (e<sub>x</sub>), to the left "
                    "(e<sub>y</sub>), and "
                    "its norm, the distance. Left: the whole run, dominated by the start beside "
                    "the path. Right: from 12 s on, where "
                    "the arc (grey) begins. The controller's gains vanish with the planned "
                    "speed, so nothing corrects "
                    "errors that arise while the robot comes to rest at the end."
                ),
            ),
            Plot(
                "fig12_slip_during_tracking",
                partial(figures.slip_during_tracking, linear, result.comparison.laws),
                "Slip during tracking (the paper's Fig. 12)",
                "Dashed: slip of each track that the law predicts at the commanded curvature. "
                "Thin: true slip, "
                "smoothed over 0.5 s, where the sprocket turns faster than 0.3 rad/s. In the arc "
                "(grey), the left "
                "track is the inner one. The axis is the paper's; the first seconds exceed it, "
                "because the robot "
                "turns sharply towards the path.",
            ),
        ],
    )
