"""Encoders that count backwards or are swapped: found where motion tells, and never doubted where it doesn't."""

from __future__ import annotations

import numpy as np
import pytest

from trackslip import se2
from trackslip.logs.runlog import RunLog
from trackslip.ros.checks import sign_doubt, strides

TIME = np.arange(0.0, 15.0, 0.05)


def log_of(twist, omega, rng):
    """A drive with twists (n, 2) [m/s, rad/s], its poses with a scanner's noise, its speeds with an encoder's."""
    heading = np.cumsum(twist[:, 1]) * 0.05
    position = np.cumsum(twist[:, :1] * se2.direction(heading), axis=0) * 0.05
    pose = np.column_stack([position, heading]) + rng.normal(0.0, (2e-3, 2e-3, 5e-3), (len(TIME), 3))
    return RunLog("drive", TIME, omega + rng.normal(0.0, 1e-4, omega.shape), pose)


def speeds(twist, half_gauge, radius):
    """Sprocket speeds (n, 2) [rad/s] without slip."""
    return (twist[:, :1] + twist[:, 1:] * [-half_gauge, half_gauge]) / radius


def test_circles_are_not_doubted():
    rng, doubts = np.random.default_rng(0), []
    for _ in range(1000):
        speed, radius = rng.uniform(0.05, 1.0) * rng.choice([-1, 1]), rng.uniform(0.3, 8.0) * rng.choice([-1, 1])
        twist = np.tile([speed, speed / radius], (len(TIME), 1))
        half_gauge = rng.uniform(0.15, 0.6) * rng.uniform(1.0, 2.0)  # with slip, as wide as the ICRs are apart
        doubts.append(sign_doubt(strides(log_of(twist, speeds(twist, half_gauge, 0.06), rng))))
    assert doubts == [None] * 1000


@pytest.mark.parametrize(
    ("sides", "signs", "doubt"),
    [
        ((0, 1), (1, 1), None),
        ((0, 1), (-1, 1), "left"),
        ((0, 1), (1, -1), "right"),
        ((0, 1), (-1, -1), "both"),
        ((1, 0), (1, 1), "swapped"),
        ((1, 0), (-1, 1), "swapped, left"),
        ((1, 0), (1, -1), "swapped, right"),
        ((1, 0), (-1, -1), "both"),  # or the heading points backwards: the same motion
    ],
)
def test_faults_are_found_in_drives_of_varied_curvature(sides, signs, doubt):
    rng = np.random.default_rng(1)
    for _ in range(50):
        half_gauge, radius = rng.uniform(0.15, 0.6), rng.uniform(0.03, 0.3)
        periods, shares = rng.uniform(4.0, 12.0, 2), rng.uniform(0.3, 1.5, 2)
        swing = shares * np.sin(2 * np.pi * TIME[:, None] / periods + rng.uniform(0, 6, 2))
        twist = swing * [0.5, 1.0] + [0.3, 0.0]
        turned = speeds(twist, 1.5 * half_gauge, radius) * rng.uniform(1.0, 1.2, 2)
        assert sign_doubt(strides(log_of(twist, turned[:, sides] * signs, rng))) == doubt
