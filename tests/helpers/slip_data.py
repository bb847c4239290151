"""Samples of slip with known laws and errors, for tests."""

import numpy as np

from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import RobotGeometry

GEOMETRY = RobotGeometry(0.168, 0.06)
RADII = (0.63, 1.27, 1.90, 2.53, 3.16)
SPEEDS = (0.05, 0.10, 0.15, 0.20, 0.25)
ERRORS = np.array([[4e-5**2, 2e-9], [2e-9, 8e-5**2]])
"""Covariance of a run's v and w, about as large as that of a bundle of 30 s [m/s, rad/s]."""


def grid(law, errors=ERRORS, told=True, seed=0, radii=RADII, speeds=SPEEDS):
    """Radius x speed driven under a law, measured with errors."""
    radius, speed = (values.ravel() for values in np.meshgrid(radii, speeds, indexing="ij"))
    twist = np.column_stack([speed, speed / radius])
    omega = law.sprocket_speeds(twist, GEOMETRY)
    count = len(radius)
    if errors is not None:
        twist = twist + np.random.default_rng(seed).multivariate_normal([0, 0], errors, count)
    covariance = np.tile(errors, (count, 1, 1)) if told and errors is not None else None
    names = [f"R {r:g} v {v:g}" for r, v in zip(radius, speed, strict=True)]
    return SlipSamples.of(omega, twist, GEOMETRY, names, covariance)
