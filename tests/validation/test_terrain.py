"""Tracks on terrain against theory and statics: turning, slopes, tipping over, steps, stairs, rough
ground.

The box in tests/sim/tracks has more: ground of a box, wide and small belts, motors, belts on moving
bodies, batches.
"""

from typing import NamedTuple

import numpy as np
import pytest
from climbing_theory import highest_step
from terrain_trials import DEPTH, FACE, STAIRS, LevelGround, Trial, box, limit, rescue
from trials import report, use_default_contact

from experiments.common.check import Check
from experiments.common.table import Table, percent, significant
from sim.common.seeds import generator
from sim.terrain import Course, Rough, Stairs
from trackslip.skid_theory import steady_twist

pytestmark = pytest.mark.slow
PRESETS = ("accurate", "fast")
ROBOTS = {"box": box, "rescue": rescue}
CLIMBER = {
    "hull": ((-0.3, 0.08, 0.08), (0.25, 0.08, 0.08), (0.4, 0.2, 0.06)),
    "centre_of_mass": (0.05, 0.12),
}
"""A box that can climb stairs."""
SLOW = ((-0.04, 0.04), (0.0, 0.06), (0.04, 0.08), (0.1, 0.12))
PIVOT = ((-0.5, 0.5),)
"""Belt speeds [m/s], as SLOW."""
LONG = ((-0.3, 0.08, 0.08), (0.3, 0.08, 0.08))
SHORT = ((-0.2, 0.07, 0.07), (0.2, 0.07, 0.07))
RISING = ((-0.25, 0.08, 0.08), (0.2, 0.08, 0.08), (0.36, 0.2, 0.06))


class StepCase(NamedTuple):
    """A box before a step."""

    hull: tuple
    centre_of_mass: tuple  # ahead and up [m]
    friction: float


STEP_CASES = (
    StepCase(LONG, (0.0, 0.14), friction=1.0),
    StepCase(LONG, (0.06, 0.18), friction=1.0),
    StepCase(SHORT, (0.06, 0.10), friction=1.0),
    StepCase(RISING, (0.0, 0.15), friction=0.9),
    StepCase(RISING, (0.0, 0.12), friction=0.7),
    StepCase(RISING, (0.03, 0.10), friction=0.65),
)
"""Tipping over the edge limits the first four, friction the last two."""


def of_preset(preset, accurate, fast):
    return accurate if preset == "accurate" else fast


def turning_error(robot, belts, by_default=False):
    """Errors (2, M) of b + D and of D alone in steady turns, relative to theory."""
    if by_default:
        use_default_contact(robot.model)
    belts = np.array(belts)
    trial = Trial(robot, len(belts))
    trial.drive(belts)
    trial.advance(2.0)
    headings = [trial.heading()]
    for _ in range(20):
        trial.advance(0.1)
        headings.append(trial.heading())
    unwrapped = np.unwrap(headings, axis=0)
    yaw_rate = (unwrapped[-1] - unwrapped[0]) / 2.0
    twist_by_theory = steady_twist(belts, robot.line_contact(0.7), 9.81)

    difference = belts[:, 1] - belts[:, 0]
    half_width = difference / (2 * yaw_rate)
    half_width_by_theory = difference / (2 * twist_by_theory[:, 2])
    offset = half_width - robot.half_gauge
    offset_by_theory = half_width_by_theory - robot.half_gauge
    return np.stack([half_width / half_width_by_theory, offset / offset_by_theory]) - 1


@pytest.mark.parametrize("preset", PRESETS)
def test_turning(preset):
    slow, pivot = of_preset(preset, (0.01, 0.03), (0.015, 0.05))
    checks = []
    for name, robot in ROBOTS.items():
        level = robot(LevelGround(), preset)
        cases = [("slow", level, SLOW, slow), ("pivot at 0.5 m/s", level, PIVOT, pivot)]
        if robot is box and preset == "accurate":
            shifted = box(LevelGround(), preset, centre_of_mass=(0.075, 0.12))
            cases.append(("centre of mass off", shifted, SLOW, 0.025))
        for what, stand, belts, bound in cases:
            whole, outside = np.abs(turning_error(stand, belts)).max(axis=1)
            checks.append(Check(name, f"ICRs' half width b + D, {what}", whole, bound))
            checks.append(Check(name, f"D alone, {what}", outside, bound))
    report(f"Turning, {preset}", checks)


def climbing_limit(robot, friction):
    def climbs(slopes):
        trial = Trial(robot, len(slopes))
        trial.tilt(slopes)
        trial.drive([0.05, 0.05])
        trial.advance(4.0)
        return trial.velocity[:, 0] > 0

    expected = np.arctan(friction)
    around = np.radians(0.6)
    return limit(climbs, expected - around, expected + around, 9) - expected


