"""What is plotted over time, and `trackslip view`: which runs it shows, and how."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rrd import component, verify

from experiments.cli import main
from experiments.recording.run import panels, parameters_of
from experiments.recording.traces import traces_of
from experiments.recording.viewer import choose
from sim.robot.parameters import RobotParameters
from trackslip.errors import LogError
from trackslip.kinematics import RobotGeometry, limit_sprocket_speeds
from trackslip.logs.logfile import write_csv
from trackslip.slip.exponential import ExponentialSpeed


def test_slips_agree_in_steady_turns(driven):
    traces = traces_of(driven[1][1])
    steady = slice(160, 260)
    for other in (traces.identified, traces.law):
        np.testing.assert_allclose(np.nanmean(other[steady], axis=0), traces.slip[steady].mean(axis=0), atol=0.01)
    assert traces.law_name == "icr_radius"
    assert traces.moment > 11.9
    assert traces.distance[0] == pytest.approx(np.hypot(0.1, 0.1), abs=1e-6)  # the circle is the one that was asked for


def test_the_law_shown_is_the_one_that_compensated(driven):
    """Also one from a file of the user's, and one that depends on speed."""
    log = driven[1][0]
    geometry = RobotGeometry(**log.metadata["geometry"])
    law = ExponentialSpeed(0.12, -0.9, -0.3, -1.1, gamma_outer=0.2, gamma_inner=-0.3)
    limit = log.metadata["drive"]["top_speed"] / geometry.sprocket_radius
    command = limit_sprocket_speeds(law.sprocket_speeds(log.twist_command, geometry), limit)
    traces = traces_of(replace(log, command=command, metadata=log.metadata | {"compensation": "exponential"}))
    slip = law.slip(log.twist_command)
    shown = np.isfinite(traces.law)
    assert shown.mean() > 0.8
    np.testing.assert_allclose(traces.law[shown], slip[shown], atol=1e-9)
    assert not shown[np.abs(command).max(axis=1) >= limit].any()  # scaled down: it can't be told there
    assert traces.law_name == "exponential"


def test_slips_are_on_their_axis(driven):
    traces = traces_of(driven[1][1])
    slip = {panel.title: panel.range for panel in panels([traces]) if "lip" in panel.title}
    assert slip == {"Slip [-]": (-0.25, 0.20)}
    more = replace(traces, slip=np.tile([-0.7, 0.3], (len(traces.time), 1)))
    for runs in ([more], [traces, more]):
        ranges = [panel.range for panel in panels(runs) if "slip/true" in panel.entities]
        assert all(low < -0.7 and high > 0.3 for low, high in ranges)


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
