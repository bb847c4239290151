"""What holds a robot's joints in its model.

A joint that nothing moves holds its pose, as the joints of real arms do. These aren't held:

- joints with a motor, or in reach of one by a tendon or an equality constraint,
- joints with a spring of their own,
- wheels that roll and what carries them, such as casters,
- joints that a rule frees, and the hinges of flippers.

A constraint holds the joint, so that it stays in the model. All joints but the hinges of flippers
start at the angle nearest to 0 within their limits: the model's reference is moved there.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np

from sim.robot.joint_rules import FLIPPER, FREE, HOLD, rule_for
from sim.robot.tracked import TrackedRobot
from sim.robot.urdf import some
from sim.robot.wheel_reading import Model, rolling
from sim.robot.wheels import carriers
from trackslip.errors import TrackslipError

MOTOR, ROLLS = "motor", "rolls"
"""More states of joints: those that motors or springs move, and those of wheels that roll."""
_FREE_JOINT: Final = mujoco.mjtJoint.mjJNT_FREE
_SIMPLE: Final = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
# time constant of a held joint's return to its angle [s], and its damping ratio [-]
_HOLDING: Final = (0.01, 1.0)
# impedance of the constraint, MuJoCo's largest: a link on which the ground pushes with the robot's
# weight hardly yields
_STRONG: Final = (0.9999, 0.9999, 0.001, 0.5, 2.0)


def hinge_body(spec: Any, body: str) -> Any:
    """The body whose joint moves a body that carries running gear: itself, or the nearest one that
    it is fixed to and that has a joint.
    """
    link = spec.body(body)
    while not link.joints and link.parent.name != "world":
        link = link.parent
    return link


def joint_states(
    spec: Any, robot: TrackedRobot, model: Model | None, replaced: Iterable[str]
) -> dict[str, str]:
    """State of each joint by name: hold, free, flipper, motor or rolls. Joints of the `replaced`
    links, which are locked anyway, the chassis' own, and those of other machines don't count.

    Without a `model`, joints of wheels that roll count as held.
    """
    locked = {*replaced} - {*robot.gear_bodies}
    hinges = {
        joint.name
        for gear in robot.gear
        if gear.flipper is not None
        for joint in hinge_body(spec, gear.body).joints
    }
    _require_fitting_rules(robot, spec, hinges)
    driven = _driven(spec)
    rolls = rolling(model, [*replaced]) if model is not None else set()
    states = {}
    for joint in spec.joints:
        is_own = not robot.body or _root(joint.parent).name == robot.body
        if joint.type == _FREE_JOINT or joint.parent.name in locked or not is_own:
            continue
        rule = rule_for(robot.joints, joint.name)
        if joint.name in hinges:
            states[joint.name] = FLIPPER
        elif rule is not None:
            states[joint.name] = rule.state
        elif joint.name in driven or np.any(np.asarray(joint.stiffness) > 0):
            states[joint.name] = MOTOR
        else:
            states[joint.name] = ROLLS if joint.parent.name in rolls else HOLD
    return states


def _root(link: Any) -> Any:
    """The body in the world that carries a link, or the link itself."""
    return [link, *carriers(link)][-1]


def _require_fitting_rules(robot: TrackedRobot, spec: Any, hinges: set[str]) -> None:
    """Raise TrackslipError for rules that make other joints than the `hinges` of flippers hinges of
    flippers, or that hold or free these.
    """
    for joint in spec.joints:
        rule = rule_for(robot.joints, joint.name)
        if rule is None or (rule.state == FLIPPER) == (joint.name in hinges):
            continue
        allowed = f"left out or a motor, as {joint.name!r} is the hinge of a flipper"
        if rule.state == FLIPPER:
            allowed = f"on hinges that carry [[tracks]] or [[flippers]]: {joint.name!r} doesn't"
        raise TrackslipError(f"{robot.model}: joints: {rule.names!r}: must be {allowed}")


def _driven(spec: Any) -> set[str]:
    """Names of the joints that motors move: directly, by a tendon, or by an equality constraint."""
    if not spec.actuators:
        return set()
    targets = {motor.target for motor in spec.actuators}
    driven = {joint.name for joint in spec.joints if joint.name in targets}
    for tendon in spec.tendons:
        if tendon.name in targets:
            driven |= {wrap.target.name for wrap in tendon.path if wrap.target is not None}
    joints = {joint.name for joint in spec.joints}
    for constraint in spec.equalities:
        for name in (constraint.name1, constraint.name2):
            if name in joints:
                driven.add(name)
            elif (body := _body_of(spec, name)) is not None:
                links = (body, *carriers(body))
                driven |= {joint.name for link in links for joint in link.joints}
    return driven


def _body_of(spec: Any, name: str) -> Any:
    """The body with this name, or with the site of this name."""
    if not name:
        return None
    site = spec.site(name)
    return site.parent if site is not None else spec.body(name)


def require_known(spec: Any, robot: TrackedRobot) -> None:
    """Raise TrackslipError for a rule that is about none of the model's joints."""
    names = [joint.name for joint in spec.joints if joint.type != _FREE_JOINT]
    for rule in robot.joints:
        if any(rule.fits(name) for name in names):
            continue
        known = f"joints of the model, such as {some(names)}" if names else "left out: it has none"
        raise TrackslipError(f"{robot.model}: joints = {rule.names!r}: must be {known}")


