import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st
from quadrature import integral_miss, times

from trackslip.errors import InvalidValueError, ReferenceFileError
from trackslip.trajectory.named import load_reference, named_reference
from trackslip.trajectory.path import KNOT_SPACING, LIMITS
from trackslip.trajectory.waypoints import TOLERANCE, read_waypoints, waypoints

POINTS = np.array([(0, 0), (1, 0.2), (1.2, 1), (0.1, 1.5), (-1, 0.3)])

coordinate = st.floats(-4, 4, allow_nan=False)


def cell(point):
    return tuple(np.floor(np.array(point) / 0.5))


@pytest.fixture
def csv(tmp_path):
    def write(content):
        path = tmp_path / "points.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def nearest(reference, points):
    """Distance (N,) of each point to the path; its own error is a quarter of the way between two
    times, squared.
    """
    time = np.linspace(0, reference.duration, 40_001)
    return np.array([distances(reference, time, point).min() for point in points])


def distances(reference, time, point):
    """Distances (T,) of a reference to a point (2,)."""
    x, y, _ = reference.pose(time).T
    return np.hypot(x - point[0], y - point[1])


def test_the_path_meets_all_points_with_continuous_curvature():
    reference = waypoints(POINTS)
    assert nearest(reference, POINTS).max() < 1e-4
    pose = reference.pose([0.0, reference.duration])
    np.testing.assert_allclose(pose[:, :2], POINTS[[0, -1]], atol=1e-12)
    knots = reference.knots[1:-1]
    before = reference.twist(np.nextafter(knots, 0))
    np.testing.assert_allclose(before, reference.twist(knots), atol=1e-10)
    v, w = reference.twist([1e-3, reference.duration - 1e-3]).T
    np.testing.assert_allclose(w / v, 0, atol=1e-3)


def test_headings_say_where_it_reverses_and_speeds_how_fast():
    """A turn in three moves, as a planner writes it: to the right ahead, to the right in reverse,
    straight on.
    """
    # an eighth of a circle of 1 m to the right, ahead
    angles = np.linspace(0, np.pi / 4, 6)
    ahead = np.stack([np.sin(angles), np.cos(angles) - 1, -angles], axis=-1)
    # another in reverse, in the frame of the cusp
    in_frame = np.stack([-np.sin(angles), 1 - np.cos(angles), 0 * angles], axis=-1)
    back = ahead[-1] + in_frame @ _turned(-np.pi / 4)
    back[:, 2] = -np.pi / 4 - angles
    # straight on, along -y
    way = 0.3 * np.arange(1, 4)
    last = back[-1] + way[:, None] * [0.0, -1.0, 0.0]

    table = np.concatenate([ahead, back[1:], last])
    points = table[:, :2]
    speed = np.full(len(table), 0.1)
    reference = waypoints(points, yaw=table[:, 2] + 2 * np.pi, speed=speed)
    assert nearest(reference, points).max() < 1e-4
    assert integral_miss(reference) < 1e-9
    time = times(reference)
    v, w = reference.twist(time).T
    assert v.min() == pytest.approx(-0.1)
    assert v.max() == pytest.approx(0.1)
    direction = np.sign(v[np.abs(v) > 0.05])
    assert np.count_nonzero(np.diff(direction)) == 2
    assert np.abs(w).max() == pytest.approx(0.1, rel=0.05)  # arcs of 1 m
    heading = reference.pose(time)[:, 2]
    assert np.ptp(heading) == pytest.approx(np.pi / 2, abs=1e-3)
    ends = reference.pose([0.0, reference.duration])[:, :2]
    np.testing.assert_allclose(ends, points[[0, -1]], atol=1e-12)
    backwards = waypoints([(0, 0), (-1, 0), (-2, 0)], yaw=np.zeros(3))
    assert backwards.pose(0.0)[2] == pytest.approx(0)


def _turned(angle):
    """Matrix (3, 3) that turns rows (x, y, phi) by an angle, but not their phi."""
    cos = np.cos(angle)
    sin = np.sin(angle)
    return np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])


def test_speeds_brake_evenly_towards_a_waypoint():
    reference = waypoints([(0, 0), (1, 0), (2, 0)], speed=[0.1, 0.05, 0.1])
    time = np.linspace(0, reference.duration, 20_001)
    x = reference.pose(time)[:, 0]
    v = reference.twist(time)[:, 0]
    # v^2 changes evenly with the distance from the waypoint at 1 m
    growth = 0.1**2 - 0.05**2
    inside = (x > 0.2) & (x < 1.8)  # where it neither starts nor stops
    even = 0.05**2 + growth * np.abs(x - 1)
    below = (even - v**2)[inside]
    assert below.min() > -1e-9
    # a cell has the speed of its slower end, and so has a knot of its cells
    assert below.max() < growth * 2 * KNOT_SPACING


@settings(max_examples=10)
@given(st.lists(st.tuples(coordinate, coordinate), min_size=3, max_size=8, unique_by=cell))
def test_any_points_give_a_drivable_reference_or_are_refused(points):
    try:
        reference = waypoints(points)
    except InvalidValueError:
        event("refused")
        return
    assert integral_miss(reference) < 1e-9
    time = times(reference)
    v, w = reference.twist(time).T
    slack = 1 + 1e-3
    assert v.max() <= LIMITS.speed + 1e-9
    assert np.abs(w).max() <= LIMITS.yaw_rate * slack
    faster_track = v + LIMITS.half_gauge * np.abs(w)
    assert faster_track.max() <= LIMITS.track_speed * slack
    assert max(distances(reference, time, point).min() for point in points) < TOLERANCE + 0.01


