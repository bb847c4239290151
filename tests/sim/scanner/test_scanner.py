import re

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim import Fleet, LaserScanner, RobotParameters, ScannerFeed
from sim.common.seeds import generator
from sim.robot.robot import SCANNED_GROUP, compiled
from sim.scanner.scanner import Obstacles, Post, Wall
from trackslip.errors import InvalidValueError

POSES = np.array([[-1.5, 0.5, 0.3], [0.0, 1.0, 2.0], [-3.0, 3.0, -1.0], [-1.5, 1.0, np.pi / 2]])


def feed(robot, scanner=None, seed=0, poses=POSES):
    fleet = Fleet(robot, poses)
    generators = [generator(seed, f"{k}") for k in range(len(poses))]
    return ScannerFeed(scanner or LaserScanner(), fleet, generators)


def test_rays_are_those_of_a_rectangle(robot, scan_rectangle):
    mount = tuple(robot.lrf_mount)
    expected = scan_rectangle(POSES, np.random.default_rng(0), noise=0.0, mount=mount)
    ranges = feed(robot).true_ranges()
    assert ranges.shape == expected.ranges.shape == (4, 721)
    np.testing.assert_array_equal(np.isnan(ranges), np.isnan(expected.ranges))
    # it leans by 7e-6 rad until it has settled
    np.testing.assert_allclose(ranges, expected.ranges, atol=3e-5)


def test_a_seed_gives_each_robot_its_own_noise(robot):
    fleet = Fleet(robot, POSES[[0, 0]])
    true = ScannerFeed(LaserScanner(), fleet).true_ranges()[:, None]
    one = ScannerFeed(LaserScanner(), fleet, 0).measure(true)
    again = ScannerFeed(LaserScanner(), fleet, 0).measure(true)
    other = ScannerFeed(LaserScanner(), fleet, 1).measure(true)
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other, equal_nan=True)
    robots_exchanged = one[::-1]
    assert not np.array_equal(one, robots_exchanged, equal_nan=True)


def measured(robot, **options):
    """True ranges and measured ones (4, 100, B) of a scanner with some options."""
    scanned = feed(robot, LaserScanner(**options))
    true = np.repeat(scanned.true_ranges()[:, None], 100, axis=1)
    return true, scanned.measure(true)


def test_dropouts_and_range_limit(robot):
    true, seen = measured(robot, dropout=0.25)
    lost = np.isnan(seen)[np.isfinite(true)]
    assert lost.mean() == pytest.approx(0.25, abs=0.02)
    _, near = measured(robot, max_range=2.5)
    assert np.isfinite(near[0, 0]).any()
    assert np.isnan(near[2, 0]).all()


def test_quantised_ranges_are_multiples_and_all_are_biased(robot):
    _, plain = measured(robot)
    _, rounded = measured(robot, quantisation=0.01)
    steps = rounded / 0.01
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.nanmax(np.abs(rounded - plain)) <= 0.005 + 1e-12
    stated = feed(robot, LaserScanner(quantisation=0.01)).scan(np.zeros((1, 721))).noise
    of_rounding = 0.01**2 / 12
    assert stated == pytest.approx(np.sqrt(LaserScanner().noise ** 2 + of_rounding))
    _, biased = measured(robot, range_bias=-0.02)
    np.testing.assert_array_equal(biased, plain - 0.02)


SCANNERS = {
    "half circle": LaserScanner(),
    "wide": LaserScanner(field_of_view=float(np.radians(330.0)), resolution=float(np.radians(0.5))),
    "all around": LaserScanner(field_of_view=2 * np.pi, resolution=float(np.radians(1.0))),
    "coarse and short-sighted": LaserScanner(resolution=0.5, max_range=1.5),
}


def assert_all_beams(scanner, fleet):
    """Ranges (N, B) must be those of every beam, cast without regard to where the plates are."""
    x, y, heading = fleet.robot.lrf_mount
    direction = heading + scanner.bearings
    rays = np.column_stack([np.cos(direction), np.sin(direction), np.zeros_like(direction)])
    scanned = np.arange(6) == SCANNED_GROUP
    own = fleet.robot.model.body("lrf").id
    origin = np.array([x, y, fleet.robot.lrf_height])
    expected, _ = fleet.batch.ray(origin, rays, geomgroup=scanned, bodyexclude=own)
    ranges = ScannerFeed(scanner, fleet).true_ranges()
    np.testing.assert_array_equal(ranges, np.where(expected < 0, np.nan, expected))
    return ranges


def around_the_scanner(robot, distance, bearing, heading):
    """Poses (N, 3) at these distances and bearings from the scanner."""
    scanner_x, scanner_y, mount = robot.lrf_mount
    x = scanner_x + distance * np.cos(mount + bearing)
    y = scanner_y + distance * np.sin(mount + bearing)
    return np.stack([x, y, heading], axis=-1)


