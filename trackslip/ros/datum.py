"""Latitude and longitude of places in a local plane, on the ellipsoid WGS 84."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array

_A, _F = 6_378_137.0, 1 / 298.257223563  # equatorial radius [m] and flattening of WGS 84
_E2 = _F * (2 - _F)  # eccentricity squared
_B = _A * (1 - _F)


@dataclass(frozen=True)
class Datum:
    """The point at which a local plane, x to the east and y to the north, touches the ellipsoid or one parallel to it.

    The default is a field anywhere.
    """

    latitude: float = 52.0
    """Geodetic latitude [deg]."""
    longitude: float = 10.0
    """Longitude [deg]."""
    altitude: float = 0.0
    """Height above the ellipsoid [m]."""

    def geodetic(self, position: Array) -> Array:
        """Latitude [deg], longitude [deg] and height [m] (..., 3) of positions (..., 2) in the plane [m].

        From Earth-centred coordinates by Bowring's formula, whose error is below a nanometre on the ground.
        """
        latitude, longitude = np.radians(self.latitude), np.radians(self.longitude)
        sin, cos = np.sin(latitude), np.cos(latitude)
        across = _A / np.sqrt(1 - _E2 * sin**2)  # radius of curvature in the prime vertical
        east, north = np.moveaxis(position, -1, 0)
        out = (across + self.altitude) * cos - sin * north  # from the axis, in the meridian of the datum
        up = (across * (1 - _E2) + self.altitude) * sin + cos * north
        from_axis = np.hypot(out, east)
        reduced = np.arctan2(up * _A, from_axis * _B)
        found = np.arctan2(
            up + _E2 / (1 - _E2) * _B * np.sin(reduced) ** 3, from_axis - _E2 * _A * np.cos(reduced) ** 3
        )
        across = _A / np.sqrt(1 - _E2 * np.sin(found) ** 2)
        height = from_axis * np.cos(found) + up * np.sin(found) - _A**2 / across
        return np.stack([np.degrees(found), np.degrees(longitude + np.arctan2(east, out)), height], axis=-1)
