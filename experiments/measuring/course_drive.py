"""What is told of a drive over a course: outcome, slip of each track, penetration, energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from experiments.driving.course_run import CourseRun
from sim.terrain import Course
from trackslip.kinematics import Array


@dataclass(frozen=True)
class TrackResult:
    """What one track did on the way."""

    name: str
    """Name of the track."""
    slip: float | None
    """Mean slip by the way of the belt: 1 - way over ground / way of the belt while it touched [-]."""
    slip_p95: float | None
    """95th percentile of the slip's magnitude [-]."""
    touching: float
    """Share of the time in which it touched the ground [-]."""
    max_penetration: float
    """Largest penetration [m]."""
    work: float
    """Work of the belt against the ground [J]."""


@dataclass(frozen=True)
class DriveResult:
    """How a drive over a course went."""

    outcome: str
    """How it ended: reached, tipped, stuck, fell, exploded, time, or stopped."""
    duration: float
    """Simulated time [s]."""
    way: float
    """Way of the chassis in the plane [m]."""
    remaining: float
    """Way along the course that was left until its end [m]."""
    climbed: float
    """Height of the chassis at the end, above that at the start [m]."""
    max_pitch: float
    """Largest magnitude of the pitch [rad]."""
    max_roll: float
    """Largest magnitude of the roll [rad]."""
    max_penetration: float
    """Largest penetration of any track [m]."""
    penetration_p99: float
    """99th percentile of the largest penetration in each row [m]."""
    energy: float
    """Work of all belts against the ground [J]."""
    tracks: tuple[TrackResult, ...]
    """Each track."""

    @classmethod
    def of(cls, run: CourseRun, course: Course) -> DriveResult:
        """The results of a run."""
        state, moving = run.state, run.depth[1:]
        position = state.position
        deepest = moving.max(axis=1) if len(moving) else np.zeros(1)
        return cls(
            outcome=run.outcome,
            duration=round(float(run.time[-1]), 9),
            way=float(np.hypot(*np.diff(position[:, :2], axis=0).T).sum()),
            remaining=max(0.0, course.goal - float(position[-1, 0])),
            climbed=float(position[-1, 2] - position[0, 2]),
            max_pitch=float(np.abs(state.pitch).max()),
            max_roll=float(np.abs(state.roll).max()),
            max_penetration=float(deepest.max()),
            penetration_p99=float(np.percentile(deepest, 99)),
            energy=float(run.work.sum()),
            tracks=tuple(_track(run, k) for k in range(len(run.tracks))),
        )


def _track(run: CourseRun, k: int) -> TrackResult:
    slip, known = run.slip[:, k], np.isfinite(run.slip[:, k])
    belt = np.abs(run.belt[known, k])
    return TrackResult(
        name=run.tracks[k],
        slip=float(np.average(slip[known], weights=belt)) if belt.sum() > 0 else None,
        slip_p95=float(np.percentile(np.abs(slip[known]), 95)) if known.any() else None,
        touching=float(run.touching[1:, k].mean()) if len(run.time) > 1 else 0.0,
        max_penetration=float(run.depth[:, k].max()),
        work=float(run.work[:, k].sum()),
    )


def slip_by_slope(slope: Array, slip: Array, width: float) -> tuple[Array, Array]:
    """Middles (B,) of bins of slope of some width, and median and quartiles (B, 3) of the slip in them.

    Bins with fewer than five values are left out.
    """
    known = np.isfinite(slip)
    which = np.round(slope[known] / width).astype(int)
    bins = [b for b in np.unique(which) if np.sum(which == b) >= 5]
    quartiles = [np.percentile(slip[known][which == b], (25, 50, 75)) for b in bins]
    return np.array(bins, float) * width, np.array(quartiles).reshape(-1, 3)[:, [1, 0, 2]]
