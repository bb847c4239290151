"""Random numbers that depend on the root seed and on what a run is, not on the run's position in a list."""

from __future__ import annotations

import hashlib

import numpy as np


def generator(seed: int, key: str) -> np.random.Generator:
    """Random number generator of the run described by `key`, for the root `seed` (>= 0)."""
    words = np.frombuffer(hashlib.sha256(key.encode()).digest(), dtype="<u4")
    return np.random.default_rng([seed, *(int(word) for word in words)])
