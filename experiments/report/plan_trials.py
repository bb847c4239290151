"""The table of a plan that was tried: what it tells, as predicted and really."""

from __future__ import annotations

from collections.abc import Mapping

from experiments.report.formats import for_terminal, number, significant
from experiments.report.laws import SYMBOLS, unit_of
from experiments.studies.plan_trials import PAPER, PLAN, Trials

TRIED_HEADER = ("parameter", "predicted", "real", "real / predicted", "paper predicted", "paper real")


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
