"""Identification from a log: what is read of it, and what is printed of the laws."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from experiments.report import drives, steady_laws
from experiments.sweep.table import chosen
from trackslip.identification.drive.comparison import DriveComparison
from trackslip.identification.result import Identification
from trackslip.identification.source import Reading, Source, read_source
from trackslip.slip.families import FAMILIES

if TYPE_CHECKING:
    from experiments.commands.identify import Config


def source_of(config: Config) -> Source:
    """The runs and samples that the options select; raises LogError or InvalidValueError if none can be used."""
    reading = Reading(
        config.half_gauge, config.sprocket_radius, config.gear, config.settle, config.motion, config.bag.choice()
    )
    return read_source(config.path, reading, partial(chosen, where=config.where) if config.where else None)


def print_identification(found: Identification) -> None:
    """Print the laws by the chosen method in full, and those by the other one, if there are any, briefly."""
    if found.method == "drive" and found.drive is not None:
        _print_drive(found.drive)
        if found.steady is not None:
            steady_laws.law_table(found).print()
    else:
        steady_laws.law_table(found).print()
        steady_laws.criteria_table(found).print()
        if found.drive is not None:
            drives.law_table(found.drive).print()
    for warning in found.warnings:
        print(f"warning: {warning}")
    print(f"best: {found.best}, {FAMILIES[found.best].title}")


def _print_drive(found: DriveComparison) -> None:
    best = found.laws[found.best]
    drives.law_table(found).print()
    drives.extra_table(best).print()
    for line in drives.held_lines(best):
        print(line)
    print()
    drives.position_table(found).print()
    if (heading := drives.heading_table(found)) is not None:
        heading.print()
