"""The leaderboard and the table of all rows, and the first as Markdown."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from experiments.benchmark.cases import FACTORS
from experiments.benchmark.rows import ENTRY
from experiments.common.formats import number
from experiments.common.manifest import relative
from experiments.common.sweep import Row
from experiments.common.table import Table

_NUMBERS = {  # header of a column: its name in a row, factor from SI, decimals
    "kept [%]": ("success", 100.0, 0),
    "error [mm]": ("score", 1e3, 1),
    "gain": ("gain", 1.0, 1),
    "turning [mm]": ("rms_position_arc", 1e3, 1),
    "heading [deg]": ("rms_heading", math.degrees(1), 2),
    "across [mm]": ("cross_track", 1e3, 1),
    "along [mm]": ("along_track", 1e3, 1),
    "max [mm]": ("max_position", 1e3, 1),
    "effort [rad²/s]": ("effort", 1.0, 0),
    "rough [rad/s²]": ("roughness", 1.0, 2),
    "step [ms]": ("compute_ms_p50", 1.0, 2),
}
BOARD_LEGEND = (
    "Entries of equal rank can't be distinguished from the first of them. Kept: runs that stayed within 0.5 m. Error:"
    " rms position error from 12 s on, 0.5 m for a run that lost the path. Gain: the error without compensation over"
    " this one. Behind: mean of the paired differences from the best entry, with a 95 % bootstrap interval. Turning:"
    " error while the reference turns. Rough: rms rate of change of the set points. Step: median computing time of a"
    " control step, compensation included."
)
"""What the columns of the leaderboard are."""


def board_table(entries: Sequence[Row]) -> Table:
    """The leaderboard."""
    names = ENTRY if len({entry["start"] for entry in entries}) > 1 else ENTRY[:2]
    before, after = ("kept [%]", "error [mm]", "gain"), ("turning [mm]", "heading [deg]", "rough [rad/s²]", "step [ms]")
    return Table(
        "Position errors, means over references, grounds and seeds",
        ("rank", *names, *before, "behind the best [mm]", *after),
        [
            [str(entry["rank"]), *_texts(entry, names), *_cells(entry, before), _behind(entry), *_cells(entry, after)]
            for entry in entries
        ],
        align=f"l{'l' * len(names)}r",
        note=BOARD_LEGEND,
    )


def all_rows_table(rows: Sequence[Row]) -> Table:
    """All rows."""
    names, numbers = FACTORS[:-1], [header for header in _NUMBERS if header != "gain"]
    return Table(
        "Means over seeds",
        (*names, *numbers),
        [[*_texts(row, names), *_cells(row, numbers)] for row in rows],
        align="lllllr",
        note="“across” and “along” are root mean squares relative to the reference's direction; effort is the integral"
        " of the mean square of both sprockets' set points. summary.json has 95 % intervals and every run.",
    )


def _texts(row: Row, names: Iterable[str]) -> list[str]:
    return [relative(row[name]) for name in names]


def _cells(row: Row, headers: Iterable[str]) -> list[str]:
    columns = [_NUMBERS[header] for header in headers]
    return [number(None if row[name] is None else factor * row[name], digits) for name, factor, digits in columns]


def _behind(entry: Row) -> str:
    """The difference from the best entry and its interval."""
    if entry["behind_ci95"] is None:
        return number(1e3 * entry["behind"] or None, 1)
    low, high = (round(1e3 * end, 1) + 0.0 for end in entry["behind_ci95"])  # no minus zero
    return f"{1e3 * entry['behind']:.1f} ({low:.1f} to {high:.1f})"


def leaderboard(entries: Sequence[Row], about: Mapping[str, Any]) -> str:
    """The leaderboard in Markdown; `about` is the manifest."""
    git, versions = about["git"] or {}, about["versions"]
    changed = " with uncommitted changes" if git.get("dirty") else ""
    installed = ", ".join(f"{name} {version}" for name, version in versions.items() if version)
    table = board_table(entries)
    bar = [":--" if side == "l" else "--:" for side in table.sides]
    lines = [f"| {' | '.join(line)} |" for line in (table.header, bar, *table.texts)]
    suite = f"Suite `{about['config']['suite']}`, commit {git.get('commit', 'unknown')}{changed}, {installed}."
    return "\n\n".join(["# Leaderboard", suite, "\n".join(lines), BOARD_LEGEND]) + "\n"
