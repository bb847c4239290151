"""The page, the figures and the table of a drive over a course."""

import shlex
from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.common.colours import BLUE, GREY, ORANGE
from experiments.common.manifest import relative
from experiments.common.page import Answer, Page, Pictures, Plot, Section
from experiments.common.style import styled, thin
from experiments.common.table import Table, number, pair, percent
from experiments.drive.course import PERIOD, DrivenCourse
from experiments.drive.results import slip_by_slope
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
_BIN = 3.0  # width of bins of slope [deg]
_NOTE = (
    "The slip of a track is its mean weighted by the distance that the belt runs. Work is traction times belt "
    "speed; it is negative where the robot drives down and its belts hold it back."
)
_SLIP_CAPTION = (
    "Every dot is a row of the run; symbols are medians with quartiles in bins of 3°. The slope is that of the line "
    "that best fits the ground under the tracks, positive uphill; slip is positive where the belt runs ahead."
)


def answer(run: DrivenCourse, result: Mapping[str, Any], out: Path) -> Answer:
    """How the drive ended, what it took, and where it ended; `result` is its summary, `out` its folder."""
    heading = f"{SENTENCES[run.outcome]} after {result['duration']:.1f} s"
    if run.outcome != "reached":
        heading += f", {result['remaining']:.2f} m before the end"
    pitch, roll, slope = (f"{number(angle, 0)}°" for angle in np.round(np.degrees(run.attitude[-1])) + 0.0)
    x, speed = number(run.state.position[-1, 0], 2, "m"), result["way"] / max(result["duration"], PERIOD)
    lines = [f"It ended at x = {x} on a slope of {slope}, with a pitch of {pitch} and a roll of {roll}."]
    if run.outcome == "time" and speed > 0:
        lines.append(f"At its mean speed, {speed:.2f} m/s, it would need {result['remaining'] / speed:.0f} s more.")
    deepest, usual = (f"{1e3 * result[name]:.2f} mm" for name in ("max_penetration", "penetration_p99"))
    facts = (
        ("distance driven", number(result["way"], 2, "m")),
        ("height gained", number(round(result["climbed"], 2) + 0.0, 2, "m")),
        ("slip, left | right track", pair([percent(track["slip"]) for track in result["tracks"][:2]])),
        ("largest pitch and roll", f"{degrees(result['max_pitch']):.1f}° and {degrees(result['max_roll']):.1f}°"),
        ("penetration", f"up to {deepest}, 99 %: {usual}"),
        ("work of the belts", number(result["energy"], 0, "J")),
    )
    return Answer(heading, facts, lines, next=(f"trackslip view {shlex.quote(relative(str(out)))}",))


def tracks_table(result: Mapping[str, Any]) -> Table:
    """A row per track."""
    header = ("track", "slip", "slip, p95", "touching", "penetration [mm]", "work [J]")
    rows = [
        (
            track["name"].replace("_", " "),
            *(percent(track[name]) for name in ("slip", "slip_p95", "touching")),
            number(1e3 * track["max_penetration"], 2),
            number(track["work"], 0),
        )
        for track in result["tracks"]
    ]
    return Table("Tracks", header, rows, note=_NOTE)


def page(
    run: DrivenCourse,
    result: Mapping[str, Any],
    answer: Answer,
    manifest: Mapping[str, Any],
    command: str,
    pictures: Sequence[str],
) -> Page:
    """The page of a drive; `pictures` are files in its folder."""
    profile = Plot("drive_profile", _profile(run), "Path of the chassis", "The ground along the middle of the course.")
    slip = Plot("drive_slip_over_slope", _slip_over_slope(run), "Slip against slope", _SLIP_CAPTION)
    time = Plot("drive", _over_time(run), "Over time", "Slip and load of the chassis' tracks.")
    return Page(
        title=f"{run.robot.name} on {manifest['config']['course']}",
        command=command,
        manifest=manifest,
        answer=answer,
        sections=(
            Section("Over the course", (profile, Pictures(pictures, "The robot on the course") if pictures else None)),
            Section("Slip", (slip, tracks_table(result))),
            Section("Over time", (time,)),
        ),
    )


