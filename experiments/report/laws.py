"""Slip laws as reports show them: title, colour, line, formula, and the symbols and units of their parameters."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from experiments.report.colours import BLACK, BLUE, GREEN, GREY, ORANGE, RED
from experiments.report.formats import MISSING, number
from experiments.report.page import Bullets
from experiments.report.table import Cell
from trackslip.identification.drive.model import EXTRAS
from trackslip.kinematics import RobotGeometry
from trackslip.slip.families import FAMILIES


@dataclass(frozen=True)
class ShownLaw:
    """Title, colour and line style of a slip law, or of a compensation by one."""

    title: str
    colour: str = GREEN
    dashes: Any = "-"
    """Its line style in matplotlib."""
    formula: Sequence[str] = (MISSING,)
    """Lines."""


_EXPONENTIAL = ("i = α exp(β R)",)
LAWS = {
    "none": ShownLaw("no slip assumed", RED, (0, (12, 1.5)), ("i = 0",)),
    "published": ShownLaw("published law (Eq. 11)", BLACK, "--", _EXPONENTIAL),
    "constant": ShownLaw("constant slip", GREY, (0, (6, 2)), ("i the same at every radius",)),
    "exponential": ShownLaw("exponential", "#CC79A7", "-.", _EXPONENTIAL),
    "exponential_speed": ShownLaw(
        "exponential with speed", ORANGE, (0, (6, 1.5, 1, 1.5, 1, 1.5)), ("i = (α + γ v) exp(β R)",)
    ),
    "power": ShownLaw("power of radius", GREEN, (0, (3, 1.5)), ("i = α (1 + R / b)ᵝ",)),
    "hyperbola": ShownLaw("hyperbola", "#8C510A", (0, (4, 1.5, 1, 1.5)), ("outer: a / (R + p)", "inner: −a / (R − p)")),
    "icr": ShownLaw("constant ICR", "#3A93C9", (0, (2, 1)), ("outer: D / (R + b + D)", "inner: −D / (R − b − D)")),
    "icr_radius": ShownLaw(
        "constant ICR with ε",
        BLUE,
        "-",
        ("outer: 1 − (1 + ε)(R + b) / (R + b + D)", "inner: 1 − (1 + ε)(R − b) / (R − b − D)"),
    ),
    "turn_loss": ShownLaw(
        "constant ICR with turn loss",
        "#A63D6F",
        (0, (8, 2, 2, 2)),
        ("w as above, v = s (1 − g sin²θ)", "s: the belts' mean speed, tan θ = (b + D) w / s"),
    ),
    "icr_load": ShownLaw(
        "constant ICR with slip under load",
        "#2B7A78",
        (0, (10, 2, 2, 2, 2, 2)),
        ("as icr_radius, with v + t √((C v)² + (S w)²) for v", "t: traction over load"),
    ),
    "icr_sides": ShownLaw(
        "constant ICR, two-sided",
        "#6A3D9A",
        (0, (2, 2.5)),
        ("as icr_radius, with D and ε", "of the left and the right track"),
    ),
    "online": ShownLaw("online", "#117733", (0, (5, 1))),
    "online_load": ShownLaw("online, with slip under load", "#4B6A1E", (0, (5, 1, 2, 1))),
    "online_cold": ShownLaw("online, from nothing", "#999933", (0, (5, 1, 1, 1))),
}
"""By name in files and options. Colours follow Okabe and Ito's palette, with a contrast of at least 3 : 1 on the light
page and on the dark one, where the style sheet inverts figures; all dashes differ, to be told apart without colour."""

NO_SLIP = "no slip compensation"
_LETTERS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "slip": "i", "size": "a", "pole": "p", "offset": "D", "radius_error": "ε",
    "turn_loss": "g", "compliance": "C", "turn_compliance": "S"
}  # fmt: skip
_TRACKS = ("", " outer", " inner", " left", " right")
SYMBOLS = {
    **{f"{name}{track.replace(' ', '_')}": letter + track for name, letter in _LETTERS.items() for track in _TRACKS},
    **{"sensor_x": "X", "sensor_y": "Y", "drift": "c", "clock_offset": "τ", "sensor_yaw": "ψ", "lag": "T"},
}
"""Parameter of a law or of a drive -> its symbol, such as "α outer" for alpha_outer."""
_PRINTED = {"m": (1e3, "mm"), "s": (1e3, "ms"), "rad": (math.degrees(1.0), "°")}
_MAX_DIGITS = 7
_UNKNOWN_DIGITS = 2


def shown(name: str) -> ShownLaw:
    """Title and look of a law or compensation; a user's own law has its name as title."""
    return LAWS.get(name) or ShownLaw(name)


def prediction_title(name: str) -> str:
    """The title of a law among those compared by prediction, where no law means no compensation."""
    return NO_SLIP if name == "none" else shown(name).title


def law_cell(name: str, best: bool = False, formula: bool = True) -> Cell:
    """A law in a table: its title and formula on a page, its name in files and options on the terminal."""
    law = shown(name)
    return Cell(law.title, name, law.formula if formula else (), "best" if best else "")


def parameter_bullets(robot: RobotGeometry) -> Bullets:
    """The meaning of the laws' parameters."""
    meanings = (
        ("α, β, γ", "slip at zero radius, its decay with radius and its growth with speed, for each track"),
        ("D", "distance from a track's centre line outwards to its instantaneous centre of rotation (ICR)"),
        ("b", f"half the distance between the tracks' centre lines, {robot.half_gauge:g} m, which is not fitted"),
        ("ε", "relative excess of the sprockets' effective radius over the nominal one"),
        ("g", "share of the belts' mean speed that a turn costs, the more the sharper it is"),
        ("C, S", "slip per traction over load, ahead and in turning"),
        ("a, p", "size and pole of a hyperbola; with a = D and p = b + D it is a constant ICR"),
    )
    return Bullets([Markup("<strong>{}</strong>: {}.").format(*meaning) for meaning in meanings])


def unit_of(law: str, parameter: str) -> tuple[float, str]:
    """Factor from SI and unit in which a law's or a drive's parameter is printed: mm, ms, °; % for radius errors."""
    if parameter.startswith("radius_error"):
        return 1e2, "%"
    unit = (EXTRAS[parameter] if parameter in EXTRAS else FAMILIES[law].parameters[parameter]).unit
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
