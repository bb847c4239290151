"""Figures of tracking, after Figs. 7-12 of the paper, at true poses where the logs have them, else estimated ones."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc

from experiments.driving.paper_model import geometry_of
from experiments.report.colours import BLACK, BLUE, COLOURS, GREEN, GREY, LABELS, ORANGE
from experiments.report.figures.style import DESIRED, law_line, legend_below, mark_span, styled, subplots, thin
from trackslip.identification.fitted import FittedLaw
from trackslip.kinematics import Array, curvature, track_slip
from trackslip.logs.runlog import RunLog
from trackslip.metrics import TRANSIENT, body_errors
from trackslip.slip.base import SlipLaw
from trackslip.slip.exponential import PUBLISHED
from trackslip.trajectory.base import Reference
from trackslip.trajectory.segmented import paper_reference

_MIN_SPROCKET_SPEED = 0.3  # sprocket speed below which measured slip is noise [rad/s]
_SMOOTH = 0.5  # window of the moving average over the true slip [s]
_CLOSEST = 3e-4  # distances below this are zero crossings [m]
_POLE = 0.5  # slip beyond which a law is near its pole, where no line is drawn [-]
_SLIP_RANGE = (-0.15, 0.10)  # of Fig. 12
_EVERY = 20  # steps between crosses of a run by the paper's equations: 1 s
_ROBOT_POSE, _DESIRED_POSE = np.array([[0.2, 0.15, np.radians(20)], [1.5, 1.2, np.radians(55)]])  # of Fig. 9
_SIDES = {1: ORANGE, 0: BLUE}  # tracks
_LAW: dict[str, Any] = {"lw": 2.2, "ls": (0, (3, 1.2))}
_TRUE: dict[str, Any] = {"lw": 0.8}
_CROSS: dict[str, Any] = {"ls": "none", "marker": "x", "ms": 4.5}


def runs_of(logs: Sequence[RunLog], controller: str) -> dict[str, RunLog]:
    """Compensation -> the first run of `controller` with it on the paper's path, in the order of COLOURS."""
    found: dict[str, RunLog] = {}
    for log in logs:
        if log.metadata.get("controller") == controller and log.metadata.get("reference", "paper") == "paper":
            found.setdefault(str(log.metadata.get("compensation")), log)
    return {name: found[name] for name in dict.fromkeys([*COLOURS, *found]) if name in found}


def driven(log: RunLog) -> Array:
    """True poses (T, 3) [m, m, rad], or without truth the estimated ones, NaN where there is none."""
    if log.truth is not None:
        return log.truth.pose
    return np.where(log.is_valid[:, None], log.pose, np.nan)


@styled
def planned_trajectory() -> Figure:
    """Fig. 7: the reference's position and heading over time."""
    reference = paper_reference()
    time = np.linspace(0, reference.duration, 460)
    pose = reference.pose(time)
    figure, (position, heading) = subplots(3.6, 1, 2)
    position.plot(time, pose[:, 0], color=BLUE, label="x$_d$")
    position.plot(time, pose[:, 1], color=ORANGE, ls="--", label="y$_d$")
    heading.plot(time, pose[:, 2], color=GREEN, label="φ$_d$")
    begin, *_, end = time[reference.twist(time)[:, 1] != 0]
    for axis in (position, heading):
        mark_span(axis, begin, end)
        beside = axis.get_xaxis_transform()
        axis.text((begin + end) / 2, 0.03, "arc", transform=beside, ha="center", color="#666666")
        axis.set(xlabel="time [s]", xlim=(0, reference.duration))
    position.set(ylabel="desired position [m]", title="Position")
    heading.set(ylabel="desired heading [rad]", title="Heading")
    heading.set_yticks(np.pi * np.array([1 / 2, 2 / 3, 1, 4 / 3]), ["π/2", "2π/3", "π", "4π/3"])
    position.legend(loc="lower left")
    return figure


