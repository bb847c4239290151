"""The widest robots whose turns are verified to follow theory."""

import warnings

from trackslip.errors import RobotWarning

WIDEST = 3.0
"""Gauge over contact length up to which turns are verified to follow theory [-]."""


def warn_if_unverified(half_gauge: float, contact_length: float, level: int) -> None:
    """Give a RobotWarning, as of the code `level` calls above, for a robot whose turns are not verified."""
    if half_gauge > WIDEST * contact_length / 2 * (1 + 1e-9):
        allowed = f"turns are verified up to {WIDEST / 2 * contact_length:.4g} m, {WIDEST / 2:g} contact lengths"
        warnings.warn(f"half_gauge = {half_gauge:.4g}: {allowed}", RobotWarning, stacklevel=level + 1)
