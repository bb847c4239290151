"""Tracks and wheels on soft soil, straight ahead: sinkage, thrust, resistance, and the drawbar pull
over slip.

**Sinkage.** A plate of width b under the pressure p sinks by z in soil with the moduli k_c and
k_phi (Bekker, Introduction to Terrain-Vehicle Systems, 1969):

    p = (k_c / b + k_phi) z^m,    m = n + n_1 |i|                                                (1)

The exponent n grows with the slip i, because a track that slips digs itself in: slip-sinkage, in
the form of Ding et al. (Wheel slip sinkage and its prediction model of lunar rover, J. Cent. South
Univ. Technol. 17, 2010); it is due to Reece (Principles of soil-vehicle mechanics, 1965).

**Resistance.** To press a rut of depth z into the soil takes the work per area

    w(z) = (k_c / b + k_phi) z^(m + 1) / (m + 1)                                                 (2)

so that a track of width b that leaves a rut of depth z meets the resistance b w(z) (Bekker).

**Thrust.** The shear strength of soil is c + p tan(phi) (Mohr and Coulomb). An element that has
moved by j over the ground mobilises 1 - exp(-j / K) of it (Janosi and Hanamoto 1961). Straight
ahead with the slip i, j = i x at the distance x behind the front of the contact, and the mean share
over a contact of length L is

    1 - K / (i L) (1 - exp(-i L / K))                                                            (3)

**Bulldozing.** A track that slides sideways in a rut of depth z pushes soil ahead of its edge. The
passive earth pressure of Rankine resists by the force per length of the track

    gamma z^2 K_p / 2 + 2 c z sqrt(K_p),    K_p = tan(45 deg + phi / 2)^2                        (4)

**Trim.** A pull above the ground, a slope or a centre of mass off the middle shift the centre of
pressure. A rigid track then sinks in by different depths. If its rear is deeper, z is linear over
the track, and (1) holds everywhere. If its front is deeper, the rest of the track stands on the
floor of the rut that the front leaves, which soil under less pressure doesn't deepen: the pressure
is linear, as on stiff springs. The deepest point determines the rut, and by (2) the resistance.

**Wheels.** A rigid wheel of radius R and width b whose lowest point is at the depth z_0 touches the
soil along an arc, at the depths z(x) = z_0 - R + sqrt(R^2 - x^2) for x ahead of the axle. It
presses the soil ahead of the axle and loses the soil behind it, so that it bears the load (Bekker)

    N = b int_0^x_e p(z(x)) dx                                                                   (7)

from the axle to the entry x_e, where the arc is as deep as the rut ahead: 0 in fresh soil, the
front wheel's rut for a rear wheel. To be borne by what is left, a rear wheel sinks in a little
deeper. As its pressure is normal to its rim, it meets the resistance

    b int p dz = b (w(z_0) - w(rut ahead))                                                       (8)

which acts on its axle. For x_e much smaller than R, z_0 - z = x^2 / (2 R), and in fresh soil (7)
becomes b k z_0^(m + 1/2) sqrt(pi R / 2) Gamma(m + 1) / Gamma(m + 3/2), with k of (1). Bekker
expands this to b k z_0^m sqrt(2 R z_0) (3 - m) / 3, which is exact for m = 0 and 1.

Elements of the rim are taken to be sheared like those of a track, by j = i x' at the distance x'
behind the entry. What the arc adds to this, of the order of x_e^3 / (6 R^2), is left out, and so is
the vertical part of the shear stress.

Soil is described by moduli in SI units, N/m^(n + 1) and N/m^(n + 2). Parameters of soils come from
plates of 10 cm and more, so for narrower tracks they are extrapolated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import (
    Checked,
    checked,
    require,
    require_finite,
    require_non_negative,
    require_positive,
    require_within,
)
from trackslip.kinematics import Array

MAX_EXPONENT: Final = 5.0
"""Largest exponent n, and largest growth n_1 of it [-]."""
MAX_MODULUS: Final = 1e15
"""Largest k_c and k_phi, at which any soil is rigid [N/m^(n + 1), N/m^(n + 2)]."""
MAX_COHESION: Final = 1e7
"""Largest cohesion, that of weak rock [Pa]."""
MAX_ANGLE: Final = math.radians(60.0)
"""Largest angle of internal friction [rad]."""
MAX_SHEAR: Final = 0.2
"""Largest shear modulus [m]."""
MAX_UNIT_WEIGHT: Final = 1e5
"""Largest unit weight [N/m^3]."""
SLIPS: Final = np.linspace(0.005, 1.0, 200)
"""Slips of a drawbar-slip curve (200,) [-]."""

_POINTS: Final = 100  # elements along a track
_ARC_POINTS: Final = 40  # elements along a wheel's arc
_NEWTON_ROUNDS: Final = 8  # doubles the digits in each
_ROOT_ROUNDS: Final = 60
_LEAST_SLIP: Final = 1e-9  # below which nothing is sheared [-]
_TRIALS: Final = 12  # places at which a balance is sought first
# foremost of them, ahead of the centre of mass, over the track's length
_FOREMOST: Final = 0.1
_TOLERANCE: Final = 1e-10  # of roots, relative to the interval in which they are sought [-]
_STEEPEST: Final = 1.5  # [rad]
# smallest distance of the centre of pressure from a track's end, over its length, at which the
# robot stands
_EDGE: Final = 0.01
# largest t in `_stand_on_rear`, at which a hundredth of the track bears
_MOST_LIFTED: Final = 0.99


@dataclass(frozen=True)
class Soil(Checked):
    """Soil that sinks under a load and shears under thrust; see the module's docstring."""

    k_c: float
    """Cohesive modulus of sinkage [N/m^(n + 1)]."""
    k_phi: float
    """Frictional modulus of sinkage [N/m^(n + 2)]."""
    n: float = checked(1.0, require_within, 0.0, MAX_EXPONENT)
    """Exponent of sinkage without slip [-]."""
    n1: float = checked(0.0, require_within, 0.0, MAX_EXPONENT)
    """Growth of the exponent with slip, 0 for soil without slip-sinkage [-]."""
    cohesion: float = checked(0.0, require_non_negative, MAX_COHESION, "Pa")
    """Cohesion c [Pa]."""
    friction_angle: float = checked(math.radians(30.0), require_within, 0.0, MAX_ANGLE, "rad")
    """Angle of internal friction [rad]."""
    shear: float = checked(0.02, require_within, 1e-5, MAX_SHEAR, "m")
    """Shear modulus K [m]."""
    unit_weight: float = checked(15e3, require_non_negative, MAX_UNIT_WEIGHT, "N/m^3")
    """Weight per volume, for bulldozing [N/m^3]."""
    source: str = ""
    """Where the values come from."""
    assumed: tuple[str, ...] = ()
    """Names of the values that no source states."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_non_negative("k_c", self.k_c, MAX_MODULUS)
        require_non_negative("k_phi", self.k_phi, MAX_MODULUS)
        require(self.k_c + self.k_phi > 0, "k_c, k_phi", (self.k_c, self.k_phi), "not both 0")
        names = self.__dataclass_fields__
        for name in self.assumed:
            require(name in names, "assumed", name, f"one of {', '.join(names)}")
        bears = self.cohesion > 0 or self.friction_angle > 0
        require(
            bears, "friction_angle", self.friction_angle, "more than 0 for soil without cohesion"
        )

    def modulus(self, width: float) -> float:
        """Modulus of sinkage k_c / b + k_phi under a track of this width [m], in N/m^(n + 2)."""
        require_positive("width", width)
        return self.k_c / width + self.k_phi

    def exponent(self, slip: ArrayLike = 0.0) -> Array:
        """Exponents (...) of sinkage at slips (...) [-]."""
        return self.n + self.n1 * np.minimum(np.abs(np.asarray(slip, float)), 1.0)

    def pressure(self, sinkage: ArrayLike, width: float, slip: ArrayLike = 0.0) -> Array:
        """Pressures (...) that a track of this width [m] bears at sinkages (...) [m], by (1)
        [Pa]; 0 above the ground.
        """
        depth = np.maximum(np.asarray(sinkage, float), 0.0)
        return np.where(depth > 0, self.modulus(width) * depth ** self.exponent(slip), 0.0)

    def sinkage(self, pressure: ArrayLike, width: float, slip: ArrayLike = 0.0) -> Array:
        """Sinkages (...) of a track of this width [m] under pressures (...) [Pa], the inverse of
        `pressure` [m].

        Soil with n = 0 yields at one pressure: below it, the sinkage is 0, above it infinite.
        """
        relative = np.maximum(np.asarray(pressure, float), 0.0) / self.modulus(width)
        exponent = self.exponent(slip)
        with np.errstate(divide="ignore", over="ignore"):
            root = np.where(exponent > 0, 1 / exponent, np.inf)
            return np.asarray(relative**root)

    def work(self, sinkage: ArrayLike, width: float, slip: ArrayLike = 0.0) -> Array:
        """Works per area (...) that press ruts of depths (...) [m] into the soil, by (2)
        [J/m^2].
        """
        depth = np.maximum(np.asarray(sinkage, float), 0.0)
        power = self.exponent(slip) + 1
        return np.asarray(self.modulus(width) * depth**power / power)

    def bulldozing(self, sinkage: ArrayLike) -> Array:
        """Lateral forces per length (...) on tracks at depths (...) [m], by (4) [N/m]."""
        depth = np.maximum(np.asarray(sinkage, float), 0.0)
        by_depth, by_square = self.bulldozing_terms
        return np.asarray((by_square * depth + by_depth) * depth)

    @property
    def bulldozing_terms(self) -> tuple[float, float]:
        """Lateral force per length, per depth [N/m^2] and per squared depth [N/m^3], by (4)."""
        root = math.tan(math.pi / 4 + self.friction_angle / 2)  # of K_p
        return 2 * self.cohesion * root, self.unit_weight * root**2 / 2

    def friction(self, pressure: ArrayLike, sinkage: ArrayLike, width: float) -> Array:
        """Coefficients (..., 2) of friction along and across a track of this width [m].

        These are the strength of the soil over the pressure (...) [Pa], and across the track the
        bulldozing at the sinkage (...) [m] as well: what `Contact` and the engine call friction.
        """
        pressure = np.asarray(pressure, float)
        along = math.tan(self.friction_angle) + self.cohesion / pressure
        across = along + self.bulldozing(sinkage) / (width * pressure)
        return np.stack(np.broadcast_arrays(along, across), axis=-1)

    def mobilised(self, slip: ArrayLike, length: float) -> Array:
        """Mean shares (...) of the strength under a track of this length [m] at slips (...), with
        the sign of the slip, by (3) [-].
        """
        slip = np.asarray(slip, float)
        ratio = np.abs(slip) * length / self.shear
        safe = np.where(ratio > 0, ratio, 1.0)
        share = np.where(ratio > 0, 1 + np.expm1(-safe) / safe, 0.0)
        return np.asarray(np.sign(slip) * share)


class Driving(NamedTuple):
    """How running gear drives straight ahead in M cases, each (M,)."""

    thrust: Array
    """Force of the soil's shear [N]."""
    resistance: Array
    """Force of compaction [N]."""
    rut: Array
    """Depth of the rut that is left [m]."""
    pitch: Array
    """Angle by which the robot points upwards from the ground [rad]."""


