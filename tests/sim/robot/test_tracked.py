"""Robots with tracks: robot files, and what is made of them."""

import mujoco
import numpy as np
import pytest
from tracked_files import ROBOT, URDF, write_robot

from sim.robot.named import ROBOTS, load_tracked
from sim.robot.tracked_model import build_tracked, clear_angles
from sim.terrain import load_course
from sim.tracks import bind
from trackslip.errors import TrackslipError

G = 9.81


@pytest.fixture(scope="module")
def rescue():
    return build_tracked(load_tracked("rescue"))


@pytest.mark.parametrize("name", [name for name in ROBOTS if name not in ("husky", "warthog")])
def test_shipped_robots_stand_on_their_tracks(name):
    made = build_tracked(load_tracked(name))
    model, data = made.model, mujoco.MjData(made.model)
    data.qpos[made.free[0] + 2] = -made.robot.lowest
    data.qpos[made.flipper_qpos] = made.flipper_control(np.full(len(made.flipper_sign), 1.0))
    data.ctrl[made.flipper_motor] = data.qpos[made.flipper_qpos]
    belts = bind(model, *made.tracks)
    for _ in range(500):
        mujoco.mj_step(model, data)
    load = belts.read(model, data).load
    weight = G * model.body_subtreemass[made.body]
    assert load[:2].sum() == pytest.approx(weight, rel=2e-3)
    assert (load[2:] == 0).all()
    assert load[0] == pytest.approx(load[1], rel=1e-3)


def test_positive_angles_lift_the_tips_of_all_flippers(rescue):
    data = mujoco.MjData(rescue.model)

    def tips(angle):
        data.qpos[rescue.flipper_qpos] = rescue.flipper_control(np.full(4, angle))
        mujoco.mj_kinematics(rescue.model, data)
        found = []
        for flipper in rescue.robot.flippers:
            body = rescue.model.body(flipper.body).id
            x, z, _ = max(flipper.hull, key=lambda wheel: abs(wheel[0]))
            found.append(data.xpos[body, 2] + (data.xmat[body].reshape(3, 3) @ [x, flipper.y, z])[2])
        return np.array(found)

    length = 0.245
    np.testing.assert_allclose(tips(0.5) - tips(0.0), length * np.sin(0.5), atol=1e-12)
    assert rescue.flipper_angles(data.qpos).shape == (4,)
    np.testing.assert_allclose(rescue.flipper_angles(data.qpos), 0.0, atol=1e-12)


def test_looks_weigh_and_touch_nothing(rescue):
    shown = build_tracked(rescue.robot, looks=True)
    assert shown.model.ngeom > rescue.model.ngeom
    np.testing.assert_array_equal(shown.model.body_mass[1:], rescue.model.body_mass[1:])
    np.testing.assert_array_equal(shown.model.body_inertia[1:], rescue.model.body_inertia[1:])
    assert shown.model.npair == rescue.model.npair
    looks = shown.model.geom_group == 1
    assert not (shown.model.geom_contype[looks] | shown.model.geom_conaffinity[looks]).any()


def test_a_model_whose_motion_is_not_finite_is_refused(tmp_path):
    robot = load_tracked(write_robot(tmp_path, model=URDF.replace("0 0 0.14", "0 0 nan")))
    with pytest.raises(TrackslipError, match=r"mine\.urdf: a number in it is nan, inf or too large"):
        build_tracked(robot)


def test_a_model_of_too_long_a_name_is_no_file(tmp_path):
    robot = load_tracked(write_robot(tmp_path, ROBOT.replace("mine.urdf", "x" * 5000)))
    with pytest.raises(TrackslipError, match="no such file"):
        build_tracked(robot)


def test_visuals_that_carry_the_mass_are_kept(tmp_path):
    geom = '<geom type="box" size="0.2 0.1 0.05" pos="0 0 0.2" contype="0" conaffinity="0" group="1"/>'
    model = f'<mujoco><worldbody><body name="b"><freejoint/>{geom}</body></worldbody></mujoco>'
    (tmp_path / "b.xml").write_text(model)
    (tmp_path / "b.toml").write_text('model = "b.xml"\nhalf_gauge = 0.2\nhull = [[-0.2, 0.1, 0.1], [0.2, 0.1, 0.1]]\n')
    made = build_tracked(load_tracked(tmp_path / "b.toml"))
    assert made.model.body_subtreemass[made.body] == pytest.approx(1000 * 8 * 0.2 * 0.1 * 0.05)


