"""What classes and functions of `sim` refuse: one line that names the field, its value and what is allowed."""

import re
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

from sim import Drive, LaserScanner, Randomization, RobotParameters, Traverse, load_tracked
from sim.drive.drive import Motor
from sim.env import PathTrackingEnv, PathTrackingVectorEnv
from sim.ground.ground import Change, Ground, Patch
from sim.path_tracking.config import TrackingReward
from sim.scanner.scanner import Post, Wall
from sim.terrain import Beams, Blocks, Course, Flat, HeightField, Ramp, Rough, Stairs
from sim.tracks.hull import Hull
from sim.traverse.courses import draw_course
from sim.wander.motion import Driver, LawMotion, track_commands
from sim.wander.pose_source import PoseSource
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.laws.base import NoSlip

NAN, INF = float("nan"), float("inf")
PATCH, CHANGE = partial(Patch, (0, 1), (0, 1), 1.0, 1.0), partial(Change, 0.0, 1.0, 1.0)
TRAVERSE = partial(gym.make_vec, "sim:trackslip/Traverse-v0", num_envs=1)
WORLD = partial(Traverse, load_tracked("box"))
LEVEL = [Course((Flat(4.0),))]
COURSE = partial(draw_course, np.random.default_rng(0))
COMMANDS = partial(track_commands, rate=50.0, driver=Driver(), rng=np.random.default_rng(0))
WHEELS = Hull.from_wheels
BLOCKS = partial(Blocks, length=1.0)

