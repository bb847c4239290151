"""`trackslip view`: which runs it shows, and how."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rrd import component, verify

from experiments.cli import main
from experiments.recording.run import parameters_of
from experiments.recording.viewer import choose
from sim.robot.parameters import RobotParameters
from trackslip.errors import LogError
from trackslip.logs.logfile import write_csv


def test_view_of_a_real_robots_log(driven, tmp_path, capsys):
    bare = [replace(log, truth=None, metadata={}, covariance=None, command=None, scans=None) for log in driven[1]]
    write_csv(bare, tmp_path / "real.csv")
    file = tmp_path / "a real.rrd"
    main(["view", str(tmp_path / "real.csv"), "--save", str(file)])
    said = capsys.readouterr().out
    assert "2 runs; showing 'linear none'" in said
    assert f"; rerun '{file}'" in said  # as a shell takes it
    verify(file)
    _, translation = component(file, "/run/robot/chassis", "translation")
    np.testing.assert_allclose(translation[:, :2], bare[0].pose[:, :2], atol=1e-6)
    assert parameters_of(bare[0]) == RobotParameters()


def test_view_chooses_by_name_or_id(driven):
    ids = ("abcd12", "abce34")
    logs = [replace(log, metadata=log.metadata | {"id": i}) for log, i in zip(driven[1], ids, strict=True)]
    path = Path("runs")
    assert choose(logs, ["abce34", "linear none"], path) == [logs[1], logs[0]]
    assert choose(logs, ["abcd"], path) == [logs[0]]
    with pytest.raises(LogError, match=r"2 runs whose id begins with 'abc'; there are 'linear none' \(id abcd12\), "):
        choose(logs, ["abc"], path)
    for unknown in ("abcx", ""):
        with pytest.raises(LogError, match="no run '"):
            choose(logs, [unknown], path)
    with pytest.raises(LogError, match="are the same"):
        choose(logs, ["abcd", "linear none"], path)


def test_view_refuses(driven, refused, monkeypatch):
    folder = str(driven[0] / "none")
    assert refused("view", folder, "--run", "other").endswith("no run 'other'; there are 'linear none'")
    assert "a file that ends in .rrd" in refused("view", folder, "--save", "x.txt")
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    assert "doesn't start; try --web, or --save FILE" in refused("view", folder)
