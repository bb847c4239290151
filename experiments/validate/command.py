"""`trackslip validate`: compare a robot on its ground with theory."""

import math
import sys
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.common.check import Check
from experiments.common.manifest import command_line
from experiments.common.page import Answer, Page, Plot, Section
from experiments.common.results import REPORT_FILE
from experiments.common.run import Run
from experiments.common.soil import assumptions
from experiments.common.table import Table, number, pair, span
from experiments.simulate.motors import print_motors
from experiments.validate import figures
from experiments.validate.checks import (
    Checks,
    check_energy,
    check_sliding,
    check_standing,
    check_turns,
)
from experiments.validate.config import Config
from experiments.validate.measurements import Setup, checked_speed, paper_turns
from experiments.validate.soil import check_soil
from sim.common.seeds import generator
from sim.ground.ground import load_ground
from sim.motors.motor import or_tireless
from sim.robot.named import load_parameters
from trackslip.skid_theory import Soil

_UNITS: Final = {
    "m": (1e3, "mm"),
    "m/s": (1e3, "mm/s"),
    "rad": (math.degrees(1.0), "°"),
    "m/s^2": (1.0, "m/s²"),
}
_CHECKS: Final = (
    "Simulated minus theory, over the bound: each check holds within the shaded part. Each row "
    "shows the value that is closest to its bound."
)
_CAPTION: Final = (
    "Simulated minus theory in every turn and, for accelerations, minus Coulomb's law on slopes "
    "that don't hold the robot. Shaded: the bounds."
)
_NOTE: Final = "Each row shows the value that is closest to its bound."


@dataclass(frozen=True)
class _Comparison:
    """What a comparison of a robot with theory found, besides its checks."""

    facts: list[tuple[str, str]]
    plots: list[Plot] = field(default_factory=list)
    stored: dict[str, Any] = field(default_factory=dict)
    """Entries of summary.json."""


def run(config: Config) -> None:
    """Measure and check the robot, and store and print the checks; exits with 1 if a check
    fails.
    """
    parameters, ground = load_parameters(config.robot)
    if config.ground.source:
        ground = load_ground(config.ground.source)
    ground = config.ground.changed(ground)
    ground.require_even("the checks are for even ground, and tilt it themselves")
    setup = Setup(parameters, ground, config.threads)
    checks = Checks(Path(config.robot).stem, setup)
    with Run(config) as run:
        if ground.soil is None:
            comparison = _compare_on_firm_ground(run, checks, config.seed)
        else:
            comparison = _compare_on_soft_soil(run, checks, ground.soil)
        header = ("check", "theory", "measured", "allowed")
        rows = [_row(check) for check in checks.done]
        table = Table("Theory and simulator", header, rows, note=_NOTE)
        alarms = [f"Failed: {what}." for what in checks.failed]
        lines = [f"Not applicable: {line}." for line in checks.not_applicable]
        following = f"trackslip grid --robot {config.robot}"
        if config.ground.source:
            following += f" --ground {config.ground.source}"
        facts = [
            *comparison.facts,
            ("speed of the belts, at most", f"{checked_speed(parameters):.3g} m/s"),
        ]
        answer = Answer(checks.verdict, facts, lines, alarms=alarms, next=[following])
        summary = partial(figures.checks_figure, checks.done)
        all_checks = Plot("checks", summary, "All checks", _CHECKS)
        sections = [Section("Simulated minus theory", [all_checks, table, *comparison.plots])]
        manifest = run.manifest(
            seed=config.seed, robot=parameters, ground=ground, model_sha256=setup.robot().digest
        )
        title = f"{checks.robot}: theory and simulator"
        page = Page(title, command_line("validate"), manifest, sections, answer=answer)
        page.write(run.folder, config.pdf)
        found = {
            "checks": [check.to_json() for check in checks.done],
            "not_applicable": checks.not_applicable,
        }
        run.write({**found, **comparison.stored}, manifest=manifest)
    table.print()
    print_motors(config.robot, or_tireless(parameters.drive))
    print(checks.verdict)
    for line in checks.not_applicable:
        print(f"not applicable: {line}")
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")
    if checks.failed:
        sys.exit(1)


def _compare_on_firm_ground(run: Run, checks: Checks, seed: int) -> _Comparison:
    """Check turns, loads, slopes and energy."""
    parameters = checks.setup.parameters
    ground = checks.setup.ground
    with run.busy("turns"):
        turns = check_turns(checks)
    with run.busy("loads and slopes"):
        check_standing(checks)
        sliding = check_sliding(checks)
    with run.busy("energy"):
        check_energy(checks, generator(seed, "energy"))

    friction = f"friction {ground.along:g} along, {ground.across:g} across"
    friction += f", shear {1e3 * ground.shear:g} mm" if ground.shear else ""
    width = span(1e3 * turns.half_width[1].round(3), "mm")
    slips = [span(turns.slip[1, :, side]) for side in (1, 0)]
    facts = [
        ("ground", friction),
        ("b + D, half the distance of the ICRs", width),
        ("slip, outer | inner track", pair(slips)),
    ]
    radius, speed, _ = paper_turns(parameters)
    drawn = partial(figures.deviations, turns, radius, speed, sliding)
    stored = {
        "radius": radius,
        "speed": speed,
        "half_width": turns.half_width,
        "slip": turns.slip,
    }
    plots = [Plot("deviations", drawn, "Turns and slopes", _CAPTION)]
    return _Comparison(facts, plots, {"turns": stored, "sliding": sliding})


def _compare_on_soft_soil(run: Run, checks: Checks, soil: Soil) -> _Comparison:
    """Check sinking, pulls, slopes and turns."""
    with run.busy("soft soil"):
        check_soil(checks)
    width = checks.setup.parameters.track_width
    part = "wheel" if checks.setup.parameters.axles else "track"
    facts = [
        ("soft soil", soil.source or "as given"),
        *assumptions(soil),
        (part, f"{number(1e3 * width, 0, 'mm')} wide"),
    ]
    return _Comparison(facts)


def _row(check: Check) -> tuple[str, ...]:
    """A row with theory, measurement and tolerance in a readable unit, rounded to the digits of the
    tolerance.
    """
    scale, unit = _UNITS.get(check.unit, (1.0, check.unit.removesuffix("1")))
    _, high = check.ends
    tolerance = high - check.expected
    digits = max(0, 1 - math.floor(math.log10(scale * tolerance)))  # two significant digits
    values = scale * np.array([check.expected, check.measured, tolerance])
    rounded = values.round(digits) + 0.0  # without the sign of a zero
    theory, measured, allowed = (number(value, digits, unit) for value in rounded)
    mark = "" if check.holds else " !"
    return check.what, theory, measured + mark, f"± {allowed}"
