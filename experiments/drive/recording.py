"""A drive over a course in a recording: terrain, the robot with its belts and wheels, contacts with forces, plots."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from experiments.common.colours import BLUE, GREEN, GREY, VERMILLION
from experiments.drive.course import DrivenCourse
from experiments.recorder.model import drawn, send_geoms, send_paving, send_robot
from experiments.recorder.plots import LEFT, RIGHT, Panel, Series, begin_of_loop, blueprint, send_series
from experiments.recorder.stream import (
    CAMERA,
    FIELD,
    RUN,
    rgb,
    send,
    send_line,
    send_properties,
    send_shapes,
    write_recording,
)
from sim.robot.tracked_model import TrackedModel
from sim.robot.tracked_view import track_looks
from sim.traverse.contact import ContactPoints

_EVERY = 2  # one row in so many is drawn
_NEWTON = 0.002  # length of a force arrow [m/N]
_COLOURS = (LEFT, RIGHT, "#009E73", "#F0E442", "#CC79A7", "#D55E00", "#8d6bd1", "#bbbbbb")
_SLIP, _ATTITUDE = "Slip and forces", "Attitude and flippers"
PANELS = (
    Panel("Slip [-]", ("slip/tracks",), (-0.5, 1.0), 1.6, tab=_SLIP),
    Panel("Load [N]", ("contact/load",), tab=_SLIP),
    Panel("Traction [N]", ("contact/traction",), tab=_SLIP),
    Panel("Penetration [mm]", ("contact/depth",), tab=_SLIP),
    Panel("Attitude and slope [deg]", ("attitude/chassis",), tab=_ATTITUDE),
    Panel("Flippers [deg]", ("attitude/flippers",), tab=_ATTITUDE),
    Panel("Belts [m/s]", ("belts/mean",), tab=_ATTITUDE),
)
"""Plots over time."""


def record_course_drive(file: Path, run: DrivenCourse, world: TrackedModel, about: Mapping[str, Any]) -> None:
    """Record a drive over a course; `world` is the model with its looks. Raises OutputError as `record` does."""
    name = f"{world.robot.name}: {run.outcome}"
    write_recording(file, name, lambda stream: send_course_drive(stream, run, world, about))


def send_course_drive(
    stream: rr.RecordingStream, run: DrivenCourse, world: TrackedModel, about: Mapping[str, Any]
) -> None:
    """Send a drive to a stream; `world` is the model with its looks."""
    rows = np.arange(0, len(run.time), _EVERY)
    time, position, model = run.time[rows], run.state.position, world.model
    _send_terrain(stream, model, position[:, :2])
    send(stream, CAMERA, time, rr.Transform3D.columns(translation=position[rows]))
    tracks = [(name, body, look) for name, (body, look) in zip(run.tracks, track_looks(world), strict=True)]
    send_robot(stream, RUN, model, time, run.qpos[rows], tracks, run.travel[rows])
    _send_contacts(stream, run, world, rows)
    send_line(stream, f"{RUN}/path/driven", position[rows] + [0, 0, 0.02], BLUE, 0.008)
    sent = send_series(stream, RUN, run.time, list(_series(run)))
    send_properties(stream, RUN, about)
    duration = float(run.time[-1])
    begin = begin_of_loop(float(run.time[np.argmax(np.abs(run.state.pitch))]), duration)
    stream.send_blueprint(blueprint([RUN], PANELS, sent, position[:, :2], begin, duration))


def _send_terrain(stream: rr.RecordingStream, model: mujoco.MjModel, way: np.ndarray) -> None:
    """Send everything that is fixed in the world, and the floor around it and the robot's way (n, 2)."""
    send_geoms(stream, f"{FIELD}/course", model, 0)
    fixed = drawn(model, 0)
    middle, reach = model.geom_pos[fixed, :2], model.geom_rbound[fixed, None]
    for i in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE):
        send_paving(stream, np.concatenate([middle - reach, middle + reach, way]), float(model.geom_pos[i, 2]))


def _send_contacts(stream: rr.RecordingStream, run: DrivenCourse, world: TrackedModel, rows: np.ndarray) -> None:
    """Send where the robot touches the ground, and the forces there."""
    contacts = ContactPoints(world)
    found = [contacts.at(run.qpos[k], run.qvel[k], run.belt[k], run.flipper_command[k]) for k in rows]
    points, forces = (np.concatenate([one[part] for one in found]) for part in (0, 1))
    counts = np.array([len(one[0]) for one in found])
    time, entity = run.time[rows], f"{RUN}/contacts"
    style: dict[str, Any] = {"colors": [rgb(VERMILLION)], "radii": [0.008]}
    send_shapes(stream, f"{entity}/points", time, counts, rr.Points3D, style, positions=points)
    style = {"colors": [rgb(GREEN)], "radii": [0.004]}
    arrows = {"origins": points, "vectors": _NEWTON * forces}
    send_shapes(stream, f"{entity}/forces", time, counts, rr.Arrows3D, style, **arrows)


def _series(run: DrivenCourse) -> Iterator[Series]:
    """Everything that is plotted."""
    state = run.state
    tracks, flippers = (tuple(name.replace("_", " ") for name in names) for names in (run.tracks, run.flippers))
    for entity, values in (
        ("slip/tracks", run.slip),
        ("contact/load", run.load),
        ("contact/traction", run.traction),
        ("belts/mean", run.belt),
    ):
        yield Series(entity, values, tracks, _COLOURS)
    yield Series("contact/depth", 1e3 * run.depth.max(axis=1, keepdims=True), ("largest",), (GREY,))
    attitude = np.degrees(np.stack([state.pitch, state.roll, run.slope], axis=-1))
    yield Series("attitude/chassis", attitude, ("pitch", "roll", "slope of the ground"), (LEFT, RIGHT, GREY))
    if flippers:
        yield Series("attitude/flippers", np.degrees(state.flippers), flippers, _COLOURS)
