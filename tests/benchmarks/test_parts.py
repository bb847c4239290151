"""Times of single parts of the pipeline, without bounds."""

import numpy as np
import pytest
from slip_data import grid
from wandered import GEOMETRY, LAW, wandered

from experiments.common.lookup import controller
from experiments.simulate.grid_runs import before_scanner
from sim import Fleet, LaserScanner, ScannerFeed, load_ground
from trackslip.controllers.named import CONTROLLERS
from trackslip.identification.law_fit import fit_drives
from trackslip.identification.preparation import drives_of
from trackslip.identification.steady_comparison import compare_laws
from trackslip.localization.plate import PlateLocator
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady import steady_parts
from trackslip.trajectory.named import load_reference

ROBOTS = 25


def driving(robot, ground=None):
    """Robots that drive on a circle."""
    fleet = Fleet(robot, np.tile(before_scanner(robot), (ROBOTS, 1)), ground, threads=1)
    fleet.command([2.0, 3.0])
    fleet.advance(2.0)
    return fleet


@pytest.mark.parametrize("ground", ["stone", "clay"])
def test_a_second_of_physics(benchmark, robot, ground):
    """On Coulomb ground, and on ground that shears."""
    benchmark(driving(robot, load_ground(ground)).advance, 1.0)


def test_localization_of_a_scan_of_each_robot(benchmark, robot):
    fleet = driving(robot)
    feed = ScannerFeed(LaserScanner(), fleet)
    scan = feed.scan(feed.measure(feed.true_ranges()[:, None, :])[:, 0])
    benchmark(PlateLocator(robot.plate).locate, scan, fleet.pose())


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_hundred_steps_of_a_controller(benchmark, name):
    """A hundred steps of a single robot, 5 cm beside a circle."""
    pilot, path = controller(name, GEOMETRY, 0.3, 0.05), load_reference("circle")
    times = 0.05 * np.arange(100)
    poses = path.pose(times) + np.array([0.05, 0.0, 0.0])

    def drive():
        pilot.reset()
        for time, pose in zip(times, poses, strict=True):
            pilot.twist(time, pose[None], path)

    benchmark(drive)


def test_laws_of_25_steady_runs(benchmark):
    benchmark(compare_laws, grid(LAW), GEOMETRY)


def test_a_law_of_a_drive_of_a_minute(benchmark):
    benchmark(fit_drives, "icr_radius", drives_of([wandered(duration=60.0)])[0], GEOMETRY)


def test_steady_stretches_of_a_log_of_100_000_rows(benchmark):
    rng = np.random.default_rng(0)
    twist = np.repeat(np.column_stack([rng.uniform(0.05, 0.3, 166), rng.uniform(-0.5, 0.5, 166)]), 600, axis=0)
    turn = np.cumsum(twist[:, 1]) * 0.01
    place = np.cumsum(twist[:, 0] * np.exp(1j * turn)) * 0.01
    pose = np.column_stack([place.real, place.imag, turn]) + rng.normal(0, 0.005, (len(turn), 3))
    log = RunLog("long", 0.01 * np.arange(len(turn)), LAW.sprocket_speeds(twist, GEOMETRY), pose)
    assert len(benchmark(steady_parts, log)) > 160
