"""Fleets on MuJoCo Warp, beside fleets on MuJoCo. Warp runs on the processor, where compiling it takes a minute."""

import mujoco
import numpy as np
import pytest

from experiments.options.bench import BenchConfig
from experiments.speed.gpu import distance, measure_gpu
from sim.drive.pull import Pull
from sim.fleet import Fleet
from sim.ground.ground import Ground
from sim.robot.robot import CONTACT_WIDTH, load_robot
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import LaserScanner
from sim.seeds import generator
from sim.setting import Setting
from trackslip.errors import InvalidValueError, TrackslipError

pytest.importorskip("mujoco_warp", reason="MuJoCo Warp isn't installed")
pytestmark = pytest.mark.slow

BOTH = ("cpu", "warp-cpu")
FORCE = 0.25  # a thousandth of the robot's weight [N]


def test_the_paper_s_grid_ends_within_a_millimetre(robot):
    check = distance(robot, "warp-cpu")
    assert check.bound == 1e-3
    assert check.holds, check


WORLDS = {
    "flat": {},
    "weak motors on a slope": {"ground": Ground(slope=0.1, uphill=0.5)},
    "ground that shears": {"ground": Ground(shear=0.01)},
    "a load in tow": {"pull": Pull(force=20.0, height=0.2)},
}


@pytest.mark.parametrize("world", WORLDS.values(), ids=WORLDS)
def test_random_commands(robot, world):
    rng = generator(0, "commands")
    start = np.column_stack([np.zeros((4, 2)), np.linspace(0.0, 3.0, 4)])
    on_cpu, on_warp = (Fleet(robot, start, device=device, **world) for device in BOTH)
    for k in range(6):
        omega = rng.uniform(-5.0, 5.0, (4, 2))
        for fleet in (on_cpu, on_warp):
            fleet.command(omega)
            fleet.advance(0.5)
            if k == 2:  # its weight is on one side, so that constants of the model change, too
                setting = Setting((1.0, 2.0, 0.3), fleet.ground[1], 0.01, weight=(0.01, 0.02))
                fleet.restart([1], [setting])
        np.testing.assert_allclose(on_warp.pose(), on_cpu.pose(), rtol=0, atol=1e-5)
        np.testing.assert_allclose(on_warp.twist(), on_cpu.twist(), rtol=0, atol=1e-4)
    np.testing.assert_allclose(on_warp.plate, on_cpu.plate, rtol=0, atol=1e-5)
    np.testing.assert_allclose(on_warp.load(), on_cpu.load(), rtol=0, atol=FORCE)
    np.testing.assert_allclose(on_warp.traction(), on_cpu.traction(), rtol=0, atol=FORCE)
    np.testing.assert_allclose(
        on_warp.drive.torque, on_cpu.drive.torque, rtol=0, atol=FORCE * robot.geometry.sprocket_radius
    )


def test_contact_sensors_and_scans(robot):
    with_sensors = load_robot(contact_sensors=True)
    ranges, tracks, points = [], [], []
    for device in BOTH:
        fleet = Fleet(with_sensors, np.zeros((2, 3)), device=device)
        fleet.command([[3.0, 3.0], [2.0, 4.0]])
        fleet.advance(1.0)
        ranges.append(ScannerFeed(LaserScanner(), fleet, [generator(0, str(k)) for k in range(2)]).true_ranges())
        sensed = fleet.batch.bind("sensordata")
        tracks.append(sensed[:, :6].copy())
        points.append(sensed[:, 6:].reshape(-1, CONTACT_WIDTH // 3, 3).copy())  # force, position, velocity
    assert np.isfinite(ranges[0]).any()
    np.testing.assert_allclose(ranges[1], ranges[0], rtol=0, atol=1e-4)
    np.testing.assert_allclose(tracks[1], tracks[0], rtol=0, atol=FORCE)
    for k, close in enumerate((FORCE / 20, 1e-5, 1e-4)):
        np.testing.assert_allclose(points[1][:, k], points[0][:, k], rtol=0, atol=close)


def test_far_from_the_origin_a_robot_is_as_fast_as_there(robot):
    """In single precision a position 2 km away has steps of 0.1 mm, a tenth of what the robot moves in a step."""
    start = np.array([[0.0, 0.0, 0.4], [2000.0, -1000.0, 0.4]])
    fleet = Fleet(robot, start, device="warp-cpu")
    fleet.command([4.0, 4.5])
    fleet.advance(3.0)
    near, far = fleet.pose() - start
    np.testing.assert_allclose(far, near, rtol=0, atol=1e-4)
    assert np.hypot(*near[:2]) > 0.5


def test_the_same_arguments_give_the_same_bits(robot):
    def drive(rows):
        fleet = Fleet(robot, [[0.0, 0.0, 0.1 * k] for k in rows], device="warp-cpu")
        fleet.command([[3.0, 1.0 + k] for k in rows])
        fleet.advance(0.5)
        return fleet.batch.state.copy()

    np.testing.assert_array_equal(drive([0, 1, 2]), drive([0, 1, 2]))
    np.testing.assert_array_equal(drive([0, 1, 2])[1:2], drive([1]))


def test_only_the_robots_asked_for_are_stepped(robot):
    fleet = Fleet(robot, np.zeros((3, 3)), device="warp-cpu")
    before = fleet.batch.state.copy()
    out = np.empty((1, 2, fleet.robot.model.nsensordata))
    recorded = fleet.batch.rollout(2, record=("sensordata", "xmat"), ids=np.array([1]), out={"sensordata": out})
    assert recorded["sensordata"] is out
    assert recorded["xmat"].shape == (1, 2, robot.model.nbody, 9)
    np.testing.assert_array_equal(fleet.batch.state[[0, 2]], before[[0, 2]])
    assert fleet.batch.time[1] == 2 * robot.model.opt.timestep


def test_what_warp_can_t_do_is_refused(robot, monkeypatch):
    fleet = Fleet(robot, np.zeros((1, 3)), device="warp-cpu")
    with pytest.raises(InvalidValueError, match=r"field = 'opt\.iterations': must be a field that MuJoCo Warp has"):
        fleet.batch.expand("opt.iterations")
    monkeypatch.setattr("sim.warp.worlds._room", lambda model: (4, 12))
    with pytest.raises(TrackslipError, match="no room for all contacts of robot 0"):
        Fleet(robot, np.zeros((1, 3)), device="warp-cpu")
    other = load_robot()
    other.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    with pytest.raises(InvalidValueError, match=r"option\.integrator = 'RK4': must be Euler or implicitfast"):
        Fleet(other, np.zeros((1, 3)), device="warp-cpu")


def test_the_speed_is_measured(robot):
    labels = []
    config = BenchConfig(gpu=True, repeats=2)
    (speed,) = measure_gpu((4,), config, robot, labels.append, "warp-cpu")
    assert labels == ["4 robots"] * 3
    assert speed.n == 4
    assert speed.fleet_steps_per_s > 0
    assert speed.real_time_factor == pytest.approx(speed.fleet_steps_per_s * robot.model.opt.timestep)
