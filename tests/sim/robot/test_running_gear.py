"""Machines on lists of tracks, wheels and skids: they stand and turn as theory says, or are refused
in one line that says why and what to write.
"""

import warnings
from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np
import pytest
from machines import (
    LIMITS,
    box,
    centre_of_mass,
    drive,
    inertia_of_box,
    joint,
    lines,
    loads_of_equal_springs,
    patches,
    twist_of_least_power,
    wheel,
    write,
    yaw_rate_by_theory,
)

from sim import Command, JointRule, RunningGear, TrackedRobot, Traverse, check
from sim.robot.named import load_parameters, load_tracked
from sim.robot.tracked_model import build_tracked
from sim.terrain import load_course
from trackslip.errors import RobotWarning, TrackslipError

TURN = (-0.1, 0.1)
SIX = ((0.5, 0.3), (0.0, 0.45), (-0.5, 0.3))
"""Places x, y of the left wheels of a rover [m]."""
HINGED = LIMITS.format(-1.5, 1.5)
REPLACED = 'wheels = "replace"\n'
ON_WHEELS = REPLACED + 'contact = "wheels"\n'


class Flipper(NamedTuple):
    """A flipper, and the signs of the x and y of its hinge."""

    name: str
    side: str
    x: int
    y: int


FLIPPERS = (
    Flipper("fl", "left", x=1, y=1),
    Flipper("fr", "right", x=1, y=-1),
    Flipper("rl", "left", x=-1, y=1),
    Flipper("rr", "right", x=-1, y=-1),
)


def of_both_sides(places):
    """Places of wheels (x, y), left and right, from those of the left."""
    return [(x, sign * y) for x, y in places for sign in (1, -1)]


def rover(places, offset=0.0, mass=30, radius=0.1):
    """A box on pairs of wheels, whose frame lies `offset` to the right of their middle."""
    parts = [box("base", mass, (0.8, 0.3, 0.15), (0, offset, 0.2))]
    for k, (x, y) in enumerate(places):
        parts.append(wheel(f"l{k}", (x, y + offset, 0), radius=radius))
        parts.append(wheel(f"r{k}", (x, -y + offset, 0), radius=radius))
    return parts


def turns_as_theory(file, points, within=0.005, preset="accurate"):
    """Drive a turn on the spot and compare its yaw rate with least power."""
    turned = drive(file, TURN, preset=preset)
    expected = yaw_rate_by_theory(points, TURN, centre_of_mass(turned.built))
    assert turned.yaw_rate == pytest.approx(expected, rel=within)
    return turned


@pytest.mark.parametrize(
    "text", ["", "half_gauge = 0.3\nhull = [[-0.25, 0, 0.1], [0.25, 0, 0.1]]\n"]
)
def test_sides_lie_where_the_wheels_are(tmp_path, text):
    file = write(tmp_path, rover([(0.25, 0.3), (-0.25, 0.3)], offset=0.05), REPLACED + text)
    robot = load_tracked(file)
    assert robot.half_gauge == pytest.approx(0.3)
    assert robot.offset == pytest.approx(0.05)
    stood = drive(file, duration=3.0)
    assert stood.load[0] == pytest.approx(stood.load[1], rel=1e-3)
    parameters, _ = load_parameters(str(file))
    assert parameters.com_y == pytest.approx(0.0, abs=1e-9)


def test_each_axle_keeps_its_gauge(tmp_path):
    file = write(tmp_path, rover(SIX), ON_WHEELS)
    robot = load_tracked(file)
    assert robot.gear[0].aside == pytest.approx((-0.05, 0.1, -0.05))
    turns_as_theory(file, patches(of_both_sides(SIX)))
    said = r"axles have different half gauges, 0\.3, 0\.45, 0\.3"
    with pytest.raises(TrackslipError, match=said):
        load_parameters(str(file))


def test_a_belt_around_unequal_axles_is_said(tmp_path):
    file = write(tmp_path, rover(SIX), REPLACED)
    with pytest.warns(RobotWarning, match="different half gauges: l2 0.3, l1 0.45, l0 0.3 m; the"):
        robot = load_tracked(file)
    assert robot.half_gauge == pytest.approx(0.35)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "half_gauge = 0.4\nhull = [[-0.25, 0, 0.1], [0.25, 0, 0.1]]\n",
            "half_gauge = 0.4, but .*0.3",
        ),
        (
            "half_gauge = 0.3\nhull = [[-0.2, 0.1, 0.1], [0.2, 0.1, 0.1]]\n",
            "down to 0, but .* to -0.1",
        ),
    ],
)
def test_given_values_that_contradict_the_wheels_are_said(tmp_path, text, said):
    file = write(tmp_path, rover([(0.25, 0.3), (-0.25, 0.3)]), REPLACED + text)
    with pytest.warns(RobotWarning, match=said):
        load_tracked(file)


