"""The rows of a benchmark as summary.json has them: means over seeds, and the leaderboard."""

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from experiments.benchmark.cases import FACTORS
from experiments.common.sweep import Row
from sim.seeds import generator
from trackslip.kinematics import Array
from trackslip.metrics import LOST, Expense, TrackingErrors

MEASURES = (
    *(f.name for f in dataclasses.fields(TrackingErrors) if f.name != "success"),
    *(f.name for f in dataclasses.fields(Expense)),
    *("valid_fraction", "icr_offset", "icr_radius_error"),
)
"""Errors and expense of a run, as in `trackslip.metrics`; the share of the scans that gave a pose [-]; and what online
compensation found in the end: the longitudinal offset of the ICRs [m] and the error of the sprocket radius [-]."""
WITH_INTERVAL = ("rms_position", "rms_position_after_12s", "rms_position_arc", "rms_heading")
"""Measures whose means have 95 % bootstrap intervals."""
ENTRY = ("controller", "compensation", "start")
"""What an entry of the leaderboard is."""
_SETTING = FACTORS[:-1]  # all but the seed
_RESAMPLES = 2000


def score(run: Row) -> float:
    """What a run is ranked by [m]: its position error after the transient, or over the whole of a shorter run.

    It is LOST for a run that lost the path or failed.
    """
    if run["error"] is not None or not run["success"]:
        return LOST
    settled: float | None = run["rms_position_after_12s"]
    return run["rms_position"] if settled is None else settled


def case_row(run: Row) -> Row:
    """A run without its name, id and times."""
    measured = {name: run[name] for name in (*FACTORS, "error", *MEASURES, "success") if name in run}
    return measured | {"score": score(run)}


def over_seeds(runs: Sequence[Row]) -> list[Row]:
    """One row for the runs that differ only in their seeds, in order."""
    rows = []
    for group in _groups(runs, _SETTING):
        driven = [run for run in group if run["error"] is None]
        row = _summary(group, _SETTING) | {"seeds": len(group), "failed": len(group) - len(driven)}
        rows.append(row | {f"{name}_ci95": bootstrap95(_values(driven, name)) for name in WITH_INTERVAL})
    return rows


def board(runs: Sequence[Row]) -> list[Row]:
    """The leaderboard: an entry for each controller, compensation and start, in order of their mean scores.

    Entries are compared pair by pair: runs on the same plant and path, from the same start. `behind` is the mean of the
    differences from the best entry; `gain` is the mean score without compensation over the entry's. Both have 95 %
    intervals from 2000 bootstrap samples of the seeds, drawn for each path on its own; the grounds of a seed, which
    share plant, start and noise, stay together. Samples have a seed less than there are, so that their variance has no
    bias (J. N. K. Rao and C. F. J. Wu, JASA 83, 1988). Entries share a `rank` with the first one from which they can't
    be distinguished.
    """
    groups = sorted(_groups(runs, ENTRY), key=lambda group: np.mean([score(run) for run in group]))
    scores = np.array([[score(run) for run in sorted(group, key=_place)] for group in groups])  # (E, P)
    samples = _resampled(scores, [_place(run)[:2] for run in sorted(groups[0], key=_place)])  # (E, B)
    entries = [_summary(group, ENTRY) for group in groups]
    uncompensated = {
        (entry["controller"], entry["start"]): k for k, entry in enumerate(entries) if entry["compensation"] == "none"
    }
    leader = 0
    for k, entry in enumerate(entries):
        ahead = _interval95(samples[k] - samples[leader])
        if ahead is None or ahead[0] > 0:
            leader = k
        entry |= {"rank": leader + 1, "pairs": scores.shape[1], "score_ci95": _interval95(samples[k])}
        entry["behind"] = (scores[k] - scores[0]).mean()
        entry["behind_ci95"] = None if k == 0 else _interval95(samples[k] - samples[0])
        base = uncompensated.get((entry["controller"], entry["start"]), k)
        entry["gain"] = None if base == k else entries[base]["score"] / entry["score"]
        entry["gain_ci95"] = None if base == k else _interval95(samples[base] / samples[k])
    return entries


def _place(run: Row) -> tuple[str, int, str]:
    """What runs that are compared have in common."""
    return run["reference"], run["seed"], run["ground"]


def _resampled(scores: Array, seeds: Sequence[tuple[str, int]]) -> Array:
    """Means (E, B) of bootstrap samples of scores (E, P), by path and seed (P); B = 0 for a single seed."""
    rng = generator(0, "bootstrap over plants")
    paths: dict[str, dict[int, list[int]]] = {}
    for k, (path, seed) in enumerate(seeds):
        paths.setdefault(path, {}).setdefault(seed, []).append(k)
    drawn = []
    for by_seed in paths.values():
        columns = np.array(list(by_seed.values()))  # (seeds, grounds)
        count = len(columns) - 1
        if count == 0:
            return np.empty((len(scores), 0))
        drawn.append(columns[rng.integers(len(columns), size=(_RESAMPLES, count))].reshape(_RESAMPLES, -1))
    return np.array([row[np.concatenate(drawn, axis=1)].mean(axis=1) for row in scores])


def _interval95(samples: Array) -> list[float] | None:
    """The ends between which 95 % of samples (B,) are; None without samples."""
    return np.percentile(samples, [2.5, 97.5]).tolist() if samples.size else None


def bootstrap95(values: Sequence[float]) -> list[float] | None:
    """Percentile bootstrap interval of the mean over seeds; None for fewer than two values."""
    if len(values) < 2:
        return None
    drawn = generator(0, "bootstrap over seeds").integers(len(values), size=(_RESAMPLES, len(values) - 1))
    return _interval95(np.array(values)[drawn].mean(axis=1))


def _groups(rows: Iterable[Row], names: Sequence[str]) -> list[list[Row]]:
    """The rows with the same values of all of these columns, in order."""
    groups: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    return list(groups.values())


def _summary(group: Sequence[Row], names: Sequence[str]) -> Row:
    """The columns `names` that runs share, means of all measures, and times of steps.

    `success` is the share of the runs that stayed within 0.5 m of where they should be; a failed one did not.
    """
    driven = [run for run in group if run["error"] is None]
    times = [time for run in driven for time in run.get("compute_ms", ())]
    row: Row = {name: group[0][name] for name in names}
    row |= {name: float(np.mean(_values(driven, name))) if _values(driven, name) else None for name in MEASURES}
    row |= {f"compute_ms_p{q}": float(np.percentile(times, q)) if times else None for q in (50, 99)}
    row["score"] = float(np.mean([score(run) for run in group]))
    return row | {"success": sum(run["success"] for run in driven) / len(group)}


def _values(rows: Iterable[Row], name: str) -> list[float]:
    """The values of a column, without those that are None."""
    return [row[name] for row in rows if row.get(name) is not None]
