"""Disturbances of scanner, mounting and field: the rows of `trackslip sensitivity`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from experiments.options.grid import GridConfig
from experiments.options.sensitivity import MIRROR_PERIOD
from trackslip.logs.runlog import RunLog


@dataclass(frozen=True)
class Disturbance:
    """A departure from the nominal experiment."""

    name: str
    scanner: Mapping[str, float] = field(default_factory=dict)
    """Changed options of `LaserScanner`."""
    obstacles: str | None = None
    """Named obstacles in the field."""
    plate_left: float = 0.0
    """Offset of the plate to the left of the robot's axis, unknown to the evaluation [m]."""
    clock: float = 0.0
    """Relative error of the scanner's clock against the encoders' [-]."""

    @property
    def settings(self) -> dict[str, float | str]:
        """What differs from the nominal experiment."""
        rest = {"obstacles": self.obstacles, "plate_left": self.plate_left, "clock": self.clock}
        return {**self.scanner, **{name: value for name, value in rest.items() if value}}

    def driven(self, config: GridConfig) -> GridConfig:
        """The grid to drive; equal to `config` where only the evaluation is disturbed."""
        scanner = dataclasses.replace(config.scanner, **self.scanner)
        return dataclasses.replace(config, scanner=scanner, obstacles=self.obstacles or config.obstacles)

    def evaluated(self, log: RunLog) -> RunLog:
        """The run as measured with this plate and this clock; the truth stays."""
        phi = log.pose[:, 2]
        shift = self.plate_left * np.column_stack([-np.sin(phi), np.cos(phi), np.zeros_like(phi)])
        # ranges do not tell where the robot is under its plate: with an offset plate, evaluate the poses
        scans = None if self.plate_left else log.scans
        return dataclasses.replace(log, time=log.time * (1 + self.clock), pose=log.pose + shift, scans=scans)


DISTURBANCES = (
    Disturbance("nominal"),
    Disturbance("noise 10 mm", {"noise": 0.01}),
    Disturbance("quantised to 1 cm", {"quantisation": 0.01}),
    Disturbance("range bias 10 mm", {"range_bias": 0.01}),
    Disturbance("mixed pixels, 4.4 mrad", {"divergence": 0.0044}),
    Disturbance(f"sweep of {MIRROR_PERIOD * 1e3:.1f} ms", {"scan_duration": MIRROR_PERIOD}),
    Disturbance("dropouts 20 %", {"dropout": 0.2}),
    Disturbance("posts around", obstacles="posts"),
    Disturbance("post in front", obstacles="occluded"),
    Disturbance("walls around", obstacles="room"),
    Disturbance("person in front", obstacles="walker"),
    Disturbance("plate 1 mm off the axis", plate_left=0.001),
    Disturbance("clock 0.1 % fast", clock=0.001),
)
