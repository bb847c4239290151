import re
import warnings
from itertools import product
from typing import NamedTuple

import mujoco
import numpy as np
import pytest

from sim import Fleet, Ground, build_tracked, check, load_robot
from sim.motors.motor import tireless
from sim.robot import flat
from sim.robot.looks import robot_looks
from sim.robot.named import load_parameters, load_tracked
from trackslip.errors import TrackslipError
from trackslip.skid_theory import steady_twist

SIDES = {"left": 1, "right": -1}
ENDS = {"front": 0.2, "rear": -0.2}
CUBE = "".join(f"v {x} {y} {z}\n" for x, y, z in product((-0.1, 0.1), repeat=3))
CUBE += "f 1 2 4\nf 1 4 3\n"
CUBE += "f 5 7 8\nf 5 8 6\n"
CUBE += "f 1 5 6\nf 1 6 2\n"
CUBE += "f 3 4 8\nf 3 8 7\n"
CUBE += "f 1 3 7\nf 1 7 5\n"
CUBE += "f 2 6 8\nf 2 8 4\n"
"""An .obj of a cube with edges of 0.2 m: its corners, then two triangles per side."""
WHEELS = {
    f"{side}_{end}": (x, 0.25 * sign) for side, sign in SIDES.items() for end, x in ENDS.items()
}
"""Places of a rover's wheels, x and y [m]."""
LISTED = list(WHEELS)
LOOSE = {"kind": "continuous"}
LIMITS = {"kind": "revolute", "rest": '<limit lower="-0.3" upper="0.3" effort="1" velocity="1"/>'}
ENDLESS = {
    "kind": "revolute",
    "rest": '<limit lower="-1e16" upper="1e16" effort="0" velocity="0"/>',
}
"""Of joints."""
TRACKS = "half_gauge = 0.25\nhull = [[-0.2, 0.0, 0.1], [0.2, 0.0, 0.1]]\n"


def link(name, mass, shape="", place="0 0 0", look=""):
    """A link with a collision shape and a mesh to look at."""
    across = f'ixx="{mass / 20}" iyy="{mass / 20}"'
    inertia = f'<inertia {across} izz="{mass / 15}" ixy="0" ixz="0" iyz="0"/>'
    text = f'<link name="{name}">'
    if mass:
        text += f'<inertial><mass value="{mass}"/>{inertia}</inertial>'
    if look:
        text += f'<visual><geometry><mesh filename="{look}"/></geometry></visual>'
    if shape:
        text += f'<collision><origin xyz="{place}"/><geometry>{shape}</geometry></collision>'
    return f"{text}</link>"


def joint(parent, child, place, kind="continuous", rest=""):
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    frame = f'<origin xyz="{place}"/><axis xyz="0 1 0"/>'
    return f'<joint name="{child}_joint" type="{kind}">{ends}{frame}{rest}</joint>'


CYLINDER = '<cylinder radius="0.1" length="0.1"/>'


def rover(wheel='<sphere radius="0.1"/>', heights=(0.0, 0.0, 0.0, 0.0), parent="base", **options):
    parts = [link("base", 10, '<box size="0.4 0.3 0.05"/>', "0 0 0.1")]
    for (name, (x, y)), z in zip(WHEELS.items(), heights, strict=True):
        parts += [link(name, 1, wheel), joint(parent, name, f"{x} {y} {z}", **options)]
    return parts


def write(folder, parts, text='wheels = "replace"\n', name="rover.urdf"):
    """Write the URDF into a package's folder urdf, and its robot file beside it."""
    urdf = folder / "rover_description" / "urdf" / name
    urdf.parent.mkdir(parents=True, exist_ok=True)
    urdf.write_text(f'<robot name="rover">{"".join(parts)}</robot>')
    file = folder / "rover.toml"
    file.write_text(f'model = "rover_description/urdf/{name}"\n{text}')
    return file


def base(shape="", mass=10, look=""):
    return link("base", mass, shape, "0 0 0.2", look)


