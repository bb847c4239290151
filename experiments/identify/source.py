"""The runs and samples of a log, as the options of `trackslip identify` select them."""

from functools import partial
from pathlib import Path

from experiments.common.log_options import size_in_bytes
from experiments.common.run_table import chosen
from experiments.identify.config import Config
from trackslip.identification.source import ReadOptions, Source, read_source


def source_of(config: Config, log: Path) -> Source:
    """The runs and samples of a `log` that the options select; raises LogError or InvalidValueError
    if none can be used.
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
    return read_source(log, reading, partial(chosen, where=config.where) if config.where else None)