ABOUT_X = {"axis": "1 0 0", "turn": "0 1.5708 0"}
SIDEWAYS = [
    box("base", 60, (0.4, 1.0, 0.2), (0, 0, 0.2)),
    wheel("fl", (-0.3, 0.4, 0), **ABOUT_X),
    wheel("fr", (0.3, 0.4, 0), **ABOUT_X),
    wheel("rl", (-0.3, -0.4, 0), **ABOUT_X),
    wheel("rr", (0.3, -0.4, 0), **ABOUT_X),
]
ONE_SIDED = rover([(0.25, 0.3), (-0.25, 0.3)])[:-1]
GIVEN = "half_gauge = 0.3\nhull = [[-0.4, 0, 0.1], [0.4, 0, 0.1]]\n"
LISTED = 'wheels = ["fl", "fr", "rl", "rr"]\n'
ON_AN_ARM = [
    box("base", 20, (0.5, 0.3, 0.1), (0, 0, 0.3)),
    box("arm", 1, (0.6, 0.02, 0.02), (0.3, 0, 0)),
    joint("elbow", "revolute", "base", "arm", (0.3, 0, 0.3), more=LIMITS.format(1.2, 2.0)),
]


@pytest.mark.parametrize(
    ("parts", "text", "said"),
    [
        (
            SIDEWAYS,
            REPLACED,
            r"wheels = fl, fr, rl and 1 more: turn about x, .*rpy=\"0 0 -1\.5708\"",
        ),
        (SIDEWAYS, LISTED + GIVEN, "wheels = fl, fr, rl and 1 more: turn about x, so the machine"),
        (ONE_SIDED, REPLACED, r"on the left are l0, l1, on the right r0; .*\[\[tracks\]\]"),
        (
            ON_AN_ARM,
            "half_gauge = 0.2\nhull = [[-0.2, 0.1, 0.1], [0.2, 0.1, 0.1]]\n",
            r"link arm reaches down to -0\.\d+ m .* at another angle, or free it, .*: elbow",
        ),
        (
            ON_AN_ARM,
            f"{GIVEN}[joints]\nelbow = 0.5\n",
            r"joints: elbow = 0\.5: must be within its limits, 1\.2 to 2",
        ),
        (ON_AN_ARM, f"{GIVEN}[joints]\nshoulder = 0.5\n", "'shoulder': must be joints .* elbow"),
        (
            ON_AN_ARM,
            f'{GIVEN}[joints]\nelbow = "loose"\n',
            'elbow = \'loose\': must be "hold", "free"',
        ),
        (
            ON_AN_ARM,
            f"{GIVEN}[joints]\nelbow = {{ stiffness = 250.0 }}\n",
            'elbow = {\'stiffness\': 250.0}: must be "hold", "free"',
        ),
        (
            ON_AN_ARM,
            f'{GIVEN}[joints]\nelbow = {{ motor = "belt" }}\n',
            "elbow = {'motor': 'belt'}: must be \"hold\", \"free\"",
        ),
        (ON_AN_ARM, f"{GIVEN}[joints]\nelbow = true\n", 'elbow = True: must be "hold", "free"'),
        (ON_AN_ARM, f"{GIVEN}joints = 0.5\n", "joints: 0.5 is not a table"),
        (ON_AN_ARM, f"{GIVEN}[[tracks]]\ny = 0.2\n", "half_gauge, hull: must be left out beside"),
        (ON_AN_ARM, "[[tracks]]\nsides = 'both'\n", r"tracks\[0\]: hull is missing: give `y` and"),
        (ON_AN_ARM, "[[tracks]]\nsides = 'top'\n", "sides = 'top': must be both, left, right or"),
        (ON_AN_ARM, "[[tracks]]\nbody = 'leg'\ny = 0.2\nhull = [[0, 0, 1], [1, 0, 1]]\n", "'leg'"),
        (
            ON_AN_ARM,
            "[[tracks]]\ny = [-0.2, 0.2]\nhull = [[0, 0, 1], [1, 0, 1]]\n",
            r"y = \[-0\.2, 0\.2\]: must be that of the left track, then of the right",
        ),
    ],
)
def test_the_way_on_is_said_in_one_line(tmp_path, parts, text, said):
    with pytest.raises(TrackslipError, match=said) as refused:
        build_tracked(load_tracked(write(tmp_path, parts, text)))
    assert "\n" not in str(refused.value)


def digger(folder, text=""):
    """A tracked machine whose stick cannot reach angle 0."""
    up = {"turn": "0 -0.6 0", "more": LIMITS.format(-1, 0.5)}
    bent = {"more": LIMITS.format(0.5236, 2.6)}
    base = box("base", 300, (1.0, 0.6, 0.3), (0, 0, 0.5))
    boom = box("boom", 25, (1.0, 0.1, 0.1), (0.5, 0, 0))
    stick = box("stick", 15, (0.8, 0.08, 0.08), (0.4, 0, 0))
    boom_joint = joint("boom_joint", "revolute", "base", "boom", (0.4, 0, 0.8), **up)
    stick_joint = joint("stick_joint", "revolute", "boom", "stick", (1, 0, 0), **bent)
    tracks = "half_gauge = 0.4\nhull = [[-0.6, 0.18, 0.18], [0.6, 0.18, 0.18]]\n"
    return write(folder, [base, boom, stick, boom_joint, stick_joint], tracks + text)


