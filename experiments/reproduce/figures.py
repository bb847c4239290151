"""Figures of the published and simulated results, and the paper's Figs. 8 and 10 to 12 for runs
along its path.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from experiments.common import style
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
_LAW: Final[dict[str, Any]] = {"lw": 2.2, "ls": (0, (3, 1.2))}
_TRUE: Final[dict[str, Any]] = {"lw": 0.8}


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


@style.styled
def paths(runs: Mapping[str, RunLog]) -> style.Panels:
    """Figs. 8 and 10: paths with each compensation, and distances over time."""
    reference = paper_reference()
    left, ground = style.panel("Path", "x [m]", "y [m]", height=4.6)
    title = "Position error (log scale)"
    distance_label = "distance from the desired position [mm]"
    right, distance = style.panel(title, "time [s]", distance_label, height=4.6)
    desired = reference.pose(np.linspace(0, reference.duration, 600))
    ground.plot(desired[:, 0], desired[:, 1], label="desired", **style.DESIRED)
    for log, rows, look in _lines(runs):
        pose = _true(log)[rows]
        time = log.time[rows]
        errors = body_errors(pose, reference.pose(time))
        norm = np.hypot(errors[:, 0], errors[:, 1])
        ground.plot(*pose[:, :2].T, **look)
        distance.plot(time, 1e3 * np.maximum(norm, _CLOSEST), **look)
    for name, log in runs.items():
        ground.plot(*_true(log)[-1, :2], "s", ms=4, color=style.law_line(name)["color"])
    start = _true(next(iter(runs.values())))[0, :2]
    ground.plot(*start, "o", ms=8, mfc="white", mec=BLACK, mew=1.5, zorder=6, label="start")
    ground.set_aspect("equal", adjustable="datalim")
    distance.set(xlim=(0, reference.duration), yscale="log", ylim=(1e3 * _CLOSEST, None))
    style.mark_span(distance, TRANSIENT, _arc()[1])
    for figure, axes in ((left, ground), (right, distance)):
        style.legend_below(figure, axes.get_legend_handles_labels()[0])
    return left, right


def _lines(runs: Mapping[str, RunLog]) -> Iterator[tuple[RunLog, slice, dict[str, Any]]]:
    """Runs with the rows to draw and the looks of their lines."""
    for name, log in runs.items():
        yield log, style.thin(len(log.time)), style.law_line(name, lw=1.2, label=name)


def _true(log: RunLog) -> Array:
    """True poses (T, 3) [m, m, rad]."""
    assert log.truth is not None
    return log.truth.pose


@style.styled
def tracking_errors_over_time(runs: Mapping[str, RunLog]) -> style.Panels:
    """Fig. 11: position errors in the body frame and their norm, for the whole run and from 12 s
    on.
    """
    reference = paper_reference()
    runs = {name: runs[name] for name in ("none", "published", "icr_radius")}
    panels = []
    for begin, factor, unit, title in (
        (0.0, 1.0, "m", "Whole run"),
        (TRANSIENT, 1e3, "mm", f"From {TRANSIENT:g} s on"),
    ):
        figure, axes = style.subplots(5.6, 3, width=4.6, sharex=True)
        for log, rows, look in _lines(runs):
            late = np.flatnonzero(log.time >= begin)[rows]
            error = factor * body_errors(_true(log), reference.pose(log.time))[late, :2]
            for axis, values in zip(axes, (*error.T, np.hypot(*error.T)), strict=True):
                axis.plot(log.time[late], values, **look)
        for axis, symbol in zip(axes, ("e$_x$", "e$_y$", "‖e‖"), strict=True):
            axis.set_ylabel(f"{symbol} [{unit}]")
            style.mark_span(axis, TRANSIENT, _arc()[1])
            style.zero_line(axis)
        axes[0].set(title=title, xlim=(begin, reference.duration))
        axes[2].set_xlabel("time [s]")
        style.legend_below(figure, axes[0].get_legend_handles_labels()[0])
        panels.append(figure)
    return tuple(panels)


@style.styled
def slip_during_tracking(runs: Mapping[str, RunLog], laws: Mapping[str, SteadyFit]) -> style.Panels:
    """Fig. 12: the slip that the law predicted at each step, and the true slip, for two
    compensations.
    """
    known: dict[str, SlipLaw] = {"published": PUBLISHED, "icr_radius": laws["icr_radius"].law}
    panels = []
    for name, law in known.items():
        log = runs[name]
        figure, axes = style.panel(f"Compensated by {name}", "time [s]", "slip i [–]", height=4.2)
        style.mark_span(axes, TRANSIENT, _arc()[1])
        style.zero_line(axes)
        by_law = _slip_by(law, log)
        true = _true_slip(log)
        rows = style.thin(len(log.time), 1000)
        for side, track, colour in (("right", 1, ORANGE), ("left", 0, BLUE)):
            axes.plot(
                log.time[rows],
                by_law[rows, track],
                color=colour,
                label=f"{side} track, by the law",
                **_LAW,
            )
            axes.plot(
                log.time[rows],
                true[rows, track],
                color=colour,
                label=f"{side} track, true",
                **_TRUE,
            )
        axes.set(ylim=_SLIP_RANGE, xlim=(0, paper_reference().duration))
        style.legend_below(figure, axes.get_legend_handles_labels()[0], ncols=2)
        panels.append(figure)
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
