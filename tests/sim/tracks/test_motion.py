from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from tracked import HALF_GAUGE, HALF_LENGTH, HULL, add_flipper, add_robot, built, plane, slab

from sim.tracks import PRESETS, Belts, Track, add_tracks, connect
from trackslip.skid_theory import Contact, line_contact, steady_twist


def driven(spec, speeds, time, preset="accurate", **options):
    model, data, belts = built(spec, preset, **options)
    belts.set(speeds)
    mujoco.mj_step(model, data, round(time / model.opt.timestep))
    return model, data, belts


def icr_half_width(speeds, yaw_rate):
    return (speeds[1] - speeds[0]) / (2 * yaw_rate)


SLOWLY = (0.04, 0.06)
ON_THE_SPOT = (-0.5, 0.5)
FORWARDS = 0.3 * HALF_LENGTH


@dataclass(frozen=True)
class Turn:
    """A steady turn and the largest relative error of the ICRs' distance from the tracks."""

    bound: float
    ground: Callable = slab
    preset: str = "accurate"
    speeds: tuple[float, float] = SLOWLY
    com_x: float = 0.0
    across: float = 0.7  # coefficient of friction


TURNS = {
    "weight ahead": Turn(0.025, plane, com_x=FORWARDS),
    "other friction across": Turn(0.01, plane, across=0.9),
    "on a slab": Turn(0.01),
    "on the spot on a slab": Turn(0.03, speeds=ON_THE_SPOT),
    "fast": Turn(0.015, preset="fast"),
    "fast on the spot": Turn(0.05, plane, "fast", ON_THE_SPOT),
}


@pytest.mark.parametrize("turn", TURNS.values(), ids=TURNS)
def test_turns_have_the_centres_of_rotation_of_theory(turn):
    spec = turn.ground()
    heading = 1.0
    add_robot(spec, turn.com_x).quat = [np.cos(heading / 2), 0, 0, np.sin(heading / 2)]
    friction = (0.7, turn.across)
    _, data, _ = driven(spec, turn.speeds, 1.5, turn.preset, friction=friction)
    contact = line_contact(HALF_GAUGE, HALF_LENGTH, *friction, (turn.com_x, 0.0, 0.12))
    _, _, yaw_rate = steady_twist(turn.speeds, contact)
    measured = icr_half_width(turn.speeds, data.qvel[5])
    expected = icr_half_width(turn.speeds, yaw_rate)
    assert measured - HALF_GAUGE == pytest.approx(expected - HALF_GAUGE, rel=turn.bound)


@pytest.mark.parametrize(("preset", "limbs"), [("accurate", 2), ("fast", 1)])
def test_tracks_on_hinged_limbs_turn_like_those_on_the_chassis(preset, limbs):
    spec = plane()
    body = add_robot(spec)
    half = HALF_LENGTH / limbs
    for sign, side in ((1, "left"), (-1, "right")):
        for k in range(limbs):
            x = (2 * k + 1) * half - HALF_LENGTH
            limb = add_flipper(spec, body, f"{side}{k}", x, sign * HALF_GAUGE)
            limb.ipos = [0, 0, 0]
            limb.joints[0].stiffness = [600, 0, 0]
            limb.joints[0].damping = [10, 0, 0]
            track = Track(
                half_gauge=0,
                side=side,
                hull=[(-half, 0, 0.08), (half, 0, 0.08)],
                load=0.5 / limbs,
                preset=preset,
                name=f"{side}{k}",
            )
            add_tracks(spec, limb, track)
    connect(spec)
    measured = turned(spec, np.repeat([0, 1], limbs))
    assert measured == pytest.approx(half_width_of_theory(HALF_LENGTH), rel=0.02)


