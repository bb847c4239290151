"""Poses that jump while the sprockets turn steadily: no law is biased by them."""

import contextlib

import numpy as np
import pytest

from trackslip.errors import LogError
from trackslip.identification.samples import usable_samples
from trackslip.kinematics import RobotGeometry, advance
from trackslip.logs.runlog import RunLog

GEOMETRY = RobotGeometry(0.168, 0.06)
NOISE = {"fine": (0.002, 0.002, np.radians(0.25)), "coarse": (0.02, 0.02, np.radians(1.0))}


def circle(rng, noise, rate=10.0, duration=20.0, twist=None):
    """Times and poses of a steady turn, and its twist."""
    twist = np.array(twist or [rng.uniform(0.05, 0.3), rng.uniform(-0.4, 0.4)])
    time = np.arange(0, duration, 1 / rate)
    pose = advance([1.0, 2.0, rng.uniform(-3, 3)], twist, time)
    return time, pose + rng.normal(size=pose.shape) * noise, twist


def displaced(pose, way, direction, turn):
    """Poses turned about the first of them and shifted: a map that was corrected."""
    x, y = (pose[:, :2] - pose[0, :2]).T
    cos, sin = np.cos(turn), np.sin(turn)
    moved = np.column_stack([cos * x - sin * y, sin * x + cos * y]) + pose[0, :2]
    return np.column_stack([moved + way * np.array([np.cos(direction), np.sin(direction)]), pose[:, 2] + turn])


def samples_of(time, pose, twist):
    """The steady sample of a robot without slip."""
    omega = np.tile((twist[0] + np.array([-1, 1]) * 0.168 * twist[1]) / 0.06, (len(time), 1))
    return usable_samples([RunLog("run", time, omega, pose)], GEOMETRY).samples


def errors_of(samples, twist):
    """Of v and w, in standard errors."""
    return (samples.twist[0] - twist) / np.sqrt(np.diag(samples.covariance[0]))


@pytest.mark.parametrize(("rate", "noise"), [(2.0, NOISE["fine"]), (50.0, NOISE["coarse"])])
def test_poses_without_jumps_are_all_kept(rate, noise):
    rng = np.random.default_rng(0)
    for duration in (9.0, 30.0):
        for _ in range(4):
            time, pose, twist = circle(rng, noise, rate, duration)
            assert np.abs(errors_of(samples_of(time, pose, twist), twist)).max() < 6.0


@pytest.mark.parametrize(("rate", "noise"), [(5.0, NOISE["fine"]), (20.0, NOISE["coarse"])])
@pytest.mark.parametrize(("way", "turn"), [(0.2, 0.0), (0.0, 10.0), (0.3, 15.0)])
def test_a_lasting_jump_is_refused_where_it_is(way, turn, rate, noise):
    rng = np.random.default_rng([1, int(1000 * way), int(turn), int(rate)])
    for _ in range(3):
        time, pose, twist = circle(rng, noise, rate)
        row = int(rng.integers(len(time) // 4, 3 * len(time) // 4))
        pose[row:] = displaced(pose[row:], way, rng.uniform(-3, 3), np.radians(turn))
        with pytest.raises(LogError, match=r"its poses jump by .* and stay there") as refused:
            samples_of(time, pose, twist)
        assert float(str(refused.value).partition("t = ")[2].split()[0]) == pytest.approx(time[row], abs=8 / rate)


@pytest.mark.parametrize("noise", NOISE.values(), ids=NOISE)
def test_jumps_at_random_times_do_not_bias_the_motion(noise):
    """Errors of v and w in standard errors, where the jump is near the ends or small enough not to be refused."""
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(45):
        time, pose, twist = circle(rng, noise, rng.choice([5.0, 10.0, 20.0]))
        row = int(rng.integers(1, len(time)))
        way, turn = rng.choice([0, 1]) * rng.uniform(0.15, 0.5), np.radians(rng.choice([0, 1]) * rng.uniform(8, 30))
        pose[row:] = displaced(pose[row:], way, rng.uniform(-3, 3), turn)
        with contextlib.suppress(LogError):
            errors.append(errors_of(samples_of(time, pose, twist), twist))
    assert len(errors) > 12
    assert np.abs(errors).max() < 6.0
    assert np.sqrt(np.mean(np.square(errors))) < 1.6


@pytest.mark.parametrize("successive", [1, 3])
def test_wild_poses_hardly_matter(successive):
    rng = np.random.default_rng(3)
    for _ in range(5):
        time, pose, twist = circle(rng, NOISE["coarse"])
        rows = np.sort(rng.choice(len(time) // 10, 5, replace=False))[:, None] * 10 + np.arange(successive)
        pose[rows, :2] += rng.uniform(0.5, 5, (5, 1, 2)) * rng.choice([-1, 1], (5, 1, 2))
        assert np.abs(errors_of(samples_of(time, pose, twist), twist)).max() < 4.0
