"""The page of a validation: headline numbers, and figures of how far the simulator is from theory."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from experiments.report.figures import validation as figures
from experiments.report.figures import validation_turning as turning_figures
from experiments.report.figures.validation_turning import expected_twist, nearest_ratio, own
from experiments.report.page import MISSING, Drawing, Page, file_name, render_page
from experiments.validation import convergence, energy
from experiments.validation.results import Validation
from experiments.validation.standing import ANGLES, REFERENCE_ANGLE
from experiments.validation.turning import WATCH, Turns
from sim.drive.drive import Drive
from sim.robot.parameters import SINK
from sim.robot.robot import load_robot
from trackslip.kinematics import Array


@dataclass(frozen=True)
class Row:
    """A row of the table of headline numbers, as printed."""

    quantity: str
    theory: str
    recipe: str
    default: str = MISSING


def render(found: Validation, summary: Mapping[str, Any], manifest: Mapping[str, Any], command: str) -> Page:
    """The page and its figures, a file for each panel."""
    own_step = float(load_robot(parameters=found.parameters).model.opt.timestep)
    panels = {
        "turns": turning_figures.icr_and_slip(found.turns, found.naive_turns, found.parameters),
        "left": turning_figures.what_is_left(found.turns, found.parameters),
        "slip": turning_figures.slip_against_radius(found.turns, found.naive_turns, found.parameters, found.ground),
        "loads": figures.pad_loads(found.loads, found.naive_loads),
        "slopes": figures.slopes(found.creep, found.slide, found.ground),
        "steps": figures.steps_and_solvers(found.convergence, own_step),
        "energy": figures.energies(found.energy),
    }
    drawn = {name: [_drawing(name, panel) for panel in several] for name, several in panels.items()}
    html = render_page(
        "validation.html.j2",
        title="The simulator against theory",
        command=command,
        manifest=manifest,
        figures={name: _card(drawings) for name, drawings in drawn.items()},
        conditions=conditions(found, manifest, command),
        rows=rows(found, summary, own_step),
        facts=facts(found, summary),
    )
    return Page(html, [drawing for drawings in drawn.values() for drawing in drawings])


def _drawing(name: str, panel: Figure) -> Drawing:
    """A panel of the figure `name`, named for both."""
    return Drawing(f"{name}_{file_name(panel.axes[0].get_title(loc='left'))}", panel)


def _card(drawings: Sequence[Drawing]) -> Markup:
    return Markup('<div class="panels">\n{}</div>\n').format(Markup("").join(drawing.inline for drawing in drawings))


def rows(found: Validation, summary: Mapping[str, Any], own_step: float) -> list[Row]:
    """The table of headline numbers."""
    turns, naive = found.turns, found.naive_turns
    b = found.parameters.half_gauge
    offset = [(t.half_width - b) / (t.expected_half_width - b) - 1 for t in (turns, naive)]
    spread = [summary[key] for key in ("pad_load_spread", "naive_pad_load_spread")]
    own_error = found.convergence.step_error.get(own_step, math.nan)
    after = f"after {convergence.DURATION:g} s"
    table = [
        ("b + D, relative error", "0", *(_pair(100 * t.icr_error, "%") for t in (turns, naive))),
        ("D alone, relative error", "0", *(_pair(100 * error, "%") for error in offset)),
        ("slip of a track, error", "0", *(_pair(t.slip_error, "") for t in (turns, naive))),
        ("lateral speed, error", "0", *(_pair(1e3 * (t.lateral - t.expected_lateral), "mm/s") for t in (turns, naive))),
        ("load of a point of contact, largest deviation from theory's", "0", *(_percent(value) for value in spread)),
        ("sink on level ground", _number(1e3 * SINK, "mm"),
         _number(summary["sink_mm"], "mm", 3), _number(1e3 * float(found.naive_loads.sink.mean()), "mm")),
        ("creep, parked on " + _creep_angle(found), "0", _number(summary["creep_mm_per_s"], "mm/s")),
        ("acceleration beyond the friction angle, relative error", "0",
         _percent(summary["sliding_acceleration_error"])),
        ("drift to the side in 10 m straight on", "0", _number(summary["straight_drift_mm"], "mm")),
        (f"error of the physics step of {1e3 * own_step:g} ms, {after}", "0", _number(1e3 * own_error, "mm")),
        (f"solvers CG and Newton, apart {after}", "0", _number(summary["solver_difference_mm"], "mm")),
        ("energy not accounted for, of the most that the robots had", "0", _percent(summary["energy_residual"])),
        ("energy lost in friction, from Coulomb's law", "0", _percent(summary["friction_loss_error"])),
    ]  # fmt: skip
    return [Row(*cells) for cells in table]


def facts(found: Validation, summary: Mapping[str, Any]) -> dict[str, str]:
    """Numbers for the text."""
    turns, naive, parameters = found.turns, found.naive_turns, found.parameters
    v, w = expected_twist(turns, parameters).T
    plain = own(turns, parameters)
    lag = -float(np.polyfit((v * w)[plain], (turns.lateral - turns.expected_lateral)[plain], 1)[0])
    icr, naive_icr = summary["icr_error"], summary["naive_icr_error"]
    top_speed = Drive().top_speed
    points = found.loads.load.shape[1]
    return {
        "points": str(points),
        "points_per_track": str(points // 2),
        "turns": f"{len(turns.radius):,}",
        "radii": _range(turns.radius, "m"),
        "speeds": _range(turns.speed, "m/s"),
        "ratios": _range(turns.ratio, ""),
        "lengths": str(len(np.unique(turns.length))),
        "places": str(len(turns.radius) // len(turns.radius[plain]) // len(np.unique(turns.length))),
        "decades": f"{math.log10(naive_icr['median'] / icr['median']):.1f}",
        "icr_median": _percent(icr["median"]),
        "icr_worst": _percent(icr["worst"]),
        "naive_icr_median": _percent(naive_icr["median"]),
        "naive_wider": f"{np.mean(naive.icr_error > 0):.0%}".replace("%", " %"),
        "fastest": _number(float(np.abs(w).max()), "rad/s"),
        "on_the_spot": _number(top_speed / float(np.median(turns.expected_half_width[plain])), "rad/s"),
        "lag": _number(1e3 * lag, "ms"),
        "shift": _number(1e3 * lag * float(turns.speed.max()), "mm"),
        "top_speed": _number(float(turns.speed.max()), "m/s"),
        "spread": _number(_speed_spread(found, turns), ""),
        "naive_spread": _number(_speed_spread(found, naive), ""),
        "load_turns": str(len(found.loads.load)),
        "load_spread": _percent(summary["pad_load_spread"]),
        "expected_spread": _percent(float(np.abs(found.loads.expected - 1).max())),
        "watch": f"{WATCH:g} s",
        "creep": _number(summary["creep_mm_per_s"], "mm/s"),
        "creep_angle": _creep_angle(found),
        "creep_worst": _number(1e3 * float(found.creep.speed.max()), "mm/s"),
        "sliding": _percent(summary["sliding_acceleration_error"]),
        "robots": str(convergence.ROBOTS),
        "duration": f"{convergence.DURATION:g} s",
        "travelled": _number(found.convergence.travelled, "m"),
        "reference": f"{1e3 * convergence.REFERENCE_STEP:g} ms",
        "solvers": _number(summary["solver_difference_mm"], "mm"),
        "energy_robots": str(energy.ROBOTS),
        "residual_joule": _number(_residual(found), "J"),
        "residual": _percent(summary["energy_residual"]),
        "put_in": _number(float(found.energy.traction[-1]), "J", 3),
        "damping": _number(float(found.energy.damping[-1]), "J"),
        "coulomb": _percent(summary["friction_loss_error"]),
    }


def conditions(found: Validation, manifest: Mapping[str, Any], command: str) -> dict[str, str]:
    """Robot, ground, seed and command of each figure, in a line."""
    p, ground = found.parameters, found.ground
    file = manifest.get("config", {}).get("robot")
    size = f"b {1e3 * p.half_gauge:g} mm, contact {1e3 * p.contact_length:g} mm, {p.mass:g} kg"
    robot = f"{'shipped robot' if file is None else Path(file).name}: {size}"
    both = f"friction {ground.along:g} along, {ground.across:g} across"
    ratios = f"friction {ground.along:g} along, {_range(ground.along * found.turns.ratio, '')} across"
    nearest = f"friction {ground.along:g} along, {ground.along * nearest_ratio(found.turns, ground):.3g} across"
    random = f"seed {manifest.get('seed', MISSING)}"
    fixed = "no random numbers"
    grounds = {
        "turns": (ratios, fixed),
        "left": (ratios, fixed),
        "slip": (nearest, fixed),
        "loads": (both, fixed),
        "slopes": (both, fixed),
        "steps": (both, random),
        "energy": (both, random),
    }
    return {name: " · ".join([robot, *parts, command]) for name, parts in grounds.items()}


def _shipped(found: Validation) -> np.ndarray:
    """(M,) whether a turn is the robot's own, on friction nearest to its ground's."""
    return own(found.turns, found.parameters) & (found.turns.ratio == nearest_ratio(found.turns, found.ground))


def _speed_spread(found: Validation, turns: Turns) -> float:
    """Largest difference of slips at one radius, over the speeds [-]."""
    rows = _shipped(found)
    radii = np.unique(turns.radius)
    return max(float(np.nan_to_num(np.ptp(turns.slip[rows & (turns.radius == r)], axis=0)).max()) for r in radii)


def _residual(found: Validation) -> float:
    """Largest energy not accounted for [J]."""
    return found.energy.residual * float(np.abs(found.energy.kinetic).max())


def _creep_angle(found: Validation) -> str:
    """The slope that the summary's creep was measured on: the reference, or less where that does not hold a robot."""
    at_reference = int(np.argmin(np.abs(ANGLES - REFERENCE_ANGLE)))
    return _range(np.degrees(found.creep.angle[:, at_reference]), "°")


def _range(values: Array, unit: str) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    text = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
    return f"{text}{unit}" if unit == "°" else f"{text} {unit}".rstrip()


def _pair(error: Array, unit: str) -> str:
    """Worst | median size of errors."""
    size = np.abs(error)
    return f"{_number(float(np.nanmax(size)), '')} | {_number(float(np.nanmedian(size)), unit)}"


def _percent(share: float | None) -> str:
    return _number(None if share is None else 100 * share, "%")


def _number(value: float | None, unit: str, digits: int = 2) -> str:
    """A number to so many significant digits, never in powers of ten, with its unit."""
    if value is None or not math.isfinite(value):
        return MISSING
    places = 0 if value == 0 else max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:,.{places}f} {unit}".rstrip().replace("-", "−")
