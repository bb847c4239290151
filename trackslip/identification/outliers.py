"""Outliers: steady runs that no law should be fitted to, and poses of drives that jump."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from trackslip.doubts import doubt
from trackslip.identification.lack_of_fit import by_command, by_load
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_fit import fit
from trackslip.identification.weighting import WeightedRuns
from trackslip.kinematics import Array, RobotGeometry, wrap_angle
from trackslip.logs.runlog import Refused
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

_LOADED = "icr_load"  # for runs under known loads
_NEIGHBOURS = 7  # poses that predict the next one
_JUMPED = 6.0  # outlying error of prediction [robust standard deviations]
_MIN_SPREAD = np.array([1e-3, np.radians(0.05)])  # [m, rad]


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
    told = laws if samples.load is None else (*laws, _LOADED)
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
    lines = [(samples.run[k], doubt("outlier", far=nearest[k], scatter=least)) for k in np.flatnonzero(far)]
    return samples.take(~far), [Refused(run, line.reason, line.kind) for run, line in lines]


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


def outlying(pose: Array, state: Array, motion: Array) -> tuple[np.ndarray, np.ndarray]:
    """Outlying poses (n,) bool, and poses after lasting jumps (n,) bool, of one drive.

    Each pose is predicted from its neighbours before, and from those after it: the median of where dead reckoning from
    each leads. An outlying pose misses both predictions, the first one after a lasting jump only the prediction from
    before.

    Args:
        pose: (n, 3) measured poses; NaN headings are not compared.
        state: (n, 3) positions and headings to reckon from.
        motion: (n, 3) path of dead reckoning from anywhere.
    """
    before, after = _mispredicted(pose, state, motion)
    bad = before & after
    kept = np.flatnonzero(~bad)  # an outlying pose beside a jump would hide it
    before, after = _mispredicted(pose[kept], state[kept], motion[kept])
    lasting = np.zeros(len(pose), bool)
    lasting[kept[1:]] = before[1:] & ~after[1:] & after[:-1] & ~before[:-1]
    return bad, lasting


def _mispredicted(pose: Array, state: Array, motion: Array) -> tuple[np.ndarray, np.ndarray]:
    """Poses (n,) bool that those before them mispredict far, and poses that those after them do."""
    before, moved = _missed(pose, state, motion)
    after, moved_on = (one[::-1] for one in _missed(pose[::-1], state[::-1], motion[::-1]))
    columns = zip(np.minimum(before, after).T, ((moved + moved_on) / 2).T, _MIN_SPREAD, strict=True)
    far = _JUMPED * np.column_stack([_usual(error, way, least) for error, way, least in columns])
    beyond_before, beyond_after = ((np.nan_to_num(one) > far).any(axis=1) for one in (before, after))
    return np.asarray(beyond_before), np.asarray(beyond_after)


def _usual(error: Array, way: Array, least: float) -> Array:
    """Robust standard deviations (n,) of errors (n,), at least `least`: a constant and a part that grows with `way`.

    Errors of a robot that drives are larger than those at rest. The two parts are told from the third of the poses
    with the longest ways (n,), and that with the shortest.
    """
    known = np.flatnonzero(np.isfinite(error))
    if not len(known):
        return np.full(len(error), least)
    order = known[np.argsort(way[known])]
    third = -(-len(order) // 3)
    ends = np.stack([order[:third], order[-third:]])
    (short, long), (small, large) = np.median(way[ends], axis=1) ** 2, (1.4826 * np.median(error[ends], axis=1)) ** 2
    growth = max(large - small, 0.0) / (long - short) if long > short else 0.0
    return np.asarray(np.sqrt(np.maximum(small - growth * short, least**2) + growth * np.nan_to_num(way) ** 2))


def _missed(pose: Array, state: Array, motion: Array) -> tuple[Array, Array]:
    """Errors (n, 2) of position and heading of each pose as predicted by the median of those before it.

    And the way and the turn (n, 2) from these poses to it.
    """
    count = len(pose)
    size = min(_NEIGHBOURS, count - 1)
    errors, moved = np.full((count, 2), np.nan), np.full((count, 2), np.nan)
    if size < 1:
        return errors, moved
    rows = np.arange(size, count)
    window = sliding_window_view(np.arange(count), size)[:-1]  # (n - size, size) indices of the poses before
    z, c = pose[:, 0] + 1j * pose[:, 1], motion[:, 0] + 1j * motion[:, 1]
    turned = np.exp(1j * (state[:, 2] - motion[:, 2]))
    way, turn = c[rows, None] - c[window], motion[rows, None, 2] - motion[window, 2]
    moved[rows] = np.column_stack([np.median(np.abs(one), axis=1) for one in (way, turn)])
    predicted = z[window] + turned[window] * way
    middle = np.median(predicted.real, axis=1) + 1j * np.median(predicted.imag, axis=1)
    errors[rows, 0] = np.abs(z[rows] - middle)
    heading = wrap_angle(pose[window, 2] + turn - pose[rows, None, 2])
    errors[rows, 1] = np.abs(np.median(heading, axis=1))
    return errors, moved
