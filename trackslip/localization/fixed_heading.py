"""The likelihood of the plate's position at given headings: at a heading, ranges depend on it almost linearly."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.beams import Beams
from trackslip.localization.climb import Evaluation, climb
from trackslip.localization.likelihood import PlateLikelihood
from trackslip.localization.starts import centre_of_side
from trackslip.localization.view import Points, View

_FIRST, _SECOND = np.array([0, 0, 0, 1, 2, 1]), np.array([0, 1, 2, 1, 2, 2])  # residual or derivative; their products


@dataclass(frozen=True)
class TurnedBeams:
    """The returns of M scans in the axes of plates with given headings."""

    beams: Beams
    heading: Array  # (M,) [rad]
    axis: Points  # (M,) direction of the long axis
    u_e: Array  # (H,) directions of the beams along and across the plates
    u_n: Array  # (H,)
    per_along: Array  # (H,) range per distance along and across the plate, 0 for beams across and along it [-]
    per_across: Array  # (H,)

    @classmethod
    def of(cls, beams: Beams, heading: Array) -> TurnedBeams:
        """In the axes of plates with `heading` (M,) [rad]."""
        axis = np.exp(1j * heading)
        cos, sin = beams.spread(np.stack([axis.real, axis.imag]))
        u_e, u_n = beams.u * cos + beams.u_turned * sin
        per_along, per_across = (np.divide(1.0, u, out=np.zeros(len(u)), where=u != 0) for u in (u_e, u_n))
        return cls(beams, heading, axis, u_e, u_n, per_along, per_across)

    def take(self, rows: np.ndarray) -> TurnedBeams:
        """Those of the scans `rows` (R,)."""
        kept = self.beams.places(rows)
        of_returns = (part[kept] for part in (self.u_e, self.u_n, self.per_along, self.per_across))
        of_scans = (part[rows] for part in (self.heading, self.axis))
        return TurnedBeams(self.beams.take(rows), *of_scans, *of_returns)


@dataclass(frozen=True)
class FixedHeading:
    """Negative log likelihood of positions along and across plates with given headings."""

    likelihood: PlateLikelihood

    def climb(self, turned: TurnedBeams, pose: Array, iterations: int) -> Evaluation:
        """The maxima near places along and across the plates, and headings (M, 3), which are kept."""
        return climb(self, turned, pose, iterations)

    def touching(self, turned: TurnedBeams, middle: Array) -> Array:
        """Places along and across plates whose near faces touch the returns around `middle` (M, 2), and headings."""
        plate, beams, pose = self.likelihood.plate, turned.beams, np.empty((len(middle), 3))
        place = (middle[:, 0] + 1j * middle[:, 1]) * turned.axis.conj()
        sides = (turned.u_e, plate.length, place.real), (turned.u_n, plate.thickness, place.imag)
        for k, (direction, size, towards) in enumerate(sides):
            coordinate = beams.range * direction
            low, high = (reduce.reduceat(coordinate, beams.first) for reduce in (np.minimum, np.maximum))
            pose[:, k] = centre_of_side(low, high, size, towards > 0)
        pose[:, 2] = turned.heading
        return pose

    def moved(self, here: Evaluation, step: Array) -> Array:
        """Places along and across the plates, and headings (M, 3), after steps (M, 3) from `here`."""
        return here.pose + step

    def evaluate(self, turned: TurnedBeams, pose: Array) -> Evaluation:
        """Cost and derivatives at places along and across the plates, and headings (M, 3), which are fixed."""
        plate, beams = self.likelihood.plate, turned.beams
        half_length, half_thickness = plate.length / 2, plate.thickness / 2
        along, across = pose[:, 0], pose[:, 1]
        distance, reach = np.hypot(along, across), math.hypot(plate.length, plate.thickness) / 2
        of_scans = np.empty((4, len(pose)))
        # of the planes of the faces towards the LRF, signed; 0 if both point away
        of_scans[0] = along - np.minimum(np.maximum(along, -half_length), half_length)
        of_scans[1] = across - np.minimum(np.maximum(across, -half_thickness), half_thickness)
        of_scans[2], of_scans[3] = distance - reach, distance + reach
        short, long, near, far = beams.spread(of_scans)
        to_short, to_long = short * turned.per_along, long * turned.per_across
        on_long = to_long > to_short
        entered = np.maximum(to_short, to_long)
        predicted = np.minimum(np.maximum(entered, near), far)
        scale = 1 / beams.noise
        residual = (predicted - beams.range) * scale
        slope = np.where(on_long, turned.per_across, turned.per_along)
        slope *= (predicted == entered) * scale
        terms = np.empty((5, len(residual)))
        weight, terms[0] = self.likelihood.loss(residual)
        weighted = weight * slope
        weighted_long = weighted * on_long
        weighted -= weighted_long  # a beam meets one face only: what is left is on the short one
        for k, one in enumerate((weighted, weighted_long)):
            np.multiply(one, residual, out=terms[1 + k])
            np.multiply(one, slope, out=terms[3 + k])
        sums = beams.sums(terms)  # (5, M)
        view = View(plate, along + 1j * across, turned.axis)
        edges = self.likelihood.edges(beams.edges, view)
        products = edges.take(_FIRST, axis=0) * edges.take(_SECOND, axis=0)
        total = products[:, 0] + products[:, 1]  # (6, M): cost, gradient, and the Hessian's elements xx, yy, xy
        total[0] /= 2
        total[:5] += sums
        all_terms = np.zeros((10, len(pose)))
        all_terms[:3], all_terms[4:6], all_terms[9] = total[:3], total[3:5], total[5]
        all_terms[6] = 1.0
        return Evaluation(pose, all_terms.T, turned.axis)
