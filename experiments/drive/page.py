"""The page on a drive over a course, with its figures and table."""

import shlex
from collections.abc import Mapping, Sequence
from math import degrees
from pathlib import Path
from typing import Any, Final

import numpy as np

from experiments.common.chart import WIDE, Chart, Curve
from experiments.common.colours import BLUE, GREY, ORANGE
from experiments.common.page import Answer, Page, Pictures, Plot, Section
from experiments.common.results import PICTURES_FOLDER
from experiments.common.style import thin
from experiments.common.table import Table, number, pair, percent
from experiments.drive.course import DrivenCourse
from trackslip.kinematics import Array

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
    "Means over pieces of the path, weighted by the distance that the belt runs; positive where "
    "the belt runs ahead of the ground, with gaps where the track is in the air. The recording has "
    "slip, loads and attitude over time."
)
_PIECES: Final = 150  # number of pieces of the path over which slip is averaged
_SHORTEST: Final = 0.01  # length of the shortest piece [m]


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
    slip = Plot(
        "drive_slip_over_distance", slip_over_distance(run), "Slip over distance", _SLIP_CAPTION
    )
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


def _profile(run: DrivenCourse) -> Chart:
    """The ground along the course, and the path of the chassis' frame over it."""
    shown = thin(len(run.time), 1500)
    position = run.state.position[shown]
    course = run.course
    low, high = course.bounds[:, 0]
    x = np.linspace(low, high, 2000)
    height = course.height(x, np.zeros_like(x))
    ends = np.array([float(course.floor), float(height.max())])
    curves = [
        Curve(x, height, "ground at y = 0", _EARTH, floor=float(course.floor)),
        Curve(position[:, 0], position[:, 2], "chassis", BLUE, 1.2),
        Curve(np.full(2, run.goal), ends, "end of the course", GREY, 0.8, "--"),
    ]
    return Chart("", "x [m]", "z [m]", curves, 2.6, WIDE, xlim=(float(low), float(high)))


def slip_over_distance(run: DrivenCourse) -> Chart | None:
    """Slip of the chassis' tracks over the distance driven; None for a robot that stays in place.

    The path is cut into pieces of equal length. The slip in a piece is the mean of the slips in its
    rows, weighted by the distance that the belt runs, as in the table.
    """
    steps = np.diff(run.state.position[:, :2], axis=0, prepend=run.state.position[:1, :2])
    distance = np.hypot(steps[:, 0], steps[:, 1]).cumsum()
    length = float(distance[-1])
    pieces = min(_PIECES, int(length / _SHORTEST))
    if pieces < 2:
        return None
    piece = np.minimum((distance / length * pieces).astype(int), pieces - 1)
    middle = (np.arange(pieces) + 0.5) * length / pieces
    curves = []
    for name, colour, track in zip(("left", "right"), (BLUE, ORANGE), run.sides, strict=True):
        slip = _mean_per_piece(
            run.contact.slip[:, track], run.contact.belt[:, track], piece, pieces
        )
        curves.append(Curve(middle, slip, f"{name} track", colour, 1.2))
    return Chart("", "distance driven [m]", "slip [–]", curves, 2.6, WIDE, has_zero=True)


def _mean_per_piece(slip: Array, belt: Array, piece: np.ndarray, pieces: int) -> Array:
    """Means (pieces,) of slips (R,), weighted by the speed of the belt (R,), where they are known;
    `piece` (R,) numbers the piece of each row.
    """
    known = np.isfinite(slip)
    weight = np.where(known, np.abs(belt), 0.0)
    weighted = weight * np.where(known, slip, 0.0)
    whole = np.bincount(piece, weight, pieces)
    total = np.bincount(piece, weighted, pieces)
    return np.divide(total, whole, out=np.full(pieces, np.nan), where=whole > 0)
