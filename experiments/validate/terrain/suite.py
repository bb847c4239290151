"""The suite of tracks on terrain: robots with each contact preset, and with MuJoCo's default contact."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from markupsafe import Markup

from experiments.common.check import Check, at_least
from experiments.common.formats import percent, significant
from experiments.common.page import Plot, Section
from experiments.common.run import Run
from experiments.common.table import Table
from experiments.validate.config import Config
from experiments.validate.suite import Findings
from experiments.validate.terrain import figures
from experiments.validate.terrain.engine import EngineSpeed, belt_error, differing_numbers, speed
from experiments.validate.terrain.motors import MotorErrors, motor_errors
from experiments.validate.terrain.obstacles import RISE, Sinking, rough, stairs
from experiments.validate.terrain.releases import LEAST_GAIN, Releases, releases
from experiments.validate.terrain.slopes import climbing_limits, creep, tipping
from experiments.validate.terrain.steps import BOXES, StepLimit, step
from experiments.validate.terrain.subjects import BoxRobot, Subject, subjects
from experiments.validate.terrain.trial import LevelGround, Limit
from experiments.validate.terrain.turning import Turning, turning
from sim.seeds import generator
from trackslip.kinematics import Array

TITLE = "Tracks on terrain compared with theory"
PRESETS = ("accurate", "fast")
BOUNDS: dict[str, tuple[float, float]] = {
    "slow": (0.01, 0.015),
    "pivot at 0.5 m/s": (0.03, 0.05),
    "centre of mass off": (0.025, np.inf),
    "climbing limit": (float(np.radians(0.1)), float(np.radians(0.15))),
    "highest step": (0.005, 0.006),
    "99th percentile": (0.004, 0.006),
    "largest": (0.005, 0.009),
    "level ground": (40.0, 150.0),
    "ten steps": (25.0, 80.0),
    "rough ground": (12.0, 35.0),
}
"""Bounds of the presets: relative errors of b + D and of D [-], errors of a slope [rad] and of a step [m], penetration
[m], least simulated over computing time on a core [-]; an infinite one is only shown."""
_CREEP, _FASTEST, _BELTS = 0.5e-3, 1.0, 1e-12  # [m/s]
_SIDEWAYS, _BACKWARDS = np.radians([0.5, 3.0]).tolist()  # backwards, the contact gives way at the rear [rad]
ValueT = TypeVar("ValueT")
_MOTORS, _EDGES = 0.01, 0.03  # [-]
_WIDE = 0.12  # belts [m]
_REBOUND = 0.25  # of the drop [-]
_LENGTH = 0.6  # of robots whose largest penetration the bounds are for; longer ones fall further from step to step [m]
_STAGES = 7  # of the measurements of a robot with a preset
_INTRO = Markup(
    "Tracks that are added to a robot with <code>sim.tracks</code> should turn by friction, climb and tip over as "
    "Coulomb's law and statics say. This page compares them with that theory, with both contact presets: "
    "<em>accurate</em> takes steps of 2 ms, <em>fast</em> of 4 ms. The default contact is MuJoCo's own, on the same "
    "robots."
)
_LIMITS = (
    "Turning on height fields. Contacts there depend on the triangles of the field, and turns are not to theory.",
    "Real ground: soil shears and yields, and real tracks have grousers.",
)


@dataclass(frozen=True)
class TerrainMeasurements:
    """Measurements of one robot with one preset."""

    robot: str
    preset: str
    length: float
    """Of the robot's contact with the ground [m]."""
    on_plane: Turning
    on_box: Turning
    climb_on_plane: tuple[Limit, ...]
    climb_on_box: tuple[Limit, ...]
    creep: Array  # (H,) of parked robots in several directions [m/s]
    steps: tuple[StepLimit, ...]
    tips_sideways: Limit
    tips_backwards: Limit
    stairs: Sinking
    descent: Sinking
    """Down the same stairs."""
    rough: Sinking
    falls: Releases
    random_falls: Releases | None
    """Of random robots; with the box only."""
    speed: EngineSpeed
    differing: int
    """Count of state values in which a batch's rows differ from robots simulated alone."""
    motors: MotorErrors
    wide_tips: Limit | None
    """Sideways, on belts of a width of _WIDE; of the box only."""
    belt_error: float
    """Of the sliding velocity of belts on moving bodies [m/s]."""


@dataclass(frozen=True)
class ByDefault:
    """The same robot with MuJoCo's default contact, for comparison."""

    robot: str
    turning: Turning
    stairs: Sinking
    descent: Sinking


def terrain_suite(config: Config, run: Run) -> Findings:
    """Measure the box and the rescue robot, or the robot that is given, with both presets."""
    robots, total = subjects(config.robot), _STAGES * len(PRESETS) + 1
    with run.watch.stage("terrain"), run.progress("tracks on terrain", len(robots) * total, "stages") as done:
        found = [measure(one, preset, config, done) for one in robots for preset in PRESETS]
        naive = []
        for one in robots:
            naive.append(by_default(one, config.threads))
            done(1.0)
    summary = {
        "robots": [_without_depths(one) for one in found],
        "default_contact": [_without_depths(one) for one in naive],
    }
    checks = [check for one in found for check in checks_of(one)]
    return Findings(TITLE, [_INTRO], checks, [comparison(found, naive)], _sections(found, naive), _LIMITS, summary)


