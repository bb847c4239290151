"""Keyframes of a user's model: the chosen one becomes the keyframe of the model with tracks, in which runs begin."""

from __future__ import annotations

import warnings
from typing import Any

import mujoco
import numpy as np

from sim.robot.tracked import TrackedRobot
from sim.robot.urdf import find_meshes, some
from trackslip.errors import RobotWarning, TrackslipError
from trackslip.kinematics import Array

_FREE = mujoco.mjtJoint.mjJNT_FREE


def add_start(spec: Any, robot: TrackedRobot) -> None:
    """Add the robot's keyframe to its complete spec, which has other joints than the keyframe's model.

    Raises TrackslipError for a keyframe that its model doesn't have.
    """
    if not robot.key:
        return
    plain = robot.spec()
    plain.compiler.fusestatic = False
    find_meshes(plain, robot.model, robot.packages)
    own, model = plain.compile(), spec.copy().compile()
    names = [own.key(k).name for k in range(own.nkey)]
    if robot.key not in names:
        known = f"one of its keyframes, {some(names)}" if names else "left out: it has no keyframes"
        raise TrackslipError(f"{robot.model}: key = {robot.key!r}: must be {known}")
    key = names.index(robot.key)
    ctrl = np.zeros(model.nu)
    motors = {_motor_name(own, k): k for k in range(own.nu)}
    for k in range(model.nu):
        if (motor := motors.get(_motor_name(model, k))) is not None:
            ctrl[k] = own.key_ctrl[key, motor]
    qpos = with_joints_of(own, own.key_qpos[key], model, model.qpos0)
    spec.add_key(name=robot.key, qpos=qpos.tolist(), ctrl=ctrl.tolist())


def warn_of_keyframes(spec: Any, robot: TrackedRobot) -> None:
    """Give a RobotWarning for keyframes of the user's model if none is chosen and joints remain that they move."""
    moving = [joint for joint in spec.joints if joint.type != _FREE and joint.parent.name not in robot.flipper_bodies]
    names = [key.name for key in spec.keys]
    if names and moving and not robot.key:
        hint = f'key = "{names[0]}" in the robot file begins there'
        what = f"its keyframes, {some(names)}, are not used: joints and motors begin at 0"
        warnings.warn(f"{robot.model}: {what}; {hint}", RobotWarning, stacklevel=4)


def start(model: mujoco.MjModel) -> mujoco.MjData:
    """Data of a model at its keyframe, if it has one, else at its reference."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    return data


def with_joints_of(own: mujoco.MjModel, values: Array, model: mujoco.MjModel, like: Array, prefix: str = "") -> Array:
    """Positions (nq,) of a model: `like`, except for joints that the model `own` has, too, at positions `values` there.

    Free joints keep theirs. Names in the model may have a `prefix`.
    """
    qpos = like.copy()
    places = {prefix + _joint_name(own, k): k for k in range(own.njnt) if own.jnt_type[k] != _FREE}
    for k in range(model.njnt):
        if (joint := places.get(_joint_name(model, k))) is not None:
            size = 4 if model.jnt_type[k] == mujoco.mjtJoint.mjJNT_BALL else 1
            at, source = model.jnt_qposadr[k], own.jnt_qposadr[joint]
            qpos[at : at + size] = values[source : source + size]
    return qpos


def _joint_name(model: mujoco.MjModel, joint: int) -> str:
    """Name of a joint, or its body's and its number there."""
    body = model.jnt_bodyid[joint]
    return model.joint(joint).name or f"{model.body(body).name}, joint {joint - model.body_jntadr[body]}"


def _motor_name(model: mujoco.MjModel, motor: int) -> str:
    return model.actuator(motor).name or _joint_name(model, int(model.actuator_trnid[motor, 0]))
