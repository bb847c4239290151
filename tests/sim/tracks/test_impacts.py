import mujoco
import numpy as np
import pytest
from tracked import add_robot, built, plane

from sim.tracks import PRESETS, Belts, Track, add_tracks

WEIGHT = 25 * 9.81
"""Of the robot [N]."""
DROP = 0.05
"""Height from which it falls on a beam, which it meets with 1 m/s [m]."""
BOUNDS = {"accurate": 0.005, "fast": 0.009}
"""Of its depth [m]."""


def touching_cores(data):
    return [contact for contact in data.contact if contact.includemargin < 0]


@pytest.mark.parametrize("preset", BOUNDS)
def test_a_beam_stops_a_falling_robot_and_bears_the_whole_load(preset):
    spec = mujoco.MjSpec()
    size = [0.02, 1.0, 0.1]
    beam = spec.worldbody.add_geom(
        name="beam", type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=[0, 0, -0.1]
    )
    body = add_robot(spec)
    spec.delete(body.joints[0])
    body.add_joint(name="rail", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1])
    model, data, belts = built(spec, preset, terrain=[beam])
    data.qpos[0] = DROP
    heights = []
    depths = []
    loads = []
    cores = 0
    speeds = [0.0]
    while data.time < 0.25:
        mujoco.mj_step(model, data)
        reading = belts.read(data)
        heights.append(data.qpos[0])
        depths.append(reading.depth.max())
        loads.append(reading.load.sum())
        speeds.append(data.qvel[0])
        cores += len(touching_cores(data))
    assert cores
    acceleration = np.diff(speeds) / model.opt.timestep
    net_force = np.array(loads) - WEIGHT
    np.testing.assert_allclose(25 * acceleration, net_force, atol=1e-6 * WEIGHT)
    assert max(depths) < BOUNDS[preset]
    assert depths[-1] < 1.1 * PRESETS[preset].core_depth  # the core has pushed it out again
    landed = int(np.argmin(heights))
    assert max(heights[landed:]) < 0.6 * DROP


@pytest.mark.parametrize(("preset", "mass"), [("accurate", 2.0), ("fast", 0.5)])
def test_belts_of_light_modules_that_slide_do_not_hop(preset, mass):
    """A belt a side on each of two hinged modules, in a pivot: sliding must not push what is light
    off the ground.
    """
    spec = plane()
    body = spec.worldbody.add_body(name="robot")
    body.add_freejoint()
    body.mass = 17.0
    body.ipos = [0, 0, 0.15]
    body.inertia = [0.15, 0.4, 0.5]
    body.explicitinertial = True
    for x in (-0.2, 0.2):
        for side in (-1.0, 1.0):
            module = body.add_body(name=f"module {x} {side}", pos=[x, 0.2 * side, 0.08])
            module.mass = mass
            module.ipos = [0, 0, 0]
            module.explicitinertial = True
            module.inertia = [0.0015 * mass, 0.005 * mass, 0.005 * mass]
            module.add_joint(name=module.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
            hull = [(-0.125, 0, 0.08), (0.125, 0, 0.08)]
            options = {"half_gauge": 0.0, "side": "left", "load": 0.5, "preset": preset}
            add_tracks(spec, module, Track(hull=hull, **options), terrain=["ground"])
    model = spec.compile()
    data = mujoco.MjData(model)
    belts = Belts(model)
    for speed in (0.3, 0.6):
        mujoco.mj_resetData(model, data)
        belts.set([speed, -speed] * 2)
        loads = []
        while data.time < 1.5:
            mujoco.mj_step(model, data)
            loads.append(belts.read(data).load)
        steady = np.array(loads)[len(loads) // 2 :]
        assert np.ptp(steady, axis=0).max() < 0.01 * steady.mean()
