"""The vector environment trackslip/PathTracking-v0: path tracking of N robots in one batch."""

from __future__ import annotations

from typing import Any

from gymnasium.vector import AutoresetMode

from sim.path_tracking.config import PERIOD, EnvConfig
from sim.path_tracking.renderer import Renderer
from sim.path_tracking.tracking import PathTracking
from sim.task_env import metadata
from sim.task_options import from_options
from sim.task_vector_env import TaskVectorEnv


class PathTrackingVectorEnv(TaskVectorEnv):
    """N robots, each with its own ground and reference: `sim.env.PathTrackingEnv` in every row."""

    metadata = metadata(PERIOD)
    task: PathTracking

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        **options: Any,
    ) -> None:
        """Build the simulator of `num_envs` robots on `threads` worker threads, 0 for one per processor.

        `render_mode` is None or "rgb_array", `autoreset_mode` gymnasium's, `options` are the fields of `EnvConfig`.
        Raises InvalidValueError for options that are unknown or out of range.
        """

        def task() -> PathTracking:
            return PathTracking(from_options(EnvConfig, options), num_envs, threads)

        super().__init__(task, num_envs, render_mode, Renderer, autoreset_mode)
        self.tracking = self.task
