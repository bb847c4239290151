"""Robot runs in a recording: a single run with all measurements, or several runs, each in its own
colour.
"""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import rerun as rr

from experiments.common.colours import BLUE, GREY
from experiments.common.traces import Traces
from experiments.recorder.field import send_field
from experiments.recorder.model import HIDDEN_GROUP, ROBOT, send_robot
from experiments.recorder.plots import (
    LEFT,
    LEFT_MEASURED,
    RIGHT,
    RIGHT_MEASURED,
    Panel,
    send_layout,
)
from experiments.recorder.ruts import ruts_of, sinkage_of
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
from sim.common.settings import build
from sim.robot.looks import RobotLooks, robot_looks
from sim.robot.parameters import WHEELS, RobotParameters
from trackslip.errors import TrackslipError
from trackslip.kinematics import Array
from trackslip.logs.runlog import MALFORMED, RunLog, stored_geometry

_COLOURS: Final = (
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
_REFERENCE_COLOUR: Final = "#b8b8b8"
# errors ahead, to the left, and in heading
_AHEAD: Final = "#009E73"
_SIDEWAYS: Final = "#F0E442"
_TURNING: Final = "#CC79A7"
# line widths [px]
_THICK: Final = 4.5
_LINE: Final = 1.5
_THIN: Final = 0.8
_ARROW: Final = 0.5  # length of the arrow in place of an unknown robot [m]
_ABOVE: Final = 0.004  # height of lines above the ground, and above each other [m]
PANELS: Final = (
    Panel("Slip [-]", ("slip/assumed", "slip/identified", "slip/true"), 1.9, has_outliers=True),
    Panel("Sprocket speed [rad/s]", ("sprocket/command", "sprocket/measured"), 1.4),
    Panel("Sinkage [mm]", ("soil/sinkage",)),
    Panel("Resistance [N]", ("soil/resistance",)),
    Panel("Position error [mm]", ("error/distance", "error/position"), 1.2, has_outliers=True),
    Panel("Heading error [deg]", ("error/heading",), 0.9, has_outliers=True),
)
"""Panels with plots of a run; panels without lines are left out."""
_COMPARED: Final = (
    "slip/true",
    "slip/identified",
    "sprocket/measured",
    "soil/sinkage",
    "error/distance",
    "error/heading",
)
"""Lines that are plotted when several runs are compared."""


def send_runs(recording: Recording, logs: Sequence[RunLog]) -> None:
    """Send a run, or several runs on a common timeline."""
    runs = [Traces(log) for log in logs]
    alone = len(logs) == 1
    within = _within(runs)
    ruts = ruts_of([(traces, parameters_of(traces.log)) for traces in runs])
    send_field(recording, runs[0], _looks(logs[0]).model, within, ruts)
    _send_camera(recording, runs)
    roots = []
    for number, traces in enumerate(runs):
        colour = _COLOURS[number % len(_COLOURS)]
        run = traces.log.run
        root = RUN
        if not alone:
            root = rr.new_entity_path([RUN, run]).removeprefix("/")
        looks = _looks(traces.log, None if alone else colour)
        _send_robot(recording, root, traces, looks, turning=alone)
        _send_paths(recording, root, traces, colour, estimate=alone)
        series = series_of(traces)
        if alone:
            if "plate" in traces.log.metadata:
                send_estimate(recording, f"{root}/estimate", traces, looks.model)
            height = float(looks.model.body("lrf").pos[2])
            send_scans(recording, f"{root}/scan", traces, height)
        else:
            series = _in_colour(series, colour, run)
        recording.series(root, traces.time, series)
        roots.append(root)
    send_layout(recording, roots, PANELS, within)


def series_of(traces: Traces) -> list[Series]:
    """All plot lines that the log of a run provides."""
    return [*_track_series(traces), *_error_series(traces)]


def _track_series(traces: Traces) -> list[Series]:
    """Lines for the left and the right track: slips, sprocket speeds, and ruts in soft soil."""
    sides = (LEFT, RIGHT)
    of_measured = (LEFT_MEASURED, RIGHT_MEASURED)
    dark = _blended(sides, 0)
    pale = _blended(sides, 255)
    series = []

    def add(
        entity: str, values: Array | None, what: str, colours: Sequence[str], width: float
    ) -> None:
        """Add the lines of both tracks, if the log has their values."""
        if values is not None:
            names = (f"left, {what}", f"right, {what}")
            series.append(Series(entity, values, names, colours, width))

    add("slip/assumed", traces.assumed, "assumed", dark, _THICK)
    add("slip/identified", traces.identified, "measured", of_measured, _THIN)
    add("slip/true", traces.slip, "true", sides, _LINE)
    add("sprocket/command", traces.log.command, "set point", pale, _THICK)
    add("sprocket/measured", traces.log.omega, "measured", sides, _LINE)
    truth = traces.log.truth
    if truth is not None and truth.sinkage is not None:
        add("soil/sinkage", 1e3 * truth.sinkage, "rut", sides, _LINE)
        add("soil/resistance", truth.resistance, "resistance", sides, _LINE)
    return series


def _error_series(traces: Traces) -> list[Series]:
    """Lines of the errors from the reference, if there is one."""
    error = traces.error
    if error is None:
        return []
    position = 1e3 * error[:, :2]
    distance = 1e3 * np.hypot(error[:, :1], error[:, 1:2])
    heading = np.degrees(error[:, 2:])
    names = ("ahead", "to the left")
    return [
        Series("error/distance", distance, ("distance",), (GREY,), _THICK),
        Series("error/position", position, names, (_AHEAD, _SIDEWAYS)),
        Series("error/heading", heading, ("heading",), (_TURNING,)),
    ]


def _blended(colours: Sequence[str], level: int) -> list[str]:
    """Colours blended halfway to a grey `level`, from 0 (black) to 255 (white)."""
    blended = []
    for colour in colours:
        channels = [(channel + level) // 2 for channel in rgb(colour)]
        blended.append("#" + bytes(channels).hex())
    return blended


def _in_colour(series: Sequence[Series], colour: str, run: str) -> list[Series]:
    """A run's lines for comparison with other runs, in the run's colour, paler for the right
    track.
    """
    colours = [colour, *_blended([colour], 255)]
    of_tracks = (f"{run}, left", f"{run}, right")
    compared = []
    for line in series:
        if line.entity in _COMPARED:
            names = of_tracks if len(line.names) == 2 else (run,)
            compared.append(replace(line, names=names, colours=colours, width=_LINE))
    return compared


def parameters_of(log: RunLog) -> RobotParameters:
    """Parameters of the robot in a run, from its log.

    A log that has only the robot's gauge and sprockets is from a real robot: it gets two axles with
    wheels of this size, and is as long as the shipped robot, times the ratio of the gauges. A log
    without a gauge has the shipped robot's parameters.
    """
    names = RobotParameters.__dataclass_fields__.keys() - {"drive"}
    known: Any = log.metadata.get("robot")
    with contextlib.suppress(*MALFORMED):  # also raised for a robot of another kind
        own = {key: value for key, value in known.items() if key in names}
        return build(RobotParameters, own, log.run)
    shipped = RobotParameters()
    geometry = stored_geometry(log)
    if geometry is None:
        return shipped
    length = shipped.contact_length * geometry.half_gauge / shipped.half_gauge
    return replace(
        shipped,
        half_gauge=geometry.half_gauge,
        sprocket_radius=geometry.sprocket_radius,
        contact=WHEELS,
        axles=(-length / 2, length / 2),
    )


def _is_known(log: RunLog) -> bool:
    """Whether a log says which robot drove: that of a simulation, or the one that the user
    named.
    """
    return isinstance(log.metadata.get("robot"), Mapping)


def _looks(log: RunLog, colour: str | None = None) -> RobotLooks:
    """Looks of the robot in a run, in `colour` or its own colours; a plain robot if the file with
    looks is missing, and a grey one without a plate for a robot of which only the size is known.
    """
    parameters = parameters_of(log)
    is_known = _is_known(log)
    if colour is None and not is_known:
        colour = GREY
    paint = () if colour is None else (*np.divide(rgb(colour), 255), 1.0)
    try:
        looks = robot_looks(parameters, paint)
    except TrackslipError:
        looks = robot_looks(replace(parameters, looks=""), paint)
    if "plate" not in log.metadata:
        for name in ("plate", "mast"):
            looks.model.geom(name).group = HIDDEN_GROUP
    return looks


def _send_robot(
    recording: Recording, root: str, traces: Traces, looks: RobotLooks, turning: bool
) -> None:
    """Send the robot at its poses, on level ground or as deep as its ruts, with its belts `turning`
    or at rest; an arrow in its place if not even its size is known.
    """
    if not _is_known(traces.log) and stored_geometry(traces.log) is None:
        arrow = rr.Arrows3D(vectors=[[_ARROW, 0, 0]], **paint(GREY, _ARROW / 20))
        recording.still(f"{root}/{ROBOT}", arrow)
        place = at_height(traces.pose, _ARROW / 10)
        turn = about_vertical(traces.pose[:, 2])
        recording.poses(f"{root}/{ROBOT}", traces.time, place, turn)
        return
    belts = traces.log.omega * parameters_of(traces.log).sprocket_radius
    speed = belts[:, looks.track_side]
    period = np.diff(traces.time, prepend=0.0)[:, None]
    travel = np.cumsum(speed * period, axis=0)
    if not turning:
        travel = travel[:1]
    qpos = looks.qpos(traces.pose)
    sinkage = sinkage_of(traces)
    if sinkage is not None:
        qpos[:, 2] -= sinkage.mean(axis=1)
    send_robot(recording, root, looks.model, traces.time, qpos, looks.tracks, travel)


def _send_camera(recording: Recording, runs: Sequence[Traces]) -> None:
    """Send the position of a camera that follows the middle of the robots without turning."""
    time = max((traces.time for traces in runs), key=lambda time: float(time[-1]))
    poses = [_at_times(time, traces) for traces in runs]
    recording.poses(CAMERA, time, at_height(np.mean(poses, axis=0), 0.0))


def _at_times(time: Array, traces: Traces) -> Array:
    """Poses (n, 3) of a robot at times (n,), at its last pose after the end of its run."""
    columns = [np.interp(time, traces.time, column) for column in traces.pose.T]
    return np.stack(columns, axis=-1)


def _send_paths(
    recording: Recording, root: str, traces: Traces, colour: str, estimate: bool
) -> None:
    """Send the true path if it is known, the measured path, and the reference with its target."""
    driven = at_height(traces.pose, 2 * _ABOVE)
    recording.line(f"{root}/path/driven", driven, colour, 0.008)
    if estimate and traces.log.truth is not None:
        known = np.isfinite(traces.estimate).all(axis=1)
        estimated = at_height(traces.estimate[known], 3 * _ABOVE)
        recording.line(f"{root}/path/estimated", estimated, ESTIMATE_COLOUR, 0.004)
    if traces.reference is not None:
        _send_reference(recording, f"{root}/reference", traces.time, traces.reference)


def _send_reference(recording: Recording, entity: str, time: Array, reference: Array) -> None:
    """Send the path of desired poses (T, 3), and an arrow that moves along it."""
    path = at_height(reference, _ABOVE)
    recording.line(f"{entity}/path", path, _REFERENCE_COLOUR, 0.016)
    white = paint("#ffffff", 0.012)
    arrow = rr.Arrows3D(vectors=[[0.25, 0, 0]], origins=[[0, 0, 0.02]], **white)
    recording.still(f"{entity}/target", arrow)
    recording.poses(f"{entity}/target", time, path, about_vertical(reference[:, 2]))


def _within(runs: Sequence[Traces]) -> Array:
    """Points (n, 2) [m] on paths, references and scanners, between which everything of interest
    lies.
    """
    points = []
    for traces in runs:
        points.append(traces.pose[:, :2])
        if traces.reference is not None:
            points.append(traces.reference[:, :2])
        if traces.log.scans is not None:
            points.append(traces.log.scans.scan.mount[None, :2])
    return np.concatenate(points)
