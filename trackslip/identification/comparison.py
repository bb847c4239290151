"""Laws with 95 % intervals, compared on the same data, and the choice of the best law."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple, TypeVar

import numpy as np

from trackslip.kinematics import Array, RobotGeometry, body_twist
from trackslip.laws.base import SlipLaw
from trackslip.laws.families import FAMILIES
from trackslip.viewable import ShortRepr

# least number of different curvatures over which laws are compared: over two, all laws with two
# parameters predict the same
FEWEST_CURVATURES: Final = 4
# share of the range of directions within which those commanded by hand scatter (test_answer) [-]
_SCATTER: Final = 0.05
REFERENCE: Final = "icr_radius"
"""The law that is fitted first, as the start for other laws; it is also the best law if laws can't
be compared.
"""
MACHINED: Final = 0.02
"""Standard deviation of radius errors where the driving doesn't determine the radius [-]."""
NEAREST_CURVATURES: Final = 0.05
"""Largest angle between motions of one curvature, in the plane (v, b w): encoders scatter less in a
second [rad].
"""
LEAST_ERROR: Final = 1e-3
"""Mean prediction error, or difference between mean errors, that is too small to notice [m, rad, or
relative].
"""
# least number of blocks whose scatter shows what chance is, and the share of the leader's mean
# error that counts as chance with fewer blocks
_FEWEST_BLOCKS_FOR_SCATTER: Final = 5
_CHANCE_SHARE: Final = 0.25
_NEARLY_0: Final = 1e-9  # mean error in whose place ratios of errors have no meaning


@dataclass(frozen=True, kw_only=True, repr=False)
class FittedLaw(ShortRepr):
    """A law with parameter values identified from steady samples or whole drives."""

    name: str  # name of the law's family
    law: SlipLaw  # the law with the values below
    values: dict[str, float]  # parameters of the law by name, in their units
    # standard errors of the fitted parameters; empty with too little driving
    stderr: dict[str, float]
    # 95 % intervals of the same parameters
    interval95: dict[str, tuple[float, float]]
    correlation: Array  # correlation matrix of the same parameters, in the order of stderr
    # the reason for each parameter that was held or that the driving doesn't determine
    held: Mapping[str, str] = field(default_factory=dict)


class Uncertainty(NamedTuple):
    """The uncertainty of a law's parameters: the fields of a `FittedLaw` with the same names."""

    stderr: dict[str, float]
    interval95: dict[str, tuple[float, float]]
    correlation: Array

    @classmethod
    def of(
        cls,
        names: Sequence[str],
        values: Array,
        covariance: Array,
        quantile: Array,
        limits: Array,
    ) -> Uncertainty:
        """The uncertainty of fitted parameters (f,) with a covariance (f, f) and `limits` (2, f).

        Half an interval has the width of `quantile` (f,) standard errors. Parameters whose variance
        is NaN, as with too little driving, are left out: nothing is known of their errors.
        """
        known = np.flatnonzero(np.isfinite(np.diag(covariance)))
        among_known = covariance[np.ix_(known, known)]
        error = np.sqrt(np.diag(among_known))
        stderr = dict[str, float]()
        interval95 = dict[str, tuple[float, float]]()
        for k, stderr_of_value in zip(known.tolist(), error.tolist(), strict=True):
            half_width = float(quantile[k]) * stderr_of_value
            low = max(float(values[k]) - half_width, float(limits[0, k]))
            high = min(float(values[k]) + half_width, float(limits[1, k]))
            stderr[names[k]] = stderr_of_value
            interval95[names[k]] = low, high
        return cls(stderr, interval95, among_known / np.outer(error, error))


Fit = TypeVar("Fit", bound=FittedLaw)


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The best law among several."""

    # the law that predicts motion best or, among laws that predict it equally well, the simplest
    best: str
    reason: str  # why `best` is best, in one sentence
    # by law: mean error relative to the smallest of any law, averaged over criteria [-]
    score: Mapping[str, float]
    expressible: str | None = None
    """The law of a differential drive that gives the answer: `diff_drive`, or `icr_radius` if the
    radii of left and right don't differ; None if there is none.
    """


@dataclass(frozen=True, kw_only=True, repr=False)
class Comparison(ShortRepr, Choice):
    """Laws identified from the same data, with the choice of the best."""

    laws: Mapping[str, FittedLaw]  # fits by law name, the best first
    warnings: tuple[str, ...]  # remarks on the fits, one line each


@dataclass(frozen=True)
class Criterion:
    """Prediction errors of laws on the same data."""

    errors: Mapping[str, Array]  # (n,) errors by law
    block: np.ndarray  # (n,) for each error, index of the independent part of the data
    unnoticed: float  # largest difference between mean errors that doesn't matter

    def as_good_as(self, errors: Array, leader: int) -> np.ndarray:
        """(L,) bool: true for laws whose mean of `errors` (L, n) exceeds the leader's mean by no
        more than chance.

        A difference up to `unnoticed` doesn't count. Chance is one standard error, from the scatter
        of block sums. With fewer than five blocks, whose scatter is unknown, chance is a quarter of
        the leader's mean error.
        """
        worse = errors - errors[leader]
        mean = worse.mean(axis=1)
        labels, block = np.unique(self.block, return_inverse=True)
        count = len(labels)
        if count < _FEWEST_BLOCKS_FOR_SCATTER:
            return np.asarray(mean <= _CHANCE_SHARE * errors[leader].mean())

        # standard error of the mean, from the scatter of sums over blocks
        sums = np.array([np.bincount(block, of_law) for of_law in worse - mean[:, None]])
        variance = np.sum(sums**2, axis=1) * count / (count - 1)
        chance = np.sqrt(variance) / len(block)
        return np.asarray(mean <= np.maximum(chance, self.unnoticed))


def choose(
    laws: Mapping[str, Fit], rank: Callable[[Mapping[str, Fit]], Choice | None]
) -> Choice | None:
    """Choose the best law according to `rank`; None if `rank` returns None.

    A law that odometry can't express is best only if a parameter that no law for odometry has
    differs from zero.
    """
    linear = {name: law for name, law in laws.items() if is_usable_for_odometry(name)}
    choice = rank(laws)
    among_linear = rank(linear) if linear else None
    if choice is None or among_linear is None or choice.best in linear:
        return choice

    # the parameters that only the best law has
    best = laws[choice.best]
    of_linear = {name for law in linear.values() for name in law.values}
    own = [name for name in best.values if name not in of_linear]
    if any(differs_from_zero(best, name) for name in own):
        return choice
    doubt = f"its {' and '.join(own)} may be 0" if own else "it has no parameter of its own"
    reason = f"{among_linear.reason}; {choice.best} predicts better, but {doubt}"
    return replace(choice, best=among_linear.best, reason=reason)


def differs_from_zero(law: FittedLaw, name: str) -> bool:
    """True if the 95 % interval of a parameter is known and doesn't contain 0."""
    low, high = law.interval95.get(name, (-np.inf, np.inf))
    return low > 0 or high < 0


