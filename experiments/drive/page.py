"""The page, the figures and the table of a drive over a course."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.common.colours import BLUE, GREY, ORANGE
from experiments.common.formats import number, percent
from experiments.common.page import Page, Pictures, Plot, Section
from experiments.common.style import styled, subplots, thin
from experiments.common.table import Table
from experiments.drive.course import DrivenCourse
from experiments.drive.results import slip_by_slope
from sim.terrain import Course
from trackslip.kinematics import Array

SENTENCES = {
    "reached": "It crossed the course",
    "tipped": "It tipped over",
    "stuck": "It got stuck",
    "fell": "It fell off the course",
    "exploded": "The simulation broke down",
    "time": "It ran out of time",
    "stopped": "Its driver stopped it",
}
_EARTH = "#b9b2a6"  # an area
_TRACKS = ((BLUE, "o", "left", -0.25), (ORANGE, "^", "right", 0.25))  # with the offset of a bin's symbol [deg]
_SLIP = (-0.5, 1.0)  # largest range of slips that is drawn [-]
_RARE = 0.01  # share of the slips that may lie outside the axes on either side
_BIN = 3.0  # width of bins of slope [deg]
_HEADER = ("track", "slip", "slip, p95", "touching", "penetration [mm]", "work [J]")
_NOTE = (
    "The slip of a track is its mean weighted by the distance that the belt runs. Work is traction times belt "
    "speed; it is negative where the robot drives down and its belts hold it back."
)
_SLIP_CAPTION = (
    "Every dot is a row of the run; symbols are medians with quartiles in bins of 3°. The slope is that of the line "
    "that best fits the ground under the tracks, positive uphill; slip is positive where the belt runs ahead."
)


def sentences(result: Mapping[str, Any]) -> tuple[str, str, str]:
    """Outcome, motion and tracks of a drive, from its summary."""
    ended = f"{SENTENCES[result['outcome']]} after {result['duration']:.1f} s"
    if result["outcome"] != "reached":
        ended += f", {result['remaining']:.2f} m before the end"
    climbed = number(round(result["climbed"], 2) + 0.0, 2)
    return (
        f"{ended}.",
        f"distance driven {result['way']:.2f} m, height gained {climbed} m, "
        f"pitch up to {degrees(result['max_pitch']):.1f} deg, roll up to {degrees(result['max_roll']):.1f} deg",
        f"penetration up to {1e3 * result['max_penetration']:.2f} mm (99 %: {1e3 * result['penetration_p99']:.2f} mm), "
        f"work of the belts {number(result['energy'], 0)} J",
    )


def tracks_table(result: Mapping[str, Any]) -> Table:
    """A row per track."""
    rows = [
        (
            one["name"].replace("_", " "),
            *(percent(one[name]) for name in ("slip", "slip_p95", "touching")),
            number(1e3 * one["max_penetration"], 2),
            number(one["work"], 0),
        )
        for one in result["tracks"]
    ]
    return Table("Tracks", _HEADER, rows, note=_NOTE)


def page(
    run: DrivenCourse,
    result: Mapping[str, Any],
    course: Course,
    manifest: Mapping[str, Any],
    command: str,
    pictures: Sequence[str],
) -> Page:
    """The page of a drive; `pictures` are files in its folder."""
    ended, *more = sentences(result)
    way = Plot(
        "drive_profile", profile(run, course), "Path of the chassis", "The ground along the middle of the course.", ""
    )
    slip = Plot("drive_slip_over_slope", slip_over_slope(run), "Slip against slope", _SLIP_CAPTION, "")
    time = Plot(
        "drive_over_time",
        over_time(run),
        "Attitude, flippers, slip, load and penetration",
        "Slip and load of the chassis' tracks.",
        "",
    )
    return Page(
        title=f"{manifest['robot']['name']} on {manifest['config']['course']}",
        command=command,
        manifest=manifest,
        intro=(ended, *(f"{line[0].upper()}{line[1:]}." for line in more)),
        sections=(
            Section("Over the course", (way, Pictures(pictures, "The robot on the course") if pictures else None)),
            Section("Slip", (slip, tracks_table(result))),
            Section("Over time", (time,)),
        ),
    )


def slip_limits(slip: Array) -> tuple[float, float]:
    """Limits of an axis of slips (T, k), NaN where a belt stands still: all but the rarest, with room around them."""
    low, high = np.nanquantile(slip, (_RARE, 1 - _RARE)) if np.isfinite(slip).any() else (0.0, 0.0)
    room = 0.02 + 0.15 * (high - low)
    return max(_SLIP[0], float(low - room)), min(_SLIP[1], float(high + room))


@styled
def profile(run: DrivenCourse, course: Course) -> Figure:
    """The ground along the course, and the way of the chassis' frame over it."""
    figure, axes = subplots(2.6)
    position = run.state.position
    low, high = course.bounds[0, 0], course.bounds[1, 0]
    x = np.linspace(low, high, 2000)
    height = course.height(x, np.zeros_like(x))
    axes.fill_between(x, height, course.floor, facecolor=_EARTH, lw=0, label="ground at y = 0")
    axes.plot(position[:, 0], position[:, 2], color=BLUE, lw=1.2, label="chassis")
    axes.plot(*position[-1, [0, 2]], "o", color=BLUE, ms=5)
    axes.axvline(course.goal, color=GREY, lw=0.8, ls="--", label="end of the course")
    axes.set(xlabel="x [m]", ylabel="z [m]", xlim=(low, high), title=f"{run.outcome}, {run.time[-1]:.1f} s")
    axes.set_ylim(course.floor, float(max(height.max(), position[:, 2].max())) + 0.35)
    axes.legend(ncols=3, loc="upper left")
    return figure


