"""The table and the page of a planned drive: errors to expect of it and of the paper's runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from experiments.common.formats import number, percent, significant
from experiments.common.laws import symbol, unit_of
from experiments.common.manifest import command_line
from experiments.common.page import Page, Plot, Section
from experiments.common.table import Table
from experiments.plan.figures import draw_plan
from trackslip.planning.information import Expectation
from trackslip.planning.plan import DrivePlan

_EXPECTED = ("parameter", "expected value", "standard error", "relative to", "share", "the paper's 25 runs")
_NOTE = """Share: the standard error over the size it is relative to, for a D half_gauge + D, on which turning depends.
The plan makes the largest share small. Last column: standard errors of the paper's 25 runs with this robot."""


def page(plan: DrivePlan, paper: Expectation | None, manifest: Mapping[str, Any], tried: Sequence[Table | str]) -> Page:
    """The page of a plan; `tried` is what the drives that tried it show."""
    figure = Plot("plan", partial(draw_plan, plan), "Path and speeds", "The path if the law is as expected.", "")
    lines = [f"{line[0].upper()}{line[1:]}." for line in _sentences(plan)]
    intro = f"A drive of {plan.limits.duration:g} s that shows a robot's slip law as well as its limits allow."
    sections = [Section("Drive", [figure, *lines]), Section("Expected errors", [_expected(plan, paper)])]
    sections.append(Section("Tried in the simulator", tried))
    return Page("A drive to identify slip", command_line("plan"), manifest, sections, [intro])


def print_plan(plan: DrivePlan, paper: Expectation | None) -> None:
    """Print the errors that a plan is expected to give, and the robot's start and extent."""
    _expected(plan, paper).print()
    for line in _sentences(plan):
        print(line)


def _expected(plan: DrivePlan, paper: Expectation | None) -> Table:
    """A row per parameter."""
    limits = plan.limits
    rows = []
    for (name, size), value in zip(plan.sizes.items(), plan.values.tolist(), strict=True):
        factor, unit = unit_of(plan.law, name)
        error = plan.expectation.stderr[name]
        values = (
            number(factor * value, 2, unit),
            significant(factor * error, unit),
            significant(factor * size, unit, 3),
            percent(error / size),
            significant(None if paper is None else factor * paper.stderr[name], unit),
        )
        rows.append((symbol(plan.law, name), *values))
    title = f"{limits.duration:g} s in {limits.area_text} m: how well {plan.law} will be known"
    return Table(title, _EXPECTED, rows, note=_NOTE)


def _sentences(plan: DrivePlan) -> Iterator[str]:
    """Where the robot starts and stays, and what the drive leaves open."""
    x, y, heading = plan.start
    where = f"x = {x:.2f} m, y = {y:.2f} m from the middle of the area"
    yield f"start at {where}, heading {math.degrees(heading):.0f} deg"
    across, up = plan.places.size
    yield (
        f"the middle of the robot stays within {across:.2f} x {up:.2f} m while half_gauge + D is "
        f"{plan.knowledge.reach:.3f} m within {plan.knowledge.reach_doubt:.0%}"
    )
    held = [name for name in plan.expectation.held if name not in ("lag", "sensor_yaw")]
    if held:
        yield f"not determined by this drive: {', '.join(held)}"
