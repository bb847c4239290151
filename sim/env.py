"""Gymnasium environments for path tracking and crossing courses, with one robot or N robots in a
batch.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from sim.common.settings import from_options
from sim.learning.environment import TaskEnv, TaskVectorEnv
from sim.path_tracking.config import EnvConfig
from sim.path_tracking.randomization import Randomization
from sim.path_tracking.renderer import PathRenderer
from sim.path_tracking.tracking import PathTracking
from sim.traverse.config import TraverseConfig
from sim.traverse.renderer import CourseRenderer
from sim.traverse.task import Crossing
from trackslip.errors import require


class _Tracking:
    configuration = EnvConfig
    kind = PathTracking
    drawing = PathRenderer
    task: PathTracking

    def set_randomization(
        self, randomization: Randomization | Mapping[str, Any] | str | None
    ) -> None:
        """Set how later episodes vary, like the option `randomization`; raises InvalidValueError
        for invalid values.
        """
        options = {f.name: getattr(self.task.config, f.name) for f in fields(EnvConfig)}
        config = from_options(EnvConfig, options | {"randomization": randomization})
        allowed = "None in an environment that was made without ground that shears"
        require(not config.shears or self.task.config.shears, "shear", config.drawn.shear, allowed)
        self.task.config = config


class _Traversing:
    configuration = TraverseConfig
    kind = Crossing
    drawing = CourseRenderer
    task: Crossing

    def set_difficulty(self, low: float, high: float) -> None:
        """Set the range, within 0 to 1, for the difficulty of the courses in later episodes."""
        self.task.set_difficulty(low, high)


class PathTrackingEnv(_Tracking, TaskEnv):
    """trackslip/PathTracking-v0: a tracked robot that must follow a reference trajectory.

    Actions are float32 (2,) in [-1, 1], 20 per second: sprocket speeds or a twist, see
    `EnvConfig.action`. See `TrackingLayout` for the observations and `TrackingReward` for the
    reward. An episode terminates if the robot is farther than `off_path` from the reference or tips
    over, and is truncated at the end of the reference.
    """


class PathTrackingVectorEnv(_Tracking, TaskVectorEnv):
    """N robots, each with its own ground and reference; each row behaves like a
    `PathTrackingEnv`.
    """


class TraverseEnv(_Traversing, TaskEnv):
    """trackslip/Traverse-v0: a tracked robot that must cross a course.

    Actions are float32 in [-1, 1], by default 10 per second: left and right belt speeds, and
    flipper angles, see `TraverseConfig.action` and `flippers`. See `traverse.config` for the
    observations and `CrossingReward` for the reward. An episode terminates if the robot has crossed
    the course, tips over, falls off, gets stuck or explodes, and is truncated at its time limit.
    """


class TraverseVectorEnv(_Traversing, TaskVectorEnv):
    """N robots, each on its own course; each row behaves like a `TraverseEnv`."""
