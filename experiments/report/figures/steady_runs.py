"""Figures of steady runs: pose and velocity, slip against speed and radius (Figs. 4 and 5), and radii driven."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.driving.paper_model import geometry_of, published_poses
from experiments.measuring.grid import RadiusSummary
from experiments.measuring.inner_outer import TRACKS, InnerOuterSamples, slip_at
from experiments.measuring.value_groups import group_label, is_narrow, value_groups
from experiments.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from experiments.report.figures.axes import bar_factor, bar_key, curve_radii, draw_bars, show_radii, with_bars
from experiments.report.figures.style import (
    INNER,
    OUTER,
    POINTS,
    RADII_SHADES,
    SPEED_SHADES,
    legend_below,
    limits_around,
    shade,
    styled,
    subplots,
    thin,
)
from trackslip.identification.fitted import FittedLaw
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.motion.filtered import butterworth_motion
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII
from trackslip.slip.exponential import PUBLISHED

_MARKERS = "osD^vP*X"
_PAPER: dict[str, Any] = {"color": BLACK, "marker": "x", "ms": 7, "mew": 1.6}
_BY_PAPER: dict[str, Any] = {"color": RED, "lw": 1.4, "ls": "--", "label": "by Eq. 11"}  # the circle of the paper's law
_TRUE: dict[str, Any] = {"color": BLACK, "lw": 0.8, "label": "truth"}


def typical_run(logs: Sequence[RunLog], radius: float = 1.5, speed: float = 0.15) -> RunLog:
    """The run commanded nearest to `radius` [m] and `speed` [m/s]; the first if no metadata has the commands."""

    def distance(log: RunLog) -> float:
        r, v = log.metadata.get("radius"), log.metadata.get("speed")
        if not isinstance(r, int | float) or not isinstance(v, int | float):
            return np.inf
        return float(np.hypot(abs(r) / radius - 1, abs(v) / speed - 1))

    return min(logs, key=distance)


@styled
def pose_and_velocity(log: RunLog) -> Figure:
    """Fig. 4: pose of one run over time and its smoothed derivatives, in the world frame."""
    motion = butterworth_motion(log)
    v, w = motion.twist.T
    phi = motion.pose[:, 2]
    figure, axes = subplots(4.8, 2, 2, sharex=True)
    position, velocity, heading, turning = axes.ravel()
    rows, fine, smooth = thin(len(log.time), 45), thin(len(log.time)), thin(len(v), 2 * POINTS)
    pose = np.where(log.is_valid[:, None], log.pose, np.nan)
    marked = ((position, 0, BLUE, "o", "x"), (position, 1, ORANGE, "s", "y"), (heading, 2, GREEN, "^", "φ"))
    for axis, column, colour, marker, name in marked:
        axis.plot(log.time[rows], pose[rows, column], marker, ms=3.6, mew=0, color=colour, label=name)
    dx, dy = v * np.cos(phi), v * np.sin(phi)
    derived = ((velocity, dx, BLUE, "dx/dt"), (velocity, dy, ORANGE, "dy/dt"), (turning, w, GREEN, "dφ/dt"))
    for axis, values, colour, name in derived:
        axis.plot(motion.time[smooth], values[smooth], color=colour, lw=0.8, label=name)
    lines = [] if log.truth is None else [(_true_traces(log), _TRUE)]
    if geometry_of(log.metadata) is not None:
        published = _near(published_poses(log), log)
        lines.append((np.column_stack([published, np.gradient(published, log.time, axis=0)]), _BY_PAPER))
    for axis, columns, label, title in (
        (position, (0, 1), "position [m]", "Position"),
        (velocity, (3, 4), "velocity [m/s]", "Velocity"),
        (heading, (2,), "heading φ [rad]", "Heading"),
        (turning, (5,), "yaw rate [rad/s]", "Yaw rate"),
    ):
        for traces, style in lines:
            axis.plot(log.time[fine], traces[fine][:, columns], **{**style, "label": None})
        handles = [*axis.get_legend_handles_labels()[0], *(Line2D([], [], **style) for _, style in lines)]
        axis.set(ylabel=label, title=title)
        # beside the title, because the traces of a turning robot visit every corner of the axes
        beside: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1, 0.98), "borderaxespad": 0}
        axis.legend(handles=handles, ncols=4, columnspacing=1.0, handlelength=1.5, handletextpad=0.5, **beside)
    for axis in axes[1]:
        axis.set_xlabel("time [s]")
    return figure


def _true_traces(log: RunLog) -> Array:
    """True poses and their derivatives in the world frame, (T, 6)."""
    assert log.truth is not None
    pose = _near(log.truth.pose, log)
    forward, left, w = log.truth.twist.T
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return np.column_stack([pose, forward * cos - left * sin, forward * sin + left * cos, w])


def _near(pose: Array, log: RunLog) -> Array:
    """Poses (T, 3) with the full turns added to their headings that bring them closest to the log's."""
    turns = np.round(np.nanmedian(log.pose[:, 2] - pose[:, 2]) / (2 * np.pi))
    return np.add(pose, [0, 0, 2 * np.pi * turns])


