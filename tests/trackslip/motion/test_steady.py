import contextlib
from dataclasses import replace

import numpy as np
import pytest

from trackslip import se2
from trackslip.errors import LogError
from trackslip.identification.samples import usable_samples
from trackslip.kinematics import RobotGeometry, advance
from trackslip.laws.icr import ConstantIcr, IcrLoad
from trackslip.logs.runlog import RunLog
from trackslip.motion.steady import MARGIN, SETTLE, steady_part, steady_parts

GEOMETRY = RobotGeometry(0.168, 0.06)
LAW = ConstantIcr(0.045, 0.168, 0.01)
TWIST = np.array([0.15, 0.075])


def driven(changes=((0.0, 1.0),), duration=20.0, step=0.05, name="run"):
    """A run whose sprockets and twist are multiplied by a factor from each time on."""
    time = np.arange(0, duration, step)
    factor = np.ones(time.size)
    for start, value in changes:
        factor[time >= start] = value
    omega = factor[:, None] * LAW.sprocket_speeds(TWIST, GEOMETRY)
    pose = [np.zeros(3)]
    for k in range(1, time.size):
        pose.append(advance(pose[-1], factor[k] * TWIST, step))
    return RunLog(name, time, omega, np.array(pose))


def test_a_run_that_is_steady_for_a_while_only():
    log = driven()
    log.omega[200:] *= np.linspace(1, 3, 200)[:, None]  # ever faster: nowhere else steady
    (part,) = steady_parts(log)
    assert part.name == "run"
    assert part.window == pytest.approx((SETTLE, 10.0 - MARGIN), abs=0.5)
    assert "run 'run': steady, and used, from 1.5 s to" in part.notes[0]


def test_every_steady_stretch_is_a_sample():
    changes = ((0.0, 0.5), (6.0, 1.0), (12.0, 0.0), (15.0, 0.7), (21.0, -0.5), (22.0, 1.3))
    log = driven(changes, duration=30.0)
    parts = steady_parts(log)
    names = ("run @ 1.5 s", "run @ 7.5 s", "run @ 16.5 s", "run @ 23.5 s")
    assert tuple(part.name for part in parts) == names
    found = usable_samples([log], GEOMETRY)
    assert found.samples.run == names
    np.testing.assert_allclose(found.samples.slip, np.tile(LAW(0.5), (4, 1)), atol=1e-6)
    expected = np.outer([0.5, 1.0, 0.7, 1.3], TWIST)
    np.testing.assert_allclose(found.samples.twist, expected, atol=1e-6)
    assert found.refused == ()


def test_a_gap_in_the_clock_parts_a_run():
    log = driven()
    late = np.where(log.time >= 5.0, log.time + 7.0, log.time)  # the clock jumps, the robot doesn't
    log = replace(log, time=late)
    part = steady_part(log)
    assert "its clock has a gap from t = 4.95 s to 12 s" in part.notes[0]
    assert part.window == pytest.approx((12.0 + SETTLE, 26.95 - MARGIN))
    samples = usable_samples([log], GEOMETRY, longest=True).samples
    np.testing.assert_allclose(samples.slip[0], LAW(0.5), atol=1e-6)


def test_motion_that_changes_at_constant_sprockets_is_refused():
    log = driven()
    slower = driven(((10.0, 0.8),))
    with pytest.raises(LogError, match="but its motion is not: v changes by -0"):
        usable_samples([replace(slower, omega=log.omega)], GEOMETRY, longest=True)


def test_runs_without_a_steady_stretch():
    time = np.arange(0, 20, 0.05)
    swinging = driven()
    swinging.omega[:] *= (1 + 0.5 * np.sin(time))[:, None]
    with pytest.raises(LogError, match="too short"):
        steady_part(swinging)
    standing = driven()
    standing.omega[:] = 1e-5
    with pytest.raises(LogError, match="stand still"):
        steady_part(standing)
    log = driven()
    log.pose[:, 2] = np.nan
    with pytest.raises(LogError, match="run 'run': has no headings: steady stretches need phi"):
        steady_parts(log)


