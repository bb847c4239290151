"""Tracked robots in soft soil against theory: depths, resistances, thrust and trim under pulls and
on slopes, turns, passes over a rut, and robots that dig themselves in. Energy and the physics step,
on tracks and on wheels.

Bits, restarts and states are in tests/sim/ground/test_soft_fleets.py.
"""

import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest
from soft_soil import tracks_of
from trials import report

from experiments.common.check import Check
from sim import Fleet, Ground, Pull, RobotParameters, load_robot
from sim.ground.ground import NAMED_GROUNDS
from sim.motors.motor import tireless
from sim.robot.named import load_parameters
from sim.runs.run_recorder import read_contacts
from trackslip.errors import InvalidValueError
from trackslip.skid_theory import Load, drawbar_curve, most_slope, steady_twist

pytestmark = pytest.mark.slow
GRAVITY = 9.81
SHIPPED = RobotParameters()
HUSKY, _ = load_parameters("husky")
VEHICLE = RobotParameters(
    half_gauge=1.2,
    contact_length=3.5,
    track_width=0.5,
    sprocket_radius=0.3,
    mass=11_000.0,
    com_height=0.9,
    radius_error=0.0,
    drive=None,
)
"""A tracked vehicle of 11 t."""
SOILS = {name: ground.soil for name, ground in NAMED_GROUNDS.items() if ground.soil}
FIRMER = ("dry_sand", "lete_sand", "upland_loam", "regolith")
"""Soils in which the shipped robot sinks in by millimetres."""
HITCH = 0.1  # height of the hitch [m]
SPEED = 0.12  # of the belts [m/s]


TRACKS = tracks_of(SHIPPED)


def fleet_on(grounds, robot=SHIPPED, start=None, **options):
    """A fleet with a robot on each of the grounds, with unlimited motors."""
    start = np.zeros((len(grounds), 3)) if start is None else start
    return Fleet(load_robot(robot), start, list(grounds), 0.0, tireless(2.0), **options)


def drive(fleet, omega, seconds):
    fleet.command(omega)
    fleet.advance(round(seconds / fleet.period) * fleet.period)


class Driven:
    """Steady motion straight ahead on several grounds: slip, forces, depths and pitch (N,)."""

    def __init__(self, grounds, robot=SHIPPED, speed=SPEED, passes=4.0, pull=0.0):
        fleet = fleet_on(grounds, robot, pull=Pull(pull, HITCH, since=1.0))
        radius = robot.sprocket_radius
        drive(fleet, [speed / radius] * 2, 1.0 + passes * robot.contact_length / speed)
        before = fleet.pose()[:, 0]
        fleet.advance(1.0)
        self.slip = 1 - (fleet.pose()[:, 0] - before) / speed
        self.rut = fleet.ruts.deepest.mean(axis=1)
        self.resistance = -fleet.ruts.resistance.sum(axis=1)
        self.pitch = -fleet.attitude()[:, 2]
        # tractions are projected on the robot's axis, which the pitch shortens
        self.thrust = fleet.mean_traction.sum(axis=1) / np.cos(self.pitch)


def theory_at(soil, slip, tracks=TRACKS, **load):
    """The drawbar curve at one slip."""
    return drawbar_curve(soil, tracks, [min(max(slip, 1e-6), 1.0)], **load)


def test_depth_and_resistance_on_the_level():
    checks = []
    for name, robot, soils, speed in (
        ("shipped", SHIPPED, SOILS, SPEED),
        ("11 t", VEHICLE, {name: SOILS[name] for name in ("dry_sand", "upland_loam")}, 0.5),
    ):
        driven = Driven([Ground(soil=soil) for soil in soils.values()], robot, speed)
        for k, (soil_name, soil) in enumerate(soils.items()):
            theory = theory_at(soil, driven.slip[k], tracks_of(robot))
            case = f"{name}, {soil_name}"
            depth = driven.rut[k] / theory.sinkage[0] - 1
            force = driven.resistance[k] / theory.resistance[0] - 1
            checks.append(Check(case, "sinkage", depth, 0.01))
            checks.append(Check(case, "resistance", force, 0.015))
    report("Driving on level soil", checks)


