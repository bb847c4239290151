"""Tracks for any MuJoCo robot: needs MuJoCo and NumPy only.

tracks = add_tracks(spec, "chassis", half_gauge=0.2, hull=[(-0.25, 0.08, 0.08), (0.25, 0.08, 0.08)])
tracks.connect(spec)  # with every colliding geom that is fixed to the world
model = spec.compile()
belts = bind(model, tracks)
belts.set(model, [0.3, 0.3])  # [m/s]
"""

from sim.tracks.add import Tracks, add_tracks
from sim.tracks.belts import BatchBelts, Belts, Reading, bind
from sim.tracks.drawing import DrawnTracks
from sim.tracks.motors import MotorReading
from sim.tracks.recipe import PRESETS, Preset

__all__ = [
    "PRESETS",
    "BatchBelts",
    "Belts",
    "DrawnTracks",
    "MotorReading",
    "Preset",
    "Reading",
    "Tracks",
    "add_tracks",
    "bind",
]
