"""Model predictive path integral control.

G. Williams, A. Aldrich and E. A. Theodorou, "Model predictive path integral control: from theory to parallel
computation", J. Guidance, Control, and Dynamics 40(2), 2017; in the information-theoretic form of G. Williams,
P. Drews, B. Goldfain, J. M. Rehg and E. A. Theodorou, "Information-theoretic model predictive control: theory and
applications to autonomous driving", IEEE Trans. Robotics 34(6), 2018.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trackslip.controllers.horizon import Horizon
from trackslip.errors import require_whole
from trackslip.kinematics import Array, track_speeds, twist_of_tracks, wrap_angle


@dataclass(frozen=True)
class PathIntegral(Horizon):
    """Averages sampled plans, each weighted by exp(-cost / temperature), and drives the first twist of the mean.

    Samples are normal about the shifted plan of the previous call, in pairs of opposite deviations, and driven within
    the limits of the tracks. Uncontrolled motion is that of the reference, so a deviation d of a track speed from it
    costs temperature d^2 / (2 noise^2): with many samples and no active limit, the plan is that of model predictive
    control with speed_scale = noise sqrt(2 / temperature). The random numbers follow from the seed and the time, so
    that a robot's twist depends on its own poses only.
    """

    samples: int = 400
    """Number of sampled plans, rounded up to an even one [-]."""
    noise: float = 0.03
    """Standard deviation of each sampled track speed in each interval [m/s]."""
    temperature: float = 0.125
    """lambda, in units of the cost [-]."""
    seed: int = 1
    """Of the random numbers [-]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole("samples", self.samples, 2, 10_000)
        require_whole("seed", self.seed, 1)

    def _improved(self, time: float, plans: Array, pose: Array, poses: Array, twists: Array) -> Array:
        generator = np.random.default_rng([self.seed, round(1e6 * time) % 2**63])
        half = generator.normal(0.0, self.noise, ((self.samples + 1) // 2, self.intervals, 2))
        deviations, speeds = np.concatenate([half, -half]), track_speeds(twists, self.half_gauge)  # (M, K, 2), (K, 2)
        better = [self._averaged(*each, deviations, poses[1:], speeds) for each in zip(plans, pose, strict=True)]
        return np.reshape(better, plans.shape)

    def _averaged(self, plan: Array, pose: Array, deviations: Array, wanted: Array, speeds: Array) -> Array:
        """The plan (K, 2) of a robot at `pose` (3,), averaged over samples that differ from it by `deviations`."""
        sampled = np.clip(plan + deviations, -self.track_speed, self.track_speed)  # (M, K, 2)
        v, w = np.moveaxis(twist_of_tracks(sampled, self.half_gauge), -1, 0)  # (M, K)
        heading = pose[2] + np.cumsum(w, axis=-1) * self.interval
        middle = heading - w * (self.interval / 2)  # chords of arcs point there; they are 1 - w^2 interval^2 / 24 long
        chord = v * self.interval * (1 - (w * self.interval) ** 2 / 24)
        x = pose[0] - wanted[:, 0] + np.cumsum(chord * np.cos(middle), axis=-1)
        y = pose[1] - wanted[:, 1] + np.cumsum(chord * np.sin(middle), axis=-1)
        squares = np.stack([x**2, y**2, wrap_angle(heading - wanted[:, 2]) ** 2], axis=-1)
        cost = (squares * self.weights).sum(axis=(1, 2)) / self.temperature
        cost += ((plan - speeds) * deviations).sum(axis=(1, 2)) / self.noise**2
        weight = np.exp(cost.min() - cost)
        return np.asarray((weight[:, None, None] * sampled).sum(axis=0) / weight.sum())