def measure(subject: Subject, preset: str, config: Config, done: Callable[[float], None]) -> TerrainMeasurements:
    """Make all measurements; `done` is called after each of _STAGES with 1."""
    rng, threads = generator(config.seed, f"{subject.name} {preset}"), config.threads
    cases = BOXES if isinstance(subject, BoxRobot) else ((subject, 0.8),)

    def stage(value: ValueT) -> ValueT:
        done(1.0)
        return value

    return TerrainMeasurements(
        robot=subject.name,
        preset=preset,
        length=2 * subject.stand(LevelGround(), preset).half_length,
        on_plane=turning(subject, preset, False, threads),
        on_box=stage(turning(subject, preset, True, threads)),
        climb_on_plane=climbing_limits(subject, preset, False, threads),
        climb_on_box=climbing_limits(subject, preset, True, threads),
        creep=creep(subject, preset, True, threads),
        tips_sideways=tipping(subject, preset, True, threads),
        tips_backwards=stage(tipping(subject, preset, False, threads)),
        steps=stage(tuple(step(robot, preset, friction, threads) for robot, friction in cases)),
        stairs=stairs(subject, preset, threads),
        descent=stage(stairs(subject, preset, threads, rise=-RISE)),
        rough=stage(rough(subject, preset, rng, threads)),
        falls=releases(subject, preset, rng),
        random_falls=stage(releases(None, preset, rng) if isinstance(subject, BoxRobot) else None),
        speed=speed(subject, preset),
        differing=differing_numbers(subject, preset, rng),
        motors=motor_errors(subject, preset, threads),
        wide_tips=tipping(BoxRobot(width=_WIDE), preset, True, threads) if isinstance(subject, BoxRobot) else None,
        belt_error=stage(belt_error(subject, preset, rng)),
    )


def by_default(subject: Subject, threads: int) -> ByDefault:
    """The turns and the stairs with MuJoCo's default contact."""
    turns = turning(subject, "accurate", False, threads, by_default=True)
    up, down = (stairs(subject, "accurate", threads, by_default=True, rise=rise) for rise in (RISE, -RISE))
    return ByDefault(subject.name, turns, up, down)


def checks_of(found: TerrainMeasurements) -> list[Check]:
    """All checks of one robot with one preset."""
    bounds = {name: both[PRESETS.index(found.preset)] for name, both in BOUNDS.items()}
    bounds["largest"] *= max(1.0, found.length / _LENGTH)
    checks: list[Check] = []

    def check(what: str, value: float, bound: float | tuple[float, float], unit: str, source: str) -> None:
        checks.append(Check(f"{found.robot}, {found.preset}", what, float(value), bound, unit, source=source))

    for ground, turned in (("plane", found.on_plane), ("box", found.on_box)):
        for what, turns in (
            ("slow", turned.slow),
            ("pivot at 0.5 m/s", turned.pivot),
            ("centre of mass off", turned.offset),
        ):
            if np.isfinite(bound := bounds[what]):
                theory = "quasi-static Coulomb theory (trackslip.skid_theory)"
                check(f"ICRs' half width b + D on a {ground}, {what}", abs(turns.worst), bound, "1", theory)
                check(f"D alone on a {ground}, {what}", abs(turns.outside), bound, "1", theory)
    for ground, angles in (("plane", found.climb_on_plane), ("box", found.climb_on_box)):
        error = np.abs([a.error for a in angles]).max()
        check(f"climbing limit on a {ground}", error, bounds["climbing limit"], "rad", "Coulomb's law")
    check("creep on 30 degrees", found.creep.max(), _CREEP, "m/s", "Coulomb's law")
    statics = "statics (trackslip.climbing_theory)"
    for number, one in enumerate(found.steps, start=1):
        check(f"highest step, case {number}", abs(one.error), bounds["highest step"], "m", statics)
    check("tips over sideways", abs(found.tips_sideways.error), _SIDEWAYS, "rad", statics)
    check("tips over backwards", abs(found.tips_backwards.error), _BACKWARDS, "rad", statics)
    needed = "requirement"
    for what, crossed in (("climb", found.stairs), ("get down", found.descent)):
        check(f"robots that don't {what} the stairs", crossed.robots - crossed.arrived, 0.0, "1", needed)
    places = (("stairs", found.stairs), ("stairs down", found.descent), ("rough ground", found.rough))
    for name, sinking in places:
        check(f"penetration on {name}, 99th percentile", sinking.typical, bounds["99th percentile"], "m", needed)
        check(f"penetration on {name}, largest", sinking.largest, bounds["largest"], "m", needed)
    check("warnings on stairs and rough ground", sum(one.warnings for _, one in places), 0.0, "1", needed)
    check("fastest robot on rough ground", found.rough.fastest, _FASTEST, "m/s", needed)
    for name, value in zip(("level ground", "ten steps", "rough ground"), vars(found.speed).values(), strict=True):
        check(f"times real time on {name}, one core", value, at_least(bounds[name]), "1", needed)
    for robots, falls in (("the robot", found.falls), ("random robots", found.random_falls)):
        if falls is not None:
            gain = max(0.0, float(falls.gain.max()))
            check(f"energy that {robots} gained, over weight", gain, LEAST_GAIN, "m", "conservation of energy")
            check(f"rebound of {robots}, over the drop", falls.rebound.max(), _REBOUND, "1", needed)
    motors = found.motors
    check("torque of motors that climb 15 degrees, relative error", motors.climbing, _MOTORS, "1", "statics")
    check("impulse of motors, relative error", motors.impulse, _MOTORS, "1", "conservation of momentum")
    check("energy drawn by motors, relative error", motors.energy, _MOTORS, "1", "conservation of energy")
    if found.wide_tips is not None:
        error = abs(found.wide_tips.error / found.wide_tips.expected)
        check("tips over the edges of wide belts, relative error", error, _EDGES, "1", statics)
    check("numbers of a batch's rows that differ from robots alone", found.differing, 0.0, "1", "the same computation")
    check("sliding velocity of belts on moving bodies", found.belt_error, _BELTS, "m/s", "kinematics")
    return checks


