"""The geometry in the metadata of a run."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping

from trackslip.errors import TrackslipError
from trackslip.kinematics import RobotGeometry
from trackslip.logs.runlog import RunLog


def stored_geometry(log: RunLog) -> RobotGeometry | None:
    """The robot's geometry, if the log has it."""
    known = log.metadata.get("geometry")
    with contextlib.suppress(TypeError, TrackslipError):
        return RobotGeometry(**known) if isinstance(known, Mapping) else None
    return None
