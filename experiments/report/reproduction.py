"""The page of a reproduction of the paper: its results beside the simulation's, slip, laws, closed loops."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from markupsafe import Markup

from experiments.measuring.grid import RadiusSummary
from experiments.measuring.sightings import Sightings
from experiments.measuring.steady_turns import InnerOuterSamples
from experiments.measuring.tracking import TrackingResult
from experiments.report.drives import whole_drives
from experiments.report.figures import tracking as figures
from experiments.report.figures.steady_runs import published_and_simulated
from experiments.report.identification import INTRO, by_paper, measured_slip, remarks, spread
from experiments.report.page import Page, Plot, Section
from experiments.report.table import Table
from experiments.report.tracking import tracking_table
from trackslip.identification.result import Identification
from trackslip.logs.runlog import RunLog


@dataclass(frozen=True, kw_only=True)
class Report:
    """The results of a reproduction."""

    command: str  # the command line that made it
    manifest: Mapping[str, Any]  # configuration, versions, seed: anything that fits into JSON
    comparison: Table  # the paper's results beside the simulation's
    radius: RadiusSummary  # radii of the grid
    grid_logs: Sequence[RunLog]
    seen: Sightings | None  # their poses, if truth and scanner are known
    identification: Identification
    tracking: Sequence[TrackingResult]  # errors of the runs along the paper's path
    tracking_logs: Sequence[RunLog]  # these runs, with `controller` and `compensation` in their metadata
    published: Mapping[str, Mapping[str, RunLog]]  # controller -> compensation -> the same run by the paper's equations
    warnings: Sequence[str] = ()  # other than those of the identification

    def page(self) -> Page:
        """The page; its figures are drawn when it is written."""
        found = self.identification
        sections = [
            Section("Published and simulated", [self._published_and_simulated(), self.comparison]),
            measured_slip(found, self.grid_logs, self.seen),
            whole_drives(found),
            self._compensated(),
            *remarks(found, self.warnings),
        ]
        title = "Slip of a tracked robot: the paper and its simulation"
        return Page(title, self.command, self.manifest, sections, [INTRO])

    def _published_and_simulated(self) -> Plot | None:
        found = self.identification
        turns = InnerOuterSamples.of(found.samples, found.geometry)
        if not len(turns):
            return None
        apart = spread(turns)
        differ = f". At one radius, runs of different speeds differ by at most {apart}" if apart else ""
        return Plot(
            "published_and_simulated",
            partial(published_and_simulated, self.radius, turns),
            "The paper's result and the simulation's",
            "Left: radius driven when the sprockets run at the speeds that a robot without slip would need. Right: "
            "slip of each track, by the published law (dashed; crosses at the radii that the paper observed) and in "
            f"every simulated run{differ}.",
        )

    def _compensated(self) -> Section | None:
        """The section of the closed loops."""
        feedforward, linear = (figures.runs_of(self.tracking_logs, name) for name in ("feedforward", "linear"))
        if not feedforward and not linear:
            return None
        pose = "true" if any(log.truth is not None for log in self.tracking_logs) else "estimated"
        planned = Plot(
            "fig07_planned_trajectory",
            figures.planned_trajectory,
            "The planned trajectory (the paper's Fig. 7)",
            "Desired position and heading: 5 s of acceleration, 7 s straight on, the arc (grey) to a heading of "
            "4π/3, 7 s straight on, 5 s of deceleration.",
        )
        return Section(
            "Compensated slip",
            [
                "The robot follows a path of two straight lines and an arc of radius 1.25 m at 0.15 m/s. A slip law "
                "converts the controller's twist into sprocket speeds; without compensation, slip is assumed to be "
                f"zero. Paths and errors are those of the {pose} pose.",
                tracking_table(self.tracking),
                planned,
                self._feedforward(feedforward) if feedforward else None,
                *(self._feedback(linear) if linear else ()),
            ],
        )

    def _crosses(self, text: str) -> str:
        """A sentence on the crosses in the figures, where there are any."""
        return f" {text}" if by_paper(self.tracking_logs) else ""

    def _feedforward(self, runs: Mapping[str, RunLog]) -> Plot:
        crosses = (
            "Crosses, one per second: the paper's own equations, in which the robot slips exactly as in Eq. 11, "
            "without compensation and compensated by Eq. 11. In the latter case the robot follows the desired path, "
            "except that commands are held for 50 ms."
        )
        return Plot(
            "fig08_feedforward_paths",
            partial(figures.paths, runs, self.published.get("feedforward", {})),
            "Feedforward only (the paper's Fig. 8)",
            "The robot drives the planned twist without feedback, so that every error of the slip law accumulates. "
            "Left: paths, with squares at their ends. Right: distance from the desired position at the same time "
            f"(errors below 0.3 mm are drawn at 0.3 mm; grey: the arc).{self._crosses(crosses)}",
        )

    def _feedback(self, runs: Mapping[str, RunLog]) -> Sequence[Plot]:
        published = self.published.get("linear", {})
        laws = {} if self.identification.steady is None else self.identification.comparison.laws
        above, same = "Crosses: the paper's own equations, as above.", "Crosses: the same by the paper's own equations."
        return (
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
                partial(figures.paths, runs, published),
                "Linear feedback controller (the paper's Fig. 10)",
                "The same with feedback of the estimated pose, from a start beside the path. Feedback corrects part "
                "of what the slip law misses, so the paths differ less than without it; the distances on the right "
                f"show the differences.{self._crosses(above)}",
            ),
            Plot(
                "fig11_feedback_errors",
                partial(figures.tracking_errors_over_time, runs, published),
                "Errors with feedback (the paper's Fig. 11)",
                Markup(
                    "Position error in the robot's frame, forward (e<sub>x</sub>) and to the left (e<sub>y</sub>), and "
                    "its norm. Left: the whole run, dominated by the start beside the path. Right: from 12 s on, where "
                    "the arc (grey) begins, in millimetres. The remaining errors come from uncompensated slip, noise "
                    "and delay.{} The controller's gains vanish with the planned speed, so nothing corrects errors "
                    "that arise while the robot comes to rest at the end."
                ).format(self._crosses("Crosses: the paper's own equations, without noise and delay.")),
            ),
            Plot(
                "fig12_slip_during_tracking",
                partial(figures.slip_during_tracking, runs, laws, published),
                "Slip during tracking (the paper's Fig. 12)",
                "Dashed: slip of each track that the law predicts at the commanded curvature."
                f"{self._crosses(same)} Thin: true slip, smoothed over "
                "0.5 s, where it is known and the sprocket turns faster than 0.3 rad/s. In the arc (grey), the left "
                "track is the inner one. The axis is the paper's; the first seconds exceed it, because the robot "
                "turns sharply towards the path.",
            ),
        )
