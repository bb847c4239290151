"""Likelihood of the known rectangle, given the ranges of a scan, and its maximisation for many scans at once.

A beam with direction u meets a face whose plane is m.p = h at range h / (m.u). At most two faces point towards the LRF,
one long and one short; together they form a wedge, which a beam meets where it enters the second of the two
half-planes. The likelihood has two parts:

- the range of every return, with the scanner's noise, under a Huber loss;
- the two edges of the silhouette: the outermost corners of the plate are uniformly distributed between the last beam
  that missed it and the first that hit it, so the middle of that gap measures the bearing of the corner with variance
  step^2 / 12. Without the edges, a plate seen broadside could slide freely along itself. An edge of the field of view
  or of the scanner's reach is not an edge of the plate and measures nothing. If beams inside the cluster are missing
  at a rate p, beams beyond its last return may be missing too: p / (1 - p) of them, with variance p / (1 - p)^2. An
  edge made by an object in front of the plate is not the plate's either: the corner may be anywhere behind the object,
  and only a pose whose corner sticks out beyond it, or does not reach the last return, adds to the cost.

Thus a beam that passes through the supposed plate adds to the cost by way of the edges, and a return where the pose
leaves nothing to hit costs as much as if it had been measured at the near or far end of the plate.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.beams import Edges, PlateBeams
from trackslip.localization.gauss_newton import Evaluation, newton
from trackslip.localization.scan import Plate
from trackslip.localization.view import View

_TINY = 1e-300  # keeps a beam that is parallel to a face, and a step without promise, from dividing by zero
_DAMPING = 1e-3  # at first
_FEW = 32  # rows: to leave some out takes longer than to evaluate them once more
_CONVERGED = 1e-2  # a climb ends with a step that promises less; what is left promises about the square of that
_SHORTEST, _LONGEST = 0.1, 0.5  # part of a refused step that is tried next
# an edge's residual or derivative whose products are what it adds to the cost, the gradient, and the Hessian's elements
_FIRST, _SECOND = np.array([0, 0, 0, 0, 1, 2, 3, 2, 1, 1]), np.array([0, 1, 2, 3, 1, 2, 3, 3, 3, 2])


@dataclass(frozen=True)
class PlateLikelihood:
    """Negative log likelihood of poses, with its derivatives and minima."""

    plate: Plate
    huber: float
    """Residual above which the loss of a range is linear [standard deviations]."""

    def evaluate(self, beams: PlateBeams, pose: Array) -> Evaluation:
        """Cost, gradient and Gauss-Newton Hessian at poses (M, 3)."""
        view = View.of(self.plate, pose)
        residual, on_long, slope, lever = self._ranges(beams, view)
        terms, slopes = np.empty((9, len(residual))), np.empty((3, len(residual)))
        weight, terms[0] = self.loss(residual)
        turning = lever * slope
        weighted = weight * slope
        np.multiply(weighted, on_long, out=slopes[1])
        np.subtract(weighted, slopes[1], out=slopes[0])  # a beam meets one face only: what is left is on the short one
        np.multiply(weight, turning, out=slopes[2])
        np.multiply(slopes, residual, out=terms[1:4])
        np.multiply(slopes[:2], slope, out=terms[4:6])
        np.multiply(slopes[::-1], turning, out=terms[6:])
        sums = beams.sums(terms)  # (9, M): cost, gradient, and the Hessian's elements but the last

        edges = self.edges(beams.edges, view)
        products = edges.take(_FIRST, axis=0) * edges.take(_SECOND, axis=0)
        total = products[:, 0] + products[:, 1]  # (10, M): the same, and the last element
        total[0] /= 2
        total[:9] += sums
        return Evaluation(pose, total.T, view.axis)

    def misfit(self, beams: PlateBeams, pose: Array) -> Array:
        """Root mean square residuals (M,) of the ranges at poses (M, 3) [standard deviations]."""
        residual = self._ranges(beams, View.of(self.plate, pose))[0]
        return np.sqrt(beams.sums(residual * residual) / beams.count)

    def _moved(self, here: Evaluation, step: Array) -> Array:
        """Poses (M, 3) after steps (M, 3) from `here` along and across the plates."""
        moved, shift = here.pose.copy(), np.empty(len(step), complex)
        shift.real, shift.imag = step[:, 0], step[:, 1]
        shift = shift * here.axis  # in place, NumPy rounds one product otherwise than several
        moved[:, 0] += shift.real
        moved[:, 1] += shift.imag
        moved[:, 2] += step[:, 2]
        return moved

    def climb(self, beams: PlateBeams, pose: Array, iterations: int) -> Evaluation:
        """The minima of the cost near poses (M, 3) in the LRF's frame, by damped Gauss-Newton steps.

        A step that leads upwards crosses a kink of the cost, where beams leave a face of the plate; a part of it is
        tried next, up to the minimum of the parabola through what is known, unless that promises next to nothing. A row
        whose next step promises next to nothing takes that step. It no longer changes then, so that rows are bitwise
        independent.
        """
        fit = here = self.evaluate(beams, pose.copy())
        rows = np.arange(len(pose))  # those of `here`
        climbing = np.ones(len(pose), bool)
        part = np.ones(len(pose))  # of the step that is tried
        for k in range(iterations):
            step, fall = newton(here, _DAMPING / 10**k)
            there = (fall < _CONVERGED) & climbing
            target = self._moved(here, part[:, None] * step)
            if there.any():
                np.copyto(here.pose, target, where=there[:, None])
                np.subtract(here.cost, fall, out=here.cost, where=there)
                climbing &= ~there
            left = np.count_nonzero(climbing)
            if not left:
                break
            if len(rows) > _FEW and left < len(rows):
                if fit is not here:
                    fit.put(rows[~climbing], here.take(~climbing))
                (on,) = climbing.nonzero()
                rows, beams, here, climbing = rows[on], beams.take(on), here.take(on), climbing[on]
                part, target, fall = part[on], target[on], fall[on]
            trial = self.evaluate(beams, target)
            rise = trial.cost - here.cost
            better = (rise < 0) & climbing
            if better.all():
                here = trial
            else:
                np.copyto(here.pose, trial.pose, where=better[:, None])
                np.copyto(here.terms, trial.terms, where=better[:, None])
                np.copyto(here.axis, trial.axis, where=better)
            np.copyto(part, 1.0, where=better)
            refused = climbing & ~better
            if refused.any():
                promised = 2 * part * fall
                shorter = promised / (2 * (rise + promised) + _TINY)
                climbing &= better | (shorter * promised / 2 >= _CONVERGED)  # what the minimum of the parabola promises
                part = np.where(refused, part * np.minimum(np.maximum(shorter, _SHORTEST), _LONGEST), part)
        if here is fit or len(rows) == len(pose):
            return here
        fit.put(rows, here)
        return fit

    def loss(self, residual: Array) -> tuple[Array, Array]:
        """Weights (...) of ranges with residuals (...) [standard deviations] under the Huber loss, and their costs."""
        size = np.abs(residual)
        weight = self.huber / np.maximum(size, self.huber)
        weighted = weight * size
        return weight, weighted * (size - weighted / 2)

    def _ranges(self, beams: PlateBeams, view: View) -> tuple[Array, Array, Array, Array]:
        """Residuals (H,) of the ranges [standard deviations], and what their derivatives are made of.

        That is whether they are on the long face (H,), their derivatives (H,) with respect to the place of the face
        [standard deviations per m], and how far along it they are (H,) [m].
        """
        half = _half_sides(self.plate)
        of_scans = np.empty((10, len(view.place)))
        of_scans[0], of_scans[1] = view.axis.real, view.axis.imag
        place = of_scans[2:4]  # along and across, as all pairs that follow
        place[0], place[1] = view.place.real, view.place.imag
        # signed distances of the planes of the short and the long face towards the LRF; 0 if both point away
        np.subtract(place, np.minimum(np.maximum(place, -half), half), out=of_scans[4:6])
        np.copysign(_TINY, place, out=of_scans[6:8])
        distance, reach = np.abs(view.place), math.hypot(self.plate.length, self.plate.thickness) / 2
        np.maximum(distance - reach, _TINY, out=of_scans[8])
        np.add(distance, reach, out=of_scans[9])
        spread = beams.spread(of_scans)
        cos, sin, near, far = spread[0], spread[1], spread[8], spread[9]
        u = beams.u * cos + beams.u_turned * sin
        # the range of a face is negative where the beam does not enter the half-plane behind it
        per_distance: Array = 1 / (u - spread[6:8])
        to_short, to_long = spread[4:6] * per_distance
        on_long = to_long > to_short
        entered = np.maximum(to_short, to_long)
        predicted = np.minimum(np.maximum(entered, near), far)
        scale = 1 / beams.noise
        residual = (predicted - beams.range) * scale
        slope = np.where(on_long, per_distance[1], per_distance[0])
        slope *= (predicted == entered) * scale
        along, across = predicted * u - spread[2:4]
        return residual, on_long, slope, np.where(on_long, along, -across)

    def edges(self, edges: Edges, view: View) -> Array:
        """Residuals of the two edges of the silhouette, and their three derivatives, (4, 2, M)."""
        result = view.silhouette(edges.ahead)
        result[0], weight = _missed(edges, result[0])
        result *= weight
        return result


@functools.lru_cache(maxsize=64)
def _half_sides(plate: Plate) -> Array:
    """Half the length and half the thickness (2, 1) [m]."""
    return np.array([[plate.length / 2], [plate.thickness / 2]])


def _missed(edges: Edges, bearing: Array) -> tuple[Array, Array]:
    """By how much corners at bearings (2, M) miss the edges [rad], and the weights of that [1/rad]."""
    residual, weight, slack = bearing - edges.bearing.T, edges.weight.T, edges.slack.T
    if slack.any():
        residual -= np.minimum(np.maximum(residual, -slack), slack)
        weight = np.where((slack == 0) | (residual != 0), weight, 0.0)
    return residual, weight
