"""The mounting of the poses' sensor: twists at the robot's centre, and estimates of the mounting from the driving.

A sensor at (x, y), whose heading is turned by psi, moves in its own frame at

    v_s = cos psi (v - y w) + sin psi x w        u_s = -sin psi (v - y w) + cos psi x w

where the robot turns without drifting sideways. Without v, that is u_s = -tan psi v_s + x w / cos psi: two slopes,
from which psi and x follow. Here x is ahead of the centre of turning; how far that lies ahead of the middle of the
robot does not show in its motion. An offset y to the left makes the ICRs seem unequal, D - y on the left and D + y on
the right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from trackslip.errors import InvalidValueError, LogError, require
from trackslip.identification.fitted import SteadyFit, fit_law
from trackslip.identification.lack_of_fit import by_command
from trackslip.identification.outliers import split_outliers
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import Array, RobotGeometry, track_slip
from trackslip.se2 import Mounting

_MIN_SIDE = 3  # minimum number of turns to each side
_CERTAIN = 3.0  # size of a value that is no chance [standard errors]
_KNOWN = {"x": 0.05, "y": 0.05, "yaw": 0.02}  # standard errors of undetermined values, in half gauges and rad
_MATTERS = {"y": 0.005, "yaw": 0.002}  # values that are corrected by default, likewise
_NAMES = {"x": "place ahead of the centre of turning", "y": "offset to the left", "yaw": "mounting angle"}


@dataclass(frozen=True)
class SensorEstimate:
    """The sensor's place and mounting, as far as the driving determines them."""

    sensor: Mounting
    """The estimates; 0 where the driving does not determine them."""
    stderr: Mapping[str, float] = field(default_factory=dict)
    """Standard errors of `x`, `y` [m] and `yaw` [rad], where they are determined."""
    reasons: Mapping[str, str] = field(default_factory=dict)
    """Reasons why the others are not."""


def corrected(samples: SlipSamples, sensor: Mounting, geometry: RobotGeometry) -> SlipSamples:
    """Samples measured by a sensor as those at the robot's centre, with their errors.

    Without lateral speeds, the sensor is taken to move sideways as in a turn about the robot's centre. Raises
    InvalidValueError for a sensor that looks sideways or back.
    """
    require(abs(sensor.yaw) < np.pi / 2, "sensor.yaw", sensor.yaw, "between -pi/2 and pi/2")
    cos, sin = np.cos(sensor.yaw), np.sin(sensor.yaw)
    v, w = samples.twist.T
    if samples.lateral is None or samples.lateral_stderr is None:
        forward, gradient = (v - sin * sensor.x * w) / cos, (1 / cos, sensor.y - np.tan(sensor.yaw) * sensor.x)
        lateral, noise = None, 0.0
    else:
        forward, gradient = cos * v - sin * samples.lateral, (cos, sensor.y)
        lateral, noise = sin * v + cos * samples.lateral - sensor.x * w, (sin * samples.lateral_stderr) ** 2
    twist = np.column_stack([forward + sensor.y * w, w])
    covariance = samples.covariance
    if covariance is not None:
        turn = np.array([gradient, (0.0, 1.0)])
        covariance = turn @ covariance @ turn.T
        covariance[:, 0, 0] += noise
    slip = track_slip(samples.omega, twist, geometry)
    return replace(samples, twist=twist, slip=slip, covariance=covariance, lateral=lateral)


def estimate_sensor(samples: SlipSamples, geometry: RobotGeometry) -> SensorEstimate:
    """The sensor's mounting and place from lateral speeds, and its offset from turns to both sides, for equal ICRs."""
    samples, _ = split_outliers(samples, geometry, ("icr_sides",))
    values, stderr, reasons = _from_lateral(samples, geometry)
    straight = corrected(samples, Mounting(yaw=values.get("yaw", 0.0)), geometry)
    offset = _offset(straight, geometry)
    if isinstance(offset, str):
        reasons["y"] = offset
    else:
        values["y"], stderr["y"] = offset
    return SensorEstimate(Mounting(**values), stderr, reasons)


def with_sensor(
    samples: SlipSamples, geometry: RobotGeometry, given: Mounting | None = None, estimate: bool | None = None
) -> tuple[SlipSamples, SensorEstimate | None, tuple[str, ...]]:
    """Samples at the robot's centre, what was found of the sensor, and what a reader should know of it, a line each.

    A sensor that is `given` is taken as it is. With `estimate` None, estimates are used where they come from turns to
    both sides and are neither chance nor negligible; with True wherever the driving determines them; with False the
    sensor is taken to be at the centre. Raises InvalidValueError for a sensor that is given and to be estimated.
    """
    if given is not None:
        if estimate:
            raise InvalidValueError("estimate_sensor", estimate, "left out where the sensor is given")
        return corrected(samples, given, geometry), None, ()
    if estimate is False:
        return samples, None, ()
    found = estimate_sensor(samples, geometry)
    used = [name for name in found.stderr if estimate or _worth_correcting(name, found, geometry)]
    if "y" not in found.stderr and not estimate:
        used = []
    sensor = Mounting(**{name: getattr(found.sensor, name) for name in used})
    notes = [_told(name, found) for name in used]
    notes += [
        f"sensor: its {_NAMES[name]} is taken as 0: {why}"
        for name, why in found.reasons.items()
        if estimate or name in _MATTERS
    ]
    return corrected(samples, sensor, geometry) if used else samples, found, tuple(notes)


