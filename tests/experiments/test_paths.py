"""Paths of the commands that drive in closed loop: files, turns on the spot, and equal names."""

import re

import numpy as np
import pytest

from experiments.common.paths import PathPlan, path_of
from experiments.simulate.paths import PathSummary
from sim.env import PathTrackingEnv
from sim.path_tracking.config import EnvConfig
from trackslip.errors import InvalidValueError
from trackslip.logs.logfile import read_runs
from trackslip.trajectory.named import REFERENCES
from trackslip.trajectory.path import LIMITS
from trackslip.trajectory.waypoints import waypoints

TURN = "x,y,yaw\n-1.8,1,0\n-1.5,1,0\n-1.2,1,0\n-1.2,1,1.5708\n-1.2,0.7,1.5708\n-1.2,0.4,1.5708\n"
NOISY = np.random.default_rng(0).normal(np.c_[np.arange(0, 2, 0.02), np.zeros(100)], 0.002)


@pytest.fixture
def turn(tmp_path, monkeypatch):
    """A file in the current folder: ahead, a turn of 90 deg to the left, and in reverse."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "turn.csv").write_text(TURN)
    return "turn.csv"


@pytest.fixture
def noisy(tmp_path):
    path = tmp_path / "noisy.csv"
    np.savetxt(path, NOISY, delimiter=",", header="x,y", comments="")
    return str(path)


def driven(trackslip, *options):
    result = trackslip("track", "--localization", "truth", *options)
    (log,) = read_runs(result.folder / "runs.parquet")
    return result, log


def assert_same_path(path, other):
    time = np.linspace(0, other.duration, 50)
    assert path.duration == other.duration
    np.testing.assert_array_equal(path.pose(time), other.pose(time))


def test_a_circle_is_the_same_everywhere(trackslip, tmp_path, monkeypatch):
    """In track, benchmark and the environment, and drawn from the log."""
    circle = REFERENCES["circle"]()
    monkeypatch.chdir(tmp_path)
    once = ("--compensations", "icr_radius", "--starts", "zero", "--seeds", "0", "--jobs", "1")
    options = ("--controllers", "linear", *once, "--plants", "nominal", "--gains", "default")
    compared = trackslip("benchmark", "--references", "circle", "--localization", "truth", *options)
    _, tracked = driven(trackslip, "--reference", "circle")
    (benchmarked,) = read_runs(compared.folder / "runs.parquet")
    np.testing.assert_array_equal(tracked.truth.pose, benchmarked.truth.pose)
    np.testing.assert_array_equal(tracked.truth.pose[0], circle.pose(0.0))
    assert_same_path(path_of(tracked.metadata), circle)
    assert_same_path(EnvConfig().load_reference("circle"), circle)


def test_options_of_the_circle_change_it(trackslip):
    options = ("--circle-radius", "2", "--circle-duration", "3", "--circle-speed", "0.1")
    _, log = driven(trackslip, "--reference", "circle", *options)
    assert log.time[-1] == pytest.approx(3.0)
    v, w = path_of(log.metadata).twist(1.0)
    assert (v, v / w) == pytest.approx((0.1, 2.0))


def test_track_drives_a_turn_on_the_spot(trackslip, turn):
    result, log = driven(trackslip, "--reference", turn)
    assert "Path turn.csv: 1.20 m in 22.2 s, 1 turn on the spot." in result.printed
    (row,) = result.summary["tracking"]
    assert row["rms_position"] < 0.01
    assert row["final_heading"] < np.radians(1)
    speed = np.abs(log.truth.twist[:, 0])
    is_turning = np.abs(log.truth.twist[:, 2]) > 0.25
    assert is_turning.sum() > 50
    assert speed[is_turning].max() < 0.02


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--controller", "stanley"), "controller = 'stanley': .*turn on the spot.*after"),
        (("--controller", "pure_pursuit:look_ahead=0.2"), "controller = 'pure_pursuit': .*linear"),
        (("--compensation", "published"), "compensation = 'published': .*such as icr_radius"),
        (("--compensation", "exponential"), "compensation = 'exponential': .*on the spot"),
    ],
)
def test_who_cant_turn_on_the_spot_says_so(refused, tmp_path, options, message):
    (tmp_path / "turn.csv").write_text(TURN)
    line = refused("track", "--reference", "turn.csv", *options)
    assert re.search(message, line)


def test_a_benchmark_is_refused_before_it_drives(refused, tmp_path):
    (tmp_path / "turn.csv").write_text(TURN)
    line = refused("benchmark", "--references", "turn.csv", "--controllers", "linear", "stanley")
    assert line.startswith("controller = 'stanley': must be one that can turn on the spot")


def test_the_environment_refuses_laws_that_cant_turn(turn):
    twist = {"action": "twist", "reference": turn}
    with pytest.raises(InvalidValueError, match="compensation = 'published'"):
        PathTrackingEnv(compensation="published", **twist)
    env = PathTrackingEnv(compensation="icr_radius", **twist)
    observation, _ = env.reset(seed=0)
    truncated = False
    while not truncated:
        v, w = observation[3:5]
        action = [v + 0.5 * observation[0], w + 1.5 * observation[1] * np.sign(v)]
        action[1] += 3.0 * observation[2]
        observation, _, terminated, truncated, info = env.step(np.float32(action))
        assert not terminated
    assert info["success"]


def test_bends_that_slow_the_robot_are_warned_of(noisy):
    sharp = PathPlan(LIMITS, 0.0)
    summary = PathSummary.of(noisy, sharp.path(noisy), LIMITS)
    (warning,) = summary.warnings(sharp)
    assert "bends between its points slow the robot" in warning
    smooth = PathPlan(LIMITS, 0.0168)
    assert PathSummary.of(noisy, smooth.path(noisy), LIMITS).warnings(smooth) == []
    assert PathSummary.of("spiral", REFERENCES["spiral"](), LIMITS).warnings(sharp) == []


def test_speed_and_tolerance_reach_the_path_and_its_log(trackslip, noisy):
    result, log = driven(trackslip, "--reference", noisy, "--speed", "0.3", "--tolerance", "0.03")
    assert result.summary["path"]["duration"] == pytest.approx(1.98 / 0.3 + 3, rel=0.02)
    limits = LIMITS.scaled(0.3, 0.3)
    assert_same_path(path_of(log.metadata), waypoints(NOISY, limits, tolerance=0.03))


def test_speeds_above_the_robots_are_refused(refused, noisy):
    line = refused("track", "--reference", noisy, "--speed", "0.31")
    assert line.startswith("speed = 0.31: must be at most drive.top_speed = 0.3 m/s")
    line = refused("track", "--reference", "slalom", "--tolerance", "0.01")
    assert line.startswith("tolerance = 0.01: must be left out for paths without a .csv file")
