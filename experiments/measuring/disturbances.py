"""What can be wrong with a scanner, its mounting and its field: the rows of `trackslip sensitivity`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from experiments.options.grid import GridConfig
from experiments.options.sensitivity import MIRROR_PERIOD
from trackslip.logs.runlog import RunLog

SWEEP = MIRROR_PERIOD
"""Time of a sweep [s]: a turn of the mirror of a SICK LMS 200."""


@dataclass(frozen=True)
class Effect:
    """A departure from the nominal experiment."""

    name: str
    scanner: Mapping[str, float] = field(default_factory=dict)
    """Options of `LaserScanner` that become other."""
    obstacles: str | None = None
    """Named obstacles in the field."""
    plate_left: float = 0.0
    """Where the plate is, to the left of the robot's axis, unknown to who evaluates [m]."""
    clock: float = 0.0
    """Relative error of the scanner's clock against that of the encoders [-]."""

    def driven(self, config: GridConfig) -> GridConfig:
        """The grid to drive; `config` itself where the effect is one of evaluation alone."""
        scanner = dataclasses.replace(config.scanner, **self.scanner)
        return dataclasses.replace(config, scanner=scanner, obstacles=self.obstacles or config.obstacles)

    def evaluated(self, log: RunLog) -> RunLog:
        """A run as it looks with this plate and this clock. The truth stays."""
        phi = log.pose[:, 2]
        shift = self.plate_left * np.column_stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)])
        # ranges know nothing of where the robot is under its plate: with one that is off, go by the poses
        scans = None if self.plate_left else log.scans
        return dataclasses.replace(log, time=log.time * (1 + self.clock), pose=log.pose + shift, scans=scans)


EFFECTS = (
    Effect("nominal"),
    Effect("noise 10 mm", {"noise": 0.01}),
    Effect("quantised to 1 cm", {"quantisation": 0.01}),
    Effect("range bias 10 mm", {"range_bias": 0.01}),
    Effect("mixed pixels, 4.4 mrad", {"divergence": 0.0044}),
    Effect(f"sweep of {SWEEP * 1e3:.1f} ms", {"sweep_time": SWEEP}),
    Effect("dropouts 20 %", {"dropout": 0.2}),
    Effect("posts around", obstacles="posts"),
    Effect("post in front", obstacles="occluded"),
    Effect("walls around", obstacles="room"),
    Effect("person in front", obstacles="walker"),
    Effect("plate 1 mm off the axis", plate_left=0.001),
    Effect("clock 0.1 % fast", clock=0.001),
)
