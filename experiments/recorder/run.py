"""Robot runs in a recording, one with all that was measured, or several side by side, each in its own colour."""

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import mujoco
import numpy as np
import rerun as rr

from experiments.common.colours import BLUE, GREEN, GREY
from experiments.recorder.field import send_field
from experiments.recorder.model import ROBOT, send_robot
from experiments.recorder.plots import LEFT, RIGHT, Panel, send_layout
from experiments.recorder.sensing import ESTIMATE_COLOUR, send_estimate, send_scans
from experiments.recorder.stream import CAMERA, RUN, Recording, Series, about_vertical, at_height, paint, rgb
from experiments.recorder.traces import Traces
from sim.robot.looks import RobotLooks, robot_looks
from sim.robot.pads import shearing_points
from sim.robot.parameters import RobotParameters
from sim.toml_file import build
from trackslip.errors import TrackslipError
from trackslip.kinematics import Array
from trackslip.logs.runlog import MALFORMED, RunLog

_COLOURS = (BLUE, "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#F0E442", "#B8B8B8", "#8C510A", "#6A3D9A")
_REFERENCE_COLOUR = "#b8b8b8"
_AHEAD, _SIDEWAYS, _TURNING = "#009E73", "#F0E442", "#CC79A7"
_THICK, _LINE, _THIN = 4.5, 1.5, 0.8  # line widths [px]
_ABOVE = 0.004  # height of lines above the ground, and above each other [m]
_NEWTON = 0.004  # length of a force arrow [m/N]
_STRONGEST = 0.98  # quantile of the shear with the last colour of its map
_BESIDE = 0.06  # distance from a pad to its arrow, which the track would hide [m]
_MOTION = "Twist and forces"
PANELS = (
    Panel("Slip [-]", ("slip/by_law", "slip/identified", "slip/true"), 1.9, has_outliers=True),
    Panel("Sprocket speed [rad/s]", ("sprocket/command", "sprocket/measured"), 1.4),
    Panel("Position error [mm]", ("error/distance", "error/position"), 1.2, has_outliers=True),
    Panel("Heading error [deg]", ("error/heading",), 0.9, has_outliers=True),
    Panel("Twist [m/s, rad/s]", ("twist/command", "twist/true"), 1.5, _MOTION),
    Panel("Load on the tracks [N]", ("contact/load",), tab=_MOTION),
    Panel("Traction of the tracks [N]", ("contact/traction",), tab=_MOTION),
)
"""Panels of a single run."""
_COMPARED = ("slip/true", "slip/identified", "sprocket/measured", "error/distance", "error/heading")
"""Lines of several runs."""


def send_runs(recording: Recording, logs: Sequence[RunLog], laws: Path | None = None) -> None:
    """Send a run, or several on one time line; `laws` as in `Traces`."""
    runs, alone = [Traces(log, laws) for log in logs], len(logs) == 1
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
            _send_contacts(recording, f"{root}/{ROBOT}/chassis", traces, looks.model)
            send_estimate(recording, f"{root}/estimate", traces, looks.model)
            send_scans(recording, f"{root}/scan", traces, float(looks.model.body("lrf").pos[2]))
        else:
            series = _in_colour(series, colour, run)
        recording.series(root, traces.time, series)
        recording.properties(RUN if alone else f"{RUN}_{number}", {"name": run, **traces.log.metadata})
        roots.append(root)
    worst = max(runs, key=lambda traces: 0.0 if traces.distance is None else float(np.max(traces.distance)))
    duration = max(float(traces.time[-1]) for traces in runs)
    send_layout(recording, roots, PANELS, within, worst.moment, duration)


