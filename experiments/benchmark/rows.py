"""The rows of a benchmark as summary.json has them: means over seeds, the leaderboard, and where paths are lost."""

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from experiments.benchmark.cases import FACTORS
from experiments.common.manifest import relative
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
_SETTING = FACTORS[:-1]  # all but the seed
_RESAMPLES = 2000


def case_row(run: Row) -> Row:
    """A run without its name, id and times."""
    measured = {name: run[name] for name in (*FACTORS, "error", *MEASURES, "success") if name in run}
    return measured | {"score": score(run)}


def over_seeds(runs: Sequence[Row]) -> list[Row]:
    """One row for the runs that differ only in their seeds, in order.

    `success` is the share of the runs that stayed within 0.5 m of where they should be; a failed one did not.
    """
    rows = []
    for same in _alike(runs, _SETTING):
        driven = [run for run in same if run["error"] is None]
        row = _summary(same, _SETTING) | {"seeds": len(same), "failed": len(same) - len(driven)}
        rows.append(row | {f"{name}_ci95": bootstrap95(_known(driven, name)) for name in WITH_INTERVAL})
    return rows


def score(run: Row) -> float:
    """What a run is ranked by: its position error after the transient; LOST if it lost the path or failed [m]."""
    return min(settled_error(run), LOST) if run["error"] is None and run["success"] else LOST


def board(runs: Sequence[Row]) -> list[Row]:
    """The leaderboard: an entry for each controller, compensation and start, in order of their mean scores.

    Entries are compared pair by pair: runs on the same plant and path, from the same start. `behind` is the mean of the
    differences from the best entry, with a 95 % interval from 2000 bootstrap samples of the seeds, drawn for each path
    on its own; the grounds of a seed, which share plant, start and noise, stay together. Samples have a seed less than
    there are, so that their variance has no bias (J. N. K. Rao and C. F. J. Wu, JASA 83, 1988). Entries share a `rank`
    with the first one from which they can't be distinguished.
    """
    names = ("controller", "compensation", "start")
    alike = sorted(_alike(runs, names), key=lambda same: np.mean([score(run) for run in same]))
    scores = np.array([[score(run) for run in sorted(same, key=_place)] for same in alike])  # (E, P)
    means = _resampled(scores, [_place(run)[:2] for run in sorted(alike[0], key=_place)])  # (E, B)
    entries: list[Row] = []
    leader = 0
    for k, same in enumerate(alike):
        ahead = None if means is None else np.percentile(means[k] - means[leader], 2.5)
        if ahead is None or ahead > 0:
            leader = k
        entry = _summary(same, names) | {"rank": leader + 1, "score": float(scores[k].mean())}
        entry |= {"behind": float((scores[k] - scores[0]).mean()), "pairs": scores.shape[1]}
        ends = None if means is None or k == 0 else np.percentile(means[k] - means[0], [2.5, 97.5])
        entries.append(entry | {"behind_ci95": None if ends is None else ends.tolist()})
    return entries


def _place(run: Row) -> tuple[str, int, str]:
    """What runs that are compared have in common."""
    return run["reference"], run["seed"], run["ground"]


def _resampled(scores: Array, seeds: Sequence[tuple[str, int]]) -> Array | None:
    """Means (E, B) of bootstrap samples of scores (E, P), by path and seed (P); None for a single seed."""
    rng = generator(0, "bootstrap over plants")
    paths: dict[str, dict[int, list[int]]] = {}
    for k, (path, seed) in enumerate(seeds):
        paths.setdefault(path, {}).setdefault(seed, []).append(k)
    parts = [np.array(list(by_seed.values())) for by_seed in paths.values()]  # (S, G) each
    if min(map(len, parts)) < 2:
        return None
    drawn = [part[rng.integers(len(part), size=(_RESAMPLES, len(part) - 1))].reshape(_RESAMPLES, -1) for part in parts]
    return np.array([one[np.concatenate(drawn, axis=1)].mean(axis=1) for one in scores])


def settled_error(row: Row) -> float:
    """Position error once the transient is over, or that of a shorter run; infinite where there is none [m]."""
    known = [value for name in ("rms_position_after_12s", "rms_position") for value in _known([row], name)]
    return known[0] if known else float("inf")


def losses(rows: Sequence[Row]) -> list[str]:
    """One line for each controller, compensation and ground: how many runs lost the path, or failed, and where."""
    found = _alike(rows, ("controller", "compensation", "ground"))
    lines = []
    for same in found:
        runs, failed = (sum(row[name] for row in same) for name in ("seeds", "failed"))
        lost = sum(round((1 - row["success"]) * row["seeds"]) for row in same)
        if lost:
            controller, ground = relative(same[0]["controller"]), relative(same[0]["ground"])
            where = ", ".join(dict.fromkeys(relative(row["reference"]) for row in same if row["success"] < 1))
            lines.append(
                f"{controller} with {same[0]['compensation']} on {ground} loses the path in {lost} of {runs} runs"
                f"{f', {failed} of them failed' if failed else ''}: {where}"
            )
    if len(lines) < len(found):
        lines.append("all others keep the path in every run" if lines else "every run keeps the path")
    return lines


def bootstrap95(values: Sequence[float]) -> tuple[float, float] | None:
    """Percentile bootstrap interval of the mean over seeds; None for fewer than two values."""
    if len(values) < 2:
        return None
    drawn = generator(0, "bootstrap over seeds").integers(len(values), size=(_RESAMPLES, len(values) - 1))
    low, high = np.percentile(np.array(values)[drawn].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)


def _alike(rows: Iterable[Row], names: Sequence[str]) -> list[list[Row]]:
    """The rows with the same values of all of these columns, in order."""
    found: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in names), []).append(row)
    return list(found.values())


def _summary(same: Sequence[Row], names: Sequence[str]) -> Row:
    """The columns `names` that runs share, means of all measures, times of steps, and the share that kept the path."""
    driven = [run for run in same if run["error"] is None]
    known = {name: _known(driven, name) for name in MEASURES}
    times = [time for run in driven for time in run.get("compute_ms", ())]
    row: Row = {name: same[0][name] for name in names}
    row |= {name: float(np.mean(values)) if values else None for name, values in known.items()}
    row |= {f"compute_ms_p{q}": float(np.percentile(times, q)) if times else None for q in (50, 99)}
    return row | {"success": sum(run["success"] for run in driven) / len(same)}


def _known(rows: Iterable[Row], name: str) -> list[float]:
    return [row[name] for row in rows if row.get(name) is not None]
