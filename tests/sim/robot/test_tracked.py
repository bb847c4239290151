from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tracked_files import ROBOT, URDF, write_robot

from sim import Flipper, TrackedRobot, Traverse, check
from sim.robot.check import RobotCheck
from sim.robot.looks import robot_looks
from sim.robot.named import ROBOTS, load_parameters, load_tracked
from sim.robot.tracked_model import build_tracked, clear_angles
from sim.terrain import load_course
from sim.tracks import Belts
from trackslip.errors import RobotWarning, TrackslipError

G = 9.81


@pytest.fixture(scope="module")
def rescue():
    return build_tracked(load_tracked("rescue"))


@pytest.mark.parametrize("name", ROBOTS)
def test_shipped_robots_stand_on_their_tracks(name):
    made = build_tracked(load_tracked(name))
    model = made.model
    data = mujoco.MjData(model)
    data.qpos[made.free[0] + 2] = -made.robot.lowest
    data.qpos[made.flipper_qpos] = made.flipper_control(np.full(len(made.flipper_sign), 1.0))
    data.ctrl[made.flipper_motor] = data.qpos[made.flipper_qpos]
    belts = Belts(model)
    for _ in range(500):
        mujoco.mj_step(model, data)
    load = belts.read(data).load
    weight = G * model.body_subtreemass[made.body]
    assert load[:2].sum() == pytest.approx(weight, rel=2e-3)
    assert (load[2:] == 0).all()
    assert load[0] == pytest.approx(load[1], rel=1e-3)


def test_a_urdf_gets_a_free_joint_and_a_motor(tmp_path):
    made = build_tracked(load_tracked(write_robot(tmp_path)), load_course("flat"))
    assert made.robot.name == "mine"
    assert made.model.nq == 8
    assert made.model.nu == 1
    assert made.flipper_sign.tolist() == [-1.0]
    assert made.flipper_range.tolist() == [[-1.0, 1.0]]
    assert made.track_side.tolist() == [0, 1, 0]
    assert made.model.body_subtreemass[made.body] == pytest.approx(21.0)


def test_the_scene_and_states_of_the_model_stay_behind(tmp_path):
    model = URDF.replace("</robot>", '<mujoco><compiler fusestatic="true"/></mujoco></robot>')
    made = build_tracked(load_tracked(write_robot(tmp_path, model=model)))
    assert made.model.body(made.body).name == "base"
    xml = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><light pos="0 0 1"/>
    <body name="b"><freejoint/><geom type="box" size="0.2 0.1 0.05" pos="0 0 0.2"/></body>
    </worldbody>
    <keyframe><key qpos="0 0 1 1 0 0 0"/></keyframe></mujoco>"""
    (tmp_path / "scene.xml").write_text(xml)
    text = ROBOT.split("[[flippers]]")[0].replace("mine.urdf", "scene.xml")
    made = build_tracked(load_tracked(write_robot(tmp_path, text)), load_course("flat"))
    model = made.model
    assert "floor" not in [model.geom(k).name for k in range(model.ngeom)]
    assert model.nkey == 0
    assert model.nlight == 0


def bent_down(flipper, angle):
    """A flipper whose hull is turned down by an angle [rad] around its hinge."""
    hull = [(x * np.cos(angle), -abs(x) * np.sin(angle), radius) for x, _, radius in flipper.hull]
    return replace(flipper, hull=hull)


def test_flippers_start_clear_of_the_ground(rescue):
    """The wheel at the tip, 0.04 m, 0.245 m from the hinge at 0.08 m, just clears the ground at
    -asin(0.04 / 0.245).
    """
    assert not clear_angles(rescue).any()
    bend = 0.6
    flippers = tuple(bent_down(flipper, bend) for flipper in rescue.robot.flippers)
    lifted = clear_angles(build_tracked(replace(rescue.robot, flippers=flippers)))
    least = bend - np.arcsin(0.04 / 0.245)
    assert (lifted >= least - 1e-9).all()
    assert (lifted <= least + 2.6 / 60).all()


MASKED = """<mujoco><worldbody>
<body name="base"><freejoint/><geom type="box" size=".2 .1 .1" {}="0" mass="9"/>
<body name="arm" pos=".2 .3 .1"><joint axis="0 1 0"/><geom size=".01"/></body></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (URDF, MASKED.format("contype"), r"reaches down to -0\.1 m"),
        (URDF, MASKED.format("conaffinity"), r"reaches down to -0\.1 m"),
        ("0 0 0.14", "0 0 nan", r"mine\.urdf: <origin> xyz = '0 0 nan': numbers must be finite"),
        ("</robot>", "", r"mine\.urdf: not XML \(no element found"),
        ("mine.urdf", "x" * 5000, "no such file"),
        ("mine.urdf", "gone.urdf", r"gone.urdf: no such file; `model` must name"),
        (
            'body = "arm"',
            'body = "leg"',
            "flippers: body = 'leg': must be links of the model, such as base, arm",
        ),
        ('body = "arm"', 'body = "base"', "body = 'base': must have one joint, a hinge"),
        (
            'side = "left"',
            'side = "right"',
            "side of 'arm' = 'right': lies at y = 0.3 m, on the other",
        ),
        (
            "</robot>",
            '<mujoco><option gravity="0 0 0"/></mujoco></robot>',
            "must have gravity downwards",
        ),
        (
            "half_gauge",
            'body = "arm"\nhalf_gauge',
            "body = 'arm': must be one that lies in the world: base",
        ),
        (
            "0.1, 0.1]",
            "0.3, 0.1]",
            "geom .* reaches down to 0.09 m .* above the tracks' lowest point, at 0.2 m",
        ),
    ],
)
def test_robots_that_cannot_be_built(tmp_path, old, new, said):
    file = write_robot(tmp_path, ROBOT.replace(old, new), URDF.replace(old, new))
    with pytest.raises(TrackslipError, match=said):
        build_tracked(load_tracked(file))