def tipping_error(robot, sideways):
    """Error of the slope on which a parked robot tips over that stands across it, or points uphill
    [rad].
    """
    view = robot.view
    expected = np.arctan2(robot.half_gauge if sideways else view.ahead, view.height)

    def stands(slopes):
        trial = Trial(robot, len(slopes), np.pi / 2 if sideways else 0.0)
        trial.drive([0.0, 0.0])
        stays = np.ones(len(slopes), bool)
        for time in np.arange(0.0, 8.0, 0.05):  # tilted slowly for 4 s, and watched for as long
            share = np.sin(np.pi / 2 * min(1.0, time / 4.0))
            trial.tilt(share * slopes)
            trial.advance(0.05, stays)
            stays &= trial.lean() < np.radians(30.0)
            if not stays.any():
                break
        return stays

    around = np.radians(4.0)
    return limit(stands, expected - around, expected + around, 9) - expected


def creep_of(robot):
    """Fastest speed of robots parked on 30 degrees, with four headings [m/s]."""
    headings = np.array([0.0, np.pi / 4, np.pi / 2, np.pi])
    parked = Trial(robot, 4, headings)
    parked.tilt(np.full(4, np.radians(30.0)))
    parked.drive([0.0, 0.0])
    parked.advance(3.0)
    before = parked.position.copy()
    parked.advance(5.0)
    return np.linalg.norm(parked.position - before, axis=1).max() / 5.0


@pytest.mark.parametrize("preset", PRESETS)
def test_slopes(preset):
    climbing_bound = np.radians(of_preset(preset, 0.1, 0.15))
    checks = []
    for name, robot in ROBOTS.items():
        frictions = (0.3, 0.5, 0.7, 0.9)
        errors = [climbing_limit(robot(LevelGround(mu), preset), mu) for mu in frictions]
        checks.append(Check(name, "climbing limit", np.abs(errors).max(), climbing_bound, "rad"))
        creep = creep_of(robot(LevelGround(), preset))
        checks.append(Check(name, "creep on 30 degrees", creep, 0.5e-3, "m/s"))
        # the contact gives way at the rear
        for what, bound in (("sideways", 0.5), ("backwards", 3.0)):
            error = tipping_error(robot(LevelGround(4.0), preset), what == "sideways")
            checks.append(Check(name, f"tips over {what}", abs(error), np.radians(bound), "rad"))
    report(f"Slopes, {preset}", checks)


def step_error(robot, friction):
    """Error of the highest step that a robot climbs at 0.03 m/s at the first attempt [m]."""

    def climbs(heights):
        count = len(heights)
        trial = Trial(robot, count)
        step = robot.model.geom("step").id
        trial.batch.expand("geom_pos")[:, step, 2] = heights - DEPTH
        wheels = robot.view.wheels
        foremost = (wheels[:, 0] + wheels[:, 2]).max()
        trial.position[:, 0] = FACE - 0.01 - foremost
        trial.drive([0.03, 0.03])
        way = FACE - trial.centre_of_mass()[0] + heights.max()
        over = np.zeros(count, bool)
        trying = np.ones(count, bool)
        steepest = np.zeros(count)
        for _ in range(int(1.5 * way / 0.03 / 0.1)):
            trial.advance(0.1, trying)
            over |= trial.centre_of_mass() > FACE + 0.01
            steepest = np.maximum(steepest, trial.lean())
            # one that falls back has failed
            trying &= ~over & (trial.lean() > steepest - np.radians(5.0))
            if not trying.any():
                break
        return over

    expected = highest_step(robot.view, friction)
    return limit(climbs, max(1e-3, expected - 0.02), expected + 0.02, 7) - expected


@pytest.mark.parametrize("preset", PRESETS)
def test_steps(preset):
    checks = []
    bound = of_preset(preset, 0.005, 0.006)
    for k, (hull, centre, friction) in enumerate(STEP_CASES, start=1):
        robot = box(LevelGround(friction, step=True), preset, hull, centre)
        error = step_error(robot, friction)
        checks.append(Check("highest step", f"box {k}", abs(error), bound, "m"))
    error = step_error(rescue(LevelGround(0.8, step=True), preset), 0.8)
    checks.append(Check("highest step", "rescue", abs(error), bound, "m"))
    report(f"Highest step, {preset}", checks)


