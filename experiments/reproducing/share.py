"""What a worker drove of a set of runs, and the whole set again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sim.run_recorder import FAILURE
from trackslip.errors import RunFailedError
from trackslip.identification.samples import MeasuredRuns
from trackslip.logs.runlog import RunLog

_SAME = 1e-9  # times closer than this are equal [s]


@dataclass(frozen=True)
class Share:
    """Runs that one worker drove as one fleet."""

    logs: Sequence[RunLog]
    stages: Mapping[str, float]
    """Work by stage [s]."""
    failure: RunFailedError | None = None
    """Why they stopped early."""
    measured: MeasuredRuns = field(default_factory=dict)
    """What was found of steady runs."""

    @property
    def end(self) -> float:
        """When the runs ended [s]; negative if they never began."""
        return float(self.logs[0].time[-1]) if self.logs else -1.0


def whole(shares: Sequence[Share], places: Sequence[Sequence[int]]) -> list[RunLog]:
    """The logs of all runs, those of each share at its `places`.

    Raises RunFailedError if runs of a share failed, the earliest; its logs are those of all runs until then.
    """
    logs: dict[int, RunLog] = {}
    for share, at in zip(shares, places, strict=True):
        logs |= zip(at, share.logs, strict=False)  # a fleet that failed at once has none
    ordered = [logs[k] for k in sorted(logs)]
    failed = [share for share in shares if share.failure is not None]
    if not failed:
        return ordered
    first = min(failed, key=lambda share: share.end)
    assert first.failure is not None
    failure = RunFailedError(str(first.failure))
    failure.logs = [short for log in ordered if (short := _until(log, first.end, str(failure))) is not None]
    raise failure


def _until(log: RunLog, end: float, reason: str) -> RunLog | None:
    """A log's rows until a failure [s], with its reason; None for less than two."""
    rows = int(np.count_nonzero(log.time <= end + _SAME))
    return None if rows < 2 else replace(log.between(0, rows), metadata={**log.metadata, FAILURE: reason})