HULL = ((-0.2, 0.1, 0.1), (0.2, 0.1, 0.1))
FLIPPER = Flipper("arm", "left", hull=HULL)
PAIR = {"half_gauge": 0.2, "hull": HULL}


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({}, "half_gauge, hull = None: must be given, unless `wheels`, .* tell it"),
        ({"hull": HULL}, "half_gauge = 0.0: must be a finite number > 0"),
        ({"half_gauge": 0.2}, r"hull = \[\]: must be from 2 to 100 wheels"),
        ({**PAIR, "half_gauge": -0.2}, "half_gauge = -0.2: must be a finite number > 0"),
        ({**PAIR, "width": 0.0}, "width = 0.0: must be a finite number > 0"),
        ({**PAIR, "offset": np.inf}, "offset = inf: must be a finite number"),
        ({**PAIR, "flippers": (FLIPPER, FLIPPER)}, "flippers = .*: must be on bodies that are all"),
    ],
)
def test_running_gear_that_cannot_be_is_refused(fields, said):
    with pytest.raises(TrackslipError, match=rf"^{said}"):
        TrackedRobot(Path("robot.urdf"), **fields)


def test_a_robot_may_stand_on_its_flippers_alone():
    other = replace(FLIPPER, y=0.1)  # two belts on one body, at different places
    robot = TrackedRobot(Path("robot.urdf"), flippers=(FLIPPER, other))
    assert [each.y for each in robot.gear] == [0.0, 0.1]


@pytest.mark.parametrize(
    ("table", "motors"),
    [
        ("", "unlimited, without a table [drive]"),
        ("[drive]\n", "unlimited, by the table [drive]"),
        ("[drive]\ntorque_limit = 20.0\n", "20 N m a side"),
    ],
)
def test_a_check_tells_weight_and_what_a_slope_takes(tmp_path, table, motors):
    """A chassis of 20 kg and an arm of 1 kg, (0.3, 0.3, -0.02) m from it, on sprockets of 0.1 m."""
    text = ROBOT.replace("[[flippers]]", f"{table}[[flippers]]")
    facts = dict(check(write_robot(tmp_path, text)).facts)
    assert facts["mass"] == (
        f"21 kg, {0.3 / 21:+.3f} m ahead, {0.3 / 21:+.3f} m left, "
        f"{0.12 - 0.02 / 21:.3f} m above the ground"
    )
    reduced = 20 * 1 / 21
    tipping = 0.51 + reduced * (0.3**2 + 0.02**2)
    turning = 0.51 + reduced * (0.3**2 + 0.3**2)
    inertia = f"{tipping:.3g}, {tipping:.3g}, {turning:.3g} kg m^2 about x, y, z"
    assert facts["inertia"] == inertia
    needed = 21 * G * np.sin(np.radians(20)) * 0.1 / 2
    assert facts["motors"] == f"{motors}; 20 degrees uphill take {needed:.3g} N m a side"
    assert facts["contact"] == "tracks, half gauge 0.2 m, 0.4 m long"
    assert facts["what collides"] == "1 shape"
    assert facts["joints with motors"] == "shoulder"
    assert facts["flippers"] == "arm"
    for name in ("links replaced", "joints that hold", "joints that swing freely"):
        assert facts[name] == "none"


def test_a_check_in_words_ends_with_the_file():
    checked = RobotCheck((("mass", "1 kg"),), ("is light",), ("has no tracks",), "name = 'a'\n\n")
    assert str(checked).splitlines() == [
        "mass: 1 kg",
        "warning: is light",
        "error: has no tracks",
        "",
        "# the robot file that says all of this",
        "name = 'a'",
    ]
    assert str(replace(checked, file="")).splitlines()[-1] == "error: has no tracks"