def driven_depths(trial, steps, belts=lambda k: None, goal=np.inf):
    """Depths (K,) of all tracks that touch in each physics step, and the fastest speed [m],
    [m/s].
    """
    depths = []
    fastest = 0.0
    for k in range(steps):
        belts(k)
        driving = trial.position[:, 0] < goal
        if not driving.any():
            break
        trial.batch.step(ids=driving)
        reading = trial.belts.read()
        touching = reading.touching & driving[:, None]
        depths.append(reading.depth[touching])
        speed = np.linalg.norm(trial.velocity, axis=1)
        fastest = max(fastest, float(speed.max()))
    assert trial.batch.warning[..., 1].sum() == 0
    return np.concatenate(depths), fastest


def on_stairs(name, preset, rise, by_default=False):
    """Depths (K,) of tracks on ten stairs of 0.15 x 0.28 m at 0.3 m/s, and how many of three robots
    cross them.
    """
    course = Course((Stairs(rise=rise, run=0.28, number=10, width=1.2),), width=4.0, friction=1.0)
    robot = box(course, preset, **CLIMBER) if name == "box" else rescue(course, preset, STAIRS)
    if by_default:
        use_default_contact(robot.model)
    trial = Trial(robot, 3, np.array([-0.05, 0.0, 0.05]))
    trial.position[:] += np.array(course.start[:3])
    trial.drive([0.3, 0.3])
    depths, _ = driven_depths(trial, round(30.0 / trial.timestep), goal=course.goal)
    return depths, int((trial.position[:, 0] >= course.goal).sum())


def on_rough_ground(name, preset):
    """Depths (K,) and the fastest speed of six robots that drive at random for a minute on ground
    of 10 cm.
    """
    course = Course((Rough(length=30.0, amplitude=0.1, cell=0.1),), width=30.0)
    rng = generator(0, f"{name} {preset}")
    robot = ROBOTS[name](course, preset)
    trial = Trial(robot, 6, rng.uniform(-np.pi, np.pi, 6))
    trial.position[:, 0] = 30.0 * (np.arange(6) + 0.5) / 6
    trial.position[:, 2] += 0.15
    trial.advance(1.0)

    def belts(k):
        if k % round(2.0 / trial.timestep) == 0:
            trial.drive(rng.uniform(-0.3, 0.3, (6, 2)))

    return driven_depths(trial, round(60.0 / trial.timestep), belts)


@pytest.mark.parametrize("preset", PRESETS)
def test_stairs_and_rough_ground(preset):
    typical, largest = of_preset(preset, (0.004, 0.005), (0.006, 0.009))
    checks = []
    for name in ROBOTS:
        up, climbed = on_stairs(name, preset, 0.15)
        down, descended = on_stairs(name, preset, -0.15)
        rough, fastest = on_rough_ground(name, preset)
        left_behind = 6.0 - climbed - descended
        checks.append(Check(name, "robots that don't cross the stairs", left_behind, 0.0))
        for where, depths in (("stairs up", up), ("stairs down", down), ("rough ground", rough)):
            usual = np.quantile(depths, 0.99)
            checks.append(Check(name, f"penetration, {where}, 99 %", usual, typical, "m"))
            checks.append(Check(name, f"penetration, {where}, largest", depths.max(), largest, "m"))
        checks.append(Check(name, "fastest on rough ground", fastest, 1.0, "m/s"))
    report(f"Stairs and rough ground, {preset}", checks)


def worst_of(errors):
    """The error of the largest size, with its sign."""
    return float(errors[np.abs(errors).argmax()])


def test_the_default_contact():
    """MuJoCo's own contact parameters turn the same robots by a third less, and sink in deeper."""
    rows = []
    for name, robot in ROBOTS.items():
        for what, belts in (("slow", SLOW), ("pivot at 0.5 m/s", PIVOT)):
            errors, _ = turning_error(robot(LevelGround(), "accurate"), belts)
            by_default, _ = turning_error(robot(LevelGround(), "accurate"), belts, by_default=True)
            worst = worst_of(errors)
            worst_by_default = worst_of(by_default)
            quantity = f"{name}: half width of the ICRs, {what}"
            rows.append((quantity, percent(worst), percent(worst_by_default)))
            assert worst_by_default > 0.3
            assert abs(worst) < 0.03
        for what, rise in (("up", 0.15), ("down", -0.15)):
            depths, _ = on_stairs(name, "accurate", rise)
            depths_by_default, _ = on_stairs(name, "accurate", rise, by_default=True)
            largest = depths.max()
            largest_by_default = depths_by_default.max()
            texts = [significant(1e3 * depth, "mm") for depth in (largest, largest_by_default)]
            rows.append((f"{name}: largest penetration, stairs {what}", *texts))
            assert largest_by_default > largest
    Table("MuJoCo's default contact", ("quantity", "recipe", "default contact"), rows).print()
