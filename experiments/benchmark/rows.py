"""The rows of a benchmark as summary.json has them: means over seeds, the leaderboard, and where paths are lost."""

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from experiments.benchmark.cases import FACTORS
from experiments.storage.manifest import relative
from experiments.sweep.parts import Row
from sim.seeds import generator
from trackslip.metrics import Expense, TrackingErrors

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
    return {name: run[name] for name in (*FACTORS, "error", *MEASURES, "success") if name in run}


def over_seeds(runs: Sequence[Row]) -> list[Row]:
    """One row for the runs that differ only in their seeds, in order.

    `success` is the share of the runs that stayed within 0.5 m of where they should be; a failed one did not.
    """
    rows = []
    for same in _alike(runs, _SETTING):
        driven = [run for run in same if run["error"] is None]
        times = [time for run in driven for time in run.get("compute_ms", ())]
        p50, p99 = (float(np.percentile(times, percent)) if times else None for percent in (50, 99))
        row = {name: same[0][name] for name in _SETTING} | _means(driven)
        row |= {f"{name}_ci95": bootstrap95(_known(run.get(name) for run in driven)) for name in WITH_INTERVAL}
        row |= {"seeds": len(same), "failed": len(same) - len(driven), "compute_ms_p50": p50, "compute_ms_p99": p99}
        rows.append(row | {"success": sum(run["success"] for run in driven) / len(same)})
    return rows


def board(rows: Sequence[Row]) -> list[Row]:
    """The leaderboard, of means over references and grounds: entries that keep the path most often come first.

    Equals are ordered by the mean of the position error once the transient is over.
    """
    names = ("controller", "compensation", "start")
    entries = [
        {name: same[0][name] for name in names}
        | _means(same)
        | {name: _mean(row[name] for row in same) for name in ("success", "compute_ms_p50")}
        for same in _alike(rows, names)
    ]
    return sorted(entries, key=lambda entry: (-entry["success"], settled_error(entry)))


def settled_error(row: Row) -> float:
    """Position error once the transient is over, or that of a shorter run; infinite where there is none [m]."""
    known = _known((row["rms_position_after_12s"], row["rms_position"]))
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
    drawn = generator(0, "bootstrap over seeds").integers(len(values), size=(_RESAMPLES, len(values)))
    low, high = np.percentile(np.array(values)[drawn].mean(axis=1), [2.5, 97.5])
    return float(low), float(high)


def _alike(rows: Iterable[Row], names: Sequence[str]) -> list[list[Row]]:
    """The rows with the same values of all of these columns, in order."""
    found: dict[tuple[object, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in names), []).append(row)
    return list(found.values())


def _means(rows: Sequence[Row]) -> Row:
    """Means of all measures over the rows that have a value."""
    return {name: _mean(row.get(name) for row in rows) for name in MEASURES}


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _mean(values: Iterable[float | None]) -> float | None:
    known = _known(values)
    return float(np.mean(known)) if known else None
