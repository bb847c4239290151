"""The engine of Monte-Carlo studies: independent trials, stored as they finish, and their statistics."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
import scipy

from experiments.common.check import Check
from experiments.common.manifest import digest, made_by
from experiments.common.plain_json import plain
from experiments.common.pool import WorkersFailedError, processors, workers
from experiments.common.table import Table
from sim.seeds import generator
from trackslip.kinematics import Array
from trackslip.metrics import rms

if TYPE_CHECKING:
    from experiments.common.run import Run
    from trackslip.identification.drive_law import DriveFit

FILE = ".trials.jsonl"
"""File in the folder of results with the trials that a killed study had finished."""
_CHANCE = 1e-3  # of a false alarm
_UNSAID = ("out", "overwrite", "threads", "pdf", "rrd")  # options that no trial depends on


@dataclass(frozen=True)
class Trial:
    """A repeat of a case."""

    case: str
    number: int = 0
    given: Any = field(default=None, compare=False)
    """Its input, such as a log, where it follows from the options."""


class Estimate(NamedTuple):
    """A parameter estimated in a trial, with its standard error by the model of the noise and its 95 % interval."""

    value: float
    stderr: float
    low: float
    high: float

    @staticmethod
    def of(fit: DriveFit) -> dict[str, Estimate]:
        """The estimates of all fitted parameters, of the law and others."""
        values = fit.values | fit.extras
        return {name: Estimate(values[name], error, *fit.interval95[name]) for name, error in fit.stderr.items()}


@dataclass(frozen=True)
class TrialOutcome:
    """The result of a trial."""

    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)
    """Other numbers by name, or groups of them."""
    notes: tuple[str, ...] = ()
    """Reasons why a parameter was not estimated or, without estimates, why the fit failed."""

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """The outcome that was stored with `asdict`."""
        estimates = {name: Estimate(*one) for name, one in content["estimates"].items()}
        return cls(estimates, content["numbers"], tuple(content["notes"]))


Values = Mapping[str, float]  # by parameter
Do = Callable[[Trial, np.random.Generator], TrialOutcome]


def run_trials(run: Run, do: Do, trials: Sequence[Trial], key: str, about: Any = None) -> dict[str, list[TrialOutcome]]:
    """The outcomes of trials by case, in order, each done in one of `config.threads` processes.

    The random numbers of a trial depend on the root seed and on `key`, with {case} and {number} filled in. Finished
    trials are stored in `config.out`: the same command resumes while options, code and `about` are the same, and
    `forget_trials` deletes them.
    """
    stored = _StoredTrials(run.config, about)
    found = {trial: stored.outcomes[trial] for trial in trials if trial in stored.outcomes}
    missing = [trial for trial in trials if trial not in found]
    jobs = min(run.config.threads or processors(), max(1, len(missing)))
    try:
        with (
            run.progress("trials", len(trials), "trials", len(found)) as step,
            workers("processes", jobs) as pool,
        ):
            for trial, outcome in pool.each(partial(_done, do, run.config.seed, key), missing):
                stored.add(trial, outcome)
                found[trial] = outcome
                step(1.0)
    except (KeyboardInterrupt, WorkersFailedError) as stop:
        kept = f" with {len(found)} of {len(trials)} trials done; the same command resumes" if found else ""
        raise type(stop)(f"{str(stop) or 'interrupted'}{kept}") from None
    return {case: [found[one] for one in trials if one.case == case] for case in dict.fromkeys(t.case for t in trials)}


def forget_trials(out: Path) -> None:
    """Delete the finished trials of a study whose results are complete."""
    (out / FILE).unlink(missing_ok=True)


def _done(do: Do, seed: int, key: str, trial: Trial) -> tuple[Trial, TrialOutcome]:
    rng = generator(seed, key.format(case=trial.case, number=trial.number))
    return Trial(trial.case, trial.number), do(trial, rng)


class _StoredTrials:
    """Finished trials in a file, a line of JSON behind its digest each, below a line that says what they depend on."""

    def __init__(self, config: Any, about: Any) -> None:
        options = {name: value for name, value in plain(config).items() if name not in _UNSAID}
        self._title = digest([type(config).__module__, options, about, made_by()])
        self._file = Path(config.out) / FILE
        self.outcomes: dict[Trial, TrialOutcome] = {}
        if self._file.exists():
            title, *lines = self._file.read_text(encoding="utf-8", errors="replace").split("\n")
            if title == self._title:
                self.outcomes = dict(_read(lines))
            else:
                self._file.unlink()

    def add(self, trial: Trial, outcome: TrialOutcome) -> None:
        """Store a trial; a line that was cut short before is left as it is."""
        text = json.dumps([trial.case, trial.number, asdict(outcome)])
        line = f"{digest(text)} {text}"
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(f"\n{line}" if stream.tell() else f"{self._title}\n{line}")


def _read(lines: Iterable[str]) -> Iterable[tuple[Trial, TrialOutcome]]:
    """The trials in lines, without those that were cut short when the study was killed, or are damaged."""
    for line in lines:
        stated, _, text = line.partition(" ")
        if stated == digest(text):
            case, number, outcome = json.loads(text)
            yield Trial(case, number), TrialOutcome.from_json(outcome)


@dataclass(frozen=True)
class Study:
    """The results of a study."""

    summary: Mapping[str, Any]
    """The summary besides the checks; `failures` are the reasons why fits failed."""
    shown: Sequence[Table | str]
    """The tables to print."""
    checks: Sequence[Check] = ()

    def to_json(self) -> dict[str, Any]:
        """The content of summary.json."""
        return {**self.summary, **({"checks": [check.to_json() for check in self.checks]} if self.checks else {})}

    def print(self) -> None:
        """Print the tables, why fits failed, and how many checks hold."""
        for one in self.shown:
            if isinstance(one, Table):
                one.print()
            else:
                print(one)
        for line in self.summary.get("failures", ()):
            print(f"a fit failed: {line}")
        if self.checks:
            print(f"{sum(check.holds for check in self.checks)} of {len(self.checks)} checks hold")


@dataclass(frozen=True)
class Estimates:
    """The estimates of a parameter in n trials, NaN where it was not estimated."""

    value: Array  # (n,)
    stderr: Array  # (n,)
    low: Array  # (n,)
    high: Array  # (n,)

    @classmethod
    def of(cls, outcomes: Sequence[TrialOutcome], name: str) -> Self:
        """Gather the estimates of the parameter called `name`."""
        missing = Estimate(*[np.nan] * 4)
        found = [one.estimates.get(name, missing) for one in outcomes]
        return cls(*np.array(found, float).reshape(-1, 4).T)

    @property
    def known(self) -> np.ndarray:
        """(n,) bool: whether it was estimated."""
        return ~np.isnan(self.value)

    def errors(self, aim: float) -> Array:
        """Errors (m,) of those that were estimated."""
        return self.value[self.known] - aim

    def cover(self, truth: Array | float) -> np.ndarray:
        """(n,) bool: whether the intervals contain the truth, a number or (n,)."""
        return (self.low <= truth) & (truth <= self.high)


def failures_of(outcomes: Iterable[TrialOutcome]) -> list[str]:
    """The reasons why fits failed, once each."""
    return sorted({note for one in outcomes for note in one.notes})


def share_interval(count: int, trials: int) -> tuple[float, float]:
    """The 95 % interval of a probability, by Clopper and Pearson, after `count` of so many trials."""
    low = scipy.special.betaincinv(count, trials - count + 1, 0.025) if count else 0.0
    high = scipy.special.betaincinv(count + 1, trials - count, 0.975) if count < trials else 1.0
    return float(low), float(high)


def plausible_shares(low: float, high: float, trials: int) -> tuple[float, float]:
    """The range of shares of so many trials where the probability is from `low` to `high`.

    By chance, one study in a thousand is outside either end.
    """
    ends = scipy.stats.binom.ppf([_CHANCE, 1 - _CHANCE], trials, [low, high]) / trials
    return float(ends[0]), float(ends[1])


def rms_interval(errors: Array) -> tuple[float, float]:
    """The 95 % interval of the root mean square of normal errors (n,), in their unit; NaN without errors."""
    n = len(errors)
    if n == 0:
        return np.nan, np.nan
    low, high = (rms(errors) * np.sqrt(n / scipy.special.chdtri(n, tail)) for tail in (0.025, 0.975))
    return float(low), float(high)


def sampling_error(count: int) -> float:
    """Relative standard error of a root mean square of so many normal errors, at least one."""
    return float(1 / np.sqrt(2 * count))
