"""Robots that fall don't bounce higher than they fell from; cores stop what comes down on few points."""

import mujoco
import numpy as np
import pytest
from mujoco import batch
from tracked import add_robot, built, plane, slab

from sim.terrain import Course, Rough
from sim.tracks import Belts, Track, add_tracks

DROPS = np.array([0.02, 0.05, 0.1, 0.15, 0.2, 0.3])
"""Heights from which robots fall [m]."""
HULL = [(-0.25, 0.07, 0.07), (0.25, 0.07, 0.07)]
ROUGH = Course((Rough(length=6.0, amplitude=0.1, cell=0.1),), width=6.0)


@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize(("preset", "size"), [("accurate", (0.25, 0.2, 0.1)), ("fast", (0.2, 0.14, 0.05))])
def test_boxes_bounce_lower_than_they_fell_from(preset, size, rough):
    """By far on a plane. On rough ground, 0.05 m high, they may land lower."""
    spec, rng = mujoco.MjSpec(), np.random.default_rng(0)
    if rough:
        terrain, above, share = ROUGH.add_to(spec), 0.05, 1.0
    else:
        spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[9, 9, 1])
        terrain, above, share = "ground", 0.0, 0.6
    start = np.column_stack([rng.uniform([1.5, -1.5], [4.5, 1.5], (len(DROPS), 2)), above + DROPS])
    body = spec.worldbody.add_body(name="box")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=[0, 0, 0.12], mass=25, contype=0, conaffinity=0)
    add_tracks(spec, "box", Track(half_gauge=0.2, hull=HULL, preset=preset), terrain=terrain)
    model = spec.compile()
    robots = batch.Batch(model, len(start), nthread=1)
    robots.qpos[:, :3] = start
    Belts(model).bind_batch(robots).set(np.zeros((len(start), 2)))
    rises, top = np.zeros(len(start), bool), np.full(len(start), -np.inf)
    for _ in range(round(0.7 / model.opt.timestep)):
        robots.step()
        rises |= robots.qvel[:, 2] > 0
        top = np.where(rises, np.maximum(top, robots.qpos[:, 2]), top)
    assert (top < share * start[:, 2]).all()


WEIGHT = 25 * 9.81
"""Of the robot [N]."""
DROP = 0.05
"""Height from which it falls on a beam, which it meets with 1 m/s [m]."""
BOUNDS = {"accurate": 0.005, "fast": 0.009}
"""Of its depth [m]."""


def touching_cores(data):
    return [contact for contact in data.contact if contact.includemargin < 0]


@pytest.mark.parametrize("preset", BOUNDS)
def test_a_robot_that_falls_on_a_beam_is_stopped_and_the_load_is_the_whole_force(preset):
    spec = mujoco.MjSpec()
    size = [0.02, 1.0, 0.1]
    beam = spec.worldbody.add_geom(name="beam", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=[0, 0, -0.1])
    body = add_robot(spec)
    spec.delete(body.joints[0])
    body.add_joint(name="rail", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    model, data, belts = built(spec, preset, terrain=[beam])
    data.qpos[0] = DROP
    heights, depths, loads, cores, speeds = [], [], [], 0, [0.0]
    while data.time < 0.25:
        mujoco.mj_step(model, data)
        reading = belts.read(data)
        heights.append(data.qpos[0])
        depths.append(reading.depth.max())
        loads.append(reading.load.sum())
        speeds.append(data.qvel[0])
        cores += len(touching_cores(data))
    assert cores
    np.testing.assert_allclose(25 * np.diff(speeds) / model.opt.timestep, np.array(loads) - WEIGHT, atol=1e-6 * WEIGHT)
    assert max(depths) < BOUNDS[preset]
    landed = int(np.argmin(heights))
    assert max(heights[landed:]) < 0.6 * DROP


@pytest.mark.parametrize(("preset", "ground"), [("accurate", plane), ("fast", slab)])
def test_a_robot_that_turns_on_the_spot_does_not_touch_with_its_cores(preset, ground):
    spec = ground()
    add_robot(spec)
    model, data, belts = built(spec, preset)
    belts.set([-0.5, 0.5])
    for _ in range(round(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        assert not touching_cores(data)
    assert data.qvel[5] > 0.5


@pytest.mark.parametrize(("preset", "mass"), [("accurate", 2.0), ("fast", 0.5)])
def test_belts_of_light_modules_that_slide_do_not_hop(preset, mass):
    """A belt a side on each of two hinged modules, in a pivot: sliding must not push what is light off the ground."""
    spec = plane()
    body = spec.worldbody.add_body(name="robot")
    body.add_freejoint()
    body.mass, body.ipos, body.inertia, body.explicitinertial = 17.0, [0, 0, 0.15], [0.15, 0.4, 0.5], True
    for x in (-0.2, 0.2):
        for side in (-1.0, 1.0):
            module = body.add_body(name=f"module {x} {side}", pos=[x, 0.2 * side, 0.08])
            module.mass, module.ipos, module.explicitinertial = mass, [0, 0, 0], True
            module.inertia = [0.0015 * mass, 0.005 * mass, 0.005 * mass]
            module.add_joint(name=module.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
            hull = [(-0.125, 0, 0.08), (0.125, 0, 0.08)]
            options = {"half_gauge": 0.0, "side": "left", "load": 0.5, "preset": preset}
            add_tracks(spec, module, Track(hull=hull, **options), terrain=["ground"])
    model = spec.compile()
    data, belts = mujoco.MjData(model), Belts(model)
    for speed in (0.3, 0.6):
        mujoco.mj_resetData(model, data)
        belts.set([speed, -speed] * 2)
        loads = []
        while data.time < 1.5:
            mujoco.mj_step(model, data)
            loads.append(belts.read(data).load)
        steady = np.array(loads)[len(loads) // 2 :]
        assert np.ptp(steady, axis=0).max() < 0.01 * steady.mean()
