"""Figures of the published and simulated results, and the paper's Figs. 8 and 10 to 12 for runs
along its path.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from experiments.common import style
from experiments.common.chart import Chart, Curve, law_curve, road, start_of
from experiments.common.colours import BLACK, BLUE, GREY, ORANGE
from experiments.common.laws import law_looks
from experiments.identify.figures import curve_radii, show_radii
from experiments.identify.turns import TRACKS, Turns, slip_at
from experiments.simulate.grid_summary import RadiusSummary
from trackslip.identification.steady import SteadyFit
from trackslip.kinematics import Array, curvature, track_slip
from trackslip.laws.base import SlipLaw
from trackslip.laws.exponential import PUBLISHED
from trackslip.logs.runlog import RunLog, stored_geometry
from trackslip.metrics import TRANSIENT, body_errors
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII
from trackslip.trajectory.segmented import paper_reference

_MIN_SPROCKET_SPEED: Final = 0.3  # sprocket speed below which measured slip is noise [rad/s]
_SMOOTH: Final = 0.5  # window of the moving average over the true slip [s]
_SLIP_RANGE: Final = (-0.15, 0.10)  # range of the slip axis in the paper's Fig. 12
_CLOSEST: Final = 3e-4  # distances below this are zero crossings [m]
_PAPER: Final[dict[str, Any]] = {"color": BLACK, "marker": "x", "ms": 7, "mew": 1.6, "ls": "none"}
_EQ_11: Final[dict[str, Any]] = {"color": BLACK, "ls": "--", "lw": 1.2}


@style.styled
def published_and_simulated(radius: RadiusSummary, turns: Turns) -> style.Panels:
    """Driven against commanded radius, and slip against radius, published and simulated."""
    left, radii = style.panel("Wider than commanded", "radius commanded [m]", "radius driven [m]")
    most = 1.08 * max(*radius.commanded, *COMMANDED_RADII)
    radii.plot([0, most], [0, most], color=GREY, lw=1.0, label="without slip")
    radii.plot(COMMANDED_RADII, OBSERVED_RADII, label="published", **_PAPER)
    radii.plot(radius.commanded, radius.observed, "o", color=style.OUTER, ms=6, label="simulated")
    radii.set(xlim=(0, None), ylim=(0, None))
    radii.legend(loc="upper left")
    right, slips = style.panel("Because the tracks slip", "", "slip i [–]")
    curve = curve_radii(turns)
    published = slip_at(PUBLISHED, np.array(OBSERVED_RADII), 1.0)
    for track, (name, colour, marker) in enumerate(
        zip(TRACKS, (style.INNER, style.OUTER), "so", strict=True)
    ):
        slips.plot(curve, slip_at(PUBLISHED, curve, 1.0)[:, track], **_EQ_11)
        slips.plot(OBSERVED_RADII, published[:, track], **_PAPER)
        label = f"{name} track, simulated"
        slips.plot(
            turns.radius, turns.slip[:, track], marker, color=colour, ms=6, mfc="none", label=label
        )
    slips.plot([], [], label="Eq. 11, published", **_PAPER | {"ls": "--", "lw": 1.3})
    style.zero_line(slips)
    show_radii(slips, turns)
    slips.legend(loc="lower right")
    return left, right


def runs_of(logs: Sequence[RunLog], controller: str) -> dict[str, RunLog]:
    """Runs with `controller` by compensation, in the order of `law_looks`."""
    runs = {
        str(log.metadata["compensation"]): log
        for log in logs
        if log.metadata["controller"] == controller
    }
    return {name: runs[name] for name in law_looks() if name in runs}


def _arc() -> tuple[float, float]:
    """Times at which the arc of the paper's reference begins and ends [s]."""
    time = np.arange(0, paper_reference().duration, 0.05)
    turning = time[paper_reference().twist(time)[:, 1] != 0]
    return float(turning[0]), float(turning[-1])


def paths(runs: Mapping[str, RunLog]) -> tuple[Chart, Chart]:
    """Figs. 8 and 10: paths with each compensation, and distances over time."""
    reference = paper_reference()
    desired = reference.pose(np.linspace(0, reference.duration, 600))
    on_ground = [road(desired, "desired")]
    over_time = []
    ends = []
    for name, log in runs.items():
        rows = style.thin(len(log.time))
        pose = _true(log)[rows]
        time = log.time[rows]
        errors = body_errors(pose, reference.pose(time))
        norm = np.hypot(errors[:, 0], errors[:, 1])
        on_ground.append(law_curve(pose[:, 0], pose[:, 1], name, width=1.2))
        over_time.append(law_curve(time, 1e3 * np.maximum(norm, _CLOSEST), name, width=1.2))
        end = _true(log)[-1]
        colour = style.law_line(name)["color"]
        ends.append(Curve(end[:1], end[1:2], name, colour, 0.0, marker="s"))
    start = start_of(_true(next(iter(runs.values()))))
    title = "Position error (log scale)"
    distance = "distance from the desired position [mm]"
    return (
        Chart("Path", "x [m]", "y [m]", [*on_ground, *ends, start], 4.6, is_map=True),
        Chart(
            title,
            "time [s]",
            distance,
            over_time,
            4.6,
            is_log=True,
            xlim=(0.0, reference.duration),
            span=(TRANSIENT, _arc()[1]),
        ),
    )


