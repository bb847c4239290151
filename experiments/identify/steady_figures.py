"""Figures of steady runs: pose and velocity (Fig. 4), slip against speed and radius (Fig. 5), and radii driven."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.common import style
from experiments.common.colours import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from experiments.identify.steady_turns import TRACKS, InnerOuterSamples, group_label, is_narrow, slip_at, value_groups
from experiments.simulate.grid_summary import RadiusSummary
from experiments.simulate.paper_model import published_poses
from trackslip import se2
from trackslip.identification.fitted import SteadyFit
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog, stored_geometry
from trackslip.motion.filtered import paper_motion
from trackslip.paper import COMMANDED_RADII, OBSERVED_RADII
from trackslip.slip.exponential import PUBLISHED

BARS: dict[str, Any] = {"fmt": "none", "ecolor": "#777777", "elinewidth": 0.7, "zorder": 4}
"""Look of error bars."""
_WIDE = 8.0  # ratio of the largest to the smallest radius above which the axis is logarithmic
_MIN_RADIUS = 1e-3  # radius at which curves begin [m]
_MIN_SPAN = 0.5  # smallest upper end of the axis [m]
_MIN_SEEN = 0.03  # share of the range of slips: shorter error bars are drawn enlarged
_MARKERS = "osD^vP*X"
_LINE = "#777777"
_PAPER: dict[str, Any] = {"color": BLACK, "marker": "x", "ms": 7, "mew": 1.6}
_EQ_11: dict[str, Any] = {"color": BLACK, "ls": "--", "lw": 1.2}


def typical_run(logs: Sequence[RunLog], radius: float = 1.5, speed: float = 0.15) -> RunLog:
    """The run commanded nearest to `radius` [m] and `speed` [m/s]; the first if no metadata has the commands."""

    def distance(log: RunLog) -> float:
        r, v = log.metadata.get("radius"), log.metadata.get("speed")
        if not isinstance(r, int | float) or not isinstance(v, int | float):
            return np.inf
        return float(np.hypot(abs(r) / radius - 1, abs(v) / speed - 1))

    return min(logs, key=distance)


@style.styled
def pose_and_velocity(log: RunLog) -> Figure:
    """Fig. 4: pose of one run over time and its smoothed derivatives, in the world frame."""
    motion = paper_motion(log)
    v, w, phi = *motion.twist.T, motion.pose[:, 2]
    lines: list[tuple[Array, dict[str, Any]]] = []  # positions, heading and their derivatives (T, 6), and their look
    if log.truth is not None:
        true, twist = _near(log.truth.pose, log), log.truth.twist
        traces = np.column_stack([true, se2.rotate(true[:, 2], twist[:, :2]), twist[:, 2]])
        lines.append((traces, {"color": BLACK, "lw": 0.8, "label": "truth"}))
    if stored_geometry(log) is not None:
        circle = _near(published_poses(log), log)
        traces = np.column_stack([circle, np.gradient(circle, log.time, axis=0)])
        lines.append((traces, {"color": RED, "lw": 1.4, "ls": "--", "label": "by Eq. 11"}))
    figure, axes = style.subplots(4.8, 2, 2, down=0.4, sharex=True)
    rows, fine, smooth = style.thin(len(log.time), 45), style.thin(len(log.time)), style.thin(len(v), 2 * style.POINTS)
    time, pose = log.time[rows], np.where(log.is_valid[:, None], log.pose, np.nan)[rows]
    marks, curves = {"ls": "none", "ms": 3.6, "mew": 0}, {"lw": 0.8}
    x, y, heading = ((time, column, marks) for column in pose.T)
    dx, dy, rate = ((motion.time[smooth], part[smooth], curves) for part in (v * np.cos(phi), v * np.sin(phi), w))
    for axis, title, label, columns, measured in (
        (axes[0, 0], "Position", "position [m]", [0, 1], {"x": (x, BLUE, "o"), "y": (y, ORANGE, "s")}),
        (axes[1, 0], "Heading", "heading φ [rad]", [2], {"φ": (heading, GREEN, "^")}),
        (axes[0, 1], "Velocity", "velocity [m/s]", [3, 4], {"dx/dt": (dx, BLUE, ""), "dy/dt": (dy, ORANGE, "")}),
        (axes[1, 1], "Yaw rate", "yaw rate [rad/s]", [5], {"dφ/dt": (rate, GREEN, "")}),
    ):
        for name, ((at, values, look), colour, marker) in measured.items():
            axis.plot(at, values, color=colour, marker=marker, label=name, **look)
        handles = axis.get_legend_handles_labels()[0]
        handles += [axis.plot(log.time[fine], traces[fine][:, columns], **look)[0] for traces, look in lines]
        axis.set(ylabel=label, title=title)
        style.legend_beside_title(axis, handles, handlelength=1.5)
    for axis in axes[1]:
        axis.set_xlabel("time [s]")
    return figure


def _near(pose: Array, log: RunLog) -> Array:
    """Poses (T, 3) with the full turns added to their headings that bring them closest to the log's."""
    turns = np.round(np.nanmedian(log.pose[:, 2] - pose[:, 2]) / (2 * np.pi))
    return np.add(pose, [0, 0, 2 * np.pi * turns])


