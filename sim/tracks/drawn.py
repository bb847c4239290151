"""Tracks in pictures: band, shoes and wheels in the scene of MuJoCo's viewer or renderer."""

from __future__ import annotations

import mujoco
import numpy as np

from sim.tracks.belts import bind
from sim.tracks.looks import TrackLook, draw
from sim.tracks.parts import TrackParts
from trackslip.errors import require_positive


class DrawnTracks:
    """Draws the tracks of a compiled model, with belts and wheels that turn; what collides is hidden, in geom group 3.

    In a loop with MuJoCo's viewer, after each step:

        viewer.user_scn.ngeom = 0
        drawn.draw(viewer.user_scn, data)
        viewer.sync()
    """

    def __init__(self, model: mujoco.MjModel, *tracks: TrackParts, width: float = 0.08) -> None:
        """Get ready to draw belts of some `width` [m].

        Raises InvalidValueError if the model lacks one of the tracks, and for a width that isn't positive.
        """
        require_positive("width", width)
        self._model, self._belts = model, bind(model, *tracks)
        self._bodies = [model.body(body).id for each in tracks for body in each.bodies]
        self._looks = [TrackLook(each.hull.wheels, 0.0, width) for each in tracks for _ in each.bodies]
        self._travel = np.zeros(len(self._bodies))
        self._time = 0.0

    def draw(self, scene: mujoco.MjvScene, data: mujoco.MjData) -> None:
        """Append the tracks to a scene; since they were last drawn, the belts have run at the speeds of now."""
        passed = data.time - self._time
        if passed < 0:  # the simulation was reset
            self._travel[:] = passed = 0.0
        self._time = data.time
        self._travel += self._belts.speeds(self._model) * passed
        for body, look, way in zip(self._bodies, self._looks, self._travel, strict=True):
            draw(scene, look.pieces(way), data.xpos[body], data.xmat[body].reshape(3, 3))
