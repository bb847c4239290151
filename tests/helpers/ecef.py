"""Places on WGS 84, by the textbook."""

from __future__ import annotations

import numpy as np


def ecef(latitude, longitude, height):
    """Earth-centred coordinates of a geodetic place on WGS 84."""
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    phi, lam = np.radians(latitude), np.radians(longitude)
    n = a / np.sqrt(1 - e2 * np.sin(phi) ** 2)
    across = (n + height) * np.cos(phi)
    return np.stack([across * np.cos(lam), across * np.sin(lam), (n * (1 - e2) + height) * np.sin(phi)], axis=-1)
