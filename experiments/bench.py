"""`trackslip bench`: the speed of the simulator relative to the bare engine."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from experiments.common.options import Distinct, Positive, Whole
from experiments.simulate.options import Repeatable
from trackslip.errors import counted

EXAMPLES = (
    ("the simulator, the environments, localization and reproduce", "trackslip bench"),
    ("a quick look", "trackslip bench --sizes 1 64 --seconds 5 --repeats 3"),
)
MAX_ROBOTS = 10_000


@dataclass(frozen=True)
class Config(Repeatable):
    """Compare the simulator's speed with the bare engine's, both making the same steps in turns."""

    sizes: Annotated[tuple[int, ...], Distinct("number"), Whole(1, MAX_ROBOTS)] = (1, 25, 256)
    """Numbers of robots."""
    threads: Annotated[int, Whole(1, 1024)] = 1
    """Number of worker threads."""
    seconds: Annotated[float, Positive(1000.0, "s")] = 20.0
    """Simulated time of all robots together in a turn [s]."""
    repeats: Annotated[int, Whole(1, 100)] = 5
    """Number of rounds of turns, after one that warms up; ratios are medians."""
    out: Path = Path("out/bench")
    """Folder for the results."""


def run(config: Config) -> None:
    """Measure, store and print."""
    from experiments.common.results import SUMMARY_FILE
    from experiments.common.run import Run
    from experiments.common.table import Table
    from experiments.simulate.speed import CASES, checks_of, measure
    from sim.robot.robot import load_robot

    robot = load_robot()
    with Run(config) as run:
        with run.progress("bench", 1 + (1 + config.repeats) * (1 + len(config.sizes) * len(CASES)), "turns") as turn:
            speeds, costs = measure(config, robot, turn)
        checks = checks_of(speeds, costs)
        summary = {
            "speeds": speeds,
            "costs": costs,
            "checks": [check.to_json() for check in checks],
        }
        run.write(summary, seed=config.seed, model_sha256=robot.digest)
    step = float(robot.model.opt.timestep)
    rows = [
        (one.case, str(one.robots), f"{one.steps_per_s:,.0f}", f"{one.over_bare:.2f}", f"{one.steps_per_s * step:,.0f}")
        for one in speeds
    ]
    header = ("case", "robots", "physics steps/s", "over the bare engine", "x real time")
    Table(f"Speed on {counted(config.threads, 'thread')}", header, rows).print()
    for check in checks:
        print(f"{'holds' if check.holds else 'DOES NOT HOLD'}: {check}")
    print(f"{config.out / SUMMARY_FILE}: {run.wall:.1f} s")
