from dataclasses import replace

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from experiments.common.choices import FTR_NAMES
from sim import Command, TrackedRobot, Traverse, load_tracked
from sim.terrain import Beams, Course, Flat, Ramp, Rough, Stairs
from sim.traverse.courses import FTR_BOXES, FTR_COURSES, KINDS, MAX_BOXES, OBSTACLES, draw_course
from sim.traverse.ground import Footprint
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
    for course, message in (
        (Course((Stairs(0.1, 0.3, 6),), **SHORT), "course = '7 boxes': must be of at most 5"),
        (Course((Rough(1.0, 0.05),), **SHORT), "1 height fields"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            world.begin([0], [course])


def test_every_course_fits_the_slots():
    courses = [draw_course("random", 1.0, np.random.default_rng(seed), HULL) for seed in range(400)]
    assert max(len(course.solids) for course in courses) == MAX_BOXES
    assert {course.width for course in courses} == {2.0}


@pytest.mark.parametrize("kind", OBSTACLES)
def test_a_harder_course_has_larger_obstacles(kind):
    sizes = []
    for difficulty in (0.0, 0.5, 1.0):
        course = draw_course("random", difficulty, np.random.default_rng(5), HULL, 1, (kind,))
        x = np.linspace(-0.5, course.goal, 400)
        height = np.ptp(course.height(x, 0.0))
        sizes.append(course.goal if kind == "gap" else height)
    assert sizes == sorted(set(sizes))


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
    weight = 45000 * 9.81
    still = Command(np.zeros((1, 2)), np.zeros((1, 0)))
    # the gap at which robots are put down
    assert world.state.position[0, 2] == pytest.approx(0.002)
    front = world.state.position[0, 0] + 2.9 + 0.35
    assert front <= 0
    heaviest = 0.0
    for _ in range(10):
        world.step(still)
        heaviest = max(heaviest, world.contact.load.sum())
    assert heaviest < 1.5 * weight
    assert world.contact.load.sum() == pytest.approx(weight, rel=1e-3)
    assert abs(world.state.pitch[0]) < 1e-3
    # it has crossed the course when all of it has, and stands on the goal platform then
    assert world.goal[0] == pytest.approx(course.placed[-2].x + 2.9 + 0.411)
    front = world.goal[0] + 2.9 + 0.35
    assert front <= 1e-9 + course.placed[-1].x


def test_a_course_that_a_robot_does_not_fit_on_is_refused(tank):
    said = r"start_length = 2.0: must be at least 6.61 m for this robot to stand"
    with pytest.raises(InvalidValueError, match=said):
        Traverse(tank, [RAMP], threads=1)
    said = r"width = 3.0: must be at least 3.3 m for this robot to stand"
    with pytest.raises(InvalidValueError, match=said):
        Traverse(tank, [replace(RAMP, start_length=8.0)], threads=1)
    Traverse(tank, [replace(RAMP, start_length=8.0, width=4.0)], threads=1)


# its wheels have a radius of 0.08 m, those of FTR-Bench's robot 0.1 m
HULL = load_tracked("rescue").hull


def drawn(name, difficulty, seed=0):
    return draw_course(name, difficulty, np.random.default_rng(seed), HULL)


def highest(course):
    x = np.linspace(-1.0, course.goal, 2001)
    y = np.array([-0.4, 0.02, 0.4])
    return course.height(x[:, None], y).max()


def test_sizes_are_those_published():
    at_difficulties_0_and_1 = {  # heights [m]
        "steps_up": (0.2, 0.4),
        "uplifts": (0.2, 0.4),
        "one_sided": (0.1, 0.3),
        "waves": (0.1, 0.4),
        "rails": (0.2, 0.3),
    }
    for kind, (low, high) in at_difficulties_0_and_1.items():
        for difficulty, expected in ((0.0, low), (1.0, high), (0.5, (low + high) / 2)):
            published = drawn(f"{kind}_published", difficulty)
            assert highest(published) == pytest.approx(expected, rel=0.03)
            ours = drawn(kind, difficulty)
            assert highest(ours) == pytest.approx(0.8 * expected, rel=0.03)
    for difficulty, expected in ((0.0, 20.0), (1.0, 45.0)):
        (stairs,) = drawn("stairs_down_published", difficulty).pieces
        angle = np.degrees(np.arctan2(-stairs.rise, stairs.run))
        assert angle == pytest.approx(expected)
        assert 0.2 <= stairs.run <= 0.3
    (steps,) = drawn("steps_down_published", 1.0).pieces
    assert steps.height == pytest.approx(-0.6)
    (rails,) = drawn("rails", 1.0).pieces
    *_, slant = rails.blocks[0]
    assert abs(slant) == pytest.approx(np.radians(45))


def test_names_are_listed_and_courses_fit_into_the_environment():
    assert FTR_NAMES == FTR_COURSES
    for name in FTR_COURSES:
        courses = [drawn(name, hard, seed) for hard in (0.0, 1.0) for seed in range(20)]
        assert max(len(course.solids) for course in courses) <= FTR_BOXES
        assert drawn(name, 0.3) == drawn(name, 0.3)
    sides = set()
    for seed in range(20):
        _, y, *_ = drawn("one_sided", 0.5, seed).pieces[0].blocks[0]
        sides.add(np.sign(y))
    assert sides == {-1.0, 1.0}
    env = gym.make_vec(
        "sim:trackslip/Traverse-v0", num_envs=10, threads=1, course=KINDS, difficulty=(0.2, 0.4)
    )
    _, info = env.reset(seed=0, options={"course": list(KINDS)})
    difficulty = info["difficulty"]
    assert ((difficulty >= 0.2) & (difficulty <= 0.4)).all()