def draw_paths(reference: Reference, runs: Mapping[str, tuple[RunLog, Mapping[str, Any]]]) -> tuple[Figure, Axes, Axes]:
    """Paths beside the reference, and distances from it over time; `runs` are logs with line keywords, by label."""
    figure, (plane, distance) = subplots(4.2, 1, 2, width_ratios=(1.2, 1))
    distance.set_yscale("log")
    desired = reference.pose(np.linspace(0, reference.duration, 600))
    plane.plot(desired[:, 0], desired[:, 1], label="desired", **DESIRED)
    for label, (log, style) in runs.items():
        pose = driven(log)
        rows = thin(len(log.time))
        plane.plot(pose[rows, 0], pose[rows, 1], label=label, lw=1.2, **style)
        norm = np.hypot(*body_errors(pose, reference.pose(log.time))[:, :2].T)
        distance.plot(log.time[rows], 1e3 * np.maximum(norm[rows], _CLOSEST), lw=1.2, **style)
    start = driven(next(iter(runs.values()))[0])[0]
    plane.plot(*start[:2], "o", ms=8, mfc="white", mec=BLACK, mew=1.5, zorder=6)
    plane.annotate("start", start[:2], xytext=(12, -3), textcoords="offset points", fontsize=8.5, annotation_clip=False)
    plane.set_aspect("equal", adjustable="datalim")
    plane.set(xlabel="x [m]", ylabel="y [m]", title="Path")
    distance.set(xlabel="time [s]", xlim=(0, reference.duration), title="Position error (log scale)")
    distance.set_ylabel("distance from the desired position [mm]")
    return figure, plane, distance


@styled
def paths(runs: Mapping[str, RunLog], published: Mapping[str, RunLog]) -> Figure:
    """Figs. 8 and 10: paths with each compensation, and distances over time; crosses: `published`, by equations."""
    reference = paper_reference()
    lines = {LABELS.get(name, name): (log, law_line(name)) for name, log in runs.items()}
    figure, plane, distance = draw_paths(reference, lines)
    for name, log in runs.items():
        plane.plot(*driven(log)[-1, :2], "s", ms=4, color=law_line(name)["color"])
    for name, log in published.items():
        rows = slice(None, None, _EVERY)
        norm = np.hypot(*body_errors(log.pose, reference.pose(log.time))[rows, :2].T)
        plane.plot(log.pose[rows, 0], log.pose[rows, 1], **_crosses(name))
        seen = norm > _CLOSEST
        distance.plot(log.time[rows][seen], 1e3 * norm[seen], **_crosses(name))
    distance.set_ylim(bottom=1e3 * _CLOSEST)
    mark_span(distance, TRANSIENT, _arc_end())
    legend_below(figure, plane.get_legend_handles_labels()[0])
    return figure


def _crosses(name: str) -> dict[str, Any]:
    """Keywords of the crosses that stand for the paper's equations with a compensation."""
    label, marker = f"{LABELS[name]}: by the paper's equations", {"none": "x", "published": "+"}[name]
    return {"color": COLOURS[name], "ls": "none", "label": label, "marker": marker, "ms": 5.5, "mew": 1.1}


def _arc_end() -> float:
    """Time at which the reference's arc ends [s]."""
    reference = paper_reference()
    time = np.arange(0, reference.duration, 0.05)
    return float(time[reference.twist(time)[:, 1] != 0][-1])


