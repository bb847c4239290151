"""The leaderboard and the table of all rows, as text."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from experiments.benchmark.rows import BenchmarkRow, BoardEntry, Measures
from experiments.storage.manifest import relative

_TEXT_COLUMNS = ("controller", "compensation", "reference", "ground", "start")
_Row = BenchmarkRow | BoardEntry
_Cell = Callable[[_Row], str]
_WholeCell = Callable[[BenchmarkRow], str]


def _measure(measure: Callable[[Measures], float | None], scale: float, digits: int) -> _Cell:
    return lambda row: _number(measure(row.means), scale, digits)


def _number(value: float | None, scale: float, digits: int) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}"


def _with_interval(name: str) -> _WholeCell:
    def text(row: BenchmarkRow) -> str:
        ends = row.intervals[name]
        interval = "" if ends is None else f" [{1e3 * ends[0]:.1f}, {1e3 * ends[1]:.1f}]"
        return _number(getattr(row.means, name), 1e3, 1) + interval

    return text


_KEPT: _Cell = lambda row: f"{100 * row.success:.0f}"  # noqa: E731
_HEADING = _measure(lambda means: means.rms_heading, math.degrees(1), 2)
_MAX, _END = (_measure(lambda m: m.max_position, 1e3, 1), _measure(lambda m: m.final_position, 1e3, 1))
_BOARD: Mapping[str, Callable[[BoardEntry], str]] = {
    "controller": lambda row: relative(row.controller),
    "compensation": lambda row: row.compensation,
    "start": lambda row: row.start,
    "kept [%]": _KEPT,
    "rms [mm]": _measure(lambda means: means.rms_position, 1e3, 1),
    "> 12 s [mm]": _measure(lambda means: means.rms_position_after_12s, 1e3, 1),
    "turning [mm]": _measure(lambda means: means.rms_position_arc, 1e3, 1),
    "max [mm]": _MAX,
    "end [mm]": _END,
    "heading [deg]": _HEADING,
    "step [ms]": lambda row: _number(row.compute_ms_p50, 1, 2),
}
_WHOLE: Mapping[str, _WholeCell] = {
    "controller": lambda row: relative(row.controller),
    "compensation": lambda row: row.compensation,
    "reference": lambda row: relative(row.reference),
    "ground": lambda row: relative(row.ground),
    "start": lambda row: row.start,
    "kept [%]": _KEPT,
    "failed": lambda row: f"{row.failed} of {row.seeds}",
    "rms [mm]": _with_interval("rms_position"),
    "> 12 s [mm]": _with_interval("rms_position_after_12s"),
    "turning [mm]": _with_interval("rms_position_arc"),
    "heading [deg]": _HEADING,
    "across [mm]": _measure(lambda means: means.cross_track, 1e3, 1),
    "along [mm]": _measure(lambda means: means.along_track, 1e3, 1),
    "max [mm]": _MAX,
    "end [mm]": _END,
    "IAE [m s]": _measure(lambda means: means.iae, 1, 3),
    "ITAE [m s²]": _measure(lambda means: means.itae, 1, 2),
    "effort [rad²/s]": _measure(lambda means: means.effort, 1, 0),
    "saturated [s]": _measure(lambda means: means.saturation_s, 1, 2),
    "poses valid [%]": _measure(lambda means: means.valid_fraction, 100, 1),
    "step p50 | p99 [ms]": lambda row: f"{_number(row.compute_ms_p50, 1, 2)} | {_number(row.compute_ms_p99, 1, 2)}",
}
BOARD_HEADER, WHOLE_HEADER = tuple(_BOARD), tuple(_WHOLE)


def board_text(entries: Sequence[BoardEntry]) -> list[tuple[str, ...]]:
    """The cells of the leaderboard, under BOARD_HEADER."""
    return [tuple(cell(entry) for cell in _BOARD.values()) for entry in entries]


def whole_text(rows: Sequence[BenchmarkRow]) -> list[tuple[str, ...]]:
    """The cells of all rows, under WHOLE_HEADER."""
    return [tuple(cell(row) for cell in _WHOLE.values()) for row in rows]


def leaderboard(entries: Sequence[BoardEntry], lost: Sequence[str], rows: Sequence[BenchmarkRow]) -> str:
    """The leaderboard, where paths are lost, and all rows, in Markdown."""
    return "\n".join(
        [
            "# Leaderboard",
            "",
            "Position errors are distances of the true position from where the reference is at the time; means over"
            " references, grounds and seeds. Kept: share of the runs that stayed within 0.5 m.",
            "",
            markdown(BOARD_HEADER, board_text(entries)),
            *([] if not lost else ["## Where the path is lost", "", *(f"- {line}" for line in lost), ""]),
            "## All rows",
            "",
            "Means over seeds [95 % bootstrap interval].",
            "",
            markdown(WHOLE_HEADER, whole_text(rows)),
        ]
    )


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; names to the left, numbers to the right."""
    bar = [":--" if name in _TEXT_COLUMNS else "--:" for name in header]
    lines = (header, bar, *rows)
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"
