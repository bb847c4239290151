"""Samples of slip with known laws and errors, for tests."""

from collections.abc import Mapping

import numpy as np

from trackslip.identification.samples import SlipSamples, true_samples, usable_samples
from trackslip.identification.steady import fit_law
from trackslip.kinematics import RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.logs.logfile import read_runs
from trackslip.logs.runlog import stored_geometry

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


def coverage(
    name: str,
    values: Mapping[str, float],
    design: SlipSamples,
    geometry: RobotGeometry,
    repeats: int,
    rng: np.random.Generator,
    known_errors: bool = True,
) -> dict[str, float]:
    """Share of the repeats in which the 95 % interval of each parameter of a law contains its value.

    Each repeat draws the twists of a robot that follows the law with `values`, at the sprocket speeds of the design and
    with its errors of twists. The fits know the covariances of these errors, or estimate the scatter from the samples.
    """
    root = np.linalg.cholesky(design.covariance)
    errors = np.einsum("nij,mnj->mni", root, rng.standard_normal((repeats, len(design), 2)))
    covariance = design.covariance if known_errors else None
    covered = dict.fromkeys(values, 0)
    for twist in FAMILIES[name].build(values, geometry).twist(design.omega, geometry) + errors:
        samples = SlipSamples.of(design.omega, twist, geometry, design.run, covariance)
        for key, (low, high) in fit_law(name, samples, geometry).interval95.items():
            covered[key] += low <= values[key] <= high
    return {key: count / repeats for key, count in covered.items()}


def slip_errors(folder, method):
    """Errors of slips (n, 2) of the runs on circles in a folder of results, by a motion method."""
    logs = [log for log in read_runs(folder / "runs.parquet") if "radius" in log.metadata]
    geometry = stored_geometry(logs[0])
    return usable_samples(logs, geometry, method=method, longest=True).samples.slip - true_samples(logs, geometry).slip
