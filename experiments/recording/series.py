"""Plots over time: entities, names with units, colours, and the panels that they are gathered in.

The viewer draws the entities of a panel, and lists them in its legend, by the alphabet: what comes later lies on top.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from experiments.recording.traces import Traces
from trackslip.kinematics import Array

LEFT, RIGHT = "#56B4E9", "#E69F00"  # tracks in every panel; all colours are from Okabe and Ito's palette
_AHEAD, _SIDEWAYS, _TURNING = "#009E73", "#F0E442", "#CC79A7"
# opaque, because the viewer draws a line in pieces that overlap
_PALE = {LEFT: "#BFE3F8", RIGHT: "#FFE0A0", _AHEAD: "#9ADFCA", _TURNING: "#F2D5E4"}
_DIM = {LEFT: "#2B5F7D", RIGHT: "#7A5400"}
_GREY = "#8a8a8a"
_THICK, _LINE, _THIN = 4.5, 1.5, 0.8  # line widths [px]
_RARE = 5.0  # share of the time, at either end, in which slips may be off their axis [%]
_MAX_LABELS = 5  # along an axis


@dataclass(frozen=True)
class Series:
    """Some lines of a panel."""

    entity: str
    values: Array  # (T, n), NaN for a gap
    names: tuple[str, ...]
    colours: tuple[str, ...]
    width: float = 1.5  # [px]


@dataclass(frozen=True)
class Panel:
    """A plot over time."""

    title: str
    entities: tuple[str, ...]
    range: tuple[float, float] | None = None
    height: float = 1.0  # relative to the other panels
    legend: bool = True
    tab: str = "Slip and errors"  # the tab with the panel, if there are several


SLIP_LAW, SLIP_IDENTIFIED, SLIP_TRUE = "slip/by_law", "slip/identified", "slip/true"
_SLIP_RANGE = (-0.25, 0.20)
_POSITION, _HEADING = "Position error [mm]", "Heading error [deg]"
_DISTANCE = "Distance from the reference [mm]"
_MOTION, _SPEEDS = "Twist and forces", "Speeds"
PANELS = (
    Panel("Slip [-]", (SLIP_LAW, SLIP_IDENTIFIED, SLIP_TRUE), _SLIP_RANGE, 1.9),
    Panel("Sprocket speed [rad/s]", ("sprocket/command", "sprocket/measured"), height=1.4),
    Panel(_POSITION, ("error/distance", "error/position"), height=1.2),
    Panel(_HEADING, ("error/heading",), height=0.9, legend=False),
    Panel("Twist [m/s, rad/s]", ("twist/command", "twist/true"), height=1.5, tab=_MOTION),
    Panel("Load on the tracks [N]", ("contact/load",), tab=_MOTION),
    Panel("Traction of the tracks [N]", ("contact/traction",), tab=_MOTION),
)
"""Panels of a single run."""
COMPARED = (
    Panel(_DISTANCE, ("error/distance",), height=1.6),
    Panel(_HEADING, ("error/heading",), legend=False),
    Panel("True slip [-], pale: right track", (SLIP_TRUE,), _SLIP_RANGE, legend=False),
    Panel("Identified slip [-], pale: right track", (SLIP_IDENTIFIED,), _SLIP_RANGE, legend=False),
    Panel("Sprocket speed [rad/s], pale: right track", ("sprocket/measured",), tab=_SPEEDS),
    Panel("Yaw rate [rad/s], pale: commanded", ("twist/yaw",), legend=False, tab=_SPEEDS),
)
"""Panels of several runs; each run has one colour in all of them."""


def series_of(traces: Traces) -> list[Series]:
    """Everything that can be plotted of a run."""
    log, found = traces.log, []

    def add(entity: str, values: Array | None, names: tuple[str, ...], colours: tuple[str, ...], width: float) -> None:
        if values is not None:
            found.append(Series(entity, values, names, colours, width))

    sides, ways = (LEFT, RIGHT), (_AHEAD, _TURNING)
    pale_sides, pale_ways = (tuple(_PALE[colour] for colour in colours) for colours in (sides, ways))
    law = traces.law_name
    add(SLIP_LAW, traces.law, (f"left, law {law}", f"right, law {law}"), (_DIM[LEFT], _DIM[RIGHT]), _THICK)
    add(SLIP_IDENTIFIED, traces.identified, ("left, identified", "right, identified"), pale_sides, _THIN)
    add(SLIP_TRUE, traces.slip, ("left, true", "right, true"), sides, _LINE)
    add("sprocket/command", log.command, ("left, set point", "right, set point"), pale_sides, _THICK)
    add("sprocket/measured", log.omega, ("left, measured", "right, measured"), sides, _LINE)
    if traces.error is not None and traces.distance is not None:
        millimetres = 1e3 * traces.error[:, :2]
        add("error/distance", 1e3 * traces.distance[:, None], ("distance",), (_GREY,), _THICK)
        add("error/position", millimetres, ("ahead", "to the left"), (_AHEAD, _SIDEWAYS), _LINE)
        add("error/heading", np.degrees(traces.error[:, 2:]), ("heading",), (_TURNING,), _LINE)
    add("twist/command", log.twist_command, ("v commanded [m/s]", "w commanded [rad/s]"), pale_ways, _THICK)
    if log.truth is not None:
        add("twist/true", log.truth.twist[:, [0, 2]], ("v true [m/s]", "w true [rad/s]"), ways, _LINE)
        add("contact/traction", log.truth.traction, ("left, traction", "right, traction"), sides, _THIN)
        if log.truth.contact is not None:
            left = log.truth.contact.shape[1] // 2  # the left pads come before the right ones
            load = np.stack([part.sum(axis=1) for part in np.split(log.truth.contact[..., 2], [left], axis=1)], axis=-1)
            add("contact/load", load, ("left, load", "right, load"), sides, _LINE)
    return found


def panels(runs: Sequence[Traces]) -> list[Panel]:
    """PANELS of one run, or COMPARED of several, with readable ranges; those of errors leave out the transients."""
    chosen = PANELS if len(runs) == 1 else COMPARED
    late = [error for traces in runs if (error := traces.late_error) is not None]
    slip = _slip_range(runs)
    many = [line for run in runs for line in compared_series(run, "", LEFT, LEFT)]
    lines = series_of(runs[0]) if len(runs) == 1 else many
    ranges = {panel.title: slip if panel.range == _SLIP_RANGE else range_of(panel, lines) for panel in chosen}
    if late:
        error = np.concatenate(late)
        ranges[_POSITION] = readable(1e3 * np.append(error[:, :2].ravel(), np.hypot(error[:, 0], error[:, 1])))
        ranges[_DISTANCE] = readable(1e3 * np.hypot(error[:, 0], error[:, 1]))
        ranges[_HEADING] = readable(np.degrees(error[:, 2]))
    return [replace(panel, range=ranges[panel.title]) for panel in chosen]


def range_of(panel: Panel, lines: Sequence[Series]) -> tuple[float, float] | None:
    """A range with all values that a panel shows of the lines; None without any."""
    values = np.concatenate([[], *(line.values.ravel() for line in lines if line.entity in panel.entities)])
    values = values[np.isfinite(values)]
    return readable(values) if values.size else None


def _slip_range(runs: Sequence[Traces]) -> tuple[float, float]:
    """_SLIP_RANGE, extended if robots slip more than that for more than moments."""
    slips = [traces.identified if traces.slip is None else traces.slip for traces in runs]
    columns = [column[np.isfinite(column)] for slip in slips if slip is not None for column in slip.T]
    shares = [np.percentile(column, (_RARE, 100 - _RARE)) for column in columns if column.size]
    ends = np.array([_SLIP_RANGE, *shares])
    inside = ends.min() >= _SLIP_RANGE[0] and ends.max() <= _SLIP_RANGE[1]
    return _SLIP_RANGE if inside else readable(ends)


def readable(values: Array) -> tuple[float, float]:
    """The range of an axis with zero, all values, and two labels or more, at powers of ten, as many as have room."""
    low, high = min(float(values.min()), 0.0), max(float(values.max()), 0.0)
    margin = 0.08 * max(high - low, 1e-3)
    low, high = low - margin, high + margin

    def labels(power: float) -> int:
        return int(np.floor(high / power) - np.ceil(low / power)) + 1

    power = 10.0 ** np.floor(np.log10(high - low))
    if labels(power) > _MAX_LABELS:
        power *= 10
    if labels(power) < 2:
        low, high = (low, 1.08 * power) if high > -low else (-1.08 * power, high)
    return float(low), float(high)


def compared_series(traces: Traces, name: str, colour: str, pale: str) -> list[Series]:
    """The lines of a run beside others, in its own colour."""
    kept = {entity for panel in COMPARED for entity in panel.entities}
    found = []
    for series in series_of(traces):
        if series.entity in kept:
            names, colours = (
                ((name,), (colour,))
                if len(series.names) == 1
                else ((f"{name}, left", f"{name}, right"), (colour, pale))
            )
            found.append(Series(series.entity, series.values, names, colours))
    truth, asked = traces.log.truth, traces.log.twist_command
    yaw = [(f"{name}, true", colour, truth.twist[:, 2])] if truth is not None else []
    yaw += [(f"{name}, commanded", pale, asked[:, 1])] if asked is not None else []
    if yaw:
        names, colours, values = zip(*yaw, strict=True)
        found.append(Series("twist/yaw", np.stack(values, axis=-1), names, colours))
    return found
