"""Laws that are given up after their fit: values that the samples do not determine, or a law that does not follow them.

Intervals and cross-validations of such laws would mean nothing, and take longest.
"""

from __future__ import annotations

import numpy as np

from trackslip.identification.fit import Fits
from trackslip.identification.replicates import by_command, by_speed
from trackslip.kinematics import Array
from trackslip.slip.base import SlipLaw

_VAGUE = 5.0  # standard error of an undetermined parameter, relative to its scale
_REPLACEABLE = 1e6  # variance inflation of a parameter that others stand in for [-]
_AT_LIMIT = 1e-3  # distance from a limit, relative to a range of at most 1
_PROBED = (0.02, 0.1, 0.5)  # distances from the fit [standard errors]
_JUMP = 10.0  # of chi-square beyond its parabola, between these: more than the height of an interval
_MISSED = 1e-3  # relative error of sprocket speeds that a motion does not have
_MAX_WITHOUT = 0.1  # share of samples without a motion


def undetermined(name: str, fits: Fits, error: Array) -> tuple[str, ...]:
    """Why the samples do not determine a parameter, with standard errors (p,); empty if they determine all of them."""
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


def unfollowed(name: str, fits: Fits) -> tuple[str, ...]:
    """Why a law does not follow the samples anywhere near the fit; empty if it does.

    Some sprocket speeds may have no motion under the law, or motions that change abruptly with its parameters, as near
    the pole of a slip ratio.
    """
    law, runs = fits.law, fits.runs
    if type(law).twist is not SlipLaw.twist:
        return ()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        missed = np.abs(law.sprocket_speeds(fits.twist, runs.geometry) - runs.omega).max(axis=-1)
    solved = missed < _MISSED * np.abs(runs.omega).max(axis=-1)
    without = int((~(solved | law.turns_in_place(runs.omega, runs.geometry)[0])).sum())
    if without > _MAX_WITHOUT * runs.runs:
        return (f"law {name}: given up: no motion has the sprocket speeds of {without} of the {runs.runs} samples",)
    if _jump(fits) > _JUMP:
        return (f"law {name}: given up: how well it fits the {runs.runs} samples changes abruptly with its parameters",)
    return ()


def _jump(fits: Fits) -> float:
    """Largest deviation of chi-square from its parabola near the fit."""
    runs, error = fits.runs, np.sqrt(np.diag(fits.covariance[0]))
    steps = np.concatenate([np.array(_PROBED)[:, None, None] * np.diag(error)] * 2)  # (3, p, p) to both sides
    steps[len(_PROBED) :] *= -1
    steps = steps.reshape(-1, len(error))
    low, high, _ = fits.family.limits(runs.geometry.half_gauge)
    values = np.clip(fits.values + steps, low, high)
    steps = values - fits.values
    law = fits.family.law(values[:, None, :], runs.geometry)
    rows = np.zeros(len(values), int)
    cost = np.sum(runs.whiten(runs.deviation(law, rows), fits.scatter[rows], rows) ** 2, axis=1)
    parabola = np.einsum("mi,ij,mj->m", steps, fits.hessian[0], steps)
    return float(np.abs(cost - fits.cost[0] - parabola).max())