def test_pulls():
    """Up to 0.9 of the largest pull, at which robots tilt by up to 3.6 degrees and slip by up to
    0.2.
    """
    weight = TRACKS.weight
    curves = [drawbar_curve(SOILS[name], TRACKS, hitch_height=HITCH) for name in FIRMER]
    most = [curve.pull[curve.most] for curve in curves]
    thrust = np.zeros(len(FIRMER))
    drawbar = np.zeros(len(FIRMER))
    pitch = np.zeros(len(FIRMER))
    for pull in (10.0, 25.0, 50.0, 75.0, 100.0, 115.0, 125.0, 137.0):
        driven = Driven([Ground(soil=SOILS[name]) for name in FIRMER], pull=pull, passes=6.0)
        for k, name in enumerate(FIRMER):
            if pull > 0.9 * most[k]:
                continue
            theory = theory_at(SOILS[name], driven.slip[k], hitch_height=HITCH)
            missed_thrust = abs(driven.thrust[k] - theory.thrust[0]) / weight
            thrust[k] = max(thrust[k], missed_thrust)
            drawbar[k] = max(drawbar[k], abs(pull - theory.pull[0]) / weight)
            pitch[k] = max(pitch[k], abs(driven.pitch[k] - theory.pitch[0]))
    checks = []
    for k, name in enumerate(FIRMER):
        checks.append(Check(name, "thrust / weight", thrust[k], 0.002))
        checks.append(Check(name, "drawbar / weight", drawbar[k], 0.002))
        checks.append(Check(name, "pitch", pitch[k], math.radians(0.05), "rad"))
    report("Drawbar pull", checks)


def test_pulls_of_a_vehicle():
    """A vehicle of 11 t, with pulls of 0.15 and 0.3 of its weight."""
    tracks = tracks_of(VEHICLE)
    checks = []
    names = ("dry_sand", "upland_loam")
    for share in (0.15, 0.3):
        pull = share * tracks.weight
        grounds = [Ground(soil=SOILS[name]) for name in names]
        driven = Driven(grounds, VEHICLE, speed=0.5, passes=6.0, pull=pull)
        for k, name in enumerate(names):
            theory = theory_at(SOILS[name], driven.slip[k], tracks, hitch_height=HITCH)
            case = f"{name}, {share:g} of the weight"
            missed = (pull - theory.pull[0]) / tracks.weight
            checks.append(Check(case, "drawbar / weight", missed, 0.002))
            lean = driven.pitch[k] - theory.pitch[0]
            checks.append(Check(case, "pitch", lean, math.radians(0.05), "rad"))
            depth = driven.rut[k] / theory.sinkage[0] - 1
            checks.append(Check(case, "sinkage", depth, 0.01))
    report("Drawbar pull of 11 t", checks)


def test_towing_uphill():
    """A pull and a slope together take the slip of both."""
    checks = []
    slopes = np.radians([5.0, 10.0, 15.0])
    for pull in (20.0, 45.0):
        for name in ("dry_sand", "regolith"):
            soil = SOILS[name]
            grounds = [Ground(soil=soil, slope=slope) for slope in slopes]
            driven = Driven(grounds, pull=pull, passes=6.0)
            missed = []
            for slope, slip in zip(slopes, driven.slip, strict=True):
                theory = theory_at(soil, slip, slope=slope, hitch_height=HITCH)
                missed.append(abs(pull - theory.pull[0]) / TRACKS.weight)
            case = f"{name}, {pull:g} N"
            checks.append(Check(case, "drawbar / weight, 5 to 15°", max(missed), 0.002))
    report("Towing uphill", checks)