class RunningGear(Protocol):
    """What bears a robot on soil: `Tracks` or `Wheels`."""

    @property
    def length(self) -> float:
        """Length over which the centre of pressure may move [m]."""

    @property
    def weight(self) -> float:
        """Weight of the robot [N]."""

    @property
    def com_x(self) -> float:
        """Centre of mass, ahead of the middle of the gear [m]."""

    @property
    def com_height(self) -> float:
        """Centre of mass above the ground [m]."""

    @property
    def lever(self) -> float:
        """Height above the ground at which the resistance acts [m]."""

    def driving(self, soil: Soil, slip: Array, normal: float, arm: Array) -> Driving:
        """Drive at slips (M,), under a normal force [N] whose centre is an `arm` (M,) ahead of the
        middle of the gear [m].
        """


@dataclass(frozen=True)
class Tracks:
    """Two rigid tracks and the weight on them."""

    length: float
    """Length of a track's contact with level ground [m]."""
    width: float
    """Width of a track [m]."""
    weight: float
    """Weight of the robot [N]."""
    com_x: float = 0.0
    """Centre of mass, ahead of the middle of the tracks [m]."""
    com_height: float = 0.0
    """Centre of mass above the ground [m]."""
    settlement: float = 0.0
    """Elastic settlement under the mean pressure, in addition to the soil's: that of the
    simulator's contacts, or 0 [m].
    """

    def __post_init__(self) -> None:
        for name in ("length", "width", "weight"):
            require_positive(name, getattr(self, name))
        require_non_negative("settlement", self.settlement)
        require_finite("com_height", self.com_height)
        require_within("com_x", self.com_x, -self.length / 2, self.length / 2, "m")

    @property
    def area(self) -> float:
        """Area of both tracks [m^2]."""
        return 2 * self.length * self.width

    @property
    def pressure(self) -> float:
        """Mean pressure on level ground [Pa]."""
        return self.weight / self.area

    @property
    def lever(self) -> float:
        """Height above the ground at which the resistance acts [m]."""
        return 0.0

    def driving(self, soil: Soil, slip: Array, normal: float, arm: Array) -> Driving:
        """Drive at slips (M,), see `RunningGear`."""
        standing = stand(soil, self, slip, normal, arm)
        pitch = _pitch(self, standing)
        thrust = _thrust(soil, self, _over_ground(slip, pitch), standing)
        resistance = 2 * self.width * soil.work(standing.rut, self.width, slip)
        return Driving(thrust, resistance, standing.rut, pitch)


