"""One scan -> pose of the plate, with covariance (paper, Sec. III-B)."""

from trackslip.localization.base import Locator, PoseEstimate
from trackslip.localization.line import LineLocator
from trackslip.localization.plate import PlateLocator
from trackslip.localization.tracker import Tracker

__all__ = ["LineLocator", "Locator", "PlateLocator", "PoseEstimate", "Tracker"]
