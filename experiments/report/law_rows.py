"""A law and its parameters as printed: in a report's table, and on the terminal."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class LawRow:
    """A law and its parameters, as printed."""

    law: str  # its name in files and options
    title: str
    formula: Sequence[str]  # lines
    parameters: Sequence[tuple[str, ...]]  # symbol; value with standard error and unit; 95 % intervals
    best: bool = False


def law_table(rows: Sequence[LawRow]) -> list[tuple[str, ...]]:
    """One line per parameter."""
    return [(row.law if k == 0 else "", *cells) for row in rows for k, cells in enumerate(row.parameters)]
