"""The bare engine: the physics of a fleet with nothing around it."""

from __future__ import annotations

from mujoco import batch

from sim.fleet import Fleet


def bare_batch(fleet: Fleet) -> batch.Batch:
    """Robots in the fleet's present state, their belts at its present speeds, stepped by MuJoCo alone."""
    bare = batch.Batch(fleet.robot.model, fleet.size, nthread=fleet.batch.nthread)
    for name in ("geom_surfacevel", "pair_friction"):
        bare.expand(name)[:] = fleet.batch.expand(name)
    bare.state[:] = fleet.batch.state
    return bare
