"""Robot runs in a recording, one with all that was measured, or several side by side, each in its own colour."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from experiments.common.colours import BLUE, GREEN
from experiments.recorder.field import mount_of, send_field
from experiments.recorder.model import ROBOT, send_robot
from experiments.recorder.plots import LEFT, RIGHT, Panel, Series, begin_of_loop, blueprint, send_series
from experiments.recorder.sensing import ESTIMATE_COLOUR, send_estimate, send_scans
from experiments.recorder.stream import (
    CAMERA,
    RUN,
    at_height,
    rgb,
    send,
    send_line,
    send_poses,
    send_properties,
    send_shapes,
)
from experiments.recorder.traces import Traces, traces_of
from sim.robot.looks import RobotLooks, robot_looks
from sim.robot.pads import shearing_points
from sim.robot.parameters import RobotParameters
from trackslip.errors import TrackslipError
from trackslip.kinematics import Array
from trackslip.logs.runlog import MALFORMED, RunLog
from trackslip.metrics import TRANSIENT

_COLOURS = (BLUE, "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#F0E442", "#B8B8B8", "#8C510A", "#6A3D9A")
_REFERENCE_COLOUR = "#b8b8b8"
_AHEAD, _SIDEWAYS, _TURNING, _GREY = "#009E73", "#F0E442", "#CC79A7", "#8a8a8a"
_PALE_SIDES, _PALE_WAYS = ("#BFE3F8", "#FFE0A0"), ("#9ADFCA", "#F2D5E4")  # opaque: lines are pieces that overlap
_DIM_SIDES = ("#2B5F7D", "#7A5400")
_THICK, _LINE, _THIN = 4.5, 1.5, 0.8  # line widths [px]
_ABOVE = 0.004  # height of lines above the ground, and above each other [m]
_NEWTON = 0.004  # length of a force arrow [m/N]
_SHEARED = ((40, 60, 140), (60, 170, 130), (250, 230, 60))  # colours of ground, from firm to farthest given way
_STRONGEST = 0.98  # quantile of the shear with the last of these colours
_BESIDE = 0.06  # distance from a pad to its arrow, which the track would hide [m]
_SLIP_RANGE = (-0.25, 0.20)
_RARE = 5.0  # share of the time, at either end, in which slips may be off their axis [%]
_MOTION = "Twist and forces"
PANELS = (
    Panel("Slip [-]", ("slip/by_law", "slip/identified", "slip/true"), _SLIP_RANGE, 1.9),
    Panel("Sprocket speed [rad/s]", ("sprocket/command", "sprocket/measured"), height=1.4),
    Panel("Position error [mm]", ("error/distance", "error/position"), height=1.2),
    Panel("Heading error [deg]", ("error/heading",), height=0.9),
    Panel("Twist [m/s, rad/s]", ("twist/command", "twist/true"), height=1.5, tab=_MOTION),
    Panel("Load on the tracks [N]", ("contact/load",), tab=_MOTION),
    Panel("Traction of the tracks [N]", ("contact/traction",), tab=_MOTION),
)
"""Panels of a single run."""
COMPARED = (
    Panel("Distance from the reference [mm]", ("error/distance",), height=1.6),
    Panel("Heading error [deg]", ("error/heading",)),
    Panel("True slip [-], pale: right track", ("slip/true",), _SLIP_RANGE),
    Panel("Identified slip [-], pale: right track", ("slip/identified",), _SLIP_RANGE),
    Panel("Sprocket speed [rad/s], pale: right track", ("sprocket/measured",), tab="Speeds"),
)
"""Panels of several runs; each run has one colour in all of them."""


def send_runs(stream: rr.RecordingStream, logs: Sequence[RunLog], laws: Path | None = None) -> None:
    """Send a run, or several on one time line; `laws` as in `traces_of`."""
    runs, alone = [traces_of(log, laws) for log in logs], len(logs) == 1
    within = _within(runs)
    send_field(stream, runs[0], _looks(logs[0]).model, within)
    _send_camera(stream, runs)
    roots, sent = [], []
    for number, traces in enumerate(runs):
        colour = _COLOURS[number % len(_COLOURS)]
        root = RUN if alone else rr.new_entity_path([RUN, traces.log.run]).removeprefix("/")
        looks = _looks(traces.log, None if alone else colour)
        model = looks.model
        _send_robot(stream, root, traces, looks, turning=alone)
        _send_paths(stream, root, traces, colour, estimate=alone)
        if alone:
            _send_contacts(stream, root, traces, model)
            send_estimate(stream, f"{root}/estimate", traces, model)
            send_scans(stream, f"{root}/scan", traces, float(model.body("lrf").pos[2]))
        series = series_of(traces) if alone else compared_series(traces, colour)
        sent += send_series(stream, root, traces.time, series)
        properties = RUN if alone else f"{RUN}_{number}"
        send_properties(stream, properties, {"name": traces.log.run, **traces.log.metadata})
        roots.append(root)
    worst = max(runs, key=lambda traces: 0.0 if traces.distance is None else float(np.max(traces.distance)))
    duration = max(float(traces.time[-1]) for traces in runs)
    begin = begin_of_loop(worst.moment, duration)
    stream.send_blueprint(blueprint(roots, panels(runs), sent, within, begin, duration))


def series_of(traces: Traces) -> list[Series]:
    """Everything that can be plotted of a run."""
    log, law, truth = traces.log, traces.law_name, traces.log.truth
    sides, ways = (LEFT, RIGHT), (_AHEAD, _TURNING)
    every: list[tuple[str, Array | None, tuple[str, ...], tuple[str, ...], float]] = [
        ("slip/by_law", traces.law, (f"left, law {law}", f"right, law {law}"), _DIM_SIDES, _THICK),
        ("slip/identified", traces.identified, ("left, identified", "right, identified"), _PALE_SIDES, _THIN),
        ("slip/true", traces.slip, ("left, true", "right, true"), sides, _LINE),
        ("sprocket/command", log.command, ("left, set point", "right, set point"), _PALE_SIDES, _THICK),
        ("sprocket/measured", log.omega, ("left, measured", "right, measured"), sides, _LINE),
        ("twist/command", log.twist_command, ("v commanded [m/s]", "w commanded [rad/s]"), _PALE_WAYS, _THICK),
    ]
    if traces.error is not None:
        position, distance = 1e3 * traces.error[:, :2], 1e3 * np.hypot(*traces.error[:, :2].T)
        every += [
            ("error/distance", distance[:, None], ("distance",), (_GREY,), _THICK),
            ("error/position", position, ("ahead", "to the left"), (_AHEAD, _SIDEWAYS), _LINE),
            ("error/heading", np.degrees(traces.error[:, 2:]), ("heading",), (_TURNING,), _LINE),
        ]
    if truth is not None:
        load = None
        if truth.contact is not None:  # the left pads come before the right ones
            load = np.stack([side.sum(axis=1) for side in np.split(truth.contact[..., 2], 2, axis=1)], axis=-1)
        every += [
            ("twist/true", truth.twist[:, [0, 2]], ("v true [m/s]", "w true [rad/s]"), ways, _LINE),
            ("contact/traction", truth.traction, ("left, traction", "right, traction"), sides, _THIN),
            ("contact/load", load, ("left, load", "right, load"), sides, _LINE),
        ]
    return [
        Series(entity, values, names, colours, width)
        for entity, values, names, colours, width in every
        if values is not None
    ]


def compared_series(traces: Traces, colour: str) -> list[Series]:
    """The lines of a run among others, in its own colour, paler for the right track."""
    kept, run = {entity for panel in COMPARED for entity in panel.entities}, traces.log.run
    pale = "#" + "".join(f"{(int(colour[k : k + 2], 16) + 255) // 2:02x}" for k in (1, 3, 5))
    sides = (f"{run}, left", f"{run}, right")
    lines = [line for line in series_of(traces) if line.entity in kept]
    return [
        replace(line, names=sides if len(line.names) == 2 else (run,), colours=(colour, pale), width=_LINE)
        for line in lines
    ]


def panels(runs: Sequence[Traces]) -> list[Panel]:
    """PANELS of one run, or COMPARED of several, whose ranges hold all errors after the transients, and most slips."""
    return [_with_range(panel, runs) for panel in (PANELS if len(runs) == 1 else COMPARED)]


def _with_range(panel: Panel, runs: Sequence[Traces]) -> Panel:
    lines = [(run.time >= TRANSIENT, line) for run in runs for line in series_of(run) if line.entity in panel.entities]
    late = np.concatenate([[], *(line.values[rows].ravel() for rows, line in lines)])
    late = late[np.isfinite(late)]
    if not late.size or not (panel.range or panel.entities[0].startswith("error/")):
        return panel
    if panel.range is not None:
        late = np.percentile(late, (_RARE, 100 - _RARE))
        if panel.range[0] <= late[0] <= late[1] <= panel.range[1]:
            return panel
    ends = np.append(late, panel.range or 0.0)
    margin = 0.08 * float(np.ptp(ends))
    return replace(panel, range=(float(ends.min()) - margin, float(ends.max()) + margin))


def parameters_of(log: RunLog) -> RobotParameters:
    """The parameters of the robot that drove a run, as far as its log has them; the shipped robot's for the rest."""
    known = log.metadata.get("robot") or log.metadata.get("geometry")
    names = RobotParameters.__dataclass_fields__
    with contextlib.suppress(*MALFORMED):  # a robot of another kind, too
        if isinstance(known, Mapping):
            kept = {str(key): _entry(value) for key, value in known.items() if key in names and key != "drive"}
            return RobotParameters(**kept)
    return RobotParameters()