def series_of(traces: Traces) -> list[Series]:
    """Everything that can be plotted of a run."""
    log, error, distance, truth = traces.log, traces.error, traces.distance, traces.log.truth
    sides, ways = (LEFT, RIGHT), (_AHEAD, _TURNING)
    dark, pale, pale_ways = _blended(sides, 0), _blended(sides, 255), _blended(ways, 255)
    every: list[tuple[str, Array | None, tuple[str, ...], Sequence[str], float]] = [
        ("slip/by_law", traces.law, _both(f"law {traces.law_name}"), dark, _THICK),
        ("slip/identified", traces.identified, _both("identified"), pale, _THIN),
        ("slip/true", traces.slip, _both("true"), sides, _LINE),
        ("sprocket/command", log.command, _both("set point"), pale, _THICK),
        ("sprocket/measured", log.omega, _both("measured"), sides, _LINE),
        ("twist/command", log.twist_command, ("v commanded [m/s]", "w commanded [rad/s]"), pale_ways, _THICK),
    ]
    if error is not None and distance is not None:
        every += [
            ("error/distance", 1e3 * distance[:, None], ("distance",), (GREY,), _THICK),
            ("error/position", 1e3 * error[:, :2], ("ahead", "to the left"), (_AHEAD, _SIDEWAYS), _LINE),
            ("error/heading", np.degrees(error[:, 2:]), ("heading",), (_TURNING,), _LINE),
        ]
    if truth is not None:
        every += [
            ("twist/true", truth.twist[:, [0, 2]], ("v true [m/s]", "w true [rad/s]"), ways, _LINE),
            ("contact/traction", truth.traction, _both("traction"), sides, _THIN),
        ]
        if truth.contact is not None:  # the left pads come before the right ones
            load = truth.contact[..., 2].reshape(len(log.time), 2, -1).sum(axis=-1)
            every.append(("contact/load", load, _both("load"), sides, _LINE))
    return [
        Series(entity, values, names, colours, width)
        for entity, values, names, colours, width in every
        if values is not None
    ]


def _both(what: str) -> tuple[str, str]:
    """Names of the lines of both tracks."""
    return f"left, {what}", f"right, {what}"


def _blended(colours: Sequence[str], level: int) -> list[str]:
    """Colours halfway to black, 0, or to white, 255."""
    return ["#" + "".join(f"{(channel + level) // 2:02x}" for channel in rgb(colour)) for colour in colours]


def _in_colour(series: Sequence[Series], colour: str, run: str) -> list[Series]:
    """The lines of a run among others, in its own colour, paler for the right track."""
    colours = [colour, *_blended([colour], 255)]
    lines = [line for line in series if line.entity in _COMPARED]
    names = [(f"{run}, left", f"{run}, right") if len(line.names) == 2 else (run,) for line in lines]
    return [replace(line, names=name, colours=colours, width=_LINE) for line, name in zip(lines, names, strict=True)]


def parameters_of(log: RunLog) -> RobotParameters:
    """The parameters of the robot that drove a run, as far as its log has them; the shipped robot's for the rest."""
    known: Any = log.metadata.get("robot") or log.metadata.get("geometry")
    names = RobotParameters.__dataclass_fields__.keys() - {"drive"}
    with contextlib.suppress(*MALFORMED):  # a robot of another kind, too
        return build(RobotParameters, {key: value for key, value in known.items() if key in names}, log.run)
    return RobotParameters()


def _looks(log: RunLog, colour: str | None = None) -> RobotLooks:
    """The robot that drove a run on its field, in a colour or in its own ones; a plain one if its file is gone."""
    parameters, paint = parameters_of(log), () if colour is None else (*np.divide(rgb(colour), 255), 1.0)
    try:
        return robot_looks(parameters, paint)
    except TrackslipError:
        return robot_looks(replace(parameters, looks=""), paint)


def _send_robot(recording: Recording, root: str, traces: Traces, looks: RobotLooks, turning: bool) -> None:
    """Send the robot where it was, on level ground, with its belts `turning` or at rest."""
    speed = (traces.log.omega * parameters_of(traces.log).sprocket_radius)[:, looks.track_side]
    travel = np.cumsum(speed * np.diff(traces.time, prepend=0.0)[:, None], axis=0)
    qpos = looks.qpos(traces.pose)
    send_robot(recording, root, looks.model, traces.time, qpos, looks.tracks, travel if turning else travel[:1])