def _true(log: RunLog) -> Array:
    """True poses (T, 3) [m, m, rad]."""
    assert log.truth is not None
    return log.truth.pose


def tracking_errors_over_time(runs: Mapping[str, RunLog]) -> tuple[Chart, Chart]:
    """Fig. 11: position errors in the body frame and their norm, for the whole run and from 12 s
    on.
    """
    return (
        _errors_from(runs, 0.0, 1.0, "m", "Whole run"),
        _errors_from(runs, TRANSIENT, 1e3, "mm", f"From {TRANSIENT:g} s on"),
    )


def _errors_from(
    runs: Mapping[str, RunLog], begin: float, factor: float, unit: str, title: str
) -> Chart:
    """Errors from `begin` [s] on, times `factor` in this unit: three charts over each other."""
    reference = paper_reference()
    curves: list[list[Curve]] = [[], [], []]  # ahead, to the left, and their norm
    for name in ("none", "published", "icr_radius"):
        log = runs[name]
        late = np.flatnonzero(log.time >= begin)[style.thin(len(log.time))]
        errors = body_errors(_true(log), reference.pose(log.time))
        ahead, left, _ = factor * errors[late].T
        for of_name, values in zip(curves, (ahead, left, np.hypot(ahead, left)), strict=True):
            of_name.append(law_curve(log.time[late], values, name, width=1.2))
    names = ("ahead", "to the left", "distance")
    charts = [
        Chart(
            "",
            "time [s]",
            f"{name} [{unit}]",
            of_name,
            1.9,
            xlim=(begin, reference.duration),
            span=(TRANSIENT, _arc()[1]),
            has_zero=True,
        )
        for name, of_name in zip(names, curves, strict=True)
    ]
    return replace(charts[0], title=title, below=charts[1:])


def slip_during_tracking(
    runs: Mapping[str, RunLog], laws: Mapping[str, SteadyFit]
) -> tuple[Chart, ...]:
    """Fig. 12: the slip that the law predicted at each step, and the true slip, for two
    compensations.
    """
    known: dict[str, SlipLaw] = {"published": PUBLISHED, "icr_radius": laws["icr_radius"].law}
    panels = []
    for name, law in known.items():
        log = runs[name]
        by_law = _slip_by(law, log)
        true = _true_slip(log)
        rows = style.thin(len(log.time), 1000)
        time = log.time[rows]
        curves = []
        for side, track, colour in (("right", 1, ORANGE), ("left", 0, BLUE)):
            label = f"{side} track, by the law"
            predicted = Curve(time, by_law[rows, track], label, colour, 2.2, (0, (3, 1.2)))
            driven = Curve(time, true[rows, track], f"{side} track, true", colour, 0.8)
            curves += [predicted, driven]
        chart = Chart(
            f"Compensated by {name}",
            "time [s]",
            "slip i [–]",
            curves,
            4.2,
            xlim=(0.0, paper_reference().duration),
            ylim=_SLIP_RANGE,
            span=(TRANSIENT, _arc()[1]),
            has_zero=True,
        )
        panels.append(chart)
    return tuple(panels)


def _slip_by(law: SlipLaw, log: RunLog) -> Array:
    """The slip (T, 2) that a law predicts for the commanded twists of a run."""
    assert log.twist_command is not None
    return law(curvature(log.twist_command))


def _true_slip(log: RunLog) -> Array:
    """Smoothed true slip (T, 2) [-], NaN where a sprocket hardly turns."""
    robot = stored_geometry(log)
    assert robot is not None
    assert log.truth is not None
    period = float(np.median(np.diff(log.time)))
    width = max(1, round(_SMOOTH / period))
    window = np.ones(width) / width

    def smoothed(values: Array) -> Array:
        """Moving averages of columns (T, 2)."""
        columns = [np.convolve(column, window, mode="same") for column in values.T]
        return np.column_stack(columns)

    omega = smoothed(log.omega)
    twist = smoothed(log.truth.twist[:, [0, 2]])
    slip = track_slip(omega, twist, robot)
    return np.where(np.abs(omega) > _MIN_SPROCKET_SPEED, slip, np.nan)