def test_slopes():
    checks = []
    for name in ("dry_sand", "regolith", "upland_loam"):
        soil = SOILS[name]
        slopes = np.radians([5.0, 10.0, 15.0, 20.0])
        driven = Driven([Ground(soil=soil, slope=slope) for slope in slopes], passes=6.0)
        errors = []
        for slope, slip in zip(slopes, driven.slip, strict=True):
            # a step of Newton's method to the slip at which theory has nothing left to pull
            around = drawbar_curve(soil, TRACKS, slip + np.array([-1e-4, 0.0, 1e-4]), slope)
            errors.append(around.pull[1] / ((around.pull[2] - around.pull[0]) / 2e-4))
        error = np.abs(errors).max()
        checks.append(Check(name, "slip uphill, up to 20°", error, 0.001))
    report("Slopes", checks)


def standing_on(soil, slopes):
    """A fleet on those of the slopes, in ascending order, on which robots stand at rest."""
    while True:
        try:
            return fleet_on([Ground(soil=soil, slope=slope) for slope in slopes])
        except InvalidValueError:  # the steepest slides
            slopes = slopes[:-1]


@pytest.mark.parametrize("growth", [0.0, 0.4])
def test_steepest_slope(growth):
    """On a slope that is too steep, slip-sinkage digs a robot in within some lengths of contact."""
    checks = []
    around = np.radians(np.arange(-1.5, 1.6, 0.5))
    for name in ("dry_sand", "regolith"):
        soil = replace(SOILS[name], n1=growth)
        expected = most_slope(soil, replace(TRACKS, settlement=0.0))
        fleet = standing_on(soil, expected + around)
        drive(fleet, [SPEED / SHIPPED.sprocket_radius] * 2, 45.0)
        before = fleet.pose()[:, 0]
        fleet.advance(1.0)
        is_climbed = fleet.pose()[:, 0] - before > 0.02 * SPEED
        steepest = float(expected + around[: fleet.size][is_climbed].max())
        bound = math.radians(1.0)
        checks.append(Check(name, "steepest slope", steepest, bound, "rad", expected))
    report(f"Steepest slope, growth {growth:g} of the exponent", checks)


def half_width(fleet, belts, seconds):
    """b + D in steady turns."""
    drive(fleet, np.asarray(belts) / SHIPPED.sprocket_radius, seconds)
    before = fleet.pose()[:, 2]
    fleet.advance(1.0)
    rate = fleet.pose()[:, 2] - before
    return (belts[:, 1] - belts[:, 0]) / (2 * rate)


def expected_half_width(soil, belts, rolls):
    """b + D by the balance of friction and resistance, which is 0 in a rut."""
    pressure = TRACKS.pressure
    depth = float(soil.sinkage(pressure, TRACKS.width))
    along, across = soil.friction(pressure, depth, TRACKS.width).tolist()
    contact = SHIPPED.contact_theory(along, across, 200)
    resistance = 2 * TRACKS.width * float(soil.work(depth, TRACKS.width))
    load = Load(pull=resistance / TRACKS.weight if rolls else 0.0)
    rate = steady_twist(belts, contact, GRAVITY, soil.shear, load)[:, 2]
    return (belts[:, 1] - belts[:, 0]) / (2 * rate)


def test_turns():
    checks = []
    turns = np.array([[0.09, 0.15], [0.06, 0.12], [0.15, 0.20]])
    spins = np.array([[-0.06, 0.06], [-0.12, 0.12]])
    for name, soil in SOILS.items():
        # the theory of turns is for soil without slip-sinkage
        ground = Ground(soil=replace(soil, n1=0.0))
        is_snow = name == "soft_snow"
        for what, belts, rolls, seconds, bound in (
            ("b + D in turns", turns, True, 20.0, 0.01),
            ("b + D on the spot", spins, False, 25.0, 0.013),
        ):
            found = half_width(fleet_on([ground] * len(belts)), belts, seconds)
            error = np.abs(found / expected_half_width(ground.soil, belts, rolls) - 1).max()
            checks.append(Check(name, what, error, 0.1 if is_snow else bound))
    report("Turns in soil", checks)