@styled
def slip_over_slope(run: DrivenCourse) -> Figure:
    """Slip of the chassis' tracks against the slope of the ground under them."""
    figure, axes = subplots(3.4)
    slope, shown = np.degrees(run.slope), thin(len(run.time), 1500)
    for k, (colour, marker, name, offset) in enumerate(_TRACKS):
        axes.plot(slope[shown], run.slip[shown, k], ".", color=colour, ms=2.5, alpha=0.35, mew=0)
        middle, quartiles = slip_by_slope(slope, run.slip[:, k], _BIN)
        median, bars = quartiles[:, 0], np.abs(quartiles[:, 1:] - quartiles[:, :1]).T
        axes.errorbar(middle + offset, median, bars, color=colour, marker=marker, ms=4, lw=1.2, label=name)
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set(xlabel="slope of the ground along the robot [deg]", ylabel="slip [-]", ylim=slip_limits(run.slip))
    axes.legend(loc="upper left", ncols=2)
    return figure


@styled
def over_time(run: DrivenCourse) -> Figure:
    """Attitude, flippers, slip, load and penetration over time."""
    figure, panels = subplots(8.2, 5, sharex=True)
    shown, state = thin(len(run.time), 2000), run.state
    sides = [(name, colour) for colour, _, name, _ in _TRACKS]
    flippers = [(name.replace("_", " "), None) for name in run.flippers]
    attitude = np.degrees(np.stack([state.pitch, state.roll, run.slope], axis=-1))
    contents: list[tuple[str, Array, Sequence[tuple[str, str | None]]]] = [
        ("attitude [deg]", attitude, (("pitch", BLUE), ("roll", ORANGE), ("slope", GREY))),
        ("flippers [deg]", np.degrees(state.flippers), flippers),
        ("slip [-]", run.slip, sides),
        ("load [N]", run.load, sides),
        ("penetration [mm]", 1e3 * run.depth.max(axis=1, keepdims=True), (("largest", BLUE),)),
    ]
    for panel, (title, values, lines) in zip(panels, contents, strict=True):
        for k, (name, colour) in enumerate(lines):
            # dashes over wider lines, as the two sides often coincide
            look: dict[str, Any] = {"lw": 0.9, "ls": (0, (4, 4))} if k % 2 else {"lw": 1.6}
            panel.plot(run.time[shown], values[shown, k], color=colour, label=name, **look)
        panel.set_ylabel(title)
        if lines:
            panel.legend(loc="upper left", ncols=4, bbox_to_anchor=(0.0, 1.18), borderaxespad=0.0)
    panels[2].set_ylim(slip_limits(run.slip))
    panels[4].set_xlabel("t [s]")
    return figure