@pytest.mark.parametrize(
    ("filename", "at", "packages"),
    [
        ("package://rover_description/meshes/cube.obj", "rover_description/meshes", ""),
        ("package://other/cube.obj", "elsewhere/other", 'packages = ["elsewhere"]'),
        ("package://named/cube.obj", "elsewhere/other", 'packages = ["elsewhere/other"]'),
        ("../meshes/cube.obj", "rover_description/meshes", ""),
        ("../meshes/cube.dae", "rover_description/meshes", ""),
    ],
)
def test_meshes_are_found(tmp_path, filename, at, packages):
    package = tmp_path / at
    package.mkdir(parents=True)
    (package / "cube.obj").write_text(CUBE)
    (package / "package.xml").write_text("<package><name>named</name></package>")
    shape = f'<mesh filename="{filename}"/>'
    for extra in ("", '<mujoco><compiler strippath="true"/></mujoco>'):
        file = write(tmp_path, [base(shape), extra], TRACKS + packages)
        assert build_tracked(load_tracked(file)).model.nmesh == 1


def test_a_broken_mesh_to_look_at_stops_no_robot(tmp_path):
    """It is needed neither to find the wheels nor to drive, only for pictures."""
    robots = []
    for name, content in (("whole", CUBE), ("broken", "v 0 0 0\nf 1 1 1\n")):
        shown = [base(look=f"../meshes/{name}.obj"), *rover()[1:]]
        file = write(tmp_path / name, shown)
        meshes = tmp_path / name / "rover_description" / "meshes"
        meshes.mkdir()
        (meshes / f"{name}.obj").write_text(content)
        robots.append(load_tracked(file))
    whole, broken = robots
    assert (broken.half_gauge, broken.hull) == (whole.half_gauge, whole.hull)
    assert build_tracked(broken).model.nmesh == 0
    assert build_tracked(whole, looks=True).model.nmesh == 1
    with pytest.raises(TrackslipError, match="vertices required"):
        build_tracked(broken, looks=True)


POINTER = f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 32184\n"
ASCII_STL = "solid made by a CAD\n" + "facet normal 0 0 1 outer loop vertex 0 0 0\n" * 9
PADDLE = (
    '[[flippers]]\nbody = "paddle"\nside = "left"\nhull = [[0.0, 0.0, 0.06], [0.25, 0.0, 0.04]]\n'
)
HINGE = joint("base", "paddle", '0.2 0.3 0" rpy="0 0 1.57', **LIMITS)
HINGED = joint("base", "paddle", '0.2 0.3 0" rpy="0 0 0', **LIMITS)
TIPPED = [
    link("paddle", 1),
    HINGED,
    link("tip", 1, '<sphere radius="0.04"/>'),
    joint("paddle", "tip", "0.25 0 0"),
]
OTHER = 'packages = ["rover_description/other"]\n'
PACKAGE = {"other/package.xml": "<package><name>named</name></package>"}


def mesh(file, mass=10):
    return [base(f'<mesh filename="{file}"/>', mass)]


def below(shape):
    return [base(), link("plate", 0, shape), joint("base", "plate", "0 0 -0.11", "fixed")]


class Fault(NamedTuple):
    """What is wrong with a model, and what is to be said about it."""

    parts: list[str]
    said: str
    text: str = ""  # of the robot file
    files: dict[str, str] | None = None  # contents by path in the package


FAULTS = {
    "package is gone": Fault(
        parts=mesh("package://gone/a.stl"),
        said="link 'base' needs package://gone/a.stl .*`packages` must list",
    ),
    "mesh is a .dae": Fault(
        parts=mesh("../meshes/a.dae"),
        said="'base' needs .*MuJoCo doesn't read .dae; convert it",
        files={"meshes/a.dae": ""},
    ),
    "mesh is gone": Fault(
        parts=mesh("a.stl"),
        said="link 'base' needs a.stl to collide or for its mass, but there is no",
    ),
    "mesh is an ASCII .stl": Fault(
        parts=mesh("../meshes/a.stl"),
        said=r"such an \.stl \(ASCII, damaged, or over 200,000 faces\)",
        files={"meshes/a.stl": ASCII_STL},
    ),
    "mesh is a pointer": Fault(
        parts=mesh("../meshes/a.obj"),
        said="but a.obj is a Git LFS .*git lfs pull",
        files={"meshes/a.obj": POINTER},
    ),
    "package lacks the mesh": Fault(
        parts=mesh("package://named/a.stl"),
        said="package named in .*other has no a.stl$",
        text=OTHER,
        files=PACKAGE,
    ),
    "box below the tracks": Fault(
        parts=below('<box size="0.3 0.1 0.02"/>'),
        said="a geom of link plate reaches down to -0.12 m in the frame of",
    ),
    "mesh below the tracks": Fault(
        parts=below('<mesh filename="../meshes/a.obj"/>'),
        said="mesh a of link plate reaches down",
        files={"meshes/a.obj": CUBE},
    ),
    "model is xacro": Fault(
        parts=['<xacro:include filename="a.xacro"/>', base()],
        said="is xacro; run `xacro rover.urdf > robot.urdf`",
    ),
    "size is no number": Fault(
        parts=[base('<box size="a"/>')],
        said=r"rover\.urdf: XML Error: .*Element 'box', line 1$",
    ),
    "hinge is turned": Fault(
        parts=[base(), link("paddle", 1), HINGE],
        said="'paddle': must have its hinge along the chassis' y",
        text=PADDLE,
    ),
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_what_is_wrong_is_said_in_one_line_that_names_it(tmp_path, fault):
    for name, content in (fault.files or {}).items():
        file = tmp_path / "rover_description" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content)
    file = write(tmp_path, fault.parts, TRACKS + fault.text)
    with pytest.raises(TrackslipError, match=fault.said):
        build_tracked(load_tracked(file))