@styled
def tracking_errors_over_time(runs: Mapping[str, RunLog], published: Mapping[str, RunLog]) -> Figure:
    """Fig. 11: body-frame position errors and their norm, right from 12 s on; crosses: `published`, by equations."""
    reference = paper_reference()
    figure, axes = subplots(5.4, 3, 2, down=0.3, sharex="col", width_ratios=(1, 1.35))
    for name in [n for n in ("none", "published", "icr_radius") if n in runs] or list(runs):
        log = runs[name]
        traces = _error_traces(log, reference)
        after = np.flatnonzero(log.time >= TRANSIENT)
        rows, after = thin(len(log.time)), after[thin(len(after))]
        style = law_line(name, lw=1.2, label=LABELS.get(name, name))
        for k in range(3):
            axes[k, 0].plot(log.time[rows], traces[rows, k], **style)
            axes[k, 1].plot(log.time[after], 1e3 * traces[after, k], **style)
    for name, log in published.items():
        time, traces = log.time[::_EVERY], _error_traces(log, reference)[::_EVERY]
        late = time >= TRANSIENT
        for k in range(3):
            axes[k, 0].plot(time, traces[:, k], **_crosses(name))
            axes[k, 1].plot(time[late], 1e3 * traces[late, k], **_crosses(name))
    for k, symbol in enumerate(("e$_x$", "e$_y$", "‖e‖")):
        axes[k, 0].set_ylabel(f"{symbol} [m]")
        axes[k, 1].set_ylabel(f"{symbol} [mm]")
        for axis in axes[k]:
            mark_span(axis, TRANSIENT, _arc_end())
            axis.axhline(0, color="#888888", lw=0.7, zorder=1)
    axes[0, 0].set(title="Whole run", xlim=(0, reference.duration))
    axes[0, 1].set(title=f"From {TRANSIENT:g} s on (grey: the arc)", xlim=(TRANSIENT, reference.duration))
    for axis in axes[2]:
        axis.set_xlabel("time [s]")
    legend_below(figure, axes[0, 0].get_legend_handles_labels()[0])
    return figure


def _error_traces(log: RunLog, reference: Reference) -> Array:
    """Errors forward and to the left, and their norm, (T, 3) [m]."""
    error = body_errors(driven(log), reference.pose(log.time))[:, :2]
    return np.column_stack([error, np.hypot(error[:, 0], error[:, 1])])


@styled
def slip_during_tracking(
    runs: Mapping[str, RunLog], laws: Mapping[str, FittedLaw], published: Mapping[str, RunLog]
) -> Figure | None:
    """Fig. 12: the slip that the law predicted at each step and, where it is known, the true one.

    Up to two compensations, one above the other, with crosses for the paper's equations where `published` has them;
    None if no run has commanded twists and a known law.
    """
    known: dict[str, SlipLaw] = {"published": PUBLISHED, **{name: fit.law for name, fit in laws.items()}}
    names = [n for n in ("published", "icr_radius", "icr", "exponential") if n in runs and n in known]
    names = [n for n in names if runs[n].twist_command is not None][:2]
    if not names:
        return None
    figure, axes = subplots(1.5 + 1.9 * len(names), len(names), 1, sharex=True, squeeze=False)
    column = axes[:, 0]
    for axis, name in zip(column, names, strict=True):
        _slip_panel(axis, runs[name], known[name], published.get(name))
        axis.set(ylim=_SLIP_RANGE, ylabel="slip i [–]", title=f"Compensated by: {LABELS[name]}")
    column[-1].set(xlabel="time [s]", xlim=(0, paper_reference().duration))
    handles = [
        Line2D([], [], color=_SIDES[track], label=f"{side} track, {kind}", **look)
        for track, side in ((1, "right"), (0, "left"))
        for kind, look in (("from the law", _LAW), ("true", _TRUE), ("by the paper's equations", _CROSS))
    ]
    legend_below(figure, handles, ncols=2)
    return figure


def _slip_panel(axis: Axes, log: RunLog, law: SlipLaw, published: RunLog | None) -> None:
    """Draw the slip of both tracks over time: thick from the law, thin the true one, crosses by the equations."""
    mark_span(axis, TRANSIENT, _arc_end())
    axis.axhline(0, color="#888888", lw=0.7, zorder=1)
    slip = _slip_by(law, log)
    slip = np.where(np.abs(slip) < _POLE, slip, np.nan)
    true = _true_slip(log)
    rows = thin(len(log.time), 1000)
    for track, colour in _SIDES.items():
        axis.plot(log.time[rows], slip[rows, track], color=colour, **_LAW)
        if true is not None:
            axis.plot(log.time[rows], true[rows, track], color=colour, **_TRUE)
    if published is not None:
        slip = _slip_by(law, published)
        for track, colour in _SIDES.items():
            axis.plot(published.time[::_EVERY], slip[::_EVERY, track], color=colour, **_CROSS)


