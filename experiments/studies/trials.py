"""The engine of Monte-Carlo studies: trials with random numbers of their own, stored as they finish, and statistics."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import scipy

from experiments.parallel import WorkersFailedError, processors, workers
from experiments.storage.manifest import digest, made_by
from experiments.storage.plain_json import plain
from sim.seeds import generator
from trackslip.kinematics import Array
from trackslip.metrics import rms

if TYPE_CHECKING:
    from experiments.run import Run
    from trackslip.identification.drive.estimate import DriveFit

FILE = ".trials.jsonl"
"""File in the folder of results with the trials that a killed study had finished."""
_CHANCE = 1e-3  # of a false alarm
_UNSAID = ("out", "threads", "pdf", "rrd")  # options that no trial depends on


@dataclass(frozen=True)
class Trial:
    """A repeat of a case."""

    case: str
    number: int = 0
    given: Any = field(default=None, compare=False)
    """What it starts from, such as a log, where that follows from the options."""


@dataclass(frozen=True)
class Estimate:
    """A parameter estimated in a trial, in its unit."""

    value: float
    stderr: float
    """By the model of the noise."""
    low: float
    high: float
    """The 95 % interval."""

    @staticmethod
    def of(fit: DriveFit) -> dict[str, Estimate]:
        """The estimates of all fitted parameters, of the law and others."""
        values = fit.values | fit.extras
        return {name: Estimate(values[name], error, *fit.interval95[name]) for name, error in fit.stderr.items()}


@dataclass(frozen=True)
class Outcome:
    """The result of a trial."""

    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    """Why something could not be estimated; without estimates, why the fit failed."""

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Self:
        """The outcome that was stored with `asdict`."""
        estimates = {name: Estimate(**one) for name, one in content["estimates"].items()}
        return cls(estimates, content["numbers"], tuple(content["notes"]))


Values = Mapping[str, float]  # by parameter
Do = Callable[[Trial, np.random.Generator], Outcome]


def run_trials(run: Run, do: Do, trials: Sequence[Trial], key: str, about: Any = None) -> dict[str, list[Outcome]]:
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


def _done(do: Do, seed: int, key: str, trial: Trial) -> tuple[Trial, Outcome]:
    rng = generator(seed, key.format(case=trial.case, number=trial.number))
    return Trial(trial.case, trial.number), do(trial, rng)


class _StoredTrials:
    """Finished trials in a file, one line of JSON each, below a line that says what they depend on."""

    def __init__(self, config: Any, about: Any) -> None:
        options = {name: value for name, value in plain(config).items() if name not in _UNSAID}
        self._title = digest([type(config).__module__, options, about, made_by()])
        self._file = Path(config.out) / FILE
        self.outcomes: dict[Trial, Outcome] = {}
        if self._file.exists():
            title, *lines = self._file.read_text(encoding="utf-8").split("\n")
            if title == self._title:
                self.outcomes = dict(_read(lines))
            else:
                self._file.unlink()

    def add(self, trial: Trial, outcome: Outcome) -> None:
        """Store a trial; a line that was cut short before is left as it is."""
        line = json.dumps([trial.case, trial.number, asdict(outcome)])
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(f"\n{line}" if stream.tell() else f"{self._title}\n{line}")


def _read(lines: Iterable[str]) -> Iterable[tuple[Trial, Outcome]]:
    """The trials in lines, without one that was cut short when the study was killed."""
    for line in lines:
        with contextlib.suppress(ValueError):
            case, number, outcome = json.loads(line)
            yield Trial(case, number), Outcome.from_json(outcome)


@dataclass(frozen=True)
class Coverage:
    """How often intervals contained the truth."""

    covered: int
    trials: int

    @property
    def share(self) -> float:
        """Covered over all [-]."""
        return self.covered / self.trials

    @property
    def interval95(self) -> tuple[float, float]:
        """The 95 % interval of the probability of covering, by Clopper and Pearson."""
        k, n = self.covered, self.trials
        low = scipy.special.betaincinv(k, n - k + 1, 0.025) if k else 0.0
        high = scipy.special.betaincinv(k + 1, n - k, 0.975) if k < n else 1.0
        return float(low), float(high)

    def to_json(self) -> dict[str, Any]:
        """The share and its interval."""
        return {"coverage": self.share, "coverage_interval95": self.interval95}


def plausible_shares(low: float, high: float, trials: int) -> tuple[float, float]:
    """The range of shares of so many trials where the probability is from `low` to `high`.

    By chance, one study in a thousand is outside either end.
    """
    ends = scipy.stats.binom.ppf([_CHANCE, 1 - _CHANCE], trials, [low, high]) / trials
    return float(ends[0]), float(ends[1])


@dataclass(frozen=True)
class Errors:
    """Errors of an estimate over trials, in its unit."""

    errors: Array  # (n,)

    @property
    def rms(self) -> float:
        """Root mean square; NaN without errors."""
        return rms(self.errors)

    @property
    def interval95(self) -> tuple[float, float]:
        """The 95 % interval of the root mean square, for normal errors."""
        n = len(self.errors)
        if n == 0:
            return np.nan, np.nan
        low, high = (self.rms * np.sqrt(n / scipy.special.chdtri(n, tail)) for tail in (0.025, 0.975))
        return float(low), float(high)

    def to_json(self) -> dict[str, Any]:
        """The root mean square and its interval."""
        return {"rms": self.rms, "rms_interval95": self.interval95}


@dataclass(frozen=True)
class Results:
    """The outcomes of a case against the truth."""

    outcomes: Sequence[Outcome]
    truths: Sequence[Values]
    """For each outcome, the values that its intervals must cover."""
    aim: Values | None = None
    """Values that errors are measured from, if not the truths."""

    @property
    def failures(self) -> list[str]:
        """Why fits failed, once each."""
        return sorted({note for one in self.outcomes for note in one.notes})

    def pairs(self, name: str) -> list[tuple[Estimate, float]]:
        """The estimates of a parameter, and the values that errors are measured from."""
        both = zip(self.outcomes, self.truths, strict=True)
        return [(one.estimates[name], (self.aim or truth)[name]) for one, truth in both if name in one.estimates]

    def errors(self, name: str) -> Errors:
        """Errors of a parameter."""
        return Errors(np.array([one.value - aim for one, aim in self.pairs(name)]))

    def coverage(self, name: str, truth: Values | None = None) -> Coverage:
        """How often the intervals of a parameter cover its own truth, or another; one not estimated covers nothing."""
        covered = 0
        for one, own in zip(self.outcomes, self.truths, strict=True):
            if name in one.estimates:
                covered += one.estimates[name].low <= (truth or own)[name] <= one.estimates[name].high
        return Coverage(covered, len(self.outcomes))


def sampling_error(count: int) -> float:
    """Relative standard error of a root mean square of so many normal errors, at least one."""
    return float(1 / np.sqrt(2 * count))
