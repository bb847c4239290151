"""Tables of what the drive estimator has to reach, and of MuJoCo's own drives."""

from collections.abc import Sequence
from itertools import groupby

from experiments.measuring.check import Check
from experiments.measuring.drive_cases import EPSILON, D
from experiments.measuring.drive_study import SimulatedDrives
from experiments.report.formats import for_terminal, number

CHECKS_HEADER = ("case", "value", "bound", "unit", "")
SIMULATED_HEADER = ("", "D [mm]", "epsilon [1e-3]")
_SHOWN = {"m": (1e3, "mm"), "s": (1e3, "ms"), "rad": (1e3, "mrad")}


def checks_table(checks: Sequence[Check]) -> list[tuple[str, ...]]:
    """A row per check under CHECKS_HEADER, below one with the name of its case."""
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
    return for_terminal(rows)


def simulated_table(found: SimulatedDrives) -> list[tuple[str, ...]]:
    """What drives and circles give, under SIMULATED_HEADER."""
    lines = (
        ("steady circles of the same speeds", found.steady),
        ("steady circles, the paper's", found.paper),
        (f"mean of {found.drives} drives", found.mean),
        ("scatter between drives", found.scatter),
    )
    rows = [(what, *(number(1e3 * values[name], 3) for name in (D, EPSILON))) for what, values in lines]
    shares = (number(found.coverage_of_steady[name], 3) for name in (D, EPSILON))
    return for_terminal([*rows, ("coverage of the steady law", *shares)])
