import mujoco
import numpy as np
import pytest
from mujoco import batch

from sim.tracks import Belts, Track, add_tracks
from trackslip.skid_theory import line_contact, steady_twist
from trackslip.skid_theory.contact import ground_wrench

G = 9.81
SLOPE = np.radians(15.0)
RADIUS = 0.08  # of the sprocket of a robot of size 1 [m]


def robot(mass=25.0, preset="accurate", size=1.0, slope=0.0):
    """Model, data and belts of a box with tracks on a slope uphill along x."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [-G * np.sin(slope), 0, -G * np.cos(slope)]
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50, 50, 0.1])
    body = spec.worldbody.add_body(name="robot")
    body.add_freejoint()
    x, y, z, up = np.array([0.22, 0.16, 0.05, 0.12]) * size
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[x, y, z],
        pos=[0, 0, up],
        mass=mass,
        contype=0,
        conaffinity=0,
    )
    hull = np.array([(-0.25, 0.08, 0.08), (0.25, 0.08, 0.08)]) * size
    track = Track(half_gauge=0.2 * size, hull=hull, preset=preset)
    add_tracks(spec, "robot", track, terrain="ground")
    model = spec.compile()
    return model, mujoco.MjData(model), Belts(model)


def step(model, data, belts, time):
    for _ in range(round(time / model.opt.timestep)):
        belts.step(data)


@pytest.mark.parametrize(
    ("preset", "mass", "size", "share"),
    [
        pytest.param("fast", 25.0, 1.0, 0.0, id="no inertia"),
        pytest.param("accurate", 1.0, 0.4, 1e-4, id="small"),
        pytest.param("fast", 5000.0, 6.0, 0.3, id="large"),
    ],
)
def test_a_robot_on_a_slope_accelerates_by_what_torque_is_left(preset, mass, size, share):
    """By 1 % of its weight downhill, uphill or downwards; the belts' inertia J / r^2 is a share of
    its mass.
    """
    model, data, belts = robot(mass, preset, size, SLOPE)
    step(model, data, belts, 0.3)
    radius = RADIUS * size
    inertia = share * mass * radius**2 / 2
    downhill = G * np.sin(SLOPE)
    for torque in (0.99, 1.01):
        limit = torque * mass * downhill * radius / 2
        belts.set([0.2, 0.2], torque_limit=limit, inertia=inertia)
        before = data.qvel[0]
        step(model, data, belts, 0.3)
        expected = 0.3 * (torque - 1) * downhill / (1 + share)
        assert data.qvel[0] - before == pytest.approx(expected, rel=0.03)
        np.testing.assert_allclose(belts.motors().torque, limit, rtol=1e-6)


@pytest.mark.parametrize(("preset", "share"), [("accurate", 0.02), ("fast", 0.5)])
def test_impulse_and_energy_are_balanced(preset, share):
    model, data, belts = robot(preset=preset)
    step(model, data, belts, 0.5)
    # of each belt
    mass = share * 25.0
    force = 0.15 * 25.0 * G
    belts.set([5.0, 5.0], torque_limit=force * RADIUS, inertia=mass * RADIUS**2)
    impulse = np.zeros(2)
    work = np.zeros(2)
    lost = 0.0
    h = model.opt.timestep
    for _ in range(200):
        before = belts.motors().speed
        belts.step(data)
        motor = belts.motors()
        reading = belts.read(data)
        traction = reading.traction
        impulse += (motor.torque / RADIUS - traction) * h
        work += traction * (before + motor.speed) / 2 * h
        lost += traction @ reading.sliding * h
    np.testing.assert_allclose(impulse, mass * motor.speed, rtol=0.01)
    np.testing.assert_allclose(motor.energy, work + mass * motor.speed**2 / 2, rtol=0.01)
    assert 25.0 * data.qvel[0] ** 2 / 2 + lost == pytest.approx(work.sum(), rel=0.01)


def test_turns_need_the_torque_of_theory_and_stop_without_it():
    speeds = np.array([-0.2, 0.2])
    contact = line_contact(0.2, 0.25, 0.7, 0.7)
    left = contact.y > 0
    # of the left track alone
    belts = np.where(left, *speeds)
    loads = contact.loads(np.zeros(2)) * left
    twist = steady_twist(speeds, contact)
    traction, *_ = ground_wrench(twist, belts, contact, loads, shear=1e-9)
    needed = 25.0 * G * abs(traction) * RADIUS
    turned = []
    for torque in (0.95, 1.05):
        model, data, belts = robot()
        step(model, data, belts, 0.2)
        belts.set(speeds, torque_limit=torque * needed)
        step(model, data, belts, 0.5)
        turned.append(data.qvel[5])
    too_weak, strong_enough = turned
    assert too_weak < 0.05
    assert strong_enough == pytest.approx(twist[2], rel=0.03)


@pytest.mark.parametrize(("limit", "within"), [(None, 0.0), (1e9, 1e-9)])
def test_without_motors_a_step_is_the_engines(limit, within):
    model, data, belts = robot()
    other, there, same = robot()
    belts.set([0.2, 0.3], torque_limit=limit)
    same.set([0.2, 0.3])
    step(model, data, belts, 0.2)
    mujoco.mj_step(other, there, nstep=100)
    np.testing.assert_allclose(data.qvel, there.qvel, rtol=0, atol=within)
    np.testing.assert_allclose(belts.motors().speed, [0.2, 0.3], rtol=0, atol=within)


def test_a_row_of_a_batch_is_the_same_as_the_robot_alone():
    limits = np.array([[1.0, 2.0], [3.0, np.inf], [0.5, 0.5]])
    model, _, belts = robot(slope=0.1)
    robots = batch.Batch(model, 3, nthread=2)
    fleet = belts.bind_batch(robots)
    fleet.set(np.tile([0.3, 0.2], (3, 1)), torque_limit=limits, inertia=0.01)
    for _ in range(30):
        fleet.step()
    readings = fleet.read()
    for row, limit in enumerate(limits):
        model, data, alone = robot(slope=0.1)
        alone.set([0.3, 0.2], torque_limit=limit, inertia=0.01)
        step(model, data, alone, 30 * model.opt.timestep)
        assert (robots.qpos[row] == data.qpos).all()
        for name, value in vars(alone.motors()).items():
            assert (getattr(fleet.motors(), name)[row] == value).all()
        for name, value in vars(alone.read(data)).items():
            np.testing.assert_array_equal(getattr(readings, name)[row], value)
