from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from beside import LENGTH, THICKNESS, cylinder, drive, post, room, teleoperated, wall

from trackslip.errors import LogError
from trackslip.kinematics import RobotGeometry, advance, body_twist
from trackslip.localization.plate import PlateLocator
from trackslip.localization.pose_tracker import EVERY, Follower, Tracker
from trackslip.localization.raw_scans import RawScans, follow_plate
from trackslip.localization.scan import Plate

PLATE = Plate(LENGTH, THICKNESS)
OFF = (0.05, 0.10, np.radians(5.0))


def walk(time):
    """Places (..., 2) of somebody who walks to and fro."""
    return np.stack([4 * np.sin(time / 5), 1.6 + 0 * time], axis=-1)


WALKER = cylinder(walk, 0.25)


def message(first, step, lag=0.0, reach=30.0):
    return SimpleNamespace(
        angle_min=first,
        angle_increment=step,
        range_min=0.1,
        range_max=reach,
        time_increment=lag,
    )


def followed(session, omega=None):
    """The plate in a session's scans; the encoders may read other speeds `omega` (E, 2)."""
    about = message(session.angle_min, session.angle_increment, session.time_increment)
    raw = RawScans.measured(session.time, session.ranges.astype(np.float32), about)
    if omega is None:
        omega = session.omega
    turns = omega[1:] * np.diff(session.encoder_time)[:, None]
    turned = np.concatenate([np.zeros((1, 2)), np.cumsum(turns, axis=0)])
    left, right = turned.T
    at_scans = [np.interp(raw.time, session.encoder_time, side) for side in (left, right)]
    return follow_plate(raw, np.stack(at_scans, axis=-1), PLATE)


def errors(session, found):
    """Errors (n, 3) of the valid poses, and in their own standard deviations; whole turns don't
    count.
    """
    valid = found.estimate.valid
    error = (found.estimate.pose - session.local(found.time))[valid]
    whole_turns = np.round(np.median(error[:, 2]) / (2 * np.pi))
    error[:, 2] -= 2 * np.pi * whole_turns
    variance = np.einsum("sii->si", found.estimate.covariance[valid])
    return error, error / np.sqrt(variance)


def commands(duration=18.0, top=3.0, seed=1):
    return teleoperated(np.random.default_rng(seed), duration, top)


PLACES = {
    "room, off centre": {"things": room(), "place": OFF},
    "walker": {"things": [*room(), WALKER]},
    "slow and clockwise": {"things": room(), "scan_duration": 0.045, "clockwise": True},
    "centimetres": {"things": room(), "noise": 0.002, "quantisation": 0.01},
    "full circle": {"things": [post(0, -3)], "fov": 2 * np.pi * 360 / 361, "start": (-2.0, 0, 0)},
    "wall beside it": {"things": [*room(), wall((-0.3, 3.9), (0.3, 3.9))]},
}


@pytest.mark.parametrize(
    ("place", "seed"),
    [*((name, 1) for name in PLACES), ("room, off centre", 4), ("centimetres", 2)],
)
def test_poses_are_as_good_as_they_say(place, seed):
    """Also of drives that end edge-on with three returns, and in front of a post that one beam
    meets as well.
    """
    options = PLACES[place]
    session = drive(commands(seed=seed), **options)
    found = followed(session)
    error, deviation = errors(session, found)
    assert found.estimate.valid.mean() > 0.75
    spread = np.sqrt(np.mean(deviation**2, axis=0))
    assert (spread < 1.2).all()
    assert np.abs(np.mean(deviation, axis=0)).max() < 0.3
    rounding = options.get("quantisation", 0) / np.sqrt(12)
    noise = np.hypot(options.get("noise", 0.005), rounding)
    assert np.percentile(np.abs(error[:, :2]), 95) < 0.01 + noise
    assert found.scanner.noise == pytest.approx(noise, rel=0.05)
    assert not found.notes


STANDING = np.where(np.arange(1500)[:, None] < 750, 0.0, commands(30.0))


@pytest.mark.parametrize(("omega", "fov"), [(STANDING, np.pi), (commands(40.0, 5.0), np.pi / 3)])
def test_robots_that_rest_or_leave_the_field_of_view(omega, fov):
    session = drive(omega, things=room(), fov=fov)
    error, _ = errors(session, followed(session))
    assert (np.abs(error).max(axis=0) < [0.02, 0.02, 0.1]).all()


def test_what_looks_wrong_is_told():
    session = drive(commands(15.0), things=room(), beams=241)
    swapped = followed(session, omega=session.omega[:, ::-1])
    assert "swapped" in " ".join(swapped.notes)
    spin = drive(np.tile([[-2.0, 2.0]], (500, 1)), things=room(), beams=181)
    assert "only turns on the spot" in " ".join(followed(spin).notes)


