"""Runs that fail: why, and what was recorded until they did."""

from __future__ import annotations

from sim.run_recorder import RunFailedError
from trackslip.errors import TrackslipError
from trackslip.logs.runlog import RunLog


def failure_text(error: BaseException) -> str:
    """Why a run failed, on one line."""
    said = str(error) if isinstance(error, TrackslipError) else f"{type(error).__name__}: {error}"
    return " ".join(said.split())


def logs_until(error: BaseException) -> list[RunLog]:
    """What was recorded of the runs of a fleet until one of them failed."""
    return error.logs if isinstance(error, RunFailedError) else []
