"""What is plotted over time: entities, names with units, colours, and the panels that they are gathered in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from experiments.colours import BLUE, GREEN, ORANGE, VERMILLION
from experiments.recording.traces import Traces
from trackslip.kinematics import Array

_PALE = {GREEN: "#8fd3bd", ORANGE: "#f3cf86", BLUE: "#8fbfe0", VERMILLION: "#f0b08a"}
_LEFT, _RIGHT = GREEN, ORANGE
_GREY = "#9a9a9a"


@dataclass(frozen=True)
class Series:
    """A few lines of a panel."""

    entity: str
    values: Array  # (T, n), NaN for a gap
    names: tuple[str, ...]
    colours: tuple[str, ...]
    width: float = 1.5


@dataclass(frozen=True)
class Panel:
    """A plot over time."""

    title: str
    entities: tuple[str, ...]
    range: tuple[float, float] | None = None
    height: float = 1.0
    """Beside the others'."""
    legend: bool = True


SLIP_TRUE, SLIP_IDENTIFIED, SLIP_LAW = "slip/true", "slip/identified", "slip/law"
_SLIP_RANGE = (-0.25, 0.20)
_DISTANCE = "Distance from the reference [mm]"
PANELS = (
    Panel("Slip [-]", (SLIP_IDENTIFIED, SLIP_TRUE, SLIP_LAW), _SLIP_RANGE, 1.7),
    Panel("Sprocket speed [rad/s]", ("sprocket/set_point", "sprocket/measured")),
    Panel("Position error [mm]", ("error/distance", "error/position")),
    Panel("Heading error [deg]", ("error/heading",)),
    Panel("Twist [m/s, rad/s]", ("twist/asked", "twist/true")),
    Panel("Load on the tracks [N]", ("contact/load", "contact/traction")),
)
"""Of one run."""
COMPARED = (
    Panel(_DISTANCE, ("error/distance",), height=2.0),
    Panel("Heading error [deg]", ("error/heading",), legend=False),
    Panel("True slip [-], pale: right track", (SLIP_TRUE,), _SLIP_RANGE, legend=False),
    Panel("Identified slip [-], pale: right track", (SLIP_IDENTIFIED,), _SLIP_RANGE, legend=False),
    Panel("Sprocket speed [rad/s], pale: right track", ("sprocket/measured",), legend=False),
    Panel("Yaw rate [rad/s], pale: asked for", ("twist/yaw",), legend=False),
)
"""Of several runs; their colours are the same in all."""


def series_of(traces: Traces) -> list[Series]:
    """All that there is to plot of a run."""
    log, found = traces.log, []

    def add(entity: str, values: Array | None, names: tuple[str, ...], colours: tuple[str, ...], width: float) -> None:
        if values is not None:
            found.append(Series(entity, values, names, colours, width))

    sides, pale = (_LEFT, _RIGHT), (_PALE[_LEFT], _PALE[_RIGHT])
    add(SLIP_IDENTIFIED, traces.identified, ("left, identified", "right, identified"), pale, 1.0)
    add(SLIP_TRUE, traces.slip, ("left, true", "right, true"), sides, 1.5)
    law = traces.law_name
    add(SLIP_LAW, traces.law, (f"left, law {law}", f"right, law {law}"), (BLUE, VERMILLION), 4.0)
    add("sprocket/set_point", log.command, ("left, set point", "right, set point"), pale, 3.0)
    add("sprocket/measured", log.omega, ("left, measured", "right, measured"), sides, 1.2)
    if traces.error is not None and traces.distance is not None:
        millimetres = 1e3 * traces.error[:, :2]
        add("error/distance", 1e3 * traces.distance[:, None], ("distance",), (_GREY,), 3.0)
        add("error/position", millimetres, ("ahead", "to the left"), (BLUE, VERMILLION), 1.5)
        add("error/heading", np.degrees(traces.error[:, 2:]), ("heading",), (BLUE,), 1.5)
    pale_twist = (_PALE[BLUE], _PALE[VERMILLION])
    add("twist/asked", log.twist_command, ("v asked for [m/s]", "w asked for [rad/s]"), pale_twist, 3.0)
    if log.truth is not None:
        add("twist/true", log.truth.twist[:, [0, 2]], ("v true [m/s]", "w true [rad/s]"), (BLUE, VERMILLION), 1.2)
        add("contact/traction", log.truth.traction, ("left, traction", "right, traction"), pale, 1.2)
        if log.truth.contact is not None:
            left = log.truth.contact.shape[1] // 2  # the pads stand left before right
            load = np.stack([part.sum(axis=1) for part in np.split(log.truth.contact[..., 2], [left], axis=1)], axis=-1)
            add("contact/load", load, ("left, load", "right, load"), sides, 1.5)
    return found


def compared_panels(runs: Sequence[Traces]) -> list[Panel]:
    """COMPARED, with the distances' range such that they can be told apart once the transients are over."""
    late = [traces.late_distance for traces in runs if traces.late_distance is not None]
    if not late:
        return list(COMPARED)
    highest = 1.2e3 * max(float(distance.max()) for distance in late) + 1.0
    return [replace(COMPARED[0], range=(0.0, highest)), *COMPARED[1:]]


def compared_series(traces: Traces, name: str, colour: str, pale: str) -> list[Series]:
    """What is plotted of a run beside others, in its own colour."""
    kept = {entity for panel in COMPARED for entity in panel.entities}
    found = []
    for series in series_of(traces):
        if series.entity in kept:
            two = len(series.names) == 2
            names = (f"{name}, left", f"{name}, right") if two else (name,)
            found.append(
                Series(series.entity, series.values, names, (colour, pale) if two else (colour,), series.width)
            )
    truth, asked = traces.log.truth, traces.log.twist_command
    yaw = [(f"{name}, true", colour, truth.twist[:, 2])] if truth is not None else []
    yaw += [(f"{name}, asked", pale, asked[:, 1])] if asked is not None else []
    if yaw:
        names, colours, values = zip(*yaw, strict=True)
        found.append(Series("twist/yaw", np.stack(values, axis=-1), names, colours))
    return found
