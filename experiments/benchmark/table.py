"""The leaderboard and the table of all rows, as text."""

import math
from collections.abc import Callable, Mapping, Sequence

from experiments.benchmark.rows import BenchmarkRow, BoardEntry
from experiments.storage.manifest import relative

_TEXT_COLUMNS = ("controller", "compensation", "reference", "ground", "start")


def _number(value: float | None, scale: float, digits: int) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}"


def _measure(name: str, scale: float = 1e3, digits: int = 1) -> Callable[[BoardEntry], str]:
    """The text of one of `Measures`, by default a length in mm."""
    return lambda row: _number(getattr(row.means, name), scale, digits)


def _with_interval(name: str) -> Callable[[BenchmarkRow], str]:
    def text(row: BenchmarkRow) -> str:
        ends = row.intervals[name]
        interval = "" if ends is None else f" [{1e3 * ends[0]:.1f}, {1e3 * ends[1]:.1f}]"
        return _number(getattr(row.means, name), 1e3, 1) + interval

    return text


_FIRST: Mapping[str, Callable[[BoardEntry], str]] = {
    "controller": lambda row: relative(row.controller),
    "compensation": lambda row: row.compensation,
}
_START: Mapping[str, Callable[[BoardEntry], str]] = {
    "start": lambda row: row.start,
    "kept [%]": lambda row: f"{100 * row.success:.0f}",
}
_BOARD: Mapping[str, Callable[[BoardEntry], str]] = {
    **_FIRST,
    **_START,
    "rms [mm]": _measure("rms_position"),
    "> 12 s [mm]": _measure("rms_position_after_12s"),
    "turning [mm]": _measure("rms_position_arc"),
    "max [mm]": _measure("max_position"),
    "end [mm]": _measure("final_position"),
    "heading [deg]": _measure("rms_heading", math.degrees(1), 2),
    "step [ms]": lambda row: _number(row.compute_ms_p50, 1, 2),
}
_WHOLE: Mapping[str, Callable[[BenchmarkRow], str]] = {
    **_FIRST,
    "reference": lambda row: relative(row.reference),
    "ground": lambda row: relative(row.ground),
    **_START,
    "failed": lambda row: f"{row.failed} of {row.seeds}",
    "rms [mm]": _with_interval("rms_position"),
    "> 12 s [mm]": _with_interval("rms_position_after_12s"),
    "turning [mm]": _with_interval("rms_position_arc"),
    "heading [deg]": _BOARD["heading [deg]"],
    "across [mm]": _measure("cross_track"),
    "along [mm]": _measure("along_track"),
    "max [mm]": _BOARD["max [mm]"],
    "end [mm]": _BOARD["end [mm]"],
    "IAE [m s]": _measure("iae", 1, 3),
    "ITAE [m s²]": _measure("itae", 1, 2),
    "effort [rad²/s]": _measure("effort", 1, 0),
    "saturated [s]": _measure("saturation_s", 1, 2),
    "poses valid [%]": _measure("valid_fraction", 100),
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
    where = ["## Where the path is lost\n", *(f"- {line}" for line in lost), ""] if lost else []
    return "\n".join(
        [
            "# Leaderboard\n",
            "Position errors are distances of the true position from where the reference is at the time; means over"
            " references, grounds and seeds. Kept: share of the runs that stayed within 0.5 m.\n",
            markdown(BOARD_HEADER, board_text(entries)),
            *where,
            "## All rows\n\nMeans over seeds [95 % bootstrap interval].\n",
            markdown(WHOLE_HEADER, whole_text(rows)),
        ]
    )


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; names to the left, numbers to the right."""
    bar = [":--" if name in _TEXT_COLUMNS else "--:" for name in header]
    lines = (header, bar, *rows)
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines) + "\n"
