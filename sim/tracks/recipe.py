"""The one recipe of contacts: springs that many points share on a plane; what is deeper is left to hard cores.

A contact with impedance d between bodies of inverse weight A pushes with f = (d / (1 - d)) / A * (a* - a),
a* = -K r - B v at depth r. N points with d / (1 - d) = e m A / N have a softness of 1 / (e m) together, e being the
`regularisation` and m the robot's mass. Standing on them, the robot sinks in by g / (e K), and heave has the
squared frequency w^2 = e K / (1 + e) and the damping e B / (1 + e).

Landing must not create energy. In a physics step h, a point moves by h v at most before it is pushed, so that damping
and spring take (h B + h^2 K) a of the speed v, where a = e l / (1 + e l) is the share of a* that the bodies follow, and
l their mobility in the direction of the push, relative to heave. If that is more than 1 the robot leaves at once, and
if it is more than 2 faster than it came. A light limb has a large l. With e K and e B given, and thus the depth at
which the robot stands, a larger e bounds a: l / (1 + e l) is never more than 1 / e.

Sliding pushes up, too: in an elliptic cone with the friction mu, points that slide at v are pushed off the ground as if
a* were mu * grip * v more, with mu * e * grip * v of a robot's mass together. The grip is divided by as much as e
grows for light limbs, so that they don't hop when they slide.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from trackslip.errors import RobotWarning, require

WIDEST = 3.0
"""Gauge over contact length up to which turns are verified to follow theory [-]."""
_POINTS, _GROWTH = 10, 1.6  # points of a track as long as the gauge, and the power of the gauge with which they grow
_ENOUGH = 1.2  # gauge over contact length up to which a preset's own points will do [-]
LEAST_ODDS = 1.001 * mujoco.mjMINIMP
"""Least d / (1 - d) of a contact [-]; the engine raises lower impedances d, and the contact then has other rates."""
_MAX_TAKEN = 2.0  # share of its speed that landing takes from a robot in one physics step [-]
_CORE_IMPEDANCE = 0.95  # [-]
_CORE_PUSH = 0.4  # share of its depth by which a core is pushed out in one physics step [-]
_CORE_BRAKE = 0.7  # share of its speed that a core loses in one physics step [-]
_EDGE = 1.5  # depth at which the core of a belt's edge touches, over that of a robot that stands [-]
_TIMESTEP = 1  # in `spec.authored.option`, the bit of a timestep that the spec's file states
_WIDTH = 0.001  # over which the engine would change the impedance, which is constant [m]


@dataclass(frozen=True)
class Preset:
    """A contact recipe."""

    timestep: float
    """Longest physics step that it is made for [s]."""
    segments: int
    """Capsules along the longest run of a track; even."""
    sink: float
    """Depth of a robot that stands on one run of each track [m]."""
    damping_ratio: float
    """Damping ratio of heave, times the root of 1 + regularisation [-]."""
    regularisation: float = 0.02
    """Inverse softness of all points of the standing robot together, in robot masses [-]."""
    grip: float = 100.0
    """Rate at which sliding decays where the ground holds, at that softness [1/s]."""
    core_depth: float = 0.003
    """Depth at which the belt's hard core touches; more than a robot that stands sinks in [m]."""
    impratio: float = 1e4
    """Ratio of frictional to normal constraint impedance [-]. A robot parked on a slope creeps at g sin(slope) over
    regularisation * impratio * grip."""

    def softer(self, factor: float) -> Preset:
        """The same with so many times softer points, which shift less load where they slide, and the same creep."""
        return replace(self, regularisation=self.regularisation / factor, impratio=self.impratio * factor)

    @property
    def edge_depth(self) -> float:
        """The same at the edges of wide belts, whose few springs would let a robot lean far before it tips over [m]."""
        return _EDGE * self.sink

    def regularise(self, gravity: float, mobility: float, least_share: float) -> float:
        """Regularisation with which landing creates no energy, and no impedance is below the engine's least.

        Args:
            gravity: acceleration of gravity [m/s^2].
            mobility: l above, which may be infinite [-].
            least_share: m A / N above, of the point that carries least [-].
        """
        stiffness, damping = self._rates(gravity)
        taken = self.timestep * damping + self.timestep**2 * stiffness
        return max(self.regularisation, taken / _MAX_TAKEN - 1 / mobility, LEAST_ODDS / least_share)

    def contact(self, gravity: float, share: float, regularisation: float, grip: float) -> ContactParameters:
        """Parameters of a contact.

        Args:
            gravity: acceleration of gravity [m/s^2].
            share: m A / N above, for the point's part of the load [-].
            regularisation: e above [-].
            grip: rate at which sliding decays where the ground holds [1/s].
        """
        d = regularisation * share / (1 + regularisation * share)
        stiffness, damping = self._rates(gravity)
        return ContactParameters(
            solref=(-d * stiffness / regularisation, -d * damping / regularisation),  # the engine divides by d
            solimp=(d, d, _WIDTH, 0.5, 1.0),
            solreffriction=(-1.0, -d * grip),
        )

    def core(self) -> ContactParameters:
        """Parameters of the hard core below a belt's surface.

        A robot that tips over an edge meets the next one with a wheel or two, and contacts that share a plane with many
        points then yield by centimetres. The impedance of a core is near 1, so that a is, too: cores never take more
        than they are asked for, whatever their number and the robot.
        """
        d = _CORE_IMPEDANCE
        return ContactParameters(
            solref=(-d * _CORE_PUSH / self.timestep**2, -d * _CORE_BRAKE / self.timestep),
            solimp=(d, d, _WIDTH, 0.5, 1.0),
            solreffriction=(-1.0, -d * self.grip),
        )

    def _rates(self, gravity: float) -> tuple[float, float]:
        """The products e K [1/s^2] and e B [1/s]."""
        return gravity / self.sink, float(2 * self.damping_ratio * np.sqrt(gravity / self.sink))


