"""Figures of the identification: one run's pose, slip against speed and radius, and the laws fitted to it.

Every function returns a new Figure that no window or global state knows of. They resemble Figs. 4-6 of the
paper; the tracking experiments' are in tracking_figures.py.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from experiments.figure_style import BLACK, BLUE, GREEN, ORANGE, POINTS, law_line, styled, thin
from trackslip.identification import FittedLaw, SlipSamples
from trackslip.kinematics import Array
from trackslip.motion import butterworth_motion
from trackslip.published import OBSERVED_RADII
from trackslip.runlog import RunLog
from trackslip.slip import PUBLISHED, SlipLaw

_MARKERS = "osD^vP*X"
_STRAIGHT = 20.0  # radius from which a run counts as straight [m]
_MOST_GROUPS = 8
_GROUP_GAP = 0.08  # relative gap between neighbouring values that starts another group


@dataclass(frozen=True)
class RoleSamples:
    """Steady slip by a track's role in the turn, without runs straight or on the spot, which have none."""

    speed: Array  # (n,) [m/s], >= 0
    radius: Array  # (n,) of the observed path [m], > 0
    inner: Array  # (n,) slip [-]
    outer: Array  # (n,) slip [-]

    @classmethod
    def of(cls, samples: SlipSamples) -> RoleSamples:
        """The left track is the inner one where the curvature is positive, the right one elsewhere."""
        radius = np.abs(samples.radius)
        turning = (radius > 0) & (radius < _STRAIGHT)
        slip, left_turn = samples.slip[turning], samples.curvature[turning] > 0
        return cls(
            speed=np.abs(samples.twist[turning, 0]),
            radius=radius[turning],
            inner=np.where(left_turn, slip[:, 0], slip[:, 1]),
            outer=np.where(left_turn, slip[:, 1], slip[:, 0]),
        )


def alike(values: Array) -> list[np.ndarray]:
    """Indices of `values` (n,) > 0 in groups of about the same value, ascending.

    A grid of commanded values leaves clear gaps between its groups, so no log has to say what was commanded.
    Values that are scattered, or of many groups, come as one group.
    """
    order = np.argsort(values, kind="stable")
    if not order.size:
        return []
    ranked = values[order]
    starts = np.flatnonzero(np.diff(ranked) > _GROUP_GAP * ranked[1:]) + 1
    groups = np.split(order, starts)
    gridded = len(groups) <= _MOST_GROUPS and all(_narrow(values[group]) for group in groups)
    return groups if gridded else [order]


def _narrow(values: Array) -> bool:
    """Whether values (n,) > 0 are about the same."""
    return bool(np.ptp(values) <= 2 * _GROUP_GAP * values.max())


def roles(law: SlipLaw, radius: Array) -> tuple[Array, Array]:
    """Inner and outer slip (n,) of `law` at radii (n,) [m] > 0."""
    inner, outer = law(1 / radius).T  # a left turn
    return inner, outer


def typical_run(logs: Sequence[RunLog], radius: float = 1.5, speed: float = 0.15) -> RunLog:
    """The run commanded nearest `radius` [m] and `speed` [m/s]; the first if no metadata says what was."""

    def distance(log: RunLog) -> float:
        r, v = log.metadata.get("radius"), log.metadata.get("speed")
        if not isinstance(r, int | float) or not isinstance(v, int | float):
            return np.inf
        return float(np.hypot(abs(r) / radius - 1, abs(v) / speed - 1))

    return min(logs, key=distance)


@styled
def pose_and_velocity(log: RunLog) -> Figure:
    """Fig. 4: pose of one run over time, and its derivatives after smoothing, in the frame of the field."""
    motion = butterworth_motion(log)
    v, w = motion.twist.T
    phi = motion.pose[:, 2]
    figure = Figure(figsize=(9.0, 4.8), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True)
    position, velocity, heading, turning = axes.ravel()
    rows = thin(len(log.time), 45)
    pose = np.where(log.is_valid[:, None], log.pose, np.nan)
    for axis, column, colour, marker, name in (
        (position, 0, BLUE, "o", "x"),
        (position, 1, ORANGE, "s", "y"),
        (heading, 2, GREEN, "^", "φ"),
    ):
        axis.plot(log.time[rows], pose[rows, column], marker, ms=3.6, mew=0, color=colour, label=name)
    for axis, values, colour, name in (
        (velocity, v * np.cos(phi), BLUE, "dx/dt"),
        (velocity, v * np.sin(phi), ORANGE, "dy/dt"),
        (turning, w, GREEN, "dφ/dt"),
    ):
        fine = thin(len(values), 2 * POINTS)
        axis.plot(motion.time[fine], values[fine], color=colour, lw=0.8, label=name)
    if log.truth is not None:
        truth = _true_traces(log)
        fine = thin(len(log.time))
        for axis, columns in ((position, (0, 1)), (heading, (2,)), (velocity, (3, 4)), (turning, (5,))):
            axis.plot(log.time[fine], truth[fine][:, columns], color=BLACK, lw=0.8)
    for axis, label, title in (
        (position, "position [m]", "Position"),
        (velocity, "velocity [m/s]", "Velocity"),
        (heading, "heading φ [rad]", "Heading"),
        (turning, "yaw rate [rad/s]", "Yaw rate"),
    ):
        handles = axis.get_legend_handles_labels()[0]
        if log.truth is not None:
            handles.append(Line2D([], [], color=BLACK, lw=0.8, label="truth"))
        axis.set(ylabel=label, title=title)
        # beside the title, since a turning robot's traces visit every corner of the axes
        axis.legend(handles=handles, ncols=3, loc="lower right", bbox_to_anchor=(1, 0.98), borderaxespad=0)
    for axis in axes[1]:
        axis.set_xlabel("time [s]")
    return figure


