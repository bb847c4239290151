"""Motors with a torque-speed line, gear and losses, and the drives of sprockets that contain them.

Torques and speeds are those of the sprocket, positive forwards. At the speed w, a motor with the
stall torque S and the no-load speed W exerts, at full voltage forwards or backwards,

    T = S (1 - w / W)   or   T = -S (1 + w / W),

and any torque in between at less voltage. Against its direction of motion, a motor is therefore
stronger than at rest; beyond its no-load speed it can only brake. The amplifier limits the current,
and with it the torque, to a range from -L to L. Of the motor's torque, the gear takes its friction:

    what reaches the belt = T - friction * sign(w)    (tanh(w / 0.02 rad/s) in place of the sign),

which hinders a motor that drives, and helps one that brakes or is driven backwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from trackslip.arguments import checks_arguments
from trackslip.errors import (
    Checked,
    SettingsFileError,
    checked,
    require,
    require_non_negative,
    require_positive,
)

Array = NDArray[np.floating[Any]]

_SMALLEST: Final = 1e-12  # limits for all parameters, so that no derived value overflows
_LARGEST: Final = 1e6
_CREEP: Final = 0.02  # scale of the sprocket speeds at which gear friction changes sign [rad/s]
UNLIMITED: Final = 1e6
"""Torque limit of a drive that never saturates [N m]."""
TOP_SPEED: Final = 0.6
"""Top speed of the tracks of a robot without motors of its own [m/s]."""
LINE: Final = ("gear", "no_load_speed", "stall_torque")
"""Numbers of a motor that make its torque-speed line."""


class TorqueLaw(Protocol):
    """What a motor can exert at a speed, and what its gear takes of it."""

    def limits(self, omega: Array, torque_limit: Array | float) -> tuple[Array, Array]:
        """Smallest and largest torques (...) [N m] at speeds (...) [rad/s]."""

    def loss(self, omega: Array) -> Array:
        """Torque (...) lost in the gear [N m] at speeds (...) [rad/s]."""


class EvenTorque:
    """A motor without losses that can exert its torque limit at any speed."""

    def limits(self, omega: Array, torque_limit: Array | float) -> tuple[Array, Array]:
        """Smallest and largest torques (...) [N m] at speeds (...) [rad/s]."""
        largest = np.broadcast_to(torque_limit, omega.shape)
        return -largest, largest

    def loss(self, omega: Array) -> Array:
        """No loss (...) [N m] at speeds (...) [rad/s]."""
        return np.zeros_like(omega)


def _require_usable(name: str, value: float) -> None:
    require_positive(name, value, _LARGEST)
    require(value >= _SMALLEST, name, value, f"at least {_SMALLEST:g}")


@dataclass(frozen=True)
class Motor(Checked):
    """A brushed DC motor with a gear. All values are assumptions: its 60 W can easily drive 25 kg
    at 0.3 m/s.
    """

    gear: float = checked(50.0, _require_usable)
    """Gear ratio, motor speed over sprocket speed [-]."""
    voltage: float = checked(24.0, _require_usable)
    """Voltage of the battery, the largest voltage at the motor [V]."""
    no_load_speed: float = checked(400.0, _require_usable)
    """No-load speed of the motor at full voltage [rad/s]."""
    stall_torque: float = checked(0.6, _require_usable)
    """Stall torque of the motor at full voltage [N m]."""
    rotor_inertia: float = checked(8e-6, _require_usable)
    """Moment of inertia of the rotor, including the gear [kg m^2]."""
    friction: float = checked(0.3, require_non_negative)
    """Friction torque of the gear, measured at the sprocket [N m]."""

    @classmethod
    def from_table(cls, table: Mapping[str, Any], where: str) -> Motor:
        """A motor from the table `[drive.motor]` of a robot file; without friction and inertia
        unless it states them.

        Raises SettingsFileError, which begins with `where`, for a table without one of the numbers
        that make the torque-speed line: those of another robot's motor would be no default.
        """
        from sim.common.settings import build  # late, as sim.tracks does without files

        for name in LINE:
            if name not in table:
                raise SettingsFileError(
                    f"{where}: {name} is missing: a motor has {', '.join(LINE[:-1])} and {LINE[-1]}"
                )
        return build(cls, table, where, tireless().motor)

    def __post_init__(self) -> None:
        super().__post_init__()
        require(
            self.friction < self.stall,
            "friction",
            self.friction,
            f"less than gear * stall_torque = {self.stall:g} N m",
        )

    @property
    def stall(self) -> float:
        """Stall torque at the sprocket [N m]."""
        return self.gear * self.stall_torque

    @cached_property
    def inertia(self) -> float:
        """Moment of inertia of the motor at the sprocket [kg m^2]."""
        return self.rotor_inertia * self.gear**2

    @cached_property
    def torque_constant(self) -> float:
        """Torque constant, which equals the back-EMF constant [N m/A]."""
        return self.voltage / self.no_load_speed

    @cached_property
    def resistance(self) -> float:
        """Winding resistance [ohm]."""
        return self.voltage * self.torque_constant / self.stall_torque

    def limits(self, omega: Array, torque_limit: Array | float) -> tuple[Array, Array]:
        """Smallest and largest sprocket torques (...) [N m] at sprocket speeds (...) [rad/s], if
        the current is limited to that of `torque_limit` (...) [N m].
        """
        stall = self.stall
        back_emf = stall * self.gear / self.no_load_speed * omega
        # takes a third of np.clip's time
        smallest = np.minimum(np.maximum(-stall - back_emf, -torque_limit), torque_limit)
        largest = np.minimum(np.maximum(stall - back_emf, -torque_limit), torque_limit)
        return smallest, largest

    def loss(self, omega: Array) -> Array:
        """Coulomb friction of the gear (...) [N m] at sprocket speeds (...) [rad/s], smoothed
        around rest.
        """
        return self.friction * np.tanh(omega / _CREEP)

    def power(self, torque: Array, omega: Array) -> Array:
        """Electrical power (...) [W] at sprocket torques (...) [N m] and speeds (...) [rad/s];
        negative if fed back.
        """
        current = torque / (self.gear * self.torque_constant)
        return torque * omega + self.resistance * current**2


@checks_arguments
@dataclass(frozen=True)
class Drive(Checked):
    """Servo and motor of a sprocket. The defaults are the shipped robot's, of which only the top
    speed is from the paper; all other values are assumptions. In robot files, they are no defaults:
    see `from_table`.
    """

    lag: float = checked(0.05, require_positive, 1.0, "s")
    """Time constant of the speed controller [s]."""
    top_speed: float = checked(0.3, require_positive, 10.0, "m/s")
    """Largest speed of a track (paper, Sec. II) [m/s]."""
    torque_limit: float = checked(8.0, require_positive)
    """Largest motor torque at the sprocket, limited by the amplifier's current [N m]."""
    encoder_counts: int = checked(100_000, require_positive)
    """Encoder counts per sprocket revolution (motor encoder times gear)."""
    period: float = checked(0.01, require_positive)
    """Sampling period of the servo [s]."""
    motor: Motor = field(default_factory=Motor)
    """Motor and gear of the sprocket."""

    @classmethod
    def from_table(cls, table: Mapping[str, Any], where: str) -> Drive:
        """A drive from the table `[drive]` of a robot file; what it leaves out is that of a robot
        without motors, and no limit.

        Raises SettingsFileError, which begins with `where`, for values that aren't allowed.
        """
        from sim.common.settings import build  # late, as sim.tracks does without files

        return build(cls, table, where, tireless())

    def __post_init__(self) -> None:
        super().__post_init__()
        limit, friction = self.torque_limit, self.motor.friction
        require(
            limit > friction, "torque_limit", limit, f"more than motor.friction = {friction} N m"
        )

    def limits(self, omega: Array) -> tuple[Array, Array]:
        """Smallest and largest motor torques (...) [N m] at sprocket speeds (...) [rad/s]."""
        return self.motor.limits(omega, self.torque_limit)

    def strength(self, omega: float) -> float:
        """Largest torque that reaches a belt which the motor drives at a sprocket speed [N m]."""
        speed = np.array(abs(omega))
        largest = self.limits(speed)[1]
        return float(largest - self.motor.loss(speed))


def or_tireless(drive: Drive | None) -> Drive:
    """A robot's drive; for a robot without motors, one that never saturates."""
    return tireless() if drive is None else drive


def tireless(top_speed: float = TOP_SPEED) -> Drive:
    """A drive that never saturates and loses nothing, for robots without motors of their own, and
    to isolate the ground's effect; `top_speed` is in m/s.
    """
    return Drive(
        top_speed=top_speed,
        torque_limit=UNLIMITED,
        motor=Motor(
            gear=300.0,  # makes the loss in its winding small
            no_load_speed=_LARGEST,
            stall_torque=_LARGEST,
            rotor_inertia=_SMALLEST,
            friction=0.0,
        ),
    )
