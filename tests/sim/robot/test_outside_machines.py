"""Machines of others: what their files say is driven, or refused in one line."""

import mujoco
import numpy as np
import pytest
import scipy
from machines import LIMITS, box, drive, joint, patches, wheel, write

from sim import check
from sim.robot.flat import standing
from sim.robot.named import load_tracked
from sim.robot.tracked_model import build_tracked
from trackslip.errors import TrackslipError

TRACKS = "half_gauge = 0.25\nhull = [[-0.3, 0, 0.1], [0.3, 0, 0.1]]\n"
CORNERS = (("fl", 0.25, 0.3), ("fr", 0.25, -0.3), ("rl", -0.25, 0.3), ("rr", -0.25, -0.3))
"""Names and places x, y of four wheels [m]."""

ARM = """<mujoco><worldbody><body name="base" pos="0 0 0.1"><freejoint/>
<geom type="box" size="0.3 0.2 0.1" pos="0 0 0.2" mass="40"/>{bodies}
</body></worldbody>{more}</mujoco>"""
TWO_LINKS = """<body name="upper" pos="0.2 0 0.4"><joint name="j1" axis="0 1 0"{first}/>
<geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="4"/>
<body name="fore" pos="0.5 0 0"><joint name="j2" axis="0 1 0"{second}/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.03" mass="2"/></body></body>"""
FREE_LINKS = TWO_LINKS.format(first="", second="")
COUPLED = '<equality><joint joint1="j2" joint2="j1" polycoef="0 -1 0.5 0 0"/></equality>'
KEY = '<keyframe><key name="home" qpos="0 0 0 1 0 0 0 -1.2 2.4"/></keyframe>'
UNIVERSAL = """<body name="arm" pos="0.2 0 0.4">
<joint name="yaw" axis="0 0 1" range="20 60"/><joint name="pitch" axis="0 1 0" range="-80 -30"/>
<geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="4"/></body>"""


def on_arm(folder, text="", bodies=FREE_LINKS, more=""):
    """A robot file of a box on tracks that carries an arm."""
    (folder / "arm.xml").write_text(ARM.format(bodies=bodies, more=more))
    (folder / "arm.toml").write_text(f'model = "arm.xml"\n{TRACKS}{text}')
    return folder / "arm.toml"


def start_of(file, *joints):
    """Angles of joints at their start, after which nothing may move much or gain energy."""
    built = build_tracked(load_tracked(file))
    model = built.model
    data = standing(built)
    start = [data.joint(name).qpos[0] for name in joints]
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data.qpos[built.free[0] + 2] += 0.001
    mujoco.mj_forward(model, data)
    energy = data.energy.sum()
    for _ in range(200):
        mujoco.mj_step(model, data)
        assert data.energy.sum() < energy + 1e-3
        assert np.abs(data.qvel[6:]).max() < 0.1
    return start


@pytest.mark.parametrize(
    ("text", "more", "start"),
    [
        ("[joints]\nj1 = -1.0\n", COUPLED, (-1.0, 1.5)),
        ('[joints]\nj1 = -1.0\nj2 = "free"\n', COUPLED, (-1.0, 1.5)),
        ("[joints]\nj2 = 1.5\n", COUPLED, (-1.0, 1.5)),
        ('key = "home"\n', KEY, (-1.2, 2.4)),
        ('key = "home"\n[joints]\nj1 = -0.5\n', KEY, (-0.5, 2.4)),
        ('key = "home"\n', KEY + COUPLED, (-1.2, 1.92)),
    ],
)
def test_rules_couplings_and_keyframes_agree_at_the_start(tmp_path, text, more, start):
    file = on_arm(tmp_path, text, more=more)
    assert start_of(file, "j1", "j2") == pytest.approx(start, abs=1e-9)


def test_joints_that_share_a_body_start_within_their_limits(tmp_path):
    file = on_arm(tmp_path, bodies=UNIVERSAL)
    assert np.degrees(start_of(file, "yaw", "pitch")) == pytest.approx([20, -30])
    data = standing(build_tracked(load_tracked(file)))
    ahead = data.body("arm").xmat.reshape(3, 3)[:, 0]
    yaw, pitch = np.radians([20, -30])
    expected = [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)]
    np.testing.assert_allclose(ahead, expected, atol=1e-9)