def _true_traces(log: RunLog) -> Array:
    """(T, 6): true pose and its derivatives in the frame of the field."""
    assert log.truth is not None
    pose = log.truth.pose.copy()
    pose[:, 2] += 2 * np.pi * np.round(np.nanmedian(log.pose[:, 2] - pose[:, 2]) / (2 * np.pi))
    forward, left, w = log.truth.twist.T
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return np.column_stack([pose, forward * cos - left * sin, forward * sin + left * cos, w])


@styled
def slip_against_speed_and_radius(samples: SlipSamples) -> Figure:
    """Fig. 5: slip of the inner (top) and outer track (bottom) against speed (left) and radius (right)."""
    s = RoleSamples.of(samples)
    shade = matplotlib.colormaps["viridis"]
    figure = Figure(figsize=(9.0, 6.4), layout="constrained")
    axes = figure.subplots(2, 2, sharey="row", sharex="col")
    top = max(float(s.radius.max(initial=0.0)), 3.5) * 1.04
    low = min(float(s.radius.min(initial=np.inf)), min(OBSERVED_RADII)) * 0.85
    curve = np.linspace(low, top, 200)
    by_radius, by_speed = alike(s.radius), alike(s.speed)
    for row, (name, slip) in enumerate((("inner", s.inner), ("outer", s.outer))):
        against_speed, against_radius = axes[row]
        at_observed = roles(PUBLISHED, np.array(OBSERVED_RADII))[row]
        for radius, value in zip(OBSERVED_RADII, at_observed, strict=True):
            against_speed.axhline(value, color=shade(radius / top * 0.9), ls="--", lw=0.9, alpha=0.6)
        for marker, group in zip(_MARKERS, by_radius, strict=False):
            order = group[np.argsort(s.speed[group])]
            colour = shade(float(s.radius[group].mean()) / top * 0.9)
            against_speed.plot(
                s.speed[order],
                slip[order],
                marker,
                color=colour,
                ms=4.5,
                ls="-" if _narrow(s.radius[group]) else "none",
                lw=1.2,
                label=_span(s.radius[group], "m"),
            )
        against_radius.plot(curve, roles(PUBLISHED, curve)[row], color=BLACK, ls="--", lw=1.2)
        for number, (marker, group) in enumerate(zip(_MARKERS, by_speed, strict=False)):
            colour = matplotlib.colormaps["plasma"](0.85 * number / max(len(by_speed) - 1, 1))
            size = 9.0 - 1.1 * min(number, 4)  # runs at one radius nearly coincide: the first look out around
            against_radius.plot(
                s.radius[group],
                slip[group],
                marker,
                color=colour,
                ms=size,
                mfc="none",
                mew=1.1,
                label=_span(s.speed[group], "m/s"),
            )
        against_speed.set(ylabel=f"slip of the {name} track  i [–]", title=f"{name.capitalize()} track, against speed")
        against_radius.set_title(f"{name.capitalize()} track, against radius")
    axes[1, 0].set(xlabel="measured speed v [m/s]", xlim=(0, None))
    axes[1, 1].set(xlabel="observed radius R [m]", xlim=(0, None))
    dashed = Line2D([], [], color="#777777", ls="--", lw=0.9, label="Eq. 11 at the paper's five radii")
    curve_line = Line2D([], [], color=BLACK, ls="--", lw=1.2, label="Eq. 11")
    _legend_below(figure, axes[0, 0], dashed, "Left: observed R", "left")
    _legend_below(figure, axes[0, 1], curve_line, "Right: measured v", "right")
    return figure