REFUSED = [
    (Drive, {"lag": -0.1}, "lag = -0.1: must be a finite number > 0"),
    (Motor, {"friction": 40.0}, "friction = 40.0: must be less than gear * stall_torque = 30 N m"),
    (Ground, {"along": -0.1}, "along = -0.1: must be a finite number > 0"),
    (Ground, {"patches": (PATCH(),) * 10_001}, "number of patches = 10001: must be at most 10000"),
    (CHANGE, {"shear": 0.21}, "shear = 0.21: must be at most 0.2 m"),
    (RobotParameters, {"half_gauge": 0.01}, "com_height = 0.12: must be at most 0.0125 m"),
    (RobotParameters, {"com_x": 0.0566}, "com_x = 0.0566: must be between -0.05525 and 0.05525 m"),
    (RobotParameters, {"radius_error": None}, "radius_error = None: must be from -0.5 to 0.5"),
    (RobotParameters, {"com_x": 0.04, "com_y": 0.1}, "com_x, com_y = (0.04, 0.1): must be closer to the centre"),
    (LaserScanner, {"dropout": 1.0}, "dropout = 1.0: must be at least 0 and less than 1"),
    (LaserScanner, {"field_of_view": 7.0}, "field_of_view = 7.0: must be greater than the resolution"),
    (LaserScanner, {"quantisation": 1e-320}, "quantisation = 1e-320: must be 0, or at least 1e-06 m"),
    (partial(Post, NAN), {"y": 0.0}, "x = nan: must be a finite number"),
    (partial(Wall, 0.0, 1.0, 0.0), {"y1": 1.0}, "must be another place than x0, y0"),
    (WHEELS, {"wheels": [(0.01 * k, 0.1, 0.1) for k in range(101)]}, "must be from 2 to 100 wheels"),
    (WHEELS, {"wheels": [(0.0, 0.1, 0.1), (0.01, 0.1, 0.05)]}, "two wheels or more that don't lie inside one another"),
    (WHEELS, {"wheels": [(0.0, 0.1, 0.1), (0.3, 0.1, -0.1)]}, "must be finite, with radii of at least"),
    (Flat, {"length": NAN}, "length = nan: must be from 0.001 to 200 m"),
    (Ramp, {"angle": 1.5}, "angle = 1.5: must be from -1.2 to 1.2 rad (69 degrees)"),
    (BLOCKS, {"blocks": ()}, "blocks = '0 blocks': must be 1 to 500"),
    (BLOCKS, {"blocks": ((0.5, 0.0, 0.1, 0.1, NAN, 0.0),)}, "height of a block = nan: must be from 0.0001 to 10 m"),
    (Stairs, {"rise": "a"}, "rise = 'a': must be a finite number"),
    (Beams, {"size": 0.5, "spacing": 0.4}, "spacing = 0.4: must be greater than the beams' size, 0.5 m"),
    (Rough, {"length": 1.0, "blend": 0.6}, "blend = 0.6: must be from 0 to 0.5 m, at most half of the length"),
    (HeightField, {"heights": [[0, 1], [2]]}, "heights = [[0, 1], [2]]: must be rows of equal lengths"),
    (Course, {"pieces": (3,)}, "pieces = 3: must be pieces of terrain"),
    (Course, {"pieces": (Rough(15.0, cell=0.01),), "width": 15.0}, "samples of rough ground = 2253001"),
    (Course, {"pieces": (Stairs(0.001, 0.1, 500),) * 5}, "solids of the course = 2001: must be at most 2000"),
    (WORLD, {"courses": LEVEL, "period": 0.03}, "period = 0.03: must be a multiple of sample, 0.02 s"),
    (WORLD, {"courses": LEVEL, "sample": 0.003}, "sample = 0.003: must be a multiple of the physics step"),
    (PathTrackingEnv, {"action": "torque"}, "action = 'torque': must be one of sprockets, twist"),
    (PathTrackingEnv, {"action": "twist", "compensation": "magic"}, "compensation = 'magic': must be one of none,"),
    (PathTrackingEnv, {"preview_spacing": 0.12}, "preview_spacing = 0.12: must be a multiple of 0.05 s"),
    (PathTrackingEnv, {"randomization": Randomization(start_distance=(0.0, 0.6))}, "start_distance = (0.0, 0.6)"),
    (PathTrackingVectorEnv, {"render_mode": "human"}, "render_mode = 'human'"),
    (PathTrackingVectorEnv, {"max_episode_steps": 0}, "max_episode_steps = 0: must be a whole number >= 1"),
    (TrackingReward, {"weight_alive": 1e308}, "weight_alive = 1e+308: must be at most 1e+06"),
    (TRAVERSE, {"start_offset": 2.0}, "start_offset = 2.0: must be at most 1 m, half the width of a course"),
    (TRAVERSE, {"autoreset_mode": 3}, "autoreset_mode = 3: must be one of NextStep, SameStep, Disabled"),
    (Randomization, {"slope": (0.2, 0.1)}, "slope = (0.2, 0.1): must be two ascending numbers"),
    (TRAVERSE, {"kinds": ("wall",)}, "kinds = 'wall'"),
    (TRAVERSE, {"period": 0.03}, "period = 0.03: must be a multiple of 0.02 s"),
    (COMMANDS, {"driving": "zigzag", "duration": 9.0}, "driving = 'zigzag': must be one of random, eights"),
    (COMMANDS, {"driving": "random", "duration": 0.01}, "duration = 0.01: must be at least a period of the encoders"),
    (partial(LawMotion, NoSlip(), RobotGeometry(0.168, 0.06)), {"lag": -0.1}, "lag = -0.1"),
    (PoseSource, {"outliers": 1.0}, "outliers = 1.0: must be at least 0 and less than 1"),
    (PoseSource, {"jitter": 0.011}, "jitter = 0.011: must be at most 0.01 s, 0.2 of a period"),
    (PoseSource, {"scale_error": -1.0}, "scale_error = -1.0: must be greater than -1"),
]


@pytest.mark.parametrize(("make", "arguments", "message"), REFUSED, ids=[message[:40] for _, _, message in REFUSED])
def test_one_line_names_field_value_and_what_is_allowed(make, arguments, message):
    with pytest.raises(InvalidValueError, match=re.escape(message)) as error:
        make(**arguments)
    assert "\n" not in str(error.value)