def _send_camera(recording: Recording, runs: Sequence[Traces]) -> None:
    """Send the position of a camera that follows the middle of the robots without turning."""
    time = max((traces.time for traces in runs), key=lambda time: float(time[-1]))
    places = [[np.interp(time, traces.time, column) for column in traces.pose.T] for traces in runs]
    recording.poses(CAMERA, time, at_height(np.mean(places, axis=0).T, 0.0))


def _send_contacts(recording: Recording, chassis: str, traces: Traces, model: mujoco.MjModel) -> None:
    """Send forces as arrows at the pads, and how far the ground has given way as coloured points."""
    truth, time, parameters = traces.log.truth, traces.time, parameters_of(traces.log)
    if truth is not None and truth.contact is not None:
        count = truth.contact.shape[1]
        origins = _beside_pads(model, count, parameters)
        look = rr.Arrows3D.from_fields(origins=origins, **paint(GREEN, 0.004))
        vectors = (_NEWTON * truth.contact).reshape(-1, 3)
        recording.shapes(f"{chassis}/contact_forces", time, np.full(len(time), count), look, vectors=vectors)
    if truth is not None and truth.shear is not None:
        count = truth.shear.shape[1]
        dots = rr.Points3D.from_fields(positions=_beside_pads(model, count, parameters), radii=[0.015])
        share = truth.shear.ravel() / max(float(np.quantile(truth.shear, _STRONGEST)), 1e-9)
        colours = matplotlib.colormaps["viridis"](share, bytes=True)
        recording.shapes(f"{chassis}/shear", time, np.full(len(time), count), dots, colors=colours)


def _beside_pads(model: mujoco.MjModel, count: int, parameters: RobotParameters) -> Array:
    """Places (count, 3) next to the pads of a model, or to the points at which they touch ground that shears [m]."""
    pads = [i for i in range(model.ngeom) if "left_pad" in model.geom(i).name]
    x, half = model.geom_pos[pads, 0], model.geom_size[pads, 1]
    if count > 2 * len(pads) and parameters.axles:
        x = shearing_points(parameters.axles, parameters.patch_length)
    elif count > 2 * len(pads):
        x = np.sort(np.concatenate([x - half, x + half]))
    y = np.repeat([1.0, -1.0], len(x)) * (parameters.half_gauge + _BESIDE)
    return np.column_stack([np.tile(x, 2), y, np.full(count, model.geom_pos[pads[0], 2])])


def _send_paths(recording: Recording, root: str, traces: Traces, colour: str, estimate: bool) -> None:
    """Send the true path if it is known, the measured path, and the reference with its target."""
    recording.line(f"{root}/path/driven", at_height(traces.pose, 2 * _ABOVE), colour, 0.008)
    if estimate and traces.log.truth is not None:
        known = traces.estimate[np.isfinite(traces.estimate).all(axis=1)]
        recording.line(f"{root}/path/estimated", at_height(known, 3 * _ABOVE), ESTIMATE_COLOUR, 0.004)
    if (reference := traces.reference) is not None:
        path, target = at_height(reference, _ABOVE), f"{root}/reference/target"
        recording.line(f"{root}/reference/path", path, _REFERENCE_COLOUR, 0.016)
        arrow = rr.Arrows3D(vectors=[[0.25, 0, 0]], origins=[[0, 0, 0.02]], **paint("#ffffff", 0.012))
        recording.still(target, arrow)
        recording.poses(target, traces.time, path, about_vertical(reference[:, 2]))


def _within(runs: Sequence[Traces]) -> Array:
    """Points (n, 2) that enclose everything of interest."""
    points = [traces.pose[:, :2] for traces in runs]
    points += [traces.reference[:, :2] for traces in runs if traces.reference is not None]
    points += [traces.mount[None, :2] for traces in runs if traces.mount is not None]
    return np.concatenate(points)