@style.styled
def published_and_simulated(radius: RadiusSummary, runs: InnerOuterSamples) -> Figure:
    """Radius driven against radius commanded, and slip against radius, published and simulated."""
    figure, (driven, slips) = style.subplots(3.7, 1, 2, width_ratios=(1, 1.35))
    most = 1.08 * max(*radius.commanded, *COMMANDED_RADII)
    driven.plot([0, most], [0, most], color=GREY, lw=1.0, label="without slip")
    driven.plot(COMMANDED_RADII, OBSERVED_RADII, ls="none", label="published", **_PAPER)
    driven.plot(radius.commanded, radius.observed, "o", color=style.OUTER, ms=6, label="simulated")
    driven.set(xlabel="radius commanded [m]", ylabel="radius driven [m]", title="Wider than commanded")
    driven.set(xlim=(0, None), ylim=(0, None))
    driven.legend(loc="upper left")
    curve = curve_radii(runs)
    published = slip_at(PUBLISHED, np.array(OBSERVED_RADII), 1.0)
    for track, (name, colour, marker) in enumerate(zip(TRACKS, (style.INNER, style.OUTER), "so", strict=True)):
        slips.plot(curve, slip_at(PUBLISHED, curve, 1.0)[:, track], **_EQ_11)
        slips.plot(OBSERVED_RADII, published[:, track], ls="none", **_PAPER)
        label = f"{name} track, simulated"
        slips.plot(runs.radius, runs.slip[:, track], marker, color=colour, ms=6, mfc="none", label=label)
    slips.plot([], [], ls="--", lw=1.3, label="Eq. 11, published", **_PAPER)
    style.zero_line(slips)
    slips.set(
        ylabel="slip i [–]", title="Because the tracks slip", ylim=style.limits_around(np.append(runs.slip, published))
    )
    show_radii(slips, runs)
    slips.legend(loc="lower right")
    return figure


@style.styled
def slip_against_speed_and_radius(runs: InnerOuterSamples, best: SteadyFit) -> Figure:
    """Fig. 5: slip of the inner (top) and outer track (bottom) against speed (left) and radius (right)."""
    figure, axes = style.subplots(6.0, 2, 2, across=0.4, down=0.4, sharey="row", sharex="col")
    curve = curve_radii(runs)
    by_radius, by_speed = value_groups(runs.radius), value_groups(runs.speed)
    factor = bar_factor(runs)
    published = slip_at(PUBLISHED, np.array(OBSERVED_RADII), 1.0)
    for track, (name, (against_speed, against_radius)) in enumerate(zip(TRACKS, axes, strict=True)):
        slip = runs.slip[:, track]
        for radius, value in zip(OBSERVED_RADII, published[:, track], strict=True):
            against_speed.axhline(value, color=_shade(radius, runs), ls="--", lw=0.8)
        for marker, group in zip(_MARKERS, by_radius, strict=False):
            radii, speeds = runs.radius[group], runs.speed[group]
            colour = _shade(float(radii.mean()), runs)
            against_speed.plot(speeds, slip[group], marker, color=colour, ms=4.5, label=group_label(radii, "m"))
            if is_narrow(radii) and radii.min() > 0:
                line = np.linspace(0.8 * speeds.min(), 1.1 * speeds.max(), 30)
                left = bool(runs.left[group].mean() >= 0.5)
                by_law = slip_at(best.law, np.full(line.size, radii.mean()), line, left=left)
                against_speed.plot(line, by_law[:, track], color=colour, lw=1.0)
        against_radius.plot(curve, slip_at(PUBLISHED, curve, 1.0)[:, track], **_EQ_11)
        for number, (marker, group) in enumerate(zip(_MARKERS, by_speed, strict=False)):
            look: dict[str, Any] = {
                "color": style.shade(style.SPEED_SHADES, number / max(len(by_speed) - 1, 1)),
                "mfc": "none",
            }
            look["ms"] = 9.0 - 1.1 * min(number, 4)  # runs at one radius nearly coincide: draw the first ones larger
            label = group_label(runs.speed[group], "m/s")
            against_radius.plot(runs.radius[group], slip[group], marker, mew=1.1, label=label, **look)
        if runs.errors is not None:
            bars = factor * runs.errors.slip[:, track]
            against_speed.errorbar(runs.speed, slip, bars, factor * runs.errors.speed, **BARS)
            against_radius.errorbar(runs.radius, slip, bars, factor * runs.errors.radius, **BARS)
        against_speed.set(ylabel=f"slip of the {name} track  i [–]", title=f"{name.capitalize()} track, against speed")
        against_radius.set_title(f"{name.capitalize()} track, against radius")
        against_speed.set_ylim(style.limits_around(np.append(with_bars(runs, track, factor), published[:, track])))
    fastest = 1.1 * float(runs.speed.max()) + 0.01
    axes[1, 0].set(xlabel="measured speed v [m/s]", xlim=(-0.03 * fastest, fastest))
    show_radii(axes[1, 1], runs)
    left, right = (axis.get_legend_handles_labels()[0] for axis in axes[0])
    if any(is_narrow(runs.radius[group]) for group in by_radius):
        left.append(style.key("best law", color=_LINE, lw=1.0))
    left.append(style.key("Eq. 11 at the paper's radii", color=_LINE, ls="--", lw=0.9))
    right += [style.key("Eq. 11", **_EQ_11), *bar_key(factor)]
    style.legend_below(figure, left, right, titles=("Left: observed R", "Right: measured v"), columnspacing=1.2)
    return figure


