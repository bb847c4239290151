"""Stored laws of every family, and twists to compare them at."""

import numpy as np

from trackslip.kinematics import Array, RobotGeometry
from trackslip.laws.file import StoredLaws, laws_content, stored_laws

GEOMETRY = RobotGeometry(0.168, 0.06)
VALUES = {
    "icr": {"offset": 0.0436},
    "icr_radius": {"offset": 0.045, "radius_error": 0.0067},
    "two_gains": {"offset": 0.045, "radius_error": 0.0067},
    "diff_drive": {"offset": 0.045, "radius_error_left": 0.005, "radius_error_right": -0.012},
    "icr_sides": {
        "offset_left": 0.04,
        "offset_right": 0.05,
        "radius_error_left": 0.005,
        "radius_error_right": -0.012,
    },
    "turn_loss": {"offset": 0.045, "radius_error": 0.0067, "turn_loss": 0.3},
    "turn_loss_sides": {
        "offset": 0.045,
        "radius_error_left": 0.005,
        "radius_error_right": -0.012,
        "turn_loss": 0.3,
    },
    "centrifugal": {
        "offset": 0.045,
        "radius_error": 0.0067,
        "turn_loss": 0.3,
        "centrifugal_slip": 0.3,
    },
    "exponential": {
        "alpha_outer": 0.0814,
        "beta_outer": -0.892,
        "alpha_inner": -0.184,
        "beta_inner": -0.854,
    },
    "exponential_speed": {
        "alpha_outer": 0.0815,
        "beta_outer": -0.892,
        "alpha_inner": -0.183,
        "beta_inner": -0.854,
        "gamma_outer": 0.1,
        "gamma_inner": -0.2,
    },
}
"""Parameters of a law of each family that has any."""


def stored(values=VALUES, **content) -> StoredLaws:
    """Laws as if they had been read from a file called laws.json."""
    laws = {name: {"values": dict(one)} for name, one in values.items()}
    return stored_laws(laws_content(laws, GEOMETRY) | content, "laws.json")


def twists(count: int, seed: int = 0) -> Array:
    """Twists (n, 2): at rest, straight, in place, on pivots about a track, slow, fast, and `count`
    at random.
    """
    rng = np.random.default_rng(seed)
    b = GEOMETRY.half_gauge
    at_rest = (0, 0)
    straight = [(0.2, 0), (-0.2, 0), (0.1, 1e-12)]
    in_place = [(0, 0.5), (0, -0.5), (1e-9, 0.5), (-1e-9, 0.5)]
    pivots = [(0.4 * b, -0.4), (-0.4 * b, 0.4), (-0.4 * b, -0.4), (0.4 * b, 0.4)]
    fast = (3.0, 8.0)
    special = np.array([at_rest, *straight, *in_place, *pivots, fast], float)
    size = 10 ** rng.uniform(-4, 0.5, count)
    direction = rng.uniform(-np.pi, np.pi, count)
    v = size * np.cos(direction)
    w = size * np.sin(direction) / b
    return np.concatenate([special, np.stack([v, w], axis=-1)])
