"""Symbols, formulas and units of slip laws, as printed."""

import math

from trackslip.identification.drive.model import EXTRAS
from trackslip.slip.families import FAMILIES

_LETTERS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "slip": "i", "size": "a", "pole": "p", "offset": "D", "radius_error": "ε",
    "turn_loss": "g", "compliance": "C", "turn_compliance": "S"
}  # fmt: skip
_TRACKS = ("", " outer", " inner", " left", " right")
SYMBOLS = {
    f"{name}{track.replace(' ', '_')}": f"{letter}{track}" for name, letter in _LETTERS.items() for track in _TRACKS
}
"""Parameter -> its symbol, such as "α outer" for alpha_outer."""
FORMULAS = {
    "none": ("i = 0",),
    "constant": ("i the same at every radius",),
    "exponential": ("i = α exp(β R)",),
    "exponential_speed": ("i = (α + γ v) exp(β R)",),
    "power": ("i = α (1 + R / b)ᵝ",),
    "hyperbola": ("outer: a / (R + p)", "inner: −a / (R − p)"),
    "icr": ("outer: D / (R + b + D)", "inner: −D / (R − b − D)"),
    "icr_radius": ("outer: 1 − (1 + ε)(R + b) / (R + b + D)", "inner: 1 − (1 + ε)(R − b) / (R − b − D)"),
    "turn_loss": ("w as above, v = s (1 − g sin²θ)", "s: the belts' mean speed, tan θ = (b + D) w / s"),
    "icr_load": ("as icr_radius, with v + t √((C v)² + (S w)²) for v", "t: traction over load"),
    "icr_sides": ("as icr_radius, with D and ε", "of the left and the right track"),
}
"""Law -> the lines of its formula."""
EXTRA_SYMBOLS = {
    "sensor_x": "X", "sensor_y": "Y", "drift": "c", "clock_offset": "τ", "sensor_yaw": "ψ", "lag": "T"
}  # fmt: skip
"""The same for parameters of a drive that aren't its law's."""
EXTRA_TITLES = {
    "sensor_x": "sensor ahead of the turning centre",
    "sensor_y": "sensor to the left",
    "drift": "outward drift in turns",
    "clock_offset": "encoder clock minus pose clock",
    "sensor_yaw": "heading of the sensor in the robot",
    "lag": "lag of the motion behind the belts",
}
"""What they are."""
_PRINTED = {"m": (1e3, "mm"), "s": (1e3, "ms"), "rad": (math.degrees(1.0), "°")}
_MAX_DIGITS = 7
_UNKNOWN_DIGITS = 2


def unit_of(law: str, parameter: str) -> tuple[float, str]:
    """Factor from SI and unit in which a parameter is printed: mm for lengths, % for errors of the radius."""
    if parameter.startswith("radius_error"):
        return 1e2, "%"
    unit = FAMILIES[law].parameters[parameter].unit
    return (1e3, "mm") if unit == "m" else (1.0, unit)


def unit_of_extra(name: str) -> tuple[float, str]:
    """Factor from SI and unit in which another parameter of a drive is printed."""
    return _PRINTED[EXTRAS[name].unit]


def digits_for(error: float) -> int:
    """Decimals that show two digits of an error; few where a law is not determined."""
    if math.isinf(error):
        return _UNKNOWN_DIGITS
    return min(_MAX_DIGITS, max(0, 1 - math.floor(math.log10(error)))) if error > 0 else _MAX_DIGITS
