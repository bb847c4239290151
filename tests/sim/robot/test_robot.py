"""The shipped model: its numbers, its contact recipe, and wide, short robots, which need more points."""

import mujoco
import numpy as np
import pytest

from sim import Fleet, Ground, load_robot
from sim.drive.drive import tireless
from sim.robot.parameters import SINK, RobotParameters
from sim.robot.robot import MODELS
from sim.tracks.recipe import LEVEL
from trackslip.errors import RobotWarning
from trackslip.skid_theory import line_contact, steady_twist

FIELD = MODELS / "field.xml"


def test_the_shipped_file_is_what_the_recipe_makes_of_the_default_parameters(robot):
    """So that the model opens in MuJoCo's viewer as it is simulated."""
    file, made = mujoco.MjModel.from_xml_path(str(FIELD)), robot.model
    pads = [[k for k in range(model.ngeom) if "_pad" in model.geom(k).name] for model in (file, made)]
    for name, tolerance in (("solref", 2e-4), ("solreffriction", 1e-9), ("solimp", 1e-9), ("friction", 0.0)):
        written, by_recipe = (getattr(model, f"pair_{name}")[:, :3] for model in (file, made))
        np.testing.assert_allclose(written, by_recipe, rtol=tolerance)
    np.testing.assert_allclose(file.geom_pos[pads[0]], made.geom_pos[pads[1]], atol=1e-12)
    inertias = [np.sort(model.body("chassis").inertia) for model in (file, made)]
    np.testing.assert_allclose(*inertias, rtol=1e-12)
    assert (file.opt.impratio, file.opt.timestep) == (made.opt.impratio, made.opt.timestep)
    assert file.geom("sprocket0").size[0] == robot.geometry.sprocket_radius
    assert made.pair_friction[0, :2].tolist() == [Ground().along, Ground().across]
    assert (LEVEL.sink, LEVEL.timestep) == (SINK, file.opt.timestep)


@pytest.mark.parametrize("name", ["tracked_robot.xml", "field.xml"])
def test_models_load_and_stand_without_our_code(name):
    model = mujoco.MjModel.from_xml_path(str(FIELD.parent / name))
    data = mujoco.MjData(model)
    for _ in range(600):
        mujoco.mj_step(model, data)
    assert data.ncon == 20
    assert data.qpos[2] == pytest.approx(-0.002, abs=2e-5)


def test_springs_of_what_is_added_to_the_model_push(robot):
    spec = mujoco.MjSpec.from_file(str(FIELD))
    arm = spec.body("chassis").add_body(name="arm", pos=[0.0, 0.0, 0.3])
    arm.add_joint(name="hinge", axis=[0, 1, 0], stiffness=np.array([5.0, 0, 0]), damping=np.array([0.1, 0, 0]))
    arm.add_geom(size=[0.02, 0, 0], mass=0.1)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.joint("hinge").qpos, data.joint("hinge").qvel = 0.2, 0.5
    mujoco.mj_forward(model, data)
    assert data.qfrc_spring[6] == pytest.approx(-1.0)
    assert data.qfrc_damper[6] == pytest.approx(-0.05)
    alone = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER
    assert robot.model.opt.disableflags & alone == alone  # which saves time


@pytest.mark.parametrize(("width", "shear", "within"), [(1.25, 0.0, 0.01), (3.0, 0.0, 0.01), (2.0, 0.01, 0.02)])
def test_the_icrs_of_a_wide_robot_are_where_theory_has_them(width, shear, within):
    half_length, half_gauge = 0.17, 0.17 * width
    speed = 0.2 if shear else 0.1
    yaw_rate = speed / (np.array([2.4, 8.0]) * half_gauge)
    spread = 2 * (half_gauge + 0.05 * half_length) * yaw_rate
    belts = speed + np.stack([-spread, spread], axis=1) / 2
    robot = load_robot(parameters=RobotParameters(half_gauge=half_gauge))
    fleet = Fleet(robot, np.zeros((2, 3)), Ground(shear=shear), 0.0, tireless())
    fleet.command(belts / robot.geometry.sprocket_radius)
    fleet.advance(6.0 if shear else 2.0)
    contact = line_contact(half_gauge, half_length, 0.7, 0.778, (0.0, 0.0, 0.12), points=800)
    expected = steady_twist(belts, contact, 9.81, shear)[:, 2]
    offset, by_theory = (spread / (2 * w) - half_gauge for w in (fleet.twist()[:, 2], expected))
    np.testing.assert_allclose(offset, by_theory, rtol=within)


def test_robots_wider_than_verified_are_told_of():
    with pytest.warns(RobotWarning, match=r"half_gauge = 0\.6: turns are verified up to 0\.51 m, 1\.5 contact lengths"):
        load_robot(RobotParameters(half_gauge=0.6))
