"""Laws fitted to drives by windows: which length, which start, values, intervals, and what the driving doesn't tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackslip.identification.fitted import FittedLaw
from trackslip.identification.path import DriveModel
from trackslip.identification.prediction import Pairs, sizes, slip_noise
from trackslip.identification.preparation import PreparedDrive, drives_of
from trackslip.identification.windows import FEWEST_BLOCKS, LENGTHS, Data, WindowFit, fit_windows
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import FAMILIES, family
from trackslip.logs.runlog import RunLog
from trackslip.se2 import Mounting

REFERENCE = "icr_radius"
"""The law that is fitted first: the others start from it, with windows of the same length."""
FOLDS = 5
"""Parts of the driving, of every fifth block each, that are predicted by what the others tell."""
_COMPARED = (1.0, 5.0)  # horizons of the predictions that choose the length [s]
_NO_WORSE = 1.01  # ratio of errors of predictions that doesn't matter
_MACHINED = 0.02  # error of an effective radius that is taken to be possible where the driving doesn't tell it [-]
_NEAR = 0.3  # difference that doesn't matter [significant changes]: a fit may stop before it reaches a limit
_VAGUE = 0.5  # share of the prior's width that a standard error has where the driving doesn't tell a parameter


@dataclass(frozen=True, kw_only=True)
class DriveFit(FittedLaw):
    """A law fitted to drives."""

    extras: dict[str, float]
    """The other parameters (see `path.EXTRAS`), held ones included, in m, s and rad."""
    held: dict[str, str]
    """Parameters that were held, or that the driving doesn't tell, and why."""
    noise: dict[str, float]
    """Standard deviations of poses: position [m] and heading [rad]; of slip that varies: slip_forward and slip_sideways
    [m/√m], slip_turn [rad/√m]; with a gyro, also gyro [rad/√s]."""
    poses: int
    """Poses used."""
    blocks: int
    """Blocks of driving, whose scatter gives the standard errors."""
    fit: WindowFit
    """The fit in full."""

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the fitted parameters."""
        return tuple(self.stderr)

    @property
    def at_limit(self) -> tuple[str, ...]:
        """Names of the law's parameters at a limit, or so near that the difference doesn't matter; 0 is no limit."""
        low, high, scale = self.fit.model.limits[:, : len(self.values)]
        values = self.fit.values[: len(self.values)]
        near = _NEAR * scale
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
        start: values of REFERENCE and extras to start from, by name. Without radius_error among them, the driving
            doesn't tell it, and it is taken to be small.
        lag: whether to estimate how far the motion lags behind the belts.

    Raises:
        LogError: if no drive can be used.
        InvalidValueError: for an unknown law.
    """
    if reference is None:
        reference = _reference(Data.of(prepared(drives)), geometry, sensor, held or {}, start or {}, lag)
    if name == REFERENCE:
        return reference
    first = reference.fit
    model = replace(first.model, family=family(name))
    law = len(first.model.family.names)
    values = np.concatenate([_law_start(name, geometry, reference.values), first.values[law:]])
    fixed = _held(model, first.data, sensor, held or {}, lag)
    free, mean = _free(model, fixed), _means(model, sensor)
    if "offset_left" in model.names:
        values[model.index("sensor_y")] = (held or {}).get("sensor_y", mean[model.index("sensor_y")])
    fit = fit_windows(model, first.data, first.length, values, free, mean, first.spread)
    return _described(fit, fixed, geometry)


def prepared(drives: Sequence[RunLog] | Sequence[PreparedDrive]) -> list[PreparedDrive]:
    """Drives ready to be fitted; raises LogError if there is none."""
    ready = [drive for drive in drives if isinstance(drive, PreparedDrive)]
    return ready or drives_of([log for log in drives if isinstance(log, RunLog)])[0]


def folds(fit: WindowFit, pairs: Pairs) -> tuple[Array, np.ndarray]:
    """Parameters (F, p) without every fifth block, one step from the fit, and which of them predict the pairs (n,)."""
    count = len(fit.score)
    number, fold = np.unique(np.arange(count) % FOLDS, return_inverse=True)
    return fit.without(fold == np.arange(len(number))[:, None]), fold[np.minimum(fit.block[pairs.start], count - 1)]


def held_out(fit: WindowFit, pairs: Pairs) -> Array:
    """Errors (n, 3) of pairs that are predicted by what the other blocks tell."""
    values, part = folds(fit, pairs)
    return pairs.errors(fit.model, values, part)


