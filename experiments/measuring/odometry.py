"""Odometry by several laws on the same log."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from trackslip.logs.runlog import RunLog
from trackslip.odometry.clock_check import better_clock_offset
from trackslip.odometry.evaluation import OdometryErrors, odometry_errors
from trackslip.odometry.identified import LawInUse
from trackslip.odometry.mounting import Mounting
from trackslip.odometry.pose_check import jumps
from trackslip.odometry.slip_odometry import SlipOdometry
from trackslip.slip.stored_laws import NO_SLIP

_MANY = 0.005  # share of outlying poses that is told


@dataclass(frozen=True)
class Evaluated:
    """A law and the errors of odometry by it."""

    label: str  # the law's name, with its file where others have the same name
    used: LawInUse
    mounting: Mounting  # of the sensor that measured the poses
    clock_offset: float  # encoder clock minus pose clock [s]
    errors: OdometryErrors


def evaluated(
    laws: Sequence[tuple[str, LawInUse]],
    logs: Sequence[RunLog],
    mounting: Mounting | None = None,
    clock_offset: float | None = None,
    step: Callable[[float], None] = lambda _: None,
) -> list[Evaluated]:
    """Errors of laws, by their labels, on the same logs; `step(1.0)` is called after each law.

    Unless given, sensor and clock are as identified with each law, for laws shift and turn them differently; for laws
    that come without, as with the first law that has them. Raises LogError if no log has poses to compare with.
    """
    first = next((used for _, used in laws if used.mounting is not None), None)
    found = []
    for label, used in laws:
        known = first if used.mounting is None else used
        place = mounting or (known.mounting if known else None) or Mounting()
        offset = ((known.clock_offset if known else None) or 0.0) if clock_offset is None else clock_offset
        found.append(Evaluated(label, used, place, offset, odometry_errors(logs, _odometry(used), place, offset)))
        step(1.0)
    return found


def clock_doubt(found: Sequence[Evaluated], logs: Sequence[RunLog]) -> list[str]:
    """A line if another offset between the clocks fits clearly better."""
    one = next((one for one in found if one.used.name != NO_SLIP), found[0])
    better = better_clock_offset(logs, _odometry(one.used), one.mounting, one.clock_offset)
    if better is None:
        return []
    told = f"{round(1e3 * better)} ms ahead of the poses', not {round(1e3 * one.clock_offset)} ms"
    return [f"the encoders' clock seems to be {told}: try --clock-offset {round(better, 3) + 0.0:.3f}"]


def pose_doubts(found: Sequence[Evaluated]) -> list[str]:
    """A line for each drive whose measured poses jump away and back, or lastingly, by the law that fits them best."""
    best = min(found, key=_misfit)
    doubts = []
    for drive in best.errors.trajectories:
        outlying, lasting = jumps(drive)
        what = [f"{outlying} outlying pose(s)"] if outlying > _MANY * len(drive.time) else []
        what += [f"{lasting} lasting jump(s) of the poses"] if lasting else []
        if what:
            told = f"run {drive.name!r}: {' and '.join(what)} count in all errors"
            doubts.append(f"{told}; medians tell more of the law")
    return doubts


def summary_of(one: Evaluated) -> dict[str, Any]:
    """A law and its errors as content of a summary.json."""
    errors = one.errors
    return {
        "law": one.used.name,
        "sensor": one.mounting,
        "clock_offset": one.clock_offset,
        "aligned": errors.aligned,
        "from_first": errors.from_first,
        "after_metres": {f"{length:g}": found for length, found in errors.after_metres.items()},
        "after_seconds": {f"{length:g}": found for length, found in errors.after_seconds.items()},
    }


def _misfit(one: Evaluated) -> float:
    """Median error of positions that are aligned [m]."""
    position = one.errors.aligned.position
    return float("inf") if position is None else position.median


def _odometry(used: LawInUse) -> SlipOdometry:
    """Odometry without the covariance, which takes longer."""
    return SlipOdometry(used.law, used.geometry, drift=used.drift)