RADAR = [link("radar", 1, '<box size="0.3 0.1 0.1"/>'), joint("base", "radar", "0 0 0.2")]


@pytest.mark.parametrize(
    ("parts", "wheels", "said"),
    [
        ([base()], '"replace"', "wheels = replace: must be round links .* found are none"),
        (
            rover()[:-2],
            '"replace"',
            "on the left are left_front, left_rear, on the right right_front; list",
        ),
        (rover(), '"all"', "wheels = 'all': must be \"replace\" or a list"),
        (rover(), ["left_frnt"], "wheels = 'left_frnt': must be links of the model, such as base"),
        (
            rover(),
            ["left_front", "right_front"],
            "left_front, right_front are on one axle: must be on two or more: give the `hull`",
        ),
        (
            rover(heights=(0.0, 0.02, 0.0, 0.0)),
            '"replace"',
            r"left_rear is at x = -0\.2, y = 0\.25, z = 0\.02 m .*, right_rear is at .* z = 0 m",
        ),
        (
            [*rover(), *RADAR],
            [*LISTED, "radar"],
            "'radar': turns endlessly, must be round to be a wheel",
        ),
    ],
)
def test_wheels_that_tell_no_hull_are_refused(tmp_path, parts, wheels, said):
    with pytest.raises(TrackslipError, match=said):
        load_tracked(write(tmp_path, parts, f"wheels = {wheels}\n"))


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (rover(wheel=""), "left_front, left_rear, .* turn endlessly, but have no shape"),
        (
            rover(wheel='<box size="0.2 0.1 0.05"/>'),
            "left_front, left_rear, .* turn endlessly, but aren't round",
        ),
        (rover(**LIMITS), "left_front, left_rear, .* are round, but their hinges have limits"),
        (rover(kind="fixed"), "left_front, left_rear, .* are round, but have no hinge about y"),
    ],
)
def test_links_like_wheels_say_what_they_lack(tmp_path, parts, said):
    with pytest.raises(TrackslipError, match=said):
        load_tracked(write(tmp_path, parts))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (POINTER, "is a Git LFS pointer"),
        (
            '<mujoco><asset><texture name="p" type="2d" file="p.png"/></asset></mujoco>',
            "'p' needs p.png, but it",
        ),
        (
            '<?xml version="1.0"?><!-- <robot --><sdf version="1.7"/>',
            r"is SDF; run `sdf2mjcf r\.xml robot\.xml` of gz-mujoco",
        ),
        ("<scene/>", "is XML of <scene>; `model` must be an MJCF .* or"),
        ("#usda 1.0", "is no XML"),
        ('<robot name="r"><wheels_macro/></robot>', "has no links; .* called as <xacro:NAME/>"),
    ],
)
def test_files_that_are_no_models_are_named(tmp_path, text, said):
    (tmp_path / "r.xml").write_text(text)
    (tmp_path / "p.png").write_text(POINTER)
    (tmp_path / "r.toml").write_text('model = "r.xml"\n' + TRACKS)
    with pytest.raises(TrackslipError, match=rf"r\.xml: .*{said}"):
        build_tracked(load_tracked(tmp_path / "r.toml"))