@dataclass(frozen=True)
class Wheels:
    """Four rigid wheels on two axles, and the weight on them."""

    length: float
    """Distance between the axles [m]."""
    radius: float
    """Radius of the wheels [m]."""
    width: float
    """Width of a wheel [m]."""
    weight: float
    """Weight of the robot [N]."""
    com_x: float = 0.0
    """Centre of mass, ahead of the middle between the axles [m]."""
    com_height: float = 0.0
    """Centre of mass above the ground [m]."""
    settlement: float = 0.0
    """Elastic settlement under a quarter of the weight, in addition to the soil's: that of the
    simulator's contacts, or 0 [m].
    """

    def __post_init__(self) -> None:
        for name in ("length", "radius", "width", "weight"):
            require_positive(name, getattr(self, name))
        require_non_negative("settlement", self.settlement)
        require_finite("com_height", self.com_height)
        require_within("com_x", self.com_x, -self.length / 2, self.length / 2, "m")

    @property
    def lever(self) -> float:
        """Height above the ground at which the resistance acts: that of the axles [m]."""
        return self.radius

    def bulldozing(self, soil: Soil, depth: ArrayLike) -> Array:
        """Lateral forces (...) on wheels in ruts of depths (...) [m], by (4) [N].

        The part of a wheel below the ground is taken for a parabola of the depth d over a chord of
        2 x_e, along which d and d^2 have the integrals 4/3 d x_e and 16/15 d^2 x_e.
        """
        depth = np.asarray(depth, float)
        by_depth, by_square = soil.bulldozing_terms
        per_chord = (4 / 3 * by_depth + 16 / 15 * by_square * depth) * depth
        return np.asarray(per_chord * _half_chord(self.radius, depth))

    def driving(self, soil: Soil, slip: Array, normal: float, arm: Array) -> Driving:
        """Drive at slips (M,), see `RunningGear`; the rear wheels run in the ruts of the front
        wheels.
        """
        front_load = normal * (0.5 + arm / self.length) / 2
        rear_load = normal / 2 - front_load
        front = roll(soil, self, front_load, 0.0, slip)
        rear = roll(soil, self, rear_load, front.rut, slip)
        settled = self.settlement * (rear_load - front_load) / (self.weight / 4)
        pitch = np.arctan2(rear.rut - front.rut + settled, self.length)
        over_ground = _over_ground(slip, pitch)
        thrust = 2 * (front.thrust(soil, over_ground) + rear.thrust(soil, over_ground))
        resistance = 2 * (front.resistance + rear.resistance)
        return Driving(thrust, resistance, rear.rut, pitch)


