"""References by name, placed in view of the default scanner, or read from a file of waypoints."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from trackslip.errors import require
from trackslip.trajectory.base import Reference
from trackslip.trajectory.curves import clothoid, figure_eight, rounded_square, slalom, spiral
from trackslip.trajectory.segmented import PAPER_START, circle, paper_reference, stop_and_go
from trackslip.trajectory.waypoints import read_waypoints

# The scanner is at (-1.5, -1.5) and sees everything with y > -1.5. From these starts the plate stays more than 1 m from
# it and within its field of view, even with an error of 0.4 m.
REFERENCES: dict[str, Callable[..., Reference]] = {
    "paper": partial(paper_reference, start=PAPER_START),
    "circle": partial(circle, 1.0, 0.15, 2 * np.pi / 0.15, start=(-1.5, 0.4, 0.0)),
    "figure_eight": partial(figure_eight, start=(-1.5, 1.6, -np.pi / 4)),
    "slalom": partial(slalom, start=(-3.5, 1.2, 0.0)),
    "rounded_square": partial(rounded_square, start=(-1.5, 0.5, 0.0)),
    "clothoid": partial(clothoid, start=(-2.5, 0.6, 0.0)),
    "spiral": partial(spiral, start=(-1.5, 0.5, 0.0)),
    "stop_and_go": partial(stop_and_go, start=(-2.5, 1.0, np.pi / 4)),
}
"""Makers of references by name; each takes another `start` (3,) as a keyword."""


def named_reference(name: str, start: ArrayLike | None = None) -> Reference:
    """The reference called `name` in REFERENCES, from `start` (3,) or from its default start.

    Raises InvalidValueError if there is no such reference.
    """
    require(name in REFERENCES, "reference", name, f"one of {', '.join(REFERENCES)}")
    return REFERENCES[name]() if start is None else REFERENCES[name](start=start)


def load_reference(name_or_path: str | Path) -> Reference:
    """A reference by its name in REFERENCES, or through the waypoints in a `.csv` file.

    Raises:
        InvalidValueError: if it is neither.
        ReferenceFileError: if the file cannot be read or the path cannot be driven.
    """
    name = str(name_or_path)
    if Path(name).suffix.lower() == ".csv":
        return read_waypoints(Path(name))
    require(name in REFERENCES, "reference", name, f"one of {', '.join(REFERENCES)}, or a .csv file of waypoints")
    return REFERENCES[name]()
