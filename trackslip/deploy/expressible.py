"""Which laws the parameters of a differential drive can express, and what to take instead of the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.deploy.constants import icrs, is_linear
from trackslip.deploy.prediction import best_of, measured_cost
from trackslip.errors import LogError, TrackslipError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.metrics import rms
from trackslip.slip.base import SlipLaw
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.stored_laws import NO_SLIP, StoredLaws

_RADII = (3.0, 20.0)  # of the turns in which laws are compared where no prediction was measured [half gauges]
_SPEED = 0.2  # in them [m/s]


@dataclass(frozen=True)
class DifferentialDrive:
    """A law with constant ICRs as parameters of wheels that do not slip."""

    separation_multiplier: float
    """(b + D) / b: distance of the wheels over the gauge of the tracks, for the mean D of both tracks [-]."""
    left_radius_multiplier: float
    """1 + epsilon of the left sprocket [-]."""
    right_radius_multiplier: float
    """1 + epsilon of the right sprocket [-]."""
    middle: float
    """How far the point midway between the ICRs lies to the left of the middle of the tracks [m]."""


def differential_drive(stored: StoredLaws, name: str) -> DifferentialDrive:
    """The parameters by which a differential drive moves as a linear law says.

    Where the D of the tracks differ, it is the point midway between the ICRs that moves so.
    """
    (left, right), (error_left, error_right) = icrs(stored.values(name))
    b = stored.geometry.half_gauge
    return DifferentialDrive((b + (left + right) / 2) / b, 1 + error_left, 1 + error_right, (left - right) / 2)


def require_expressible(stored: StoredLaws, name: str) -> DifferentialDrive:
    """The parameters of a law.

    Raises TrackslipError for a law that has none; the message names the nearest one that has, and what it costs.
    """
    if not is_linear(name):
        raise TrackslipError(f"law = {name!r}: ros2_control can only express constant ICRs; {nearest(stored, name)}")
    return differential_drive(stored, name)


def nearest_icr(law: SlipLaw, geometry: RobotGeometry) -> ConstantIcr:
    """The constant ICRs whose twists are nearest to those of a law in turns, by least squares."""
    twist = _turns(geometry)
    belt = geometry.sprocket_radius * law.sprocket_speeds(twist, geometry)
    mean, difference = belt.mean(axis=1), np.diff(belt)[:, 0] / 2
    scale = (twist[:, 0] @ mean) / (mean @ mean)
    reach = scale * (difference @ difference) / (twist[:, 1] @ difference)
    return ConstantIcr(float(reach) - geometry.half_gauge, geometry.half_gauge, float(scale) - 1)


def best_expressible(stored: StoredLaws) -> str:
    """The best law if a differential drive can express it, else the nearest one that it can, if there is one."""
    best = stored.law_named(None)
    able = _able(stored)
    return best if not able or is_linear(best) else best_of(stored, able)


def instead_of(stored: StoredLaws, name: str) -> str:
    """What taking a law instead of the best one costs, if that can't be expressed; else empty."""
    try:
        best = stored.law_named(None)
    except LogError:
        return ""
    if is_linear(best):
        return ""
    return f"The best law is {best}, which ros2_control can't express. Instead, {name}: {_cost(stored, best, name)}"


def nearest(stored: StoredLaws, name: str) -> str:
    """The law nearest to another one that a differential drive can express, and what it costs, in words."""
    law, geometry = stored.laws[name], stored.geometry
    if able := _able(stored):
        other = best_of(stored, able)
        return f"nearest in {stored.name} is {other} (--law {other}): {_cost(stored, name, other)}"
    icr = nearest_icr(law, geometry)
    return (
        f"{stored.name} holds none; nearest would be icr_radius with offset = {icr.offset:.4g} m and radius_error = "
        f"{icr.radius_error:.4g}: {_difference(law, icr, geometry)}"
    )


def _able(stored: StoredLaws) -> list[str]:
    """The identified laws that can be expressed."""
    return [name for name in stored.laws if name != NO_SLIP and is_linear(name)]


def _cost(stored: StoredLaws, law: str, nearest: str) -> str:
    measured = measured_cost(stored, law, nearest)
    return measured or _difference(stored.laws[law], stored.laws[nearest], stored.geometry)


def _difference(law: SlipLaw, other: SlipLaw, geometry: RobotGeometry) -> str:
    """How much worse another law predicts motion that follows a law."""
    twist = _turns(geometry)
    missed = other.twist(law.sprocket_speeds(twist, geometry), geometry) / twist - 1
    low, high = (factor * geometry.half_gauge for factor in _RADII)
    turns = f"in turns of {low:.2g} to {high:.2g} m radius"
    return f"its yaw rates are off by {rms(missed[:, 1]):.2%}, its speeds by {rms(missed[:, 0]):.2%} (rms) {turns}"


def _turns(geometry: RobotGeometry) -> Array:
    """Twists (n, 2) of turns to both sides."""
    radius = np.geomspace(*_RADII, 50) * geometry.half_gauge
    kappa = np.concatenate([1 / radius, -1 / radius])
    return np.stack([np.full(len(kappa), _SPEED), _SPEED * kappa], axis=-1)
