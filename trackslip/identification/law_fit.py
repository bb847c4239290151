"""Fits of laws to drives in windows: window length, start values, intervals, and undetermined
parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from trackslip.drives.clocks import clock_of_drive, median_offset
from trackslip.drives.drive import Drive, Drives
from trackslip.drives.gains import gains_of
from trackslip.identification.answer import NO_POSITIONS
from trackslip.identification.comparison import REFERENCE, FittedLaw, uncertainty
from trackslip.identification.far_poses import OFFSETS, are_far_apart, start_between_far_poses
from trackslip.identification.path import EXTRAS, DriveModel
from trackslip.identification.prediction import Pairs, sizes, slip_noise
from trackslip.identification.windows import WindowFit, fit_windows
from trackslip.intervals import FEWEST_BLOCKS
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import DIFF_DRIVE, FAMILIES, family
from trackslip.se2 import Mounting

MACHINED: Final = 0.02
"""Prior standard deviation of radius errors if the driving doesn't determine the radius [-]."""
_LENGTHS: Final = (10.0, 5.0, 2.0, 1.0)  # candidate lengths of windows [s]
# prediction horizons that decide the window length and show how slip varies [s]
_COMPARED: Final = (1.0, 5.0)


@dataclass(frozen=True, kw_only=True)
class DriveFit(FittedLaw):
    """A law fitted to whole drives."""

    # values of the parameters in `path.EXTRAS`, held or fitted, in m, s and rad
    extras: dict[str, float]
    noise: dict[str, float]
    """Standard deviations. Poses: position [m], heading [rad]. Varying slip: slip_forward and
    slip_sideways [m/√m], slip_turn [rad/√m]. With a gyro: gyro [rad/√s].
    """
    poses: int  # number of poses used
    blocks: int  # number of blocks of driving, whose scatter determines the standard errors
    fit: WindowFit  # the complete fit
    # (n, 3) prediction errors for `pairs`, from fits without each pair's own block [m, m, rad]
    missed: Array
    pairs: Pairs  # pairs of poses for predictions

    @property
    def at_limit(self) -> tuple[str, ...]:
        """Names of law parameters at or very near a limit, except a lower limit of 0."""
        low, high, scale = self.fit.model.limits[:, : len(self.values)]
        # a fit may stop before it reaches a limit
        values, near = self.fit.values[: len(self.values)], 0.3 * scale
        bound = ((values < low + near) & (low != 0)) | (values > high - near)
        return tuple(name for name, at in zip(self.values, bound, strict=True) if at)

    @property
    def sits_aside(self) -> bool:
        """True if the driving shows that the sensor is off-centre, or that the sides' ICRs differ
        with that effect.
        """
        low, high = self.interval95.get("sensor_y", (-np.inf, np.inf))
        matters = EXTRAS["sensor_y"].scale
        return low > matters or high < -matters


def fit_drives(
    name: str,
    drives: Sequence[Drive],
    geometry: RobotGeometry,
    sensor: Mounting | None = None,
    reference: DriveFit | None = None,
    start: Mapping[str, float] | None = None,
    lag: bool = False,
) -> DriveFit:
    """Fit a law to whole drives prepared by `drives_of`; raises InvalidValueError for an unknown
    law.

    A given `sensor` isn't estimated; the motion's lag behind the belts is estimated only with
    `lag`. `reference` is an existing fit of REFERENCE to the same drives; without it, REFERENCE is
    fitted first, from the values by name in `start` (by default gains and clock from regression).
    Without radius_error in `start`, the prior for it is narrow.
    """
    if reference is None:
        reference = _reference(Drives.smooth(drives), geometry, sensor, start, lag)
    if name == REFERENCE:
        return reference
    first = reference.fit
    model = replace(first.model, family=family(name))
    values = np.concatenate(
        [_law_start(name, geometry, reference.values), [*reference.extras.values()]]
    )
    held, mean = held_parameters(model, first.drives, sensor, lag), prior_means(model, sensor)
    if "offset_left" in model.names and not reference.sits_aside:
        values[model.index("sensor_y")] = mean[model.index("sensor_y")]
    if not model.far:
        fit = fit_windows(model, first.drives, first.length, values, held, mean)
        return _described(fit, held, reference.pairs)
    # equal radii may fit too badly to show that the driving determines the mean radius
    priors = [DriveModel.radius_prior] if name == DIFF_DRIVE else []
    for prior in (*priors, model.radius_prior):
        model = replace(model, radius_prior=prior)
        start_values = start_between_far_poses(model, first.drives, values, held, mean)
        fit = fit_windows(model, first.drives, first.length, start_values, held, mean)
        found = _described(fit, held, reference.pairs)
        if not found.held.keys() >= {"radius_error_left", "radius_error_right"}:
            break
    return found


