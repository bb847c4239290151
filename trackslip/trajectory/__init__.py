"""References: what a controller is asked to follow, as pose and twist over time."""

from trackslip.trajectory.base import Reference
from trackslip.trajectory.clothoid import ClothoidPath, Piece, clothoid, rounded_square
from trackslip.trajectory.curves import figure_eight, slalom, spiral
from trackslip.trajectory.named import REFERENCES, NamedReference, load_reference, named_reference
from trackslip.trajectory.path import ParametricPath, PlanarPath
from trackslip.trajectory.profile import LIMITS, Limits, ProfiledReference
from trackslip.trajectory.segmented import Segment, SegmentedReference, circle, paper_reference
from trackslip.trajectory.stop_and_go import stop_and_go
from trackslip.trajectory.waypoints import read_waypoints, waypoints

__all__ = [
    "LIMITS",
    "REFERENCES",
    "ClothoidPath",
    "Limits",
    "NamedReference",
    "ParametricPath",
    "Piece",
    "PlanarPath",
    "ProfiledReference",
    "Reference",
    "Segment",
    "SegmentedReference",
    "circle",
    "clothoid",
    "figure_eight",
    "load_reference",
    "named_reference",
    "paper_reference",
    "read_waypoints",
    "rounded_square",
    "slalom",
    "spiral",
    "stop_and_go",
    "waypoints",
]
