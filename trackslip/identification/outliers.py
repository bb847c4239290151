"""Outliers: runs that no law should be fitted to."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.identification.fit import fit
from trackslip.identification.replicates import by_command, by_load
from trackslip.identification.samples import SlipSamples
from trackslip.identification.weighting import WeightedRuns
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.refused import Refused
from trackslip.slip.families import FAMILIES

_MIN_SAMPLES = 6  # minimum number of samples to detect outliers
_MAX_OUTLIER_SHARE = 0.25  # maximum share of outliers
_FAR = 6.0  # deviation of an outlier [robust standard deviations]
_AS_GOOD = 1.3  # spread of laws that fit about as well, relative to the best
_WORTH_MENTIONING = 0.005  # minimum deviation of an outlier [-]
_REPEATED = 3  # minimum number of runs of one radius for a median
_ROUNDS = 15
_SETTLED = 1e-3  # change of weights at convergence
_ROUGHLY = 1e-6  # tolerance of the fits
_TUKEY = 4.685  # cutoff of the biweight [robust standard deviations]
_LAWS = ("exponential", "icr_radius", "turn_loss", "icr_sides")

_LOADED = ("icr_load",)  # for runs under known loads


def split_outliers(
    samples: SlipSamples, geometry: RobotGeometry, laws: Sequence[str] = _LAWS
) -> tuple[SlipSamples, list[Refused]]:
    """Separate outliers, which are far from every law that fits the majority of the runs well.

    Each of the `laws` is fitted robustly, with Tukey's biweight of the larger deviation of a run, and those whose
    median deviation is near the smallest are used. Repeated runs are compared with their median, because a common
    deviation is an error of the law. Nothing is excluded from fewer than _MIN_SAMPLES samples, or if more than a
    quarter of them appear to be outliers: then no law fits. Returns the samples without the outliers, and the outliers.
    """
    count = len(samples)
    if count < _MIN_SAMPLES:
        return samples, []
    runs = WeightedRuns.of(samples, geometry)
    told = laws if samples.load is None else (*laws, *_LOADED)
    judged = [_robust_deviation(name, runs) for name in told if count > len(FAMILIES[name].names)]
    least = min(spread for _, spread in judged)
    labels = by_load(by_command(samples.omega, geometry), samples.load)
    good = [(_worst(deviation, labels), spread) for deviation, spread in judged if spread <= _AS_GOOD * least]
    noise = np.sqrt(runs.eigenvalues.max(axis=1))  # (n,) of measurement
    limits = [np.maximum(_FAR * np.hypot(spread, noise), _WORTH_MENTIONING) for _, spread in good]
    far = np.all([worst > limit for (worst, _), limit in zip(good, limits, strict=True)], axis=0)
    if not far.any() or far.sum() > _MAX_OUTLIER_SHARE * count:
        return samples, []
    nearest = np.min([worst for worst, _ in good], axis=0)  # (n,) deviation from the law that fits the run best
    reason = "its motion deviates by {:.3g} of its speed from what fits the other runs, which scatter by {:.2g}"
    outliers = [Refused(samples.run[k], reason.format(nearest[k], least)) for k in np.flatnonzero(far)]
    return samples.take(~far), outliers


def _worst(deviation: Array, labels: np.ndarray) -> Array:
    """The larger deviation (n,) of the two of a run (n, 2), repeated runs being compared with their median."""
    own = deviation.copy()
    for label in np.flatnonzero(np.bincount(labels) >= _REPEATED):
        rows = labels == label
        own[rows] -= np.median(deviation[rows], axis=0)
    worst: Array = np.abs(own).max(axis=1)
    return worst


def _robust_deviation(name: str, runs: WeightedRuns) -> tuple[Array, float]:
    """Deviations (n, 2) of slip from a robust fit, and their robust standard deviation."""
    family = FAMILIES[name]
    scatter = np.full(1, _WORTH_MENTIONING)
    found = fit(family, runs, scatter=scatter, tolerance=_ROUGHLY)
    weight = np.zeros(runs.runs)
    for _ in range(_ROUNDS):
        deviation = found.deviation[0]
        spread = _spread(deviation)
        reach = np.abs(deviation).max(axis=1) / (_TUKEY * max(spread, _WORTH_MENTIONING / _FAR))
        before, weight = weight, np.where(reach < 1, (1 - reach**2) ** 2, 1e-9)
        if np.abs(weight - before).max() < _SETTLED:
            break
        found = fit(family, runs.weighted(weight[None]), found.values, scatter, _ROUGHLY)
    return found.deviation[0], spread


def _spread(deviation: Array) -> float:
    """Robust standard deviation about 0 of deviations (n, 2)."""
    return max(1.4826 * float(np.median(np.abs(deviation))), 1e-6)
