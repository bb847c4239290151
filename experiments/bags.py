"""Bags: their topics, what trackslip takes of them, and the log that this makes."""

import shlex
from pathlib import Path

from experiments.report.formats import MISSING, number
from experiments.report.table import Table
from experiments.storage.results import write_output
from trackslip.errors import OutputError
from trackslip.logs.logfile import write_csv, write_parquet
from trackslip.ros.bag import Bag
from trackslip.ros.choice import BagChoice
from trackslip.ros.drive_log import read_bags
from trackslip.ros.overview import overview
from trackslip.ros.record import short_type

_HEADER = ("topic", "type", "messages", "rate [Hz]", "longest gap [s]", "use (*: taken)")


def print_topics(bag: Bag, choice: BagChoice) -> None:
    """Print the topics and their uses."""
    found = overview(bag, choice)
    rows = [
        (
            topic.name,
            short_type(topic.type),
            str(topic.count),
            number(topic.rate, 1),
            number(topic.longest_gap, 2),
            found.uses.get(topic.name, ""),
        )
        for topic in bag.topics.values()
    ]
    frames = [name for name in found.uses if name not in bag.topics]
    rows += [(name, "transforms", MISSING, MISSING, MISSING, found.uses[name]) for name in frames]
    begin, end = bag.span
    Table(f"{bag.path}: {(end - begin) / 1e9:.1f} s", _HEADER, rows).print()
    for line in found.taken:
        print(line)
    for line in (*bag.notes, *found.doubts):
        print(f"warning: {line}")


def export(path: Path, choice: BagChoice, file: Path, overwrite: bool) -> None:
    """Write the log of a bag to a file, and print what was taken; raises OutputError for a file that exists."""
    if file.exists() and not overwrite:
        raise OutputError(f"{file}: exists already; --overwrite replaces it")
    read = read_bags(path, choice)
    write = write_parquet if file.suffix.lower() == ".parquet" else write_csv
    write_output(file, lambda draft: write(read.runs, draft))
    for line in (*read.taken, *(f"warning: {line}" for line in read.warnings)):
        print(line)
    print(f"{file}: {len(read.runs)} run(s), {sum(len(log.time) for log in read.runs)} rows")
    print(f"trackslip identify {shlex.quote(str(file))} --half-gauge … --sprocket-radius …")
