import mujoco
import numpy as np
import pytest

from sim.terrain import (
    Beams,
    Course,
    Flat,
    HeightField,
    Pallets,
    Ramp,
    Rough,
    SideSlope,
    Stairs,
    Step,
)
from sim.terrain.course import course_names, load_course, look_up
from sim.terrain.solids import Box, Grid, Level


def look_down(model, points):
    """Heights (P,) and normals (P, 3) where vertical rays of MuJoCo at `points` (P, 2) hit."""
    data = mujoco.MjData(model)
    high = 30.0
    mujoco.mj_forward(model, data)
    heights = np.empty(len(points))
    normals = np.empty((len(points), 3))
    down = np.array([0.0, 0.0, -1.0])
    geom = np.zeros(1, np.int32)
    for k, (x, y) in enumerate(points):
        start = np.array([x, y, high])
        depth = mujoco.mj_ray(model, data, start, down, None, 1, -1, geom, normals[k])
        heights[k] = high - depth
    return heights, normals


def test_a_small_ball_touches_height_fields_where_height_says():
    """Rays and collisions have triangles of their own in MuJoCo."""
    course = Course((Rough(2.0, 0.4, cell=0.2, blend=0.0),), seed=1)
    spec = mujoco.MjSpec()
    course.add_to(spec)
    ball = spec.worldbody.add_body()
    ball.add_freejoint()
    ball.add_geom(size=[1e-3, 0, 0])
    model = spec.compile()
    data = mujoco.MjData(model)
    points = np.random.default_rng(0).uniform([0.05, -1.4], [1.95, 1.4], (200, 2))
    x, y = points.T
    height = course.height(x, y)
    tiny = 1e-6
    rise_ahead = (course.height(x + tiny, y) - height) / tiny
    rise_left = (course.height(x, y + tiny) - height) / tiny
    steepness = np.hypot(rise_ahead, rise_left)
    upward = 1 / np.hypot(1, steepness)  # of the surface's normal
    depth = np.full(len(points), np.nan)
    for k, point in enumerate(points):
        data.qpos[:3] = *point, height[k] + 5e-4
        mujoco.mj_forward(model, data)
        depth[k] = -data.contact.dist.min()
    missed = np.abs(depth - (1e-3 - 5e-4 * upward))
    assert np.median(missed) < 1e-9
    # beside edges, another triangle is a little nearer
    assert missed.max() < 5e-5


def test_seams_are_flush():
    ramps = Ramp(0.3, 1.7), Flat(1.0), Ramp(-0.7, 2.3), Beams(), Ramp(0.1)
    pieces = (*ramps, SideSlope(0.4), Pallets(), Rough(), Step())
    course = Course(pieces)
    seams = np.array([placed.x for placed in course.placed[:-2]])
    aside = 3e-9
    y = np.linspace(-1.5, 1.5, 7)[:, None]
    before = course.height(seams - aside, y)
    behind = course.height(seams + aside, y)
    level = np.abs(before - behind).max(axis=0)
    assert (level[:-1] < 1e-7).all()  # height fields are in single precision
    inner = seams[5] + np.array([1.0, 4.0])  # between the side slope and its twisted stretches
    before = course.height(inner - aside, y)
    behind = course.height(inner + aside, y)
    np.testing.assert_allclose(before, behind, atol=1e-7)
    heights = [placed.z for placed in course.placed[:-2]]
    np.testing.assert_allclose(course.height(seams - aside, 0.0), heights, atol=1e-8)


def test_rough_ground_has_its_height_and_its_spectrum():
    course = Course((Rough(40.0, 0.2, exponent=3.0, blend=0.0),), width=20.0, seed=5)
    heights = course.solids[1].heights
    assert np.ptp(heights) == pytest.approx(0.2, rel=1e-12)
    assert (heights[:, [0, -1]] == 0.0).all()
    inner = heights[:, 1:-1]
    rows, columns = inner.shape
    window = np.hanning(columns) * np.hanning(rows)[:, None]
    power = np.abs(np.fft.rfft2(inner * window)) ** 2
    wave_number = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(columns))
    band = (wave_number > 0.05) & (wave_number < 0.4)
    slope, _ = np.polyfit(np.log(wave_number[band]), np.log(power[band]), 1)
    assert slope == pytest.approx(-3.0, abs=0.1)


