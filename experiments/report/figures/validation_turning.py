"""Figures of the turns: errors of ICRs and slips against theory, and what the remaining errors depend on."""

import itertools
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.interpolate import CubicSpline

from experiments.report.colours import BLUE, GREEN, ORANGE, RED
from experiments.report.figures.style import (
    DEFAULT,
    RECIPE,
    SPEED_SHADES,
    THEORY,
    Panels,
    make_room,
    panel,
    shade,
    styled,
)
from experiments.validation.turning import Turns
from sim.drive.drive import Drive
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from trackslip.kinematics import Array, RobotGeometry, limit_sprocket_speeds, sprocket_speeds

_DASHES: tuple[Any, ...] = ("-", "--", "-.", (0, (1, 1)))
_MARKERS = "os^Dv"
_COLOURS = (BLUE, ORANGE, GREEN, RED, "#CC79A7")


def own(turns: Turns, parameters: RobotParameters) -> np.ndarray:
    """Whether a turn is one of the robot itself, not of a variant in length or centre of mass, (M,) bool."""
    off = turns.centre_of_mass - [parameters.com_x, parameters.com_y]
    distance = np.hypot(np.hypot(*off.T), turns.length - parameters.contact_length)
    return distance <= distance.min() + 1e-9


def nearest_ratio(turns: Turns, ground: Ground) -> float:
    """The friction ratio nearest to a ground's [-]."""
    ratios = np.unique(turns.ratio)
    return float(ratios[np.argmin(np.abs(ratios - ground.across / ground.along))])


def expected_twist(turns: Turns, parameters: RobotParameters) -> Array:
    """Forward speed [m/s] and yaw rate [rad/s] by theory, (M, 2)."""
    # from the ICRs and the outer track's slip, because an inner track that stands still has no slip
    b, radius = parameters.half_gauge, parameters.sprocket_radius
    commanded = np.stack([turns.speed, turns.speed / turns.radius], axis=-1)
    nominal = sprocket_speeds(commanded, 0.0, RobotGeometry(b, radius))
    surface = radius * limit_sprocket_speeds(nominal, Drive().top_speed / radius)
    spread = (1 + parameters.radius_error) * (surface[:, 1] - surface[:, 0])
    yaw_rate = spread / (2 * turns.expected_half_width)
    return np.stack([surface[:, 1] * (1 - turns.expected_slip[:, 1]) - b * yaw_rate, yaw_rate], axis=-1)


@styled
def icr_and_slip(turns: Turns, naive: Turns, parameters: RobotParameters) -> Panels:
    """Distribution of the ICRs' errors over the turns; and simulated slip against theoretical slip."""
    dashes = dict(zip(np.unique(turns.ratio), itertools.cycle(_DASHES), strict=False))
    shares, axes = panel("Error of the ICRs' half width b + D", "size of the error [%]", "turns with less error [%]")
    for found, style, name in ((turns, RECIPE, "recipe"), (naive, DEFAULT, "default\ncontact")):
        for ratio, dash in dashes.items():
            error = np.sort(100 * np.abs(found.icr_error[found.ratio == ratio]))
            share = 100 * np.arange(1, len(error) + 1) / len(error)
            axes.plot(error, share, color=style["color"], ls=dash, lw=1.3)
        left = 100 * float(np.quantile(np.abs(found.icr_error), 0.25))
        axes.text(0.6 * left, 55, name, color=style["color"], weight="bold", ha="right", va="center")
    axes.set(xscale="log", xlim=(1e-2, None), ylim=(0, 101))
    axes.xaxis.set_major_formatter("{x:g}")
    handles = [Line2D([], [], color="#555555", ls=dash, label=f"{ratio:.3g}") for ratio, dash in dashes.items()]
    axes.legend(handles=handles, title="friction\nacross / along", loc="center", bbox_to_anchor=(0.62, 0.3))
    return shares, _one_to_one(turns, naive, own(turns, parameters))


def _one_to_one(turns: Turns, naive: Turns, rows: np.ndarray) -> Figure:
    figure, axes = panel("Slip of both tracks", "slip by theory [–]", "slip, simulated [–]")
    for found, style, name in ((naive, DEFAULT, "default"), (turns, RECIPE, "recipe")):
        for track, side in ((1, "outer"), (0, "inner")):
            face = style["color"] if side == "outer" else "none"
            look = style | {"ls": "none", "ms": 4.5, "mew": 0.9, "mfc": face, "label": f"{name}, {side} track"}
            axes.plot(turns.expected_slip[rows, track], found.slip[rows, track], **look)
    ends = [np.nanmin(turns.expected_slip[rows]), np.nanmax(turns.expected_slip[rows])]
    axes.plot(ends, ends, **THEORY, zorder=5, label="theory")
    axes.axhline(0, color="#888888", lw=0.7, zorder=1)
    axes.axvline(0, color="#888888", lw=0.7, zorder=1)
    axes.legend(loc="lower right")
    return figure


@styled
def what_is_left(turns: Turns, parameters: RobotParameters) -> Panels:
    """Errors of the recipe: of the ICRs, against yaw rate and by the robot's shape; and of the lateral speed."""
    rows = own(turns, parameters)
    v, w = expected_twist(turns, parameters).T
    by_rate, axes = panel("Half width, against yaw rate", "yaw rate [rad/s]", "error of b + D [%]")
    _by_ratio(axes, turns, rows, w, 100 * turns.icr_error)
    lateral, axes = panel("Lateral speed", "centripetal acceleration v w [m/s²]", "error of the lateral speed [mm/s]")
    _by_ratio(axes, turns, rows, v * w, 1e3 * (turns.lateral - turns.expected_lateral))
    return by_rate, _by_shape(turns, parameters), lateral


