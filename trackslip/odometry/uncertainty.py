"""Uncertainty of odometry: varying slip, gyro errors, and errors of the law's parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from trackslip.errors import require, require_finite, require_non_negative
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.base import SlipLaw

_SLIP = ("slip_forward", "slip_sideways", "slip_turn")  # entries of DriveFit.noise
_NORMAL_95 = 1.959963984540054  # half-width of a 95 % interval [standard deviations]
_DIFFERENCE = 1e-3  # parameter step for derivatives [standard errors]
_ASYMMETRY = 1e-6  # allowed asymmetry of a covariance, relative to its variances


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
        require(set(_SLIP) <= set(noise), "noise", [*noise], f"a mapping with {', '.join(_SLIP)}")
        return cls(*(float(noise[name]) for name in _SLIP))


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


@dataclass(frozen=True)
class LawErrors:
    """Errors of a law's parameters, which are constant along the whole path."""

    names: tuple[str, ...]
    """Names of the parameters, which are attributes of the law."""
    covariance: Array
    """Covariance (p, p) of the parameters' errors, in the parameters' units."""

    def __post_init__(self) -> None:
        p, matrix = len(self.names), np.asarray(self.covariance, float)
        require(
            matrix.shape == (p, p),
            "covariance",
            matrix.shape,
            f"of shape {(p, p)}, as there are {p} names",
        )
        variances = np.diag(matrix)
        usable = np.isfinite(matrix).all() and (variances >= 0).all()
        require(usable, "covariance", matrix.tolist(), "finite, with variances >= 0")
        most = np.sqrt(np.outer(variances, variances))
        usable = (np.abs(matrix - matrix.T) <= _ASYMMETRY * most).all()
        usable &= (np.abs(matrix) <= (1 + _ASYMMETRY) * most).all()
        require(usable, "covariance", matrix.tolist(), "symmetric, with correlations from -1 to 1")

    @classmethod
    def stored(cls, fit: Mapping[str, Any]) -> Self:
        """Read the errors of a stored fit: `values`, `stderr` and, optionally, `interval95` and
        `correlation`.

        Errors match the 95 % intervals, which allow for persistent slip. Parameters with unknown
        errors are left out.
        """
        intervals, fitted = fit.get("interval95") or {}, list(fit["stderr"])
        errors = {}
        for name in fit["values"]:
            error = fit["stderr"].get(name)
            if error is not None and 0 < float(error) < np.inf:
                low, high = intervals.get(name) or (0.0, 0.0)
                errors[name] = max(float(error), (float(high) - float(low)) / 2 / _NORMAL_95)
        correlation = np.array(fit.get("correlation", np.eye(len(fitted))), float).reshape(
            len(fitted), len(fitted)
        )
        rows = [fitted.index(name) for name in errors]
        with np.errstate(over="ignore", invalid="ignore"):  # __post_init__ refuses infinities
            spread = np.outer([*errors.values()], [*errors.values()])
            return cls(tuple(errors), spread * correlation[np.ix_(rows, rows)])

    def slopes(self, law: SlipLaw, omega: Array, geometry: RobotGeometry) -> Array:
        """Derivatives (..., 2, p) of the law's twists at sprocket speeds (..., 2) [rad/s] by the
        parameters `names`.

        Derivatives are central differences, or 0 for a parameter without error. Raises
        InvalidValueError for a name that is not a parameter of the law.
        """
        slopes = np.zeros((*omega.shape, len(self.names)))
        for k, (name, variance) in enumerate(
            zip(self.names, np.diag(self.covariance).tolist(), strict=True)
        ):
            value, step = getattr(law, name, None), _DIFFERENCE * np.sqrt(variance)
            require(value is not None, "names", name, f"parameters of {law}")
            if step > 0:
                ahead, behind = (
                    replace(law, **{name: value + push}).twist(omega, geometry)  # type: ignore[type-var]
                    for push in (step, -step)
                )
                slopes[..., k] = (ahead - behind) / (2 * step)
        return slopes
