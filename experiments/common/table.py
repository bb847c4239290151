"""Tables for the terminal and for pages, and the format of printed numbers."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table as RichTable

from experiments.common.streams import printable
from trackslip.kinematics import Array
from trackslip.views.numbers import MISSING as MISSING
from trackslip.views.numbers import number as number


def significant(value: float | None, unit: str = "", digits: int = 2) -> str:
    """Format a number with `digits` significant digits, never in exponential notation, and its
    unit.
    """
    if value is None or not math.isfinite(value):
        return MISSING
    places = 0 if value == 0 else max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:,.{places}f} {unit}".rstrip().replace("-", "−")


def percent(share: float | None) -> str:
    """Format a share in per cent, with two significant digits."""
    return significant(None if share is None else 100 * share, "%")


def pair(values: Sequence[str], unit: str = "") -> str:
    """Join printed values, with one unit for all of them."""
    return f"{' | '.join(values)} {unit if set(values) != {MISSING} else ''}".rstrip()


def span(values: Array, unit: str = "") -> str:
    """Format the smallest and largest value, or the common value if all are equal, with three
    significant digits.
    """
    low, high = float(np.min(values)), float(np.max(values))
    text = f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
    return f"{text}{unit}" if unit == "°" else f"{text} {unit}".rstrip()


def stages_text(stages: Mapping[str, float]) -> str:
    """Seconds per stage, on one line."""
    return ", ".join(f"{name} {seconds:.1f} s" for name, seconds in stages.items())


@dataclass(frozen=True)
class Cell:
    """A cell that shows more on a page than on the terminal."""

    text: str
    """Text on the page."""
    name: str = ""
    """Text on the terminal, if different."""
    lines: Sequence[str] = ()
    """Lines in small print below the text, only on the page."""
    mark: str = ""
    """A badge, such as "best", only on the page, which highlights the row."""


@dataclass(frozen=True)
class Table:
    """A table to print on the terminal and show on a page.

    A row whose first cell is empty continues the row above: on a page, the first cells of both rows
    are merged.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    align: str = "lr"
    """A letter per column, l or r; the last letter applies to all further columns."""
    note: str = ""
    """Text below the table, only on the page."""

    def print(self) -> None:
        """Print the table on the terminal, as plain text that can be searched and copied."""
        table = RichTable(
            title=escape(printable(self.title)),
            title_justify="left",
            title_style="bold",
            box=SIMPLE_HEAD,
            padding=0,
        )
        table.pad_edge = False
        for name, side in zip(self.header, self.sides, strict=True):
            table.add_column(escape(name), justify="left" if side == "l" else "right", no_wrap=True)
        for row in self.texts:
            table.add_row(*map(escape, row))
        console = Console(highlight=False, width=10_000)
        console.width = console.measure(table).maximum  # a narrower terminal wraps lines
        console.print(table)

    @property
    def texts(self) -> list[list[str]]:
        """The rows for the terminal."""
        cells = [[_cell(value) for value in row] for row in self.rows]
        return [
            [
                printable(cell.name or cell.text).replace("−", "-").replace(MISSING, "-")
                for cell in row
            ]
            for row in cells
        ]

    @property
    def sides(self) -> str:
        """The alignment of each column, l or r."""
        return self.align.ljust(len(self.header), self.align[-1])[: len(self.header)]

    @property
    def dense(self) -> bool:
        """Whether the table has so many columns that a page shows it in smaller type."""
        return len(self.header) > 9

    @property
    def groups(self) -> list[list[list[Cell]]]:
        """The rows for a page, each grouped with the rows that continue it."""
        groups: list[list[list[Cell]]] = []
        for row in self.rows:
            cells = [_cell(value) for value in row]
            if groups and not cells[0].text:
                groups[-1].append(cells)
            else:
                groups.append([cells])
        return groups


def _cell(value: str | Cell) -> Cell:
    """`value` as a cell, with MISSING instead of NaN."""
    if isinstance(value, Cell):
        return value
    return Cell(MISSING if value in ("nan", "+nan") else value)
