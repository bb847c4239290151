"""The table of a planned drive: what it is expected to tell, beside the paper's runs."""

from __future__ import annotations

from experiments.report.formats import for_terminal, number, percent, significant
from experiments.report.laws import SYMBOLS, unit_of
from trackslip.planning.information import Expectation
from trackslip.planning.plan import DrivePlan

EXPECTED_HEADER = ("parameter", "expected value", "standard error", "relative to", "share", "the paper's 25 runs")


def expected_rows(plan: DrivePlan, paper: Expectation | None) -> list[tuple[str, ...]]:
    """A row per parameter under EXPECTED_HEADER."""
    rows = []
    for (name, size), value in zip(plan.sizes.items(), plan.values.tolist(), strict=True):
        factor, unit = unit_of(plan.law, name)
        error = plan.expectation.stderr[name]
        others = None if paper is None else factor * paper.stderr[name]
        rows.append(
            (
                SYMBOLS[name],
                number(factor * value, 2, unit),
                significant(factor * error, unit),
                significant(factor * size, unit, 3),
                percent(error / size),
                significant(others, unit),
            )
        )
    return for_terminal(rows)
