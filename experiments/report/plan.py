"""Tables of a planned drive: what it is expected to tell, beside the paper's runs and what it really tells."""

from __future__ import annotations

from collections.abc import Mapping

from experiments.measuring.plan_trials import PAPER, PLAN, Trials
from experiments.report.formats import for_terminal, number, percent, significant
from experiments.report.law_symbols import SYMBOLS, unit_of
from trackslip.planning.information import Expectation
from trackslip.planning.plan import DrivePlan

EXPECTED_HEADER = ("parameter", "expected value", "standard error", "relative to", "share", "the paper's 25 runs")
TRIED_HEADER = ("parameter", "predicted", "real", "real / predicted", "paper predicted", "paper real")


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


def tried_rows(trials: Trials) -> list[tuple[str, ...]]:
    """A row per parameter under TRIED_HEADER: standard errors expected, and root mean square errors."""
    predicted = trials.predicted
    real = {source: trials.errors(source) for source in (PLAN, PAPER)}
    rows = []
    for name in trials.plan.sizes:
        factor, unit = unit_of(trials.plan.law, name)

        def shown(errors: Mapping[str, float], name: str = name, factor: float = factor, unit: str = unit) -> str:
            value = errors.get(name)
            return significant(None if value is None else factor * value, unit)

        mine = predicted[PLAN].get(name)
        rows.append(
            (
                SYMBOLS[name],
                shown(predicted[PLAN]),
                shown(real[PLAN]),
                number(real[PLAN][name] / mine if mine else None, 2),
                shown(predicted[PAPER]),
                shown(real[PAPER]),
            )
        )
    return for_terminal(rows)
