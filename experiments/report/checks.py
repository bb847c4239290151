"""The table of checks."""

from collections.abc import Sequence
from itertools import groupby

from experiments.measuring.check import Check
from experiments.report.formats import number
from experiments.report.table import Table

_HEADER = ("case", "value", "bound", "unit", "")
_SHOWN = {"m": (1e3, "mm"), "s": (1e3, "ms"), "rad": (1e3, "mrad")}


def checks_table(title: str, checks: Sequence[Check]) -> Table:
    """A row per check, below one with the name of its case."""
    rows: list[tuple[str, ...]] = []
    for case, group in groupby(checks, key=lambda check: check.case):
        rows.append((case, "", "", "", ""))
        for check in group:
            scale, unit = _SHOWN.get(check.unit, (1.0, ""))
            digits = 4 if scale == 1 else 3
            ends = check.bound if isinstance(check.bound, tuple) else (check.bound,)
            bound = " to ".join(number(scale * end, digits) for end in ends)
            holds = "holds" if check.holds else "does not hold"
            rows.append((f"  {check.what}", number(scale * check.value, digits), bound, unit, holds))
    return Table(title, _HEADER, rows)
