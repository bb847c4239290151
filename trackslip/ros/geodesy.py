"""Places on the ellipsoid WGS 84 and on a plane that touches it, x to the east and y to the north."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trackslip.kinematics import Array

_A, _F = 6_378_137.0, 1 / 298.257223563  # equatorial radius [m] and flattening of WGS 84
_E2 = _F * (2 - _F)  # eccentricity squared
_B = _A * (1 - _F)  # polar radius [m]
FIELD = np.array([52.0, 10.0, 0.0])
"""Latitude [deg], longitude [deg] and height [m] of a field anywhere."""


def to_plane(geodetic: Array, origin: ArrayLike) -> Array:
    """Places (..., 2) east and north [m] of latitudes [deg], longitudes [deg] and heights [m] (..., 3).

    The plane touches the ellipsoid, or one parallel to it, at the `origin` (3,).
    """
    return np.asarray((_earth_centred(geodetic) - _earth_centred(origin)) @ _east_north(origin))


def from_plane(place: Array, origin: ArrayLike) -> Array:
    """Latitude [deg], longitude [deg] and height [m] (..., 3) of places (..., 2) [m] in the plane: see `to_plane`.

    By Bowring's formula, whose error is below a nanometre on the ground.
    """
    x, y, axis = np.moveaxis(_earth_centred(origin) + place @ _east_north(origin).T, -1, 0)
    from_axis = np.hypot(x, y)
    reduced = np.arctan2(axis * _A, from_axis * _B)
    latitude = np.arctan2(
        axis + _E2 / (1 - _E2) * _B * np.sin(reduced) ** 3, from_axis - _E2 * _A * np.cos(reduced) ** 3
    )
    height = from_axis * np.cos(latitude) + axis * np.sin(latitude) - _A**2 / _vertical(latitude)
    return np.stack([np.degrees(latitude), np.degrees(np.arctan2(y, x)), height], axis=-1)


def _earth_centred(geodetic: ArrayLike) -> Array:
    """Earth-centred places (..., 3) [m]."""
    latitude, longitude, height = np.moveaxis(np.asarray(geodetic, float) * [np.pi / 180, np.pi / 180, 1], -1, 0)
    across = (_vertical(latitude) + height) * np.cos(latitude)
    axis = (_vertical(latitude) * (1 - _E2) + height) * np.sin(latitude)
    return np.stack([across * np.cos(longitude), across * np.sin(longitude), axis], axis=-1)


def _vertical(latitude: ArrayLike) -> Array:
    """Radii of curvature in the prime vertical [m] at latitudes [rad]."""
    return np.asarray(_A / np.sqrt(1 - _E2 * np.sin(latitude) ** 2))


def _east_north(origin: ArrayLike) -> Array:
    """The directions (3, 2) to the east and to the north, Earth-centred."""
    latitude, longitude, _ = np.radians(origin)
    (sin, cos), (sine, cosine) = ((np.sin(angle), np.cos(angle)) for angle in (latitude, longitude))
    return np.array([[-sine, -sin * cosine], [cosine, -sin * sine], [0.0, cos]])
