"""Identified laws: values, errors, intervals; fitted to steady samples, with goodness of fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import stdtrit

from trackslip.errors import LogError, counted
from trackslip.identification.determined import undetermined_by_samples
from trackslip.identification.groups import by_command
from trackslip.identification.samples import SlipSamples
from trackslip.identification.steady_fit import Fits, fit
from trackslip.identification.weighting import MIN_SCATTER, WeightedRuns, relative_errors
from trackslip.identification.windows import FEWEST_BLOCKS
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw
from trackslip.laws.derivatives import twist_derivatives
from trackslip.laws.families import family
from trackslip.metrics import rms

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
    """A law fitted to steady samples; intervals are Student's."""

    rms: float
    """Root mean square error of the track speeds predicted, relative to the speed of the faster sprocket [-]."""
    scatter: float
    """tau, scatter of the track speeds about the law beyond the measurement errors, relative likewise [-]."""
    likelihood: float
    """-2 log likelihood at its maximum, scatter included [-]."""
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

    def aicc(self, samples: int) -> float | None:
        """Akaike's criterion, corrected for few data (two per sample); None if there are too few.

        The scatter counts as a parameter.
        """
        free, data = len(self.values) + 1, 2 * samples
        if data - free - 1 <= 0:
            return None
        return self.likelihood + 2 * free + 2 * free * (free + 1) / (data - free - 1)


def fit_law(name: str, samples: SlipSamples, geometry: RobotGeometry, vague: bool = False) -> SteadyFit:
    """Weighted least-squares fit to the measured motions (see `weighting`), with intervals.

    `geometry` is the robot's nominal one. Raises LogError if the samples do not determine every parameter, unless a
    `vague` law is wanted that says so in its `notes`, and InvalidValueError for an unknown law.
    """
    model = family(name)
    names, count, free = model.names, len(samples.run), len(model.names)
    if 2 * count <= free:
        raise LogError(f"law {name}: {counted(count, 'sample')} of two tracks can't determine its {free} parameters")
    fits = fit(model, WeightedRuns.of(samples, geometry))
    covariance = fits.covariance[0]
    covariance = covariance * _widening(fits, np.sqrt(np.diag(covariance)))
    error = np.sqrt(np.diag(covariance))
    notes = undetermined_by_samples(name, fits, error)
    if notes and not vague:
        raise LogError(notes[0])
    low, high, _ = model.limits(geometry.half_gauge)
    width = error * stdtrit(fits.freedom, 0.975)
    interval = np.column_stack([np.maximum(fits.values[0] - width, low), np.minimum(fits.values[0] + width, high)])
    values = dict(zip(names, fits.values[0].tolist(), strict=True))
    law = model.build(values, geometry)
    loaded = model.under(samples.load).build(values, geometry)
    with np.errstate(invalid="ignore"):
        correlation = covariance / np.outer(error, error)
    return SteadyFit(
        name=name,
        law=law,
        values=values,
        stderr=dict(zip(names, error.tolist(), strict=True)),
        interval95=dict(zip(names, map(tuple, interval.tolist()), strict=True)),
        correlation=correlation,
        rms=rms(relative_errors(loaded.twist(samples.omega, geometry), samples, geometry)),
        scatter=float(fits.scatter[0]),
        likelihood=_likelihood(fits),
        notes=notes,
    )


def _widening(fits: Fits, error: Array) -> Array:
    """Factors (p, p) of a covariance with standard errors (p,) that scatter otherwise than modelled makes too small.

    They come from fits without one command, or without one run where commands are few, by one step of Newton's method
    (CR3, as in `windows`).
    """
    runs, count = fits.runs, len(error)
    groups = by_command(runs.omega, runs.geometry)
    if groups.max() + 1 < FEWEST_BLOCKS:
        groups = np.arange(len(groups))
    number = int(groups.max()) + 1
    if number < FEWEST_BLOCKS or not count or not np.isfinite(error).all():
        return np.ones((count, count))
    roots = runs.roots(fits.scatter)[0, :, :, None]
    family = fits.family
    slope = roots * (runs.of_twists @ twist_derivatives(family, fits.values, runs.omega, runs.geometry)[0])  # (n, 2, p)
    hessian, score = np.zeros((number, count, count)), np.zeros((number, count))
    np.add.at(hessian, groups, np.einsum("nka,nkb->nab", slope, slope))
    np.add.at(score, groups, np.einsum("nka,nk->na", slope, roots[..., 0] * fits.deviation[0]))
    scale = np.outer(error, error)
    rest = (hessian.sum(axis=0) - hessian) * scale
    if np.linalg.cond(rest).max() > 1e12:
        return np.ones((count, count))
    apart = np.linalg.solve(rest, (score * error)[..., None])[..., 0]  # in standard errors
    factor = np.maximum(1.0, np.sqrt((number - 1) / number * np.sum(apart**2, axis=0)))
    return np.outer(factor, factor)


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
