"""Options of `trackslip train`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from experiments.options.world import MAX_THREADS
from trackslip.errors import InvalidValueError, require_at_most, require_positive

MAX_ROBOTS = 4096
MAX_LAYER = 4096
MAX_AUTHORITY = 10.0
"""[m/s], [rad/s]"""
MAX_SEED = 2**32 - 1
"""That PyTorch and NumPy's old generators take."""


@dataclass(frozen=True)
class TrainConfig:
    """Train a policy with PPO to correct the reference's twist, for `benchmark --controllers ppo:OUT`.

    The defaults are the tuned configuration that the README's numbers were made with.
    """

    steps: int = 2_000_000
    """Control periods of all robots together."""
    robots: int = 64
    """Robots in the vector environment."""
    references: tuple[str, ...] = ("paper", "figure_eight", "slalom", "clothoid", "spiral", "stop_and_go")
    """Paths to train on; an episode draws one."""
    grounds: tuple[str, ...] = ("stone",)
    """Grounds to train on; an episode draws one."""
    compensation: str = "icr_radius"
    """How twists become sprocket speeds: none, published or one of the shipped laws."""
    authority: tuple[float, float] = (0.12, 0.6)
    """Largest correction of the reference's twist [m/s, rad/s]."""
    network: tuple[int, ...] = (64, 64)
    """Sizes of the hidden layers."""
    learning_rate: float = 6e-4
    """At the start; it falls to a twentieth."""
    horizon: int = 128
    """Control periods of each robot between two updates."""
    batch: int = 2048
    """Control periods in a minibatch."""
    epochs: int = 6
    """Passes over what was driven, in an update."""
    discount: float = 0.97
    """Of the reward a control period later."""
    seed: int = 0
    """Root of all random numbers."""
    threads: int = 0
    """Worker threads of the simulator, 0 for one per processor."""
    resume: bool = False
    """Go on from the last checkpoint in OUT, instead of beginning anew."""
    rrd: bool = False
    """Also let the policy drive each path in the end, recorded for the rerun viewer in OUT/recordings."""
    out: Path = Path("out/train")
    """Folder for the policy, its checkpoints and the record of its training."""

    def __post_init__(self) -> None:
        for name in ("steps", "robots", "horizon", "batch", "epochs"):
            if getattr(self, name) < 1:
                raise InvalidValueError(name, getattr(self, name), "an integer >= 1")
        require_at_most("robots", self.robots, MAX_ROBOTS)
        if self.robots * self.horizon % self.batch:
            raise InvalidValueError("batch", self.batch, f"a factor of robots * horizon = {self.robots * self.horizon}")
        for name in ("references", "grounds", "network"):
            if not getattr(self, name):
                raise InvalidValueError(name, getattr(self, name), "at least one")
        for size in self.network:
            if not 1 <= size <= MAX_LAYER:
                raise InvalidValueError("network", size, f"integers from 1 to {MAX_LAYER}")
        for value in self.authority:
            require_positive("authority", value)
            require_at_most("authority", value, MAX_AUTHORITY)
        require_positive("learning_rate", self.learning_rate)
        require_at_most("learning_rate", self.learning_rate, 1.0)
        if not 0 < self.discount < 1:
            raise InvalidValueError("discount", self.discount, "between 0 and 1")
        if not 0 <= self.seed <= MAX_SEED:
            raise InvalidValueError("seed", self.seed, f"an integer from 0 to {MAX_SEED}")
        if not 0 <= self.threads <= MAX_THREADS:
            raise InvalidValueError("threads", self.threads, f"an integer from 0 to {MAX_THREADS}")
