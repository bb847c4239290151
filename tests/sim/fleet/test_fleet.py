import itertools

import numpy as np
import pytest
from results import assert_same
from scipy.spatial.transform import Rotation

from sim import Description, Drive, Fleet, LaserScanner, ScannerFeed, load_robot, open_loop
from sim.engine.simulations import States
from sim.fleet.fleet import RunSetup
from sim.ground.ground import Change, Ground, Patch
from sim.motors.motor import Motor, tireless
from sim.robot.named import load_parameters
from sim.robot.parameters import SINK, RobotParameters
from sim.robot.robot import compiled
from trackslip.errors import InvalidValueError, RunFailedError
from trackslip.kinematics import sprocket_speeds, track_speeds
from trackslip.localization.plate import PlateLocator
from trackslip.paper import COMMANDED_RADII, SPEEDS
from trackslip.skid_theory import line_contact, steady_twist

# the tightest, fastest run of the grid asks 0.334 m/s of the outer track
FAST = Drive(top_speed=0.4)


def grid_commands(robot, radii=COMMANDED_RADII, speeds=SPEEDS):
    """Sprocket speeds (n, 2) for every radius and speed, without slip."""
    radius, speed = np.array(list(itertools.product(radii, speeds))).T
    twist = np.column_stack([speed, speed / radius])
    return sprocket_speeds(twist, 0.0, robot.geometry)


def drive(robot, omega, seconds=4.0, **options):
    fleet = Fleet(robot, np.zeros((len(omega), 3)), drive=options.pop("drive", FAST), **options)
    fleet.command(omega)
    fleet.advance(seconds)
    return fleet


SHARP = np.array([[-2.0, 2.0], [3.0, 2.0], [-3.0, -2.0]])
"""On the spot, to the right and backwards [rad/s]."""


@pytest.mark.parametrize("ratio", [0.7, 1.4])
def test_turning_agrees_with_theory_over_the_grid(robot, ratio):
    omega = np.concatenate([grid_commands(robot), SHARP])
    fleet = drive(robot, omega, ground=Ground(0.7, 0.7 * ratio), radius_error=0.0067)
    surface = omega * robot.geometry.sprocket_radius * 1.0067
    half_gauge = robot.geometry.half_gauge
    half_length = robot.parameters.contact_length / 2
    theory = steady_twist(surface, line_contact(half_gauge, half_length, 0.7, 0.7 * ratio))
    twist = fleet.twist()
    spread = surface[:, 1] - surface[:, 0]
    np.testing.assert_allclose(spread / twist[:, 2], spread / theory[:, 2], rtol=0.01)  # 2 (b + D)
    np.testing.assert_allclose(twist[:, 0], theory[:, 0], rtol=0.01, atol=1e-4)
    slip = 1 - track_speeds(twist[:, [0, 2]], 0.168) / surface
    expected = 1 - track_speeds(theory[:, [0, 2]], 0.168) / surface
    np.testing.assert_allclose(slip, expected, atol=0.004)
    slow = np.abs(theory[:, 2]) < 0.2
    np.testing.assert_allclose(slip[slow], expected[slow], atol=0.001)


def test_headings_are_unwrapped(robot):
    fleet = Fleet(robot, [[0.0, 0.0, 7.0], [0.0, 0.0, -4.0]])
    fleet.command([[-4.0, 4.0], [4.0, -4.0]])
    fleet.advance(10.0)
    turned = fleet.pose()[:, 2] - [7.0, -4.0]
    steady_turn = (10.0 - 0.05) * fleet.twist()[0, 2]
    np.testing.assert_allclose(turned, [steady_turn, -steady_turn], rtol=0.01)
    assert turned[0] > 2 * np.pi


def test_a_robot_begun_anew_drives_as_a_new_fleet_does(robot):
    """Set down in another way, it stands a little differently; after a while little of that is
    left.
    """
    start = (0.5, 0.2, 0.3)
    ground = Ground(0.6, 0.8, slope=0.1, uphill=1.0)
    leaning = load_robot(parameters=RobotParameters(com_x=0.03, com_y=-0.02))
    new = Fleet(leaning, [start], ground, 0.02, Drive(lag=0.1))
    old = Fleet(robot, np.zeros((1, 3)))
    old.command([2.0, 3.0])
    old.advance(1.0)
    old.restart([0], [RunSetup(start, ground, 0.02, 0.1, (0.03, -0.02))])
    np.testing.assert_allclose(old.pose(), new.pose(), atol=1e-12)
    np.testing.assert_allclose(old.attitude(), new.attitude(), atol=5e-5)
    assert np.all(old.drive.encoder_angle() == 0)
    for fleet in (new, old):
        fleet.command([2.0, 3.0])
        fleet.advance(3.0)
    np.testing.assert_allclose(old.pose(), new.pose(), atol=1e-4)


