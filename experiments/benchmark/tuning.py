"""Gains of a controller with a compensation, found by differential evolution on training paths and drawn plants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.optimize import differential_evolution
from scipy.stats import qmc

from experiments.benchmark.cases import BenchmarkCase
from experiments.benchmark.drive import ClosedLoops
from experiments.benchmark.gains import specified
from experiments.benchmark.rows import score
from experiments.common.choices import TRAINING_PATHS
from experiments.common.lookup import tunable
from experiments.common.manifest import relative
from experiments.common.sweep import drive_fleet
from experiments.common.table import Table
from experiments.studies.trials import Trial, TrialOutcome
from trackslip.errors import TrackslipError
from trackslip.kinematics import Array
from trackslip.metrics import LOST

if TYPE_CHECKING:
    from experiments.tune import Config

POPULATION = 12
"""Candidates that are driven together, as one generation."""


@dataclass(frozen=True)
class Tried:
    """Means over the training runs of one candidate."""

    error: float
    """Position error after the transient, 0.5 m for a run that lost the path [m]."""
    roughness: float
    """Root mean square rate of change of the set points, infinite if a run failed [rad/s^2]."""
    failure: str = ""
    """Reason why a run failed, or none could be driven."""

    def cost(self, limit: float) -> float:
        """The error; above the limit on roughness more than any error, and the more the rougher [m]."""
        return self.error if self.roughness <= limit else LOST * (1 + self.roughness / limit)


class Training:
    """The training runs of controllers with one compensation."""

    def __init__(self, config: Config, compensation: str) -> None:
        self._config, self._compensation = config, compensation
        self._loops = ClosedLoops(config, "drawn")

    def tried(self, specifications: list[str]) -> list[Tried]:
        """Drive candidates, all on the same paths and plants; one that can't be made has an infinite error."""
        refused = {one: self._refusal(one) for one in specifications}
        rows: dict[str, list[dict[str, Any]]] = {one: [] for one, reason in refused.items() if not reason}
        for path in TRAINING_PATHS if rows else ():
            cases = [
                BenchmarkCase(one, self._compensation, path, "stone", "random", seed, f"{one} {seed}")
                for one in rows
                for seed in self._config.seeds
            ]
            part = drive_fleet(self._loops, cases)
            for row in part.rows:
                rows[row["controller"]].append(row)
        return [Tried(np.inf, np.inf, refused[one]) if refused[one] else _means(rows[one]) for one in specifications]

    def _refusal(self, specification: str) -> str:
        """Reason why a candidate can't be made, if it can't."""
        try:
            self._loops.controller(specification)
        except TrackslipError as error:
            return str(error)
        return ""


def _means(rows: list[dict[str, Any]]) -> Tried:
    error = float(np.mean([score(row) for row in rows]))
    for row in rows:
        if row["error"] is not None:
            return Tried(error, np.inf, row["error"])
    return Tried(error, float(np.mean([row["roughness"] for row in rows])))


def tune(trial: Trial, rng: np.random.Generator, config: Config) -> TrialOutcome:
    """The best gains of the controller and compensation that the trial is called by, within a factor of ten.

    The defaults of the class are among the first candidates. The search is in the logarithms of the gains. Raises
    TrackslipError if a run fails with each of the candidates.
    """
    controller, compensation = trial.given
    defaults, training = tunable(controller), Training(config, compensation)
    seen: dict[tuple[float, ...], tuple[dict[str, float], Tried]] = {}

    def costs(logarithms: Array) -> Array:
        """Costs (S,) of candidates (parameters, S)."""
        candidates = [_arguments(defaults, one) for one in logarithms.T]
        tried = training.tried([specified(controller, one) for one in candidates])
        seen.update((tuple(one.values()), (one, of)) for one, of in zip(candidates, tried, strict=True))
        return np.array([one.cost(config.roughness) for one in tried])

    first = qmc.scale(qmc.LatinHypercube(len(defaults), rng=rng).random(POPULATION), -1.0, 1.0)
    first[0] = 0.0
    differential_evolution(
        costs,
        [(-1.0, 1.0)] * len(defaults),
        init=first,
        maxiter=config.evaluations // POPULATION - 1,
        vectorized=True,
        updating="deferred",
        polish=False,
        tol=0.0,
        rng=rng,
    )
    arguments, best = min(seen.values(), key=lambda one: one[1].cost(config.roughness))
    if best.failure:
        raise TrackslipError(f"{controller} with {compensation}: no gains drive all training runs: {best.failure}")
    _, default = next(iter(seen.values()))
    numbers = {"controller": controller, "compensation": compensation, "arguments": arguments}
    numbers |= {"error": best.error, "roughness": best.roughness}
    return TrialOutcome(numbers=numbers | {"default_error": default.error, "default_roughness": default.roughness})


def _arguments(defaults: Mapping[str, float], logarithms: Array) -> dict[str, float]:
    """Constructor arguments, rounded to four digits."""
    return {
        name: float(f"{value * 10**power:.4g}")
        for (name, value), power in zip(defaults.items(), logarithms, strict=True)
    }


def gains_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """The gains, and errors and roughness with them and with the defaults."""
    header = ("controller", "compensation", "error [mm]", "by default", "rough [rad/s²]", "by default", "gains")
    return Table(
        "Tuned gains, means over the training runs",
        header,
        [
            [
                relative(row["controller"]),
                row["compensation"],
                *(f"{1e3 * row[name]:.1f}" for name in ("error", "default_error")),
                *(f"{row[name]:.2f}" for name in ("roughness", "default_roughness")),
                ", ".join(f"{name} {value:g}" for name, value in row["arguments"].items()),
            ]
            for row in rows
        ],
        align="llrrrrl",
    )