ARM = """<mujoco><default><default class="big"><joint armature="0.1" damping="20" range="-180 180"/>
  <position kp="3000" forcerange="-150 150"/></default></default>
  <worldbody><body name="base" pos="0 0 0.1"><freejoint/>
  <geom type="box" size="0.3 0.15 0.05" pos="0 0 0.12" mass="25"/>
  <body name="wheel" pos="0 0 0.2">
    <joint name="spin" axis="0 1 0"/><geom size="0.02" mass="0.1"/></body>
  <body name="upper" pos="0.2 0 0.33"><joint name="lift" class="big" axis="0 -1 0"/>
    <geom type="capsule" size="0.05" fromto="0 0 0 0.42 0 0" mass="8"/>
    <body name="fore" pos="0.42 0 0"><joint class="big" axis="0 -1 0"/>
    <geom type="capsule" size="0.04" fromto="0 0 0 0.4 0 0" mass="5"/></body></body>
  </body></worldbody><actuator><velocity name="spin" joint="spin"/>
  <position class="big" name="lift" joint="lift"/></actuator>
  <keyframe><key qpos="0 0 0 1 0 0 0 0 0 0"/>
  <key name="home" qpos="9 9 9 1 0 0 0 0.5 1.57 2.9" ctrl="1 1.57"/></keyframe></mujoco>"""


def test_runs_begin_in_a_keyframe(tmp_path):
    (tmp_path / "arm.xml").write_text(ARM)
    tracks = 'model = "arm.xml"\nwheels = ["wheel"]\nhalf_gauge = 0.22\n'
    tracks += "hull = [[-0.4, 0.08, 0.08], [0.4, 0.08, 0.08]]\n"
    without = tmp_path / "arm.toml"
    without.write_text(tracks)
    plain = load_tracked(without)
    unused = 'its keyframes, unnamed_key0, home, are not used.*; key = "unnamed_key0" in'
    with pytest.warns(RobotWarning, match=unused):
        assert build_tracked(plain).model.nkey == 0
    checked = check(without)
    assert not checked.errors
    (line,) = (line for line in checked.warnings if "flat ground" in line)
    assert line.startswith("not for flat ground: ")
    assert "arm.xml: com_x = 0.19" in line
    unknown = "key = 'hom': must be one of its keyframes, unnamed_key0, home"
    with pytest.raises(TrackslipError, match=unknown):
        build_tracked(replace(plain, key="hom"))

    home = tmp_path / "home.toml"
    home.write_text(f'{tracks}key = "home"\n')
    course = load_course("flat")
    world = Traverse(load_tracked(home), [course], 2)
    np.testing.assert_allclose(world.batch.qpos[:, 7:], [[1.57, 2.9]] * 2)
    np.testing.assert_allclose(world.batch.ctrl, [[1.57]] * 2)
    assert world.batch.qpos[0, 0] == course.start[0]

    parameters, _ = load_parameters(str(home))
    elbow = 0.2 + 0.42 * np.cos(1.57)
    upper_middle = (0.2 + elbow) / 2
    fore_middle = elbow + 0.2 * np.cos(1.57 + 2.9)
    arm = (8 * upper_middle + 5 * fore_middle) / (25 + 0.1 + 8 + 5)
    assert parameters.com_x == pytest.approx(arm, abs=1e-6)
    np.testing.assert_allclose(robot_looks(parameters).rest[-2:], [1.57, 2.9])


LINK = """<link name="{name}"><inertial><origin xyz="{place}"/><mass value="{mass}"/>
<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
HINGE = """<joint name="j{name}" type="revolute"><parent link="base"/><child link="{name}"/>
<origin xyz="{place}"/><axis xyz="0 1 0"/>
<limit lower="-3.1" upper="3.1" effort="{torque}" velocity="10"/></joint>
"""
ENTRY = """[[flippers]]
body = "{name}"
side = "{side}"
hull = [[0.0, 0.0, 0.09], [{tip}, 0.0, 0.03]]
"""


@pytest.mark.parametrize(("torque", "lifts"), [(30, False), (40, True)])
def test_flippers_lift_a_robot_as_far_as_their_torque_allows(tmp_path, torque, lifts):
    """Four flippers of 0.35 m lift 40 kg off its tracks with 34 N m each."""
    urdf = LINK.format(name="base", place="0 0 0.15", mass=36, inertia=1.0)
    text = 'model = "r.urdf"\nhalf_gauge = 0.2\nhull = [[-0.25, 0.09, 0.09], [0.25, 0.09, 0.09]]\n'
    for name, side, forwards, left in (
        ("fl", "left", 1, 1),
        ("fr", "right", 1, -1),
        ("rl", "left", -1, 1),
        ("rr", "right", -1, -1),
    ):
        place = f"{0.25 * forwards} {0.3 * left} 0.09"
        urdf += LINK.format(name=name, place=f"{0.15 * forwards} 0 0", mass=1, inertia=0.01)
        urdf += HINGE.format(name=name, place=place, torque=torque)
        text += ENTRY.format(name=name, side=side, tip=0.35 * forwards)
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{urdf}</robot>')
    (tmp_path / "r.toml").write_text(text)
    tracked = build_tracked(load_tracked(tmp_path / "r.toml"))
    model = tracked.model
    data = mujoco.MjData(model)
    for step in range(2000):
        angle = -0.6 * min(1.0, step / 1000)
        data.ctrl[tracked.flipper_motor] = tracked.flipper_control(np.full(4, angle))
        mujoco.mj_step(model, data)
    assert (data.qpos[2] > 0.01) == lifts