@styled
def published_and_simulated(radius: RadiusSummary, runs: InnerOuterSamples) -> Figure:
    """Radius driven against radius commanded, and slip against radius, published and simulated."""
    figure, (driven, slips) = subplots(3.7, 1, 2, width_ratios=(1, 1.35))
    most = 1.08 * max(*radius.commanded, *COMMANDED_RADII)
    driven.plot([0, most], [0, most], color=GREY, lw=1.0, label="without slip")
    driven.plot(COMMANDED_RADII, OBSERVED_RADII, ls="none", label="published", **_PAPER)
    driven.plot(radius.commanded, radius.observed, "o", color=OUTER, ms=6, label="simulated")
    driven.set(xlabel="radius commanded [m]", ylabel="radius driven [m]", title="Wider than commanded")
    driven.set(xlim=(0, None), ylim=(0, None))
    driven.legend(loc="upper left")
    curve = curve_radii(runs)
    published = slip_at(PUBLISHED, np.array(OBSERVED_RADII), 1.0)
    for track, (name, colour, marker) in enumerate(zip(TRACKS, (INNER, OUTER), "so", strict=True)):
        slips.plot(curve, slip_at(PUBLISHED, curve, 1.0)[:, track], color=BLACK, ls="--", lw=1.3)
        slips.plot(OBSERVED_RADII, published[:, track], ls="none", **_PAPER)
        label = f"{name} track, simulated"
        slips.plot(runs.radius, runs.slip[:, track], marker, color=colour, ms=6, mfc="none", label=label)
    slips.plot([], [], ls="--", lw=1.3, label="Eq. 11, published", **_PAPER)
    slips.axhline(0, color=GREY, lw=0.8, zorder=1)
    slips.set(ylabel="slip i [–]", title="Because the tracks slip", ylim=limits_around(np.append(runs.slip, published)))
    show_radii(slips, runs)
    slips.legend(loc="lower right")
    return figure


@styled
def slip_against_speed_and_radius(runs: InnerOuterSamples, best: FittedLaw) -> Figure:
    """Fig. 5: slip of the inner (top) and outer track (bottom) against speed (left) and radius (right)."""
    figure, axes = subplots(6.2, 2, 2, across=0.4, sharey="row", sharex="col")
    curve = curve_radii(runs)
    by_radius, by_speed = value_groups(runs.radius), value_groups(runs.speed)
    factor = bar_factor(runs)
    for row, name in enumerate(TRACKS):
        against_speed, against_radius = axes[row]
        slip = runs.slip[:, row]
        at_observed = slip_at(PUBLISHED, np.array(OBSERVED_RADII), 1.0)[:, row]
        for radius, value in zip(OBSERVED_RADII, at_observed, strict=True):
            against_speed.axhline(value, color=_shade(radius, runs), ls="--", lw=0.8)
        for marker, group in zip(_MARKERS, by_radius, strict=False):
            colour = _shade(float(runs.radius[group].mean()), runs)
            label = group_label(runs.radius[group], "m")
            against_speed.plot(runs.speed[group], slip[group], marker, color=colour, ms=4.5, label=label)
            if is_narrow(runs.radius[group]) and runs.radius[group].min() > 0:
                speeds = np.linspace(0.8 * runs.speed[group].min(), 1.1 * runs.speed[group].max(), 30)
                at = np.full(speeds.size, runs.radius[group].mean())
                left = bool(runs.left[group].mean() >= 0.5)
                against_speed.plot(speeds, slip_at(best.law, at, speeds, left=left)[:, row], color=colour, lw=1.0)
        against_radius.plot(curve, slip_at(PUBLISHED, curve, 1.0)[:, row], color=BLACK, ls="--", lw=1.2)
        for number, (marker, group) in enumerate(zip(_MARKERS, by_speed, strict=False)):
            colour = shade(SPEED_SHADES, number / max(len(by_speed) - 1, 1))
            size = 9.0 - 1.1 * min(number, 4)  # runs at one radius nearly coincide: draw the first ones larger
            label = group_label(runs.speed[group], "m/s")
            look: dict[str, Any] = {"color": colour, "ms": size, "mfc": "none", "mew": 1.1, "label": label}
            against_radius.plot(runs.radius[group], slip[group], marker, **look)
        if runs.errors is not None:
            of_slip = factor * runs.errors.slip[:, row]
            draw_bars(against_speed, runs.speed, slip, factor * runs.errors.speed, of_slip)
            draw_bars(against_radius, runs.radius, slip, factor * runs.errors.radius, of_slip)
        against_speed.set(ylabel=f"slip of the {name} track  i [–]", title=f"{name.capitalize()} track, against speed")
        against_radius.set_title(f"{name.capitalize()} track, against radius")
        against_speed.set_ylim(limits_around(np.append(with_bars(runs, row, factor), at_observed)))
    fastest = 1.1 * float(runs.speed.max()) + 0.01
    axes[1, 0].set(xlabel="measured speed v [m/s]", xlim=(-0.03 * fastest, fastest))
    show_radii(axes[1, 1], runs)
    lines = any(is_narrow(runs.radius[group]) for group in by_radius)
    best_line = [Line2D([], [], color="#777777", lw=1.0, label="best law")] if lines else []
    dashed = Line2D([], [], color="#777777", ls="--", lw=0.9, label="Eq. 11 at the paper's radii")
    curve_line = Line2D([], [], color=BLACK, ls="--", lw=1.2, label="Eq. 11")
    by_speed_lines, by_radius_lines = [*best_line, dashed], [curve_line, *bar_key(factor)]
    legends = [
        [*axis.get_legend_handles_labels()[0], *lines]
        for axis, lines in zip(axes[0], (by_speed_lines, by_radius_lines), strict=True)
    ]
    legend_below(figure, *legends, titles=("Left: observed R", "Right: measured v"), columnspacing=1.2)
    return figure


def _shade(radius: float, runs: InnerOuterSamples) -> tuple[float, float, float, float]:
    """A colour for a radius [m], on a logarithmic scale from the smallest to the largest."""
    least, most = float(runs.radius[runs.radius > 0].min(initial=min(OBSERVED_RADII))), float(runs.radius.max())
    share = np.log(max(radius, least) / least) / np.log(max(most, max(OBSERVED_RADII)) / least)
    return shade(RADII_SHADES, float(share))