def test_an_arm_that_cannot_reach_zero_holds_still(tmp_path):
    built = build_tracked(load_tracked(digger(tmp_path)))
    model = built.model
    data = mujoco.MjData(model)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data.qpos[2] = 0.002
    mujoco.mj_forward(model, data)
    start = data.energy.sum()
    assert data.joint("stick_joint").qpos[0] == pytest.approx(0.5236)
    for _ in range(1000):
        mujoco.mj_step(model, data)
        assert data.energy.sum() < start + 1e-6
        assert abs(data.joint("stick_joint").qvel[0]) < 0.02
    assert data.qpos[0] == pytest.approx(0.0, abs=1e-3)


def test_rules_hold_joints_where_they_say_or_free_them(tmp_path):
    text = '[joints]\nboom_joint = 0.25\n"stick_*" = "free"\n'
    built = build_tracked(load_tracked(digger(tmp_path, text)))
    assert built.joints.held == {"boom_joint": 0.25}
    assert built.joints.named("free") == ["stick_joint"]
    data = mujoco.MjData(built.model)
    mujoco.mj_step(built.model, data, nstep=200)
    assert data.joint("boom_joint").qpos[0] == pytest.approx(0.25, abs=1e-3)
    assert data.joint("stick_joint").qpos[0] > 0.6  # it fell


def test_a_held_arm_does_not_change_the_turn(tmp_path):
    places = [(0.45, 0.4), (0.0, 0.4), (-0.45, 0.4)]
    limits = {"more": LIMITS.format(-1.5, 2.8)}
    upper = box("upper", 1.5, (0.5, 0.04, 0.04), (0.25, 0, 0))
    fore = box("fore", 1, (0.5, 0.04, 0.04), (0.25, 0, 0))
    shoulder = joint("shoulder", "revolute", "base", "upper", (0.3, 0, 0.35), **limits)
    elbow = joint("elbow", "revolute", "upper", "fore", (0.5, 0, 0), **limits)
    parts = [*rover(places, radius=0.13), upper, fore, shoulder, elbow]
    file = write(tmp_path, parts, ON_WHEELS)
    turned = turns_as_theory(file, patches(of_both_sides(places)))
    tip = turned.data.body("fore").xpos[2]
    assert tip == pytest.approx(0.48, abs=1e-3)


def shaft(*belts):
    """A machine whose front flippers sit on one shaft, with belts given as body, side, y."""
    base = box("base", 30, (0.5, 0.2, 0.12), (0, 0, 0.12))
    left = box("flipper_left", 2, (0.3, 0.05, 0.1), (0.15, 0, 0))
    right = box("flipper_right", 2, (0.3, 0.05, 0.1), (0.15, 0, 0))
    hinge = joint("shaft", "revolute", "base", "flipper_left", (0.25, 0.25, 0.09), more=HINGED)
    weld = joint("weld", "fixed", "flipper_left", "flipper_right", (0, -0.5, 0))
    parts = [base, left, hinge, right, weld]
    text = REPLACED + "half_gauge = 0.18\nhull = [[-0.25, 0.09, 0.09], [0.25, 0.09, 0.09]]\n"
    for body, side, y in belts:
        text += f'[[flippers]]\nbody = "flipper_{body}"\nside = "{side}"\ny = {y}\n'
        text += "hull = [[0, 0, 0.06], [0.3, 0, 0.04]]\n"
    return parts, text


LEFT_BELT = ("left", "left", 0)
RIGHT_BELT = ("right", "right", 0)
RIGHT_BELT_ON_LEFT_BODY = ("left", "right", -0.5)


@pytest.mark.parametrize("other", [RIGHT_BELT, RIGHT_BELT_ON_LEFT_BODY])
def test_flippers_on_one_shaft_have_belts_of_both_sides(tmp_path, other):
    file = write(tmp_path, *shaft(LEFT_BELT, other))
    built = build_tracked(load_tracked(file))
    assert built.track_side.tolist() == [0, 1, 0, 1]
    assert built.flipper_names == ("flipper_left",)
    assert len(built.flipper_motor) == 1
    down = drive(file, (0.1, 0.1), angles=[-0.3])
    assert down.load[2] == pytest.approx(down.load[3], rel=0.01)
    assert down.load[2] > 10


def test_a_link_without_shapes_on_a_shaft_needs_no_belt(tmp_path):
    """Such as a sensor's frame on the other side."""
    parts, text = shaft(("right", "right", 0))
    mass = f'<mass value="0.1"/>{inertia_of_box(0.1, 0.1, 0.1, 0.1)}'
    parts[1] = f'<link name="flipper_left"><inertial>{mass}</inertial></link>'
    robot = load_tracked(write(tmp_path, parts, text))
    assert [flipper.body for flipper in robot.flippers] == ["flipper_right"]