def test_a_coupling_holds_after_its_references_moved(tmp_path):
    file = on_arm(tmp_path, '[joints]\nj1 = "free"\nj2 = "free"\n', more=COUPLED + KEY)
    file.write_text(file.read_text().replace("[joints]", 'key = "home"\n[joints]'))
    built = build_tracked(load_tracked(file))
    data = standing(built)
    mujoco.mj_step(built.model, data, nstep=60)
    leading = data.joint("j1").qpos[0]
    assert abs(leading + 1.2) > 0.01  # it fell
    assert data.joint("j2").qpos[0] == pytest.approx(0.5 * leading**2 - leading, abs=0.02)


@pytest.mark.parametrize(
    ("bodies", "rules", "said"),
    [
        (
            FREE_LINKS,
            "j1 = -1.0\nj2 = 0.3\n",
            r"j2 = 0\.3: must be 1\.5, as 'j1', which leads it, is",
        ),
        (
            TWO_LINKS.format(first="", second=' range="-30 30"'),
            "j1 = -1.0\n",
            r"j1 = -1: puts 'j2', .* limits, -0\.5236 to",
        ),
        (
            TWO_LINKS.format(first=' range="0 60"', second=""),
            "j2 = 1.5\n",
            r"j2 = 1\.5: must be an angle to which 'j1', which",
        ),
    ],
)
def test_rules_that_contradict_a_coupling_are_refused(tmp_path, bodies, rules, said):
    file = on_arm(tmp_path, f"[joints]\n{rules}", bodies, COUPLED)
    with pytest.raises(TrackslipError, match=said):
        build_tracked(load_tracked(file))


@pytest.mark.parametrize(
    ("first", "start"), [("", (-0.3204, 0.3717)), (' range="0 60"', (0.0, 0.3717))]
)
def test_a_follower_that_no_rule_moves_stays_in_its_limits(tmp_path, first, start):
    bodies = TWO_LINKS.format(first=first, second=' range="21.3 60"')
    file = on_arm(tmp_path, "", bodies, COUPLED)
    assert start_of(file, "j1", "j2") == pytest.approx(start, abs=1e-3)


def height_of_mass(facts):
    """Height of the centre of mass in a check, after "… m left, " [m]."""
    _, _, height = facts["mass"].partition("left, ")
    return float(height.split(" m")[0])


def test_a_check_says_the_angles_of_coupled_joints(tmp_path):
    lifted = dict(check(on_arm(tmp_path, "[joints]\nj1 = -1.0\n", more=COUPLED)).facts)
    assert lifted["joints that hold"] == "j1 at -1, j2 at 1.5"
    level = dict(check(on_arm(tmp_path)).facts)
    assert height_of_mass(lifted) > height_of_mass(level) + 0.02


def on_struts(rule=""):
    """A box on wheels whose struts slide up and down, and its robot file."""
    parts = [box("base", 40, (0.8, 0.3, 0.2), (0, 0, 0.3))]
    limits = LIMITS.format(-0.2, 0.2)
    for name, x, y in CORNERS:
        strut = f"strut_{name}"
        slide = f"{name}_slide"
        parts.append(box(strut, 1, (0.04, 0.04, 0.1), (0, 0, 0.1)))
        parts.append(joint(slide, "prismatic", "base", strut, (x, y, 0), "0 0 1", more=limits))
        parts.append(wheel(name, (0, 0, 0), strut))
    return parts, f'wheels = "replace"\ncontact = "wheels"\n[joints]\n{rule}'


@pytest.mark.parametrize("lift", [-0.08, 0.0, 0.08])
def test_wheels_are_read_where_rules_hold_them(tmp_path, lift):
    file = write(tmp_path, *on_struts(f'"*_slide" = {lift}\n'))
    assert load_tracked(file).lowest == pytest.approx(lift - 0.1)
    stood = drive(file, duration=2.0)
    assert stood.height == pytest.approx(0.1 - lift, abs=2e-3)
    assert stood.load.sum() == pytest.approx(9.81 * 50, rel=0.01)


