"""The gymnasium environment trackslip/PathTracking-v0: path tracking of one robot."""

from __future__ import annotations

from typing import Any

from sim.path_tracking.config import PERIOD, EnvConfig
from sim.path_tracking.renderer import Renderer
from sim.path_tracking.tracking import PathTracking
from sim.task_env import TaskEnv, metadata, require_render_mode
from sim.task_options import from_options


class PathTrackingEnv(TaskEnv):
    """A tracked robot that must follow a reference trajectory.

    Actions are float32 (2,) in [-1, 1], 20 per second: sprocket speeds or a twist, see `EnvConfig.action`. The
    observations are described in `path_tracking.observation`, the reward in `path_tracking.config.Reward`. An episode
    terminates when the robot is farther than `off_path` from the reference or tips over, and is truncated at the
    reference's end.
    """

    metadata = metadata(PERIOD)

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        """Build the simulator; `render_mode` is None, "rgb_array" or "human", `options` are the fields of `EnvConfig`.

        Raises InvalidValueError for options that are unknown or out of range.
        """
        require_render_mode(render_mode)
        self.tracking = PathTracking(from_options(EnvConfig, options), 1, threads=1)
        super().__init__(self.tracking, render_mode, lambda: Renderer(self.tracking))
