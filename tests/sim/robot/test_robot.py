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
from sim.robot.robot import MODELS, shaped_robot
from sim.tracks.recipe import LEVEL
from trackslip.errors import InvalidValueError, RobotWarning, SettingsFileError
from trackslip.skid_theory import line_contact, steady_twist

FIELD = MODELS / "field.xml"


def pads(model):
    """Places of a robot's pads (N, 3)."""
    names = [model.geom(k).name for k in range(model.ngeom)]
    return model.geom_pos[["_pad" in name for name in names]]


def test_the_recipe_makes_the_shipped_file_of_the_defaults(robot):
    """So that the model opens in MuJoCo's viewer as it is simulated."""
    file = mujoco.MjModel.from_xml_path(str(FIELD))
    made = robot.model
    tolerances = {"solref": 2e-4, "solreffriction": 1e-9, "solimp": 1e-9, "friction": 0.0}
    for name, tolerance in tolerances.items():
        written = getattr(file, f"pair_{name}")[:, :3]
        by_recipe = getattr(made, f"pair_{name}")[:, :3]
        np.testing.assert_allclose(written, by_recipe, rtol=tolerance)
    np.testing.assert_allclose(pads(file), pads(made), atol=1e-12)
    written = np.sort(file.body("chassis").inertia)
    by_recipe = np.sort(made.body("chassis").inertia)
    np.testing.assert_allclose(written, by_recipe, rtol=1e-12)
    assert file.opt.impratio == made.opt.impratio
    assert file.opt.timestep == made.opt.timestep
    assert file.geom("sprocket0").size[0] == robot.geometry.sprocket_radius
    assert made.pair_friction[0, :2].tolist() == [Ground().along, Ground().across]
    assert LEVEL.sink == SINK
    assert LEVEL.timestep == file.opt.timestep


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
    """Turns around points 2.4 and 8 half gauges off the middle; half gauge b and offset D of the
    ICRs hold 2 w (b + D) = difference of the belts' speeds.
    """
    half_length = 0.17
    half_gauge = 0.17 * width
    speed = 0.2 if shear else 0.1
    radius = np.array([2.4, 8.0]) * half_gauge
    yaw_rate = speed / radius
    guessed_offset = 0.05 * half_length
    spread = 2 * (half_gauge + guessed_offset) * yaw_rate
    belts = speed + np.stack([-spread, spread], axis=1) / 2

    robot = load_robot(parameters=RobotParameters(half_gauge=half_gauge))
    fleet = Fleet(robot, np.zeros((2, 3)), Ground(shear=shear), 0.0, tireless())
    fleet.command(belts / robot.geometry.sprocket_radius)
    fleet.advance(6.0 if shear else 2.0)
    offset = spread / (2 * fleet.twist()[:, 2]) - half_gauge

    contact = line_contact(half_gauge, half_length, 0.7, 0.778, (0.0, 0.0, 0.12), points=800)
    expected = steady_twist(belts, contact, 9.81, shear)
    offset_by_theory = spread / (2 * expected[:, 2]) - half_gauge
    np.testing.assert_allclose(offset, offset_by_theory, rtol=within)


def test_robots_wider_than_verified_are_told_of():
    said = r"half_gauge = 0\.6: turns are verified up to 0\.51 m, 1\.5 contact lengths"
    with pytest.warns(RobotWarning, match=said):
        load_robot(RobotParameters(half_gauge=0.6))


WIDE = RobotParameters(half_gauge=0.3, contact_length=0.5, mass=60.0, com_x=0.03, com_height=0.2)


def rigid_inertia(made, angles):
    """Mass m, centre of mass c (3,) and inertia (3, 3) about it of a robot with flippers at these
    angles.

    Of a chassis that is not turned, the mass matrix of the free joint is
    [[m 1, -m [r]x], [m [r]x, I - m [r]x [r]x]], where [r]x is the matrix of the cross product with
    r from the joint's origin to c, and I the inertia about c.
    """
    model = made.model
    data = mujoco.MjData(model)
    qpos, first = made.free
    data.qpos[qpos : qpos + 7] = [-made.robot.middle, 0, -made.robot.lowest, 1, 0, 0, 0]
    data.qpos[made.flipper_qpos] = angles
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    block = full[first : first + 6, first : first + 6]
    mass = block[0, 0]
    cross = -block[:3, 3:] / mass
    lever = np.array([cross[2, 1], cross[0, 2], cross[1, 0]])
    origin = data.qpos[qpos : qpos + 3]
    inertia = block[3:, 3:] + mass * cross @ cross
    return mass, origin + lever, inertia


def second_moments(model):
    """Integrals of x^2, y^2 and z^2 over the chassis' mass: half of all moments of inertia less the
    axis' own; its axes must be those of its frame.
    """
    body = model.body("chassis")
    axes = Rotation.from_quat(body.iquat, scalar_first=True).as_matrix()
    inertia = axes @ np.diag(body.inertia) @ axes.T
    np.testing.assert_allclose(inertia, np.diag(np.diag(inertia)), atol=1e-9)
    return np.trace(inertia) / 2 - np.diag(inertia)


def test_second_moments_grow_with_mass_and_squares_of_the_shape():
    shipped = RobotParameters()
    other = RobotParameters(
        contact_length=1.5 * shipped.contact_length,
        half_gauge=1.2 * shipped.half_gauge,
        com_height=0.9 * shipped.com_height,
        mass=2 * shipped.mass,
    )
    before, after = (second_moments(shaped_robot(each).compile()) for each in (shipped, other))
    np.testing.assert_allclose(after / before, 2 * np.array([1.5, 1.2, 0.9]) ** 2)


