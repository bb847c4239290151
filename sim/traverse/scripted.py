"""The scripted controller: along the middle of the course at a steady speed, with the flippers on reflex."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sim.traverse.reflex import Reflex
from sim.traverse.world import Command, Traverse
from trackslip.errors import require_non_negative, require_positive


@dataclass(frozen=True)
class Scripted:
    """Drives along y = 0 and keeps the flippers on reflex."""

    speed: float = 0.4
    """Forward speed of the belts [m/s]."""
    position_gain: float = 0.3
    """Belt speed per distance from the middle [1/s]."""
    heading_gain: float = 0.45
    """Belt speed per heading [m/s]."""
    turn: float = 0.3
    """Largest difference of a belt's speed from the mean of both [m/s]."""
    reflex: Reflex = field(default_factory=Reflex)
    """Of the flippers."""

    def __post_init__(self) -> None:
        require_positive("speed", self.speed)
        for name in ("position_gain", "heading_gain", "turn"):
            require_non_negative(name, getattr(self, name))

    def command(self, world: Traverse) -> Command:
        """Set points of all robots in `world`."""
        state = world.state
        aside = -self.position_gain * state.position[:, 1] - self.heading_gain * state.heading
        turn = np.clip(aside, -self.turn, self.turn)
        return Command(self.speed + turn[:, None] * np.array([-1.0, 1.0]), world.reflex(self.reflex))
