"""Scans of a plate in bags that other libraries write, against the truth."""

from dataclasses import replace

import numpy as np
import pytest
from bags import START, stamp, transform
from beside import GEOMETRY, LENGTH, THICKNESS, D, compose, drive, teleoperated
from scanned import other_poses, scan_messages, write_session
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


def error(log, driven):
    """Root mean square errors (3,) of the plate's poses in the world."""
    valid = log.is_valid
    found = log.pose[valid] - driven.path(log.time[valid])
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


@pytest.mark.parametrize("upside_down", [False, True])
def test_where_the_scanner_stands_by_transforms(tmp_path, driven, upside_down):
    """Upside down, its beams run the other way round seen from above."""
    turn = Rotation.from_euler("z", MOUNT[2])
    if upside_down:
        turn = turn * Rotation.from_euler("x", np.pi)
        driven = replace(driven, angle_min=-driven.angle_min, angle_increment=-driven.angle_increment)
    turned = dict(zip("xyzw", turn.as_quat().tolist(), strict=True))
    frames = [
        transform(START, "map", "mast", (0, 0, 0), topic="/tf_static"),
        transform(START, "mast", "laser", MOUNT, topic="/tf_static", z=0.3, turn=turned),
    ]
    (one,) = scanned_drives(open_bag(write_session(tmp_path / "run", "mcap", driven, frames)), CHOICE, [])
    np.testing.assert_allclose(one.stand.mount, MOUNT, atol=1e-9)
    assert (one.stand.source, one.stand.upside_down) == ("from transforms, in map", upside_down)
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
    assert "topic /scan: 15 scans with other beams than most left out" in notes
    assert "topic /scan: 15 scans before and after the encoders' readings left out" in notes
    assert error(one.log, driven)[:2].max() < 0.008


ON_ROBOT = [
    transform(START, "base_link", "laser", (0.1, 0.0, 0.0), topic="/tf_static"),
    *(transform(stamp(k / 10), "odom", "base_link", (0.1 * k, 0, 0)) for k in range(20)),
]


@pytest.mark.parametrize(
    ("messages", "choice", "said"),
    [
        ([], replace(CHOICE, scan="/nope"), "it has no topic '/nope'"),
        ([], replace(CHOICE, scan="/joint_states"), "needs sensor_msgs/msg/LaserScan"),
        ([], replace(CHOICE, plate=Plate(0.1, 0.02)), "no plate of 0.1x0.02 m moves .* what moves is 0.5. m long"),
        ([], replace(CHOICE, poses="/odom"), "it has no topic '/odom'"),
        (ON_ROBOT, CHOICE, "topic /scan: .* frame 'laser' moves in 'odom': a scanner beside the field"),
    ],
)
def test_what_the_bag_does_not_have(tmp_path, driven, messages, choice, said):
    path = write_session(tmp_path / "run", "mcap", driven, messages)
    with pytest.raises(LogError, match=said) as refused:
        scanned_drives(open_bag(path), choice, [])
    assert "\n" not in str(refused.value)


def test_which_scanner_must_be_said_where_there_are_two(tmp_path, driven):
    empty = np.full(driven.ranges.shape, np.inf)
    path = write_session(tmp_path / "run", "mcap", driven, scan_messages(driven, topic="/front", ranges=empty))
    for topic, said in (
        (None, "scans may be /front, /scan: choose with --scan"),
        ("/front", "its scans have no return"),
    ):
        with pytest.raises(LogError, match=said):
            scanned_drives(open_bag(path), replace(CHOICE, scan=topic), [])
    scanned_drives(open_bag(path), replace(CHOICE, scan="/scan"), [])
