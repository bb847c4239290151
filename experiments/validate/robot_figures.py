"""Figures of a robot on Coulomb ground: turns, contact loads, slopes, physics step and solver, energy."""

import itertools
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

from experiments.common.colours import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from experiments.common.style import (
    DEFAULT,
    RECIPE,
    SPEED_SHADES,
    THEORY,
    Panels,
    key,
    log_ticks,
    make_room,
    panel,
    shade,
    styled,
    thin,
    zero_line,
)
from experiments.validate.numerics import REFERENCE_STEP, Convergence, Energy
from experiments.validate.standing import HEADINGS, REFERENCE_ANGLE, SLIDING_HEADINGS, Creep, Loads, Slide
from experiments.validate.turning import VariedTurns
from sim.ground.ground import Ground, friction_angle
from sim.robot.parameters import RobotParameters
from sim.robot.robot import CONTACT_POINTS
from trackslip.kinematics import Array

_DASHES: tuple[Any, ...] = ("-", "--", "-.", (0, (1, 1)))
_MARKERS = "os^Dv"
_COLOURS = (BLUE, ORANGE, GREEN, RED, "#CC79A7")
_LOOKS = ((BLUE, "o", "-"), (ORANGE, "s", "--"), (GREEN, "^", "-."))
_NAMES = {0.0: "straight uphill", np.pi / 4: "oblique", np.pi / 2: "across the slope"}


@styled
def icr_and_slip(turns: VariedTurns, naive: VariedTurns, parameters: RobotParameters) -> Panels:
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
    axes.set(xscale="log", xlim=(3e-3, None), ylim=(0, 101))
    axes.xaxis.set_major_formatter("{x:g}")
    handles = [key(f"{ratio:.3g}", color="#555555", ls=dash) for ratio, dash in dashes.items()]
    axes.legend(handles=handles, title="friction\nacross / along", loc="center", bbox_to_anchor=(0.62, 0.3))
    return shares, _one_to_one(turns, naive, turns.own(parameters))


def _one_to_one(turns: VariedTurns, naive: VariedTurns, rows: np.ndarray) -> Figure:
    figure, axes = panel("Slip of both tracks", "slip by theory [–]", "slip, simulated [–]")
    for found, style, name in ((naive, DEFAULT, "default"), (turns, RECIPE, "recipe")):
        for track, side in ((1, "outer"), (0, "inner")):
            face = style["color"] if side == "outer" else "none"
            look = style | {"ls": "none", "ms": 4.5, "mew": 0.9, "mfc": face, "label": f"{name}, {side} track"}
            axes.plot(turns.expected_slip[rows, track], found.slip[rows, track], **look)
    ends = [np.nanmin(turns.expected_slip[rows]), np.nanmax(turns.expected_slip[rows])]
    axes.plot(ends, ends, **THEORY, zorder=5, label="theory")
    axes.legend(loc="lower right")
    return figure


@styled
def what_is_left(turns: VariedTurns, parameters: RobotParameters) -> Panels:
    """Errors of the recipe: of the ICRs, against yaw rate; and of the lateral speed."""
    rows = turns.own(parameters)
    v, w = turns.expected_twist(parameters).T
    by_rate, axes = panel("Half width, against yaw rate", "yaw rate [rad/s]", "error of b + D [%]")
    _by_ratio(axes, turns, rows, w, 100 * turns.icr_error)
    lateral, axes = panel("Lateral speed", "centripetal acceleration v w [m/s²]", "error of the lateral speed [mm/s]")
    _by_ratio(axes, turns, rows, v * w, 1e3 * (turns.lateral - turns.expected_lateral))
    return by_rate, lateral


def _by_ratio(axes: Axes, turns: VariedTurns, rows: np.ndarray, x: Array, y: Array) -> None:
    for ratio, marker, colour in zip(np.unique(turns.ratio), itertools.cycle(_MARKERS), itertools.cycle(_COLOURS)):
        chosen = rows & (turns.ratio == ratio)
        axes.plot(x[chosen], y[chosen], marker, color=colour, ms=4.5, mfc="none", mew=1.1, label=f"{ratio:.3g}")
    zero_line(axes)
    axes.set_xlim(left=0)
    axes.legend(title="friction across / along", ncols=2)