def _by_ratio(axes: Axes, turns: Turns, rows: np.ndarray, x: Array, y: Array) -> None:
    for ratio, marker, colour in zip(np.unique(turns.ratio), itertools.cycle(_MARKERS), itertools.cycle(_COLOURS)):
        chosen = rows & (turns.ratio == ratio)
        axes.plot(x[chosen], y[chosen], marker, color=colour, ms=4.5, mfc="none", mew=1.1, label=f"{ratio:.3g}")
    axes.axhline(0, color="#888888", lw=0.8, zorder=1)
    axes.set_xlim(left=0)
    axes.legend(title="friction across / along", ncols=2)


def _by_shape(turns: Turns, parameters: RobotParameters) -> Figure:
    """Smallest, median and largest error for each centre of mass and contact length."""
    figure, axes = panel("Half width, by shape of the robot", "centre of mass", "error of b + D [%]", bottom=0.65)
    shift = turns.centre_of_mass - [parameters.com_x, parameters.com_y]
    place = np.round(100 * shift / np.column_stack([turns.length, np.full(len(shift), parameters.half_gauge)]))
    places = sorted(np.unique(place, axis=0), key=lambda p: np.abs(p).tolist()[::-1])
    lengths = np.unique(turns.length)
    looks = zip(lengths, itertools.cycle(_MARKERS), itertools.cycle(_COLOURS), strict=False)
    for k, (length, marker, colour) in enumerate(looks):
        errors = [100 * turns.icr_error[(turns.length == length) & (place == p).all(axis=1)] for p in places]
        x = np.arange(len(places)) + 0.2 * (k - (len(lengths) - 1) / 2)
        middle = np.array([np.median(e) for e in errors])
        reach = [middle - [e.min() for e in errors], [e.max() for e in errors] - middle]
        label = f"{1e3 * length:.0f} mm"
        axes.errorbar(x, middle, reach, fmt=marker, color=colour, ms=4.5, lw=1.1, capsize=2.5, label=label)
    axes.axhline(0, color="#888888", lw=0.8, zorder=1)
    axes.set_xticks(np.arange(len(places)), [_place(*p) for p in places])
    axes.grid(visible=False, axis="x")
    axes.legend(title="length of contact", ncols=len(lengths), loc="upper left")
    make_room(axes, 0.2)
    return figure


def _place(forwards: float, left: float) -> str:
    parts = [(forwards, "forward" if forwards > 0 else "back"), (left, "left" if left > 0 else "right")]
    return ",\n".join(f"{abs(shift):.0f} % {way}" for shift, way in parts if shift) or "the robot's\nown"


@styled
def slip_against_radius(turns: Turns, naive: Turns, parameters: RobotParameters, ground: Ground) -> Panels:
    """Slip against commanded radius by speed, with the recipe and with the default contact."""
    rows = own(turns, parameters) & (turns.ratio == nearest_ratio(turns, ground))
    both = [found.slip[rows] for found in (turns, naive)]
    low, high = np.nanmin(both), np.nanmax(both)
    room = 0.06 * (high - low)
    panels = []
    for found, name in ((turns, "Recipe"), (naive, "MuJoCo's default contact")):
        figure, axes = panel(name, "radius commanded [m]", "slip [–]")
        _theory_line(axes, turns, rows)
        speeds = np.unique(turns.speed)
        for k, (speed, marker) in enumerate(zip(speeds, itertools.cycle(_MARKERS), strict=False)):
            colour = shade(SPEED_SHADES, k / max(len(speeds) - 1, 1))
            chosen = rows & (turns.speed == speed)
            for track in (0, 1):
                # the first ones are hidden, so they are larger
                look: dict[str, Any] = {"color": colour, "ms": 9.0 - 1.1 * k, "mfc": "none", "mew": 1.1, "lw": 0.9}
                look |= {"ls": ":" if found is naive else "none", "label": f"{speed:g} m/s" if track else None}
                axes.plot(turns.radius[chosen], found.slip[chosen, track], marker, **look)
        axes.axhline(0, color="#888888", lw=0.8, zorder=1)
        axes.set(ylim=(low - room, high + room), xlim=(0, None))
        axes.legend(loc="lower right", ncols=2)
        panels.append(figure)
    return tuple(panels)


def _theory_line(axes: Axes, turns: Turns, rows: np.ndarray) -> None:
    """Draw slip by theory at the slowest speed, interpolated over curvature, where it is nearly straight."""
    slowest = rows & (turns.speed == turns.speed.min())
    for track, label in ((1, "theory"), (0, None)):
        chosen = np.flatnonzero(slowest & np.isfinite(turns.expected_slip[:, track]))
        chosen = chosen[np.argsort(1 / turns.radius[chosen])]
        knots = 1 / turns.radius[chosen]
        curvature = np.linspace(knots[0], knots[-1], 200)
        slip = CubicSpline(knots, turns.expected_slip[chosen, track])(curvature)
        axes.plot(1 / curvature, slip, **THEORY, label=label, zorder=1.5)
