"""A drive over a course in a recording: terrain, the robot with its belts and wheels, contacts with forces, plots."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import rerun as rr

from experiments.course.run import CourseRun
from experiments.recording import robot_mesh
from experiments.recording.blueprint import begin_of_loop, blueprint
from experiments.recording.columns import mesh, rgb, send, send_properties, send_series
from experiments.recording.field import FIELD
from experiments.recording.robot import CAMERA, ROBOT
from experiments.recording.series import LEFT, RIGHT, Panel, Series, range_of
from experiments.recording.stream import RUN
from experiments.report.colours import BLUE, GREEN, GREY, VERMILLION
from sim.robot.tracked_model import TrackedModel
from sim.robot.tracked_view import track_looks
from sim.tracks.looks import BOX, Pieces
from sim.traverse.contact import ContactPoints
from trackslip.kinematics import Array

_EVERY = 2  # one row in so many is drawn
_MARGIN = 3.0  # of the floor around the course [m]
_NEWTON = 0.002  # length of a force arrow [m/N]
_SLIP_RANGE = (-0.5, 1.0)
_COLOURS = (LEFT, RIGHT, "#009E73", "#F0E442", "#CC79A7", "#D55E00", "#8d6bd1", "#bbbbbb")
_TABS = ("Slip and forces", "Attitude and flippers")
PANELS = (
    Panel("Slip [-]", ("slip/tracks",), _SLIP_RANGE, 1.6, tab=_TABS[0]),
    Panel("Load [N]", ("contact/load",), tab=_TABS[0]),
    Panel("Traction [N]", ("contact/traction",), tab=_TABS[0]),
    Panel("Penetration [mm]", ("contact/depth",), legend=False, tab=_TABS[0]),
    Panel("Attitude and slope [deg]", ("attitude/chassis",), tab=_TABS[1]),
    Panel("Flippers [deg]", ("attitude/flippers",), tab=_TABS[1]),
    Panel("Belts [m/s]", ("belts/mean",), tab=_TABS[1]),
)
"""Plots over time."""


def send_course_drive(
    stream: rr.RecordingStream, run: CourseRun, world: TrackedModel, about: Mapping[str, Any]
) -> None:
    """Send a drive to a stream; `world` is the model with its looks."""
    rows = np.arange(0, len(run.time), _EVERY)
    time, position = run.time[rows], run.state.position
    within = position[:, :2]
    stream.log(f"{FIELD}/course", mesh(terrain(world.model)), static=True)
    send(stream, CAMERA, time, rr.Transform3D.columns(translation=position[rows]))
    _send_robot(stream, run, world, rows)
    _send_contacts(stream, run, world, rows)
    strip = rr.LineStrips3D([position[rows] + [0, 0, 0.02]], colors=[rgb(BLUE)], radii=[0.008])
    stream.log(f"{RUN}/path/true", strip, static=True)
    series = list(_series(run))
    sent = send_series(stream, RUN, run.time, series)
    send_properties(stream, RUN, about)
    panels = [replace(panel, range=panel.range or range_of(panel, series)) for panel in PANELS]
    duration = float(run.time[-1])
    begin = begin_of_loop(float(run.time[np.argmax(np.abs(run.state.pitch))]), duration)
    stream.send_blueprint(blueprint([RUN], panels, sent, within, begin, duration))


def terrain(model: mujoco.MjModel) -> robot_mesh.Triangles:
    """Everything that is fixed in the world; a plane ends around it."""
    fixed = robot_mesh.drawn(model, 0)
    planes = [i for i in fixed if model.geom_type[i] == mujoco.mjtGeom.mjGEOM_PLANE]
    parts = [robot_mesh.geom(model, i) for i in fixed if i not in planes]
    around = np.concatenate([part.vertices[:, :2] for part in parts]) if parts else np.zeros((1, 2))
    low, high = around.min(axis=0) - _MARGIN, around.max(axis=0) + _MARGIN
    for i in planes:
        corners = np.array([[low[0], low[1]], [high[0], low[1]], high, low, high, [low[0], high[1]]])
        vertices = np.column_stack([corners, np.full(6, model.geom_pos[i, 2])])
        colour = np.rint(255 * model.geom_rgba[i]).astype(np.uint8)
        parts.append(robot_mesh.Triangles(vertices, np.tile(colour, (6, 1))))
    return robot_mesh.joined(parts)


def _send_robot(stream: rr.RecordingStream, run: CourseRun, world: TrackedModel, rows: np.ndarray) -> None:
    """Send every body that is drawn, and the tracks on it."""
    model, looks = world.model, track_looks(world)
    carriers = {body for body, _ in looks}
    bodies = [b for b in range(1, model.nbody) if robot_mesh.drawn(model, b) or b in carriers]
    position, attitude = _poses(model, run.qpos[rows], bodies)
    travel = run.travel[rows]
    for k, body in enumerate(bodies):
        entity = f"{RUN}/{ROBOT}/{model.body(body).name or body}"
        columns = rr.Transform3D.columns(translation=position[:, k], quaternion=np.roll(attitude[:, k], -1, axis=-1))
        send(stream, entity, run.time[rows], columns)
        if geoms := robot_mesh.drawn(model, body):
            parts = robot_mesh.joined([robot_mesh.geom(model, i) for i in geoms])
            stream.log(f"{entity}/body", mesh(parts), static=True)
        for track, (carrier, look) in enumerate(looks):
            if carrier == body:
                _send_track(stream, f"{entity}/{run.tracks[track]}", run.time[rows], look.pieces(travel[:, track]))


def _send_track(stream: rr.RecordingStream, entity: str, time: Array, pieces: Pieces) -> None:
    """Send the pieces of a track: those that are alike as copies of one mesh, those that never move only once."""
    alike, which = np.unique(np.column_stack([pieces.kind, pieces.size, pieces.rgba]), axis=0, return_inverse=True)
    moves = np.ptp(pieces.position, axis=0).max(axis=-1) + np.ptp(pieces.angle, axis=0) > 0
    for k, (kind, *rest) in enumerate(alike):
        size, rgba = np.array(rest[:3]), np.rint(255 * np.array(rest[3:])).astype(np.uint8)
        corners = robot_mesh.box(size) if kind == BOX else robot_mesh.wheel(size[0], size[1])
        shape = mesh(robot_mesh.Triangles(corners, np.tile(rgba, (len(corners), 1))))
        mine = which.ravel() == k
        half = pieces.angle[:, mine] / 2
        zero = np.zeros_like(half)
        turn = np.stack([zero, np.sin(half), zero, np.cos(half)], axis=-1)
        place = pieces.position[:, mine]
        name = f"{entity}/{k}"
        stream.log(name, shape, static=True)
        if not moves[mine].any():
            poses = rr.InstancePoses3D(translations=place[0], quaternions=turn[0])
            stream.log(name, poses, static=True)
            continue
        columns = rr.InstancePoses3D.columns(translations=place.reshape(-1, 3), quaternions=turn.reshape(-1, 4))
        send(stream, name, time, columns.partition(np.full(len(time), place.shape[1])))


def _poses(model: mujoco.MjModel, qpos: Array, bodies: list[int]) -> tuple[Array, Array]:
    """Positions (R, B, 3) and attitudes (R, B, 4), w first, of bodies in states qpos (R, nq)."""
    data = mujoco.MjData(model)
    position, attitude = np.empty((len(qpos), len(bodies), 3)), np.empty((len(qpos), len(bodies), 4))
    for k, one in enumerate(qpos):
        data.qpos[:] = one
        mujoco.mj_kinematics(model, data)
        position[k], attitude[k] = data.xpos[bodies], data.xquat[bodies]
    return position, attitude


def _send_contacts(stream: rr.RecordingStream, run: CourseRun, world: TrackedModel, rows: np.ndarray) -> None:
    """Send where the robot touches the ground, and the forces there."""
    contacts = ContactPoints(world)
    found = [contacts.at(run.qpos[k], run.qvel[k], run.belt[k], run.flipper_command[k]) for k in rows]
    points, forces = (np.concatenate([one[part] for one in found]) for part in (0, 1))
    counts = np.array([len(one[0]) for one in found])
    for entity, style in (
        ("points", rr.Points3D.from_fields(colors=[rgb(VERMILLION)], radii=[0.008])),
        ("forces", rr.Arrows3D.from_fields(colors=[rgb(GREEN)], radii=[0.004])),
    ):
        stream.log(f"{RUN}/contacts/{entity}", style, static=True)
    if len(points):
        time = run.time[rows]
        columns = rr.Points3D.columns(positions=points)
        send(stream, f"{RUN}/contacts/points", time, columns.partition(counts))
        columns = rr.Arrows3D.columns(origins=points, vectors=_NEWTON * forces)
        send(stream, f"{RUN}/contacts/forces", time, columns.partition(counts))


def _series(run: CourseRun) -> Iterator[Series]:
    """Everything that is plotted."""
    state, names = run.state, tuple(name.replace("_", " ") for name in run.tracks)
    colours = tuple(_COLOURS[k % len(_COLOURS)] for k in range(len(names)))
    for entity, values in (
        ("slip/tracks", run.slip),
        ("contact/load", run.load),
        ("contact/traction", run.traction),
        ("belts/mean", run.belt),
    ):
        yield Series(entity, values, names, colours)
    yield Series("contact/depth", 1e3 * run.depth.max(axis=1, keepdims=True), ("largest",), (GREY,))
    attitude = np.degrees(np.stack([state.pitch, state.roll, run.slope], axis=-1))
    yield Series("attitude/chassis", attitude, ("pitch", "roll", "slope of the ground"), (LEFT, RIGHT, GREY))
    if run.flippers:
        flippers = tuple(name.replace("_", " ") for name in run.flippers)
        colours = tuple(_COLOURS[k % len(_COLOURS)] for k in range(len(flippers)))
        yield Series("attitude/flippers", np.degrees(state.flippers), flippers, colours)
