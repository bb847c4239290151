import re
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from tracked import HULL, add_flipper, add_robot, built, plane, slab

from sim.tracks import PRESETS, add_tracks, bind
from trackslip.errors import InvalidValueError, TrackslipError

FLIPPER = [(0, 0, 0.08), (0.25, 0, 0.05)]


def on_plane():
    """A plane with a robot without tracks."""
    spec = plane()
    add_robot(spec)
    return spec


def tracked(spec, **options):
    return add_tracks(spec, **({"body": "robot", "half_gauge": 0.2, "hull": HULL} | options))


def driven(model, belts, speeds=(0.3, 0.3), steps=1000):
    """The state after some steps at belt speeds."""
    data = mujoco.MjData(model)
    belts.set(model, speeds)
    mujoco.mj_step(model, data, steps)
    return data


def test_tracks_need_mujoco_and_numpy_only():
    code = (
        "import sys\n"
        "for name in ('gymnasium', 'scipy', 'rerun', 'pyarrow', 'matplotlib'): sys.modules[name] = None\n"
        "import sim.tracks\n"
        "print(sorted(m for m in sys.modules if m.startswith('sim.') and not m.startswith('sim.tracks')))\n"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.parametrize("preset", PRESETS)
def test_the_ground_carries_the_robot_at_the_depth_of_the_preset(preset):
    model, data, belts = built(on_plane(), preset)
    mujoco.mj_step(model, data, 1000)
    reading = belts.read(model, data)
    assert reading.load.sum() == pytest.approx(25 * 9.81, rel=1e-4)
    np.testing.assert_allclose(reading.depth, PRESETS[preset].sink, rtol=0.02)
    assert np.isnan(reading.slip).all()
    assert np.abs(reading.sliding).max() < 1e-6


def test_a_body_that_is_turned_on_the_robot_drives_where_its_own_x_axis_points():
    spec = plane()
    add_robot(spec).add_body(name="turned", quat=[np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    tracks = tracked(spec, body="turned", terrain="ground")
    model = spec.compile()
    np.testing.assert_allclose(driven(model, bind(model, tracks)).qpos[:2], [0.0, 0.6], atol=0.02)


def test_pairs_and_flippers_share_a_robot():
    spec = slab()
    body = add_robot(spec)
    every = [tracked(spec, body=body)]
    for side, y in (("left", 0.28), ("right", -0.28)):
        flipper = add_flipper(spec, body, f"flipper_{side}", 0.25, y)
        every.append(tracked(spec, body=flipper, half_gauge=0.0, side=side, hull=FLIPPER))
    for tracks in every:
        tracks.connect(spec)
    model = spec.compile()
    belts = bind(model, *every)
    assert belts.names == ("robot_left", "robot_right", "flipper_left", "flipper_right")
    data = driven(model, belts, [0.2] * 4)
    assert data.qpos[0] == pytest.approx(0.4, abs=0.03)
    assert belts.read(model, data).load.sum() == pytest.approx(28 * 9.81, rel=0.01)


def test_an_attached_robot_keeps_its_tracks_under_other_names():
    robot, scene = mujoco.MjSpec(), plane()
    add_robot(robot)
    tracks = tracked(robot)
    scene.worldbody.add_frame().attach_body(robot.body("robot"), "first/", "")
    with pytest.raises(InvalidValueError, match=r"must be in this spec; .* Tracks.prefixed"):
        tracks.connect(scene)
    tracks = tracks.prefixed("first/")
    tracks.connect(scene)
    model = scene.compile()
    assert driven(model, bind(model, tracks), steps=500).qpos[0] == pytest.approx(0.3, abs=0.02)


def test_a_robot_that_is_held_in_height_drives_along_its_rail():
    spec = plane()
    body = spec.worldbody.add_body(name="robot", pos=[0, 0, -0.0003])
    body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    body.mass, body.inertia, body.explicitinertial = 25.0, [0.45, 0.6, 0.89], True
    model, _, belts = built(spec)
    assert driven(model, belts, steps=500).qvel[0] == pytest.approx(0.3, abs=0.01)


def test_whatever_is_fixed_to_the_world_is_terrain_by_default():
    spec = plane()
    rack = spec.worldbody.add_body(name="rack").add_body(name="shelf")
    rack.add_geom(name="board", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1])
    rack.add_geom(name="paint", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1], contype=0, conaffinity=0)
    for name, moves in (("parcel", True), ("lift", False)):
        body = spec.worldbody.add_body(name=name, pos=[3, 0, 1], mocap=not moves)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1])
        if moves:
            body.add_freejoint()
    add_robot(spec)
    tracked(spec).connect(spec)
    assert {pair.geomname1 for pair in spec.pairs} == {"ground", "board"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"body": "rover"}, "body = 'rover': must be a body of the spec: world, robot"),
        ({"body": "world"}, "body = 'world': must be a body that moves"),
        ({"half_gauge": 0.0}, "half_gauge = 0.0: must be a finite number > 0"),
        ({"side": ["left"]}, "side = ['left']: must be one of both, left, right"),
        ({"preset": "exact"}, "preset = 'exact': must be one of accurate, fast"),
        ({"friction": (0.7, 0.0)}, "friction = 0.0: must be a finite number > 0"),
        ({"load": "half"}, "load = 'half': must be a finite number > 0"),
        ({"segments": 0}, "segments = 0: must be a whole number from 1 to 40"),
        ({"terrain": ["stairs"]}, "terrain = 'stairs': must be a geom of the spec, such as ground"),
        ({"terrain": [plane().geom("ground")]}, "terrain = 'ground': must be a geom of the spec"),
        ({"terrain": []}, "terrain = []: must be at least one geom"),
        ({"terrain": ["ground", "ground"]}, "terrain = 'ground': must be connected with robot_left only once"),
    ],
)
def test_bad_arguments_are_named_and_leave_the_spec_as_it_was(options, message):
    spec = on_plane()
    before = spec.to_xml()
    with pytest.raises(InvalidValueError, match=f"^{re.escape(message)}"):
        tracked(spec, **options)
    assert spec.to_xml() == before
    tracked(spec, terrain=["ground"])
    with pytest.raises(InvalidValueError, match="name = 'robot': must be another"):
        tracked(spec, half_gauge=0.3)
    tracked(spec, half_gauge=0.3, name="outer")