def _legend_below(figure: Figure, axis: Axes, last: Line2D, title: str, where: Literal["left", "right"]) -> None:
    """A legend of `axis` and the line `last`, under one half of the figure."""
    handles = [*axis.get_legend_handles_labels()[0], last]
    figure.legend(
        handles=handles,
        title=title,
        ncols=3 if where == "left" else 4,
        loc="outside lower left" if where == "left" else "outside lower right",
        columnspacing=1.2,
        alignment="left",
    )


def _span(values: Array, unit: str) -> str:
    """The mean of values that are about the same, else their range, with the unit."""
    if _narrow(values):
        return f"{values.mean():.2f} {unit}"
    return f"{values.min():.2f}–{values.max():.2f} {unit}"


@styled
def fitted_laws(samples: SlipSamples, laws: Mapping[str, FittedLaw]) -> Figure:
    """Fig. 6: slip against observed radius with the fitted and the published laws; below, the residuals."""
    s = RoleSamples.of(samples)
    figure = Figure(figsize=(9.0, 6.2), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, height_ratios=(2.2, 1))
    axes[1, 1].sharey(axes[1, 0])
    groups = alike(s.radius)
    top, low = float(s.radius.max(initial=1.0)), float(s.radius.min(initial=0.5))
    curve = np.linspace(0.9 * low, 1.05 * top, 300)
    shown: dict[str, SlipLaw] = {"published": PUBLISHED, **{name: fit.law for name, fit in laws.items()}}
    for column, (name, slip) in enumerate((("outer", s.outer), ("inner", s.inner))):
        upper, lower = axes[:, column]
        role = 1 - column  # of roles(): inner, outer
        upper.plot(s.radius, slip, "o", color="#777777", ms=3, mew=0, label="runs", zorder=6)
        centre = np.array([[s.radius[g].mean(), slip[g].mean()] for g in groups if len(groups) > 1])
        if centre.size:
            upper.plot(*centre.T, "D", color=BLACK, ms=8, mfc="none", mew=1, label="mean of a radius", zorder=5)
        for key, law in shown.items():
            formula = _published_formula(role) if key == "published" else _formula(laws[key], role)
            upper.plot(curve, roles(law, curve)[role], **law_line(key, label=formula))
            rest = slip - roles(law, s.radius)[role]
            style = law_line(key, lw=0.9, marker="o", ms=2.5)
            middle = np.array([[s.radius[g].mean(), rest[g].mean()] for g in groups if len(groups) > 1])
            if middle.size:
                lower.plot(*middle.T, **style)
            else:
                lower.plot(s.radius, rest, **{**style, "linestyle": "none"})
        low_slip, high_slip = min(0.0, float(slip.min(initial=0.0))), max(0.0, float(slip.max(initial=0.0)))
        room = 0.05 * (high_slip - low_slip) + 1e-4  # a law's pole may go beyond
        upper.set_ylim(1.2 * low_slip - room, 1.2 * high_slip + room)
        upper.axhline(0, color="#888888", lw=0.8)
        lower.axhline(0, color="#888888", lw=0.8)
        upper.set_title(f"{name.capitalize()} track")
        upper.legend(loc="upper right" if name == "outer" else "lower right")
        lower.set_xlabel("observed radius R [m]")
    axes[0, 0].set_ylabel("slip i [–]")
    axes[1, 0].set(ylabel="measured − law [–]", title="Residual")
    return figure


def _published_formula(role: int) -> str:
    alpha, beta = (
        (PUBLISHED.alpha_inner, PUBLISHED.beta_inner),
        (PUBLISHED.alpha_outer, PUBLISHED.beta_outer),
    )[role]
    return f"Eq. 11: {_exponential(alpha, beta)}"


def _formula(fit: FittedLaw, role: int) -> str:
    """A fitted law of the inner (role 0) or outer track (1) in one line."""
    side = ("inner", "outer")[role]
    values = fit.values
    if fit.name == "exponential":
        return f"fitted: {_exponential(values[f'alpha_{side}'], values[f'beta_{side}'])}"
    if "offset" not in values:
        return fit.name
    offset = f"D = {values['offset'] * 1e3:.1f} mm"
    if "radius_error" in values:
        return f"ICR with ε: {offset}, ε = {values['radius_error']:+.2%}".replace("-", "−").replace("%", " %")
    return ("ICR: −D/(R−b−D), " if side == "inner" else "ICR: D/(R+b+D), ") + offset


def _exponential(alpha: float, beta: float) -> str:
    return f"{alpha:.3f} exp({beta:.2f} R)".replace("-", "−")
