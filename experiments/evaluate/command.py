"""`trackslip evaluate`: measure how well slip laws and simulated robots predict logs."""

import sys

from experiments.common.manifest import command_line, origin
from experiments.common.plain_json import plain
from experiments.common.results import REPORT_FILE
from experiments.common.run import Run
from experiments.evaluate.config import Config
from experiments.evaluate.data_set import load_data_set
from experiments.evaluate.evaluation import evaluated
from experiments.evaluate.many_logs import run_all
from experiments.evaluate.models import known_geometry
from experiments.evaluate.page import Report


def run(config: Config) -> None:
    """Predict a log, and compare, store and report; exits with 1 if a bound in a data set is
    exceeded.
    """
    if len(config.logs) > 1:
        run_all(config)
        return
    given = config
    data = None
    (log,) = config.logs
    if log.suffix == ".toml":
        data = load_data_set(log)
        config = data.options(config)
        (log,) = config.logs
    known = known_geometry(config)
    with Run(given) as run, run.progress("evaluation", 2, "stages") as step:
        evaluation = evaluated(config, log, known, run.watch, step)
        checks = data.checks(evaluation.predictions) if data else []
        title = data.title if data else f"Predictions of “{log.resolve().name}”"
        source = f"{data.source}; {data.licence}" if data else ""
        report = Report(
            title, source, evaluation.predictions, checks, evaluation.fit, evaluation.notes
        )
        about = {"data_set": plain(data)} if data else {}
        manifest = run.manifest(**origin(evaluation.log.logs), **about)
        run.write(evaluation.summary(checks), manifest=manifest)
        evaluation.write_paths(run.folder, config.rrd)
        report.page(manifest, command_line("evaluate")).write(run.folder, config.pdf)
    report.print()
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")
    if not all(check.holds for check in checks):
        sys.exit(1)
