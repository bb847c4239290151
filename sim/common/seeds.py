"""Random numbers that depend on a root seed and on a run's description, but not on its position in
a list.
"""

from __future__ import annotations

import hashlib

import numpy as np


def generator(seed: int, key: str) -> np.random.Generator:
    """Generator for the run described by `key`, with the root `seed` (>= 0)."""
    words = np.frombuffer(hashlib.sha256(key.encode()).digest(), dtype="<u4")
    return np.random.default_rng([seed, *(int(word) for word in words)])
