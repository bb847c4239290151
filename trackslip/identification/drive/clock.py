"""How likely clock offsets are: the likelihood of a fit, maximised over everything else, at given offsets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.identification.drive.equations import solve
from trackslip.identification.drive.fit import Fit
from trackslip.identification.drive.residuals import cost, residuals
from trackslip.kinematics import Array

_POINTS = 13
_WIDTH = 6.0  # of the profile on each side [standard errors]
_STEPS = 2  # of Gauss and Newton at each offset


@dataclass(frozen=True)
class ClockProfile:
    """Rise of -2 log likelihood with the clock offset."""

    offset: Array  # (n,) encoder clock minus pose clock [s]
    rise: Array  # (n,) [-]


def clock_profile(fit: Fit) -> ClockProfile:
    """The profile of the clock offset around a fit, with its noise; raises ValueError if the fit held the offset."""
    model, nodes = fit.model, fit.nodes
    clock, yaw = model.index("clock_offset"), model.index("sensor_yaw")
    if clock not in fit.free:
        raise ValueError("the clock offset was held")
    error = np.sqrt(fit.covariance[list(fit.free).index(clock)][list(fit.free).index(clock)])
    offsets = fit.values[clock] + error * _WIDTH * np.linspace(-1, 1, _POINTS)
    free = fit.free[fit.free != clock]
    low, high, _ = model.limits
    least = cost(fit.residuals, nodes, fit.noise)
    rise = []
    for offset in offsets:
        values, states = fit.values.copy(), fit.states
        values[clock] = offset
        for _ in range(_STEPS):
            found = residuals(model, nodes, states, values, free)
            step = solve(found, nodes, fit.noise, yaw, model.prior, values - fit.mean)
            values[free] = np.clip(values[free] + step.values, low[free], high[free])
            states = states + step.states
        found = residuals(model, nodes, states, values, free[:0])
        rise.append(cost(found, nodes, fit.noise) - least)
    return ClockProfile(offsets, np.array(rise))
