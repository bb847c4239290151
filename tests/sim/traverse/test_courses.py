import numpy as np
import pytest

from sim.traverse.courses import MAX_BOXES, OBSTACLES, draw_course


def test_the_same_numbers_draw_the_same_course():
    one, two, other = (draw_course(np.random.default_rng(seed), 0.7) for seed in (3, 3, 4))
    assert one == two
    assert one != other


def test_every_course_fits_the_slots():
    courses = [draw_course(np.random.default_rng(seed), 1.0) for seed in range(400)]
    assert max(len(course.solids) for course in courses) == MAX_BOXES
    assert {course.width for course in courses} == {2.0}


@pytest.mark.parametrize("kind", OBSTACLES)
def test_a_harder_course_has_larger_obstacles(kind):
    def height(difficulty):
        course = draw_course(np.random.default_rng(5), difficulty, 1, (kind,))
        return np.ptp(course.height(np.linspace(-0.5, course.goal, 400), 0.0))

    def length(difficulty):
        return draw_course(np.random.default_rng(5), difficulty, 1, (kind,)).goal

    measure = length if kind == "gap" else height
    easy, middle, hard = (measure(difficulty) for difficulty in (0.0, 0.5, 1.0))
    assert easy < middle < hard