def offset_between_sides(law: SteadyFit) -> tuple[float, float]:
    """(D_right - D_left) / 2 of the law icr_sides and its standard error [m]: the sensor's offset, for equal ICRs."""
    left, right = (list(law.values).index(f"offset_{side}") for side in ("left", "right"))
    errors = law.stderr["offset_left"], law.stderr["offset_right"]
    shared = 2 * float(law.correlation[left, right]) * errors[0] * errors[1]
    variance = errors[0] ** 2 + errors[1] ** 2 - shared
    return (law.values["offset_right"] - law.values["offset_left"]) / 2, max(variance, 0.0) ** 0.5 / 2


def _from_lateral(
    samples: SlipSamples, geometry: RobotGeometry
) -> tuple[dict[str, float], dict[str, float], dict[str, str]]:
    """Values, standard errors and reasons of x and yaw."""
    if samples.lateral is None or samples.lateral_stderr is None:
        return {}, {}, dict.fromkeys(("x", "yaw"), "the lateral speed was not measured")
    if by_command(samples.omega, geometry).max() == 0:
        return {}, {}, dict.fromkeys(("x", "yaw"), "on circles of one radius they can't be told apart")
    design = np.column_stack([samples.twist[:, 1] * geometry.half_gauge, -samples.twist[:, 0]])  # of x / b and yaw
    speed = geometry.sprocket_radius * np.abs(samples.omega).max(axis=1)
    slopes, covariance = _line(design, samples.lateral, samples.lateral_stderr, speed)
    yaw = float(np.arctan(slopes[1]))
    found = {"x": float(slopes[0] * np.cos(yaw) * geometry.half_gauge), "yaw": yaw}
    relative = dict(zip(("x", "yaw"), np.sqrt(np.diag(covariance)).tolist(), strict=True))
    reasons = {
        name: f"its standard error is {error:.2g} {'rad' if name == 'yaw' else 'half gauges'}"
        for name, error in relative.items()
        if not error < _KNOWN[name]
    }
    stderr = {"x": relative["x"] * geometry.half_gauge, "yaw": relative["yaw"]}
    known = [name for name in found if name not in reasons]
    return {name: found[name] for name in known}, {name: stderr[name] for name in known}, reasons


def _line(design: Array, lateral: Array, stderr: Array, speed: Array) -> tuple[Array, Array]:
    """Weighted least squares, and the covariance (p, p) from the residuals (HC3).

    Runs scatter by their errors of measurement and by a share of their speed, which is estimated.
    """
    scatter = 0.0
    for _ in range(10):
        weight = 1 / np.maximum(stderr**2 + (scatter * speed) ** 2, 1e-24)
        bread = np.linalg.pinv(np.einsum("ni,n,nj->ij", design, weight, design), hermitian=True)
        slopes = bread @ (design.T @ (weight * lateral))
        residual = lateral - design @ slopes
        excess = float(np.mean((residual**2 * len(lateral) / max(len(lateral) - 2, 1) - stderr**2) / speed**2))
        scatter = max(excess, 0.0) ** 0.5
    leverage = np.einsum("ni,ij,nj->n", design, bread, design) * weight
    scores = design * (weight * residual / np.maximum(1 - leverage, 1e-3))[:, None]
    return slopes, bread @ np.maximum(scores.T @ scores, 0) @ bread


def _offset(samples: SlipSamples, geometry: RobotGeometry) -> tuple[float, float] | str:
    """The sensor's offset and its standard error [m], or why there is none."""
    turning = np.sign(samples.omega[:, 1] - samples.omega[:, 0])
    if min((turning > 0).sum(), (turning < 0).sum()) < _MIN_SIDE:
        return "with turns to one side only, D and an offset of the sensor to the left can't be told apart"
    try:
        found, stderr = offset_between_sides(fit_law("icr_sides", samples, geometry, bootstraps=0))
    except LogError as error:
        return str(error)
    if not stderr < _KNOWN["y"] * geometry.half_gauge:
        return f"its standard error is {1e3 * stderr:.2g} mm"
    return found, stderr


def _worth_correcting(name: str, found: SensorEstimate, geometry: RobotGeometry) -> bool:
    """True if an estimate is neither chance nor negligible; x alone changes no twist."""
    if name not in _MATTERS:
        return False
    least = _MATTERS[name] * (1 if name == "yaw" else geometry.half_gauge)
    return abs(getattr(found.sensor, name)) > max(_CERTAIN * found.stderr[name], least)


def _told(name: str, found: SensorEstimate) -> str:
    """A line on a correction."""
    value, error = getattr(found.sensor, name), found.stderr[name]
    if name == "yaw":
        turned = f"{np.degrees(abs(value)):.2f} ± {np.degrees(error):.2g}° to the {'left' if value > 0 else 'right'}"
        return f"sensor: its heading is turned {turned} of the robot's; corrected"
    size = f"{1e3 * abs(value):.1f} ± {1e3 * error:.2g} mm"
    if name == "x":
        return f"sensor: it sits {size} {'ahead of' if value > 0 else 'behind'} the centre of turning; corrected"
    return (
        f"sensor: it sits {size} to the {'left' if value > 0 else 'right'} of the middle, if the ICRs of both sides "
        "are equal: an offset and unequal ICRs can't be told apart; corrected"
    )
