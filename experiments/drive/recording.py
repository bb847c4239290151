"""Recording of a drive over a course: terrain, the robot with its belts and wheels, contacts with
forces, plots.
"""

from pathlib import Path

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

_EVERY = 2  # every n-th row is drawn
_NEWTON = 0.002  # length of a force arrow [m/N]
_COLOURS = (LEFT, RIGHT, "#009E73", "#F0E442", "#CC79A7", "#D55E00", "#8d6bd1", "#bbbbbb")


def record_course_drive(file: Path, run: DrivenCourse, looks: TrackedModel) -> None:
    """Record a drive over a course; `looks` is the model to draw. Raises OutputError as `record`
    does.
    """

    def send(recording: Recording) -> None:
        rows = np.arange(0, len(run.time), _EVERY)
        time, position = run.time[rows], run.state.position
        _send_terrain(recording, looks.model, position[:, :2])
        recording.poses(CAMERA, time, position[rows])
        shown = RobotLooks.of(looks)
        tracks = [
            (name, body, look)
            for name, (_, body, look) in zip(run.tracks, shown.tracks, strict=True)
        ]
        send_robot(
            recording, RUN, looks.model, time, run.state.qpos[rows], tracks, run.travel[rows]
        )
        _send_contacts(recording, run, looks, rows)
        recording.line(f"{RUN}/path/driven", position[rows] + [0, 0, 0.02], BLUE, 0.008)
        panels = _send_plots(recording, run)
        send_layout(recording, [RUN], panels, position[:, :2])

    write_recording(file, f"{run.robot.name}: {run.outcome}", send)


def _send_terrain(recording: Recording, model: mujoco.MjModel, path: np.ndarray) -> None:
    """Send everything fixed in the world, and a floor that surrounds it and the robot's path (n,
    2).
    """
    send_geoms(recording, f"{FIELD}/course", model, 0)
    fixed = drawn(model, 0)
    middle, reach = model.geom_pos[fixed, :2], model.geom_rbound[fixed, None]
    for i in np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE):
        send_paving(
            recording,
            np.concatenate([middle - reach, middle + reach, path]),
            float(model.geom_pos[i, 2]),
        )


def _send_contacts(
    recording: Recording, run: DrivenCourse, looks: TrackedModel, rows: np.ndarray
) -> None:
    """Send the points where the robot touches the ground, and the forces there."""
    contacts, state = ContactPoints(looks), run.state
    moments = [
        contacts.at(state.qpos[k], state.qvel[k], run.contact.belt[k], run.command.flippers[k])
        for k in rows
    ]
    points, forces = (np.concatenate(parts) for parts in zip(*moments, strict=True))
    counts, time = np.array([len(points) for points, _ in moments]), run.time[rows]
    dot, arrow = (
        rr.Points3D.from_fields(**paint(VERMILLION, 0.008)),
        rr.Arrows3D.from_fields(**paint(GREEN, 0.004)),
    )
    recording.shapes(f"{RUN}/contacts/points", time, counts, dot, positions=points)
    recording.shapes(
        f"{RUN}/contacts/forces", time, counts, arrow, origins=points, vectors=_NEWTON * forces
    )


def _send_plots(recording: Recording, run: DrivenCourse) -> list[Panel]:
    """Send the lines of the plots over time; returns the panels."""
    contact, forces, attitude = run.contact, "Slip and forces", "Attitude and flippers"
    plots = (
        ("Slip [-]", "slip/tracks", contact.slip, run.tracks, forces),
        ("Load [N]", "contact/load", contact.load, run.tracks, forces),
        ("Traction [N]", "contact/traction", contact.traction, run.tracks, forces),
        ("Penetration [mm]", "contact/depth", 1e3 * contact.depth, run.tracks, forces),
        (
            "Attitude and slope [deg]",
            "attitude/chassis",
            run.attitude,
            ("pitch", "roll", "slope"),
            attitude,
        ),
        ("Flippers [deg]", "attitude/flippers", np.degrees(run.angles), run.flippers, attitude),
        ("Belts [m/s]", "belts/mean", contact.belt, run.tracks, attitude),
    )
    for _, entity, values, names, _ in plots:
        legend = [name.replace("_", " ") for name in names]
        recording.series(
            RUN, run.time, [Series(entity, values, legend, _COLOURS)] if legend else []
        )
    return [
        Panel(title, (entity,), tab=tab, has_outliers="slip" in entity)
        for title, entity, *_, tab in plots
    ]
