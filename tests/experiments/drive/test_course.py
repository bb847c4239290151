"""Drives over courses: drivers and recorded quantities."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import models
from experiments.drive.config import Config as DriveConfig
from experiments.drive.course import STOPPED, drive_course
from experiments.drive.world import driver, make_world
from sim.robot.named import load_tracked
from sim.terrain import Course, Flat, Ramp
from trackslip.trajectory.waypoints import read_waypoints


def driven(change=lambda world: True, **options):
    """A drive; `change` may change the world before each command, and ends the drive by False."""
    config = DriveConfig(**{"robot": "box", "course": "flat", "preset": "fast", **options})
    world = make_world(config)
    steady = driver(config, world)
    return drive_course(world, lambda world: steady(world) if change(world) else None)


@pytest.mark.parametrize("heading", [0.0, np.pi, np.pi / 2, 0.7])
def test_slope_of_a_ramp_is_that_along_the_robot(heading):
    angle = 0.3
    course = Course((Ramp(angle=angle, length=4.0), Flat(1.0)))
    state = SimpleNamespace(position=np.array([[2.0, 0.1, 0.0]]), heading=np.array([heading]))
    slope = replace(driven(duration=0.1), robot=load_tracked("box"), course=course, state=state).slope
    assert slope == pytest.approx(np.arctan(np.tan(angle) * np.cos(heading)), abs=1e-9)


@pytest.mark.slow
def test_a_path_is_followed_to_its_end(tmp_path):
    path = tmp_path / "path.csv"
    path.write_text("x,y\n-1,0\n0,0\n1,0.4\n2,-0.2\n3,0\n")
    run = driven(path=path, speed=0.5)
    assert run.outcome == STOPPED
    reference = read_waypoints(path)
    points = reference.pose(np.linspace(0, reference.duration, 2000))[:, :2]
    off = np.hypot(*(run.state.position[:, None, :2] - points).transpose(2, 0, 1)).min(axis=1)
    assert off.max() < 0.06
    np.testing.assert_allclose(run.state.position[-1, :2], [3, 0], atol=0.02)
    assert np.abs(run.command.speed).max() <= 0.5 + 1e-12


def test_explosions_and_drivers_that_stop_end_a_run_by_name():
    def blow_up(world):
        if world.time[0] > 0.1:
            world.batch.qvel[0, :3] = 1e9
        return True

    assert driven(lambda world: world.time[0] < 0.1).outcome == STOPPED
    run = driven(blow_up)
    assert run.outcome == "exploded"
    assert np.isfinite([*run.state.qpos.ravel(), *run.state.qvel.ravel(), *run.contact.load.ravel()]).all()


@pytest.mark.parametrize(("limit", "climbs"), [(3.4, False), (4.0, True)])
def test_motors_of_the_robot_file_climb_what_their_torque_allows(tmp_path, limit, climbs):
    """25 kg on 20 degrees take 3.36 N m at either sprocket, and 0.3 N m of the gear's friction."""
    box = Path(models.__file__).parent / "box_robot.toml"
    text = box.read_text().replace("box_robot.xml", str(box.with_suffix(".xml")))
    (tmp_path / "box.toml").write_text(f"{text}\n[drive]\ntorque_limit = {limit}\n")
    run = driven(robot=str(tmp_path / "box.toml"), course="ramp20", duration=6.0)
    assert (run.state.position[-1, 2] > 0.2) == climbs
    assert (run.contact.belt[-1] > 0.25).all() == climbs
    assert run.contact.traction.max() * 0.08 < 1.1 * limit
