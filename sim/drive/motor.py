"""The motor of a sprocket: torque-speed line, gear, inertia, friction loss, electrical power."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.errors import InvalidValueError, require_at_most, require_non_negative, require_positive
from trackslip.kinematics import Array

_MIN_NUMBER, _MAX_NUMBER = 1e-12, 1e6  # of any number of a motor, so that none of what follows from them overflows
_CREEP = 0.02  # sprocket speed over which the gear's friction turns round [rad/s]


@dataclass(frozen=True)
class Motor:
    """A brushed DC motor with a gear. All assumptions: a 60 W motor that moves 25 kg at 0.3 m/s with power to spare."""

    gear: float = 50.0
    """Turns of the motor for one of the sprocket [-]."""
    voltage: float = 24.0
    """Of the battery: the largest that the motor gets [V]."""
    no_load_speed: float = 400.0
    """Speed of the motor at full voltage without load [rad/s]."""
    stall_torque: float = 0.6
    """Torque of the motor at full voltage that stops it [N m]."""
    rotor_inertia: float = 8e-6
    """Of the motor, gear included [kg m^2]."""
    friction: float = 0.3
    """Torque lost in the gear, at the sprocket [N m]."""

    def __post_init__(self) -> None:
        for name in ("gear", "voltage", "no_load_speed", "stall_torque", "rotor_inertia"):
            require_positive(name, getattr(self, name))
            require_at_most(name, getattr(self, name), _MAX_NUMBER)
            if getattr(self, name) < _MIN_NUMBER:
                raise InvalidValueError(name, getattr(self, name), f"at least {_MIN_NUMBER:g}")
        require_non_negative("friction", self.friction)
        if self.friction >= self.gear * self.stall_torque:
            raise InvalidValueError(
                "friction", self.friction, f"less than gear * stall_torque = {self.gear * self.stall_torque:g} N m"
            )

    @property
    def inertia(self) -> float:
        """Of the rotor, at the sprocket [kg m^2]."""
        return self.rotor_inertia * self.gear**2

    @property
    def torque_constant(self) -> float:
        """Torque per current, which is also voltage per speed [N m/A]."""
        return self.voltage / self.no_load_speed

    @property
    def resistance(self) -> float:
        """Of the winding [ohm]."""
        return self.voltage * self.torque_constant / self.stall_torque

    def torque_range(self, omega: Array) -> tuple[Array, Array]:
        """Least and greatest torque at the sprocket (...) [N m] that full voltage gives at sprocket speeds (...)."""
        stall = self.gear * self.stall_torque
        spent = stall * self.gear / self.no_load_speed * omega
        return -stall - spent, stall - spent

    def loss(self, omega: Array) -> Array:
        """Friction torque of the gear (...) [N m] at sprocket speeds (...) [rad/s]: Coulomb's, rounded off at rest."""
        return self.friction * np.tanh(omega / _CREEP)

    def power(self, torque: Array, omega: Array) -> Array:
        """Electrical power (...) [W] for torques at the sprocket (...) [N m]; negative when the motor feeds back."""
        current = torque / (self.gear * self.torque_constant)
        return torque * omega + self.resistance * current**2
