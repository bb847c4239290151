"""Options of a spec that the contact recipe needs."""

from __future__ import annotations

import mujoco

from sim.tracks.presets import Preset
from trackslip.errors import require

IMPRATIO = 1e4
"""How much stiffer friction is than the soft normal direction [-]."""


def set_options(spec: mujoco.MjSpec, preset: Preset) -> None:
    """Set the cone and impratio, and the time step unless it is the user's own.

    Raises InvalidValueError for a time step at which the preset isn't stable.
    """
    option, plain = spec.option, mujoco.MjSpec().option
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
