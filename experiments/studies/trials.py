"""Independent trials, stored as they finish."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.common.manifest import digest, made_by
from experiments.common.plain_json import plain
from experiments.common.pool import WorkersFailedError, processors, workers
from sim.seeds import generator

if TYPE_CHECKING:
    from experiments.common.run import Run

FILE = ".trials.jsonl"
"""File in the folder of results with the trials that a killed study had finished."""
_UNSAID = ("out", "overwrite", "threads", "pdf", "rrd")  # options that no trial depends on


@dataclass(frozen=True)
class Trial:
    """A repeat of a case."""

    case: str
    number: int = 0
    given: Any = field(default=None, compare=False)
    """Its input, such as a log, where it follows from the options."""


@dataclass(frozen=True)
class TrialOutcome:
    """The result of a trial."""

    numbers: Mapping[str, Any] = field(default_factory=dict)
    """Numbers by name, or groups of them."""


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
            yield Trial(case, number), TrialOutcome(**outcome)
