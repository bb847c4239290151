"""From runs to rows: means over seeds with their intervals, and the leaderboard as text."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sim.seeds import generator

NAMES = ("controller", "compensation", "reference", "ground", "start")
_WITH_INTERVAL = ("rms_position", "rms_position_after_12s", "rms_position_arc", "rms_heading")
_MEANS = (
    *_WITH_INTERVAL,
    *("cross_track", "along_track", "max_position", "final_position", "final_heading", "iae", "itae"),
    *("effort", "roughness", "saturation_s", "valid_fraction", "icr_offset", "icr_radius_error"),
)
_RESAMPLES = 2000
_RANKED = ("controller", "compensation", "start")

Row = Mapping[str, Any]


def over_seeds(runs: Sequence[Row]) -> list[dict[str, Any]]:
    """A row for each of the runs that differ in their seeds only, in order: means, and 95 % intervals of the first."""
    found: dict[tuple[str, ...], list[Row]] = {}
    for run in runs:
        found.setdefault(tuple(run[name] for name in NAMES), []).append(run)
    return [_row(dict(zip(NAMES, names, strict=True)), same) for names, same in found.items()]


def _row(names: Mapping[str, str], runs: Sequence[Row]) -> dict[str, Any]:
    row: dict[str, Any] = dict(names) | {"seeds": len(runs), "failed": sum(run["error"] is not None for run in runs)}
    for key in _MEANS:
        values = [float(run[key]) for run in runs if run.get(key) is not None]
        row[key] = float(np.mean(values)) if values else None
        if key in _WITH_INTERVAL:
            row[f"{key}_ci95"] = bootstrap95(values)
    row["success"] = float(np.mean([bool(run.get("success")) for run in runs]))
    times = [time for run in runs for time in run["compute_ms"]]
    for name, percent in (("p50", 50), ("p99", 99)):
        row[f"compute_ms_{name}"] = float(np.percentile(times, percent)) if times else None
    return row


def bootstrap95(values: Sequence[float]) -> list[float] | None:
    """Percentile bootstrap interval of the mean over seeds; None of fewer than two."""
    if len(values) < 2:
        return None
    drawn = generator(0, "bootstrap over seeds").integers(len(values), size=(_RESAMPLES, len(values)))
    low, high = np.percentile(np.array(values)[drawn].mean(axis=1), [2.5, 97.5])
    return [float(low), float(high)]


def board(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The leaderboard: controllers with compensations over references and grounds, those that keep the path on top.

    Equals are ordered by the mean of the position error once the transient is over.
    """
    found: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        found.setdefault(tuple(row[name] for name in _RANKED), []).append(row)
    entries = []
    for names, same in found.items():
        entry: dict[str, Any] = dict(zip(_RANKED, names, strict=True)) | {"rows": len(same)}
        for key in (*_MEANS, "compute_ms_p50", "compute_ms_p99"):
            values = [row[key] for row in same if row[key] is not None]
            entry[key] = float(np.mean(values)) if values else None
        entry["success"] = float(np.mean([row["success"] for row in same]))
        entries.append(entry)
    return sorted(entries, key=lambda entry: (-entry["success"], _settled(entry)))


def _settled(row: Row) -> float:
    """By what rows are ordered."""
    for key in ("rms_position_after_12s", "rms_position"):
        if row[key] is not None:
            return float(row[key])
    return math.inf


def losses(rows: Sequence[Row]) -> list[str]:
    """In a line for each controller, compensation and ground: how many runs lost the path, or failed, and where."""
    found: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        found.setdefault((row["controller"], row["compensation"], row["ground"]), []).append(row)
    lines = []
    for (controller, compensation, ground), same in found.items():
        runs = sum(row["seeds"] for row in same)
        lost = sum(round((1 - row["success"]) * row["seeds"]) for row in same)
        if lost:
            failed = sum(row["failed"] for row in same)
            where = ", ".join(dict.fromkeys(row["reference"] for row in same if row["success"] < 1))
            crashed = f", {failed} of them failed" if failed else ""
            who = f"{controller} with {compensation} on {ground}"
            lines.append(f"{who} loses the path in {lost} of {runs} runs{crashed}: {where}")
    if len(lines) < len(found):
        lines.append("all others keep the path in every run" if lines else "every run keeps the path")
    return lines


_Format = Callable[[Row], str]


def _mm(key: str) -> _Format:
    return lambda row: _number(row[key], 1e3, 1)


def _number(value: float | None, scale: float, digits: int) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}"


def _interval(key: str) -> _Format:
    def text(row: Row) -> str:
        ends = row.get(f"{key}_ci95")
        return _number(row[key], 1e3, 1) + ("" if ends is None else f" [{1e3 * ends[0]:.1f}, {1e3 * ends[1]:.1f}]")

    return text


_BOARD: dict[str, _Format] = {
    "controller": lambda row: row["controller"],
    "compensation": lambda row: row["compensation"],
    "start": lambda row: row["start"],
    "kept [%]": lambda row: f"{100 * row['success']:.0f}",
    "rms [mm]": _mm("rms_position"),
    "> 12 s [mm]": _mm("rms_position_after_12s"),
    "turning [mm]": _mm("rms_position_arc"),
    "max [mm]": _mm("max_position"),
    "end [mm]": _mm("final_position"),
    "heading [deg]": lambda row: _number(row["rms_heading"], math.degrees(1), 2),
    "step [ms]": lambda row: _number(row["compute_ms_p50"], 1, 2),
}
_WHOLE: dict[str, _Format] = {
    **{name: (lambda row, name=name: str(row[name])) for name in NAMES},  # type: ignore[misc]
    "kept [%]": _BOARD["kept [%]"],
    "failed": lambda row: f"{row['failed']} of {row['seeds']}",
    "rms [mm]": _interval("rms_position"),
    "> 12 s [mm]": _interval("rms_position_after_12s"),
    "turning [mm]": _interval("rms_position_arc"),
    "heading [deg]": _BOARD["heading [deg]"],
    "across [mm]": _mm("cross_track"),
    "along [mm]": _mm("along_track"),
    "max [mm]": _BOARD["max [mm]"],
    "end [mm]": _BOARD["end [mm]"],
    "IAE [m s]": lambda row: _number(row["iae"], 1, 3),
    "ITAE [m s²]": lambda row: _number(row["itae"], 1, 2),
    "effort [rad²/s]": lambda row: _number(row["effort"], 1, 0),
    "saturated [s]": lambda row: _number(row["saturation_s"], 1, 2),
    "poses valid [%]": lambda row: _number(row["valid_fraction"], 100, 1),
    "step p50 | p99 [ms]": lambda row: (
        f"{_number(row['compute_ms_p50'], 1, 2)} | {_number(row['compute_ms_p99'], 1, 2)}"
    ),
}
BOARD_HEADER, WHOLE_HEADER = tuple(_BOARD), tuple(_WHOLE)


def board_text(entries: Sequence[Row]) -> list[tuple[str, ...]]:
    """The leaderboard's cells, under BOARD_HEADER."""
    return [tuple(cell(entry) for cell in _BOARD.values()) for entry in entries]


def whole_text(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """The cells of all rows, under WHOLE_HEADER."""
    return [tuple(cell(row) for cell in _WHOLE.values()) for row in rows]


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; names to the left, numbers to the right."""
    bar = [":--" if name in NAMES else "--:" for name in header]
    lines = (header, bar, *rows)
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"
