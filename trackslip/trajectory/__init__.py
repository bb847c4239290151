"""References: what a controller is asked to follow, as pose and twist over time."""

from trackslip.trajectory.base import Reference
from trackslip.trajectory.segmented import Segment, SegmentedReference, circle, paper_reference

__all__ = ["Reference", "Segment", "SegmentedReference", "circle", "paper_reference"]