def test_robots_begin_anew_in_any_order(robot):
    starts = [(0.5, 0.2, 0.3), (-1.0, 0.4, 2.0)]
    fleet = Fleet(robot, np.zeros((3, 3)))
    fleet.advance(0.1)
    fleet.restart([2, 0], [RunSetup(start, Ground()) for start in starts])
    np.testing.assert_allclose(fleet.pose()[[2, 0]], starts, atol=1e-6)


@pytest.mark.parametrize("duration", [-0.02, 0.005])
def test_only_whole_periods_can_be_simulated(robot, duration):
    fleet = Fleet(robot, np.zeros((1, 3)))
    with pytest.raises(InvalidValueError, match=r"0 or a multiple of the servo period, 0\.01 s"):
        fleet.advance(duration)


def slid(parameters, friction, twist):
    """Final pose (3,) and model of a robot that is launched at a twist (3,) on locked tracks or
    wheels.
    """
    ground = Ground(friction, friction)
    fleet = Fleet(compiled(parameters), np.zeros((1, 3)), ground, 0.0, tireless(2.0), 1)
    fleet.launch(twist)
    for _ in range(300):
        fleet.follow(np.zeros((1, 1, 2)))
    return fleet.pose()[0], fleet.robot


def sliding_distance(speed, deceleration, step=0.005, rate=100.0):
    """Way (or angle) of a slide to rest at a constant deceleration.

    The engine integrates with the speed at the end of a step; grip decays at a finite rate.
    """
    exact = speed**2 / 2 / deceleration
    of_steps = speed * step / 2
    of_grip = deceleration / rate * (1 / rate - step) / 2
    return exact - of_steps + of_grip


@pytest.mark.parametrize(
    ("name", "friction"), [("shipped", 0.1), ("shipped", 0.7), ("husky", 0.6), ("warthog", 0.1)]
)
@pytest.mark.parametrize("speed", [0.3, 1.5])
def test_locked_tracks_slide_as_far_as_coulomb_friction_allows(name, friction, speed):
    """When it slides, it also pitches on the springs under it, which sets back its pose on the
    ground.
    """
    parameters = load_parameters(name)[0]
    pose, robot = slid(parameters, friction, [speed, 0.0, 0.0])
    x, y = robot.contact_points.T
    pitch = friction * parameters.com_height * SINK / np.mean(x**2)
    expected = sliding_distance(speed, 9.81 * friction) - parameters.com_height * pitch
    harder = 5e-4 if name == "shipped" else 1e-4  # tracks that slide fast press harder at first
    assert pose[0] == pytest.approx(expected, abs=harder, rel=4e-3)
    np.testing.assert_allclose(pose[1:], 0.0, atol=1e-5)

    pose, _ = slid(parameters, friction, [0.0, 0.0, speed])
    chassis = robot.model.body("chassis")
    principal_axes = Rotation.from_quat(chassis.iquat, scalar_first=True).as_matrix()
    inertia = principal_axes[2] ** 2 @ chassis.inertia  # about the vertical
    moment = friction * robot.mass * 9.81 * np.hypot(x, y).mean()
    expected = sliding_distance(speed, moment / inertia)
    harder = 4e-4 if name == "shipped" else 1e-4
    assert pose[2] == pytest.approx(expected, abs=harder, rel=1e-3)
    np.testing.assert_allclose(pose[:2], 0.0, atol=1e-5)


PATCHED = Ground(
    patches=(Patch((0.02, 0.3), (0.0, 1.0), 0.2, 0.2),), changes=(Change(0.21, 0.4, 0.5),)
)
COULOMB = [Ground(), Ground(0.9, 1.1, slope=0.2, uphill=2.0), PATCHED, Ground(0.15, 0.15)]
SHEARING = [
    Ground(shear=0.005, slope=0.1, uphill=0.4),
    Ground(
        shear=0.01,
        patches=(Patch((0.1, 0.4), (-1, 1), 0.5, 0.6), Patch((0.3, 0.5), (-1, 1), 0.7, 0.8, 0.002)),
    ),
    Ground(shear=0.025, changes=(Change(0.2, 0.6, 0.7), Change(0.4, 0.5, 0.6, 0.001))),
    Ground(0.15, 0.15),
]


