"""The page and the table of a drive over a course."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

from experiments.course.results import DriveResult
from experiments.course.run import CourseRun
from experiments.report.figures import course_drive as figures
from experiments.report.formats import number, percent
from experiments.report.page import Page, Pictures, Plot, Section
from experiments.report.table import Table
from sim.terrain import Course

SENTENCES = {
    "reached": "It crossed the course",
    "tipped": "It tipped over",
    "stuck": "It got stuck",
    "fell": "It fell off the course",
    "exploded": "The simulation broke down",
    "time": "It ran out of time",
    "stopped": "Its driver stopped it",
}


def sentences(result: DriveResult) -> tuple[str, str, str]:
    """Outcome, motion and tracks of the drive."""
    ended = f"{SENTENCES[result.outcome]} after {result.duration:.1f} s"
    if result.outcome != "reached":
        ended += f", {result.remaining:.2f} m before the end"
    climbed = number(round(result.climbed, 2) + 0.0, 2)
    return (
        f"{ended}.",
        f"way {result.way:.2f} m, height gained {climbed} m, "
        f"pitch up to {degrees(result.max_pitch):.1f} deg, roll up to {degrees(result.max_roll):.1f} deg",
        f"penetration up to {1e3 * result.max_penetration:.2f} mm (99 %: {1e3 * result.penetration_p99:.2f} mm), "
        f"work of the belts {number(result.energy, 0)} J",
    )


def tracks_table(result: DriveResult) -> Table:
    """A row per track."""
    rows = [
        (
            one.name.replace("_", " "),
            *(percent(value) for value in (one.slip, one.slip_p95, one.touching)),
            number(1e3 * one.max_penetration, 2),
            number(one.work, 0),
        )
        for one in result.tracks
    ]
    note = (
        "The slip of a track is its mean weighted by the way of the belt. Work is traction times belt speed; it is "
        "negative where the robot drives down and its belts hold it back."
    )
    return Table("Tracks", ("track", "slip", "slip, p95", "touching", "penetration [mm]", "work [J]"), rows, note=note)


def page(
    run: CourseRun,
    result: DriveResult,
    course: Course,
    manifest: Mapping[str, Any],
    command: str,
    pictures: Sequence[str],
) -> Page:
    """The page of a drive; `pictures` are files beside it."""
    ended, *more = sentences(result)
    profile = Plot(
        "drive_profile",
        figures.profile(run, course),
        "Way of the chassis",
        "The ground is that along the middle of the course. The chassis' frame lies on the ground between the tracks "
        "when the robot stands.",
        "",
    )
    slip = Plot(
        "drive_slip_over_slope",
        figures.slip_over_slope(run),
        "Slip against slope",
        "Every dot is a row of the run; symbols are medians with quartiles in bins of 3°. The slope is that of the "
        "line that best fits the heights of the ground under the tracks, positive uphill. Slip is 1 − speed over "
        "ground / belt speed, averaged over the load, where a track touches and its belt runs: positive where the belt "
        "runs ahead of the robot, negative where it holds the robot back.",
        "",
    )
    time = Plot(
        "drive_over_time",
        figures.over_time(run),
        "Attitude, flippers, slip, load and penetration",
        "Slip and load are those of the chassis' tracks.",
        "",
    )
    return Page(
        title=f"{manifest['robot']['name']} on {manifest['config']['course']}",
        command=command,
        manifest=manifest,
        intro=(ended, *(f"{line[0].upper()}{line[1:]}." for line in more)),
        sections=(
            Section("Over the course", (profile, Pictures(pictures, "The robot on the course") if pictures else None)),
            Section("Slip", (slip, tracks_table(result))),
            Section("Over time", (time,)),
        ),
    )