@pytest.mark.parametrize("unit", ["0.1", "2.54e-2", "1", ""])
def test_a_converted_mesh_has_the_unit_of_its_dae_or_is_refused(tmp_path, unit):
    meshes = tmp_path / "rover_description" / "meshes"
    meshes.mkdir(parents=True)
    meter = f'<unit name="u" meter="{unit}"/>' if unit else ""
    (meshes / "wheel.dae").write_text(f"<COLLADA><asset>{meter}</asset></COLLADA>")
    (meshes / "wheel.obj").write_text(CUBE)
    file = write(tmp_path, rover('<mesh filename="../meshes/wheel.dae"/>'))
    if unit in ("1", ""):
        assert load_tracked(file).hull[0][2] == pytest.approx(0.1)
        return
    said = f"wheel.dae is in units of {unit} m, and wheel.obj has no unit: name"
    with pytest.raises(TrackslipError, match=said):
        load_tracked(file)
    named = rover(f'<mesh filename="../meshes/wheel.obj" scale="{unit} {unit} {unit}"/>')
    robot = load_tracked(write(tmp_path, named))
    assert robot.hull[0][2] == pytest.approx(0.1 * float(unit), rel=1e-3)


def fixed(part, parent="base", place="0 0 0"):
    name = re.search('name="(.*?)"', part)[1]
    return [part, joint(parent, name, place, "fixed")]


def on_hubs():
    """A rover with a hub on each wheel, which reaches further in than the wheel."""
    parts = rover()
    for name, (_, y) in WHEELS.items():
        hub = link(f"{name}_hub", 1, '<sphere radius="0.03"/>')
        parts += fixed(hub, name, f"0 {-0.4 * y} 0")
    return parts


def with_rollers():
    """A rover whose wheels are a hair apart in height, and rollers above them a hair apart in x."""
    parts = rover(heights=HAIR)
    for (name, (x, y)), off in zip(WHEELS.items(), HAIR, strict=True):
        parts.append(link(f"{name}_r", 1, '<sphere radius="0.03"/>'))
        parts.append(joint("base", f"{name}_r", f"{x + off} {y} 0.12"))
    return parts


def replaced(parts, old, new):
    """The parts, with a regular expression replaced in each."""
    return [re.sub(old, new, part) for part in parts]


HAIR = (1e-4, 0.0, 0.0, 1e-4)
LYING = r'<origin rpy="1.5707963 0.7 0" xyz="0 0 0"/><geometry><cyl'
HUB_NAMES = [f"{name}_hub" for name in LISTED]
BLOCK = fixed(link("block", 1, '<box size="0.3 0.3 0.3"/>', "0 0.2 0.2"))
BELT = fixed(link("belt", 1, '<box size="0.6 0.1 0.2"/>', "0 0.25 0.02"))


@pytest.mark.parametrize(
    ("parts", "wheels"),
    [
        (rover(**ENDLESS), '"replace"'),
        (replaced(rover(CYLINDER), '<origin xyz="0 0 0"/><geometry><cyl', LYING), '"replace"'),
        (rover('<mesh filename="package://rover_description/wheel.obj"/>'), '"replace"'),
        (on_hubs(), LISTED + HUB_NAMES),
        ([*rover(kind="fixed", parent="block"), *BLOCK, *BELT], [*LISTED, "belt", "block"]),
        ([*rover(), *fixed(link("rider", 0, '<box size="1 1 1"/>', "0 0 1"))], '"replace"'),
        (
            replaced(rover(), 'xyz="0 0 0"/><geo', 'xyz="0 0 0" rpy="0 0.7 0"/><geo'),
            '"replace"',
        ),
        (replaced(rover(), '<inertial><mass value="1"/>.*?</inertial>', ""), '"replace"'),
        (replaced(rover(), 'mass value="1"', 'mass value="0"'), '"replace"'),
        (with_rollers(), '"replace"'),
        ([*rover(), *TIPPED], f'"replace"\n{PADDLE}'),
    ],
)
def test_tracks_replace_the_wheels(tmp_path, parts, wheels):
    package = tmp_path / "rover_description"
    package.mkdir()
    (package / "wheel.obj").write_text(CUBE)
    robot = load_tracked(write(tmp_path, parts, f"wheels = {wheels}\n"))
    assert set(WHEELS) <= set(robot.wheels)
    assert robot.half_gauge == pytest.approx(0.25, abs=1e-4)
    largest = sorted(robot.hull, key=lambda wheel: (-wheel[2], wheel[0]))[:2]
    np.testing.assert_allclose(largest, [(-0.2, 0, 0.1), (0.2, 0, 0.1)], atol=2e-4)
    with warnings.catch_warnings(action="error"):  # nothing is left that swings
        made = build_tracked(robot)
    stated = re.findall('mass value="(.*?)"', "".join(parts))
    mass = sum(map(float, stated))
    assert made.model.body_subtreemass[made.body] == pytest.approx(mass)
    assert made.model.nv == 6 + len(robot.flippers)