def known(fleet, rows=slice(None)):
    """All that is known of the robots in some rows."""
    drive = fleet.drive
    values = [drive.omega, drive.angle, drive.torque, drive.energy, drive.saturated_time]
    if fleet.shear is not None:
        values += [fleet.shear.displacement, fleet.shear.share]
    values += [fleet.pose(), fleet.twist(), fleet.attitude(), fleet.friction(), fleet.batch.state]
    return [np.array(each)[rows] for each in values]


@pytest.mark.parametrize("grounds", [COULOMB, SHEARING], ids=["Coulomb", "shear"])
def test_robots_drive_the_same_however_they_are_stepped(robot, grounds):
    """At any number of threads, in steps of any length, and alone; some motors are too weak."""
    commands = np.array([[2.0, 3.0], [3.0, -1.0], [3.0, 3.0], [0.5, 1.0]])
    start = np.array([[0.1 * k, 0.0, 3.0 + 0.2 * k] for k in range(4)])  # some turn through pi

    def driven(rows, threads, steps):
        weak = Drive(torque_limit=3.0)
        shears = grounds is SHEARING
        of_rows = [grounds[k] for k in rows]
        fleet = Fleet(robot, start[rows], of_rows, 0.01, weak, threads, shears=shears)
        for sign in (1.0, -0.7, 0.7):  # at last the belts are at their set points to the last bit
            fleet.command(sign * commands[rows])
            for step in steps:
                fleet.advance(step)
        return known(fleet)

    together = driven(range(4), 2, [0.15])
    assert together[4].max() > 0.05
    on_one_thread = driven(range(4), 1, [0.01] * 15)
    assert_same(together, on_one_thread)
    in_uneven_steps = driven(range(4), 2, [0.07, 0.01, 0.07])
    assert_same(together, in_uneven_steps)
    alone = driven([2], 1, [0.05] * 3)
    assert_same([values[2:3] for values in together], alone)


# yaw, then nose down, then leaning to the right
EULER = np.random.default_rng(0).uniform(-1.2, 1.2, (50, 3))
TURNED = Rotation.from_euler("ZYX", EULER)


def states(turned):
    """States at rest at the origin, turned."""
    quaternion = turned.as_quat(scalar_first=True)
    position = np.zeros((*quaternion.shape[:-1], 3))
    return States(np.concatenate([position, quaternion], axis=-1), np.zeros(6))


