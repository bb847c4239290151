"""The page and the tables of a validation of tracks on terrain."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from experiments.measuring.check import Check
from experiments.report.figures import terrain as figures
from experiments.report.formats import MISSING, number, percent, significant
from experiments.report.page import Bullets, Page, Plot, Section
from experiments.report.table import Table
from experiments.validation.terrain.findings import ByDefault, Findings, TerrainValidation

TITLE = "Tracks on terrain compared with theory"
_FAILS = " !"
_INTRO = Markup(
    "Tracks that are added to a robot with <code>sim.tracks</code> should turn by friction, climb and tip over as "
    "Coulomb's law and statics say. This page compares them with that theory, with both contact presets: "
    "<em>accurate</em> takes steps of 2 ms, <em>fast</em> of 4 ms. The default contact is MuJoCo's own, on the same "
    "robots."
)
_LIMITS = Bullets(
    [
        "Turning on height fields. Contacts there depend on the triangles of the field, and turns are not to theory.",
        "Real ground: soil shears and yields, and real tracks have grousers.",
    ]
)


def page(found: TerrainValidation, checks: Sequence[Check], manifest: Mapping[str, Any], command: str) -> Page:
    """The checks, MuJoCo's default contact beside them, and the figures."""
    held = f"{sum(check.holds for check in checks)} of {len(checks)} checks hold. A value marked ! is out of its bound."
    return Page(
        TITLE,
        command,
        manifest,
        [
            Section("In numbers", [held, checks_table(found, checks), default_table(found)]),
            Section("Turning", [_turns(found)]),
            Section("Climbing and tipping over", _climbing(found)),
            Section("Obstacles", [_penetration(found)]),
            Section("What this does not show", [_LIMITS]),
        ],
        intro=[_INTRO],
    )


def _turns(found: TerrainValidation) -> Plot:
    return Plot(
        "turns",
        figures.turns(found),
        "Errors of the ICRs' half width",
        Markup(
            "Steady turns on a plane and on a box against quasi-static Coulomb theory, on a logarithmic axis. "
            "<em>Slow</em>: belts of at most 0.12 m/s. <em>Pivot</em>: on the spot with ±0.5 m/s. <em>Centre of mass "
            "off</em>: slow, shifted forwards by 30 % of half the contact's length. Dashed lines are the bounds of the "
            "preset of their colour."
        ),
        "",
    )


def _climbing(found: TerrainValidation) -> tuple[Plot, ...]:
    return (
        Plot(
            "slopes",
            figures.slopes(found),
            "Steepest slopes",
            "Filled symbols: the steepest slope that a robot climbs, tan θ = μ by theory. Open symbols: the slope on "
            "which a parked robot tips over. Backwards it tips over early, because the contact gives way at the rear.",
            "",
        ),
        Plot(
            "steps",
            figures.steps(found),
            "Highest steps",
            "At 0.03 m/s, against statics: the centre of mass has to pass the edge, and friction has to push the robot "
            "there. The crosses show what tipping over alone would allow where friction is the limit. Robots climb a "
            "little higher than theory, by the depth at which the edge sinks into the tracks.",
            "",
        ),
    )


def _penetration(found: TerrainValidation) -> Plot:
    return Plot(
        "depth",
        figures.depths(found),
        "Penetration",
        "Share of the tracks that touch, over all physics steps, whose deepest point is deeper than the value. Stairs "
        "of 0.15 m × 0.28 m at 0.3 m/s; rough ground of 10 cm with cells of 0.1 m, random commands. Marks show the "
        "bounds: 99th percentile (triangle) and largest (dotted line).",
        "",
    )


def checks_table(found: TerrainValidation, checks: Sequence[Check]) -> Table:
    """A row per check: the value of each robot and the bound of each preset; a value that isn't within is marked."""
    header = ["check"]
    for preset in found.presets:
        header += [f"{one.robot}, {preset}" for one in found.of_preset(preset)] + ["bound"]
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
    note = "Errors are the largest of their kind. The speed depends on the computer and on what else it does."
    return Table(TITLE, header, rows, note=note)


def default_table(found: TerrainValidation) -> Table:
    """MuJoCo's default contact on the same robots, beside the accurate recipe."""
    rows: list[tuple[str, ...]] = []
    for naive in found.by_default:
        recipe = next(one for one in found.findings if (one.robot, one.preset) == (naive.robot, "accurate"))
        rows += _compared(recipe, naive)
    return Table("The same with MuJoCo's default contact", ("quantity", "recipe", "default contact"), rows)


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
