"""Parameters of candidates."""

import numpy as np
import pytest

from sim.calibration.candidate import PARAMETERS, Candidate


@pytest.mark.parametrize("name", ["lag", "delay", "droop", "shear", "clock"])
def test_limits_are_met_despite_rounding(name):
    one = PARAMETERS[name]
    for start in np.linspace(0.21, 0.4, 40).tolist():
        base = Candidate().with_values({name: start / 10 if name == "shear" else start})
        for limit in one.limits(base):
            value = one.unscaled(base, limit)
            assert one.low <= value <= one.high
            assert base.with_values({name: value}).value(name) == value
