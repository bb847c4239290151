import dataclasses
import re
import sys
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

from sim import (
    Drive,
    Fleet,
    LaserScanner,
    Pull,
    Randomization,
    RobotParameters,
    Traverse,
    load_robot,
    load_tracked,
)
from sim.calibration.calibration import calibrate
from sim.calibration.candidate import Candidate
from sim.calibration.targets import PublishedTurns
from sim.env import PathTrackingEnv
from sim.ground.ground import Change, Ground, Patch
from sim.motors.motor import Motor
from sim.robot.gear import FlipperMotor
from sim.robot.named import load_parameters
from sim.scanner.feed import ScannerFeed
from sim.scanner.scanner import Wall
from sim.terrain import Beams, Course, Flat, Ramp, Rough, Stairs
from sim.tracks import Track
from sim.tracks.hull import Hull
from sim.wander.pose_sensor import PoseSensor
from trackslip.errors import InvalidValueError

NAN = float("nan")
PATCH = partial(Patch, (0, 1), (0, 1), 1.0, 1.0)
CHANGE = partial(Change, 0.0, 1.0, 1.0)
TRAVERSE = partial(gym.make_vec, "sim:trackslip/Traverse-v0", num_envs=1)
WORLD = partial(Traverse, load_tracked("box"))
LEVEL = [Course((Flat(4.0),))]
WHEELS = Hull.from_wheels
FLEET = partial(Fleet, load_robot(), np.zeros((2, 3)))
CALIBRATE = partial(calibrate, PublishedTurns(), Candidate())
HUSKY = load_parameters("husky")[0]
ROVER = partial(
    RobotParameters,
    **{name: value for name, value in vars(HUSKY).items() if name != "contact_length"},
)

REFUSED = [
    (Motor, {"friction": 40.0}, "friction = 40.0: must be less than gear * stall_torque = 30 N m"),
    (Ground, {"patches": (PATCH(),) * 10_001}, "number of patches = 10001: must be at most 10000"),
    (CHANGE, {"shear": 0.21}, "shear = 0.21: must be at most 0.2 m"),
    (RobotParameters, {"com_x": 0.0566}, "com_x = 0.0566: must be between -0.05525 and 0.05525 m"),
    (
        RobotParameters,
        {"com_x": 0.04, "com_y": 0.1},
        "com_x, com_y = (0.04, 0.1): must be closer to the centre",
    ),
    (
        LaserScanner,
        {"field_of_view": 7.0},
        "field_of_view = 7.0: must be greater than the resolution",
    ),
    (partial(Wall, 0.0, 1.0, 0.0), {"y1": 1.0}, "must be another place than x0, y0"),
    (
        WHEELS,
        {"wheels": [(0.0, 0.1, 0.1), (0.01, 0.1, 0.05)]},
        "two wheels or more that don't lie inside one another",
    ),
    (Ramp, {"angle": 1.5}, "angle = 1.5: must be from -1.2 to 1.2 rad (69 degrees)"),
    (
        Beams,
        {"size": 0.5, "spacing": 0.4},
        "spacing = 0.4: must be greater than the beams' size, 0.5 m",
    ),
    (
        Rough,
        {"length": 1.0, "blend": 0.6},
        "blend = 0.6: must be from 0 to 0.5 m, at most half of the length",
    ),
    (
        Course,
        {"pieces": (Rough(15.0, cell=0.01),), "width": 15.0},
        "samples of rough ground = 2253001",
    ),
    (
        Course,
        {"pieces": (Stairs(0.001, 0.1, 500),) * 5},
        "solids of the course = 2001: must be at most 2000",
    ),
    (
        WORLD,
        {"courses": LEVEL, "period": 0.03},
        "period = 0.03: must be a multiple of sample, 0.02 s",
    ),
    (PathTrackingEnv, {"action": "spin"}, "action = 'spin': must be one of sprockets, twist"),
    (PathTrackingEnv, {"pose_source": "gps"}, "pose_source = 'gps': must be one of truth, noisy,"),
    (PathTrackingEnv, {"scanner": LaserScanner(rate=10.0)}, "scanner.rate = 10.0: must be 20 Hz"),
    (PathTrackingEnv, {"pull": Pull(160.0, 0.6)}, "tips over"),
    (
        PathTrackingEnv,
        {"laws": "/nowhere"},
        "laws = '/nowhere': must be None unless compensation names a law",
    ),
    (
        PathTrackingEnv,
        {"action": "twist", "compensation": "magic"},
        "compensation = 'magic': must be one of none,",
    ),
    (
        PathTrackingEnv,
        {"randomization": Randomization(start_distance=(0.0, 0.6))},
        "start_distance = (0.0, 0.6)",
    ),
    (TRAVERSE, {"action": "spin"}, "action = 'spin': must be one of "),
    (TRAVERSE, {"flippers": "one"}, "flippers = 'one': must be one of "),
    (
        TRAVERSE,
        {"start_offset": 2.0},
        "start_offset = 2.0: must be at most 1 m, half the width of a course",
    ),
    (Randomization, {"slope": (0.2, 0.1)}, "slope = (0.2, 0.1): must be two ascending numbers"),
    (PoseSensor, {"jitter": 0.011}, "jitter = 0.011: must be at most 0.01 s, 0.2 of a period"),
    (FLEET, {"ground": Ground(0.2, 0.2, slope=0.3)}, "slope"),
    (FLEET, {"drive": Drive(period=0.007)}, "drive.period"),
    (
        lambda noise: ScannerFeed(LaserScanner(), FLEET(), noise=noise),
        {"noise": -0.1},
        "noise = [-0.1, -0.1]: must be",
    ),
    (partial(Fleet, load_robot()), {"start": [[0.0, NAN, 0.0]]}, "start"),
    (
        ROVER,
        {"contact": "tracks"},
        'axles = (-0.256, 0.256): must be left out without contact = "wheels"',
    ),
    (ROVER, {"axles": ()}, "axles = []: must be 2 to 10 positions"),
    (
        ROVER,
        {"axles": (0.0, 0.5)},
        "axles = [0.0, 0.5]: must be positions ahead of the middle of all, whose mean is 0",
    ),
    (
        ROVER,
        {"axles": (-0.04, 0.04)},
        "patch_length = 0.1: must be less than the distance of the axles",
    ),
    (
        ROVER,
        {"contact_length": 0.5},
        "contact_length = 0.5: must be left out: the axles make it 0.612 m",
    ),
    (CALIBRATE, {"free": ("mass",)}, "free = 'mass': must be one of half_gauge"),
    (
        CALIBRATE,
        {"free": ("radius_error", "radius_left")},
        "either radius_error, of both sides, or radius_left",
    ),
]


@pytest.mark.parametrize(
    ("make", "arguments", "message"), REFUSED, ids=[message[:40] for _, _, message in REFUSED]
)
def test_one_line_names_field_value_and_what_is_allowed(make, arguments, message):
    with pytest.raises(InvalidValueError, match=re.escape(message)):
        make(**arguments)


def test_what_is_checked_when_it_is_made_stays_as_it_is():
    """Dataclasses of all modules imported here that check their fields are frozen."""
    modules = [
        module for name, module in sys.modules.items() if name.startswith(("sim.", "trackslip."))
    ]
    found = {
        kind
        for module in modules
        for kind in vars(module).values()
        if dataclasses.is_dataclass(kind) and hasattr(kind, "__post_init__")
    }
    assert {RobotParameters, Ground, Motor, FlipperMotor, Drive, Randomization, Track} <= found
    changeable = {kind for kind in found if not kind.__dataclass_params__.frozen}
    assert changeable == set()
