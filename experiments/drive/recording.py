"""Recording of a drive over a course: terrain, the robot with its belts and wheels, contacts with
forces, plots.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
import rerun as rr

from experiments.common.colours import BLUE, GREEN, VERMILLION
from experiments.drive.course import DrivenCourse
from experiments.recorder.model import drawn, send_geoms, send_paving, send_robot
from experiments.recorder.plots import LEFT, RIGHT, Panel, send_layout
from experiments.recorder.stream import (
    CAMERA,
    FIELD,
    RUN,
    Recording,
    Series,
    paint,
    write_recording,
)
from sim.robot.looks import RobotLooks
from sim.robot.tracked_model import TrackedModel
from sim.traverse.outcome import ContactPoints
from trackslip.kinematics import Array

_EVERY: Final = 2  # every n-th row is drawn
_NEWTON: Final = 0.002  # length of a force arrow [m/N]
_COLOURS: Final = (LEFT, RIGHT, "#009E73", "#F0E442", "#CC79A7", "#D55E00", "#8d6bd1", "#bbbbbb")
# tabs of the viewer
_FORCES: Final = "Slip and forces"
_ATTITUDE: Final = "Attitude and flippers"


def record_course_drive(file: Path, run: DrivenCourse, looks: TrackedModel) -> None:
    """Record a drive over a course; `looks` is the model to draw. Raises OutputError as `record`
    does.
    """

    def send(recording: Recording) -> None:
        rows = np.arange(0, len(run.time), _EVERY)
        position = run.state.position
        driven = position[rows] + [0, 0, 0.02]
        _send_terrain(recording, looks.model, position[:, :2])
        recording.poses(CAMERA, run.time[rows], position[rows])
        _send_robot(recording, run, looks, rows)
        _send_contacts(recording, run, looks, rows)
        recording.line(f"{RUN}/path/driven", driven, BLUE, 0.008)
        panels = _send_plots(recording, run)
        send_layout(recording, [RUN], panels, position[:, :2])

    write_recording(file, f"{run.robot.name}: {run.outcome}", send)


def _send_robot(
    recording: Recording, run: DrivenCourse, looks: TrackedModel, rows: np.ndarray
) -> None:
    """Send the robot at its poses, with its belts turning."""
    shown = RobotLooks.of(looks)
    tracks = [
        (name, body, look) for name, (_, body, look) in zip(run.tracks, shown.tracks, strict=True)
    ]
    time = run.time[rows]
    qpos = run.state.qpos[rows]
    send_robot(recording, RUN, looks.model, time, qpos, tracks, run.travel[rows])


def _send_terrain(recording: Recording, model: mujoco.MjModel, path: np.ndarray) -> None:
    """Send everything fixed in the world, and a floor that surrounds it and the robot's path (n,
    2).
    """
    send_geoms(recording, f"{FIELD}/course", model, 0)
    fixed = drawn(model, 0)
    middle = model.geom_pos[fixed, :2]
    reach = model.geom_rbound[fixed, None]
    within = np.concatenate([middle - reach, middle + reach, path])
    for i in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE):
        height = float(model.geom_pos[i, 2])
        send_paving(recording, within, height)


def _send_contacts(
    recording: Recording, run: DrivenCourse, looks: TrackedModel, rows: np.ndarray
) -> None:
    """Send the points where the robot touches the ground, and the forces there."""
    contacts = ContactPoints(looks)
    points = []
    arrows = []
    for k in rows:
        state = run.state
        belt = run.contact.belt[k]
        flippers = run.command.flippers[k]
        touched, forces = contacts.at(state.qpos[k], state.qvel[k], belt, flippers)
        points.append(touched)
        arrows.append(_NEWTON * forces)

    time = run.time[rows]
    counts = np.array([len(touched) for touched in points])
    places = np.concatenate(points)
    dot = rr.Points3D.from_fields(**paint(VERMILLION, 0.008))
    recording.shapes(f"{RUN}/contacts/points", time, counts, dot, positions=places)
    arrow = rr.Arrows3D.from_fields(**paint(GREEN, 0.004))
    vectors = np.concatenate(arrows)
    recording.shapes(f"{RUN}/contacts/forces", time, counts, arrow, origins=places, vectors=vectors)


def _send_plots(recording: Recording, run: DrivenCourse) -> list[Panel]:
    """Send the lines of the plots over time; returns the panels."""
    panels = []

    def plot(tab: str, title: str, entity: str, values: Array, names: Sequence[str]) -> None:
        """Send the lines of a plot, if there are any, and add its panel."""
        legend = [name.replace("_", " ") for name in names]
        lines = [Series(entity, values, legend, _COLOURS)] if legend else []
        recording.series(RUN, run.time, lines)
        panels.append(Panel(title, (entity,), tab=tab, has_outliers="slip" in entity))

    contact = run.contact
    depth_mm = 1e3 * contact.depth
    plot(_FORCES, "Slip [-]", "slip/tracks", contact.slip, run.tracks)
    plot(_FORCES, "Load [N]", "contact/load", contact.load, run.tracks)
    plot(_FORCES, "Traction [N]", "contact/traction", contact.traction, run.tracks)
    plot(_FORCES, "Penetration [mm]", "contact/depth", depth_mm, run.tracks)

    leans = ("pitch", "roll", "slope")
    flippers = np.degrees(run.angles)
    plot(_ATTITUDE, "Attitude and slope [deg]", "attitude/chassis", run.attitude, leans)
    plot(_ATTITUDE, "Flippers [deg]", "attitude/flippers", flippers, run.flippers)
    plot(_ATTITUDE, "Belts [m/s]", "belts/mean", contact.belt, run.tracks)
    return panels
