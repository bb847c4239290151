"""Tracks in the engine: speeds of belts on moving bodies, rows of a batch, computing time."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.validate.terrain.obstacles import SPEED, climber, rough_course, stairs_course
from experiments.validate.terrain.subjects import STAIRS, Subject, TerrainRobot
from experiments.validate.terrain.trial import LevelGround, TerrainTrial
from sim.robot.tracked_model import Terrain
from sim.terrain import Course
from trackslip.kinematics import Array

_STATES = 20  # random states of a moving robot
_SUNK = 0.01  # depth at which it touches the ground [m]
_ROWS = 4
ROW_TIME = 1.0  # for which rows of a batch are compared with robots alone [s]
TIMED = 4.0
"""Simulated time over which the computing time is taken [s]."""
WARM = 1.0  # before it [s]
_FLAPPING = (0.3, -0.2)  # angles of flippers that reach the ground at random attitudes [rad]


@dataclass(frozen=True)
class EngineSpeed:
    """Simulated time over computing time of one core, one robot [-]."""

    flat: float
    stairs: float
    """On ten steps."""
    rough: float


def belt_error(subject: Subject, preset: str, rng: np.random.Generator) -> float:
    """Largest difference of a contact's sliding velocity from that of the belt, robots moving at random [m/s].

    The velocity comes from the engine's constraints; the belt's from its body's motion, its wheels and its speed.
    """
    stand = subject.stand(LevelGround(), preset, flippers=_FLAPPING)
    model, data = stand.model, mujoco.MjData(stand.model)
    worst = 0.0
    for _ in range(_STATES):
        data.qpos[:] = stand.qpos
        position, _ = stand.free
        data.qpos[position + 2] -= _SUNK
        attitude = np.array([1.0, *rng.uniform(-0.03, 0.03, 2), rng.uniform(-1.0, 1.0)])
        data.qpos[position + 3 : position + 7] = attitude / np.linalg.norm(attitude)
        data.qvel[:] = rng.uniform(-1.0, 1.0, model.nv)
        speeds = rng.uniform(-1.0, 1.0, len(stand.track_side))
        stand.belts.set(model, speeds)
        mujoco.mj_forward(model, data)
        worst = float(np.maximum(worst, _contact_error(stand, data, speeds)))
    return worst


def _contact_error(stand: TerrainRobot, data: mujoco.MjData, speeds: Array) -> float:
    """The largest difference in one state."""
    model, worst = stand.model, float("nan")
    jacobian = np.zeros((3, model.nv))
    tracks = [(each.hull, names) for each in stand.tracks for names in each.geoms]
    for contact in data.contact:
        geom = int(contact.geom[1])
        name = model.geom(geom).name
        track = next((k for k, (_, names) in enumerate(tracks) if name in names), None)
        if track is None:
            continue
        hull, body = tracks[track][0], model.geom_bodyid[geom]
        turn = data.xmat[body].reshape(3, 3)
        kind, index = re.search(r"_(run|wheel)(\d+)", name).groups()  # type: ignore[union-attr]
        if kind == "run":
            ahead = hull.runs[int(index)].along
            belt = turn @ np.array([ahead[0], 0.0, ahead[1]])
        else:
            radius = hull.wheels[int(index), 2]
            belt = np.cross(turn[:, 1], contact.pos - data.geom_xpos[geom]) / radius
        mujoco.mj_jac(model, data, jacobian, None, contact.pos, body)
        frame = np.asarray(contact.frame).reshape(3, 3)
        expected = frame[1:] @ (jacobian @ data.qvel + speeds[track] * belt)
        found = data.efc_vel[contact.efc_address + 1 : contact.efc_address + 3]
        worst = float(np.fmax(worst, np.abs(found - expected).max()))
    return worst


def differing_numbers(subject: Subject, preset: str, rng: np.random.Generator) -> int:
    """Count of state values in which rows of a batch differ from robots simulated alone."""
    speeds = rng.uniform(0.1, 0.3, (_ROWS, 2))
    trial = _on_course(climber(subject), stairs_course(), preset, _ROWS, 2)
    start = trial.batch.qpos.copy()
    trial.drive(speeds)
    trial.advance(ROW_TIME)
    stand, differing = trial.stand, 0
    for k in range(_ROWS):
        data = mujoco.MjData(stand.model)
        data.qpos[:] = start[k]
        if stand.model.nu:
            data.ctrl[:] = stand.control
        stand.belts.set(stand.model, speeds[k, stand.track_side])
        mujoco.mj_step(stand.model, data, round(ROW_TIME / trial.timestep))
        differing += int((data.qpos != trial.batch.qpos[k]).sum() + (data.qvel != trial.batch.qvel[k]).sum())
    return differing


def speed(subject: Subject, preset: str) -> EngineSpeed:
    """Take the computing time of a robot that drives on level ground, ten steps and rough ground."""
    trials = (
        _on_course(subject, None, preset, 1, 1),
        _on_course(climber(subject), stairs_course(), preset, 1, 1),
        _on_course(subject, rough_course(8.0), preset, 1, 1),
    )
    return EngineSpeed(*(_timed(trial) for trial in trials))


def _timed(trial: TerrainTrial) -> float:
    trial.drive(np.array([SPEED, SPEED]))
    trial.advance(WARM)
    began = time.process_time()
    trial.advance(TIMED)
    return TIMED / (time.process_time() - began)


def _on_course(subject: Subject, course: Course | None, preset: str, size: int, threads: int) -> TerrainTrial:
    terrain: Terrain = LevelGround() if course is None else course
    trial = TerrainTrial(subject.stand(terrain, preset, flippers=STAIRS), size, threads)
    if course is not None:
        trial.position[:] += np.array(course.start[:3])
    return trial
