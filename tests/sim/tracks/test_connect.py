"""Cores stop what comes down on few points, and leave alone what stands or turns."""

import mujoco
import numpy as np
import pytest
from tracked import add_robot, built, plane, slab

from sim.tracks import PRESETS

WEIGHT = 25 * 9.81
"""Of the robot [N]."""
DROP = 0.05
"""Height from which it falls on a beam, which it meets with 1 m/s [m]."""
BOUNDS = {"accurate": 0.005, "fast": 0.009}
"""Of its depth [m]."""


def touching_cores(data):
    return [contact for contact in data.contact if contact.dim == 1]


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
        reading = belts.read(model, data)
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


@pytest.mark.parametrize("ground", [plane, slab])
@pytest.mark.parametrize("preset", PRESETS)
def test_a_robot_that_turns_on_the_spot_does_not_touch_with_its_cores(preset, ground):
    spec = ground()
    add_robot(spec)
    model, data, belts = built(spec, preset)
    belts.set(model, [-0.5, 0.5])
    for _ in range(round(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        assert not touching_cores(data)
    assert data.qvel[5] > 0.5
