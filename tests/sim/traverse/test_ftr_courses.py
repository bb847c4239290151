"""Courses of FTR-Bench: sizes as published and scaled, in the environment, and what is refused."""

import gymnasium as gym
import numpy as np
import pytest

from experiments.common.choices import FTR_NAMES
from sim.robot.named import load_tracked
from sim.traverse.ftr_courses import FTR_BOXES, FTR_COURSES, KINDS, draw_ftr_course
from trackslip.errors import InvalidValueError

ID = "sim:trackslip/Traverse-v0"
HULL = load_tracked("rescue").hull  # its wheels have a radius of 0.08 m, those of FTR-Bench's robot 0.1 m


def drawn(name, difficulty, seed=0):
    return draw_ftr_course(name, difficulty, np.random.default_rng(seed), HULL)


def highest(course):
    return course.height(np.linspace(-1.0, course.goal, 2001)[:, None], np.array([-0.4, 0.02, 0.4])).max()


HEIGHTS = {
    "steps_up": (0.2, 0.4),
    "uplifts": (0.2, 0.4),
    "one_sided": (0.1, 0.3),
    "waves": (0.1, 0.4),
    "rails": (0.2, 0.3),
}
"""At difficulties 0 and 1 [m]."""


def test_sizes_are_those_published():
    for kind, (low, high) in HEIGHTS.items():
        for difficulty, expected in ((0.0, low), (1.0, high), (0.5, (low + high) / 2)):
            assert highest(drawn(f"{kind}_published", difficulty)) == pytest.approx(expected, rel=0.03)
            assert highest(drawn(kind, difficulty)) == pytest.approx(0.8 * expected, rel=0.03)
    for difficulty, angle in ((0.0, 20.0), (1.0, 45.0)):
        (stairs,) = drawn("stairs_down_published", difficulty).pieces
        assert np.degrees(np.arctan2(-stairs.rise, stairs.run)) == pytest.approx(angle)
        assert 0.2 <= stairs.run <= 0.3
    assert drawn("steps_down_published", 1.0).pieces[0].height == pytest.approx(-0.6)
    assert abs(drawn("rails", 1.0).pieces[0].blocks[0][5]) == pytest.approx(np.radians(45))


def test_names_are_listed_and_courses_fit_into_the_environment():
    assert FTR_NAMES == FTR_COURSES
    for name in FTR_COURSES:
        assert max(len(drawn(name, d, seed).solids) for d in (0.0, 1.0) for seed in range(20)) <= FTR_BOXES
        assert drawn(name, 0.3) == drawn(name, 0.3)
    sides = {np.sign(drawn("one_sided", 0.5, seed).pieces[0].blocks[0][1]) for seed in range(20)}
    assert sides == {-1.0, 1.0}
    env = gym.make_vec(ID, num_envs=10, threads=1, course=KINDS, difficulty=(0.2, 0.4))
    _, info = env.reset(seed=0, options={"course": list(KINDS)})
    assert ((info["difficulty"] >= 0.2) & (info["difficulty"] <= 0.4)).all()
    env.task.set_difficulty(0.9, 1.0)
    _, info = env.reset()
    assert (info["difficulty"] >= 0.9).all()
    env.step(np.zeros((10, 6), np.float32))


def test_what_is_refused():
    env = gym.make(ID, course=("rails", "step10"))
    for attempt, message in (
        (lambda: drawn("lava", 0.5), "course = 'lava': must be one of steps_up"),
        (lambda: drawn("rails", None), "difficulty = None: must be from 0 to 1"),
        (lambda: gym.make(ID, course="lava"), r"course = 'lava': must be one of .*step10, random, steps_up"),
        (lambda: env.reset(options={"course": "step10", "difficulty": 7.0}), r"difficulty = 7\.0: must be from 0 to 1"),
        (lambda: env.reset(options={"start_offset": -5.0}), r"start_offset = -5\.0: must be from -1\.5 to 1\.5 m"),
        (lambda: env.reset(options={"course": "waves"}), "'waves': must be a course, or one of step10, rails"),
    ):
        with pytest.raises(InvalidValueError, match=message):
            attempt()
