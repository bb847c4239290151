import csv
import json

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from experiments.common.table import significant
from trackslip.planning import plan as planning

SHORT = ("--half-gauge", "0.168", "--sprocket-radius", "0.06", "--duration", "30")


@pytest.fixture(autouse=True)
def few_routes(monkeypatch):
    monkeypatch.setattr(planning, "MAX_EVALUATIONS", 30)
    monkeypatch.setattr(planning, "MIN_EVALUATIONS", 30)


def test_commands_are_those_without_slip_and_the_bag_has_them(trackslip):
    result = trackslip("plan", *SHORT, "--topic", "/base/cmd_vel")
    with (result.folder / "plan.csv").open(newline="") as stream:
        _, *rows = csv.reader(stream)
    t, left, right, v, w = np.array(rows, float).T
    np.testing.assert_allclose(v, 0.06 * (left + right) / 2, atol=1e-5)
    np.testing.assert_allclose(w, 0.06 * (right - left) / (2 * 0.168), atol=1e-4)
    assert max(np.abs(left).max(), np.abs(right).max()) * 0.06 <= 0.3 + 1e-6
    with AnyReader([result.folder / "bags" / "cmd_vel.mcap"]) as reader:
        (connection,) = reader.connections
        assert connection.topic == "/base/cmd_vel"
        assert connection.msgtype == "geometry_msgs/msg/TwistStamped"
        sent = [
            (1e-9 * at, reader.deserialize(raw, connection.msgtype))
            for _, at, raw in reader.messages()
        ]
    arrived = np.array([at for at, _ in sent])
    np.testing.assert_allclose(arrived - arrived[0], t, atol=1e-5)
    stamps = [message.header.stamp for _, message in sent]
    assert all(stamp.sec == 0 and stamp.nanosec == 0 for stamp in stamps)  # as of arrival
    twists = [(message.twist.linear.x, message.twist.angular.z) for _, message in sent]
    np.testing.assert_allclose(twists, np.column_stack([v, w]), atol=1e-4)


@pytest.mark.usefixtures("with_figures")
def test_the_page_says_how_well_the_law_will_be_known(trackslip):
    result = trackslip("plan", *SHORT)
    assert {path.name for path in (result.folder / "figures").iterdir()} == {
        "plan_path.svg",
        "plan_belts.svg",
    }
    report = (result.folder / "report.html").read_text()
    error = significant(1e3 * result.summary["stderr"]["offset"], "mm")
    assert f"30 s of driving will determine D ± {error} and ε ± " in report
    for text in (report.replace("<span>", "").replace("</span>", ""), result.printed):
        assert "trackslip identify LOG --half-gauge 0.168 --sprocket-radius 0.06" in text


def test_a_second_round_takes_the_robot_and_the_law_of_the_first(trackslip, tmp_path):
    law = {
        "values": {"offset": 0.04, "radius_error": 0.01},
        "stderr": {"offset": 1e-3, "radius_error": 1e-3},
    }
    geometry = {"half_gauge": 0.168, "sprocket_radius": 0.06}
    content = {"format": 1, "geometry": geometry, "slip_laws": {"icr_radius": law}}
    (tmp_path / "known.json").write_text(json.dumps(content))
    result = trackslip(
        "plan", "--after", str(tmp_path / "known.json"), "--duration", "20", "--no-bag"
    )
    assert result.summary["values"] == law["values"]
    assert result.summary["stderr"]["radius_error"] < 1e-3
    assert result.summary["knowledge"]["reach_doubt"] == pytest.approx(4e-3 / 0.208)
    assert not (result.folder / "bags").exists()