def test_attitude_is_that_of_the_rotation_left_up_leans_right():
    state = states(TURNED)
    np.testing.assert_allclose(state.rotation, TURNED.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(state.heading, EULER[:, 0], atol=1e-12)
    np.testing.assert_allclose(state.pitch, -EULER[:, 1], atol=1e-12)
    np.testing.assert_allclose(state.roll, EULER[:, 2], atol=1e-12)
    np.testing.assert_allclose(state.upright, TURNED.as_matrix()[:, 2, 2], atol=1e-12)
    left_up = Rotation.from_euler("x", 0.2)
    assert left_up.as_matrix()[2, 1] > 0
    assert states(left_up).roll == pytest.approx(0.2)


STRONG = Drive(top_speed=1.0, torque_limit=1e5, motor=Motor(stall_torque=1e4, no_load_speed=1e5))
POINTS = 10  # of contact under a track


def weight_offset(parameters):
    """Where the weight presses (x, y) [m], for the ground gives way by SINK and the robot leans to
    its heavier side.
    """
    height = parameters.com_height
    leaning_forwards = height * SINK / (parameters.contact_length**2 / 12)
    leaning_aside = height * SINK / parameters.half_gauge**2
    return parameters.com_x / (1 - leaning_forwards), parameters.com_y / (1 - leaning_aside)


@pytest.mark.filterwarnings("ignore::trackslip.errors.RobotWarning")
@pytest.mark.parametrize(
    "shape",
    [
        dict(half_gauge=5.0, contact_length=8.0, com_height=1.0, mass=900.0),
        dict(half_gauge=2.0),
        dict(contact_length=2.0),
        dict(half_gauge=0.1, contact_length=0.17, com_height=0.05, mass=0.01),
        dict(com_x=0.05, sprocket_radius=0.01),
        dict(com_x=-0.03, com_y=0.05, sprocket_radius=1.0),
    ],
)
def test_robots_of_any_shape_stand_and_turn_as_theory_says(shape):
    """Large ones would fly off and small ones topple if the recipe of the contacts didn't suit
    them.
    """
    parameters = RobotParameters(**shape)
    robot = load_robot(parameters=parameters)
    gauge = 2 * parameters.half_gauge
    assert robot.geometry.half_gauge == pytest.approx(parameters.half_gauge)
    assert robot.geometry.sprocket_radius == parameters.sprocket_radius
    assert robot.mass == pytest.approx(parameters.mass)
    surface = 0.1 + np.array([[-0.1, 0.1], [0.2, -0.2]]) * min(gauge, 0.4)
    fleet = Fleet(robot, np.zeros((2, 3)), Ground(0.6, 0.7), 0.0, STRONG)
    np.testing.assert_allclose(fleet.attitude()[:, 0], SINK, rtol=0.01)
    weight_x, weight_y = weight_offset(parameters)
    left = (1 + weight_y / parameters.half_gauge) / 2
    weight = parameters.mass * 9.81
    load = [left * weight, (1 - left) * weight]
    np.testing.assert_allclose(fleet.load(), [load, load], rtol=5e-3)
    fleet.command(surface / parameters.sprocket_radius)
    fleet.advance(4.0)
    # the contact points as they are, and the weight where it leans to
    centre = (weight_x, weight_y, parameters.com_height)
    half_length = parameters.contact_length / 2
    contact = line_contact(parameters.half_gauge, half_length, 0.6, 0.7, centre, POINTS)
    expected = steady_twist(surface, contact, 9.81)
    twist = fleet.twist()
    np.testing.assert_allclose(twist[:, 0], expected[:, 0], rtol=3e-3)
    np.testing.assert_allclose(twist[:, 2], expected[:, 2], rtol=3e-3, atol=1e-5)


@pytest.mark.parametrize("heading", [0.0, np.pi, 0.1])
def test_robots_do_not_park_where_they_would_tip_over(robot, heading):
    """Rough ground would hold it, but its weight, 12 cm high, is beyond its rear contact points,
    15.3 cm back.
    """
    tips = float(np.arctan(np.abs(robot.contact_points[:, 0]).max() / 0.12))
    start = [(0.0, 0.0, heading)]
    too_steep = Ground(8.0, 8.0, slope=1.15 * tips)
    steep = Ground(8.0, 8.0, slope=0.7 * tips)
    said = r"slope = 1\.\d+: must be less, to park .* the robot tips over"
    with pytest.raises(InvalidValueError, match=said):
        Fleet(robot, start, too_steep)
    said = r"radius_error = \[2.0\]: must be from -0.5 to 0.5"  # meant in percent
    with pytest.raises(InvalidValueError, match=said):
        Fleet(robot, start, steep, radius_error=2.0)
    Fleet(robot, start, steep)


def test_robots_do_not_park_where_one_track_slides(robot):
    """The mean of both sides' friction would hold it, but the pull of the good track turns it round
    the other.
    """
    patch = Patch((-np.inf, np.inf), (0.0, np.inf), 0.1, 0.1)
    ground = Ground(0.7, 0.7, slope=0.3, patches=(patch,))
    said = r"slope = 0\.3: must be less, to park .* the robot slides"
    with pytest.raises(InvalidValueError, match=said):
        Fleet(robot, np.zeros((1, 3)), ground)
    Fleet(robot, np.zeros((1, 3)), Ground(0.7, 0.7, slope=0.15, patches=(patch,)))


def test_a_run_that_tips_over_names_itself_and_keeps_its_rows(robot):
    fleet = Fleet(robot, np.zeros((2, 3)))
    feed = ScannerFeed(LaserScanner(), fleet)
    fleet.set_ground([Ground(), Ground(8.0, 8.0, slope=1.4)])
    names = [Description("level"), Description("steep")]
    said = r"^run 'steep': the robot tips over after \d\.\d+ s$"
    with pytest.raises(RunFailedError, match=said) as failure:
        open_loop(fleet, [1.0, 1.0], 4.0, feed, PlateLocator(robot.plate), names)
    *_, fallen, _ = str(failure.value).split()
    level, steep = failure.value.logs
    for log in (level, steep):
        assert log.time[-1] == pytest.approx(float(fallen) - feed.period)
        assert log.scans is not None
        assert len(log.scans.cluster.count) == len(log.time)
    assert level.is_valid.all()
    np.testing.assert_allclose(level.pose[:, :2], level.truth.pose[:, :2], atol=0.02)
