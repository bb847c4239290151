"""Motors that a URDF tells by the effort and velocity limits of its wheels' joints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final
from xml.etree.ElementTree import Element

from sim.motors.motor import Drive, Motor
from sim.robot.model_check import parsed
from sim.robot.robot_file import drive_text
from sim.robot.tracked_model import TrackedModel
from trackslip.errors import TrackslipError

_GEAR: Final = 50.0  # gear of the motors, whose value has no effect at the sprocket [-]
# stall torque over the effort, and no-load speed over the velocity, of a torque-speed line through
# both limits [-]
_BEYOND: Final = 2.0
_MOST: Final = 1e6  # effort and velocity beyond which limits mean none [N m, rad/s]


def offered_motors(built: TrackedModel) -> str:
    """Tables of motors, each line a comment, from the limits of the joints that turn the links
    which tracks replace; "" for models without such limits.
    """
    robot = built.robot
    if robot.drive is not None or robot.model.suffix.lower() == ".xml":
        return ""
    try:
        root = parsed(robot.model)
    except TrackslipError:
        return ""
    # a flipper's hinge turns about its axis, too, but not endlessly
    limits = [
        _limit(joint)
        for joint in root.findall("joint")
        if _child(joint) in robot.wheels and _is_endless(joint)
    ]
    stated = [(effort, velocity) for effort, velocity in limits if _is_stated(effort, velocity)]
    if not stated:
        return ""
    drive = drive_of(stated, robot.sprocket_radius)
    lines = [
        "# motors by the effort and velocity limits of the wheels' joints: uncomment to use them",
        *drive_text(drive).splitlines(),
    ]
    return "\n".join(line if line.startswith("#") or not line else f"# {line}" for line in lines)


def drive_of(limits: Sequence[tuple[float, float]], radius: float) -> Drive:
    """The drive of a side whose wheels have these limits of effort [N m] and velocity [rad/s]; half
    of the wheels are on each side.
    """
    effort = sum(effort for effort, _ in limits) / 2
    velocity = min(velocity for _, velocity in limits)
    return Drive(
        top_speed=round(min(10.0, velocity * radius), 4),
        torque_limit=effort,
        motor=Motor(
            gear=_GEAR,
            no_load_speed=_BEYOND * velocity * _GEAR,
            stall_torque=_BEYOND * effort / _GEAR,
            friction=0.0,
        ),
    )


def _child(joint: Element) -> str:
    child = joint.find("child")
    return "" if child is None else child.get("link", "")


def _is_endless(joint: Element) -> bool:
    """True for a joint that turns by more than a circle, as wheels do."""
    if joint.get("type") == "continuous":
        return True
    limit = joint.find("limit")
    if limit is None:
        return False
    try:
        return float(limit.get("upper", "0")) - float(limit.get("lower", "0")) > 2 * math.pi
    except ValueError:
        return False


def _limit(joint: Element) -> tuple[float, float]:
    """Effort [N m] and velocity [rad/s] of a joint, 0 where they aren't stated."""
    limit = joint.find("limit")
    if limit is None:
        return 0.0, 0.0
    try:
        return float(limit.get("effort", "0")), float(limit.get("velocity", "0"))
    except ValueError:
        return 0.0, 0.0


def _is_stated(effort: float, velocity: float) -> bool:
    return 0.0 < effort < _MOST and 0.0 < velocity < _MOST
