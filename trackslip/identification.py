"""Runs -> steady slip samples -> slip laws fitted to them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import lmfit
import numpy as np

from trackslip.errors import InvalidValueError, LogError, require_non_negative
from trackslip.kinematics import Array, RobotGeometry, body_twist, curvature, track_slip
from trackslip.metrics import rms
from trackslip.motion import DEFAULT_METHOD, MOTION_METHODS
from trackslip.runlog import RunLog
from trackslip.slip import ConstantIcr, Exponential, SlipLaw
from trackslip.steady import SETTLE, steady_window

_JUMP = 0.3  # error of a pose that is still believed [m]
_OVERDRIVE = 3.0  # way from pose to pose that is still believed, over the way of the faster sprocket [-]
_NEARLY_STANDING = 0.02  # speed of the slower sprocket over that of the faster, below which its slip says nothing
_WILD = 0.8  # slip of the faster track that no robot on wheels or tracks shows in steady motion


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
            LogError: where a sprocket stands still, which leaves its slip undefined, or a slip is beyond belief.
        """
        slip = track_slip(omega, twist, geometry)
        undefined = ~np.isfinite(slip).all(axis=1)
        if undefined.any():
            raise LogError(f"run {run[int(np.argmax(undefined))]!r}: a sprocket stands still, its slip is undefined")
        size = np.abs(omega)
        standing = size.min(axis=1) < _NEARLY_STANDING * size.max(axis=1)
        if standing.any():
            k = int(np.argmax(standing))
            raise LogError(
                f"run {run[k]!r}: one sprocket nearly stands ({omega[k].min():.3g} and {omega[k].max():.3g} rad/s): "
                "its slip says nothing, leave the run out"
            )
        of_faster = np.take_along_axis(slip, np.abs(omega).argmax(axis=1)[:, None], axis=1)[:, 0]
        wild = np.abs(of_faster) > _WILD
        if wild.any():
            k = int(np.argmax(wild))
            raise LogError(
                f"run {run[k]!r}: slip {of_faster[k]:.3g} of the faster track is beyond belief (over {_WILD}): "
                f"check the units (rad/s, m, rad, s) and sprocket_radius = {geometry.sprocket_radius:g} m"
            )
        ideal = body_twist(omega, 0.0, geometry)[:, 1]
        backwards = (ideal * twist[:, 1] < 0) & (np.abs(twist[:, 1]) > 0.2 * np.abs(ideal))
        if backwards.any():
            k = int(np.argmax(backwards))
            raise LogError(
                f"run {run[k]!r}: it turns at {twist[k, 1]:+.3g} rad/s where its sprockets say {ideal[k]:+.3g} rad/s: "
                "are the tracks swapped, or phi not counter-clockwise?"
            )
        return cls(omega, twist, slip, tuple(run))

    @classmethod
    def joined(cls, parts: Sequence[SlipSamples]) -> SlipSamples:
        """All samples of the parts, in order."""
        return cls(
            omega=np.concatenate([part.omega for part in parts]),
            twist=np.concatenate([part.twist for part in parts]),
            slip=np.concatenate([part.slip for part in parts]),
            run=tuple(name for part in parts for name in part.run),
        )


def slip_samples(
    logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE, method: str = DEFAULT_METHOD
) -> SlipSamples:
    """Mean slip of each run from its estimated poses and measured sprocket speeds.

    Args:
        logs: runs at constant sprocket speeds.
        geometry: the robot's nominal geometry.
        settle: time at the start of each run that is left out [s].
        method: name of a motion method, out of MOTION_METHODS.

    Raises:
        InvalidValueError: for an unknown method.
        LogError: for a run that is too short, not steady, jumps, or has too few valid poses.
    """
    require_non_negative("settle", settle)
    if method not in MOTION_METHODS:
        raise InvalidValueError("motion", method, f"one of {', '.join(MOTION_METHODS)}")
    omega, twist = [], []
    for log in logs:
        begin, end = steady_window(log, settle)
        refuse_jumps(log, geometry)
        rows = (log.time > begin) & (log.time < end)
        omega.append(log.omega[rows].mean(axis=0))
        twist.append(MOTION_METHODS[method](log, (begin, end)).twist)
    return SlipSamples.of(np.array(omega), np.array(twist), geometry, [log.run for log in logs])


def refuse_jumps(log: RunLog, geometry: RobotGeometry) -> None:
    """Raise LogError where the valid poses of a run jump farther than its sprockets could have driven it."""
    valid = log.is_valid
    time, position = log.time[valid], log.pose[valid, :2]
    way = np.hypot(*np.diff(position, axis=0).T)
    reach = _JUMP + _OVERDRIVE * geometry.sprocket_radius * np.abs(log.omega).max() * np.diff(time)
    far = way > reach
    if far.any():
        k = int(np.argmax(far))
        raise LogError(
            f"run {log.run!r}: its pose jumps by {way[k]:.3g} m between t = {time[k]:g} s and {time[k + 1]:g} s, "
            f"where its sprockets allow {reach[k]:.3g} m: mark bad rows in a column valid"
        )


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
    """name -> (start, lowest, highest); of a length, in half gauges of the robot."""
    build: Callable[[Mapping[str, float], RobotGeometry], SlipLaw]
    """A law from values of the parameters."""

    def limits(self, half_gauge: float) -> dict[str, tuple[float, float, float]]:
        """name -> (start, lowest, highest) for a robot of that half gauge [m]."""
        units = {name: half_gauge if name in _LENGTHS else 1.0 for name in self.parameters}
        return {
            name: (s * units[name], a * units[name], b * units[name]) for name, (s, a, b) in self.parameters.items()
        }


