"""Figures of tracking, after Figs. 7-12 of the paper, at true poses where the logs have them, else estimated ones."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc

from experiments.common import style
from experiments.common.colours import BLACK, BLUE, GREEN, GREY, ORANGE
from experiments.common.laws import law_looks, shown
from trackslip.identification.fitted import SteadyFit
from trackslip.kinematics import Array, curvature, track_slip
from trackslip.logs.runlog import RunLog, stored_geometry
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
_ROBOT, _DESIRED = np.array([[0.2, 0.15, np.radians(20)], [1.5, 1.2, np.radians(55)]])  # poses in Fig. 9
_SIDES = {1: ORANGE, 0: BLUE}  # tracks
_LAW: dict[str, Any] = {"lw": 2.2, "ls": (0, (3, 1.2))}
_TRUE: dict[str, Any] = {"lw": 0.8}
_CROSS: dict[str, Any] = {"ls": "none", "marker": "x", "ms": 4.5}


def runs_of(logs: Sequence[RunLog], controller: str) -> dict[str, RunLog]:
    """Compensation -> the first run of `controller` with it on the paper's path, in the order of `law_looks`."""
    found: dict[str, RunLog] = {}
    for log in logs:
        if log.metadata.get("controller") == controller and log.metadata.get("reference", "paper") == "paper":
            found.setdefault(str(log.metadata.get("compensation")), log)
    return {name: found[name] for name in dict.fromkeys([*law_looks(), *found]) if name in found}


def driven(log: RunLog) -> Array:
    """True poses (T, 3) [m, m, rad], or without truth the estimated ones, NaN where there is none."""
    if log.truth is not None:
        return log.truth.pose
    return np.where(log.is_valid[:, None], log.pose, np.nan)


def _arc() -> tuple[float, float]:
    """Times at which the arc of the paper's reference begins and ends [s]."""
    reference = paper_reference()
    time = np.arange(0, reference.duration, 0.05)
    turning = time[reference.twist(time)[:, 1] != 0]
    return float(turning[0]), float(turning[-1])


@style.styled
def planned_trajectory() -> Figure:
    """Fig. 7: the reference's position and heading over time."""
    reference = paper_reference()
    time = np.linspace(0, reference.duration, 460)
    pose = reference.pose(time)
    figure, (position, heading) = style.subplots(3.6, 1, 2)
    position.plot(time, pose[:, 0], color=BLUE, label="x$_d$")
    position.plot(time, pose[:, 1], color=ORANGE, ls="--", label="y$_d$")
    heading.plot(time, pose[:, 2], color=GREEN, label="φ$_d$")
    for axis in (position, heading):
        style.mark_span(axis, *_arc())
        axis.text(np.mean(_arc()), 0.03, "arc", transform=axis.get_xaxis_transform(), ha="center", color="#666666")
        axis.set(xlabel="time [s]", xlim=(0, reference.duration))
    position.set(ylabel="desired position [m]", title="Position")
    heading.set(ylabel="desired heading [rad]", title="Heading")
    heading.set_yticks(np.pi * np.array([1 / 2, 2 / 3, 1, 4 / 3]), ["π/2", "2π/3", "π", "4π/3"])
    position.legend(loc="lower left")
    return figure


def draw_paths(reference: Reference, runs: Mapping[str, tuple[RunLog, Mapping[str, Any]]]) -> tuple[Figure, Axes, Axes]:
    """Paths and their reference, and distances from it over time; `runs` are logs with line keywords, by label."""
    figure, (ground, distance) = style.subplots(4.2, 1, 2, width_ratios=(1.2, 1))
    desired = reference.pose(np.linspace(0, reference.duration, 600))
    ground.plot(*desired[:, :2].T, label="desired", **style.DESIRED)
    for label, (log, look) in runs.items():
        pose, rows = driven(log), style.thin(len(log.time))
        norm = np.hypot(*body_errors(pose, reference.pose(log.time))[:, :2].T)
        ground.plot(*pose[rows, :2].T, label=label, lw=1.2, **look)
        distance.plot(log.time[rows], 1e3 * np.maximum(norm[rows], _CLOSEST), lw=1.2, **look)
    start = driven(next(iter(runs.values()))[0])[0]
    ground.plot(*start[:2], "o", ms=8, mfc="white", mec=BLACK, mew=1.5, zorder=6)
    clear = {"fc": "white", "ec": "none", "pad": 0.5, "alpha": 0.8}  # of the paths that leave from there
    ground.annotate("start", start[:2], xytext=(10, 8), textcoords="offset points", annotation_clip=False, bbox=clear)
    style.plane(ground, adjustable="datalim", title="Path")
    distance.set(xlabel="time [s]", xlim=(0, reference.duration), title="Position error (log scale)", yscale="log")
    distance.set_ylabel("distance from the desired position [mm]")
    return figure, ground, distance


