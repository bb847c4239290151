import mujoco
import numpy as np
import pytest

from sim.robot.robot import FIELD, load_robot
from trackslip.errors import TrackslipError


def test_the_model_holds_the_numbers(robot):
    assert robot.geometry.half_gauge == 0.168
    assert robot.geometry.sprocket_radius == 0.06
    assert robot.contact_half_length == 0.17
    assert robot.mass == pytest.approx(25.0)
    assert (robot.plate.length, robot.plate.thickness) == (0.6, 0.04)
    assert robot.pad_position.shape == (10, 2)
    assert len(robot.contact_points) == 20


@pytest.mark.parametrize("name", ["tracked_robot.xml", "field.xml"])
def test_models_load_and_stand_without_our_code(name):
    model = mujoco.MjModel.from_xml_path(str(FIELD.parent / name))
    data = mujoco.MjData(model)
    for _ in range(600):
        mujoco.mj_step(model, data)
    assert data.ncon == 20
    assert data.qpos[2] == pytest.approx(-0.002, abs=2e-5)


def test_visuals_carry_no_physics(robot):
    full = mujoco.MjModel.from_xml_path(str(FIELD))
    assert full.ngeom > robot.model.ngeom
    data, bare = mujoco.MjData(full), mujoco.MjData(robot.model)
    for _ in range(200):
        mujoco.mj_step(full, data)
        mujoco.mj_step(robot.model, bare)
    np.testing.assert_array_equal(data.qpos, bare.qpos)


def test_the_contact_recipe_follows_from_its_formulas(robot):
    """K, B and the friction's rate from sink, damping ratio and impedance; see models/README.md."""
    n, d, sink, zeta, rate, gravity = 20, 0.004, 0.002, 0.7, 100.0, 9.81
    c = d / (1 - d)
    stiffness = gravity * d / (n * c * sink)
    frequency = np.sqrt(n * c * (stiffness / d) / (1 + n * c))
    damping = 2 * zeta * frequency * d * (1 + n * c) / (n * c)
    np.testing.assert_allclose(robot.model.pair_solref[0], [-stiffness, -damping], rtol=1e-3)
    np.testing.assert_allclose(robot.model.pair_solreffriction[0], [-1, -rate * d])


def test_a_model_that_is_none(tmp_path):
    path = tmp_path / "broken.xml"
    path.write_text("<mujoco><worldbody><geom/></worldbody></mujoco>")
    with pytest.raises(TrackslipError, match=r"broken\.xml"):
        load_robot(path)
    with pytest.raises(TrackslipError, match=r"none\.xml"):
        load_robot(tmp_path / "none.xml")
