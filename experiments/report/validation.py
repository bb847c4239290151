"""The page of a validation: headline numbers, and figures that compare the simulator with theory."""

import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from experiments.report.figures import validation as figures
from experiments.report.figures import validation_turning as turning_figures
from experiments.report.figures.validation_turning import expected_twist, nearest_ratio, own
from experiments.report.formats import MISSING, pair, percent, significant, span
from experiments.report.page import file_name, relative_command
from experiments.report.template_page import Drawing, Page, render_page
from experiments.validation import convergence, energy
from experiments.validation.results import Validation, ValidationSummary
from experiments.validation.standing import ANGLES, REFERENCE_ANGLE
from experiments.validation.turning import WATCH, Turns
from sim.drive.drive import Drive
from sim.robot.parameters import SINK
from sim.robot.robot import load_robot
from trackslip.kinematics import Array

TITLE = "The simulator compared with theory"
TABLE_HEADER = ("quantity", "theory", "recipe", "default contact")


def render(found: Validation, summary: ValidationSummary, manifest: Mapping[str, Any], command: str) -> Page:
    """Draw the figures, one file per panel, and fill in the template."""
    panels = {
        "turns": turning_figures.icr_and_slip(found.turns, found.naive_turns, found.parameters),
        "left": turning_figures.what_is_left(found.turns, found.parameters),
        "slip": turning_figures.slip_against_radius(found.turns, found.naive_turns, found.parameters, found.ground),
        "loads": figures.pad_loads(found.loads, found.naive_loads),
        "slopes": figures.slopes(found.creep, found.slide, found.ground),
        "steps": figures.steps_and_solvers(found.convergence, physics_step(found)),
        "energy": figures.energies(found.energy),
    }
    drawn = {name: [_drawing(name, panel) for panel in several] for name, several in panels.items()}
    cards = {name: Markup("").join(drawing.inline for drawing in drawings) for name, drawings in drawn.items()}
    return render_page(
        "validation.html.j2",
        list(itertools.chain(*drawn.values())),
        title=TITLE,
        command=command,
        manifest=manifest,
        figures={name: Markup('<div class="panels">\n{}</div>\n').format(card) for name, card in cards.items()},
        conditions=conditions(found, manifest, command),
        header=TABLE_HEADER,
        rows=table_of(found, summary),
        found=found,
        summary=summary,
        facts=facts(found),
    )


def _drawing(name: str, panel: Figure) -> Drawing:
    """A panel of the figure `name`, named after both."""
    return Drawing(f"{name}_{file_name(panel.axes[0].get_title(loc='left'))}", panel)


def table_of(found: Validation, summary: ValidationSummary) -> list[tuple[str, ...]]:
    """The headline numbers, under TABLE_HEADER."""
    turns, naive = found.turns, found.naive_turns
    b = found.parameters.half_gauge
    offset = [(t.half_width - b) / (t.expected_half_width - b) - 1 for t in (turns, naive)]
    spread = summary.pad_load_spread, summary.naive_pad_load_spread
    step = physics_step(found)
    error = found.convergence.step_error.get(step, math.nan)
    after = f"after {convergence.DURATION:g} s"
    table = [
        ("b + D, worst | median error", "0", *(_worst_and_median(100 * t.icr_error, "%") for t in (turns, naive))),
        ("D alone, worst | median error", "0", *(_worst_and_median(100 * error, "%") for error in offset)),
        ("slip, worst | median error", "0", *(_worst_and_median(t.slip_error) for t in (turns, naive))),
        ("lateral speed, worst | median error", "0",
         *(_worst_and_median(1e3 * (t.lateral - t.expected_lateral), "mm/s") for t in (turns, naive))),
        ("load of a contact point, largest deviation from theory", "0", *(percent(value) for value in spread)),
        ("sink on level ground", significant(1e3 * SINK, "mm"),
         significant(summary.sink_mm, "mm", 3), significant(1e3 * float(found.naive_loads.sink.mean()), "mm")),
        ("roll | pitch in turns, largest", "0",
         pair([significant(summary.roll_deg), significant(summary.pitch_deg)], "deg")),
        ("creep, parked on " + _creep_angle(found), "0", significant(summary.creep_mm_per_s, "mm/s")),
        ("acceleration beyond the friction angle, relative error", "0",
         percent(summary.sliding_acceleration_error)),
        ("sideways drift in 10 m straight on", "0", significant(summary.straight_drift_mm, "mm")),
        (f"error of the physics step of {1e3 * step:g} ms, {after}", "0", significant(1e3 * error, "mm")),
        (f"solvers CG and Newton, apart {after}", "0", significant(summary.solver_difference_mm, "mm")),
        ("energy not accounted for, of the largest energy stored", "0", percent(summary.energy_residual)),
        ("friction loss, deviation from Coulomb's law", "0", percent(summary.friction_loss_error)),
    ]  # fmt: skip
    return [(*cells, *[MISSING] * (len(TABLE_HEADER) - len(cells))) for cells in table]