def _require_no_wheels(spec: Any, robot: TrackedRobot) -> None:
    """Raise TrackslipError for a rule that frees joints, or holds them at an angle, of which all
    are those of links that tracks replace: these are locked.
    """
    locked = {*robot.wheels} - {*robot.gear_bodies}
    for rule in robot.joints:
        if rule.state == HOLD and rule.angle is None:
            continue
        about = [joint for joint in spec.joints if rule_for(robot.joints, joint.name) is rule]
        wheels = [joint for joint in about if joint.parent.name in locked]
        if wheels and len(wheels) == len(about):
            link = wheels[0].parent.name
            raise TrackslipError(
                f"{robot.model}: joints: {rule.names!r}: must be about joints that stay, but "
                f"{wheels[0].name!r} is locked, as tracks replace its link {link!r}; list the "
                f"links of the wheels in `wheels`, without {link!r}, to let it move"
            )


@dataclass(frozen=True)
class Joints:
    """What holds or moves the joints of a robot, without those of the links that tracks replace."""

    states: dict[str, str]
    """State by name: hold, free, flipper, motor or rolls."""
    held: dict[str, float]
    """Angles of the joints that hold theirs [rad or m]."""
    starts: dict[str, float]
    """Angles at which joints that hold, swing or have motors start [rad or m]."""

    def named(self, state: str) -> list[str]:
        """Names of the joints in a state."""
        return [name for name, each in self.states.items() if each == state]


def hold(spec: Any, robot: TrackedRobot, chassis: str) -> Joints:
    """Let all joints start within their limits, and hold those that hold by constraints that are
    strong enough for any weight.

    Raises TrackslipError for rules without joints, and for angles outside of a joint's limits.
    """
    require_known(spec, robot)
    _require_no_wheels(spec, robot)
    states = joint_states(spec, robot, None, robot.wheels)
    if not {HOLD, FREE, MOTOR} & set(states.values()):
        return Joints(states, {}, {})
    model = Model(spec, chassis, robot)
    states = joint_states(spec, robot, model, robot.wheels)
    starts = {}
    for name, state in states.items():
        if state in (HOLD, FREE, MOTOR):
            starts[name] = _start_of(model, name)
    held = {name: angle for name, angle in starts.items() if states[name] == HOLD}
    _begin(spec, model, starts)
    _uncouple(spec, held)
    for name, angle in held.items():
        _fix(spec, name, angle)
    _keep_apart(spec, held)
    return Joints(states, held, starts)


def _start_of(model: Model, name: str) -> float:
    """Angle at which a joint starts in the model's pose; 0 for ball joints [rad or m]."""
    joint = model.model.joint(name)
    start = float(model.data.qpos[joint.qposadr[0]])
    return start if _kind(joint) in _SIMPLE else 0.0


def _kind(joint: Any) -> mujoco.mjtJoint:
    """Kind of a joint of a compiled model."""
    return mujoco.mjtJoint(int(joint.type[0]))


def _begin(spec: Any, model: Model, starts: dict[str, float]) -> None:
    """Let joints start at these angles: their bodies are moved there, and their reference is set to
    the angle.
    """
    compiled = model.model
    data = mujoco.MjData(compiled)
    moved = {}
    for name, angle in starts.items():
        joint = compiled.joint(name)
        place = int(joint.qposadr[0])
        if _kind(joint) in _SIMPLE and angle != compiled.qpos0[place]:
            data.qpos[place] = angle
            moved[name] = int(joint.bodyid[0])
    if not moved:
        return
    mujoco.mj_kinematics(compiled, data)
    for body in dict.fromkeys(moved.values()):
        parent = int(compiled.body_parentid[body])
        inverse = np.zeros(4)
        turn = np.zeros(4)
        mujoco.mju_negQuat(inverse, data.xquat[parent])
        mujoco.mju_mulQuat(turn, inverse, data.xquat[body])
        link = spec.body(model.name(body))
        link.pos = data.xmat[parent].reshape(3, 3).T @ (data.xpos[body] - data.xpos[parent])
        link.quat = turn
        link.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        if len(link.joints) > 1:
            _keep_axes(link, compiled, data, body)
    for each in spec.equalities:
        if each.type == mujoco.mjtEq.mjEQ_JOINT:
            _shift(each, model, {name: starts[name] for name in moved})
    for name in moved:
        joint = spec.joint(name)
        joint.ref = starts[name] / angle_unit(spec, joint)


