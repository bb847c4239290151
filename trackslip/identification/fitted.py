"""Identified laws: values, errors, intervals; fitted to steady samples, with goodness of fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trackslip.errors import LogError, counted
from trackslip.identification.determined import undetermined_by_samples
from trackslip.identification.intervals import bootstrap_intervals, heights, profile_intervals, standard_errors
from trackslip.identification.lack_of_fit import SIGNIFICANT, LackOfFit, lack_of_fit
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_fit import Fits, fit
from trackslip.identification.weighting import MIN_SCATTER, WeightedRuns, relative_errors
from trackslip.kinematics import Array, RobotGeometry
from trackslip.metrics import rms
from trackslip.slip.base import SlipLaw
from trackslip.slip.families import family

_MIN_DRAWN = 4  # minimum number of runs for a bootstrap
_TRIED, _REFINED = 60, 6  # number of scatters tried at once, and how often the grid about the best is made finer


@dataclass(frozen=True, kw_only=True)
class FittedLaw:
    """A law with values that were identified, from steady samples or whole drives."""

    name: str
    """Name of the family."""
    law: SlipLaw
    """The law with the values below."""
    values: dict[str, float]
    """Parameters of the law by name, in their units."""
    stderr: dict[str, float]
    """Standard errors of the fitted parameters."""
    interval95: dict[str, tuple[float, float]]
    """95 % intervals of the fitted parameters."""
    correlation: Array  # of the fitted parameters, in the order of stderr

    @property
    def determined(self) -> bool:
        """True if the data determine the law."""
        return True

    @property
    def stored(self) -> dict[str, Any]:
        """The entry of the law in the `slip_laws` of a file."""
        errors = {name: self.stderr.get(name) for name in self.values}  # None for a value that was held
        return {"values": self.values, "stderr": errors, "interval95": self.interval95}


@dataclass(frozen=True, kw_only=True)
class SteadyFit(FittedLaw):
    """A law fitted to steady samples.

    Standard errors are inflated if the law lacks fit; intervals come from the profile likelihood.
    """

    bootstrap95: dict[str, tuple[float, float]]
    """95 % percentile intervals from resampled runs; empty if there are too few runs."""
    noise_stderr: dict[str, float]
    """Contribution of the measurement errors to the standard errors; 0 if these errors are not known."""
    rms: float
    """Root mean square error of the track speeds predicted, relative to the speed of the faster sprocket [-]."""
    scatter: float
    """tau, scatter of the track speeds about the law beyond the measurement errors, relative likewise [-]."""
    likelihood: float
    """-2 log likelihood at its maximum, scatter included [-]."""
    lack_of_fit: LackOfFit | None
    """Test for lack of fit; None without repeated runs and measurement errors."""
    notes: tuple[str, ...] = ()
    """Reasons why the samples do not determine the law, whose values then mean nothing; empty if they do."""

    @property
    def determined(self) -> bool:
        """True if the samples determine the law."""
        return not self.notes

    @property
    def stored(self) -> dict[str, Any]:
        """The entry of the law in the `slip_laws` of a file."""
        return super().stored | {"rms": self.rms}

    @property
    def lacks_fit(self) -> bool:
        """True if the law significantly misses the samples."""
        return self.lack_of_fit is not None and self.lack_of_fit.probability < SIGNIFICANT

    def aicc(self, samples: int) -> float | None:
        """Akaike's criterion, corrected for few data (two per sample); None if there are too few.

        The scatter counts as a parameter.
        """
        free, data = len(self.values) + 1, 2 * samples
        if data - free - 1 <= 0:
            return None
        return self.likelihood + 2 * free + 2 * free * (free + 1) / (data - free - 1)


def fit_law(
    name: str, samples: SlipSamples, geometry: RobotGeometry, bootstraps: int = 300, vague: bool = False
) -> SteadyFit:
    """Weighted least-squares fit to the measured motions (see `weighting`), with intervals.

    `geometry` is the robot's nominal one, `bootstraps` the number of resamples of the runs; 0 for none. Raises LogError
    if the samples do not determine every parameter, unless a `vague` law is wanted that says so in its `notes`, and
    InvalidValueError for an unknown law.
    """
    model = family(name)
    names, count, free = model.names, len(samples.run), len(model.names)
    if 2 * count <= free:
        raise LogError(f"law {name}: {counted(count, 'sample')} of two tracks can't determine its {free} parameters")
    runs = WeightedRuns.of(samples, geometry)
    fits = fit(model, runs)
    measured = samples.covariance is not None
    tests = lack_of_fit(fits, measured)
    error = standard_errors(fits, tests, measured)[0]
    notes = undetermined_by_samples(name, fits, error)
    if notes and not vague:
        raise LogError(notes[0])
    interval = fits.family.limits(geometry.half_gauge)[:2].T
    if not notes:
        interval = profile_intervals(fits, heights(fits, tests, measured))[0]
    values = dict(zip(names, fits.values[0].tolist(), strict=True))
    law = model.build(values, geometry)
    loaded = model.under(samples.load).build(values, geometry)
    deviations = np.sqrt(np.diag(fits.covariance[0]))
    with np.errstate(invalid="ignore"):
        correlation = fits.covariance[0] / np.outer(deviations, deviations)
        noise = np.sqrt(np.diag(fits.noise_covariance[0]))
    bootstrap = {}
    if bootstraps and count > max(free, _MIN_DRAWN) and not notes:
        drawn = bootstrap_intervals(fits, bootstraps, np.random.default_rng(count))
        bootstrap = dict(zip(names, map(tuple, drawn.tolist()), strict=True))
    return SteadyFit(
        name=name,
        law=law,
        values=values,
        stderr=dict(zip(names, error.tolist(), strict=True)),
        interval95=dict(zip(names, map(tuple, interval.tolist()), strict=True)),
        bootstrap95=bootstrap,
        correlation=correlation,
        noise_stderr=dict(zip(names, noise.tolist(), strict=True)),
        rms=rms(relative_errors(loaded.twist(samples.omega, geometry), samples, geometry)),
        scatter=float(fits.scatter[0]),
        likelihood=_likelihood(fits),
        lack_of_fit=tests[0] if tests else None,
        notes=notes,
    )


def _likelihood(fits: Fits) -> float:
    """-2 log likelihood of the measured motions, without constants, at the most likely scatter."""
    eigenvalues, squares = fits.runs.eigenvalues, fits.deviation[0] ** 2
    low, high, least = np.log(MIN_SCATTER), 1.0, np.inf
    for _ in range(_REFINED):
        tried = np.linspace(low, high, _TRIED)
        variance = eigenvalues + np.exp(2 * tried)[:, None, None]
        minus = np.sum(squares / variance + np.log(variance), axis=(1, 2))
        best = int(minus.argmin())
        low, high, least = tried[max(best - 1, 0)], tried[min(best + 1, _TRIED - 1)], minus[best]
    return float(least)
