"""The table of a planned drive: errors to expect of it and of the paper's runs."""

from __future__ import annotations

import math

from experiments.report.formats import number, percent, significant
from experiments.report.laws import symbol, unit_of
from experiments.report.table import Table
from trackslip.planning.information import Expectation
from trackslip.planning.plan import DrivePlan

_EXPECTED = ("parameter", "expected value", "standard error", "relative to", "share", "the paper's 25 runs")


def print_plan(plan: DrivePlan, paper: Expectation | None) -> None:
    """Print the errors that a plan is expected to give, and the robot's start and extent."""
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
    title = f"{limits.duration:g} s in {limits.area_text} m: what {plan.law} will be known to"
    Table(title, _EXPECTED, rows).print()
    x, y, heading = plan.start
    print(f"start at x = {x:.2f} m, y = {y:.2f} m from the middle of the area, heading {math.degrees(heading):.0f} deg")
    across, up = plan.places.size
    print(
        f"the middle of the robot stays within {across:.2f} x {up:.2f} m while half_gauge + D is "
        f"{plan.knowledge.reach:.3f} m within {plan.knowledge.reach_doubt:.0%}"
    )
    held = [name for name in plan.expectation.held if name not in ("lag", "sensor_yaw")]
    if held:
        print(f"not determined by it: {', '.join(held)}")
