"""`trackslip validate`: compare the simulator with theory."""

from experiments.common.choices import SHIPPED
from experiments.common.manifest import command_line
from experiments.common.results import REPORT_FILE
from experiments.common.run import Run
from experiments.recorder import record_all
from experiments.simulate.grid_runs import sample_runs
from experiments.validate.config import Config
from experiments.validate.robot import robot_suite
from experiments.validate.shear import shear_suite
from experiments.validate.terrain.suite import terrain_suite


def run(config: Config) -> None:
    """Measure robots, tracks on terrain, or ground that shears, and check the results against theory."""
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
