import numpy as np
import pytest

from experiments.wander.drives import drive_contents
from sim.wander.motion import Motion
from trackslip import se2
from trackslip.logs.logfile import read_runs
from trackslip.logs.runlog import RunLog, Truth


@pytest.mark.parametrize("driving", ["random", "eights", "stop_and_go", "loop"])
def test_each_driving_in_the_simulator(trackslip, driving):
    result = trackslip("wander", "--driving", driving, "--drives", "2", "--duration", "6")
    logs = read_runs(result.folder / "runs.parquet")
    assert [log.run for log in logs] == [f"{driving} 1", f"{driving} 2"]
    for log in logs:
        assert 55 <= log.valid.sum() <= 60  # 10 Hz; the last come after the encoders' end
        late = np.hypot(*(log.pose - log.truth.pose)[log.valid, :2].T)
        assert late.max() < 0.02 * 5 + 0.3 * 0.12  # noise, and the way in the clock's delay
        assert {"lrf", "scanner"}.isdisjoint(log.metadata)  # SLAM measured the poses
    assert f"trackslip identify {result.folder}" in result.printed


def test_distances_turns_and_rests_are_summed():
    twist = np.repeat([[0.2, 0.0, 0.5], [0.1, 0.0, -1.0], [0.0, 0.0, 0.0]], [200, 100, 100], axis=0)
    time, pose = np.arange(401) / 100, se2.chain(np.zeros(3), se2.exp(twist * 0.01))
    valid = np.arange(401) % 5 == 0
    truth = Truth(Motion(time, pose).pose, np.concatenate([np.zeros((1, 3)), twist]))
    log = RunLog("drive", time, np.zeros((401, 2)), pose, valid=valid, truth=truth)
    contents = drive_contents(log)
    assert (contents["readings"], contents["poses"]) == (401, 81)
    measured = [contents[name] for name in ("way", "turned_left", "turned_right", "standing")]
    np.testing.assert_allclose(measured, (0.5, 1.0, 1.0, 0.25), rtol=1e-4)
