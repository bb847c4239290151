"""Compiled robots for the paper's field, the numbers that the simulator reads from them, and
rigid-body inertia.
"""

from __future__ import annotations

import copy
import hashlib
import math
import warnings
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

import models
from sim.robot.parameters import RobotParameters
from sim.tracks.recipe import (
    LEAST_ODDS,
    LEVEL,
    LEVEL_WHEELS,
    LEVEL_WIDE,
    Preset,
    track_points,
    warn_if_unverified,
)
from trackslip.arguments import checks_arguments
from trackslip.errors import RobotWarning
from trackslip.kinematics import TRACK_SIGNS, Array, RobotGeometry
from trackslip.localization.scan import Plate

MODELS = Path(models.__file__).parent
"""Folder of the shipped models."""
BODY_LOOKS = ("hull", "deck", "bumper", "left_lamp", "right_lamp")
"""Geoms that only show the body's shape."""
_TRACK_LOOKS = ("track0", "track1")
SCANNED_GROUP = 0
"""Geom group that the laser range finder sees."""
VISUAL_GROUP = 1
"""Geom group of the visuals, which are removed from the physics."""
CONTACT_POINTS = 2
"""Default number of contact points per pad."""
CONTACT_WIDTH = 9
"""Number of values from a contact sensor per point, in this order: force, position in the world,
velocity. Force and velocity have components normal to the ground, along the pad and across it.
"""
_Bit = mujoco.mjtDisableBit
# off: useless for a single body
_NOT_FOR_A_BODY = _Bit.mjDSBL_ISLAND | _Bit.mjDSBL_SPRING | _Bit.mjDSBL_DAMPER
_FORCE, _POSITION, _VELOCITY = 1, 4, 7  # bits of a contact sensor's data specification
# tilt of a pad with one point: only its lower end touches; its axis still sets directions
_TILT = np.radians(45.0)
_LENGTH = 0.02  # distance between the ends of a tilted pad [m]
_SHEARING = 4  # number of points in a wheel's patch on shearing ground
# points in a patch on other ground, with a uniform patch's spread [-]
_GAUSS = (-1 / math.sqrt(12), 1 / math.sqrt(12))


def shaped_robot(parameters: RobotParameters, file: str = "field.xml") -> Any:
    """The spec of a shipped model with the body that these parameters describe, without the looks
    of its tracks.
    """
    spec = mujoco.MjSpec.from_file(str(MODELS / file))
    for name in _TRACK_LOOKS:
        spec.delete(spec.body(name))
    shipped = RobotParameters()
    chassis = spec.body("chassis")
    size = np.array([parameters.contact_length, parameters.half_gauge, parameters.half_gauge])
    size /= [shipped.contact_length, shipped.half_gauge, shipped.half_gauge]
    spec.mesh("hull").scale = size
    for name in BODY_LOOKS:
        geom = spec.geom(name)
        geom.pos = geom.pos * size
        geom.size = geom.size * size

    raised = np.array([0.0, 0.0, parameters.plate_height - shipped.plate_height])
    mast = spec.geom("mast")
    mast.pos = mast.pos + raised / 2
    mast.size[1] += max(raised[2] / 2, -0.1)
    plate = spec.geom("plate")
    plate.pos = plate.pos + raised
    if lrf := spec.body("lrf"):  # only the field's model has it
        lrf.pos = lrf.pos + raised

    for site in (site for site in chassis.sites if "_footprint" in site.name):
        site.pos[1] = np.copysign(parameters.half_gauge, site.pos[1])
        # to either side of the middle: covers any contact points
        site.size[0] = parameters.contact_length
    growth = np.array([size[0], size[1], parameters.com_height / shipped.com_height])
    _set_mass(chassis, parameters, growth)
    return spec


