"""Motion in MuJoCo: a fleet whose sprockets are commanded anew in every period of the encoders."""

from __future__ import annotations

from collections.abc import Sequence

from sim.fleet import Fleet
from sim.run_recorder import Description, RunRecorder
from sim.runs import Progress
from trackslip.errors import RunFailedError
from trackslip.kinematics import Array
from trackslip.logs.runlog import RunLog


def drive_fleet(
    fleet: Fleet,
    omega: Array,
    rate: float,
    descriptions: Sequence[Description],
    progress: Progress = lambda seconds: None,
) -> list[RunLog]:
    """Drive N robots at set points `omega` (T, N, 2) [rad/s], each for a period of the encoders, 1 / `rate` [s].

    The logs have the true poses and, in each row, the sprocket speeds since the row before.

    Raises:
        RunFailedError: when a robot tips over; its `logs` contain what was recorded until then.
        InvalidValueError: unless the encoders' period is a multiple of the servo's.
    """
    record = RunRecorder(fleet, len(omega), 1 / rate, descriptions)
    try:
        for k, command in enumerate(omega):
            if k > 0:
                fleet.advance(1 / rate)
                progress(1 / rate)
            record.measure(k)
            record.estimate_exactly(k)
            fleet.command(command)
            record.command(k)
    except RunFailedError as error:
        error.logs = record.logs(failure=str(error))
        raise
    return record.logs()
