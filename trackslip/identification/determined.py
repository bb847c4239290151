"""Parameters that samples do not determine, and words for why."""

from __future__ import annotations

import numpy as np

from trackslip.identification.groups import by_command, by_speed
from trackslip.identification.steady_fit import Fits
from trackslip.kinematics import Array

_VAGUE = 5.0  # standard error of an undetermined_by_samples parameter, relative to its scale
_REPLACEABLE = 1e6  # variance inflation of a parameter that others stand in for [-]
_AT_LIMIT = 1e-3  # distance from a limit, relative to a range of at most 1


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
