"""Tracks on bodies that don't move: belts that carry things."""

import mujoco
import numpy as np
import pytest
from mujoco import batch

from sim.tracks import Belts, Track, add_tracks, connect
from trackslip.errors import InvalidValueError

MASS = 8.0
RADIUS = 0.05
G = 9.81
BELT = Track(half_gauge=0.0, side="left", width=0.3, hull=[(-1.0, 0.0, RADIUS), (1.0, 0.0, RADIUS)])


def conveyor(slope=0.0, loads=("crate",)):
    """A conveyor that rises along x by a slope [rad], with a crate that lies on it."""
    turned = f"{np.cos(slope / 2)} 0 {-np.sin(slope / 2)} 0"
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><worldbody><geom name="floor" type="plane" size="5 5 .1"/>'
        f'<body name="bed" pos="0 0 1" quat="{turned}"/>'
        f'<body name="crate" pos="0 0 {1 + 0.151 / np.cos(slope)}" quat="{turned}"><freejoint/>'
        f'<geom name="crate" type="box" size=".1 .1 .1" mass="{MASS}"/></body>'
        "</worldbody></mujoco>"
    )
    add_tracks(spec, "bed", BELT)
    connect(spec, loads)
    return spec.compile()


def test_a_conveyor_carries_a_crate_at_its_speed():
    model = conveyor()
    data = mujoco.MjData(model)
    belts = Belts(model)
    belts.set([0.3])
    for _ in range(1000):
        belts.step(data)
    assert data.qvel[0] == pytest.approx(0.3, abs=1e-3)
    np.testing.assert_allclose(data.qpos[1:3], [0.0, 1.15], atol=2.5e-3)
    reading = belts.read(data)
    assert reading.load[0] == pytest.approx(MASS * G, rel=0.01)
    assert belts.motors().position[0] == pytest.approx(0.3 * data.time)
    # the crate lags by what it slid until it was as fast: v^2 / (2 mu g)
    slid = 0.3**2 / (2 * 0.7 * G)
    assert data.qpos[0] == pytest.approx(0.3 * data.time - slid, abs=2e-3)


@pytest.mark.parametrize("speed", [0.2, 0.0, -0.2])
def test_uphill_a_conveyors_motor_bears_the_crate(speed):
    slope = 0.2
    model = conveyor(slope)
    data = mujoco.MjData(model)
    belts = Belts(model)
    belts.set([speed], torque_limit=5.0, inertia=0.01)
    for _ in range(500):
        belts.step(data)
    motor = belts.motors()
    expected = [speed * np.cos(slope), speed * np.sin(slope)]
    np.testing.assert_allclose(data.qvel[[0, 2]], expected, atol=3e-3)
    assert motor.torque[0] == pytest.approx(RADIUS * MASS * G * np.sin(slope), rel=0.03)
    assert motor.position[0] == pytest.approx(speed * data.time, abs=0.01)


def test_too_weak_a_motor_lets_the_crate_roll_back():
    model = conveyor(0.2)
    data = mujoco.MjData(model)
    belts = Belts(model)
    needed = RADIUS * MASS * G * np.sin(0.2)
    belts.set([0.2], torque_limit=0.5 * needed, inertia=0.01)
    for _ in range(250):
        belts.step(data)
    motor = belts.motors()
    assert motor.speed[0] < -0.1
    assert motor.position[0] < 0.0
    assert motor.saturated_time[0] == pytest.approx(data.time, rel=0.05)


def test_belts_of_a_batch_have_positions_of_their_own():
    model = conveyor()
    simulations = batch.Batch(model, 3)
    belts = Belts(model).bind_batch(simulations)
    belts.set([[0.1], [-0.2], [0.3]])
    belts.run(200)
    belts.run(100, [2])
    times = np.array([200, 200, 300]) * model.opt.timestep
    np.testing.assert_allclose(belts.motors().position[:, 0], [0.1, -0.2, 0.3] * times)
    belts.begin([1])
    assert belts.motors().position[1, 0] == 0.0


def test_a_conveyor_that_carries_nothing_is_refused():
    with pytest.raises(InvalidValueError, match="on a body that moves, or connected with one"):
        Belts(conveyor(loads=("floor",)))