def _entry(value: Any) -> Any:
    """A parameter from JSON."""
    return value if isinstance(value, str) else tuple(value) if isinstance(value, list) else float(value)


def _looks(log: RunLog, colour: str | None = None) -> RobotLooks:
    """The robot that drove a run on its field, in a colour or in its own ones; a plain one if its file is gone."""
    parameters, paint = parameters_of(log), () if colour is None else (*np.divide(rgb(colour), 255), 1.0)
    try:
        return robot_looks(parameters, paint)
    except TrackslipError:
        return robot_looks(replace(parameters, looks=""), paint)


def _send_robot(stream: rr.RecordingStream, root: str, traces: Traces, looks: RobotLooks, turning: bool) -> None:
    """Send the robot where it was, on level ground, with its belts `turning` or at rest."""
    speed = (traces.log.omega * parameters_of(traces.log).sprocket_radius)[:, looks.track_side]
    travel = np.cumsum(speed * np.diff(traces.time, prepend=0.0)[:, None], axis=0)
    qpos = looks.qpos(traces.pose)
    send_robot(stream, root, looks.model, traces.time, qpos, looks.tracks, travel if turning else travel[:1])


def _send_camera(stream: rr.RecordingStream, runs: Sequence[Traces]) -> None:
    """Send the position of a camera that follows the middle of the robots without turning."""
    time = max((traces.time for traces in runs), key=lambda time: float(time[-1]))
    places = [[np.interp(time, traces.time, column) for column in traces.pose.T] for traces in runs]
    middle = at_height(np.mean(places, axis=0).T, 0.0)
    send(stream, CAMERA, time, rr.Transform3D.columns(translation=middle))


