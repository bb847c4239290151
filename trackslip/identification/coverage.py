"""Whether intervals cover: how often those of drawn samples hold the parameters that the samples were drawn with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from trackslip.identification.fit import fit
from trackslip.identification.intervals import CONFIDENCE, heights, profile_intervals
from trackslip.identification.replicates import lack_of_fit
from trackslip.identification.samples import SlipSamples
from trackslip.identification.weighting import WeightedRuns
from trackslip.kinematics import Array, RobotGeometry
from trackslip.slip.families import FAMILIES

_AT_ONCE = 100  # repeats fitted together, so that they stay in the cache


def drawn_twists(
    name: str,
    values: Mapping[str, float],
    design: SlipSamples,
    geometry: RobotGeometry,
    repeats: int,
    rng: np.random.Generator,
) -> Array:
    """Measured twists (repeats, n, 2) of a robot that obeys a law, at a design's sprocket speeds and with its errors.

    The errors are those of the twist, so slip and radius get theirs together, with their correlation.
    """
    law = FAMILIES[name].build(values, geometry)
    if design.covariance is None:
        raise ValueError("the design has no errors of measurement")
    root = np.linalg.cholesky(design.covariance)
    errors = np.einsum("nij,mnj->mni", root, rng.standard_normal((repeats, len(design), 2)))
    return law.twist(design.omega, geometry) + errors


def coverage(
    name: str,
    values: Mapping[str, float],
    design: SlipSamples,
    geometry: RobotGeometry,
    repeats: int,
    rng: np.random.Generator,
    known_errors: bool = True,
) -> dict[str, float]:
    """Share of the repeats in which each parameter's 95 % interval holds its value.

    Args:
        name: of the family.
        values: parameters that the samples are drawn with.
        design: sprocket speeds and errors of measurement of n runs.
        geometry: of the robot.
        repeats: how often samples are drawn and fitted.
        rng: for the draws.
        known_errors: whether the fits are told the errors of measurement, or find the scatter from the samples alone.
    """
    family = FAMILIES[name]
    truth = np.array([values[key] for key in family.names])
    twists = drawn_twists(name, values, design, geometry, repeats, rng)
    told = design if known_errors else SlipSamples(design.omega, design.twist, design.slip, design.run)
    base = WeightedRuns.of(told, geometry)
    held = np.zeros(len(truth))
    for first in range(0, repeats, _AT_ONCE):
        runs = base.measured(twists[first : first + _AT_ONCE])
        fits = fit(family, runs, np.tile(truth, (len(runs.speeds), 1)))
        ends = profile_intervals(fits, heights(fits, lack_of_fit(fits, known_errors), known_errors))
        held += ((ends[..., 0] <= truth) & (truth <= ends[..., 1])).sum(axis=0)
    return {key: float(count) / repeats for key, count in zip(family.names, held, strict=True)}


def noise_coverage(
    name: str, repeats: Sequence[tuple[SlipSamples, SlipSamples]], geometry: RobotGeometry
) -> tuple[dict[str, float], dict[str, float]]:
    """How often fits to measured samples hold the fits to their true motions, which stand beside them in `repeats`.

    The true motion is fitted with the weights of each repeat, so that nothing but noise is between the two.

    Returns:
        The shares of intervals from the noise's part of the standard errors alone, which should be 95 %, and of the
        95 % intervals, which also answer for what the law doesn't know and hold it more often.
    """
    family = FAMILIES[name]
    by_noise, by_all = np.zeros(len(family.names)), np.zeros(len(family.names))
    for samples, truth in repeats:
        runs = WeightedRuns.of(samples, geometry)
        fits = fit(family, runs)
        goal = fit(family, runs.measured(truth.twist[None]), fits.values, fits.scatter).values[0]
        error = np.sqrt(np.diag(fits.noise_covariance[0]))
        by_noise += np.abs(fits.values[0] - goal) <= scipy.stats.norm.ppf((1 + CONFIDENCE) / 2) * error
        ends = profile_intervals(fits, heights(fits, lack_of_fit(fits, True), True))[0]
        by_all += (ends[:, 0] <= goal) & (goal <= ends[:, 1])
    count = len(repeats)
    return (
        dict(zip(family.names, (by_noise / count).tolist(), strict=True)),
        dict(zip(family.names, (by_all / count).tolist(), strict=True)),
    )
