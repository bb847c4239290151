"""Obstacles by name, or from a TOML file.

The named ones are placed around the circles that the robots of a grid drive in front of the scanner, which stands at
(-1.5, -1.5) and looks along +y. The circles touch each other at (-1.5, 0) and lie beyond it, the largest from x = -4.7
to 1.7 and up to y = 6.3. No obstacle stands in the way of a robot of the grid.
"""

from __future__ import annotations

from sim.scanner.obstacles import Obstacles, Post, Walker, Wall
from sim.toml_file import build, read_named

NAMED_OBSTACLES: dict[str, Obstacles] = {
    # beside and behind the circles, two of them closer to the largest one than a plate is long
    "posts": Obstacles(
        posts=(Post(2.3, 2.0), Post(-5.3, 4.0), Post(1.6, 6.0), Post(-1.5, 7.2, 0.15), Post(-3.5, -0.8))
    ),
    "room": Obstacles(
        walls=(
            Wall(-6.0, -2.0, -6.0, 8.0),
            Wall(-6.0, 8.0, 3.0, 8.0),
            Wall(3.0, 8.0, 3.0, -2.0),
            Wall(3.0, -2.0, -6.0, -2.0),
        )
    ),
    # between the scanner and the circles, so that the plate is hidden at times
    "walker": Obstacles(walkers=(Walker(-4.5, -0.7, 1.0, 0.0, turns_after=6.0),)),
    # it hides a part of every circle
    "occluded": Obstacles(posts=(Post(-1.61, -0.71),)),
}


def load_obstacles(source: str) -> Obstacles:
    """Load named obstacles, or those of a TOML file with tables `[[posts]]`, `[[walls]]` and `[[walkers]]`.

    Raises InvalidValueError for any other source, SettingsFileError for an unreadable file and invalid fields.
    """
    if source in NAMED_OBSTACLES:
        return NAMED_OBSTACLES[source]
    return build(Obstacles, read_named("obstacles", source, NAMED_OBSTACLES), source)
