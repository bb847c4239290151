"""Contact presets: impedance that stiffens with depth, so that many points share a plane and few carry a stair.

A contact with impedance d(r) at depth r, between bodies of inverse weight A, pushes with
f = (d / (1 - d)) / A * (a* - a), a* = K d(r) / dmax^2 r - B / dmax v. Standing, N points at the depth `sink` carry the
robot of mass m; of their `regularisation` e, d / (1 - d) = e m A / N there. Then K = g dmax^2 / (e d sink), and heave
has the frequency w^2 = (1 + 2 sink d' / d) g / sink / (1 + e) and the damping e B / dmax / (1 + e) = 2 zeta w.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from trackslip.errors import require

_MAX_PUSH = 0.5
"""Largest share of its depth by which a contact pushes a light body out in a physics step, not to throw it [-]."""
_MAX_BRAKE = 1.0
"""Largest share of its speed that a contact takes from a light body in a physics step, not to reverse it [-]."""
IMPRATIO = 1e4
"""Ratio of frictional to normal constraint impedance [-]."""


@dataclass(frozen=True)
class Preset:
    """A contact recipe. `stiffening` points have d0 at no depth and `stiffening` d0 at `width`."""

    timestep: float
    """Physics step that it is made for [s]."""
    longest_timestep: float
    """Longest physics step at which it is stable [s]."""
    segments: int
    """Capsules along the longest run of a track; even."""
    sink: float
    """Depth of a robot that stands on one run of each track [m]."""
    damping_ratio: float
    """Damping ratio of heave [-]."""
    stiffening: float
    """Ratio of the impedances at depth `width` and at no depth [-]."""
    width: float
    """Depth at which the impedance is largest [m]."""
    power: float
    """Power of depth with which the impedance grows [-]."""
    regularisation: float = 0.02
    """Inverse softness of all points of the standing robot together, in robot masses [-]."""
    grip: float = 100.0
    """Rate at which sliding decays where the ground holds [1/s]."""
    core: float = 0.003
    """Depth at which the belt's hard core touches; more than a robot that stands sinks in [m]."""

    def contact(
        self,
        gravity: float,
        share: float,
        hardness: float,
        weight: float = 1.0,
        lightness: float = 1.0,
        brake: float = 0.0,
    ) -> ContactParameters:
        """Parameters of a contact.

        Args:
            gravity: acceleration of gravity [m/s^2].
            share: m A / N above [-].
            hardness: stiffness and damping relative to those of the preset [-].
            weight: load of this point on a plane, relative to the others [-].
            lightness: largest inverse mass of a point over that of the bodies, A [-].
            brake: least share of its speed that the contact takes from a lone point in one physics step [-].
        """
        softness = self.regularisation * share
        standing = softness / (1 + softness)
        growth = (self.stiffening - 1) * (self.sink / self.width) ** self.power
        first = standing / (1 + growth)
        last = min(first * self.stiffening, 0.99)
        softer = np.sqrt(weight)  # the force of a point goes with the square of its impedance
        steepness = 1 + 2 * self.power * growth / (1 + growth)
        e = self.regularisation
        frequency = np.sqrt(steepness * gravity / (self.sink * (1 + e)))
        stiffness = gravity * last**2 / (e * standing * self.sink)
        damping = 2 * self.damping_ratio * frequency * last * (1 + e) / e
        response = lightness / (lightness * last + 1 - last)  # of a point's acceleration to the contact's, over `last`
        stop = 1 / (response * self.timestep)  # damping that takes all of a point's speed in one step
        stiffness = min(hardness * stiffness, _MAX_PUSH * stop / self.timestep)
        damping = min(max(hardness * damping, brake * stop), _MAX_BRAKE * stop)
        midpoint = 0.5 if self.power == 1 else 0.999  # the whole rise is a power of depth
        return ContactParameters(
            solref=(-stiffness, -damping),
            solimp=(first * softer, last, self.width, midpoint, self.power),
            solreffriction=(-1.0, -self.grip * last),
        )


@dataclass(frozen=True)
class ContactParameters:
    """Fields of a contact pair."""

    solref: tuple[float, float]
    solimp: tuple[float, float, float, float, float]
    solreffriction: tuple[float, float]


PRESETS = {
    "accurate": Preset(0.002, 0.002, 8, 0.00034, 0.4, 2.7, 0.003, 3.0, core=0.0023),
    "fast": Preset(0.004, 0.004, 4, 0.00125, 0.35, 2.2, 0.004, 4.0, core=0.004),
}
"""Presets by name."""


def load_preset(preset: str | Preset) -> Preset:
    """Return the preset of that name, or the one given. Raises InvalidValueError for an unknown name."""
    if isinstance(preset, Preset):
        return preset
    require(preset in PRESETS, "preset", preset, f"one of {', '.join(PRESETS)}")
    return PRESETS[preset]


def set_options(spec: mujoco.MjSpec, preset: Preset) -> None:
    """Set the cone and impratio, and the time step unless the user has chosen one.

    Raises InvalidValueError for a time step at which the preset isn't stable, and if the spec overrides contacts.
    """
    option, plain = spec.option, mujoco.MjSpec().option
    _require_own_contacts(option)
    if option.timestep == plain.timestep:
        option.timestep = preset.timestep
    require_stable(option.timestep, preset)
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = max(option.impratio, IMPRATIO)
    if option.solver == mujoco.mjtSolver.mjSOL_PGS:  # doesn't converge at such an impratio
        option.solver = plain.solver


def require_stable(timestep: float, preset: Preset) -> None:
    """Raise InvalidValueError for a time step [s] at which the preset isn't stable."""
    allowed = f"at most {preset.longest_timestep:g} s, for contacts of this preset to be stable"
    require(0 < timestep <= preset.longest_timestep, "timestep", timestep, allowed)


def require_options(option: Any) -> None:
    """Raise InvalidValueError for options of a model (or a spec) with which contacts don't follow the recipe.

    `attach` keeps those of the spec that the robot is attached to.
    """
    elliptic = option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    require(elliptic, "cone", "pyramidal", "elliptic, as connect sets it")
    require(option.impratio >= IMPRATIO, "impratio", option.impratio, f"at least {IMPRATIO:g}, as connect sets it")
    _require_own_contacts(option)


def _require_own_contacts(option: Any) -> None:
    override = option.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE
    require(not override, "flag override", "enable", "disable: the contacts of tracks have parameters of their own")