def test_second_pass():
    """A track that is `offset` beside a rut meets the share offset / b of the resistance."""
    checks = []
    soil = replace(SOILS["regolith"], n1=0.0)
    width = SHIPPED.track_width
    omega = SPEED / SHIPPED.sprocket_radius
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        fleet = fleet_on([Ground(soil=soil)])
        drive(fleet, [omega] * 2, 10.0)
        fresh = -fleet.ruts.resistance.sum()
        # put the robot beside the beginning of its rut
        fleet.state.qpos[0, :2] = 0.3, share * width
        fleet.state.qvel[0] = 0.0
        drive(fleet, [omega] * 2, 4.0)
        again = -fleet.ruts.resistance.sum()
        checks.append(Check(f"offset {share:g} b", "resistance", again / fresh, 0.05, "1", share))
    report("Second pass", checks)


def test_immobilised():
    """Up to the largest pull of theory, robots drive on; beyond it, they dig themselves in.

    They tilt by 5 degrees, and the front of their tracks lifts.
    """
    checks = []
    for name in ("dry_sand", "regolith"):
        soil = SOILS[name]
        curve = drawbar_curve(soil, TRACKS, hitch_height=HITCH)
        low = 0.92 * curve.pull[curve.most]
        high = 1.08 * curve.pull[curve.most]
        for _ in range(4):
            middle = (low + high) / 2
            drives = Driven([Ground(soil=soil)], pull=middle, passes=16.0).slip[0] < 0.95
            low = middle if drives else low
            high = high if drives else middle
        most = float(curve.pull[curve.most] / TRACKS.weight)
        found = (low + high) / 2 / TRACKS.weight
        checks.append(Check(name, "largest pull / weight", found, 0.02, "1", most))
    report("Immobilised", checks)


def test_parking():
    checks = []
    slope = math.radians(10.0)
    headings = (0.0, np.pi / 4, np.pi / 2)
    for name in FIRMER:
        grounds = [Ground(soil=SOILS[name], slope=slope)] * len(headings)
        start = np.array([(0.0, 0.0, heading) for heading in headings])
        fleet = fleet_on(grounds, start=start)
        fleet.advance(2.0)
        before = fleet.pose()
        fleet.advance(5.0)
        moved = fleet.pose() - before
        creep = float(np.hypot(moved[:, 0], moved[:, 1]).max()) / 5.0
        checks.append(Check(name, "creep on 10°", creep, 0.06e-3, "m/s"))
    report("Parking in soil", checks)


@dataclass(frozen=True)
class Gear:
    """A robot, and soils that bear it."""

    robot: RobotParameters
    soils: tuple[str, ...]
    height: float
    """Height at which resistance acts on the robot [m]."""
    step_error: float
    """Bound on the effect of the physics step after 30 s of random commands [m]."""


GEARS = {
    "tracks": Gear(
        SHIPPED,
        tuple(SOILS),
        height=0.0,
        step_error=0.010,
    ),
    # ruts are made of cells of 29 mm, so that the end depends on where they lie: with the start
    # shifted by 3 mm, it shifts by up to 14 mm more
    "wheels": Gear(
        HUSKY,
        FIRMER,
        height=HUSKY.sprocket_radius,
        step_error=0.020,
    ),
}


@pytest.fixture(params=GEARS)
def gear(request):
    return GEARS[request.param]