def on_rockers(axis, options):
    """A rover whose wheels hang on two rockers, one of each side, with near-square plates near the
    middle.
    """
    parts = [link("base", 10, '<box size="0.4 0.2 0.05"/>', "0 0 0.15")]
    for side, sign in SIDES.items():
        rocker = f"{side}_rocker"
        hinge = joint("base", rocker, f"0 {0.2 * sign} 0", **options)
        parts.append(link(rocker, 1, '<box size="0.2 0.04 0.19"/>', "0 0 0.05"))
        parts.append(hinge.replace("0 1 0", axis))
        parts += hung_wheel(f"{side}_front", rocker, sign)
        parts += hung_wheel(f"{side}_rear", rocker, sign)
    return parts


def on_bogies(options):
    """A rover whose front wheels hang on rockers, and the rear ones on bogies of these rockers."""
    parts = [link("base", 10, '<box size="0.4 0.2 0.05"/>', "0 0 0.15")]
    for side, sign in SIDES.items():
        rocker = f"{side}_rocker"
        bogie = f"{side}_bogie"
        parts.append(link(rocker, 1, '<box size="0.2 0.04 0.19"/>', "0 0 0.05"))
        parts.append(joint("base", rocker, f"0 {0.2 * sign} 0", **options))
        parts.append(link(bogie, 1, '<cylinder radius="0.12" length="0.02"/>', "0 0 0.1"))
        parts.append(joint(rocker, bogie, "0 0 0", **options))
        parts += hung_wheel(f"{side}_front", rocker, sign)
        parts += hung_wheel(f"{side}_rear", bogie, sign)
    return parts


def hung_wheel(name, carrier, sign):
    """A wheel 0.1 m outside its carrier."""
    x, _ = WHEELS[name]
    hinge = joint(carrier, name, f"{x} {0.1 * sign} 0")
    return [link(name, 1, '<sphere radius="0.1"/>'), hinge]


@pytest.mark.parametrize(
    ("parts", "held"),
    [
        pytest.param(on_rockers("0 1 0", LIMITS), 2, id="rockers with limits"),
        pytest.param(on_rockers("0 1 0", LOOSE), 2, id="endless rockers"),
        pytest.param(on_rockers("0 0 1", LIMITS), 2, id="knuckles"),
        pytest.param(on_bogies(LIMITS), 4, id="bogies"),
    ],
)
def test_what_carries_wheels_holds_and_is_no_wheel(tmp_path, parts, held):
    robot = load_tracked(write(tmp_path, parts))
    assert robot.half_gauge == pytest.approx(0.3)
    assert robot.lowest == pytest.approx(-0.1)
    np.testing.assert_allclose(robot.hull, [(-0.2, 0, 0.1), (0.2, 0, 0.1)])
    built = build_tracked(robot)
    assert len(built.joints.held) == held
    assert set(built.joints.held.values()) == {0.0}


def test_belts_around_wheels_on_bogies_that_swing_are_refused(tmp_path):
    text = f'wheels = {LISTED}\n{TRACKS}[joints]\n"*_rocker_joint" = "free"\n'
    file = write(tmp_path, on_rockers("0 1 0", LIMITS), text)
    with pytest.raises(TrackslipError, match=r"'left_front': hangs on 'left_rocker', .*\[\[tracks"):
        build_tracked(load_tracked(file))


