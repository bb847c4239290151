import numpy as np
import pytest
from drives import drive_log, model

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
