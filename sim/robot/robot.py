"""MJCF -> compiled model and the numbers that the simulator needs from it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

import models
from sim.robot.pads import lay_pads, shearing_points
from sim.robot.parameters import TRACK_LOOKS, RobotParameters
from sim.tracks.presets import require_impedances
from trackslip.errors import TrackslipError
from trackslip.kinematics import Array, RobotGeometry
from trackslip.localization.scan import Plate

FIELD = Path(models.__file__).parent / "field.xml"
"""Model of the robot on the paper's field, with the laser range finder."""
SCANNED_GROUP = 0
"""Geom group that the laser range finder sees."""
VISUAL_GROUP = 1
"""Geom group of the visuals, which are removed from the physics."""
CONTACT_POINTS = 2
"""Default number of contact points of a pad."""
CONTACT_WIDTH = 9
"""Numbers that a contact sensor gives per point, in this order: force, position in the world, velocity; force and
velocity are normal to the ground, along the pad and across it."""
_Bit = mujoco.mjtDisableBit
_NOT_FOR_A_BODY = _Bit.mjDSBL_ISLAND | _Bit.mjDSBL_SPRING | _Bit.mjDSBL_DAMPER  # which one on its own lacks, for speed
_FORCE, _POSITION, _VELOCITY = 1, 4, 7  # bits of a contact sensor's data specification


@dataclass(frozen=True)
class Robot:
    """A compiled model and the numbers in it."""

    model: mujoco.MjModel
    """The compiled model, without its visuals."""
    geometry: RobotGeometry
    """Half gauge and nominal sprocket radius."""
    contact_half_length: float
    """Half the length of the tracks' contact with the ground, from the first wheel's patch to the last one's [m]."""
    mass: float
    """Mass of the robot [kg]."""
    plate: Plate
    """The plate that the laser range finder sees."""
    plate_radius: float
    """Radius of the sphere around the plate [m]."""
    pads: slice  # of the geoms: the contact capsules, each along its own z axis
    pad_side: np.ndarray  # (P,) 0 left, 1 right
    pad_sign: Array  # (P,) 1 where a pad's z axis points forward, -1 where backward; less where it is tilted
    pad_slant: Array  # (P,) the robot's direction forward, in the pad's frame: its x component over z
    pad_position: Array  # (P, 2) middle of each pad's contact, in the chassis' frame [m]
    pad_pairs: slice  # of the contact pairs, in the order of the pads
    contact_points: Array  # (K, 2) points where the tracks touch the ground, in the chassis' frame [m]
    lrf_mount: Array  # (3,) pose of the laser range finder in the world [m, m, rad]
    lrf_height: float
    """Height of the scan plane above the ground [m]."""
    digest: str
    """SHA-256 of the model, without visuals and contact sensors."""
    path: Path
    """The MJCF file."""
    parameters: RobotParameters | None
    """Changes of the file's robot."""
    contact_sensors: bool = False
    """True if there is a sensor at every pad; runs are then recorded with the pads' forces and complete scans."""
    points_per_pad: int = CONTACT_POINTS
    """Number of points at which a pad touches the ground."""
    patches: int = 1
    """Number of contact patches of a side: one a wheel, or the track's."""
    patch_length: float = 0.0
    """Length of a patch [m]."""

    def pad_speeds(self, belts: Array) -> Array:
        """Speeds (..., P) of the pads' surfaces, each along its own axis, for belt speeds (..., 2) [m/s]."""
        # the lower side of a belt moves backwards when the robot drives forwards
        return (-belts).take(self.pad_side, axis=-1) * self.pad_sign

    def with_single_contacts(self) -> Robot:
        """The same robot with pads that touch the ground at one point each, twice as many, as shearing ground needs.

        Options and contact parameters are those that the model has now.
        """
        if self.points_per_pad == 1:
            return self
        robot = load_robot(self.path, self.parameters, self.contact_sensors, single_contacts=True)
        for name in (n for n in dir(self.model.opt) if not n.startswith("_")):
            value = getattr(self.model.opt, name)
            if isinstance(value, np.ndarray):
                getattr(robot.model.opt, name)[:] = value
            else:
                setattr(robot.model.opt, name, value)
        alike = len(robot.contact_points) == len(self.contact_points)
        for name in ("pair_solref", "pair_solreffriction", "pair_solimp") if alike else ():
            getattr(robot.model, name)[:] = getattr(self.model, name)[0]
        return replace(robot, digest=self.digest)


