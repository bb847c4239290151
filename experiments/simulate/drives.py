"""Drives whose true motion is known, by a slip law or in MuJoCo, and their logs as a source of poses sees them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.common.plain_json import plain
from sim.fleet import Fleet
from sim.loop import Progress, open_loop
from sim.run_recorder import Description
from sim.wander.motion import LawMotion, Motion, encoder_log, joined_log, quantised
from sim.wander.pose_source import PoseSource
from trackslip import se2
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog


@dataclass(frozen=True)
class KnownDrive:
    """A log of encoders with the true motion."""

    log: RunLog
    motion: Motion

    def measured(self, source: PoseSource, rng: np.random.Generator) -> RunLog:
        """The log with the poses of a source."""
        return joined_log(self.log, *source.measure(self.motion, rng))


def driven_by_law(
    name: str,
    law: LawMotion,
    omega: Array,
    rate: float,
    rng: np.random.Generator,
    start: Array | None = None,
    counts: int | None = None,
    metadata: Mapping[str, Any] | None = None,
) -> KnownDrive:
    """A drive by a law from `start` (3,) [m, m, rad], by default the origin.

    Encoders give readings `omega` (T, 2), means since the row before [rad/s], at `rate` [Hz], exactly or with `counts`
    per revolution; `rng` is for slip that varies, `metadata` is the log's besides the geometry.
    """
    moved, twist = law.drive(omega, rate, rng)
    motion = moved if start is None else Motion(moved.time, se2.compose(start, moved.pose))
    log = encoder_log(name, rate, omega, motion, twist, {"geometry": plain(law.geometry), **(metadata or {})})
    return KnownDrive(log if counts is None else quantised(log, counts), motion)


def driven_in_mujoco(
    fleet: Fleet, omega: Sequence[Array], rate: float, about: Sequence[Description], progress: Progress
) -> list[KnownDrive]:
    """Drives of a fleet at sprocket speeds (T, 2) of each robot [rad/s], all at once.

    `progress` is called with the simulated seconds since the last call; raises RunFailedError when a robot tips over.
    """
    speeds, period = np.stack(omega, axis=1), 1 / rate
    logs = open_loop(fleet, speeds, (len(speeds) - 1) * period, descriptions=about, progress=progress, period=period)
    return [KnownDrive(log, Motion(log.time, log.pose)) for log in logs]
