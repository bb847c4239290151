"""The page on a planned drive: path and belt speeds, and the errors expected from it and from the
paper's runs.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.common.colours import BLUE, GREEN, GREY, ORANGE
from experiments.common.manifest import command_line
from experiments.common.page import Answer, Page, Plot, Section
from experiments.common.style import BAND, plane, styled
from experiments.common.table import MISSING, Table, number, percent, significant
from trackslip.planning.information import Expectation
from trackslip.planning.plan import DrivePlan
from trackslip.views.symbols import symbol, unit_of

_EXPECTED: Final = ("parameter", "expected", "± error", "scale", "share", "25 runs")
_SIZE: Final = (4.5, 4.2)  # width and height of a figure [in]
_NOTE: Final = (
    "Share: the standard error over the scale, which is half gauge + D for D. The plan makes the "
    "largest share small. The area needed is that of the robot's middle."
)


def page(
    plan: DrivePlan, paper: Expectation | None, manifest: Mapping[str, Any], steps: Sequence[str]
) -> Page:
    """The page on a plan; `steps` are the command lines to run next."""
    heading = (
        f"{plan.limits.duration:g} s of driving will determine "
        f"{_errors_text(plan, plan.expectation)}"
    )
    answer = Answer(heading, _facts(plan, paper), next=steps)
    draw = partial(_draw_plan, plan)
    figure = Plot("plan", draw, "Path and speeds", "The path if the law is as expected.")
    sections = [
        Section("Drive", [figure]),
        Section("Expected errors", [_expected(plan, paper)]),
    ]
    command = command_line("plan")
    return Page("A drive to identify slip", command, manifest, sections, answer=answer)


def print_plan(plan: DrivePlan, paper: Expectation | None) -> None:
    """Print the errors expected from a plan, and the robot's start and extent of motion."""
    _expected(plan, paper).print()
    for name, text in _facts(plan, None):
        print(f"{name}: {text}")


def _expected(plan: DrivePlan, paper: Expectation | None) -> Table:
    """A table with a row per parameter of the law: what is expected, and how well the drive and
    the paper's runs determine it.
    """
    errors = _errors(plan, plan.expectation)
    errors_of_paper = {} if paper is None else _errors(plan, paper)
    rows = []
    for (name, scale), value in zip(plan.sizes.items(), plan.values.tolist(), strict=True):
        factor, unit = unit_of(plan.law, name)
        share = plan.expectation.stderr[name] / scale
        row = (
            symbol(plan.law, name),
            number(factor * value, 2, unit),
            errors[name],
            significant(factor * scale, unit, 3),
            percent(share),
            errors_of_paper.get(name, MISSING),
        )
        rows.append(row)
    title = (
        f"{plan.limits.duration:g} s in {plan.limits.area_text} m: how well {plan.law} will "
        "be known"
    )
    return Table(title, _EXPECTED, rows, note=_NOTE)


def _errors(plan: DrivePlan, expectation: Expectation) -> dict[str, str]:
    """The standard error of each of the law's parameters, with its unit."""
    errors = {}
    for name in plan.sizes:
        factor, unit = unit_of(plan.law, name)
        errors[name] = significant(factor * expectation.stderr[name], unit)
    return errors


def _errors_text(plan: DrivePlan, expectation: Expectation) -> str:
    errors = _errors(plan, expectation)
    return " and ".join(f"{symbol(plan.law, name)} ± {error}" for name, error in errors.items())


def _facts(plan: DrivePlan, paper: Expectation | None) -> list[tuple[str, str]]:
    """Facts on a plan: start, extent, undetermined parameters, and the errors expected from the
    paper's runs.
    """
    x, y, heading = plan.start
    across, up = np.ptp(plan.places, axis=0)
    knowledge = plan.knowledge
    where = (
        f"x = {x:.2f} m, y = {y:.2f} m from the middle of the area, heading "
        f"{math.degrees(heading):.0f}°"
    )
    reach = f"half gauge + D = {knowledge.reach:.3f} m ± {100 * knowledge.reach_doubt:.0f} %"
    facts = [
        ("start", where),
        ("area needed", f"{across:.2f} × {up:.2f} m if {reach}"),
    ]
    undetermined = [
        name for name in plan.expectation.undetermined if name not in ("lag", "sensor_yaw")
    ]
    if undetermined:
        facts.append(("not determined by this drive", ", ".join(undetermined)))
    if paper is not None:
        facts.append(("the paper's 25 runs of 30 s would determine", _errors_text(plan, paper)))
    return facts


@styled
def _draw_plan(plan: DrivePlan) -> tuple[Figure, Figure]:
    path = _draw_path(plan)
    belts = _draw_belts(plan)
    for figure in (path, belts):
        figure.legend(loc="outside lower center", ncols=2)
    return path, belts


def _draw_path(plan: DrivePlan) -> Figure:
    """The expected path in the area, and the part of the area that the robot may get to."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.subplots()
    length, width = plan.limits.area
    corner = (-length / 2, -width / 2)
    area = Rectangle(corner, length, width, fill=False, ec=GREY, lw=1.2, label="area")
    axes.add_patch(area)
    low_x, low_y = plan.places[0]
    reached = np.ptp(plan.places, axis=0)
    within = Rectangle((low_x, low_y), *reached, color=BAND, lw=0, label="where it may get to")
    axes.add_patch(within)
    axes.plot(*plan.path.T, color=BLUE, label="expected path")
    axes.plot(*plan.start[:2], "o", color=GREEN, label="start")
    plane(axes, title="Path")
    return figure


def _draw_belts(plan: DrivePlan) -> Figure:
    """The speeds of both belts over time."""
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.subplots()
    left, right = plan.speeds.T
    axes.step(plan.time, left, where="post", color=BLUE, label="left")
    axes.step(plan.time, right, where="post", color=ORANGE, label="right")
    axes.set(title="Belts", xlabel="time [s]", ylabel="speed [m/s]")
    axes.set_xlim(0, plan.limits.duration)
    return figure