def comparison(found: list[TerrainMeasurements], by_default: list[ByDefault]) -> Table:
    """MuJoCo's default contact on the same robots, compared with the accurate recipe."""
    rows: list[tuple[str, ...]] = []
    for naive in by_default:
        recipe = next(one for one in found if (one.robot, one.preset) == (naive.robot, "accurate"))
        turns, stairs_, down = (
            (recipe.on_plane, naive.turning), (recipe.stairs, naive.stairs), (recipe.descent, naive.descent)
        )  # fmt: skip
        both = [
            ("half width of the ICRs, slow", *(percent(one.slow.worst) for one in turns)),
            ("half width, pivot at 0.5 m/s", *(percent(one.pivot.worst) for one in turns)),
            ("half width, centre of mass off", *(percent(one.offset.worst) for one in turns)),
            ("penetration on stairs, p99", *(significant(1e3 * one.typical, "mm") for one in stairs_)),
            ("penetration on stairs, largest", *(significant(1e3 * one.largest, "mm") for one in stairs_)),
            ("penetration on stairs down, p99", *(significant(1e3 * one.typical, "mm") for one in down)),
            ("penetration on stairs down, largest", *(significant(1e3 * one.largest, "mm") for one in down)),
            ("robots that climb the stairs", *(f"{one.arrived} of {one.robots}" for one in stairs_)),
        ]
        rows += [(f"{naive.robot}: {what}", *cells) for what, *cells in both]
    return Table("The same with MuJoCo's default contact", ("quantity", "recipe", "default contact"), rows)


def _without_depths(one: TerrainMeasurements | ByDefault) -> dict[str, Any]:
    """Everything but every single depth."""
    return {
        name: {"p99_m": value.typical, "largest_m": value.largest}
        | {key: number for key, number in vars(value).items() if key != "depth"}
        if isinstance(value, Sinking)
        else value
        for name, value in vars(one).items()
    }


def _sections(found: list[TerrainMeasurements], naive: list[ByDefault]) -> list[Section]:
    turns = Plot(
        "turns",
        figures.turns(found, naive, BOUNDS),
        "Errors of the ICRs' half width",
        Markup(
            "Steady turns on a plane and on a box. <em>Slow</em>: belts of at most 0.12 m/s. <em>Pivot</em>: on the "
            "spot with ±0.5 m/s. <em>Centre of mass off</em>: slow, shifted forwards by 30 % of half the contact's "
            "length. Dashed lines are the bounds of the preset of their colour."
        ),
        "",
    )
    slopes = Plot(
        "slopes",
        figures.slopes(found),
        "Steepest slopes",
        "Filled symbols: the steepest slope that a robot climbs, tan θ = μ by theory. Open symbols: the slope on which "
        "a parked robot tips over. Backwards it tips over early, because the contact gives way at the rear.",
        "",
    )
    steps = Plot(
        "steps",
        figures.steps(found),
        "Highest steps",
        "At 0.03 m/s, against statics: the centre of mass has to pass the edge, and friction has to push the robot "
        "there. The crosses show what tipping over alone would allow where friction is the limit.",
        "",
    )
    depth = Plot(
        "depth",
        figures.depths(found, naive, BOUNDS),
        "Penetration",
        "Share of the tracks that touch, over all physics steps, whose deepest point is deeper than the value. Marks "
        "show the bounds: 99th percentile (triangle) and largest (dotted line).",
        "",
    )
    over = Section("Climbing and tipping over", [slopes, steps])
    return [Section("Turning", [turns]), over, Section("Obstacles", [depth])]
