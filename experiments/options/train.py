"""Options of `trackslip train`."""

from dataclasses import dataclass
from pathlib import Path

from experiments.options.checks import refuse_unused, require_integer, require_positive_up_to
from experiments.options.world import MAX_THREADS
from trackslip.errors import InvalidValueError

PATH_TRACKING, TRAVERSE = ENVIRONMENTS = ("path_tracking", "traverse")
MAX_ROBOTS = MAX_LAYER = 4096
MAX_TRIALS = 10_000
MAX_AUTHORITY = 10.0  # [m/s], [rad/s]
MAX_SEED = 2**32 - 1  # the largest that PyTorch and NumPy's legacy generators accept


@dataclass(frozen=True)
class TrainConfig:
    """Train a policy with PPO that corrects the reference's twist, for `benchmark --controllers ppo:OUT`.

    With --env traverse, train one that corrects the scripted controller of a robot that crosses courses. The defaults
    are the tuned configuration behind the documented results in path tracking.
    """

    env: str = PATH_TRACKING
    """Environment: path_tracking or traverse."""
    steps: int = 2_000_000
    """Total number of control periods, summed over all robots."""
    robots: int = 64
    """Number of robots in the vector environment."""
    references: tuple[str, ...] = ("paper", "figure_eight", "slalom", "clothoid", "spiral", "stop_and_go")
    """Paths to train on; each episode draws one."""
    grounds: tuple[str, ...] = ("stone",)
    """Grounds to train on; each episode draws one."""
    compensation: str = "icr_radius"
    """Slip compensation between twist and sprocket speeds: none, published, or one of the shipped laws."""
    authority: tuple[float, float] = (0.12, 0.6)
    """Largest correction of the reference's twist [m/s, rad/s]."""
    robot: str = "rescue"
    """Name of a tracked robot, or its .toml file; needs --env traverse."""
    difficulty: tuple[float, float] = (0.7, 1.0)
    """Range of the courses' difficulty, from 0 to 1; needs --env traverse [-]."""
    trials: int = 300
    """Number of unseen courses, of each of three difficulties, to try the policy on; needs --env traverse."""
    network: tuple[int, ...] = (64, 64)
    """Sizes of the hidden layers."""
    learning_rate: float = 6e-4
    """Initial learning rate; it falls linearly to a twentieth [-]."""
    horizon: int = 128
    """Number of control periods of each robot between two updates."""
    batch: int = 2048
    """Number of control periods in a minibatch."""
    epochs: int = 6
    """Number of passes over the collected data in each update."""
    discount: float = 0.97
    """Discount of the reward per control period [-]."""
    seed: int = 0
    """Seed of all random numbers."""
    threads: int = 0
    """Number of the simulator's worker threads, 0 for one per processor."""
    resume: bool = False
    """Resume from the last checkpoint in OUT instead of starting again."""
    rrd: bool = False
    """Also record the trained policy driving each path, for the rerun viewer, in OUT/recordings."""
    out: Path = Path("out/train")
    """Folder for the policy, its checkpoints and the training curve."""

    def __post_init__(self) -> None:
        if self.env not in ENVIRONMENTS:
            raise InvalidValueError("env", self.env, f"one of {', '.join(ENVIRONMENTS)}")
        if self.env == PATH_TRACKING:
            refuse_unused(self, ("robot", "difficulty", "trials"), "without --env traverse")
        else:
            refuse_unused(self, ("references", "grounds", "compensation", "authority", "rrd"), "with --env traverse")
        low, high = self.difficulty
        if not 0 <= low <= high <= 1:
            raise InvalidValueError("difficulty", self.difficulty, "two ascending numbers from 0 to 1")
        require_integer("trials", self.trials, 1, MAX_TRIALS)
        for name in ("steps", "horizon", "batch", "epochs"):
            require_integer(name, getattr(self, name), 1)
        require_integer("robots", self.robots, 1, MAX_ROBOTS)
        if self.robots * self.horizon % self.batch:
            raise InvalidValueError("batch", self.batch, f"a factor of robots * horizon = {self.robots * self.horizon}")
        for name in ("references", "grounds", "network"):
            if not getattr(self, name):
                raise InvalidValueError(name, getattr(self, name), "at least one")
        for size in self.network:
            if not 1 <= size <= MAX_LAYER:
                raise InvalidValueError("network", size, f"integers from 1 to {MAX_LAYER}")
        for value in self.authority:
            require_positive_up_to("authority", value, MAX_AUTHORITY)
        require_positive_up_to("learning_rate", self.learning_rate, 1.0)
        if not 0 < self.discount < 1:
            raise InvalidValueError("discount", self.discount, "between 0 and 1")
        require_integer("seed", self.seed, 0, MAX_SEED)
        require_integer("threads", self.threads, 0, MAX_THREADS)
