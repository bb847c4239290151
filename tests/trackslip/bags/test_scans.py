from dataclasses import replace

import numpy as np
import pytest
from bags import START, scan_messages, stamp, transform, write_session
from beside import LENGTH, THICKNESS, compose, drive, teleoperated
from scipy.spatial.transform import Rotation

from trackslip.bags.choice import BagChoice
from trackslip.bags.drives import load
from trackslip.errors import LogError, LogWarning
from trackslip.localization.scan import Plate

MOUNT = (1.0, -2.0, 0.7)
OFF = (0.05, 0.10, np.radians(5.0))
CHOICE = BagChoice(plate=Plate(LENGTH, THICKNESS))
ON_ROBOT = [
    transform(START, "base_link", "laser", (0.1, 0.0, 0.0), topic="/tf_static"),
    *(transform(stamp(k / 10), "odom", "base_link", (0.1 * k, 0, 0)) for k in range(20)),
]


@pytest.fixture(scope="module")
def driven():
    start = compose(np.array(MOUNT), np.array([3.0, 0.0, 1.0])).tolist()
    omega = teleoperated(np.random.default_rng(1), 15.0, 3.0)
    return drive(omega, start, MOUNT, beams=241, place=OFF)


def errors(log, true):
    """Root mean squares (3,) of the errors of the valid poses; whole turns don't count."""
    error = log.pose[log.is_valid] - true(log.time[log.is_valid])
    whole_turns = np.round(np.median(error[:, 2]) / (2 * np.pi))
    error[:, 2] -= 2 * np.pi * whole_turns
    return np.sqrt(np.mean(error**2, axis=0))


def test_without_transforms_the_scanner_is_the_origin(tmp_path, driven):
    (log,) = load(write_session(tmp_path / "run", "ros1", driven), CHOICE)
    assert log.is_valid.sum() > 0.9 * len(driven.time)
    assert (errors(log, driven.local) < [0.008, 0.008, np.radians(0.6)]).all()
    assert log.scans.scan.noise == pytest.approx(0.005, rel=0.05)
    rows = np.searchsorted(driven.encoder_time, log.time[1:100] - 1e-6)
    np.testing.assert_allclose(log.omega[1:100], driven.omega[rows], atol=1e-6)


def test_transforms_tell_where_the_scanner_stands(tmp_path, driven):
    """It is mounted upside down, where its beams run the other way round seen from above."""
    turn = Rotation.from_euler("z", MOUNT[2]) * Rotation.from_euler("x", np.pi)
    driven = replace(driven, angle_min=-driven.angle_min, angle_increment=-driven.angle_increment)
    turned = dict(zip("xyzw", turn.as_quat().tolist(), strict=True))
    frames = [
        transform(START, "map", "mast", (0, 0, 0), topic="/tf_static"),
        transform(START, "mast", "laser", MOUNT, topic="/tf_static", z=0.3, turn=turned),
    ]
    (log,) = load(write_session(tmp_path / "run", "mcap", driven, frames), CHOICE)
    np.testing.assert_allclose(log.metadata["bag"]["mount"], MOUNT, atol=1e-9)
    assert errors(log, driven.path)[:2].max() < 0.008


def test_scans_with_other_beams_are_left_out(tmp_path, driven):
    few = replace(driven, time=driven.time[:15], angle_increment=2 * driven.angle_increment)
    bag = write_session(tmp_path / "run", "mcap", driven, scan_messages(few))
    said = "topic /scan: 15 scans with other beams than most left out"
    with pytest.warns(LogWarning, match=said):
        load(bag, CHOICE)


@pytest.mark.parametrize(
    ("messages", "choice", "said"),
    [
        ([], replace(CHOICE, scan="/joint_states"), "needs sensor_msgs/msg/LaserScan"),
        ([], replace(CHOICE, plate=Plate(0.1, 0.02)), "topic /scan: no plate of 0.1x0.02 m moves"),
        (
            ON_ROBOT,
            CHOICE,
            "topic /scan: .* frame 'laser' moves in 'odom': a scanner beside the field",
        ),
    ],
)
def test_what_the_bag_does_not_have(tmp_path, driven, messages, choice, said):
    bag = write_session(tmp_path / "run", "mcap", driven, messages)
    with pytest.raises(LogError, match=said):
        load(bag, choice)
