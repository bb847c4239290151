import re
from functools import partial

import numpy as np
import pytest

from trackslip.bags.choice import BagChoice
from trackslip.controllers.steering import Stanley
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.laws.base import NoSlip
from trackslip.laws.exponential import Exponential
from trackslip.laws.icr import ConstantIcr
from trackslip.laws.turn_loss import Centrifugal, TurnLoss
from trackslip.localization.scan import Plate
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.uncertainty import Gyro, LawErrors, SlipNoise
from trackslip.planning.information import PoseQuality
from trackslip.planning.limits import DriveLimits
from trackslip.planning.plan import plan_drive
from trackslip.skid_theory import Load, line_contact, steady_twist, wheel_contact
from trackslip.trajectory.path import MotionLimits
from trackslip.trajectory.segmented import circle
from trackslip.trajectory.waypoints import waypoints

NAN = float("nan")
ORIGIN = (0.0, 0.0, 0.0)
GEOMETRY = RobotGeometry(0.168, 0.06)
ICR = ConstantIcr(0.045, 0.168, 0.0066)
ODOMETRY = SlipOdometry(ICR, GEOMETRY)
OFFSET = LawErrors(("offset",), np.eye(1))
LEVEL = line_contact(0.168, 0.17, 0.7, 0.778)
HIGH = line_contact(0.168, 0.17, 0.7, 0.778, (0.0, 0.0, 0.12))
LIMITS = partial(DriveLimits, 0.3, 0.5)
PLAN = partial(plan_drive, GEOMETRY, poses=PoseQuality(10.0, 0.02, np.radians(1.0)))
ZIGZAG = [(100 * (-1) ** k, 0.1 * k) for k in range(10)]

