"""The simulated world: robots on MuJoCo grounds, their drives, and the laser range finder that watches them.

The gymnasium environments are registered as soon as gymnasium is there too, whichever is imported first.
"""

from sim.registration import register_with_gymnasium

register_with_gymnasium()