def test_a_rover_on_its_own_wheels_turns_as_theory_says(tmp_path):
    file = write(tmp_path, rover(), 'contact = "wheels"\nwheels = "replace"\npatch_length = 0.05\n')
    parameters, _ = load_parameters(file)
    assert parameters.axles == (-0.2, 0.2)
    assert parameters.half_gauge == 0.25
    assert parameters.contact_length == 0.45
    speeds = np.array([0.1, 0.2])
    made = build_tracked(load_tracked(file))
    model = made.model
    data = mujoco.MjData(model)
    data.qpos[made.free[0] + 2] = -made.robot.lowest
    made.belts.set(speeds)
    mujoco.mj_step(model, data, 1500)
    start = np.zeros((1, 3))
    fleet = Fleet(load_robot(parameters), start, Ground(0.7, 0.7), 0.0, tireless())
    fleet.command(speeds / parameters.sprocket_radius)
    fleet.advance(3.0)
    contact = parameters.contact_theory(0.7, 0.7)
    expected = steady_twist(speeds, contact, 9.81)[2]
    assert fleet.twist()[0, 2] == pytest.approx(expected, rel=1e-3)
    assert data.qvel[5] == pytest.approx(expected, rel=2e-3)
    looks = robot_looks(parameters)
    assert not any(look.belted for *_, look in looks.tracks)


