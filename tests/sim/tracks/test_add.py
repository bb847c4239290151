import re
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from tracked import HULL, add_robot, plane

from sim.tracks import Belts, Track, add_tracks, connect
from trackslip.errors import InvalidValueError

SIDES = ("left", "right")


def on_plane():
    spec = plane()
    add_robot(spec)
    return spec


def tracked(spec, body="robot", terrain=None, **options):
    given = {"half_gauge": 0.2, "hull": HULL} | options
    return add_tracks(spec, body, Track(**given), terrain)


def driven(model, belts, speeds=(0.3, 0.3), steps=1000):
    data = mujoco.MjData(model)
    belts.set(speeds)
    mujoco.mj_step(model, data, steps)
    return data


@pytest.mark.parametrize(
    ("preset", "width", "depth"),
    [("accurate", 0.0, 0.34e-3), ("accurate", 0.12, 0.34e-3), ("fast", 0.0, 1.25e-3)],
)
def test_the_ground_carries_the_robot_at_the_depth_of_the_preset(preset, width, depth):
    """Also a payload that comes after the tracks; and belts move a robot that would sleep, whatever
    geoms inherit.
    """
    spec = on_plane()
    spec.default.geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_EULER
    spec.default.geom.alt.euler = [0, 0.5, 0]
    spec.option.enableflags = mujoco.mjtEnableBit.mjENBL_SLEEP
    tracked(spec, preset=preset, terrain="ground", width=width)
    spec.body("robot").add_body(name="payload", pos=[0, 0, 0.2]).add_geom(size=[0.1, 0, 0], mass=20)
    model = spec.compile()
    belts = Belts(model)
    data = driven(model, belts, (0.0, 0.0))
    reading = belts.read(data)
    np.testing.assert_allclose(reading.load, 45 * 9.81 / 2, rtol=1e-3)
    np.testing.assert_allclose(reading.depth, depth, rtol=0.02)
    assert np.abs(reading.sliding).max() < 1e-6
    belts.set((0.3, 0.3))
    mujoco.mj_step(model, data, 100)
    assert data.qvel[0] == pytest.approx(0.3, rel=1e-3)


def test_an_attached_robot_is_connected_with_its_new_scene():
    scene = plane()
    for prefix, y, preset in (("first/", 0.0, "fast"), ("second/", 2.0, "accurate")):
        robot = mujoco.MjSpec()
        add_robot(robot)
        tracked(robot, preset=preset)
        scene.worldbody.add_frame(pos=[0, y, 0]).attach_body(robot.body("robot"), prefix, "")
    connect(scene)
    model = scene.compile()
    assert Belts(model).names == (
        "first/robot_left",
        "first/robot_right",
        "second/robot_left",
        "second/robot_right",
    )
    data = driven(model, Belts(model), (0.0, 0.0, 0.3, 0.3), steps=500)
    np.testing.assert_allclose(data.qpos[[0, 7]], [0.0, 0.3], atol=0.02)


PLAIN = """
import sys
for name in ("gymnasium", "scipy", "rerun", "pyarrow", "matplotlib"):
    sys.modules[name] = None
import mujoco
import numpy as np
from sim.tracks import Belts, connect

xml = '<mujoco><worldbody><body name="post" pos="0 9 0"/></worldbody></mujoco>'
scene = mujoco.MjSpec.from_string(xml)
robot = mujoco.MjSpec.from_file(sys.argv[1])
scene.attach(robot, prefix="a/", suffix="-b", frame=scene.worldbody.add_frame())
connect(scene)  # has nothing left to do
model = scene.compile()
mujoco.mj_saveModel(model, sys.argv[2], None)
model = mujoco.MjModel.from_binary_path(sys.argv[2])
data = mujoco.MjData(model)
Belts(model).set([-0.1, 0.1])
mujoco.mj_step(model, data, 1000)
print(repr(float(data.qvel[5])))
light = ("sim.tracks", "sim.motors", "trackslip.errors", "trackslip.arguments")
assert not [name for name in sys.modules if name.startswith(("sim.", "trackslip.")) and not
            name.startswith(light)]
"""


