"""Laws fitted to drives: values, errors, intervals, and parameters that the driving does not determine."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trackslip.doubts import refuse
from trackslip.errors import LogError
from trackslip.identification.determined import undetermined_by_drives
from trackslip.identification.drive_equations import solve
from trackslip.identification.drive_fit import FIRST, TrajectoryFit, fit_trajectory, unlike_sprockets
from trackslip.identification.drive_model import EXTRAS, DriveModel
from trackslip.identification.drive_prediction import held_out_deviance
from trackslip.identification.drive_residuals import Nodes, Noise, cost, residuals
from trackslip.identification.drive_start import gyro_clock, law_start, starts, trajectory
from trackslip.identification.drives import PreparedDrive, drives_of
from trackslip.identification.fitted import FittedLaw
from trackslip.identification.intervals import half_widths, model_errors
from trackslip.identification.plausibility import require_units
from trackslip.kinematics import Array, RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.se2 import Mounting
from trackslip.slip.families import FAMILIES, family

REFERENCE = "icr_radius"
"""The law that is fitted first; others start from its trajectory, and its gates hold for all."""
_LAGS = (0.03, 0.3)  # starting values [s]
_CERTAIN = 3.0  # lag that shows [standard errors]
_TRIALS = 4  # steps after which a lag is given up unless it shows
_LIKELIER = 10.0  # fall of -2 log likelihood if poses that state their covariances count alike
_LAGGING = 4.0  # the same, that a lag must bring
_POINTS = 13
_WIDTH = 6.0  # of the profile on each side [standard errors]
_NEWTON_STEPS = 2  # of Gauss and Newton at each offset


@dataclass(frozen=True, kw_only=True)
class DriveFit(FittedLaw):
    """A law fitted to drives by maximum likelihood.

    Standard errors are those by the model of the noise; intervals are wider where slip lasts.
    """

    extras: dict[str, float]
    """The other parameters (see `drive_model.EXTRAS`), held ones included, in m, s and rad."""
    held: dict[str, str]
    """Parameters that were held, and why."""
    noise: dict[str, float]
    """Standard deviations: position [m], heading [rad], slip_forward, slip_sideways [m/√m], slip_turn [rad/√m].

    And position_by_speed and heading_by_yaw_rate [s], by which those of poses grow; with a gyro, also gyro [rad/√s].
    """
    poses: int
    """Poses used."""
    left_out: int
    """Poses left out as outlying."""
    breaks: int
    """Steps left out: lasting jumps of the poses, or slip out of all proportion."""
    converged: bool
    """True if the fit converged."""
    deviance: float
    """-2 log likelihood, but for a constant that all laws share [-]."""
    fit: TrajectoryFit
    """The fit in full, with the trajectory."""

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the fitted parameters."""
        return tuple(self.stderr)

    @property
    def at_limit(self) -> bool:
        """True if a parameter of the law is at its lower limit."""
        low = self.fit.model.limits[0][: len(self.values)]
        return bool((self.fit.values[: len(self.values)] <= low).any())


def fit_drives(
    name: str,
    drives: Sequence[RunLog] | Sequence[PreparedDrive],
    geometry: RobotGeometry,
    sensor: Mounting | None = None,
    held: Mapping[str, float] | None = None,
    reference: DriveFit | None = None,
) -> DriveFit:
    """Fit a law to whole drives by maximum likelihood.

    Args:
        name: of the law.
        drives: logs of drives, or prepared ones.
        geometry: nominal geometry of the robot.
        sensor: place and yaw of the sensor on the robot, if known; else estimated.
        held: extras to hold at a value, by name.
        reference: a fit of REFERENCE to the same drives, which saves fitting it again.

    Raises:
        LogError: if no drive can be used, or the driving doesn't determine the law.
        InvalidValueError: for an unknown law.
    """
    prepared = prepare(drives)
    if reference is None:
        reference = _reference(prepared, geometry, sensor, held or {})
    if name == REFERENCE:
        return reference
    first = reference.fit
    model = DriveModel(family(name), geometry, first.model.gyro)
    values = np.concatenate([law_start(name, first), first.values[len(first.model.family.names) :]])
    lagging = "lag" in reference.free
    return _fitted(model, first.nodes, first.states, values, first.noise, sensor, held or {}, False, lagging)


def prepare(drives: Sequence[RunLog] | Sequence[PreparedDrive]) -> list[PreparedDrive]:
    """Drives ready to be fitted; raises LogError if there is none."""
    ready = [drive for drive in drives if isinstance(drive, PreparedDrive)]
    return ready or drives_of([log for log in drives if isinstance(log, RunLog)])[0]