def test_a_urdf_gets_a_free_joint_and_a_motor(tmp_path):
    made = build_tracked(load_tracked(write_robot(tmp_path)), load_course("flat"))
    assert made.robot.name == "mine"
    assert made.model.nq == 8
    assert made.model.nu == 1
    assert made.flipper_sign.tolist() == [-1.0]
    assert made.flipper_range.tolist() == [[-1.0, 1.0]]
    assert made.track_side.tolist() == [0, 1, 0]
    assert made.model.body_subtreemass[made.body] == pytest.approx(21.0)


def test_a_light_flipper_is_stable_at_the_long_step(tmp_path):
    made = build_tracked(load_tracked(write_robot(tmp_path)), preset="fast")
    model, data = made.model, mujoco.MjData(made.model)
    data.qpos[2] = 0.5
    data.ctrl[:] = made.flipper_control(np.array([0.5]))
    model.opt.gravity[:] = 0
    for _ in range(500):
        mujoco.mj_step(model, data)
    assert made.flipper_angles(data.qpos) == pytest.approx(0.5, abs=1e-6)
    assert abs(data.qvel[6]) < 1e-6  # of the hinge; nothing holds the robot itself


def test_the_scene_and_states_of_the_model_stay_behind(tmp_path):
    model = URDF.replace(
        "</robot>",
        '<mujoco><compiler fusestatic="true"/></mujoco></robot>',
    )
    made = build_tracked(load_tracked(write_robot(tmp_path, model=model)))
    assert made.model.body(made.body).name == "base"
    xml = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/><light pos="0 0 1"/>
    <body name="b"><freejoint/><geom type="box" size="0.2 0.1 0.05" pos="0 0 0.2"/></body></worldbody>
    <keyframe><key qpos="0 0 1 1 0 0 0"/></keyframe></mujoco>"""
    (tmp_path / "mine.urdf").write_text(xml)
    (tmp_path / "scene.xml").write_text(xml)
    text = ROBOT.split("[[flippers]]")[0].replace("mine.urdf", "scene.xml")
    made = build_tracked(load_tracked(write_robot(tmp_path, text)), load_course("flat"))
    assert "floor" not in [made.model.geom(i).name for i in range(made.model.ngeom)]
    assert made.model.nkey == made.model.nlight == 0


def test_flippers_start_clear_of_the_ground(rescue):
    up = np.array([1.0, 0.3, 0.5, 0.2])
    np.testing.assert_allclose(clear_angles(rescue, up), up)
    lifted = clear_angles(rescue, np.full(4, -1.2))
    # the tip's wheel, 0.04 m, 0.245 m from the hinge at 0.08 m, just clears the ground at -asin(0.04 / 0.245)
    step = (2.6 + 1.2) / 60
    assert (lifted >= -np.arcsin(0.04 / 0.245) - 1e-9).all()
    assert (lifted <= -np.arcsin(0.04 / 0.245) + step).all()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("mine.urdf", "gone.urdf", r"gone.urdf: no such file; `model` must name"),
        ('body = "arm"', 'body = "leg"', "flippers: body = 'leg': must be one of the model's: arm"),
        ('body = "arm"', 'body = "base"', "body = 'base': must have one joint, a hinge"),
        ("half_gauge", 'body = "arm"\nhalf_gauge', "body = 'arm': must be one that lies in the world: base"),
        ("0.1, 0.1]", "0.3, 0.1]", "geom .* reaches down to 0.09 m .* above the tracks' lowest point, at 0.2 m"),
    ],
)
def test_robots_that_cannot_be_built(tmp_path, old, new, said):
    with pytest.raises(TrackslipError, match=said):
        build_tracked(load_tracked(write_robot(tmp_path, ROBOT.replace(old, new))))


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("<", "XML"),
        ('<joint type="slide" name="rail"/><geom size="0.1"/>', "joints of body 'base' = rail: must be a free joint"),
        ("<freejoint/>", "mass and inertia of moving bodies"),
    ],
)
def test_what_is_wrong_with_a_model_is_said_of_its_file(tmp_path, body, said):
    model = f'<mujoco><worldbody><body name="base">{body}</body></worldbody></mujoco>'
    with pytest.raises(TrackslipError, match=rf"mine\.urdf: .*{said}"):
        build_tracked(load_tracked(write_robot(tmp_path, ROBOT.split("[[flippers]]")[0], model)))
