from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tracked_files import ROBOT, write_robot

from sim import Fleet, Ground, RobotParameters, build_tracked, load_robot
from sim.motors.motor import tireless
from sim.robot.looks import robot_looks
from sim.robot.named import load_parameters, load_tracked
from sim.robot.parameters import SINK
from sim.robot.robot import MODELS
from sim.tracks.recipe import LEVEL
from trackslip.errors import InvalidValueError, RobotWarning, SettingsFileError
from trackslip.skid_theory import line_contact, steady_twist

FIELD = MODELS / "field.xml"


def test_the_recipe_makes_the_shipped_file_of_the_defaults(robot):
    """So that the model opens in MuJoCo's viewer as it is simulated."""
    file, made = mujoco.MjModel.from_xml_path(str(FIELD)), robot.model
    pads = [
        [k for k in range(model.ngeom) if "_pad" in model.geom(k).name] for model in (file, made)
    ]
    for name, tolerance in (
        ("solref", 2e-4),
        ("solreffriction", 1e-9),
        ("solimp", 1e-9),
        ("friction", 0.0),
    ):
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


@pytest.mark.parametrize(
    ("width", "shear", "within"), [(1.25, 0.0, 0.01), (3.0, 0.0, 0.01), (2.0, 0.01, 0.02)]
)
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
    with pytest.warns(
        RobotWarning,
        match=r"half_gauge = 0\.6: turns are verified up to 0\.51 m, 1\.5 contact lengths",
    ):
        load_robot(RobotParameters(half_gauge=0.6))


WIDE = RobotParameters(half_gauge=0.3, contact_length=0.5, mass=60.0, com_x=0.03, com_height=0.2)


def rigid_inertia(made, angles):
    """Mass, centre of mass (3,) and inertia (3, 3) about it, from the mass matrix of the free
    joint.
    """
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
def test_a_tracked_robot_has_the_mass_matrix_of_its_model(name):
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


UNEVEN = replace(load_tracked("box"), hull=((-0.2, 0.1, 0.1), (0, 0.099, 0.1), (0.2, 0.1, 0.1)))


@pytest.mark.parametrize(
    "source", ["rescue", "husky", WIDE, UNEVEN, replace(UNEVEN, contact="wheels")]
)
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
    fleet = Fleet(
        load_robot(parameters=parameters),
        np.zeros((1, 3)),
        Ground(friction, friction),
        0.0,
        tireless(),
    )
    fleet.command(speeds / parameters.sprocket_radius)
    fleet.advance(1.5)
    expected = steady_twist(speeds, parameters.contact_theory(friction, friction))[2]
    assert fleet.twist()[0, 2] == pytest.approx(expected, rel=0.005)
    assert data.qvel[made.free[1] + 5] == pytest.approx(expected, rel=0.01)


def test_robots_without_stand_or_tracks_are_refused(tmp_path):
    hull = "[[-0.2, 0.2, 0.1], [0.0, 0.1, 0.1], [0.2, 0.2, 0.1]]"
    text = ROBOT.split("[[flippers]]")[0].replace("[[-0.2, 0.1, 0.1], [0.2, 0.1, 0.1]]", hull)
    with pytest.raises(SettingsFileError, match=r"mine\.urdf: .*contact_length = 0\.0"):
        load_parameters(write_robot(tmp_path, text))
    (tmp_path / "mixed.toml").write_text(
        "half_gauge = 0.2\nhull = [[0, 0, 1], [1, 0, 1]]\nmass = 3\n"
    )
    for load in (load_parameters, load_tracked):
        with pytest.raises(
            SettingsFileError, match=r"mass is unknown; known are model, half_gauge"
        ):
            load(tmp_path / "mixed.toml")
        with pytest.raises(
            InvalidValueError, match=r"a \.toml file that names this model and its tracks"
        ):
            load("robot.urdf")
    with pytest.raises(InvalidValueError, match=r"inertia = .*six finite numbers"):
        RobotParameters(inertia=(1, 1, 3, 0, 0, 0))