def _reference(
    drives: Sequence[PreparedDrive], geometry: RobotGeometry, sensor: Mounting | None, held: Mapping[str, float]
) -> DriveFit:
    """The fit of REFERENCE, with the poses' covariances if these make the poses likelier.

    And with a lag, if that makes poses likelier to which it wasn't fitted.
    """
    found = _without_lag(drives, geometry, sensor, held)
    if _likelier_alike(found.fit):
        found = _without_lag([replace(drive, whitening=None) for drive in drives], geometry, sensor, held)
    first = found.fit
    coarse = any(drive.coarse for drive in drives)
    if "lag" in held or coarse or "clock_offset" not in found.free or (tried := _lagged(first)) is None:
        return found
    try:
        lagging = _fitted(
            tried.model, tried.nodes, tried.states, tried.values, tried.noise, sensor, held, False, lagging=True
        )
        shown = "lag" in lagging.free and lagging.extras["lag"] > _CERTAIN * lagging.stderr["lag"]
        if not shown or lagging.deviance > found.deviance - _LAGGING:
            return found
        better = held_out_deviance(lagging.fit) < held_out_deviance(first)
    except LogError:
        return found
    return lagging if better else found


def _without_lag(
    drives: Sequence[PreparedDrive], geometry: RobotGeometry, sensor: Mounting | None, held: Mapping[str, float]
) -> DriveFit:
    """The likeliest of the fits from all starting values."""
    model = DriveModel(FAMILIES[REFERENCE], geometry, any(drive.gyro is not None for drive in drives))
    starting = starts(drives, geometry)
    require_units(drives, geometry)
    noise, fits, error = Noise(FIRST if model.gyro else FIRST[:-1]), [], None
    for offset, clock_offset in starting:
        values: Array = np.zeros(len(model.names))
        values[model.index("offset")], values[model.index("clock_offset")] = offset, clock_offset
        if model.gyro:
            values[model.index("gyro_clock")] = gyro_clock(drives, geometry, clock_offset)
        states = np.concatenate([trajectory(drive, geometry, offset, clock_offset) for drive in drives])
        try:
            fits.append(_fitted(model, Nodes.of(drives), states, values, noise, sensor, held, True, lagging=False))
        except LogError as one:
            error = error or one
    if error and not fits:
        raise error
    return min(fits, key=lambda fit: fit.deviance)


def _likelier_alike(found: TrajectoryFit) -> bool:
    """True if the poses of a fit that uses their covariances are clearly likelier with equal uncertainties."""
    if found.nodes.whitening is None:
        return False
    drives = tuple(replace(drive, whitening=None) for drive in found.nodes.drives)
    nodes = replace(found.nodes, drives=drives, whitening=None)
    alike = fit_trajectory(
        found.model, nodes, found.states, found.values, found.noise, found.free, found.mean, gated=False
    )
    return alike.deviance < found.deviance - _LIKELIER


def _lagged(found: TrajectoryFit) -> TrajectoryFit | None:
    """A few steps with a lag at unchanged noise, if the poses are likelier than without."""
    free, tried = np.append(found.free, found.model.index("lag")), []
    for lag in _LAGS:  # the motion begins later by as much
        values = found.values.copy()
        values[[found.model.index("lag"), found.model.index("clock_offset")]] += lag
        with contextlib.suppress(LogError):
            tried.append(
                fit_trajectory(
                    found.model,
                    found.nodes,
                    found.states,
                    values,
                    found.noise,
                    free,
                    found.mean,
                    gated=False,
                    quiet=True,
                    rounds=_TRIALS,
                )
            )
    best = min(tried, key=lambda fit: fit.deviance, default=found)
    return best if best.deviance < found.deviance - _LAGGING / 2 else None


