"""`trackslip track`: one run in closed loop, and runs that fail."""

import json

import numpy as np
import pytest

from experiments.cli import main
from trackslip.kinematics import RobotGeometry
from trackslip.logs.logfile import read_runs
from trackslip.slip.icr import ConstantIcr
from trackslip.slip.law_file import save_laws

CIRCLE = ("--reference", "circle", "--circle-duration", "6")
STUBBORN = """
import numpy as np

class Stubborn:
    def reset(self):
        self.steps = 0

    def twist(self, time, pose, reference):
        if time > 2.0:
            raise RuntimeError("I have had enough")
        return np.tile(reference.twist(time), (len(pose), 1))
"""


@pytest.mark.parametrize("controller", ["feedforward", "linear"])
@pytest.mark.parametrize("localization", ["plate", "line", "truth"])
def test_track(trackslip, controller, localization):
    options = ("--controller", controller, "--compensation", "icr", "--localization", localization)
    result = trackslip("track", *options, "--reference", "circle", "--circle-duration", "14", "--circle-radius", "1.0")
    (row,) = result.summary["tracking"]
    assert (row["controller"], row["compensation"], row["localization"]) == (controller, "icr", localization)
    assert row["rms_position"] < 0.05
    assert row["rms_position_after_12s"] > 0


def test_track_takes_a_start_and_laws(trackslip, tmp_path):
    save_laws(tmp_path / "mine.json", {"icr_radius": ConstantIcr(0.1, 0.168)}, RobotGeometry(0.168, 0.06))
    options = ("--start", "-1.5", "0.2", "0.0", "--compensation", "icr_radius", "--laws", str(tmp_path / "mine.json"))
    (log,) = read_runs(trackslip("track", *CIRCLE, *options).folder / "runs.parquet")
    np.testing.assert_allclose(log.truth.pose[0], [-1.5, 0.2, 0.0], atol=1e-9)
    v, w = log.twist_command[100]
    np.testing.assert_allclose(log.command[100], (v + np.array([-1, 1]) * (0.168 + 0.1) * w) / 0.06, rtol=1e-9)


@pytest.fixture
def stubborn(tmp_path, monkeypatch):
    (tmp_path / "stubborn_driver.py").write_text(STUBBORN)
    monkeypatch.chdir(tmp_path)
    return "stubborn_driver:Stubborn"


def test_a_controller_that_raises_leaves_its_run_and_its_recording(tmp_path, capsys, stubborn):
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stop:
        main(["track", "--controller", stubborn, *CIRCLE, "--rrd", "--out", str(out)])
    line = capsys.readouterr().err.strip().splitlines()[-1]  # progress may come before
    assert stop.value.code == 2
    assert "its controller fails at 2.05 s (RuntimeError: I have had enough)" in line
    assert line.endswith(f"{out} contains the runs until then")
    assert {path.name for path in out.iterdir()} == {"manifest.json", "runs.parquet", "recordings"}
    error = json.loads((out / "manifest.json").read_text())["error"]
    assert error in line
    (log,) = read_runs(out / "runs.parquet")
    assert log.metadata["failure"] == error
    assert 1.9 < log.time[-1] <= 2.05
    assert len(list((out / "recordings").glob("*.rrd"))) == 1