def on_wheels(*more):
    """Parts of a box on four wheels."""
    parts = [box("base", 50, (0.6, 0.4, 0.2), (0, 0, 0.2)), *more]
    for name, x, y in CORNERS:
        parts.append(wheel(name, (x, y, 0)))
    return parts


def rod(angle):
    """An arm on an endless hinge, lifted by an angle [rad]."""
    place = (0.1, 0.15, 0.4)
    turn = f"0 {-angle} 0"
    shoulder = joint("shoulder", "continuous", "base", "rod", place, "0 1 0", turn)
    return [box("rod", 3, (0.4, 0.04, 0.04), (0.2, 0, 0)), shoulder]


@pytest.mark.parametrize("angle", [0.0, np.pi / 8, np.pi / 4])
def test_a_rod_is_no_wheel_at_any_angle(tmp_path, angle):
    robot = load_tracked(write(tmp_path, on_wheels(*rod(angle)), 'wheels = "replace"\n'))
    assert set(robot.wheels) == {"fl", "fr", "rl", "rr"}
    assert build_tracked(robot).joints.held == {"shoulder": 0.0}


@pytest.mark.parametrize("camber", [-0.25, 0.25])
def test_wide_wheels_with_camber_are_round_about_their_axes(tmp_path, camber):
    """Though they are a fifth higher than long, seen along the axle."""
    parts = [box("base", 50, (0.6, 0.4, 0.2), (0, 0, 0.2))]
    for name, x, y in CORNERS:
        tilt = camber * np.sign(y)
        axis = f"0 {np.cos(tilt)} {np.sin(tilt)}"
        turn = f"{np.pi / 2 + tilt} 0 0"
        parts.append(wheel(name, (x, y, 0), axis=axis, turn=turn, width=0.2))
    robot = load_tracked(write(tmp_path, parts, 'wheels = "replace"\n'))
    assert set(robot.wheels) == {"fl", "fr", "rl", "rr"}


@pytest.mark.parametrize("rule", ['fl_joint = "free"\n', "fl_joint = 0.3\n", '"f*" = "free"\n'])
def test_rules_about_replaced_wheels_are_refused(tmp_path, rule):
    file = write(tmp_path, on_wheels(), f'wheels = "replace"\n[joints]\n{rule}')
    said = "must be about joints that stay, but 'fl_joint' is locked, .* without 'fl', to let"
    with pytest.raises(TrackslipError, match=said):
        build_tracked(load_tracked(file))
    file = write(tmp_path, on_wheels(*rod(0.5)), 'wheels = "replace"\n[joints]\n"*" = "free"\n')
    assert build_tracked(load_tracked(file)).joints.named("free") == ["shoulder"]


REAR = """[[tracks]]
wheels = ["rl", "rr"]
contact = "wheels"
"""
FRONT = """[[tracks]]
body = "front"
wheels = ["fl", "fr"]
contact = "wheels"
"""
GIVEN = "y = 0.3\nhull = [[0, 0, 0.1]]\n"


def steered(text, yaw):
    """A box with a rear axle, and a front axle that a joint steers."""
    limits = LIMITS.format(-1, 1)
    parts = [
        box("base", 40, (0.8, 0.3, 0.2), (0, 0, 0.3)),
        box("front", 1, (0.1, 0.1, 0.1)),
        joint("pivot", "revolute", "base", "front", (0.5, 0, 0), "0 0 1", more=limits),
        wheel("fl", (0, 0.3, 0), "front"),
        wheel("fr", (0, -0.3, 0), "front"),
        wheel("rl", (-0.5, 0.3, 0)),
        wheel("rr", (-0.5, -0.3, 0)),
    ]
    return parts, f"{text}[joints]\npivot = {yaw}\n"