def test_a_straight_drive_says_nothing_about_the_sides():
    session = drive(np.tile([[2.0, 2.0]], (600, 1)), things=room(), beams=241)
    assert followed(session).notes == ()


def test_scans_without_a_plate():
    said = r"no plate of 0\.6x0\.04 m moves as the encoders say in its .* scans"
    behind = drive(commands(), start=(0.0, -5.0, 0.0), things=room(), beams=181)
    at_rest = drive(np.zeros((500, 2)), start=(0.0, 3.0, 0.0), things=room(), beams=181)
    for session in (behind, at_rest):
        with pytest.raises(LogError, match=said):
            followed(session)


def test_a_plate_must_be_located_in_12_scans():
    session = drive(commands(), things=room())
    for count in (11, 12):
        rows = np.linspace(0, len(session.time) - 1, count).round().astype(int)
        few = replace(session, time=session.time[rows], ranges=session.ranges[rows])
        if count < 12:
            with pytest.raises(LogError, match=r"no plate of .* in its 11 scans"):
                followed(few)
        else:
            assert followed(few).estimate.valid.all()


def test_returns_and_beams_follow_rep_117():
    row = np.array([np.nan, np.inf, -np.inf, 0.0, 0.05, 0.1, 5.0, 9.99, 10.0, 11.0], np.float32)
    is_return = [0, 0, 0, 0, 0, 1, 1, 1, 0, 0]
    time = np.arange(20) / 10
    raw = RawScans.measured(time, np.tile(row, (20, 1)), message(1.0, -0.1, 0.002, reach=10.0))
    np.testing.assert_array_equal(np.isfinite(raw.ranges[0]), is_return[::-1])
    np.testing.assert_allclose(raw.bearings, np.linspace(0.1, 1.0, 10), atol=1e-12)
    np.testing.assert_allclose(raw.lag, 0.002 * np.arange(9, -1, -1))
    no_limit = message(0.0, 0.1)
    no_limit.range_min = 0.0
    raw = RawScans.measured(time, np.tile([0.0, 0.05], (20, 1)), no_limit)
    np.testing.assert_array_equal(np.isfinite(raw.ranges[0]), [False, True])
    for distance, step, said in (
        (np.inf, 0.1, "no return"),
        (1.0, 0.0, "increment = 0"),
        (1.0, 1.0, "a full circle"),
    ):
        ranges = np.full((20, 10), distance, np.float32)
        with pytest.raises(LogError, match=said):
            RawScans.measured(time, ranges, message(0.0, step))


GEOMETRY = RobotGeometry(half_gauge=0.17, sprocket_radius=0.06)
ROWS = 8 * EVERY + 4


def test_what_is_found_does_not_depend_on_the_blocks(scan_rectangle):
    """Nor does it need the encoders to be right: the sprockets slip by a tenth."""
    angle = np.tile([[0.10, 0.14], [0.13, 0.09]], (ROWS, 1, 1)).swapaxes(0, 1)  # (2, ROWS, 2)
    angle[:, 0] = 0.0
    poses = np.empty((2, ROWS, 3))
    poses[:, -1] = [[2.0, 0.4, 0.3], [1.8, -0.5, 2.4]]  # before the first row, which doesn't move
    for k in range(ROWS):
        twist = body_twist(0.9 * angle[:, k], 0.0, GEOMETRY)
        poses[:, k] = advance(poses[:, k - 1], twist, 1.0)
    flat = scan_rectangle(poses.reshape(-1, 3), np.random.default_rng(3))
    scan = replace(flat, ranges=flat.ranges.reshape(2, ROWS, -1))

    def followed(ends):
        """Poses, covariances and validity from blocks that end before these rows."""
        follower = Follower(PlateLocator(Plate()), Tracker(poses[:, 0], GEOMETRY))
        found = []
        for begin, end in zip([0, *ends], [*ends, ROWS], strict=True):
            block = replace(scan, ranges=scan.ranges[:, begin:end])
            found.append(follower.follow(block, angle[:, begin:end]))
        pose = np.concatenate([one.pose for one in found], axis=1)
        covariance = np.concatenate([one.covariance for one in found], axis=1)
        valid = np.concatenate([one.valid for one in found], axis=1)
        return pose, covariance, valid

    whole = followed([])
    for ends in ([EVERY], [2 * EVERY, 3 * EVERY, 5 * EVERY]):
        for one, other in zip(followed(ends), whole, strict=True):
            np.testing.assert_array_equal(one, other)
    pose, _, valid = whole
    assert valid.mean() > 0.95
    error = (pose - poses)[valid]
    assert np.sqrt(np.mean(error[:, :2] ** 2)) < 0.005
