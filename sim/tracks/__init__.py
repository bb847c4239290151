"""Tracks for any MuJoCo robot; the package needs only MuJoCo and NumPy.

add_tracks(spec, "chassis", Track(half_gauge=0.2, hull=[(-0.25, 0.08, 0.08), (0.25, 0.08, 0.08)]))
connect(spec)  # to all colliding geoms that are fixed to the world
model = spec.compile()
belts = Belts(model)
belts.set([0.3, 0.3])  # [m/s]
"""

from sim.motors.belt_motors import MotorReading
from sim.tracks.belts import BatchBelts, Belts
from sim.tracks.connect import add_tracks, connect
from sim.tracks.drawing import DrawnTracks
from sim.tracks.reading import Reading
from sim.tracks.recipe import PRESETS, Preset
from sim.tracks.track import Track

__all__ = [
    "PRESETS",
    "BatchBelts",
    "Belts",
    "DrawnTracks",
    "MotorReading",
    "Preset",
    "Reading",
    "Track",
    "add_tracks",
    "connect",
]
