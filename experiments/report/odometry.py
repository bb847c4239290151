"""Tables of odometry's errors, and what to say of them."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np

from experiments.odometry import Evaluated
from experiments.report.formats import MISSING, for_terminal, number, pair, significant
from experiments.report.terminal import print_table
from trackslip.odometry.evaluation import LENGTHS, PoseErrors, RelativeErrors
from trackslip.odometry.mounting import Mounting
from trackslip.slip.stored_laws import NO_SLIP

_METRES, _SECONDS = (tuple(f"{length:g} {unit}" for length in LENGTHS) for unit in ("m", "s"))
ABSOLUTE_HEADER = ("law", "aligned [m]", "heading [deg]", "from first pose [m]", "heading [deg]")
METRES_HEADER = ("law", *_METRES)
SECONDS_HEADER = ("law", *_SECONDS)
TITLES = {
    "absolute": "Absolute errors, rms | largest",
    "way_position": "Position error by way, mean [%] | rms [m]",
    "way_heading": "Heading error by way, mean [deg/m] | rms [deg]",
    "time_position": "Position error by time, rms | median [m]",
    "time_heading": "Heading error by time, rms | median [deg]",
}
HEADERS = {
    "absolute": ABSOLUTE_HEADER,
    "way_position": METRES_HEADER,
    "way_heading": METRES_HEADER,
    "time_position": SECONDS_HEADER,
    "time_heading": SECONDS_HEADER,
}
_MOST = 1000  # ratio of errors that is told
_LEAST = 0.01  # below which an error has three decimals
Rows = list[tuple[str, ...]]


def tables(found: Sequence[Evaluated]) -> dict[str, Rows]:
    """The rows under each of HEADERS; those of headings are left out if none was measured."""
    rows: dict[str, Rows] = {
        "absolute": [(one.label, *_absolute(one.errors.aligned), *_absolute(one.errors.from_first)) for one in found],
        "way_position": [_row(one.label, one.errors.after_metres, _way_position) for one in found],
        "way_heading": [_row(one.label, one.errors.after_metres, _way_heading) for one in found],
        "time_position": [_row(one.label, one.errors.after_seconds, _time_position) for one in found],
        "time_heading": [_row(one.label, one.errors.after_seconds, _time_heading) for one in found],
    }
    return {name: lines for name, lines in rows.items() if any(set(line[1:]) != {MISSING} for line in lines)}


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


def _row(label: str, errors: Mapping[float, RelativeErrors], cell: Any) -> tuple[str, ...]:
    return (label, *(cell(errors[length]) if length in errors else MISSING for length in LENGTHS))


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
    for key, rows in tables(found).items():
        print_table(TITLES[key], HEADERS[key], for_terminal(rows))
    for line in sensing:
        print(line)
    for note in notes:
        print(f"warning: {note}")
    if told := gain(found):
        print(told)