def _set_mass(chassis: Any, parameters: RobotParameters, growth: np.ndarray) -> None:
    """Set the chassis' mass, its centre and its inertia; the shape grows by factors `growth` (3,)
    along x, y, z.
    """
    scaled = np.array(chassis.inertia) * (parameters.mass / chassis.mass)
    # second moments along x, y, z, which grow with the squares of the shape
    second = (scaled.sum() / 2 - scaled) * growth**2
    of_shape = (*(second.sum() - second), 0.0, 0.0, 0.0)
    chassis.mass = parameters.mass
    chassis.ipos = parameters.centre_of_mass
    chassis.inertia = [0.0, 0.0, 0.0]
    chassis.fullinertia = parameters.inertia or of_shape


def contact_points(parameters: RobotParameters, single: bool) -> tuple[Array, Preset]:
    """Contact points (n,) along one side of a robot, from rear to front [m], and their contact
    recipe.

    A track has one point in the middle of each segment; a wheel has two, or on shearing ground four
    `single` pads.
    """
    if not parameters.axles:
        count = track_points(parameters.half_gauge, parameters.contact_length, LEVEL)
        points = parameters.contact_length * _middles(count)
        return points, LEVEL if count == 2 * LEVEL.segments else LEVEL_WIDE
    warn_if_unverified(parameters.half_gauge, parameters.contact_length)
    in_patch = _middles(_SHEARING) if single else np.array(_GAUSS)
    # least that the engine allows, for any ground
    softest = LEAST_ODDS * 2 * _SHEARING * len(parameters.axles)
    preset = LEVEL_WHEELS.softer(min(1.0, LEVEL_WHEELS.regularisation / softest))
    around = parameters.patch_length * in_patch
    return np.add.outer(parameters.axles, around).ravel(), preset


def _middles(count: int) -> Array:
    """Middles (n,) of `count` equal segments that are 1 long together, from -1/2 to 1/2 [-]."""
    return (np.arange(count) + 0.5) / count - 0.5


def lay_pads(spec: Any, parameters: RobotParameters, single: bool = False) -> Array:
    """Replace a model's pads with those that a robot needs, and return the contact points (n,)
    along one side [m].

    A pad has two points, or one if `single`. The robot's sinkage and creep don't depend on the
    number of points.
    """
    chassis = spec.body("chassis")
    pads = [geom for geom in chassis.geoms if "_pad" in geom.name]
    plain = spec.pairs[0]
    ground = plain.geomname1
    friction = list(plain.friction)
    radius = pads[0].size[0]
    group = pads[0].group
    for thing in (*spec.pairs, *pads):
        spec.delete(thing)

    x, preset = contact_points(parameters, single)
    gravity = -float(spec.option.gravity[2])
    contact = preset.contact(gravity, 1 / (2 * len(x)), preset.regularisation, preset.grip)
    spec.option.impratio = preset.impratio
    raised = _LENGTH * np.array([np.cos(_TILT), 0.0, np.sin(_TILT)])
    for side, y in zip(("left", "right"), parameters.half_gauge * -TRACK_SIGNS, strict=True):
        place = np.stack([x, np.full_like(x, y), np.full_like(x, radius)], axis=1)
        # from the first to the second end of each pad
        spans = np.hstack([place, place + raised]) if single else place.reshape(-1, 6)
        for k, span in enumerate(spans):
            name = f"{side}_pad{k}"
            chassis.add_geom(
                name=name,
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=[radius, 0.0, 0.0],
                fromto=span,
                mass=0.0,
                contype=0,
                conaffinity=0,
                group=group,
            )
            spec.add_pair(
                geomname1=ground, geomname2=name, condim=3, friction=friction, **vars(contact)
            )
    return x


