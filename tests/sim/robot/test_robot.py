"""The shipped model: its numbers, its contact recipe, and that what is left out of it carries no physics."""

import mujoco
import numpy as np
import pytest

from sim.ground.ground import Ground
from sim.robot.parameters import RobotParameters
from sim.robot.robot import FIELD, load_robot
from trackslip.errors import TrackslipError


def test_the_model_holds_the_numbers_of_the_parameters(robot):
    parameters, model = RobotParameters(), robot.model
    assert parameters.half_gauge == robot.geometry.half_gauge == 0.168
    assert parameters.sprocket_radius == robot.geometry.sprocket_radius == 0.06
    assert parameters.contact_length == 2 * robot.contact_half_length == 0.34
    assert parameters.mass == robot.mass
    assert (robot.plate.length, robot.plate.thickness) == (0.6, 0.04)
    assert len(robot.contact_points) == 2 * len(robot.pad_position) == 20
    centre = [parameters.com_x, parameters.com_y, parameters.com_height]
    np.testing.assert_array_equal(model.body("chassis").ipos, centre)
    assert load_robot(parameters=parameters).digest == robot.digest
    assert model.pair_friction[0, :2].tolist() == [Ground().along, Ground().across]


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


def test_what_is_left_out_carries_no_physics(robot):
    """Visuals, cameras and lights."""
    full, belts = mujoco.MjModel.from_xml_path(str(FIELD)), robot.pad_speeds(np.array([0.1, 0.3]))
    assert full.ngeom > robot.model.ngeom
    ends = []
    for model in (full, robot.model):
        data, model.flg_surfacevel = mujoco.MjData(model), 1
        model.geom_surfacevel[[k for k in range(model.ngeom) if "_pad" in model.geom(k).name], 2] = belts
        mujoco.mj_step(model, data, 400)
        ends.append((*data.qpos, *data.sensordata[:6]))
    robot.model.geom_surfacevel[:] = 0.0
    assert ends[0][0] > 0.1
    np.testing.assert_array_equal(*ends)


def test_the_contact_recipe_follows_from_its_formulas(robot):
    """K, B and the friction's rate from sink, damping ratio and impedance; see models/README.md."""
    n, d, sink, zeta, rate, gravity = 20, 0.004, 0.002, 0.7, 100.0, 9.81
    c = d / (1 - d)
    stiffness = gravity * d / (n * c * sink)
    frequency = np.sqrt(n * c * (stiffness / d) / (1 + n * c))
    damping = 2 * zeta * frequency * d * (1 + n * c) / (n * c)
    np.testing.assert_allclose(robot.model.pair_solref[0], [-stiffness, -damping], rtol=1e-3)
    np.testing.assert_allclose(robot.model.pair_solreffriction[0], [-1, -rate * d])


def test_files_that_are_no_model(tmp_path):
    (tmp_path / "broken.xml").write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    for name in ("broken.xml", "none.xml"):
        with pytest.raises(TrackslipError, match=name):
            load_robot(tmp_path / name)