_VAGUE = 0.1  # standard error, as a fraction of its range, of a parameter that the samples say nothing about
_EXACT = 1e-9  # rms residual of samples that lie on a law to within rounding
_HOPELESS = 0.3  # rms residual of a fit that has gone astray
_START_SCALES = (1.0, 6.0, 20.0)
_LENGTHS = ("offset",)
_OFFSET = (0.05, -0.99, 50.0)

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
        {"offset": _OFFSET},
        lambda p, geometry: ConstantIcr(p["offset"], geometry.half_gauge),
    ),
    "icr_radius": LawModel(
        {"offset": _OFFSET, "radius_error": (0.0, -0.5, 0.5)},
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
    """Standard errors, from the scatter about the law; 0 for samples that lie on it exactly."""
    rms: float
    """Of the residual slip, both tracks [-]."""


def fit_law(name: str, samples: SlipSamples, geometry: RobotGeometry) -> FittedLaw:
    """Least squares of both tracks' slip at the observed curvatures, by lmfit.

    Raises:
        InvalidValueError: for an unknown law.
        LogError: for samples that don't determine every parameter, or a fit that fails.
    """
    if name not in LAW_MODELS:
        raise InvalidValueError("law", name, f"one of {', '.join(LAW_MODELS)}")
    model = LAW_MODELS[name]
    limits = model.limits(geometry.half_gauge)
    if samples.slip.size <= len(limits):
        raise LogError(
            f"law {name}: {len(samples.run)} sample(s) of two tracks can't determine its {len(limits)} parameters"
        )

    def residual(p: lmfit.Parameters) -> Array:
        return (model.build(p.valuesdict(), geometry)(samples.curvature) - samples.slip).ravel()

    # slip has a pole in the offset for every turn: climb from several sides, keep the best
    results = []
    for scale in _START_SCALES:
        parameters = lmfit.Parameters()
        for key, (start, low, high) in limits.items():
            parameters.add(key, value=start * (scale if key in _LENGTHS else 1.0), min=low, max=high)
        results.append(lmfit.minimize(residual, parameters))
        if not set(limits) & set(_LENGTHS):
            break
    result = min(results, key=lambda r: float(r.chisqr))
    left_over = rms(residual(result.params))
    if left_over > _HOPELESS:
        raise LogError(
            f"law {name}: misses the samples by {left_over:.2g} rms: are there runs as tight as the tracks are apart?"
        )
    if not result.success and left_over > _EXACT:
        raise LogError(f"law {name}: the fit failed ({' '.join(result.message.split())})")
    for key, p in result.params.items():
        at_limit = min(p.value - p.min, p.max - p.value) < 1e-3 * min(p.max - p.min, 1.0)
        if at_limit or p.stderr is None or p.stderr > _VAGUE * (p.max - p.min):
            raise LogError(
                f"law {name}: the {len(samples.run)} samples don't determine {key} (the fit stopped at {p.value:.3g}); "
                "it takes runs of different radii, in units of rad/s, m, rad and s"
            )
    values = {key: float(p.value) for key, p in result.params.items()}
    stderr = {key: float(p.stderr) for key, p in result.params.items()}
    return FittedLaw(name, model.build(values, geometry), values, stderr, left_over)


def fit_laws(samples: SlipSamples, geometry: RobotGeometry) -> tuple[dict[str, FittedLaw], list[str]]:
    """Every law of LAW_MODELS that the samples determine, and why not the others.

    Raises:
        LogError: when they determine none.
    """
    laws, warnings = {}, []
    for name in LAW_MODELS:
        try:
            laws[name] = fit_law(name, samples, geometry)
        except LogError as error:
            warnings.append(str(error))
    if not laws:
        raise LogError(warnings[-1])
    return laws, warnings


def law_from_values(name: str, values: Mapping[str, Any], half_gauge: float) -> SlipLaw:
    """A law of LAW_MODELS from stored values; raises InvalidValueError for what isn't there."""
    if name not in LAW_MODELS:
        raise InvalidValueError("law", name, f"one of {', '.join(LAW_MODELS)}")
    model = LAW_MODELS[name]
    given = {key: values.get(key) for key in model.parameters}
    missing = [key for key, value in given.items() if isinstance(value, bool) or not isinstance(value, int | float)]
    if missing:
        raise InvalidValueError(f"{name}.{missing[0]}", values.get(missing[0]), "a number")
    numbers = {key: float(values[key]) for key in model.parameters}
    geometry = RobotGeometry(half_gauge, sprocket_radius=1.0)
    for key, (_, low, high) in model.limits(half_gauge).items():
        if not low <= numbers[key] <= high:
            raise InvalidValueError(f"{name}.{key}", numbers[key], f"from {low:g} to {high:g}")
    return model.build(numbers, geometry)