def test_a_flipper_left_out_on_its_shaft_is_named(tmp_path):
    file = write(tmp_path, *shaft(LEFT_BELT))
    said = "'flipper_right' is fixed to 'flipper_left', but lies"
    with pytest.raises(TrackslipError, match=said):
        load_tracked(file)


@pytest.mark.parametrize(
    ("turn", "axis", "tip"),
    [
        ("0 0 0", "0 1 0", "[0.3, 0.02, 0.04]"),
        ("1.5707963 0 0", "0 0 1", "[0.3, 0.02, 0.04]"),  # z to the right, y up
        ("0 0 3.1415927", "0 1 0", "[-0.3, 0.02, 0.04]"),  # x backwards, y to the right
        ("0 3.1415927 0", "0 1 0", "[-0.3, -0.02, 0.04]"),  # x backwards, z down
        ("0 0 1.5707963", "1 0 0", "[-0.3, 0.02, 0.04]"),  # x to the left, y backwards
        ("0 -0.5 0", "0 1 0", "[0.272863, -0.126277, 0.04]"),  # nose up by half a radian
    ],
)
def test_flippers_may_have_frames_of_any_orientation(tmp_path, turn, axis, tip):
    parts = [box("base", 30, (0.5, 0.2, 0.12), (0, 0, 0.12))]
    text = "half_gauge = 0.18\nhull = [[-0.25, 0.09, 0.09], [0.25, 0.09, 0.09]]\n"
    for side, y in (("left", 0.25), ("right", -0.25)):
        at = (0.25, y, 0.09)
        parts.append(box(side, 2, (0.05, 0.05, 0.05)))
        parts.append(joint(f"{side}_j", "revolute", "base", side, at, axis, turn, HINGED))
        text += f'[[flippers]]\nbody = "{side}"\nside = "{side}"\nhull = [[0, 0, 0.06], {tip}]\n'
    built = build_tracked(load_tracked(write(tmp_path, parts, text)))
    assert built.flippers.front.all()
    np.testing.assert_allclose(built.flippers.hinge, [[0.25, 0.25, 0.09], [0.25, -0.25, 0.09]])
    np.testing.assert_allclose(built.tracks[2].gear.hull[1][:2], [0.3, 0.02], atol=1e-5)
    data = mujoco.MjData(built.model)
    data.qpos[built.flipper_qpos] = built.flipper_control(np.full(2, 0.5))
    mujoco.mj_kinematics(built.model, data)
    frame = data.xmat[built.belts.bodies[2]].reshape(3, 3)
    np.testing.assert_allclose(frame[:, 1], [0, 1, 0], atol=1e-6)  # to the left
    assert frame[2, 0] == pytest.approx(np.sin(0.5), abs=1e-6)  # forwards is up by the angle


FLIPPER_ENTRY = """[[flippers]]
body = "{name}"
side = "{side}"
hull = [[0, 0, 0.08], [{tip}, 0, 0.08]]
"""
TRACK_ENTRY = """[[tracks]]
body = "{name}"
sides = "{side}"
y = 0
hull = [[0, 0, 0.08], [{tip}, 0, 0.08]]
"""
TAPERED_ENTRY = """[[tracks]]
body = "{name}"
sides = "{side}"
y = 0
hull = [[0, 0, 0.06], [{tip}, 0, 0.04]]
"""


def on_four_flippers(entry):
    """A box that stands on four flippers, each described by `entry`."""
    parts = [box("base", 30, (0.5, 0.2, 0.12), (0, 0, 0.05))]
    text = ""
    for flipper in FLIPPERS:
        name = flipper.name
        at = (0.12 * flipper.x, 0.25 * flipper.y, 0)
        parts.append(box(name, 2, (0.3, 0.05, 0.1), (0.15 * flipper.x, 0, 0)))
        parts.append(joint(f"{name}_j", "revolute", "base", name, at, more=HINGED))
        text += entry.format(name=name, side=flipper.side, tip=0.3 * flipper.x)
    return parts, text


def points_under_flippers():
    """Points (x, y) of the belts of four flippers, which reach from 0.12 m to 0.42 m."""
    points = []
    for flipper in FLIPPERS:
        points += lines(0.25 * flipper.y, 0.15, 0.27 * flipper.x)
    return points


def test_a_robot_may_stand_on_flippers_only(tmp_path):
    parts, text = on_four_flippers(FLIPPER_ENTRY)
    for given in (text, REPLACED + text):
        file = write(tmp_path, parts, given)
        driven = drive(file, (0.1, 0.1))
        assert driven.forwards == pytest.approx(0.1, rel=0.005)
        assert driven.load.sum() == pytest.approx(9.81 * 38, rel=0.01)
        assert len(driven.built.flipper_motor) == 4
    with pytest.raises(TrackslipError, match="stands on its flippers; `trackslip drive`"):
        load_parameters(str(file))


