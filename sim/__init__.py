"""The simulated world: tracked robots on grounds in MuJoCo, and a laser range finder that observes
them.

    import numpy as np
    import sim

    fleet = sim.Fleet(sim.load_robot(), np.zeros((2, 3)))
    logs = sim.open_loop(fleet, np.array([[2.0, 3.0], [3.0, 4.0]]), duration=10.0)

The names below are imported at their first use. Importing this package registers the environments
trackslip/PathTracking-v0 and trackslip/Traverse-v0:
`gymnasium.make("sim:trackslip/PathTracking-v0")`.
"""

import contextlib

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

with contextlib.suppress(ImportError):  # sim.tracks and sim.terrain don't need gymnasium
    import gymnasium

    for _task in ("PathTracking", "Traverse"):
        gymnasium.register(
            id=f"trackslip/{_task}-v0",
            entry_point=f"sim.env:{_task}Env",
            vector_entry_point=f"sim.env:{_task}VectorEnv",
        )
