"""Parameters that samples or drives do not determine, and words for why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.identification.drive_fit import TrajectoryFit
from trackslip.identification.drive_model import EXTRAS
from trackslip.identification.lack_of_fit import by_command, by_speed
from trackslip.identification.steady_fit import Fits
from trackslip.kinematics import Array

_VAGUE = 5.0  # standard error of an undetermined_by_samples parameter, relative to its scale
_REPLACEABLE = 1e6  # variance inflation of a parameter that others stand in for [-]
_AT_LIMIT = 1e-3  # distance from a limit, relative to a range of at most 1
_VAGUE_COMBINATION = 1.0  # standard error of a combination that isn't determined [changes that matter]
_CERTAIN = 3.0  # size of a value that is no chance [standard errors]
_PART = 0.3  # share in a combination that is worth naming

_REASONS = {
    "sensor_x": "it shows only in turns of different curvature",
    "sensor_y": "turns to one side only, or none, don't tell it from the ICRs",
    "drift": "it shows only where speed and turn rate both vary",
    "clock_offset": "it shows only where the driving changes",
    "sensor_yaw": "it needs headings, and driving forwards for some metres",
    "lag": "it shows only where the driving changes fast",
    "gyro_scale": "it shows only in turns",
}


def undetermined_by_samples(name: str, fits: Fits, error: Array) -> tuple[str, ...]:
    """Reasons why the samples do not determine a parameter, from standard errors (p,); empty if they determine all."""
    names, limits = fits.family.names, fits.family.limits(fits.runs.geometry.half_gauge)
    load = fits.runs.load
    if fits.family.loaded and (load is None or np.ptp(load) == 0):
        return (f"law {name}: the {fits.runs.runs} samples don't determine compliance: it takes runs under loads",)
    with np.errstate(invalid="ignore"):
        replaceable = ~(np.diag(fits.hessian[0]) * np.diag(fits.covariance[0]) < _REPLACEABLE)
    for key, value, spread, replaced, least, most, scale in zip(
        names, fits.values[0], error, replaceable, *limits, strict=True
    ):
        at_limit = min(value - least, most - value) < _AT_LIMIT * min(most - least, 1.0)
        if not at_limit and not replaced and spread < max(_VAGUE * scale, abs(value) / 2):
            continue
        why = f"no value below {most:.4g}" if most - value < value - least else f"no value above {least:.4g}"
        why = f"{why} fits, so they don't follow this law" if at_limit else f"its standard error is {spread:.2g}"
        if replaced:
            why = "other parameters make up for any value of it"
        if by_command(fits.runs.omega, fits.runs.geometry).max() == 0:
            why = "it takes runs of different radii"
        elif key.startswith("gamma") and by_speed(fits.runs.omega).max() == 0:
            why = "it takes runs of different speeds"
        stopped = f"the {fits.runs.runs} samples don't determine {key} (the fit stopped at {value:.3g})"
        return (f"law {name}: {stopped}: {why}",)
    return ()


def undetermined_by_drives(fit: TrajectoryFit) -> tuple[str, str] | None:
    """The parameter to hold because a combination of free ones isn't determined, and why; None if all are.

    A value that is certainly not that of the prior is never held, however vague: it matters more than its error.
    """
    names = [fit.model.names[k] for k in fit.free]
    information = fit.solution.information - np.diag(1 / fit.model.prior[fit.free] ** 2)
    errors = np.sqrt(np.diag(fit.covariance))
    chance = np.abs(fit.values - fit.mean)[fit.free] < _CERTAIN * errors
    found = vaguest(names, information, fit.model.limits[2][fit.free], chance)
    if found is None:
        return None
    chosen, others = found
    confused = f"the driving can't tell it from {' and '.join(others)}" if others else "the driving doesn't show it"
    reason = _REASONS.get(chosen, "runs of different radii and metres of straight driving do")
    return chosen, f"{confused}; {reason}"


def vaguest(
    names: Sequence[str], information: Array, scale: Array, chance: np.ndarray | None = None
) -> tuple[str, list[str]] | None:
    """The parameter to hold, and the ones that it is confused with; None if all f are determined.

    `information` (f, f) excludes the priors; `scale` (f,) are changes of the parameters that matter; only those of
    `chance` (f,) bool may be held. Of the vaguest combination in which one may be, it is the extra with the largest
    share, or a parameter of the law if no extra has a part in it.
    """
    sizes, directions = np.linalg.eigh(information * np.outer(scale, scale))
    for size, direction in zip(sizes, directions.T, strict=True):
        if size > 1 / _VAGUE_COMBINATION**2:
            break
        share = np.abs(direction)
        parts = [k for k in np.argsort(-share) if share[k] > _PART]
        open_ = [names[k] for k in parts if chance is None or chance[k]]
        if open_:
            chosen = next((name for name in open_ if name in EXTRAS), open_[0])
            return chosen, [names[k] for k in parts if names[k] != chosen]
    return None
