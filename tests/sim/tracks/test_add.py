import subprocess
import sys

import mujoco
import numpy as np
import pytest
from tracked import HULL, URDF, add_flipper, add_robot, plane, slab

from sim.tracks import PRESETS, add_tracks, bind
from trackslip.errors import InvalidValueError, TrackslipError


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
    spec = plane()
    add_robot(spec)
    tracks = add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, preset=preset, terrain="ground")
    model = spec.compile()
    belts, data = tracks.bind(model), mujoco.MjData(model)
    mujoco.mj_step(model, data, 1000)
    reading = belts.read(model, data)
    assert reading.load.sum() == pytest.approx(25 * 9.81, rel=1e-4)
    np.testing.assert_allclose(reading.depth, PRESETS[preset].sink, rtol=0.02)
    assert np.isnan(reading.slip).all()
    assert np.abs(reading.sliding).max() < 1e-6


def test_tracks_fit_a_robot_from_a_urdf_file():
    spec = mujoco.MjSpec.from_string(URDF)
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1])
    tracks = add_tracks(spec, "base", half_gauge=0.2, hull=HULL)
    with pytest.raises(InvalidValueError, match="body = 'base_left': must be on a body that moves"):
        tracks.connect(spec)
    spec.body("base").add_freejoint()
    tracks.connect(spec)
    model = spec.compile()
    belts, data = bind(model, tracks), mujoco.MjData(model)
    belts.set(model, [0.3, 0.3])
    mujoco.mj_step(model, data, 1000)
    assert data.qpos[0] == pytest.approx(0.6, abs=0.02)


def test_a_body_that_is_turned_on_the_robot_drives_where_its_own_x_axis_points():
    spec = plane()
    body = add_robot(spec)
    body.add_body(name="turned", quat=[np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    tracks = add_tracks(spec, "turned", half_gauge=0.2, hull=HULL, terrain="ground")
    model = spec.compile()
    belts, data = bind(model, tracks), mujoco.MjData(model)
    belts.set(model, [0.3, 0.3])
    mujoco.mj_step(model, data, 1000)
    np.testing.assert_allclose(data.qpos[:2], [0.0, 0.6], atol=0.02)


def test_pairs_and_flippers_share_a_robot():
    spec = slab()
    body = add_robot(spec)
    main = add_tracks(spec, body, half_gauge=0.2, hull=HULL)
    sides = (("left", 0.28), ("right", -0.28))
    flippers = [
        add_tracks(
            spec,
            add_flipper(spec, body, f"flipper_{side}", 0.25, y),
            half_gauge=0.0,
            side=side,
            hull=[(0, 0, 0.08), (0.25, 0, 0.05)],
        )
        for side, y in sides
    ]
    for tracks in (main, *flippers):
        tracks.connect(spec)
    model = spec.compile()
    belts, data = bind(model, main, *flippers), mujoco.MjData(model)
    assert belts.names == ("robot_left", "robot_right", "flipper_left", "flipper_right")
    belts.set(model, [0.2] * 4)
    mujoco.mj_step(model, data, 1000)
    assert data.qpos[0] == pytest.approx(0.4, abs=0.03)
    assert belts.read(model, data).load.sum() == pytest.approx(28 * 9.81, rel=0.01)


def test_an_attached_robot_keeps_its_tracks_under_other_names():
    robot, scene = mujoco.MjSpec(), plane()
    add_robot(robot).name = "chassis"
    tracks = add_tracks(robot, "chassis", half_gauge=0.2, hull=HULL)
    scene.worldbody.add_frame().attach_body(robot.body("chassis"), "first/", "")
    tracks = tracks.prefixed("first/")
    tracks.connect(scene)
    model = scene.compile()
    belts, data = bind(model, tracks), mujoco.MjData(model)
    belts.set(model, [0.3, 0.3])
    mujoco.mj_step(model, data, 500)
    assert data.qpos[0] == pytest.approx(0.3, abs=0.02)


def refused(message, **changes):
    spec = plane()
    add_robot(spec)
    arguments = {"body": "robot", "half_gauge": 0.2, "hull": HULL} | changes
    with pytest.raises(InvalidValueError, match=message):
        add_tracks(spec, **arguments)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"body": "rover"}, "body = 'rover': must be a body of the spec: world, robot"),
        ({"body": "world"}, "body = 'world': must be a body that moves"),
        ({"half_gauge": 0.0}, "half_gauge = 0.0: must be a finite number > 0"),
        ({"side": "up"}, "side = 'up': must be one of both, left, right"),
        ({"preset": "exact"}, "preset = 'exact': must be one of accurate, fast"),
        ({"friction": (0.7, 0.0)}, "friction = 0.0: must be a finite number > 0"),
        ({"friction": 0.7}, "friction = 0.7: must be two coefficients"),
        ({"load": 0.0}, "load = 0.0: must be a finite number > 0"),
        ({"half_gauge": 20.0}, "half_gauge = 20.0: must be at most 10 m"),
        ({"segments": 0}, "segments = 0: must be a whole number from 1 to 40"),
        ({"load": 1.5}, "load = 1.5: must be at most 1"),
        ({"load": "half"}, "load = 'half': must be a finite number > 0"),
        ({"side": ["left"]}, r"side = \['left'\]: must be one of both, left, right"),
        ({"segments": "four"}, "segments = 'four': must be a whole number from 1 to 40"),
        ({"segments": 2.5}, "segments = 2.5: must be a whole number from 1 to 40"),
        ({"hull": HULL[:1]}, "hull = .*: must be two wheels"),
        ({"terrain": ["stairs"]}, "terrain = 'stairs': must be a geom of the spec, such as ground"),
        ({"terrain": []}, r"terrain = \[\]: must be at least one geom"),
        ({"terrain": ["ground", "ground"]}, "terrain = 'ground': must be connected with robot_left only once"),
    ],
)
def test_bad_arguments_are_named(changes, message):
    refused(message, **changes)


