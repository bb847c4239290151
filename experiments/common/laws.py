"""Slip laws as reports show them: title, colour, line, formula, and the symbols and units of their parameters."""

import math
from collections.abc import Iterable, Iterator, Sequence

from markupsafe import Markup

from experiments.common.colours import BLACK
from experiments.common.formats import MISSING, number
from experiments.common.page import Bullets
from experiments.common.table import Cell
from trackslip.identification.drive_model import EXTRAS
from trackslip.kinematics import RobotGeometry
from trackslip.slip.families import FAMILIES, Look

_OTHERS = {
    "published": Look("published law (Eq. 11)", BLACK, "--", FAMILIES["exponential"].look.formula),
    "online": Look("online", "#117733", (0, (5, 1))),
    "online_load": Look("online, with slip under load", "#4B6A1E", (0, (5, 1, 2, 1))),
    "online_cold": Look("online, from nothing", "#999933", (0, (5, 1, 1, 1))),
}
"""Compensations that are no family of laws."""
NO_SLIP = "no slip compensation"
_TRACKS = ("outer", "inner", "left", "right")
_EXTRA_SYMBOLS = {"sensor_x": "X", "sensor_y": "Y", "drift": "c", "clock_offset": "τ", "sensor_yaw": "ψ", "lag": "T"}
_EXTRA_SYMBOLS |= {"gyro_bias": "β", "gyro_scale": "κ", "gyro_clock": "τ gyro"}
_PRINTED = {"m": (1e3, "mm"), "s": (1e3, "ms"), "rad": (math.degrees(1.0), "°"), "rad/s": (math.degrees(1.0), "°/s")}
_MAX_DIGITS = 7
_UNKNOWN_DIGITS = 2


def law_looks() -> dict[str, Look]:
    """The looks of all laws and other compensations, by name."""
    return {name: law.look for name, law in FAMILIES.items()} | _OTHERS


def shown(name: str) -> Look:
    """The look of a law or compensation; an unknown one has its name as label."""
    return law_looks().get(name) or Look(name)


def symbol(law: str, parameter: str) -> str:
    """The symbol of a law's or a drive's parameter, such as "α outer" for alpha_outer; its name if it has none."""
    parameters, track = FAMILIES[law].parameters, parameter.rpartition("_")[2]
    letter = parameters[parameter].symbol if parameter in parameters else _EXTRA_SYMBOLS[parameter]
    return f"{letter} {track if track in _TRACKS and parameter in parameters else ''}".strip() or parameter


def prediction_title(name: str) -> str:
    """The title of a law among those compared by prediction, where no law means no compensation."""
    return NO_SLIP if name == "none" else shown(name).label


def law_cell(name: str, best: bool = False, formula: bool = True) -> Cell:
    """A law in a table: its title, name and formula on a page, its name in files and options on the terminal."""
    law = shown(name)
    option = (name,) if name != law.label else ()
    return Cell(law.label, name, (*option, *(law.formula if formula else ())), "best" if best else "")


def parameter_bullets(laws: Iterable[str], robot: RobotGeometry) -> Bullets:
    """The meaning of the parameters of some laws."""
    meanings = {p.symbol: p.meaning for law in laws for p in FAMILIES[law].parameters.values() if p.meaning}
    meanings["b"] = f"half the distance between the tracks' centre lines, {robot.half_gauge:g} m, which is not fitted"
    return Bullets([Markup("<strong>{}</strong>: {}.").format(*meaning) for meaning in meanings.items()])


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


def parameter_rows(law: Cell, parameters: Iterable[Sequence[str | Cell]]) -> Iterator[tuple[str | Cell, ...]]:
    """Rows of a law's parameters, the first of which names the law."""
    for k, cells in enumerate(parameters):
        yield (law if k == 0 else "", *cells)
