"""How reports show slip laws: name, colour, line style and formula."""

from dataclasses import dataclass, replace
from typing import Any, Final

from experiments.common.colours import BLACK, BLUE
from experiments.common.table import Cell
from trackslip.identification.drive_comparison import TODAY
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


def law_cell(name: str, best: bool = False, formula: bool = True) -> Cell:
    """A table cell for a law: its name and, on a page, its description and formula."""
    look = law_looks().get(name, Look(name))
    lines = (look.label, *look.formula) if formula else ()
    return Cell(name, lines=lines, mark="best" if best else "")