@dataclass(frozen=True)
class Robot:
    """A compiled model and the numbers read from it."""

    model: mujoco.MjModel  # the compiled model, without its visuals
    geometry: RobotGeometry  # half gauge and nominal sprocket radius
    mass: float  # [kg]
    plate: Plate  # the plate that the laser range finder sees
    plate_radius: float  # radius of the sphere around the plate [m]
    pads: slice  # the geoms that are contact capsules, each along its own z axis
    pad_side: np.ndarray  # (P,) 0 left, 1 right
    # (P,) 1 where a pad's z axis points forwards, -1 where backwards; less in magnitude if tilted
    pad_sign: Array
    # (P,) ratio of the x and z components of the robot's forward direction in the pad's frame
    pad_slant: Array
    pad_position: Array  # (P, 2) middle of each pad's contact, in the chassis' frame [m]
    pad_pairs: slice  # the contact pairs, in the order of the pads
    # (K, 2) points where the tracks touch the ground, in the chassis' frame [m]
    contact_points: Array
    lrf_mount: Array  # (3,) pose of the laser range finder in the world [m, m, rad]
    lrf_height: float  # height of the scan plane above the ground [m]
    digest: str  # SHA-256 of the model, without visuals and contact sensors
    parameters: RobotParameters
    contact_sensors: bool
    """True if every pad has a sensor; runs are then recorded with the pads' forces and complete
    scans.
    """
    points_per_pad: int  # number of points at which a pad touches the ground

    def pad_speeds(self, belts: Array) -> Array:
        """Speeds (..., P) of the pads' surfaces, each along the pad's own axis, for belt speeds
        (..., 2) [m/s].
        """
        # the lower side of a belt moves backwards when the robot drives forwards
        return (-belts).take(self.pad_side, axis=-1) * self.pad_sign

    def with_single_contacts(self) -> Robot:
        """The same robot and options, with one contact point per pad, as shearing ground needs."""
        if self.points_per_pad == 1:
            return self
        robot = load_robot(self.parameters, self.contact_sensors, single_contacts=True)
        robot.model.opt = self.model.opt
        return robot

    def with_movable_ground(self) -> Robot:
        """The same robot, whose ground the engine places where its field `geom_pos` has it."""
        model = copy.copy(self.model)
        model.geom_sameframe[model.geom("ground").id] = 0
        return replace(self, model=model)


