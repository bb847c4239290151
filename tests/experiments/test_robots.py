"""Any robot in every command: from runs to laws to controllers, with a URDF and its tracks."""

from dataclasses import replace

import pytest
from tracked_files import write_robot

from experiments.common.plain_json import plain
from experiments.common.results import RUNS_FILE
from sim.robot.named import load_parameters
from trackslip.logs.logfile import read_runs
from trackslip.skid_theory import line_contact, steady_turns

RADII = ("0.6", "1.2")


def logs_of(result):
    return read_runs(result.folder / RUNS_FILE)


@pytest.mark.usefixtures("few_resamples", "without_figures")
@pytest.mark.parametrize(
    ("name", "bound"),
    [("rescue", 0.01), pytest.param("a URDF", 0.05, marks=pytest.mark.slow)],  # whose mass lies to its left
)
def test_a_tracked_robot_is_identified_and_controlled(trackslip, tmp_path, name, bound):
    robot = ("--robot", name if name == "rescue" else str(write_robot(tmp_path)))
    runs = trackslip("grid", *robot, "--radii", *RADII, "--speeds", "0.1", "0.2", "--duration", "8", "--rrd")
    found = trackslip("identify", str(runs.folder))
    parameters, ground = load_parameters(robot[1])
    size = parameters.half_gauge, parameters.contact_length / 2
    contact = line_contact(*size, ground.along, ground.across, parameters.centre_of_mass)
    theory = steady_turns([0.8, 1.5], contact).offset.mean()
    assert found.summary["slip_laws"]["icr_radius"]["values"]["offset"] == pytest.approx(theory, rel=bound)
    options = ("--controllers", "linear", "--compensations", "none", "icr_radius", "--seeds", "0", "--jobs", "1")
    small = ("--references", "circle", "--localization", "truth", "--starts", "zero", "--grounds", "robot")
    small += ("--plants", "nominal", "--gains", "default")
    table = trackslip("benchmark", *robot, "--laws", str(found.folder), *options, *small)
    rms = {row["compensation"]: row["rms_position_after_12s"] for row in table.summary["rows"]}
    assert rms["icr_radius"] < 0.3 * rms["none"]
    driven = trackslip("wander", *robot, "--duration", "10", "--drives", "1")
    assert driven.manifest["robot"]["half_gauge"] == parameters.half_gauge


def test_a_robot_brings_its_own_drive_into_every_command(trackslip, refused, tmp_path):
    """A heavy robot, too much for the shipped motors; options change single fields."""
    heavy = tmp_path / "heavy.toml"
    heavy.write_text(
        "half_gauge = 0.28\ncontact_length = 0.5\nsprocket_radius = 0.1\nmass = 75.0\nradius_error = 0.0\n"
        "[drive]\nlag = 0.3\ntop_speed = 1.0\ntorque_limit = 90.0\n[drive.motor]\n"
        "stall_torque = 3.0\nno_load_speed = 1000.0\n"
    )
    own = load_parameters(heavy)[0].drive
    robot = ("--robot", str(heavy))
    driven = trackslip("grid", *robot, "--radii", "1", "--speeds", "0.6", "--duration", "6", "--drive.delay", "0.1")
    expected = plain(replace(own, delay=0.1))
    assert driven.manifest["drive"] == logs_of(driven)[0].metadata["drive"] == expected
    assert logs_of(driven)[0].truth.saturated.max() == 0
    one = ("--radii", "1", "--speeds", "0.1", "--duration", "5")
    swept = trackslip("grid", *robot, *one, "--vary", "drive.lag=0.3,0.5")
    assert sorted(log.run for log in logs_of(swept)) == ["radius=1.0 speed=0.1", "radius=1.0 speed=0.1 drive.lag=0.5"]
    none = ("--compensation", "none")
    tracked = trackslip(
        "track", *robot, "--reference", "circle", "--circle-duration", "2", "--circle-speed", "0.8", *none
    )
    wandered = trackslip("wander", *robot, "--duration", "5", "--max-speed", "0.9")
    for one in (tracked, wandered):
        assert logs_of(one)[0].metadata["drive"] == one.manifest["drive"] == plain(own)
    for line, message in (
        (("grid", "--speeds", "1.2"), "speeds = 1.2: must be at most drive.top_speed = 1.0 m/s"),
        (("wander", "--max-speed", "1.2"), "max_speed = 1.2: must be at most drive.top_speed = 1.0 m/s"),
        (("track", "--drive.motor.friction", "99"), "drive.torque_limit = 90.0: must be more than motor.friction"),
    ):
        assert message in refused(*line, *robot)