def turned(spec, side, speeds=(0.04, 0.08)):
    """Half of the distance of the ICRs of a robot that turns steadily, the speeds of its belts by
    their side [m].
    """
    model = spec.compile()
    data = mujoco.MjData(model)
    Belts(model).set(np.array(speeds)[side])
    mujoco.mj_step(model, data, round(2.0 / model.opt.timestep))
    start = data.qpos[3:7].copy()
    mujoco.mj_step(model, data, round(2.0 / model.opt.timestep))
    angle = np.zeros(3)
    mujoco.mju_subQuat(angle, data.qpos[3:7], start)
    return icr_half_width(speeds, angle[2] / 2.0)


def half_width_of_theory(half_length, speeds=(0.04, 0.08)):
    contact = line_contact(HALF_GAUGE, half_length, 0.7, 0.7, (0.0, 0.0, 0.12))
    _, _, yaw_rate = steady_twist(speeds, contact)
    return icr_half_width(speeds, yaw_rate)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize(("excess", "climbs"), [(-0.1, True), (0.1, False)])
def test_the_steepest_slope_is_that_of_friction(preset, excess, climbs):
    spec = plane()
    add_robot(spec)
    slope = np.arctan(0.5) + np.radians(excess)
    spec.option.gravity = [-9.81 * np.sin(slope), 0, -9.81 * np.cos(slope)]
    _, data, _ = driven(spec, (0.1, 0.1), 2.0, preset, friction=(0.5, 0.5))
    assert bool(data.qvel[0] > 0) is climbs


@pytest.mark.parametrize("preset", PRESETS)
def test_a_parked_robot_creeps_at_the_rate_of_its_soft_grip(preset):
    spec = plane()
    add_robot(spec).ipos = [0, 0, 0.001]  # low, so that no point is unloaded and slides
    slope = np.radians(30.0)
    spec.option.gravity = [-9.81 * np.sin(slope), 0, -9.81 * np.cos(slope)]
    _, data, _ = driven(spec, (0.0, 0.0), 2.0, preset, friction=(0.8, 0.8))
    recipe = PRESETS[preset]
    theory = 9.81 * np.sin(slope) / (recipe.regularisation * 1e4 * recipe.grip)
    assert -data.qvel[0] == pytest.approx(theory, rel=0.01)
    assert theory < 0.5e-3


def test_a_belt_moves_relative_to_its_moving_flipper():
    """Every contact's sliding velocity is that of the body there, plus the belt's along the
    hull.
    """
    spec = slab()
    body = add_robot(spec)
    flipper = add_flipper(spec, body, "flipper", 0.25, 0.28)
    add_tracks(spec, body, Track(half_gauge=0.2, hull=HULL), terrain="ground")
    one_side = Track(half_gauge=0.0, side="left", hull=[(0, 0, 0.08), (0.25, 0, 0.05)])
    add_tracks(spec, flipper, one_side, terrain="ground")
    model = spec.compile()
    belts = Belts(model)
    data = mujoco.MjData(model)
    speeds = np.array([0.3, -0.2, 0.7])
    belts.set(speeds)
    generator = np.random.default_rng(0)
    seen = set()
    for _ in range(60):
        data.qpos[:3] = [0, 0, generator.uniform(-0.004, 0.0)]
        data.qpos[3:7] = generator.normal([1, 0, 0, 0], 0.01)
        data.qpos[7] = generator.uniform(-np.pi, np.pi)
        data.qvel[:] = generator.normal(size=model.nv)
        mujoco.mj_forward(model, data)
        for contact in data.contact:
            if contact.dim == 1:  # a core's, without friction
                continue
            # the slab is the first geom
            geom, sign = max((contact.geom[0], -1), (contact.geom[1], 1))
            track = model.geom_bodyid[geom]
            k = belts.bodies.tolist().index(track)
            centre = data.geom_xpos[geom]
            axis = data.xmat[track].reshape(3, 3)[:, 1]
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_SPHERE:
                out = np.cross(axis, contact.pos - centre)
                surface = out * speeds[k] / model.geom_size[geom, 0]
            else:
                surface = data.geom_xmat[geom].reshape(3, 3)[:, 2] * speeds[k]
            velocity = np.zeros(6)
            mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, track, velocity, 0)
            turning = np.cross(velocity[:3], contact.pos - data.xipos[track])
            moving = velocity[3:] + turning
            in_plane = contact.frame.reshape(3, 3)[1:]
            expected = sign * in_plane @ (moving + surface)
            row = contact.efc_address
            np.testing.assert_allclose(data.efc_vel[row + 1 : row + 3], expected, atol=1e-12)
            seen.add((k, int(model.geom_type[geom])))
    assert len(seen) == 6  # capsules and spheres of all three tracks


