"""Models that predict a log from its encoders: odometry by slip laws, and simulated robots."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from experiments.evaluate.log import Log
from sim.calibration.candidate import Candidate
from sim.calibration.targets import SteadyRows
from sim.log_replay import Inputs, Replayer
from trackslip.identification.samples import SlipSamples
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog
from trackslip.odometry.evaluation import estimated_trajectory, trajectory_of
from trackslip.odometry.identified import LawInUse
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.odometry.trajectory_errors import Trajectory
from trackslip.se2 import Mounting

TODAY, GAINS, ROBOT, CALIBRATED = "today", "two_gains", "robot", "calibrated"
"""Names of models that aren't laws."""
FIRST = 1.0
"""Shortest time ahead; steady driving is compared after it [s]."""


@dataclass(frozen=True)
class Model:
    """Predicts how the sensor of the poses moves."""

    label: str
    """In tables and files: its name, with its file where others have the same name."""
    name: str
    """The law's, or one of TODAY, GAINS, ROBOT and CALIBRATED."""
    sensor: Mounting
    clock_offset: float
    """Encoder clock minus pose clock [s]."""

    def trajectories(self, log: Log) -> list[Trajectory]:
        """Measured and predicted poses of all drives or samples of a log."""
        raise NotImplementedError


@dataclass(frozen=True)
class LawModel(Model):
    """Odometry by a slip law."""

    law: LawInUse
    lag: float = 0.0
    """Time constant with which the motion follows the belts [s]."""

    @property
    def odometry(self) -> SlipOdometry:
        """Odometry without the errors of the law, which take longer."""
        law = self.law
        return SlipOdometry(law.law, law.geometry, law.noise, drift=law.drift, gyro=law.gyro)

    def trajectories(self, log: Log) -> list[Trajectory]:
        """See Model."""
        if log.samples is not None:
            return _steady(log.samples, self.law.law.twist(log.samples.omega, log.geometry))
        logs = [replace(one, omega=_lagging(one, self.lag)) if self.lag > 0 else one for one in log.logs]
        return [trajectory_of(one, self.odometry, self.sensor, self.clock_offset) for one in logs]


@dataclass(frozen=True)
class RobotModel(Model):
    """A simulated robot that drives as encoders or commands say."""

    candidate: Candidate
    inputs: Inputs
    threads: int

    def trajectories(self, log: Log) -> list[Trajectory]:
        """See Model."""
        if log.samples is not None:
            rows = SteadyRows(log.samples, log.geometry, threads=self.threads)
            return _steady(log.samples, rows.predicted(self.candidate)[:2].T)
        motion = Replayer(log.logs, self.inputs).run(self.candidate.robot, self.candidate.ground, self.threads)
        return [
            estimated_trajectory(one, partial(motion.sensor_at, k, self.sensor), log.geometry, self.clock_offset)
            for k, one in enumerate(log.logs)
        ]


def _lagging(log: RunLog, lag: float) -> Array:
    """Sprocket speeds (T, 2), means since the row before, that follow those of a log with a lag [s]."""
    omega, state = log.omega.copy(), log.omega[1]
    for k, step in enumerate(np.diff(log.time), start=1):
        behind, kept = state - log.omega[k], np.exp(-step / lag)
        omega[k] = log.omega[k] + behind * (1 - kept) * lag / step
        state = log.omega[k] + behind * kept
    return omega


def _steady(samples: SlipSamples, twist: Array) -> list[Trajectory]:
    """Measured motion within FIRST of steady driving, and that by predicted twists (n, 2); a trajectory a sample."""
    ends = [_driven(one) for one in (samples.twist, twist)]
    measured, predicted = (np.stack([np.zeros_like(end), end], axis=1) for end in ends)
    time, way = np.array([0.0, FIRST]), np.zeros(2)
    return [
        Trajectory(run, time, way, measured[k], predicted[k], measured[k, :, 2]) for k, run in enumerate(samples.run)
    ]


def _driven(twist: Array) -> Array:
    """Poses (n, 3) after FIRST at constant twists (n, 2), from the origin."""
    v, turn = twist[:, 0], FIRST * twist[:, 1]
    chord = FIRST * v * np.sinc(turn / (2 * np.pi))
    return np.column_stack([chord * np.cos(turn / 2), chord * np.sin(turn / 2), turn])
