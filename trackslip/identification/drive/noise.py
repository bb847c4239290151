"""Variances of the noise by restricted maximum likelihood."""

from __future__ import annotations

import numpy as np

from trackslip.identification.drive.equations import Nodes, Noise, Residuals, log_determinant
from trackslip.identification.drive.model import DriveModel
from trackslip.kinematics import Array

FIRST = Noise(np.array([0.02, 0.02, 0.005, 0.005, 0.01]))
"""A first guess."""
_FLOOR = np.array([1e-4, 1e-4, 1e-4, 1e-4, 2e-4])  # standard deviations below which noise doesn't matter
_AVOIDED = np.array([0.0, 0.0, 1.0, 1.0, 1.0])  # power of a standard deviation in its prior: 0 is avoided
_MIN_FREEDOM = 0.25
_RELAXATION = 1.5  # exponent of a change, which would take small steps otherwise
_DIFFERENCE = 1e-3  # relative change of a variance for differences
_WILD = 0.3  # standard deviation of slip that no driving on the ground shows [m/sqrt(m), rad/sqrt(m)]
_HARDLY = 0.1  # likewise, that makes one doubt a drive which tells nothing else
_UNITS = ("m/√m", "m/√m", "rad/√m")
_MAX_CHANGE = 16.0  # factor of variances in one update


def updated(
    model: DriveModel, found: Residuals, nodes: Nodes, noise: Noise, free: np.ndarray, prior: Array, trimmed: float
) -> Noise:
    """The next iterate of the variances, from residuals at the trajectory that `noise` led to.

    Each variance is the sum of its squares over the number of its residuals less those used up by the trajectory and
    the parameters: the derivative of the Hessian's log determinant by the logarithm of the variance's reciprocal.
    `trimmed` is the share of the variance that poses keep when outlying ones are left out.
    """
    yaw = model.index("sensor_yaw")
    base = log_determinant(found, nodes, noise, free, yaw, prior)
    squares = found.squares(nodes)
    counts = [2 * nodes.weight[:, 0].sum(), nodes.weight[:, 1].sum(), *[nodes.link.sum()] * 3]
    values = noise.values.copy()
    unknowns = 3 * len(nodes.pose) + len(free)
    others = 0.0
    for k in reversed(range(len(values))):  # the position's share follows from that of all others
        if not counts[k]:
            continue
        if k:
            beside = noise.values.copy()
            beside[k] /= np.sqrt(1 + _DIFFERENCE)
            used = (log_determinant(found, nodes, Noise(beside), free, yaw, prior) - base) / np.log1p(_DIFFERENCE)
            others += used
        else:
            used = unknowns - others
        share = trimmed if k < 2 else 1.0
        variance = squares[k].sum() / share / max(counts[k] - used - _AVOIDED[k], _MIN_FREEDOM)
        ratio = np.clip(variance / noise.values[k] ** 2, 1 / _MAX_CHANGE, _MAX_CHANGE)
        values[k] = max(values[k] * ratio ** (_RELAXATION / 2), _FLOOR[k])
    return Noise(values)


def unlike_sprockets(noise: Noise, hopeless: bool = False) -> str:
    """Words for slip so large that the motion hardly depends on the sprocket speeds; empty if it does.

    A drive from which nothing else follows, a `hopeless` one, is doubted earlier.
    """
    most = _HARDLY if hopeless else _WILD
    slips = dict(zip(Noise.NAMES[2:], noise.values[2:].tolist(), strict=True))
    wild = [
        f"{name} = {value:.2g} {unit}"
        for (name, value), unit in zip(slips.items(), _UNITS, strict=True)
        if value > most
    ]
    if not wild:
        return ""
    return f"the motion hardly follows the sprockets ({', '.join(wild)}): are units, gear, signs and clocks right?"
