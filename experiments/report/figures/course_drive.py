"""Figures of a drive over a course: the profile, slip against slope, and everything over time."""

import numpy as np
from matplotlib.figure import Figure

from experiments.course.results import slip_by_slope
from experiments.course.run import CourseRun
from experiments.report.colours import BLUE, GREY, ORANGE
from experiments.report.figures.style import styled, subplots, thin
from sim.terrain import Course

_TRACKS = ((BLUE, "o", "left"), (ORANGE, "^", "right"))
_SLIP = (-0.5, 1.0)  # range of slips that is drawn [-]
_BIN = np.radians(3.0)  # width of bins of slope [rad]
_GROUND = "#b9b2a6"


@styled
def profile(run: CourseRun, course: Course) -> Figure:
    """The ground along the course, and the way of the chassis' frame over it."""
    figure, axes = subplots(2.6)
    position = run.state.position
    low, high = course.bounds[0, 0], course.bounds[1, 0]
    x = np.linspace(low, high, 2000)
    height = course.height(x, np.zeros_like(x))
    axes.fill_between(x, height, course.floor, color=_GROUND, lw=0, label="ground at y = 0")
    axes.plot(position[:, 0], position[:, 2], color=BLUE, lw=1.2, label="chassis")
    axes.plot(*position[-1, [0, 2]], "o", color=BLUE, ms=5)
    axes.axvline(course.goal, color=GREY, lw=0.8, ls="--", label="end of the course")
    axes.set(xlabel="x [m]", ylabel="z [m]", xlim=(low, high), title=f"{run.outcome}, {run.time[-1]:.1f} s")
    axes.legend(ncols=3, loc="upper left")
    axes.set_ylim(course.floor, float(max(height.max(), position[:, 2].max())) + 0.35)
    return figure


@styled
def slip_over_slope(run: CourseRun) -> Figure:
    """Slip of the chassis' tracks against the slope of the ground under them."""
    figure, axes = subplots(3.4)
    degrees = np.degrees(run.slope)
    for k, (colour, marker, name) in enumerate(_TRACKS):
        known = np.isfinite(run.slip[:, k])
        shown = thin(int(known.sum()), 1500)
        axes.plot(degrees[known][shown], run.slip[known, k][shown], ".", color=colour, ms=2.5, alpha=0.35, mew=0)
        middle, quartiles = slip_by_slope(run.slope, run.slip[:, k], _BIN)
        if len(middle):
            median = quartiles[:, 0]
            bars = np.abs(quartiles[:, 1:].T - median)
            offset = 0.25 * (1 if k else -1)
            axes.errorbar(
                np.degrees(middle) + offset, median, bars, color=colour, marker=marker, ms=4, lw=1.2, label=name
            )
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set(xlabel="slope of the ground along the robot [deg]", ylabel="slip [-]", ylim=_SLIP)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper left", ncols=2)
    return figure


@styled
def over_time(run: CourseRun) -> Figure:
    """Attitude, flippers, slip, load and penetration over time."""
    figure, panels = subplots(8.2, 5, down=0.35, sharex=True)
    shown = thin(len(run.time), 2000)
    time, state = run.time[shown], run.state
    for values, colour, name in (
        (state.pitch, BLUE, "pitch"),
        (state.roll, ORANGE, "roll"),
        (run.slope, GREY, "slope"),
    ):
        panels[0].plot(time, np.degrees(values)[shown], color=colour, lw=1.1, label=name)
    for k, name in enumerate(run.flippers):
        panels[1].plot(time, np.degrees(state.flippers[shown, k]), lw=1.1, label=name.replace("_", " "))
    for k, (colour, _, name) in enumerate(_TRACKS):
        panels[2].plot(time, run.slip[shown, k], color=colour, lw=0.8, label=name)
        panels[3].plot(time, run.load[shown, k], color=colour, lw=0.8, label=name)
    panels[4].plot(time, 1e3 * run.depth.max(axis=1)[shown], color=BLUE, lw=0.8)
    titles = ("attitude [deg]", "flippers [deg]", "slip [-]", "load [N]", "penetration [mm]")
    for panel, title in zip(panels, titles, strict=True):
        panel.set_ylabel(title)
        if panel.get_legend_handles_labels()[0]:
            panel.legend(loc="upper left", ncols=4, bbox_to_anchor=(0.0, 1.18), borderaxespad=0.0)
    panels[2].set_ylim(_SLIP)
    panels[4].set_xlabel("t [s]")
    return figure