def _fitted(
    model: DriveModel,
    nodes: Nodes,
    states: Array,
    values: Array,
    noise: Noise,
    sensor: Mounting | None,
    given: Mapping[str, float],
    gated: bool,
    lagging: bool,
) -> DriveFit:
    """Fit all parameters that are neither given nor known to be open, then hold what turns out not to be determined."""
    held = {name: "given" for name in given}
    values, mean = values.copy(), np.zeros(len(values))
    for name, value in given.items():
        values[model.index(name)] = value
    if sensor is not None:
        for name, value in (("sensor_x", sensor.x), ("sensor_y", sensor.y), ("sensor_yaw", sensor.yaw)):
            values[model.index(name)] = mean[model.index(name)] = value
        held |= dict.fromkeys(("sensor_y", "sensor_yaw"), "given")  # x is ahead of the turning centre, not the middle
    if not any(drive.has_heading for drive in nodes.drives):
        held.setdefault("sensor_yaw", "no headings were measured")
    if not lagging:
        coarse = any(drive.coarse for drive in nodes.drives)
        held.setdefault("lag", "encoders with so few ticks don't tell it" if coarse else "none shows")
    if "offset_left" in model.names:
        reason = "taken with equal ICRs: an offset of the sensor and unequal ICRs can't be told apart"
        held.setdefault("sensor_y", reason)
    while True:
        free = np.array([k for k, name in enumerate(model.names) if name not in held], int)
        found = fit_trajectory(model, nodes, states, values, noise, free, mean, gated=gated)
        vague = undetermined_by_drives(found)
        if vague is None and "gyro_clock" not in held and model.gyro:
            vague = "gyro_clock", "aligned with the turns of the poses"
        elif vague is None:
            described = _described(found, held)
            rough = all(described.stderr[name] > scale for name, scale in _changes(model) if name in described.stderr)
            if model.family.names and rough and (why := unlike_sprockets(found.noise, hopeless=True)):
                refuse("hopeless", nodes.drives[0].accept, why=why)
            return described
        name, reason = vague
        held[name] = reason if name == "gyro_clock" else f"not determined: {reason}"
        if model.family.names and held.keys() >= set(model.family.names):
            reason = unlike_sprockets(found.noise, hopeless=True) or reason
            raise LogError(f"the drives determine no parameter of the law: {reason}")
        nodes, states, noise = found.nodes, found.states, found.noise
        values, gated = found.values.copy(), False
        if name == "gyro_clock":
            continue
        if name in EXTRAS or model.limits[0][model.index(name)] <= 0 <= model.limits[1][model.index(name)]:
            values[model.index(name)] = mean[model.index(name)]


def _changes(model: DriveModel) -> list[tuple[str, float]]:
    """The law's parameters with changes that matter."""
    return list(zip(model.family.names, model.family.limits(model.geometry.half_gauge)[2].tolist(), strict=True))


def _described(found: TrajectoryFit, held: Mapping[str, str]) -> DriveFit:
    model = found.model
    law = len(model.family.names)
    parameters = dict(zip(model.family.names, found.values[:law].tolist(), strict=True))
    names = [model.names[k] for k in found.free]
    best = found.values[found.free]
    half, covariance = half_widths(found), found.covariance
    errors = model_errors(found)
    measured = Nodes.of(found.nodes.drives)
    return DriveFit(
        name=next(name for name, one in FAMILIES.items() if one is model.family),
        law=model.family.build(parameters, model.geometry),
        values=parameters,
        extras=dict(zip(model.extras, found.values[law:].tolist(), strict=True)),
        stderr=dict(zip(names, errors.tolist(), strict=True)),
        interval95={
            name: (float(value - width), float(value + width))
            for name, value, width in zip(names, best, half, strict=True)
        },
        held=dict(held),
        correlation=covariance / np.outer(errors, errors),
        noise=dict(zip(Noise.NAMES, found.noise.values.tolist(), strict=False)),
        poses=int((found.nodes.weight[:, 0] > 0).sum()),
        left_out=int((measured.weight[:, 0] * (found.nodes.weight[:, 0] == 0)).sum()),
        breaks=int((measured.link * (found.nodes.link == 0)).sum()),
        converged=found.converged,
        deviance=found.deviance,
        fit=found,
    )


@dataclass(frozen=True)
class ClockProfile:
    """Rise of -2 log likelihood with the clock offset."""

    offset: Array  # (n,) encoder clock minus pose clock [s]
    rise: Array  # (n,) [-]


def clock_profile(fit: TrajectoryFit) -> ClockProfile:
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
        for _ in range(_NEWTON_STEPS):
            found = residuals(model, nodes, states, values, free)
            step = solve(found, nodes, fit.noise, yaw, model.prior, values - fit.mean)
            values[free] = np.clip(values[free] + step.values, low[free], high[free])
            states = states + step.states
        found = residuals(model, nodes, states, values, free[:0])
        rise.append(cost(found.weighted_as(fit.residuals), nodes, fit.noise) - least)
    return ClockProfile(offsets, np.array(rise))
