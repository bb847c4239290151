"""Path tracking as a learning task, on which `sim.env` builds environments."""