def test_a_spec_stays_as_it_was_where_terrain_is_refused():
    spec = plane()
    add_robot(spec)
    before = spec.to_xml()
    with pytest.raises(InvalidValueError, match="terrain = 'stairs'"):
        add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain=["ground", "stairs"])
    assert spec.to_xml() == before
    block = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1])
    with pytest.raises(InvalidValueError, match="connected with robot_left only once"):
        add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain=[block, block])
    assert not block.name
    add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain=["ground"])


def test_a_name_is_taken_once():
    spec = plane()
    add_robot(spec)
    add_tracks(spec, "robot", half_gauge=0.2, hull=HULL)
    with pytest.raises(InvalidValueError, match="name = 'robot': must be another"):
        add_tracks(spec, "robot", half_gauge=0.3, hull=HULL)
    add_tracks(spec, "robot", half_gauge=0.3, hull=HULL, name="outer")


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
    add_tracks(spec, "robot", half_gauge=0.2, hull=HULL).connect(spec)
    assert {pair.geomname1 for pair in spec.pairs} == {"ground", "board"}


def test_a_geom_of_another_spec_is_no_terrain():
    spec, other = plane(), plane()
    add_robot(spec)
    with pytest.raises(InvalidValueError, match="terrain = 'ground': must be a geom of the spec"):
        add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain=[other.geom("ground")])


def test_friction_differs_along_and_across_on_planes_only():
    spec = slab()
    add_robot(spec)
    with pytest.raises(InvalidValueError, match=r"friction = \(0.7, 0.9\): must be equal .* ground is no plane"):
        add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, friction=(0.7, 0.9), terrain="ground")


@pytest.mark.parametrize(("preset", "step", "longest"), [("accurate", 0.003, 0.002), ("fast", 0.005, 0.004)])
def test_a_time_step_at_which_contacts_are_unstable_is_refused(preset, step, longest):
    spec = plane()
    add_robot(spec)
    spec.option.timestep = step
    with pytest.raises(InvalidValueError, match=f"timestep = {step}: must be at most {longest} s"):
        add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, preset=preset)
    spec.option.timestep = 0.001
    tracks = add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, preset=preset, terrain="ground")
    assert spec.option.timestep == 0.001
    model = spec.compile()
    model.opt.timestep = step
    with pytest.raises(InvalidValueError, match=f"timestep = {step}"):
        bind(model, tracks)


def test_a_spec_that_does_not_compile_is_not_connected():
    spec = plane()
    add_robot(spec)
    spec.body("robot").add_body(name="weightless").add_joint()
    with pytest.raises(TrackslipError, match="spec: must compile before tracks are connected"):
        add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain="ground")


def test_a_model_without_the_tracks_is_refused():
    spec = plane()
    add_robot(spec)
    model = spec.compile()
    tracks = add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain="ground")
    model.opt.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    with pytest.raises(InvalidValueError, match="must be in the model"):
        bind(model, tracks)


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("cone", mujoco.mjtCone.mjCONE_PYRAMIDAL, "cone = 'pyramidal': must be elliptic"),
        ("impratio", 1.0, "impratio = 1.0: must be at least 10000"),
        ("enableflags", mujoco.mjtEnableBit.mjENBL_OVERRIDE, "flag override = 'enable': must be disable"),
    ],
)
def test_options_that_spoil_the_recipe_are_refused(option, value, message):
    spec = plane()
    add_robot(spec)
    tracks = add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain="ground")
    model = spec.compile()
    setattr(model.opt, option, value)
    with pytest.raises(InvalidValueError, match=message):
        tracks.bind(model)


def test_a_spec_that_overrides_contacts_is_refused():
    spec = plane()
    add_robot(spec)
    spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_OVERRIDE
    with pytest.raises(InvalidValueError, match="flag override = 'enable': must be disable"):
        add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain="ground")


def test_tracks_of_an_attached_robot_are_connected_under_their_new_names():
    robot, scene = mujoco.MjSpec(), plane()
    add_robot(robot)
    tracks = add_tracks(robot, "robot", half_gauge=0.2, hull=HULL)
    scene.attach(robot, prefix="first/", frame=scene.worldbody.add_frame())
    with pytest.raises(InvalidValueError, match=r"must be in this spec; .* Tracks.prefixed"):
        tracks.connect(scene)


def test_a_robot_that_is_held_in_height_drives_along_its_rail():
    spec = plane()
    body = spec.worldbody.add_body(name="robot", pos=[0, 0, -0.0003])
    body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    body.mass, body.inertia, body.explicitinertial = 25.0, [0.45, 0.6, 0.89], True
    tracks = add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain="ground")
    model = spec.compile()
    belts, data = tracks.bind(model), mujoco.MjData(model)
    belts.set(model, [0.3, 0.3])
    mujoco.mj_step(model, data, 500)
    assert data.qvel[0] == pytest.approx(0.3, abs=0.01)
