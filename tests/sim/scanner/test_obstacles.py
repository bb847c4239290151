"""Obstacles in the way of beams."""

import re

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim import Fleet, LaserScanner, ScannerFeed
from sim.scanner.scanner import Obstacles, Post, Wall
from trackslip.errors import InvalidValueError


def fan(beams=720):
    angle = np.arange(beams) / beams * 2 * np.pi + 1e-3
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def engine_ranges(obstacles, origin, directions):
    """The same obstacles as geoms: cylinders, and boxes 2 um thick."""
    places = [(post.x, post.y, post.radius) for post in obstacles.posts]
    geoms = [f'<geom type="cylinder" size="{radius} 1" pos="{x} {y} 0"/>' for x, y, radius in places]
    geoms += [
        f'<geom type="box" size="1e-6 1e-6 1" fromto="{wall.x0} {wall.y0} 0 {wall.x1} {wall.y1} 0"/>'
        for wall in obstacles.walls
    ]
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{''.join(geoms)}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hit = np.zeros(1, np.int32)
    start = np.array([*origin, 0.0])
    distance = [mujoco.mj_ray(model, data, start, np.array([*d, 0.0]), None, 1, -1, hit) for d in directions]
    return np.where(np.array(distance) < 0, np.nan, distance)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_ranges_are_those_of_the_engine(seed):
    rng = np.random.default_rng(seed)
    posts = tuple(Post(*rng.uniform(1.0, 5.0, 2), rng.uniform(0.05, 0.5)) for _ in range(3))
    walls = tuple(Wall(*rng.uniform(-5.0, -1.0, 4)) for _ in range(3))
    obstacles = Obstacles(posts, walls)
    origin, directions = rng.uniform(-0.2, 0.2, 2), fan()
    ranges, expected = obstacles.ranges(origin, directions), engine_ranges(obstacles, origin, directions)
    differ = np.isnan(ranges) != np.isnan(expected)
    assert differ.sum() <= 2  # a beam along the very edge
    np.testing.assert_allclose(ranges[~differ], expected[~differ], atol=1e-3)


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [
        ("posts", Post(-1.5, -1.2, 0.3), Post(-1.5, -1.2, 0.28)),
        ("walls", Wall(-3.5, -2.5, 0.5, -0.5), Wall(-1.4, -1.5, 0.5, -1.5)),
    ],
)
def test_obstacles_on_the_scanner_are_refused(robot, name, inside, outside):
    fleet = Fleet(robot, [[-1.5, 0.5, 0.3]])
    ScannerFeed(LaserScanner(), fleet, obstacles=Obstacles(**{name: (outside,)}))
    message = f"{name}[1] = {inside}: must be at least 0.01 m away from the scanner, which is at (-1.5, -1.5)"
    with pytest.raises(InvalidValueError, match=f"^{re.escape(message)}$"):
        ScannerFeed(LaserScanner(), fleet, obstacles=Obstacles(**{name: (outside, inside)}))


def test_a_post_hides_a_part_of_the_plate_and_nothing_else(robot):
    fleet = Fleet(robot, [[-1.5, 0.5, 0.3], [3.0, 0.5, 0.0]])
    open_field, hidden, behind = (
        ScannerFeed(LaserScanner(), fleet, obstacles=Obstacles(posts=posts)).true_ranges()
        for posts in ((), (Post(-1.5, -0.5),), (Post(-1.5, 2.0, 0.1),))
    )
    shadow = np.abs(LaserScanner().bearings) <= np.arcsin(0.05)
    np.testing.assert_array_equal(hidden[:, ~shadow], open_field[:, ~shadow])
    bearing = LaserScanner().bearings[shadow]
    near = np.cos(bearing) - np.sqrt(0.05**2 - np.sin(bearing) ** 2)
    np.testing.assert_allclose(hidden[:, shadow], np.tile(near, (2, 1)), atol=1e-12)
    assert np.isfinite(open_field[0, shadow]).all()
    np.testing.assert_array_equal(behind[0], open_field[0])  # the plate hides it wholly
