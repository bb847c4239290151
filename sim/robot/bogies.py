"""Chassis' tracks on bogies: two bodies on passive hinges across, which a differential turns by opposite angles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from sim.tracks import Tracks, add_tracks
from sim.tracks.add import pair_segments
from sim.tracks.hull import Hull
from sim.tracks.presets import load_preset
from trackslip.errors import TrackslipError

if TYPE_CHECKING:
    from sim.robot.tracked import TrackedRobot

_ACROSS = 0.99  # least cosine between y of the chassis and of a bogie, and the hinge [-]


def require_across(model: mujoco.MjModel, data: mujoco.MjData, robot: TrackedRobot, chassis: str) -> None:
    """Raise TrackslipError for bogies and flippers on a hinge that isn't across, or whose y isn't to the left."""
    lateral = data.body(chassis).xmat.reshape(3, 3)[:, 1]
    for name in robot.limbs:
        body = data.body(name)
        axis = data.xaxis[model.body_jntadr[body.id]]
        if min(body.xmat.reshape(3, 3)[:, 1] @ lateral, abs(axis @ lateral)) < _ACROSS:
            raise TrackslipError(f"{robot.model}: body {name!r}: must have y to the left, and its hinge along y")


def add_to_bogies(
    spec: Any, robot: TrackedRobot, chassis: str, preset: str, friction: tuple[float, float]
) -> list[Tracks]:
    """Add the chassis' left and right track to its bogies, and couple them.

    Raises TrackslipError for bodies that aren't in the model, or don't have one hinge.
    """
    hinges = [_hinge(spec, robot, name) for name in robot.bogies]
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    require_across(model, data, robot, chassis)
    base = data.body(chassis)
    frame = base.xmat.reshape(3, 3)
    count = pair_segments(load_preset(preset), robot.half_gauge, Hull.from_wheels(robot.hull))
    made = []
    for name, side, sign in zip(robot.bogies, ("left", "right"), (1.0, -1.0), strict=True):
        body = data.body(name)
        turn = frame.T @ body.xmat.reshape(3, 3)
        offset = frame.T @ (body.xpos - base.xpos)
        places = [turn.T @ (np.array([x, sign * robot.half_gauge, z]) - offset) for x, z, _ in robot.hull]
        made += [
            add_tracks(
                spec,
                name,
                half_gauge=float(places[0][1]),
                hull=[(p[0], p[2], radius) for p, (_, _, radius) in zip(places, robot.hull, strict=True)],
                preset=preset,
                friction=friction,
                name=f"{chassis}_{side}",
                side="left",
                load=0.5,
                width=robot.contact_width,
                lines=robot.lines,
                segments=count,
            )
        ]
    if not any({each.name1, each.name2} == {*hinges} for each in spec.equalities):
        kind, joint = mujoco.mjtEq.mjEQ_JOINT, mujoco.mjtObj.mjOBJ_JOINT
        differential = spec.add_equality(
            name="differential", type=kind, objtype=joint, name1=hinges[0], name2=hinges[1]
        )
        differential.data[1] = -np.sign(data.joint(hinges[0]).xaxis @ data.joint(hinges[1]).xaxis)
    return made


def _hinge(spec: Any, robot: TrackedRobot, name: str) -> str:
    """Name of the only joint of a bogie, a hinge."""
    body = spec.body(name)
    if body is None or [joint.type for joint in body.joints] != [mujoco.mjtJoint.mjJNT_HINGE]:
        raise TrackslipError(f"{robot.model}: bogies = {name!r}: must be a body of the model with one joint, a hinge")
    body.joints[0].name = body.joints[0].name or f"{name}_hinge"
    return str(body.joints[0].name)