def physics_step(found: Validation) -> float:
    """The physics step of the model [s]."""
    return float(load_robot(parameters=found.parameters).model.opt.timestep)


def facts(found: Validation) -> dict[str, str]:
    """Numbers for the text that follow from several of those found."""
    turns, naive = found.turns, found.naive_turns
    v, w = expected_twist(turns, found.parameters).T
    plain = own(turns, found.parameters)
    lag = -float(np.polyfit((v * w)[plain], (turns.lateral - turns.expected_lateral)[plain], 1)[0])
    points, lengths = found.loads.load.shape[1], len(np.unique(turns.length))
    top_yaw_rate = Drive().top_speed / float(np.median(turns.expected_half_width[plain]))
    return {
        "points": str(points),
        "points_per_track": str(points // 2),
        "turns": f"{len(turns.radius):,}",
        "radii": span(turns.radius, "m"),
        "speeds": span(turns.speed, "m/s"),
        "ratios": span(turns.ratio),
        "lengths": str(lengths),
        "places": str(len(turns.radius) // len(turns.radius[plain]) // lengths),
        "decades": f"{math.log10(np.median(np.abs(naive.icr_error)) / np.median(np.abs(turns.icr_error))):.1f}",
        "naive_wider": f"{np.mean(naive.icr_error > 0):.0%}".replace("%", " %"),
        "fastest": significant(float(np.abs(w).max()), "rad/s"),
        "on_the_spot": significant(top_yaw_rate, "rad/s"),
        "lag": significant(1e3 * lag, "ms"),
        "shift": significant(1e3 * lag * float(turns.speed.max()), "mm"),
        "spread": significant(_speed_spread(found, turns)),
        "naive_spread": significant(_speed_spread(found, naive)),
        "expected_spread": percent(float(np.abs(found.loads.expected - 1).max())),
        "watch": f"{WATCH:g} s",
        "creep_angle": _creep_angle(found),
        "robots": str(convergence.ROBOTS),
        "duration": f"{convergence.DURATION:g} s",
        "reference": f"{1e3 * convergence.REFERENCE_STEP:g} ms",
        "energy_robots": str(energy.ROBOTS),
        "residual_joule": significant(found.energy.residual * float(np.abs(found.energy.kinetic).max()), "J"),
    }


def conditions(found: Validation, manifest: Mapping[str, Any], command: str) -> dict[str, str]:
    """Robot, ground, seed and command of each figure, on one line."""
    p, ground = found.parameters, found.ground
    file = manifest.get("config", {}).get("robot")
    size = f"b {1e3 * p.half_gauge:g} mm, contact {1e3 * p.contact_length:g} mm, {p.mass:g} kg"
    robot = f"{'shipped robot' if file is None else Path(file).name}: {size}"
    friction = f"friction {ground.along:g} along, {{}} across".format
    own_ground, ratios = friction(f"{ground.across:g}"), friction(span(ground.along * found.turns.ratio))
    nearest = friction(f"{ground.along * nearest_ratio(found.turns, ground):.3g}")
    fixed, random = "no random numbers", f"seed {manifest.get('seed', MISSING)}"
    of_figures = {
        **dict.fromkeys(("turns", "left"), (ratios, fixed)),
        "slip": (nearest, fixed),
        **dict.fromkeys(("loads", "slopes"), (own_ground, fixed)),
        **dict.fromkeys(("steps", "energy"), (own_ground, random)),
    }
    return {name: " · ".join([robot, *parts, relative_command(command)]) for name, parts in of_figures.items()}


def _speed_spread(found: Validation, turns: Turns) -> float:
    """Largest difference of slip between the speeds of one radius, of the robot itself near its ground's friction."""
    rows = own(found.turns, found.parameters) & (found.turns.ratio == nearest_ratio(found.turns, found.ground))
    slips = (turns.slip[rows & (turns.radius == radius)] for radius in np.unique(turns.radius))
    return max(float(np.nan_to_num(np.ptp(slip, axis=0)).max()) for slip in slips)


def _creep_angle(found: Validation) -> str:
    """The slope whose creep the summary reports: the reference, or less where that does not hold a robot."""
    at_reference = int(np.argmin(np.abs(ANGLES - REFERENCE_ANGLE)))
    return span(np.degrees(found.creep.angle[:, at_reference]), "°")


def _worst_and_median(error: Array, unit: str = "") -> str:
    size = np.abs(error)
    return pair([significant(float(np.nanmax(size))), significant(float(np.nanmedian(size)))], unit)
