"""Edits of the robot's MuJoCo spec: what makes a physics step cheaper, and pads that touch at one point each."""

from __future__ import annotations

import mujoco
import numpy as np

_TILT = np.radians(45.0)  # of a pad: only its lower end touches, and its axis still gives the contact's directions
_LENGTH = 0.02  # between the ends of a pad [m]


def save_sensing(spec: mujoco.MjSpec) -> None:
    """Delete cameras and lights, which the engine would move in every step, and give each track a ground of its own.

    The force sensors of the tracks then know a contact by its ground: to find out where it is takes longer.
    """
    for thing in (*spec.cameras, *spec.lights):
        spec.delete(thing)
    ground = spec.geom("ground")
    for side in ("left", "right"):
        plane = spec.worldbody.add_geom(name=f"{side}_ground", type=ground.type, size=ground.size, group=ground.group)
        plane.pos, plane.quat, plane.contype, plane.conaffinity = ground.pos, ground.quat, 0, 0
        for pair in spec.pairs:
            if pair.geomname1 == ground.name and pair.geomname2.startswith(f"{side}_pad"):
                pair.geomname1 = plane.name
        sensor = spec.sensor(f"{side}_track_force")
        sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_GEOM, plane.name
    spec.delete(ground)


def skip_idle_stages(model: mujoco.MjModel) -> None:
    """Disable the search for islands where there can be one only, and passive forces where there are none."""
    disabled = mujoco.mjtDisableBit
    if model.ntree <= 1:  # all constraints then act on the same degrees of freedom
        model.opt.disableflags |= disabled.mjDSBL_ISLAND
    if not _has_passive_forces(model):  # the engine passes over them if both flags are set
        model.opt.disableflags |= disabled.mjDSBL_SPRING | disabled.mjDSBL_DAMPER


def _has_passive_forces(model: mujoco.MjModel) -> bool:
    jointed = (model.jnt_type != mujoco.mjtJoint.mjJNT_FREE).any() or model.dof_damping.any()
    in_fluid = model.opt.density > 0 or model.opt.viscosity > 0
    others = model.ntendon, model.nflex, model.nplugin, model.ngravcomp
    return bool(jointed or in_fluid or any(others))


def split_pads(spec: mujoco.MjSpec) -> None:
    """Replace every capsule that lies on the ground by two tilted ones, whose lower ends touch where its ends did."""
    chassis = spec.body("chassis")
    raised = _LENGTH * np.array([np.cos(_TILT), 0.0, np.sin(_TILT)])
    pairs = {pair.geomname2: pair for pair in spec.pairs}
    pads = [geom for geom in chassis.geoms if "_pad" in geom.name]
    for side in ("left", "right"):
        ends = np.concatenate([_ends(pad) for pad in pads if pad.name.startswith(side)])
        for k, place in enumerate(ends[np.argsort(ends[:, 0])]):
            name = f"{side}_pad{k}_single"
            like = pads[0]
            chassis.add_geom(
                name=name,
                type=like.type,
                size=[like.size[0], 0.0, 0.0],
                fromto=[*place, *(place + raised)],
                mass=0.0,
                contype=0,
                conaffinity=0,
                group=like.group,
            )
            pair = pairs[like.name]
            spec.add_pair(
                geomname1=pair.geomname1,
                geomname2=name,
                condim=pair.condim,
                friction=pair.friction,
                solref=pair.solref,
                solreffriction=pair.solreffriction,
                solimp=pair.solimp,
            )
    for pad in pads:
        spec.delete(pairs[pad.name])
        spec.delete(pad)


def _ends(pad: mujoco.MjsGeom) -> np.ndarray:
    return np.array(pad.fromto).reshape(2, 3)
