"""Check of units and signs: a robot moves about as far as its sprockets drive, and in their direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.drive.drives import Drive
from trackslip.identification.drive.start import reckoned
from trackslip.identification.plausibility import unit_guess
from trackslip.kinematics import Array, RobotGeometry, body_twist

_WINDOW = 2.0  # over which ways are compared [s]
_MIN_WINDOWS = 5
_LIMITS = (0.2, 3.0)  # plausible ratios of measured to commanded ways
_BACKWARDS = -0.3  # ratio below which a robot drives the other way round
_TURN_LIMIT = 5.0  # largest plausible ratio of measured to commanded turns
_MIN_SHARE = 0.1  # rms commanded way of a window, in half gauges, below which the robot only spins


def require_units(drives: Sequence[Drive], geometry: RobotGeometry) -> None:
    """Raise LogError if the poses move or turn much farther or less far than the sprockets drive, or the other way."""
    parts = [_ways(drive, geometry) for drive in drives]
    real, commanded = (np.concatenate(part) for part in zip(*parts, strict=True))
    if len(real) < _MIN_WINDOWS or np.sqrt(np.mean(commanded[:, 0] ** 2)) < _MIN_SHARE * geometry.half_gauge:
        return
    way = _slope(real[:, 0], commanded[:, 0])
    known = np.isfinite(real[:, 1])
    turn = _slope(real[known, 1], commanded[known, 1]) if known.any() else 1.0
    if way < _BACKWARDS:
        raise LogError(
            "the robot moves backwards where its sprockets drive forwards: are both encoders swapped and reversed, or "
            "does phi point backwards?"
        )
    if _LIMITS[0] <= way <= _LIMITS[1] and turn <= _TURN_LIMIT:
        return
    wrong = f"turn {turn:.3g} times as far" if _LIMITS[0] <= way <= _LIMITS[1] else f"move {way:.3g} times as far"
    guess = unit_guess(np.ones(2), np.array([way, turn]))
    raise LogError(
        f"the poses {wrong} as the sprockets drive: check the units (rad/s, m, rad, s), the gear and "
        f"sprocket_radius = {geometry.sprocket_radius:g} m{guess}"
    )


def _slope(real: Array, commanded: Array) -> float:
    """Ratio of measured to commanded values (n,) in least squares; 1 if nothing is commanded."""
    power = float(commanded @ commanded)
    return float(real @ commanded) / power if power > 0 else 1.0


def _ways(drive: Drive, geometry: RobotGeometry) -> tuple[Array, Array]:
    """Measured and commanded ways [m] and turns [rad] (n, 2) in windows; without headings, sizes of ways and NaN."""
    v = body_twist(drive.omega, 0.0, geometry)[:, 0]
    driven = np.concatenate([[0.0], np.cumsum(v * np.diff(drive.edges))])
    rows = np.flatnonzero(np.isfinite(drive.pose).all(axis=1) if drive.has_heading else np.isfinite(drive.pose[:, 0]))
    if len(rows) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    z, phi = drive.pose[rows, 0] + 1j * drive.pose[rows, 1], drive.pose[rows, 2]
    ends = np.arange(0, len(rows), max(1, round(_WINDOW / drive.interval)))
    turned = np.diff(reckoned(drive, geometry, 1.0, drive.time[rows[ends]])[1])
    way = np.diff(np.interp(drive.time[rows[ends]], drive.edges, driven))
    if not drive.has_heading:
        unknown = np.full(len(way), np.nan)
        return np.column_stack([np.abs(np.diff(z[ends])), unknown]), np.column_stack([np.abs(way), turned])
    forward = np.concatenate([[0.0], np.cumsum((np.diff(z) * np.exp(-0.5j * (phi[1:] + phi[:-1]))).real)])
    return np.column_stack([np.diff(forward[ends]), np.diff(phi[ends])]), np.column_stack([way, turned])
