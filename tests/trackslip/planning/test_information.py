"""Expected errors against a Cramér-Rao bound by finite differences, and what must follow from more information."""

from __future__ import annotations

import numpy as np
import pytest

from sim.wander.motion import LawMotion, SlipVariation
from trackslip import se2
from trackslip.identification.drive_model import DriveModel
from trackslip.kinematics import RobotGeometry
from trackslip.odometry.uncertainty import LawErrors
from trackslip.planning.information import PoseQuality, drive_to_measure, expected, information, with_extras
from trackslip.slip.families import FAMILIES

GEOMETRY = RobotGeometry(0.168, 0.06)
MODEL = DriveModel(FAMILIES["icr_radius"], GEOMETRY)
TRUTH = np.array([0.045, 0.0066])
SLIP = (0.002, 0.002, 0.005)
COARSE = PoseQuality(10.0, 0.02, np.radians(1.0))
RATE = 20.0
TIME = np.arange(400) / RATE
SPEEDS = np.column_stack([0.2 + 0.1 * np.sin(0.7 * TIME), 0.2 * np.cos(0.5 * TIME)])


@pytest.mark.parametrize("poses", [COARSE, PoseQuality(5.0, 0.05, None), PoseQuality(20.0, 0.002, 0.005)])
def test_the_information_is_that_of_the_cramer_rao_bound(poses):
    """All poses as functions of the law, the first pose and the slip of all steps, by finite differences."""
    drive = drive_to_measure(SPEEDS, RATE, poses, 0.06)
    found = information(MODEL, with_extras(TRUTH), [drive], poses, SLIP, MODEL.family.names)
    omega = np.concatenate([SPEEDS[:1], SPEEDS]) / 0.06
    way = np.concatenate([[0.0], np.cumsum(np.abs(SPEEDS).mean(axis=1) / RATE)])
    deviation = np.sqrt(np.diff(np.interp(drive.time, drive.edges, way)))[:, None] * SLIP
    noise = np.array([poses.position, poses.position, poses.heading or np.inf])

    def steps(law):
        silent = LawMotion(FAMILIES["icr_radius"].law(law, GEOMETRY), GEOMETRY, SlipVariation())
        return se2.steps(silent.drive(omega, RATE, np.random.default_rng(0))[0].at(drive.time))

    h, true_steps = 1e-6, steps(TRUTH)

    def slope(poses_of, count):
        """Of the measured poses, over their noise, by each of so many numbers."""
        changes = h * np.eye(count)
        return np.stack([((poses_of(d) - poses_of(-d)) / (2 * h) / noise).ravel() for d in changes], axis=-1)

    by_law = slope(lambda law: se2.chain(np.zeros(3), steps(TRUTH + law)), 2)
    by_start = slope(lambda start: se2.chain(start, true_steps), 3)
    by_slip = slope(lambda slip: se2.chain(np.zeros(3), true_steps + slip.reshape(-1, 3)), true_steps.size)
    every = np.column_stack([by_law, by_start, by_slip])
    full = every.T @ every
    full[5:, 5:] += np.diag(1 / deviation.ravel() ** 2)
    bound = np.sqrt(np.diag(np.linalg.inv(full))[:2])
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(found))), bound, rtol=0.02)


def test_thinned_poses_tell_about_as_much():
    many = PoseQuality(40.0, 0.02, np.radians(1.0))
    errors = [
        expected(MODEL, with_extras(TRUTH), [drive_to_measure(SPEEDS, RATE, poses, 0.06)], poses, SLIP).stderr
        for poses in (many, many.thinned(10.0))
    ]
    assert errors[1]["offset"] == pytest.approx(errors[0]["offset"], rel=0.05)
    assert errors[1]["radius_error"] == pytest.approx(errors[0]["radius_error"], rel=0.05)


def test_what_the_driving_does_not_tell_is_held():
    straight = np.full((400, 2), 0.3)
    found = expected(MODEL, with_extras(TRUTH), [drive_to_measure(straight, RATE, COARSE, 0.06)], COARSE, SLIP)
    assert "offset" in found.held
    assert "radius_error" in found.stderr
    without = PoseQuality(5.0, 0.05, None)
    found = expected(MODEL, with_extras(TRUTH), [drive_to_measure(SPEEDS, RATE, without, 0.06)], without, SLIP)
    assert "sensor_yaw" in found.held


def test_information_from_before_adds_up():
    """Twice the same drive, or one and what is known of the law from the other: the extras of the first are its own."""
    drive = drive_to_measure(SPEEDS, RATE, COARSE, 0.06)
    alone = expected(MODEL, with_extras(TRUTH), [drive], COARSE, SLIP)
    covariance = np.diag([alone.stderr["offset"] ** 2, alone.stderr["radius_error"] ** 2])
    known = LawErrors(("offset", "radius_error"), covariance)
    both = expected(MODEL, with_extras(TRUTH), [drive], COARSE, SLIP, known)
    for name in known.names:
        assert 0.5 * alone.stderr[name] < both.stderr[name] < 0.8 * alone.stderr[name]
    certain = LawErrors(("offset", "radius_error"), 1e-12 * np.eye(2))
    assert expected(MODEL, with_extras(TRUTH), [drive], COARSE, SLIP, certain).stderr["offset"] < 1.1e-6
