"""References by name, placed in view of the default scanner, or read from a file of waypoints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import InvalidValueError
from trackslip.trajectory.base import Reference
from trackslip.trajectory.clothoid import clothoid, rounded_square
from trackslip.trajectory.curves import figure_eight, slalom, spiral
from trackslip.trajectory.segmented import PAPER_START, circle, paper_reference
from trackslip.trajectory.stop_and_go import stop_and_go
from trackslip.trajectory.waypoints import read_waypoints


@dataclass(frozen=True)
class NamedReference:
    """A reference that can start anywhere, with its default start."""

    make: Callable[[ArrayLike], Reference]
    """Makes the reference from its first pose (3,)."""
    start: tuple[float, float, float]
    """Default first pose [m, m, rad]."""
    about: str
    """Description for help texts."""

    def __call__(self, start: ArrayLike | None = None) -> Reference:
        """The reference from `start` (3,), or from its default start."""
        return self.make(self.start if start is None else start)


def _lap(start: ArrayLike) -> Reference:
    """Once around a circle of 1 m radius at constant speed."""
    radius, speed = 1.0, 0.15
    return circle(radius, speed, 2 * np.pi * radius / speed, start)


# The scanner is at (-1.5, -1.5) and sees everything with y > -1.5. From these starts the plate stays more than 1 m from
# it and within its field of view, even with an error of 0.4 m.
REFERENCES: dict[str, NamedReference] = {
    "paper": NamedReference(paper_reference, PAPER_START, "straight, arc, straight: the paper's Sec. IV-A"),
    "circle": NamedReference(_lap, (-1.5, 0.4, 0.0), "a circle at constant speed"),
    "figure_eight": NamedReference(figure_eight, (-1.5, 1.6, -np.pi / 4), "Bernoulli's lemniscate"),
    "slalom": NamedReference(slalom, (-3.5, 1.2, 0.0), "a sine"),
    "rounded_square": NamedReference(rounded_square, (-1.5, 0.5, 0.0), "straights and arcs"),
    "clothoid": NamedReference(clothoid, (-2.5, 0.6, 0.0), "an S of straights, clothoids and arcs"),
    "spiral": NamedReference(spiral, (-1.5, 0.5, 0.0), "Archimedes' spiral, inwards"),
    "stop_and_go": NamedReference(stop_and_go, (-2.5, 1.0, np.pi / 4), "forwards, backwards on an arc, forwards"),
}
"""References by name."""


def named_reference(name: str, start: ArrayLike | None = None) -> Reference:
    """The reference called `name` in REFERENCES, from `start` (3,) or from its default start.

    Raises:
        InvalidValueError: if there is no such reference.
    """
    if name not in REFERENCES:
        raise InvalidValueError("reference", name, f"one of {', '.join(REFERENCES)}")
    return REFERENCES[name](start)


def load_reference(name_or_path: str | Path) -> Reference:
    """A reference by its name in REFERENCES, or through the waypoints in a `.csv` file.

    Raises:
        InvalidValueError: if it is neither.
        ReferenceFileError: if the file cannot be read or the path cannot be driven.
    """
    if Path(name_or_path).suffix.lower() == ".csv":
        return read_waypoints(Path(name_or_path))
    if str(name_or_path) not in REFERENCES:
        raise InvalidValueError(
            "reference", str(name_or_path), f"one of {', '.join(REFERENCES)}, or a .csv file of way points"
        )
    return named_reference(str(name_or_path))
