import mujoco
import numpy as np
import pytest
from mujoco import batch

from sim.tracks import add_tracks, bind
from trackslip.errors import InvalidValueError

HULL = [(-0.25, 0.08, 0.08), (0.25, 0.08, 0.08)]


def box_robot():
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1])
    body = spec.worldbody.add_body(name="robot")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.2, 0.12, 0.06], pos=[0, 0, 0.12], mass=25, contype=0)
    return spec


def test_a_row_of_a_batch_moves_as_it_does_alone():
    spec = box_robot()
    tracks = add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain=["ground"])
    model = spec.compile()
    belts = bind(model, tracks)
    assert belts.names == ("robot_left", "robot_right")
    data = mujoco.MjData(model)
    belts.set(model, [0.3, 0.35])
    mujoco.mj_step(model, data, 500)
    together = batch.Batch(model, 3, nthread=2)
    live = belts.bind_batch(together)
    live.set([[0.1, -0.2], [0.3, 0.35], [0.0, 0.0]])
    together.step(nstep=500)
    np.testing.assert_array_equal(together.qpos[1], data.qpos)
    alone, rows = belts.read(model, data), live.read()
    for name in ("traction", "load", "sliding", "slip", "touching", "depth"):
        np.testing.assert_array_equal(getattr(rows, name)[1], getattr(alone, name), err_msg=name)


def test_the_ground_carries_the_robot():
    spec = box_robot()
    tracks = add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain=["ground"])
    model = spec.compile()
    belts, data = tracks.bind(model), mujoco.MjData(model)
    mujoco.mj_step(model, data, 1000)
    reading = belts.read(model, data)
    assert reading.load.sum() == pytest.approx(25 * 9.81, rel=1e-4)
    np.testing.assert_allclose(reading.depth, 0.0003, rtol=0.01)
    assert np.isnan(reading.slip).all()
    assert np.abs(reading.sliding).max() < 1e-6


def test_a_missing_geom_is_named():
    spec = box_robot()
    with pytest.raises(InvalidValueError, match="terrain = 'stairs': must be a geom of the spec: ground"):
        add_tracks(spec, "robot", half_gauge=0.2, hull=HULL, terrain=["stairs"])
