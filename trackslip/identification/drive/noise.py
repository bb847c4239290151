"""Variances of the noise by restricted maximum likelihood."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.identification.drive.residuals import Nodes, Noise, Residuals
from trackslip.kinematics import Array

FIRST = Noise(np.array([0.02, 0.02, 0.005, 0.005, 0.01]))
"""A first guess."""
_FLOOR = np.array([1e-4, 1e-4, 1e-4, 1e-4, 2e-4])  # standard deviations below which noise doesn't matter
_AVOIDED = np.array([0.0, 0.0, 1.0, 1.0, 1.0])  # power of a standard deviation in its prior: 0 is avoided
_MIN_FREEDOM = 0.25
_RELAXATION = 1.5  # exponent of a change at first: small steps are usual
_EXPONENTS = (0.5, 3.0)  # its limits
_SMALL = 0.3  # changes of logarithms beyond which the exponent doesn't grow
_FAINT = 1e-4  # changes of logarithms that tell nothing
_WILD = 0.3  # standard deviation of slip that no driving on the ground shows [m/sqrt(m), rad/sqrt(m)]
_HARDLY = 0.1  # likewise, that makes one doubt a drive which tells nothing else
_UNITS = ("m/√m", "m/√m", "rad/√m")
_MAX_CHANGE = 16.0  # factor of variances in one update


@dataclass(frozen=True)
class Iterate:
    """An iterate of the noise, and how it was reached."""

    noise: Noise
    change: Array  # (5,) last change of the logarithm of each standard deviation; NaN at first
    exponent: Array  # (5,) power of the ratio of variances by which each was changed

    @classmethod
    def at(cls, noise: Noise) -> Iterate:
        """A first iterate."""
        return cls(noise, np.full(len(noise.values), np.nan), np.full(len(noise.values), _RELAXATION))

    def updated(self, found: Residuals, nodes: Nodes, used: Array, trimmed: float) -> Iterate:
        """The next iterate, from residuals at the trajectory that this one led to.

        Each variance is the sum of its squares over the number of its residuals less those `used` (5,) up by the
        trajectory and the parameters. `trimmed` is the share of the variance that poses keep when outlying ones are
        left out.
        """
        counts = np.array([2 * nodes.weight[:, 0].sum(), nodes.weight[:, 1].sum(), *[nodes.link.sum()] * 3])
        share = np.array([trimmed, trimmed, 1.0, 1.0, 1.0])
        squares = np.array([one.sum() for one in found.squares(nodes)])
        variance = squares / share / np.maximum(counts - used - _AVOIDED, _MIN_FREEDOM)
        before = self.noise.values
        ratio = np.clip(variance / before**2, 1 / _MAX_CHANGE, _MAX_CHANGE)
        values = np.maximum(before * ratio ** (self.exponent / 2), _FLOOR)
        values = np.where(counts > 0, values, before)
        change = np.log(values / before)
        return Iterate(Noise(values), change, self._exponent(change))

    def _exponent(self, change: Array) -> Array:
        """Powers (5,) that would have led to the limit at once, as far as the last two changes tell."""
        with np.errstate(divide="ignore", invalid="ignore"):
            found = self.exponent / (1 - change / self.change)
        found = np.clip(np.where(found > 0, found, _EXPONENTS[1]), *_EXPONENTS)
        found = np.where(np.abs([change, self.change]).max(axis=0) < _SMALL, found, np.minimum(found, self.exponent))
        return np.where(np.abs(self.change) > _FAINT, found, self.exponent)


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
