"""Belts with a width: turning, edges and beams, against theory."""

import mujoco
import numpy as np
import pytest
from tracked import HALF_GAUGE, HALF_LENGTH, HULL, add_robot, plane

from sim.tracks import PRESETS, Belts, Track, add_tracks
from trackslip.errors import InvalidValueError
from trackslip.skid_theory import Contact, steady_twist

WIDTH, HEIGHT = 0.12, 0.12  # of the belts, and of the centre of mass [m]


def wide(spec, preset="accurate", terrain="ground", width=WIDTH, **options):
    track = Track(half_gauge=HALF_GAUGE, hull=HULL, preset=preset, width=width, **options)
    add_tracks(spec, "robot", track, terrain=terrain)
    model = spec.compile()
    return model, mujoco.MjData(model), Belts(model)


def even_pressure(along=200, across=12):
    """Two belts under even pressure."""
    x = ((np.arange(along) + 0.5) / along - 0.5) * 2 * HALF_LENGTH
    y = ((np.arange(across) + 0.5) / across - 0.5) * WIDTH
    x, y = np.repeat(x, across), np.tile(y, along)
    return Contact(np.tile(x, 2), np.concatenate([HALF_GAUGE + y, y - HALF_GAUGE]), 0.7, 0.7, (0.0, 0.0, HEIGHT))


@pytest.mark.parametrize(("preset", "speeds", "bound"), [("accurate", (0.04, 0.06), 0.01), ("fast", (-0.5, 0.5), 0.03)])
def test_wide_belts_turn_like_an_even_pressure(preset, speeds, bound):
    spec = plane()
    add_robot(spec)
    model, data, belts = wide(spec, preset)
    belts.set(speeds)
    mujoco.mj_step(model, data, nstep=round(2.0 / model.opt.timestep))
    measured, expected = (
        (speeds[1] - speeds[0]) / (2 * w) for w in (data.qvel[5], steady_twist(speeds, even_pressure(), 9.81)[2])
    )
    assert measured == pytest.approx(expected, rel=bound)
    narrow = steady_twist(speeds, even_pressure(across=1), 9.81)[2]
    assert expected > 1.02 * (speeds[1] - speeds[0]) / (2 * narrow)  # the width shows


def tips(preset, slope, height):
    """True if a robot with wide belts that stands across a slope tips over."""
    spec = plane()
    body = add_robot(spec)
    body.ipos = [0, 0, height]
    model, data, belts = wide(spec, preset, friction=(4.0, 4.0))
    belts.set([0.0, 0.0])
    for part in np.sin(np.linspace(0, np.pi / 2, 400)):  # tilted slowly, to the left
        model.opt.gravity[:] = 9.81 * np.array([0, np.sin(part * slope), -np.cos(part * slope)])
        mujoco.mj_step(model, data, nstep=round(0.01 / model.opt.timestep))
    mujoco.mj_step(model, data, nstep=round(3.0 / model.opt.timestep))
    return bool(data.xmat.reshape(-1, 3, 3)[1, 2, 2] < np.cos(np.radians(30)))


@pytest.mark.parametrize(("preset", "height", "part"), [("accurate", 0.3, 0.97), ("fast", 0.12, 0.95)])
def test_a_robot_tips_over_the_edges_of_its_belts(preset, height, part):
    over = np.arctan((HALF_GAUGE + WIDTH / 2) / height)
    assert not tips(preset, part * over, height)
    assert tips(preset, 1.01 * over, height)


@pytest.mark.parametrize(("width", "holds"), [(0.0, False), (WIDTH, True)])
def test_an_edge_beside_the_middle_of_a_belt_holds_it(width, holds):
    """The left belt's middle is 3 cm beyond the edge of a slab, its inner line on it."""
    spec = mujoco.MjSpec()
    edge = HALF_GAUGE - 0.03
    slab = {"size": [5, 5, 0.5], "pos": [0, edge - 5, -0.5]}
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_BOX, **slab)
    body = add_robot(spec)
    body.ipos = [0, 0.05, HEIGHT]
    model, data, _ = wide(spec, width=width)
    mujoco.mj_step(model, data, nstep=round(3.0 / model.opt.timestep))
    lean = np.arccos(data.xmat.reshape(-1, 3, 3)[1, 2, 2])
    assert (lean < np.radians(0.5)) == holds


def test_a_narrow_beam_beside_the_middle_carries_a_wide_belt():
    height = []
    for width in (0.0, WIDTH):
        spec = mujoco.MjSpec()
        for k, y in enumerate((HALF_GAUGE + 0.06, -HALF_GAUGE - 0.06)):  # beams of 4 cm under the outer edges
            beam = {"size": [5, 0.02, 0.1], "pos": [0, y, -0.1]}
            spec.worldbody.add_geom(name=f"beam{k}", type=mujoco.mjtGeom.mjGEOM_BOX, **beam)
        add_robot(spec)
        model, data, belts = wide(spec, terrain=("beam0", "beam1"), width=width)
        belts.set([0.2, 0.2])
        mujoco.mj_step(model, data, nstep=round(2.0 / model.opt.timestep))
        height.append(data.qpos[2])
    assert height[0] < -0.01  # its wheels hang between the beams
    assert height[1] == pytest.approx(0.0, abs=0.002)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width": 0.5}, r"width = 0.5: must be less than 0.4 m"),
        ({"width": -0.1}, r"width = -0.1"),
        ({"width": 0.1, "lines": 0}, "lines = 0"),
        ({"width": 0.1, "lines": 10}, "lines = 10"),
    ],
)
def test_widths_that_make_no_sense_are_refused(options, message):
    spec = plane()
    add_robot(spec)
    with pytest.raises(InvalidValueError, match=message):
        add_tracks(spec, "robot", Track(half_gauge=HALF_GAUGE, hull=HULL, **options))


@pytest.mark.parametrize(("segments", "lines", "across", "inertia"), [(8, 3, 0.7, 5.0), (40, 9, 0.8, 0.5)])
def test_no_point_is_softer_than_the_engine_knows(segments, lines, across, inertia):
    spec = plane()
    add_robot(spec).inertia = [inertia] * 3
    model, _, _ = wide(spec, segments=segments, lines=lines, friction=(0.7, across))
    assert model.pair_solimp[:, :2].min() >= mujoco.mjMINIMP
    grip = model.pair_solreffriction[:, 1] / np.maximum(model.pair_solimp[:, 0], mujoco.mjMINIMP)
    np.testing.assert_allclose(grip, -PRESETS["accurate"].grip, rtol=1e-6)
