"""The recipe for all contacts: soft springs that many points share on a plane, and hard cores for
greater depths.

A contact with impedance d between bodies of inverse weight A pushes with f = (d / (1 - d)) / A *
(a* - a), a* = -K r - B v at depth r. Together, N points with d / (1 - d) = e m A / N have a
softness of 1 / (e m), where e is the `regularisation` and m the robot's mass. A robot that stands
on them sinks in by g / (e K), and its heave has the squared frequency w^2 = e K / (1 + e) and the
damping e B / (1 + e).

Landing must not create energy. In a physics step h, a point moves by up to h v before the ground
pushes it, so damping and spring take the share (h B + h^2 K) a of the speed v. Here, a = e l / (1 +
e l) is the share of a* that the bodies follow, and l their mobility in the direction of the push,
relative to heave; it is large for a light limb. If the share exceeds 1, the robot rebounds at once;
if it exceeds 2, the robot rebounds faster than it landed. With e K and e B given, and thus the
depth of a standing robot, a larger e limits the share: l / (1 + e l) is never more than 1 / e.

Sliding also causes an upward force: in an elliptic cone with the friction mu, points that slide at
v are pushed off the ground as if a* were larger by mu * grip * v; together, these forces are mu * e
* grip * v times the robot's mass. Where e is increased for light limbs, the grip is divided by the
same factor, so that they don't hop while they slide.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackslip.errors import RobotWarning, require

Array = NDArray[np.float64]
WIDEST = 3.0
"""Largest gauge over contact length for which turns are verified to follow theory [-]."""
# points of a track as long as the gauge; exponent of the gauge in their number
_POINTS, _GROWTH = 10, 1.6
# largest gauge over contact length at which a preset's own number of points suffices [-]
_ENOUGH = 1.2
LEAST_ODDS = 1.001 * mujoco.mjMINIMP
"""Least d / (1 - d) of a contact [-]; the engine raises lower impedances d, which would change a
contact's rates.
"""
_MAX_TAKEN = 2.0  # largest share of a landing robot's speed that one physics step may take [-]
_CORE_IMPEDANCE = 0.95  # [-]
_CORE_PUSH = 0.4  # share of a core's depth that one physics step removes [-]
_CORE_BRAKE = 0.7  # share of a core's speed that one physics step removes [-]
# depth of a belt edge's core over the sinkage, which is at most 2 at the ends of a standing robot
# [-]
_EDGE = 2.4
_TIMESTEP = 1  # bit in `spec.authored.option` that is set if the spec's file states a time step
# depth over which the engine would vary the impedance, were it not constant here [m]
_WIDTH = 0.001


@dataclass(frozen=True)
class Preset:
    """A recipe for the contacts of tracks."""

    timestep: float
    """Longest physics step for which the preset is made [s]."""
    segments: int
    """Number of capsules along a track's longest run; even."""
    sink: float
    """Sinkage of a robot that stands on one run of each track [m]."""
    damping_ratio: float
    """Damping ratio of heave times the square root of 1 + regularisation [-]."""
    regularisation: float = 0.02
    """Inverse of the total softness of all points below a standing robot, in robot masses [-]."""
    grip: float = 100.0
    """Rate at which sliding decays on ground that holds, with this regularisation [1/s]."""
    core_depth: float = 0.003
    """Depth at which the belt's hard core touches; greater than a standing robot's sinkage [m]."""
    impratio: float = 1e4
    """Ratio of frictional to normal constraint impedance [-]. A robot parked on a slope creeps at g
    sin(slope) over regularisation * impratio * grip.
    """

    def softer(self, factor: float) -> Preset:
        """A preset whose points are softer by a `factor` and shift less load while they slide, at
        the same creep.
        """
        return replace(
            self, regularisation=self.regularisation / factor, impratio=self.impratio * factor
        )

    @property
    def edge_depth(self) -> float:
        """Depth of the core at the edges of wide belts, whose few springs alone would let a robot
        lean too far [m].
        """
        return _EDGE * self.sink

    def regularise(
        self, gravity: float, mobility: Array | float, least_share: Array | float
    ) -> Array:
        """Regularisation (...) at which landing creates no energy and no impedance is below the
        engine's least.

        Args:
            gravity: acceleration of gravity [m/s^2].
            mobility: l in the module's docstring, which may be infinite [-].
            least_share: m A / N in the module's docstring, of the point with the least load [-].
        """
        stiffness, damping = self._rates(gravity)
        taken = self.timestep * damping + self.timestep**2 * stiffness
        least = np.maximum(
            taken / _MAX_TAKEN - 1 / np.asarray(mobility), LEAST_ODDS / np.asarray(least_share)
        )
        return np.maximum(self.regularisation, least)

    def contact(
        self,
        gravity: float,
        share: Array | float,
        regularisation: Array | float,
        grip: Array | float,
    ) -> ContactParameters:
        """Parameters (...) of soft contacts.

        Args:
            gravity: acceleration of gravity [m/s^2].
            share: m A / N in the module's docstring, for the point's share of the load [-].
            regularisation: e in the module's docstring [-].
            grip: rate at which sliding decays on ground that holds [1/s].
        """
        odds = np.asarray(regularisation * share)
        d, (stiffness, damping) = odds / (1 + odds), self._rates(gravity)
        return ContactParameters.of(
            d, d * stiffness / regularisation, d * damping / regularisation, d * grip
        )

    def core(self) -> ContactParameters:
        """Parameters of the hard cores below a belt's surface.

        A robot that tips over an edge meets the next one with only a wheel or two, where contacts
        designed for many points on a plane yield by centimetres. A core's impedance, and its a, are
        near 1: whatever the number of cores and the robot, cores never take more of the speed than
        their rates prescribe.
        """
        d = np.asarray(_CORE_IMPEDANCE)
        push, brake = d * _CORE_PUSH / self.timestep**2, d * _CORE_BRAKE / self.timestep
        return ContactParameters.of(d, push, brake, d * self.grip)

    def _rates(self, gravity: float) -> tuple[float, float]:
        """The products e K [1/s^2] and e B [1/s]."""
        return gravity / self.sink, float(2 * self.damping_ratio * np.sqrt(gravity / self.sink))


