"""Options of `trackslip bench`."""

from dataclasses import dataclass
from pathlib import Path

from experiments.options import checks
from experiments.options.world import MAX_DURATION, MAX_THREADS
from trackslip.errors import InvalidValueError

MAX_ROBOTS = 10_000
MAX_GPU_ROBOTS = 1_000_000
MAX_REPEATS = 1000
_SHEAR_SIZES = (32, 64, 256)
_GPU_SIZES = (1024, 4096, 16_384, 65_536)
_SCALE_SIZES = (1, 16, 256, 4096)
_CHOICES = ("env", "terrain", "shear", "gpu", "pipeline", "scale")


@dataclass(frozen=True)
class BenchConfig:
    """Measure the speed of the simulation: bare physics, a fleet, a fleet with scanners, and the closed loop.

    With --env, measure the learning environments instead; with --terrain, robots with tracks on level ground, on ten
    steps and on rough ground; with --shear, what ground that shears costs; with --gpu, fleets on an NVIDIA GPU; with
    --pipeline, each stage of the pipeline against its bound; with --scale, many robots and long runs.
    """

    sizes: tuple[int, ...] = (1, 25, 256)
    """Numbers of robots; each is measured with each number of threads."""
    thread_counts: tuple[int, ...] = (1, 2)
    """Numbers of worker threads."""
    seconds: float = 20.0
    """Simulated time of each measurement, summed over all robots; the closed loop simulates a tenth of it [s]."""
    repeats: int = 5
    """Number of rounds; every case is measured in short turns in each round, and the results are medians."""
    env: bool = False
    """Measure the gymnasium environments, vectorised natively and one by one, relative to the bare engine."""
    env_size: int = 64
    """Number of robots in the environments; needs --env."""
    terrain: bool = False
    """Measure robots with tracks on terrain, with both contact presets, relative to the bare engine."""
    terrain_robot: str = "rescue"
    """Name of a tracked robot, or its .toml file; needs --terrain."""
    terrain_sizes: tuple[int, ...] = (1, 64)
    """Numbers of robots on terrain; needs --terrain."""
    shear: bool = False
    """Measure fleets on ground that shears and on Coulomb ground; by default of 32, 64 and 256 robots."""
    gpu: bool = False
    """Measure fleets on an NVIDIA GPU, with MuJoCo Warp; by default of 1,024 to 65,536 robots."""
    pipeline: bool = False
    """Measure each stage, from physics to report, and compare it with its bound; takes minutes."""
    scale: bool = False
    """Measure how time and memory grow with the number of robots and the length of runs; takes minutes."""
    scale_long: tuple[int, ...] = (1, 16)
    """Numbers of robots that also drive for 30 min: 256 take 8 minutes, 4096 two hours; needs --scale."""
    seed: int = 0
    """Seed of all random numbers."""
    out: Path = Path("out/bench")
    """Folder for the results."""

    def __post_init__(self) -> None:
        sizes = MAX_GPU_ROBOTS if self.gpu else MAX_ROBOTS
        checks.require_distinct("scale_long", self.scale_long, "number")
        for name, most in (("sizes", sizes), ("thread_counts", MAX_THREADS), ("terrain_sizes", MAX_ROBOTS)):
            checks.require_distinct(name, getattr(self, name), "number")
            for value in getattr(self, name):
                checks.require_integer(name, value, 1, most)
        checks.require_positive_up_to("seconds", self.seconds, MAX_DURATION, "s")
        checks.require_integer("repeats", self.repeats, 1, MAX_REPEATS)
        checks.require_integer("env_size", self.env_size, 1, MAX_ROBOTS)
        chosen = [name for name in _CHOICES if getattr(self, name)]
        if len(chosen) > 1:
            raise InvalidValueError(chosen[-1], True, f"left out with --{chosen[0]}")
        checks.require_integer("seed", self.seed)
        if not self.env:
            checks.refuse_unused(self, ("env_size",), "without --env")
        if not self.terrain:
            checks.refuse_unused(self, ("terrain_robot", "terrain_sizes"), "without --terrain")
        if self.env or self.terrain:
            checks.refuse_unused(self, ("sizes",), "with --env and --terrain")
        for value in self.scale_long:
            if value not in _SCALE_SIZES:
                raise InvalidValueError("scale_long", value, f"one of {', '.join(map(str, _SCALE_SIZES))}")
        if not self.scale:
            checks.refuse_unused(self, ("scale_long",), "without --scale")
        if self.gpu:
            checks.refuse_unused(self, ("thread_counts", "seconds"), "with --gpu")
        if self.pipeline or self.scale:
            checks.refuse_unused(self, ("sizes", "thread_counts", "seconds"), "with --pipeline and --scale")

    @property
    def shear_sizes(self) -> tuple[int, ...]:
        """Numbers of robots with --shear: those given, or else enough for the cost to be bounded."""
        return _SHEAR_SIZES if self.sizes == BenchConfig.sizes else self.sizes

    @property
    def gpu_sizes(self) -> tuple[int, ...]:
        """Numbers of robots with --gpu: those given, or else enough to occupy a GPU."""
        return _GPU_SIZES if self.sizes == BenchConfig.sizes else self.sizes
