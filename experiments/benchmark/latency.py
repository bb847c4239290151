"""The time that a controller with its compensation takes for one step of one robot."""

from __future__ import annotations

import time

import numpy as np

from experiments.benchmark.setup import Setup
from experiments.driving.lookup import reference
from experiments.options.benchmark import Case
from trackslip.controllers.base import SensesSprockets
from trackslip.kinematics import Array, limit_sprocket_speeds
from trackslip.localization.base import PoseEstimate
from trackslip.logs.runlog import RunLog

_STEPS = 200  # number measured, from the start of the run


def step_times(setup: Setup, case: Case, log: RunLog) -> Array:
    """Times (K,) [s] from pose to sprocket set points, at the poses of a run, measured with a controller of its own."""
    geometry, limit = setup.world.robot.geometry, setup.config.drive.top_speed
    path, pilot, compensation = (
        reference(case.reference),
        setup.controller(case.controller),
        setup.compensation(case.compensation),
    )
    covariance = np.zeros((len(log.time), 3, 3)) if log.covariance is None else log.covariance
    pilot.reset()
    compensation.reset(log.pose[:1])
    period = float(log.time[1] - log.time[0])
    times = []
    for k in range(min(_STEPS, len(log.time))):
        row = slice(k, k + 1)
        estimate = PoseEstimate(log.pose[row].copy(), covariance[row], log.is_valid[row])
        began = time.perf_counter()
        if k > 0:
            compensation.observe(log.omega[row], period, estimate)
        if isinstance(pilot, SensesSprockets):
            pilot.sense(log.omega[row])
        twist = pilot.twist(float(log.time[k]), estimate.pose, path)
        limit_sprocket_speeds(compensation.law().sprocket_speeds(twist, geometry), limit / geometry.sprocket_radius)
        times.append(time.perf_counter() - began)
    return np.array(times[1:])  # the first call prepares what the others use
