"""`trackslip evaluate`: how well slip laws and simulated robots predict a log."""

import sys
from dataclasses import asdict

from experiments.calibrate.calibration import fit_summary
from experiments.common.manifest import command_line
from experiments.common.plain_json import plain
from experiments.common.results import REPORT_FILE
from experiments.common.run import Run
from experiments.evaluate.config import Config
from experiments.evaluate.data_set import load_data_set
from experiments.evaluate.log import read_log
from experiments.evaluate.models import known_geometry, law_specs, models_of, robots_of
from experiments.evaluate.page import Report
from experiments.evaluate.paths import write_paths
from experiments.evaluate.prediction import doubts, identified_from, predictions
from trackslip.identification.source import origin


def run(config: Config) -> None:
    """Predict, compare, store and report; exits with 1 if a bound of a data set is missed."""
    given, data = config, None
    if config.path.suffix == ".toml":
        data = load_data_set(config.path)
        config = data.options(config)
    specs = law_specs(config)
    with Run(given) as run, run.progress("evaluation", 3, "stages") as step:
        log = read_log(config, known_geometry(config, specs))
        for line in log.taken:
            print(line)
        with run.watch.stage("fits"):
            robots, fit = robots_of(config, log)
            models = [models_of(config, specs, log, part, robots) for part in range(log.parts)]
        step(1.0)
        with run.watch.stage("predictions"):
            found = predictions(log, models)
        step(1.0)
        lengths = found[0].errors.notes if log.logs and not config.folds else ()  # windows are short
        notes = [*log.notes, *lengths, *identified_from(config.path, specs)]
        notes += doubts(found, log)
        checks = data.checks(found) if data else []
        title = data.title if data else f"Predictions of “{config.path.resolve().name}”"
        source = f" From {data.source}; {data.licence}." if data else ""
        report = Report(title, source, log, found, checks, fit, notes)
        manifest = run.manifest(**origin(log.logs), **({"data_set": plain(data)} if data else {}))
        summary = {
            "geometry": asdict(log.geometry),
            "models": {one.label: one.summary for one in found},
            "drives": {one.label: one.errors.drives for one in found} if config.folds is None else {},
            "checks": [check.to_json() for check in checks],
            "calibrated": fit_summary(fit) if fit else {},
            "warnings": notes,
        }
        run.write(summary, manifest=manifest)
        if log.logs:
            write_paths(found, log, run.folder, config.tum, config.rrd)
        report.page(manifest, command_line("evaluate")).write(run.folder, config.pdf)
        step(1.0)
    report.print()
    print(f"{config.out / REPORT_FILE}: {run.wall:.1f} s")
    if not all(check.holds for check in checks):
        sys.exit(1)
