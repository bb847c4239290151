"""The leaderboard and the table of all rows."""

import math
from collections.abc import Callable, Mapping, Sequence

from experiments.report.table import Cell, Table
from experiments.storage.manifest import relative
from experiments.sweep.parts import Row

_FOLDED = 40  # rows from which a page shows the table of all only when asked
_Columns = Mapping[str, Callable[[Row], str | Cell]]  # their cells, by header


def _name(factor: str) -> Callable[[Row], str]:
    return lambda row: relative(row[factor])


def _number(name: str, scale: float = 1.0, digits: int = 2) -> Callable[[Row], str]:
    return lambda row: "-" if row[name] is None else f"{scale * row[name]:.{digits}f}"


def _mm(name: str) -> Callable[[Row], str]:
    return _number(name, 1e3, 1)


def _with_interval(name: str) -> Callable[[Row], Cell]:
    """A length in mm, followed by its interval, which a page shows below it."""

    def cell(row: Row) -> Cell:
        mean, ends = _mm(name)(row), row[f"{name}_ci95"]
        if ends is None:
            return Cell(mean)
        interval = f"[{1e3 * ends[0]:.1f}, {1e3 * ends[1]:.1f}]"
        return Cell(mean, f"{mean} {interval}", [interval])

    return cell


_BOARD: _Columns = {
    "controller": _name("controller"),
    "compensation": _name("compensation"),
    "start": _name("start"),
    "kept [%]": _number("success", 100, 0),
    "rms [mm]": _mm("rms_position"),
    "> 12 s [mm]": _mm("rms_position_after_12s"),
    "turning [mm]": _mm("rms_position_arc"),
    "max [mm]": _mm("max_position"),
    "end [mm]": _mm("final_position"),
    "heading [deg]": _number("rms_heading", math.degrees(1)),
    "step [ms]": _number("compute_ms_p50"),
}
_ALL: _Columns = {
    "controller": _name("controller"),
    "compensation": _name("compensation"),
    "reference": _name("reference"),
    "ground": _name("ground"),
    "start": _name("start"),
    "kept [%]": _BOARD["kept [%]"],
    "failed": lambda row: f"{row['failed']} of {row['seeds']}",
    "rms [mm]": _with_interval("rms_position"),
    "> 12 s [mm]": _with_interval("rms_position_after_12s"),
    "turning [mm]": _with_interval("rms_position_arc"),
    "heading [deg]": _BOARD["heading [deg]"],
    "across [mm]": _mm("cross_track"),
    "along [mm]": _mm("along_track"),
    "max [mm]": _BOARD["max [mm]"],
    "end [mm]": _BOARD["end [mm]"],
    "IAE [m s]": _number("iae", 1, 3),
    "ITAE [m s²]": _number("itae"),
    "effort [rad²/s]": _number("effort", 1, 0),
    "saturated [s]": _number("saturation_s"),
    "poses valid [%]": _number("valid_fraction", 100, 1),
    "step p50 | p99 [ms]": lambda row: f"{_number('compute_ms_p50')(row)} | {_number('compute_ms_p99')(row)}",
}


BOARD_LEGEND = (
    "kept: share of the runs that stayed within 0.5 m; turning: error while the reference turns; "
    "step: median time to compute a control step, compensation included"
)
"""What the columns of the leaderboard are, for the terminal."""


def board_table(entries: Sequence[Row]) -> Table:
    """The leaderboard."""
    return Table(
        "Position errors, means over references, grounds and seeds",
        tuple(_BOARD),
        [[cell(entry) for cell in _BOARD.values()] for entry in entries],
        align="lllr",
        note="Sorted by how often the path was kept, then by the error from 12 s on. “turning”: while the reference"
        " turns. “step”: median computing time per step of one robot, compensation included.",
    )


def whole_table(rows: Sequence[Row]) -> Table:
    """All rows."""
    return Table(
        "All rows: means over seeds [95 % bootstrap interval]",
        tuple(_ALL),
        [[cell(row) for cell in _ALL.values()] for row in rows],
        align="lllllr",
        note="“across” and “along” are root mean squares relative to the reference's direction. IAE and ITAE are the"
        " integrals of the position error and of time times the position error; effort is the integral of the mean"
        " square of both sprockets' set points. “saturated”: time with a motor or a sprocket at its limit.",
        folded=len(rows) > _FOLDED,
    )


def leaderboard(entries: Sequence[Row], lost: Sequence[str], rows: Sequence[Row]) -> str:
    """The leaderboard, where paths are lost, and all rows, in Markdown."""
    return "\n".join(
        [
            "# Leaderboard\n",
            "Position errors are distances of the true position from where the reference is at the time; means over"
            " references, grounds and seeds. Kept: share of the runs that stayed within 0.5 m.\n",
            markdown(board_table(entries)),
            "## Where the path is lost\n",
            *(f"- {line}" for line in lost),
            "\n## All rows\n\nMeans over seeds [95 % bootstrap interval].\n",
            markdown(whole_table(rows)),
        ]
    )


def markdown(table: Table) -> str:
    """A table in Markdown."""
    bar = [":--" if side == "l" else "--:" for side in table.sides]
    lines = (table.header, bar, *table.texts)
    return "\n".join("| " + " | ".join(text.replace("|", "\\|") for text in line) + " |" for line in lines) + "\n"
