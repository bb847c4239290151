"""Ruts in soft soil under a fleet's wheels: how deep its wheels roll, and what their ruts resist.

The engine's pads under a wheel are springs with the stiffness K together. Below them is a rigid
wheel in rigid-plastic soil, which bears the load N(d) of equation (7) in
`trackslip.skid_theory.soil` if its lowest point is at the depth d. In every servo period, the
engine's wheel is at the depth z, and the wheel sinks in until both bear the same,

    K (z - d) = N(d)                                                                             (1)

where the integral in N is a sum over points along the arc, from the entry to the axle. The soil
ahead of the arc has depths s on lines along the wheel. Where less than d solves (1), the wheel
climbs out of its rut, but at most along its arc: by x_e / R per travel. At rest, it stays where it
is. All pads of a wheel begin to touch at the depth d, to which its lowest point presses the cells
under it.

The soil ahead is that of cells to which the wheel moves, and its depths s are means over about the
last cell of travel. A wheel that turns back thus rolls in its own
rut, and a rear wheel in that of the front wheel.

The resistance (8) acts on the axles, because the pressure on a rigid wheel is normal to its rim. It
grows over the first 2 mm of travel.

The pads of a wheel share its load and its friction evenly, on a patch of a fixed length L, whereas
the strength of the soil under the arc grows from the entry to the axle. So each pad stands for an
equal part of this strength. Soil has passed a part of the patch when it reaches a pad, the distance
d, but passes the arc's distance x' on the way to the pad's part of the strength: with the shear
modulus K d / x', it is sheared as under the arc.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from sim.ground.ruts import AHEAD, GROWTH, LEAST_LINES, MOST_FRICTION, Ruts, Soils
from trackslip.errors import require
from trackslip.kinematics import Array
from trackslip.skid_theory import Soil, Wheels, roll

# rounds of Newton's method for (1): to a thousandth up to a wheel's share of the weight, to two
# thousandths up to three times as much (test_wheel_ruts)
_ROUNDS: Final = 3
_POINTS: Final = 8  # points along an arc, of a Gauss-Legendre rule
_SHORTEST: Final = 1e-4  # smallest distance x' [m]
_TINY: Final = 1e-30
_Ints = NDArray[np.int_]


class WheelRuts(Ruts):
    """Ruts of N robots on T wheels each, the left ones first, from rear to front on each side."""

    STATE: ClassVar[tuple[str, ...]] = (*Ruts.STATE, "wheel_depth", "_ahead")

    def __init__(
        self,
        place: Array,
        length: float,
        width: float,
        size: int,
        period: float,
        radius: float,
        axles: Sequence[float],
        wheel_radius: float,
    ) -> None:
        """Start without ruts, on firm ground.

        Args:
            place: as for `Ruts`; each wheel has as many pads.
            length: length L of a wheel's patch [m].
            width: width of a wheel [m].
            size, period, radius: as for `Ruts`.
            axles: positions of the axles, from rear to front [m].
            wheel_radius: radius of the wheels [m].
        """
        super().__init__(place, length, width, size, period, radius)
        self.lever = wheel_radius
        self._wheel_radius = wheel_radius
        self._axles = len(axles)
        self._axle = np.tile(axles, 2)  # (T,) [m]
        self._lateral = self._side.repeat(self._axles)  # (T,) [m]
        self._line_y = np.add.outer(self._lateral, self._lines)  # (T, L) [m]
        self._pads_of_wheel = self._pads // len(self._axle)
        # shares of the strength at the end of each pad's part, and distances d, from the axle on
        self._part_end = (np.arange(self._pads_of_wheel) + 1) / self._pads_of_wheel
        self._passed = length * (1 - self._part_end + 0.5 / self._pads_of_wheel)
        nodes, weights = np.polynomial.legendre.leggauss(_POINTS)
        self._node = (nodes + 1) / 2  # distances from the axle, over x_e [-]
        self._weight = weights / 2
        self._ahead = np.zeros((size, *self._line_y.shape))  # depths s of soil ahead [m]
        self.wheel_depth = np.zeros((size, len(self._axle)))
        """Depths (N, T) of the lowest points of the wheels [m]."""

    @property
    def by_robot(self) -> tuple[Array, ...]:
        """Views of the arrays that a period changes, see `Ruts`."""
        return *super().by_robot, self._ahead, self.wheel_depth

    def _line_count(self) -> int:
        """Number of lines along a wheel, whose lowest point alone presses cells."""
        return LEAST_LINES

    def sinkage(self, soil: Soil, pressure: float) -> float:
        """Sinkage of a robot at rest under a pressure on its patches [Pa], in m."""
        load = pressure * self._width * self._length
        sinkage = _sinkage(soil, self._wheel_radius, self._width, load)
        allowed = "firm enough for these wheels, which sink in up to their axles"
        is_firm = sinkage < self._wheel_radius
        require(is_firm, "ground.soil", soil.source or "this soil", allowed)
        return sinkage

    def forget(self, rows: _Ints, position: Array) -> None:
        """Begin without ruts around the robots `rows` (R,), see `Ruts`."""
        super().forget(rows, position)
        self._ahead[rows] = 0.0
        self.wheel_depth[rows] = 0.0

    def press(self, rows: _Ints, pose: Array) -> Array:
        """Press the soil under the robots `rows` (R,), see `Ruts`; returns depths (R, T) of the
        wheels [m].
        """
        x = np.broadcast_to(self._axle[:, None], self._line_y.shape)
        cells = self._cells(rows, pose, x[None], self._line_y[None])
        return self._roll(rows, pose, cells, np.zeros((len(rows), 2)))

    def advance(
        self, rows: _Ints, before: Array, after: Array, pose: Array, belt: Array
    ) -> Array | None:
        """Update ruts and resistances after a period, see `Ruts`; no part of a patch is in the
        air.
        """
        self._follow(rows, after[:2].T)

        motion, aside, turn = self._motion(before, after)
        self._slide(rows, motion, belt * self._period)
        by_wheel = motion.repeat(self._axles, axis=1)  # (R, T) [m]
        sideways = aside + turn * self._axle

        # the cells under the wheels, those on the way to there, so that fast wheels leave no gaps,
        # and those ahead in the direction of motion
        reach = AHEAD * self._cell
        distance = np.abs(by_wheel)
        front = np.where(self._travel[rows] >= 0, reach, -reach).repeat(self._axles, axis=1)
        drift = np.clip(sideways / np.maximum(distance, _TINY), -1.0, 1.0) * reach
        x = np.empty((len(rows), 3, *self._line_y.shape))
        y = np.empty_like(x)
        x[:, 0] = self._axle[:, None]
        y[:, 0] = self._line_y
        x[:, 1] = (self._axle - by_wheel / 2)[..., None]
        y[:, 1] = self._line_y - sideways[..., None] / 2
        x[:, 2] = (self._axle + front)[..., None]
        y[:, 2] = self._line_y + drift[..., None]
        cells = self._cells(rows, pose, x, y)
        below = cells[:, :2].swapaxes(1, 2).reshape(len(rows), len(self._axle), -1)  # (R, T, 2 L)

        # the soil ahead
        found = self._depth[cells[:, 2]].astype(float)
        share = -np.expm1(-distance / self._cell)
        known = self._ahead[rows]
        self._ahead[rows] = known + share[..., None] * (found - known)

        depth = self._roll(rows, pose, below, np.abs(motion))

        # the resistance
        soil = self._of(rows)
        power = self._exponents(rows, soil)[:, :, None] + 1  # (R, T, 1)
        pressed = depth[..., None] ** power - self._ahead[rows] ** power
        work = np.maximum(pressed, 0.0).mean(axis=-1) / power[..., 0]
        of_wheels = work.reshape(len(rows), 2, self._axles).sum(axis=-1)
        scale = self._width * soil.modulus
        self.resistance[rows] = -scale * of_wheels * (self._travel[rows] / GROWTH)
        return None

    def _roll(self, rows: _Ints, pose: Array, below: _Ints, travel: Array) -> Array:
        """Sink in and climb by (1), over travels (R, 2) of both sides [m]; press the cells `below`
        (R, T, K) the wheels, find where contacts begin and their friction and shear, and return the
        depths (R, T) of the wheels.
        """
        soil = self._of(rows)
        exponent = self._exponents(rows, soil)
        reached = self._wheel_depths(pose)  # z (R, T) [m]
        ahead = self._ahead[rows]
        stiffness = (self._width * self._length / self._give[rows])[:, None]  # K (R, 1) [N/m]

        # the depth at which springs and soil bear the same
        lowest = ahead.min(axis=-1)
        wanted = self._settled(reached, ahead, lowest, soil, exponent, stiffness)
        known = self.wheel_depth[rows]
        slope = self._chord(known - lowest) / self._wheel_radius
        climbed = known - slope * travel.repeat(self._axles, axis=1)
        depth = np.maximum(wanted, climbed)
        self.wheel_depth[rows] = depth
        self._deepen(below, depth[..., None])
        self.deepest[rows] = depth.reshape(len(rows), 2, -1).max(axis=-1)

        # all pads of a wheel begin to touch at its depth
        at_pads = self._depths(pose)[:, : self._pads]
        yielded = (reached - depth).repeat(self._pads_of_wheel, axis=1)
        margin = at_pads - yielded
        floor = margin.mean(axis=1)
        self.margin[rows] = margin
        self.floor[rows] = floor
        self.compression[rows] = np.maximum(yielded, 0.0)
        self.height[rows] = -pose[:, 2:3] - (at_pads + floor[:, None]) / 2

        load = stiffness * np.maximum(reached - depth, 0.0)
        self._grip(rows, depth, load, soil, exponent)
        return depth

    def _grip(self, rows: _Ints, depth: Array, load: Array, soil: Soils, exponent: Array) -> None:
        """Find friction and shear moduli at the pads of wheels that bear loads (R, T) at depths (R,
        T) [N, m].
        """
        # the strength of the soil under the arc
        chord, pressure = self._arc(depth, self._ahead[rows], exponent)
        frictional = soil.friction * load
        cohesive = soil.cohesion * self._width * chord.mean(axis=-1)
        along = frictional + cohesive
        across = along + self._bulldozing(depth, soil)
        friction = np.stack([along, across], axis=-1) / np.maximum(load, _TINY)[..., None]
        friction = np.minimum(friction, MOST_FRICTION)
        self.surface[rows, :, :2] = friction.repeat(self._pads_of_wheel, axis=1)

        # its shares at the points of the arc, and their distances behind the entry, (R, T, q)
        borne = chord[..., None] * pressure
        by_point = borne.sum(axis=2)
        total = np.maximum(by_point.sum(axis=-1, keepdims=True), _TINY)
        strength = frictional[..., None] * by_point / total + cohesive[..., None] * self._weight
        share = strength / np.maximum(along, _TINY)[..., None]
        mean_chord = (chord[..., None] * borne).sum(axis=2) / np.maximum(by_point, _TINY)
        behind = mean_chord * (1 - self._node)

        # the mean distances x' of equal parts of it, one for each pad
        end = np.cumsum(share, axis=-1)[..., None, :]
        begin = end - share[..., None, :]
        part_end = self._part_end[:, None]
        part_begin = part_end - 1 / self._pads_of_wheel
        common = np.minimum(end, part_end) - np.maximum(begin, part_begin)  # (R, T, p, q)
        of_part = np.maximum(common, 0.0) * self._pads_of_wheel
        distance = np.einsum("rtpq,rtq->rtp", of_part, behind)

        modulus = soil.shear[..., None] * self._passed / np.maximum(distance, _SHORTEST)
        rolls_back = (self._travel[rows] < 0).repeat(self._axles, axis=1)
        modulus = np.where(rolls_back[..., None], modulus[..., ::-1], modulus)
        self.surface[rows, :, 2] = modulus.reshape(len(rows), -1)

    def _settled(
        self,
        reached: Array,
        ahead: Array,
        lowest: Array,
        soil: Soils,
        exponent: Array,
        stiffness: Array,
    ) -> Array:
        """Depths (R, T) that solve (1) for wheels of the engine at the depths `reached` (R, T) [m].

        With d = s + u^2, the difference of both loads is convex in u, as the arc is as long as u.
        Newton's method then converges from above. It begins at the smaller of the limits at which
        either the springs or the soil yields alone, where the soil has the pressure of the rut
        ahead, or is fresh.
        """
        room = np.maximum(reached - lowest, 0.0)
        bound = stiffness * np.maximum(reached, 0.0) / (self._width * soil.modulus)
        root = np.sqrt(2 * self._wheel_radius)
        in_rut = bound / np.maximum(root * lowest**exponent, _TINY)
        fresh = (bound / root * (exponent + 1)) ** (1 / (2 * exponent + 1))
        highest = np.sqrt(room)
        u = np.minimum(highest, np.minimum(in_rut, fresh))
        per_line = self._cell * soil.modulus
        for _ in range(_ROUNDS):
            depth = lowest + u * u
            chord, pressure = self._arc(depth, ahead, exponent)
            load = per_line * (chord[..., None] * pressure).sum(axis=(2, 3))
            # the arc becomes longer, and its points deeper
            longer = load / np.maximum(u, _TINY)
            deeper = 2 * u * exponent * load / np.maximum(depth, _TINY)
            growth = longer + deeper + 2 * u * stiffness
            excess = load - stiffness * (reached - depth)
            step = excess / np.maximum(growth, _TINY)
            u = np.minimum(np.maximum(u - step, 0.0), highest)
        return lowest + u * u

    def _arc(self, depth: Array, ahead: Array, exponent: Array) -> tuple[Array, Array]:
        """Half chords x_e (R, T, L) [m] of wheels at depths (R, T) in ruts of depths `ahead` (R, T,
        L) [m], and pressures over the soil's modulus times weights (R, T, L, q) at points from the
        axle to the entry [m^m].
        """
        chord = self._chord(depth[..., None] - ahead)
        x = chord[..., None] * self._node
        z = (depth - self._wheel_radius)[..., None, None] + np.sqrt(self._wheel_radius**2 - x * x)
        return chord, self._weight * np.maximum(z, 0.0) ** exponent[..., None, None]

    def _bulldozing(self, depth: Array, soil: Soils) -> Array:
        """Lateral forces (R, T) on the part of a wheel below the ground, by (4) [N].

        Over a parabola of the depth d and the half chord c, the integrals of its depth and the
        square of it are 4/3 d c and 16/15 d^2 c.
        """
        chord = self._chord(depth)
        by_square = soil.by_square * depth * (16 / 15)
        by_depth = soil.by_depth * (4 / 3)
        return chord * depth * (by_square + by_depth)

    def _chord(self, height: Array) -> Array:
        """Half chords of segments of these heights of a wheel, up to its axle [m]."""
        cut = np.minimum(np.maximum(height, 0.0), self._wheel_radius)
        return np.asarray(np.sqrt((2 * self._wheel_radius - cut) * cut))

    def _wheel_depths(self, pose: Array) -> Array:
        """Depths (R, T) of the lowest points of the engine's wheels [m]."""
        _, _, z, by_x, by_y, by_z, _ = pose.T[..., None]
        lifted = by_x * self._axle + by_y * self._lateral + (by_z - 1) * self._wheel_radius
        return -(z + lifted)

    def _exponents(self, rows: _Ints, soil: Soils) -> Array:
        """Exponents (R, T) of sinkage under the wheels [-]."""
        return super()._exponents(rows, soil).repeat(self._axles, axis=1)


@functools.lru_cache(maxsize=64)
def _sinkage(soil: Soil, radius: float, width: float, load: float) -> float:
    """Sinkage of a wheel that rolls in fresh soil under a load [N], in m."""
    wheels = Wheels(1.0, radius, width, 4 * load)
    return float(roll(soil, wheels, load).rut[0])
