"""Speeds over the bare engine, with bounds: `pytest tests/benchmarks/test_ratios.py` prints
docs/speed.md's table.
"""

import math
import os
import subprocess
import sys
from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
from bare_engine import SameMotion, bare_copy, seconds

from experiments.common.lookup import controller, locator
from experiments.simulate.grid_options import GridConfig
from experiments.simulate.grid_runs import before_scanner, cells_of, drive_grid
from experiments.simulate.options import IDENTIFIED
from experiments.simulate.world import World
from sim import LaserScanner, Pilot, ScannerFeed, closed_loop, load_robot
from sim.env import PathTrackingVectorEnv, TraverseVectorEnv
from sim.fleet.fleet import SETTLING, Fleet
from sim.ground.ground import NAMED_GROUNDS, Ground
from sim.path_tracking.config import PERIOD
from sim.robot.named import load_parameters
from sim.runs.stopwatch import Stopwatch
from sim.terrain import Course, Flat
from trackslip.controllers.named import CONTROLLERS
from trackslip.kinematics import RobotGeometry, sprocket_speeds
from trackslip.laws.file import load_laws
from trackslip.online.compensation import KNOWN_LAWS, FixedLaw
from trackslip.trajectory.named import load_reference
from trackslip.trajectory.segmented import circle, paper_reference

# simulated time of all robots together in a round, of which slow cases drive a part [s]
SECONDS = 20.0
RADIUS = 1.25  # of the circle that robots drive [m]
SPEED = 0.15  # of robots on it [m/s]
UNDER_WAY = 40  # control periods after which all robots of an environment drive
SCAN = LaserScanner().period


def periods(size: int, period: float, part: float = 1.0) -> int:
    return max(3, math.ceil(part * SECONDS / (size * period)))


def on_circle(robot, size: int, ground: Ground | None = None) -> Fleet:
    start = np.tile(before_scanner(robot), (size, 1))
    fleet = Fleet(robot, start, ground, threads=1)
    law = load_laws()["icr_radius"]
    fleet.command(law.sprocket_speeds([SPEED, SPEED / RADIUS], robot.geometry))
    fleet.advance(2.0)
    return fleet


def bare_steps(fleet: Fleet, duration: float) -> Callable[[], None]:
    """The bare engine's steps of so long a motion at constant speeds [s]."""
    bare = bare_copy(fleet.batch)
    steps = round(duration / fleet.robot.model.opt.timestep)
    return lambda: bare.step(nstep=steps)


@pytest.mark.parametrize(("size", "least"), [(1, 0.9), (25, 0.9), (256, 0.9)])
def test_fleet(compare, robot, size, least):
    fleet = on_circle(robot, size)
    duration = SCAN * periods(size, SCAN)
    compare(lambda: fleet.advance(duration), bare_steps(fleet, duration), least)


def compare_with_shear(compare, robot, size: int, ground: Ground, least: float) -> None:
    """Compare a fleet on soft soil with one on firm ground of the same friction and shear."""
    soft = on_circle(robot, size, ground)
    sheared = on_circle(robot, size, Ground(ground.along, ground.across, shear=ground.shear))
    duration = SCAN * periods(size, SCAN, 0.3)
    compare(lambda: soft.advance(duration), lambda: sheared.advance(duration), least)


@pytest.mark.parametrize(("size", "least"), [(1, 0.3), (25, 0.5), (256, 0.5)])
def test_soft_soil_under_tracks(compare, robot, size, least):
    compare_with_shear(compare, robot, size, NAMED_GROUNDS["dry_sand"], least)


@pytest.mark.parametrize(("size", "least"), [(1, 0.15), (25, 0.25), (256, 0.25)])
def test_soft_soil_under_wheels(compare, size, least):
    husky, _ = load_parameters("husky")
    compare_with_shear(compare, load_robot(husky), size, NAMED_GROUNDS["upland_loam"], least)