@style.styled
def paths(runs: Mapping[str, RunLog], published: Mapping[str, RunLog]) -> Figure:
    """Figs. 8 and 10: paths with each compensation, and distances over time; crosses: `published`, by equations."""
    reference = paper_reference()
    figure, ground, distance = draw_paths(
        reference, {shown(n).label: (log, style.law_line(n)) for n, log in runs.items()}
    )
    for name, log in runs.items():
        ground.plot(*driven(log)[-1, :2], "s", ms=4, color=shown(name).colour)
    for name, log in published.items():
        time, pose = log.time[::_EVERY], log.pose[::_EVERY]
        norm = np.hypot(*body_errors(pose, reference.pose(time))[:, :2].T)
        ground.plot(*pose[:, :2].T, **_crosses(name))
        distance.plot(time, 1e3 * np.where(norm > _CLOSEST, norm, np.nan), **_crosses(name))
    distance.set_ylim(bottom=1e3 * _CLOSEST)
    style.mark_span(distance, TRANSIENT, _arc()[1])
    style.legend_below(figure, ground.get_legend_handles_labels()[0])
    return figure


def _crosses(name: str) -> dict[str, Any]:
    """Keywords of the crosses that stand for the paper's equations with a compensation."""
    law, marker = shown(name), {"none": "x", "published": "+"}[name]
    look = _CROSS | {"marker": marker, "ms": 5.5, "mew": 1.1}
    return look | {"color": law.colour, "label": f"{law.label}: by the paper's equations"}


@style.styled
def tracking_errors_over_time(runs: Mapping[str, RunLog], published: Mapping[str, RunLog]) -> Figure:
    """Fig. 11: body-frame position errors and their norm, right from 12 s on; crosses: `published`, by equations."""
    reference = paper_reference()
    chosen = [name for name in ("none", "published", "icr_radius") if name in runs] or list(runs)
    lines = [
        (runs[name], style.thin(len(runs[name].time)), style.law_line(name, lw=1.2, label=shown(name).label))
        for name in chosen
    ]
    lines += [(log, slice(None, None, _EVERY), _crosses(name)) for name, log in published.items()]
    figure, axes = style.subplots(5.4, 3, 2, down=0.3, sharex="col", width_ratios=(1, 1.35))
    for log, rows, look in lines:
        error = body_errors(driven(log), reference.pose(log.time))[:, :2]
        late = np.flatnonzero(log.time >= TRANSIENT)[rows]
        for pair, values in zip(axes, (*error.T, np.hypot(*error.T)), strict=True):
            pair[0].plot(log.time[rows], values[rows], **look)
            pair[1].plot(log.time[late], 1e3 * values[late], **look)
    for pair, symbol in zip(axes, ("e$_x$", "e$_y$", "‖e‖"), strict=True):
        for axis, unit in zip(pair, ("m", "mm"), strict=True):
            axis.set_ylabel(f"{symbol} [{unit}]")
            style.mark_span(axis, TRANSIENT, _arc()[1])
            style.zero_line(axis)
    axes[0, 0].set(title="Whole run", xlim=(0, reference.duration))
    axes[0, 1].set(title=f"From {TRANSIENT:g} s on (grey: the arc)", xlim=(TRANSIENT, reference.duration))
    for axis in axes[2]:
        axis.set_xlabel("time [s]")
    style.legend_below(figure, axes[0, 0].get_legend_handles_labels()[0])
    return figure