def _axes(width: float, height: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots()


def _limit_slip(axes: Axes, slip: Array) -> None:
    """Show all slips (T, k) but the rarest, which are those of belts that hardly move."""
    known = slip[np.isfinite(slip)]
    if known.size:
        low, high = np.quantile(known, (0.01, 0.99))
        axes.set_ylim(low - 0.05, high + 0.05)


@styled
def _profile(run: DrivenCourse) -> Figure:
    """The ground along the course, and the path of the chassis' frame over it."""
    figure, axes = _axes(9.0, 2.6)
    position, course = run.state.position, run.course
    low, high = course.bounds[0, 0], course.bounds[1, 0]
    x = np.linspace(low, high, 2000)
    height = course.height(x, np.zeros_like(x))
    axes.fill_between(x, height, course.floor, facecolor=_EARTH, lw=0, label="ground at y = 0")
    axes.plot(position[:, 0], position[:, 2], color=BLUE, lw=1.2, label="chassis")
    axes.plot(*position[-1, [0, 2]], "o", color=BLUE, ms=5)
    axes.axvline(course.goal, color=GREY, lw=0.8, ls="--", label="end of the course")
    axes.set(xlabel="x [m]", ylabel="z [m]", xlim=(low, high))
    figure.legend(ncols=3, loc="outside upper left")
    return figure


@styled
def _slip_over_slope(run: DrivenCourse) -> Figure:
    """Slip of the chassis' tracks against the slope of the ground under them."""
    figure, axes = _axes(5.4, 3.2)
    slope, shown = np.degrees(run.slope), thin(len(run.time), 1500)
    for k, (colour, marker, name, offset) in enumerate(_TRACKS):
        axes.plot(slope[shown], run.slip[shown, k], ".", color=colour, ms=2.5, alpha=0.35, mew=0)
        middle, quartiles = slip_by_slope(slope, run.slip[:, k], _BIN)
        median, bars = quartiles[:, 0], np.abs(quartiles[:, 1:] - quartiles[:, :1]).T
        axes.errorbar(middle + offset, median, bars, color=colour, marker=marker, ms=4, lw=1.2, label=name)
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set(xlabel="slope of the ground along the robot [deg]", ylabel="slip [-]")
    _limit_slip(axes, run.slip)
    figure.legend(ncols=2, loc="outside upper left")
    return figure


@styled
def _over_time(run: DrivenCourse) -> list[Figure]:
    """Attitude, flippers, slip, load and penetration over time."""
    shown, sides = thin(len(run.time), 2000), ("left", "right")
    flippers = [name.replace("_", " ") for name in run.flippers]
    contents: list[tuple[str, str, Array, Sequence[str]]] = [
        ("Attitude", "angle [deg]", np.degrees(run.attitude), ("pitch", "roll", "slope")),
        ("Flippers", "angle [deg]", np.degrees(run.state.flippers), flippers),
        ("Slip", "slip [-]", run.slip, sides),
        ("Load", "load [N]", run.load, sides),
        ("Penetration", "largest depth [mm]", 1e3 * run.depth.max(axis=1, keepdims=True), ("all tracks",)),
    ]
    figures = []
    for title, label, values, names in (panel for panel in contents if panel[-1]):
        figure, axes = _axes(4.6, 2.8)
        for k, name in enumerate(names):
            # dashes over wider lines, as the two sides often coincide
            look: dict[str, Any] = {"lw": 0.9, "ls": (0, (4, 4))} if k % 2 else {"lw": 1.6}
            axes.plot(run.time[shown], values[shown, k], color=(BLUE, ORANGE, GREY, "black")[k % 4], label=name, **look)
        axes.set(title=title, xlabel="t [s]", ylabel=label)
        if title == "Slip":
            _limit_slip(axes, values)
        figure.legend(ncols=2, loc="outside lower left")
        figures.append(figure)
    return figures
