from dataclasses import replace

import pytest

from experiments.common.plain_json import plain
from experiments.common.results import RUNS_FILE
from sim.robot.named import load_parameters
from trackslip.logs.logfile import read_runs
from trackslip.skid_theory import line_contact, steady_turns


def test_a_tracked_robot_is_identified_and_controlled(trackslip):
    robot = ("--robot", "rescue")
    runs = trackslip(
        "grid", *robot, "--radii", "0.6", "1.2", "--speeds", "0.1", "0.2", "--duration", "6"
    )
    laws = trackslip("identify", str(runs.folder))
    parameters, ground = load_parameters(robot[1])
    size = parameters.half_gauge, parameters.contact_length / 2
    contact = line_contact(*size, ground.along, ground.across, parameters.centre_of_mass)
    theory = steady_turns([0.8, 1.5], contact).offset.mean()
    assert laws.summary["slip_laws"]["icr_radius"]["values"]["offset"] == pytest.approx(
        theory, rel=0.01
    )
    circle = ("--reference", "circle", "--circle-duration", "22", "--localization", "truth")

    def error(*compensation):
        result = trackslip("track", *robot, *circle, "--compensation", *compensation)
        (row,) = result.summary["tracking"]
        return row["rms_position_after_12s"]

    assert error("icr_radius", "--laws", str(laws.folder)) < 0.3 * error("none")


def test_a_robot_has_its_drive_and_ground_in_every_command(trackslip, refused, tmp_path):
    """A heavy robot, too much for the shipped motors; options change single fields."""
    heavy = tmp_path / "heavy.toml"
    heavy.write_text(
        "half_gauge = 0.28\ncontact_length = 0.5\nsprocket_radius = 0.1\nmass = "
        "75.0\nradius_error = 0.03\n"
        "[ground]\nalong = 0.5\nacross = 0.6\n[drive]\nlag = 0.3\ntop_speed = 1.0\ntorque_limit "
        "= 90.0\n[drive.motor]\n"
        "gear = 50.0\nstall_torque = 3.0\nno_load_speed = 1000.0\n"
    )
    robot = ("--robot", str(heavy))
    parameters, _ = load_parameters(heavy)
    own = parameters.drive
    circle = ("--reference", "circle", "--circle-duration", "2", "--circle-speed", "0.8")
    circle += ("--compensation", "none")
    runs = ("--radii", "1", "--speeds", "0.6", "--duration", "6")
    for options, drive in (
        (("grid", *runs, "--drive.lag", "0.1"), replace(own, lag=0.1)),
        (("track", *circle), own),
        (("wander", "--duration", "5", "--max-speed", "0.9"), own),
    ):
        result = trackslip(*options, *robot)
        (log,) = read_runs(result.folder / RUNS_FILE)
        assert log.metadata["drive"] == result.manifest["drive"] == plain(drive)
        assert log.truth.saturated.max() == 0
        assert (log.metadata["ground"]["across"], log.metadata["radius_error"]) == (0.6, 0.03)
    for line, message in (
        (("grid", "--speeds", "1.2"), "speeds = 1.2: must be at most drive.top_speed = 1.0 m/s"),
        (
            ("track", "--drive.motor.friction", "99"),
            "drive.torque_limit = 90.0: must be more than motor.friction",
        ),
    ):
        assert message in refused(*line, *robot)
