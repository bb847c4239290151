"""Path tracking as a task to learn: what the environments of `sim.env` and `sim.vector_env` are made of."""