MOVING = "mass and inertia of moving bodies must be larger than mjMINVAL"


def weightless(spec):
    spec.body("robot").add_body(name="weightless").add_joint()


@pytest.mark.parametrize(
    ("spoil", "ground", "options", "message"),
    [
        (
            weightless,
            plane,
            {},
            f"spec: must compile before tracks are connected: {MOVING} Element name 'weightless', id 2",
        ),
        (lambda spec: None, slab, {"friction": (0.7, 0.9)}, "friction = (0.7, 0.9): must be equal along and across"),
    ],
)
def test_specs_that_cannot_have_tracks_are_refused(spoil, ground, options, message):
    spec = ground()
    add_robot(spec)
    spoil(spec)
    with pytest.raises(TrackslipError, match=re.escape(message)):
        tracked(spec, terrain="ground", **options)


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("cone", mujoco.mjtCone.mjCONE_PYRAMIDAL, "cone = 'pyramidal': must be elliptic"),
        ("impratio", 1.0, "impratio = 1.0: must be at least 10000"),
        ("enableflags", mujoco.mjtEnableBit.mjENBL_OVERRIDE, "flag override = 'enable': must be disable"),
        ("timestep", 0.003, "timestep = 0.003: must be at most 0.002 s"),
    ],
)
def test_options_of_a_model_that_spoil_the_recipe_are_refused(option, value, message):
    spec = on_plane()
    bare = spec.compile()
    tracks = tracked(spec, terrain="ground")
    with pytest.raises(InvalidValueError, match="must be in the model"):
        bind(bare, tracks)
    model = spec.compile()
    setattr(model.opt, option, value)
    with pytest.raises(InvalidValueError, match=message):
        tracks.bind(model)


def test_more_pairs_than_a_step_can_test_are_refused():
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="robot")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.25, 0.15, 0.05], pos=[0, 0, 0.12], mass=25)
    for k in range(600):
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 0.05, 0.02], pos=[k, 0, 0])
    tracks = add_tracks(spec, "robot", half_gauge=0.2, hull=[(-0.25, 0.08, 0.08), (0.25, 0.08, 0.08)])
    with pytest.raises(
        InvalidValueError, match=r"terrain = '600 geoms, 25,200 contact pairs .*: must be at most 20,000"
    ):
        tracks.connect(spec)
    assert not spec.pairs
    tracks.connect(spec, list(spec.worldbody.geoms)[:5])
    assert len(spec.pairs) == 5 * 42
