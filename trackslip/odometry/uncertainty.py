"""Uncertainty of odometry: varying slip, gyro errors, and errors of the law's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np

from trackslip.arguments import checks_arguments
from trackslip.errors import (
    InvalidValueError,
    require,
    require_finite,
    require_non_negative,
)
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw

_SLIP_ENTRIES: Final = ("slip_forward", "slip_sideways", "slip_turn")  # in DriveFit.noise
# half-width of a 95 % interval of a normal distribution [standard deviations]
_NORMAL_95: Final = 1.959963984540054
_DIFFERENCE: Final = 1e-3  # parameter step for derivatives [standard errors]
# allowed asymmetry of a covariance, and excess of a correlation over 1, relative to the variances
_ASYMMETRY: Final = 1e-6


@dataclass(frozen=True)
class SlipNoise:
    """Varying slip: a random walk of the pose whose variances grow with the mean distance driven by
    the belts.
    """

    forward: float = 0.0
    """Standard deviation along the robot [m/sqrt(m)]."""
    sideways: float = 0.0
    """Standard deviation across the robot [m/sqrt(m)]."""
    turn: float = 0.0
    """Standard deviation of the heading [rad/sqrt(m)]."""

    def __post_init__(self) -> None:
        for name in ("forward", "sideways", "turn"):
            require_non_negative(name, getattr(self, name))

    @classmethod
    def of(cls, noise: Mapping[str, float]) -> Self:
        """Select the slip noise from `DriveFit.noise` of a law fitted to drives; other entries are
        ignored.

        Raises InvalidValueError if an entry is missing or not a standard deviation.
        """
        is_complete = set(_SLIP_ENTRIES) <= set(noise)
        allowed = f"a mapping with {', '.join(_SLIP_ENTRIES)}"
        require(is_complete, "noise", [*noise], allowed)
        forward, sideways, turn = (float(noise[name]) for name in _SLIP_ENTRIES)
        return cls(forward, sideways, turn)


@dataclass(frozen=True)
class Gyro:
    """Errors of a gyroscope that reads (1 + scale) yaw rate + bias + noise."""

    bias: float = 0.0
    """Bias of the readings [rad/s]."""
    scale: float = 0.0
    """Scale error of the readings [-]."""
    noise: float = 0.0
    """Standard deviation of the integrated readings, a random walk [rad/sqrt(s)]."""
    bias_error: float = 0.0
    """Standard error of the bias [rad/s]."""
    scale_error: float = 0.0
    """Standard error of the scale [-]."""
    clock: float = 0.0
    """Gyro clock minus encoder clock [s]: readings stamped t + clock belong to sprocket speeds
    stamped t.
    """

    def __post_init__(self) -> None:
        for name in ("bias", "scale", "clock"):
            require_finite(name, getattr(self, name))
        for name in ("noise", "bias_error", "scale_error"):
            require_non_negative(name, getattr(self, name))


@checks_arguments
@dataclass(frozen=True)
class LawErrors:
    """Errors of a law's parameters, which are constant along the whole path."""

    names: tuple[str, ...]
    """Names of the parameters, which are attributes of the law."""
    covariance: Array
    """Covariance (..., p, p) of the parameters' errors, in the parameters' units; one for all
    robots, or one for each.
    """

    def __post_init__(self) -> None:
        p = len(self.names)
        matrix = np.asarray(self.covariance, float)
        fits = matrix.shape[-2:] == (p, p)
        allowed = f"of shape {(p, p)}, as there are {p} names"
        require(fits, "covariance", matrix.shape, allowed)

        variances = np.diagonal(matrix, axis1=-2, axis2=-1)
        are_variances = np.isfinite(matrix).all() and (variances >= 0).all()
        require(are_variances, "covariance", matrix.tolist(), "finite, with variances >= 0")

        # of a covariance, at a correlation of 1
        limit = np.sqrt(variances[..., :, None] * variances[..., None, :])
        is_symmetric = (np.abs(matrix - matrix.swapaxes(-1, -2)) <= _ASYMMETRY * limit).all()
        are_correlations = (np.abs(matrix) <= (1 + _ASYMMETRY) * limit).all()
        allowed = "symmetric, with correlations from -1 to 1"
        require(is_symmetric and are_correlations, "covariance", matrix.tolist(), allowed)

    @classmethod
    def stored(cls, fit: Mapping[str, Any]) -> Self:
        """Read the errors of a stored fit: `values`, `stderr` and, optionally, `interval95` and
        `correlation`.

        Errors match the 95 % intervals, which allow for persistent slip. Parameters with unknown
        errors are left out.
        """
        intervals = fit.get("interval95") or {}
        fitted = list(fit["stderr"])
        errors = {}
        for name in fit["values"]:
            error = fit["stderr"].get(name)
            if error is None or not 0 < float(error) < np.inf:
                continue
            low, high = intervals.get(name) or (0.0, 0.0)
            of_interval = (float(high) - float(low)) / 2 / _NORMAL_95
            errors[name] = max(float(error), of_interval)

        count = len(fitted)
        correlation = np.array(fit.get("correlation", np.eye(count)), float).reshape(count, count)
        rows = [fitted.index(name) for name in errors]
        sizes = [*errors.values()]
        with np.errstate(over="ignore", invalid="ignore"):  # __post_init__ refuses infinities
            covariance = np.outer(sizes, sizes) * correlation[np.ix_(rows, rows)]
            return cls(tuple(errors), covariance)

    def slopes(self, law: SlipLaw, omega: Array, geometry: RobotGeometry) -> Array:
        """Derivatives (..., 2, p) of the law's twists at sprocket speeds (..., 2) [rad/s] by the
        parameters `names`.

        Derivatives are central differences, or 0 for a parameter without error. Raises
        InvalidValueError for a name that is not a parameter of the law.
        """
        slopes = np.zeros((*omega.shape, len(self.names)))

        def twist_with(name: str, value: Array) -> Array:
            changed = replace(law, **{name: value})  # type: ignore[type-var]
            return changed.twist(omega, geometry)

        errors = np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1))  # (..., p)
        for k, name in enumerate(self.names):
            value = getattr(law, name, None)
            if value is None:
                raise InvalidValueError("names", name, f"parameters of {law}")
            step = _DIFFERENCE * errors[..., k]
            if (step > 0).all():
                above = twist_with(name, value + step)
                below = twist_with(name, value - step)
                slopes[..., k] = (above - below) / (2 * step[..., None])
        return slopes