@dataclass(frozen=True)
class Rolling:
    """How wheels roll in soil in M cases, with K elements along each arc, from its entry to the
    axle.
    """

    width: float  # of a wheel [m]
    rut: Array  # (M,) depth of the lowest point, and of the rut that is left [m]
    resistance: Array  # (M,) force of compaction on a wheel [N]
    pressure: Array  # (M, K) [Pa]
    behind: Array  # (M, K) distance of an element behind the entry [m]
    entry: Array  # (M,) length of the arc along the ground [m]

    @property
    def load(self) -> Array:
        """Loads (M,) that a wheel bears, by (7) [N]."""
        return np.asarray(self.width * self.entry * self.pressure.mean(axis=1))

    def thrust(self, soil: Soil, slip: Array) -> Array:
        """Thrusts (M,) of a wheel at slips (M,) [N]."""
        sheared = np.abs(slip)[:, None] * self.behind / soil.shear
        strength = soil.cohesion + math.tan(soil.friction_angle) * self.pressure
        stress = strength * -np.expm1(-sheared)
        return np.asarray(np.sign(slip) * self.width * self.entry * stress.mean(axis=1))


def roll(
    soil: Soil, wheels: Wheels, load: ArrayLike, ahead: ArrayLike = 0.0, slip: ArrayLike = 0.0
) -> Rolling:
    """Roll one of the wheels under loads (M,) [N] through ruts of depths `ahead` (M,) [m] at slips
    (M,), by (7) and (8).

    A wheel that the soil doesn't bear sinks in up to its axle.
    """
    load, ahead, slip = np.broadcast_arrays(*(np.asarray(x, float) for x in (load, ahead, slip)))
    load, ahead, slip = (np.atleast_1d(values) for values in (load, ahead, slip))

    def spare(depth: Array) -> Array:
        """What wheels at depths (M,) bear beyond their loads (M,) [N]."""
        return _roll_at(soil, wheels, depth, ahead, slip).load - load

    depth = _root(spare, ahead, ahead + wheels.radius)
    return _roll_at(soil, wheels, depth, ahead, slip)


