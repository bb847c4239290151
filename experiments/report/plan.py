"""The tables of a planned drive: errors to expect beside those of the paper's runs, and errors in trials."""

from __future__ import annotations

import math

from experiments.report.checks import checks_table
from experiments.report.formats import number, percent, significant
from experiments.report.laws import SYMBOLS, unit_of
from experiments.report.studies import print_verdict
from experiments.report.table import Table
from experiments.studies.plan_trials import PAPER, PLAN, PlanTrials
from experiments.studies.trials import sampling_error
from trackslip.planning.information import Expectation
from trackslip.planning.plan import DrivePlan

_EXPECTED = ("parameter", "expected value", "standard error", "relative to", "share", "the paper's 25 runs")
_TRIED = ("parameter", "predicted", "real", "real / predicted", "paper predicted", "paper real")


def print_plan(plan: DrivePlan, paper: Expectation | None) -> None:
    """Print what a plan is expected to tell, and where the robot starts and stays."""
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
        rows.append((SYMBOLS[name], *values))
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


def print_plan_trials(trials: PlanTrials) -> None:
    """Print errors in trials beside those predicted, and the checks."""
    counts = {case: len(trials.outcomes.get(case, [])) for case in (PLAN, PAPER)}
    if trials.truth is None:
        title = f"A drive in MuJoCo, measured {trials.repeats} times: standard deviations between measurements"
    else:
        driven = f"{counts[PLAN]} drives of the plan, {trials.repeats} times the paper's runs"
        title = f"{driven}, moved by the law: root mean square errors"
    Table(title, _TRIED, _tried_rows(trials)).print()
    if trials.truth is not None:
        known = [f"{case} {sampling_error(count):.0%}" for case, count in counts.items() if count]
        print(f"so many drives leave real errors uncertain by: {', '.join(known)}")
    checks_table("Checks", trials.checks()).print()
    print_verdict(trials.checks(), trials.failures)


def _tried_rows(trials: PlanTrials) -> list[tuple[str, ...]]:
    """A row per parameter: standard errors expected, and root mean square errors."""
    real = {case: trials.errors(case) for case in (PLAN, PAPER)}
    rows = []
    for name in trials.plan.sizes:
        factor, unit = unit_of(trials.plan.law, name)
        mine, papers = (trials.predicted[case].get(name) for case in (PLAN, PAPER))
        ratio = real[PLAN][name].rms / mine if mine else None
        columns = (mine, real[PLAN][name].rms, papers, real[PAPER][name].rms)
        printed = [significant(None if error is None else factor * error, unit) for error in columns]
        rows.append((SYMBOLS[name], *printed[:2], number(ratio, 2), *printed[2:]))
    return rows
