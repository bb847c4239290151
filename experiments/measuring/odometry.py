"""Odometry by several laws on the same log."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from trackslip.logs.runlog import RunLog
from trackslip.odometry.clock_check import better_clock_offset
from trackslip.odometry.evaluation import OdometryErrors, odometry_errors
from trackslip.odometry.identified import NO_SLIP, LawInUse
from trackslip.odometry.mounting import Mounting
from trackslip.odometry.slip_odometry import SlipOdometry


@dataclass(frozen=True)
class Evaluated:
    """A law and the errors of odometry by it."""

    label: str  # the law's name, with its file where others have the same name
    used: LawInUse
    errors: OdometryErrors


def evaluated(
    laws: Sequence[tuple[str, LawInUse]],
    logs: Sequence[RunLog],
    mounting: Mounting,
    clock_offset: float,
    step: Callable[[float], None],
) -> list[Evaluated]:
    """Errors of laws, by their labels, on the same logs; `step(1.0)` is called after each law.

    Raises LogError if no log has poses to compare with.
    """
    found = []
    for label, used in laws:
        found.append(Evaluated(label, used, odometry_errors(logs, _odometry(used), mounting, clock_offset)))
        step(1.0)
    return found


def clock_doubt(
    found: Sequence[Evaluated], logs: Sequence[RunLog], mounting: Mounting, clock_offset: float
) -> list[str]:
    """A line if another offset between the clocks fits clearly better."""
    used = next((one.used for one in found if one.used.name != NO_SLIP), found[0].used)
    better = better_clock_offset(logs, _odometry(used), mounting, clock_offset)
    if better is None:
        return []
    told = f"{round(1e3 * better)} ms ahead of the poses', not {round(1e3 * clock_offset)} ms"
    return [f"the encoders' clock seems to be {told}: try --clock-offset {round(better, 3) + 0.0:.3f}"]


def summary_of(one: Evaluated) -> dict[str, Any]:
    """A law and its errors as content of a summary.json."""
    errors = one.errors
    return {
        "law": one.used.name,
        "aligned": errors.aligned,
        "from_first": errors.from_first,
        "after_metres": {f"{length:g}": found for length, found in errors.after_metres.items()},
        "after_seconds": {f"{length:g}": found for length, found in errors.after_seconds.items()},
    }


def _odometry(used: LawInUse) -> SlipOdometry:
    """Odometry without the covariance, which takes longer."""
    return SlipOdometry(used.law, used.geometry, drift=used.drift)
