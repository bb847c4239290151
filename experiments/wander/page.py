"""The page on simulated drives: what they contain, their paths, speeds and slips."""

import math
import shlex
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

from experiments.common.chart import Chart
from experiments.common.manifest import command_line
from experiments.common.page import Answer, Page, Plot, Section
from experiments.common.table import Table, percent, significant
from experiments.common.traces import Traces
from experiments.simulate.run_charts import path_chart, slip_chart, speeds_chart
from experiments.wander.config import Config
from trackslip.errors import counted
from trackslip.logs.runlog import RunLog

_HEADER: Final = (
    "drive",
    "rows",
    "poses",
    "distance [m]",
    "turned left [deg]",
    "right [deg]",
    "at rest",
)
_DRAWN: Final = 4  # largest number of drives whose paths are drawn


def drives_table(config: Config, contents: Sequence[Mapping[str, Any]]) -> Table:
    """A table with a row per drive, see `drive_contents`."""
    rows = []
    for drive in contents:
        row = (
            drive["run"],
            str(drive["readings"]),
            str(drive["poses"]),
            f"{drive['way']:.1f}",
            f"{math.degrees(drive['turned_left']):.0f}",
            f"{math.degrees(drive['turned_right']):.0f}",
            f"{drive['standing']:.0%}",
        )
        rows.append(row)
    title = f"Drives, with poses of {config.source.source} at {config.source.poses().rate:g} Hz"
    return Table(title, _HEADER, rows)


def page(
    config: Config,
    logs: Sequence[RunLog],
    contents: Sequence[Mapping[str, Any]],
    notes: Sequence[str],
    manifest: Mapping[str, Any],
) -> Page:
    """The page on drives with these contents; `notes` are about the robot."""
    paths = Plot(
        "paths",
        partial(_paths, logs),
        "Paths" if len(logs) <= _DRAWN else f"Paths of the first {_DRAWN} drives",
        "Measured positions are those of the pose sensor, where it is mounted.",
    )
    first = logs[0]
    speeds = Plot("speeds", lambda: speeds_chart(Traces(first)), f"Speeds of {first.run}")
    slip = Plot("slip", lambda: slip_chart(Traces(first)), f"True slip of {first.run}")
    drives = Section("Drives", [paths, drives_table(config, contents)])
    over_time = Section("Over time", [speeds, slip])
    answer = _answer(config, contents, notes)
    title = f"Simulated drives: {config.driving}"
    return Page(title, command_line("wander"), manifest, [drives, over_time], answer=answer)


def _paths(logs: Sequence[RunLog]) -> list[Chart]:
    """The paths of the first drives."""
    return [path_chart(Traces(log), log.run) for log in logs[:_DRAWN]]


def _answer(config: Config, contents: Sequence[Mapping[str, Any]], notes: Sequence[str]) -> Answer:
    """The answer: the number of drives and what they contain together."""
    distance = sum(drive["way"] for drive in contents)
    turned = sum(drive["turned_left"] + drive["turned_right"] for drive in contents)
    poses = sum(drive["poses"] for drive in contents)
    rest = sum(drive["standing"] for drive in contents) / len(contents)
    source = config.source
    heading = (
        f"{counted(len(contents), 'drive')} of {config.duration:g} s, "
        f"{significant(distance, 'm', 3)} in all"
    )
    facts = [
        ("poses", f"{poses:,} by {source.source}, at {source.poses().rate:g} Hz"),
        ("encoders", f"at {config.encoder_rate:g} Hz"),
        ("turned, both ways", f"{math.degrees(turned):,.0f}°"),
        ("at rest", percent(rest)),
    ]
    warnings = [] if poses else ["no pose was measured"]
    lines = [f"{note[0].upper()}{note[1:]}." for note in notes]
    identify = f"trackslip identify {shlex.quote(str(config.out))}"
    return Answer(heading, facts, lines, warnings, next=[identify])