@styled
def slip_against_radius(turns: VariedTurns, naive: VariedTurns, parameters: RobotParameters, ground: Ground) -> Panels:
    """Slip against commanded radius by speed, with the recipe and with the default contact."""
    rows = turns.own(parameters) & (turns.ratio == turns.nearest_ratio(ground))
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
        zero_line(axes)
        axes.set(ylim=(low - room, high + room), xlim=(0, None))
        axes.legend(loc="lower right", ncols=2)
        panels.append(figure)
    return tuple(panels)


def _theory_line(axes: Axes, turns: VariedTurns, rows: np.ndarray) -> None:
    """Draw slip by theory at the slowest speed, interpolated over curvature, where it is nearly straight."""
    slowest = rows & (turns.speed == turns.speed.min())
    for track, label in ((1, "theory"), (0, None)):
        chosen = np.flatnonzero(slowest & np.isfinite(turns.expected_slip[:, track]))
        chosen = chosen[np.argsort(1 / turns.radius[chosen])]
        knots = 1 / turns.radius[chosen]
        curvature = np.linspace(knots[0], knots[-1], 200)
        slip = CubicSpline(knots, turns.expected_slip[chosen, track])(curvature)
        axes.plot(1 / curvature, slip, **THEORY, label=label, zorder=1.5)


@styled
def pad_loads(loads: Loads, naive: Loads) -> Panels:
    """Load along the track: of the pads with both contacts, and of every point with the recipe alone."""
    both, axes = panel("Pads, both contacts", "along the track, forwards [mm]", "load / mean load [–]")
    # a sensor does not tell which of a pad's points has lifted, so show the mean of each pad
    x, y = _of_pads(loads.position.T)
    sides = [side[np.argsort(x[side])] for side in (np.flatnonzero(y > 0), np.flatnonzero(y < 0))]
    place = 1e3 * x[sides].mean(axis=0)
    for found, style, name, shift in ((naive, DEFAULT, "default", -3.0), (loads, RECIPE, "recipe", 3.0)):
        load = _of_pads(found.load)[:, sides].reshape(-1, len(place))
        _reach(axes, place + shift, load, style["color"], style["marker"], name)
    axes.set_ylim(bottom=0)
    axes.legend(loc="upper center", ncols=2)
    make_room(axes)
    large, axes = panel("Points, recipe alone, enlarged", "along the track, forwards [mm]", "load / mean load [–]")
    for side, shift, (colour, marker, _) in zip(("left", "right"), (-2.0, 2.0), _LOOKS, strict=False):
        chosen = (loads.position[:, 1] > 0) == (side == "left")
        _reach(axes, 1e3 * loads.position[chosen, 0] + shift, loads.load[:, chosen], colour, marker, f"{side} track")
    axes.axhline(1, **THEORY, zorder=1)
    axes.legend(loc="upper center", ncols=2)
    make_room(axes)
    return both, large


def _of_pads(points: Array) -> Array:
    """Means (..., P) of values (..., K) over the points of each pad."""
    return points.reshape(*points.shape[:-1], -1, CONTACT_POINTS).mean(axis=-1)


def _reach(axes: Axes, x: Array, load: Array, colour: str, marker: str, name: str) -> None:
    """Draw medians of loads (M, P) at places (P,); thick lines span the middle half, thin ones the whole range."""
    least, lower, middle, upper, greatest = np.quantile(load, [0.0, 0.25, 0.5, 0.75, 1.0], axis=0)
    axes.vlines(x, lower, upper, color=colour, lw=5.0)
    reach = [middle - least, greatest - middle]
    axes.errorbar(x, middle, reach, fmt=marker, color=colour, ms=5.5, mec="white", lw=1.0, capsize=2.0, label=name)