def test_a_robot_saved_and_attached_elsewhere_turns_as_here(tmp_path):
    """Through XML, an attachment by prefix and suffix, and a binary model, with mujoco, numpy and
    sim.tracks only.
    """
    spec = on_plane()
    tracked(spec, terrain="ground")
    model = spec.compile()
    here = driven(model, Belts(model), (-0.1, 0.1)).qvel[5]
    robot = tmp_path / "robot.xml"
    robot.write_text(spec.to_xml())
    command = [sys.executable, "-c", PLAIN, str(robot), str(tmp_path / "scene.mjb")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert float(done.stdout) == pytest.approx(here, rel=1e-5)


def test_whatever_is_fixed_to_the_world_is_terrain_by_default():
    spec = mujoco.MjSpec.from_string(
        """<mujoco><worldbody><geom name="ground" type="plane" size="9 9 1"/><body><body>
        <geom name="board" size=".1"/>
        <geom name="paint" size=".1" contype="0" conaffinity="0"/></body></body>
        <body mocap="true" pos="3 0 1"><geom name="lift" size=".1"/></body>
        <body pos="3 0 1"><freejoint/><geom name="parcel" size=".1"/></body></worldbody></mujoco>"""
    )
    add_robot(spec)
    tracked(spec)
    connect(spec)
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
        (
            {"terrain": "box", "friction": (0.7, 0.9)},
            "friction = (0.7, 0.9): must be equal along and across",
        ),
        ({"load": "half"}, "load = 'half': must be a finite number > 0"),
        ({"width": 0.5}, "width = 0.5: must be less than 0.4 m"),
        (
            {"half_gauge": -0.2},
            "half_gauge = -0.2: must be a finite number > 0",
        ),
        ({"half_gauge": 10.1}, "half_gauge = 10.1: must be at most 10 m"),
        (
            {"half_gauge": -10.1, "side": "right"},
            "half_gauge = -10.1: must be at most 10 m",
        ),
        ({"friction": (0.7,)}, "friction = (0.7,): must be two coefficients, along and across"),
        ({"friction": (10.1, 0.7)}, "friction = 10.1: must be"),
        ({"offset": np.inf}, "offset = inf: must be a finite number"),
        ({"contact": "skis"}, "contact = 'skis': must be tracks or wheels"),
        (
            {"contact": "wheels", "patch_length": 2 * HULL[0][2]},
            f"patch_length = {2 * HULL[0][2]:g}: must be less than the wheels' diameter",
        ),
        ({"contact": "wheels", "aside": (0.1,)}, "aside = [0.1]: must be one for each wheel, with"),
        ({"aside": (0.0,) * len(HULL)}, "aside = [0.0, 0.0"),
        (
            {"contact": "wheels", "aside": (10.1,) + (0.0,) * (len(HULL) - 1)},
            "aside = 10.1: must be",
        ),
        ({"load": 1.1}, "load = 1.1: must be"),
        ({"width": 10.0, "side": "left"}, "width = 10.0: must be less than 10 m"),
        ({"segments": 41}, "segments = 41: must be a whole number from 1 to 40"),
        ({"segments": 0}, "segments = 0: must be a whole number from 1 to 40"),
        ({"terrain": ["stairs"]}, "terrain = 'stairs': must be a geom of the spec, such as ground"),
        ({"terrain": [plane().geom("ground")]}, "terrain = 'ground': must be a geom of the spec"),
        ({"terrain": []}, "terrain = []: must be at least one geom"),
    ],
)
def test_bad_arguments_are_named_and_leave_the_spec_as_it_was(options, message):
    spec = on_plane()
    spec.worldbody.add_geom(
        name="box", type=mujoco.mjtGeom.mjGEOM_BOX, size=[1, 1, 1], pos=[0, 9, 0]
    )
    before = spec.to_xml()
    with pytest.raises(InvalidValueError, match=f"^{re.escape(message)}"):
        tracked(spec, **options)
    assert spec.to_xml() == before
    tracked(spec, terrain=["ground"])
    with pytest.raises(InvalidValueError, match="name = 'robot': must be another"):
        tracked(spec, half_gauge=0.3)
    tracked(spec, half_gauge=0.3, name="outer")