def ranked(laws: Mapping[str, FittedLaw], criteria: Sequence[Criterion]) -> Choice | None:
    """Choose the best law according to criteria, one per prediction horizon; None without criteria.

    The leader has the smallest errors by most criteria. Laws that are as good as the leader by most
    criteria, within one standard error of the mean difference over blocks, count as equal; the
    simplest of these laws is best.
    """
    if not criteria:
        return None
    names = list(laws)
    errors = [
        np.stack([criterion.errors[name] for name in names]) for criterion in criteria
    ]  # (laws, n) by each criterion

    # the leader
    means = [of_laws.mean(axis=1) for of_laws in errors]
    ratios = [(mean + _NEARLY_0) / (mean.min() + _NEARLY_0) for mean in means]
    score = np.mean(ratios, axis=0)
    wins = np.bincount([int(mean.argmin()) for mean in means], minlength=len(names))
    leader = min(range(len(names)), key=lambda k: (-wins[k], score[k]))

    # the simplest of the laws that are as good
    as_good = np.zeros(len(names), int)
    for criterion, of_laws in zip(criteria, errors, strict=True):
        as_good += criterion.as_good_as(of_laws, leader)
    good = np.flatnonzero(2 * as_good > len(criteria)).tolist()
    best = min(good, key=lambda k: (_terms(names[k], laws[names[k]]), k != leader, score[k]))

    usable = all(map(is_usable_for_odometry, names))
    compared = "all laws usable for odometry" if usable else "all laws"
    where = _share_of_horizons(int(wins[leader]), len(criteria))
    reason = f"smallest errors of {compared} {where}"
    if best != leader:
        reason = (
            f"as good as {names[leader]}, which has the {reason}, within one standard error, and "
            "simpler to use"
        )
    return Choice(
        best=names[best], reason=reason, score=dict(zip(names, score.tolist(), strict=True))
    )


def _share_of_horizons(count: int, total: int) -> str:
    """At how many of the prediction horizons, in words."""
    if total == 1:
        return "at the only horizon"
    if count == total:
        return f"at all {total} horizons"
    return f"at {count} of {total} horizons"


def _terms(name: str, law: FittedLaw) -> float:
    """Number of a law's parameters, plus a half if odometry can't use the law."""
    return len(law.values) + 0.5 * (not is_usable_for_odometry(name))


def is_usable_for_odometry(name: str) -> bool:
    """True if `deploy` can write the law as parameters of a differential drive's odometry."""
    return "ros2_control" in FAMILIES[name].targets


def few_curvatures(count: int, driving: str) -> str:
    """The reason why laws aren't compared over `count` different curvatures of some `driving`;
    empty if there are enough.
    """
    if count >= FEWEST_CURVATURES:
        return ""
    return (
        f"laws aren't compared, as {driving} {count} of the {FEWEST_CURVATURES} different "
        "curvatures that this takes"
    )


def nearest_curvatures(direction: Array, least: float) -> float:
    """The angle [rad] up to which directions (n,) in the plane (v, b w) count as one curvature: at
    least `least`, and a share of their range, as motions that were commanded by hand scatter.
    """
    # from 0 for straight motions, forwards or backwards, to π/2 for turns on the spot
    folded = np.abs((direction + np.pi / 2) % np.pi - np.pi / 2)
    return max(least, _SCATTER * float(np.ptp(folded)))


def different_curvatures(direction: Array, nearest: float, least: int = 1) -> int:
    """Number of different curvatures among motions with directions (n,) in the plane (v, b w)
    [rad]; driving backwards doesn't change the curvature.

    Directions up to `nearest` [rad] above the smallest of a group count as one curvature; groups of
    fewer than `least` motions don't count.
    """
    # straight motions scatter about 0: they must not be split there
    angle = np.sort((direction + nearest / 2) % np.pi)
    count = 0
    begin = 0
    while begin < len(angle):
        end = int(np.searchsorted(angle, angle[begin] + nearest, side="right"))
        count += end - begin >= least
        begin = end
    return count


def turns_fast(omega: Array, geometry: RobotGeometry) -> bool:
    """True if sprocket speeds (n, 2) [rad/s] often imply lateral accelerations that may affect slip
    (> 0.5 m/s²).
    """
    v, w = body_twist(omega, 0.0, geometry).T
    return bool(np.mean(np.abs(v * w) > 0.5) > 0.05)
