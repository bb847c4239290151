"""Symbols and printed units of the parameters of laws and drives."""

from __future__ import annotations

import math
from typing import Final

from trackslip.identification.path import EXTRAS
from trackslip.laws.families import FAMILIES

_TRACKS: Final = ("outer", "inner", "left", "right")
_EXTRA_SYMBOLS: Final = {
    "sensor_x": "X",
    "sensor_y": "Y",
    "drift": "c",
    "clock_offset": "τ",
    "sensor_yaw": "ψ",
    "lag": "T",
    "gyro_bias": "β",
    "gyro_scale": "κ",
}
_PRINTED: Final = {
    "m": (1e3, "mm"),
    "s": (1e3, "ms"),
    "rad": (math.degrees(1.0), "°"),
    "rad/s": (math.degrees(1.0), "°/s"),
}


def symbol(law: str, parameter: str) -> str:
    """Symbol for a parameter of a law or a drive, such as "α outer" for alpha_outer; its name if it
    has no symbol.
    """
    parameters = FAMILIES[law].parameters
    track = parameter.rpartition("_")[2]
    if parameter not in parameters:
        return _EXTRA_SYMBOLS[parameter] or parameter
    letter = parameters[parameter].symbol
    text = f"{letter} {track}" if track in _TRACKS else letter
    return text.strip() or parameter


def unit_of(law: str, parameter: str) -> tuple[float, str]:
    """Factor from SI and printed unit for a parameter of a law or a drive: mm, ms, °, or % for
    relative errors.
    """
    if parameter.startswith(("radius_error", "gyro_scale")):
        return 1e2, "%"
    known = EXTRAS if parameter in EXTRAS else FAMILIES[law].parameters
    return printed_unit(known[parameter].unit)


def printed_unit(unit: str) -> tuple[float, str]:
    """Factor from an SI unit to the printed unit (mm, ms or °), and the printed unit."""
    return _PRINTED.get(unit, (1.0, unit))