def _roll_at(soil: Soil, wheels: Wheels, depth: Array, ahead: Array, slip: Array) -> Rolling:
    """Roll with the lowest points at depths (M,) [m], through ruts of depths `ahead` (M,) [m]."""
    radius = wheels.radius
    width = wheels.width
    entry = _half_chord(radius, depth - ahead)
    places = (np.arange(_ARC_POINTS) + 0.5) / _ARC_POINTS
    behind = entry[:, None] * places
    x = entry[:, None] - behind
    arc = depth[:, None] - radius + np.sqrt(radius**2 - x**2)
    pressure = soil.pressure(arc, width, slip[:, None])
    resistance = width * (soil.work(depth, width, slip) - soil.work(ahead, width, slip))
    return Rolling(width, depth, resistance, pressure, behind, entry)


def _half_chord(radius: float, height: Array) -> Array:
    """Half chords (M,) of segments of these heights (M,) of a wheel, up to its axle [m]."""
    cut = np.clip(height, 0.0, radius)
    return np.asarray(np.sqrt((2 * radius - cut) * cut))


def _over_ground(slip: Array, pitch: Array) -> Array:
    """Slips (M,) at which a robot at pitches (M,) [rad] shears the ground, see `drawbar_curve`."""
    return 1 - (1 - slip) / np.cos(pitch)


@dataclass(frozen=True)
class Standing:
    """How tracks stand in soil in M cases, with K elements along each track, from rear to front."""

    rut: Array  # (M,) depth of the rut that they leave [m]
    rear: Array  # (M,) depth of the tracks' rear end, negative above the ground [m]
    front: Array  # (M,) depth of the tracks' front end [m]
    pressure: Array  # (M, K) [Pa]
    entry: Array  # (M,) front end of the contact, ahead of the middle of the track [m]


@dataclass(frozen=True)
class DrawbarCurve:
    """The pull of M states of driving straight ahead, NaN where the robot tips over."""

    slip: Array  # (M,) 1 - speed over ground / speed of the belts [-]
    pull: Array  # (M,) drawbar pull that the robot can exert, backwards on it [N]
    thrust: Array  # (M,) force of the soil's shear on tracks or wheels [N]
    resistance: Array  # (M,) force of compaction on tracks or wheels [N]
    sinkage: Array  # (M,) depth of the rut [m]
    pitch: Array  # (M,) angle by which the robot points upwards from the ground [rad]
    efficiency: Array  # (M,) tractive efficiency, power of the pull over that of the belts [-]

    @property
    def most(self) -> int:
        """Index of the largest pull: a robot that has to pull more is immobilised."""
        return int(np.nanargmax(self.pull))

    @property
    def best(self) -> int:
        """Index of the largest tractive efficiency."""
        return int(np.nanargmax(self.efficiency))


