"""The pose in which a robot's joints start.

Rules on joints say it first, then equality constraints between joints, then a keyframe. All other
joints start at their reference, or as near to it as their limits allow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np

from sim.robot.joint_rules import rule_for
from sim.robot.tracked import TrackedRobot
from trackslip.errors import TrackslipError
from trackslip.kinematics import Array

_SIMPLE: Final = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
_SAME: Final = 1e-6  # largest difference between an angle and that of its coupling [rad or m]
_TERMS: Final = 5  # coefficients of the polynomial of a coupling


@dataclass(frozen=True)
class _Coupling:
    """An equality constraint between two joints: follower = polynomial(leader), both as distances
    from their reference. Without a leader, the follower stays at a distance.
    """

    follower: int
    leader: int | None
    terms: Array  # (5,) coefficients, the constant first


def start_pose(model: mujoco.MjModel, robot: TrackedRobot) -> Array:
    """Positions (nq,) of all joints at their start.

    A joint without a rule follows the joint that leads it or, if only its follower has a rule,
    leads it there. Raises TrackslipError for angles outside of a joint's limits, and for rules that
    contradict a coupling.
    """
    qpos = model.key_qpos[0].copy() if model.nkey else nearest_start(model)
    decided = _follow_rules(model, robot, qpos)
    couplings = _couplings(model)

    # what rules decide goes on along the couplings, in both directions
    for _ in couplings:
        for each in couplings:
            if each.leader is None:
                continue
            if each.leader in decided and each.follower not in decided:
                qpos[_place(model, each.follower)] = _led(model, each, qpos)
                decided.add(each.follower)
            elif each.follower in decided and each.leader not in decided:
                leading = _leading(model, each, qpos)
                if leading is None:
                    raise TrackslipError(_out_of_reach(model, robot, each, qpos))
                qpos[_place(model, each.leader)] = leading
                decided.add(each.leader)
    for each in couplings:
        if each.follower in decided and each.leader in decided:
            _require_fit(model, robot, each, qpos)

    # all others follow their leaders
    for _ in couplings:
        for each in couplings:
            if each.follower not in decided:
                _follow(model, each, qpos)
    return qpos


def nearest_start(model: mujoco.MjModel) -> Array:
    """Positions (nq,) of all joints at their reference, or as near to it as their limits allow."""
    qpos = model.qpos0.copy()
    for joint in range(model.njnt):
        if not model.jnt_limited[joint] or _kind(model, joint) not in _SIMPLE:
            continue
        place = _place(model, joint)
        qpos[place] = np.clip(qpos[place], *model.jnt_range[joint])
    return np.asarray(qpos)


def _follow_rules(model: mujoco.MjModel, robot: TrackedRobot, qpos: Array) -> set[int]:
    """Set the angles that rules give; returns the joints that have one."""
    ruled = set()
    for joint in range(model.njnt):
        name = model.joint(joint).name
        rule = rule_for(robot.joints, name)
        if rule is None or rule.angle is None or _kind(model, joint) == mujoco.mjtJoint.mjJNT_FREE:
            continue
        if _kind(model, joint) not in _SIMPLE or not _within(model, joint, rule.angle):
            low, high = model.jnt_range[joint]
            allowed = f"within its limits, {low:.4g} to {high:.4g}"
            raise TrackslipError(
                f"{robot.model}: joints: {name} = {rule.angle:g}: must be {allowed}"
            )
        qpos[_place(model, joint)] = rule.angle
        ruled.add(joint)
    return ruled


def _couplings(model: mujoco.MjModel) -> Sequence[_Coupling]:
    """The active equality constraints between joints."""
    found = []
    for k in range(model.neq):
        if model.eq_type[k] != mujoco.mjtEq.mjEQ_JOINT or not model.eq_active0[k]:
            continue
        leader = int(model.eq_obj2id[k])
        terms = model.eq_data[k, :_TERMS].copy()
        follower = int(model.eq_obj1id[k])
        found.append(_Coupling(follower, leader if leader >= 0 else None, terms))
    return found


def _led(model: mujoco.MjModel, coupling: _Coupling, qpos: Array) -> float:
    """Where its coupling puts a follower [rad or m]."""
    away = 0.0
    if coupling.leader is not None:
        place = _place(model, coupling.leader)
        away = qpos[place] - model.qpos0[place]
    shift = np.polynomial.Polynomial(coupling.terms)(away)
    return float(model.qpos0[_place(model, coupling.follower)] + shift)


def _follow(model: mujoco.MjModel, coupling: _Coupling, qpos: Array) -> None:
    """Set a follower to where its leader puts it. If that is outside of its limits, it stays within
    them, and the leader goes there if it can.
    """
    place = _place(model, coupling.follower)
    qpos[place] = _led(model, coupling, qpos)
    if coupling.leader is None or _within(model, coupling.follower, qpos[place]):
        return
    qpos[place] = np.clip(qpos[place], *model.jnt_range[coupling.follower])
    leading = _leading(model, coupling, qpos)
    if leading is not None:
        qpos[_place(model, coupling.leader)] = leading


def _leading(model: mujoco.MjModel, coupling: _Coupling, qpos: Array) -> float | None:
    """Where a leader puts its follower where it is: of all such places within the leader's limits,
    the nearest; None without any [rad or m].
    """
    assert coupling.leader is not None
    place = _place(model, coupling.follower)
    terms = coupling.terms.copy()
    terms[0] -= qpos[place] - model.qpos0[place]
    roots = np.polynomial.Polynomial(terms).trim().roots()
    real = roots[np.abs(roots.imag) < _SAME].real
    reference = model.qpos0[_place(model, coupling.leader)]
    possible = [
        float(reference + root)
        for root in real
        if _within(model, coupling.leader, float(reference + root))
    ]
    if not possible:
        return None
    now = qpos[_place(model, coupling.leader)]
    return min(possible, key=lambda each: abs(each - now))


def _out_of_reach(
    model: mujoco.MjModel, robot: TrackedRobot, coupling: _Coupling, qpos: Array
) -> str:
    """Why a follower can't be where a rule puts it."""
    follower = model.joint(coupling.follower).name
    leader = model.joint(coupling.leader).name
    angle = qpos[_place(model, coupling.follower)]
    return (
        f"{robot.model}: joints: {follower} = {angle:.4g}: must be an angle to which {leader!r}, "
        "which leads it, can bring it within its limits"
    )


