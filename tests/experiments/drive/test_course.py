"""Drives over courses: pilots and recorded quantities."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.drive.config import Config as DriveConfig
from experiments.drive.course import STOPPED, PathPilot, drive_course
from experiments.drive.results import slip_by_slope
from experiments.drive.world import CourseWorld
from sim.robot.named import load_tracked
from sim.terrain import Course, Flat, Ramp

G, BOX_MASS = 9.81, 25.0


class Level:
    """States with given poses (R, 3)."""

    def __init__(self, pose):
        self.position, self.heading = np.insert(pose[:, :2], 2, 0.0, axis=1), pose[:, 2]


def driven(watch=lambda _: True, **options):
    world = CourseWorld.of(DriveConfig(**{"robot": "box", "course": "flat", "preset": "fast", **options}))
    return drive_course(world.traverse, world.pilot(), world.flippers(), watch=watch)


@pytest.mark.parametrize("heading", [0.0, np.pi, np.pi / 2, 0.7])
def test_slope_of_a_ramp_is_that_along_the_robot(heading):
    angle = 0.3
    course = Course((Ramp(angle=angle, length=4.0), Flat(1.0)))
    state = Level(np.array([[2.0, 0.1, heading]]))
    slope = replace(driven(duration=0.1), robot=load_tracked("box"), course=course, state=state).slope
    assert slope == pytest.approx(np.arctan(np.tan(angle) * np.cos(heading)), abs=1e-9)


def test_steady_driving_on_the_flat():
    run = driven(speed=0.4, duration=3.0)
    assert run.outcome == "time"
    late = run.time > 1.0
    np.testing.assert_allclose(run.state.velocity[late, 0], 0.4, atol=1e-3)
    np.testing.assert_allclose(run.slip[late], 0.0, atol=5e-3)
    np.testing.assert_allclose(run.load[late].sum(axis=1), G * BOX_MASS, rtol=5e-3)
    np.testing.assert_allclose(np.diff(run.time), 0.02, atol=1e-9)
    assert np.isnan(run.slip[0]).all()
    assert run.travel[-1] == pytest.approx(run.belt[1:].sum(axis=0) * 0.02)


def test_a_path_is_followed_to_its_end(tmp_path):
    path = tmp_path / "path.csv"
    path.write_text("x,y\n-1,0\n0,0\n1,0.4\n2,-0.2\n3,0\n")
    run = driven(path=path, speed=0.5)
    assert run.outcome == "reached"
    points = PathPilot.of(path, 0.5, 0.17).points
    off = np.hypot(*(run.state.position[:, None, :2] - points).transpose(2, 0, 1)).min(axis=1)
    assert off.max() < 0.15
    assert np.abs(run.command).max() <= 0.5 + 1e-12


def test_a_straight_path_leads_straight_on(tmp_path):
    path = tmp_path / "path.csv"
    path.write_text("x,y\n0,0\n2,0\n5,0\n")
    pilot = PathPilot.of(path, 0.3, 0.2)
    np.testing.assert_allclose(np.diff(pilot.points, axis=0), [[0.02, 0.0]] * 250, atol=1e-3)
    state = Level(np.array([[1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(pilot(state), [0.3, 0.3], atol=1e-9)
    left = pilot(Level(np.array([[1.0, -0.1, 0.0]])))
    assert left[0] < left[1] == pytest.approx(0.3)
    for x in (1.9, 2.8, 3.7, 4.6):
        assert pilot(Level(np.array([[x, 0.0, 0.0]]))) is not None
    assert pilot(Level(np.array([[5.1, 0.0, 0.0]]))) is None


@pytest.mark.parametrize(
    ("given", "angles"),
    [("0.5", [0.5] * 4), ("0.5,0.2", [0.5, 0.5, 0.2, 0.2]), ("0.1,0.2,0.3,0.4", [0.1, 0.2, 0.3, 0.4])],
)
def test_flippers_as_asked(given, angles):
    run = driven(robot="rescue", flippers=given, duration=0.5)
    np.testing.assert_allclose(run.state.flippers[-1], angles, atol=0.06)


def test_slip_in_bins_of_slope():
    slope = np.repeat([0.0, 0.1, 0.2], [10, 3, 20])
    slip = np.concatenate([np.linspace(0, 0.9, 10), [0.5] * 3, np.full(20, 0.2)])
    slip[-5:] = np.nan
    middle, quartiles = slip_by_slope(slope, slip, 0.1)
    np.testing.assert_allclose(middle, [0.0, 0.2])  # too few at 0.1
    np.testing.assert_allclose(quartiles, [[0.45, 0.225, 0.675], [0.2, 0.2, 0.2]])


def test_explosions_and_drivers_that_stop_end_a_run_by_name():
    def blow_up(traverse):
        if traverse.time[0] > 0.1:
            traverse.batch.qvel[0, :3] = 1e9
        return True

    stopped = driven(watch=lambda traverse: traverse.time[0] < 0.1)
    assert stopped.outcome == STOPPED
    run = driven(watch=blow_up)
    assert run.outcome == "exploded"
    assert np.isfinite([*run.state.qpos.ravel(), *run.state.qvel.ravel(), *run.load.ravel()]).all()
