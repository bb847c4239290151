"""Poses of a plate in scans of rooms, fields and crowds, against the truth."""

import re
from dataclasses import replace

import numpy as np
import pytest
from beside import EPSILON, GEOMETRY, LENGTH, THICKNESS, D, cylinder, drive, post, room, teleoperated, wall

from trackslip.errors import LogError
from trackslip.identification.drive_law import fit_drives
from trackslip.localization.scan import Plate
from trackslip.rangefinder.findings import findings
from trackslip.rangefinder.log import scanned_log
from trackslip.rangefinder.plate_motion import Turned, plate_place
from trackslip.rangefinder.series import ScanSeries
from trackslip.rangefinder.session import sight_plate

PLATE = Plate(LENGTH, THICKNESS)
OFF = (0.05, 0.10, np.radians(5.0))
WALKER = cylinder(lambda time: np.stack([4 * np.sin(time / 5), 1.6 + 0 * time], axis=-1), 0.25)


def series_of(session):
    limits = session.angle_min, session.angle_increment, 0.05, 30.0, session.time_increment
    return ScanSeries.measured("a", session.time, session.ranges, *limits)


def sighted(session, plate=PLATE, noise=None):
    return sight_plate(series_of(session), Turned.of(session.encoder_time, session.omega), plate, noise)


def errors(session, seen):
    """Errors (n, 3) of the valid poses, and in their own standard deviations; whole turns don't count."""
    valid = seen.estimate.valid
    error = (seen.estimate.pose - session.local(seen.time))[valid]
    error[:, 2] -= 2 * np.pi * np.round(np.median(error[:, 2]) / (2 * np.pi))
    return error, error / np.sqrt(np.einsum("sii->si", seen.estimate.covariance[valid]))


def commands(duration=25.0, top=3.0):
    return teleoperated(np.random.default_rng(1), duration, top)


@pytest.mark.parametrize(
    ("more", "least", "within"),
    [
        ({}, 0.93, 1.15),
        ({"things": room()}, 0.93, 1.15),
        ({"things": room(), "place": OFF}, 0.93, 1.15),
        ({"things": [*room(), WALKER]}, 0.88, 1.15),
        ({"things": room(), "scan_duration": 0.045, "clockwise": True}, 0.93, 1.15),
        ({"things": room(), "noise": 0.002, "quantisation": 0.01}, 0.93, 1.15),
        ({"things": room(), "noise": 0.03}, 0.93, 1.15),
        ({"things": [post(0, -3)], "fov": 2 * np.pi * 360 / 361, "start": (-2.0, 0, 0)}, 0.95, 1.15),
    ],
    ids=["open", "room", "off centre", "walker", "clockwise and slow", "centimetres", "noisy", "full circle"],
)
def test_poses_are_as_good_as_they_say(more, least, within):
    session = drive(commands(), **more)
    seen = sighted(session)
    error, deviation = errors(session, seen)
    assert seen.estimate.valid.mean() > least
    assert np.sqrt(np.mean(deviation**2, axis=0)).max() < within
    assert np.abs(np.mean(deviation, axis=0)).max() < 0.3
    noise = max(more.get("noise", 0.005), more.get("quantisation", 0) / np.sqrt(12))
    assert np.abs(error[:, :2]).max() < 0.02 + 1.5 * noise
    assert seen.scatter == pytest.approx(
        np.hypot(more.get("noise", 0.005), more.get("quantisation", 0) / 12**0.5), rel=0.1
    )
    assert seen.front


def test_a_robot_that_stands_for_half_the_session_is_no_background():
    omega = commands(30.0)
    omega[:750] = 0.0
    session = drive(omega, things=room())
    seen = sighted(session)
    assert seen.estimate.valid.mean() > 0.97
    assert np.abs(errors(session, seen)[0][:, :2]).max() < 0.02
    assert seen.scan.noise == pytest.approx(0.005, rel=0.03)


def test_a_slow_scan_is_straightened():
    """At 45 ms a scan, a plate that passes close by is skewed by more than its errors."""
    omega = np.tile([[4.9, 5.1]], (400, 1))
    session = drive(omega, start=(-1.2, 1.0, 0.0), things=room(), scan_duration=0.045, beams=721, noise=0.001)
    error, deviation = errors(session, sighted(session))
    assert np.sqrt(np.mean(deviation**2, axis=0)).max() < 1.5
    unaware = replace(session, time_increment=0.0)
    assert np.abs(errors(session, sighted(unaware))[0][:, :2]).max() > 2 * np.abs(error[:, :2]).max()