def _send_contacts(stream: rr.RecordingStream, root: str, traces: Traces, model: mujoco.MjModel) -> None:
    """Send forces as arrows at the pads, and the shear of the ground as a coloured line where it is known."""
    truth, time, chassis, parameters = (
        traces.log.truth,
        traces.time,
        f"{root}/{ROBOT}/chassis",
        parameters_of(traces.log),
    )
    if truth is not None and truth.contact is not None:
        count = truth.contact.shape[1]
        pads, vectors = _beside_pads(model, count, parameters), (_NEWTON * truth.contact).reshape(-1, 3)
        style: dict[str, Any] = {"origins": pads, "colors": [rgb(GREEN)], "radii": [0.004]}
        counts = np.full(len(time), count)
        send_shapes(stream, f"{chassis}/contact_forces", time, counts, rr.Arrows3D, style, vectors=vectors)
    if truth is not None and truth.shear is not None and len(time):
        pads = _beside_pads(model, truth.shear.shape[1], parameters)
        lines = np.concatenate([np.stack([track[:-1], track[1:]], axis=1) for track in np.split(pads, 2)])
        spaces = lines[:, 1, 0] - lines[:, 0, 0]
        within = spaces < 1.5 * spaces.min()  # of a patch, not from wheel to wheel
        sides = np.split(truth.shear, 2, axis=1)
        middle = np.concatenate([(side[:, :-1] + side[:, 1:]) / 2 for side in sides], axis=1)
        lines, middle = lines[within], middle[:, within]
        share = middle / max(float(np.quantile(truth.shear, _STRONGEST)), 1e-9)
        colours = np.stack([np.interp(share, np.linspace(0, 1, 3), band) for band in np.transpose(_SHEARED)], axis=-1)
        style, counts = {"strips": list(lines), "radii": [0.012]}, np.full(len(time), len(lines))
        colours = np.rint(colours).astype(np.uint8).reshape(-1, 3)
        send_shapes(stream, f"{chassis}/shear", time, counts, rr.LineStrips3D, style, colors=colours)