def _reference(
    data: Data,
    geometry: RobotGeometry,
    sensor: Mounting | None,
    held: Mapping[str, float],
    start: Mapping[str, float],
    lag: bool,
) -> DriveFit:
    """The fit of REFERENCE with the longest windows that predict no worse and leave enough blocks for intervals."""
    prior = _MACHINED if start and "radius_error" not in start else DriveModel.radius_prior
    model = DriveModel(FAMILIES[REFERENCE], geometry, data.line.gyro is not None, prior)
    fixed = _held(model, data, sensor, held, lag)
    free, mean = _free(model, fixed), _means(model, sensor)
    values: Array = np.zeros(len(model.names))
    for name, value in {**start, **held}.items():
        values[model.index(name)] = value
    if sensor is not None:
        values = np.where(mean != 0, mean, values)
    pairs = Pairs.of(data, geometry, _COMPARED)
    longest = max(float(drive.time[-1] - drive.time[0]) for drive in data.drives)
    best, spread = None, None
    least = _missed(pairs.errors(model, values[None]), pairs)
    fits: list[tuple[float, WindowFit]] = []
    for length in LENGTHS:
        if fits and length > longest:
            break
        fit = fit_windows(model, data, length, values, free, mean, spread)
        if fits and len(fit.score) < min(FEWEST_BLOCKS, len(fits[0][1].score)):
            break
        few = len(fit.score) < FEWEST_BLOCKS
        missed = _missed(pairs.errors(model, fit.values[None]) if few else held_out(fit, pairs), pairs)
        fits.append((missed, fit))
        if missed <= _NO_WORSE * least:  # else windows so short that a path of any law fits them as well
            best, values, spread = fit, fit.values, fit.spread
        least = min(least, missed)
    if best is None:
        _, best = min(fits, key=lambda pair: pair[0])
    fit = fit_windows(model, data, best.length, best.values, free, mean, best.spread)
    return _described(fit, fixed, geometry)


def _missed(error: Array, pairs: Pairs) -> float:
    """Mean errors of position and heading over the horizons, as one number; infinite without any."""
    size = sizes(error)
    means = [np.nanmean(size[pairs.horizon == h, k]) for h in np.unique(pairs.horizon) for k in (0, 1)
             if np.isfinite(size[pairs.horizon == h, k]).any()]  # fmt: skip
    return float(np.exp(np.mean(np.log(means)))) if means else np.inf


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
        fixed |= {name: "no positions were measured" for name in ("sensor_x", "sensor_y", "drift", *lengths)}
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
        for name, value in (("sensor_x", sensor.x), ("sensor_y", sensor.y), ("sensor_yaw", sensor.yaw)):
            mean[model.index(name)] = value
    return mean


def _law_start(name: str, geometry: RobotGeometry, reference: Mapping[str, float]) -> Array:
    """Values of a law that move a robot nearly as the reference does."""
    known = {**reference}
    for side in ("left", "right"):
        known |= {f"{key}_{side}": value for key, value in reference.items()}
    start = FAMILIES[name].starts(geometry.half_gauge)[0]
    return np.array([known.get(key, value) for key, value in zip(FAMILIES[name].names, start, strict=True)])


def _described(fit: WindowFit, fixed: Mapping[str, str], geometry: RobotGeometry) -> DriveFit:
    model, values = fit.model, fit.values
    law = len(model.family.names)
    names = [model.names[k] for k in fit.free]
    covariance = fit.covariance
    error = np.sqrt(np.diag(covariance))
    width = fit.quantile * error
    low, high, _ = model.limits[:, fit.free]
    ends = np.stack([np.maximum(values[fit.free] - width, low), np.minimum(values[fit.free] + width, high)], axis=-1)
    prior = 1 / np.sqrt(fit.prior)
    vague = {
        name: "the driving doesn't tell it" for name, e, p in zip(names, error, prior, strict=True) if e > _VAGUE * p
    }
    parameters = dict(zip(model.family.names, values[:law].tolist(), strict=True))
    with np.errstate(invalid="ignore"):
        correlation = covariance / np.outer(error, error)
    return DriveFit(
        name=next(name for name, one in FAMILIES.items() if one is model.family),
        law=model.family.build(parameters, model.geometry),
        values=parameters,
        extras=dict(zip(model.extras, values[law:].tolist(), strict=True)),
        stderr=dict(zip(names, error.tolist(), strict=True)),
        interval95={name: tuple(row) for name, row in zip(names, ends.tolist(), strict=True)},
        held=dict(fixed) | vague,
        correlation=correlation,
        noise=_noise(fit, geometry),
        poses=int(fit.data.known.any(axis=0).sum()),
        blocks=len(fit.score),
        fit=fit,
    )


def _noise(fit: WindowFit, geometry: RobotGeometry) -> dict[str, float]:
    """The `noise` of a fit: of poses, what windows leave; of slip, what predictions miss the more, the farther."""
    position, heading, turn = fit.spread.tolist()
    pairs = Pairs.of(fit.data, geometry, _COMPARED)
    noise = {"position": position, "heading": heading, **slip_noise(held_out(fit, pairs), pairs, fit.spread)}
    return noise | ({"gyro": turn / np.sqrt(fit.data.drives[0].interval)} if fit.model.gyro else {})
