"""The table of checks."""

import math
from collections.abc import Iterable, Sequence
from itertools import groupby

from experiments.common.check import Check
from experiments.common.formats import MISSING, number, percent, significant
from experiments.common.table import Table

_HEADER = ("case", "value", "bound", "unit", "")
_SHOWN = {"m": (1e3, "mm"), "s": (1e3, "ms"), "rad": (1e3, "mrad")}
_MOST_COLUMNS = 4  # cases that fit side by side
_FAILS = " !"
_SHARE = 0.2  # largest bound of an error that is printed in per cent


def checks_table(title: str, checks: Sequence[Check]) -> Table:
    """A row per check; up to four cases side by side, more one below the other."""
    cases = list(dict.fromkeys(check.case for check in checks))
    return _side_by_side(title, checks, cases) if len(cases) <= _MOST_COLUMNS else _listed(title, checks)


def _listed(title: str, checks: Sequence[Check]) -> Table:
    rows: list[tuple[str, ...]] = []
    for case, group in groupby(checks, key=lambda check: check.case):
        rows.append((case, "", "", "", ""))
        for check in group:
            scale, unit = _SHOWN.get(check.unit, (1.0, ""))
            digits = 4 if scale == 1 else 3
            ends = check.bound if isinstance(check.bound, tuple) else (check.bound,)
            bound = " to ".join(number(scale * end, digits) for end in ends)
            holds = "holds" if check.holds else "does not hold"
            rows.append((f"  {check.what}", number(scale * check.measured, digits), bound, unit, holds))
    return Table(title, _HEADER, rows)


def _side_by_side(title: str, checks: Sequence[Check], cases: Sequence[str]) -> Table:
    """A column per case, side by side where they share their bounds, which come after them."""
    by_case = {case: {check.what: check for check in checks if check.case == case} for case in cases}
    groups: list[list[str]] = []
    for case in cases:
        alike = next((group for group in groups if _agree(by_case[group[0]], by_case[case])), None)
        groups.append([case]) if alike is None else alike.append(case)
    header = ["check", *(name for group in groups for name in (*group, "bound"))]
    rows = []
    for what in dict.fromkeys(check.what for check in checks):
        cells = [what]
        for group in groups:
            found = [by_case[case].get(what) for case in group]
            cells += [MISSING if check is None else _value(check) for check in found]
            cells.append(next((_bound(check) for check in found if check is not None), MISSING))
        rows.append(tuple(cells))
    return Table(title, header, rows)


def _agree(some: dict[str, Check], others: dict[str, Check]) -> bool:
    """True if checks of two cases with the same names have the same bounds."""
    return all(others[what].bound == check.bound for what, check in some.items() if what in others)


def _value(check: Check) -> str:
    return _in_its_unit(check, [check.measured])[0] + ("" if check.holds else _FAILS)


def _bound(check: Check) -> str:
    low, high = check.ends
    if not isinstance(check.bound, tuple):
        return _in_its_unit(check, [high])[0]
    shown = _in_its_unit(check, [low, high])
    return f">= {shown[0]}" if math.isinf(high) else " to ".join(shown)


def _in_its_unit(check: Check, values: Iterable[float]) -> list[str]:
    """Values as a reader expects them: errors in per cent, angles in degrees, lengths in millimetres."""
    most = max(abs(end) for end in check.ends)
    if check.unit == "1":
        return [percent(value) if 0 < most <= _SHARE else significant(value) for value in values]
    if check.unit == "rad":
        return [significant(math.degrees(value), "deg") for value in values]
    if check.unit in ("m", "m/s") and most < _SHARE:
        if most < 1e-6:  # rounding errors
            return [f"{value:.0e} {check.unit}".replace("-", "−") for value in values]
        return [significant(1e3 * value, f"m{check.unit}") for value in values]
    return [significant(value, check.unit) for value in values]
