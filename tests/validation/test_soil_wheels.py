"""Wheeled robots in soft soil against theory: ruts and resistances of both axles, thrust under
pulls and on slopes, turns, passes over a rut, and robots that dig themselves in.

Energy and the physics step are in test_soil.py.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from trials import report

from experiments.common.check import Check
from sim import Fleet, Ground, Pull, load_robot
from sim.ground.ground import NAMED_GROUNDS
from sim.motors.motor import tireless
from sim.robot.named import load_parameters
from sim.robot.parameters import SINK
from trackslip.skid_theory import (
    Load,
    Wheels,
    drawbar_curve,
    most_slope,
    roll,
    slip_for,
    steady_twist,
)

pytestmark = pytest.mark.slow
GRAVITY = 9.81
HUSKY, _ = load_parameters("husky")
WARTHOG, _ = load_parameters("warthog")
SOILS = {
    name: NAMED_GROUNDS[name].soil for name in ("dry_sand", "lete_sand", "upland_loam", "regolith")
}
"""Soils that bear a Husky; in soft snow, it sinks in up to its axles."""
HITCH = 0.2  # height of the hitch [m]
SPEED = 0.12  # of the wheels [m/s]


def wheels_of(robot):
    return Wheels(
        robot.axles[1] - robot.axles[0],
        robot.sprocket_radius,
        robot.track_width,
        robot.mass * GRAVITY,
        robot.com_x,
        robot.com_height,
        SINK,
    )


WHEELS = wheels_of(HUSKY)


def fleet_on(grounds, robot=HUSKY, start=None, **options):
    """A fleet with a robot on each of the grounds, with unlimited motors."""
    start = np.zeros((len(grounds), 3)) if start is None else start
    return Fleet(load_robot(robot), start, list(grounds), 0.0, tireless(2.0), **options)


def drive(fleet, omega, seconds):
    fleet.command(omega)
    fleet.advance(round(seconds / fleet.period) * fleet.period)


class Driven:
    """Steady motion straight ahead on several grounds: slip, forces and depths (N,)."""

    def __init__(self, grounds, robot=HUSKY, speed=SPEED, distance=2.0, slip=0.0, pull=0.0):
        """Drive over a distance [m] at about this slip."""
        fleet = fleet_on(grounds, robot, pull=Pull(pull, HITCH, since=1.0))
        seconds = 1.0 + distance / (speed * (1 - slip))
        drive(fleet, [speed / robot.sprocket_radius] * 2, seconds)
        before = fleet.pose()[:, 0]
        fleet.advance(1.0)
        self.slip = 1 - (fleet.pose()[:, 0] - before) / speed
        self.thrust = fleet.mean_traction.sum(axis=1)
        by_wheel = fleet.ruts.wheel_depth.reshape(len(grounds), 2, -1).mean(axis=1)
        self.rear = by_wheel[:, 0]
        self.front = by_wheel[:, -1]
        self.resistance = -fleet.ruts.resistance.sum(axis=1)
        self.pitch = -fleet.attitude()[:, 2]


def theory_at(soil, slip, wheels=WHEELS, **load):
    """The drawbar curve at one slip, and the load of a front wheel [N]."""
    curve = drawbar_curve(soil, wheels, [min(max(slip, 1e-6), 1.0)], **load)
    lean = wheels.com_height * math.tan(load.get("slope", 0.0) + curve.pitch[0])
    normal = wheels.weight * math.cos(load.get("slope", 0.0))
    towed = load.get("hitch_height", 0.0) * max(curve.pull[0], 0.0)
    moment = towed + wheels.radius * curve.resistance[0]
    arm = wheels.com_x - lean - moment / normal
    return curve, normal * (0.5 + arm / wheels.length) / 2


def test_ruts_and_resistance_on_the_level():
    checks = []
    for name, robot, soils, speed in (
        ("Husky", HUSKY, SOILS, SPEED),
        ("Husky, 0.8 m/s", HUSKY, {"upland_loam": SOILS["upland_loam"]}, 0.8),
        (
            "Warthog",
            WARTHOG,
            {"dry_sand": SOILS["dry_sand"], "upland_loam": SOILS["upland_loam"]},
            0.5,
        ),
    ):
        driven = Driven([Ground(soil=soil) for soil in soils.values()], robot, speed, 3.0)
        wheels = wheels_of(robot)
        for k, (soil_name, soil) in enumerate(soils.items()):
            theory, front_load = theory_at(soil, driven.slip[k], wheels)
            front = roll(soil, wheels, front_load, 0.0, driven.slip[k])
            case = f"{name}, {soil_name}"
            checks.append(Check(case, "front rut", driven.front[k] / front.rut[0] - 1, 0.01))
            checks.append(Check(case, "rear rut", driven.rear[k] / theory.sinkage[0] - 1, 0.01))
            force = driven.resistance[k] / theory.resistance[0] - 1
            checks.append(Check(case, "resistance", force, 0.01))
    report("Wheels on level soil", checks)


def test_pulls():
    weight = WHEELS.weight
    curves = [drawbar_curve(soil, WHEELS, hitch_height=HITCH) for soil in SOILS.values()]
    most = [curve.pull[curve.most] for curve in curves]
    thrust = np.zeros(len(SOILS))
    drawbar = np.zeros(len(SOILS))
    pitch = np.zeros(len(SOILS))
    for share in (0.2, 0.5, 0.8):
        for k, soil in enumerate(SOILS.values()):
            pull = share * most[k]
            slip = slip_for(soil, WHEELS, pull, hitch_height=HITCH)
            driven = Driven([Ground(soil=soil)], speed=0.3, distance=3.0, slip=slip, pull=pull)
            theory, _ = theory_at(soil, driven.slip[0], hitch_height=HITCH)
            thrust[k] = max(thrust[k], abs(driven.thrust[0] - theory.thrust[0]) / weight)
            drawbar[k] = max(drawbar[k], abs(pull - theory.pull[0]) / weight)
            pitch[k] = max(pitch[k], abs(driven.pitch[0] - theory.pitch[0]))
    checks = []
    for k, name in enumerate(SOILS):
        checks.append(Check(name, "thrust / weight, to 0.8 of the most", thrust[k], 0.004))
        checks.append(Check(name, "drawbar / weight, to 0.8 of the most", drawbar[k], 0.002))
        checks.append(Check(name, "pitch", pitch[k], math.radians(0.05), "rad"))
    report("Drawbar pull of wheels", checks)


def test_slopes():
    checks = []
    for name, slopes in (
        ("lete_sand", np.radians([5.0, 10.0, 15.0])),
        ("upland_loam", np.radians([5.0, 10.0, 15.0])),
        ("regolith", np.radians([5.0, 10.0])),
    ):
        soil = SOILS[name]
        expected = [slip_for(soil, WHEELS, slope=slope) for slope in slopes]
        grounds = [Ground(soil=soil, slope=slope) for slope in slopes]
        driven = Driven(grounds, speed=0.3, distance=3.0, slip=max(expected))
        error = np.abs(driven.slip - expected).max()
        checks.append(Check(name, "slip uphill", error, 0.002))
    report("Slopes under wheels", checks)


def test_steepest_slope():
    """Of soil without slip-sinkage, where a robot shows within seconds whether it climbs.

    On steeper slopes, a robot may drive until its rear wheels meet the ruts in which the front
    wheels began, and stops there.
    """
    checks = []
    for name in ("upland_loam", "regolith"):
        soil = replace(SOILS[name], n1=0.0)
        expected = most_slope(soil, WHEELS)
        slopes = expected + np.radians(np.arange(-2.5, 3.0, 0.5))
        fleet = fleet_on([Ground(soil=soil, slope=slope) for slope in slopes])
        speed = 0.5
        drive(fleet, [speed / HUSKY.sprocket_radius] * 2, 25.0)
        before = fleet.pose()[:, 0]
        fleet.advance(1.0)
        moves = fleet.pose()[:, 0] - before > 0.01 * speed
        climbs = moves & (before > 2 * WHEELS.length)
        steepest = float(slopes[climbs].max(initial=0.0))
        bound = math.radians(1.0)
        checks.append(Check(name, "steepest slope", steepest, bound, "rad", float(expected)))
    report("Steepest slope under wheels", checks)


def mean_distance(rolling):
    """Mean distance of the pressure under a wheel behind the entry [m]."""
    return float((rolling.pressure * rolling.behind).sum() / rolling.pressure.sum())


def test_turns():
    """Of soil without cohesion, weight and slip-sinkage, whose friction is equal for all wheels."""
    checks = []
    belts = np.array([[0.09, 0.15], [0.06, 0.12], [0.15, 0.20]])
    for name in ("lete_sand", "upland_loam", "regolith"):
        soil = replace(SOILS[name], n1=0.0, cohesion=0.0, unit_weight=0.0, shear=2e-4)
        fleet = fleet_on([Ground(soil=soil)] * len(belts))
        drive(fleet, belts / HUSKY.sprocket_radius, 20.0)
        before = fleet.pose()[:, 2]
        fleet.advance(1.0)
        found = (belts[:, 1] - belts[:, 0]) / (2 * (fleet.pose()[:, 2] - before))
        friction = math.tan(soil.friction_angle)
        contact = HUSKY.contact_theory(friction, friction, 200)
        first = roll(soil, WHEELS, WHEELS.weight / 4)
        second = roll(soil, WHEELS, WHEELS.weight / 4, first.rut)
        mean = np.mean([mean_distance(rolling) for rolling in (first, second)])
        resistance = 2 * float(first.resistance[0] + second.resistance[0])
        load = Load(pull=resistance / WHEELS.weight, hitch_height=WHEELS.radius)
        modulus = soil.shear * HUSKY.patch_length / (2 * mean)
        rate = steady_twist(belts, contact, GRAVITY, modulus, load)[:, 2]
        expected = (belts[:, 1] - belts[:, 0]) / (2 * rate)
        error = np.abs(found / expected - 1).max()
        checks.append(Check(name, "b + D in turns", error, 0.01))
    report("Turns of wheels in soil", checks)


def test_passes():
    """A robot that is put back to the beginning of its rut, again and again."""
    checks = []
    soil = replace(SOILS["upland_loam"], n1=0.0)
    omega = SPEED / HUSKY.sprocket_radius
    fleet = fleet_on([Ground(soil=soil)])
    ruts = [0.0]
    for number in range(1, 5):
        # both axles are where both rolled in all passes before
        drive(fleet, [omega] * 2, 7.0)
        force = -fleet.ruts.resistance.sum()
        depth = float(fleet.ruts.deepest.mean())
        expected = 0.0
        for _ in range(2):
            rolling = roll(soil, WHEELS, WHEELS.weight / 4, ruts[-1])
            ruts.append(float(rolling.rut[0]))
            expected += 2 * float(rolling.resistance[0])
        checks.append(Check(f"pass {number}", "rut", depth / ruts[-1] - 1, 0.01))
        checks.append(Check(f"pass {number}", "resistance", force / expected - 1, 0.02))
        drive(fleet, [omega] * 2, 8.0)
        fleet.state.qpos[0, :2] = 0.0
        fleet.state.qvel[0] = 0.0
    report("Passes of wheels over a rut", checks)


def test_immobilised():
    """Up to the largest pull of theory, robots drive on; beyond it, they dig themselves in."""
    checks = []
    for name in ("upland_loam", "regolith"):
        soil = SOILS[name]
        curve = drawbar_curve(soil, WHEELS, hitch_height=HITCH)
        most = float(curve.pull[curve.most])
        low = 0.8 * most
        high = 1.2 * most
        for _ in range(5):
            middle = (low + high) / 2
            drives = Driven([Ground(soil=soil)], pull=middle, speed=0.3, slip=0.8).slip[0] < 0.95
            low = middle if drives else low
            high = high if drives else middle
        share = low / WHEELS.weight
        expected = most / WHEELS.weight
        checks.append(Check(name, "largest pull / weight", share, 0.02, "1", expected))
    report("Immobilised wheels", checks)


def test_parking():
    checks = []
    slope = math.radians(10.0)
    headings = (0.0, np.pi / 4, np.pi / 2)
    for name, soil in SOILS.items():
        grounds = [Ground(soil=soil, slope=slope)] * len(headings)
        start = np.array([(0.0, 0.0, heading) for heading in headings])
        fleet = fleet_on(grounds, start=start)
        fleet.advance(2.0)
        before = fleet.pose()
        fleet.advance(5.0)
        moved = fleet.pose() - before
        creep = float(np.hypot(moved[:, 0], moved[:, 1]).max()) / 5.0
        checks.append(Check(name, "creep on 10°", creep, 0.06e-3, "m/s"))
    report("Parking wheels in soil", checks)