@pytest.mark.parametrize(("size", "least"), [(1, 0.2), (25, 0.6), (256, 0.7)])
def test_scanner(compare, robot, size, least):
    """The fleet, and the rays and noise of a scan every 50 ms."""
    fleet = on_circle(robot, size)
    count = periods(size, SCAN, 0.5)
    feed = ScannerFeed(LaserScanner(), fleet)

    def scan():
        for _ in range(count):
            fleet.advance(SCAN)
            feed.measure(feed.true_ranges()[:, None, :])

    compare(scan, bare_steps(fleet, SCAN * count), least)


@pytest.mark.parametrize(("size", "least"), [(1, 0.06), (10, 0.3), (25, 0.5), (256, 0.55)])
def test_closed_loop(compare, robot, size, least):
    duration = SCAN * periods(size, SCAN, 0.1)
    path = circle(RADIUS, SPEED, duration, before_scanner(robot))
    law = FixedLaw(load_laws()["icr_radius"])
    loop = []

    def start():
        fleet = Fleet(robot, np.tile(path.pose(0.0), (size, 1)), threads=1)
        pilot = Pilot(CONTROLLERS["linear"](), range(size), law)
        feed = ScannerFeed(LaserScanner(), fleet)
        loop[:] = fleet, [pilot], path, feed, locator("plate", robot)

    start()
    motion = SameMotion(loop[0])
    closed_loop(*loop, progress=motion.note)
    compare(lambda: closed_loop(*loop), motion.repeat, least, start)


@pytest.mark.parametrize(("size", "least"), [(1, 0.2), (25, 0.65), (256, 0.75)])
def test_path_tracking(compare, size, least):
    references = ("circle", "figure_eight", "slalom", "spiral")
    options = {"reference": references, "action": "twist", "compensation": "icr_radius"}
    single = size == 1
    if single:
        env = gymnasium.make("sim:trackslip/PathTracking-v0", **options).unwrapped
    else:
        env = PathTrackingVectorEnv(size, threads=1, **options)
    seen = np.empty((size, 0))

    def step(count: int, note=lambda duration: None):
        nonlocal seen
        for _ in range(count):
            ahead, aside, turned = seen[:, :3].T
            correction = np.stack([0.5 * ahead, aside + turned], axis=1)
            twist = seen[:, 3:5] + correction
            actions = np.clip(twist, -1, 1).astype(np.float32)
            seen, _, terminated, truncated, _ = env.step(actions[0] if single else actions)
            if single and (terminated or truncated):
                seen, _ = env.reset()
            seen = np.atleast_2d(seen)
            note(PERIOD)

    def start():
        nonlocal seen
        first, _ = env.reset(seed=0)
        seen = np.atleast_2d(first)
        step(UNDER_WAY)

    start()
    motion = SameMotion(env.task.fleet)
    count = periods(size, PERIOD, 0.5)
    step(count, motion.note)
    compare(lambda: step(count), motion.repeat, least, start)


def traversing(size: int, **options) -> tuple[TraverseVectorEnv, np.ndarray]:
    """Robots that cross courses, and the action by which the scripted controller alone drives
    them.
    """
    env = TraverseVectorEnv(size, threads=1, action="correction", **options)
    still = np.zeros(env.action_space.shape, np.float32)
    return env, still