def _reference(
    drives: Drives,
    geometry: RobotGeometry,
    sensor: Mounting | None,
    start: Mapping[str, float] | None,
    lag: bool,
    machined: bool = False,
) -> DriveFit:
    """Fit REFERENCE with the longest windows that predict as well as shorter windows and leave
    enough blocks.

    Where the driving doesn't determine the radius, it is assumed to be `machined`, near the nominal
    one.
    """
    if start is None:
        clock = median_offset(map(clock_of_drive, drives.drives))
        start = gains_of(drives, geometry, clock).start(geometry, clock)
    # relative motions take positions and headings
    far = are_far_apart(drives) and bool(drives.known.any(axis=1).all())
    machined = machined or not (far or "radius_error" in start)
    prior = MACHINED if machined else DriveModel.radius_prior
    model = DriveModel(FAMILIES[REFERENCE], geometry, drives.gyro is not None, prior, far)
    held, mean = held_parameters(model, drives, sensor, lag), prior_means(model, sensor)
    values = mean.copy()
    for name, value in start.items():
        if not (name in held or (sensor is not None and name.startswith("sensor"))):
            values[model.index(name)] = value
    if far:
        values = start_between_far_poses(model, drives, values, held, mean, OFFSETS)
    starts = values[None]
    # front and rear may look alike: try both
    if not ({"sensor_x", "sensor_y"} & set(held) or drives.known[1].any()):
        starts = np.tile(values, (2, 1))
        starts[:, model.index("sensor_x")] = geometry.half_gauge, -geometry.half_gauge
    pairs = Pairs.of(drives, geometry)
    best: DriveFit | None = None
    for length in _lengths(drives):
        windows = (fit_windows(model, drives, length, start, held, mean) for start in starts)
        fit = min((_described(each, held, pairs) for each in windows), key=_size)
        if best is not None and _size(best) <= 1.01 * _size(fit):  # 1 % doesn't matter
            break
        best = fit
    assert best is not None
    if far and not machined and "radius_error" in best.held:
        return _reference(drives, geometry, sensor, start, lag, machined=True)
    return best


def _lengths(drives: Drives) -> list[float]:
    """Window lengths [s], longest first, that fit into the drives and leave enough blocks for
    confidence intervals.
    """
    longest = max(float(drive.time[-1] - drive.time[0]) for drive in drives.drives)
    blocks = [int(drives.blocks(2 * length)[-1]) + 1 for length in _LENGTHS]
    least = min(FEWEST_BLOCKS, blocks[-1])
    lengths = [
        length
        for length, count in zip(_LENGTHS, blocks, strict=True)
        if length <= longest and count >= least
    ]
    return lengths or [_LENGTHS[-1]]


def _size(fit: DriveFit) -> float:
    """Geometric mean of a fit's mean errors in position and heading at the compared horizons; 0
    without errors.
    """
    size, horizon = sizes(fit.missed), fit.pairs.horizon
    ahead = set(horizon) & set(_COMPARED) or set(horizon)
    columns = [
        column[np.isfinite(column)] for h in sorted(ahead) for column in size[horizon == h].T
    ]
    return float(
        np.exp(
            np.mean(
                [np.log(column.mean() + 1e-12) for column in columns if len(column)] or [-np.inf]
            )
        )
    )


