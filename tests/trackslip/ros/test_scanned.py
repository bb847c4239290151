"""Scans of a plate in bags that other libraries write, against the truth."""

from dataclasses import replace

import numpy as np
import pytest
from beside import GEOMETRY, LENGTH, THICKNESS, D, compose, drive, teleoperated
from scanned import other_poses, scan_messages, static_transform, write_session
from scipy.spatial.transform import Rotation

from trackslip.errors import LogError
from trackslip.identification.drive_law import fit_drives
from trackslip.localization.scan import Plate
from trackslip.ros.bag import open_bag
from trackslip.ros.choice import BagChoice
from trackslip.ros.drive_log import load
from trackslip.ros.scanned import scanned_drives
from trackslip.se2 import Mounting

PLATE = Plate(LENGTH, THICKNESS)
MOUNT = (1.0, -2.0, 0.7)
OFF = (0.05, 0.10, np.radians(5.0))
CHOICE = BagChoice(plate=PLATE)


def session(duration=20.0, **more):
    start = compose(np.array(MOUNT), np.array([3.0, 0.0, 1.0])).tolist()
    rng = np.random.default_rng(1)
    return drive(teleoperated(rng, duration, 3.0), start, MOUNT, beams=241, **more)


@pytest.fixture(scope="module")
def driven():
    return session(place=OFF)


def error(log, driven, frame=None):
    """Root mean square errors (3,) of the plate's poses in the world."""
    valid = log.is_valid
    true = driven.path(log.time[valid])
    if frame is not None:
        true = compose(frame, true)
    found = log.pose[valid] - true
    found[:, 2] -= 2 * np.pi * np.round(np.median(found[:, 2]) / (2 * np.pi))
    return np.sqrt(np.mean(found**2, axis=0))


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap", "foxglove"])
def test_the_plate_in_bags_of_every_kind(tmp_path, driven, kind):
    path = write_session(tmp_path / "run", kind, driven)
    (log,) = load(path, replace(CHOICE, mount=MOUNT))
    assert log.is_valid.sum() > 0.9 * len(driven.time)
    assert error(log, driven)[:2].max() < 0.008
    assert error(log, driven)[2] < np.radians(0.6)
    assert log.scans.scan.noise == pytest.approx(0.005, rel=0.1)
    np.testing.assert_allclose(
        log.omega[1:100], driven.omega[np.searchsorted(driven.encoder_time, log.time[1:100] - 1e-6)], atol=1e-6
    )


def test_the_law_and_the_plate_s_place_are_found(tmp_path):
    driven = session(duration=40.0, place=OFF)
    logs = load(write_session(tmp_path / "run", "mcap", driven), CHOICE)
    law = fit_drives("icr_radius", logs, GEOMETRY)
    for name, true in zip(("sensor_x", "sensor_y", "sensor_yaw"), OFF, strict=True):
        low, high = law.interval95[name]
        assert low - 0.001 < true < high + 0.001
        assert high - low < 0.02
    low, high = law.interval95["offset"]
    assert low < D < high
    assert high - low < 0.002
    given = fit_drives("icr_radius", logs, GEOMETRY, Mounting(*OFF))
    assert given.values["offset"] == pytest.approx(D, abs=0.001)


def test_where_the_scanner_stands_without_being_told(tmp_path, driven):
    path = write_session(tmp_path / "run", "mcap", driven)
    (one,) = scanned_drives(open_bag(path), CHOICE, [])
    np.testing.assert_array_equal(one.stand.mount, 0)
    assert "the scanner is the origin" in one.stand.source
    np.testing.assert_allclose(
        one.log.pose[one.log.is_valid], one.seen.estimate.pose[one.seen.estimate.valid], atol=1e-9
    )


def test_where_the_scanner_stands_by_transforms(tmp_path, driven):
    x, y, yaw = MOUNT
    turn = Rotation.from_euler("z", yaw).as_quat()
    frames = [
        static_transform("map", "mast", (0, 0, 0), (0, 0, 0, 1)),
        static_transform("mast", "laser", (x, y, 0.3), turn),
    ]
    path = write_session(tmp_path / "run", "mcap", driven, frames)
    (one,) = scanned_drives(open_bag(path), CHOICE, [])
    np.testing.assert_allclose(one.stand.mount, MOUNT, atol=1e-9)
    assert one.stand.source == "from transforms, in map"
    assert error(one.log, driven)[:2].max() < 0.008


