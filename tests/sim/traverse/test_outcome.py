"""How runs end: each outcome by a robot that comes to it, and by name."""

import numpy as np
import pytest

from sim.robot.named import load_tracked
from sim.terrain import Course, Flat, Step
from sim.traverse.outcome import Limits, Outcome, StuckWatch
from sim.traverse.world import Command, Traverse

WALL = Course((Flat(0.2), Step(0.6)), friction=0.5, start_length=1.4, goal_length=1.4)
ROWS = ("reached", "stuck", "fell", "tipped", "exploded", "time")


@pytest.fixture(scope="module")
def world():
    """A box in every row, each driven or put to another end."""
    limits = Limits(time=6.0, stuck_time=2.0)
    world = Traverse(load_tracked("box"), [WALL], len(ROWS), limits=limits, threads=1)
    start = np.tile([-0.6, 0.0, 0.0], (len(ROWS), 1))
    start[0] = WALL.goal - 0.1, 0.0, 0.0
    start[2] = -0.6, 1.3, np.pi / 2
    world.begin(np.arange(len(ROWS)), start=start)
    on_its_back = np.array([np.cos(0.7), np.sin(0.7), 0.0, 0.0])
    world.batch.qpos[3, 2:7] = 0.4, *on_its_back
    world.batch.qvel[4, 2] = 50.0
    speed = np.full((len(ROWS), 2), 0.5)
    speed[5] = -0.02, 0.02
    while (world.outcome == Outcome.DRIVING).any():
        world.step(Command(speed, np.zeros((len(ROWS), 0))))
    return world


def test_each_run_ends_by_name(world):
    assert tuple(Outcome(one).label for one in world.outcome) == ROWS
    contact = world.contact
    for values in (world.state.qpos, world.state.qvel, contact.traction, contact.load, contact.depth, contact.work):
        assert np.isfinite(values).all()


def test_runs_that_have_ended_stand_still(world):
    before = world.state.qpos.copy(), world.time.copy()
    world.step(Command(np.ones((len(ROWS), 2)), np.zeros((len(ROWS), 0))))
    np.testing.assert_array_equal(world.state.qpos, before[0])
    np.testing.assert_array_equal(world.time, before[1])
    assert world.time[5] == pytest.approx(6.0)


def test_a_state_that_is_not_finite_is_named_and_kept_out(capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    world = Traverse(load_tracked("box"), [WALL], 2, threads=1)
    fine = world.state.qpos[1].copy()
    gravity = world.batch.expand("opt.gravity")
    gravity[1, 2] = np.nan
    world.step(Command(np.zeros((2, 2)), np.zeros((2, 0))))
    assert [Outcome(one).label for one in world.outcome] == ["driving", "exploded"]
    np.testing.assert_array_equal(world.state.qpos[1], fine)
    gravity[1, 2] = gravity[0, 2]
    world.begin([1])
    world.step(Command(np.zeros((2, 2)), np.zeros((2, 0))))
    assert (world.outcome == Outcome.DRIVING).all()
    assert capfd.readouterr().err == ""
    assert not list(tmp_path.iterdir())  # the engine's MUJOCO_LOG.TXT


def test_who_waits_turns_or_slips_is_not_stuck():
    watch = StuckWatch(Limits(stuck_time=1.0), 4, period=0.1)
    position = np.zeros((4, 3))
    belts = np.array([[0.0, 0.0], [-0.3, 0.3], [0.3, 0.3], [0.3, 0.3]])
    speed = np.array([0.0, 0.0, 0.05, 0.02])  # at a tenth of the belts' way a robot is stuck
    found = []
    for _ in range(12):
        position[:, 0] += speed * 0.1
        found.append(watch.observe(position, belts))
    np.testing.assert_array_equal(found[-1], [False, False, False, True])
    assert not np.any(found[:10])
    watch.begin(np.array([3]))
    assert not watch.observe(position, belts).any()
