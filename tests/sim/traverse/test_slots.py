"""Drawn courses, and courses in slots, which are the courses themselves to the bit."""

import mujoco
import numpy as np
import pytest

from sim.robot.named import load_tracked
from sim.terrain import Beams, Course, Flat, Ramp, Rough, Stairs
from sim.traverse.courses import MAX_BOXES, OBSTACLES, draw_course
from sim.traverse.world import Command, Traverse
from trackslip.errors import InvalidValueError

SHORT = {"width": 2.0, "start_length": 1.0, "goal_length": 1.0}
LISTED = [
    Course((Rough(2.0, 0.08),), friction=0.6, **SHORT),
    Course((Stairs(0.1, 0.3, 2), Flat(0.5), Ramp(-0.2, 1.0)), friction=0.8, **SHORT),
    Course((Rough(2.0, 0.1, cell=0.2),), friction=0.7, seed=4, **SHORT),
]
OTHER = Course((Beams(0.1, 0.6, 2, yaw=0.3),), friction=0.9, **SHORT)


@pytest.fixture(scope="module")
def world():
    world = Traverse(load_tracked("box"), LISTED, 5, boxes=3, threads=1)
    world.begin(np.arange(5), [*LISTED, OTHER, LISTED[0]])
    return world


def test_robots_drive_on_slots_as_on_the_course(world):
    speed = np.full((5, 2), 0.5)
    for _ in range(25):
        world.step(Command(speed, np.zeros((5, 0))))
    for row in range(4):
        alone = Traverse(load_tracked("box"), [world.course[row]], threads=1)
        alone.batch.expand("opt.disableflags")[:] |= int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)
        for _ in range(25):
            alone.step(Command(speed[:1], np.zeros((1, 0))))
        np.testing.assert_array_equal(world.state.qpos[row], alone.state.qpos[0])
    np.testing.assert_array_equal(world.state.qpos[4], world.state.qpos[0])
    assert (world.state.position[:, 0] > -0.4).all()


def test_courses_without_room_are_refused(world):
    steps = Course((Stairs(0.1, 0.3, 6),), **SHORT)
    with pytest.raises(InvalidValueError, match="course = '7 boxes': must be of at most 5"):
        world.begin([0], [steps])
    rough = Course((Rough(1.0, 0.05),), **SHORT)
    with pytest.raises(InvalidValueError, match="1 height fields"):
        world.begin([0], [rough])
    alone = Traverse(load_tracked("box"), [OTHER], threads=1)
    with pytest.raises(InvalidValueError, match="courses"):
        alone.begin([0], [steps])


def test_every_course_fits_the_slots():
    courses = [draw_course(np.random.default_rng(seed), 1.0) for seed in range(400)]
    assert max(len(course.solids) for course in courses) == MAX_BOXES
    assert {course.width for course in courses} == {2.0}


@pytest.mark.parametrize("kind", OBSTACLES)
def test_a_harder_course_has_larger_obstacles(kind):
    sizes = []
    for difficulty in (0.0, 0.5, 1.0):
        course = draw_course(np.random.default_rng(5), difficulty, 1, (kind,))
        height = np.ptp(course.height(np.linspace(-0.5, course.goal, 400), 0.0))
        sizes.append(course.goal if kind == "gap" else height)
    assert sizes == sorted(set(sizes))
