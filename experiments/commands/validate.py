"""`trackslip validate`: compare the simulator with theory."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from experiments.options.base import Excludes, Exclusion, default_is
from experiments.options.choices import ROBOTS, SHIPPED
from experiments.options.world import Repeatable

EXAMPLES = (
    ("the shipped robot", "trackslip validate"),
    ("a calibrated robot", "trackslip validate --robot out/calibrate/robot.toml"),
    ("tracks on terrain", "trackslip validate --terrain"),
    ("ground that shears", "trackslip validate --shear"),
)


@dataclass(frozen=True)
class Config(Repeatable):
    """Compare the simulator with theory: turning, loads, slopes, time step, solver, energy.

    With --terrain it is tracks made with sim.tracks, on a box and the rescue robot: turning, climbing, tipping over,
    stairs, rough ground.
    """

    robot: Annotated[str | None, default_is("shipped; with --terrain, a box and rescue", ROBOTS)] = None
    """Robot: a name, a file of parameters as written by calibrate, or of a model (MJCF, URDF) with its tracks."""
    terrain: bool = False
    """Instead compare tracks on terrain with theory, and check their bounds."""
    shear: bool = False
    """Instead compare ground that shears with theory, under two robots or --robot, and check its bounds."""
    rrd: bool = False
    """Also record the robot turning at the paper's radii, for the rerun viewer, in OUT/recordings."""
    out: Path = Path("out/validate")
    """Folder for the results."""
    pdf: bool = False
    """Also write the figures as PDF."""

    exclusions: ClassVar[tuple[Exclusion, ...]] = (
        Excludes(("shear", "rrd"), "terrain"),
        Excludes(("rrd",), "shear"),
    )


def run(config: Config) -> None:
    """Measure robots, tracks on terrain, or ground that shears, and check the results against theory."""
    from experiments.driving.grid_runs import sample_runs
    from experiments.recording import record_all
    from experiments.run import Run
    from experiments.storage.manifest import command_line
    from experiments.storage.results import REPORT_FILE
    from experiments.validation.robot import robot_suite
    from experiments.validation.shear import shear_suite
    from experiments.validation.terrain.suite import terrain_suite

    suite = terrain_suite if config.terrain else shear_suite if config.shear else robot_suite
    with Run(config) as run:
        found = suite(config, run)
        manifest = run.manifest(seed=config.seed, **found.about)
        with run.busy("report"):
            found.page(manifest, command_line("validate")).write(run.folder, config.pdf)
        run.write(found.to_json(), manifest=manifest)
        if config.rrd:
            with run.busy("recordings"):
                record_all(run.folder, sample_runs(config.robot or SHIPPED, config))
    found.print()
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")