def drawbar_curve(
    soil: Soil,
    gear: RunningGear,
    slip: ArrayLike = SLIPS,
    slope: float = 0.0,
    hitch_height: float = 0.0,
) -> DrawbarCurve:
    """The drawbar pull at slips (M,) from above 0 to 1, straight up a slope [rad].

    The pull acts at a `hitch_height` above the ground [m]. The force balance along the ground is

        pull = thrust - resistance - weight sin(slope)                                           (5)

    and the pull, the slope and the pitch of the robot shift the centre of pressure to

        x_p = (com_x cos(slope + pitch) - com_height sin(slope + pitch)
               - (hitch_height pull + lever resistance) / weight) / cos(slope)                   (6)

    with the lever 0 for the resistance of tracks, and the radius for that of wheels.

    Thrust, resistance and pitch depend on x_p, for which (5) and (6) are solved. The belts of a
    pitched robot carry their elements over the ground at cos(pitch) of their speed, so that these
    are sheared as at the slip 1 - (1 - i) / cos(pitch), and their power is thrust cos(pitch). The
    tractive efficiency is the share of the belts' power that the pull has,

        pull (1 - i) / (thrust cos(pitch))

    (Wong, Theory of Ground Vehicles, 2008); on a slope, lifting of the weight counts as loss. A
    negative pull is what the robot lacks to move on its own, with the trim that it has without one.
    Raises InvalidValueError for slips that aren't in 0 < slip <= 1 and slopes that no robot climbs.
    """
    slip = np.atleast_1d(np.asarray(slip, float))
    are_slips = slip.ndim == 1 and slip.size > 0 and bool(((slip > 0) & (slip <= 1)).all())
    require(are_slips, "slip", slip.tolist(), "(M,) numbers above 0, up to 1")
    require_within("slope", slope, 0.0, _STEEPEST, "rad")
    require_non_negative("hitch_height", hitch_height)
    normal = gear.weight * math.cos(slope)
    downhill = gear.weight * math.sin(slope)
    reach = np.full_like(slip, (0.5 - _EDGE) * gear.length)

    def driving(arm: Array) -> tuple[Driving, Array]:
        """Motion and pull (M,) with the centre of pressure at arms (M,)."""
        motion = gear.driving(soil, slip, normal, arm)
        return motion, motion.thrust - motion.resistance - downhill

    def beyond(arm: Array) -> Array:
        """Distances (M,) by which arms (M,) are ahead of what (6) makes of their trim [m]."""
        motion, pull = driving(arm)
        lean = slope + motion.pitch
        com = (gear.com_x * np.cos(lean) - gear.com_height * np.sin(lean)) / math.cos(slope)
        moment = hitch_height * np.maximum(pull, 0.0) + gear.lever * motion.resistance
        return np.asarray(arm - (com - moment / normal))

    # the foremost balance is stable; behind the next one, the robot tips over backwards
    foremost = np.minimum(gear.com_x + _FOREMOST * gear.length, reach)
    low = foremost
    high = foremost
    is_ahead = beyond(foremost) > 0
    stands = is_ahead
    for share in np.linspace(0.0, 1.0, _TRIALS)[1:]:
        high = np.where(is_ahead, low, high)
        low = np.where(is_ahead, foremost - share * (foremost + reach), low)
        is_ahead = is_ahead & (beyond(low) > 0)
    stands = stands & ~is_ahead
    arm = _root(beyond, low, high)
    motion, pull = driving(arm)
    pull = np.where(stands, pull, np.nan)
    efficiency = pull * (1 - slip) / (motion.thrust * np.cos(motion.pitch))
    return DrawbarCurve(
        slip, pull, motion.thrust, motion.resistance, motion.rut, motion.pitch, efficiency
    )


def _pitch(tracks: Tracks, standing: Standing) -> Array:
    """Angles (M,) by which a robot points upwards from the ground [rad]."""
    return np.arctan2(standing.rear - standing.front, tracks.length)


def most_slope(soil: Soil, gear: RunningGear) -> float:
    """The steepest slope that the robot climbs straight ahead at some slip [rad].

    There, the largest pull of (5) is 0. Raises InvalidValueError for soil that doesn't carry the
    robot on the level.
    """

    slips = SLIPS[19::20]  # from 0.05 to 1

    def spare(slope: Array) -> Array:
        """Largest pull (1,) on a slope (1,) [N]; negative also if the robot tips over."""
        curve = drawbar_curve(soil, gear, slips, float(slope[0]))
        return np.nan_to_num(curve.pull, nan=-gear.weight).max(keepdims=True)

    level = np.zeros(1)
    allowed = "firm enough to drive on the level"
    require(spare(level)[0] > 0, "soil", soil.source or "this soil", allowed)
    return float(_root(lambda slope: -spare(slope), level, np.full(1, _STEEPEST))[0])


def slip_for(
    soil: Soil, gear: RunningGear, pull: float = 0.0, slope: float = 0.0, hitch_height: float = 0.0
) -> float:
    """The slip at which a robot straight ahead pulls a load [N] up a slope [rad]: the smallest, at
    which the motion is stable.

    Returns NaN for a robot that is immobilised, because no slip suffices.
    """
    curve = drawbar_curve(soil, gear, SLIPS, slope, hitch_height)
    enough = np.flatnonzero(curve.pull >= pull)
    if not enough.size:
        return math.nan
    first = int(enough[0])
    low = np.full(1, SLIPS[first - 1] if first else _TOLERANCE)

    def spare(slip: Array) -> Array:
        """Pull (1,) beyond the required one at a slip (1,) [N]."""
        return drawbar_curve(soil, gear, slip, slope, hitch_height).pull - pull

    return float(_root(spare, low, np.full(1, SLIPS[first]))[0])


