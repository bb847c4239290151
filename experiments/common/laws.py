"""How reports show slip laws: name, colour, line style, formula, and the symbols and units of the
parameters.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from experiments.common.colours import BLACK, BLUE
from experiments.common.table import Cell, number
from trackslip.identification.drive_comparison import TODAY
from trackslip.identification.path import EXTRAS
from trackslip.laws.families import DIFF_DRIVE, FAMILIES, GAINS


@dataclass(frozen=True)
class Look:
    """Appearance of a slip law, a compensation or another motion model in figures and tables.

    Colours have a contrast of at least 3 : 1 on light pages, and on dark pages, where figures are
    inverted.
    """

    label: str  # description in a few words
    colour: str = "#009E73"
    # matplotlib line style, different for each law so that lines can be told apart without colour
    dashes: Any = "-"
    formula: tuple[str, ...] = ("-",)  # a string per line


_LOOKS: Final[dict[str, tuple[Any, ...]]] = {
    "none": ("#C1272D", (0, (12, 1.5)), ("i = 0",)),
    "exponential": ("#CC79A7", "-.", ("i = α exp(β R)",)),
    "exponential_speed": ("#C98200", (0, (6, 1.5, 1, 1.5, 1, 1.5)), ("i = (α + γ v) exp(β R)",)),
    "icr": ("#3A93C9", (0, (2, 1)), ("outer: D / (R + b + D)", "inner: −D / (R − b − D)")),
    "icr_radius": (
        BLUE,
        "-",
        ("outer: 1 − (1 + ε)(R + b) / (R + b + D)", "inner: 1 − (1 + ε)(R − b) / (R − b − D)"),
    ),
    GAINS: ("#6A51A3", (0, (3, 3)), ("as icr_radius",)),
    DIFF_DRIVE: ("#3D6B8C", (0, (5, 1.5)), ("as icr_radius, with ε of each track",)),
    "turn_loss": (
        "#A63D6F",
        (0, (8, 2, 2, 2)),
        ("w as above, v = s (1 − g sin²θ)", "s: belts, tan θ = (b + D) w / s"),
    ),
    "turn_loss_sides": (
        "#B5651D",
        (0, (4, 1.5, 1, 1.5, 1, 1.5)),
        ("as turn_loss, with ε of each track",),
    ),
    "centrifugal": (
        "#5F7F1F",
        (0, (1, 2)),
        ("as turn_loss, with v (1 + κ |v w|) for v", "and w (1 + κ |v w|) for w"),
    ),
    "icr_load": (
        "#2B7A78",
        (0, (10, 2, 2, 2, 2, 2)),
        ("icr_radius, v + t √((C v)² + (S w)²)", "t: traction / load"),
    ),
    "icr_sides": ("#6A3D9A", (0, (2, 2.5)), ("as icr_radius, with D and ε of each track",)),
}
_OTHERS: Final = {
    "published": Look("the paper's Eq. 11", BLACK, "--", ("i = α exp(β R)",)),
    "online": Look("online", "#117733", (0, (5, 1))),
    "online_load": Look("online, with slip under load", "#4B6A1E", (0, (5, 1, 2, 1))),
    "online_cold": Look("online, from nothing", "#999933", (0, (5, 1, 1, 1))),
    TODAY: Look("dead reckoning as it drives today", "#8B5A2B", (0, (8, 2, 1, 2))),
    "robot": Look("the simulated robot", "#007A5A", (0, (6, 2, 1, 2, 1, 2))),
    "calibrated": Look("the simulated robot, fitted", "#1a1a1a", (0, (9, 1))),
}
_TRACKS: Final = ("outer", "inner", "left", "right")
_EXTRA_SYMBOLS: Final = {
    "sensor_x": "X",
    "sensor_y": "Y",
    "drift": "c",
    "clock_offset": "τ",
    "sensor_yaw": "ψ",
    "lag": "T",
    "gyro_bias": "β",
    "gyro_scale": "λ",
}
_PRINTED: Final = {
    "m": (1e3, "mm"),
    "s": (1e3, "ms"),
    "rad": (math.degrees(1.0), "°"),
    "rad/s": (math.degrees(1.0), "°/s"),
}
_MAX_DIGITS: Final = 4  # largest number of decimals


def law_looks() -> dict[str, Look]:
    """The looks of all laws, compensations and other motion models by name, labelled with
    descriptions.
    """
    return {
        name: Look(law.title, *_LOOKS.get(name, ())) for name, law in FAMILIES.items()
    } | _OTHERS


def shown(name: str) -> Look:
    """The look of a law or compensation, labelled with the name that options use."""
    return replace(law_looks().get(name, Look(name)), label=name)


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


def law_cell(name: str, best: bool = False, formula: bool = True) -> Cell:
    """A table cell for a law: its name and, on a page, its description and formula."""
    look = law_looks().get(name, Look(name))
    lines = (look.label, *look.formula) if formula else ()
    return Cell(name, lines=lines, mark="best" if best else "")


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


def with_interval(
    value: float,
    ends: Sequence[float] | None,
    unit: tuple[float, str] = (1.0, ""),
    *,
    why_none: str,
) -> str:
    """Format a value with its 95 % interval, rounded to two significant digits of the half-width.

    `unit` is the factor from SI and the name of the printed unit. If `ends` is None or NaN,
    `why_none` stands in place of the interval.
    """
    factor, name = unit
    low, high = (math.nan, math.nan) if ends is None else (factor * end for end in ends)
    half_width = (high - low) / 2
    if not math.isfinite(half_width):
        text = f"{factor * value:.4g} {name}".rstrip().replace("-", "−")
        return f"{text} ({why_none})"
    digits = _MAX_DIGITS
    if half_width > 0:
        two_significant = 1 - math.floor(math.log10(half_width))
        digits = min(_MAX_DIGITS, max(0, two_significant))
    text = number(factor * value, digits, name)
    return f"{text} ({number(low, digits)} to {number(high, digits)})"
