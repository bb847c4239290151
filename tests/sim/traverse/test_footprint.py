from dataclasses import replace

import numpy as np
import pytest

from sim.robot.named import load_tracked
from sim.robot.tracked import TrackedRobot
from sim.terrain import Course, Flat, Ramp
from sim.traverse.config import TraverseConfig
from sim.traverse.footprint import Footprint
from sim.traverse.task import Crossing
from sim.traverse.world import Command, Traverse
from trackslip.errors import InvalidValueError

RAMP = Course((Ramp(0.58, 6.0),))
TANK = """<mujoco><worldbody><body name="tank"><freejoint/>
  <geom type="box" size="2.4 1.1 0.5" pos="0 0 1.1" mass="45000"/></body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    """6.5 m long and 3.3 m wide, more than a course's start platform is."""
    model = tmp_path_factory.mktemp("tank") / "tank.xml"
    model.write_text(TANK)
    hull = ((-2.2, 0.4, 0.4), (2.2, 0.4, 0.4), (-2.9, 0.75, 0.411), (2.9, 0.75, 0.35))
    return TrackedRobot(model, half_gauge=1.4, hull=hull, width=0.5)


def test_a_long_robot_starts_where_all_of_it_stands(tank):
    course = Footprint.of(tank).fit(RAMP)
    world = Traverse(tank, [course], threads=1, preset="accurate")
    weight, still = 45000 * 9.81, Command(np.zeros((1, 2)), np.zeros((1, 0)))
    assert world.state.position[0, 2] == pytest.approx(0.002)  # the gap at which robots are put down
    assert world.state.position[0, 0] + 2.9 + 0.35 <= 0
    heaviest = 0.0
    for _ in range(10):
        world.step(still)
        heaviest = max(heaviest, world.contact.load.sum())
    assert heaviest < 1.5 * weight
    assert world.contact.load.sum() == pytest.approx(weight, rel=1e-3)
    assert abs(world.state.pitch[0]) < 1e-3
    # it has crossed the course when all of it has, and stands on the goal platform then
    assert world.goal[0] == pytest.approx(course.placed[-2].x + 2.9 + 0.411)
    assert world.goal[0] + 2.9 + 0.35 <= 1e-9 + course.placed[-1].x


def test_a_course_that_a_robot_does_not_fit_on_is_refused(tank):
    with pytest.raises(InvalidValueError, match=r"start_length = 2.0: must be at least 6.61 m for this robot to stand"):
        Traverse(tank, [RAMP], threads=1)
    with pytest.raises(InvalidValueError, match=r"width = 3.0: must be at least 3.3 m for this robot to stand"):
        Traverse(tank, [replace(RAMP, start_length=8.0)], threads=1)
    Traverse(tank, [replace(RAMP, start_length=8.0, width=4.0)], threads=1)


def test_tasks_take_courses_that_fit_the_robot(tank):
    task = Crossing(TraverseConfig(robot=tank, course="random", start_heading=0.5), 2, threads=1)
    episodes = [task.draw(np.random.default_rng(seed), {"start_heading": 0.5 - seed}) for seed in range(2)]
    task.begin([0, 1], episodes)
    np.testing.assert_allclose(task.world.state.position[:, 2], 0.002, atol=1e-9)
    assert all(episode.course.width >= 1.5 * 3.3 for episode in episodes)


def test_robots_that_fit_start_and_end_where_courses_say():
    footprint = Footprint.of(load_tracked("rescue"))
    for course in (RAMP, Course((Flat(0.5),), 2.0, start_length=1.6, goal_length=1.2)):
        assert footprint.fit(course) is course
        assert footprint.start(course, 0.1) == course.start[0]
        assert footprint.goal(course) == course.goal
