"""The errors of odometry: tables, sentences, and their page."""

from collections.abc import Callable, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from markupsafe import Markup

from experiments.odometry import Evaluated
from experiments.report.figures import odometry as figures
from experiments.report.formats import MISSING, number, pair, significant
from experiments.report.page import Bullets, Note, Page, Plot, Section
from experiments.report.table import Table
from trackslip.odometry.evaluation import LENGTHS, OdometryErrors, PoseErrors, RelativeErrors
from trackslip.odometry.mounting import Mounting
from trackslip.slip.stored_laws import NO_SLIP

_MOST = 1000  # ratio of errors that is told
_LEAST = 0.01  # below which an error has three decimals
_ABSOLUTE = ("law", "aligned [m]", "heading [deg]", "from first pose [m]", "heading [deg]")
_INTRO = (
    "Odometry turns encoder readings into poses by a slip law, without looking at anything else. Here it is compared "
    "with measured poses"
)


def tables(found: Sequence[Evaluated]) -> dict[str, Table]:
    """The tables by what they show; those of headings are left out if none was measured."""
    metres, seconds = (("law", *(f"{length:g} {unit}" for length in LENGTHS)) for unit in ("m", "s"))
    absolute = [(one.label, *_absolute(one.errors.aligned), *_absolute(one.errors.from_first)) for one in found]
    made = {"absolute": Table("Absolute errors, rms | largest", _ABSOLUTE, absolute)}
    for name, title, header, cell in (
        ("way_position", "Position error by way, mean [%] | rms [m]", metres, _way_position),
        ("way_heading", "Heading error by way, mean [deg/m] | rms [deg]", metres, _way_heading),
        ("time_position", "Position error by time, rms | median [m]", seconds, _time_position),
        ("time_heading", "Heading error by time, rms | median [deg]", seconds, _time_heading),
    ):
        ahead = [one.errors.after_metres if header is metres else one.errors.after_seconds for one in found]
        rows = [(one.label, *_cells(errors, cell)) for one, errors in zip(found, ahead, strict=True)]
        made[name] = Table(title, header, rows)
    return {name: table for name, table in made.items() if any(set(row[1:]) != {MISSING} for row in table.rows)}


def gain(found: Sequence[Evaluated]) -> str:
    """How much better the best law is than no slip compensation after the longest way that all have, in a line."""
    without = next((one for one in found if one.used.name == NO_SLIP), None)
    others = [one for one in found if one is not without]
    lengths = set.intersection(*(set(one.errors.after_metres) for one in found))
    if without is None or not others or not lengths:
        return ""
    length = max(lengths)
    best = min(others, key=lambda one: one.errors.after_metres[length].position_per_way)
    ours, theirs = (one.errors.after_metres[length] for one in (best, without))
    parts = [_ratio("position", theirs.position_per_way, ours.position_per_way)]
    parts += [_ratio("heading", theirs.heading_per_way, ours.heading_per_way)]
    told = ", ".join(part for part in parts if part)
    return f"{best.label}, after {length:g} m, compared with no slip compensation: {told}" if told else ""


def sensing_lines(found: Sequence[Evaluated], sensor_given: bool, clock_given: bool) -> list[str]:
    """Where the sensor was taken to sit and how far the clocks are apart: a line, or one for each law that differs."""
    known = any(one.used.mounting is not None for one in found)
    words = ["given" if given else "as identified" if known else "assumed" for given in (sensor_given, clock_given)]
    by_sensing: dict[tuple[Mounting, float], list[str]] = {}
    for one in found:
        by_sensing.setdefault((one.mounting, one.clock_offset), []).append(one.label)
    return [
        f"{', '.join(labels) + ': the' if len(by_sensing) > 1 else 'The'} poses' sensor sits {_metres(place.x)} ahead "
        f"of and {_metres(place.y)} left of the turning centre, turned by {degrees(place.yaw):.2f}° ({words[0]}); the "
        f"encoders' clock is {abs(round(1e3 * offset))} ms {'behind' if offset < 0 else 'ahead of'} the poses' "
        f"({words[1]})."
        for (place, offset), labels in by_sensing.items()
    ]


def _metres(length: float) -> str:
    return f"{round(length, 3) + 0.0:.3f} m"


def _absolute(errors: PoseErrors) -> tuple[str, str]:
    position, heading = errors.position, errors.heading
    return (
        MISSING if position is None else pair([number(position.rms, 3), number(position.largest, 3)]),
        MISSING if heading is None else pair([number(degrees(heading.rms), 2), number(degrees(heading.largest), 2)]),
    )


