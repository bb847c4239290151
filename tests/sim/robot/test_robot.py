"""The shipped model: its numbers, its contact recipe, and that what is left out of it carries no physics."""

import mujoco
import numpy as np
import pytest

from sim.ground.ground import Ground
from sim.robot.chassis import MODELS, shaped_robot
from sim.robot.parameters import SINK, RobotParameters
from sim.robot.robot import lay_pads
from sim.tracks.recipe import LEVEL

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
    assert LEVEL.sink == SINK


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
    spec, belts = shaped_robot(RobotParameters()), robot.pad_speeds(np.array([0.1, 0.3]))
    lay_pads(spec, RobotParameters())
    full = spec.compile()
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