@dataclass(frozen=True)
class ContactParameters:
    """Fields of a contact pair."""

    solref: tuple[float, float]
    solimp: tuple[float, float, float, float, float]
    solreffriction: tuple[float, float]


PRESETS = {
    "accurate": Preset(0.002, 8, 0.00034, 0.4, core_depth=0.0015),
    "fast": Preset(0.004, 4, 0.00125, 0.35, core_depth=0.003),
}
"""Presets by name."""
_SOFT = 20 * 0.004 / 0.996  # of 20 points whose impedance is 0.004
LEVEL = Preset(0.005, 5, 0.002, 0.7 * math.sqrt(1 + _SOFT), _SOFT)
"""Tracks that never leave a plane: no cores, and heave of a damping ratio of 0.7."""
LEVEL_WIDE = replace(LEVEL, regularisation=_SOFT / 2, grip=2 * LEVEL.grip)
"""The same of a wide robot. Near the middle of a short track the time that the grip takes, at the speed of the robot,
is a way that counts."""
LEVEL_WHEELS = LEVEL.softer(25)
"""The same of wheels, whose robots are faster: they shift less load to points that slide."""


def track_points(half_gauge: float, contact_length: float, preset: Preset) -> int:
    """Number of points at which each of two tracks touches the ground, 2 at either end of a segment [-].

    The ICRs of a short, wide robot are so close to its tracks that only the elements of track within a few
    millimetres of its middle slide along themselves more than across: the wider the robot, the finer its points.
    Beyond WIDEST there are no more, and a RobotWarning.
    """
    if half_gauge > WIDEST * contact_length / 2 * (1 + 1e-9):
        allowed = f"turns are verified up to {WIDEST / 2 * contact_length:.4g} m, {WIDEST / 2:g} contact lengths"
        warnings.warn(f"half_gauge = {half_gauge:.4g}: {allowed}", RobotWarning, stacklevel=4)
    width = min(2 * half_gauge / contact_length, WIDEST)
    return 2 * preset.segments if width <= _ENOUGH else 2 * math.ceil(_POINTS * width**_GROWTH / 2)


