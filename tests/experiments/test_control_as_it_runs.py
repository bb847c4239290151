"""What track and benchmark say of slow controllers, late commands, lost poses and top speeds."""

import numpy as np
import pytest
from own_clock import Clock

from experiments.cli import main
from trackslip.kinematics import RobotGeometry
from trackslip.laws.file import save_laws
from trackslip.laws.icr import ConstantIcr
from trackslip.logs.logfile import read_runs

CONTROLLERS = """
import time as clock
import numpy as np
from trackslip.controllers.feedback import LinearTimeVarying

class InSense(LinearTimeVarying):
    def sense(self, omega):
        clock.sleep(0.06)

class Stateful:
    def reset(self):
        self.omega = None

    def sense(self, omega):
        self.omega = omega

    def twist(self, time, pose, reference):
        clock.sleep(0.06)
        return np.tile(reference.twist(time), (len(self.omega), 1))

class Later(LinearTimeVarying):
    def twist(self, time, pose, reference):
        if time > 2:
            clock.sleep(0.06)
        return super().twist(time, pose, reference)

class SlowThenBroken(Later):
    def twist(self, time, pose, reference):
        if time > 3:
            raise RuntimeError("out of order")
        return super().twist(time, pose, reference)
"""
CIRCLE = ("--reference", "circle", "--circle-duration", "5", "--localization", "truth")
ALONE = ("--compensations", "none", "--grounds", "stone", "--plants", "nominal")
TIGHT = ("--circle-radius", "0.5")
UNCOMPENSATED = ("--compensation", "none")
BLIND = ("--reference", "circle", "--scanner.max-range", "1")


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A module with slow controllers in the current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "tardy.py").write_text(CONTROLLERS)


@pytest.mark.usefixtures("mine")
@pytest.mark.slow
def test_benchmark_warns_of_every_slow_controller(trackslip, short):
    names = [f"tardy:{name}" for name in ("InSense", "Stateful", "Later", "SlowThenBroken")]
    chosen = ("--controllers", "linear", *names, "--seeds", "0", "1")
    result = trackslip("benchmark", *short, *ALONE, *chosen, "--gains", "default")
    timing = result.summary["timing"]
    for name in names[:3]:
        assert 0.06 <= timing["step_s"][name] < 0.1
    for name in names:
        assert 0.06 <= timing["p99_step_s"][name] <= timing["worst_step_s"][name]
        assert f"Warning: {name} takes" in result.printed
    assert timing["step_s"]["linear"] < 0.02
    assert "Warning: linear takes" not in result.printed
    assert len(result.summary["failures"]) == 2
    assert "RuntimeError: out of order" in result.printed


def test_measured_times_are_apart_from_results(trackslip, short):
    chosen = ("--controllers", "linear", "--seeds", "0", "1", "--gains", "default")
    results = [trackslip("benchmark", *short, *ALONE, *chosen) for _ in range(2)]
    first, second = (result.summary for result in results)
    assert first["timing"].keys() == second["timing"].keys()
    for key in first.keys() - {"timing"}:
        assert first[key] == second[key], key
    files = [(result.folder / "runs.parquet").read_bytes() for result in results]
    assert files[0] == files[1]


@pytest.fixture
def clock(monkeypatch):
    """A clock that only controllers advance, by the time that they ask to sleep."""
    ours = Clock()
    monkeypatch.setattr("sim.runs.loop.time", ours)
    monkeypatch.setattr("time.sleep", ours.sleep)


@pytest.mark.usefixtures("mine", "clock")
def test_track_times_its_run_and_applies_the_time(trackslip):
    circle = (*CIRCLE, "--circle-duration", "3")
    slow = trackslip("track", *circle, "--controller", "tardy:InSense")
    assert slow.summary["timing"]["step_s"] == pytest.approx(0.06)
    assert "Warning: tardy:InSense takes 60 ms (99 %; 60 ms at worst) a step" in slow.printed
    assert "but commands are due every 50 ms" in slow.printed
    measured = trackslip(
        "track", *circle, "--controller", "tardy:InSense", "--command-delay", "measured"
    )
    given = trackslip("track", *circle, "--command-delay", "0.06")
    unhurried, late, as_late = (
        result.summary["tracking"][0]["max_position"] for result in (slow, measured, given)
    )
    assert late > 1.3 * unhurried
    assert late == pytest.approx(as_late)


