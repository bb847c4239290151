"""What classes and functions of `sim` refuse: one line that names the field, its value and what is allowed."""

import re
from functools import partial

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from sim.drive.drive import Drive
from sim.drive.motor import Motor
from sim.env import PathTrackingEnv, PathTrackingVectorEnv
from sim.ground.ground import Change, Ground, Patch
from sim.path_tracking.config import Reward
from sim.path_tracking.randomization import Randomization
from sim.robot.parameters import RobotParameters
from sim.robot.tracked import load_tracked
from sim.scanner.obstacles import Obstacles, Post, Walker, Wall
from sim.scanner.scanner import LaserScanner
from sim.terrain import Beams, Course, Flat, HeightField, Mesh, Pallets, Picture, Ramp, Rough, Stairs, Step
from sim.tracks.hull import Hull
from sim.traverse.courses import draw_course
from sim.traverse.outcome import Limits
from sim.traverse.world import Traverse
from sim.wander.commands import Driver, track_commands
from sim.wander.motion import LawMotion, SlipVariation
from sim.wander.pose_source import PoseSource
from trackslip.errors import InvalidValueError
from trackslip.kinematics import RobotGeometry
from trackslip.slip.constant import NoSlip

NAN, INF = float("nan"), float("inf")
PATCH, CHANGE = partial(Patch, (0, 1), (0, 1), 1.0, 1.0), partial(Change, 0.0, 1.0, 1.0)
TRAVERSE = partial(gym.make_vec, "sim:trackslip/Traverse-v0", num_envs=1)
WORLD = partial(Traverse, load_tracked("box"))
LEVEL = [Course((Flat(4.0),))]
COURSE = partial(draw_course, np.random.default_rng(0))
COMMANDS = partial(track_commands, rate=50.0, driver=Driver(), rng=np.random.default_rng(0))
WHEELS = Hull.from_wheels

