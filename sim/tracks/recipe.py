"""The recipe for all contacts: soft springs that many points share on a plane, and hard cores for greater depths.

A contact with impedance d between bodies of inverse weight A pushes with f = (d / (1 - d)) / A * (a* - a),
a* = -K r - B v at depth r. Together, N points with d / (1 - d) = e m A / N have a softness of 1 / (e m), where e is the
`regularisation` and m the robot's mass. A robot that stands on them sinks in by g / (e K), and its heave has the
squared frequency w^2 = e K / (1 + e) and the damping e B / (1 + e).

Landing must not create energy. In a physics step h, a point moves by h v at most before it is pushed, so that damping
and spring take the share (h B + h^2 K) a of the speed v, where a = e l / (1 + e l) is the share of a* that the bodies
follow, and l their mobility in the direction of the push, relative to heave. If more than 1 is taken, the robot leaves
at once; if more than 2, faster than it came. A light limb has a large l. With e K and e B given, and thus the depth of
a standing robot, a larger e bounds what is taken: l / (1 + e l) is never more than 1 / e.

Sliding pushes up, too: in an elliptic cone with the friction mu, points that slide at v are pushed off the ground as if
a* were mu * grip * v larger; the force on all of them is mu * e * grip * v times the robot's mass. Where e grows for
light limbs, the grip is divided by the same factor, so that they don't hop when they slide.
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
_POINTS, _GROWTH = 10, 1.6  # points of a track as long as the gauge; their number grows with this power of the gauge
_ENOUGH = 1.2  # largest gauge over contact length for which a preset's own points suffice [-]
LEAST_ODDS = 1.001 * mujoco.mjMINIMP
"""Least d / (1 - d) of a contact [-]; the engine raises lower impedances d, which changes the contact's rates."""
_MAX_TAKEN = 2.0  # largest share of a landing robot's speed that one physics step may take [-]
_CORE_IMPEDANCE = 0.95  # [-]
_CORE_PUSH = 0.4  # share of its depth by which a core is pushed out in one physics step [-]
_CORE_BRAKE = 0.7  # share of its speed that a core loses in one physics step [-]
_EDGE = 2.4  # depth of a belt edge's core, over the sinkage of a standing robot, which is at most 2 at its ends [-]
_TIMESTEP = 1  # bit in `spec.authored.option` for a time step that the spec's file states
_WIDTH = 0.001  # depth over which the engine would change the impedance, which is constant here [m]


@dataclass(frozen=True)
class Preset:
    """A contact recipe."""

    timestep: float
    """Longest physics step that the preset is made for [s]."""
    segments: int
    """Number of capsules along a track's longest run; even."""
    sink: float
    """Sinkage of a robot that stands on one run of each track [m]."""
    damping_ratio: float
    """Damping ratio of heave, times the square root of 1 + regularisation [-]."""
    regularisation: float = 0.02
    """Inverse of the total softness of all points under a standing robot, in robot masses [-]."""
    grip: float = 100.0
    """Rate at which sliding decays where the ground holds, for this regularisation [1/s]."""
    core_depth: float = 0.003
    """Depth at which the belt's hard core touches; more than a standing robot's sinkage [m]."""
    impratio: float = 1e4
    """Ratio of frictional to normal constraint impedance [-]. A robot parked on a slope creeps at g sin(slope) over
    regularisation * impratio * grip."""

    def softer(self, factor: float) -> Preset:
        """A preset with points softer by a factor, which shift less load where they slide, and with the same creep."""
        return replace(self, regularisation=self.regularisation / factor, impratio=self.impratio * factor)

    @property
    def edge_depth(self) -> float:
        """Core depth at the edges of wide belts, whose few springs would let a robot lean far before it tips [m]."""
        return _EDGE * self.sink

    def regularise(self, gravity: float, mobility: Array | float, least_share: Array | float) -> Array:
        """Regularisation (...) with which landing creates no energy, and no impedance is below the engine's least.

        Args:
            gravity: acceleration of gravity [m/s^2].
            mobility: l above, which may be infinite [-].
            least_share: m A / N above, for the point that carries least load [-].
        """
        stiffness, damping = self._rates(gravity)
        taken = self.timestep * damping + self.timestep**2 * stiffness
        least = np.maximum(taken / _MAX_TAKEN - 1 / np.asarray(mobility), LEAST_ODDS / np.asarray(least_share))
        return np.maximum(self.regularisation, least)

    def contact(
        self, gravity: float, share: Array | float, regularisation: Array | float, grip: Array | float
    ) -> ContactParameters:
        """Parameters (...) of contacts.

        Args:
            gravity: acceleration of gravity [m/s^2].
            share: m A / N above, for the point's share of the load [-].
            regularisation: e above [-].
            grip: rate at which sliding decays where the ground holds [1/s].
        """
        odds = np.asarray(regularisation * share)
        d, (stiffness, damping) = odds / (1 + odds), self._rates(gravity)
        return ContactParameters.of(d, d * stiffness / regularisation, d * damping / regularisation, d * grip)

    def core(self) -> ContactParameters:
        """Parameters of the hard core below a belt's surface.

        A robot that tips over an edge meets the next one with only a wheel or two, and contacts made for many points on
        a plane then yield by centimetres. The impedance of a core is near 1, and so is a: cores never take more of the
        speed than they are asked for, however many there are and on any robot.
        """
        d = np.asarray(_CORE_IMPEDANCE)
        push, brake = d * _CORE_PUSH / self.timestep**2, d * _CORE_BRAKE / self.timestep
        return ContactParameters.of(d, push, brake, d * self.grip)

    def _rates(self, gravity: float) -> tuple[float, float]:
        """The products e K [1/s^2] and e B [1/s]."""
        return gravity / self.sink, float(2 * self.damping_ratio * np.sqrt(gravity / self.sink))