@pytest.mark.parametrize(("size", "least"), [(1, 0.25), (25, 0.6), (256, 0.65)])
def test_traverse(compare, size, least):
    """Robots that cross courses, whose motors read the ground in each sample; the bare engine has
    none.
    """
    env, still = traversing(size)

    def start():
        env.reset(seed=0)
        for _ in range(UNDER_WAY // 2):
            env.step(still)

    start()
    world = env.task.world
    bare = bare_copy(world.batch)
    count = periods(size, world.period, 0.05)
    steps = round(world.period / world.tracked.model.opt.timestep)
    state = bare.state.copy()
    surface = bare.expand("geom_surfacevel")
    motion = []
    for _ in range(count):
        env.step(still)
        motion.append((world.batch.expand("geom_surfacevel").copy(), world.batch.ctrl.copy()))

    def repeat():
        bare.state[:] = state
        for belts, motors in motion:
            surface[:] = belts
            bare.ctrl[:] = motors
            bare.step(nstep=steps)

    compare(lambda: [env.step(still) for _ in range(count)], repeat, least, start)


@pytest.mark.parametrize(("course", "least"), [("stairs", 0.33), ("random", 0.4)])
def test_traverse_over_level_ground(compare, course, least):
    level, still = traversing(64, course=Course((Flat(6.0),)))
    env, _ = traversing(64, course=course)
    for one in (level, env):
        one.reset(seed=0)
        for _ in range(UNDER_WAY // 2):
            one.step(still)
    compare(
        lambda: [env.step(still) for _ in range(3)],
        lambda: [level.step(still) for _ in range(3)],
        least,
    )


def grid_physics(world: World, grid: GridConfig) -> float:
    robot = world.robot
    cells = cells_of(grid)
    start = np.tile(before_scanner(robot), (len(cells), 1))
    fleet = Fleet(robot, start, threads=grid.threads)
    twist = np.array([(cell.speed, cell.speed / cell.radius) for cell in cells])
    fleet.command(sprocket_speeds(twist, 0.0, robot.geometry))
    fleet.advance(2.0)
    return seconds(bare_steps(fleet, SETTLING + grid.duration))


def test_localization_over_its_physics(benchmark, within):
    grid = GridConfig(seed=0, threads=1)
    watch = Stopwatch()
    world = World.of(grid)
    benchmark.pedantic(drive_grid, (grid, world), {"watch": watch})
    within(watch.stages["localization"] / grid_physics(world, grid), most=1.0)


def seconds_of_path_tracking(robot, threads: int) -> float:
    """The bare engine's time for the runs of `trackslip reproduce` along the paper's path."""
    path = paper_reference()
    laws = {**KNOWN_LAWS, **load_laws()}
    pilots = []
    for name in ("feedforward", "linear"):
        for law in (*KNOWN_LAWS, *IDENTIFIED):
            pilots.append(Pilot(CONTROLLERS[name](), [len(pilots)], FixedLaw(laws[law])))
    fleet = Fleet(robot, [path.pose(0.0)] * len(pilots), threads=threads)
    motion = SameMotion(fleet)
    feed = ScannerFeed(LaserScanner(), fleet)
    closed_loop(fleet, pilots, path, feed, locator("plate", robot), progress=motion.note)
    return seconds(motion.repeat)


def test_reproduce_over_its_physics(benchmark, within, robot, tmp_path):
    """`trackslip reproduce`, start of Python included, over its physics on as many processors."""
    threads = min(2, os.cpu_count() or 1)
    grid = GridConfig(threads=threads)
    bare = seconds_of_path_tracking(robot, threads) + grid_physics(World.of(grid), grid)
    command = [sys.executable, "-m", "experiments", "reproduce"]
    command += ["--seed", "0", "--threads", str(threads), "--out", str(tmp_path / "out")]
    environment = dict(os.environ)
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    whole = [0.0]

    def run():
        subprocess.run(command, check=True, capture_output=True, env=environment)

    def reproduce():
        whole[0] = seconds(run)

    benchmark.pedantic(reproduce)
    within(whole[0] / bare, most=10.0)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_hundred_steps_of_a_controller(benchmark, name):
    """A hundred steps of a single robot, 5 cm beside a circle."""
    pilot = controller(name, RobotGeometry(0.168, 0.06), 0.3, 0.05)
    path = load_reference("circle")
    times = 0.05 * np.arange(100)
    poses = path.pose(times) + np.array([0.05, 0.0, 0.0])

    def drive():
        pilot.reset()
        for time, pose in zip(times, poses, strict=True):
            pilot.twist(time, pose[None], path)

    benchmark(drive)
