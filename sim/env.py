"""The gymnasium environment trackslip/PathTracking-v0: path tracking, with one robot and with N in one batch."""

from sim.path_tracking.config import PERIOD, EnvConfig
from sim.path_tracking.renderer import Renderer
from sim.path_tracking.tracking import PathTracking
from sim.task_env import TaskEnv, TaskKind, TaskVectorEnv, metadata

_KIND = TaskKind(EnvConfig, PathTracking, Renderer)


class PathTrackingEnv(TaskEnv):
    """A tracked robot that must follow a reference trajectory.

    Actions are float32 (2,) in [-1, 1], 20 per second: sprocket speeds or a twist, see `EnvConfig.action`. The
    observations are described in `path_tracking.observation`, the reward in `path_tracking.config.Reward`. An episode
    terminates when the robot is farther than `off_path` from the reference or tips over, and is truncated at the
    reference's end.
    """

    kind, metadata = _KIND, metadata(PERIOD)
    task: PathTracking


class PathTrackingVectorEnv(TaskVectorEnv):
    """N robots, each with its own ground and reference: `PathTrackingEnv` in every row."""

    kind, metadata = _KIND, metadata(PERIOD)
    task: PathTracking
