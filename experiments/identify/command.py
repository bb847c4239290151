"""`trackslip identify`: fit slip laws to a stored grid or to a real robot's log, or to several."""

from experiments.common.manifest import command_line, origin
from experiments.common.results import REPORT_FILE, write_samples
from experiments.common.run import Run
from experiments.identify.card import print_card
from experiments.identify.config import Config
from experiments.identify.many_logs import run_all
from experiments.identify.page import page, print_all
from experiments.identify.source import source_of
from trackslip.identification.identify import identify_source
from trackslip.identification.result import identification_to_json
from trackslip.laws.families import drive_laws
from trackslip.se2 import Mounting


def run(config: Config) -> None:
    """Fit the laws, and store and print them."""
    if len(config.logs) > 1:
        run_all(config)
        return
    (log,) = config.logs
    # reading, steady stretches, each law for whole drives, the report
    stages = 3 + len(drive_laws())
    with Run(config) as run, run.progress("identification", stages, "stages") as report:
        source = source_of(config, log)
        report(1)
        sensor = None if config.sensor is None else Mounting(*config.sensor)
        with run.watch.stage("identify"):
            result = identify_source(source, config.method, sensor, report, config.lag)
        manifest = run.manifest(**origin(result.logs))
        if not result.logs:
            write_samples(run.folder, result.samples)
        run.write(identification_to_json(result), result.logs, manifest=manifest)
        title = f"Slip laws identified from “{log.resolve().name}”"
        report_page = page(result, title, command_line("identify"), manifest, source.taken)
        report_page.write(run.folder, config.pdf)
        report(1)
    assert report_page.answer is not None
    print_card(report_page.answer, f"{config.out / REPORT_FILE} ({run.wall:.1f} s)")
    if config.all:
        print_all(result)
