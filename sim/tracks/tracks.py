"""Tracks that were added to a spec."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import mujoco

from sim.tracks.belts import Belts, bind
from sim.tracks.connect import connect
from sim.tracks.parts import TrackParts


@dataclass(frozen=True)
class Tracks(TrackParts):
    """The tracks of one call of `add_tracks`: each a body without joints, with its geoms and a contact sensor."""

    def prefixed(self, prefix: str) -> Tracks:
        """Return these tracks under the names that they have after `attach` with a prefix."""
        return replace(
            self,
            names=tuple(prefix + name for name in self.names),
            bodies=tuple(prefix + body for body in self.bodies),
            geoms=tuple(tuple(prefix + geom for geom in geoms) for geoms in self.geoms),
        )

    def connect(self, spec: mujoco.MjSpec, terrain: Iterable[object] | None = None) -> None:
        """Let these tracks touch the geoms `terrain` of the spec; see `sim.tracks.connect.connect`."""
        connect(spec, self, terrain)

    def bind(self, model: mujoco.MjModel) -> Belts:
        """Return the belts of these tracks in a compiled model; see `sim.tracks.belts.bind`."""
        return bind(model, self)