def test_tracks_on_held_links_turn_as_theory_says(tmp_path):
    parts, text = on_four_flippers(TRACK_ENTRY)
    file = write(tmp_path, parts, 'wheels = ["fl", "fr", "rl", "rr"]\n' + text)
    turns_as_theory(file, points_under_flippers())


def test_the_motor_of_a_hinge_makes_its_tracks_flippers(tmp_path):
    parts, flippers = on_four_flippers(TAPERED_ENTRY)
    tracks = "[[tracks]]\ny = 0.15\nhull = [[-0.2, 0, 0.1], [0.2, 0, 0.1]]\n"
    motor = '{ motor = "flipper", torque = 50, limits = [-1.0, 1.0] }'
    file = write(tmp_path, parts, f'{tracks}{flippers}[joints]\n"*_j" = {motor}\n')
    built = build_tracked(load_tracked(file))
    assert built.flipper_names == ("fl", "fr", "rl", "rr")
    np.testing.assert_allclose(built.flipper_range, [[-1.0, 1.0]] * 4)
    np.testing.assert_allclose(built.model.actuator_forcerange, [[-50.0, 50.0]] * 4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            '"*_j" = "hold"\n',
            r"'\*_j': must be left out or a motor, as 'fl_j' is the hinge of",
        ),
        ('"elbow" = { motor = "flipper" }\n', r"'elbow': must be on hinges that carry \[\[tracks"),
    ],
)
def test_rules_fit_what_the_joints_carry(tmp_path, text, said):
    parts, flippers = on_four_flippers(FLIPPER_ENTRY)
    parts.append(box("arm", 1, (0.3, 0.02, 0.02), (0.15, 0, 0)))
    parts.append(joint("elbow", "revolute", "base", "arm", (0, 0, 0.3), more=HINGED))
    file = write(tmp_path, parts, f"{flippers}[joints]\n{text}")
    with pytest.raises(TrackslipError, match=said):
        build_tracked(load_tracked(file))


def test_a_rule_sets_the_motor_of_a_table_of_flippers(tmp_path):
    parts, flippers = on_four_flippers(FLIPPER_ENTRY)
    motor = '{ motor = "flipper", torque = 33.0, limits = [-0.5, 1.0] }'
    file = write(tmp_path, parts, f'{flippers}[joints]\n"*_j" = {motor}\n')
    built = build_tracked(load_tracked(file))
    np.testing.assert_allclose(built.model.actuator_forcerange, [[-33.0, 33.0]] * 4)
    np.testing.assert_allclose(built.flipper_range[2], [-0.5, 1.0])


CENTRE = '[[tracks]]\nsides = "centre"\ny = 0\nwidth = 0.4\nlines = 3\n'
CENTRE += "hull = [[-0.9, 0.15, 0.15], [0.1, 0.15, 0.15]]\n"
SKIS = '[[tracks]]\ny = 0.45\ncontact = "skid"\nhull = [[0.6, 0.05, 0.05], [1.0, 0.05, 0.05]]\n'


def test_a_centre_belt_drives_a_machine_on_skids(tmp_path):
    file = snowmobile(tmp_path)
    driven = drive(file, (0.08, 0.12))
    assert driven.built.track_side.tolist() == [2, -1, -1]
    assert driven.built.side_tracks == (0, 0)
    assert driven.forwards == pytest.approx(0.1, rel=0.005)
    assert driven.load.sum() == pytest.approx(9.81 * 200, rel=0.01)
    with pytest.raises(TrackslipError, match="it has 2 entries of running gear"):
        load_parameters(str(file))


def test_a_machine_on_one_belt_is_as_wide_as_the_belt(tmp_path):
    robot = load_tracked(write(tmp_path, [box("base", 200, (1.5, 0.4, 0.3), (0, 0, 0.5))], CENTRE))
    assert robot.half_gauge == 0.4 / 2
    assert robot.offset == 0.0


AXLE = '[[tracks]]\ny = 0.3\nhull = [[0.2, 0.1, 0.1]]\ncontact = "wheels"\n'
BALL = '[[tracks]]\nsides = "centre"\ny = 0\nhull = [[-0.3, 0.05, 0.05]]\ncontact = "skid"\n'
BALL += "patch_length = 0.05\n"


def test_one_axle_and_a_ball_turn_as_theory_says(tmp_path):
    file = write(tmp_path, [box("base", 20, (0.6, 0.4, 0.1), (0, 0, 0.2))], AXLE + BALL)
    driven = drive(file, TURN)
    # the centre of mass is 0.3 m ahead of the ball and 0.2 m behind the axle
    loads = 9.81 * 20 * np.array([0.3, 0.3, 0.4])
    np.testing.assert_allclose(driven.load, loads, rtol=0.01)
    axle = patches([(0.2, 0.3), (0.2, -0.3)])
    ball = patches([(-0.3, 0.0)], 0.05, 5)
    points = axle + ball
    speeds = np.repeat([*TURN, 0.0], [10, 10, 5])
    each = loads_of_equal_springs(points, centre_of_mass(driven.built), 9.81 * 20)
    expected = twist_of_least_power(points, each, speeds)
    assert driven.yaw_rate == pytest.approx(expected[2], rel=0.005)
    assert driven.forwards == pytest.approx(expected[0], abs=0.0005)


