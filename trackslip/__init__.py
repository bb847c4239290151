"""Slip of tracked robots: kinematics, localisation, identification, controllers. Needs no simulator."""

from trackslip.errors import InvalidValueError, LogError, OutputError, TrackslipError

__all__ = ["InvalidValueError", "LogError", "OutputError", "TrackslipError"]
