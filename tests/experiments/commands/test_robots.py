"""Any robot in every command: from runs to laws to controllers, with a URDF and its tracks."""

import pytest
from tracked_files import write_robot

from sim.robot.named import load_parameters
from trackslip.skid_theory import line_contact, steady_turns

RADII = ("0.6", "1.2")


@pytest.mark.usefixtures("few_resamples")
@pytest.mark.parametrize(("name", "bound"), [("rescue", 0.01), ("a URDF", 0.05)])  # whose mass lies to its left
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
    table = trackslip("benchmark", *robot, "--laws", str(found.folder), *options, *small)
    rms = {row["compensation"]: row["rms_position_after_12s"] for row in table.summary["rows"]}
    assert rms["icr_radius"] < 0.3 * rms["none"]
    driven = trackslip("wander", *robot, "--duration", "10", "--drives", "1")
    assert driven.manifest["robot"]["half_gauge"] == parameters.half_gauge