HALF_TRACK = "[[tracks]]\ny = 0.5\nhull = [[-1, 0.2, 0.2], [0, 0.2, 0.2]]\n"
HALF_TRACK += '[[tracks]]\ny = 0.5\nhull = [[0.9, 0.25, 0.25]]\ncontact = "wheels"\n'


@pytest.mark.parametrize(("preset", "within"), [("accurate", 0.005), ("fast", 0.01)])
def test_a_half_track_turns_as_theory_says(tmp_path, preset, within):
    file = write(tmp_path, [box("base", 400, (2, 0.8, 0.3), (0, 0, 0.6))], HALF_TRACK)
    belts = lines(0.5, 0.5, -0.5) + lines(-0.5, 0.5, -0.5)
    axle = patches([(0.9, 0.5), (0.9, -0.5)])
    turns_as_theory(file, belts + axle, within, preset)


def articulated():
    """Two bodies with one axle each, on a waist that bends to the sides."""
    parts = []
    for name in ("base", "rear"):
        parts.append(box(name, 20, (0.3, 0.3, 0.1), (0, 0, 0.05)))
        parts.append(wheel(f"{name}_l", (0, 0.3, 0), name))
        parts.append(wheel(f"{name}_r", (0, -0.3, 0), name))
    parts.append(joint("waist", "revolute", "base", "rear", (-0.5, 0, 0), "0 0 1", more=HINGED))
    return parts


def test_a_held_waist_makes_one_robot_of_two_axles(tmp_path):
    points = patches(of_both_sides([(0, 0.3), (-0.5, 0.3)]))
    turns_as_theory(write(tmp_path, articulated(), ON_WHEELS), points)


def test_a_free_waist_leaves_each_body_its_axle(tmp_path):
    text = ON_WHEELS + '[joints]\nwaist = "free"\n'
    file = write(tmp_path, articulated(), text)
    with warnings.catch_warnings(action="error"):
        driven = drive(file, (0.1, 0.1))
    assert [gear.body for gear in driven.built.robot.gear] == ["", "rear"]
    np.testing.assert_allclose(driven.load, driven.load.mean(), rtol=0.01)
    assert driven.forwards == pytest.approx(0.1, rel=0.005)
    with pytest.raises(TrackslipError, match="2 entries of running gear, on the chassis, rear"):
        load_parameters(str(file))


@pytest.mark.parametrize(
    ("text", "points"),
    [
        (ON_WHEELS, patches(of_both_sides([(0.3, 0.3), (-0.3, 0.3)]))),
        (REPLACED, lines(0.3, 0.3) + lines(-0.3, 0.3)),
    ],
)
def test_a_rocker_that_swings_keeps_its_wheels(tmp_path, text, points):
    parts = [box("base", 30, (0.5, 0.3, 0.1), (0, 0, 0.25))]
    for side, y in (("l", 0.25), ("r", -0.25)):
        rocker = f"rocker_{side}"
        out = 0.05 * np.sign(y)
        parts.append(box(rocker, 2, (0.4, 0.04, 0.05)))
        parts.append(joint(f"{rocker}_j", "revolute", "base", rocker, (0, y, 0.1), more=HINGED))
        parts.append(wheel(f"{side}f", (0.3, out, -0.1), rocker))
        parts.append(wheel(f"{side}r", (-0.3, out, -0.1), rocker))
    file = write(tmp_path, parts, text + '[joints]\nrocker_l_j = "free"\n')
    turned = turns_as_theory(file, points)
    assert turned.built.joints.held == {"rocker_r_j": 0.0}


def test_flippers_that_bear_weight_are_said(tmp_path):
    parts = [box("base", 40, (0.5, 0.36, 0.12), (0, 0, 0.06))]
    limits = LIMITS.format(-3.1, 3.1)
    entry = ""
    for name, side, x, y in FLIPPERS:
        at = (0.25 * x, 0.27 * y, 0)
        parts.append(box(name, 2, (0.3, 0.05, 0.1), (0.15 * x, 0, 0)))
        parts.append(joint(f"{name}_j", "revolute", "base", name, at, more=limits))
        entry += f'[[flippers]]\nbody = "{name}"\nside = "{side}"\n'
        entry += f"hull = [[0, 0, 0.115], [{0.28 * x}, 0, 0.075]]\n"
    hull = "half_gauge = 0.2\nhull = [[-0.25, 0, 0.115], [0.25, 0, 0.115]]\n"
    file = write(tmp_path, parts, REPLACED + hull + entry)
    with pytest.warns(RobotWarning, match="its flippers bear 29% of its weight on level ground"):
        load_parameters(str(file))
    assert any("bear 29% of its weight" in line for line in check(file).warnings)


