import numpy as np
import pytest
from drives import GEOMETRY, ICR, drive_log, model

from trackslip.drives.conditioning import drive_of
from trackslip.drives.drive import Drives
from trackslip.identification.path import path_at
from trackslip.kinematics import advance

RNG = np.random.default_rng(0)
EDGES = np.cumsum(RNG.uniform(0.01, 0.1, 41))
MOTION = RNG.normal(size=(3, 40)) * [[0.3], [0.1], [1.0]]


def path(motion, slope, time):
    row = np.clip(np.searchsorted(EDGES, time, side="right") - 1, 0, len(EDGES) - 2)
    return path_at(EDGES, motion, slope, time, row)


@pytest.mark.parametrize("turning", [1.0, 1e-3, 0.0])
def test_paths_are_exact_arcs(turning):
    motion = MOTION * [[1], [0], [turning]]
    time = np.sort(RNG.uniform(EDGES[0], EDGES[-1], 50))
    expected = np.zeros((50, 3))
    for (v, _, w), begin, end in zip(motion.T, EDGES, EDGES[1:], strict=False):
        duration = np.clip(time, begin, end) - begin
        expected = advance(expected, np.array([v, w]), duration)
    path_found = path(motion, np.zeros((3, 0, 40)), time)
    place = path_found.place
    found = np.column_stack([place.real, place.imag, path_found.heading])
    np.testing.assert_allclose(found, expected, atol=1e-13)


@pytest.mark.parametrize("turning", [1.0, 1e-4])
def test_derivatives_and_velocities_are_differences(turning):
    motion = MOTION * [[1], [1], [turning]]
    slope = RNG.normal(size=(3, 4, 40))
    time = np.linspace(EDGES[0] + 0.003, EDGES[-1] + 0.1, 25)
    found = path(motion, slope, time)
    h = 1e-6

    def differences(ahead, behind):
        """Differences of places and headings over 2 h."""
        place = (ahead.place - behind.place) / (2 * h)
        heading = (ahead.heading - behind.heading) / (2 * h)
        return place, heading

    for k in range(4):
        step = h * slope[:, k]
        ahead = path(motion + step, slope, time)
        behind = path(motion - step, slope, time)
        place, heading = differences(ahead, behind)
        np.testing.assert_allclose(found.place_slope[k], place, atol=1e-7)
        np.testing.assert_allclose(found.heading_slope[k], heading, atol=1e-7)
    later = path(motion, slope, time + h)
    earlier = path(motion, slope, time - h)
    velocity, yaw_rate = differences(later, earlier)
    np.testing.assert_allclose(found.velocity, velocity, atol=1e-7)
    np.testing.assert_allclose(found.yaw_rate, yaw_rate, atol=1e-7)


@pytest.mark.parametrize("clock_offset", [0.003, -4.003])
@pytest.mark.parametrize("lag", [0.0, 0.2])
def test_each_of_several_drives_moves_as_it_does_alone(clock_offset, lag):
    drives = [drive_of(drive_log(seed, 10.0 + seed)) for seed in range(3)]
    driven = model("turn_loss")
    every = np.arange(len(driven.names))
    values = np.array([0.045, 0.0066, 0.3, 0.1, 0.05, 0.2, clock_offset, 0.07, lag])
    together = driven.path(values, Drives.of(drives), every)
    begin = 0
    for drive in drives:
        alone = driven.path(values, Drives.of([drive]), every)
        rows = slice(begin, begin + len(drive.time))
        turn = together.heading[begin] - alone.heading[0]
        from_start = together.place[rows] - together.place[begin]
        alone_from_start = alone.place - alone.place[0]
        np.testing.assert_allclose(from_start * np.exp(-1j * turn), alone_from_start, atol=1e-10)
        np.testing.assert_allclose(together.heading[rows] - turn, alone.heading, atol=1e-11)
        slope = together.heading_slope[:, rows] - together.heading_slope[:, [begin]]
        alone_slope = alone.heading_slope - alone.heading_slope[:, :1]
        np.testing.assert_allclose(slope, alone_slope, atol=1e-9)
        begin += len(drive.time)


@pytest.fixture(scope="module")
def two_drives():
    return Drives.of([drive_of(drive_log(seed, 6.0)) for seed in range(2)])


def test_with_a_lag_headings_follow_the_law_as_a_first_order(two_drives):
    """The yaw rate x of the robot follows x' = (u - x) / lag from that of the law, u, integrated
    in small steps by the trapezoidal rule; each drive starts with x = u. Headings are from the
    drive's first.
    """
    lag = 0.3
    driven = model("icr_radius")
    values = np.zeros(len(driven.names))
    values[:2] = ICR.offset, ICR.radius_error
    values[driven.index("lag")] = lag
    found = driven.path(values, two_drives, np.array([], int))

    wanted = ICR.twist(two_drives.omega, GEOMETRY)[:, 1]
    edges = two_drives.edges
    first = set(two_drives.begins.tolist())
    heading = [0.0]
    for k, (u, duration) in enumerate(zip(wanted, np.diff(edges), strict=True)):
        if k in first:
            rate = u
        turned = 0.0
        short = duration / 50
        for _ in range(50):
            step = (u - rate) * short / (lag + short / 2)
            turned += (rate + step / 2) * short
            rate += step
        heading.append(heading[-1] + turned)
    expected = np.interp(two_drives.time, edges, heading)
    first_pose = two_drives.first[two_drives.drive]
    np.testing.assert_allclose(
        found.heading - found.heading[first_pose], expected - expected[first_pose], atol=1e-6
    )
    assert np.ptp(expected) > 1.0


def test_derivatives_by_every_parameter_are_differences(two_drives):
    driven = model("turn_loss")
    every = np.arange(len(driven.names))
    values = np.array([0.045, 0.0066, 0.3, 0.1, 0.05, 0.2, 0.013, 0.07, 0.2])
    found = driven.path(values, two_drives, every)
    h = 1e-6
    for k, name in enumerate(driven.names):
        step = h * (every == k)
        ahead = driven.path(values + step, two_drives, every)
        behind = driven.path(values - step, two_drives, every)
        place = (ahead.place - behind.place) / (2 * h)
        heading = (ahead.heading - behind.heading) / (2 * h)
        # that by the lag is itself a difference, over 1 ms
        atol = 1e-3 if name == "lag" else 1e-7
        np.testing.assert_allclose(found.place_slope[k], place, atol=atol, err_msg=name)
        np.testing.assert_allclose(found.heading_slope[k], heading, atol=atol, err_msg=name)
