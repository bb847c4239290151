"""`trackslip track`: one run in closed loop, and runs that fail."""

import json

import numpy as np
import pytest

from experiments.cli import main
from trackslip.logs.logfile import read_runs

SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")
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
    circle = ("--reference", "circle", "--circle-duration", "14", "--circle-radius", "1.0")
    result = trackslip("track", *options, *circle)
    (row,) = result.summary["tracking"]
    assert (row["controller"], row["compensation"], row["localization"]) == (controller, "icr", localization)
    assert row["rms_position"] < 0.05
    assert row["rms_position_after_12s"] > 0


@pytest.mark.usefixtures("few_resamples")
def test_track_takes_a_start_and_laws(trackslip):
    identified = trackslip("identify", str(trackslip("grid", *SMALL).folder)).folder
    result = trackslip(
        "track", "--reference", "circle", "--circle-duration", "6", "--start", "-1.5", "0.2", "0.0",
        "--compensation", "exponential", "--laws", str(identified),
    )  # fmt: skip
    log = read_runs(result.folder / "runs.parquet")[0]
    np.testing.assert_allclose(log.truth.pose[0], [-1.5, 0.2, 0.0], atol=1e-9)
    assert result.manifest["config"]["start"] == [-1.5, 0.2, 0.0]


@pytest.fixture
def stubborn(tmp_path, monkeypatch):
    (tmp_path / "stubborn_driver.py").write_text(STUBBORN)
    monkeypatch.chdir(tmp_path)
    return "stubborn_driver:Stubborn"


@pytest.mark.parametrize("recorded", [True, False])
def test_a_controller_that_raises_leaves_its_run(tmp_path, capsys, stubborn, recorded):
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stop:
        main(["track", "--controller", stubborn, *CIRCLE, *(("--rrd",) if recorded else ()), "--out", str(out)])
    line = capsys.readouterr().err.strip().splitlines()[-1]  # progress may come before
    assert stop.value.code == 2
    assert "its controller fails at 2.05 s (RuntimeError: I have had enough)" in line
    assert line.endswith(f"{out} contains the runs until then")
    assert {path.name for path in out.iterdir()} == {"manifest.json", "runs.parquet"} | (
        {"recordings"} if recorded else set()
    )
    error = json.loads((out / "manifest.json").read_text())["error"]
    assert error in line
    (log,) = read_runs(out / "runs.parquet")
    assert log.metadata["failure"] == error
    assert 1.9 < log.time[-1] <= 2.05
    if recorded:
        assert len(list((out / "recordings").glob("*.rrd"))) == 1


def test_results_replace_those_of_a_failed_run(tmp_path, stubborn):
    out = tmp_path / "out"
    with pytest.raises(SystemExit):
        main(["track", "--controller", stubborn, *CIRCLE, "--out", str(out)])
    main(["track", *CIRCLE, "--out", str(out)])
    assert {path.name for path in out.iterdir()} == {"manifest.json", "runs.parquet", "summary.json"}
    assert "error" not in json.loads((out / "manifest.json").read_text())