MJCF_ROVER = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body pos="0 0 1" euler="0 0 90"><freejoint/>
<geom name="g" type="box" size=".2 .1 .05" pos="0 0 .2"/>{wheels}</body></worldbody>
<tendon><fixed name="t"><joint joint="left_rear" coef="1"/></fixed></tendon>
<contact><pair geom1="floor" geom2="g"/></contact>
<actuator>{motors}<motor tendon="t"/></actuator><sensor>{sensors}</sensor></mujoco>"""


def test_wheels_of_an_mjcf_go_with_their_motors_and_sensors(tmp_path):
    wheels = motors = sensors = ""
    for name, (x, y) in WHEELS.items():
        hinge = f'<joint name="{name}" axis="0 1 0"/>'
        wheels += f'<body name="{name}" pos="{x} {y} 0">{hinge}<geom size="0.1"/></body>'
        motors += f'<velocity name="m{name}" joint="{name}"/>'
        sensors += f'<jointpos joint="{name}"/><actuatorfrc actuator="m{name}"/>'
    text = MJCF_ROVER.format(wheels=wheels, motors=motors, sensors=sensors)
    (tmp_path / "r.xml").write_text(text)
    file = tmp_path / "r.toml"
    file.write_text('model = "r.xml"\nwheels = "replace"\n')
    model = build_tracked(load_tracked(file)).model
    assert model.nv == 6
    assert model.nu == 0
    assert model.ntendon == 0
    parameters, _ = load_parameters(str(file))
    drawn = robot_looks(parameters).model.body("robot/unnamed_body1")
    np.testing.assert_allclose(drawn.pos, [0, 0, 0.1], atol=1e-9)
    np.testing.assert_allclose(drawn.quat, [1, 0, 0, 0], atol=1e-9)


BOX = """<worldbody><body name="b"><freejoint/>
<geom type="box" size=".2 .1 .05" pos="0 0 .2"/></body></worldbody>"""
STEP = '<option timestep="0.002"/>'


@pytest.mark.parametrize(
    ("text", "step"),
    [
        (STEP, 0.002),
        ('<include file="part.xml"/>', 0.002),
        (f"<!-- {STEP} -->", 0.004),
        ("<option/>", 0.004),
    ],
)
def test_a_stated_physics_step_is_kept(tmp_path, text, step):
    (tmp_path / "part.xml").write_text(f"<mujoco>{STEP}</mujoco>")
    (tmp_path / "b.xml").write_text(f"<mujoco>{text}{BOX}</mujoco>")
    mjcf = tmp_path / "b.toml"
    mjcf.write_text('model = "b.xml"\n' + TRACKS.replace("0.0, 0.1", "0.1, 0.1"))
    files = [mjcf]
    if "include" not in text:  # a URDF can't include
        files.append(write(tmp_path, [base(), f"<mujoco>{text}</mujoco>"], TRACKS))
    for file in files:
        assert build_tracked(load_tracked(file), preset="fast").model.opt.timestep == step


def test_a_check_says_at_once_what_is_known_left_out_and_wrong(tmp_path):
    arm = link("arm", 1, '<mesh filename="package://gone/arm.stl"/>')
    mast = link("mast", 1, '<mesh filename="package://gone/mast.stl"/>')
    fan = link("fan", 0, '<sphere radius="0.01"/>')
    eye = link("eye", 0, look="eye.dae")
    _, *plate = below('<box size="0.3 0.1 0.02"/>')
    parts = [*rover(), *plate]
    parts += [arm, joint("base", "arm", "0 0 0.3")]
    parts += [fan, joint("base", "fan", "0 0 0.5", **LIMITS)]
    parts += fixed(mast, place="0 0 0.3")
    parts += fixed(eye)
    checked = check(write(tmp_path, parts, f"wheels = {LISTED}\n"))
    for said in (
        "link 'arm' needs",
        "link 'mast' needs",
        "a geom of link plate reaches down to -0.12 m",
    ):
        assert sum(said in line for line in checked.errors) == 1
    assert len(checked.errors) == 3
    for said in (
        "without 1 mesh file (eye.dae)",
        "without <inertial>, fan, weigh as water",
    ):
        assert sum(said in line for line in checked.warnings) == 1
    facts = dict(checked.facts)
    assert facts["contact"] == "tracks, half gauge 0.25 m, 0.4 m long"
    assert facts["mass"].startswith("16 kg")
    assert facts["joints that hold"] == "arm_joint at 0, fan_joint at 0"
    assert not checked.file
    assert not check("rescue").errors
    assert not check("warthog").errors


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        (
            [base(), '<link name="pan"/>', joint("base", "pan", "0 0 0.4", **LIMITS)],
            "link 'pan' moves, but weighs nothing: give it <inertial> .* or make its joint type=",
        ),
        (
            [base(), *[link("arm", 1), joint("base", "arm", "0 0 0.4", **LIMITS)] * 60],
            r"<link> name = arm: 60 of 'arm', must be unique$",
        ),
        (
            [base(), link("a", 1), link("b", 1), *[joint("base", "a", "0 0 0.4", **LIMITS)] * 2],
            r"<joint> name = a_joint: 2 of 'a_joint', must be unique$",
        ),
        ([link("base", -50)], r"link 'base': mass = -50: must be at least 0 kg$"),
        (
            ['<link name="base"><inertial><mass value="${m}"/></inertial></link>'],
            r"link 'base': <mass> value = '\$\{m\}': is xacro; run `xacro` on",
        ),
        (
            [base(), link("a", 1), joint("bas", "a", "0 0 0.4")],
            r"joint 'a_joint': parent = 'bas': must be a link of the model, such as base, a$",
        ),
        *[
            (
                ['<link name="odom"/>', joint("odom", "base", "0 0 0", kind), base()],
                rf"joint 'base_joint': type = '{kind}': must be \"fixed\", .* leave out the joint",
            )
            for kind in ("floating", "planar")
        ],
    ],
)
def test_faults_of_a_model_are_said_in_one_short_line(tmp_path, parts, said):
    with pytest.raises(TrackslipError, match=said) as refused:
        build_tracked(load_tracked(write(tmp_path, parts, TRACKS)))
    assert len(str(refused.value)) < 300


@pytest.mark.parametrize("limit", ["1.79e308", "1.8e308", "1e400"])
def test_limits_beyond_all_numbers_are_none(tmp_path, limit):
    endless = f'<limit lower="-{limit}" upper="{limit}" effort="{limit}" velocity="{limit}"/>'
    parts = [base(), link("paddle", 1), joint("base", "paddle", "0.2 0.3 0", "revolute", endless)]
    with warnings.catch_warnings(action="error"):
        built = build_tracked(load_tracked(write(tmp_path, parts, TRACKS + PADDLE)))
    np.testing.assert_allclose(built.flipper_range, [[-np.pi, np.pi]])


def test_a_robot_too_heavy_ahead_is_told_its_way_on(tmp_path):
    parts = [*rover(), link("nose", 9, "", "0 0 0"), joint("base", "nose", "0.6 0 0.2", "fixed")]
    with pytest.raises(
        TrackslipError,
        match=r"rover\.urdf: com_x = .*: fold its arm by \[joints\] or `key`; ",
    ):
        load_parameters(write(tmp_path, parts))


@pytest.mark.parametrize(
    "repeated",
    [
        '<ros2_control name="all" type="system"><joint name="left_rear_joint"/></ros2_control>',
        '<transmission name="one"><joint name="left_rear_joint"/></transmission>',
        '<gazebo><plugin name="p"><link name="base"/></plugin></gazebo>',
    ],
)
def test_other_elements_may_repeat_names_of_joints(tmp_path, repeated):
    robot = load_tracked(write(tmp_path, [*rover(), repeated]))
    assert robot.half_gauge == pytest.approx(0.25)


ONE_AXLE = '[[tracks]]\nwheels = ["left_front", "right_front"]\ncontact = "wheels"\n'
LEFT_ONLY = '[[tracks]]\nsides = "left"\nwheels = ["left_front", "left_rear"]\n'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ONE_AXLE, "but its wheels from left_front, right_front stand on one axle only; `track"),
        (LEFT_ONLY, "but its only running gear is on the side 'left'; `trackslip drive` and"),
    ],
)
def test_what_flat_ground_lacks_is_said_in_plain_words(tmp_path, text, said):
    with pytest.raises(TrackslipError, match=said):
        load_parameters(write(tmp_path, rover(), text))


@pytest.mark.parametrize(("gravity", "is_said"), [("0 0 -1.62", True), ("0 0 -9.83", False)])
def test_flat_ground_warns_of_gravity_that_it_leaves_out(tmp_path, gravity, is_said):
    place = f'<mujoco><option gravity="{gravity}"/></mujoco>'
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        load_parameters(write(tmp_path, [*rover(), place]))
    lines = [str(each.message) for each in said]
    expected = "its gravity, (0, 0, -1.62) m/s^2, counts on terrain; flat ground has (0, 0, -9.81)"
    assert any(expected in line for line in lines) == is_said


def test_rounding_puts_no_centre_of_mass_off_the_middle(tmp_path):
    """As of wheels whose places aren't binary fractions."""
    parameters, _ = load_parameters(write(tmp_path, rover()))
    assert parameters.com_y == 0.0
    assert flat.without_rounding(-2e-19) == 0.0
    assert flat.without_rounding(-2e-6) == -2e-6


