import numpy as np
import pytest

from trackslip.logs.logfile import read_runs


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
    assert result.summary["timing"]["simulated_s"] == 2 * 6.0
    assert f"trackslip identify {result.folder}" in result.printed