@checks_arguments
def load_robot(
    parameters: RobotParameters | None = None,
    contact_sensors: bool = False,
    single_contacts: bool = False,
) -> Robot:
    """Compile a robot, by default the shipped one, on the paper's field, and read its numbers.

    With `contact_sensors`, every pad has a sensor, whose forces runs record;
    with `single_contacts`, a pad touches the ground at one point instead of two, and there are more
    pads.
    """
    parameters = parameters or RobotParameters()
    spec = shaped_robot(parameters)
    spec.option.disableflags |= _NOT_FOR_A_BODY
    x = lay_pads(spec, parameters, single_contacts)
    for geom in [geom for geom in spec.geoms if geom.group == VISUAL_GROUP]:
        spec.delete(geom)
    spec.compile()
    digest = hashlib.sha256(spec.to_xml().encode()).hexdigest()
    count = 1 if single_contacts else CONTACT_POINTS
    if contact_sensors:
        _add_contact_sensors(spec, count)
    model = spec.compile()
    # else the engine would ignore later writes, as tracks are compiled at rest
    model.flg_surfacevel = 1

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    first = int(model.geom("left_pad0").id)
    pads = slice(first, first + 2 * len(x) // count)
    forwards = data.geom_xmat[pads, :3]  # the robot's forward direction in each pad's frame
    ahead = forwards[:, 2]
    middles = x.reshape(-1, count).mean(axis=1)
    y = parameters.half_gauge * -TRACK_SIGNS
    plate = model.geom("plate")
    lrf = model.body("lrf")
    heading = data.body("lrf").xmat[::3]
    return Robot(
        model=model,
        geometry=parameters.geometry,
        mass=float(model.body_subtreemass[model.body("chassis").id]),
        plate=Plate(2 * float(plate.size[0]), 2 * float(plate.size[1])),
        plate_radius=float(np.linalg.norm(plate.size)),
        pads=pads,
        pad_side=np.repeat([0, 1], len(middles)),
        pad_sign=ahead if single_contacts else np.sign(ahead),
        pad_slant=forwards[:, 0] / ahead,
        pad_position=_on_both_sides(middles, y),
        pad_pairs=slice(0, 2 * len(middles)),
        contact_points=_on_both_sides(x, y),
        lrf_mount=np.array([*lrf.pos[:2], np.arctan2(heading[1], heading[0])]),
        lrf_height=float(lrf.pos[2]),
        digest=digest,
        parameters=parameters,
        contact_sensors=contact_sensors,
        points_per_pad=count,
    )


def _on_both_sides(x: Array, y: Array) -> Array:
    """Points (2 n, 2) at `x` (n,) on the left and then on the right, at `y` (2,) [m]."""
    return np.stack([np.tile(x, 2), np.repeat(y, len(x))], axis=1)


@lru_cache(maxsize=16)
def compiled(parameters: RobotParameters) -> Robot:
    """The robot with these parameters on the paper's field, compiled once."""
    return load_robot(parameters)


def _add_contact_sensors(spec: Any, points: int) -> None:
    data = 1 << _FORCE | 1 << _POSITION | 1 << _VELOCITY
    for pair in spec.pairs:
        spec.add_sensor(
            name=f"{pair.geomname2}_contact",
            type=mujoco.mjtSensor.mjSENS_CONTACT,
            objtype=mujoco.mjtObj.mjOBJ_GEOM,
            objname=pair.geomname1,
            reftype=mujoco.mjtObj.mjOBJ_GEOM,
            refname=pair.geomname2,
            intprm=[data, 0, points],
        )


def composite(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: ArrayLike
) -> tuple[float, Array, Array]:
    """Mass [kg], centre (3,) [m] and inertia (3, 3) about it [kg m^2] of bodies in their current
    poses; world axes.
    """
    own = np.asarray(bodies, int)
    mass = model.body_mass[own]
    centre = mass @ data.xipos[own] / mass.sum()
    turned = data.ximat[own].reshape(-1, 3, 3)
    about_own = (turned * model.body_inertia[own, None]) @ turned.swapaxes(1, 2)

    # Steiner's part: the mass times |r|^2 1 - r r^T, at the distance r from the common centre
    away = data.xipos[own] - centre
    squares = (away**2).sum(axis=1)[:, None, None] * np.eye(3)
    steiner = squares - away[:, :, None] * away[:, None]
    inertia = (about_own + mass[:, None, None] * steiner).sum(axis=0)
    return float(mass.sum()), centre, inertia


def warn_of_inertia(model: mujoco.MjModel, robot: int, path: Path) -> None:
    """Issue a RobotWarning for a body with a radius of gyration beyond the reach of its shapes.

    Links under the body `robot` that are fixed to each other count as one body; a body without
    shapes is compared with the shapes of the whole robot. `path` is the model's file.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    links = np.flatnonzero(model.body_rootid == robot)
    for body in np.unique(model.body_weldid[links]):
        own = links[model.body_weldid[links] == body]
        if not model.body_mass[own].sum():
            continue
        mass, centre, inertia = composite(model, data, own)
        shapes = np.isin(model.geom_bodyid, own)
        if not shapes.any():
            shapes = np.isin(model.geom_bodyid, links)
        away = np.linalg.norm(data.geom_xpos[shapes] - centre, axis=1)
        reach = (away + model.geom_rbound[shapes]).max(initial=0.0)
        gyration = float(np.sqrt(np.linalg.eigvalsh(inertia)[-1] / mass))
        if gyration > reach:
            worst = own[model.body_inertia[own].max(axis=1).argmax()]
            what = (
                f"inertia of link {model.body(worst).name} = "
                f"{model.body_inertia[worst].max():.3g} kg m^2"
            )
            why = (
                f"with it, {mass:.3g} kg have a radius of gyration of {gyration:.3g} m, and "
                f"reach only {reach:.3g} m"
            )
            warnings.warn(f"{path}: {what}: {why}", RobotWarning, stacklevel=3)
