"""Descriptions of tracks inside a model: a `<tuple>` of geoms and a `<numeric>` recipe, both called
NAME_tracks.

Both remain in a model that is saved, loaded, or attached to another model with a prefix.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.tracks.hull import Hull
from sim.tracks.recipe import Preset, require_stable, set_options
from trackslip.errors import require

Array = NDArray[np.float64]
_ENDING = "_tracks"
_TRACK = "_track"  # suffix in the names of bodies and contact sensors
_PRESET = len(fields(Preset))  # number of values in a recipe
_HEAD = _PRESET + 5


@dataclass(frozen=True)
class Description:
    """The tracks that one call of `add_tracks` added to a spec."""

    preset: Preset  # the contact recipe
    friction: tuple[float, float]  # coefficients along and across [-]
    load: float  # share of the robot's weight on these tracks when it stands on them [-]
    points: float  # number of contact points on the tracks' longest runs, weighted by stiffness [-]
    segment: float  # length of each capsule along the longest run [m]
    geoms: tuple[str, ...]  # names of all tracks' geoms, track by track
    weights: tuple[float, ...]  # stiffness of the geoms, relative to a capsule's end [-]
    cores: tuple[float, ...]  # depths of the geoms' cores, 0 for geoms without a core [m]

    def write(self, spec: mujoco.MjSpec, name: str) -> None:
        """Write the description into a spec."""
        head = (*astuple(self.preset), *self.friction, self.load, self.points, self.segment)
        spec.add_numeric(name=name + _ENDING, data=[*map(float, head), *self.cores])
        kinds = [mujoco.mjtObj.mjOBJ_GEOM] * len(self.geoms)
        spec.add_tuple(
            name=name + _ENDING, objtype=kinds, objname=list(self.geoms), objprm=list(self.weights)
        )


def descriptions(spec: mujoco.MjSpec) -> dict[str, Description]:
    """All tracks in a spec, by name without the suffix, in the order in which they were added."""
    numbers = {numeric.name: list(numeric.data) for numeric in spec.numerics}
    return {
        each.name.removesuffix(_ENDING): Description(
            *_head(numbers[each.name]),
            tuple(each.objname),
            tuple(each.objprm),
            tuple(numbers[each.name][_HEAD:]),
        )
        for each in spec.tuples
        if _ENDING in each.name and each.name in numbers
    }


def _head(numbers: Sequence[float]) -> tuple[Preset, tuple[float, float], float, float, float]:
    timestep, segments, *rest, along, across, load, points, segment = numbers[:_HEAD]
    return Preset(timestep, int(segments), *rest), (along, across), load, points, segment


class TracksInModel:
    """The tracks that one call of `add_tracks` added, in a compiled model."""

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        """Read the tracks with this name, which includes the suffix."""
        described, numbers = model.tuple(name), model.numeric(name).data.tolist()
        self.preset, _, self.load, self.points, self.segment = _head(numbers)
        self.geoms: NDArray[np.int_] = described.objid.copy()  # (G,)
        self.weights: Array = described.objprm.copy()  # (G,) stiffness relative to a capsule's end
        owner = model.geom_bodyid[self.geoms]
        self.bodies = owner[np.sort(np.unique(owner, return_index=True)[1])]  # (T,)
        self.names = tuple(model.body(body).name.removesuffix(_TRACK) for body in self.bodies)
        # (G,) index of each geom's track
        self.track = (owner[:, None] == self.bodies).argmax(axis=1)
        self.direction = _directions(model, self.geoms)
        """Surface velocities (G, 6) in the geoms' frames at a belt speed of 1 m/s."""
        round_ = self.direction[:, 3:].any(axis=1) & (owner == self.bodies[0])
        wheels = self.geoms[round_]
        place = model.geom_pos[wheels]
        radius = model.geom_size[wheels, 0]
        # a belt repeats its wheels on each line of contact; wheels without one may lie anywhere
        is_belted = self.direction[:, 2].any()
        first = (place[:, 1] == place[0, 1]) | ~is_belted
        self.hull = Hull.from_wheels(np.column_stack([place[:, [0, 2]], radius])[first].tolist())
        """Hull of each track."""
        beside = (place[:, [0, 2]] == place[0, [0, 2]]).all(axis=1)
        shares = self.weights[round_][beside]
        self.lines = np.column_stack([place[beside, 1], shares / shares.sum()])
        """Lines of contact (L, 2): lateral distance from the belt's middle [m], and share of the
        load [-].
        """


def tracks_in(model: mujoco.MjModel) -> list[TracksInModel]:
    """All tracks in a compiled model, in the order in which they were added."""
    named = {model.numeric(k).name for k in range(model.nnumeric)}
    names = [model.tuple(k).name for k in range(model.ntuple)]
    return [TracksInModel(model, name) for name in names if _ENDING in name and name in named]


def _directions(model: mujoco.MjModel, geoms: NDArray[np.int_]) -> Array:
    """Surface velocities (G, 6): about y for spheres and lateral capsules, along their own z for
    other capsules.
    """
    axes = np.zeros((len(geoms), 9))
    for geom, into in zip(geoms, axes, strict=True):
        mujoco.mju_quat2Mat(into, model.geom_quat[geom])
    across = axes.reshape(-1, 3, 3)[:, 1, 2]  # of each geom's z axis
    turning = 1 / model.geom_size[geoms, 0]  # rate at a belt speed of 1 m/s [rad/s]
    is_sphere = model.geom_type[geoms] == mujoco.mjtGeom.mjGEOM_SPHERE
    is_lateral = ~is_sphere & (np.abs(across) > 0.5)
    direction = np.zeros((len(geoms), 6))
    direction[:, 2] = ~is_sphere & ~is_lateral
    direction[:, 4] = np.where(is_sphere, turning, 0.0)
    direction[:, 5] = np.where(is_lateral, np.sign(across) * turning, 0.0)
    return direction


