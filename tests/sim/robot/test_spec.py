from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim.fleet import Fleet
from sim.robot.parameters import RobotParameters
from sim.robot.robot import VISUAL_GROUP, load_robot
from sim.robot.spec import skip_idle_stages

_ISLAND = mujoco.mjtDisableBit.mjDSBL_ISLAND
_PASSIVE = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER


@pytest.mark.parametrize(
    "parameters", [None, RobotParameters(half_gauge=0.3, contact_length=0.8, mass=60.0, com_x=0.03)]
)
def test_no_bit_changes(parameters):
    robot = load_robot(parameters=parameters)
    assert (robot.model.opt.disableflags, robot.model.ncam, robot.model.nlight) == (_ISLAND | _PASSIVE, 0, 0)
    now, before = (_driven(each) for each in (robot, _without_savings(robot)))
    np.testing.assert_array_equal(now.batch.state, before.batch.state)
    np.testing.assert_array_equal(now.drive.energy, before.drive.energy)  # which adds up all forces


def _without_savings(robot):
    """The robot of a file, with all stages of the engine, its cameras and lights, and one ground for both tracks."""
    spec = mujoco.MjSpec.from_file(str(robot.path))
    if robot.parameters is not None:
        robot.parameters.apply(spec)
    for geom in list(spec.geoms):
        if geom.group == VISUAL_GROUP:
            spec.delete(geom)
    model = spec.compile()
    model.flg_surfacevel = 1
    first = int(model.geom("left_pad0").id)
    return replace(robot, model=model, pads=slice(first, first + len(robot.pad_side)))


def _driven(robot):
    fleet = Fleet(robot, np.zeros((3, 3)), threads=1)
    fleet.command([[1.0, 3.0], [3.0, 3.0], [-2.0, 2.0]])
    fleet.advance(2.0)
    return fleet


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
