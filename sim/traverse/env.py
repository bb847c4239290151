"""The gymnasium environment trackslip/Traverse-v0: crossing courses, with one robot and with N in one batch."""

from __future__ import annotations

from typing import Any

from gymnasium.vector import AutoresetMode

from sim.task_env import TaskEnv, metadata, require_render_mode
from sim.task_options import from_options
from sim.task_vector_env import TaskVectorEnv
from sim.traverse.config import PERIOD, TraverseConfig
from sim.traverse.renderer import Renderer
from sim.traverse.task import Crossing


class TraverseEnv(TaskEnv):
    """A tracked robot that must cross a course.

    Actions are float32 in [-1, 1], by default 10 per second: the belts' speeds, left and right, and the flippers'
    angles, see `TraverseConfig.action` and `flippers`. The observations are described in `traverse.observation`, the
    reward in `traverse.config.Reward`. An episode terminates when the course is crossed, or the robot tips over, falls
    off, is stuck or explodes, and is truncated when its time is over.
    """

    metadata = metadata(PERIOD)
    task: Crossing

    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        """Build the simulator; `render_mode` is None, "rgb_array" or "human", `options` are those of `TraverseConfig`.

        Raises InvalidValueError for options that are unknown or out of range.
        """
        require_render_mode(render_mode)
        task = Crossing(from_options(TraverseConfig, options), 1, threads=1)
        super().__init__(task, render_mode, lambda: Renderer(task))

    def set_difficulty(self, low: float, high: float) -> None:
        """Set the range of the difficulty of later episodes; raises InvalidValueError outside of 0 to 1."""
        self.task.set_difficulty(low, high)


class TraverseVectorEnv(TaskVectorEnv):
    """N robots, each on its own course: `TraverseEnv` in every row."""

    metadata = metadata(PERIOD)
    task: Crossing

    def __init__(
        self,
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 0,
        **options: Any,
    ) -> None:
        """Build the simulator of `num_envs` robots on `threads` worker threads, 0 for one per processor.

        `render_mode` is None or "rgb_array", `autoreset_mode` gymnasium's, `options` are those of `TraverseConfig`.
        Raises InvalidValueError for options that are unknown or out of range.
        """

        def task() -> Crossing:
            return Crossing(from_options(TraverseConfig, options), num_envs, threads)

        super().__init__(task, num_envs, render_mode, Renderer, autoreset_mode)

    def set_difficulty(self, low: float, high: float) -> None:
        """Set the range of the difficulty of later episodes; raises InvalidValueError outside of 0 to 1."""
        self.task.set_difficulty(low, high)