def test_a_scanner_upside_down(tmp_path, driven):
    """Its beams run the other way round seen from above; the transforms tell."""
    x, y, yaw = MOUNT
    turn = (Rotation.from_euler("z", yaw) * Rotation.from_euler("x", np.pi)).as_quat()
    frames = [static_transform("map", "laser", (x, y, 0.3), turn)]
    mirrored = replace(driven, angle_min=-driven.angle_min, angle_increment=-driven.angle_increment)
    path = write_session(tmp_path / "run", "mcap", mirrored, frames)
    (one,) = scanned_drives(open_bag(path), CHOICE, [])
    assert one.stand.upside_down
    assert error(one.log, driven)[:2].max() < 0.008


def test_where_the_scanner_stands_by_other_poses(tmp_path, driven):
    path = write_session(tmp_path / "run", "mcap", driven, other_poses(driven))
    (one,) = scanned_drives(open_bag(path), replace(CHOICE, poses="/slam/pose"), [])
    found = one.stand.aligned
    assert (np.abs(found.mount - MOUNT) < 4 * found.stderr).all()
    assert found.stderr.max() < 0.02


def test_what_a_scanner_may_send(tmp_path, driven):
    """No return as 0, NaN, inf or beyond the range; a restart with other beams; scans before the encoders."""
    ranges = driven.ranges.copy()
    missing = ~np.isfinite(ranges)
    ranges[missing] = np.random.default_rng(0).choice([0.0, np.nan, np.inf, 31.0, 0.02], missing.sum())
    other = replace(driven, time=driven.time[:15], angle_increment=2 * driven.angle_increment)
    early = replace(driven, time=driven.time[:15] - 5.0)
    messages = [*scan_messages(other, ranges=ranges[:, :100]), *scan_messages(early)]
    path = write_session(tmp_path / "run", "mcap", driven, messages, ranges=ranges)
    notes = []
    (one,) = scanned_drives(open_bag(path), replace(CHOICE, mount=MOUNT), notes)
    assert "topic /scan: 15 scans with other beams than most are left out" in notes
    assert "topic /scan: 15 scans before and after the encoders' readings are left out" in notes
    assert error(one.log, driven)[:2].max() < 0.008


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        (replace(CHOICE, scan="/nope"), "it has no topic '/nope'"),
        (replace(CHOICE, scan="/joint_states"), "needs sensor_msgs/msg/LaserScan"),
        (replace(CHOICE, plate=Plate(0.1, 0.02)), "no plate of 0.1x0.02 m moves .* what moves is 0.5. m long"),
        (replace(CHOICE, poses="/odom"), "it has no topic '/odom'"),
    ],
)
def test_what_the_bag_does_not_have(tmp_path, driven, choice, said):
    path = write_session(tmp_path / "run", "mcap", driven)
    with pytest.raises(LogError, match=said) as refused:
        scanned_drives(open_bag(path), choice, [])
    assert "\n" not in str(refused.value)


def test_which_scanner_must_be_said_where_there_are_two(tmp_path, driven):
    path = write_session(tmp_path / "run", "mcap", driven, scan_messages(driven, topic="/front"))
    with pytest.raises(LogError, match="scans may be /front, /scan: choose with --scan TOPIC"):
        scanned_drives(open_bag(path), CHOICE, [])
    scanned_drives(open_bag(path), replace(CHOICE, scan="/front"), [])


def test_a_scanner_on_the_robot_is_refused(tmp_path, driven):
    """Its frame is fixed in one that moves."""
    mounted = static_transform("base_link", "laser", (0.1, 0.0, 0.3), (0, 0, 0, 1))
    moving = []
    for k in range(20):
        _, kind, at, fields = static_transform("odom", "base_link", (0.1 * k, 0, 0), (0, 0, 0, 1), at=k / 10)
        moving.append(("/tf", kind, at, fields))
    path = write_session(tmp_path / "run", "mcap", driven, [mounted, *moving])
    with pytest.raises(LogError, match=r"topic /scan: .* frame 'laser' moves in 'odom': a scanner beside the field"):
        scanned_drives(open_bag(path), CHOICE, [])


def test_empty_scans(tmp_path, driven):
    path = write_session(tmp_path / "run", "mcap", driven, ranges=np.full(driven.ranges.shape, np.inf))
    with pytest.raises(LogError, match="topic /scan: its scans have no return"):
        scanned_drives(open_bag(path), CHOICE, [])
