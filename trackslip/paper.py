"""Settings and published results of the paper's experiment, for comparison."""

from __future__ import annotations

from typing import Final

COMMANDED_RADII: Final = (0.5, 1.0, 1.5, 2.0, 2.5)
"""Radii that the commands would produce without slip [m] (Eq. 8)."""

SPEEDS: Final = (0.05, 0.10, 0.15, 0.20, 0.25)
"""Speeds that the commands would produce without slip [m/s] (Eq. 9)."""

OBSERVED_RADII: Final = (0.62, 1.34, 2.05, 2.68, 3.12)
"""Radii that the robot drove at each of COMMANDED_RADII [m] (legend of Fig. 5)."""