def test_a_piece_depends_on_the_seed_and_on_no_other_piece():
    pieces = (Rough(), Beams(yaw=0.3))
    one = Course(pieces, seed=2)
    again = Course(pieces, seed=2)
    other = Course(pieces, seed=3)
    assert (one.solids[1].heights == again.solids[1].heights).all()
    assert one.solids[2:] == again.solids[2:]
    assert (one.solids[1].heights != other.solids[1].heights).any()
    longer = Course((Flat(3.0), Pallets(), *pieces), seed=2)
    quaternions = [getattr(solid, "quaternion", None) for solid in longer.solids]
    assert one.solids[-1].quaternion in quaternions
    first, second = Course((Rough(), Rough())).solids[1:3]
    assert (first.heights != second.heights).any()


def test_given_heights_are_rows_to_the_left_and_columns_ahead():
    heights = np.zeros((3, 5))
    heights[2, 3] = 0.2
    heights[0, 1] = -0.1
    course = Course((HeightField(heights, length=4.0, width=2.0),))
    x, y = np.meshgrid(np.linspace(0.0, 4.0, 5), [-1.0, 0.0, 1.0])
    np.testing.assert_allclose(course.height(x, y), heights, atol=1e-7)


@pytest.mark.parametrize(
    "solid",
    [
        Level(x0=1.0, x1=3.0, half_width=0.5, z=0.3),
        Box(centre=(2.0, 0.0, 0.2), half=(1.0, 0.5, 0.1)),
        Grid(x0=1.0, length=2.0, width=1.0, heights=np.full((2, 3), 0.3)),
    ],
    ids=["level", "box", "grid"],
)
def test_solids_end_with_their_edges(solid):
    """All are from 1 to 3 m ahead, half a metre to both sides, and 0.3 m high."""
    np.testing.assert_allclose(solid.bounds[:, :2], [[1.0, -0.5], [3.0, 0.5]])
    tiny = 1e-6
    on_edges = np.array([(1.0, 0.0), (3.0, 0.0), (2.0, 0.5), (2.0, -0.5), (1.0, 0.5), (3.0, -0.5)])
    outwards = np.sign(on_edges - [2.0, 0.0])
    for points, height in ((on_edges, 0.3), (on_edges + tiny * outwards, -np.inf)):
        np.testing.assert_allclose(solid.height(*points.T), height)


def test_elevation_is_height_but_for_edges():
    course = Course((Ramp(0.3, 2.0), Stairs(0.1, 0.3, 3), Rough(2.0, 0.1)))

    def elevation(points):
        """Heights (n,) in the course's map at points (n, 2)."""
        return look_up([course], np.array([points]))[0]

    anywhere = np.random.default_rng(0).uniform(*course.bounds[:, :2], (2000, 2))
    error = np.abs(elevation(anywhere) - course.height(*anywhere.T))
    assert np.quantile(error, 0.9) < 2e-3

    on_ramp = [[0.5, 0.2], [0.7, -1.4], [1.0, 1.3]]
    rise = np.tan(0.3) * np.array([0.5, 0.7, 1.0])
    np.testing.assert_allclose(elevation(on_ramp), rise, atol=1e-9)
    far = [[1e6, 0.0], [-1e6, 3.0], [0.0, 1e9]]
    np.testing.assert_allclose(elevation(far), course.floor, atol=1e-9)
    corners = [[-1.97, -1.47], [-1.97, 1.47]]
    np.testing.assert_allclose(elevation(corners), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", course_names())
def test_heights_are_mujocos_and_start_and_goal_are_level(name):
    course = load_course(name)
    low, high = course.bounds[:, :2]
    points = np.random.default_rng(0).uniform(low - 0.1, high + 0.1, (1000, 2))
    height, _ = look_down(course.model, points)
    np.testing.assert_allclose(course.height(*points.T), height, atol=1e-9)
    around = np.linspace(-0.5, 0.5, 11)
    np.testing.assert_allclose(course.height(course.start[0] + around, 0.0), 0.0, atol=1e-12)
    assert np.ptp(course.height(course.goal + around, 0.0)) < 1e-12
