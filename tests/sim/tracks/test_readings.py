from dataclasses import replace

import mujoco
import numpy as np
import pytest
from tracked import add_robot, built, plane

from sim.terrain import Course, HeightField
from sim.tracks import Belts, Reading, Track, add_tracks
from trackslip.errors import InvalidValueError, TrackslipError


@pytest.fixture
def robot():
    spec = plane()
    add_robot(spec)
    return built(spec)


def test_slip_in_a_turn_is_that_of_the_track_over_the_ground(robot):
    model, data, belts = robot
    speeds = np.array([0.1, 0.3])
    belts.set(speeds)
    mujoco.mj_step(model, data, 1000)
    twist = data.qvel.copy()  # of the state that the last step began with, to within a step
    forwards = data.xmat[1].reshape(3, 3)[:, 0] @ twist[:3]
    over_ground = forwards + np.array([-0.2, 0.2]) * twist[5]
    reading = belts.read(data)
    np.testing.assert_allclose(reading.slip, 1 - over_ground / speeds, atol=1e-4)
    np.testing.assert_allclose(reading.sliding, speeds - over_ground, atol=1e-5)


def test_a_track_in_the_air_has_no_slip(robot):
    model, data, belts = robot
    belts.set([0.2, 0.2])
    data.qpos[2] = 1.0
    mujoco.mj_step(model, data)
    reading = belts.read(data)
    assert not reading.touching.any()
    assert np.isnan(reading.slip).all()
    assert np.isnan(reading.sliding).all()
    np.testing.assert_array_equal([reading.traction, reading.load, reading.depth], np.zeros((3, 2)))


def test_wheels_on_an_edge_pull_along_the_belt_there():
    """A wheel before a high step: the belt's force is tangential, and turns with the normal."""
    spec = plane()
    spec.worldbody.add_geom(
        name="wall", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 1, 0.5], pos=[0.43, 0, 0.5]
    )
    add_robot(spec)
    model, data, belts = built(spec, terrain=["ground", "wall"])
    belts.set([0.1, 0.1])
    mujoco.mj_step(model, data, 300)
    wall = model.geom("wall").id
    assert (data.contact.geom == wall).any()
    reading = belts.read(data)
    pull = 0.0
    load = 0.0
    for i, contact in enumerate(data.contact):
        force = np.zeros(6)
        mujoco.mj_contactForce(model, data, i, force)
        load += force[0]
        towards_track = 1 if contact.geom[1] > contact.geom[0] else -1
        frame = contact.frame.reshape(3, 3)
        out = -towards_track * frame[0]  # from the track
        ahead = np.cross([0, 1, 0], -out)
        on_track = towards_track * (frame.T @ force[:3])
        pull += ahead @ on_track
    np.testing.assert_allclose(reading.traction.sum(), pull, rtol=1e-4)
    np.testing.assert_allclose(reading.load.sum(), load, rtol=1e-9)
    assert pull > 0


def on_a_field(length, cell, preset):
    """A robot of this length at rest on a level height field: model, data and belts."""
    count = round(1.7 * length / cell / 2) * 2 + 2
    side = count * cell
    radius = 0.16 * length
    course = Course((HeightField(np.zeros((count + 1, count + 1)), side, side),), width=side)
    spec = mujoco.MjSpec()
    turned = [np.cos(0.15), 0, 0, np.sin(0.15)]  # by 0.3 rad
    body = spec.worldbody.add_body(name="robot", pos=[side / 2, 0, 0], quat=turned)
    body.add_freejoint()
    size = [length / 2, length / 3, length / 10]
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=[0, 0, length / 4], mass=200 * length**3
    )
    hull = [(-length / 2, radius, radius), (length / 2, radius, radius)]
    track = Track(half_gauge=0.4 * length, hull=hull, preset=preset)
    add_tracks(spec, "robot", track, terrain=course.add_to(spec))
    model = spec.compile()
    return model, mujoco.MjData(model), Belts(model)


FINE = r"cell of the height field = .*: must be at least .* under capsules"


@pytest.mark.parametrize(
    ("length", "cell", "preset"),
    [(0.3, 0.008, "fast"), (7.0, 0.12, "fast"), (7.0, 0.1, "accurate")],
)
def test_cells_of_which_the_engine_may_drop_contacts_are_refused(length, cell, preset):
    with pytest.raises(InvalidValueError, match=FINE):
        on_a_field(length, cell, preset)


@pytest.mark.parametrize(
    ("length", "cell", "preset"),
    [(0.3, 0.008, "accurate"), (0.5, 0.02, "fast"), (0.5, 0.2, "fast"), (4.4, 0.1, "accurate")],
)
def test_the_load_on_a_height_field_is_the_weight(length, cell, preset):
    model, data, belts = on_a_field(length, cell, preset)
    load = []
    while data.time < 0.5:
        mujoco.mj_step(model, data)
        load.append(belts.read(data).load.sum())
    weight = 9.81 * model.body_subtreemass[0]
    second_half = load[len(load) // 2 :]
    assert np.mean(second_half) == pytest.approx(weight, rel=0.01)


def test_the_track_that_lacks_most_contacts_is_named():
    missing = np.array([[0.0, 0.01], [0.0, 0.2], [0.1, 0.0]])  # of three robots
    for rows, name in ((slice(None), "right"), (2, "left")):
        reading = replace(Reading.none(3, 2), missing=missing)[rows]
        with pytest.raises(TrackslipError, match=f"track {name} touches the terrain at more"):
            reading.complete(("left", "right"))


def test_a_reading_that_lacks_contacts_says_so():
    model, data, belts = on_a_field(0.5, 0.02, "accurate")
    belts._map.slots[:] = 20  # noqa: SLF001  no terrain of a test has as many contacts as it may have
    mujoco.mj_step(model, data, 200)
    said = "touches the terrain at more points than its sensor reports"
    with pytest.raises(TrackslipError, match=said):
        belts.read(data)
