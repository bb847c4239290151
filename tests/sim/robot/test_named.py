"""Robots by name or file: the same robot on flat ground and on terrain."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tracked_files import ROBOT, write_robot

from sim import Fleet, Ground, RobotParameters, build_tracked, load_robot
from sim.drive.drive import tireless
from sim.robot.looks import robot_looks
from sim.robot.named import load_parameters, load_tracked
from trackslip.errors import InvalidValueError, SettingsFileError
from trackslip.skid_theory import steady_twist

WIDE = RobotParameters(half_gauge=0.3, contact_length=0.5, mass=60.0, com_x=0.03, com_height=0.2)


def rigid_inertia(made, angles):
    """Mass, centre of mass (3,) and inertia (3, 3) about it, from the mass matrix of the free joint."""
    model, data = made.model, mujoco.MjData(made.model)
    qpos, first = made.free
    data.qpos[qpos : qpos + 7] = [-made.robot.middle, 0, -made.robot.lowest, 1, 0, 0, 0]
    data.qpos[made.flipper_qpos] = angles
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    block, origin = full[first : first + 6, first : first + 6], data.qpos[qpos : qpos + 3]
    mass, off = block[0, 0], block[:3, 3:]  # the latter is -mass [c]x
    c = np.array([off[1, 2], off[2, 0], off[0, 1]]) / mass
    cross = np.array([[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]])
    return mass, origin + c, block[3:, 3:] + mass * cross @ cross


@pytest.mark.parametrize("name", ["rescue", "box"])
def test_a_tracked_robot_on_flat_ground_has_the_mass_matrix_of_its_model(name):
    parameters, _ = load_parameters(name)
    looks = robot_looks(parameters)
    made = build_tracked(load_tracked(name))
    mass, centre, inertia = rigid_inertia(made, looks.rest[7:])
    robot = load_robot(parameters=parameters)
    body = robot.model.body("chassis")
    axes = Rotation.from_quat(body.iquat, scalar_first=True).as_matrix()
    np.testing.assert_allclose((parameters.mass, robot.mass), mass, rtol=1e-12)
    np.testing.assert_allclose(body.ipos, centre, atol=1e-12)
    np.testing.assert_allclose(axes @ np.diag(body.inertia) @ axes.T, inertia, atol=1e-9)


@pytest.mark.parametrize("source", ["rescue", "husky", WIDE])
def test_it_turns_as_theory_says_on_flat_ground_and_on_terrain(source):
    speeds, friction = np.array([0.04, 0.08]), 0.7
    parameters, tracked = load_parameters(source)[0], load_tracked(source)
    made = build_tracked(tracked, friction=(friction, friction))
    model, data = made.model, mujoco.MjData(made.model)
    data.qpos[made.free[0] + 2] = -tracked.lowest
    data.qpos[made.flipper_qpos] = made.flipper_control(np.full(len(made.flipper_sign), np.pi / 2))
    data.ctrl[made.flipper_motor] = data.qpos[made.flipper_qpos]
    made.belts.set(speeds[made.track_side])
    mujoco.mj_step(model, data, nstep=round(2.0 / model.opt.timestep))
    fleet = Fleet(load_robot(parameters=parameters), np.zeros((1, 3)), Ground(friction, friction), 0.0, tireless())
    fleet.command(speeds / parameters.sprocket_radius)
    fleet.advance(1.5)
    expected = steady_twist(speeds, parameters.contact_theory(friction, friction))[2]
    assert fleet.twist()[0, 2] == pytest.approx(expected, rel=0.005)
    assert data.qvel[made.free[1] + 5] == pytest.approx(expected, rel=0.01)


def test_robots_that_cannot_stand_have_fields_of_both_kinds_or_no_tracks_are_refused(tmp_path):
    hull = "[[-0.2, 0.2, 0.1], [0.0, 0.1, 0.1], [0.2, 0.2, 0.1]]"
    text = ROBOT.split("[[flippers]]")[0].replace("[[-0.2, 0.1, 0.1], [0.2, 0.1, 0.1]]", hull)
    with pytest.raises(InvalidValueError, match=r"contact_length = 0\.0"):
        load_parameters(write_robot(tmp_path, text))
    (tmp_path / "mixed.toml").write_text("half_gauge = 0.2\nhull = [[0, 0, 1], [1, 0, 1]]\nmass = 3\n")
    for load in (load_parameters, load_tracked):
        with pytest.raises(SettingsFileError, match=r"mass is unknown; known are model, half_gauge"):
            load(tmp_path / "mixed.toml")
        with pytest.raises(InvalidValueError, match=r"a \.toml file that names this model and its tracks"):
            load("robot.urdf")
    with pytest.raises(InvalidValueError, match=r"inertia = .*six finite numbers"):
        RobotParameters(inertia=(1, 1, 3, 0, 0, 0))