def stand(
    soil: Soil, tracks: Tracks, slip: ArrayLike, normal: ArrayLike, arm: ArrayLike
) -> Standing:
    """Stand on soil at slips (M,), with normal forces (M,) of both tracks [N] whose centre is an
    `arm` (M,) ahead of the middle of the tracks [m].

    With the centre at the share m = 1/2 + arm / L of the length from the rear, a track whose front
    is deeper bears the linear pressure p (1 + 12 (m - 1/2) (x - 1/2)), or from m = 2/3 on a
    triangle over the foremost 3 (1 - m) of its length. A track whose rear is deeper has a ratio r
    of the depths of front and rear, below 0 if its front is in the air, at which its pressures by
    (1) have the centre m.
    """
    slip, normal, arm = np.broadcast_arrays(*(np.asarray(x, float) for x in (slip, normal, arm)))
    slip, normal, arm = (np.atleast_1d(values) for values in (slip, normal, arm))
    mean = normal / tracks.area
    centre = 0.5 + arm / tracks.length
    noses_down = centre > 0.5
    down = _stand_on_front(soil, tracks, slip, mean, np.maximum(centre, 0.5))
    up = _stand_on_rear(soil, tracks, slip, mean, np.minimum(centre, 0.5))
    fields = {}
    for name in Standing.__dataclass_fields__:
        first = getattr(down, name)
        second = getattr(up, name)
        which = noses_down[:, None] if first.ndim == 2 else noses_down
        fields[name] = np.where(which, first, second)
    return Standing(**fields)


def _places() -> Array:
    """Middles (K,) of the elements of a track of length 1, from the rear."""
    return (np.arange(_POINTS) + 0.5) / _POINTS


def _stand_on_front(
    soil: Soil, tracks: Tracks, slip: Array, mean: Array, centre: Array
) -> Standing:
    """Stand with the mean pressures (M,) [Pa] around `centre` (M,), from 1/2 on [-]."""
    x = _places()
    is_whole = centre <= 2 / 3
    bearing = np.where(is_whole, 1.0, np.maximum(3 * (1 - centre), _EDGE))  # share of the length
    steepness = np.where(is_whole, 12 * (centre - 0.5), 2 / bearing**2)
    at_front = np.where(is_whole, 1 + steepness / 2, 2 / bearing) * mean
    relative = at_front[:, None] - (mean * steepness)[:, None] * (1 - x)
    pressure = np.maximum(relative, 0.0)
    rut = soil.sinkage(at_front, tracks.width, slip)
    give = tracks.settlement / tracks.pressure  # [m/Pa]
    front = rut + give * at_front
    rear = front - give * mean * steepness
    return Standing(rut, rear, front, pressure, np.full_like(mean, tracks.length / 2))


def _stand_on_rear(soil: Soil, tracks: Tracks, slip: Array, mean: Array, centre: Array) -> Standing:
    """Stand with the mean pressures (M,) [Pa] around `centre` (M,), up to 1/2 [-]."""
    x = _places()
    give = tracks.settlement / tracks.pressure  # [m/Pa]

    def shape(ratio: Array) -> Array:
        """Depths (M, K) over that of the rear, at ratios (M,) of the depths of front and rear."""
        return np.maximum(1 - (1 - ratio)[:, None] * x, 0.0)

    def pressures(rear: Array, ratio: Array) -> Array:
        """Pressures (M, K) at depths of the rear (M,) [m]."""
        depth = rear[:, None] * shape(ratio)
        return soil.pressure(
            _soil_depth(soil, depth, tracks.width, slip, give), tracks.width, slip[:, None]
        )

    def rear_depth(ratio: Array) -> Array:
        """Depths (M,) of the rear at which the mean pressure is right [m]: for soil alone, by (1);
        in series with springs, at most as deep as both would be that bear alone.
        """
        exponent = soil.exponent(slip)
        share = (shape(ratio) ** exponent[:, None]).mean(axis=1)
        of_soil = soil.sinkage(mean / share, tracks.width, slip)
        if give == 0:
            return of_soil
        of_springs = give * mean / shape(ratio).mean(axis=1)
        most = 2 * (of_soil + of_springs)
        return _root(lambda rear: pressures(rear, ratio).mean(axis=1) - mean, of_soil, most)

    def ratio_at(t: Array) -> Array:
        """Ratios (M,), which fall from 1 to minus infinity as t (M,) grows from 0 to 1 [-]."""
        return 1 - t / (1 - t)

    def beyond(t: Array) -> Array:
        """Share (M,) of the length by which the centre of pressure is behind the right one [-]."""
        ratio = ratio_at(t)
        pressure = pressures(rear_depth(ratio), ratio)
        return np.asarray(centre - (pressure * x).sum(axis=1) / pressure.sum(axis=1))

    low = np.zeros_like(mean)
    ratio = ratio_at(_root(beyond, low, np.full_like(mean, _MOST_LIFTED)))
    rear = rear_depth(ratio)
    pressure = pressures(rear, ratio)
    rut = _soil_depth(soil, rear[:, None], tracks.width, slip, give)[:, 0]
    bearing = 1 / np.maximum(1 - ratio, 1.0)  # share of the length
    entry = tracks.length * (bearing - 0.5)
    return Standing(rut, rear, rear * ratio, pressure, entry)


