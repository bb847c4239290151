"""A reference's twist integrated to its poses."""

import numpy as np

from trackslip.kinematics import Array
from trackslip.trajectory.path import ProfiledReference
from trackslip.trajectory.segmented import SegmentedReference

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


def times(reference: ProfiledReference | SegmentedReference, others: int = 2000) -> Array:
    """The knots of a reference and others between them (T,), from 0 to its duration."""
    return np.union1d(reference.knots, np.linspace(0, reference.duration, others))


def integral_miss(reference: ProfiledReference | SegmentedReference) -> float:
    """Largest error of any pose against the integral of the twist [m]; headings count as far as 1 /
    curvature.
    """
    time = times(reference)
    half = np.diff(time)[:, None] / 2
    nodes = time[:-1, None] + half * (1 + _NODES)  # (T - 1, 6)
    v, w = np.moveaxis(reference.twist(nodes), -1, 0)
    phi = reference.pose(nodes)[..., 2]
    rate = np.stack([v * np.cos(phi), v * np.sin(phi), w], axis=-1)
    steps = half * np.einsum("tnc,n->tc", rate, _WEIGHTS)
    moved = np.cumsum(steps, axis=0)

    pose = reference.pose(time)
    error = np.abs(pose[1:] - pose[0] - moved)
    ahead = v > 0
    curvature = np.abs(w[ahead] / v[ahead])  # [1/m]
    tightest = max(1.0, float(curvature.max(initial=0.0)))
    return float((error / [1.0, 1.0, tightest]).max())
