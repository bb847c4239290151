"""Latitudes and longitudes on a local plane."""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array

_RADIUS = 6_378_137.0  # equatorial radius of WGS 84 [m]
_FLATTENING = 1 / 298.257223563  # of WGS 84
_SQUARE = _FLATTENING * (2 - _FLATTENING)  # square of its eccentricity


def local_plane(latitude: Array, longitude: Array, altitude: Array) -> Array:
    """Positions (n, 2) east and north of the first one [m], on the plane that touches the ellipsoid there.

    Args:
        latitude: (n,) geodetic, of WGS 84 [deg].
        longitude: (n,) [deg].
        altitude: (n,) above the ellipsoid [m].
    """
    place = _earth_centred(np.radians(latitude), np.radians(longitude), altitude)
    north, east = np.radians(latitude[0]), np.radians(longitude[0])
    to_east = np.array([-np.sin(east), np.cos(east), 0.0])
    to_north = np.array([-np.sin(north) * np.cos(east), -np.sin(north) * np.sin(east), np.cos(north)])
    return np.asarray((place - place[0]) @ np.stack([to_east, to_north], axis=-1))


def _earth_centred(latitude: Array, longitude: Array, altitude: Array) -> Array:
    """Positions (n, 3) from the centre of the earth [m] of latitudes and longitudes (n,) [rad]."""
    vertical = _RADIUS / np.sqrt(1 - _SQUARE * np.sin(latitude) ** 2)
    around = (vertical + altitude) * np.cos(latitude)
    axis = (vertical * (1 - _SQUARE) + altitude) * np.sin(latitude)
    return np.stack([around * np.cos(longitude), around * np.sin(longitude), axis], axis=-1)
