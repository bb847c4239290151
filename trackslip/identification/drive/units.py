"""Check of units and signs: a robot moves about as far as its sprockets drive, and in their direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.drive.drives import Drive
from trackslip.identification.drive.start import reckoned
from trackslip.identification.plausibility import unit_guess
from trackslip.kinematics import Array, RobotGeometry

_WINDOW = 5.0  # over which ways are compared [s]
_MIN_WINDOWS = 3
_SHORT = 1.0  # over which directions are compared [s]
_BACKWARDS = -0.3  # ratio of measured to commanded forward ways below which a robot drives the other way round
_LIMITS = (0.2, 3.0)  # plausible ratios of measured to commanded ways
_TURN_LIMIT = 5.0  # largest plausible ratio of measured to commanded turns


def require_units(drives: Sequence[Drive], geometry: RobotGeometry) -> None:
    """Raise LogError if the poses move or turn much farther or less far than the sprockets drive, or the other way."""
    forward, driven = (np.concatenate(part) for part in zip(*(_forward(d, geometry) for d in drives), strict=True))
    if len(forward) >= _MIN_WINDOWS and forward @ driven < _BACKWARDS * (driven @ driven):
        raise LogError(
            "the robot moves backwards where its sprockets drive forwards: are both encoders swapped and reversed, or "
            "does phi point backwards?"
        )
    real, commanded = (np.concatenate(part) for part in zip(*(_ways(drive, geometry) for drive in drives), strict=True))
    if len(real) < _MIN_WINDOWS or commanded[:, 0].max() < geometry.half_gauge / 2:  # too little, or spinning
        return
    long = commanded[:, 0] >= commanded[:, 0].max() / 2
    way = float(np.median(real[long, 0] / np.maximum(commanded[long, 0], 1e-9)))
    known = np.isfinite(real[:, 1]) & (commanded[:, 1] >= commanded[:, 1].max() / 2) & (commanded[:, 1] > 0)
    turn = float(np.median(real[known, 1] / commanded[known, 1])) if known.any() else 1.0
    if _LIMITS[0] <= way <= _LIMITS[1] and turn <= _TURN_LIMIT:
        return
    wrong = f"move {way:.3g} times as far" if not _LIMITS[0] <= way <= _LIMITS[1] else f"turn {turn:.3g} times as far"
    guess = unit_guess(np.ones(2), np.array([way, turn]))
    raise LogError(
        f"the poses {wrong} as the sprockets drive: check the units (rad/s, m, rad, s), the gear and "
        f"sprocket_radius = {geometry.sprocket_radius:g} m{guess}"
    )


def _forward(drive: Drive, geometry: RobotGeometry) -> tuple[Array, Array]:
    """Measured and commanded forward ways (n,) in short windows [m]; empty without headings."""
    rows = np.flatnonzero(np.isfinite(drive.pose).all(axis=1))
    rows = rows[:: max(1, round(_SHORT / drive.interval))]
    place, heading = reckoned(drive, geometry, 1.0, drive.time[rows])
    z, phi = drive.pose[rows, 0] + 1j * drive.pose[rows, 1], drive.pose[rows, 2]
    real, commanded = (
        (np.diff(at) * np.exp(-0.5j * (turned[1:] + turned[:-1]))).real for at, turned in ((z, phi), (place, heading))
    )
    near = np.diff(drive.time[rows]) < 3 * _SHORT
    return real[near], commanded[near]


def _ways(drive: Drive, geometry: RobotGeometry) -> tuple[Array, Array]:
    """Measured and commanded ways [m] and turns [rad] (n, 2) in windows; turns are NaN without headings."""
    rows = np.flatnonzero(np.isfinite(drive.pose[:, 0]))
    size = min(max(1, round(_WINDOW / drive.interval)), len(rows) - 1)
    rows = rows[::size]
    place, heading = reckoned(drive, geometry, 1.0, drive.time[rows])
    z = drive.pose[rows, 0] + 1j * drive.pose[rows, 1]
    real = np.column_stack([np.abs(np.diff(z)), np.abs(np.diff(drive.pose[rows, 2]))])
    return real, np.column_stack([np.abs(np.diff(place)), np.abs(np.diff(heading))])
