"""The page on a planned drive: path and belt speeds, and the errors expected from it and from the
paper's runs.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from experiments.common.colours import BLUE, GREEN, GREY, ORANGE
from experiments.common.laws import symbol, unit_of
from experiments.common.manifest import command_line
from experiments.common.page import Answer, Page, Plot, Section
from experiments.common.style import BAND, plane, styled
from experiments.common.table import MISSING, Table, number, percent, significant
from trackslip.planning.information import Expectation
from trackslip.planning.plan import DrivePlan

_EXPECTED = ("parameter", "expected", "± error", "scale", "share", "25 runs")
_NOTE = (
    "Share: the standard error over the scale, for D half_gauge + D. The plan makes the "
    "largest share small."
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
    figure = Plot(
        "plan", partial(_draw_plan, plan), "Path and speeds", "The path if the law is as expected."
    )
    sections = [Section("Drive", [figure]), Section("Expected errors", [_expected(plan, paper)])]
    return Page("A drive to identify slip", command_line("plan"), manifest, sections, answer=answer)


def print_plan(plan: DrivePlan, paper: Expectation | None) -> None:
    """Print the errors expected from a plan, and the robot's start and extent of motion."""
    _expected(plan, paper).print()
    for name, text in _facts(plan, None):
        print(f"{name}: {text}")


def _expected(plan: DrivePlan, paper: Expectation | None) -> Table:
    rows = []
    errors, of_paper = (
        _errors(plan, plan.expectation),
        {} if paper is None else _errors(plan, paper),
    )
    for (name, size), value in zip(plan.sizes.items(), plan.values.tolist(), strict=True):
        factor, unit = unit_of(plan.law, name)
        relative = (
            significant(factor * size, unit, 3),
            percent(plan.expectation.stderr[name] / size),
        )
        expected = (number(factor * value, 2, unit), errors[name])
        rows.append((symbol(plan.law, name), *expected, *relative, of_paper.get(name, MISSING)))
    title = (
        f"{plan.limits.duration:g} s in {plan.limits.area_text} m: how well {plan.law} will "
        "be known"
    )
    return Table(title, _EXPECTED, rows, note=_NOTE)


def _errors(plan: DrivePlan, expectation: Expectation) -> dict[str, str]:
    """The standard error of each of the law's parameters, with its unit."""
    units = {name: unit_of(plan.law, name) for name in plan.sizes}
    return {
        name: significant(factor * expectation.stderr[name], unit)
        for name, (factor, unit) in units.items()
    }


def _errors_text(plan: DrivePlan, expectation: Expectation) -> str:
    errors = _errors(plan, expectation)
    return " and ".join(f"{symbol(plan.law, name)} ± {error}" for name, error in errors.items())


def _facts(plan: DrivePlan, paper: Expectation | None) -> list[tuple[str, str]]:
    """Facts on a plan: start, extent, undetermined parameters, and the errors expected from the
    paper's runs.
    """
    (x, y, heading), (across, up), knowledge = (
        plan.start,
        np.ptp(plan.places, axis=0),
        plan.knowledge,
    )
    where = (
        f"x = {x:.2f} m, y = {y:.2f} m from the middle of the area, heading "
        f"{math.degrees(heading):.0f}°"
    )
    reach = f"while half_gauge + D is {knowledge.reach:.3f} m within {knowledge.reach_doubt:.0%}"
    facts = [
        ("start", where),
        ("the robot's middle stays within", f"{across:.2f} x {up:.2f} m, {reach}"),
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
    figures = [Figure(figsize=(4.5, 4.2), layout="constrained") for _ in range(2)]
    place, belts = (figure.subplots() for figure in figures)
    area, reached, low = plan.limits.area, np.ptp(plan.places, axis=0), tuple(plan.places[0])
    place.add_patch(
        Rectangle((-area[0] / 2, -area[1] / 2), *area, fill=False, ec=GREY, lw=1.2, label="area")
    )
    place.add_patch(Rectangle(low, *reached, color=BAND, lw=0, label="where it may get to"))
    place.plot(*plan.path.T, color=BLUE, label="expected path")
    place.plot(*plan.start[:2], "o", color=GREEN, label="start")
    plane(place, title="Path")
    for values, side, colour in zip(plan.speeds.T, ("left", "right"), (BLUE, ORANGE), strict=True):
        belts.step(plan.time, values, where="post", color=colour, label=side)
    belts.set(
        title="Belts", xlabel="time [s]", ylabel="speed [m/s]", xlim=(0, plan.limits.duration)
    )
    for figure in figures:
        figure.legend(loc="outside lower center", ncols=2)
    return figures[0], figures[1]
