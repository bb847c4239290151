"""What a robot's files contain, what they leave out, and what is wrong in them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import mujoco
import numpy as np

from sim.motors.motor import UNLIMITED
from sim.robot.flat import standing
from sim.robot.gear import RunningGear
from sim.robot.joint_rules import FREE, HOLD
from sim.robot.joints import MOTOR, ROLLS
from sim.robot.named import SHIPPED, PlainRobot, RobotSource, load_parameters, load_tracked
from sim.robot.offered import offered_motors
from sim.robot.robot import composite
from sim.robot.robot_file import tracked_file_text
from sim.robot.tracked import TrackedRobot
from sim.robot.tracked_model import TrackedModel, build_tracked
from sim.robot.urdf import engine_errors
from sim.robot.wheels import colliding
from trackslip.arguments import checks_arguments
from trackslip.errors import RobotWarning, TrackslipError, counted

_G: Final = 9.81  # [m/s^2]
_SLOPE: Final = np.radians(20)


@dataclass(frozen=True)
class RobotCheck:
    """The results of checking a robot."""

    facts: tuple[tuple[str, str], ...]
    """Names and values of the robot's properties."""
    warnings: tuple[str, ...]
    """Lines on parts that are left out or look wrong."""
    errors: tuple[str, ...]
    """Lines on faults that keep the robot from driving."""
    file: str = ""
    """The robot file that says all about the robot; "" for robots without a model of their own."""

    def __str__(self) -> str:
        lines = [f"{name}: {value}" for name, value in self.facts]
        lines += [f"warning: {line}" for line in self.warnings]
        lines += [f"error: {line}" for line in self.errors]
        if self.file:
            lines += ["", "# the robot file that says all of this", self.file.rstrip()]
        return "\n".join(lines)


@checks_arguments
def check(source: RobotSource | Path = SHIPPED) -> RobotCheck:
    """Check a robot, by name or file, and collect all of its faults instead of stopping at the
    first error.
    """
    facts: list[tuple[str, str]] = []
    errors: list[str] = []
    file = ""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            robot = load_tracked(source, errors.append)
            facts += _facts_of_gear(robot)
            build_tracked(robot, looks=True, refuse=errors.append)
            built = build_tracked(robot, refuse=lambda _: None)
            with engine_errors(robot.model):
                facts += _facts(built)
                if not errors and not isinstance(robot, PlainRobot):
                    folder = Path(source).parent if isinstance(source, str | Path) else Path()
                    file = tracked_file_text(built, folder, offered_motors(built))
        except TrackslipError as error:
            errors.append(str(error))
        if not errors:
            try:
                load_parameters(source)
            except TrackslipError as error:
                warnings.warn(f"not for flat ground: {error}", RobotWarning, stacklevel=2)
    lines = dict.fromkeys(str(each.message) for each in said)
    return RobotCheck(tuple(facts), tuple(lines), tuple(dict.fromkeys(errors)), file)


def _facts_of_gear(robot: TrackedRobot) -> list[tuple[str, str]]:
    """The running gear, with where each number comes from."""
    length = f"{robot.contact_length:.4g} m long"
    contact = f"{robot.contact}, half gauge {robot.half_gauge:g} m, {length}"
    facts = [("model", robot.model.name), ("contact", contact)]
    for gear in robot.gear:
        facts += _facts_of_entry(gear)
    return [*facts, ("links replaced", ", ".join(robot.wheels) or "none")]


def _facts_of_entry(gear: RunningGear) -> list[tuple[str, str]]:
    """The lines on one entry of the list of running gear."""
    origin = f" {gear.origin}" if gear.origin else " given"
    body = gear.body or "the chassis"
    if isinstance(gear.y, tuple):
        half = (gear.y[0] - gear.y[1]) / 2
        middle = (gear.y[0] + gear.y[1]) / 2
        place = f"half gauge {half:g}, {middle:+g} m left of {body}'s frame{origin}"
    elif len(gear.places) > 1:
        place = f"half gauge {gear.places[0]:g}{origin}"
    else:
        place = f"y = {gear.places[0]:g}{origin}"
    drives = ", ".join(gear.drives)
    kind = "flipper" if gear.flipper is not None else gear.contact
    hull = ", ".join(f"({x:g}, {z:g}, {r:g})" for x, z, r in gear.hull)
    facts = [
        (f"{kind} on {body}", f"{gear.sides}, {place}; motors {drives}"),
        ("  wheels (x, z, radius)", f"{hull}{origin}"),
    ]
    if gear.aside:
        asides = ", ".join(f"{aside:+g}" for aside in gear.aside)
        facts.append(("  further out", f"{asides} m{origin}"))
    return facts


def _facts(tracked: TrackedModel) -> list[tuple[str, str]]:
    """Names and values of a compiled robot's properties: mass, inertia, joints, flippers and
    motors.
    """
    robot = tracked.robot
    model = tracked.model
    joints = tracked.joints
    own = np.flatnonzero(model.body_rootid == tracked.body)
    mass, centre, inertia = composite(model, standing(tracked), own)
    x, y, z = np.round(centre, 6) + 0.0
    at = f"{x:+.3f} m ahead, {y:+.3f} m left, {z:.3f} m above the ground"
    diagonal = ", ".join(f"{value:.3g}" for value in inertia.diagonal())
    held = ", ".join(f"{name} at {angle:.4g}" for name, angle in joints.held.items())
    shapes = int(colliding(model)[model.geom_bodyid > 0].sum())
    facts = [
        ("mass", f"{mass:.4g} kg, {at}"),
        ("inertia", f"{diagonal} kg m^2 about x, y, z"),
        ("what collides", counted(shapes, "shape")),
        ("joints with motors", _listed(_with_motors(model))),
        (f"joints that {HOLD}", held or "none"),
        ("joints that swing freely", _listed(joints.named(FREE))),
        ("flippers", _listed(list(tracked.flipper_names))),
        ("motors", _motors(robot, mass)),
    ]
    if sprung := [name for name in joints.named(MOTOR) if name not in _with_motors(model)]:
        facts.append(("joints with springs or constraints", _listed(sprung)))
    if rolling := joints.named(ROLLS):
        facts.append(("wheels that roll", _listed(rolling)))
    return facts


def _motors(robot: TrackedRobot, mass: float) -> str:
    """The robot's motors, and what a slope takes."""
    needed = np.sin(_SLOPE) * mass * _G * robot.sprocket_radius / 2
    if robot.drive is None:
        motors = "unlimited, without a table [drive]"
    elif (strength := robot.drive.strength(0.0)) >= UNLIMITED:
        motors = "unlimited, by the table [drive]"
    else:
        motors = f"{strength:.3g} N m a side"
    return f"{motors}; 20 degrees uphill take {needed:.3g} N m a side"


def _with_motors(model: mujoco.MjModel) -> list[str]:
    """Names of the joints with motors of their own."""
    return [model.joint(int(k)).name for k in model.actuator_trnid[:, 0] if k >= 0]


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "none"
