"""Tables, printed on the terminal and shown on a report's page."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table as RichTable

from experiments.common.formats import MISSING

_WIDEST = 10_000  # of tables, none of which is cut [characters]
_DENSE = 9  # more columns are set smaller


@dataclass(frozen=True)
class Cell:
    """A cell that says more on a page than on the terminal."""

    text: str
    """On the page."""
    name: str = ""
    """On the terminal, if not the same."""
    lines: Sequence[str] = ()
    """Small lines below, on the page alone."""
    mark: str = ""
    """A badge, such as "best", on the page alone; its row is highlighted."""


@dataclass(frozen=True)
class Table:
    """A table, described once for the terminal and for a page.

    A row whose first cell is empty continues the row above: on a page, their first cells are one.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    align: str = "lr"
    """A letter per column, l or r; the last one counts for all that follow."""
    note: str = ""
    """Text below the table, on the page alone."""
    folded: bool = False
    """Collapse the table on a page until its title is clicked."""

    def print(self) -> None:
        """Print it on the terminal, in signs that can be searched and copied."""
        table = RichTable(
            title=escape(self.title),
            title_justify="left",
            title_style="bold",
            box=SIMPLE_HEAD,
            padding=0,
            pad_edge=False,
        )
        for name, side in zip(self.header, self.sides, strict=True):
            table.add_column(escape(name), justify="left" if side == "l" else "right", no_wrap=True)
        for row in self.texts:
            table.add_row(*map(escape, row))
        console = Console(highlight=False, width=_WIDEST)
        console.width = console.measure(table).maximum  # a narrower terminal wraps lines
        console.print(table)

    @property
    def texts(self) -> list[list[str]]:
        """The rows for the terminal."""
        return [[_printed(cell) for cell in row] for row in self.rows]

    @property
    def sides(self) -> str:
        """The alignment of each column, l or r."""
        return self.align.ljust(len(self.header), self.align[-1])[: len(self.header)]

    @property
    def dense(self) -> bool:
        """True if the table has so many columns that a page sets it smaller."""
        return len(self.header) > _DENSE

    @property
    def groups(self) -> list[list[list[Cell]]]:
        """The rows for a page, each with those that continue it."""
        groups: list[list[list[Cell]]] = []
        for row in self.rows:
            cells = [cell if isinstance(cell, Cell) else Cell(MISSING if _unknown(cell) else cell) for cell in row]
            if groups and not cells[0].text:
                groups[-1].append(cells)
            else:
                groups.append([cells])
        return groups


def _unknown(text: str) -> bool:
    return text in ("nan", "+nan")


def _printed(cell: str | Cell) -> str:
    text = cell if isinstance(cell, str) else cell.name or cell.text
    return "-" if _unknown(text) else text.replace("−", "-").replace(MISSING, "-")