def _slip_by(law: SlipLaw, log: RunLog) -> Array:
    """The slip (T, 2) that a law gives for the commanded twists of a run."""
    assert log.twist_command is not None
    return law(curvature(log.twist_command))


def _true_slip(log: RunLog) -> Array | None:
    """Smoothed true slip (T, 2) [-], NaN where a sprocket hardly turns; None without truth or geometry."""
    robot = geometry_of(log.metadata)
    if log.truth is None or robot is None:
        return None
    width = max(1, round(_SMOOTH / float(np.median(np.diff(log.time)))))
    speeds = np.column_stack([log.omega, log.truth.twist[:, [0, 2]]])
    smooth = np.column_stack([np.convolve(column, np.ones(width) / width, mode="same") for column in speeds.T])
    omega = smooth[:, :2]
    slip = track_slip(omega, smooth[:, 2:], robot)
    return np.where(np.abs(omega) > _MIN_SPROCKET_SPEED, slip, np.nan)


@styled
def errors_defined() -> Figure:
    """Fig. 9: the errors of Eq. 18 between a robot and its desired pose, in the robot's frame."""
    e_x, e_y, e_phi = body_errors(_ROBOT_POSE, _DESIRED_POSE)
    forward, left = _rotation(_ROBOT_POSE[2]).T
    corner = _ROBOT_POSE[:2] + e_x * forward
    figure, axis = subplots(3.6)
    _robot(axis, _ROBOT_POSE, BLACK, "robot (x, y, φ)")
    _robot(axis, _DESIRED_POSE, GREY, "desired (x$_d$, y$_d$, φ$_d$)")
    axis.plot(*np.transpose([_ROBOT_POSE[:2], corner]), color=BLUE, lw=2.2)
    axis.plot(*np.transpose([corner, corner + e_y * left]), color=ORANGE, lw=2.2, ls="--")
    middle = (_ROBOT_POSE[:2] + corner) / 2
    axis.annotate("e$_x$, forward", middle, xytext=(8, -14), textcoords="offset points", color=BLUE)
    axis.annotate("e$_y$, to the left", corner + e_y / 2 * left, xytext=(8, -4), textcoords="offset points")
    ahead = _DESIRED_POSE[:2] + 0.7 * forward
    axis.plot(*np.transpose([_DESIRED_POSE[:2], ahead]), color=GREY, lw=1.0, ls=":")
    angles = np.degrees([_ROBOT_POSE[2], _ROBOT_POSE[2] + e_phi])
    axis.add_patch(Arc(tuple(_DESIRED_POSE[:2]), 1.0, 1.0, theta1=angles[0], theta2=angles[1], color=GREEN, lw=2.2))
    middle = _DESIRED_POSE[:2] + 0.56 * _rotation(np.radians(angles.mean()))[:, 0]
    axis.annotate("e$_φ$", (middle[0], middle[1]), color=GREEN, va="center")
    axis.set_aspect("equal")
    axis.set(xlabel="x [m]", ylabel="y [m]", xlim=(-1.2, 3.0), ylim=(-0.3, 1.9))
    return figure


def _robot(axis: Axes, pose: Array, colour: str, label: str) -> None:
    """Draw a body with an arrow that points forward."""
    x, y, phi = pose
    turn = _rotation(phi)
    corners = np.array([[0.2, 0.17], [-0.2, 0.17], [-0.2, -0.17], [0.2, -0.17], [0.2, 0.17]]) @ turn.T
    axis.plot(x + corners[:, 0], y + corners[:, 1], color=colour, lw=1.5)
    tip = pose[:2] + 0.38 * turn[:, 0]
    axis.annotate("", (tip[0], tip[1]), (x, y), arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.5})
    axis.annotate(label, (x, y), xytext=(-44, 0), textcoords="offset points", ha="right", va="center")


def _rotation(angle: float) -> Array:
    """The matrix (2, 2) that turns vectors by an angle [rad]."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
