"""`trackslip identify`: fit slip laws to a stored grid or to a real robot's log."""

from functools import partial

from experiments.common.log_options import size_in_bytes
from experiments.common.manifest import command_line, origin
from experiments.common.results import REPORT_FILE, write_samples
from experiments.common.run import Run
from experiments.common.run_table import chosen
from experiments.identify.card import print_card
from experiments.identify.config import Config
from experiments.identify.page import page, print_all
from trackslip.identification.identify import identify_source
from trackslip.identification.result import identification_to_json
from trackslip.identification.source import ReadOptions, Source, read_source
from trackslip.laws.families import drive_laws
from trackslip.se2 import Mounting


def run(config: Config) -> None:
    """Fit the laws, and store and print them."""
    # reading, steady stretches, each law for whole drives, the report
    stages = 3 + len(drive_laws())
    with Run(config) as run, run.progress("identification", stages, "stages") as report:
        source = source_of(config)
        report(1)
        sensor = None if config.sensor is None else Mounting(*config.sensor)
        with run.watch.stage("identify"):
            result = identify_source(source, config.method, sensor, report, config.lag)
        manifest = run.manifest(**origin(result.logs))
        if not result.logs:
            write_samples(run.folder, result.samples)
        run.write(identification_to_json(result), result.logs, manifest=manifest)
        title = f"Slip laws identified from “{config.path.resolve().name}”"
        report_page = page(result, title, command_line("identify"), manifest, source.taken)
        report_page.write(run.folder, config.pdf)
        report(1)
    assert report_page.answer is not None
    print_card(report_page.answer, f"{config.out / REPORT_FILE} ({run.wall:.1f} s)")
    if config.all:
        print_all(result)


def source_of(config: Config) -> Source:
    """The runs and samples that the options select; raises LogError or InvalidValueError if none
    can be used.
    """
    reading = ReadOptions(
        half_gauge=config.half_gauge,
        sprocket_radius=config.sprocket_radius,
        gear=config.gear,
        settle=config.settle,
        motion=config.motion,
        bag=config.bag.choice(),
        multiplier=config.multiplier,
        layout=config.table.layout(config.half_gauge, config.sprocket_radius),
        max_memory=size_in_bytes("max_memory", config.max_memory),
    )
    return read_source(
        config.path, reading, partial(chosen, where=config.where) if config.where else None
    )