def _soil_depth(soil: Soil, depth: Array, width: float, slip: Array, give: float) -> Array:
    """Depths (M, K) of the soil's surface under belts at depths (M, K), in series with springs that
    `give` [m/Pa].

    The depth T solves T + give k T^m = z. With u = log T, the logarithm of the left side has a
    slope between 1 and m everywhere, so that Newton's method converges from the smaller of both
    limits.
    """
    if give == 0:
        return depth
    exponent = np.broadcast_to(soil.exponent(slip)[:, None], depth.shape)
    safe = np.maximum(depth, 1e-300)
    of_spring = give * soil.modulus(width)
    u = np.minimum(np.log(safe), np.log(safe / of_spring) / exponent)
    for _ in range(_NEWTON_ROUNDS):
        soft = np.exp(u)
        firm = of_spring * np.exp(exponent * u)
        total = soft + firm
        slope = (soft + exponent * firm) / total
        u = u - np.log(total / safe) / slope
    return np.where(depth > 0, np.exp(u), 0.0)


def _thrust(soil: Soil, tracks: Tracks, slip: Array, standing: Standing) -> Array:
    """Thrusts (M,) of both tracks at slips (M,) [N]: the sum over elements of their strength and of
    (3) between their ends.
    """
    cell = tracks.length / _POINTS
    rear_ends = tracks.length * (_places() - 0.5) - cell / 2
    behind = standing.entry[:, None] - rear_ends  # distance of an element's rear from the entry
    inside = np.clip(behind, 0.0, cell)  # length of an element within the contact

    # the distance within which an element is sheared by K
    reach = soil.shear / np.maximum(np.abs(slip), _LEAST_SLIP)[:, None]

    # by (3), the integral of the share over the first x of the contact is x times its mean
    def integral(distance: Array) -> Array:
        distance = np.maximum(distance, 0.0)
        shares = 1 - np.exp(-distance / reach)
        return distance - reach * shares

    sheared = integral(behind) - integral(behind - inside)
    touches = np.where(standing.pressure > 0, soil.cohesion, 0.0)
    # the pressure of an element that is partly in the air is the mean over its whole length
    of_cohesion = touches * sheared
    share = sheared / np.where(inside > 0, inside, 1.0)
    of_friction = math.tan(soil.friction_angle) * standing.pressure * cell * share
    strength = (of_cohesion + of_friction).sum(axis=1)
    return np.asarray(np.sign(slip) * 2 * tracks.width * strength)


def _root(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Roots (M,) of M increasing functions between `low` and `high` (M,), or the end that is
    closer to zero if there is none.

    The method is regula falsi with the weights of the Illinois algorithm (Dowell and Jarratt 1971):
    the value at an end that stays is halved, so that both ends approach the root.
    """
    first = low
    last = high
    span = high - low
    at_low = function(low)
    at_high = function(high)
    beyond_low = at_low >= 0
    beyond_high = at_high <= 0
    side = np.zeros_like(low)
    root = low
    for _ in range(_ROOT_ROUNDS):
        weight = at_high - at_low
        share = np.where(weight > 0, -at_low / np.where(weight > 0, weight, 1.0), 0.5)
        new = low + np.clip(share, 0.0, 1.0) * (high - low)
        is_settled = np.abs(new - root) <= _TOLERANCE * span
        root = new
        if is_settled.all():
            break
        value = function(root)
        is_low = value < 0
        at_high = np.where(is_low, np.where(side < 0, at_high / 2, at_high), value)
        at_low = np.where(is_low, value, np.where(side > 0, at_low / 2, at_low))
        low = np.where(is_low, root, low)
        high = np.where(is_low, high, root)
        side = np.where(is_low, -1.0, 1.0)
    return np.where(beyond_low, first, np.where(beyond_high, last, root))
