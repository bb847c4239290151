"""The errors of odometry: tables, sentences, and their page."""

from collections.abc import Mapping, Sequence
from functools import partial
from math import degrees
from typing import Any

from markupsafe import Markup

from experiments.common.formats import MISSING, number, pair, significant
from experiments.common.page import Bullets, Note, Page, Plot, Section
from experiments.common.table import Table
from experiments.evaluate import odometry_figures as figures
from experiments.evaluate.odometry import Evaluated, clock_words
from trackslip.errors import counted
from trackslip.odometry.evaluation import LENGTHS, PoseErrors
from trackslip.se2 import Mounting
from trackslip.slip.law_file import NO_SLIP

_LEAST = 0.01  # below which an error has three decimals
_FACTORS = {"position": (1.0, 3, 100.0), "heading": (degrees(1.0), 2, degrees(1.0))}
"""Factor from SI, decimals, and factor from SI of errors over the way."""
_ABSOLUTE = ("aligned [m]", "heading [deg]", "from first pose [m]", "heading [deg]")
_RELATIVE = (
    ("after_metres", "position", ("per_way", "rms"), "Position error by distance [%] | rms [m]"),
    ("after_metres", "heading", ("per_way", "rms"), "Heading error by distance [deg/m] | rms [deg]"),
    ("after_seconds", "position", ("rms", "median"), "Position error by time, rms | median [m]"),
    ("after_seconds", "heading", ("rms", "median"), "Heading error by time, rms | median [deg]"),
)


def tables(found: Sequence[Evaluated], kind: str = "law") -> list[Table]:
    """The tables of laws, or of what else `kind` says, without headings if none were measured."""
    absolute = []
    for one in found:
        kinds = [(errors, name) for errors in (one.errors.aligned, one.errors.from_first) for name in _FACTORS]
        absolute.append((one.label, *(_cell(errors, name, "rms", "largest") for errors, name in kinds)))
    made = [Table("Absolute errors, rms | largest", (kind, *_ABSOLUTE), absolute)]
    for ahead, name, statistics, title in _RELATIVE:
        known = [length for one in found for length in getattr(one.errors, ahead)]
        lengths = [length for length in LENGTHS if length in known]
        rows = []
        for one in found:
            errors = getattr(one.errors, ahead)
            rows.append((one.label, *(_cell(errors.get(length), name, *statistics) for length in lengths)))
        header = (kind, *(f"{length:g} {'m' if ahead == 'after_metres' else 's'}" for length in lengths))
        made.append(Table(title, header, rows))
    return [table for table in made if any(set(row[1:]) - {MISSING} for row in table.rows)]


def _cell(errors: PoseErrors | None, name: str, *statistics: str) -> str:
    """Statistics of errors of position or heading side by side; MISSING if there are none."""
    known = getattr(errors, name, None)
    if known is None:
        return MISSING
    factor, digits, per_way = _FACTORS[name]
    return pair(
        [
            _small(per_way * getattr(errors, f"{name}_per_way"))
            if kind == "per_way"
            else number(factor * getattr(known, kind), digits)
            for kind in statistics
        ]
    )


def _small(value: float) -> str:
    """Two significant digits, but no more than three decimals."""
    return number(value, 3) if value < _LEAST else significant(value)


def gain(found: Sequence[Evaluated]) -> str:
    """A line on the gain of the best law over no slip compensation, after the longest distance that all have."""
    without = next((one for one in found if one.used.name == NO_SLIP), None)
    others = [one for one in found if one is not without]
    lengths = set.intersection(*(set(one.errors.after_metres) for one in found))
    if without is None or not others or not lengths:
        return ""
    length = max(lengths)
    best = min(others, key=lambda one: one.errors.after_metres[length].position_per_way)
    told = []
    for name in _FACTORS:
        ours, theirs = (getattr(one.errors.after_metres[length], f"{name}_per_way") for one in (best, without))
        if ours > 0 and theirs > 0:  # and measured
            told.append(f"{name} {significant(theirs / ours)} times better")
    return f"{best.label}, after {length:g} m, compared with no slip compensation: {', '.join(told)}" if told else ""


def sensing_lines(found: Sequence[Evaluated], sensor_given: bool, clock_given: bool) -> list[str]:
    """Lines on the sensor's place and the clock offset: one, or one for each law that differs."""
    known = any(one.used.mounting is not None for one in found)
    words = ["given" if given else "as identified" if known else "assumed" for given in (sensor_given, clock_given)]
    by_sensing: dict[tuple[Mounting, float], list[str]] = {}
    for one in found:
        by_sensing.setdefault((one.mounting, one.clock_offset), []).append(one.label)
    return [
        f"{', '.join(labels) + ': the' if len(by_sensing) > 1 else 'The'} poses' sensor sits {place.x:z.3f} m ahead "
        f"of and {abs(place.y):.3f} m {'right' if place.y < 0 else 'left'} of the turning centre, turned by "
        f"{degrees(place.yaw):z.2f}° ({words[0]}); the encoders' clock is {clock_words(offset)} ({words[1]})."
        for (place, offset), labels in by_sensing.items()
    ]


def print_errors(found: Sequence[Evaluated], notes: Sequence[str], sensing: Sequence[str], kind: str = "law") -> None:
    """Print the tables, what was sensed where, warnings, and how much the best law gains."""
    for table in tables(found, kind):
        table.print()
    for line in (*sensing, *(f"warning: {note}" for note in notes), gain(found)):
        if line:
            print(line)


def page(
    found: Sequence[Evaluated],
    notes: Sequence[str],
    sensing: Sequence[str],
    manifest: Mapping[str, Any],
    command: str,
    title: str,
    about: str = "Odometry turns encoder readings into poses by a slip law. Here it is compared",
    kind: str = "law",
) -> Page:
    """The page of odometry, or of what else `about` says, under a title; `kind` as for `tables`."""
    drives, told, longest = found[0].errors.drives, gain(found), figures.longest(found)
    way, duration = sum(drive.way for drive in drives), sum(drive.duration for drive in drives)
    intro = (
        f"{about} with measured poses of {counted(len(drives), 'drive')}: {way:.0f} m by the encoders in "
        f"{duration:.0f} s, {counted(sum(drive.poses for drive in drives), 'pose')}. "
    )
    along = "Every path begins at the first measured pose, with its heading."
    if not longest.has_heading:
        along = "As no heading was measured, every path is moved so that it fits the measured positions best."
    paths = Plot(
        "odometry_paths",
        partial(figures.paths, found),
        f"Path of {longest.name}",
        f"{along} Right: how far its positions are from those measured.",
    )
    over_way = Plot(
        "odometry_errors_over_way",
        partial(figures.errors_over_way, found),
        "Errors over the distance driven",
        "Mean error after a distance, over this distance, from every measured pose. A line that falls like "
        "1 / distance is the noise of the measured poses; one that stays level is an error of the law; slip that "
        "varies lies between.",
    )
    relative = Note(
        "Relative errors compare the motion from every measured pose to the one nearest to the given distance or time "
        "ahead, and contain the noise of both. Without headings, each motion starts with the heading at which odometry "
        "fits the positions of the last 10 s."
    )
    sections = [
        Section("Along a drive", [paths]),
        Section(
            "Per metre and second",
            [over_way if found[0].errors.after_metres else None, *tables(found, kind), relative],
        ),
        Section("Warnings", [Bullets(notes)]) if notes else None,
    ]
    best = told and Markup("<strong>{}.</strong>").format(told)
    return Page(title, command, manifest, sections, [intro + " ".join(sensing), best])
