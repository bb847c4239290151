"""Runs that share a slip law, and runs that don't."""

from dataclasses import replace

import numpy as np
import pytest

from trackslip.errors import LogError
from trackslip.identification.source import source_of_runs
from trackslip.logs.runlog import RunLog

GROUND = {"along": 0.7, "across": 0.778, "slope": 0.0, "uphill": 0.0, "shear": 0.01}
GEOMETRY = {"half_gauge": 0.168, "sprocket_radius": 0.06}


def run(loads: bool = True, **changed: float) -> RunLog:
    time = np.arange(0, 5, 0.05)
    log = RunLog("run", time, np.ones((100, 2)), np.zeros((100, 3)), load=np.zeros((100, 2)) if loads else None)
    return replace(log, metadata={"geometry": GEOMETRY, "ground": GROUND | changed})


def test_runs_that_tell_their_loads_may_differ_in_slope():
    (note,) = source_of_runs([run(), run(slope=0.1, uphill=1.0)]).notes
    assert note == "its runs differ in ground (slope, uphill): only icr_load takes that into account"
    assert source_of_runs([run(), run()]).notes == ()


@pytest.mark.parametrize(
    ("runs", "named"),
    [
        ([run(), run(loads=False, slope=0.1)], "slope"),
        ([run(), run(shear=0.02)], "shear"),
        ([run(), run(slope=0.1, along=0.6)], "along, slope"),
    ],
)
def test_other_differences_are_refused(runs, named):
    with pytest.raises(LogError, match=rf"differ in ground \({named}\): choose with --where"):
        source_of_runs(runs)
