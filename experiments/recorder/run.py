"""Robot runs in a recording: a single run with all measurements, or several runs, each in its own
colour.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import rerun as rr

from experiments.common.colours import BLUE, GREY
from experiments.recorder.field import send_field
from experiments.recorder.model import send_robot
from experiments.recorder.plots import LEFT, RIGHT, Panel, send_layout
from experiments.recorder.sensing import ESTIMATE_COLOUR, send_estimate, send_scans
from experiments.recorder.stream import (
    CAMERA,
    RUN,
    Recording,
    Series,
    about_vertical,
    at_height,
    paint,
    rgb,
)
from experiments.recorder.traces import Traces
from sim.common.settings import build
from sim.robot.looks import RobotLooks, robot_looks
from sim.robot.parameters import RobotParameters
from trackslip.errors import TrackslipError
from trackslip.kinematics import Array
from trackslip.logs.runlog import MALFORMED, RunLog

_COLOURS = (
    BLUE,
    "#D55E00",
    "#009E73",
    "#E69F00",
    "#CC79A7",
    "#56B4E9",
    "#F0E442",
    "#B8B8B8",
    "#8C510A",
    "#6A3D9A",
)
_REFERENCE_COLOUR = "#b8b8b8"
_AHEAD, _SIDEWAYS, _TURNING = "#009E73", "#F0E442", "#CC79A7"
_THICK, _LINE, _THIN = 4.5, 1.5, 0.8  # line widths [px]
_ABOVE = 0.004  # height of lines above the ground, and above each other [m]
PANELS = (
    Panel("Slip [-]", ("slip/assumed", "slip/identified", "slip/true"), 1.9, has_outliers=True),
    Panel("Sprocket speed [rad/s]", ("sprocket/command", "sprocket/measured"), 1.4),
    Panel("Position error [mm]", ("error/distance", "error/position"), 1.2, has_outliers=True),
    Panel("Heading error [deg]", ("error/heading",), 0.9, has_outliers=True),
)
"""Panels with plots of a run; panels without lines are left out."""
_COMPARED = ("slip/true", "slip/identified", "sprocket/measured", "error/distance", "error/heading")
"""Lines that are plotted when several runs are compared."""


def send_runs(recording: Recording, logs: Sequence[RunLog]) -> None:
    """Send a run, or several runs on a common timeline."""
    runs, alone = [Traces(log) for log in logs], len(logs) == 1
    within = _within(runs)
    send_field(recording, runs[0], _looks(logs[0]).model, within)
    _send_camera(recording, runs)
    roots = []
    for number, traces in enumerate(runs):
        colour, run = _COLOURS[number % len(_COLOURS)], traces.log.run
        root = RUN if alone else rr.new_entity_path([RUN, run]).removeprefix("/")
        looks = _looks(traces.log, None if alone else colour)
        _send_robot(recording, root, traces, looks, turning=alone)
        _send_paths(recording, root, traces, colour, estimate=alone)
        series = series_of(traces)
        if alone:
            send_estimate(recording, f"{root}/estimate", traces, looks.model)
            send_scans(recording, f"{root}/scan", traces, float(looks.model.body("lrf").pos[2]))
        else:
            series = _in_colour(series, colour, run)
        recording.series(root, traces.time, series)
        roots.append(root)
    send_layout(recording, roots, PANELS, within)


def series_of(traces: Traces) -> list[Series]:
    """All plot lines that the log of a run provides."""
    log, error, sides = traces.log, traces.error, (LEFT, RIGHT)
    dark, pale = _blended(sides, 0), _blended(sides, 255)
    by_track = [
        ("slip/assumed", traces.assumed, "assumed", dark, _THICK),
        ("slip/identified", traces.identified, "identified", pale, _THIN),
        ("slip/true", traces.slip, "true", sides, _LINE),
        ("sprocket/command", log.command, "set point", pale, _THICK),
        ("sprocket/measured", log.omega, "measured", sides, _LINE),
    ]
    series = [
        Series(entity, values, (f"left, {what}", f"right, {what}"), colours, width)
        for entity, values, what, colours, width in by_track
        if values is not None
    ]
    if error is not None:
        distance = 1e3 * np.hypot(error[:, :1], error[:, 1:2])
        series += [
            Series("error/distance", distance, ("distance",), (GREY,), _THICK),
            Series(
                "error/position", 1e3 * error[:, :2], ("ahead", "to the left"), (_AHEAD, _SIDEWAYS)
            ),
            Series("error/heading", np.degrees(error[:, 2:]), ("heading",), (_TURNING,)),
        ]
    return series


def _blended(colours: Sequence[str], level: int) -> list[str]:
    """Colours blended halfway to a grey `level`, from 0 (black) to 255 (white)."""
    return [
        "#" + "".join(f"{(channel + level) // 2:02x}" for channel in rgb(colour))
        for colour in colours
    ]


def _in_colour(series: Sequence[Series], colour: str, run: str) -> list[Series]:
    """A run's lines for comparison with other runs, in the run's colour, paler for the right
    track.
    """
    colours = [colour, *_blended([colour], 255)]
    lines = [line for line in series if line.entity in _COMPARED]
    names = [
        (f"{run}, left", f"{run}, right") if len(line.names) == 2 else (run,) for line in lines
    ]
    return [
        replace(line, names=name, colours=colours, width=_LINE)
        for line, name in zip(lines, names, strict=True)
    ]


def parameters_of(log: RunLog) -> RobotParameters:
    """Parameters of the robot in a run, from its log; parameters missing in the log are the shipped
    robot's.
    """
    known: Any = log.metadata.get("robot") or log.metadata.get("geometry")
    names = RobotParameters.__dataclass_fields__.keys() - {"drive"}
    with contextlib.suppress(*MALFORMED):  # also raised for a robot of another kind
        return build(
            RobotParameters, {key: value for key, value in known.items() if key in names}, log.run
        )
    return RobotParameters()


def _looks(log: RunLog, colour: str | None = None) -> RobotLooks:
    """Looks of the robot in a run, in `colour` or its own colours; a plain robot if the file with
    looks is missing.
    """
    parameters, paint = (
        parameters_of(log),
        () if colour is None else (*np.divide(rgb(colour), 255), 1.0),
    )
    try:
        return robot_looks(parameters, paint)
    except TrackslipError:
        return robot_looks(replace(parameters, looks=""), paint)


def _send_robot(
    recording: Recording, root: str, traces: Traces, looks: RobotLooks, turning: bool
) -> None:
    """Send the robot at its poses, on level ground, with its belts `turning` or at rest."""
    speed = (traces.log.omega * parameters_of(traces.log).sprocket_radius)[:, looks.track_side]
    travel = np.cumsum(speed * np.diff(traces.time, prepend=0.0)[:, None], axis=0)
    qpos = looks.qpos(traces.pose)
    send_robot(
        recording,
        root,
        looks.model,
        traces.time,
        qpos,
        looks.tracks,
        travel if turning else travel[:1],
    )


def _send_camera(recording: Recording, runs: Sequence[Traces]) -> None:
    """Send the position of a camera that follows the middle of the robots without turning."""
    time = max((traces.time for traces in runs), key=lambda time: float(time[-1]))
    places = [[np.interp(time, traces.time, column) for column in traces.pose.T] for traces in runs]
    recording.poses(CAMERA, time, at_height(np.mean(places, axis=0).T, 0.0))


def _send_paths(
    recording: Recording, root: str, traces: Traces, colour: str, estimate: bool
) -> None:
    """Send the true path if it is known, the measured path, and the reference with its target."""
    recording.line(f"{root}/path/driven", at_height(traces.pose, 2 * _ABOVE), colour, 0.008)
    if estimate and traces.log.truth is not None:
        known = traces.estimate[np.isfinite(traces.estimate).all(axis=1)]
        recording.line(
            f"{root}/path/estimated", at_height(known, 3 * _ABOVE), ESTIMATE_COLOUR, 0.004
        )
    if (reference := traces.reference) is not None:
        path, target = at_height(reference, _ABOVE), f"{root}/reference/target"
        recording.line(f"{root}/reference/path", path, _REFERENCE_COLOUR, 0.016)
        arrow = rr.Arrows3D(
            vectors=[[0.25, 0, 0]], origins=[[0, 0, 0.02]], **paint("#ffffff", 0.012)
        )
        recording.still(target, arrow)
        recording.poses(target, traces.time, path, about_vertical(reference[:, 2]))


def _within(runs: Sequence[Traces]) -> Array:
    """Points (n, 2) [m] on paths, references and scanners, between which everything of interest
    lies.
    """
    points = [traces.pose[:, :2] for traces in runs]
    points += [traces.reference[:, :2] for traces in runs if traces.reference is not None]
    points += [
        traces.log.scans.scan.mount[None, :2] for traces in runs if traces.log.scans is not None
    ]
    return np.concatenate(points)