def _shade(radius: float, runs: InnerOuterSamples) -> tuple[float, float, float, float]:
    """A colour for a radius [m], on a logarithmic scale from the smallest to the largest."""
    least, most = float(runs.radius[runs.radius > 0].min(initial=min(OBSERVED_RADII))), float(runs.radius.max())
    share = np.log(max(radius, least) / least) / np.log(max(most, max(OBSERVED_RADII)) / least)
    return style.shade(style.RADII_SHADES, float(share))


def is_wide(runs: InnerOuterSamples) -> bool:
    """True if the radii need a logarithmic axis, which excludes turns on the spot."""
    return bool(0 < float(runs.radius.min()) < float(runs.radius.max()) / _WIDE)


def curve_radii(runs: InnerOuterSamples) -> Array:
    """Radii (m,) [m] for the curves of laws, reaching a little beyond the runs."""
    least = max(0.85 * float(runs.radius.min()), _MIN_RADIUS)
    most = max(1.08 * float(runs.radius.max()), _MIN_SPAN)
    return np.geomspace(least, most, 300) if is_wide(runs) else np.linspace(least, most, 300)


def show_radii(axes: Axes, runs: InnerOuterSamples) -> None:
    """Set scale, limits, ticks and label: linear from zero, or logarithmic where the radii differ much."""
    radius = curve_radii(runs)
    axes.set_xlabel("observed radius R [m]")
    if is_wide(runs):
        axes.set(xscale="log", xlim=(radius[0], radius[-1]))
        style.log_ticks(axes.xaxis)
    else:
        on_the_spot = float(runs.radius.min()) < _MIN_RADIUS
        axes.set_xlim(-0.04 * radius[-1] if on_the_spot else 0.0, radius[-1])


def bar_factor(runs: InnerOuterSamples) -> int:
    """Factor 1, 2, 5, 10, 20, ... that makes the error bars visible; 0 where the errors are not known."""
    if runs.errors is None:
        return 0
    typical = float(np.median(runs.errors.slip))
    needed = _MIN_SEEN * float(np.ptp(runs.slip, axis=0).max()) / max(typical, 1e-300)
    factors = [step * 10**power for power in range(6) for step in (1, 2, 5)]
    return next((factor for factor in factors if factor >= needed), factors[-1])


def with_bars(runs: InnerOuterSamples, track: int, factor: int) -> Array:
    """Slips of a track and the ends of their bars, (n,) or (2 n,) [-], from which the limits of an axis follow."""
    slip = runs.slip[:, track]
    if runs.errors is None:
        return slip
    bar = factor * runs.errors.slip[:, track]
    return np.concatenate([slip - bar, slip + bar])


def bar_key(factor: int) -> list[Line2D]:
    """The legend's entry for the error bars; empty where there are none."""
    label = "bars: standard error" + (f" × {factor}" if factor > 1 else "")
    return [style.key(label, marker="+", ms=8, ls="none", color=BARS["ecolor"])] if factor else []