def set_contacts(model: mujoco.MjModel, tracks: TracksInModel) -> None:
    """Set the parameters of the tracks' contact pairs, and the engine options that these pairs
    need.

    Raises InvalidValueError for a time step at which the preset isn't stable, for a robot that
    can't move, and if there are so many contact points that the engine would stiffen them.
    """
    preset = tracks.preset
    require_stable(model.opt.timestep, preset)
    set_options(model.opt, preset)
    body = int(tracks.bodies[0])
    is_conveyor = model.body_treeid[body] < 0
    trees = loads_on(model, body) if is_conveyor else model.body_treeid[[body]]
    require(
        trees.size,
        "body",
        tracks.names[0],
        "on a body that moves, or connected with one: give the robot or the load a free joint",
    )
    mass = float(moving_mass(model, body)) * tracks.load
    # belts don't wake what they move
    model.tree_sleep_policy[trees] = mujoco.mjtSleepPolicy.mjSLEEP_NEVER
    gravity = float(np.linalg.norm(model.opt.gravity)) or 9.81
    # a robot held on a test rig and a conveyor, for example, have no mobility at all
    rocks = max(mobility(model, tracks, mass), 1.0)
    grip = preset.grip * preset.regularisation / preset.regularise(gravity, rocks, np.inf)
    place = {int(geom): k for k, geom in enumerate(tracks.geoms)}
    ends = np.stack([model.pair_geom1, model.pair_geom2], axis=1)
    pairs = np.flatnonzero(np.isin(ends, tracks.geoms).any(axis=1))
    require(
        pairs.size,
        "terrain",
        tracks.names[0],
        "connected before the model is compiled: see connect",
    )
    ours = np.isin(ends[pairs], tracks.geoms)
    weight = tracks.weights[[place[geom] for geom in ends[pairs][ours].tolist()]]
    grounds = ends[pairs][~ours]
    softness = model.body_invweight0[body, 0] + model.body_invweight0[model.geom_bodyid[grounds], 0]
    share = mass * softness / tracks.points
    field = model.geom_type[grounds] == mujoco.mjtGeom.mjGEOM_HFIELD  # a geom may touch it anywhere
    regularisation = preset.regularise(
        gravity, np.where(field, np.inf, rocks), share * tracks.weights.min()
    )
    belts, core = preset.contact(gravity, share * weight, regularisation, grip), preset.core()
    hard = model.pair_margin[pairs, None] < 0
    for name in vars(core):
        getattr(model, f"pair_{name}")[pairs] = np.where(
            hard, getattr(core, name), getattr(belts, name)
        )


def moving_mass(model: mujoco.MjModel, bodies: NDArray[np.int_] | int) -> Any:
    """Masses (...) of the robots to which `bodies` (...) belong, without fixed bodies that carry a
    robot; of bodies that don't move, such as a conveyor's, the masses of all loads on them [kg].
    """

    def mass(body: int) -> float:
        tree = model.body_treeid[body]
        trees = loads_on(model, body) if tree < 0 else [tree]
        return float(model.body_subtreemass[model.tree_bodyadr[trees]].sum())

    return np.vectorize(mass, otypes=[float])(bodies)


def loads_on(model: mujoco.MjModel, body: int) -> NDArray[np.int_]:
    """Trees of bodies that have contact pairs with a body which doesn't move."""
    ends = model.geom_bodyid[np.stack([model.pair_geom1, model.pair_geom2], axis=1)]
    others = ends[(ends == body).any(axis=1)]
    trees = np.unique(model.body_treeid[others])
    return trees[trees >= 0]


def mobility(model: mujoco.MjModel, tracks: TracksInModel, mass: float) -> float:
    """Largest ratio of a robot's squared natural frequencies on its tracks to its squared heave
    frequency [-].

    Each run rests on springs that together carry the robot's `mass` [kg]. The ratio is about 3 for
    a box that rolls on two tracks, and larger for a light flipper on its hinge.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    mujoco.mj_factorM(model, data)
    return max(_stiffest(model, data, tracks, mass, run) for run in range(len(tracks.hull.runs)))


def _stiffest(
    model: mujoco.MjModel, data: mujoco.MjData, tracks: TracksInModel, mass: float, run: int
) -> float:
    """`mobility` of the tracks on one of their runs."""
    shape = tracks.hull.runs[run]
    places = 2 if tracks.segment >= shape.length else 5
    shares = np.linspace(0.0, 1.0, places)
    rows = []
    for body in tracks.bodies:
        rotation = data.xmat[body].reshape(3, 3)
        in_plane = rotation[:, [0, 2]]
        normal = in_plane @ shape.outwards
        for share, (aside, load) in itertools.product(shares, tracks.lines):
            on_run = shape.start + share * (shape.end - shape.start)
            point = data.xpos[body] + in_plane @ on_run
            point += aside * rotation[:, 1]
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, point, body)
            rows.append(math.sqrt(load) * (normal @ jacobian))
    along = np.array(rows)
    moved = np.zeros_like(along)
    mujoco.mj_solveM(model, data, moved, along)
    return float(np.linalg.eigvalsh(along @ moved.T).max()) * mass * len(tracks.lines) / len(rows)
