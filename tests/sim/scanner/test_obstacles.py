"""Obstacles against MuJoCo's own rays, and where a person walks."""

import re

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.fleet import Fleet
from sim.scanner.feed import ScannerFeed
from sim.scanner.obstacles import Obstacles, Post, Walker, Wall
from sim.scanner.scanner import LaserScanner
from trackslip.errors import InvalidValueError

NOW = np.zeros(1)


def fan(beams=720):
    angle = np.arange(beams) / beams * 2 * np.pi + 1e-3
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def engine_ranges(obstacles, origin, directions, time):
    """The same obstacles as geoms: cylinders, and boxes 2 um thick."""
    spec = mujoco.MjSpec()
    places = [(post.x, post.y, post.radius) for post in obstacles.posts]
    places += [(*walker.place(np.array(time)), walker.radius) for walker in obstacles.walkers]
    for x, y, radius in places:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, 1.0, 0], pos=[x, y, 0])
    for w in obstacles.walls:
        length, turn = np.hypot(w.x1 - w.x0, w.y1 - w.y0), np.arctan2(w.y1 - w.y0, w.x1 - w.x0)
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[length / 2, 1e-6, 1.0],
            pos=[(w.x0 + w.x1) / 2, (w.y0 + w.y1) / 2, 0],
            quat=[np.cos(turn / 2), 0, 0, np.sin(turn / 2)],
        )
    model = spec.compile()
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
    walkers = tuple(Walker(*rng.uniform([1, -5], [5, -1]), *rng.uniform(-0.5, 0.5, 2)) for _ in range(2))
    obstacles, time = Obstacles(posts, walls, walkers), float(rng.uniform(0.0, 1.0))
    origin, directions = rng.uniform(-0.2, 0.2, 2), fan()
    ranges, expected = obstacles.ranges(origin, directions, time), engine_ranges(obstacles, origin, directions, time)
    differ = np.isnan(ranges) != np.isnan(expected)
    assert differ.sum() <= 2  # a beam along the very edge
    np.testing.assert_allclose(ranges[~differ], expected[~differ], atol=1e-3)


def test_a_beam_along_a_wall_passes_it():
    wall = Obstacles(walls=(Wall(1.0, 0.0, 2.0, 0.0),))
    assert np.isnan(wall.ranges(np.zeros(2), np.array([[1.0, 0.0]]), NOW)).all()


def test_a_person_walks_straight_on_or_to_and_fro():
    time = np.array([-0.5, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0])
    straight, turning = Walker(1.0, 2.0, 0.5, -1.0), Walker(1.0, 2.0, 0.5, -1.0, turns_after=2.0)
    np.testing.assert_allclose(straight.place(time), np.array([1.0, 2.0]) + time[:, None] * [0.5, -1.0])
    away = np.array([0.5, 0.0, 1.0, 2.0, 1.0, 0.0, 1.0])
    np.testing.assert_allclose(turning.place(time), np.array([1.0, 2.0]) + away[:, None] * [0.5, -1.0])


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [
        ("posts", Post(-1.5, -1.2, 0.3), Post(-1.5, -1.2, 0.28)),
        ("walls", Wall(-3.5, -2.5, 0.5, -0.5), Wall(-1.4, -1.5, 0.5, -1.5)),
        ("walkers", Walker(-1.6, -1.5, 1.0, 0.0), Walker(-1.8, -1.5, 1.0, 0.0)),
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
