import numpy as np
import pytest
from beside import compose, inverse, teleoperated
from beside import drive as driven

from trackslip.errors import LogError
from trackslip.rangefinder.align import mounting

MOUNT = np.array([1.0, -2.0, 0.7])
LEVER = np.array([0.2, -0.1, 0.0])


def poses(seed, noise=0.02, scale=1.0):
    """Poses of a plate in a scanner's frame, and positions of another sensor on the robot."""
    rng = np.random.default_rng(seed)
    session = driven(teleoperated(rng, 60.0, 5.0), mount=MOUNT, beams=3)
    time, other_time = np.arange(0.1, 59, 0.05), np.arange(0.03, 59, 0.1)
    plate = compose(inverse(MOUNT), session.path(time)) + rng.normal(size=(len(time), 3)) * [0.003, 0.003, 0.005]
    other = scale * compose(session.path(other_time), LEVER)[:, :2] + noise * rng.normal(size=(len(other_time), 2))
    return time, plate, other_time, other


def test_the_mounting_is_within_its_errors():
    deviations = []
    for seed in range(30):
        found = mounting(*poses(seed))
        deviations.append((found.mount - MOUNT) / found.stderr)
        assert found.scale == pytest.approx(1.0, abs=5 * found.scale_stderr)
    spread = np.sqrt(np.mean(np.square(deviations), axis=0))
    assert ((spread > 0.6) & (spread < 1.5)).all()


def test_outliers_and_another_scale():
    time, plate, other_time, other = poses(1, scale=1.03)
    other[100:110] += 3.0
    found = mounting(time, plate, other_time, other)
    np.testing.assert_allclose(found.mount[2], MOUNT[2], atol=0.01)
    assert found.scale == pytest.approx(1.03, abs=0.005)


def test_what_does_not_determine_it():
    time, plate, other_time, other = poses(0)
    with pytest.raises(LogError, match="0 poses from scans are at times of the other poses"):
        mounting(time, plate, other_time + 100, other)
    with pytest.raises(LogError, match="stays within"):
        mounting(time, plate * [0.01, 0.01, 1], other_time, other)
