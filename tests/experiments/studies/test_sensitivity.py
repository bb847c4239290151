"""Sensitivity: disturbances of exact circles against closed forms, and the command's table."""

import numpy as np
import pytest

from experiments.studies.sensitivity import DISTURBANCES, Disturbance, slip_errors
from trackslip.kinematics import advance, sprocket_speeds, track_slip
from trackslip.logs.runlog import RunLog, Truth

TWIST = np.array([0.2, 0.25])
SLIP = np.array([-0.1, 0.05])


def circle(geometry):
    time = np.arange(0.0, 12.0, 0.05)
    rows = np.ones((len(time), 1))
    pose = advance(np.array([0.3, -0.4, 1.0]), TWIST, time)
    truth = Truth(pose, rows * [TWIST[0], 0.0, TWIST[1]], 0 * rows * [1, 1], 0 * rows * [1, 1])
    return RunLog("circle", time, rows * sprocket_speeds(TWIST, SLIP, geometry), pose, truth=truth)


def error(disturbance, geometry):
    slip, warnings = slip_errors([disturbance.evaluated(circle(geometry))], geometry, "arc")
    assert warnings == ()
    return slip[0]


def test_a_fast_clock_makes_the_robot_look_slow(geometry):
    fast = 0.001
    np.testing.assert_allclose(error(Disturbance("nominal"), geometry), 0.0, atol=1e-9)
    np.testing.assert_allclose(error(Disturbance("", clock=fast), geometry), (1 - SLIP) * fast / (1 + fast), atol=1e-9)


def test_a_plate_to_the_left_sees_another_speed(geometry):
    aside = 0.002
    omega = sprocket_speeds(TWIST, SLIP, geometry)
    seen = track_slip(omega, TWIST - [TWIST[1] * aside, 0.0], geometry)
    np.testing.assert_allclose(error(Disturbance("", plate_left=aside), geometry), seen - SLIP, atol=1e-9)
    shifted = Disturbance("", plate_left=aside).evaluated(circle(geometry)).pose - circle(geometry).pose
    np.testing.assert_allclose(np.hypot(shifted[:, 0], shifted[:, 1]), aside)


SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.2", "--duration", "8")


def test_a_row_for_each_disturbance(trackslip):
    found = trackslip("sensitivity", *SMALL, "--seed", "2")
    assert {path.name for path in found.folder.iterdir()} == {"manifest.json", "summary.json"}
    rows = {row["effect"]: row for row in found.summary["rows"]}
    assert list(rows) == [effect.name for effect in DISTURBANCES]
    for name, row in rows.items():
        assert name in found.printed
        assert f"{row['slip_error']['outer']['bias']:+.5f}" in found.printed
        assert row["runs"]["all"] == 2
    nominal, noisy = rows["nominal"], rows["noise 10 mm"]
    assert nominal["settings"] == {}
    assert nominal["localization"]["valid_fraction"] > 0.95
    for track in ("outer", "inner"):
        assert nominal["slip_error"][track]["largest"] < 0.002
        # a clock that is 0.1 % wrong makes slip wrong by as much; it also shifts the steady window by a scan
        bias = rows["clock 0.1 % fast"]["slip_error"][track]["bias"] - nominal["slip_error"][track]["bias"]
        assert bias == pytest.approx(0.001, abs=0.0003)
    assert noisy["settings"] == {"noise": 0.01}
    for error in ("rmse_x", "rmse_y", "rmse_heading"):
        assert noisy["localization"][error] > nominal["localization"][error]
    biased = rows["range bias 10 mm"]["localization"]["rmse_y"]  # the scanner looks along y
    assert biased == pytest.approx(0.01, abs=0.004)
