"""What classes and functions of `sim` refuse: one line that names the field, its value and what is allowed."""

import re
from functools import partial

import gymnasium as gym
import numpy as np
import pytest

from sim.drive.drive import Drive
from sim.drive.motor import Motor
from sim.env import PathTrackingEnv, PathTrackingVectorEnv
from sim.ground.ground import Change, Ground, Patch
from sim.path_tracking.config import Reward
from sim.path_tracking.randomization import Randomization
from sim.robot.named import load_tracked
from sim.robot.parameters import RobotParameters
from sim.scanner.obstacles import Post, Walker, Wall
from sim.scanner.scanner import LaserScanner
from sim.terrain import Beams, Blocks, Course, Flat, HeightField, Ramp, Rough, Stairs, Step
from sim.tracks.hull import Hull
from sim.traverse.courses import draw_course
from sim.traverse.world import Traverse
from sim.wander.commands import Driver, track_commands
from sim.wander.motion import LawMotion
from sim.wander.pose_source import PoseSource
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.laws.constant import NoSlip

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
    # drives
    (Drive, {"delay": -0.1}, "delay = -0.1: must be a finite number >= 0"),
    (Drive, {"delay": 1.1}, "delay = 1.1: must be at most 1 s"),
    (Drive, {"droop": NAN}, "droop = nan: must be a finite number >= 0"),
    (Drive, {"droop": 1.5}, "droop = 1.5: must be at most 1 rad/s per N m"),
    (Motor, {"gear": 1e-300}, "gear = 1e-300: must be at least 1e-12"),
    (Motor, {"friction": 40.0}, "friction = 40.0: must be less than gear * stall_torque = 30 N m"),
    # grounds
    (Ground, {"along": -0.1}, "along = -0.1: must be a finite number > 0"),
    (Ground, {"patches": (PATCH(),) * 10_001}, "number of patches = 10001: must be at most 10000"),
    (CHANGE, {"shear": 0.21}, "shear = 0.21: must be at most 0.2 m"),
    # robots
    (RobotParameters, {"half_gauge": 1e-6}, "half_gauge = 1e-06: must be at least 0.001 m"),
    (RobotParameters, {"half_gauge": 0.01}, "com_height = 0.12: must be at most 0.0125 m"),
    (RobotParameters, {"com_x": 0.0566}, "com_x = 0.0566: must be between -0.05525 and 0.05525 m"),
    (RobotParameters, {"com_y": NAN}, "com_y = nan: must be a finite number"),
    (RobotParameters, {"com_x": "a"}, "com_x = 'a': must be a finite number"),
    (RobotParameters, {"radius_error": None}, "radius_error = None: must be from -0.5 to 0.5"),
    (RobotParameters, {"com_x": 0.04, "com_y": 0.1}, "com_x, com_y = (0.04, 0.1): must be closer to the centre"),
    # scanners
    (LaserScanner, {"dropout": 1.0}, "dropout = 1.0: must be at least 0 and less than 1"),
    (LaserScanner, {"dropout": "a"}, "dropout = 'a': must be a finite number"),
    (LaserScanner, {"field_of_view": 7.0}, "field_of_view = 7.0: must be greater than the resolution"),
    (LaserScanner, {"quantisation": 1e-320}, "quantisation = 1e-320: must be 0, or at least 1e-06 m"),
    (LaserScanner, {"scan_duration": 0.06}, "scan_duration = 0.06: must be at most 0.05 s, the time between scans"),
    # obstacles
    (partial(Post, NAN), {"y": 0.0}, "x = nan: must be a finite number"),
    (partial(Wall, 0.0, 1.0, 0.0), {"y1": 1.0}, "must be another place than x0, y0"),
    (partial(Walker, 0.0, 0.0, INF), {"vy": 0.0}, "vx = inf: must be from -20 to 20 m/s"),
    # hulls of tracks
    (WHEELS, {"wheels": [(0.0, 0.1, 0.1)]}, "hull = [[0.0, 0.1, 0.1]]: must be from 2 to 100 wheels"),
    (WHEELS, {"wheels": [(0.01 * k, 0.1, 0.1) for k in range(101)]}, "must be from 2 to 100 wheels"),
    (WHEELS, {"wheels": [("a", 0.1, 0.1), (0.2, 0.1, 0.1)]}, "must be wheels of three numbers each"),
    (WHEELS, {"wheels": [(0.0, 0.1, 0.1), (0.3, 0.1, -0.1)]}, "must be finite, with radii of at least"),
    (WHEELS, {"wheels": [(0.0, 0.1, 0.1), (0.01, 0.1, 0.05)]}, "two wheels or more that don't lie inside one another"),
    # terrain
    (Flat, {"length": NAN}, "length = nan: must be from 0.001 to 200 m"),
    (Ramp, {"angle": 1.5}, "angle = 1.5: must be from -1.2 to 1.2 rad (69 degrees)"),
    (BLOCKS, {"blocks": ()}, "blocks = '0 blocks': must be 1 to 500"),
    (BLOCKS, {"blocks": ((0.5, 0.0),)}, "blocks = (0.5, 0.0): must be x, y, length, width, height and yaw"),
    (BLOCKS, {"blocks": ((2.0, 0.0, 0.1, 0.1, 0.1, 0.0),)}, "x of a block = 2.0: must be from 0 to 1 m"),
    (BLOCKS, {"blocks": ((0.5, 0.0, 0.1, 0.1, NAN, 0.0),)}, "height of a block = nan: must be from 0.0001 to 10 m"),
    (Step, {"height": 0.0}, "height = 0.0: must be from 0.0001 to 10 m, or its negative to go down"),
    (Stairs, {"rise": "a"}, "rise = 'a': must be a finite number"),
    (Ramp, {"angle": "a"}, "angle = 'a': must be from -1.2 to 1.2 rad"),
    (Beams, {"size": 0.5, "spacing": 0.4}, "spacing = 0.4: must be greater than the beams' size, 0.5 m"),
    (Rough, {"length": 1.0, "blend": 0.6}, "blend = 0.6: must be from 0 to 0.5 m, at most half of the length"),
    (HeightField, {"heights": [[0, 1], [2]]}, "heights = [[0, 1], [2]]: must be rows of equal lengths"),
    (HeightField, {"heights": np.full((3, 3), NAN)}, "heights = [nan]: must be finite numbers"),
    (HeightField, {"heights": np.eye(2) * 1e9}, "range of heights = 1000000000.0: must be at most 200 m"),
    (Course, {"pieces": (3,)}, "pieces = 3: must be pieces of terrain"),
    (Course, {"pieces": (Flat(),), "friction": 11.0}, "friction = 11.0: must be at most 10"),
    (
        Course,
        {"pieces": (Rough(100.0, cell=0.01),)},
        "cells along a side of rough ground = 10001",
    ),
    (
        Course,
        {"pieces": (Rough(15.0, cell=0.01),), "width": 15.0},
        "samples of rough ground = 2253001",
    ),
    (Course, {"pieces": (Flat(200.0),) * 6}, "length of the course = 1204.0: must be at most 1000 m"),
    (Course, {"pieces": (Stairs(0.001, 0.1, 500),) * 5}, "solids of the course = 2001: must be at most 2000"),
    # worlds and runs over courses
    (WORLD, {"courses": LEVEL, "period": 0.03}, "period = 0.03: must be a multiple of sample, 0.02 s"),
    (WORLD, {"courses": LEVEL, "sample": 0.003}, "sample = 0.003: must be a multiple of the physics step"),
    (COURSE, {"difficulty": 1.5}, "difficulty = 1.5: must be from 0 to 1"),
    # environments
    (PathTrackingEnv, {"action": "torque"}, "action = 'torque': must be one of sprockets, twist"),
    (PathTrackingEnv, {"reference": ()}, "reference = (): must be a name, or a tuple of names"),
    (PathTrackingEnv, {"action": "twist", "compensation": "magic"}, "compensation = 'magic': must be one of none,"),
    (PathTrackingEnv, {"previews": -1}, "previews = -1: must be a whole number from 0 to 100"),
    (PathTrackingEnv, {"preview_spacing": 0.12}, "preview_spacing = 0.12: must be a multiple of 0.05 s"),
    (PathTrackingEnv, {"randomization": Randomization(start_distance=(0.0, 0.6))}, "start_distance = (0.0, 0.6)"),
    (PathTrackingEnv, {"randomization": Randomization(com_x=(-0.1, 0.1))}, "com_x = -0.1: must be between"),
    (PathTrackingEnv, {"render_mode": "ascii"}, "render_mode = 'ascii'"),
    (PathTrackingVectorEnv, {"render_mode": "human"}, "render_mode = 'human'"),
    (PathTrackingVectorEnv, {"max_episode_steps": 0}, "max_episode_steps = 0: must be a whole number >= 1"),
    (PathTrackingVectorEnv, {"threads": -1}, "threads = -1: must be a whole number from 0 to 1024"),
    (PathTrackingEnv, {"robot": 3}, "robot = 3: must be a text or a RobotParameters"),
    (PathTrackingEnv, {"randomization": 3}, "randomization = 3: must be a Randomization or a text or None"),
    (PathTrackingEnv, {"reference": None}, "reference = None: must be a text or a tuple"),
    (PathTrackingEnv, {"twist_scale": ("a", 1.0)}, "twist_scale = 'a': must be a finite number > 0"),
    (TRAVERSE, {"period": "a"}, "period = 'a': must be a number"),
    (PathTrackingEnv, {"compensation": "icr_radius"}, "compensation = 'icr_radius': must be \"none\" unless action is"),
    (PathTrackingEnv, {"off_path": 1e-308}, "off_path = 1e-308: must be at least 0.001 m"),
    (PathTrackingEnv, {"preview_spacing": 1e308}, "preview_spacing = 1e+308: must be at most 20 s"),
    (Reward, {"weight_alive": 1e308}, "weight_alive = 1e+308: must be at most 1e+06"),
    (TRAVERSE, {"flipper_authority": 1e9}, "flipper_authority = 1000000000.0: must be at most 3.14159 rad"),
    (TRAVERSE, {"difficulty": ("x", "y")}, "difficulty = ('x', 'y'): must be two ascending numbers from 0 to 1"),
    (TRAVERSE, {"autoreset_mode": 3}, "autoreset_mode = 3: must be one of NextStep, SameStep, Disabled"),
    (TRAVERSE, {"limits": 3}, "limits = 3: must be a Limits"),
    (TRAVERSE, {"kinds": 3}, "kinds = 3: must be a tuple"),
    (Randomization, {"slope": (0.2, 0.1)}, "slope = (0.2, 0.1): must be two ascending numbers"),
    (Randomization, {"patches": (0, 1.5)}, "patches = (0, 1.5): must be two integers"),
    (Reward, {"position_scale": 0.0}, "position_scale = 0.0: must be a finite number > 0"),
    (TRAVERSE, {"course": "moon"}, "course = 'moon'"),
    (TRAVERSE, {"kinds": ("wall",)}, "kinds = 'wall'"),
    (TRAVERSE, {"period": 0.03}, "period = 0.03: must be a multiple of 0.02 s"),
    # teleoperated drives
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