def _cells(errors: Mapping[float, RelativeErrors], cell: Callable[[RelativeErrors], str]) -> list[str]:
    return [cell(errors[length]) if length in errors else MISSING for length in LENGTHS]


def _way_position(errors: RelativeErrors) -> str:
    assert errors.position is not None
    return pair([_small(100 * errors.position_per_way), number(errors.position.rms, 3)])


def _way_heading(errors: RelativeErrors) -> str:
    if errors.heading is None:
        return MISSING
    return pair([_small(degrees(errors.heading_per_way)), number(degrees(errors.heading.rms), 2)])


def _time_position(errors: RelativeErrors) -> str:
    assert errors.position is not None
    return pair([number(errors.position.rms, 3), number(errors.position.median, 3)])


def _time_heading(errors: RelativeErrors) -> str:
    if errors.heading is None:
        return MISSING
    return pair([number(degrees(errors.heading.rms), 2), number(degrees(errors.heading.median), 2)])


def _ratio(what: str, without: float, with_law: float) -> str:
    """How many times smaller the second error is; empty where it isn't known."""
    if not np.isfinite([without, with_law]).all() or without == 0:
        return ""
    if with_law * _MOST < without:
        return f"{what} more than {_MOST:,} times better"
    return f"{what} {significant(without / with_law)} times better"


def _small(value: float) -> str:
    """Two significant digits, but no more than three decimals."""
    return number(value, 3) if value < _LEAST else significant(value)


def print_errors(found: Sequence[Evaluated], notes: Sequence[str], sensing: Sequence[str]) -> None:
    """Print the tables, what was sensed where, warnings, and how much the best law gains."""
    for table in tables(found).values():
        table.print()
    for line in sensing:
        print(line)
    for note in notes:
        print(f"warning: {note}")
    if told := gain(found):
        print(told)


def page(
    found: Sequence[Evaluated],
    notes: Sequence[str],
    sensing: Sequence[str],
    manifest: Mapping[str, Any],
    command: str,
    name: str,
) -> Page:
    """The page of odometry on the log `name`."""
    errors = found[0].errors
    drive, told = figures.longest(found), gain(found)
    along = "Every path begins at the first measured pose, with its heading."
    if not drive.has_heading:
        along = "As no heading was measured, every path is moved so that it fits the measured positions best."
    blind = (
        " Without headings, each motion starts with the heading at which odometry fits the positions of the last 10 s."
    )
    way = (
        Plot(
            "odometry_errors_over_way",
            figures.errors_over_way(found),
            "Errors over the way driven",
            "Mean error after a way, over that way, from every measured pose. A line that falls like 1 / way is the "
            "noise of the measured poses; one that stays level is an error of the law; slip that varies lies between.",
        )
        if errors.after_metres
        else None
    )
    return Page(
        title=f"Odometry by slip laws on {name}",
        command=command,
        manifest=manifest,
        intro=[
            " ".join([_driven(errors, drive.has_heading), *sensing]),
            told and Markup("<strong>{}.</strong>").format(told),
        ],
        sections=[
            Section(
                "Along a drive",
                [
                    Plot(
                        "odometry_paths",
                        figures.paths(found),
                        f"Path of {drive.name}",
                        f"{along} Right: how far its positions are from those measured.",
                    )
                ],
            ),
            Section(
                "Per metre and second",
                [
                    way,
                    *tables(found).values(),
                    Note(
                        "Relative errors compare the motion from every measured pose to the one nearest to the given "
                        "way or time ahead. They contain the noise of the measured poses at both ends. The way is that "
                        f"of the middle of the tracks by the encoders.{'' if drive.has_heading else blind}"
                    ),
                ],
            ),
            Section("Warnings", [Bullets(notes)]) if notes else None,
        ],
    )


def _driven(errors: OdometryErrors, headings: bool) -> str:
    """What odometry was compared with."""
    drives = errors.drives
    count = "a drive" if len(drives) == 1 else f"{len(drives)} drives"
    way, duration = sum(drive.way for drive in drives), sum(drive.duration for drive in drives)
    poses = f"{sum(drive.poses for drive in drives):,} poses{'' if headings else ' without headings'}"
    return f"{_INTRO} of {count}: {way:.0f} m by the encoders in {duration:.0f} s, {poses}."