@styled
def slopes(creep: Creep, slide: Slide, ground: Ground) -> Panels:
    """Creep on slopes that hold the robot, and acceleration on those that do not."""
    held, axes = panel("Parked: creep", "slope [°]", "creep [mm/s]")
    parked = zip(HEADINGS, creep.angle, creep.speed, itertools.cycle(_LOOKS), strict=False)
    for heading, angle, speed, (colour, marker, dash) in parked:
        angle, first = np.unique(np.degrees(angle), return_index=True)
        style: dict[str, Any] = {"color": colour, "marker": marker, "ls": dash, "ms": 4.5}
        axes.plot(angle, 1e3 * speed[first], label=_name(heading), **style)
        axes.axvline(np.degrees(friction_angle((ground.along, ground.across), heading)), color=colour, ls=dash, lw=0.9)
    axes.axvline(np.degrees(REFERENCE_ANGLE), color=GREY, lw=3.0, zorder=0)
    axes.set(yscale="log", xlim=(0, None))
    log_ticks(axes.yaxis)
    axes.legend(loc="lower right", bbox_to_anchor=(0.85, 0))
    let_go, axes = panel("Sliding: acceleration", "slope [°]", "acceleration downhill [m/s²]")
    for heading, angle, measured, expected, (colour, marker, dash) in zip(
        SLIDING_HEADINGS, slide.angle, slide.acceleration, slide.expected, _LOOKS[::2], strict=True
    ):
        limit = friction_angle((ground.along, ground.across), heading)
        name = downhill(heading)
        coulomb: dict[str, Any] = {"color": colour, "ls": dash, "lw": 1.2, "label": f"{name}, Coulomb"}
        axes.plot(np.degrees([limit, *angle]), [0.0, *expected], **coulomb)
        simulated: dict[str, Any] = {"color": colour, "marker": marker, "ls": "none", "label": f"{name}, simulated"}
        axes.plot(np.degrees(angle), measured, ms=5.5, mfc="none", mew=1.2, **simulated)
    axes.legend(loc="upper left")
    axes.set_ylim(bottom=0)
    return held, let_go


def downhill(heading: float) -> str:
    """How a robot with a heading slides [rad]."""
    return "straight downhill" if heading == 0 else _name(heading)


def _name(heading: float) -> str:
    return _NAMES.get(heading, f"{np.degrees(heading):.0f}°")


@styled
def steps_and_solvers(found: Convergence, own_step: float) -> Figure:
    """Position error against the physics step, and the distance between the solvers."""
    figure, axes = panel("Error after the random commands", "physics step [ms]", "distance, largest of all robots [mm]")
    step, error = np.array(list(found.step_error.items())).T
    reference = REFERENCE_STEP
    rate = float(np.median(error / (step - reference)))
    curve = np.geomspace(step.min(), step.max(), 100)
    axes.plot(1e3 * curve, 1e3 * rate * (curve - reference), **THEORY, ls="--",
              label=f"slope 1, less that of the\nreference step of {1e3 * reference:g} ms")  # fmt: skip
    axes.plot(1e3 * step, 1e3 * error, "o", color=BLUE, ms=6, label="CG, other steps")
    if own_step in found.step_error:
        axes.plot(1e3 * own_step, 1e3 * found.step_error[own_step], "o", color=BLUE, ms=12, mfc="none", mew=1.2,
                  label="the model's own step")  # fmt: skip
    axes.axhline(1e3 * found.solver_difference, color=RED, ls="-.", label="CG from Newton,\nat the model's own step")
    axes.set(xscale="log", yscale="log")
    axes.set_xticks(1e3 * step, [f"{1e3 * s:g}" for s in step])
    axes.set_xticks([], minor=True)
    log_ticks(axes.yaxis)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.1))
    return figure


@styled
def energies(found: Energy) -> Panels:
    """Work of the belts and friction loss since the start; and their small difference, enlarged."""
    rows = thin(len(found.time))
    time = found.time[rows]
    whole, axes = panel("Since the start", "time [s]", "energy [J]")
    axes.plot(time, found.traction[rows], color=BLUE, lw=4.0, alpha=0.75, label="work of the belts")
    axes.plot(time, found.friction[rows], color=BLACK, lw=1.1, ls="--", label="friction loss")
    axes.plot(time, found.kinetic[rows], color=GREEN, lw=1.3, label="kinetic and potential")
    axes.legend(loc="upper left")
    left, axes = panel("The difference, enlarged", "time [s]", "energy [J]")
    difference = found.traction - found.friction - found.damping
    axes.plot(time, difference[rows], color=BLUE, lw=4.0, alpha=0.75, label="work − all losses")
    axes.plot(time, found.kinetic[rows], color=GREEN, lw=1.3, ls="--", label="kinetic and potential")
    axes.plot(time, (difference - found.kinetic)[rows], color=RED, ls="-.", lw=1.3, label="not accounted for")
    zero_line(axes)
    make_room(axes, 0.3)
    axes.legend(loc="upper left")
    return whole, left
