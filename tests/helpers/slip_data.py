"""Samples of slip with known laws and errors, and identifications from them."""

import itertools

import numpy as np

from trackslip.identification.result import Identification
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady import CrossValidation, SteadyComparison, fit_law
from trackslip.kinematics import RobotGeometry
from trackslip.laws.icr import ConstantIcr
from trackslip.logs.runlog import Refused

GEOMETRY = RobotGeometry(0.168, 0.06)
RADII = (0.63, 1.27, 1.90, 2.53, 3.16)
SPEEDS = (0.05, 0.10, 0.15, 0.20, 0.25)
ERRORS = np.array([[4e-5**2, 2e-9], [2e-9, 8e-5**2]])
"""Covariance of a run's v and w, about as large as that of a bundle of 30 s [m/s, rad/s]."""
LAWS = ("none", "exponential", "icr", "icr_radius")
_NOISE = 2e-3  # relative, of the twists


def grid(law, radii=RADII):
    """Radius x speed driven under a law, measured with known errors."""
    radius_grid, speed_grid = np.meshgrid(radii, SPEEDS, indexing="ij")
    radius = radius_grid.ravel()
    speed = speed_grid.ravel()
    true = np.column_stack([speed, speed / radius])
    rng = np.random.default_rng(0)
    twist = true + rng.multivariate_normal([0, 0], ERRORS, len(true))
    names = [f"R {r:g} v {v:g}" for r, v in zip(radius, speed, strict=True)]
    omega = law.sprocket_speeds(true, GEOMETRY)
    covariance = np.tile(ERRORS, (len(true), 1, 1))
    return SlipSamples.of(omega, twist, GEOMETRY, names, covariance)


def driven(twist, *, errors=True, seed=0):
    """Samples of a robot with a constant ICR that drives twists (n, 2), with or without their
    errors.
    """
    twist = np.asarray(twist, float)
    law = ConstantIcr(0.05, GEOMETRY.half_gauge, 0.007)
    omega = law.sprocket_speeds(twist, GEOMETRY)
    size = _NOISE * np.abs(twist) + 1e-6
    noise = np.random.default_rng(seed).standard_normal(twist.shape)
    measured = twist + size * noise
    names = [f"run {k}" for k in range(len(twist))]
    covariance = size[:, :, None] ** 2 * np.eye(2) if errors else None
    return SlipSamples.of(omega, measured, GEOMETRY, names, covariance)


def circles(*, side=1):
    """Twists (8, 2) of four radii at two speeds, to the left or, with -1, to the right."""
    radii = (0.6, 1.2, 2.0, 3.0)
    speeds = (0.1, 0.2)
    return [(v, side * v / radius) for radius, v in itertools.product(radii, speeds)]


def identified(samples, names=LAWS, *, best="icr_radius", outliers=(), determined=True):
    """Laws fitted to samples; `determined=False` imitates samples too few for a comparison."""
    laws = {name: fit_law(name, samples, GEOMETRY) for name in names}
    validation = {}
    for name, law in laws.items():
        predicted = law.fit.left_out() if determined else None
        validation[name] = CrossValidation.of(predicted, samples, GEOMETRY)
    comparison = SteadyComparison(
        samples=samples,
        laws=laws,
        validation=validation,
        score={},
        best=best,
        reason="it predicts best",
        expressible=best,
        warnings=("law exponential_speed: the samples don't determine gamma_outer",),
    )
    outliers = tuple(Refused(*outlier) for outlier in outliers)
    warnings = (*map(str, outliers), *comparison.warnings)
    return Identification(GEOMETRY, "steady", comparison, None, outliers, warnings)
