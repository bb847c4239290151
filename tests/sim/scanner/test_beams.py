"""What beams meet: obstacles, mixed pixels at edges, and what moves while they sweep."""

import re

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim import Fleet, LaserScanner, ScannerFeed
from sim.scanner.beams import MIN_SHARE, PULSE, SUBRAYS, echo
from sim.scanner.obstacles import Obstacles, Post, Walker, Wall
from trackslip import se2
from trackslip.errors import InvalidValueError


def fan(beams=720):
    angle = np.arange(beams) / beams * 2 * np.pi + 1e-3
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def engine_ranges(obstacles, origin, directions, time):
    """The same obstacles as geoms: cylinders, and boxes 2 um thick."""
    places = [(post.x, post.y, post.radius) for post in obstacles.posts]
    places += [(*walker.place(np.array(time)), walker.radius) for walker in obstacles.walkers]
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
    walkers = tuple(Walker(*rng.uniform([1, -5], [5, -1]), *rng.uniform(-0.5, 0.5, 2)) for _ in range(2))
    obstacles, time = Obstacles(posts, walls, walkers), float(rng.uniform(0.0, 1.0))
    origin, directions = rng.uniform(-0.2, 0.2, 2), fan()
    ranges, expected = obstacles.ranges(origin, directions, time), engine_ranges(obstacles, origin, directions, time)
    differ = np.isnan(ranges) != np.isnan(expected)
    assert differ.sum() <= 2  # a beam along the very edge
    np.testing.assert_allclose(ranges[~differ], expected[~differ], atol=1e-3)


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


def split(front, back, rays_in_front):
    return np.where(np.arange(SUBRAYS) < rays_in_front, front, back)


def test_overlapping_echoes_are_mixed_by_their_light_and_of_distant_ones_the_first_strong_one_counts():
    front, back = 2.0, 2.4
    for k in range(SUBRAYS + 1):
        light = np.array([k / front**2, (SUBRAYS - k) / back**2])
        assert echo(split(front, back, k)) == pytest.approx(light @ [front, back] / light.sum())
    for behind in (9.0, np.nan):
        for k in range(SUBRAYS + 1):
            strong = k / SUBRAYS >= MIN_SHARE
            np.testing.assert_allclose(echo(split(2.0, behind, k)), 2.0 if strong else behind, rtol=1e-12)
    steps = 1.0 + 2 * PULSE * (np.arange(SUBRAYS) // 2)  # no two of them more than 2 / 9 of the footprint
    assert np.isnan(echo(steps))


START = np.array([[-1.2, 0.3, 0.4], [-2.5, 0.8, 0.6]])
TWIST = np.array([[0.8, 0.1, 1.5], [-0.5, 0.0, 0.0]])  # forward, lateral, yaw rate


def ranges_of(fleet, scanner, obstacles=None):
    return ScannerFeed(scanner, fleet, obstacles=obstacles).true_ranges()


def test_each_beam_sees_the_plate_at_its_own_time(robot):
    options = {"resolution": np.radians(1.0), "divergence": 0.0044}
    skewed, moving = LaserScanner(scan_duration=0.05, **options), Fleet(robot, START)
    moving.batch.qvel[:, :2] = se2.rotate(START[:, 2], TWIST[:, :2])
    moving.batch.qvel[:, 5] = TWIST[:, 2]
    ranges, lag = ranges_of(moving, skewed), skewed.lag
    assert lag[-1] - lag[0] == pytest.approx(0.05)
    assert lag[90] == 0.0  # the middle of the sweep is the scan's time
    for pose, twist, seen in zip(START, TWIST, ranges, strict=True):
        assert np.isfinite(seen).sum() > 5
        beams = np.flatnonzero(np.convolve(np.isfinite(seen), np.ones(5), "same"))
        standing = Fleet(robot, se2.compose(pose, se2.exp(lag[beams, None] * twist)))
        expected = np.diag(ranges_of(standing, LaserScanner(**options))[:, beams])
        np.testing.assert_allclose(seen[beams], expected, atol=3e-5)  # standing, the plate leans by microradians
    assert np.nanmax(np.abs(ranges - ranges_of(moving, LaserScanner(**options)))) > 1e-3


def test_a_plate_before_nothing_looks_wider_by_half_a_beam_at_most(robot):
    fleet, options = Fleet(robot, [[-1.5, 0.5, 0.2]]), {"field_of_view": 1.0, "resolution": 1e-4}
    sharp, mixed = (ranges_of(fleet, LaserScanner(**options, divergence=angle)) for angle in (0.0, 0.0044))
    extra = np.isfinite(mixed).sum() - np.isfinite(sharp).sum()
    expected = 2 * (0.5 - MIN_SHARE) * 0.0044  # a side sees the plate until MIN_SHARE of its footprint is left
    assert extra * 1e-4 == pytest.approx(expected, abs=2 * 0.0044 / SUBRAYS)


def test_a_person_is_seen_where_each_beam_finds_them(robot):
    scanner = LaserScanner(scan_duration=0.05)
    walker = Walker(-1.9, -0.5, 4.0, 0.0)
    ranges = ranges_of(Fleet(robot, [[5.0, 5.0, 0.0]]), scanner, Obstacles(walkers=(walker,)))[0]
    beams = np.flatnonzero(ranges < 2.0)
    direction = np.pi / 2 + scanner.bearings[beams]
    point = np.array([-1.5, -1.5]) + ranges[beams, None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    assert len(beams) > 50
    np.testing.assert_allclose(np.hypot(*(point - walker.place(scanner.lag[beams])).T), walker.radius, atol=1e-9)
