"""Slip laws as reports show them: one name everywhere, colour, line, formula, symbols and units of parameters."""

import math
from collections.abc import Sequence
from dataclasses import replace

from experiments.common.colours import BLACK
from experiments.common.table import MISSING, Cell, number
from trackslip.identification.drive_model import EXTRAS
from trackslip.identification.drive_prediction import GAINS, TODAY
from trackslip.slip.families import FAMILIES, Look

_OTHERS = {
    "published": Look("the paper's Eq. 11", BLACK, "--", FAMILIES["exponential"].look.formula),
    "online": Look("online", "#117733", (0, (5, 1))),
    "online_load": Look("online, with slip under load", "#4B6A1E", (0, (5, 1, 2, 1))),
    "online_cold": Look("online, from nothing", "#999933", (0, (5, 1, 1, 1))),
    TODAY: Look("dead reckoning as it drives today", "#8B5A2B", (0, (8, 2, 1, 2))),
    GAINS: Look("factors on speed and yaw rate", "#6A51A3", (0, (3, 3))),
    "robot": Look("the simulated robot", "#007A5A", (0, (6, 2, 1, 2, 1, 2))),
    "calibrated": Look("the simulated robot, fitted", "#1a1a1a", (0, (9, 1))),
}
"""Compensations and predictions that are no family of laws."""
_TRACKS = ("outer", "inner", "left", "right")
_EXTRA_SYMBOLS = {"sensor_x": "X", "sensor_y": "Y", "drift": "c", "clock_offset": "τ", "sensor_yaw": "ψ", "lag": "T"}
_EXTRA_SYMBOLS |= {"gyro_bias": "β", "gyro_scale": "κ", "gyro_clock": "τ gyro"}
_PRINTED = {"m": (1e3, "mm"), "s": (1e3, "ms"), "rad": (math.degrees(1.0), "°"), "rad/s": (math.degrees(1.0), "°/s")}
_MAX_DIGITS = 7
_UNKNOWN_DIGITS = 2


def law_looks() -> dict[str, Look]:
    """The looks of all laws and other compensations, by name; their labels describe them."""
    return {name: law.look for name, law in FAMILIES.items()} | _OTHERS


def shown(name: str) -> Look:
    """The look of a law or compensation, which has the same name in legends, tables and options."""
    return replace(law_looks().get(name, Look(name)), label=name)


def symbol(law: str, parameter: str) -> str:
    """The symbol of a law's or a drive's parameter, such as "α outer" for alpha_outer; its name if it has none."""
    parameters, track = FAMILIES[law].parameters, parameter.rpartition("_")[2]
    letter = parameters[parameter].symbol if parameter in parameters else _EXTRA_SYMBOLS[parameter]
    return f"{letter} {track if track in _TRACKS and parameter in parameters else ''}".strip() or parameter


def law_cell(name: str, best: bool = False, formula: bool = True) -> Cell:
    """A law in a table: its name, on a page with what it is and its formula."""
    look = law_looks().get(name, Look(name))
    lines = (look.label, *look.formula) if formula else ()
    return Cell(name, lines=lines, mark="best" if best else "")


def unit_of(law: str, parameter: str) -> tuple[float, str]:
    """Factor from SI and unit in which a law's or a drive's parameter is printed: mm, ms, °; % for radius errors."""
    if parameter.startswith(("radius_error", "gyro_scale")):
        return 1e2, "%"
    return printed_unit((EXTRAS[parameter] if parameter in EXTRAS else FAMILIES[law].parameters[parameter]).unit)


def printed_unit(unit: str) -> tuple[float, str]:
    """Factor from an SI unit and the unit in which values are printed: mm, ms, °."""
    return _PRINTED.get(unit, (1.0, unit))


def with_error(value: float, error: float, unit: tuple[float, str], *ends: Sequence[float] | None) -> tuple[str, ...]:
    """A parameter ± its standard error, and intervals, with the decimals that show two digits of the error.

    `unit` is a factor from SI and a unit's name; an interval of None is MISSING.
    """
    factor, name = unit
    error *= factor
    digits = _UNKNOWN_DIGITS if math.isinf(error) else _MAX_DIGITS
    if 0 < error < math.inf:
        digits = min(_MAX_DIGITS, max(0, 1 - math.floor(math.log10(error))))
    intervals = (MISSING if e is None else " to ".join(number(factor * x, digits) for x in e) for e in ends)
    return (f"{number(factor * value, digits)} ± {number(error, digits)} {name}".rstrip(), *intervals)
