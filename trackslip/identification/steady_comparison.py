"""Laws compared on steady samples, by how they predict runs that they were not fitted to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.comparison import Comparison, expressible, turns_fast
from trackslip.identification.fitted import FEWEST_BLOCKS
from trackslip.identification.prediction import as_good_as
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_fit import SteadyFit, fit_law
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import FAMILIES
from trackslip.metrics import rms

BASELINES = ("none", "exponential", "icr")
"""Laws that are always reported, for others to be compared with."""
_FOLDS = 10  # most parts of a cross-validation (Kohavi, 1995)
_NEGLIGIBLE = 1e-3  # relative error of the track speeds that no ground and no encoder repeats, and no law need predict


@dataclass(frozen=True)
class CrossValidation:
    """Rms errors of a law for runs it was not fitted to; None if the runs do not form two groups.

    The first three are of the track speeds, relative to the faster sprocket's, leaving out one radius, one speed, or
    every tenth run at a time; the others of the yaw rate [rad/s] and the speed [m/s] at left-out radii.
    """

    radius: float | None
    speed: float | None
    run: float | None
    yaw_rate: float | None
    linear_speed: float | None

    @classmethod
    def of(
        cls, predicted: Mapping[str, Array | None], samples: SlipSamples, geometry: RobotGeometry
    ) -> CrossValidation:
        """Errors of the twists (n, 2) that `left_out` predicts."""
        errors = {
            way: None if twist is None else rms(samples.relative_errors(twist, geometry))
            for way, twist in predicted.items()
        }
        twist = predicted["radius"]
        v, w = (None, None) if twist is None else (rms(column) for column in (twist - samples.twist).T)
        return cls(**errors, yaw_rate=w, linear_speed=v)


@dataclass(frozen=True, kw_only=True)
class SteadyComparison(Comparison):
    """Laws identified from steady samples."""

    samples: SlipSamples  # the samples that the laws were fitted to
    laws: Mapping[str, SteadyFit]  # fits by name of the law
    validation: Mapping[str, CrossValidation]  # cross-validation by name of the law

    @property
    def ranking(self) -> tuple[str, ...]:
        """Names of the laws in order of AICc, smallest first; those without one follow in order of scatter."""
        aicc = {name: np.inf if law.aicc is None else law.aicc for name, law in self.laws.items()}
        return tuple(sorted(self.laws, key=lambda name: (aicc[name], self.laws[name].scatter)))


def compare_laws(samples: SlipSamples, geometry: RobotGeometry) -> SteadyComparison:
    """Fit all families that the samples determine, and the baselines in any case, and compare them.

    Raises LogError if the samples determine no law of turning.
    """
    laws, warnings = dict[str, SteadyFit](), list[str]()
    sides = np.sign(samples.omega[:, 1] - samples.omega[:, 0]) * np.sign(samples.omega.sum(axis=1))
    one_sided = min((sides > 0).sum(), (sides < 0).sum()) < 2
    unloaded = samples.load is None or np.ptp(samples.load) < 1e-3
    slow = not turns_fast(samples.omega, geometry)
    for name, family in FAMILIES.items():
        impossible = (family.two_sided and one_sided) or (family.loaded and unloaded) or (family.fast and slow)
        if impossible or not family.of_runs:
            continue
        try:
            laws[name] = fit_law(name, samples, geometry, vague=name in BASELINES)
            warnings += laws[name].notes
        except LogError as error:
            warnings.append(str(error))
    known = {name: law for name, law in laws.items() if law.determined}
    if not known.keys() - {"none", "constant"}:  # which say nothing of turning
        raise LogError(next(why for why in warnings if why.startswith("law icr:")))
    predicted = {name: left_out(law) for name, law in laws.items()}
    best, reason = _best(known, predicted)
    linear = expressible(known)
    return SteadyComparison(
        samples=samples,
        laws=laws,
        validation={name: CrossValidation.of(twists, samples, geometry) for name, twists in predicted.items()},
        best=best,
        reason=reason,
        expressible=best if best in linear else _best(linear, predicted)[0],
        warnings=tuple(warnings),
    )


def left_out(law: SteadyFit) -> dict[str, Array | None]:
    """Twists (n, 2) of runs by fits without runs of their radius, of their speed, and without every tenth run.

    None where such runs are all or the rest are too few.
    """
    fit, samples, geometry = law.fit, law.fit.samples, law.fit.geometry
    ways = {
        "radius": folds(samples.by_command(geometry)),
        "speed": folds(samples.by_speed()),
        "run": np.arange(len(samples)) % _FOLDS,
    }
    twists: dict[str, Array | None] = dict.fromkeys(ways)
    for way, labels in ways.items():
        rest = len(labels) - np.bincount(labels).max()
        if 2 * rest > len(fit.values):
            law_of_run = fit.family.law(fit.without(labels)[labels], geometry)
            twists[way] = np.broadcast_to(law_of_run.twist(samples.omega, geometry), samples.twist.shape)
    return twists


def folds(labels: np.ndarray) -> np.ndarray:
    """Folds (n,) of a cross-validation: groups (n,) or, where there are many, about equal numbers of neighbours."""
    size = np.bincount(labels)
    if len(size) <= _FOLDS:
        return labels
    fold = (np.cumsum(size) - size) * _FOLDS // len(labels)
    return np.unique(fold[labels], return_inverse=True)[1]


def _best(laws: Mapping[str, SteadyFit], predicted: Mapping[str, Mapping[str, Array | None]]) -> tuple[str, str]:
    """The best law, and why.

    It is the simplest of the laws that predict as well as any other and, of equally simple ones, the one that predicts
    best. Where the samples are too few for predictions, AICc, or else the scatter, stands in.
    """
    fit = next(iter(laws.values())).fit
    samples, scatter = fit.samples, max(_NEGLIGIBLE, min(law.scatter for law in laws.values()))
    weight = 1 / (fit.measurement.mean(axis=1) + scatter**2)

    def squares(way: str) -> dict[str, Array]:
        """Mean squares (n,) of the relative errors of the track speeds by law, weighted by the runs' variances."""
        twists = {name: twist for name in laws if (twist := predicted[name][way]) is not None}
        relative = {name: samples.relative_errors(twist, fit.geometry) ** 2 for name, twist in twists.items()}
        return {name: weight / weight.mean() * each.mean(axis=1) for name, each in relative.items()}

    def simplest(scores: Mapping[str, float]) -> str:
        return min(scores, key=lambda name: (len(laws[name].values), scores[name]))

    radii, runs = squares("radius"), squares("run")
    many = radii and samples.by_command(fit.geometry).max() >= 2
    errors, what = (radii, "radii") if many else (runs, "runs")
    if errors and len(samples) >= FEWEST_BLOCKS:
        good = _as_good(errors)
        good = _as_good({name: runs[name] for name in good if name in runs}) or good
        why = f"it is the simplest of those that predict left-out {what} as well as any, within a standard error"
        return simplest({name: float(errors[name].mean()) for name in good}), why
    aicc = {name: law.aicc for name, law in laws.items() if law.aicc is not None}
    if aicc:
        near = {
            name: value for name, value in aicc.items() if value <= min(aicc.values()) + 2
        }  # Burnham and Anderson, 2002
        why = "it is the simplest of those whose AICc is within 2 of the smallest; the runs are too few for predictions"
        return simplest(near), why
    least = min(laws, key=lambda name: laws[name].scatter)
    return least, "it scatters least; the runs are too few for anything else"


def _as_good(squares: Mapping[str, Array]) -> list[str]:
    """Names of the laws whose squared errors (n,) exceed the smallest by no more than chance, or than a robot notices.

    Runs are independent of each other.
    """
    if not squares:
        return []
    every = np.stack([*squares.values()])
    good = as_good_as(every, int(every.mean(axis=1).argmin()), np.arange(every.shape[1]), _NEGLIGIBLE**2)
    return [name for name, yes in zip(squares, good, strict=True) if yes]
