"""`trackslip calibrate`: tune the simulated robot to published or measured slips and radii."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from experiments.options.base import Distinct, Whole, default_is
from experiments.options.choices import SHIPPED
from experiments.options.world import Repeatable, RobotSource
from trackslip.errors import InvalidValueError

Parameter = Literal["half_gauge", "contact_length", "friction_ratio", "radius_error", "com_x", "com_y", "shear"]
MAX_STARTS = 100
ROBOT = "robot.toml"
EXAMPLES = (
    ("to the paper's slips and radii", "trackslip calibrate"),
    (
        "to a log of steady driving",
        "trackslip calibrate --target log.csv --free friction_ratio radius_error",
    ),
)


@dataclass(frozen=True)
class Config(Repeatable):
    """Fit the simulated robot's parameters to slips and radii: the paper's, or those of a log.

    A table of turns has the columns radius and speed (commanded, to the left), observed_radius, slip_outer, slip_inner.
    """

    target: Annotated[str, default_is("published", "published|FILE")] = "published"
    """Data: the paper's Eq. 11 and Fig. 5 (published), steady driving in a log or folder, or a .csv table of turns."""
    free: Annotated[tuple[Parameter, ...], Distinct("parameter")] = ("friction_ratio", "radius_error", "com_y")
    """Parameters to fit; friction_ratio is across / along, shear the modulus of ground that shears."""
    robot: RobotSource = SHIPPED
    """Robot with the initial values, and with the values of the parameters that are not fitted."""
    starts: Annotated[int, Whole(0, MAX_STARTS)] = 5
    """Number of random starts in addition to the robot's own values."""
    rrd: bool = False
    """Also record the calibrated robot turning at the paper's radii, for the rerun viewer, in OUT/recordings."""
    out: Path = Path("out/calibrate")
    """Folder for the results, including robot.toml."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.target:
            raise InvalidValueError("target", self.target, "published, or a file")


def run(config: Config) -> None:
    """Fit, store and print."""
    from experiments.calibration import centred_fit, fit_summary, print_fits, read_target, values
    from experiments.driving.grid_runs import sample_runs
    from experiments.recording import record_all
    from experiments.run import Run
    from experiments.storage.manifest import command_line
    from sim.calibration.calibration import Candidate, calibrate, floor, simulated_twist, starts
    from sim.ground.ground import Ground
    from sim.robot.named import load_parameters
    from sim.robot.parameters import robot_file_text
    from sim.seeds import generator

    with Run(config) as run:
        robot, ground = load_parameters(config.robot)
        base = Candidate(robot, ground.across / ground.along, ground.shear)
        target = read_target(config.target, base.geometry)
        twist = partial(simulated_twist, along=ground.along, threads=config.threads)
        further = starts(config.free, config.starts, generator(config.seed, "calibrate"))
        with run.progress(f"calibration to {config.target}", 3 + config.starts, "fits") as report:
            best = calibrate(base, config.free, target, twist, further, report)
            centred = centred_fit(base, config.free, target, twist)
            report(1)
            lowest = floor(best, target)
            report(1)
        made = Ground(ground.along, ground.along * best.candidate.friction_ratio, shear=best.candidate.shear)
        comment = f"made by: {command_line('calibrate')}"
        (run.folder / ROBOT).write_text(robot_file_text(best.candidate.robot, made, comment), encoding="utf-8")
        summary = {
            **fit_summary(best),
            "floor": {"slip_rms": lowest.slip_rms, "values": values(lowest, lowest.candidate)},
            "centred": None if centred is None else fit_summary(centred),
            "starts": [{"cost": cost, "values": values(best, end)} for end, cost in best.ends],
        }
        run.write(summary, seed=config.seed)
        if config.rrd:
            with run.busy("recordings"):
                record_all(run.folder, sample_runs(str(run.folder / ROBOT), config))
    print_fits(f"Calibrated to {config.target}", best, centred, lowest)
    print(f"{config.out / ROBOT}: {run.wall:.1f} s; use it with --robot {config.out / ROBOT}")