def _beside_pads(model: mujoco.MjModel, count: int, parameters: RobotParameters) -> Array:
    """Places (count, 3) next to the pads of a model, or to the points at which they touch ground that shears [m]."""
    pads = [i for i in range(model.ngeom) if "_pad" in model.geom(i).name]
    places = model.geom_pos[pads]
    if parameters.axles and count > len(pads):
        x = shearing_points(parameters.axles, parameters.patch_length)
        y, z = np.repeat([1.0, -1.0], len(x)) * parameters.half_gauge, np.full(count, places[0, 2])
        places = np.column_stack([np.tile(x, 2), y, z])
    elif count == 2 * len(pads):  # pads that touch the ground at one point each
        half = model.geom_size[pads, 1, None] * [1.0, 0.0, 0.0]
        ends = np.stack([places - half, places + half], axis=1).reshape(-1, 3)
        places = ends[np.lexsort([ends[:, 0], -ends[:, 1]])]
    return places + np.sign(places) * [0, _BESIDE, 0]


def _send_paths(stream: rr.RecordingStream, root: str, traces: Traces, colour: str, estimate: bool) -> None:
    """Send the true path if it is known, the measured path, and the reference with its target."""
    send_line(stream, f"{root}/path/driven", at_height(traces.pose, 2 * _ABOVE), colour, 0.008)
    if estimate and traces.log.truth is not None:
        known = traces.estimate[np.isfinite(traces.estimate).all(axis=1)]
        send_line(stream, f"{root}/path/estimated", at_height(known, 3 * _ABOVE), ESTIMATE_COLOUR, 0.004)
    if traces.reference is not None:
        send_line(stream, f"{root}/reference/path", at_height(traces.reference, _ABOVE), _REFERENCE_COLOUR, 0.016)
        target = rr.Arrows3D(vectors=[[0.25, 0, 0]], origins=[[0, 0, 0.02]], colors=[(255, 255, 255)], radii=[0.012])
        stream.log(f"{root}/reference/target", target, static=True)
        send_poses(stream, f"{root}/reference/target", traces.time, traces.reference, _ABOVE)


def _within(runs: Sequence[Traces]) -> Array:
    """Points (n, 2) that enclose everything of interest."""
    points = [traces.pose[:, :2] for traces in runs]
    points += [traces.reference[:, :2] for traces in runs if traces.reference is not None]
    points += [mount[None, :2] for traces in runs if (mount := mount_of(traces)) is not None]
    return np.concatenate(points)