@dataclass(frozen=True)
class ContactParameters:
    """Fields of contact pairs in MuJoCo."""

    solref: Array  # (..., 2)
    solimp: Array  # (..., 5)
    solreffriction: Array  # (..., 2)

    @classmethod
    def of(
        cls, impedance: Array, stiffness: Array, damping: Array, grip: Array
    ) -> ContactParameters:
        """Fields for an impedance (...) that is constant over depth; rates (...) are divided by it
        in the engine.
        """
        solimp = [
            impedance,
            impedance,
            *(np.full_like(impedance, value) for value in (_WIDTH, 0.5, 1.0)),
        ]
        columns = ([-stiffness, -damping], solimp, [-np.ones_like(impedance), -grip])
        return cls(*(np.stack(column, axis=-1) for column in columns))


PRESETS = {
    "accurate": Preset(0.002, 8, 0.00034, 0.4, core_depth=0.0015),
    "fast": Preset(0.004, 4, 0.00125, 0.35, core_depth=0.003),
}
"""Presets by name."""
_SOFT = 20 * 0.004 / 0.996  # regularisation of 20 points with an impedance of 0.004
LEVEL = Preset(0.005, 5, 0.002, 0.7 * math.sqrt(1 + _SOFT), _SOFT)
"""Preset for tracks that never leave a plane: no cores, and a damping ratio of 0.7 in heave."""
LEVEL_WIDE = replace(LEVEL, regularisation=_SOFT / 2, grip=2 * LEVEL.grip)
"""`LEVEL` for a wide robot: elements near the middle of its short tracks slide so little that grip
must act fast.
"""
LEVEL_WHEELS = LEVEL.softer(25)
"""`LEVEL` for faster robots, those on wheels: less load shifts to points that slide."""


def track_points(half_gauge: float, contact_length: float, preset: Preset) -> int:
    """Number of points at which each of two tracks touches the ground, two per segment.

    The ICRs of a short, wide robot are so close to its tracks that only elements within a few
    millimetres of a track's middle slide more along the track than across it: the wider the robot,
    the finer its points. If gauge over contact length exceeds WIDEST, their number no longer grows,
    and a RobotWarning is issued.
    """
    warn_if_unverified(half_gauge, contact_length)
    width = min(2 * half_gauge / contact_length, WIDEST)
    return 2 * preset.segments if width <= _ENOUGH else 2 * math.ceil(_POINTS * width**_GROWTH / 2)


def warn_if_unverified(half_gauge: float, contact_length: float) -> None:
    """Issue a RobotWarning for a robot so wide that its turns aren't verified to follow theory."""
    if half_gauge > WIDEST * contact_length / 2 * (1 + 1e-9):
        allowed = (
            f"turns are verified up to {WIDEST / 2 * contact_length:.4g} m, {WIDEST / 2:g} "
            "contact lengths"
        )
        warnings.warn(f"half_gauge = {half_gauge:.4g}: {allowed}", RobotWarning, stacklevel=5)


def load_preset(preset: str | Preset) -> Preset:
    """Return the preset with this name, or the given preset. Raises InvalidValueError for an
    unknown name.
    """
    if isinstance(preset, Preset):
        return preset
    require(preset in PRESETS, "preset", preset, f"one of {', '.join(PRESETS)}")
    return PRESETS[preset]


def shared_timestep(spec: mujoco.MjSpec, presets: Sequence[Preset]) -> float:
    """The presets' shortest time step, or the one in the spec's file; raises InvalidValueError if
    it isn't stable.
    """
    steps = [preset.timestep for preset in presets]
    chosen = spec.authored.option & _TIMESTEP or spec.option.timestep not in (
        mujoco.MjSpec().option.timestep,
        *steps,
    )
    step = spec.option.timestep if chosen else min(steps)
    for preset in presets:
        require_stable(step, preset)
    return float(step)


def set_options(option: Any, preset: Preset) -> None:
    """Set cone, impratio and solver of a spec or a model.

    Raises InvalidValueError if the option overrides contacts, or disables the sensors that read
    them.
    """
    override = option.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE
    require(
        not override,
        "flag override",
        "enable",
        "disable: the contacts of tracks have parameters of their own",
    )
    unread = option.disableflags & mujoco.mjtDisableBit.mjDSBL_SENSOR
    require(
        not unread, "flag sensor", "disable", "enable: the tracks' contacts are read from sensors"
    )
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = max(option.impratio, preset.impratio)
    # this solver doesn't converge at the preset's impratio
    if option.solver == mujoco.mjtSolver.mjSOL_PGS:
        option.solver = mujoco.mjtSolver.mjSOL_NEWTON


def require_stable(timestep: float, preset: Preset) -> None:
    """Raise InvalidValueError for a time step [s] at which the preset isn't stable."""
    allowed = (
        f"at most {preset.timestep:g} s, for stable contacts of this preset: change it in "
        "the model's <option>"
    )
    require(0 < timestep <= preset.timestep, "timestep", timestep, allowed)
