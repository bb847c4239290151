"""What slow tests in tests/validation share: trials in processes, estimates, shares, and MuJoCo's
own contact.
"""

import multiprocessing
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple, Self, TypeVar

import mujoco
import numpy as np
from scipy.stats import binom, binomtest

from experiments.common.check import Check, checks_table
from trackslip.drives.conditioning import drives_of
from trackslip.errors import TrackslipError
from trackslip.identification.law_fit import fit_drives
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog

LAW = "icr_radius"
"""The law that moves robots and is fitted, unless a test tries several."""
TRUE_LAW = {"offset": 0.045, "radius_error": 0.0066}
"""Its parameters [m, -], similar to the shipped robot's on stone."""
_ROOT = Path(__file__).parents[2]  # test modules are imported from here
_CHANCE = 1e-3  # of a false alarm, at each end of a range of shares

Trial = TypeVar("Trial")
Outcome = TypeVar("Outcome")


def outcomes(do: Callable[[Trial], Outcome], trials: Iterable[Trial]) -> list[Outcome]:
    """What `do` returns for each trial, in order, in one process per processor."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(
        os.cpu_count(), context, initializer=sys.path.append, initargs=(str(_ROOT),)
    ) as pool:
        return list(pool.map(do, trials))


class Estimate(NamedTuple):
    """An estimated parameter with its standard error, by the model of the noise, and its 95 %
    interval.
    """

    value: float
    stderr: float
    low: float
    high: float


def identified(logs: Sequence[RunLog], geometry: RobotGeometry) -> dict[str, Estimate]:
    """LAW from whole drives: the estimates of its parameters and of others; empty if the drives
    don't determine it.
    """
    try:
        fit = fit_drives(LAW, drives_of(logs)[0], geometry)
    except TrackslipError:
        return {}
    values = fit.values | fit.extras
    found = {
        name: Estimate(values[name], error, *fit.interval95[name])
        for name, error in fit.stderr.items()
    }
    return found if TRUE_LAW.keys() <= found.keys() else {}


class Estimates(NamedTuple):
    """Estimates of a parameter in n trials, NaN where there is none."""

    value: Array  # (n,)
    stderr: Array  # (n,)
    low: Array  # (n,)
    high: Array  # (n,)

    @classmethod
    def of(cls, trials: Sequence[dict[str, Estimate]], name: str) -> Self:
        missing = Estimate(*[np.nan] * 4)
        return cls(*np.array([trial.get(name, missing) for trial in trials], float).T)

    def rms_error(self, aim: Array | float) -> float:
        return float(np.sqrt(np.nanmean((self.value - aim) ** 2)))

    def coverage(self, truth: Array | float) -> float:
        """Share of the intervals that contain the truth, a number or one of each trial."""
        return float(np.mean((self.low <= truth) & (truth <= self.high)))


def share_text(share: float, trials: int) -> str:
    """A share of so many trials with its 95 % interval, by Clopper and Pearson."""
    low, high = binomtest(round(share * trials), trials).proportion_ci(method="exact")
    return f"{share:.3f} ({low:.2f} to {high:.2f})"


def plausible_shares(low: float, high: float, trials: int) -> tuple[float, float]:
    """The range of shares of so many trials where the probability is from `low` to `high`.

    By chance, one study in a thousand is outside either end.
    """
    ends = binom.ppf([_CHANCE, 1 - _CHANCE], trials, [low, high]) / trials
    return float(ends[0]), float(ends[1])


def report(title: str, checks: Sequence[Check]) -> None:
    """Print the table of some checks and assert that all of them hold."""
    checks_table(title, checks).print()
    assert [str(check) for check in checks if not check.holds] == []


def use_default_contact(model: mujoco.MjModel) -> None:
    """Replace the contact parameters of a model by MuJoCo's defaults, except the friction
    coefficients.
    """
    plain = mujoco.MjSpec().option
    model.pair_solref[:] = [0.02, 1.0]
    model.pair_solreffriction[:] = 0.0
    model.pair_solimp[:] = [0.9, 0.95, 0.001, 0.5, 2.0]
    model.pair_margin[model.pair_dim == 1] = -1.0  # the cores of tracks never touch
    for name in ("timestep", "cone", "impratio", "solver", "iterations"):
        setattr(model.opt, name, getattr(plain, name))
