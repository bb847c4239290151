"""The leaderboard and the table of all rows."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from experiments.common.manifest import relative
from experiments.common.sweep import Row
from experiments.common.table import Cell, Table

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


def _behind(row: Row) -> str:
    """The difference from the best entry and its interval."""
    ends = row["behind_ci95"]
    interval = "" if ends is None else " ({:.1f} to {:.1f})".format(*(round(1e3 * end, 1) + 0.0 for end in ends))
    return f"{1e3 * row['behind']:.1f}{interval}" if row["rank"] > 1 or row["behind"] > 0 else "-"


_BOARD: _Columns = {
    "rank": lambda row: str(row["rank"]),
    "controller": _name("controller"),
    "compensation": _name("compensation"),
    "start": _name("start"),
    "kept [%]": _number("success", 100, 0),
    "error [mm]": _mm("score"),
    "behind the best [mm]": _behind,
    "turning [mm]": _mm("rms_position_arc"),
    "heading [deg]": _number("rms_heading", math.degrees(1)),
    "rough [rad/s²]": _number("roughness"),
    "effort [rad²/s]": _number("effort", 1, 0),
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
    "max [mm]": _mm("max_position"),
    "end [mm]": _mm("final_position"),
    "IAE [m s]": _number("iae", 1, 3),
    "ITAE [m s²]": _number("itae"),
    "effort [rad²/s]": _BOARD["effort [rad²/s]"],
    "rough [rad/s²]": _BOARD["rough [rad/s²]"],
    "saturated [s]": _number("saturation_s"),
    "poses valid [%]": _number("valid_fraction", 100, 1),
    "step p50 | p99 [ms]": lambda row: f"{_number('compute_ms_p50')(row)} | {_number('compute_ms_p99')(row)}",
}


BOARD_LEGEND = (
    "Entries of equal rank can't be distinguished from the first of them. Kept: runs that stayed within 0.5 m. Error:"
    " rms position error from 12 s on, 0.5 m for a run that lost the path. Behind: mean of the paired differences from"
    " the best entry, with a 95 % bootstrap interval. Turning: error while the reference turns. Rough: rms rate of"
    " change of the set points. Step: median computing time of a control step, compensation included."
)
"""What the columns of the leaderboard are."""


def board_table(entries: Sequence[Row]) -> Table:
    """The leaderboard."""
    several = len({entry["start"] for entry in entries}) > 1
    columns = {header: cell for header, cell in _BOARD.items() if several or header != "start"}
    return Table(
        "Position errors, means over references, grounds and seeds",
        tuple(columns),
        [[cell(entry) for cell in columns.values()] for entry in entries],
        align="lll" + "l" * several + "r",
        note=BOARD_LEGEND,
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


def leaderboard(entries: Sequence[Row], lost: Sequence[str], rows: Sequence[Row], about: Mapping[str, Any]) -> str:
    """The leaderboard, where paths are lost, and all rows, in Markdown; `about` is the manifest."""
    git, versions = about["git"] or {}, about["versions"]
    return "\n".join(
        [
            "# Leaderboard\n",
            f"Suite `{about['config']['suite']}`, commit {git.get('commit', 'unknown')}"
            f"{' with uncommitted changes' if git.get('dirty') else ''},"
            f" {', '.join(f'{name} {version}' for name, version in versions.items() if version)}.\n",
            markdown(board_table(entries)),
            f"{BOARD_LEGEND}\n",
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
