"""Edits of the robot's model: idle stages of the engine off, and pads that touch at one point each."""

from __future__ import annotations

import mujoco
import numpy as np

_TILT = np.radians(45.0)  # of a pad: only its lower end touches, and its axis still gives the contact's directions
_LENGTH = 0.02  # between the ends of a pad [m]


def skip_idle_stages(model: mujoco.MjModel) -> None:
    """Disable the search for islands where there can be one only, and passive forces where there are none."""
    disabled = mujoco.mjtDisableBit
    if model.ntree <= 1:  # all constraints then act on the same degrees of freedom
        model.opt.disableflags |= disabled.mjDSBL_ISLAND
    jointed = (model.jnt_type != mujoco.mjtJoint.mjJNT_FREE).any() or model.dof_damping.any()
    in_fluid = model.opt.density > 0 or model.opt.viscosity > 0
    if not (jointed or in_fluid or model.ntendon or model.nflex or model.nplugin or model.ngravcomp):
        model.opt.disableflags |= disabled.mjDSBL_SPRING | disabled.mjDSBL_DAMPER


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