REFUSED = [
    # drives
    (Drive, {"lag": -1}, "lag = -1: must be a finite number > 0"),
    (Drive, {"torque_limit": 0.2}, "torque_limit = 0.2: must be more than motor.friction = 0.3 N m"),
    (Motor, {"gear": 1e-300}, "gear = 1e-300: must be at least 1e-12"),
    (Motor, {"friction": 40.0}, "friction = 40.0: must be less than gear * stall_torque = 30 N m"),
    # grounds
    (Ground, {"along": -0.1}, "along = -0.1: must be a finite number > 0"),
    (Ground, {"shear": -0.001}, "shear = -0.001: must be"),
    (Ground, {"patches": (PATCH(),) * 10_001}, "number of patches = 10001: must be at most 10000"),
    (CHANGE, {"shear": 0.21}, "shear = 0.21: must be at most 0.2 m"),
    # robots
    (RobotParameters, {"half_gauge": 1e-6}, "half_gauge = 1e-06: must be at least 0.001 m"),
    (RobotParameters, {"mass": 1e4}, "mass = 10000.0: must be at most 1000 kg"),
    (RobotParameters, {"half_gauge": 0.01}, "com_height = 0.12: must be at most 0.0125 m"),
    (RobotParameters, {"com_x": 0.0566}, "com_x = 0.0566: must be between -0.05525 and 0.05525 m"),
    (RobotParameters, {"com_y": NAN}, "com_y = nan: must be between"),
    (RobotParameters, {"com_x": 0.04, "com_y": 0.1}, "com_x, com_y = (0.04, 0.1): must be closer to the centre"),
    (RobotParameters, {"radius_error": NAN}, "radius_error = nan: must be from -0.5 to 0.5"),
    # scanners
    (LaserScanner, {"rate": 0.0}, "rate = 0.0"),
    (LaserScanner, {"dropout": 1.0}, "dropout = 1.0: must be at least 0 and less than 1"),
    (LaserScanner, {"resolution": 4.0}, "field_of_view"),
    (LaserScanner, {"field_of_view": 7.0}, "field_of_view = 7.0: must be greater than the resolution"),
    (LaserScanner, {"quantisation": 1.0}, "quantisation = 1.0: must be at most 0.5 m"),
    (LaserScanner, {"quantisation": 1e-320}, "quantisation = 1e-320: must be 0, or at least 1e-06 m"),
    (LaserScanner, {"range_bias": NAN}, "range_bias = nan: must be from -0.5 to 0.5 m"),
    (LaserScanner, {"divergence": 0.2}, "divergence = 0.2: must be at most 0.1 rad"),
    (LaserScanner, {"scan_duration": 0.06}, "scan_duration = 0.06: must be at most 0.05 s, the time between scans"),
    # obstacles
    (partial(Post, NAN), {"y": 0.0}, "x = nan: must be a finite number"),
    (partial(Post, 0.0), {"y": 1e9}, "y = 1000000000.0: must be from -1000 to 1000 m"),
    (partial(Wall, 0.0, 1.0, 0.0), {"y1": 1.0}, "must be another place than x0, y0"),
    (partial(Walker, 0.0, 0.0, INF), {"vy": 0.0}, "vx = inf: must be from -20 to 20 m/s"),
    (partial(Walker, 0.0, 0.0, 0.0, 0.0), {"turns_after": 0.0}, "turns_after = 0.0: must be a number > 0"),
    (Obstacles, {"walkers": (Walker(0.0, 0.0, 0.0, 0.0),) * 101}, "number of walkers = 101: must be at most 100"),
    # hulls of tracks
    (WHEELS, {"wheels": [(0.0, 0.1, 0.1)]}, "hull = [[0.0, 0.1, 0.1]]: must be two wheels"),
    (WHEELS, {"wheels": [("a", 0.1, 0.1), (0.2, 0.1, 0.1)]}, "must be wheels of three numbers each"),
    (WHEELS, {"wheels": [(0.0, 0.1, 0.1), (0.3, 0.1, -0.1)]}, "must be finite, with radii of at least"),
    (WHEELS, {"wheels": [(0.0, 0.1, 0.1), (0.01, 0.1, 0.05)]}, "without a wheel inside its neighbour"),
    (WHEELS, {"wheels": [(0, 0, 0.05), (1, 1, 0.05), (1, 0, 0.05), (0, 1, 0.05)]}, "crosses nowhere"),
    # terrain
    (Flat, {"length": NAN}, "length = nan: must be from 0.001 to 200 m"),
    (Ramp, {"angle": 1.5}, "angle = 1.5: must be from -1.2 to 1.2 rad (69 degrees)"),
    (Step, {"height": 0.0}, "height = 0.0: must be from 0.0001 to 10 m, or its negative to go down"),
    (Stairs, {"number": 0}, "number = 0: must be a whole number from 1 to 500"),
    (Beams, {"size": 0.5, "spacing": 0.4}, "spacing = 0.4: must be greater than the beams' size, 0.5 m"),
    (Pallets, {"spacing": 0.5}, "spacing = 0.5: must be greater than the depth of a pallet, 0.8 m"),
    (Rough, {"cell": 0.0}, "cell = 0.0: must be from 0.005 to 4 m, at most the length"),
    (Rough, {"length": 1.0, "blend": 0.6}, "blend = 0.6: must be from 0 to 0.5 m, at most half of the length"),
    (HeightField, {"heights": [[0, 1], [2]]}, "heights = [[0, 1], [2]]: must be rows of equal lengths"),
    (HeightField, {"heights": np.zeros(4)}, "shape of heights = (4,): must be (rows, columns), at least (2, 2)"),
    (HeightField, {"heights": np.full((3, 3), NAN)}, "heights = [nan]: must be finite numbers"),
    (HeightField, {"heights": np.eye(2) * 1e9}, "range of heights = 1000000000.0: must be at most 200 m"),
    (Picture, {"file": "hills.jpg"}, "file = 'hills.jpg': must be a .png file"),
    (Mesh, {"file": "a.stp"}, "file = 'a.stp': must be a mesh: .obj, .stl, .msh"),
    (Mesh, {"file": "a.obj", "cell": 0.0}, "cell = 0.0: must be from 0.005 to 1 m"),
    (Course, {"pieces": ()}, "pieces = (): must be at least one piece"),
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
    (Course((Flat(),)).add_to, {"spec": mujoco.MjSpec(), "at": (INF, 0.0)}, "at = inf: must be a finite number"),
    # worlds and runs over courses
    (WORLD, {"courses": []}, "courses = []: must be at least one"),
    (WORLD, {"courses": LEVEL, "period": 0.03}, "period = 0.03: must be a multiple of sample, 0.02 s"),
    (WORLD, {"courses": LEVEL, "sample": 0.003}, "sample = 0.003: must be a multiple of the physics step"),
    (WORLD, {"courses": LEVEL, "size": 0}, "size = 0"),
    (Limits, {"lean": 4.0}, "lean = 4.0: must be less than pi"),
    (COURSE, {"difficulty": 1.5}, "difficulty = 1.5: must be from 0 to 1"),
    (COURSE, {"difficulty": 0.5, "obstacles": 3}, "obstacles = 3: must be 1 or 2"),
    (COURSE, {"difficulty": 0.5, "kinds": ()}, "kinds = (): must be some of ramp"),
    # environments
    (PathTrackingEnv, {"action": "torque"}, "action = 'torque': must be one of sprockets, twist"),
    (PathTrackingEnv, {"reference": "moon"}, "moon"),
    (PathTrackingEnv, {"reference": ()}, "reference = (): must be a name, or a tuple of names"),
    (PathTrackingEnv, {"action": "twist", "compensation": "magic"}, "compensation = 'magic': must be a slip law, or"),
    (PathTrackingEnv, {"previews": -1}, "previews = -1: must be a whole number from 0 to 100"),
    (PathTrackingEnv, {"preview_spacing": 0.12}, "preview_spacing = 0.12: must be a multiple of 0.05 s"),
    (PathTrackingEnv, {"randomization": "wild"}, "randomization = 'wild'"),
    (PathTrackingEnv, {"randomization": Randomization(start_distance=(0.0, 0.6))}, "start_distance = (0.0, 0.6)"),
    (PathTrackingEnv, {"randomization": Randomization(com_x=(-0.1, 0.1))}, "com_x = -0.1: must be between"),
    (PathTrackingEnv, {"twist_scale": (0.3, 0.0)}, "twist_scale = 0.0"),
    (PathTrackingEnv, {"speed": 1.0}, "option = 'speed': must be one of reference"),
    (PathTrackingEnv, {"render_mode": "ascii"}, "render_mode = 'ascii'"),
    (PathTrackingVectorEnv, {"num_envs": 0}, "num_envs = 0"),
    (PathTrackingVectorEnv, {"render_mode": "human"}, "render_mode = 'human'"),
    (Randomization, {"slope": (0.2, 0.1)}, "slope = (0.2, 0.1): must be two ascending numbers"),
    (Randomization, {"latency": (0, 3)}, "latency = (0, 3)"),
    (Randomization, {"patches": (0, 1.5)}, "patches = (0, 1.5): must be two integers"),
    (Reward, {"position_scale": 0.0}, "position_scale = 0.0: must be a finite number > 0"),
    (TRAVERSE, {"course": "moon"}, "course = 'moon'"),
    (TRAVERSE, {"course": ()}, "course = ()"),
    (TRAVERSE, {"difficulty": (0.5, 2.0)}, "difficulty = (0.5, 2.0): must be two ascending numbers"),
    (TRAVERSE, {"kinds": ("wall",)}, "kinds = 'wall'"),
    (TRAVERSE, {"flippers": "none"}, "flippers = 'none': must be one of each, pairs"),
    (TRAVERSE, {"period": 0.03}, "period = 0.03: must be a multiple of 0.02 s"),
    (TRAVERSE, {"robot": "wheeled"}, "robot = 'wheeled'"),
    # teleoperated drives
    (COMMANDS, {"driving": "zigzag", "duration": 9.0}, "driving = 'zigzag': must be one of random, eights"),
    (COMMANDS, {"driving": "random", "duration": 0.01}, "duration = 0.01: must be at least a period of the encoders"),
    (SlipVariation, {"turning": -1.0}, "turning = -1.0"),
    (partial(LawMotion, NoSlip(), RobotGeometry(0.168, 0.06)), {"lag": -0.1}, "lag = -0.1"),
    (PoseSource, {"outliers": 1.0}, "outliers = 1.0: must be at least 0 and less than 1"),
    (PoseSource, {"jitter": 0.011}, "jitter = 0.011: must be at most 0.01 s, 0.2 of a period"),
    (PoseSource, {"delay": INF}, "delay = inf: must be a finite number"),
    (PoseSource, {"scale_error": -1.0}, "scale_error = -1.0: must be greater than -1"),
]


@pytest.mark.parametrize(("make", "arguments", "message"), REFUSED, ids=[message[:40] for _, _, message in REFUSED])
def test_one_line_names_field_value_and_what_is_allowed(make, arguments, message):
    with pytest.raises(InvalidValueError, match=re.escape(message)) as error:
        make(**arguments)
    assert "\n" not in str(error.value)