REFUSED = [
    (lambda: RobotGeometry(0.0, 0.06), "half_gauge = 0.0: must be"),
    # laws
    (lambda: Exponential(0.07, 0.1, -0.15, -0.6), "beta_outer"),
    (lambda: ConstantIcr(-0.2, 0.168), "offset"),
    (lambda: TurnLoss(0.04, 0.168, 0.0, 1.0), "turn_loss"),
    (
        lambda: Centrifugal(0.04, 0.168, centrifugal_slip=-0.1),
        "centrifugal_slip = -0.1: must be finite and >= 0",
    ),
    (lambda: ConstantIcr(10**400, 0.168), "offset"),
    # theory
    (lambda: steady_twist([0.1, 0.1], LEVEL, load=Load(pull=0.8)), "load"),
    (lambda: steady_twist([0.5, 3.5], HIGH, 9.81), "surface_speeds"),
    (lambda: wheel_contact(0.168, (-0.2, 0.2), 0.0, 0.7, 0.8), "patch_length"),
    (lambda: line_contact(0.168, 0.17, 0.7, 0.8, centre_of_mass=(0.2, 0.0, 0.1)), "centre_of_mass"),
    # odometry and the filter
    (lambda: ODOMETRY.update([1.0, NAN], 0.1), "omega = nan: must be finite"),
    (lambda: ODOMETRY.update([1.0, 2.0, 3.0], 0.1), "omega = (3,): must be of shape (..., 2)"),
    (
        lambda: ODOMETRY.reset(ORIGIN, np.zeros((2, 3))),
        "covariance = (2, 3): must be of shape (..., 3, 3)",
    ),
    (
        lambda: ODOMETRY.path([0.0, 0.0], np.ones((2, 2))),
        "time = 0.0: must be finite, and ascending from row to row",
    ),
    (lambda: ODOMETRY.update([1.0, 1.0], 0.1, np.inf), "gyro = inf: must be finite, or NaN"),
    (lambda: SlipNoise(sideways=-0.1), "sideways = -0.1: must be a finite number >= 0"),
    (lambda: Gyro(noise=-0.1), "noise = -0.1: must be a finite number >= 0"),
    (lambda: Gyro(bias_error=NAN), "bias_error = nan: must be a finite number >= 0"),
    (lambda: Gyro(clock=np.inf), "clock = inf: must be a finite number"),
    (lambda: SlipNoise.of({"slip_turn": 0.1}), "noise = ['slip_turn']: must be a mapping with"),
    (
        lambda: LawErrors(("a", "b"), np.array([[1.0, 2.0], [2.0, 1.0]])),
        "covariance = [[1.0, 2.0], [2.0, 1.0]]: must be symmetric, with correlations from -1 to 1",
    ),
    (
        lambda: LawErrors(("a", "b"), np.array([[1.0, 0.5], [0.4, 1.0]])),
        "covariance = [[1.0, 0.5], [0.4, 1.0]]: must be symmetric",
    ),
    (
        lambda: LawErrors(("a", "b"), np.eye(3)),
        "covariance = (3, 3): must be of shape (2, 2), as there are 2 names",
    ),
    (
        lambda: LawErrors(("a", "b"), np.diag([1.0, -1.0])),
        "covariance = [[1.0, 0.0], [0.0, -1.0]]: must be finite, with variances >= 0",
    ),
    (lambda: LawErrors(("a",), np.array([[np.inf]])), "must be finite, with variances >= 0"),
    (lambda: Gyro(bias=NAN), "bias = nan: must be a finite number"),
    (lambda: Gyro(scale=np.inf), "scale = inf: must be a finite number"),
    (lambda: Gyro(scale_error=-0.1), "scale_error = -0.1: must be a finite number >= 0"),
    (lambda: SlipNoise(forward=-0.1), "forward = -0.1: must be a finite number >= 0"),
    (lambda: SlipNoise(turn=np.inf), "turn = inf: must be a finite number >= 0"),
    (
        partial(SlipOdometry(NoSlip(), GEOMETRY, None, OFFSET).update, [1.0, 2.0], 0.1),
        "names = 'offset'",
    ),
    # references
    (lambda: circle(0.0, 0.1, 10.0), "abs(radius) = 0.0: must be"),
    (lambda: MotionLimits(half_gauge=-0.1), "half_gauge = -0.1: must be a finite number >= 0"),
    (lambda: MotionLimits(speed=0.0009), "speed = 0.0009: must be at least 0.001 m/s"),
    (lambda: MotionLimits(yaw_rate=0.0), "yaw_rate = 0.0: must be a finite number > 0"),
    (
        lambda: MotionLimits(acceleration=0.9e-4),
        "acceleration = 9e-05: must be at least 0.0001 m/s^2",
    ),
    (lambda: MotionLimits(track_speed=1e-4), "track_speed = 0.0001: must be at least 0.001 m/s"),
    (lambda: waypoints([(0, 0), (1, 1)]), "number of waypoints = 2: must be from 3 to 10000"),
    (
        lambda: waypoints([(0, 0), (1, 0), (1, 0.0005), (2, 0)], tolerance=0.0),
        "point 3 = (1.0, 0.0005): must be at least 0.001 m from point 2, or equal to it",
    ),
    (lambda: waypoints([(0, 0), (1, 0), (0.5, 0)]), "path = 'turns back sharply at "),
    (
        lambda: waypoints([(0, 0), (1, 0.05), (0.5, 0)]),
        "must be large enough to drive at 0.001 m/s",
    ),
    (lambda: waypoints(ZIGZAG), "way through all points = "),
    (lambda: Stanley(steering_limit=np.pi / 2), "steering_limit = 1.57"),
    # plans
    (
        lambda: LIMITS((3.0, 3.0), 40.0, 1.5),
        "area = '3x3': must be more than twice the clearance, 1.5 m",
    ),
    (
        lambda: PLAN(LIMITS((3.0, 0.6), 40.0)),
        "area = '3x0.6': must be more than 0.672 m long and wide",
    ),
    # what is taken from bags
    (lambda: BagChoice(left=("a",)), "right = None: must be given where left is"),
    (
        lambda: BagChoice(left=("b",), right=("b",)),
        "right = 'b': must be the name of a joint that is not on the left",
    ),
    (lambda: BagChoice(poses="tf:map:map"), "poses = 'tf:map:map': must be tf:FRAME:FRAME"),
    (lambda: BagChoice(plate=Plate(), poses="/pose"), "poses = "),
]


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[message[:40] for _, message in REFUSED])
def test_one_line_names_field_value_and_what_is_allowed(make, message):
    with pytest.raises(InvalidValueError, match=re.escape(message)):
        make()
