"""Latitudes and longitudes of places in a plane."""

from __future__ import annotations

import numpy as np
import pytest
from ecef import ecef

from trackslip.ros.datum import Datum


@pytest.mark.parametrize("datum", [Datum(), Datum(-33.0, 179.9999, 1500.0), Datum(0.0, 0.0), Datum(89.9, -70.0)])
def test_places_of_fixes_by_earth_centred_coordinates(datum):
    place = np.random.default_rng(0).uniform(-2000, 2000, (100, 2))
    phi, lam = np.radians([datum.latitude, datum.longitude])
    east = np.array([-np.sin(lam), np.cos(lam), 0])
    north = np.array([-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)])
    from_datum = ecef(*datum.geodetic(place).T) - ecef(datum.latitude, datum.longitude, datum.altitude)
    np.testing.assert_allclose(from_datum @ np.stack([east, north]).T, place, atol=1e-7)
    np.testing.assert_allclose(from_datum @ np.cross(east, north), 0, atol=1e-7)
