"""Coverage of intervals: how often intervals from simulated samples contain the true parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from trackslip.identification.intervals import CONFIDENCE, heights, profile_intervals
from trackslip.identification.lack_of_fit import lack_of_fit
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_fit import fit
from trackslip.identification.weighting import WeightedRuns
from trackslip.kinematics import RobotGeometry
from trackslip.slip.families import FAMILIES

_AT_ONCE = 100  # repeats fitted at once, so that they stay in the cache


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

    Each repeat draws the twists of a robot that follows the law with `values`, at the sprocket speeds of the design.
    The errors are those of the twist, so the errors of slip and radius are correlated as in a measurement. The fits
    know the covariances of these errors or, without `known_errors`, estimate the scatter from the samples alone.
    """
    if design.covariance is None:
        raise ValueError("the design has no errors of measurement")
    family = FAMILIES[name]
    truth = np.array([values[key] for key in family.names])
    root = np.linalg.cholesky(design.covariance)
    errors = np.einsum("nij,mnj->mni", root, rng.standard_normal((repeats, len(design), 2)))
    twists = family.build(values, geometry).twist(design.omega, geometry) + errors
    base = WeightedRuns.of(design if known_errors else replace(design, covariance=None), geometry)
    covered = np.zeros(len(truth))
    for first in range(0, repeats, _AT_ONCE):
        runs = base.measured(twists[first : first + _AT_ONCE])
        fits = fit(family, runs, np.tile(truth, (len(runs.speeds), 1)))
        ends = profile_intervals(fits, heights(fits, lack_of_fit(fits, known_errors), known_errors))
        covered += ((ends[..., 0] <= truth) & (truth <= ends[..., 1])).sum(axis=0)
    return dict(zip(family.names, (covered / repeats).tolist(), strict=True))


def noise_coverage(
    name: str, repeats: Sequence[tuple[SlipSamples, SlipSamples]], geometry: RobotGeometry
) -> tuple[dict[str, float], dict[str, float]]:
    """Shares of the intervals from measured samples that contain the values fitted to the true motions, given as pairs.

    The true motion is fitted with the weights of each repeat, so that the two differ only by noise. The first shares
    are those of intervals from the noise part of the standard errors, which should be 95 %; the second those of the
    95 % intervals, which also allow for the errors of the law and therefore cover more often.
    """
    family = FAMILIES[name]
    by_noise, by_all = [], []
    for samples, truth in repeats:
        runs = WeightedRuns.of(samples, geometry)
        fits = fit(family, runs)
        goal = fit(family, runs.measured(truth.twist[None]), fits.values, fits.scatter).values[0]
        error = np.sqrt(np.diag(fits.noise_covariance[0]))
        by_noise.append(np.abs(fits.values[0] - goal) <= scipy.special.ndtri((1 + CONFIDENCE) / 2) * error)
        ends = profile_intervals(fits, heights(fits, lack_of_fit(fits, True), True))[0]
        by_all.append((ends[:, 0] <= goal) & (goal <= ends[:, 1]))
    noise, whole = (dict(zip(family.names, np.mean(held, axis=0).tolist(), strict=True)) for held in (by_noise, by_all))
    return noise, whole
