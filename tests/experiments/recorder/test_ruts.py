"""Ruts in recordings, as rerun reads them back."""

from dataclasses import asdict

import numpy as np
import pytest
from rerun.chunk import RrdReader
from rrd import component

from experiments import recorder
from experiments.recorder.model import STONE
from sim.robot.parameters import RobotParameters
from trackslip.logs.runlog import RunLog, Truth

ROBOT = RobotParameters()
SPEED = 0.2
TIME = np.arange(0.0, 4.01, 0.05)
DEPTH = np.stack([0.010 + 0.005 * TIME, np.full_like(TIME, 0.004)], axis=-1)
"""Of the ruts under the left and the right track [m]."""
RESISTANCE = np.full((len(TIME), 2), -1.5)


def log_of(truth, **options):
    omega = np.full((len(TIME), 2), SPEED / ROBOT.sprocket_radius)
    metadata = {"robot": asdict(ROBOT), "geometry": vars(ROBOT.geometry)}
    return RunLog("sand", TIME, omega, truth.pose, truth=truth, metadata=metadata, **options)


def truth_of(heading=0.0, **soil):
    """Straight ahead from (0.1, 0)."""
    distance = SPEED * TIME
    pose = np.stack(
        [
            0.1 + distance * np.cos(heading),
            distance * np.sin(heading),
            np.full_like(TIME, heading),
        ],
        axis=-1,
    )
    twist = np.tile([SPEED, 0.0, 0.0], (len(TIME), 1))
    return Truth(pose, twist, **soil)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    file = tmp_path_factory.mktemp("ruts") / "sand.rrd"
    recorder.record(file, [log_of(truth_of(sinkage=DEPTH, resistance=RESISTANCE))])
    return file


def stones_of(file):
    """Times (n,) and corners (n, K, 3) of the cells of each stone with ruts, by entity."""
    paths = {chunk.entity_path for chunk in RrdReader(file).stream()}
    stones = {}
    for path in paths:
        if path.startswith("/field/ruts/"):
            time, position = component(file, path, "vertex_positions")
            stones[path] = time, position.reshape(len(time), -1, 3)
    return stones


def depth_at(stones, x, y, time):
    """Depth of the corner of a cell that is closest to a place, at a time [m]."""
    for times, corners in stones.values():
        distance = np.hypot(corners[0, :, 0] - x, corners[0, :, 1] - y)
        if distance.min() < 0.0142:
            state = np.flatnonzero(times <= time)[-1]
            return -corners[state, distance.argmin(), 2]
    raise AssertionError(f"no stone at {x}, {y}")


def test_the_rut_behind_each_track_has_its_depth(recorded):
    """A place is as deep as when the rear end of the track left it."""
    stones = stones_of(recorded)
    rear = -ROBOT.contact_length / 2
    for k, side in enumerate((1, -1)):
        y = side * ROBOT.half_gauge
        for left_at in (1.0, 2.5, 3.5):
            place = 0.1 + SPEED * left_at + rear
            expected = np.interp(left_at, TIME, DEPTH[:, k])
            # a state is shown every 0.5 s, and cells have 2 cm
            assert depth_at(stones, place - 0.01, y, 4.0) == pytest.approx(expected, abs=0.0011)


def test_soil_is_flat_until_a_track_comes(recorded):
    stones = stones_of(recorded)
    ahead = 0.1 + ROBOT.contact_length / 2 + SPEED * 2.0  # the front end after 2 s
    assert depth_at(stones, ahead - 0.06, ROBOT.half_gauge, 2.0) > 0.01
    assert depth_at(stones, ahead + 0.2, ROBOT.half_gauge, 2.0) == 0.0
    assert depth_at(stones, ahead + 0.2, ROBOT.half_gauge, 4.0) > 0.01
    assert depth_at(stones, ahead, 0.0, 4.0) == 0.0  # between the tracks


def test_stones_with_ruts_are_no_stones_of_the_paving(recorded):
    whole = set()
    for chunk in RrdReader(recorded).stream().filter(content="/field/ground"):
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.endswith(":centers"):
                centres = np.array(batch.column(name)[0].as_py())
                whole |= {tuple(corner) for corner in np.floor(centres[:, :2] / STONE).astype(int)}
    with_ruts = {tuple(map(int, path.rsplit("/", 1)[1].split("_"))) for path in stones_of(recorded)}
    assert whole
    assert not whole & with_ruts
    columns = sorted(column for column, _ in with_ruts)
    assert columns[0] == -1  # the rear end of the tracks at the start
    assert columns[-1] == 2  # the front end after 0.8 m is at 1.07 m


def test_robots_are_as_deep_as_their_ruts(recorded):
    _, place = component(recorded, "/run/robot/chassis", "translation")
    np.testing.assert_allclose(
        place[0, 2] - place[:, 2], np.mean(DEPTH - DEPTH[0], axis=1), atol=1e-6
    )


def test_depth_and_resistance_are_plotted(recorded):
    _, depth = component(recorded, "/run/soil/sinkage", "scalars")
    _, force = component(recorded, "/run/soil/resistance", "scalars")
    np.testing.assert_allclose(depth, 1e3 * DEPTH)
    np.testing.assert_allclose(force, RESISTANCE)


def test_firm_ground_has_no_ruts(tmp_path):
    recorder.record(tmp_path / "firm.rrd", [log_of(truth_of())])
    assert stones_of(tmp_path / "firm.rrd") == {}


def test_a_second_robot_deepens_the_ruts_of_the_first(tmp_path):
    first = log_of(truth_of(sinkage=DEPTH, resistance=RESISTANCE))
    crossing = log_of(truth_of(np.pi / 6, sinkage=0 * DEPTH + 0.05, resistance=RESISTANCE))
    other = RunLog(
        "crossing",
        crossing.time,
        crossing.omega,
        crossing.pose,
        truth=crossing.truth,
        metadata=crossing.metadata,
    )
    recorder.record(tmp_path / "both.rrd", [first, other])
    depths = [corners[-1, :, 2].min() for _, corners in stones_of(tmp_path / "both.rrd").values()]
    assert min(depths) == pytest.approx(-0.05)
