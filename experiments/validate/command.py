"""`trackslip validate`: compare a robot on its ground with theory."""

import math
import sys
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from experiments.common.check import Check
from experiments.common.manifest import command_line
from experiments.common.page import Answer, Page, Plot, Section
from experiments.common.results import REPORT_FILE
from experiments.common.run import Run
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
from sim.common.seeds import generator
from sim.ground.ground import load_ground
from sim.motors.motor import or_tireless
from sim.robot.named import load_parameters

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


def run(config: Config) -> None:
    """Measure and check the robot, and store and print the checks; exits with 1 if a check
    fails.
    """
    parameters, ground = load_parameters(config.robot)
    if config.ground.source:
        ground = load_ground(config.ground.source)
    ground = config.ground.changed(ground)
    ground.require_even("the checks are for even ground, and tilt it themselves")
    ground.require_firm("the checks are for firm ground; `trackslip predict` has soft soil")
    setup = Setup(parameters, ground, config.threads)
    checks = Checks(Path(config.robot).stem, setup)
    with Run(config) as run:
        with run.busy("turns"):
            turns = check_turns(checks)
        with run.busy("loads and slopes"):
            check_standing(checks)
            sliding = check_sliding(checks)
        with run.busy("energy"):
            check_energy(checks, generator(config.seed, "energy"))
        header = ("check", "theory", "measured", "allowed")
        rows = [_row(check) for check in checks.done]
        table = Table("Theory and simulator", header, rows, note=_NOTE)
        alarms = [f"Failed: {what}." for what in checks.failed]
        friction = f"friction {ground.along:g} along, {ground.across:g} across"
        friction += f", shear {1e3 * ground.shear:g} mm" if ground.shear else ""
        width = span(1e3 * turns.half_width[1].round(3), "mm")
        slips = [span(turns.slip[1, :, side]) for side in (1, 0)]
        facts = [
            ("ground", friction),
            ("b + D, half the distance of the ICRs", width),
            ("slip, outer | inner track", pair(slips)),
            ("speed of the belts, at most", f"{checked_speed(parameters):.3g} m/s"),
        ]
        lines = [f"Not applicable: {line}." for line in checks.not_applicable]
        following = [f"trackslip grid --robot {config.robot}"]
        answer = Answer(checks.verdict, facts, lines, alarms=alarms, next=following)
        radius, speed, _ = paper_turns(parameters)
        summary = partial(figures.checks_figure, checks.done)
        drawn = partial(figures.deviations, turns, radius, speed, sliding)
        plots = [
            Plot("checks", summary, "All checks", _CHECKS),
            Plot("deviations", drawn, "Turns and slopes", _CAPTION),
        ]
        sections = [Section("Simulated minus theory", [plots[0], table, plots[1]])]
        manifest = run.manifest(
            seed=config.seed, robot=parameters, ground=ground, model_sha256=setup.robot().digest
        )
        title = f"{checks.robot}: theory and simulator"
        page = Page(title, command_line("validate"), manifest, sections, answer=answer)
        page.write(run.folder, config.pdf)
        stored = {
            "radius": radius,
            "speed": speed,
            "half_width": turns.half_width,
            "slip": turns.slip,
        }
        found = {
            "checks": [check.to_json() for check in checks.done],
            "not_applicable": checks.not_applicable,
        }
        run.write({**found, "turns": stored, "sliding": sliding}, manifest=manifest)
    table.print()
    print_motors(config.robot, or_tireless(parameters.drive))
    print(checks.verdict)
    for line in checks.not_applicable:
        print(f"not applicable: {line}")
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")
    if checks.failed:
        sys.exit(1)


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