def load_robot(
    path: Path = FIELD,
    parameters: RobotParameters | None = None,
    contact_sensors: bool = False,
    single_contacts: bool = False,
) -> Robot:
    """Compile the MJCF file `path`, changed by `parameters`, and read its numbers.

    With `contact_sensors`, every pad has a sensor, for `sim.contact_forces` to read and runs to record; with
    `single_contacts`, a pad touches the ground at one point instead of two, and there are twice as many.

    Raises:
        TrackslipError: for a file that doesn't compile or lacks a required part.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        if [joint.type for joint in spec.joints] == [mujoco.mjtJoint.mjJNT_FREE]:
            spec.option.disableflags |= _NOT_FOR_A_BODY
        if parameters is not None:
            parameters.apply(spec)
        sprocket_radius = float(spec.geom("sprocket0").size[0])
        shape = parameters or RobotParameters()
        if single_contacts:
            lay_pads(spec, single=True, at=shearing_points(shape.axles, shape.patch_length) if shape.axles else None)
        for name in TRACK_LOOKS:
            spec.delete(spec.body(name))
        for geom in [geom for geom in spec.geoms if geom.group == VISUAL_GROUP]:
            spec.delete(geom)
        spec.compile()
        digest = hashlib.sha256(spec.to_xml().encode()).hexdigest()
        if contact_sensors:
            _add_contact_sensors(spec, 1 if single_contacts else CONTACT_POINTS)
        model = spec.compile()
        robot = _read(model, sprocket_radius, digest, single_contacts)
        require_impedances(model, np.arange(robot.pads.start, robot.pads.stop))
        robot = replace(robot, patch_length=2 * robot.contact_half_length)
        if shape.axles:
            half, patches = shape.contact_length / 2, len(shape.axles)
            robot = replace(robot, contact_half_length=half, patches=patches, patch_length=shape.patch_length)
        return replace(robot, path=path, parameters=parameters, contact_sensors=contact_sensors)
    except (ValueError, KeyError, AttributeError) as error:
        raise TrackslipError(f"{path}: {' '.join(str(error).split())}") from error


@lru_cache(maxsize=16)
def compiled(parameters: RobotParameters) -> Robot:
    """The robot of the paper's field with these parameters, compiled once."""
    return load_robot(parameters=parameters)


def _add_contact_sensors(spec: mujoco.MjSpec, points: int) -> None:
    """Add a sensor of the contact with the ground to every pad."""
    geom_type = mujoco.mjtObj.mjOBJ_GEOM
    grounds = {pair.geomname2: pair.geomname1 for pair in spec.pairs}
    for geom in spec.geoms:
        if "_pad" in geom.name:
            spec.add_sensor(
                name=f"{geom.name}_contact",
                type=mujoco.mjtSensor.mjSENS_CONTACT,
                objtype=geom_type,
                objname=grounds[geom.name],
                reftype=geom_type,
                refname=geom.name,
                intprm=[1 << _FORCE | 1 << _POSITION | 1 << _VELOCITY, 0, points],
            )


def _read(model: mujoco.MjModel, sprocket_radius: float, digest: str, single_contacts: bool) -> Robot:
    pads = np.array([i for i in range(model.ngeom) if "_pad" in model.geom(i).name])
    side = np.array([0 if model.geom(i).name.startswith("left_") else 1 for i in pads])
    pairs = {int(model.pair_geom2[i]): i for i in range(model.npair)}
    rotation = np.array([_rotation(model.geom_quat[i]) for i in pads])  # (P, 3, 3) geom -> chassis
    # a capsule lies along its own z; a contact point is at either end, or at the lower one
    ends = model.geom_size[pads, 1, None] * rotation[:, :, 2]
    if single_contacts:
        points = middle = (model.geom_pos[pads] - np.sign(ends[:, 2:]) * ends)[:, :2]
    else:
        points = np.concatenate([model.geom_pos[pads] - ends, model.geom_pos[pads] + ends])[:, :2]
        middle = model.geom_pos[pads, :2].copy()
    on_left = np.sort(points[points[:, 1] > 0, 0])
    spacing = (on_left[-1] - on_left[0]) / (len(on_left) - 1)
    plate = model.geom("plate").id
    plate_size = model.geom_size[plate]
    if np.any(model.geom_pos[plate, :2] != 0) or list(np.flatnonzero(model.geom_group == SCANNED_GROUP)) != [plate]:
        raise ValueError(f"geom group {SCANNED_GROUP} must contain only the plate, above the centre of the tracks")
    lrf = model.body("lrf")
    heading = _rotation(model.body_quat[lrf.id])[:, 0]
    model.flg_surfacevel = 1  # compiled with tracks at rest, the engine would ignore later writes
    return Robot(
        model=model,
        geometry=RobotGeometry(round(float(np.abs(points[:, 1]).mean()), 9), sprocket_radius),
        contact_half_length=round(float(on_left[-1] - on_left[0] + spacing) / 2, 9),
        mass=float(model.body_subtreemass[model.body("chassis").id]),
        plate=Plate(2 * float(plate_size[0]), 2 * float(plate_size[1])),
        plate_radius=float(np.linalg.norm(plate_size)),
        pads=_consecutive(pads, "pads"),
        pad_side=side,
        pad_sign=rotation[:, 0, 2] if single_contacts else np.sign(rotation[:, 0, 2]),
        pad_slant=rotation[:, 0, 0] / rotation[:, 0, 2],
        pad_position=middle,
        pad_pairs=_consecutive(np.array([pairs[int(i)] for i in pads]), "pairs of the pads"),
        contact_points=points,
        lrf_mount=np.array([*model.body_pos[lrf.id][:2], np.arctan2(heading[1], heading[0])]),
        lrf_height=float(model.body_pos[lrf.id][2]),
        digest=digest,
        path=FIELD,
        parameters=None,
        points_per_pad=1 if single_contacts else CONTACT_POINTS,
    )


def _consecutive(ids: np.ndarray, what: str) -> slice:
    """Ids (n,) as a slice, so that arrays can be viewed and written without copying."""
    if not np.array_equal(ids, np.arange(ids[0], ids[0] + len(ids))):
        raise ValueError(f"the {what} must be consecutive, in the order of the geoms")
    return slice(int(ids[0]), int(ids[-1]) + 1)


def _rotation(quaternion: Array) -> Array:
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
