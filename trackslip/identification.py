"""Runs -> steady slip samples -> slip laws fitted to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import lmfit
import numpy as np

from trackslip.errors import InvalidValueError, LogError, require_non_negative
from trackslip.kinematics import Array, RobotGeometry, curvature, track_slip
from trackslip.metrics import rms
from trackslip.motion import butterworth_motion
from trackslip.runlog import RunLog
from trackslip.slip import ConstantIcr, Exponential, SlipLaw
from trackslip.steady import SETTLE, steady_window


@dataclass(frozen=True)
class SlipSamples:
    """Mean slip of steady runs, one row a run."""

    omega: Array  # (n, 2) measured sprocket speeds [rad/s]
    twist: Array  # (n, 2) [m/s, rad/s]
    slip: Array  # (n, 2)
    run: tuple[str, ...]  # (n,) names

    @property
    def curvature(self) -> Array:
        """(n,) of the observed paths [1/m]."""
        return curvature(self.twist)

    @property
    def radius(self) -> Array:
        """(n,) of the observed paths [m], signed; infinite for a straight one."""
        v, w = self.twist.T
        return np.divide(v, w, out=np.full(len(v), np.inf), where=w != 0)

    @classmethod
    def of(cls, omega: Array, twist: Array, geometry: RobotGeometry, run: Sequence[str]) -> SlipSamples:
        """Samples from steady sprocket speeds and twists (n, 2); Eqs. 2-3.

        Raises:
            LogError: where a sprocket stands still, which leaves its slip undefined.
        """
        slip = track_slip(omega, twist, geometry)
        undefined = ~np.isfinite(slip).all(axis=1)
        if undefined.any():
            raise LogError(f"run {run[int(np.argmax(undefined))]!r}: a sprocket stands still, its slip is undefined")
        return cls(omega, twist, slip, tuple(run))


def slip_samples(logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE) -> SlipSamples:
    """Mean slip of each run from its estimated poses and measured sprocket speeds.

    Args:
        logs: runs at constant sprocket speeds.
        geometry: the robot's nominal geometry.
        settle: time at the start of each run that is left out [s].

    Raises:
        LogError: for a run that is too short, not steady, or has too few valid poses.
    """
    require_non_negative("settle", settle)
    omega, twist = [], []
    for log in logs:
        begin, end = steady_window(log, settle)
        motion = butterworth_motion(log)
        steady = (motion.time > begin) & (motion.time < end)
        rows = (log.time > begin) & (log.time < end)
        if not steady.any():
            raise LogError(f"run {log.run!r}: no valid poses between {begin:g} s and {end:g} s, where it is steady")
        omega.append(log.omega[rows].mean(axis=0))
        twist.append(motion.twist[steady].mean(axis=0))
    return SlipSamples.of(np.array(omega), np.array(twist), geometry, [log.run for log in logs])


def true_samples(logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE) -> SlipSamples:
    """The same from the truth of simulated runs.

    Raises:
        LogError: for a run without truth.
    """
    omega, twist = [], []
    for log in logs:
        if log.truth is None:
            raise LogError(f"run {log.run!r}: has no truth")
        begin, end = steady_window(log, settle)
        rows = (log.time > begin) & (log.time < end)
        omega.append(log.omega[rows].mean(axis=0))
        twist.append(log.truth.twist[rows][:, [0, 2]].mean(axis=0))
    return SlipSamples.of(np.array(omega), np.array(twist), geometry, [log.run for log in logs])


@dataclass(frozen=True)
class LawModel:
    """A family of slip laws with free parameters."""

    parameters: Mapping[str, tuple[float, float, float]]
    """name -> (start, lowest, highest)."""
    build: Callable[[Mapping[str, float], RobotGeometry], SlipLaw]
    """A law from values of the parameters."""


LAW_MODELS: dict[str, LawModel] = {
    "exponential": LawModel(
        {
            "alpha_outer": (0.05, -2.0, 0.99),
            "beta_outer": (-0.5, -50.0, -1e-3),
            "alpha_inner": (-0.1, -20.0, 0.99),
            "beta_inner": (-0.5, -50.0, -1e-3),
        },
        lambda p, geometry: Exponential(**p),
    ),
    "icr": LawModel(
        {"offset": (0.01, -0.9, 10.0)},
        lambda p, geometry: ConstantIcr(p["offset"], geometry.half_gauge),
    ),
    "icr_radius": LawModel(
        {"offset": (0.01, -0.9, 10.0), "radius_error": (0.0, -0.5, 0.5)},
        lambda p, geometry: ConstantIcr(p["offset"], geometry.half_gauge, p["radius_error"]),
    ),
}
"""The laws that are identified: the paper's, the constant ICR (D), and with an error of the effective radius."""


@dataclass(frozen=True)
class FittedLaw:
    """A law identified from samples."""

    name: str
    law: SlipLaw
    values: dict[str, float]
    stderr: dict[str, float]
    """Standard errors, from the scatter about the law; NaN where the samples don't determine one."""
    rms: float
    """Of the residual slip, both tracks [-]."""


def fit_law(name: str, samples: SlipSamples, geometry: RobotGeometry) -> FittedLaw:
    """Least squares of both tracks' slip at the observed curvatures, by lmfit.

    Raises:
        InvalidValueError: for an unknown law.
        LogError: for fewer samples than parameters need, or a fit that fails.
    """
    if name not in LAW_MODELS:
        raise InvalidValueError("law", name, f"one of {', '.join(LAW_MODELS)}")
    model = LAW_MODELS[name]
    # an ICR inside the centre line by more than b would turn the robot the wrong way
    lowest = {"offset": -0.99 * geometry.half_gauge}
    parameters = lmfit.Parameters()
    for key, (start, low, high) in model.parameters.items():
        parameters.add(key, value=start, min=max(low, lowest.get(key, low)), max=high)
    if samples.slip.size <= len(parameters):
        raise LogError(
            f"{len(samples.run)} sample(s) of two tracks can't determine the {len(parameters)} parameters of {name}"
        )

    def residual(p: lmfit.Parameters) -> Array:
        return (model.build(p.valuesdict(), geometry)(samples.curvature) - samples.slip).ravel()

    result = lmfit.minimize(residual, parameters)
    if not result.success:
        raise LogError(f"the fit of law {name} failed: {result.message}")
    values = {key: float(p.value) for key, p in result.params.items()}
    stderr = {key: float("nan") if p.stderr is None else float(p.stderr) for key, p in result.params.items()}
    return FittedLaw(name, model.build(values, geometry), values, stderr, rms(residual(result.params)))


def fit_laws(samples: SlipSamples, geometry: RobotGeometry) -> dict[str, FittedLaw]:
    """Every law of LAW_MODELS, fitted."""
    return {name: fit_law(name, samples, geometry) for name in LAW_MODELS}


def law_from_values(name: str, values: Mapping[str, Any], half_gauge: float) -> SlipLaw:
    """A law of LAW_MODELS from stored values; raises InvalidValueError for what isn't there."""
    if name not in LAW_MODELS:
        raise InvalidValueError("law", name, f"one of {', '.join(LAW_MODELS)}")
    model = LAW_MODELS[name]
    missing = [key for key in model.parameters if not isinstance(values.get(key), int | float)]
    if missing:
        raise InvalidValueError(f"{name}.{missing[0]}", values.get(missing[0]), "a number")
    numbers = {key: float(values[key]) for key in model.parameters}
    return model.build(numbers, RobotGeometry(half_gauge, sprocket_radius=1.0))
