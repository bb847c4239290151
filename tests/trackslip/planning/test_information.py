"""Expected errors against a Cramér-Rao bound by finite differences, and what must follow from more information."""

from dataclasses import replace

import numpy as np
import pytest

from sim.wander.motion import LawMotion, SlipVariation
from trackslip.identification.law_fit import fit_drives
from trackslip.identification.path import DriveModel
from trackslip.kinematics import RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning.information import PoseQuality, drive_to_measure, expected

GEOMETRY = RobotGeometry(0.168, 0.06)
MODEL = DriveModel(FAMILIES["icr_radius"], GEOMETRY)
TRUTH = np.array([0.045, 0.0066])
SLIP = (0.002, 0.002, 0.005)
COARSE = PoseQuality(10.0, 0.02, np.radians(1.0))
RATE = 20.0
TIME = np.arange(400) / RATE
SPEEDS = np.column_stack([0.2 + 0.1 * np.sin(0.7 * TIME), 0.2 * np.cos(0.5 * TIME)])


@pytest.mark.parametrize("poses", [COARSE, PoseQuality(5.0, 0.02, None)])
def test_fits_miss_the_law_by_about_what_is_expected(poses):
    """Drives of two minutes with slip that varies and noisy poses; `validation/test_plan_trials.py` has hundreds."""
    speeds = np.tile(SPEEDS, (6, 1))
    drive = drive_to_measure(speeds, RATE, poses, 0.06)
    stated = expected(MODEL, TRUTH, [drive], poses, SLIP).stderr
    law = LawMotion(FAMILIES["icr_radius"].law(TRUTH, GEOMETRY), GEOMETRY, SlipVariation(*SLIP))
    missed = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        motion, _ = law.drive(np.concatenate([speeds[:1], speeds]) / 0.06, RATE, rng)
        noise = rng.normal(size=drive.pose.shape) * [poses.position, poses.position, poses.heading or np.nan]
        fit = fit_drives("icr_radius", [replace(drive, pose=motion.at(drive.time) + noise)], GEOMETRY)
        missed.append(
            [(value - true) / stated[name] for (name, value), true in zip(fit.values.items(), TRUTH, strict=True)]
        )
    ratio = np.sqrt(np.mean(np.square(missed), axis=0))
    assert ((ratio > 0.55) & (ratio < 1.5)).all()  # within two standard errors


def test_what_the_driving_does_not_tell_is_held():
    straight = np.full((400, 2), 0.3)
    found = expected(MODEL, TRUTH, [drive_to_measure(straight, RATE, COARSE, 0.06)], COARSE, SLIP)
    assert "offset" in found.held
    assert "radius_error" in found.stderr
    without = PoseQuality(5.0, 0.05, None)
    found = expected(MODEL, TRUTH, [drive_to_measure(SPEEDS, RATE, without, 0.06)], without, SLIP)
    assert "sensor_yaw" in found.held


def test_information_from_before_adds_up():
    """Twice the same drive, or one and what is known of the law from the other: the extras of the first are its own."""
    drive = drive_to_measure(SPEEDS, RATE, COARSE, 0.06)
    alone = expected(MODEL, TRUTH, [drive], COARSE, SLIP)
    covariance = np.diag([alone.stderr["offset"] ** 2, alone.stderr["radius_error"] ** 2])
    known = LawErrors(("offset", "radius_error"), covariance)
    both = expected(MODEL, TRUTH, [drive], COARSE, SLIP, known)
    for name in known.names:
        assert 0.5 * alone.stderr[name] < both.stderr[name] < 0.8 * alone.stderr[name]
    certain = LawErrors(("offset", "radius_error"), 1e-12 * np.eye(2))
    assert expected(MODEL, TRUTH, [drive], COARSE, SLIP, certain).stderr["offset"] < 1.1e-6