@pytest.mark.parametrize("leaning", [False, True])
@settings(max_examples=4, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    name=st.sampled_from(sorted(SCANNERS)),
    reach=st.sampled_from([0.4, 2.0, 25.0]),
)
def test_ranges_near_far_and_inside_the_plates_sphere(robot, leaning, seed, name, reach):
    """With the weight off the middle, the plate's middle isn't above the robot's."""
    rng = np.random.default_rng(seed)
    low = [[0.0], [-np.pi], [-np.pi]]
    high = [[reach], [np.pi], [np.pi]]
    distance, bearing, heading = rng.uniform(low, high, (3, 12))
    model = compiled(RobotParameters(com_x=0.04, com_y=0.04)) if leaning else robot
    poses = around_the_scanner(robot, distance, bearing, heading)
    assert_all_beams(SCANNERS[name], Fleet(model, poses))


def test_the_seam_behind_the_scanner_and_its_edges(robot):
    bearing = np.radians(
        [-180.0, -179.0, -166.0, -164.0, -91.0, -90.0, -20.0, 0.0, 19.0, 90.0, 165.0, 179.9]
    )
    fleet = Fleet(robot, around_the_scanner(robot, np.ones(12), bearing, bearing))
    straight_ahead = 7
    for scanner in SCANNERS.values():
        ranges = assert_all_beams(scanner, fleet)
        assert np.isfinite(ranges[straight_ahead]).any()


def fan(beams=720):
    angle = np.arange(beams) / beams * 2 * np.pi + 1e-3
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def engine_ranges(obstacles, origin, directions):
    """The same obstacles as geoms: cylinders, and boxes 2 um thick."""
    geoms = []
    for post in obstacles.posts:
        pos = f"{post.x} {post.y} 0"
        geoms.append(f'<geom type="cylinder" size="{post.radius} 1" pos="{pos}"/>')
    for wall in obstacles.walls:
        ends = f"{wall.x0} {wall.y0} 0 {wall.x1} {wall.y1} 0"
        geoms.append(f'<geom type="box" size="1e-6 1e-6 1" fromto="{ends}"/>')
    text = f"<mujoco><worldbody>{''.join(geoms)}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hit = np.zeros(1, np.int32)
    start = np.array([*origin, 0.0])
    distance = []
    for direction in directions:
        ray = np.array([*direction, 0.0])
        distance.append(mujoco.mj_ray(model, data, start, ray, None, 1, -1, hit))
    return np.where(np.array(distance) < 0, np.nan, distance)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_ranges_are_those_of_the_engine(seed):
    rng = np.random.default_rng(seed)
    posts = tuple(Post(*rng.uniform(1.0, 5.0, 2), rng.uniform(0.05, 0.5)) for _ in range(3))
    walls = tuple(Wall(*rng.uniform(-5.0, -1.0, 4)) for _ in range(3))
    obstacles = Obstacles(posts, walls)
    origin = rng.uniform(-0.2, 0.2, 2)
    directions = fan()
    ranges = obstacles.ranges(origin, directions)
    expected = engine_ranges(obstacles, origin, directions)
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
    message = (
        f"{name}[1] = {inside}: must be at least 0.01 m away from the scanner, which is at "
        "(-1.5, -1.5)"
    )
    with pytest.raises(InvalidValueError, match=f"^{re.escape(message)}$"):
        ScannerFeed(LaserScanner(), fleet, obstacles=Obstacles(**{name: (outside, inside)}))


def test_a_post_hides_a_part_of_the_plate_and_nothing_else(robot):
    fleet = Fleet(robot, [[-1.5, 0.5, 0.3], [3.0, 0.5, 0.0]])
    bearings = LaserScanner().bearings

    def true_ranges(*posts):
        return ScannerFeed(LaserScanner(), fleet, obstacles=Obstacles(posts=posts)).true_ranges()

    open_field = true_ranges()
    hidden = true_ranges(Post(-1.5, -0.5))  # 1 m ahead of the scanner
    shadow = np.abs(bearings) <= np.arcsin(0.05)
    np.testing.assert_array_equal(hidden[:, ~shadow], open_field[:, ~shadow])
    bearing = bearings[shadow]
    near = np.cos(bearing) - np.sqrt(0.05**2 - np.sin(bearing) ** 2)
    np.testing.assert_allclose(hidden[:, shadow], np.tile(near, (2, 1)), atol=1e-12)
    assert np.isfinite(open_field[0, shadow]).all()
    behind = true_ranges(Post(-1.5, 2.0, 0.1))
    np.testing.assert_array_equal(behind[0], open_field[0])  # the plate hides it wholly
