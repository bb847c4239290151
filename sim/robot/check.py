"""Everything about a robot at once: what is read from its files, what is left out, and what is wrong."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from sim.drive.drive import Drive
from sim.robot.named import SHIPPED, RobotSource, load_parameters, load_tracked
from sim.robot.robot import composite
from sim.robot.tracked_model import TrackedModel, build_tracked
from sim.robot.wheels import start
from trackslip.errors import RobotWarning, TrackslipError, counted

_G, _SLOPE = 9.81, np.radians(20)  # [m/s^2, rad]


@dataclass(frozen=True)
class RobotCheck:
    """What is known of a robot."""

    facts: tuple[tuple[str, str], ...]
    """Names and values."""
    warnings: tuple[str, ...]
    """What is left out or looks wrong, a line each."""
    errors: tuple[str, ...]
    """What keeps it from driving, a line each."""

    def __str__(self) -> str:
        lines = [f"{name}: {value}" for name, value in self.facts]
        lines += [f"warning: {line}" for line in self.warnings] + [f"error: {line}" for line in self.errors]
        return "\n".join(lines)


def check(source: RobotSource | Path = SHIPPED) -> RobotCheck:
    """Check a robot, by its name or file: all that is wrong with it, instead of an error a run."""
    facts: list[tuple[str, str]] = []
    errors: list[str] = []
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            robot = load_tracked(source, errors.append)
            facts += [
                ("model", robot.model.name),
                ("contact", f"{robot.contact}, half gauge {robot.half_gauge:g} m, {robot.contact_length:.4g} m long"),
                ("wheels (x, z, radius)", ", ".join(f"({x:g}, {z:g}, {r:g})" for x, z, r in robot.hull)),
                ("links replaced", ", ".join(robot.wheels) or "none"),
            ]
            build_tracked(robot, looks=True, refuse=errors.append)
            facts += _facts(build_tracked(robot, refuse=lambda _: None))
        except TrackslipError as error:
            errors.append(str(error))
        if not errors:
            try:
                load_parameters(source)
            except TrackslipError as error:
                warnings.warn(f"drives on terrain only: {error}", RobotWarning, stacklevel=2)
    lines = dict.fromkeys(str(each.message) for each in said)
    return RobotCheck(tuple(facts), tuple(lines), tuple(dict.fromkeys(errors)))


def _facts(tracked: TrackedModel) -> list[tuple[str, str]]:
    """Mass, inertia, joints, flippers and motors of a compiled robot."""
    robot, model, data = tracked.robot, tracked.model, start(tracked.model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mass, centre, inertia = composite(model, data, np.flatnonzero(model.body_rootid == tracked.body))
    x, y, z = centre - data.xpos[tracked.body] - [robot.middle, 0.0, robot.lowest]
    held = [model.joint(int(k)).name for k in model.actuator_trnid[:, 0] if k >= 0]
    loose = [joint.name for joint in map(model.joint, range(1, model.njnt)) if joint.name not in held]
    needed = np.sin(_SLOPE) * mass * _G * robot.sprocket_radius / 2
    motors = float(robot.drive.belt_limits(robot.sprocket_radius, np.zeros(1), np.ones(1))[0])
    whose = "the shipped robot's, not counted on terrain" if robot.drive == Drive() else "the robot file's"
    return [
        ("mass", f"{mass:.4g} kg, {x:+.3f} m ahead, {y:+.3f} m left, {z:.3f} m above the ground"),
        ("inertia", f"{', '.join(f'{value:.3g}' for value in inertia.diagonal())} kg m^2 about x, y, z"),
        ("what collides", counted(int((model.geom_contype[model.geom_bodyid > 0] > 0).sum()), "shape")),
        ("joints with motors", ", ".join(held) or "none"),
        ("joints without", ", ".join(loose) or "none"),
        ("flippers", ", ".join(robot.flipper_bodies) or "none"),
        ("motors", f"{motors:.3g} N m a side ({whose}); 20 degrees uphill take {needed:.3g} N m"),
    ]