def test_standing_still_between_commands_is_no_sample():
    log = driven(((0.0, 1.0), (10.0, 0.0)))
    log.omega[:] += np.random.default_rng(0).normal(0, 0.003, log.omega.shape)
    (part,) = steady_parts(log)
    assert part.name == "run"
    assert part.window[1] < 10.0


def test_pieces_follow_the_law_as_the_load_turns_with_the_robot():
    """A circle on a slope, which is not steady as a whole."""
    law = IcrLoad(0.04, 0.168, 0.01, 0.1, 0.2)
    omega = np.array([1.5, 3.5])
    step = 0.05
    poses = []
    loads = []
    pose = np.zeros(3)
    for k in range(4 * 280):
        load = np.tan(0.17) * np.array([np.cos(pose[2]), -np.sin(pose[2])])
        if k % 4 == 0:
            poses.append(pose)
            loads.append(load)
        loaded = law.under(load)
        v, w = loaded.twist(omega, GEOMETRY)
        lateral = float(loaded.sideslip(np.array([v, w])))
        pose, *_ = se2.drive(pose, np.array([v, lateral, w]) * step / 4)
    time = step * np.arange(280)
    speeds = np.tile(omega, (280, 1))
    log = RunLog("run", time, speeds, np.array(poses), load=np.array(loads))
    with pytest.raises(LogError, match="its motion is not: v changes"):
        usable_samples([log], GEOMETRY, longest=True)
    pieces = usable_samples([log], GEOMETRY).samples
    expected = law.under(pieces.load).twist(pieces.omega, GEOMETRY)
    np.testing.assert_allclose(pieces.twist, expected, atol=2e-3)


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
    cos = np.cos(turn)
    sin = np.sin(turn)
    turned = np.column_stack([cos * x - sin * y, sin * x + cos * y]) + pose[0, :2]
    shift = way * np.array([np.cos(direction), np.sin(direction)])
    return np.column_stack([turned + shift, pose[:, 2] + turn])


def samples_of(time, pose, twist):
    """Samples of a run whose sprockets turn as without slip."""
    v, w = twist
    omega = (v + np.array([-1, 1]) * GEOMETRY.half_gauge * w) / GEOMETRY.sprocket_radius
    log = RunLog("run", time, np.tile(omega, (len(time), 1)), pose)
    return usable_samples([log], GEOMETRY).samples


def errors_of(samples, twist):
    standard_errors = np.sqrt(np.diag(samples.covariance[0]))
    return (samples.twist[0] - twist) / standard_errors


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
        _, _, after = str(refused.value).partition("t = ")
        told = float(after.split()[0])
        assert told == pytest.approx(time[row], abs=8 / rate)


@pytest.mark.parametrize("noise", NOISE.values(), ids=NOISE)
def test_jumps_at_random_times_do_not_bias_the_motion(noise):
    """Errors of v and w in standard errors, where the jump is near the ends or small enough not to
    be refused.
    """
    rng = np.random.default_rng(2)
    errors = []
    for _ in range(45):
        time, pose, twist = circle(rng, noise, rng.choice([5.0, 10.0, 20.0]))
        row = int(rng.integers(1, len(time)))
        way = rng.choice([0, 1]) * rng.uniform(0.15, 0.5)
        turn = np.radians(rng.choice([0, 1]) * rng.uniform(8, 30))
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
        tenths = np.sort(rng.choice(len(time) // 10, 5, replace=False))
        rows = tenths[:, None] * 10 + np.arange(successive)
        size = rng.uniform(0.5, 5, (5, 1, 2))
        pose[rows, :2] += size * rng.choice([-1, 1], (5, 1, 2))
        errors = errors_of(samples_of(time, pose, twist), twist)
        assert np.abs(errors).max() < 4.0
