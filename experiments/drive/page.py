"""The page on a drive over a course, with its figures and table."""

import shlex
from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.markers import TICKLEFT, TICKRIGHT

from experiments.common.colours import BLUE, GREY, ORANGE
from experiments.common.page import Answer, Page, Pictures, Plot, Section
from experiments.common.results import PICTURES_FOLDER
from experiments.common.style import styled, thin
from experiments.common.table import Table, number, pair, percent
from experiments.drive.course import DrivenCourse

SENTENCES: Final = {
    "reached": "It crossed the course",
    "tipped": "It tipped over",
    "stuck": "It got stuck",
    "fell": "It fell off the course",
    "exploded": "The simulation broke down",
    "time": "It ran out of time",
    "stopped": "The driver stopped",
}
_PICTURES: Final = 12  # approximate number of pictures on the page
_EARTH: Final = "#b9b2a6"  # colour of the ground
_TABLE_NOTE: Final = (
    "Slip is weighted by the distance that the belt runs. Work is negative where a "
    "belt holds the robot back."
)
_SLIP_CAPTION: Final = (
    "Every tick is a row of the run. The slope is that of the line that best fits the ground "
    "under the tracks, positive uphill; slip is positive where the belt runs ahead. The recording "
    "has slip, loads and attitude over time."
)


def page(
    run: DrivenCourse,
    answer: Answer,
    table: Table,
    manifest: Mapping[str, Any],
    command: str,
    pictures: Sequence[Path],
) -> Page:
    """The page on a drive, which shows some of the `pictures`."""
    stride = len(pictures) // _PICTURES + 1
    shown = [f"{PICTURES_FOLDER}/{file.name}" for file in pictures[::stride]]
    gallery = Pictures(shown, "The robot on the course") if shown else None
    profile = Plot("drive_profile", _profile(run), "Path of the chassis")
    slip = Plot("drive_slip_over_slope", _slip_over_slope(run), "Slip against slope", _SLIP_CAPTION)
    return Page(
        title=f"{run.robot.name} on {manifest['config']['course']}",
        command=command,
        manifest=manifest,
        answer=answer,
        sections=(
            Section("Over the course", (profile, gallery)),
            Section("Slip", (slip, table)),
        ),
    )


def answer(
    run: DrivenCourse, result: Mapping[str, Any], out: Path, notes: Sequence[str] = ()
) -> Answer:
    """The answer: how and where the drive ended, with its distance, slip and work; and `notes` on
    the robot.
    """
    heading = f"{SENTENCES[run.outcome]} after {result['duration']:.1f} s"
    if run.outcome != "reached":
        heading += f", {result['remaining']:.2f} m before the end"
    lines = [_end(run), *(f"{note}." for note in notes)]
    warnings = [] if run.saturation is None else [str(run.saturation)]
    view = f"trackslip view {shlex.quote(str(out))}"
    return Answer(heading, _facts(run, result), lines, warnings=warnings, next=(view,))


def _end(run: DrivenCourse) -> str:
    """Where the drive ended, and how the robot stood there."""
    x = number(run.state.position[-1, 0], 2, "m")
    pitch, roll, slope = (_whole_degrees(angle) for angle in run.attitude[-1])
    return (
        f"It ended at x = {x} on a slope of {slope}, with a pitch of {pitch} and a roll of {roll}."
    )


def _whole_degrees(angle: float) -> str:
    """An angle [deg] as text, without the sign of a zero."""
    return f"{number(_rounded(angle, 0), 0)}°"


def _rounded(value: float, digits: int) -> float:
    """A rounded number, with 0 in place of -0."""
    return round(float(value), digits) + 0.0


def _facts(run: DrivenCourse, result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Distance, height, slip, attitude, penetration and work of a drive."""
    slips = [percent(result["tracks"][k]["slip"]) for k in run.sides]
    pitch = degrees(result["max_pitch"])
    roll = degrees(result["max_roll"])
    deepest = 1e3 * result["max_penetration"]
    usual = 1e3 * result["penetration_p99"]
    return [
        ("distance driven", number(result["way"], 2, "m")),
        ("height gained", number(_rounded(result["climbed"], 2), 2, "m")),
        ("slip, left | right track", pair(slips)),
        ("largest pitch and roll", f"{pitch:.1f}° and {roll:.1f}°"),
        ("penetration", f"up to {deepest:.2f} mm, 99 %: {usual:.2f} mm"),
        ("work of the belts", number(result["energy"], 0, "J")),
    ]


def tracks_table(result: Mapping[str, Any]) -> Table:
    """A table with a row per track."""
    header = ("track", "slip", "slip, p95", "touching", "penetration [mm]", "work [J]")
    rows = [_track_row(track) for track in result["tracks"]]
    return Table("Tracks", header, rows, note=_TABLE_NOTE)


def _track_row(track: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        track["name"].replace("_", " "),
        percent(track["slip"]),
        percent(track["slip_p95"]),
        percent(track["touching"]),
        number(1e3 * track["max_penetration"], 2),
        number(track["work"], 0),
    )


@styled
def _profile(run: DrivenCourse) -> Figure:
    """The ground along the course, and the path of the chassis' frame over it."""
    figure = Figure(figsize=(9.0, 2.6), layout="constrained")
    axes = figure.subplots()
    position = run.state.position
    course = run.course
    low, high = course.bounds[:, 0]
    x = np.linspace(low, high, 2000)
    height = course.height(x, np.zeros_like(x))
    axes.fill_between(x, height, course.floor, facecolor=_EARTH, lw=0, label="ground at y = 0")
    axes.plot(position[:, 0], position[:, 2], color=BLUE, lw=1.2, label="chassis")
    axes.axvline(run.goal, color=GREY, lw=0.8, ls="--", label="end of the course")
    axes.set(xlabel="x [m]", ylabel="z [m]", xlim=(low, high))
    figure.legend(ncols=3, loc="outside upper left")
    return figure


@styled
def _slip_over_slope(run: DrivenCourse) -> Figure:
    """Slip of the chassis' tracks against the slope of the ground under them."""
    figure = Figure(figsize=(5.4, 3.2), layout="constrained")
    axes = figure.subplots()
    shown = thin(len(run.time), 1500)
    slope = np.degrees(run.slope[shown])
    slip = run.contact.slip[shown]
    tick: dict[str, Any] = {"ls": "", "alpha": 0.5}
    axes.plot(slope, slip[:, 0], marker=TICKLEFT, color=BLUE, label="left", **tick)
    axes.plot(slope, slip[:, 1], marker=TICKRIGHT, color=ORANGE, label="right", **tick)
    axes.axhline(0, color=GREY, lw=0.8)
    axes.set(xlabel="slope of the ground along the robot [deg]", ylabel="slip [-]")
    known = run.contact.slip[np.isfinite(run.contact.slip)]
    if known.size:  # without the rarest slips, from belts that hardly move
        low, high = np.quantile(known, (0.01, 0.99))
        axes.set_ylim(low - 0.05, high + 0.05)
    legend = figure.legend(ncols=2, loc="outside upper left", handlelength=0.8)
    for entry in legend.get_lines():
        entry.set(alpha=1.0, markersize=8.0, markeredgewidth=3.0)
    return figure
