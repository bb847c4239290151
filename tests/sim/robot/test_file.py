"""Robots of other shapes: parameters, files, and whether they turn as theory says."""

import numpy as np
import pytest
from pages import ROOT, file

from sim.drive.drive import tireless
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters, load_robot_file, robot_file_text
from sim.robot.robot import load_robot
from trackslip.errors import InvalidValueError, SettingsFileError
from trackslip.skid_theory import line_contact, steady_twist

PAGE = ROOT / "docs" / "grounds_and_robots.md"
OTHERS = [
    RobotParameters(half_gauge=0.25, contact_length=0.5, mass=60.0, sprocket_radius=0.08),
    RobotParameters(half_gauge=0.12, contact_length=0.2, com_x=0.01, com_y=-0.01, com_height=0.08),
    RobotParameters(contact_length=0.42, com_y=0.02),
]
STRONG = tireless(0.6)


def test_the_defaults_are_the_shipped_model(robot):
    parameters, model = RobotParameters(), robot.model
    assert parameters.half_gauge == robot.geometry.half_gauge
    assert parameters.sprocket_radius == robot.geometry.sprocket_radius
    assert parameters.contact_length == 2 * robot.contact_half_length
    assert parameters.mass == robot.mass
    np.testing.assert_array_equal(
        model.body("chassis").ipos, [parameters.com_x, parameters.com_y, parameters.com_height]
    )
    assert load_robot(parameters=parameters).digest == robot.digest
    assert model.pair_friction[0, :2].tolist() == [Ground().along, Ground().across]


@pytest.mark.parametrize("parameters", OTHERS)
def test_another_robot_has_its_numbers_and_turns_as_theory_says(parameters):
    other = load_robot(parameters=parameters)
    assert other.geometry.half_gauge == pytest.approx(parameters.half_gauge)
    assert other.geometry.sprocket_radius == parameters.sprocket_radius
    assert 2 * other.contact_half_length == pytest.approx(parameters.contact_length)
    assert other.mass == pytest.approx(parameters.mass)
    surface = np.array([[0.10, 0.15], [0.15, 0.10], [0.05, 0.15], [-0.05, 0.05]])
    ground = Ground(0.6, 0.72)
    fleet = Fleet(other, np.zeros((4, 3)), ground, 0.0, STRONG)
    fleet.command(surface / parameters.sprocket_radius)
    fleet.advance(2.5)
    centre = (parameters.com_x, parameters.com_y, parameters.com_height)
    contact = line_contact(parameters.half_gauge, parameters.contact_length / 2, 0.6, 0.72, centre)
    expected = steady_twist(surface, contact, 9.81)
    twist = fleet.twist()
    np.testing.assert_allclose(twist[:, 2], expected[:, 2], rtol=0.01)
    np.testing.assert_allclose(twist[:, 0], expected[:, 0], rtol=0.01, atol=2e-4)
    np.testing.assert_allclose(fleet.load().sum(axis=1), parameters.mass * 9.81, rtol=1e-3)
    left = (1 + parameters.com_y / parameters.half_gauge) / 2
    assert fleet.load()[3, 0] / fleet.load()[3].sum() == pytest.approx(left, abs=0.005)


def test_a_file_holds_everything(tmp_path):
    path = tmp_path / "robot.toml"
    for parameters in OTHERS:
        path.write_text(robot_file_text(parameters, Ground(0.5, 0.6), "made by hand"))
        assert load_robot_file(path) == (parameters, Ground(0.5, 0.6))


def test_the_example_on_the_page_is_a_robot(tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text(file(PAGE, "robot.toml"))
    parameters, ground = load_robot_file(path)
    assert parameters == RobotParameters(half_gauge=0.25, contact_length=0.5)
    assert ground == Ground()


def test_what_a_file_leaves_out_is_the_default(tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text("com_y = 0.01\n")
    assert load_robot_file(path) == (RobotParameters(com_y=0.01), Ground())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("half_gauge = 0", "half_gauge = 0.0: must be a finite number > 0"),
        ("half_gauge = 'wide'", "half_gauge = 'wide': must be a number"),
        ("wheels = 4", "wheels is unknown; known are half_gauge"),
        ("radius_error = 0.9", "radius_error = 0.9: must be from -0.5 to 0.5"),
        ("com_x = 0.1", "com_x = 0.1: must be between"),
        ("com_y = -0.2", "com_y = -0.2: must be between"),
        ("ground = 3", "ground: 3 is not a table"),
        ("[ground]\nalong = -1", "along = -1.0: must be a finite number > 0"),
    ],
)
def test_bad_files_are_refused_by_field(tmp_path, text, message):
    path = tmp_path / "robot.toml"
    path.write_text(text)
    with pytest.raises(SettingsFileError) as error:
        load_robot_file(path)
    assert message in str(error.value)


def test_a_weight_that_lifts_a_track_is_refused():
    with pytest.raises(InvalidValueError, match="com_x, com_y"):
        RobotParameters(com_x=0.04, com_y=0.1)
