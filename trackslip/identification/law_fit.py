"""Laws fitted to drives by windows: which length, which start, values, intervals, and what the driving doesn't tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackslip.identification.clocks import clock_of
from trackslip.identification.fitted import FEWEST_BLOCKS, FittedLaw, uncertainty
from trackslip.identification.gains import gains_of
from trackslip.identification.path import DriveModel
from trackslip.identification.prediction import Pairs, held_out, sizes, slip_noise
from trackslip.identification.preparation import PreparedDrive, drives_of
from trackslip.identification.windows import Data, WindowFit, fit_windows
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import FAMILIES, family
from trackslip.logs.runlog import RunLog
from trackslip.se2 import Mounting

REFERENCE = "icr_radius"
"""The law that is fitted first: the others start from it, with windows of the same length."""
_LENGTHS = (10.0, 5.0, 2.0, 1.0)  # of windows that are tried [s]
_COMPARED = (1.0, 5.0)  # horizons of the predictions that choose the length, and tell how slip varies [s]
_NO_WORSE = 1.01  # ratio of errors of predictions that doesn't matter
_MACHINED = 0.02  # error of an effective radius that is taken to be possible where the driving doesn't tell it [-]


@dataclass(frozen=True, kw_only=True)
class DriveFit(FittedLaw):
    """A law fitted to drives."""

    extras: dict[str, float]  # the other parameters (see `path.EXTRAS`), held ones included, in m, s and rad
    held: dict[str, str]  # parameters that were held, or that the driving doesn't tell, and why
    noise: dict[str, float]
    """Standard deviations of poses: position [m] and heading [rad]; of slip that varies: slip_forward and slip_sideways
    [m/√m], slip_turn [rad/√m]; with a gyro, also gyro [rad/√s]."""
    poses: int  # poses used
    blocks: int  # blocks of driving, whose scatter gives the standard errors
    fit: WindowFit  # the fit in full
    missed: Array  # (n, 3) errors of `pairs`, each predicted by what other blocks of the driving tell [m, m, rad]
    pairs: Pairs

    @property
    def at_limit(self) -> tuple[str, ...]:
        """Names of the law's parameters at a limit, or so near that the difference doesn't matter; 0 is no limit."""
        low, high, scale = self.fit.model.limits[:, : len(self.values)]
        values, near = self.fit.values[: len(self.values)], 0.3 * scale  # a fit may stop before it reaches a limit
        bound = ((values < low + near) & (low != 0)) | (values > high - near)
        return tuple(name for name, at in zip(self.values, bound, strict=True) if at)


def fit_drives(
    name: str,
    drives: Sequence[RunLog] | Sequence[PreparedDrive],
    geometry: RobotGeometry,
    sensor: Mounting | None = None,
    held: Mapping[str, float] | None = None,
    reference: DriveFit | None = None,
    start: Mapping[str, float] | None = None,
    lag: bool = False,
) -> DriveFit:
    """Fit a law to whole drives, or to windows of them.

    Args:
        name: of the law.
        drives: logs of drives, or prepared ones.
        geometry: nominal geometry of the robot.
        sensor: place and yaw of the sensor on the robot, if known; else estimated.
        held: extras to hold at a value, by name.
        reference: a fit of REFERENCE to the same drives, which saves fitting it again.
        start: values of REFERENCE and extras to start from, by name; by default gains and clock by regression. Without
            radius_error among them, the driving doesn't tell it, and it is taken to be small.
        lag: whether to estimate how far the motion lags behind the belts.

    Raises:
        LogError: if no drive can be used.
        InvalidValueError: for an unknown law.
    """
    held = held or {}
    if reference is None:
        reference = _reference(prepared(drives), geometry, sensor, held, start, lag)
    if name == REFERENCE:
        return reference
    first = reference.fit
    model = replace(first.model, family=family(name))
    values = np.concatenate([_law_start(name, geometry, reference.values), [*reference.extras.values()]])
    fixed, mean = _held(model, first.data, sensor, held, lag), _means(model, sensor)
    if "offset_left" in model.names:
        values[model.index("sensor_y")] = held.get("sensor_y", mean[model.index("sensor_y")])
    fit = fit_windows(model, first.data, first.length, values, _free(model, fixed), mean)
    return _described(fit, fixed, reference.pairs)


def prepared(drives: Sequence[RunLog] | Sequence[PreparedDrive]) -> list[PreparedDrive]:
    """Drives ready to be fitted; raises LogError if there is none."""
    ready = [drive for drive in drives if isinstance(drive, PreparedDrive)]
    return ready or drives_of([log for log in drives if isinstance(log, RunLog)])[0]


def _reference(
    drives: Sequence[PreparedDrive],
    geometry: RobotGeometry,
    sensor: Mounting | None,
    held: Mapping[str, float],
    start: Mapping[str, float] | None,
    lag: bool,
) -> DriveFit:
    """The fit of REFERENCE with the longest windows that predict no worse and leave enough blocks for intervals."""
    if start is None:
        clock = clock_of(drives)
        start = gains_of(drives, geometry, clock).start(geometry, clock)
    data = Data.of(drives)
    prior = DriveModel.radius_prior if "radius_error" in start else _MACHINED
    model = DriveModel(FAMILIES[REFERENCE], geometry, data.line.gyro is not None, prior)
    fixed, mean = _held(model, data, sensor, held, lag), _means(model, sensor)
    values = mean.copy()
    for name, value in {**start, **held}.items():
        if name in held or not (name in fixed or (sensor is not None and name.startswith("sensor"))):
            values[model.index(name)] = value
    pairs = Pairs.of(data, geometry)
    best: DriveFit | None = None
    for length in _lengths(data):
        fit = _described(fit_windows(model, data, length, values, _free(model, fixed), mean), fixed, pairs)
        if best is not None and _size(best) <= _NO_WORSE * _size(fit):
            break
        best = fit
    assert best is not None
    return best


def _lengths(data: Data) -> list[float]:
    """Lengths of windows [s] that drives and intervals allow, the longest first."""
    longest = max(float(drive.time[-1] - drive.time[0]) for drive in data.drives)
    blocks = [int(data.blocks(2 * length)[-1]) + 1 for length in _LENGTHS]
    least = min(FEWEST_BLOCKS, blocks[-1])
    lengths = [length for length, count in zip(_LENGTHS, blocks, strict=True) if length <= longest and count >= least]
    return lengths or [_LENGTHS[-1]]


def _size(fit: DriveFit) -> float:
    """Mean errors of position and heading over the horizons that are compared, as one number; 0 without any."""
    size, horizon = sizes(fit.missed), fit.pairs.horizon
    ahead = set(np.unique(horizon)) & set(_COMPARED) or set(np.unique(horizon))
    columns = [column[np.isfinite(column)] for h in sorted(ahead) for column in size[horizon == h].T]
    return float(np.exp(np.mean([np.log(column.mean() + 1e-12) for column in columns if len(column)] or [-np.inf])))


def _held(
    model: DriveModel, data: Data, sensor: Mounting | None, held: Mapping[str, float], lag: bool
) -> dict[str, str]:
    """Parameters that are not fitted, and why."""
    fixed = dict.fromkeys(held, "given")
    if sensor is not None:
        fixed |= dict.fromkeys(("sensor_y", "sensor_yaw"), "given")  # x is ahead of the turning centre, not the middle
    if not data.known[1].any():
        fixed.setdefault("sensor_yaw", "no headings were measured")
    if not data.known[0].any():
        lengths = [name for name in model.family.names if name.startswith(("radius_error", "turn_loss"))]
        fixed |= dict.fromkeys(("sensor_x", "sensor_y", "drift", *lengths), "no positions were measured")
    if not lag:
        fixed.setdefault("lag", "not asked for")
    if "offset_left" in model.names:
        fixed.setdefault("sensor_y", "an offset of the sensor and unequal ICRs can't be told apart")
    return fixed


def _free(model: DriveModel, fixed: Mapping[str, str]) -> np.ndarray:
    return np.array([k for k, name in enumerate(model.names) if name not in fixed], int)


def _means(model: DriveModel, sensor: Mounting | None) -> Array:
    mean = np.zeros(len(model.names))
    if sensor is not None:
        mean[[model.index(f"sensor_{key}") for key in ("x", "y", "yaw")]] = sensor.x, sensor.y, sensor.yaw
    return mean


def _law_start(name: str, geometry: RobotGeometry, reference: Mapping[str, float]) -> list[float]:
    """Values of a law that move a robot nearly as the reference does."""
    start = FAMILIES[name].starts(geometry.half_gauge)[0].tolist()
    by_name = dict(zip(FAMILIES[name].names, start, strict=True))
    return [reference.get(key.removesuffix("_left").removesuffix("_right"), by_name[key]) for key in by_name]


def _described(fit: WindowFit, fixed: Mapping[str, str], pairs: Pairs) -> DriveFit:
    model, law = fit.model, len(fit.model.family.names)
    names, covariance = [model.names[k] for k in fit.free], fit.covariance
    known = uncertainty(names, fit.values[fit.free], covariance, fit.quantile, model.limits[:2, fit.free])
    vague = np.sqrt(np.diag(covariance)) > 0.5 / np.sqrt(fit.prior)  # half of what is known without driving
    held = dict(fixed) | {
        name: "the driving doesn't tell it" for name, unknown in zip(names, vague, strict=True) if unknown
    }
    parameters = dict(zip(model.family.names, fit.values[:law].tolist(), strict=True))
    missed = held_out(fit, pairs)
    position, heading, turn = fit.spread.tolist()
    noise = {"position": position, "heading": heading, **slip_noise(missed, pairs, fit.spread, _COMPARED)}
    return DriveFit(
        name=next(name for name, family in FAMILIES.items() if family is model.family),
        law=model.family.build(parameters, model.geometry),
        values=parameters,
        extras=dict(zip(model.extras, fit.values[law:].tolist(), strict=True)),
        held=held,
        noise=noise | ({"gyro": turn / np.sqrt(fit.data.drives[0].interval)} if model.gyro else {}),
        poses=int(fit.data.known.any(axis=0).sum()),
        blocks=len(fit.score),
        fit=fit,
        missed=missed,
        pairs=pairs,
        **known,
    )
