"""Rules on what holds or moves a robot's joints, from the table `joints` of a robot file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any, Final

from sim.common.settings import build
from sim.robot.gear import FlipperMotor
from trackslip.arguments import checks_arguments
from trackslip.errors import InvalidValueError, SettingsFileError

HOLD, FREE, FLIPPER = "hold", "free", "flipper"
"""What a rule says about joints: they hold their start, swing freely, or are hinges of flippers."""
_ALLOWED: Final = (
    '"hold", "free", an angle to hold [rad or m], or a motor, {motor = "flipper", stiffness = 250}'
)


@checks_arguments
@dataclass(frozen=True)
class JointRule:
    """What holds or moves the joints of one name."""

    names: str
    """Name of the joints, in which * stands for any letters."""
    state: str = HOLD
    """hold, free or flipper."""
    angle: float | None = None
    """Angle at which it is held; by default the nearest to 0 within its limits [rad or m]."""
    motor: FlipperMotor | None = None
    """Motor of a flipper's hinge."""

    def fits(self, joint: str) -> bool:
        """Whether the rule is about this joint."""
        return fnmatchcase(joint, self.names)


def rule_for(rules: tuple[JointRule, ...], joint: str) -> JointRule | None:
    """The first of the rules about this joint, or None."""
    return next((rule for rule in rules if rule.fits(joint)), None)


def joint_rules(table: object, where: str) -> tuple[JointRule, ...]:
    """The rules in the table `joints` of a robot file; raises SettingsFileError, which begins with
    `where`, for values that aren't allowed.
    """
    if not isinstance(table, Mapping):
        raise SettingsFileError(f"{where}: {table!r} is not a table")
    return tuple(_rule(name, value, where) for name, value in table.items())


def _rule(names: str, value: Any, where: str) -> JointRule:
    if value in (HOLD, FREE):
        return JointRule(names, value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return JointRule(names, HOLD, angle=float(value))
    if isinstance(value, Mapping) and value.get("motor") == FLIPPER:
        settings = {name: each for name, each in value.items() if name != "motor"}
        motor = build(FlipperMotor, settings, f"{where}: {names}")
        return JointRule(names, FLIPPER, motor=motor)
    error = InvalidValueError(names, value, _ALLOWED)
    raise SettingsFileError(f"{where}: {error}")
