"""What makes a physics step of the robot cheaper and changes no bit of it."""

from __future__ import annotations

import mujoco


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