def test_the_list_of_tracks_may_be_written_in_python(tmp_path):
    file = write(tmp_path, articulated(), "")
    axles = (
        RunningGear("base", wheels=("base_l", "base_r"), contact="wheels"),
        RunningGear("rear", wheels=("rear_l", "rear_r"), contact="wheels"),
    )
    waist = JointRule("waist", "free")
    robot = TrackedRobot(file.with_suffix(".urdf"), tracks=axles, joints=(waist,))
    world = Traverse(robot, [load_course("flat")])
    for _ in range(10):
        world.step(Command(np.full((1, 2), 0.2), np.zeros((1, 0))))
    assert world.state.velocity[0, 0] == pytest.approx(0.2, rel=0.02)
    assert world.tracked.robot.half_gauge == pytest.approx(0.3)


ARMS = """<mujoco><worldbody><body name="base" pos="0 0 0.1"><freejoint/>
<geom type="box" size="0.3 0.2 0.05" pos="0 0 0.15" mass="30"/>
<body name="arm" pos="0.2 0 0.3" euler="0 -40 0"><joint name="turn" axis="0 1 0" range="30 150"/>
  <geom type="capsule" size="0.03" fromto="0 0 0 0.4 0 0" mass="2"/>
  <body name="rod" pos="0.4 0 0"><joint name="push" type="slide" axis="1 0 0" range="0.1 0.3"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0.2 0 0" mass="1"/></body></body>
<body name="head" pos="-0.2 0 0.3"><joint name="ball" type="ball"/>
  <geom size="0.05" pos="0 0 0.1" mass="1"/></body>
<body name="mast" pos="-0.1 0.1 0.3"><joint name="sprung" axis="0 1 0" stiffness="50" damping="1"/>
  <geom size="0.05" pos="0 0 0.1" mass="1"/></body>
<body name="lid" pos="-0.1 -0.1 0.3"><joint name="driven" axis="0 1 0" range="20 60"/>
  <geom size="0.05" pos="0 0 0.1" mass="1"/></body>
</body></worldbody><actuator><position joint="driven" kp="300"/></actuator></mujoco>"""


def arms(folder):
    """An MJCF with angles in degrees and joints of all kinds."""
    (folder / "arms.xml").write_text(ARMS)
    file = folder / "arms.toml"
    tracks = "half_gauge = 0.25\nhull = [[-0.3, 0, 0.1], [0.3, 0, 0.1]]\n"
    file.write_text(f'model = "arms.xml"\n{tracks}')
    return file


def test_joints_of_all_kinds_start_within_their_limits(tmp_path):
    built = build_tracked(load_tracked(arms(tmp_path)))
    assert built.joints.held == {"turn": pytest.approx(np.pi / 6), "push": 0.1, "ball": 0.0}
    assert built.joints.named("motor") == ["sprung", "driven"]
    data = mujoco.MjData(built.model)
    mujoco.mj_forward(built.model, data)
    assert data.joint("driven").qpos[0] == pytest.approx(np.radians(20))
    ahead = data.body("arm").xmat.reshape(3, 3)[:, 0]
    up = np.radians(10)  # the arm lies 40 degrees up and turns down by 30
    np.testing.assert_allclose(ahead, [np.cos(up), 0, np.sin(up)], atol=1e-9)
    away = data.body("rod").xpos - data.body("arm").xpos
    np.testing.assert_allclose(away, 0.5 * ahead, atol=1e-9)
    mujoco.mj_step(built.model, data, nstep=500)
    held = [data.joint(name).qpos[0] for name in ("turn", "push", "ball")]
    np.testing.assert_allclose(held, [np.pi / 6, 0.1, 1.0], atol=1e-4)


def freed_digger(folder):
    return digger(folder, '[joints]\nstick_joint = 1.0\nboom_joint = "free"\n')


def rover_beside_its_frame(folder):
    return write(folder, rover([(0.3, 0.3), (-0.3, 0.3)], 0.05), REPLACED)


def rover_on_six_wheels(folder):
    return write(folder, rover(SIX), ON_WHEELS)


def flippers_on_a_shaft(folder):
    return write(folder, *shaft(LEFT_BELT, RIGHT_BELT))


def snowmobile(folder):
    return write(folder, [box("base", 200, (1.5, 0.4, 0.3), (0, 0, 0.5))], CENTRE + SKIS)


def lagging_on_a_waist(folder):
    text = '[joints]\nwaist = "free"\n[drive]\nlag = 0.1\n'
    return write(folder, articulated(), ON_WHEELS + text)


MACHINES = {
    "arms": arms,
    "digger": freed_digger,
    "offset": rover_beside_its_frame,
    "six": rover_on_six_wheels,
    "shaft": flippers_on_a_shaft,
    "snowmobile": snowmobile,
    "waist": lagging_on_a_waist,
}
"""Functions that write the robot file of a machine into a folder."""
MODEL_FIELDS = (
    "body_mass",
    "qpos0",
    "geom_pos",
    "geom_size",
    "body_pos",
    "body_quat",
    "pair_solref",
    "pair_solimp",
    "eq_data",
    "actuator_gainprm",
    "jnt_range",
)


