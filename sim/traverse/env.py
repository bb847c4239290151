"""The gymnasium environment trackslip/Traverse-v0: crossing courses, with one robot and with N in one batch."""

from sim.task_env import TaskEnv, TaskKind, TaskVectorEnv, metadata
from sim.traverse.config import PERIOD, TraverseConfig
from sim.traverse.renderer import Renderer
from sim.traverse.task import Crossing

_KIND = TaskKind(TraverseConfig, Crossing, Renderer)


class TraverseEnv(TaskEnv):
    """A tracked robot that must cross a course.

    Actions are float32 in [-1, 1], by default 10 per second: the belts' speeds, left and right, and the flippers'
    angles, see `TraverseConfig.action` and `flippers`. The observations are described in `traverse.observation`, the
    reward in `traverse.config.Reward`. An episode terminates when the course is crossed, or the robot tips over, falls
    off, is stuck or explodes, and is truncated when its time is over.
    """

    kind, metadata = _KIND, metadata(PERIOD)
    task: Crossing

    def set_difficulty(self, low: float, high: float) -> None:
        """Set the range of the difficulty of later episodes; raises InvalidValueError outside of 0 to 1."""
        self.task.set_difficulty(low, high)


class TraverseVectorEnv(TaskVectorEnv):
    """N robots, each on its own course: `TraverseEnv` in every row."""

    kind, metadata = _KIND, metadata(PERIOD)
    task: Crossing

    def set_difficulty(self, low: float, high: float) -> None:
        """Set the range of the difficulty of later episodes; raises InvalidValueError outside of 0 to 1."""
        self.task.set_difficulty(low, high)