def steered_yaw_rate(yaw, speed):
    """Yaw rate of least friction power of such a machine, whose wheels bear alike [rad/s].

    A point p of a patch slips by v + w (-p_y, p_x) - `speed` * h, with the twist (v, w) of the
    base and the heading h of its axle: ahead, or turned by the pivot.
    """
    ahead = np.array([1.0, 0.0])
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    pivot = np.array([0.5, 0.0])
    rear = np.array(patches([(-0.5, 0.3), (-0.5, -0.3)]))
    axle = np.array(patches([(0, 0.3), (0, -0.3)]))
    front = axle @ turn.T + pivot
    points = np.concatenate([rear, front])
    headings = np.repeat([ahead, turn @ ahead], [len(rear), len(front)], axis=0)
    arms = np.column_stack([-points[:, 1], points[:, 0]])

    def power(twist):
        slip = twist[:2] + twist[2] * arms - speed * headings
        return np.linalg.norm(slip, axis=1).sum()

    options = {"xatol": 1e-7, "fatol": 1e-9, "maxiter": 4000}
    first = [speed, 0.0, speed * yaw]
    found = scipy.optimize.minimize(power, first, method="Nelder-Mead", options=options)
    return found.x[2]


@pytest.mark.parametrize("yaw", [0.0, 0.3, -0.6])
def test_tracks_on_a_steered_body_push_along_its_heading(tmp_path, yaw):
    file = write(tmp_path, *steered(REAR + FRONT + GIVEN, yaw))
    turned = drive(file, (0.1, 0.1))
    expected = steered_yaw_rate(yaw, 0.1)
    assert turned.yaw_rate == pytest.approx(expected, rel=0.02, abs=1e-4)


@pytest.mark.parametrize("text", [REAR + FRONT, 'wheels = "replace"\ncontact = "wheels"\n'])
@pytest.mark.parametrize("yaw", [0.3, -0.6])
def test_wheels_that_a_joint_steers_are_not_read_as_straight(tmp_path, text, yaw):
    file = write(tmp_path, *steered(text, yaw))
    said = rf"'fl': its axis is turned by {yaw} rad about z, .*\[\[tracks\]\] with body = \"front\""
    with pytest.raises(TrackslipError, match=said):
        build_tracked(load_tracked(file))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            REAR + 'drive = "none"\n',
            "drive = 'none': must be left, right or .* leaves out roll",
        ),
        (REAR + REAR, r"tracks\[1\]: wheels = 'rl': must be in one entry only, .* in tracks\[0\]"),
        ('wheels = "replace"\n' + REAR, r'wheels = "replace": must be left out, .*\[\[tracks\]\]'),
    ],
)
def test_entries_that_contradict_each_other_are_refused(tmp_path, text, said):
    with pytest.raises(TrackslipError, match=said):
        load_tracked(write(tmp_path, on_wheels(), text))


CART = """<body name="{name}" pos="{x} 0 0.1"><freejoint/>
<geom type="box" size="0.3 0.2 0.1" pos="0 0 0.2" mass="40"/>{wheels}</body>"""
CART_WHEEL = """<body name="{name}" pos="{x} {y} 0"><joint name="{name}_j" axis="0 1 0"/>
<geom type="cylinder" size="0.1 0.03" zaxis="0 1 0" mass="1.5"/></body>"""


def test_the_wheels_of_another_machine_stay_its_own(tmp_path):
    carts = ""
    for machine, place in (("near", 0), ("far", 2)):
        wheels = ""
        for name, x, y in CORNERS:
            wheels += CART_WHEEL.format(name=f"{machine}_{name}", x=x, y=y)
        carts += CART.format(name=machine, x=place, wheels=wheels)
    (tmp_path / "carts.xml").write_text(f"<mujoco><worldbody>{carts}</worldbody></mujoco>")
    file = tmp_path / "carts.toml"
    file.write_text('model = "carts.xml"\nbody = "near"\nwheels = "replace"\n')
    built = build_tracked(load_tracked(file))
    assert built.robot.wheels == ("near_fl", "near_fr", "near_rl", "near_rr")
    assert built.robot.hull == ((-0.25, 0.0, 0.1), (0.25, 0.0, 0.1))
    assert built.joints.states == {}
    data = standing(built)
    mujoco.mj_step(built.model, data, nstep=200)
    assert data.body("far").xpos[2] == pytest.approx(0.1, abs=0.005)
