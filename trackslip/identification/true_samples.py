"""Steady slip samples from the true motion of simulated runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trackslip.errors import LogError
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog
from trackslip.motion.constant_speed import SETTLE
from trackslip.motion.steady import SteadyPart, steady_part


def true_samples(
    logs: Sequence[RunLog], geometry: RobotGeometry, settle: float = SETTLE, of_plate: bool = False
) -> SlipSamples:
    """Samples from the true motion of simulated runs, like `slip_samples`; raises LogError if a run has no truth.

    `of_plate` takes the motion of the scanned plate, which leans outwards with the robot: it moves along a wider
    circle, faster by the yaw rate times the lean.
    """
    found = []
    for log in logs:
        if log.truth is None or (of_plate and log.truth.lean is None):
            raise LogError(f"run {log.run!r}: has no truth")
        found.append(true_sample(steady_part(log, geometry, settle), geometry, of_plate))
    return SlipSamples.joined(found)


def true_sample(part: SteadyPart, geometry: RobotGeometry, of_plate: bool = False) -> SlipSamples:
    """The sample of a steady stretch from its true motion."""
    truth, rows = part.log.truth, part.rows
    assert truth is not None
    true = truth.twist[rows][:, [0, 2]]
    if of_plate and truth.lean is not None:
        true = np.column_stack([true[:, 0] - true[:, 1] * truth.lean[rows], true[:, 1]])
    load = None if part.load is None else part.load[None]
    return SlipSamples.of(part.omega[None], true.mean(axis=0)[None], geometry, [part.name], load=load)
