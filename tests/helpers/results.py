"""Results of environments, compared."""

import numpy as np
from gymnasium.utils.env_checker import data_equivalence


def assert_same(one, two):
    """Fail unless two tuples of arrays and infos are equal to the bit."""
    for a, b in zip(one, two, strict=True):
        if isinstance(a, dict):
            assert a.keys() == b.keys()
            for key in a:
                assert data_equivalence(a[key], b[key], exact=True), key
        else:
            np.testing.assert_array_equal(a, b)
