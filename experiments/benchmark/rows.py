"""A benchmark's rows in summary.json: means over seeds, and the leaderboard."""

import dataclasses
from collections.abc import Iterable, Sequence
from operator import itemgetter
from typing import Final

import numpy as np

from experiments.benchmark.cases import FACTORS
from experiments.common.sweep import STEPS, Row
from sim.common.seeds import generator
from sim.runs.stopwatch import StepTimes
from trackslip.kinematics import Array
from trackslip.metrics import LOST, Expense, TrackingErrors

MEASURES: Final = (
    *(f.name for f in dataclasses.fields(TrackingErrors) if f.name != "success"),
    *(f.name for f in dataclasses.fields(Expense)),
    *("saturation", "valid_fraction", "icr_offset", "icr_radius_error"),
)
"""Errors and expense of a run, as in `trackslip.metrics`; the share of the time of `saturation_s`,
and of scans with a pose [-]; and final estimates of online compensation: offset D of the ICRs [m]
and relative error in the sprocket radius [-].
"""
SETTING: Final = FACTORS[:-1]
"""Columns that identify a mean over seeds: all factors but the seed."""
ENTRY: Final = ("controller", "compensation", "start")
"""Columns that identify an entry of the leaderboard."""
_PLACE: Final = itemgetter("reference", "seed", "ground")  # columns in which compared runs agree
_RESAMPLES: Final = 2000


def score(run: Row) -> float:
    """The score that ranks a run [m]: its position error after the transient, or LOST if it lost
    the path or failed.
    """
    kept = run["error"] is None and run["success"]
    return float(run["rms_position_after_12s"]) if kept else LOST


def step_times(runs: Sequence[Row]) -> dict[str, StepTimes]:
    """Computing times of the control steps by controller, in its slowest run with any
    compensation.
    """
    timed: dict[str, list[StepTimes]] = {}
    for run in runs:
        if STEPS in run:
            timed.setdefault(run["controller"], []).append(StepTimes(**run[STEPS]))
    return {name: StepTimes.slowest(times) for name, times in timed.items()}


def over_seeds(runs: Sequence[Row]) -> list[Row]:
    """Rows of means, each over the runs that differ only in their seeds, in order."""
    return [_means(group, SETTING) for group in _groups(runs, SETTING)]


def board(runs: Sequence[Row]) -> list[Row]:
    """The leaderboard: an entry for each controller, compensation and start, in order of their mean
    scores.

    Entries are compared by pairs of runs on the same plant and path from the same start. `behind`
    is the mean difference from the best entry; `gain` is the mean score without compensation
    divided by the entry's mean score. Both have 95 % intervals from 2000 bootstrap samples of the
    seeds, drawn separately for each path; runs on different grounds with the same seed, which share
    plant, start and noise, stay together. Each sample has one seed fewer than the benchmark, so
    that the variance is unbiased (J. N. K. Rao and C. F. J. Wu, JASA 83, 1988). The `rank` of an
    entry is that of the first entry from which it can't be distinguished.
    """
    groups = sorted(_groups(runs, ENTRY), key=_mean_score)
    entries = [_means(group, ENTRY) for group in groups]
    # (E, P), by path, seed and ground
    scores = np.array([[score(run) for run in sorted(group, key=_PLACE)] for group in groups])
    paths = len({run["reference"] for run in runs})
    seeds = len({run["seed"] for run in runs})
    over_grounds = scores.reshape(len(groups), paths, seeds, -1).mean(axis=-1)
    samples = _resampled(over_grounds)  # (E, B)
    uncompensated = {
        (entry["controller"], entry["start"]): k
        for k, entry in enumerate(entries)
        if entry["compensation"] == "none"
    }

    leader = 0
    for k, entry in enumerate(entries):
        ahead = _interval95(samples[k] - samples[leader])
        if ahead is None or ahead[0] > 0:
            leader = k
        entry["rank"] = leader + 1
        entry["score_ci95"] = _interval95(samples[k])
        entry["behind"] = (scores[k] - scores[0]).mean()
        entry["behind_ci95"] = None if k == 0 else _interval95(samples[k] - samples[0])
        base = uncompensated.get((entry["controller"], entry["start"]), k)
        entry["gain"] = None if base == k else entries[base]["score"] / entry["score"]
        entry["gain_ci95"] = None if base == k else _interval95(samples[base] / samples[k])
    return entries


def _resampled(scores: Array) -> Array:
    """Means (E, B) of bootstrap samples from scores (E, R, S) by entry, path and seed; B = 0 for a
    single seed.
    """
    entries, paths, seeds = scores.shape
    if seeds == 1:
        return np.empty((entries, 0))
    drawn = generator(0, "bootstrap over plants").integers(
        seeds, size=(paths, _RESAMPLES, seeds - 1)
    )
    means = [scores[:, path, drawn[path]].mean(axis=-1) for path in range(paths)]
    return np.mean(means, axis=0)


def _interval95(samples: Array) -> list[float] | None:
    """Ends of the interval that contains 95 % of the samples (B,); None without samples."""
    return np.percentile(samples, [2.5, 97.5]).tolist() if samples.size else None


def _groups(rows: Iterable[Row], names: Sequence[str]) -> list[list[Row]]:
    """Groups of rows that have the same values in all the columns `names`, in order."""
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return list(groups.values())


def _means(group: Sequence[Row], names: Sequence[str]) -> Row:
    """A row for a group of runs: the columns `names` that they share, counts, and means of measures
    (None if unknown).

    `success` is the share of runs that stayed within 0.5 m of the reference; failed runs count as
    unsuccessful.
    """
    row: Row = {name: group[0][name] for name in names}
    driven = [run for run in group if run["error"] is None]
    for name in MEASURES:
        values = [run[name] for run in driven if run.get(name) is not None]
        row[name] = float(np.mean(values)) if values else None
    row["seeds"] = len({run["seed"] for run in group})
    row["failed"] = len(group) - len(driven)
    row["score"] = _mean_score(group)
    row["success"] = sum(run["success"] for run in driven) / len(group)
    return row


def _mean_score(group: Sequence[Row]) -> float:
    return float(np.mean([score(run) for run in group]))