@pytest.mark.parametrize(
    ("delay", "allowed"),
    [
        ("0.033", "a multiple of drive.period = 0.01 s"),
        ("-0.01", "from 0 to 1 s"),
        ("1.5", "from 0 to 1 s"),
    ],
)
@pytest.mark.parametrize("command", ["track", "benchmark"])
def test_delays_that_a_servo_cannot_have_are_refused(command, delay, allowed, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main([command, "--command-delay", delay, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    assert f"command_delay = {float(delay)}: must be {allowed}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_blind_run_with_its_law_stays_within_a_centimetre(trackslip):
    result = trackslip("track", *BLIND, "--compensation", "icr_radius")
    (errors,) = result.summary["tracking"]
    assert result.summary["localization"]["valid_fraction"] == 0
    assert errors["max_position"] < 0.01


def test_a_lost_robot_stops_when_asked(trackslip):
    stopped = trackslip("track", *BLIND, "--circle-duration", "5", "--when-lost", "stop")
    (log,) = read_runs(stopped.folder / "runs.parquet")
    assert log.command[:10].all()
    assert not log.command[11:].any()
    assert np.ptp(log.truth.pose[-20:, :2], axis=0).max() < 1e-3


def test_a_search_for_gains_takes_no_measured_times(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["tune", "linear", "--command-delay", "measured", "--out", str(tmp_path / "out")])
    assert "command_delay = 'measured': must be a time [s]" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ("--circle-speed", "0.29", "--circle-radius", "0.5", "--reference", "circle"),
            "circle_speed = 0.29: must be at most 0.211 m/s on this circle: the faster track takes "
            "0.411 m/s at 0.0 s, and drive.top_speed is 0.3 m/s",
        ),
        (
            (*UNCOMPENSATED, "--reference", "circle", "--circle-speed", "0.25", *TIGHT),
            "circle_speed = 0.25: must be at most 0.224 m/s on this circle",
        ),
        (
            ("--drive.top-speed", "0.16"),
            "reference = 'paper': must be slow enough for the robot, at most 0.137 instead of 0.15",
        ),
    ],
)
def test_track_refuses_references_that_are_too_fast(options, message, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["track", *options, "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_law_in_laws_decides_how_fast_a_reference_may_be(tmp_path, capsys):
    slippery = {"icr_radius": ConstantIcr(0.4, 0.168)}
    save_laws(tmp_path / "mine.json", slippery, RobotGeometry(0.168, 0.06))
    with pytest.raises(SystemExit):
        main(["track", "--laws", str(tmp_path / "mine.json"), "--reference", "figure_eight"])
    assert "reference = 'figure_eight': must be slow enough" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["benchmark", "tune"])
def test_references_too_fast_for_the_robot_are_refused(command, tmp_path, capsys):
    words = ["linear"] if command == "tune" else ["--references", "paper", "slalom"]
    with pytest.raises(SystemExit) as stop:
        main([command, *words, "--drive.top-speed", "0.19", "--out", str(tmp_path / "out")])
    assert stop.value.code == 2
    assert "references = 'slalom': must be slow enough for the robot" in capsys.readouterr().err


def test_set_points_at_the_top_speed_are_told(trackslip, short):
    tight = ("--circle-speed", "0.22", *TIGHT)
    result = trackslip("track", *CIRCLE, *tight, *UNCOMPENSATED)
    said = "Warning: run 'linear none': set points at the top speed for 9"
    assert said in result.printed
    tight = ("--drive.top-speed", "0.17", "--seeds", "0", "--controllers", "linear")
    tight += ("--starts", "paper")
    board = trackslip("benchmark", *short, *ALONE, *tight)
    (entry,) = board.summary["board"]
    assert entry["saturation"] > 0.05
    assert (
        "Warning: set points at the top speed, or motors at their limits, for 5% of the time or "
        "more in 1 of 1 entries" in board.printed
    )
