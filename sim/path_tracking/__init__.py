"""Path tracking as a learning task: the parts of the environments in `sim.env`."""
