"""Charts of a run: its path on a map, and errors, slips and sprocket speeds over time."""

from dataclasses import replace
from typing import Final

import numpy as np

from experiments.common import style
from experiments.common.chart import WIDE, Chart, Curve, dots, road, start_of
from experiments.common.colours import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION
from experiments.common.traces import Traces
from trackslip.kinematics import Array

_HEIGHT: Final = 1.9  # of a chart over time [in]
_LINES: Final = 1000  # largest number of points in a line
_DOTS: Final = 300  # largest number of measured poses on a map
_COMMON: Final = (0.5, 99.5)  # percentiles of the slips that their axis shows
_LEAST_SPAN: Final = 0.02  # least range of the slips' axis [-]


def path_chart(run: Traces, title: str = "Path") -> Chart:
    """The reference, if there is one, the true path and the measured poses of a run."""
    curves = []
    if run.reference is not None:
        curves.append(road(run.reference[style.thin(len(run.time))]))
    known = run.estimate[np.isfinite(run.estimate[:, 0])]
    if len(known):
        curves.append(dots(known[style.thin(len(known), _DOTS)], "measured", VERMILLION, 3.0))
    if run.log.truth is not None:
        rows = style.thin(len(run.time), _LINES)
        x, y, _ = run.pose[rows].T
        curves.append(Curve(x, y, "driven", BLUE))
    curves.append(start_of(run.pose))
    return Chart(title, "x [m]", "y [m]", curves, 4.6, is_map=True)


def errors_chart(run: Traces) -> Chart | None:
    """Errors of position and heading over time; None without a reference."""
    if run.error is None:
        return None
    rows = style.thin(len(run.time), _LINES)
    time = run.time[rows]
    ahead, left, heading = run.error[rows].T
    millimetres = [
        Curve(time, 1e3 * np.hypot(ahead, left), "distance", BLACK),
        Curve(time, 1e3 * ahead, "ahead", GREEN, 1.0),
        Curve(time, 1e3 * left, "to the left", ORANGE, 1.0),
    ]
    degrees = [Curve(time, np.degrees(heading), "", BLUE, 1.0)]
    position = Chart("Errors", "time [s]", "position [mm]", millimetres, _HEIGHT, has_zero=True)
    turned = replace(position, title="", ylabel="heading [°]", curves=degrees)
    return replace(position, below=[turned])


def slip_chart(run: Traces) -> Chart | None:
    """Slips of both tracks over time, true and as compensation assumes; None if none is known."""
    rows = style.thin(len(run.time), _LINES)
    time = run.time[rows]
    curves = []
    shown: list[Array] = [np.zeros(1)]
    for side, colour in enumerate((BLUE, ORANGE)):
        name = ("left", "right")[side]
        if run.slip is not None:
            slip = run.slip[rows, side]
            curves.append(Curve(time, slip, f"{name}, true", colour, 0.9))
            shown.append(slip)
        if run.assumed is not None:
            assumed = run.assumed[rows, side]
            curves.append(Curve(time, assumed, f"{name}, assumed", colour, 2.0, "--"))
            shown.append(assumed)
    if not curves:
        return None
    limits = _limits(np.concatenate(shown))
    return Chart("Slip", "time [s]", "slip [–]", curves, 3.0, WIDE, ylim=limits, has_zero=True)


def _limits(values: Array) -> tuple[float, float]:
    """Limits of an axis that shows most of some values (n,), which may be NaN."""
    low, high = np.nanpercentile(values, _COMMON)
    room = max(0.15 * (high - low), _LEAST_SPAN / 2)
    return float(low - room), float(high + room)


def speeds_chart(run: Traces) -> Chart:
    """Set points, if there are any, and measured speeds of both sprockets over time."""
    rows = style.thin(len(run.time), _LINES)
    time = run.time[rows]
    curves = []
    for side, colour in enumerate((BLUE, ORANGE)):
        name = ("left", "right")[side]
        if run.log.command is not None:
            command = run.log.command[rows, side]
            curves.append(Curve(time, command, f"{name}, set point", GREY, 2.5))
        curves.append(Curve(time, run.log.omega[rows, side], name, colour, 1.0))
    return Chart("Sprockets", "time [s]", "speed [rad/s]", curves, 3.0, WIDE, has_zero=True)
