"""`trackslip reproduce` when a closed loop fails: it leaves the grid, and the closed loops until then."""

import json

import numpy as np
import pytest

from experiments.cli import main
from trackslip.controllers.linear import LinearTimeVarying
from trackslip.controllers.named import CONTROLLERS
from trackslip.logs.logfile import read_runs

SMALL = ("--radii", "0.6", "1.5", "--speeds", "0.1", "0.2", "--duration", "8")


class Stubborn(LinearTimeVarying):
    def twist(self, time, pose, reference):
        if np.max(time) > 2.0:
            raise RuntimeError("I have had enough")
        return super().twist(time, pose, reference)


@pytest.mark.usefixtures("few_resamples")
def test_a_closed_loop_that_fails_leaves_all_runs_until_then(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(CONTROLLERS, "linear", Stubborn)
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as stop:
        main(["reproduce", *SMALL, "--threads", "1", "--out", str(out)])
    captured = capsys.readouterr()
    line = captured.err.strip().splitlines()[-1]  # progress may come before
    assert stop.value.code == 2
    assert captured.out == ""
    assert line.startswith("trackslip: run 'linear none': its controller fails at 2.05 s (RuntimeError: I have had")
    assert line.endswith(f"{out} contains the runs until then")
    assert {path.name for path in out.iterdir()} == {"manifest.json", "runs.parquet"}
    error = json.loads((out / "manifest.json").read_text())["error"]
    assert error in line
    logs = {log.run: log for log in read_runs(out / "runs.parquet")}
    loops = [log for log in logs.values() if "controller" in log.metadata]
    driven = [log for log in logs.values() if "controller" not in log.metadata]
    assert [(log.metadata["radius"], log.metadata["speed"]) for log in driven] == [
        (0.6, 0.1), (0.6, 0.2), (1.5, 0.1), (1.5, 0.2)
    ]  # fmt: skip
    assert all(log.time[-1] > 7.9 and "failure" not in log.metadata for log in driven)
    assert {log.metadata["controller"] for log in loops} == {"feedforward", "linear"}
    assert all(1.9 < log.time[-1] <= 2.05 for log in loops)
    assert logs["linear none"].metadata["failure"] == error