@dataclass(frozen=True)
class ContactParameters:
    """Fields of contact pairs."""

    solref: Array  # (..., 2)
    solimp: Array  # (..., 5)
    solreffriction: Array  # (..., 2)

    @classmethod
    def of(cls, impedance: Array, stiffness: Array, damping: Array, grip: Array) -> ContactParameters:
        """Fields for an impedance (...) at any depth, and rates (...), which the engine divides by the impedance."""
        solimp = [impedance, impedance, *(np.full_like(impedance, value) for value in (_WIDTH, 0.5, 1.0))]
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
"""`LEVEL` for a wide robot: near the middle of its short tracks, elements slide so little that grip must act fast."""
LEVEL_WHEELS = LEVEL.softer(25)
"""`LEVEL` for wheels, whose robots are faster: it shifts less load to points that slide."""


def track_points(half_gauge: float, contact_length: float, preset: Preset) -> int:
    """Number of points at which each of two tracks touches the ground, two per segment [-].

    The ICRs of a short, wide robot are so close to its tracks that only elements within a few millimetres of a track's
    middle slide more along the track than across it: the wider the robot, the finer its points. Beyond WIDEST their
    number no longer grows, and there is a RobotWarning.
    """
    warn_if_unverified(half_gauge, contact_length)
    width = min(2 * half_gauge / contact_length, WIDEST)
    return 2 * preset.segments if width <= _ENOUGH else 2 * math.ceil(_POINTS * width**_GROWTH / 2)


def warn_if_unverified(half_gauge: float, contact_length: float) -> None:
    """Issue a RobotWarning for a robot so wide that its turns aren't verified to follow theory."""
    if half_gauge > WIDEST * contact_length / 2 * (1 + 1e-9):
        allowed = f"turns are verified up to {WIDEST / 2 * contact_length:.4g} m, {WIDEST / 2:g} contact lengths"
        warnings.warn(f"half_gauge = {half_gauge:.4g}: {allowed}", RobotWarning, stacklevel=5)


def load_preset(preset: str | Preset) -> Preset:
    """Return the preset with this name, or the given preset. Raises InvalidValueError for an unknown name."""
    if isinstance(preset, Preset):
        return preset
    require(preset in PRESETS, "preset", preset, f"one of {', '.join(PRESETS)}")
    return PRESETS[preset]


def shared_timestep(spec: mujoco.MjSpec, presets: Sequence[Preset]) -> float:
    """The presets' shortest time step, or the spec's if the user chose one; InvalidValueError if it isn't stable."""
    steps = [preset.timestep for preset in presets]
    chosen = spec.authored.option & _TIMESTEP or spec.option.timestep not in (mujoco.MjSpec().option.timestep, *steps)
    step = spec.option.timestep if chosen else min(steps)
    for preset in presets:
        require_stable(step, preset)
    return float(step)


def set_options(option: Any, preset: Preset) -> None:
    """Set cone, impratio and solver of a spec or a model.

    Raises InvalidValueError if it overrides contacts, or disables the sensors that read them.
    """
    override = option.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE
    require(not override, "flag override", "enable", "disable: the contacts of tracks have parameters of their own")
    unread = option.disableflags & mujoco.mjtDisableBit.mjDSBL_SENSOR
    require(not unread, "flag sensor", "disable", "enable: the tracks' contacts are read from sensors")
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = max(option.impratio, preset.impratio)
    if option.solver == mujoco.mjtSolver.mjSOL_PGS:  # doesn't converge at this impratio
        option.solver = mujoco.mjtSolver.mjSOL_NEWTON


def require_stable(timestep: float, preset: Preset) -> None:
    """Raise InvalidValueError for a time step [s] at which the preset isn't stable."""
    allowed = f"at most {preset.timestep:g} s, for stable contacts of this preset: change it in the model's <option>"
    require(0 < timestep <= preset.timestep, "timestep", timestep, allowed)
