"""Runs that no law can be asked to explain."""

from __future__ import annotations

import numpy as np

from trackslip.identification.fit import fit
from trackslip.identification.replicates import by_command
from trackslip.identification.samples import Refused, SlipSamples
from trackslip.identification.weighting import WeightedRuns
from trackslip.kinematics import Array, RobotGeometry
from trackslip.slip.families import FAMILIES

_MIN_SAMPLES = 6  # samples that make a majority
_MAX_OUTLIER_SHARE = 0.25  # share of outliers that is still a few
_FAR = 6.0  # robust standard deviations that no good run is off
_WORTH_MENTIONING = 0.005  # slip by which an outlier is off at least [-]
_REPEATED = 3  # runs of one radius that have a median
_ROUNDS = 15
_TUKEY = 4.685  # where the biweight ends [robust standard deviations]
_LAWS = ("exponential", "hyperbola", "power", "icr_radius", "icr_sides")


def split_outliers(samples: SlipSamples, geometry: RobotGeometry) -> tuple[SlipSamples, list[Refused]]:
    """Samples without the outliers, and these: far off the law that fits most of the runs best.

    Every law is fitted robustly, with Tukey's biweight of a run's larger deviation; the law with the smallest median
    deviation is the judge. Runs that repeat each other are held against their median, for what they share is the law's
    fault, not theirs. Fewer than _MIN_SAMPLES samples have no outliers, and where more than a quarter seem to be, no
    law fits and none is left out.
    """
    count = len(samples)
    if count < _MIN_SAMPLES:
        return samples, []
    runs = WeightedRuns.of(samples, geometry)
    judged = [_robust_deviation(name, runs) for name in _LAWS if count > len(FAMILIES[name].names)]
    deviation, _ = min(judged, key=lambda pair: pair[1])
    labels = by_command(samples.omega, geometry)
    for label in range(int(labels.max()) + 1):
        rows = labels == label
        if rows.sum() >= _REPEATED:
            deviation[rows] -= np.median(deviation[rows], axis=0)
    spread = _spread(deviation)
    worst = np.abs(deviation).max(axis=1)  # (n,)
    far = worst > max(_FAR * spread, _WORTH_MENTIONING)
    if not far.any() or far.sum() > _MAX_OUTLIER_SHARE * count:
        return samples, []
    outliers = [
        Refused(
            samples.run[k],
            f"its slip is {worst[k]:.3g} off what fits the other runs, which scatter by {spread:.2g}",
        )
        for k in np.flatnonzero(far)
    ]
    return samples.take(~far), outliers


def _robust_deviation(name: str, runs: WeightedRuns) -> tuple[Array, float]:
    """Deviations (n, 2) of slip from a robust fit, and their robust standard deviation."""
    family = FAMILIES[name]
    found = fit(family, runs, scatter=np.full(1, _WORTH_MENTIONING))
    spread = 0.0
    for _ in range(_ROUNDS):
        deviation = runs.deviation(found.law)[0]
        spread = _spread(deviation)
        reach = np.abs(deviation).max(axis=1) / (_TUKEY * max(spread, _WORTH_MENTIONING / _FAR))
        weight = np.where(reach < 1, (1 - reach**2) ** 2, 1e-9)
        found = fit(family, runs.weighted(weight[None]), found.values, np.full(1, _WORTH_MENTIONING))
    return runs.deviation(found.law)[0], spread


def _spread(deviation: Array) -> float:
    """Robust standard deviation of deviations (n, 2) about 0."""
    return max(1.4826 * float(np.median(np.abs(deviation))), 1e-6)
