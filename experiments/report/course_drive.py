"""The page of a drive over a course, and its tables."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

from experiments.driving.course_run import CourseRun
from experiments.measuring.course_drive import DriveResult
from experiments.report.figures import course_drive as figures
from experiments.report.formats import number, percent
from experiments.report.template_page import Drawing, Page, render_page
from sim.terrain import Course

TRACKS_HEADER = ("track", "slip", "slip, p95", "touching", "penetration [mm]", "work [J]")
SENTENCES = {
    "reached": "It crossed the course",
    "tipped": "It tipped over",
    "stuck": "It got stuck",
    "fell": "It fell off the course",
    "exploded": "The simulation broke down",
    "time": "Its time was over before it had crossed the course",
    "stopped": "Its driver stopped it",
}


def sentence(result: DriveResult) -> str:
    """How the drive ended, in words."""
    told = f"{SENTENCES[result.outcome]} after {result.duration:.1f} s"
    return told if result.outcome == "reached" else f"{told}, {result.remaining:.2f} m before the end"


def lines(result: DriveResult) -> list[str]:
    """What is printed of the drive as a whole."""
    return [
        f"way {result.way:.2f} m, height gained {number(round(result.climbed, 2) + 0.0, 2)} m, "
        f"pitch up to {degrees(result.max_pitch):.1f} deg, roll up to {degrees(result.max_roll):.1f} deg",
        f"penetration up to {1e3 * result.max_penetration:.2f} mm (99 %: {1e3 * result.penetration_p99:.2f} mm), "
        f"work of the belts {number(result.energy, 0)} J",
    ]


def track_rows(result: DriveResult) -> list[tuple[str, ...]]:
    """A row per track, under TRACKS_HEADER."""
    return [
        (
            one.name.replace("_", " "),
            *(percent(value) for value in (one.slip, one.slip_p95, one.touching)),
            number(1e3 * one.max_penetration, 2),
            number(one.work, 0),
        )
        for one in result.tracks
    ]


def render(
    run: CourseRun,
    result: DriveResult,
    course: Course,
    manifest: Mapping[str, Any],
    command: str,
    pictures: Sequence[str],
) -> Page:
    """Draw the figures and fill in the template; `pictures` are files beside the page."""
    drawings = [
        Drawing("drive_profile", figures.profile(run, course)),
        Drawing("drive_slip_over_slope", figures.slip_over_slope(run)),
        Drawing("drive_over_time", figures.over_time(run)),
    ]
    return render_page(
        "drive.html.j2",
        drawings,
        title=f"{manifest['robot']['name']} on {manifest['config']['course']}",
        command=command,
        manifest=manifest,
        conditions="",
        told=f"{sentence(result)}.",
        lines=lines(result),
        header=TRACKS_HEADER,
        rows=track_rows(result),
        pictures=pictures,
    )
