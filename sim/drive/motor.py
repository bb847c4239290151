"""The motor of a sprocket: torque-speed line, gear, inertia, friction and electrical power."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trackslip.errors import Checked, checked, require, require_non_negative, require_positive
from trackslip.kinematics import Array

_LEAST, _MOST = 1e-12, 1e6  # of all parameters, so that nothing derived from them overflows
_CREEP = 0.02  # sprocket speed below which the gear's friction is smoothed [rad/s]


def _require_usable(name: str, value: float) -> None:
    require_positive(name, value, _MOST)
    require(value >= _LEAST, name, value, f"at least {_LEAST:g}")


@dataclass(frozen=True)
class Motor(Checked):
    """A brushed DC motor with a gear. Everything is assumed: 60 W, ample to drive 25 kg at 0.3 m/s."""

    gear: float = checked(50.0, _require_usable)
    """Gear ratio, motor speed over sprocket speed [-]."""
    voltage: float = checked(24.0, _require_usable)
    """Battery voltage, the largest at the motor [V]."""
    no_load_speed: float = checked(400.0, _require_usable)
    """No-load speed of the motor at full voltage [rad/s]."""
    stall_torque: float = checked(0.6, _require_usable)
    """Stall torque of the motor at full voltage [N m]."""
    rotor_inertia: float = checked(8e-6, _require_usable)
    """Moment of inertia of the motor, including the gear [kg m^2]."""
    friction: float = checked(0.3, require_non_negative)
    """Friction torque of the gear, at the sprocket [N m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        stall = self.gear * self.stall_torque
        require(self.friction < stall, "friction", self.friction, f"less than gear * stall_torque = {stall:g} N m")

    @cached_property
    def inertia(self) -> float:
        """Moment of inertia at the sprocket [kg m^2]."""
        return self.rotor_inertia * self.gear**2

    @cached_property
    def torque_constant(self) -> float:
        """Torque constant, which equals the back-EMF constant [N m/A]."""
        return self.voltage / self.no_load_speed

    @cached_property
    def resistance(self) -> float:
        """Winding resistance [ohm]."""
        return self.voltage * self.torque_constant / self.stall_torque

    def torque_range(self, omega: Array) -> tuple[Array, Array]:
        """Smallest and largest sprocket torque (...) [N m] at full voltage, at sprocket speeds (...) [rad/s]."""
        stall = self.gear * self.stall_torque
        spent = stall * self.gear / self.no_load_speed * omega
        return -stall - spent, stall - spent

    def loss(self, omega: Array) -> Array:
        """Coulomb friction of the gear (...) [N m] at sprocket speeds (...) [rad/s], smoothed at rest."""
        return self.friction * np.tanh(omega / _CREEP)

    def power(self, torque: Array, omega: Array) -> Array:
        """Electrical power (...) [W] at sprocket torques (...) [N m] and speeds (...) [rad/s]; feedback is negative."""
        current = torque / (self.gear * self.torque_constant)
        return torque * omega + self.resistance * current**2