@pytest.mark.parametrize("name", [*MACHINES, "rescue", "box"])
def test_the_robot_file_of_a_check_makes_the_same_robot(tmp_path, name):
    source = MACHINES[name](tmp_path) if name in MACHINES else name
    checked = check(source)
    assert not checked.errors
    first = load_tracked(source)
    again = tmp_path / "again.toml"
    text = checked.file
    if name not in MACHINES:  # the path of a shipped model is relative to the folder of the command
        text = text.replace(checked.file.splitlines()[0], f'model = "{first.model.as_posix()}"')
    again.write_text(text)
    second = load_tracked(again)
    assert [each.is_complete for each in second.gear] == [True] * len(first.gear)
    assert second.drive == first.drive
    assert second.half_gauge == first.half_gauge
    assert second.offset == first.offset
    model = build_tracked(first).model
    remade = build_tracked(second).model
    for field in MODEL_FIELDS:
        np.testing.assert_array_equal(getattr(remade, field), getattr(model, field))


@pytest.mark.parametrize("name", ["offset", "rescue", "box"])
def test_the_robot_file_of_a_check_is_the_same_on_the_plane(tmp_path, name):
    source = str(MACHINES[name](tmp_path)) if name in MACHINES else name
    model = load_tracked(source).model.as_posix()
    _, *lines_below = check(source).file.splitlines()
    again = tmp_path / "again.toml"
    again.write_text("\n".join([f'model = "{model}"', *lines_below]))
    first, _ = load_parameters(source)
    second, _ = load_parameters(str(again))
    assert replace(second, looks=first.looks) == first


def test_a_check_says_where_each_number_comes_from(tmp_path):
    read = write(tmp_path, rover([(0.3, 0.233), (-0.3, 0.233)]), REPLACED)
    facts = dict(check(read).facts)
    said = "both, half gauge 0.233 from l1, r1, l0, r0; motors left, right"
    assert facts["tracks on the chassis"] == said
    given = digger(tmp_path)
    facts = dict(check(given).facts)
    assert facts["tracks on the chassis"].startswith("both, half gauge 0.4 given")
    assert facts["joints that hold"] == "boom_joint at 0, stick_joint at 0.5236"


def test_a_check_offers_motors_of_effort_and_velocity_limits(tmp_path):
    limit = '<limit lower="-1e16" upper="1e16" effort="20" velocity="8"/>'
    parts = [
        box("base", 30, (0.8, 0.3, 0.15), (0, 0, 0.2)),
        wheel("lf", (0.3, 0.3, 0), more=limit),
        wheel("rf", (0.3, -0.3, 0), more=limit),
        wheel("lr", (-0.3, 0.3, 0), more=limit),
        wheel("rr", (-0.3, -0.3, 0), more=limit),
    ]
    file = write(tmp_path, parts, REPLACED)
    _, _, offer = check(file).file.partition("# motors by the effort")
    _, *offered = offer.splitlines()
    tables = "\n".join(line.removeprefix("# ") for line in offered)
    motors = load_tracked(write(tmp_path, parts, REPLACED + tables)).drive
    assert motors is not None
    assert motors.torque_limit == 40.0
    assert motors.top_speed == 0.8
    assert motors.strength(8.0) == pytest.approx(40.0)


def test_hinges_of_flippers_offer_no_motors_of_belts(tmp_path):
    """A shaft with an effort limit isn't what turns the belts."""
    limit = '<limit lower="-1.5" upper="1.5" effort="200" velocity="2"/>'
    parts = [
        box("base", 30, (0.5, 0.2, 0.12), (0, 0, 0.12)),
        box("flipper", 2, (0.3, 0.05, 0.1), (0.15, 0, 0)),
        joint("shaft", "revolute", "base", "flipper", (0.25, 0.25, 0.09), more=limit),
    ]
    hull = "[[-0.25, 0.09, 0.09], [0.25, 0.09, 0.09]]"
    text = f'wheels = ["flipper"]\nhalf_gauge = 0.18\nhull = {hull}\n'
    checked = check(write(tmp_path, parts, text))
    assert not checked.errors
    assert "y = 0.18" in checked.file
    assert "[drive]" not in checked.file


@pytest.mark.parametrize(
    ("text", "label", "said"),
    [
        (
            "half_gauge = 0.5\n",
            "half gauge 0.5 (half gauge given, the rest from",
            "half_gauge = 0.5",
        ),
        ("offset = 0.2\n", "(offset given, the rest from", "offset = 0.2, but its wheels have 0 m"),
    ],
)
def test_given_values_are_told_from_read_ones(tmp_path, text, label, said):
    checked = check(write(tmp_path, rover([(0.3, 0.3), (-0.3, 0.3)]), REPLACED + text))
    assert label in dict(checked.facts)["tracks on the chassis"]
    assert any(said in warning for warning in checked.warnings)
