import mujoco
import numpy as np

from experiments.speed.pipeline.physics import differences, without_savings
from sim.fleet import Fleet
from sim.robot.parameters import RobotParameters
from sim.robot.robot import load_robot
from sim.robot.savings import skip_idle_stages

_ISLAND = mujoco.mjtDisableBit.mjDSBL_ISLAND
_PASSIVE = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER


def test_no_bit_changes(robot):
    assert differences(robot, without_savings(robot), 6.0) == 0


def test_no_bit_changes_for_another_robot():
    other = load_robot(parameters=RobotParameters(half_gauge=0.3, contact_length=0.8, mass=60.0, com_x=0.03))
    assert differences(other, without_savings(other), 0.5) == 0


def test_the_comparison_can_fail(robot):
    heavier = load_robot(parameters=RobotParameters(mass=25.0001))
    assert differences(robot, without_savings(heavier), 0.5) > 0


def test_savings_leave_out_what_costs_time(robot):
    model, before = robot.model, without_savings(robot).model
    assert model.opt.disableflags == _ISLAND | _PASSIVE
    assert before.opt.disableflags == 0
    assert (model.ncam, model.nlight) == (0, 0)
    assert before.ncam > 0


def _flags(body, option=""):
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option {option}/><worldbody><body><freejoint/><geom size="0.1"/>{body}</body></worldbody></mujoco>'
    )
    skip_idle_stages(model)
    return model.opt.disableflags


def test_stages_with_something_to_do_remain():
    joint = '<body><joint damping="1"/><geom size="0.1"/></body>'
    other = '</body><body pos="1 0 0"><freejoint/><geom size="0.1"/>'
    assert _flags("") == _ISLAND | _PASSIVE
    assert _flags(joint) == _ISLAND
    assert _flags("", 'viscosity="1"') == _ISLAND
    assert _flags(other) == _PASSIVE


def test_forces_of_the_tracks_add_up_to_the_weight(robot):
    fleet = Fleet(robot, np.zeros((1, 3)))
    weight = robot.mass * np.linalg.norm(robot.model.opt.gravity)
    np.testing.assert_allclose(fleet.load().sum(), weight, rtol=1e-3)
