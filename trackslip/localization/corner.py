"""Plates seen from the side, with one or two beams on the short face: the posterior along the plate is not normal.

A beam that hits the short face determines the position along the plate precisely; if the plate slides until the beam
hits the long face instead, the beam says nothing about it. The posterior along the plate is thus a narrow peak, or half
of one, on the wide plateau that the silhouette's edges allow, and the curvature at the maximum describes neither. Where
the curvature claims more accuracy than the edges allow, the posterior along the plate is summed over a grid instead.
"""

from __future__ import annotations

import numpy as np

from trackslip.kinematics import Array
from trackslip.localization.likelihood import Beams, PlateLikelihood
from trackslip.localization.quadrature import spans, weights

FROM_SIDE = np.radians(45.0)
"""At larger angles from the line of sight, few beams hit the short face [rad]."""
_CLAIMED = 0.9  # a fit is doubted below this fraction of the standard deviation that the edges allow
_PLATEAU = np.linspace(-3.0, 3.0, 21)  # along the plate [standard deviations that an edge allows]
_PEAK = np.linspace(-4.0, 4.0, 12)  # along the plate [standard deviations of the fit]


def along_plate(likelihood: PlateLikelihood, beams: Beams, pose: Array, covariance: Array) -> tuple[Array, Array]:
    """Poses (M, 3) and covariances (M, 3, 3), corrected along the plate where the fit claims more than the edges."""
    e = np.stack([np.cos(pose[:, 2]), np.sin(pose[:, 2]), np.zeros(len(pose))], axis=-1)
    leaning = np.einsum("mij,mj->mi", covariance, e)
    sigma = np.sqrt(np.maximum(np.sum(leaning * e, axis=1), 1e-12))
    weight = np.min(beams.edge_weight, axis=1)
    sight = np.arctan2(pose[:, 1], pose[:, 0])
    edge = np.hypot(pose[:, 0], pose[:, 1]) / np.maximum(weight * np.abs(np.sin(pose[:, 2] - sight)), 1e-9)
    doubted = np.flatnonzero((sigma < _CLAIMED * edge / np.sqrt(2)) & (weight > 0))
    if doubted.size == 0:
        return pose, covariance

    e, leaning, sigma, edge = e[doubted], leaning[doubted], sigma[doubted, None], edge[doubted, None]
    offset = np.concatenate([edge * _PLATEAU, sigma * _PEAK], axis=1)  # (N, K)
    slid = pose[doubted, None, :] + offset[..., None] * e[:, None, :]
    every = beams.take(np.repeat(doubted, offset.shape[1]))
    cost = likelihood.cost(every, slid.reshape(-1, 3)).reshape(offset.shape)
    span = spans(offset)
    share = weights(cost, span)
    mean = np.sum(share * offset, axis=1)
    variance = np.sum(share * ((offset - mean[:, None]) ** 2 + span**2 / 12), axis=1)
    pose, covariance = pose.copy(), covariance.copy()
    pose[doubted] += mean[:, None] * e
    given = leaning[:, :, None] * leaning[:, None, :] / (sigma**2)[..., None]
    covariance[doubted] += variance[:, None, None] * e[:, :, None] * e[:, None, :] - given
    return pose, covariance