def _require_fit(
    model: mujoco.MjModel, robot: TrackedRobot, coupling: _Coupling, qpos: Array
) -> None:
    """Raise TrackslipError unless a follower is where its leader puts it, within its limits."""
    assert coupling.leader is not None
    follower = model.joint(coupling.follower).name
    leader = model.joint(coupling.leader).name
    angle = float(qpos[_place(model, coupling.follower)])
    leading = float(qpos[_place(model, coupling.leader)])
    led = _led(model, coupling, qpos)
    if abs(angle - led) > _SAME:
        raise TrackslipError(
            f"{robot.model}: joints: {follower} = {angle:.4g}: must be {led:.4g}, as {leader!r}, "
            f"which leads it, is at {leading:.4g}, or left out"
        )
    if not _within(model, coupling.follower, angle):
        low, high = model.jnt_range[coupling.follower]
        raise TrackslipError(
            f"{robot.model}: joints: {leader} = {leading:.4g}: puts {follower!r}, which follows "
            f"it, at {angle:.4g}: must be within its limits, {low:.4g} to {high:.4g}"
        )


def _within(model: mujoco.MjModel, joint: int, angle: float) -> bool:
    """Whether a joint's limits allow an angle."""
    low, high = model.jnt_range[joint]
    return not model.jnt_limited[joint] or bool(low - _SAME <= angle <= high + _SAME)


def _place(model: mujoco.MjModel, joint: int) -> int:
    """Index of a joint in qpos."""
    return int(model.jnt_qposadr[joint])


def _kind(model: mujoco.MjModel, joint: int) -> mujoco.mjtJoint:
    """Kind of a joint."""
    return mujoco.mjtJoint(int(model.jnt_type[joint]))
