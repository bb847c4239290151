"""The leaderboard and the table of all rows."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from experiments.benchmark.rows import BenchmarkRow, BoardEntry
from experiments.report.table import Cell, Table
from experiments.storage.manifest import relative

_FOLDED = 40  # rows from which a page shows the table of all only when asked
_Columns = dict[str, Callable[[Any], str | Cell]]  # their cells, by header


def _number(value: float | None, scale: float, digits: int) -> str:
    return "-" if value is None else f"{scale * value:.{digits}f}"


def _measure(name: str, scale: float = 1e3, digits: int = 1) -> Callable[[BoardEntry], str]:
    """The text of one of MEASURES, by default a length in mm."""
    return lambda row: _number(row.means[name], scale, digits)


def _with_interval(name: str) -> Callable[[BenchmarkRow], Cell]:
    """A length in mm, with the interval beside it or, on a page, below."""

    def cell(row: BenchmarkRow) -> Cell:
        mean, ends = _number(row.means[name], 1e3, 1), row.intervals[name]
        if ends is None:
            return Cell(mean)
        interval = f"[{1e3 * ends[0]:.1f}, {1e3 * ends[1]:.1f}]"
        return Cell(mean, f"{mean} {interval}", [interval])

    return cell


_NAMES: _Columns = {"controller": lambda row: relative(row.controller), "compensation": lambda row: row.compensation}
_PLACES: _Columns = {"reference": lambda row: relative(row.reference), "ground": lambda row: relative(row.ground)}
_KEPT: _Columns = {"start": lambda row: row.start, "kept [%]": lambda row: f"{100 * row.success:.0f}"}
_BOARD: _Columns = {
    **_NAMES,
    **_KEPT,
    "rms [mm]": _measure("rms_position"),
    "> 12 s [mm]": _measure("rms_position_after_12s"),
    "turning [mm]": _measure("rms_position_arc"),
    "max [mm]": _measure("max_position"),
    "end [mm]": _measure("final_position"),
    "heading [deg]": _measure("rms_heading", math.degrees(1), 2),
    "step [ms]": lambda row: _number(row.compute_ms_p50, 1, 2),
}
_ALL: _Columns = {
    **_NAMES,
    **_PLACES,
    **_KEPT,
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


def board_table(entries: Sequence[BoardEntry]) -> Table:
    """The leaderboard."""
    return Table(
        "Position errors, means over references, grounds and seeds",
        tuple(_BOARD),
        [[cell(entry) for cell in _BOARD.values()] for entry in entries],
        align="lllr",
        note="Sorted by how often the path was kept and then by the error from 12 s on. “turning”: while the reference"
        " turns. “step”: computing time per step of one robot, compensation included, median over the first ten"
        " seconds.",
    )


def whole_table(rows: Sequence[BenchmarkRow]) -> Table:
    """All rows."""
    return Table(
        "All rows: means over seeds [95 % bootstrap interval]",
        tuple(_ALL),
        [[cell(row) for cell in _ALL.values()] for row in rows],
        align="lllllr",
        note="Position errors are given over the whole run, from 12 s on and while the reference turns; “across” and"
        " “along” are root mean squares relative to the reference's direction. IAE and ITAE are the integrals of the"
        " position error and of time times the position error. Effort is the integral of the mean square of both"
        " sprockets' set points. “saturated” is the time with a motor at its limit or a sprocket at its top speed.",
        folded=len(rows) > _FOLDED,
    )


def leaderboard(entries: Sequence[BoardEntry], lost: Sequence[str], rows: Sequence[BenchmarkRow]) -> str:
    """The leaderboard, where paths are lost, and all rows, in Markdown."""
    where = ["## Where the path is lost\n", *(f"- {line}" for line in lost), ""] if lost else []
    return "\n".join(
        [
            "# Leaderboard\n",
            "Position errors are distances of the true position from where the reference is at the time; means over"
            " references, grounds and seeds. Kept: share of the runs that stayed within 0.5 m.\n",
            markdown(board_table(entries)),
            *where,
            "## All rows\n\nMeans over seeds [95 % bootstrap interval].\n",
            markdown(whole_table(rows)),
        ]
    )


def markdown(table: Table) -> str:
    """A table in Markdown."""
    bar = [":--" if side == "l" else "--:" for side in table.sides]
    lines = (table.header, bar, *table.texts)
    return "\n".join("| " + " | ".join(text.replace("|", "\\|") for text in line) + " |" for line in lines) + "\n"