@pytest.mark.parametrize("height", [0.4, 0.5, 0.9])
def test_a_mast_bears_the_plate_at_the_height_of_the_scanner(height):
    model = shaped_robot(RobotParameters(plate_height=height)).compile()
    plate = model.geom("plate")
    mast = model.geom("mast")
    assert plate.pos[2] == pytest.approx(height)
    assert model.body("lrf").pos[2] == pytest.approx(height)
    assert mast.pos[2] + mast.size[1] == pytest.approx(height - plate.size[2])
    foot = mujoco.MjModel.from_xml_path(str(FIELD)).geom("mast")
    assert mast.pos[2] - mast.size[1] == pytest.approx(foot.pos[2] - foot.size[1])


def test_looks_and_sensors_are_as_long_and_wide_as_the_robot():
    shipped = mujoco.MjModel.from_xml_path(str(FIELD))
    wide = RobotParameters(contact_length=0.51, half_gauge=0.21)
    model = shaped_robot(wide).compile()
    growth = np.array([0.51 / 0.34, 0.21 / 0.168, 0.21 / 0.168])
    for name in ("deck", "bumper", "left_lamp"):
        np.testing.assert_allclose(model.geom(name).pos, growth * shipped.geom(name).pos)
    bumper = model.geom("bumper").size
    np.testing.assert_allclose(bumper, growth * shipped.geom("bumper").size)
    for side, y in (("left", 0.21), ("right", -0.21)):
        site = model.site(f"{side}_footprint")
        assert site.pos[1] == pytest.approx(y)
        assert site.size[0] >= 0.51 / 2


@pytest.mark.parametrize("name", ["rescue", "box"])
def test_a_tracked_robot_has_the_mass_matrix_of_its_model(name):
    parameters, _ = load_parameters(name)
    looks = robot_looks(parameters)
    made = build_tracked(load_tracked(name))
    mass, centre, inertia = rigid_inertia(made, looks.rest[7:])
    robot = load_robot(parameters=parameters)
    body = robot.model.body("chassis")
    axes = Rotation.from_quat(body.iquat, scalar_first=True).as_matrix()
    assert parameters.mass == pytest.approx(mass, rel=1e-12)
    assert robot.mass == pytest.approx(mass, rel=1e-12)
    np.testing.assert_allclose(body.ipos, centre, atol=1e-12)
    np.testing.assert_allclose(axes @ np.diag(body.inertia) @ axes.T, inertia, atol=1e-9)


UNEVEN = replace(load_tracked("box"), hull=((-0.2, 0.1, 0.1), (0, 0.099, 0.1), (0.2, 0.1, 0.1)))


@pytest.mark.parametrize(
    "source", ["rescue", "husky", WIDE, UNEVEN, replace(UNEVEN, contact="wheels")]
)
def test_it_turns_as_theory_says_on_flat_ground_and_on_terrain(source):
    speeds = np.array([0.04, 0.08])
    friction = 0.7
    parameters = load_parameters(source)[0]
    tracked = load_tracked(source)
    made = build_tracked(tracked, friction=(friction, friction))
    model = made.model
    data = mujoco.MjData(model)
    data.qpos[made.free[0] + 2] = -tracked.lowest
    upright = np.full(len(made.flipper_sign), np.pi / 2)
    data.qpos[made.flipper_qpos] = made.flipper_control(upright)
    data.ctrl[made.flipper_motor] = data.qpos[made.flipper_qpos]
    made.belts.set(speeds[made.track_side])
    mujoco.mj_step(model, data, nstep=round(2.0 / model.opt.timestep))
    robot = load_robot(parameters=parameters)
    ground = Ground(friction, friction)
    fleet = Fleet(robot, np.zeros((1, 3)), ground, 0.0, tireless())
    fleet.command(speeds / parameters.sprocket_radius)
    fleet.advance(1.5)
    contact = parameters.contact_theory(friction, friction)
    expected = steady_twist(speeds, contact)[2]
    assert fleet.twist()[0, 2] == pytest.approx(expected, rel=0.005)
    assert data.qvel[made.free[1] + 5] == pytest.approx(expected, rel=0.01)


def test_robots_without_stand_or_tracks_are_refused(tmp_path):
    hull = "[[-0.2, 0.2, 0.1], [0.0, 0.1, 0.1], [0.2, 0.2, 0.1]]"
    without_flippers, _, _ = ROBOT.partition("[[flippers]]")
    text = without_flippers.replace("[[-0.2, 0.1, 0.1], [0.2, 0.1, 0.1]]", hull)
    with pytest.raises(SettingsFileError, match=r"mine\.urdf: .*contact_length = 0\.0"):
        load_parameters(write_robot(tmp_path, text))
    mixed = tmp_path / "mixed.toml"
    mixed.write_text("half_gauge = 0.2\nhull = [[0, 0, 1], [1, 0, 1]]\nmass = 3\n")
    unknown = r"mass is unknown; known are model, half_gauge"
    a_model = r"a \.toml file that names this model and its tracks"
    for load in (load_parameters, load_tracked):
        with pytest.raises(SettingsFileError, match=unknown):
            load(mixed)
        with pytest.raises(InvalidValueError, match=a_model):
            load("robot.urdf")
    with pytest.raises(InvalidValueError, match=r"inertia = .*six finite numbers"):
        RobotParameters(inertia=(1, 1, 3, 0, 0, 0))