WIDTH = 0.12  # of the belts [m]
HEIGHT = 0.12  # of the centre of mass [m]


def even_pressure(along=200, across=12):
    """Contact at points spread evenly over both belts."""
    x = ((np.arange(along) + 0.5) / along - 0.5) * 2 * HALF_LENGTH
    y = ((np.arange(across) + 0.5) / across - 0.5) * WIDTH
    x = np.repeat(x, across)
    y = np.tile(y, along)
    both_y = np.concatenate([y + HALF_GAUGE, y - HALF_GAUGE])
    return Contact(np.tile(x, 2), both_y, 0.7, 1.0, (FORWARDS, 0.0, HEIGHT))


@pytest.mark.parametrize(
    ("preset", "speeds", "bound"), [("accurate", SLOWLY, 0.01), ("fast", ON_THE_SPOT, 0.03)]
)
def test_wide_belts_turn_like_an_even_pressure(preset, speeds, bound):
    spec = plane()
    add_robot(spec, FORWARDS)
    _, data, _ = driven(spec, speeds, 2.0, preset, width=WIDTH, friction=(0.7, 1.0))
    measured = icr_half_width(speeds, data.qvel[5])
    expected = icr_half_width(speeds, steady_twist(speeds, even_pressure(), 9.81)[2])
    assert measured == pytest.approx(expected, rel=bound)
    narrow = icr_half_width(speeds, steady_twist(speeds, even_pressure(across=1), 9.81)[2])
    assert expected > 1.02 * narrow  # the width shows


def tips(preset, slope, height):
    """True if a robot with wide belts that stands across a slope tips over."""
    spec = plane()
    body = add_robot(spec)
    body.ipos = [0, 0, height]
    model, data, belts = built(spec, preset, friction=(4.0, 4.0), width=WIDTH)
    belts.set([0.0, 0.0])
    for part in np.sin(np.linspace(0, np.pi / 2, 400)):  # tilted slowly, to the left
        angle = part * slope
        model.opt.gravity[:] = 9.81 * np.array([0, np.sin(angle), -np.cos(angle)])
        mujoco.mj_step(model, data, nstep=round(0.01 / model.opt.timestep))
    mujoco.mj_step(model, data, nstep=round(3.0 / model.opt.timestep))
    upright = data.xmat.reshape(-1, 3, 3)[1, 2, 2]
    return bool(upright < np.cos(np.radians(30)))


@pytest.mark.parametrize(
    ("preset", "height", "part"), [("accurate", 0.3, 0.97), ("fast", 0.12, 0.93)]
)
def test_a_robot_tips_over_the_edges_of_its_belts(preset, height, part):
    over = np.arctan((HALF_GAUGE + WIDTH / 2) / height)
    assert not tips(preset, part * over, height)
    assert tips(preset, 1.01 * over, height)


@pytest.mark.parametrize(("segments", "across", "inertia"), [(8, 0.7, 5.0), (40, 0.8, 0.5)])
def test_no_point_is_softer_than_the_engine_knows(segments, across, inertia):
    spec = plane()
    add_robot(spec).inertia = [inertia] * 3
    model, _, _ = built(spec, segments=segments, friction=(0.7, across), width=WIDTH)
    assert model.pair_solimp[:, :2].min() >= mujoco.mjMINIMP
    impedance = np.maximum(model.pair_solimp[:, 0], mujoco.mjMINIMP)
    grip = model.pair_solreffriction[:, 1] / impedance
    np.testing.assert_allclose(grip, -PRESETS["accurate"].grip, rtol=1e-6)