@pytest.mark.parametrize("seed", range(3))
def test_the_plate_s_place_on_the_robot_follows_from_the_driving(seed):
    session = drive(teleoperated(np.random.default_rng(seed), 40.0, 5.0), things=room(), place=OFF, seed=seed)
    seen = sighted(session)
    valid = seen.estimate.valid
    turned = Turned.of(session.encoder_time, session.omega)
    place = plate_place(seen.time[valid], turned.at(seen.time[valid]), seen.estimate.pose[valid])
    for name, true in zip(("x", "y", "yaw"), OFF, strict=True):
        assert abs(getattr(place, name) - true) < 3.5 * place.stderr[name]
        assert place.stderr[name] < 0.003


def test_a_circle_does_not_tell_the_plate_s_place():
    session = drive(np.tile([[2.0, 4.0]], (1000, 1)), things=room(), place=OFF, start=(0.5, 3.0, 0.0))
    seen = sighted(session)
    valid = seen.estimate.valid
    turned = Turned.of(session.encoder_time, session.omega)
    assert plate_place(seen.time[valid], turned.at(seen.time[valid]), seen.estimate.pose[valid]) is None
    assert not findings(seen, PLATE)


def test_what_looks_wrong_is_told():
    session = drive(commands(15.0), things=[*room(), WALKER], beams=181)
    assert any("something else moves in" in line for line in findings(sighted(session), PLATE))
    session = drive(commands(15.0), things=room(), beams=241)
    assert findings(sighted(session), PLATE) == ()
    for wrong in (Plate(0.5, 0.04), Plate(0.6, 0.02)):
        lines = findings(sighted(session, wrong), wrong)
        better = re.search(r"the ranges fit a plate of about (\S+) x (\S+) m better", " ".join(lines))
        assert [float(one) for one in better.groups()] == pytest.approx([LENGTH, THICKNESS], rel=0.05)
    swapped = replace(session, omega=session.omega[:, ::-1])
    assert any("swapped" in line for line in findings(sighted(swapped), PLATE))
    spin = drive(np.tile([[-2.0, 2.0]], (500, 1)), things=room(), beams=181)
    assert any("only turns on the spot" in line for line in findings(sighted(spin), PLATE))


def test_scans_without_a_plate():
    omega = commands(25.0)
    session = drive(omega, start=(0.0, -5.0, 0.0), things=room(), beams=181)
    with pytest.raises(LogError, match=r"no plate of 0\.6x0\.04 m moves as the encoders say in its .* nothing moves"):
        sighted(session)
    ball = cylinder(lambda time: session.robot(time)[..., :2] + [0.0, 8.0], 0.3)
    with pytest.raises(LogError, match=r"what moves is 0\.[56]"):
        sighted(drive(omega, start=(0.0, -5.0, 0.0), things=[*room(), ball], beams=181))
    with pytest.raises(LogError, match="the sprockets turn by 0 rad while it scans"):
        sighted(drive(np.zeros((500, 2)), things=room()))


def test_a_wall_beside_the_robot_is_not_taken_for_the_plate():
    session = drive(commands(), things=[*room(), wall((-0.3, 3.9), (0.3, 3.9))])
    error, _ = errors(session, sighted(session))
    assert np.abs(error[:, :2]).max() < 0.02


TRUE = dict(zip(("sensor_x", "sensor_y", "sensor_yaw"), OFF, strict=True)) | {"offset": D, "radius_error": EPSILON}
MOST = {
    "offset": 0.07e-3,
    "radius_error": 0.28e-3,
    "sensor_x": 0.13e-3,
    "sensor_y": 0.08e-3,
    "sensor_yaw": np.radians(0.02),
}
DRIVES = 40


def fitted(seed):
    session = drive(teleoperated(np.random.default_rng(seed), 60.0, 4.0), things=room(), place=OFF, seed=seed)
    log = scanned_log("a", session.encoder_time, session.omega, sighted(session), PLATE, session.mount)
    return fit_drives("icr_radius", [log], GEOMETRY)


@pytest.mark.slow
def test_forty_drives():
    fits = [fitted(seed) for seed in range(DRIVES)]
    for name, true in TRUE.items():
        values = np.array([(fit.values | fit.extras)[name] for fit in fits])
        errors = np.array([fit.stderr[name] for fit in fits])
        within = [fit.interval95[name][0] <= true <= fit.interval95[name][1] for fit in fits]
        assert np.sqrt(np.mean((values - true) ** 2)) < MOST[name]
        assert 0.6 < np.sqrt(np.mean(((values - true) / errors) ** 2)) < 1.3
        assert np.mean(within) > 0.88