@pytest.mark.parametrize(
    "content",
    [
        "x,y\n0,0\n1,0.5\n2,0\n",
        "# a path\nx, y\r\n0, 0\r\n1,0.5\r\n2,0",
        "\ufeffy;x\n0;0\n0,5;1\n0;2\n",
    ],
)
def test_files_are_spelt_as_those_of_logs(csv, content):
    path = csv(content)
    reference = read_waypoints(path)
    expected = waypoints([(0, 0), (1, 0.5), (2, 0)])
    time = [0.0, 5.0, 9.0]
    np.testing.assert_array_equal(reference.pose(time), expected.pose(time))
    assert load_reference(path).duration == expected.duration
    assert load_reference(str(path)).duration == expected.duration


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "Empty CSV file"),
        ("x,y\n0,0\n1,zero\n2,0", "row 2, column y: 'zero' is not a finite number"),
        ("0,1\n1,0\n2,0", "has no column x, y; found '0, 1'"),
        (
            "x,y,yaw\n0,0,0\n1,0,1.6\n2,0,0",
            "point 2, column yaw = 1.6: must be within 45 deg of the way from point 1",
        ),
        (
            "x,y,yaw,v\n0,0,0,.1\n1,0,0,-.1\n2,0,0,.1",
            "point 2, column v = -0.1: must be at least 0, unless",
        ),
        (b"\xff\xfe\x00\x81", "has no column x|codec can't decode|CSV"),
    ],
)
def test_unusable_files_are_refused_in_a_line(csv, content, message):
    path = csv(content)
    with pytest.raises(ReferenceFileError, match=message) as caught:
        load_reference(path)
    assert str(caught.value).startswith(str(path))


STRAIGHT = np.array([(0.0, 0.0), (50.0, 0.0), (100.0, 0.0)])


@pytest.mark.parametrize("column", ["x", "y", "yaw", "v"])
@pytest.mark.parametrize("value", [101.0, -100.01, np.nan])
def test_a_number_beyond_100_is_named_with_its_point(column, value):
    table = {"x": STRAIGHT[:, 0], "y": STRAIGHT[:, 1], "yaw": np.zeros(3), "v": np.full(3, 0.1)}
    table[column] = np.append(table[column][:2], value)
    points = np.column_stack([table["x"], table["y"]])
    said = f"point 3, column {column} = {value}: must be from -100 to 100"
    with pytest.raises(InvalidValueError, match=said):
        waypoints(points, yaw=table["yaw"], speed=table["v"])


LINE = np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])


@pytest.mark.parametrize("row", range(3))
def test_speeds_ahead_are_not_negative(row):
    speed = np.full(3, 0.1)
    speed[row] = 0.0
    waypoints(LINE, speed=speed)
    speed[row] = -0.1
    said = f"point {row + 1}, column v = -0.1: must be at least 0, unless a column yaw says reverse"
    with pytest.raises(InvalidValueError, match=said):
        waypoints(LINE, speed=speed)


def test_speeds_in_reverse_may_have_either_sign():
    backwards = np.full(3, np.pi)
    negative = waypoints(LINE, yaw=backwards, speed=np.full(3, -0.1))
    positive = waypoints(LINE, yaw=backwards, speed=np.full(3, 0.1))
    assert negative.duration == positive.duration
    assert negative.twist(negative.duration / 2)[0] == pytest.approx(-0.1)
    # ahead, and back from the last point
    there_and_back = np.concatenate([LINE, LINE[1::-1]])
    speed = [0.1, 0.1, -0.1, -0.1, -0.1]
    assert waypoints(there_and_back, yaw=np.zeros(5), speed=speed).duration > 0
    with pytest.raises(InvalidValueError, match=r"point 2, column v = -0\.1: must be at least 0"):
        waypoints(there_and_back, yaw=np.zeros(5), speed=[0.1, -0.1, -0.1, -0.1, -0.1])
    # in reverse first, up to the second point, and ahead from there
    points = [(0.0, 0.0), (1.0, 0.0), (0.5, 0.0), (0.0, 0.0)]
    assert waypoints(points, yaw=np.full(4, np.pi), speed=[-0.1, -0.1, 0.1, 0.1]).duration > 0


def test_numbers_and_ways_may_be_as_large_as_allowed():
    assert waypoints(STRAIGHT).pose(0.0)[0] == 0
    with pytest.raises(InvalidValueError, match="number of waypoints = 10001: must be from 3 to"):
        waypoints(np.zeros((10_001, 2)))
    # five rows of 200 m, a metre apart
    rows = np.repeat(np.arange(5.0), 2)
    to_and_fro = 100 * np.array([-1, 1, 1, -1, -1, 1, 1, -1, -1, 1])
    long = np.column_stack([to_and_fro, rows])
    with pytest.raises(InvalidValueError, match=r"points = 1004\.0: must be at most 1000 m"):
        waypoints(long)
    long[-1, 0] -= 4  # 1000 m: the curve through the points is longer
    with pytest.raises(InvalidValueError, match="length of the path = "):
        waypoints(long)


def test_missing_files_and_unknown_names_are_refused(tmp_path):
    with pytest.raises(ReferenceFileError, match=r"absent\.csv: no such file"):
        load_reference(tmp_path / "absent.csv")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(ReferenceFileError, match="directory"):
        load_reference(tmp_path / "folder.csv")
    said = r"'figure_8': must be one of paper, circle, .*stop_and_go, or a \.csv"
    with pytest.raises(InvalidValueError, match=said):
        load_reference("figure_8")
    elsewhere = named_reference("slalom", (1, 2, 0.5))
    np.testing.assert_array_equal(elsewhere.pose(0.0), [1, 2, 0.5])
