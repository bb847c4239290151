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
from trackslip.identification.between_runs import fit_runs
from trackslip.identification.comparison import MACHINED, REFERENCE, FittedLaw, Uncertainty
from trackslip.identification.far_poses import OFFSETS, are_far_apart, start_between_far_poses
from trackslip.identification.path import EXTRAS, DriveModel
from trackslip.identification.prediction import Pairs, sizes, slip_noise
from trackslip.identification.windows import WindowFit, fit_windows
from trackslip.intervals import FEWEST_BLOCKS
from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.families import DIFF_DRIVE, FAMILIES, family
from trackslip.se2 import Mounting

_LENGTHS: Final = (10.0, 5.0, 2.0, 1.0)  # candidate lengths of windows [s]
# prediction horizons that decide the window length and show how slip varies [s]
_COMPARED: Final = (1.0, 5.0)
_AS_SMALL: Final = 1.01  # ratio of prediction errors that doesn't matter
# difference of losses of fits in the same minimum, where residuals may be 1 % larger
_SAME_LOSS: Final = 0.01
# standard error above which a parameter is undetermined [standard deviations of its prior]
_VAGUE: Final = 0.5


@dataclass(frozen=True, kw_only=True, repr=False)
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
        values = self.fit.values[: len(self.values)]
        near = 0.3 * scale  # a fit may stop before it reaches a limit
        is_low = (values < low + near) & (low != 0)
        is_high = values > high - near
        at_limit = is_low | is_high
        return tuple(name for name, is_at in zip(self.values, at_limit, strict=True) if is_at)

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

    Of a given `sensor`, only its distance ahead of the turning centre is estimated, as nobody can
    measure where that is; the motion's lag behind the belts is estimated only with `lag`.

    `reference` is an existing fit of REFERENCE to the same drives; without it, REFERENCE is
    fitted first, from the values by name in `start` (by default gains and clock from regression).
    Without radius_error in `start`, the prior for it is narrow.
    """
    # the reference law decides the length of the windows, and where other laws start
    if reference is None:
        reference = _reference(Drives.smooth(drives), geometry, sensor, start, lag)
    if name == REFERENCE:
        return reference

    # the same model with the other law
    first = reference.fit
    model = replace(first.model, family=family(name))
    held = held_parameters(model, first.drives, sensor, lag)
    mean = prior_means(model, sensor)
    extras = [*reference.extras.values()]
    starts = [
        np.array([*of_law, *extras]) for of_law in _law_starts(name, geometry, reference.values)
    ]
    if "offset_left" in model.names and not reference.sits_aside:
        for values in starts:
            values[model.index("sensor_y")] = mean[model.index("sensor_y")]
    if model.far:
        return _fit_between_far_poses(model, reference, starts[0], held, mean)

    # A law that contains the reference law can't fit worse. If it does, it ended in another minimum
    # and is fitted from other starts, too.
    best: WindowFit | None = None
    for values in starts:
        fit = fit_runs(model, first.drives, first.length, values, held, mean)
        if best is None or fit.loss < best.loss:
            best = fit
        if best.loss < first.loss + _SAME_LOSS:
            break
    assert best is not None
    return _described(best, held, reference.pairs)


def _fit_between_far_poses(
    model: DriveModel,
    reference: DriveFit,
    values: Array,
    held: Mapping[str, str],
    mean: Array,
) -> DriveFit:
    """Fit a law to the same poses, far apart, as the `reference`, from start `values` (p,).

    Equal radii may fit too badly to show that the driving determines the mean radius. So the prior
    for the radii of `diff_drive` is broad, unless they then are undetermined.
    """
    broad = DriveModel.radius_prior
    priors = [model.radius_prior]
    if model.family is FAMILIES[DIFF_DRIVE]:
        priors.insert(0, broad)
    first = reference.fit
    for prior in priors:
        model = replace(model, radius_prior=prior)
        start = start_between_far_poses(model, first.drives, values, held, mean)
        fit = fit_windows(model, first.drives, first.length, start, held, mean)
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
    is_far = are_far_apart(drives) and bool(drives.known.any(axis=1).all())
    is_machined = machined or not (is_far or "radius_error" in start)
    prior = MACHINED if is_machined else DriveModel.radius_prior
    has_gyro = drives.gyro is not None
    model = DriveModel(FAMILIES[REFERENCE], geometry, has_gyro, prior, is_far)
    held = held_parameters(model, drives, sensor, lag)
    mean = prior_means(model, sensor)

    values = mean.copy()
    for name, value in start.items():
        is_given = sensor is not None and name.startswith("sensor")
        if name not in held and not is_given:
            values[model.index(name)] = value
    if is_far:
        values = start_between_far_poses(model, drives, values, held, mean, OFFSETS)

    # without headings, front and rear may look alike: try both
    starts = [values]
    has_headings = bool(drives.known[1].any())
    if not has_headings and "sensor_x" not in held and "sensor_y" not in held:
        starts = [values.copy(), values.copy()]
        starts[0][model.index("sensor_x")] = geometry.half_gauge
        starts[1][model.index("sensor_x")] = -geometry.half_gauge

    pairs = Pairs.of(drives, geometry)
    best: DriveFit | None = None
    for length in _lengths(drives):
        fits = [
            _described(fit_runs(model, drives, length, values, held, mean), held, pairs)
            for values in starts
        ]
        fit = min(fits, key=_size)
        if best is not None and _size(best) <= _AS_SMALL * _size(fit):
            break
        best = fit
    assert best is not None
    if is_far and not is_machined and "radius_error" in best.held:
        return _reference(drives, geometry, sensor, start, lag, machined=True)
    return best


def _lengths(drives: Drives) -> list[float]:
    """Window lengths [s], longest first, that fit into the drives and leave enough blocks for
    confidence intervals.
    """
    longest_drive = max(float(drive.time[-1] - drive.time[0]) for drive in drives.drives)
    blocks = {length: int(drives.blocks(2 * length)[-1]) + 1 for length in _LENGTHS}
    shortest = _LENGTHS[-1]
    enough = min(FEWEST_BLOCKS, blocks[shortest])
    fitting = [
        length for length, count in blocks.items() if length <= longest_drive and count >= enough
    ]
    return fitting or [shortest]


def _size(fit: DriveFit) -> float:
    """Geometric mean of a fit's mean errors in position and heading at the compared horizons; 0
    without errors.
    """
    size = sizes(fit.missed)
    horizon = fit.pairs.horizon
    compared = set(horizon) & set(_COMPARED) or set(horizon)
    logarithms = list[float]()
    for ahead in sorted(compared):
        for errors in size[horizon == ahead].T:
            known = errors[np.isfinite(errors)]
            if len(known):
                logarithms.append(float(np.log(known.mean() + 1e-12)))
    return float(np.exp(np.mean(logarithms))) if logarithms else 0.0


def held_parameters(
    model: DriveModel, drives: Drives, sensor: Mounting | None = None, lag: bool = False
) -> dict[str, str]:
    """The parameters that are not fitted to the drives, with a reason for each."""
    held = dict[str, str]()
    if not drives.known[1].any():
        held["sensor_yaw"] = "no headings were measured"
    if not drives.known[0].any():
        law_names = model.family.names
        lengths = [name for name in law_names if name.startswith(("radius_error", "turn_loss"))]
        held |= dict.fromkeys(("sensor_x", "sensor_y", "drift", *lengths), NO_POSITIONS)
    most_poses = np.diff(drives.first).max()
    if most_poses <= 2:
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
        mean[model.index("sensor_x")] = sensor.x
        mean[model.index("sensor_y")] = sensor.y
        mean[model.index("sensor_yaw")] = sensor.yaw
    return mean


def _law_starts(
    name: str, geometry: RobotGeometry, reference: Mapping[str, float]
) -> list[list[float]]:
    """Values from which fits of a law start: first those with which it predicts nearly the same
    motion as the reference law, then those of its family, as far as they differ.
    """
    names = FAMILIES[name].names
    of_family = FAMILIES[name].starts(geometry.half_gauge).tolist()
    like_reference = []
    for key, value in zip(names, of_family[0], strict=True):
        of_both_sides = key.removesuffix("_left").removesuffix("_right")
        like_reference.append(reference.get(of_both_sides, value))
    return [like_reference, *of_family] if names else [like_reference]


def _described(fit: WindowFit, held: Mapping[str, str], pairs: Pairs) -> DriveFit:
    """Make a DriveFit from a fit in windows: the law's values, intervals and prediction errors."""
    model = fit.model
    names = [model.names[k] for k in fit.free]

    # parameters whose standard errors exceed half the prior's are undetermined; with too few
    # blocks, only the errors for independent residuals are known
    covariance = fit.covariance
    variance = np.fmax(np.diag(covariance), np.diag(fit.inverse))
    is_vague = np.sqrt(variance) > _VAGUE / np.sqrt(fit.prior)
    vague = [name for name, of_name in zip(names, is_vague, strict=True) if of_name]
    errors = Uncertainty.of(
        names, fit.values[fit.free], covariance, fit.quantile, model.limits[:2, fit.free]
    )

    # values of the law, and of the other parameters
    extras = dict(zip(model.names, fit.values.tolist(), strict=True))
    values = {name: extras.pop(name) for name in model.family.names}

    # errors of predictions, and the noise that they show
    missed = pairs.held_out_errors(fit)
    position, heading, turn = fit.spread.tolist()
    noise = {"position": position, "heading": heading}
    noise |= slip_noise(missed, pairs, fit.spread, _COMPARED)
    if model.gyro:
        noise["gyro"] = turn / np.sqrt(fit.drives.drives[0].interval)

    return DriveFit(
        name=next(name for name, family in FAMILIES.items() if family is model.family),
        law=model.family.build(values, model.geometry),
        values=values,
        stderr=errors.stderr,
        interval95=errors.interval95,
        correlation=errors.correlation,
        held={**held, **dict.fromkeys(vague, "the driving doesn't determine it")},
        extras=extras,
        noise=noise,
        poses=int(fit.drives.known.any(axis=0).sum()),
        blocks=len(fit.score),
        fit=fit,
        missed=missed,
        pairs=pairs,
    )
