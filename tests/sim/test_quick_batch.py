"""Short forms of MuJoCo's calls, compared with these."""

import numpy as np
import pytest

from sim import quick_batch
from sim.fleet import Fleet
from sim.robot.robot import SCANNED_GROUP


@pytest.fixture(params=["a known MuJoCo", "another MuJoCo"])
def fleet(request, robot, monkeypatch):
    if request.param == "another MuJoCo":
        monkeypatch.setattr(quick_batch, "_KNOWN", False)
    fleet = Fleet(robot, np.array([[0.0, 0.0, 0.3], [0.5, 0.1, -1.0], [-0.2, 0.4, 2.0]]), threads=1)
    fleet.command([3.0, 2.0])
    fleet.advance(0.3)
    return fleet


def test_sensors_are_those_of_a_rollout(fleet):
    batch, before = fleet.batch, fleet.batch.state.copy()
    expected = batch.rollout(4, record=("sensordata",))["sensordata"]
    after = batch.state.copy()
    batch.state[:] = before
    sensed = np.empty_like(expected)
    batch.record_sensors(sensed)
    np.testing.assert_array_equal(sensed, expected)
    np.testing.assert_array_equal(batch.state, after)


def test_sensors_of_some_robots_leave_the_others_alone(fleet):
    batch, before = fleet.batch, fleet.batch.state.copy()
    everyone = batch.rollout(4, record=("sensordata",))["sensordata"]
    batch.state[:] = before
    some = np.array([0, 2])
    sensed = np.empty_like(everyone[some])
    batch.record_sensors(sensed, some)
    np.testing.assert_array_equal(sensed, everyone[some])
    np.testing.assert_array_equal(batch.state[1], before[1])


def test_rays_hit_what_they_hit_in_the_long_form(fleet):
    angle = np.linspace(0, 2 * np.pi, 90)
    x, y, heading = fleet.pose().T
    origins = np.stack([x + 2, y, np.full(3, fleet.robot.lrf_height)], axis=-1)[:, None].repeat(90, axis=1)
    directions = np.stack(np.broadcast_arrays(np.cos(angle - heading[:, None]), np.sin(angle), 0.0), axis=-1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    groups = np.arange(6) == SCANNED_GROUP
    for exclude in (fleet.robot.model.body("lrf").id, fleet.robot.model.body("chassis").id):
        expected, _ = fleet.batch.ray(origins, directions, geomgroup=groups, bodyexclude=exclude)
        np.testing.assert_array_equal(fleet.batch.cast(origins, directions, groups, exclude), expected)
    assert (expected == -1).all()  # the plate is the chassis'
    assert (fleet.batch.cast(origins, directions, groups, fleet.robot.model.body("lrf").id) > 0).any()
