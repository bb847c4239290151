import numpy as np
import pytest
from bags import fix, imu, in_order, joints_of, poses_of, stamp, write_bag
from drives import drive_log
from pymap3d import enu2geodetic
from scipy.spatial.transform import Rotation

from sim.bags.topics import FIELD
from trackslip.bags.choice import BagChoice
from trackslip.bags.drives import read_bags
from trackslip.drives.conditioning import drive_of
from trackslip.errors import LogError

LOG = drive_log(0, 14.0)
TIME = np.arange(LOG.time[0], LOG.time[-1], 0.04)  # 25 Hz
YAW = np.unwrap(LOG.truth.pose[:, 2])
RATE = np.gradient(np.interp(TIME, LOG.time, YAW), TIME)
UPSIDE_DOWN = Rotation.from_euler("x", 180, degrees=True)
TILTED = Rotation.from_euler("yx", [30, 180], degrees=True)
UPRIGHT = Rotation.identity()


def imus(mounting=UPRIGHT, rows=slice(None), **others):
    in_robot = RATE[:, None] * [0.0, 0.0, 1.0] + 0.001
    rates = mounting.inv().apply(in_robot)[rows].tolist()
    return [imu(stamp(at), rate, **others) for at, rate in zip(TIME[rows], rates, strict=True)]


def read(path, *messages, kind="mcap", poses=None):
    poses = poses_of(LOG) if poses is None else poses
    bag = write_bag(path / "a", kind, in_order(joints_of(LOG), poses, *messages))
    return read_bags(bag)


def require_true(log):
    """The gyro of the log is the true yaw rate, mean since the row before."""
    true = np.diff(np.interp(log.time, LOG.time, YAW)) / np.diff(log.time)
    known = np.isfinite(log.gyro[1:])
    assert known.mean() > 0.94
    np.testing.assert_allclose(log.gyro[1:][known], true[known], atol=0.05)


@pytest.mark.parametrize(
    ("mounting", "shown", "kind"), [(UPRIGHT, "[0. 0. 1.]", "ros1"), (TILTED, "-0.87]", "mcap")]
)
def test_its_axis_is_that_of_the_turns(tmp_path, mounting, shown, kind):
    found = read(tmp_path, imus(mounting), kind=kind)
    (log,) = found.runs
    require_true(log)
    assert not found.warnings
    assert "gyro: /imu/data in imu_link about" in found.taken[0]
    assert shown in found.taken[0]
    assert log.metadata["bag"]["gyro"] == "/imu/data in imu_link"


def test_with_positions_alone_the_sprockets_tell_the_axis(tmp_path):
    seen = LOG.is_valid
    x, y, _ = LOG.pose[seen].T
    places = np.column_stack(enu2geodetic(x, y, 0.0, *FIELD)).tolist()
    fixes = [fix(stamp(at), *place) for at, place in zip(LOG.time[seen], places, strict=True)]
    found = read(tmp_path, imus(UPSIDE_DOWN), poses=fixes)
    require_true(found.runs[0])


def test_its_own_imu_is_preferred_and_another_can_be_chosen(tmp_path):
    own = imus()
    camera = imus(UPSIDE_DOWN, topic="/camera/imu", frame="camera_imu")
    found = read(tmp_path, own, camera)
    assert "gyro: /imu/data in imu_link, one of 2 about [0. 0. 1.]" in found.taken[0]
    bag = tmp_path / "a"
    chosen = read_bags(bag, BagChoice(imu="/camera/imu"))
    (log,) = chosen.runs
    require_true(log)
    assert "/camera/imu in camera_imu about" in chosen.taken[0]
    without = read_bags(bag, BagChoice(imu="none"))
    assert without.runs[0].gyro is None
    for name, message in (
        ("/imu", "no topic '/imu'"),
        ("/joint_states", "needs sensor_msgs/msg/Imu"),
    ):
        with pytest.raises(LogError, match=message):
            read_bags(bag, BagChoice(imu=name))


def test_gaps_are_not_measured(tmp_path):
    gap = (TIME > 7) & (TIME < 7.6)
    (log,) = read(tmp_path, imus(rows=~gap)).runs
    inside = (log.time > 7.1) & (log.time < 7.5)
    assert np.isnan(log.gyro[inside]).all()
    require_true(log)


UNSTAMPED = [imu(0, (0.0, 0.0, 0.1), late=stamp(at)) for at in TIME]
OTHERS = np.random.default_rng(0).normal(size=(len(TIME), 3))
OF_ANOTHER = [imu(stamp(at), rates) for at, rates in zip(TIME, OTHERS, strict=True)]


@pytest.mark.parametrize(
    ("messages", "words"),
    [
        (imus(unknown=True), "topic /imu/data: it states no angular velocities: read without gyro"),
        (UNSTAMPED, "read without gyro: topic /imu/data: "),
        (
            OF_ANOTHER,
            "gyro of /imu/data in imu_link left out: it doesn't follow the robot's turns",
        ),
    ],
)
def test_an_imu_without_a_gyro_leaves_the_log_without(tmp_path, messages, words):
    found = read(tmp_path, messages)
    assert found.runs[0].gyro is None
    assert any(words in line for line in found.warnings)
    assert "gyro" not in found.taken[0]


def test_an_imu_in_degrees_is_refused_as_in_a_table(tmp_path):
    degrees = np.degrees(RATE)[:, None] * [0.0, 0.0, 1.0]
    messages = [imu(stamp(t), w) for t, w in zip(TIME, degrees.tolist(), strict=True)]
    (log,) = read(tmp_path, messages).runs
    with pytest.raises(LogError, match=r"gyro: it turns 5[78].* times as far as the headings"):
        drive_of(log)


def without_poses(path, heading=None, **others):
    headings = np.interp(TIME, LOG.time, YAW) if heading is None else heading
    messages = []
    for at, w, h in zip(TIME.tolist(), RATE.tolist(), headings, strict=True):
        messages.append(imu(stamp(at), (0.0, 0.0, w), heading=h, **others))
    return read(path, messages, poses=[])


def test_headings_come_from_an_orientation_or_else_from_the_gyro(tmp_path):
    found = without_poses(tmp_path)
    (log,) = found.runs
    assert "poses: /imu/data (headings of an IMU); gyro: /imu/data" in found.taken[0]
    assert not log.has_place.any()
    heading = log.pose[log.has_heading, 2]
    true = np.interp(log.time, LOG.time, YAW)[log.has_heading]
    np.testing.assert_allclose(heading - heading[0], true - true[0], atol=0.01)
    require_true(log)
    found = without_poses(tmp_path / "without", heading=[0.0] * len(TIME))
    (log,) = found.runs
    assert "; no poses; gyro: /imu/data" in found.taken[0]
    assert not log.is_valid.any()
    require_true(log)
