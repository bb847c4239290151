"""The robot file that says all about a tracked robot: each entry of its running gear, what holds
each joint, and its motors.
"""

from __future__ import annotations

import dataclasses
import json
import os
from pathlib import Path
from typing import Any, Final

import mujoco

from sim.motors.motor import UNLIMITED, Drive, tireless
from sim.robot.gear import FlipperMotor, RunningGear
from sim.robot.joint_rules import FREE, HOLD
from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import TrackedModel

_FIELDS: Final = tuple(
    field for field in dataclasses.fields(RunningGear) if field.name not in ("flipper", "origin")
)
_ALWAYS: Final = ("sides", "contact")  # fields that are stated even if they have their defaults


def tracked_file_text(built: TrackedModel, folder: Path, offered: str = "") -> str:
    """The text of a file in `folder` from which the same robot is loaded; `offered` are lines on
    motors that the robot doesn't have.
    """
    robot = built.robot
    lines = [f"model = {_text(_relative(robot.model, folder))}"]
    lines.append(f"name = {_text(robot.name)}")
    if robot.body:
        lines.append(f"body = {_text(robot.body)}")
    if robot.key:
        lines.append(f"key = {_text(robot.key)}")
    if robot.packages:
        lines.append(f"packages = {_text([_relative(each, folder) for each in robot.packages])}")
    if robot.wheels:
        lines.append(f"wheels = {_text(list(robot.wheels))}")
    sections = ["\n".join(lines)]
    sections += [_gear(gear) for gear in robot.gear]
    if joints := _joints(robot, built):
        sections.append(joints)
    if robot.drive is not None:
        sections.append(drive_text(robot.drive))
    elif offered:
        sections.append(offered)
    return "\n\n".join(sections) + "\n"


def _gear(gear: RunningGear) -> str:
    """A table `tracks`."""
    values: dict[str, Any] = {field.name: getattr(gear, field.name) for field in _FIELDS}
    lines = [f"[[tracks]]  # {gear.origin}" if gear.origin else "[[tracks]]"]
    for field in _FIELDS:
        value = values[field.name]
        if value != field.default or field.name in _ALWAYS:
            lines.append(f"{field.name} = {_text(value)}")
    if gear.flipper is not None:
        lines.append(f"flipper = {_motor(gear.flipper)}")
    return "\n".join(lines)


def _motor(motor: FlipperMotor) -> str:
    """An inline table of a flipper's motor."""
    values = {name: value for name, value in vars(motor).items() if value is not None}
    return "{ " + ", ".join(f"{name} = {_text(value)}" for name, value in values.items()) + " }"


def _joints(robot: TrackedRobot, built: TrackedModel) -> str:
    """The table `joints`, "" for a robot without joints but those of flippers."""
    lines = []
    for name, state in built.joints.states.items():
        if state == HOLD:
            is_ball = built.model.joint(name).type[0] == mujoco.mjtJoint.mjJNT_BALL
            angle = _text(HOLD) if is_ball else repr(built.joints.held[name])
            lines.append(f"{_text(name)} = {angle}")
        elif state == FREE:
            lines.append(f"{_text(name)} = {_text(FREE)}")
    for rule in robot.joints:
        if rule.motor is not None:
            values = _motor(rule.motor).removeprefix("{ ")
            lines.append(f'{_text(rule.names)} = {{ motor = "flipper", {values}')
    return "\n".join(["[joints]", *lines]) if lines else ""


def drive_text(drive: Drive) -> str:
    """The tables of a robot's motors, without the numbers that stand for no limit: see
    `Drive.from_table`.
    """
    values = dataclasses.asdict(drive)
    motor = values.pop("motor")
    if drive.torque_limit >= UNLIMITED:
        del values["torque_limit"]
    lines = ["[drive]", *(f"{name} = {value!r}" for name, value in values.items())]
    if drive.motor != tireless().motor:
        lines += ["", "[drive.motor]", *(f"{name} = {value!r}" for name, value in motor.items())]
    return "\n".join(lines)


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path, folder)).as_posix()


def _text(value: object) -> str:
    """A value in TOML."""
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(_text(each) for each in value)}]"
    return json.dumps(value, ensure_ascii=False)
