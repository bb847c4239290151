"""The simulated world: robots on MuJoCo grounds, their drives, and the laser range finder that watches them.

Importing it registers the gymnasium environments; they load no simulator before they are made.
"""

import gymnasium

gymnasium.register(
    id="trackslip/PathTracking-v0",
    entry_point="sim.env:PathTrackingEnv",
    vector_entry_point="sim.vector_env:PathTrackingVectorEnv",
)
