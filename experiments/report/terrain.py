"""The page and the table of a validation of tracks on terrain."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from experiments.measuring.check import Check
from experiments.report.figures import terrain as figures
from experiments.report.formats import MISSING, number, percent, significant
from experiments.report.page import file_name
from experiments.report.template_page import Drawing, Page, render_page
from experiments.validation.terrain.findings import ByDefault, Findings, TerrainValidation

TITLE = "Tracks on terrain compared with theory"
DEFAULT_TITLE = "The same with MuJoCo's default contact"
DEFAULT_HEADER = ("quantity", "recipe", "default contact")
_FAILS = " !"


def render(found: TerrainValidation, checks: Sequence[Check], manifest: Mapping[str, Any], command: str) -> Page:
    """Draw the figures, one file per panel, and fill in the template."""
    panels = {
        "turns": figures.turns(found),
        "slopes": figures.slopes(found),
        "steps": figures.steps(found),
        "depth": figures.depths(found),
    }
    drawn = {
        name: [Drawing(f"{name}_{file_name(panel.axes[0].get_title(loc='left'))}", panel) for panel in several]
        for name, several in panels.items()
    }
    cards = {name: Markup("").join(drawing.inline for drawing in drawings) for name, drawings in drawn.items()}
    return render_page(
        "terrain.html.j2",
        [drawing for drawings in drawn.values() for drawing in drawings],
        title=TITLE,
        command=command,
        manifest=manifest,
        figures={name: Markup('<div class="panels">\n{}</div>\n').format(card) for name, card in cards.items()},
        header=header_of(found),
        rows=table_of(found, checks),
        default_header=DEFAULT_HEADER,
        default_rows=default_table(found),
        held=sum(check.holds for check in checks),
        count=len(checks),
    )


def header_of(found: TerrainValidation) -> tuple[str, ...]:
    """Header of `table_of`."""
    cells = ["check"]
    for preset in found.presets:
        cells += [f"{one.robot}, {preset}" for one in found.of_preset(preset)] + ["bound"]
    return tuple(cells)


def table_of(found: TerrainValidation, checks: Sequence[Check]) -> list[tuple[str, ...]]:
    """A row per check: the value of each robot and the bound of each preset; a value that isn't within is marked."""
    by_name = {(check.case, check.what): check for check in checks}
    rows = []
    for what in dict.fromkeys(check.what for check in checks):
        cells = [what]
        for preset in found.presets:
            cases = [f"{one.robot}, {preset}" for one in found.of_preset(preset)]
            row = [by_name.get((case, what)) for case in cases]
            cells += [MISSING if check is None else _value(check) for check in row]
            cells.append(next((_bound(check) for check in row if check is not None), MISSING))
        rows.append(tuple(cells))
    return rows


def _value(check: Check) -> str:
    return _shown(check, check.value) + ("" if check.holds else _FAILS)


def _bound(check: Check) -> str:
    return f">= {_shown(check, check.bound[0])}" if isinstance(check.bound, tuple) else _shown(check, check.bound)


def _shown(check: Check, value: float) -> str:
    if check.what.startswith(("ICRs", "D alone")):
        return percent(value)
    if check.unit == "rad":
        return significant(float(np.degrees(value)), "deg")
    if check.unit == "m" or check.what.startswith("creep"):
        return significant(1e3 * value, f"m{check.unit}")
    if check.what.startswith("sliding"):
        return f"{value:.0e} m/s".replace("-", "−")
    return number(value, 0) if check.unit == "1" else significant(value, check.unit)


def default_table(found: TerrainValidation) -> list[tuple[str, ...]]:
    """What MuJoCo's default contact makes of the same robots, beside the accurate recipe; under DEFAULT_HEADER."""
    rows = []
    for naive in found.by_default:
        recipe = next(one for one in found.findings if (one.robot, one.preset) == (naive.robot, "accurate"))
        rows += _compared(recipe, naive)
    return rows


def _compared(recipe: Findings, naive: ByDefault) -> list[tuple[str, ...]]:
    depths = []
    for name, one, other in (("stairs", recipe.stairs, naive.stairs), ("stairs down", recipe.descent, naive.descent)):
        depths += [
            (f"penetration on {name}, p99", *(significant(1e3 * s.typical, "mm") for s in (one, other))),
            (f"penetration on {name}, largest", *(significant(1e3 * s.largest, "mm") for s in (one, other))),
        ]
    both = [
        ("half width of the ICRs, slow", *(percent(t.slow.worst) for t in (recipe.on_plane, naive.turning))),
        ("half width, pivot at 0.5 m/s", *(percent(t.pivot.worst) for t in (recipe.on_plane, naive.turning))),
        ("half width, centre of mass off", *(percent(t.offset.worst) for t in (recipe.on_plane, naive.turning))),
        *depths,
        ("robots that climb the stairs", *(f"{s.arrived} of {s.robots}" for s in (recipe.stairs, naive.stairs))),
    ]
    return [(f"{recipe.robot}: {what}", *cells) for what, *cells in both]