def _keep_axes(link: Any, model: mujoco.MjModel, data: mujoco.MjData, body: int) -> None:
    """Leave the axes of a moved link's joints where they are in the world, as each joint turns the
    link together with the axes of those after it.
    """
    to_link = data.xmat[body].reshape(3, 3).T
    for joint in link.joints:
        k = model.joint(joint.name).id
        joint.axis = to_link @ data.xaxis[k]
        joint.pos = to_link @ (data.xanchor[k] - data.xpos[body])


def _shift(constraint: Any, model: Model, moved: dict[str, float]) -> None:
    """Couple two joints as before, after their references were `moved` to these angles.

    A constraint is y = p(x), where x and y are distances of the joints from their references. If
    these move by a and b, it is y = p(x + a) - b.
    """

    def shift_of(name: str) -> float:
        if name not in moved:
            return 0.0
        return moved[name] - float(model.model.joint(name).qpos0[0])

    terms = np.polynomial.Polynomial(constraint.data[:5])
    shifted = terms(np.polynomial.Polynomial([shift_of(constraint.name2), 1.0]))
    coefficients = np.zeros(5)
    coefficients[: len(shifted.coef)] = shifted.coef
    coefficients[0] -= shift_of(constraint.name1)
    constraint.data[:5] = coefficients


def angle_unit(spec: Any, joint: Any) -> float:
    """Unit of a joint's numbers in a spec [rad or m]."""
    in_degrees = spec.compiler.degree and joint.type == mujoco.mjtJoint.mjJNT_HINGE
    return math.radians(1.0) if in_degrees else 1.0


def _uncouple(spec: Any, held: dict[str, float]) -> None:
    """Delete the constraints that couple held joints to each other; those to joints that aren't
    held stay, and hold these.
    """
    for each in list(spec.equalities):
        names = {each.name1, each.name2} - {""}
        if each.type == mujoco.mjtEq.mjEQ_JOINT and names <= held.keys():
            spec.delete(each)


def _fix(spec: Any, name: str, angle: float) -> None:
    """Hold a joint at an angle by a constraint."""
    joint = spec.joint(name)
    away = angle - joint.ref * angle_unit(spec, joint)
    constraint = spec.add_equality(name=f"{name}_held", solref=_HOLDING, solimp=_STRONG)
    if joint.type in _SIMPLE:
        constraint.type = mujoco.mjtEq.mjEQ_JOINT
        constraint.objtype = mujoco.mjtObj.mjOBJ_JOINT
        constraint.name1 = name
        constraint.data[:5] = [away, 0.0, 0.0, 0.0, 0.0]
    else:
        constraint.type = mujoco.mjtEq.mjEQ_WELD
        constraint.objtype = mujoco.mjtObj.mjOBJ_BODY
        constraint.name1 = joint.parent.name
        constraint.name2 = joint.parent.parent.name


def _keep_apart(spec: Any, held: dict[str, float]) -> None:
    """Exclude contacts between links that held joints fix to each other: in the start pose of many
    models they overlap, and would push each other away. Links without joints between them don't
    collide anyway.
    """
    if not held:
        return
    rigid: dict[str, str] = {}  # the first link to which fixed or held joints fix each link
    welded: dict[str, str] = {}  # the first to which links without joints fix it
    for link in spec.bodies:
        names = [joint.name for joint in link.joints]
        is_first = link.parent is None
        is_rigid = not is_first and all(name in held for name in names)
        is_welded = not is_first and not names
        rigid[link.name] = rigid[link.parent.name] if is_rigid else link.name
        welded[link.name] = welded[link.parent.name] if is_welded else link.name
    collide = [
        link.name
        for link in spec.bodies
        if link.parent is not None and any(geom.contype or geom.conaffinity for geom in link.geoms)
    ]
    excluded = {frozenset((each.bodyname1, each.bodyname2)) for each in spec.excludes}
    for one, other in itertools.combinations(collide, 2):
        is_held = rigid[one] == rigid[other] and welded[one] != welded[other]
        if is_held and frozenset((one, other)) not in excluded:
            spec.add_exclude(bodyname1=one, bodyname2=other)
