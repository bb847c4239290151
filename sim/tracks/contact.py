"""Contact parameters of a compiled model's tracks: matched to the robot's mobility, and hard cores for landings."""

from __future__ import annotations

import itertools
import math

import mujoco
import numpy as np

from sim.tracks.description import TracksInModel
from sim.tracks.recipe import require_stable, set_options
from trackslip.errors import require


def set_contacts(model: mujoco.MjModel, tracks: TracksInModel) -> None:
    """Set the parameters of all contact pairs of tracks, and the options that they need.

    Raises InvalidValueError for a time step at which the preset isn't stable, for a robot that can't move, and for so
    many contact points that the engine would stiffen them.
    """
    preset = tracks.preset
    require_stable(model.opt.timestep, preset)
    set_options(model.opt, preset)
    body = int(tracks.bodies[0])
    require(model.body_weldid[body] != 0, "body", tracks.names[0], "on a body that moves: give the robot a free joint")
    mass = float(model.body_subtreemass[model.body_rootid[body]]) * tracks.load
    gravity = float(np.linalg.norm(model.opt.gravity)) or 9.81
    rocks = max(mobility(model, tracks, mass), 1.0)  # a robot that is held, as on a test rig, has none
    grip = preset.grip * preset.regularisation / preset.regularise(gravity, rocks, np.inf)
    place = {int(geom): k for k, geom in enumerate(tracks.geoms)}
    ends = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
    pairs = np.flatnonzero(np.isin(ends, tracks.geoms).any(axis=1))
    require(pairs.size, "terrain", tracks.names[0], "connected before the model is compiled: see connect")
    ours = np.isin(ends[pairs], tracks.geoms)
    weight = tracks.weights[[place[geom] for geom in ends[pairs][ours].tolist()]]
    grounds = ends[pairs][~ours]
    softness = model.body_invweight0[body, 0] + model.body_invweight0[model.geom_bodyid[grounds], 0]
    share = mass * softness / tracks.points
    field = model.geom_type[grounds] == mujoco.mjtGeom.mjGEOM_HFIELD  # a point of it may touch any number of times
    regularisation = preset.regularise(gravity, np.where(field, np.inf, rocks), share * tracks.weights.min())
    belts, core = preset.contact(gravity, share * weight, regularisation, grip), preset.core()
    hard = model.pair_margin[pairs, None] < 0
    for name in vars(core):
        getattr(model, f"pair_{name}")[pairs] = np.where(hard, getattr(core, name), getattr(belts, name))


def mobility(model: mujoco.MjModel, tracks: TracksInModel, mass: float) -> float:
    """Largest ratio [-] of a robot's squared natural frequencies on its tracks to its squared heave frequency.

    Each run stands on springs that together carry the robot's `mass` [kg]. A box on two tracks has about 3 in roll; a
    light flipper on its hinge has more.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    mujoco.mj_factorM(model, data)
    return max(_stiffest(model, data, tracks, mass, run) for run in range(len(tracks.hull.runs)))


def _stiffest(model: mujoco.MjModel, data: mujoco.MjData, tracks: TracksInModel, mass: float, run: int) -> float:
    shape = tracks.hull.runs[run]
    rows = []
    places = 2 if tracks.segment >= shape.length else 5
    for body in tracks.bodies:
        rotation, origin = data.xmat[body].reshape(3, 3), data.xpos[body]
        normal = rotation[:, [0, 2]] @ shape.outwards
        for part, (aside, load) in itertools.product(np.linspace(0.0, 1.0, places), tracks.lines):
            point = origin + rotation[:, [0, 2]] @ (shape.start + part * (shape.end - shape.start))
            point += aside * rotation[:, 1]
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, point, body)
            rows.append(math.sqrt(load) * (normal @ jacobian))
    along = np.array(rows)
    moved = np.zeros_like(along)
    mujoco.mj_solveM(model, data, moved, along)
    return float(np.linalg.eigvalsh(along @ moved.T).max()) * mass * len(tracks.lines) / len(rows)
