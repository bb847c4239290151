"""How easily the points of a track move, compared with a robot that only heaves."""

from __future__ import annotations

import mujoco
import numpy as np

from sim.tracks.parts import TrackParts


def mobility(model: mujoco.MjModel, tracks: TrackParts, mass: float) -> tuple[float, float]:
    """Largest ratio [-] of the squared frequencies of a robot on its tracks to that of its heave.

    The second number is the largest inverse mass of a point of the tracks along its normal [1/kg]. Each run stands on
    springs that together carry the robot's `mass` [kg]. A box on two tracks has about 2 in roll; a light flipper on its
    hinge has more, and springs of that stiffness would throw it off.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    mujoco.mj_factorM(model, data)
    found = [_stiffest(model, data, tracks, mass, run) for run in range(len(tracks.hull.runs))]
    return max(ratio for ratio, _ in found), max(point for _, point in found)


def _stiffest(
    model: mujoco.MjModel, data: mujoco.MjData, tracks: TrackParts, mass: float, run: int
) -> tuple[float, float]:
    shape = tracks.hull.runs[run]
    rows = []
    places = 2 if tracks.segment >= shape.length else 5
    for body in (model.body(name).id for name in tracks.bodies):
        rotation, origin = data.xmat[body].reshape(3, 3), data.xpos[body]
        normal = rotation[:, [0, 2]] @ shape.outwards
        for part in np.linspace(0.0, 1.0, places):
            point = origin + rotation[:, [0, 2]] @ (shape.start + part * (shape.end - shape.start))
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, point, body)
            rows.append(normal @ jacobian)
    along = np.array(rows)
    moved = np.zeros_like(along)
    mujoco.mj_solveM(model, data, moved, along)
    inverse = along @ moved.T
    return float(np.linalg.eigvalsh(inverse).max()) * mass / len(rows), float(np.diag(inverse).max())