ROUND = ((-0.5, 0.1, 0.1), (0.5, 0.1, 0.1))
"""A hull whose lower run is a metre long."""


def below(parts):
    """Ends (n, 2) of the capsules along the lower run [m], from rear to front."""
    capsules = [part for part in parts if part.name.startswith("run") and part.cored]
    places = [(part.shape["pos"][0], part.shape["size"][1]) for part in capsules]
    return np.array(sorted([x - half, x + half] for x, half in places))


@pytest.mark.parametrize("segments", [2, 3, 8])
def test_points_of_a_run_are_spread_like_an_even_load(segments):
    """Each end of a capsule bears a load, each wheel half of one: their mean distance from the
    middle is a quarter of the run.
    """
    parts = Track(0.2, ROUND, segments=segments).parts()
    ends = below(parts)
    points = np.sort(ends.ravel())
    np.testing.assert_allclose(np.diff(points), np.diff(points)[0])
    np.testing.assert_allclose(points, -points[::-1], atol=1e-15)
    wheels = [part for part in parts if part.name.startswith("wheel")]
    load = [*np.ones(2 * segments), *(part.weight for part in wheels)]
    distance = [*np.abs(points), *(abs(part.shape["pos"][0]) for part in wheels)]
    assert np.average(distance, weights=load) == pytest.approx(0.25)
    assert (ends[1:, 0] < ends[:-1, 1]).all()  # without gaps


def test_a_single_capsule_is_as_long_as_its_run():
    parts = Track(0.2, ROUND, segments=1).parts()
    np.testing.assert_allclose(below(parts), [[-0.5, 0.5]])


def test_lines_across_a_belt_spread_like_an_even_pressure():
    width = 0.3
    parts = Track(0.2, ROUND, width=width).parts()
    load = np.array([part.weight for part in parts])
    y = np.array([part.shape["pos"][1] for part in parts])
    assert np.average(y**2, weights=load) == pytest.approx(width**2 / 12)
    assert load.sum() == pytest.approx(sum(part.weight for part in Track(0.2, ROUND).parts()))
    assert {abs(part.shape["pos"][1]) for part in parts if part.edge} == {width / 2}


def test_ends_of_a_wheels_patch_spread_like_an_even_pressure():
    patch = 0.06
    track = Track(0.2, ROUND, contact="wheels", patch_length=patch, aside=(0.02, -0.01))
    parts = track.parts()
    x = np.array([part.shape["pos"][0] for part in parts]).reshape(2, 2)
    np.testing.assert_allclose(x.mean(axis=1), [-0.5, 0.5])
    np.testing.assert_allclose(x.var(axis=1), patch**2 / 12)
    assert [part.shape["pos"][1] for part in parts] == [0.02, 0.02, -0.01, -0.01]
    assert [part.weight for part in parts] == [1.0] * 4


def test_models_without_tracks_or_with_wrong_options_are_refused():
    spec = on_plane()
    override = mujoco.mjtEnableBit.mjENBL_OVERRIDE
    with pytest.raises(
        InvalidValueError, match="model = 'no tracks in it': must be one with tracks"
    ):
        Belts(spec.compile())
    tracked(spec)
    with pytest.raises(InvalidValueError, match="connected before the model is compiled"):
        Belts(spec.compile())
    connect(spec)
    no_sensors = mujoco.mjtDisableBit.mjDSBL_SENSOR
    for option, value, message in (
        ("enableflags", override, "flag override = 'enable': must be disable"),
        ("disableflags", no_sensors, "flag sensor = 'disable': must be enable"),
        ("timestep", 0.003, "timestep = 0.003: must be at most 0.002 s"),
    ):
        model = spec.compile()
        setattr(model.opt, option, value)
        with pytest.raises(InvalidValueError, match=message):
            Belts(model)
    for name, value in (
        ("torque_limit", -1.0),
        ("torque_limit", [1.0, 2.0, 3.0]),
        ("inertia", np.nan),
        ("speeds", [0.1]),
    ):
        options = {"speeds": [0.1, 0.1]} | {name: value}
        said = f"{name} = .*: must be (a number of|.*a belt each)"
        with pytest.raises(InvalidValueError, match=said):
            Belts(spec.compile()).set(**options)