def test_physics_step(gear):
    """The engine's usual step against one of 1 ms, after 30 s of random commands."""
    grounds = [NAMED_GROUNDS[name] for name in gear.soils]
    ends = []
    for step in (0.005, 0.001):
        robot = load_robot(gear.robot).with_single_contacts()
        robot.model.opt.timestep = step
        fleet = Fleet(robot, np.zeros((len(grounds), 3)), grounds, 0.0, tireless())
        generator = np.random.default_rng(3)
        for _ in range(30):
            fleet.command(generator.uniform(-3.0, 3.0, (len(grounds), 2)))
            fleet.advance(1.0)
        ends.append(fleet.pose()[:, :2])
    distance = np.hypot(*(ends[0] - ends[1]).T)
    checks = [
        Check(name, "5 ms against 1 ms", float(error), gear.step_error, "m")
        for name, error in zip(gear.soils, distance, strict=True)
    ]
    report("Physics step", checks)


def test_energy(gear):
    """The work of the belts goes to contacts, compaction and stored energy.

    The contacts take what their forces do on sliding and sinking, from contact sensors; compaction
    takes the resistance times the motion of where it acts; the stored energy is the engine's.
    """
    checks = []
    for name in gear.soils:
        ledger = Ledger(gear, NAMED_GROUNDS[name])
        balance = ledger.taken + ledger.pressed + ledger.stored
        error = balance / ledger.work - 1
        checks.append(Check(name, "energy, over the work of the belts", error, 0.01))
        share = ledger.pressed / ledger.work
        # which the balance can't overlook
        checks.append(Check(name, "share of compaction", share, (10 * abs(error), 1.0)))
    report("Energy in soil", checks)


class Ledger:
    """Where the work of two robots' belts goes in 8 s of random commands [J]."""

    def __init__(self, gear: Gear, ground: Ground) -> None:
        robot = load_robot(gear.robot, contact_sensors=True)
        robot.model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
        robot = robot.with_single_contacts()
        step = robot.model.opt.timestep
        motors = replace(tireless(), period=step)
        fleet = Fleet(robot, np.zeros((2, 3)), ground, 0.0, motors)
        energy = fleet.batch.bind("energy")
        generator = np.random.default_rng(5)
        contacts = []
        stored = []
        compaction = [0.0]
        for k in range(round(8.0 / step) + 1):
            if k % round(1.0 / step) == 0:
                fleet.command(generator.uniform(-3.0, 3.0, (2, 2)))
            resistance = fleet.ruts.resistance.copy()
            before = places_at(fleet, gear.height)
            fleet.advance(step)
            moved = places_at(fleet, gear.height) - before
            ahead = np.cos(before[:, 2]) * moved[:, 0] + np.sin(before[:, 2]) * moved[:, 1]
            by_side = ahead[:, None] + moved[:, 2:] * gear.robot.half_gauge * [-1.0, 1.0]
            compaction.append(-float((resistance * by_side).sum()))
            contacts.append(read_contacts(fleet))
            stored.append(float(energy.sum()))

        # sensors tell of a step's beginning: motion during it is the mean of two readings
        force = np.array([contact.force for contact in contacts[:-1]])
        load = np.array([contact.load for contact in contacts[:-1]])
        belts = np.array([contact.belt for contact in contacts[:-1]])
        velocity = np.array([contact.velocity for contact in contacts])
        rising = np.array([contact.rising for contact in contacts])
        sliding = (velocity[1:] + velocity[:-1]) / 2
        rising = (rising[1:] + rising[:-1]) / 2
        sliding[..., 0] += belts
        self.work = -step * (force[..., 0] * belts).sum()
        self.taken = -step * ((force * sliding).sum() + (load * rising).sum())
        self.pressed = sum(compaction[2:])
        self.stored = stored[-1] - stored[0]


def places_at(fleet, height):
    """Positions of the robots' points at a height, and headings, (N, 3) [m, m, rad]."""
    pose = fleet.pose()
    ahead = height * fleet.attitude()[:, 2]  # of the origin, as the robot noses down
    pose[:, 0] += np.cos(pose[:, 2]) * ahead
    pose[:, 1] += np.sin(pose[:, 2]) * ahead
    return pose