@style.styled
def slip_during_tracking(
    runs: Mapping[str, RunLog], laws: Mapping[str, SteadyFit], published: Mapping[str, RunLog]
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
    figure, axes = style.subplots(1.2 + 1.9 * len(names), len(names), down=0.4, sharex=True, squeeze=False)
    for axis, name in zip(axes[:, 0], names, strict=True):
        log, beside = runs[name], published.get(name)
        style.mark_span(axis, TRANSIENT, _arc()[1])
        style.zero_line(axis)
        slip, true, rows = _slip_by(known[name], log), _true_slip(log), style.thin(len(log.time), 1000)
        for track, colour in _SIDES.items():
            axis.plot(log.time[rows], np.where(np.abs(slip) < _POLE, slip, np.nan)[rows, track], color=colour, **_LAW)
            if true is not None:
                axis.plot(log.time[rows], true[rows, track], color=colour, **_TRUE)
            if beside is not None:
                crosses = _slip_by(known[name], beside)[::_EVERY, track]
                axis.plot(beside.time[::_EVERY], crosses, color=colour, **_CROSS)
        axis.set(ylim=_SLIP_RANGE, ylabel="slip i [–]", title=f"Compensated by: {shown(name).label}")
    axes[-1, 0].set(xlabel="time [s]", xlim=(0, paper_reference().duration))
    kinds = {"from the law": _LAW, "true": _TRUE, "by the paper's equations": _CROSS}
    handles = [
        style.key(f"{side} track, {kind}", color=_SIDES[track], **look)
        for track, side in ((1, "right"), (0, "left"))
        for kind, look in kinds.items()
    ]
    style.legend_below(figure, handles, ncols=2)
    return figure


def _slip_by(law: SlipLaw, log: RunLog) -> Array:
    """The slip (T, 2) that a law gives for the commanded twists of a run."""
    assert log.twist_command is not None
    return law(curvature(log.twist_command))


def _true_slip(log: RunLog) -> Array | None:
    """Smoothed true slip (T, 2) [-], NaN where a sprocket hardly turns; None without truth or geometry."""
    robot = stored_geometry(log)
    if log.truth is None or robot is None:
        return None
    width = max(1, round(_SMOOTH / float(np.median(np.diff(log.time)))))
    speeds = np.column_stack([log.omega, log.truth.twist[:, [0, 2]]])
    smooth = np.column_stack([np.convolve(column, np.ones(width) / width, mode="same") for column in speeds.T])
    slip = track_slip(smooth[:, :2], smooth[:, 2:], robot)
    return np.where(np.abs(smooth[:, :2]) > _MIN_SPROCKET_SPEED, slip, np.nan)


@style.styled
def errors_defined() -> Figure:
    """Fig. 9: the errors of Eq. 18 between a robot and its desired pose, in the robot's frame."""
    e_x, e_y, e_phi = body_errors(_ROBOT, _DESIRED)
    forward, left = _rotation(_ROBOT[2]).T
    corner = _ROBOT[:2] + e_x * forward
    figure, axes = style.subplots(3.6)
    for pose, colour, label in ((_ROBOT, BLACK, "robot (x, y, φ)"), (_DESIRED, GREY, "desired (x$_d$, y$_d$, φ$_d$)")):
        turn, place = _rotation(pose[2]), pose[:2]
        body = np.array([[0.2, 0.17], [-0.2, 0.17], [-0.2, -0.17], [0.2, -0.17], [0.2, 0.17]]) @ turn.T + place
        arrow = {"arrowstyle": "->", "color": colour, "lw": 1.5}
        axes.plot(*body.T, color=colour, lw=1.5)
        axes.annotate("", place + 0.38 * turn[:, 0], place, arrowprops=arrow)
        axes.annotate(label, place, xytext=(-44, 0), textcoords="offset points", ha="right", va="center")
    axes.plot(*np.transpose([_ROBOT[:2], corner]), color=BLUE, lw=2.2)
    axes.plot(*np.transpose([corner, corner + e_y * left]), color=ORANGE, lw=2.2, ls="--")
    axes.plot(*np.transpose([_DESIRED[:2], _DESIRED[:2] + 0.7 * forward]), color=GREY, lw=1.0, ls=":")
    angles = np.degrees([_ROBOT[2], _ROBOT[2] + e_phi])
    axes.add_patch(Arc(tuple(_DESIRED[:2]), 1.0, 1.0, theta1=angles[0], theta2=angles[1], color=GREEN, lw=2.2))
    for text, place, offset, colour in (
        ("e$_x$, forward", (_ROBOT[:2] + corner) / 2, (8, -14), BLUE),
        ("e$_y$, to the left", corner + e_y / 2 * left, (8, -4), BLACK),
        ("e$_φ$", _DESIRED[:2] + 0.56 * _rotation(np.radians(angles.mean()))[:, 0], (0, 0), GREEN),
    ):
        axes.annotate(text, place, xytext=offset, textcoords="offset points", color=colour)
    style.plane(axes, xlim=(-1.2, 3.0), ylim=(-0.3, 1.9))
    return figure


def _rotation(angle: float) -> Array:
    """The matrix (2, 2) that turns vectors by an angle [rad]."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