def load_preset(preset: str | Preset) -> Preset:
    """Return the preset of that name, or the one given. Raises InvalidValueError for an unknown name."""
    if isinstance(preset, Preset):
        return preset
    require(preset in PRESETS, "preset", preset, f"one of {', '.join(PRESETS)}")
    return PRESETS[preset]


def set_options(spec: mujoco.MjSpec, preset: Preset, finer: float = 1.0) -> None:
    """Set the cone and impratio, `finer` times the preset's, and the time step unless the user has chosen one.

    Raises InvalidValueError for a time step at which the preset isn't stable, and if the spec overrides contacts.
    """
    option, plain = spec.option, mujoco.MjSpec().option
    _require_own_contacts(option)
    if option.timestep == plain.timestep and not spec.authored.option & _TIMESTEP:
        option.timestep = preset.timestep
    require_stable(option.timestep, preset)
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = max(option.impratio, finer * preset.impratio)
    if option.solver == mujoco.mjtSolver.mjSOL_PGS:  # doesn't converge at such an impratio
        option.solver = plain.solver


def require_stable(timestep: float, preset: Preset) -> None:
    """Raise InvalidValueError for a time step [s] at which the preset isn't stable."""
    allowed = f"at most {preset.timestep:g} s, for contacts of this preset to be stable"
    require(0 < timestep <= preset.timestep, "timestep", timestep, allowed)


def require_options(option: Any, preset: Preset) -> None:
    """Raise InvalidValueError for options of a model (or a spec) with which contacts don't follow the recipe.

    `attach` keeps those of the spec that the robot is attached to.
    """
    elliptic = option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    require(elliptic, "cone", "pyramidal", "elliptic, as connect sets it")
    require(
        option.impratio >= preset.impratio,
        "impratio",
        option.impratio,
        f"at least {preset.impratio:g}, as connect sets it",
    )
    _require_own_contacts(option)


def _require_own_contacts(option: Any) -> None:
    override = option.enableflags & mujoco.mjtEnableBit.mjENBL_OVERRIDE
    require(not override, "flag override", "enable", "disable: the contacts of tracks have parameters of their own")


def soft_contacts(model: mujoco.MjModel) -> dict[str, float]:
    """Impedances of contact pairs and geoms below the engine's least, by "pair NAME" or "geom NAME".

    The engine raises them, so that these contacts have other rates than their model asks for.
    """
    pairs = {f"pair {_pair_name(model, k)}": impedance for k, impedance in enumerate(_impedances(model.pair_solimp))}
    collide = (model.geom_contype | model.geom_conaffinity) > 0
    geoms = {
        f"geom {_geom_name(model, k)}": impedance
        for k, impedance in enumerate(_impedances(model.geom_solimp))
        if collide[k]
    }
    return {name: impedance for name, impedance in (pairs | geoms).items() if impedance < mujoco.mjMINIMP}


def require_impedances(model: mujoco.MjModel, geoms: NDArray[np.int_]) -> None:
    """Raise InvalidValueError for contact pairs of these geoms whose impedance is below the engine's least."""
    low = _impedances(model.pair_solimp) < mujoco.mjMINIMP
    for k in np.flatnonzero(low & (np.isin(model.pair_geom1, geoms) | np.isin(model.pair_geom2, geoms))).tolist():
        allowed = f"at least {mujoco.mjMINIMP:g}, the least that the engine knows: use fewer contact points"
        require(False, f"solimp of pair {_pair_name(model, k)}", model.pair_solimp[k, :2].min(), allowed)


def _impedances(solimp: NDArray[np.float64]) -> NDArray[np.float64]:
    """Least impedance (K,) of contacts with parameters (K, 5), at any depth."""
    return np.asarray(solimp[:, :2].min(axis=1))


def _pair_name(model: mujoco.MjModel, pair: int) -> str:
    first, second = (_geom_name(model, int(ids[pair])) for ids in (model.pair_geom1, model.pair_geom2))
    return model.pair(pair).name or f"{first}/{second}"


def _geom_name(model: mujoco.MjModel, geom: int) -> str:
    """Name of a geom, or its number and body."""
    return model.geom(geom).name or f"{geom} of body {model.body(model.geom_bodyid[geom]).name}"
