"""Friction that differs along and across the tracks, on courses that are planes."""

import numpy as np
import pytest

from sim import Traverse, load_tracked
from sim.robot.named import load_parameters
from sim.terrain import Course, Flat, Ramp, load_course
from sim.traverse.world import Command
from trackslip.errors import InvalidValueError, SettingsFileError
from trackslip.skid_theory import steady_twist

ALONG = 0.7


def even(across):
    return Course((Flat(3.0),), friction=ALONG, friction_across=across)


def turned(world, speed):
    """Mean yaw rates on the spot, after they have become steady [rad/s]."""
    flippers = np.zeros((1, len(world.flippers.length)))
    command = Command(speed * np.array([[-1.0, 1.0]]), flippers)
    rates = []
    for _ in range(120):
        world.step(command)
        rates.append(world.state.rate[0, 2])
    return np.mean(rates[80:])


@pytest.mark.parametrize("across", [0.5, 0.9])
@pytest.mark.parametrize("name", ["box", "shipped", "husky"])
def test_turns_are_as_theory_says(name, across):
    world = Traverse(
        load_tracked(name), [even(across)], preset="accurate", period=0.02, sample=0.004, threads=1
    )
    contact = load_parameters(name)[0].contact_theory(ALONG, across)
    theory = steady_twist([-0.1, 0.1], contact)[2]
    assert turned(world, 0.1) == pytest.approx(theory, rel=0.005)


def test_courses_of_a_world_may_differ_in_both_frictions():
    world = Traverse(load_tracked("box"), [even(0.9), even(0.5)], threads=1)
    hard = turned(world, 0.1)
    world.begin([0], [even(0.5)])
    easy = turned(world, 0.1)
    alone = Traverse(load_tracked("box"), [even(0.5)], threads=1)
    assert easy == pytest.approx(turned(alone, 0.1), rel=1e-6)
    assert easy > 1.2 * hard


def test_the_plane_is_where_the_course_is():
    course = even(0.9)
    np.testing.assert_array_equal(course.height([-1.0, 2.0, 100.0], [0.0, 0.5, 9.0]), 0.0)
    assert course.floor == 0.0
    assert even(None).floor < 0.0


def test_friction_across_needs_a_plane(tmp_path):
    with pytest.raises(InvalidValueError, match=r"friction_across = 0.9: must be left out, unless"):
        Course((Flat(1.0), Ramp()), friction_across=0.9)
    with pytest.raises(InvalidValueError, match=r"friction_across = 0.0: must be a finite number"):
        even(0.0)
    path = tmp_path / "even.toml"
    path.write_text(
        'friction = 0.7\nfriction_across = 0.9\n[[pieces]]\nkind = "flat"\nlength = 3\n'
    )
    assert load_course(str(path)).frictions == (0.7, 0.9)
    path.write_text('friction_across = 0.9\n[[pieces]]\nkind = "ramp"\n')
    with pytest.raises(SettingsFileError, match=r"friction_across = 0.9: must be left out, unless"):
        load_course(str(path))


def test_a_world_of_even_friction_refuses_another():
    world = Traverse(load_tracked("box"), [even(None)], threads=1)
    with pytest.raises(InvalidValueError, match=r"friction_across = 0.9: must be equal"):
        world.begin([0], [even(0.9)])
