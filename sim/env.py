"""Gymnasium environments for one robot and for N in a batch: trajectory tracking and crossing courses."""

from sim import path_tracking, traverse
from sim.path_tracking.config import EnvConfig
from sim.path_tracking.renderer import PathRenderer
from sim.path_tracking.tracking import PathTracking
from sim.task import TaskKind, metadata
from sim.task_env import TaskEnv, TaskVectorEnv
from sim.traverse.config import TraverseConfig
from sim.traverse.renderer import CourseRenderer
from sim.traverse.task import Crossing

_TRACKING = TaskKind(EnvConfig, PathTracking, PathRenderer)
_CROSSING = TaskKind(TraverseConfig, Crossing, CourseRenderer)


class PathTrackingEnv(TaskEnv):
    """trackslip/PathTracking-v0: a tracked robot that must follow a reference trajectory.

    Actions are float32 (2,) in [-1, 1], 20 per second: sprocket speeds or a twist, see `EnvConfig.action`. The
    observations are described in `path_tracking.observation`, the reward in `path_tracking.config.Reward`. An episode
    terminates when the robot is farther than `off_path` from the reference or tips over, and is truncated at the
    reference's end.
    """

    kind, metadata = _TRACKING, metadata(path_tracking.config.PERIOD)
    task: PathTracking


class PathTrackingVectorEnv(TaskVectorEnv):
    """N robots, each with its own ground and reference: `PathTrackingEnv` in every row."""

    kind, metadata = _TRACKING, metadata(path_tracking.config.PERIOD)
    task: PathTracking


class TraverseEnv(TaskEnv):
    """trackslip/Traverse-v0: a tracked robot that must cross a course.

    Actions are float32 in [-1, 1], by default 10 per second: the belts' speeds, left and right, and the flippers'
    angles, see `TraverseConfig.action` and `flippers`. The observations are described in `traverse.observation`, the
    reward in `traverse.config.Reward`. An episode terminates when the course is crossed, or the robot tips over, falls
    off, is stuck or explodes, and is truncated when its time is over.
    """

    kind, metadata = _CROSSING, metadata(traverse.config.PERIOD)
    task: Crossing


class TraverseVectorEnv(TaskVectorEnv):
    """N robots, each on its own course: `TraverseEnv` in every row."""

    kind, metadata = _CROSSING, metadata(traverse.config.PERIOD)
    task: Crossing