def held_parameters(
    model: DriveModel, drives: Drives, sensor: Mounting | None = None, lag: bool = False
) -> dict[str, str]:
    """The parameters that are not fitted to the drives, with a reason for each."""
    held = dict[str, str]()
    if not drives.known[1].any():
        held["sensor_yaw"] = "no headings were measured"
    if not drives.known[0].any():
        lengths = [
            name for name in model.family.names if name.startswith(("radius_error", "turn_loss"))
        ]
        held |= dict.fromkeys(("sensor_x", "sensor_y", "drift", *lengths), NO_POSITIONS)
    if np.diff(drives.first).max() <= 2:
        ends = ("sensor_x", "sensor_y", "drift", "clock_offset")
        held |= dict.fromkeys(ends, "poses at both ends of runs don't determine it")
    if not lag:
        held["lag"] = "not asked for"
    if "offset_left" in model.names:
        held["sensor_y"] = "an offset of the sensor and unequal ICRs can't be told apart"
    if sensor is not None:
        # sensor_x, from the turning centre, is fitted
        held |= dict.fromkeys(("sensor_y", "sensor_yaw"), "given")
    return held


def prior_means(model: DriveModel, sensor: Mounting | None) -> Array:
    """Prior means (p,) of the parameters."""
    mean = np.zeros(len(model.names))
    if sensor is not None:
        mean[[model.index(f"sensor_{key}") for key in ("x", "y", "yaw")]] = (
            sensor.x,
            sensor.y,
            sensor.yaw,
        )
    return mean


def _law_start(name: str, geometry: RobotGeometry, reference: Mapping[str, float]) -> list[float]:
    """Start values with which a law predicts nearly the same motion as the reference law."""
    starts = zip(
        FAMILIES[name].names, FAMILIES[name].starts(geometry.half_gauge)[0].tolist(), strict=True
    )
    return [
        reference.get(key.removesuffix("_left").removesuffix("_right"), value)
        for key, value in starts
    ]


def _described(fit: WindowFit, held: Mapping[str, str], pairs: Pairs) -> DriveFit:
    """Make a DriveFit from a fit in windows: the law's values, intervals and prediction errors."""
    model, covariance = fit.model, fit.covariance
    names = [model.names[k] for k in fit.free]
    # standard errors above half the prior's; with too few blocks, only those for independent
    # residuals are known
    variance = np.fmax(np.diag(covariance), np.diag(fit.inverse))
    vague = np.sqrt(variance) > 0.5 / np.sqrt(fit.prior)
    unknown = [name for name, is_vague in zip(names, vague, strict=True) if is_vague]
    values = dict(zip(model.names, fit.values.tolist(), strict=True))
    parameters = {name: values.pop(name) for name in model.family.names}
    missed = pairs.held_out_errors(fit)
    position, heading, turn = fit.spread.tolist()
    noise = {
        "position": position,
        "heading": heading,
        **slip_noise(missed, pairs, fit.spread, _COMPARED),
    }
    return DriveFit(
        name=next(name for name, family in FAMILIES.items() if family is model.family),
        law=model.family.build(parameters, model.geometry),
        values=parameters,
        extras=values,
        held={**held, **dict.fromkeys(unknown, "the driving doesn't determine it")},
        noise=noise
        | ({"gyro": turn / np.sqrt(fit.drives.drives[0].interval)} if model.gyro else {}),
        poses=int(fit.drives.known.any(axis=0).sum()),
        blocks=len(fit.score),
        fit=fit,
        missed=missed,
        pairs=pairs,
        **uncertainty(
            names, fit.values[fit.free], covariance, fit.quantile, model.limits[:2, fit.free]
        ),
    )