def test_motors_without_limits_have_no_numbers_in_the_robot_file(tmp_path):
    checked = check(write(tmp_path, rover(), 'wheels = "replace"\n[drive]\n'))
    assert "top_speed = 0.6" in checked.file
    assert "torque_limit" not in checked.file
    assert "[drive.motor]" not in checked.file


def stl_of_a_wheel(radius, width, corners=64):
    """A binary .stl of a disc about y: two triangles per corner for its rim, one per side."""
    angle = np.linspace(0.0, 2 * np.pi, corners + 1)
    rim = radius * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    half = np.array([0.0, width / 2, 0.0])
    left = rim + half
    right = rim - half
    left_middle = np.broadcast_to(half, (corners, 3))
    right_middle = np.broadcast_to(-half, (corners, 3))
    faces = [
        np.stack([left[:-1], left[1:], right[:-1]], axis=1),
        np.stack([right[:-1], left[1:], right[1:]], axis=1),
        np.stack([left_middle, left[1:], left[:-1]], axis=1),
        np.stack([right_middle, right[:-1], right[1:]], axis=1),
    ]
    face = np.dtype([("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("rest", "<u2")])
    stored = np.zeros(4 * corners, face)
    stored["points"] = np.concatenate(faces)
    header = bytes(80)
    count = len(stored).to_bytes(4, "little")
    return header + count + stored.tobytes()


@pytest.mark.parametrize(("scale", "is_refused"), [("1 1 1", True), ("0.001 0.001 0.001", False)])
def test_a_mesh_in_mm_is_named_with_its_scale(tmp_path, scale, is_refused):
    """A wheel of a radius of 100."""
    content = stl_of_a_wheel(radius=100.0, width=60.0)
    shape = f'<mesh filename="wheel.stl" scale="{scale}"/>'
    file = write(tmp_path, rover(shape))
    (tmp_path / "rover_description" / "urdf" / "wheel.stl").write_bytes(content)
    errors = check(file).errors
    said = (
        "mesh wheel.stl of link 'left_front' is 200 m long, must be at most 20 m; if its numbers "
        'are in mm, state scale="0.001 0.001 0.001"'
    )
    assert any(said in line for line in errors) == is_refused
    assert bool(errors) == is_refused
