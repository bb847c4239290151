"""Options of a spec that the contact recipe needs."""

from __future__ import annotations

from typing import Any

import mujoco

from sim.tracks.presets import Preset
from trackslip.errors import require

IMPRATIO = 1e4
"""How much stiffer friction is than the soft normal direction [-]."""


def set_options(spec: mujoco.MjSpec, preset: Preset) -> None:
    """Set the cone and impratio, and the time step unless it is the user's own.

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
