"""Robots and grounds for the tests of tracks."""

import mujoco

from sim.tracks import Belts, Track, add_tracks

HULL = [(-0.25, 0.08, 0.08), (0.25, 0.08, 0.08)]
HALF_LENGTH = 0.25
HALF_GAUGE = 0.2


def plane():
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1])
    return spec


def slab():
    spec = mujoco.MjSpec()
    spec.worldbody.add_geom(
        name="ground", type=mujoco.mjtGeom.mjGEOM_BOX, size=[20, 20, 0.5], pos=[0, 0, -0.5]
    )
    return spec


def add_robot(spec, com_x=0.0, name="robot"):
    """A free body of 25 kg, its centre of mass 0.12 m above the ground."""
    body = spec.worldbody.add_body(name=name)
    body.add_freejoint()
    body.mass = 25.0
    body.ipos = [com_x, 0, 0.12]
    body.inertia = [0.45, 0.6, 0.89]
    body.explicitinertial = True
    return body


def add_flipper(spec, body, name, x, y, mass=1.5):
    """A flipper on a hinge at (x, y), 0.08 m above the ground, that points forwards."""
    flipper = body.add_body(name=name, pos=[x, y, 0.08])
    flipper.mass = mass
    flipper.ipos = [0.12, 0, 0]
    flipper.explicitinertial = True
    flipper.inertia = [0.003, 0.009, 0.009]
    flipper.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0], armature=0.01)
    motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_position(kp=150, kv=5)
    return flipper


def built(spec, preset="accurate", terrain="ground", half_gauge=HALF_GAUGE, **options):
    add_tracks(
        spec,
        "robot",
        Track(half_gauge=half_gauge, hull=HULL, preset=preset, **options),
        terrain=terrain,
    )
    model = spec.compile()
    return model, mujoco.MjData(model), Belts(model)
